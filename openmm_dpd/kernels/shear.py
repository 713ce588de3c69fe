"""Lees-Edwards shear: strain and rate at a time, and the lattice of images that belongs to a strain.

All of it is a function of the time that has been sheared, so that runs have the same bits however they are cut.  A description is a
:class:`openmm_dpd.model.shear.LeesEdwards`.
"""

import math
from typing import Any

import numpy as np

from .elementary import sine

_TURN = 1.0 / (2.0 * math.pi)


def strain_at(shear: Any, time: float) -> float:
    """Strain after a time."""
    if shear.amplitude is not None:
        return shear.amplitude * float(sine(_TURN * shear.frequency * time))
    if shear.ramp_time is None:
        return shear.rate * time
    inside = min(time, shear.ramp_time)
    return shear.rate * inside + 0.5 * (shear.end_rate - shear.rate) * inside * inside / shear.ramp_time + shear.end_rate * (time - inside)


def rate_at(shear: Any, time: float) -> float:
    """Its rate then."""
    if shear.amplitude is not None:
        return shear.amplitude * shear.frequency * float(sine(_TURN * shear.frequency * time + 0.25))
    if shear.ramp_time is None:
        return shear.rate
    return shear.rate + (shear.end_rate - shear.rate) * min(time / shear.ramp_time, 1.0)


def sheared_box(box: np.ndarray, strain: float, tilt: float = 0.0) -> np.ndarray:
    """(3, 3) reduced vectors of the lattice of a box at a strain: the images above it are ``strain`` times its height farther along x than
    by the ``tilt`` that it began with."""
    sheared, edge = np.diag(np.diag(box)), box[0, 0]
    shift = strain * box[1, 1] + tilt
    sheared[1, 0] = min(max(shift - edge * math.floor(shift / edge + 0.5), -0.5 * edge), 0.5 * edge)
    return sheared


def add_flow(v: np.ndarray, rate: float, x: np.ndarray) -> None:
    """Add the flow of a rate to the velocities (N, 3) of beads at unwrapped positions (N, 3)."""
    v[:, 0] += rate * x[:, 1]
