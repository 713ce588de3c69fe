"""Fixtures: every platform that the plugin has a library for, in every precision; what is missing is skipped with the reason."""

import os

os.environ.setdefault("NUMBA_NUM_THREADS", "2")

from functools import cache

import openmm
import pytest
from devices import DEVICES, Device

from openmm_dpd.plan.forces.device_force import why_no_plugin


@cache
def why_missing(device: Device) -> str | None:
    """None when the plugin runs on the device, otherwise the reason in words."""
    reason = why_no_plugin(device.platform)
    if reason is not None:
        return reason
    system = openmm.System()
    system.addParticle(1.0)
    try:
        openmm.Context(system, openmm.VerletIntegrator(0.001), openmm.Platform.getPlatformByName(device.platform), device.properties)
    except openmm.OpenMMException as error:
        return f"no Context on {device}: {error}"
    return None


def available(device: Device) -> Device:
    """The device, or a skipped test."""
    reason = why_missing(device)
    if reason is not None:
        pytest.skip(reason)
    return device


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
