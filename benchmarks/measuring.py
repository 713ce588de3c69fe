"""What measuring costs: CPU time of steps that are measured, every one or every tenth, over that of the same steps without.

A fluid of two kinds of beads that keep apart, at density 3, on one thread.  Scripts run with the two reporters and without, and a deck
averages its pressure tensor by fix ave/time, or does not: its steps alone are counted, without a trajectory.  Runs alternate, and the
fastest piece of each counts.

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
from contextlib import redirect_stdout
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).parent))

from atlas_parts.summary import machine  # noqa: E402

import openmm_dpd as dpd  # noqa: E402
from openmm_dpd.lammps.run.main import run_deck  # noqa: E402
from openmm_dpd.lammps.run.options import RunOptions  # noqa: E402
from openmm_dpd.lammps.run.stepping import DeckSteps  # noqa: E402
from openmm_dpd.measure import StressReporter  # noqa: E402

#: Beads, and steps of a piece, of about a tenth of a second.
SIZES = {375: 1000, 2000: 250, 10_000: 60}

DECK = """units lj
boundary p p p
region box block 0 {edge} 0 {edge} 0 {edge}
create_box 2 box
create_atoms 1 random {half} 8731 NULL
create_atoms 2 random {half} 9911 NULL
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


def reporters(scheme: str, beads: int, steps: int) -> dict[str, Callable[[], float]]:
    """CPU time of some steps, by what is measured."""
    edge = (beads / 3) ** (1 / 3)
    x = np.random.default_rng(1).random((beads, 3)) * edge
    like, unlike = dpd.DPD(A=25, gamma=4.5), dpd.DPD(A=60, gamma=4.5)
    pairs = {("A", "A"): like, ("B", "B"): like, ("A", "B"): unlike}
    scene = dpd.Scene({"A": 1.0, "B": 1.0}, (["A", "B"] * beads)[:beads], x, pairs, 1.0, box=[edge] * 3)

    def timed(reporter: Callable | None) -> Callable[[], float]:
        built = dpd.build(scene, dt=0.03, scheme=scheme, platform="CPU", seed=1)
        simulation = built.simulation()
        simulation.step(500)
        simulation.reporters += [] if reporter is None else [reporter(built)]

        def run() -> float:
            begun = time.process_time()
            simulation.step(steps)
            return time.process_time() - begun

        return run

    runs = {"without": timed(None)}
    for every in (1, 10):
        runs[f"DPDReporter({every})"] = timed(lambda built, every=every: dpd.DPDReporter(io.StringIO(), every, built))
        runs[f"StressReporter({every})"] = timed(lambda built, every=every: StressReporter(every, built))
    return runs


def decks(folder: Path, scheme: str, beads: int, steps: int) -> dict[str, Callable[[], float]]:
    """CPU time of the steps of a deck that averages, or not."""
    real = DeckSteps.step_from

    def timed(name: str, average: str) -> Callable[[], float]:
        path = folder / f"in.{name}"
        text = DECK.format(average=average, steps=steps, edge=(beads / 3) ** (1 / 3), half=beads // 2)
        path.write_text(text, encoding="utf-8")

        def run() -> float:
            spent = [0.0]

            def step_from(*arguments) -> None:
                begun = time.process_time()
                real(*arguments)
                spent[0] = time.process_time() - begun

            DeckSteps.step_from = step_from  # type: ignore[method-assign]
            try:
                with redirect_stdout(io.StringIO()):
                    run_deck(path, RunOptions(threads=1, platform="CPU", scheme=scheme))
            finally:
                DeckSteps.step_from = real  # type: ignore[method-assign]
            return spent[0]

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
    print(", ".join(f"{key} {value}" for key, value in machine().items()))
    heads = [f"{beads:,} beads, every {which}" for beads in SIZES for which in ("step", "tenth")]
    print(f"\n| | {' | '.join(heads)} |\n|{' --- |' * (len(heads) + 1)}")
    with tempfile.TemporaryDirectory() as folder:
        for scheme in ("mvv", "middle"):
            found = list[dict[str, float]]()
            for beads, steps in SIZES.items():
                found.append(ratios(reporters(scheme, beads, steps), options.rounds))
                found[-1] |= ratios(decks(Path(folder), scheme, beads, 5 * steps), max(3, options.rounds // 5))
            for name in ("DPDReporter(1)", "StressReporter(1)", "fix ave/time 1"):
                pairs = [(its[name], its[name.replace("1", "10")]) for its in found]
                print(
                    f"| `{scheme}`: `{name[:-2].rstrip('(')}` | {' | '.join(f'{ratio:.2f}' for pair in pairs for ratio in pair)} |",
                    flush=True,
                )


if __name__ == "__main__":
    main()
