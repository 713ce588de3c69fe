"""Walls: after each drift, beads beyond a plane are reflected and their velocities reversed.

Each degree of freedom has its own limits, so that the reflection is one expression per degree of freedom for any number of walls::

    r = x + 2 max(0, low - t) - 2 max(0, t - high)        t = x wrapped into the period around the middle of the gap
    specular      v <- -v of the degree of freedom where r is not x
    bounce-back   v <- -v of the bead where r is not x for any of its degrees of freedom

Only the second needs a vector function, which costs as much as five other lines on the CPU platform.  A drift that passes velocities to
the pair force must not be reflected before it is seen, so schemes pass them by a trial drift if there are walls.
"""

from collections.abc import Mapping

import numpy as np

from ...model.flow import BOUNCE_BACK, MIXED, NOWHERE, SPECULAR, Gap
from .program import Program

CONSTANTS = LOW, HIGH, START, PERIOD, BACK = "wall_low", "wall_high", "wall_start", "wall_period", "wall_back"
PUT_BACK = "wall_x"


def planes(gaps: Mapping[int, Gap]) -> dict[str, np.ndarray]:
    """Values (3,) of the per-axis constants of the walls, by name."""
    low, high = np.full(3, -NOWHERE), np.full(3, NOWHERE)
    start, period = np.full(3, -1e9), np.full(3, 4e9)  # no position is ever wrapped
    back = np.zeros(3)
    for axis, gap in gaps.items():
        low[axis], high[axis], back[axis] = gap.low, gap.high, gap.kind == BOUNCE_BACK
        if gap.period is not None:
            start[axis], period[axis] = 0.5 * (gap.low + gap.high - gap.period), gap.period
    return {LOW: low, HIGH: high, START: start, PERIOD: period, BACK: back}


def variables(gaps: Mapping[int, Gap], kind: str, n_beads: int) -> dict[str, np.ndarray]:
    """Values (N, 3) of the per-DOF variables of walls of this kind, by name."""
    values = planes(gaps)
    if kind != MIXED:
        del values[BACK]
    return {name: np.tile(value, (n_beads, 1)) for name, value in values.items()}


def add_reflection(p: Program, also: tuple[str, ...] = ()) -> None:
    """Add the reflection of positions and velocities (and of other per-DOF velocities, ``also``) after a drift, if there are walls."""
    kind = p.options.walls
    if not kind:
        return
    for name, why in ((LOW, "lower walls"), (HIGH, "upper walls"), (START, "start of the period"), (PERIOD, "period")):
        p.declare_per_dof(name, why)
    p.declare_per_dof(PUT_BACK, "positions reflected by the walls")
    folded = f"(x-{PERIOD}*floor((x-{START})/{PERIOD}))"
    p.each(PUT_BACK, f"x+2*max(0, {LOW}-{folded})-2*max(0, {folded}-{HIGH})", "reflect at the walls")
    hit = f"(1-delta({PUT_BACK}-x))"
    if kind == SPECULAR:
        turned, why = hit, "reverse the normal component"
    elif kind == BOUNCE_BACK:
        turned, why = f"min(1, dot({hit}, {hit}))", "reverse the velocity"
    else:
        p.declare_per_dof(BACK, "1 along axes with bounce-back, else 0")
        turned = f"max((1-{BACK})*{hit}, min(1, dot({BACK}*{hit}, {BACK}*{hit})))"
        why = "reverse the velocity, or its normal component"
    for name in ("v", *also):
        p.each(name, f"{name}*(1-2*{turned})", why)
    p.each("x", PUT_BACK)
