"""Platforms and precisions the tests run on."""

from collections import defaultdict
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import cache

import openmm
import pytest


@dataclass(frozen=True)
class Device:
    """One platform in one precision."""

    platform: str
    precision: str = ""

    def __str__(self) -> str:
        return self.platform + (f"-{self.precision}" if self.precision else "")

    @property
    def properties(self) -> dict[str, str]:
        """Platform properties."""
        if self.platform == "CPU":
            return {"Threads": "1"}
        if self.platform in ("CUDA", "HIP"):  # PME has other bits in each run there, unless it is told not to
            return {"Precision": self.precision, "DeterministicForces": "true"}
        return {"Precision": self.precision} if self.precision else {}

    @property
    def exact(self) -> bool:
        """Whether positions, velocities and the kernel's forces are double precision throughout."""
        return self.platform in ("Reference", "CPU")

    def choose(self, exact: float, mixed: float, single: float) -> float:
        """A tolerance: Reference and CPU; double or mixed precision; single precision."""
        return exact if self.exact else single if self.precision == "single" else mixed


_PRESENT = {openmm.Platform.getPlatform(k).getName() for k in range(openmm.Platform.getNumPlatforms())}
PRECISIONS = ("single", "mixed", "double")

#: Marks of the tests on GPU platforms: compiling their kernels takes most of the time, and single precision asks the most of a program.
MARKS = dict.fromkeys(("mixed", "double"), ("slow", "long"))

#: CUDA and HIP are tested where they are; OpenCL runs on any machine that has PoCL, and is skipped with a reason where it is not.
_GPUS = [platform for platform in ("OpenCL", "CUDA", "HIP") if platform == "OpenCL" or platform in _PRESENT]
DEVICES = [Device("Reference"), Device("CPU"), *(Device(platform, precision) for platform in _GPUS for precision in PRECISIONS)]
REFERENCE, CPU = DEVICES[:2]


def gpu(item: pytest.Item) -> Device | None:
    """The GPU platform, in a precision, on which a test runs."""
    values = item.callspec.params.values() if hasattr(item, "callspec") else ()
    devices = [value for value in values if isinstance(value, Device) and not value.exact]
    names = [name for name in (getattr(value, "platform", value) for value in values) if isinstance(name, str)]
    return next(iter(devices + [device for device in DEVICES if not device.exact and device.platform in names]), None)


def further_cases(items: list[pytest.Item]) -> Iterator[pytest.Item]:
    """All but the first and the last case of each test on a GPU platform in a precision: compiling their kernels takes most of the time."""
    found: dict[tuple[str, Device], list[pytest.Item]] = defaultdict(list)
    for item in items:
        if (device := gpu(item)) is not None:
            found[item.nodeid.partition("[")[0], device].append(item)
    for cases in found.values():
        yield from cases[1:-1]


@cache
def why_missing(device: Device) -> str | None:
    """None when a Context can be made on the device, otherwise the reason in words."""
    if device.platform not in _PRESENT:
        return f"OpenMM has no platform {device.platform} here"
    system = openmm.System()
    system.addParticle(1.0)
    try:
        openmm.Context(system, openmm.VerletIntegrator(0.001), openmm.Platform.getPlatformByName(device.platform), device.properties)
    except openmm.OpenMMException as error:
        return f"no Context on {device}: {error}"
    return None


def available(device: Device, why: Callable[[Device], str | None] = why_missing) -> Device:
    """The device, or a skipped test."""
    reason = why(device)
    if reason is not None:
        pytest.skip(reason)
    return device
