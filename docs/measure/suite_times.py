"""How long the fast tests take, with no compiled kernel on disk and with all of them.

    python docs/measure/suite_times.py [TREE]   # 15 minutes of two idle cores

README's test command runs twice with a cache of its own; TREE is a checkout to compare with, such as an older one.
"""

from __future__ import annotations

import os
import resource
import subprocess
import sys
import tempfile
import time
from pathlib import Path

COMMAND = [sys.executable, "-m", "pytest", "-q", "-n", "2", "-m", "not slow"]


def main(tree: str = ".") -> None:
    """Run them, and print a row of a table for each run."""
    root = Path(tree).resolve()
    print("| kernels on disk | minutes | CPU seconds | compiled kernels | |\n| --- | --- | --- | --- | --- |")
    with tempfile.TemporaryDirectory() as cache:
        for there in ("none", "all"):
            kept = {name: value for name, value in os.environ.items() if name != "NUMBA_CACHE_DIR"}
            given = kept | {"XDG_CACHE_HOME": cache, "PYTHONPATH": str(root), "OMP_NUM_THREADS": "1", "MPLBACKEND": "Agg"}
            begun, before = time.time(), resource.getrusage(resource.RUSAGE_CHILDREN)
            done = subprocess.run(COMMAND, cwd=root, env=given, capture_output=True, text=True)
            minutes, after = (time.time() - begun) / 60.0, resource.getrusage(resource.RUSAGE_CHILDREN)
            spent = after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime
            kernels = len(list(Path(cache).rglob("*.kernel")))
            print(f"| {there} | {minutes:.1f} | {spent:.0f} | {kernels} | {done.stdout.splitlines()[-1]} |", flush=True)


if __name__ == "__main__":
    main(*sys.argv[1:])
