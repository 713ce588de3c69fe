"""What a pass over the pairs costs per bead, by number and order of the beads, with the pairs stored and listed in passing.

The numbers of docs/atlas.md ("How far to the bound"): standard fluid at random positions, one thread, nanoseconds of CPU time per bead, the
best of many calls, which alternate.

    python docs/measure/loops_by_size.py               # a minute
    python docs/measure/loops_by_size.py 10000 100000
"""

from __future__ import annotations

import sys
import time
from collections import defaultdict

import numpy as np
from list_life import standard_fluid

import openmm_dpd as dpd
from openmm_dpd.kernels.engine import PairEngine
from openmm_dpd.kernels.layer import CONSERVATIVE, DISSIPATIVE, EXACT, RANDOM
from openmm_dpd.plan.plan import make_plan

ALL, SECONDS = CONSERVATIVE | DISSIPATIVE | RANDOM, 60.0


def engines(beads: int) -> dict[str, tuple]:
    """Engines whose beads lie in the order of their cells or in none, with pairs that are stored or passing, and their positions."""
    scene, found = standard_fluid(beads), {}
    edge = float(scene.box[0, 0])
    cells = (scene.positions * (int(edge) / edge)).astype(int)
    for order, names in (("in order", np.lexsort(cells.T)), ("in none", np.arange(beads))):
        for many in (False, True):
            engine = PairEngine(make_plan(scene, dt=0.1, seed=1).spec)
            engine.lists[0].many = many
            found[f"{order}, {'passing' if many else 'stored'}"] = engine, np.ascontiguousarray(scene.positions[names]), scene.box.copy()
    return found


def main() -> None:
    """Print a line per number of beads, order and way."""
    dpd.set_threads(1)
    sizes = [int(size) for size in sys.argv[1:]] or [10_000, 100_000, 1_000_000]
    cases = {(beads, name): case for beads in sizes for name, case in engines(beads).items()}
    best: dict[tuple, dict[str, float]] = defaultdict(dict)
    end, first = time.monotonic() + SECONDS, True
    while first or time.monotonic() < end:
        for (beads, name), (engine, x, box) in cases.items():
            v, out, pairs = np.random.default_rng(2).normal(size=x.shape), np.empty_like(x), engine.lists[0]
            engine.place(x, box)
            calls = {
                "into cells": lambda: pairs.bin(x, pairs.grid(x, box), 1),  # noqa: B023
                "listed": lambda: pairs.many or pairs.list(pairs._placed, 1),  # noqa: B023
                "conservative": lambda: engine.sums(CONSERVATIVE, None, 0.0, 1.0, 0, 0, None, out),  # noqa: B023
                "with friction": lambda: engine.sums(ALL, v, 1.0, 0.02, 1, 1, None, out),  # noqa: B023
                "swept": lambda: engine.swept(v, 1.0, 0.1, 1, 1, None, v, EXACT),  # noqa: B023
            }
            for what, call in calls.items():
                begun = time.process_time()
                call()
                spent = 1e9 * (time.process_time() - begun) / beads
                best[beads, name][what] = spent if first else min(spent, best[beads, name].get(what, np.inf))
        first = False
    for (beads, name), row in best.items():
        print(f"{beads:,} beads {name}: " + ", ".join(f"{what} {spent:.0f}" for what, spent in row.items()))


if __name__ == "__main__":
    main()
