"""What a pair costs: nanoseconds of a step for each pair of beads, of every kind, with friction as a force and in exact updates.

Each kind is one deck, which LAMMPS and this package read: a fluid of one type or two, 14 nm wide, one thread, a step of 0.01.  The first
column of ours does what LAMMPS does; the others are exact updates.  All run in this process, in turn, in pieces of 20 steps; printed are
medians of CPU times, and behind a ratio the middle half of those of single rounds.  Writes the table of docs/atlas.md.

    python benchmarks/pairs.py                          # ten minutes on a quiet machine
    python benchmarks/pairs.py --kinds edpd --rounds 5  # a look, not written
"""

from __future__ import annotations

import os

os.environ["NUMBA_NUM_THREADS"] = os.environ["OMP_NUM_THREADS"] = "1"  # a second thread that waits takes CPU time too

import argparse
import dataclasses
import datetime
import sys
import tempfile
import time
from collections.abc import Callable
from contextlib import ExitStack
from pathlib import Path
from typing import NamedTuple

import numpy as np
from scipy.spatial import cKDTree

ROOT = Path(__file__).resolve().parents[1]
sys.path.insert(0, str(Path(__file__).parent))

from atlas_parts import page  # noqa: E402
from atlas_parts.summary import machine  # noqa: E402
from live_lammps import instance  # noqa: E402

import openmm_dpd as dpd  # noqa: E402
from openmm_dpd.lammps import deck_scene  # noqa: E402

EDGE, DT, STEPS = 14.0, 0.01, 20
EXACT = ("middle", "bababo")


class Kind(NamedTuple):
    """Lines of a deck, the coefficients of two types {i} and {j} with a repulsion {A}, and what does here what LAMMPS does."""

    atoms: str
    style: str
    pair: str
    fixes: str = "fix move all nve"
    scheme: str = "mvv"
    exact: bool = True
    cutoff: float = 1.0
    density: float = 3.0


_INSIDE = "fix move all nve\nfix inside all eos/cv 60.0\nset atom * dpd/theta 1.0"
_ENERGY = "dpd", "dpd/fdt/energy 1.0 34387", "{i} {j} {A} 3.0 1.0 1.0"
_POWERS = "power 10.54 -3.66 3.44 -4.10 kappa -0.44 -3.21 5.04 0.0"
_DENSITIES = "hybrid/overlay mdpd/rhosum mdpd 1.0 1.0 34387\npair_coeff * * mdpd/rhosum 0.75"
KINDS = {
    "dpd": Kind("atomic", "dpd 1.0 1.0 34387", "{i} {j} {A} 4.5 1.0"),
    "dpd/ext": Kind("atomic", "dpd/ext 1.0 1.0 34387", "{i} {j} {A} 4.5 4.5 0.5 0.5 1.0"),
    "dpd/fdt, shardlow": Kind("dpd", "dpd/fdt 1.0 1.0 34387", "{i} {j} {A} 3.0 1.0", "fix bath all shardlow\nfix move all nve", "shardlow"),
    "dpd/fdt/energy": Kind(*_ENERGY, f"fix heat all dpd/energy\n{_INSIDE}"),
    "dpd/fdt/energy, shardlow": Kind(*_ENERGY, f"fix bath all shardlow\n{_INSIDE}", "shardlow", False),
    "edpd": Kind(
        "edpd",
        "edpd 1.58 34387",
        "{i} {j} {A} 4.5 0.41 1.58 1.41e-5 2.0 1.58 " + _POWERS,
        "fix move all mvv/edpd 0.5\nset atom * edpd/temp 1.0\nset atom * edpd/cv 1.0e5",
        cutoff=1.58,
    ),
    "tdpd": Kind(
        "tdpd 2",
        "tdpd 1.0 1.58 34387",
        "{i} {j} {A} 4.5 0.41 1.58 1.58 1.0 1.0e-5 2.0 3.0 1.0e-5 2.0",
        "fix move all mvv/tdpd 0.5\nset atom * cc 1 1.0\nset atom * cc 2 1.0",
        cutoff=1.58,
    ),
    "mdpd": Kind("mdpd", _DENSITIES, "{i} {j} mdpd -{A} 25.0 4.5 1.0 0.75", "fix move all mvv/dpd 0.5", density=6.0),
}


