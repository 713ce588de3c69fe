"""Runs that are interrupted and continued: the cases, and the program that continues them in a fresh process.

python restart_runs.py FOLDER PLATFORM
"""

import sys
from pathlib import Path

import numpy as np
from devices import Device
from scenes import BOXES, EXTENDED, chains, run_of, state_of

import openmm_dpd as dpd

BEFORE, AFTER = 7, 12  # Steps before the interruption, and after it.
HOW = ("checkpoint", "xml")


def cases(platform: str) -> dict[str, dict]:
    """Choices for every run on a platform."""
    schemes = {"mvv": {}, "mvv-0.65": {"lam": 0.65}, "shardlow": {}, "middle": {}, "aboba": {}, "bababo": {}}
    placements = ("kernel", "openmm") if platform == "Reference" else ("kernel",)
    return {
        f"{name}-{conservative}-{kind}": {"scheme": name.split("-")[0], "conservative": conservative, "kind": kind, **options}
        for name, options in schemes.items()
        for conservative in placements
        for kind in ("fluid", "ramp")
        if kind == "fluid" or conservative == "kernel"
    }


def simulation_of(platform: str, kind: str, **choices):
    """A fresh simulation of a case: two types, bonded neighbours with factors, a tilted box, moving walls; with a ramp of the temperature or not."""
    n = 90
    kT = dpd.TemperatureRamp(1.0, 2.0, 3, 15) if kind == "ramp" else 1.0
    scene = chains(BOXES["tilted"], n=n, table=EXTENDED, kT=kT, k=50.0, mobile=np.arange(n) % 9 > 0)
    return run_of(scene, Device(platform), dt=0.03, seed=5, **choices)


def continue_all(folder: Path, platform: str) -> None:
    """Load what was saved, go on, and leave the results beside it."""
    for name, choices in cases(platform).items():
        for how in HOW:
            simulation = simulation_of(platform, **choices)
            load = simulation.loadCheckpoint if how == "checkpoint" else simulation.loadState
            load(str(folder / f"{name}.{how}"))
            simulation.step(AFTER)
            x, v = state_of(simulation.context)
            np.savez(folder / f"{name}.{how}.npz", x=x, v=v, step=simulation.currentStep)


if __name__ == "__main__":
    continue_all(Path(sys.argv[1]), sys.argv[2])
