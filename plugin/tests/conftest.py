"""Fixtures: every platform that the plugin has a library for, in every precision; what is missing is skipped with the reason."""

import os

os.environ.setdefault("NUMBA_NUM_THREADS", "2")

import devices
import pytest
from devices import DEVICES, Device

from openmm_dpd.plan.forces.device_force import why_no_plugin


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Leave the further cases of each test on a GPU platform to the night."""
    for item in devices.further_cases(items):
        item.add_marker("slow")


def available(device: Device) -> Device:
    """The device with the plugin on it, or a skipped test."""
    return devices.available(device, lambda device: why_no_plugin(device.platform) or devices.why_missing(device))


@pytest.fixture(params=[d for d in DEVICES if d.platform != "CPU"], ids=str)
def device(request) -> Device:
    """Every platform in every precision it has; the CPU platform runs what Reference runs."""
    return available(request.param)


@pytest.fixture(params=[d for d in DEVICES if d.platform == "Reference" or d.precision in ("single", "mixed")], ids=str)
def usual(request) -> Device:
    """Reference, and the precisions that people run on GPUs."""
    return available(request.param)


@pytest.fixture(params=[d for d in DEVICES if d.platform == "Reference" or d.precision == "double"], ids=str)
def exact(request) -> Device:
    """Double precision."""
    return available(request.param)
