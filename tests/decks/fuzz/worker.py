"""A process that runs decks with one of the two programs, on request: one JSON object a line in, one out."""

import json
import os
import re
import sys
import traceback
from collections.abc import Callable
from pathlib import Path

from .deck import MARK

#: A line of numbers, of titles, of thermo style multi or of yaml.
_NOISE = re.compile(r"WARNING|^Generated|^Removed|^Last command|^For more information|^Neighbor list|^Deleted|^\s+update:|^Total wall time")


def _thermo_of_log(text: str) -> str:
    """Thermo output of a log: what is between the mark before a run and the loop time."""
    found: list[str] = []
    for part in text.split(MARK)[1:]:
        body = part.split("Loop time of")[0]
        if "Per MPI rank memory" in body:
            body = body.split("Per MPI rank memory")[-1].partition("\n")[2]
        found.append(MARK)
        found += [line for line in body.splitlines() if line.strip() and not _NOISE.search(line) and not line.startswith("ERROR")]
    return "\n".join(found)


def _with_lammps(deck: str, options: dict) -> tuple[str, str, str]:
    sys.path.insert(0, str(Path(__file__).resolve().parents[3] / "benchmarks"))
    from live_lammps import instance

    try:
        with instance() as lmp:
            lmp.command("echo none")
            lmp.command("log log.lammps")
            lmp.file(deck)
    except Exception as error:  # the module raises nothing more special
        return "refused", str(error), _thermo_of_log(Path("log.lammps").read_text(errors="replace"))
    return "done", "", _thermo_of_log(Path("log.lammps").read_text(errors="replace"))


def _with_ours(deck: str, options: dict) -> tuple[str, str, str]:
    import logging

    logging.getLogger("openmm_dpd").setLevel(logging.CRITICAL)
    from openmm_dpd.base.errors import DeckError, RunError
    from openmm_dpd.lammps import RunOptions, run_deck

    lines: list[str] = []
    status, message = "done", ""
    try:
        run_deck(deck, RunOptions(platform="Reference", **options), log=lines.append)
    except (DeckError, RunError) as error:
        status, message = "refused", str(error)
    except Exception:
        status, message = "crashed", traceback.format_exc()
    rows = "\n".join(lines).splitlines()
    return status, message, _thermo_of_log("\n".join(row for row in rows if not row.startswith(("note:", "compiling "))))


SIDES: dict[str, Callable[[str, dict], tuple[str, str, str]]] = {"lammps": _with_lammps, "ours": _with_ours}


def main(side: str) -> None:
    """Serve until standard input ends."""
    answers = os.fdopen(os.dup(1), "w")
    os.dup2(os.open(os.devnull, os.O_WRONLY), 1)  # what else is printed is no answer
    for line in sys.stdin:
        task = json.loads(line)
        os.chdir(task["folder"])
        status, message, thermo = SIDES[side](task["deck"], task["options"])
        answers.write(json.dumps({"status": status, "message": message, "thermo": thermo}) + "\n")
        answers.flush()
