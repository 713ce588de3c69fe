"""What the first use costs on one core: the import, and the first and the second script of each kind of scene.

The first script of a kind compiles its kernels and keeps them, the second finds them.  A script makes a fluid of 3,000 beads and a hundred
steps, in a process of its own; its CPU time has the start of Python and all imports in it.  ``import openmm`` stands beside them.

    python benchmarks/first_use.py                      # two minutes on a quiet machine
    python benchmarks/first_use.py --schemes mvv bab3
"""

from __future__ import annotations

import argparse
import os
import resource
import subprocess
import sys
import tempfile
from pathlib import Path

from profile_steps import KINDS

STEPS = """
from profile_steps import scene_of
import openmm_dpd as dpd
scene, dt = scene_of({kind!r}, 3000)
dpd.build(scene, dt=dt, scheme={scheme!r}, platform="CPU", seed=1).simulation().step(100)
"""


def cpu_seconds(code: str, cache: str) -> float:
    """CPU time of a process that executes this."""
    one = dict.fromkeys(("OMP_NUM_THREADS", "NUMBA_NUM_THREADS", "OPENMM_CPU_THREADS"), "1")
    found = os.pathsep.join([str(Path(__file__).parent), os.environ.get("PYTHONPATH", "")])
    environment = os.environ | one | {"NUMBA_CACHE_DIR": cache, "PYTHONPATH": found}
    before = resource.getrusage(resource.RUSAGE_CHILDREN)
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, env=environment)
    if done.returncode:
        raise SystemExit(done.stderr.strip().splitlines()[-1])
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    return after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime


def main() -> None:
    """Measure and print."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--kinds", nargs="+", default=list(KINDS), choices=KINDS, help="of fluids")
    parser.add_argument("--schemes", nargs="+", default=["middle", "mvv"])
    options = parser.parse_args()
    with tempfile.TemporaryDirectory() as cache:
        for what in ("", "import openmm", "import openmm_dpd"):
            print(f"{what or 'Python':32s} {min(cpu_seconds(what, cache) for _ in range(5)):6.2f} s")
    for kind in options.kinds:
        for scheme in options.schemes:
            code = STEPS.format(kind=kind, scheme=scheme)
            with tempfile.TemporaryDirectory() as cache:
                first, second = cpu_seconds(code, cache), cpu_seconds(code, cache)
            print(f"{f'{kind}, {scheme}':32s} {first:6.2f} s, then {second:.2f} s", flush=True)


if __name__ == "__main__":
    main()
