"""Lees-Edwards shear: strain and rate at a time, and the lattice of images that belongs to a strain.

All of it is a function of the time that has been sheared, so that runs have the same bits however they are cut.  A description is a
:class:`openmm_dpd.model.shear.LeesEdwards`.
"""

import math
from typing import Any, NamedTuple

import numpy as np

from ..runtime import Kernel, both
from .elementary import sine
from .motion import counting, over_beads

_TURN = 1.0 / (2.0 * math.pi)
#: What is known of a flow at a moment: its rate, what that changes by before and after beads drift, and the time that has been sheared.
RATE, BEFORE, AFTER, TIME = range(4)


class _Numbers(NamedTuple):
    """A shear of any kind: it oscillates if there is an amplitude, and a constant rate is a ramp that takes for ever."""

    amplitude: float
    frequency: float
    rate: float
    end_rate: float
    ramp_time: float


def _numbers(shear: Any) -> _Numbers:
    if shear.amplitude is not None:
        return _Numbers(shear.amplitude, shear.frequency, 0.0, 0.0, math.inf)
    return _Numbers(0.0, 0.0, shear.rate, *((shear.rate, math.inf) if shear.constant else (shear.end_rate, shear.ramp_time)))


@both
def _strain(s, time):
    if s.amplitude != 0.0:
        return s.amplitude * sine(_TURN * s.frequency * time)
    inside = min(time, s.ramp_time)
    return s.rate * inside + 0.5 * (s.end_rate - s.rate) * inside * inside / s.ramp_time + s.end_rate * (time - inside)


@both
def _rate(s, time):
    if s.amplitude != 0.0:
        return s.amplitude * s.frequency * sine(_TURN * s.frequency * time + 0.25)
    return s.rate + (s.end_rate - s.rate) * min(time / s.ramp_time, 1.0)


@both
def _tilt(edge, shift):
    """The images above a box, which are so much farther along x, as near as one of them is."""
    return min(max(shift - edge * math.floor(shift / edge + 0.5), -0.5 * edge), 0.5 * edge)


def strain_at(shear: Any, time: float) -> float:
    """Strain after a time."""
    return float(_strain(_numbers(shear), time))


def rate_at(shear: Any, time: float) -> float:
    """Its rate then."""
    return float(_rate(_numbers(shear), time))


def flow_at(shear: Any, time: float) -> np.ndarray:
    """(4,) RATE, BEFORE, AFTER, TIME."""
    return np.array([rate_at(shear, time), 0.0, 0.0, time])


def sheared_box(box: np.ndarray, strain: float, tilt: float = 0.0) -> np.ndarray:
    """(3, 3) reduced vectors of the lattice of a box at a strain: the images above it are ``strain`` times its height farther along x than
    by the ``tilt`` that it began with."""
    sheared = np.diag(np.diag(box))
    sheared[1, 0] = _tilt(box[0, 0], strain * box[1, 1] + tilt)
    return sheared


def _slide(shear, tilt, box, flow, time, part, parts, team):
    begin = flow[TIME]
    end = begin + time
    mean = (_strain(shear, end) - _strain(shear, begin)) / time
    flow[BEFORE], flow[AFTER] = mean - _rate(shear, begin), _rate(shear, end) - mean
    flow[RATE], flow[TIME] = _rate(shear, end), end
    box[1, 0] = _tilt(box[0, 0], _strain(shear, end) * box[1, 1] + tilt)
    return 0


_slide_kernel = Kernel(_slide)


def slide(shear: Any, tilt: float, box: np.ndarray, flow: np.ndarray, time: float) -> None:
    """Go on with box and flow for a time: beads that get the flow's change BEFORE and AFTER they drift for it go on to follow."""
    _slide_kernel(_numbers(shear), tilt, box, flow, time)


@over_beads
def change_flow(begin, end, v, x, flow, which):
    """Give beads a change of the flow at their unwrapped positions."""
    for i in range(begin, end):
        v[i, 0] += flow[which] * x[i, 1]


@counting
def leave_flow(begin, end, v, x, flow, limit, seen):
    """Write velocities (N, 3) relative to the flow to ``seen``; returns how many components are beyond a limit."""
    count = 0
    for i in range(begin, end):
        seen[i, 0], seen[i, 1], seen[i, 2] = v[i, 0] - flow[RATE] * x[i, 1], v[i, 1], v[i, 2]
        for k in range(3):
            count += not abs(seen[i, k]) <= limit
    return count


@over_beads
def join_flow(begin, end, v, x, flow, seen):
    """Write the velocities of such as these, ``seen``, back."""
    for i in range(begin, end):
        v[i, 0], v[i, 1], v[i, 2] = seen[i, 0] + flow[RATE] * x[i, 1], seen[i, 1], seen[i, 2]


def add_flow(v: np.ndarray, rate: float, x: np.ndarray) -> None:
    """Add the flow of a rate to the velocities (N, 3) of beads at unwrapped positions (N, 3)."""
    v[:, 0] += rate * x[:, 1]
