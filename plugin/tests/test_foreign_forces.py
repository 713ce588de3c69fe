"""The matrix of tests/core/test_foreign_forces.py on the device: what the user adds acts in full, or is refused by one clear line."""

import functools
import sys
from pathlib import Path

import pytest

sys.path.insert(0, str(Path(__file__).parent.parent.parent / "tests" / "core"))

from conftest import available
from devices import Device
from foreign_forces import covering, lacking, outcome

import openmm_dpd as dpd

PLATFORMS = {"Reference": Device("Reference"), "OpenCL": Device("OpenCL", "single")}
PAIRS, TRIPLES = ([cell for cell in covering(strength, tuple(PLATFORMS)) if cell.scheme != "native"] for strength in (2, 3))
CELLS = PAIRS + [pytest.param(cell, marks=pytest.mark.slow) for cell in TRIPLES if cell not in PAIRS]


@pytest.mark.parametrize("cell", CELLS, ids=str)
def test_what_is_added_acts_in_full(cell, monkeypatch):
    available(PLATFORMS[cell.platform])
    if lacking(cell.platform) is not None:
        pytest.skip(lacking(cell.platform))
    for name in ("build", "add_thermostat", "create_mixed_system"):
        monkeypatch.setattr(dpd, name, functools.partial(getattr(dpd, name), engine="device"))
    found = outcome(cell)
    assert not found.startswith("WRONG"), found