def deck(kind: Kind, types: int) -> str:
    """A fluid of so many types, in turn equally many beads of each."""
    count = round(kind.density * EDGE**3 / types)
    made = "\n".join(f"create_atoms {t} random {count} {1617 + t} NULL" for t in range(1, types + 1))
    pairs = ((i, j) for j in range(1, types + 1) for i in range(1, j + 1))
    rows = "\n".join(f"pair_coeff {kind.pair.format(i=i, j=j, A=25.0 + j - i)}" for i, j in pairs)
    box = f"region box block 0 {EDGE} 0 {EDGE} 0 {EDGE}\ncreate_box {types} box\n{made}\nmass * 1.0\nvelocity all create 1.0 1123"
    pairs = f"pair_style {kind.style}\n{rows}\ncomm_modify vel yes\nneighbor 0.3 bin\nneigh_modify every 1 delay 0 check yes"
    return f"units lj\natom_style {kind.atoms}\n{box}\n{pairs}\n{kind.fixes}\ntimestep {DT}\nthermo 1000000\nrun 200 post no\n"


def cpu_time(run: Callable[[], object]) -> float:
    """ms per step."""
    begun = time.process_time()
    run()
    return (time.process_time() - begun) / STEPS * 1e3


def measured(kind: Kind, types: int, rounds: int) -> tuple[float, dict[str, np.ndarray]]:
    """Pairs, and ms per step in each round."""
    with ExitStack() as stack:
        file = Path(stack.enter_context(tempfile.TemporaryDirectory())) / "in.pairs"
        file.write_text(deck(kind, types))
        theirs, scene = stack.enter_context(instance()), deck_scene(file)
        theirs.file(str(file))
        runs: dict[str, Callable[[], object]] = {"LAMMPS": lambda: theirs.command(f"run {STEPS} pre no post no")}
        for scheme in (kind.scheme, *(EXACT if kind.exact else ())):
            its = scene if scheme == kind.scheme else dataclasses.replace(scene, compat="consistent")
            simulation = dpd.build(its, dt=DT, scheme=scheme, platform="CPU", seed=1).simulation()
            simulation.step(200)
            runs[scheme] = lambda simulation=simulation: simulation.step(STEPS)
        found = [[cpu_time(run) for run in runs.values()] for _ in range(rounds)]
        x = simulation.context.getState(positions=True).getPositions(asNumpy=True)._value % EDGE
    pairs = len(cKDTree(x, boxsize=EDGE).query_pairs(kind.cutoff, output_type="ndarray"))
    return pairs, dict(zip(runs, np.array(found).T, strict=True))


def row(name: str, types: int, rounds: int, of_dpd: dict[str, float]) -> list[str]:
    """Cells of a kind; those of dpd with one type come first."""
    kind = KINDS[name]
    pairs, found = measured(kind, types, rounds)
    theirs, ours = found["LAMMPS"], found[kind.scheme]
    low, middle, high = np.quantile(theirs / ours, (0.25, 0.5, 0.75))
    cells = [name, str(types), f"{np.median(theirs):.1f}", f"{np.median(ours):.2f}", f"{middle:.1f} ({low:.1f} to {high:.1f})"]
    for scheme in (kind.scheme, *EXACT):
        ns = 1e6 * np.median(found[scheme]) / pairs if scheme in found else np.nan
        over = ns / of_dpd.setdefault(scheme, ns)
        cells.append("" if np.isnan(ns) else f"{ns:.0f}" if scheme not in EXACT else f"{ns:.0f}: {over:.2f}")
    return cells


def main() -> None:
    """Measure, print, write."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--rounds", type=int, default=15)
    parser.add_argument("--kinds", nargs="+", choices=KINDS, help="only these, and no page")
    options = parser.parse_args()
    dpd.set_threads(1)
    found, of_dpd = [], dict[str, float]()
    for name in options.kinds or KINDS:
        for types in (1, 2):
            found.append(row(name, types, options.rounds, of_dpd))
            print(" | ".join(found[-1]), flush=True)
    head = ["pair style", "types", "LAMMPS, ms", "here, ms", "ratio", "ns per pair", *(f"`{scheme}`: over dpd" for scheme in EXACT)]
    about = machine()
    text = f"{datetime.date.today()}, {about['processor']}, LAMMPS {about['lammps']}.\n\n{page.table(head, found)}"
    if not options.kinds:
        page.update(ROOT / "docs" / "atlas.md", texts={"pairs": text})


if __name__ == "__main__":
    main()
