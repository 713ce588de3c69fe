"""What it does to an electrolyte when the lattice sum of its charges kicks every n steps only.

The fluid of in.electrolyte (375 beads, 44 of them ions), `middle` and `bababo`: kinetic temperature, energy and pressure, and the number of
anions within one length unit of a cation, with standard errors; the table of docs/howto/charges.md.

    python docs/measure/slow_charges.py             # about ten minutes of one core
    python docs/measure/slow_charges.py --time 50   # a look
"""

from __future__ import annotations

import argparse
import time
from dataclasses import replace
from pathlib import Path

import numpy as np

import openmm_dpd as dpd
from openmm_dpd.lammps import deck_scene
from openmm_dpd.plan.plan import make_plan
from openmm_dpd.simulation.build import build_plan
from openmm_dpd.stats import block_average

DECK = Path(__file__).resolve().parents[2] / "examples" / "decks" / "in.electrolyte"

#: Scheme, step, and after how many steps the lattice sum kicks.
CASES = [(scheme, dt, n) for scheme, dt in (("middle", 0.02), ("bababo", 0.05)) for n in (1, 2, 4)]


def neighbours(x: np.ndarray, charges: np.ndarray, box: np.ndarray, reach: float = 1.0) -> float:
    """Mean number of anions closer to a cation than this."""
    d = x[charges > 0][:, None] - x[charges < 0][None]
    d -= np.rint(d / np.diag(box)) * np.diag(box)
    return float(np.sum(np.sum(d**2, axis=-1) < reach**2) / np.sum(charges > 0))


def row(scene: dpd.Scene, scheme: str, dt: float, every: int, length: float) -> str:
    """A line of the table."""
    plan = make_plan(scene, dt=dt, scheme=scheme, platform="CPU", seed=1, slow_every=every)
    execution = replace(plan.execution, held=plan.execution.held - {"charges"})  # so few charges are the kernel's otherwise
    built = build_plan(replace(plan, options=replace(plan.options, execution=execution)))
    simulation, observer = built.simulation(properties={"Threads": "1"}), dpd.Observer(built)
    simulation.step(int(20 / dt))
    samples, spent = [], 0.0
    for _ in range(int(length / 0.2)):
        begun = time.perf_counter()
        simulation.step(round(0.2 / dt))
        spent += time.perf_counter() - begun
        sample = observer.sample(simulation.context)
        x = simulation.context.getState(positions=True).getPositions(asNumpy=True)._value
        potential = (sample.pair + sample.bond) / scene.n_beads
        samples.append((sample.kT, potential, sample.pressure(), neighbours(x, scene.charges, scene.box)))
    texts = []
    for column in np.array(samples).T:
        average = block_average(column)
        texts.append(f"{average.mean:.4f}({average.sem:.4f})")
    return f"| `{scheme}`, {dt:g} | {every} | {' | '.join(texts)} | {1e3 * spent / (len(samples) * round(0.2 / dt)):.2f} |"


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--time", type=float, default=600.0, help="simulated time of each run")
    options = parser.parse_args()
    dpd.set_threads(1)
    scene = deck_scene(DECK)
    print("| scheme, step | every | kT | energy per bead | pressure | anions near a cation | ms per step |")
    print("| --- | --- | --- | --- | --- | --- | --- |")
    for case in CASES:
        print(row(scene, *case, options.time), flush=True)


if __name__ == "__main__":
    main()
