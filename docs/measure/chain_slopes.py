"""chi of linear chains per extra repulsion, to first order, over bonds and lengths: what openmm_dpd/parameters/chi_chains.json holds.

    python docs/measure/chain_slopes.py --write openmm_dpd/parameters/chi_chains.json
    python docs/measure/chain_slopes.py --check

A melt of one kind, A = 75/density, is measured by openmm_dpd.parameters.measured_chi_slope.  A run that was interrupted goes on behind the
rows that the file has.  --check: springs, lengths and a density between those of the table, beside what the package says of them.

Reduced units, rc = m = kT = 1; each row: density, k and r0 of the bonds U = k (r - r0)^2, beads of a chain, chi/dA, its standard error, mean
squared distance of the ends of a chain, and of the run beads and time.
"""

from __future__ import annotations

import argparse
import json
import os
from itertools import product

import numpy as np
from demixing import Model, fluid, per_time
from openmm import unit

from openmm_dpd.molecules import Spring
from openmm_dpd.parameters import chain_chi_slope, measured_chi_slope
from openmm_dpd.stats import block_average

DENSITIES, LENGTHS = (3.0, 5.0), (1, 2, 3, 5, 10, 20)

#: The spring F = -4 r of Groot and Madden, and a grid over stiffness and length.
SPRINGS = ((2.0, 0.0), *product((25.0, 50.0, 100.0), (0.3, 0.5, 0.7, 0.9)))

#: Where the table has no row.
CHECKS = (
    (3.0, 64.0, 0.5, 4),
    (3.0, 75.0, 0.5, 10),
    (3.0, 75.0, 0.4, 7),
    (3.0, 35.0, 0.8, 5),
    (3.0, 50.0, 0.6, 15),
    (3.0, 2.0, 0.0, 7),
    (5.0, 64.0, 0.5, 4),
    (5.0, 35.0, 0.8, 7),
    (4.0, 64.0, 0.5, 4),
    (4.0, 2.0, 0.0, 10),
    (4.0, 100.0, 0.3, 20),
)


def measured(density: float, k: float, r0: float, beads: int, seed: int, size: int, time: float) -> tuple[float, float, float]:
    """chi/dA, its standard error, and the mean squared distance of the ends, of about so many beads."""
    edge = (size / density) ** (1 / 3)
    built = fluid(Model(density, beads=beads, spring=Spring(k, r0)), 0.0, (edge,) * 3, False, seed)
    simulation, step = built.simulation(), per_time(built)
    simulation.step((30 if beads < 10 else 100) * step)
    slopes, sizes = [], []
    for _ in range(round(time / 2.5)):
        slopes.append(measured_chi_slope(built, steps=round(2.5 * step), every=step // 2, settle=0, simulation=simulation).mean)
        x = simulation.context.getState(positions=True).getPositions(asNumpy=True).value_in_unit(unit.nanometer)
        chains = x.reshape(-1, beads, 3)
        sizes.append(np.mean(np.sum((chains[:, -1] - chains[:, 0]) ** 2, axis=1)))
    found = block_average(slopes)
    return found.mean, found.sem, float(np.mean(sizes))


def table(options: argparse.Namespace) -> None:
    """All rows that the file does not have yet."""
    rows: list[list[float]] = []
    if options.write and os.path.exists(options.write):
        with open(options.write, encoding="utf-8") as file:
            rows = json.load(file)["rows"]
    # single beads have no spring
    wanted = [(rho, *spring, n) for rho in DENSITIES for spring in SPRINGS for n in LENGTHS if n > 1 or spring == SPRINGS[0]]
    for number, (density, k, r0, beads) in enumerate(wanted[len(rows) :], len(rows)):
        found = measured(density, k, r0, beads, 100 + number, options.size, options.time)
        rows.append([density, k, r0, beads, *(round(value, 5) for value in found), options.size, options.time])
        print(*rows[-1], flush=True)
        if options.write:
            head = {"script": "docs/measure/chain_slopes.py", "A": "75/density", "scheme": "bababo", "dt": 0.05}
            columns = json.dumps({**head, "columns": ["density", "k", "r0", "beads", "slope", "error", "ends", "size", "time"]})[:-1]
            with open(options.write, "w", encoding="utf-8") as file:
                file.write(columns + ', "rows": [\n' + ",\n".join(json.dumps(row) for row in rows) + "\n]}\n")


def check(options: argparse.Namespace) -> None:
    """Runs beside the table."""
    for number, (density, k, r0, beads) in enumerate(CHECKS):
        found, error, _ = measured(density, k, r0, beads, 900 + number, options.size, options.time)
        said = chain_chi_slope(beads, Spring(k, r0), density)
        print(
            f"density {density:g}, k {k:g}, r0 {r0:g}, {beads} beads: {found:.4f}({error:.4f}), table {said.value:.4f}({said.error:.4f})",
            flush=True,
        )


def main() -> None:
    """Choose and run."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--check", action="store_true", help="between the points of the table")
    parser.add_argument("--size", type=int, default=3000, help="beads of a run")
    parser.add_argument("--time", type=float, default=100.0, help="length of a run, in units of rc (m/kT)^(1/2)")
    parser.add_argument("--write", help="JSON file, gone on with if it is there")
    options = parser.parse_args()
    (check if options.check else table)(options)


if __name__ == "__main__":
    main()
