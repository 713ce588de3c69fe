"""Pressure and energy of one-component fluids over density and repulsion: what openmm_dpd/parameters/pressures.json holds.

    python docs/measure/pressure_table.py --write openmm_dpd/parameters/pressures.json

Reduced units, rc = m = kT = 1; each row: density, A, pressure and its standard error, energy of a bead and its standard error.
"""

from __future__ import annotations

import argparse
import json

from openmm_dpd.parameters.measured import measured_pressure

DENSITIES = (2.0, 2.5, 3.0, 3.5, 4.0, 5.0, 6.0, 8.0)
REPULSIONS = (5.0, 10.0, 15.0, 25.0, 40.0, 60.0, 80.0, 110.0)


def main() -> None:
    """Measure, print and write."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--beads", type=int, default=1500)
    parser.add_argument("--time", type=float, default=60.0, help="length of a run, in units of rc (m/kT)^(1/2)")
    parser.add_argument("--write", help="JSON file")
    options = parser.parse_args()
    rows = []
    for density in DENSITIES:
        for repulsion in REPULSIONS:
            found = measured_pressure(repulsion, density, beads=options.beads, time=options.time, seed=len(rows) + 1)
            p, u = found.pressure, found.energy
            rows.append([density, repulsion, round(p.mean, 5), round(p.sem, 5), round(u.mean, 5), round(u.sem, 5)])
            print(*rows[-1], flush=True)
            if options.write:
                _write(options, rows)


def _write(options: argparse.Namespace, rows: list[list[float]]) -> None:
    head = {"script": "docs/measure/pressure_table.py", "beads": options.beads, "time": options.time, "scheme": "bababo"}
    text = json.dumps(head)[:-1] + ', "columns": ["density", "A", "pressure", "error", "energy", "error"], "rows": [\n'
    text += ",\n".join(json.dumps(row) for row in rows) + "\n]}\n"
    with open(options.write, "w", encoding="utf-8") as file:
        file.write(text)


if __name__ == "__main__":
    main()
