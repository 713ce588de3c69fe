"""Viscosity from velocities at the ends of steps beside that from how far beads get, in the same runs (docs/theory.md).

A sweep takes the momentum of a whole step off at once, so a flow read after it is too slow, by half of the friction's share of what the
force brings in a step; before a whole kick (``middle``, ``basa``) beads lack the kinetic share as well.  Printed beside what that would be if
friction (and the kinetic part) were all of the viscosity: the ratios are the shares.  1,000 beads, driven as in benchmarks/transport.py.

    python docs/measure/flow_velocities.py           # two minutes of one core
"""

from __future__ import annotations

import argparse

import numpy as np
from openmm import unit
from transport_table import BASE, EVERY, amplitude, driven

import openmm_dpd as dpd

BEADS, SPEED, TIME = 1000, 0.5, 400.0
RUNS = tuple((gamma, scheme, dt) for gamma in (4.5, 40.5, 135.0) for scheme, dt in (("bababs", 0.125), ("basa", 0.0625)))


def lag(gamma: float, scheme: str, dt: float) -> tuple[float, float, float]:
    """How much too large the viscosity is, its standard error, and eta k^2 dt/(2 rho)."""
    every = round(EVERY / dt)
    simulation, push, edge = driven(BASE | {"drag": gamma}, 2, BEADS, dt, scheme, SPEED)
    wave, rows = 2 * np.pi / edge, []
    simulation.step(round(30.0 / EVERY) * every)
    for _ in range(round(TIME / EVERY)):
        simulation.step(every - 1)
        before = simulation.context.getState(positions=True).getPositions(asNumpy=True).value_in_unit(unit.nanometer)
        simulation.step(1)
        state = simulation.context.getState(positions=True, velocities=True)
        x = state.getPositions(asNumpy=True).value_in_unit(unit.nanometer)
        v = state.getVelocities(asNumpy=True).value_in_unit(unit.nanometer / unit.picosecond)
        rows.append((2 * np.mean(v[:, 0] * np.sin(wave * x[:, 2])), amplitude(before, x, wave, dt)))
    at_end, moved = np.array(rows).T
    behind = (moved - at_end) / moved.mean()
    return float(behind.mean()), float(behind.std() / len(behind) ** 0.5), push * dt / (2 * moved.mean())


def main() -> None:
    """Print the table, line by line."""
    argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter).parse_args()
    dpd.set_threads(1)
    print(f"| friction | scheme | step | too viscous | share |\n|{' --- |' * 5}")
    for gamma, scheme, dt in RUNS:
        off, sem, whole = lag(gamma, scheme, dt)
        print(
            f"| {gamma:g} | `{scheme}` | {dt:g} | {100 * off:+.2f} ± {100 * sem:.2f} % | {off / whole:.2f} ± {sem / whole:.2f} |",
            flush=True,
        )


if __name__ == "__main__":
    main()
