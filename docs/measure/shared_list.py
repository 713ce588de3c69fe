"""What would one list of pairs per step bring, shared by its kicks?  The numbers of docs/atlas.md ("Where the time goes").

A list that is made at the first place of a step where forces are needed has to have a skin, twice the way of the fastest bead until the last.
Timed with 10,000 beads of the standard fluid: making a list without and with that skin, a force, and what a shared list needs beside it, the
distances of its pairs at the new places.

    python docs/measure/shared_list.py           # half a minute; a quiet machine is needed
"""

from __future__ import annotations

import time
from collections.abc import Callable

import numpy as np
from list_life import standard_fluid
from numba import njit

import openmm_dpd as dpd
from openmm_dpd.kernels.engine import PairEngine
from openmm_dpd.kernels.layer import CONSERVATIVE
from openmm_dpd.plan.plan import make_plan

#: Schemes with several forces: step, part of it between the first and the last place of a force, lists that are made now.
SCHEMES = {"bababo": (0.12, 0.5, 2), "bab3": (0.2, 0.7, 3)}


@njit(fastmath=True)
def measured(x, edge, first, second, geometry):
    """Lines between the beads of all pairs, and their lengths."""
    for n in range(len(first)):
        r2 = 0.0
        for a in range(3):
            d = x[a, first[n]] - x[a, second[n]]
            d -= edge * np.rint(d / edge)
            geometry[a, n] = d
            r2 += d * d
        geometry[3, n] = np.sqrt(r2)


def best(call: Callable[[], object], rounds: int = 30) -> float:
    """Shortest time of a call, ms."""
    times = []
    for _ in range(rounds):
        begun = time.perf_counter()
        call()
        times.append(time.perf_counter() - begun)
    return 1e3 * min(times)


def main() -> None:
    """Print a line per scheme."""
    dpd.set_threads(1)
    scene = standard_fluid()
    edge = float(scene.box[0, 0])
    for scheme, (dt, part, lists) in SCHEMES.items():
        simulation = dpd.build(scene, dt=dt, scheme=scheme, platform="CPU", seed=1).simulation(properties={"Threads": "1"})
        simulation.step(round(10 / dt))
        state = simulation.context.getState(positions=True, velocities=True)
        x, v = (np.ascontiguousarray(part._value) for part in (state.getPositions(asNumpy=True), state.getVelocities(asNumpy=True)))
        skin = 2 * part * dt * float(np.linalg.norm(v, axis=1).max())
        found = {}
        for reach in (1.0, 1.0 + skin):
            engine = PairEngine(make_plan(scene, dt=dt, seed=1).spec)
            pairs, box = engine.lists[0], np.diag([edge] * 3)
            pairs.set_cutoff(np.array([[reach]]))
            times = [best(lambda: engine.place(x, box)), best(lambda: engine.forces(CONSERVATIVE, None, 0.0, 1.0, 0, 0))]  # noqa: B023
            first, second = (np.ascontiguousarray(beads) for beads in pairs.listed()[:2])
            sorted_x, place = np.ascontiguousarray(x[pairs.order].T), np.argsort(pairs.order)
            first, second = place[first], place[second]
            geometry = np.empty((4, len(first)))
            measured(sorted_x, edge, first, second, geometry)
            found[reach] = [len(first), *times, best(lambda: measured(sorted_x, edge, first, second, geometry))]  # noqa: B023
        (n, make, force, _), (more, long_make, long_force, again) = found.values()
        now, then = lists * (make + force), long_make + lists * long_force + (lists - 1) * again
        print(
            f"{scheme} at {dt:g}: skin {skin:.2f}, {more / n:.1f} times the pairs; list {make:.2f} and {long_make:.2f} ms, force {force:.2f} and "
            f"{long_force:.2f}, distances anew {again:.2f}; lists and forces of a step {now:.2f} now, {then:.2f} with one list"
        )


if __name__ == "__main__":
    main()
