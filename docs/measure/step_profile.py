"""Where the time of a step goes on the CPU platform: lists of pairs, forces, sweeps, the rest of the loop, OpenMM.

The table of docs/atlas.md ("Where the time goes"), in ms per step; a quiet machine is needed.

    python docs/measure/step_profile.py --threads 1
    python docs/measure/step_profile.py --threads 2
    python docs/measure/step_profile.py --energy        # the fluid of in.dpde-shardlow
"""

from __future__ import annotations

import argparse
import time
from pathlib import Path

import numpy as np

import openmm_dpd as dpd
from openmm_dpd.kernels.engine import PairEngine
from openmm_dpd.kernels.steps import StepLoop
from openmm_dpd.lammps import deck_scene

DECK = Path(__file__).resolve().parents[2] / "examples" / "decks" / "in.dpde-shardlow"

#: What is timed: (class, method, name in the table).
PARTS = (
    (StepLoop, "run", "loop"), (PairEngine, "place", "lists"), (PairEngine, "forces", "forces"), (PairEngine, "swept", "sweep"),
)  # fmt: skip


def standard_fluid(beads: int = 10_000) -> dpd.Scene:
    """Density 3, repulsion 25, friction 4.5, on random points."""
    edge = (beads / 3) ** (1 / 3)
    x = np.random.default_rng(1).random((beads, 3)) * edge
    return dpd.Scene({"W": 1.0}, ["W"] * beads, x, {("W", "W"): dpd.DPD(A=25, gamma=4.5)}, kT=1.0, box=[edge] * 3)


def clocked(owner: type, name: str, label: str, spent: dict[str, float]) -> None:
    """Let a method add up the time it takes."""
    original = getattr(owner, name)

    def call(*arguments, **options):
        begun = time.perf_counter()
        try:
            return original(*arguments, **options)
        finally:
            spent[label] = spent.get(label, 0.0) + time.perf_counter() - begun

    setattr(owner, name, call)


def main() -> None:
    """Print a line per scheme."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--threads", type=int, default=1)
    parser.add_argument("--energy", action="store_true", help="energy-conserving beads")
    parser.add_argument("--schemes", nargs="+", default=["aboba", "bababo"])
    parser.add_argument("--steps", type=int, default=100)
    options = parser.parse_args()
    dpd.set_threads(options.threads)
    scene = deck_scene(DECK) if options.energy else standard_fluid()
    spent: dict[str, float] = {}
    for part in PARTS:
        clocked(*part, spent)
    for scheme in options.schemes:
        built = dpd.build(scene, dt=0.05, scheme=scheme, platform="CPU", seed=1)
        simulation = built.simulation(properties={"Threads": str(options.threads)})
        simulation.step(100)
        spent.clear()
        begun = time.perf_counter()
        simulation.step(options.steps)
        whole = time.perf_counter() - begun
        inside = sum(spent[name] for name in ("lists", "forces", "sweep"))
        rows = {name: spent[name] for name in ("lists", "forces", "sweep")}
        rows |= {"rest of the loop": spent["loop"] - inside, "from OpenMM and back": whole - spent["loop"], "all": whole}
        print(f"{scheme}: " + ", ".join(f"{name} {1e3 * seconds / options.steps:.2f}" for name, seconds in rows.items()))


if __name__ == "__main__":
    main()
