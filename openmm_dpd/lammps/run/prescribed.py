"""Motion that ``fix move`` prescribes: places and velocities of beads as functions of the time since the fix was defined."""

import math
from collections.abc import Callable

import numpy as np

from ..state.records import Fix
from ..values.resolver import Resolver
from .acting import formula_values, starts

#: Places (n, 3) at the start -> places and velocities after a time, in the deck's units; NaN for components that are integrated.
Way = Callable[[Fix, Resolver, np.ndarray, float], tuple[np.ndarray, np.ndarray]]


def _linear(fix: Fix, moment: Resolver, start: np.ndarray, time: float) -> tuple[np.ndarray, np.ndarray]:
    v = np.broadcast_to(fix.parameters["values"], start.shape)
    return start + v * time, v


def _wiggle(fix: Fix, moment: Resolver, start: np.ndarray, time: float) -> tuple[np.ndarray, np.ndarray]:
    *amplitude, period = fix.parameters["values"]
    a, omega = np.broadcast_to(amplitude, start.shape), 2.0 * math.pi / period
    return start + a * math.sin(omega * time), a * omega * math.cos(omega * time)


def _rotate(fix: Fix, moment: Resolver, start: np.ndarray, time: float) -> tuple[np.ndarray, np.ndarray]:
    """About an axis through a point, which may move."""
    values = fix.parameters["values"]
    (v, point, axis), omega = np.reshape(values[:-1], (3, 3)), 2.0 * math.pi / values[-1]
    axis = axis / np.linalg.norm(axis)
    arms = start - point
    along = np.outer(arms @ axis, axis)
    turned = math.cos(omega * time) * (arms - along) + math.sin(omega * time) * np.cross(axis, arms)
    return point + v * time + along + turned, v + omega * np.cross(axis, turned)


def _variable(fix: Fix, moment: Resolver, start: np.ndarray, time: float) -> tuple[np.ndarray, np.ndarray]:
    members, found = moment.state.group(fix.group), np.full((2, *start.shape), np.nan)
    for k, word in enumerate(fix.parameters["values"]):
        if word is not None:
            found[k // 3, :, k % 3] = formula_values(word, moment, members)
    return start + found[0], found[1]


WAYS: dict[str, Way] = {"linear": _linear, "wiggle": _wiggle, "rotate": _rotate, "transrot": _rotate, "variable": _variable}


def moved(fix: Fix, moment: Resolver) -> tuple[np.ndarray, np.ndarray]:
    """Places, continuous as those of the moment, and velocities (n, 3) of the beads of a ``fix move`` at the step of the moment."""
    state, members = moment.state, moment.state.group(fix.group)
    time = (moment.step - fix.parameters["step"]) * state.timestep / moment.units.time
    x, v = WAYS[fix.parameters["way"]](fix, moment, starts(fix, moment, members), time)
    return x - moment.images[members] @ moment.box.vectors, v
