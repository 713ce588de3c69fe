"""OpenMM's platforms: the fastest one here, and whether OpenCL runs on a GPU."""

import re
from functools import lru_cache
from pathlib import Path

import openmm

from .errors import ParameterError, what_is


def platform_here(platform: openmm.Platform | str | None) -> str:
    """Name of a platform, the fastest one for None; ParameterError if it does not exist here."""
    name = platform.getName() if isinstance(platform, openmm.Platform) else fastest_platform() if platform is None else platform
    known = [openmm.Platform.getPlatform(k).getName() for k in range(openmm.Platform.getNumPlatforms())]
    if name not in known:
        raise ParameterError(f"there is no platform {what_is(name)} here{_why_not(name)}; it must be one of {', '.join(known)}")
    return name


def _why_not(name: str) -> str:
    """Which library OpenMM lacked for a platform, as the end of a clause; nothing if that is not the reason."""
    failures = [text for text in openmm.Platform.getPluginLoadFailures() if f"libOpenMM{name}." in text]
    lacked = re.search(r"([^\s:]+): cannot open shared object", " ".join(failures))
    return f", as OpenMM found no library {lacked[1]}" if lacked else ""


@lru_cache(maxsize=1)
def fastest_platform() -> str:
    """Name of the fastest platform on this machine."""
    platforms = [openmm.Platform.getPlatform(k) for k in range(openmm.Platform.getNumPlatforms())]
    # OpenCL on a CPU (PoCL) reports the speed of a GPU, but the CPU platform is faster
    speeds = {p.getName(): p.getSpeed() for p in platforms if p.getName() != "OpenCL" or opencl_is_a_gpu(p)}
    return max(speeds, key=lambda name: speeds[name])


def opencl_is_a_gpu(platform: openmm.Platform) -> bool:
    """Whether OpenCL runs on something other than the CPU (through PoCL)."""
    drivers = list(Path("/etc/OpenCL/vendors").glob("*.icd"))
    if drivers and all("pocl" in driver.name for driver in drivers):
        return False
    system = openmm.System()
    system.addParticle(1.0)
    try:
        context = openmm.Context(system, openmm.VerletIntegrator(0.001), platform)
        device = platform.getPropertyValue(context, "OpenCLPlatformName")
    except openmm.OpenMMException:
        return False
    return "Portable Computing Language" not in device and "pocl" not in device.lower()
