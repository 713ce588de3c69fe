"""Loads the compiled libraries into OpenMM, whose XML then knows the Force ``DPDDeviceForce``; openmm_dpd makes it and does the rest.

Attributes
----------
loaded : list of str
    Platforms whose library was loaded: "Reference" (and CPU), "OpenCL", "CUDA", "HIP".
failed : dict
    Why that of another one was not, by platform.
"""

import ctypes
from pathlib import Path

import openmm

try:
    from .built import OPENMM
except ModuleNotFoundError:
    raise ImportError("this openmm_dpd_device is its source, which is not compiled: import it from another folder") from None

_LIBRARIES = {"Reference": "OpenMMDPDDevice", "OpenCL": "OpenMMDPDDeviceOpenCL", "CUDA": "OpenMMDPDDeviceCuda", "HIP": "OpenMMDPDDeviceHip"}

loaded: list[str] = []
failed: dict[str, str] = {}


def bytes_of_arrays() -> int:
    """Bytes of the arrays that the plugin has on devices now; OpenMM's own come on top."""
    function = ctypes.CDLL(str(_library("Reference"))).dpdBytesOfArrays
    function.restype = ctypes.c_longlong
    return function()


def update_force(new: openmm.Force, force: openmm.Force, context: openmm.Context) -> str:
    """Give repulsion and friction of a DPDDeviceForce to the one of a Context; returns why not, empty if it was done.

    OpenMM's Python knows both as an openmm.Force, which has no ``updateParametersInContext``.
    """
    function = ctypes.CDLL(str(_library("Reference"))).dpdUpdate
    function.argtypes, function.restype = [ctypes.c_void_p] * 3, ctypes.c_char_p
    return function(*(int(each.this) for each in (new, force, context))).decode()


def _library(platform: str) -> Path:
    return Path(__file__).parent / f"lib{_LIBRARIES[platform]}.so"


def _minor(version: str) -> list[str]:
    return version.split(".")[:2]


if _minor(openmm.version.short_version) != _minor(OPENMM):
    raise ImportError(
        f"openmm-dpd-device was built for OpenMM {OPENMM}, and this is {openmm.version.short_version}: their C++ classes differ; "
        f'to install one that it fits: pip install "openmm=={".".join(_minor(OPENMM))}.*"'
    )

_here = [openmm.Platform.getPlatform(k).getName() for k in range(openmm.Platform.getNumPlatforms())]
for _platform in _LIBRARIES:
    if _platform not in _here:
        failed[_platform] = f"OpenMM has no platform {_platform} here"
        continue
    try:
        openmm.Platform.loadPluginLibrary(str(_library(_platform)))
        loaded.append(_platform)
    except openmm.OpenMMException as error:
        failed[_platform] = f"openmm-dpd-device does not fit the OpenMM in {openmm.version.openmm_library_path} ({error}): install it again"
