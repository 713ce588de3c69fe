"""Scenes that are exported to LAMMPS, and LAMMPS run on the result: every kind of term a scene can hold, without noise."""

import os
import subprocess
import sys
from pathlib import Path

import lammps_peer
import numpy as np

import openmm_dpd as dpd
from openmm_dpd import DPD, NONE

BIN = Path(sys.prefix) / "bin"

TWO = {("*", "*"): DPD(A=25, gamma=4.5), ("A", "B"): DPD(A=40, gamma=5.5, cutoff=0.9)}


def why_missing() -> str | None:
    """None when LAMMPS can be run with mpirun here, otherwise the reason in words."""
    lacking = [name for name in ("mpirun", "lmp") if not (BIN / name).exists()]
    return f"there is no {' and no '.join(lacking)} in {BIN}" if lacking else lammps_peer.why_missing()


def run_lammps(folder: Path, name: str, processes: int = 1) -> str:
    """Run ``in.NAME`` in its folder, unchanged; returns the log.  Processes that wait for each other take a processor each, so most tests use one."""
    environment = dict(os.environ, OMP_NUM_THREADS="1", LD_LIBRARY_PATH=str(Path(sys.prefix) / "lib"))
    import lammps

    several = [str(BIN / "mpirun"), "-np", str(processes)] if processes > 1 else []
    lmp = Path(lammps.__file__).with_name("lmp")  # behind the script of this name, which starts Python first
    command = [*several, str(lmp), "-in", f"in.{name}", "-log", f"log.{name}", "-screen", "none"]
    done = subprocess.run(command, cwd=folder, env=environment, capture_output=True, text=True, timeout=300)
    log = (folder / f"log.{name}").read_text() if (folder / f"log.{name}").exists() else ""
    assert done.returncode == 0 and "Total wall time" in log, f"{log[-2000:]}\n{done.stdout[-1000:]}\n{done.stderr[-1000:]}"
    return log


def thermo(log: str) -> dict[str, np.ndarray]:
    """Columns of the thermo output of the last run in a log."""
    lines = log.splitlines()
    start = max(k for k, line in enumerate(lines) if line.split()[:1] == ["Step"])
    end = next(k for k in range(start, len(lines)) if lines[k].startswith("Loop time"))
    values = np.array([[float(word) for word in line.split()] for line in lines[start + 1 : end] if line.split()[0].isdigit()])
    return dict(zip(lines[start].split(), values.T, strict=True))


def _beads(n: int = 240, edge: float = 4.5, seed: int = 5) -> dict:
    rng = np.random.default_rng(seed)
    types, x = ["A" if k % 3 else "B" for k in range(n)], rng.random((n, 3)) * edge * 2 - edge  # some outside the box: image flags
    known = {"masses": {"A": 1.0, "B": 2.0}, "kT": 0.0, "box": [edge, edge + 0.5, edge + 1.0]}
    return {"types": types, "positions": x, "velocities": rng.normal(size=(n, 3)), **known}


