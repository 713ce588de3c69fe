"""The two programs, each in a process of its own that is started anew when it dies."""

import json
import os
import select
import subprocess
import sys
from dataclasses import dataclass
from pathlib import Path

PATIENCE = 300.0  # A deck of the fuzzer takes a tenth of a second; what takes longer than this hangs (the first one may compile).


@dataclass(frozen=True)
class Answer:
    """What a program made of a deck.

    Attributes
    ----------
    status : str
        ``done``, ``refused``, or ``crashed`` (it died, hung, or raised what is no error of the deck).
    message : str
        The error.
    thermo : str
        Thermo output.
    """

    status: str
    message: str
    thermo: str


class Worker:
    """One program."""

    def __init__(self, side: str):
        self.side = side
        self._process: subprocess.Popen | None = None

    def _start(self) -> subprocess.Popen:
        path = os.pathsep.join([*filter(None, [os.environ.get("PYTHONPATH")]), str(Path(__file__).resolve().parents[1])])
        command = [sys.executable, "-W", "ignore", "-c", f"from fuzz.worker import main; main({self.side!r})"]
        pipes = {"stdin": subprocess.PIPE, "stdout": subprocess.PIPE, "stderr": subprocess.DEVNULL, "text": True}
        return subprocess.Popen(command, **pipes, env={**os.environ, "PYTHONPATH": path, "OMP_NUM_THREADS": "1"})

    def run(self, folder: Path, deck: str, options: dict) -> Answer:
        """Run a deck in a folder."""
        if self._process is None or self._process.poll() is not None:
            self._process = self._start()
        process = self._process
        assert process.stdin is not None and process.stdout is not None
        process.stdin.write(json.dumps({"folder": str(folder), "deck": deck, "options": options}) + "\n")
        process.stdin.flush()
        ready, _, _ = select.select([process.stdout], [], [], PATIENCE)
        line = process.stdout.readline() if ready else ""
        if line:
            return Answer(**json.loads(line))
        self.close()
        return Answer("crashed", "the process died" if ready else f"no answer within {PATIENCE:g} s", "")

    def close(self) -> None:
        """End the process."""
        if self._process is not None:
            self._process.kill()
            self._process.communicate()
            self._process = None
