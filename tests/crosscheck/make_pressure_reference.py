"""Writes pressure_reference.json: LAMMPS's averages under constant pressure (fix nph) on the decks in.dpdh-pressure and in.dpdp-pressure.

python make_pressure_reference.py [--steps N]        # 200,000 steps: about 15 minutes on one core
"""

import argparse
import json
import os
import re
import subprocess
import sys
import tempfile
from pathlib import Path

import numpy as np

from openmm_dpd.stats import block_average

HERE = Path(__file__).parent
DECKS = HERE.parents[1] / "examples" / "decks"


def rows_of(deck: str, steps: int) -> dict[str, np.ndarray]:
    """Columns of the last run's thermo output."""
    lmp = Path(sys.executable).with_name("lmp")
    environment = os.environ | {"LD_LIBRARY_PATH": f"{sys.prefix}/lib", "OMP_NUM_THREADS": "1"}
    with tempfile.TemporaryDirectory() as folder:
        arguments = [lmp, "-in", DECKS / deck, "-log", "none", "-var", "nequil", "20000", "-var", "nrun", str(steps)]
        text = subprocess.run(arguments, cwd=folder, env=environment, capture_output=True, text=True, check=True).stdout
    last = text[text.rindex("   Step ") :].splitlines()
    table = np.array(
        [line.split() for line in last[1:] if re.match(r"^\s*\d+\s", line) and len(line.split()) == len(last[0].split())], float
    )
    return dict(zip(last[0].split(), table.T, strict=True))


def main() -> None:
    """Run both decks and write the file."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--steps", type=int, default=200_000)
    options = parser.parse_args()
    result: dict = {"program": "LAMMPS 22 Jul 2025 - Update 4", "steps": options.steps, "decks": {}}
    for deck in ("in.dpdh-pressure", "in.dpdp-pressure"):
        rows = rows_of(deck, options.steps)
        quantities = {}
        for name, column in rows.items():
            if name in ("Temp", "Volume", "PotEng", "c_dpdU[4]"):
                average = block_average(column)
                quantities[name] = {"mean": average.mean, "sem": average.sem}
        # the variance of the volume, with the error of its own average
        spread = block_average((rows["Volume"] - rows["Volume"].mean()) ** 2)
        quantities["variance of Volume"] = {"mean": spread.mean, "sem": spread.sem}
        result["decks"][deck] = quantities
        print(deck, quantities, flush=True)
    (HERE / "pressure_reference.json").write_text(json.dumps(result, indent=1) + "\n")


if __name__ == "__main__":
    main()