def chains(count: int = 30, length: int = 8, edge: float = 5.0, seed: int = 6) -> tuple[dict, np.ndarray, np.ndarray]:
    """Random walks with steps of 0.7 in a box: what Scene takes but pairs, bonds, angles."""
    rng = np.random.default_rng(seed)
    steps = rng.normal(size=(count, length, 3))
    steps *= 0.7 / np.linalg.norm(steps, axis=2, keepdims=True)
    steps[:, 0] = rng.random((count, 3)) * edge
    beads = _beads(count * length, edge, seed) | {"positions": np.cumsum(steps, axis=1).reshape(-1, 3), "box": [edge] * 3}
    first = np.arange(count * length).reshape(count, length)
    bonds = np.column_stack([first[:, :-1].ravel(), first[:, 1:].ravel()])
    angles = np.column_stack([first[:, :-2].ravel(), first[:, 1:-1].ravel(), first[:, 2:].ravel()])
    return beads | {"molecules": np.arange(count * length) // length + 1}, bonds, angles


def scene(name: str) -> dpd.Scene:
    """One of :data:`SCENES`."""
    return SCENES[name]()


def _chain_terms() -> dpd.Scene:
    beads, bonds, angles = chains()
    half = len(bonds) // 2
    springs = [dpd.HarmonicBonds(bonds[:half], 100.0, np.linspace(0.5, 0.8, half)), dpd.FENEBonds(bonds[half:-40], 30.0, 1.5, 1.0, 0.5)]
    springs.append(dpd.MorseBonds(bonds[-40:], 50.0, 2.0, 0.6))
    bends = [dpd.CosineAngles(angles[:90], 5.0), dpd.HarmonicAngles(angles[90:], 3.0, 2.0)]
    return dpd.Scene(pairs=TWO, bonds=springs, angles=bends, bonded_factors=(0.5, 0.0, 1.0), **beads)


def _segments(distance: str, compat: str = "consistent") -> dpd.Scene:
    beads, bonds, _ = chains()
    repulsion = dpd.SegmentalRepulsion(50.0, 0.8, distance, bonds=bonds[:100])
    springs = [dpd.HarmonicBonds(bonds[:100], 100.0, 0.7), dpd.HarmonicBonds(bonds[100:], 90.0, 0.7)]
    return dpd.Scene(pairs=TWO, bonds=springs, segments=repulsion, compat=compat, **beads)


def _overlay() -> dpd.Scene:
    beads = _beads()  # no close pairs and no curvature at the end: there tables are interpolated differently
    grid = np.stack(np.meshgrid(*[np.arange(7)] * 3, indexing="ij"), axis=-1).reshape(-1, 3)[:240]
    beads["positions"] = (grid + 0.5 * np.random.default_rng(3).random((240, 3))) * np.array(beads["box"]) / 7
    r = np.linspace(0.0, 1.2, 400)
    layers = [{("A", "A"): DPD(A=25, gamma=4.5), ("B", "B"): DPD(A=10, gamma=1)}, {("A", "A"): DPD(A=3, gamma=1.0, cutoff=1.3)}]
    layers.append({("B", "B"): dpd.LennardJones(1e-6, 0.3, 1.0, shift=True)})
    layers.append({("A", "B"): NONE, ("A", "A"): dpd.TabulatedPair(r, 10 * (1.2 - r) ** 3, 30 * (1.2 - r) ** 2)})
    return dpd.Scene(pairs=layers, **beads)


def _energy() -> dpd.Scene:
    beads = _beads()
    n = len(beads["types"])
    table = dpd.TabulatedEOS(np.array([0.5, 1.0, 2.0, 3.0]), np.array([10.0, 30.0, 80.0, 120.0]))
    internal = dpd.InternalEnergy({"A": dpd.ConstantHeatCapacity(50.0), "B": table}, 1 + np.random.default_rng(1).random(n))
    return dpd.Scene(pairs={("*", "*"): dpd.EnergyDPD(A=25)}, internal=internal, mobile=np.arange(n) > 40, **beads)


def _heat() -> dpd.Scene:
    beads = _beads() | {"masses": {"A": 1.0, "B": 1.0}}
    n = len(beads["types"])
    table = {("*", "*"): dpd.EDPD(A=18, gamma=0.0, kappa=0.0, exponent_polynomial=(1.0, 0, 0, 0))}
    internal = dpd.BeadTemperatures(1 + np.random.default_rng(1).random(n), 1e5)
    sphere = dpd.Source(dpd.Sphere([2, 2, 2], 1.5), 0.2, beads=np.arange(n) % 2 == 0)
    sources = [dpd.Source(dpd.Block([0, 0, 0], [np.inf, 2, 2]), 0.1), sphere]
    return dpd.Scene(pairs=table, internal=internal, sources=sources, compat="lammps", **beads)


def _species() -> dpd.Scene:
    beads = _beads()
    species = dpd.Concentrations(np.random.default_rng(1).random((len(beads["types"]), 2)))
    sources = [dpd.Source(dpd.Block([0, 0, 0], [np.inf, 2, 2]), 0.1, 1)]
    return dpd.Scene(pairs={("*", "*"): dpd.TDPD(A=18, gamma=4.5, kappa=(1.0, 2.0))}, internal=species, sources=sources, **beads)


def _energy_chains() -> dpd.Scene:
    beads, bonds, _ = chains()
    internal = dpd.InternalEnergy(dpd.ConstantHeatCapacity(50.0), 1.0)
    bonds = [dpd.HarmonicBonds(bonds, 100.0, 0.7)]
    return dpd.Scene(pairs={("*", "*"): dpd.EnergyDPD(A=25)}, internal=internal, bonds=bonds, **beads)


def _frozen() -> dpd.Scene:
    beads = _beads()
    k = np.arange(len(beads["types"]))
    charges = np.random.default_rng(2).normal(size=len(k))
    return dpd.Scene(pairs=TWO, mobile=k % 4 > 0, bead_masses=1.0 + k % 5, charges=charges, molecules=k // 3, **beads)


def electrolyte(periodic: bool, tolerance: float = 1e-6, permittivity: float = 20.0, **changes) -> dpd.Scene:
    """60 ions of both signs in a fluid."""
    beads = _beads()
    n = len(beads["types"])
    charges = np.where(np.arange(n) < 60, np.where(np.arange(n) % 2, 1.0, -1.0), 0.0)
    if not periodic:
        beads["box"] = None
    smeared = dpd.SlaterCharges(lamda=0.25, permittivity=permittivity, cutoff=2.2 if periodic else None, tolerance=tolerance)
    return dpd.Scene(pairs=TWO, charges=charges, electrostatics=smeared, **beads | changes)


def _driven() -> dpd.Scene:
    """Between two walls, pushed by a sine and by a constant force."""
    beads = _beads()
    beads["positions"] = np.array(beads["positions"]) * [1, 1, 0]
    beads["positions"][:, 2] = np.random.default_rng(7).random(240) * 4
    forces = [dpd.BodyForce([1.0, 0, 0], pattern="sine", axis="z"), dpd.BodyForce([0, 2.0, 0], types="A")]
    walls = [dpd.Wall("z", -0.01, "above", "specular"), dpd.Wall("z", 4.01, "below", "specular")]
    return dpd.Scene(pairs=TWO, body_forces=forces, walls=walls, **beads)


SCENES = {  # Scenes by name; what is exported and read back must have the same forces.
    "fluid": lambda: dpd.Scene(pairs=TWO, **_beads()),
    "chains": _chain_terms,
    "segments": lambda: _segments("mid"),
    "nearest": lambda: _segments("min", "lammps"),
    "transverse": lambda: dpd.Scene(pairs={("*", "*"): DPD(A=25, gamma=4.5, gamma_perp=2.0, exponent=0.5, exponent_perp=1.5)}, **_beads()),
    "overlay": _overlay,
    "none": lambda: dpd.Scene(pairs={("*", "*"): DPD(A=25, gamma=4.5), ("A", "B"): NONE}, **_beads()),
    "many-body": lambda: dpd.Scene(pairs={("*", "*"): dpd.MDPD(A=-40, B=25, gamma=18, kernel="lucy")}, **_beads()),
    "energy": _energy,
    "energy-chains": _energy_chains,
    "heat": _heat,
    "species": _species,
    "tilted": lambda: dpd.Scene(pairs=TWO, **_beads() | {"box": np.array([[5.0, 0, 0], [1.2, 5, 0], [-0.7, 2.0, 5]])}),
    "open": lambda: dpd.Scene(pairs=TWO, **_beads() | {"box": None}),
    "frozen": _frozen,
    "electrolyte": lambda: electrolyte(True),
    "driven": _driven,
    "ions": lambda: electrolyte(False),
}
