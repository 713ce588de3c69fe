"""What measuring costs: CPU time of runs that measure in every step, and in every tenth, over that of the same runs without.

A fluid of two kinds of beads that keep apart, 3000 of them at density 3, on one thread.  With ``mvv`` scripts run with the two reporters and
without, and a deck averages its pressure tensor by fix ave/time, or does not.  Runs alternate, and the fastest piece of each counts.

    python benchmarks/measuring.py            # some minutes
    python benchmarks/measuring.py --rounds 3 # a look
"""

from __future__ import annotations

import os

os.environ["NUMBA_NUM_THREADS"] = os.environ["OMP_NUM_THREADS"] = "1"  # a second thread that waits takes CPU time too

import argparse
import io
import sys
import tempfile
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).parent))

from atlas_parts.summary import machine  # noqa: E402

import openmm_dpd as dpd  # noqa: E402
from openmm_dpd.lammps.run.main import run_deck  # noqa: E402
from openmm_dpd.lammps.run.options import RunOptions  # noqa: E402
from openmm_dpd.measure import StressReporter  # noqa: E402

BEADS, EDGE, STEPS = 3000, 10.0, 100

DECK = """units lj
boundary p p p
region box block 0 10 0 10 0 10
create_box 2 box
create_atoms 1 random 1500 8731 NULL
create_atoms 2 random 1500 9911 NULL
mass * 1.0
pair_style dpd 1.0 1.0 1234
pair_coeff 1 1 25 4.5
pair_coeff 2 2 25 4.5
pair_coeff 1 2 60 4.5
comm_modify vel yes
velocity all create 1.0 1
fix 1 all nve
timestep 0.03
variable gam equal lz/2*(pzz-0.5*(pxx+pyy))
{average}
thermo_style custom step temp press v_gam
thermo {steps}
run {steps}
"""


def reporters(scheme: str) -> dict[str, Callable[[], float]]:
    """CPU time of some steps, by what is measured."""
    x = np.random.default_rng(1).random((BEADS, 3)) * EDGE
    like, unlike = dpd.DPD(A=25, gamma=4.5), dpd.DPD(A=60, gamma=4.5)
    pairs = {("A", "A"): like, ("B", "B"): like, ("A", "B"): unlike}
    scene = dpd.Scene({"A": 1.0, "B": 1.0}, ["A", "B"] * (BEADS // 2), x, pairs, 1.0, box=[EDGE] * 3)

    def timed(reporter: Callable | None) -> Callable[[], float]:
        built = dpd.build(scene, dt=0.03, scheme=scheme, platform="CPU", seed=1)
        simulation = built.simulation()
        simulation.step(500)
        simulation.reporters += [] if reporter is None else [reporter(built)]

        def run() -> float:
            begun = time.process_time()
            simulation.step(STEPS)
            return time.process_time() - begun

        return run

    runs = {"without": timed(None)}
    for every in (1, 10):
        runs[f"DPDReporter({every})"] = timed(lambda built, every=every: dpd.DPDReporter(io.StringIO(), every, built))
        runs[f"StressReporter({every})"] = timed(lambda built, every=every: StressReporter(every, built))
    return runs


def decks(folder: Path, steps: int) -> dict[str, Callable[[], float]]:
    """CPU time of a deck that averages, or not."""

    def timed(name: str, average: str) -> Callable[[], float]:
        path = folder / f"in.{name}"
        path.write_text(DECK.format(average=average, steps=steps), encoding="utf-8")

        def run() -> float:
            begun = time.process_time()
            run_deck(path, RunOptions(threads=1, platform="CPU"), out=folder / name)
            return time.process_time() - begun

        return run

    averages = {f"fix ave/time {every}": f"fix avg all ave/time {every} {steps // every} {steps} v_gam" for every in (1, 10)}
    return {name: timed(name.replace("/", "_").replace(" ", "_"), text) for name, text in {"without": "", **averages}.items()}


def ratios(runs: dict[str, Callable[[], float]], rounds: int) -> dict[str, float]:
    """Fastest of all rounds over that without."""
    best = dict.fromkeys(runs, np.inf)
    for _ in range(rounds):
        for name, run in runs.items():
            best[name] = min(best[name], run())
    return {name: found / best["without"] for name, found in best.items() if name != "without"}


def main() -> None:
    """The table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--rounds", type=int, default=20)
    options = parser.parse_args()
    print(", ".join(f"{key} {value}" for key, value in machine().items()) + "\n\n| | every step | every 10 steps |\n| --- | --- | --- |")
    with tempfile.TemporaryDirectory() as folder:
        for where, runs in {
            "script, `mvv`": reporters("mvv"),
            "script, `middle`": reporters("middle"),
            "deck": decks(Path(folder), 1000),
        }.items():
            found = ratios(runs, options.rounds if where != "deck" else max(3, options.rounds // 5))
            for name in [name for name in found if not name.endswith(("(10)", " 10"))]:
                tenth = name.replace("(1)", "(10)").replace(" 1", " 10")
                print(f"| {where}: `{name}` | {found[name]:.2f} | {found[tenth]:.2f} |", flush=True)


if __name__ == "__main__":
    main()
