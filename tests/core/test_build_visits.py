"""What is needed twice is computed once: building a scene goes to no file again and again.

A visit: ``build``, ``make_plan`` or ``scene_system`` calls into another file of the package; calls in a row from one of these files to the
same one are one visit, each pair of caller and called function counts once (loops), properties and ``base/`` do not.
"""

import sys
from collections import Counter
from functools import cached_property
from itertools import groupby
from pathlib import Path

import numpy as np
import pytest

import openmm_dpd as dpd

ROOT = Path(dpd.__file__).parent
ORCHESTRATION = ("simulation/build.py", "plan/plan.py", "simulation/scene_system.py")


def scene(**first_wall) -> dpd.Scene:
    """Beads with charges and bonds between walls."""
    n, rng = 300, np.random.default_rng(1)
    x = rng.random((n, 3)) * [6.0, 6.0, 5.0] + [0.0, 0.0, 0.5]
    x[150:200] = x[100:150] + np.where(x[100:150] > 3.0, -0.1, 0.1)
    bonds = dpd.HarmonicBonds(np.stack([np.arange(100, 150), np.arange(150, 200)], axis=1), 100.0, 0.7)
    return dpd.Scene(
        masses={"W": 1.0},
        types=["W"] * n,
        positions=x,
        pairs={("W", "W"): dpd.DPD(A=25, gamma=4.5)},
        kT=1.0,
        box=[6.0, 6.0, 7.0],
        charges=np.repeat([1.0, -1.0, 0.0], [20, 20, n - 40]),
        electrostatics=dpd.SlaterCharges(0.3, bjerrum_length=1.0),
        bonds=[bonds],
        bonded_factors=(0.5, 1.0, 1.0),
        walls=[dpd.Wall("z", 0.5, "above", **first_wall), dpd.Wall("z", 5.5, "below")],
    )


def properties() -> set:
    """Code of all properties of classes of the package."""
    modules = [vars(module) for name, module in list(sys.modules.items()) if name.split(".")[0] == "openmm_dpd"]
    members = [member for names in modules for kind in names.values() if isinstance(kind, type) for member in vars(kind).values()]
    found = [m.fget if isinstance(m, property) else m.func for m in members if isinstance(m, property | cached_property)]
    return {function.__code__ for function in found if hasattr(function, "__code__")}


def visits(build) -> list[tuple[str, str]]:
    """(from, to) of each visit, in their order."""
    calls, seen, left_out = [], set(), properties()

    def place(frame) -> str | None:
        path = Path(frame.f_code.co_filename)
        return path.relative_to(ROOT).as_posix() if path.is_relative_to(ROOT) else None

    def hear(frame, event, _):
        there = place(frame) if event == "call" and frame.f_code not in left_out else None
        if there is None or there.startswith("base/"):
            return
        caller = frame.f_back
        while caller is not None and place(caller) is None:  # of numpy, or generated
            caller = caller.f_back
        here, pair = caller and place(caller), (caller and caller.f_code, frame.f_code)
        if here in ORCHESTRATION and here != there and pair not in seen:
            seen.add(pair)
            calls.append((here, there))

    sys.setprofile(hear)
    try:
        build()
    finally:
        sys.setprofile(None)
    return [visit for visit, _ in groupby(calls)]


@pytest.mark.parametrize(
    ("wall", "choices"),
    [({}, {}), ({"velocity": (0.1, 0.0, 0.0)}, {}), ({}, {"loop": False}), ({}, {"conservative": "openmm"})],
    ids=["in loops", "driven walls", "by the program", "by OpenMM"],
)
def test_no_file_is_visited_more_than_three_times(wall, choices):
    beads = scene(**wall)
    found = visits(lambda: dpd.build(beads, dt=0.01, platform="CPU", seed=1, **choices))
    assert found[0] == ("simulation/build.py", "plan/plan.py")
    often = {file: count for file, count in Counter(there for _, there in found).items() if count > 3}
    assert not often, found
