"""Runs of decks that get a signal at a chosen moment: the moment is a call of a function, so any line of the run can be hit, and again.

python interrupted_runs.py CALL SIGNAL ARGUMENTS OF openmm-dpd ...
"""

import inspect
import json
import os
import random
import re
import shutil
import signal
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import numpy as np
import pytest
from undrawn import draw_nothing

import openmm_dpd.lammps  # before calls are counted
from openmm_dpd.__main__ import main
from openmm_dpd.simulation.field_file import load_fields

PACKAGE = Path(openmm_dpd.lammps.__file__).parents[1]

#: For modules of such tests.  A signal between the opening of a file and the ``with`` that closes it leaves that to the garbage collector.
WITH_SIGNALS = [
    pytest.mark.skipif(os.name == "nt", reason="Windows has no such signals"),
    pytest.mark.filterwarnings("ignore:unclosed file:ResourceWarning"),
]

#: Files whose calls are counted: all that a run of a deck does beside its steps.
WRITERS = ("base/files", "base/file_ledger", "io/dcd", "io/xtc", "simulation/field_file")
COUNTED = (str(PACKAGE / "lammps"), *(str(PACKAGE / f"{name}.py") for name in WRITERS))


def counts(frame, event: str) -> bool:
    """Whether it is a call that counts: not one into a generator, which may be its end, where Python drops exceptions."""
    code = frame.f_code
    return event == "call" and code.co_filename.startswith(COUNTED) and not code.co_flags & inspect.CO_GENERATOR


@contextmanager
def signal_at(call: int, number: int) -> Iterator[list[int]]:
    """Within, this process gets a signal at the ``call``-th call of a counted function (0: never); counts them."""
    seen = [0]

    def profile(frame, event, _):
        if counts(frame, event):
            seen[0] += 1
            if seen[0] == call:
                os.kill(os.getpid(), number)

    sys.setprofile(profile)
    try:
        yield seen
    finally:
        sys.setprofile(None)


@contextmanager
def crash_in(out: Path, copy: Path, seed: int) -> Iterator[list[int]]:
    """Within, a folder is copied at a random call behind its first checkpoint, as a crash would leave it there; counts all calls.

    All that a run writes is on disk at once, so this is a SIGKILL that needs no process.
    """
    draw, begun, seen, latest = random.Random(seed), 0, [0], out / "checkpoint" / "latest"

    def profile(frame, event, _):
        nonlocal begun
        if counts(frame, event):
            seen[0] += 1
            if begun or latest.exists():
                begun += 1
                if draw.random() < 1 / begun and latest.exists():  # each call until now is the one with the same probability
                    shutil.rmtree(copy, ignore_errors=True)
                    shutil.copytree(out, copy)

    sys.setprofile(profile)
    try:
        yield seen
    finally:
        sys.setprofile(None)


def interrupted(call: int, number: int, arguments: list[str]) -> int:
    """Run until a call, and return the exit status; in a process of its own where nothing else would survive."""
    if number == signal.SIGKILL:
        command = [sys.executable, __file__, str(call), str(number), *arguments]
        return subprocess.run(command, capture_output=True, text=True).returncode
    with signal_at(call, number):
        return main(arguments)


def contents(out: Path) -> dict[str, object]:
    """Everything in a folder of results, without wall times."""
    found: dict[str, object] = {}
    for path in sorted(path for path in out.rglob("*") if path.is_file()):
        name = str(path.relative_to(out))
        if path.suffix == ".npz":
            found[name] = {key: np.asarray(values).tobytes() for key, values in load_fields(path).items()}
        elif path.suffix == ".json":
            found[name] = without_times(json.loads(path.read_text(encoding="utf-8")))
        elif name == "log.txt":
            lines = path.read_text(encoding="utf-8").splitlines()
            found[name] = [re.sub(r"CPU = .*sec", "", line) for line in lines if not line.startswith(("Loop time", "compiling"))]
        else:
            found[name] = path.read_bytes()
    return found


def without_times(report: dict) -> dict:
    """A report without seconds."""
    runs = [{key: value for key, value in run.items() if key != "seconds_per_step"} for run in report["runs"]]
    return {key: value for key, value in report.items() if key != "seconds_per_step"} | {"runs": runs}


if __name__ == "__main__":
    draw_nothing()
    with signal_at(int(sys.argv[1]), int(sys.argv[2])):
        status = main(sys.argv[3:])
    sys.exit(status)
