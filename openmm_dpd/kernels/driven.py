"""Walls that move or have something behind them, and the impulses that they take up.

A bead that a wall with the velocity u reflects gets 2 u - v (bounce-back); along the normal of the plane u is 0.  What is behind a wall is
a continuum: at the distance h it pushes a bead by F(h), and after each sweep it takes a part of the velocity relative to the wall away,
with noise, by an exact Ornstein-Uhlenbeck step in the plane and along the normal::

    v <- v - (1 - q) (v - u) + sqrt(kT (1 - q^2)/m) xi        q = exp(-Gamma(h) dt/m)

A step of friction keeps the Maxwell distribution about u, whatever its length.  F and Gamma are tables with a straight line between rows
(:mod:`openmm_dpd.plan.continuum`).  What a bead gains the wall loses: all sums go through the beads in turn, by one thread, so that no
number of threads changes a bit.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, ClassVar, NamedTuple

import numpy as np

from ..base.names import IMPULSES
from ..runtime import Kernel, inlined
from .elementary import sine
from .motion import put_back, reflect_beads
from .noise import normal, pair_key, told_key
from .sweeps import EXACT, decay

#: In the key of the noise of walls, where layers of pair terms have 0, 1, ...
NOISE = 1 << 32
#: Columns of the tables: force, its integral from h to the end of the table, friction along the normal and in the plane.
FORCE, ENERGY, NORMAL, PLANE = range(4)


@dataclass(frozen=True, eq=False)
class Continuum:
    """What is behind the walls of one axis: forces on single beads, and friction."""

    term: ClassVar[str] = "external"
    types: np.ndarray  #: (N,) int32
    inv_mass: np.ndarray  #: (N,) 1/mass, 0 for beads that do not move
    axis: int
    planes: np.ndarray  #: (2,) where the beads are above and below, nm
    there: np.ndarray  #: (2,) float, 1 where something is behind that plane
    start: float  #: Where the period around the middle of the gap begins
    period: float
    tables: np.ndarray  #: (2, T, K + 1, 4) of each plane and bead type, at K + 1 distances from 0 on
    reach: float  #: The last of them

    def evaluator(self) -> ContinuumForce:
        """What computes the force."""
        return ContinuumForce(self)

    def few(self) -> tuple[Continuum, np.ndarray, np.ndarray]:
        """One bead."""
        one = np.zeros(1, np.int32), np.ones(1), 0, np.array([0.0, 1.0]), np.ones(2), -1.5, 4.0, np.zeros((2, 1, 2, 4)), 1.0
        return Continuum(*one), np.full((1, 3), 0.5), np.diag([4.0] * 3)

    @property
    def arguments(self) -> tuple:
        """For the kernels."""
        return self.types, self.axis, self.planes, self.there, self.start, self.period, self.tables, self.reach


@dataclass(frozen=True, eq=False)
class Driven:
    """All walls of a scene in which some move or have something behind them."""

    there: np.ndarray  #: (3, 2) bool which walls there are
    velocity: np.ndarray  #: (3, 2, 3) of each axis and side, nm/ps
    period: np.ndarray  #: (3, 2) of their oscillation, ps; 0 where the velocity is constant
    continuum: Continuum | None
    shape: ClassVar[tuple[int, int, int]] = (3, 2, 3)  #: Of what is recorded

    @property
    def impulses(self) -> dict[tuple[int, int, int], str]:
        """Names of what is recorded, by axis, side and component."""
        return {place: name for place, name in IMPULSES.items() if self.there[place[:2]]}

    @property
    def steady(self) -> bool:
        """Whether all velocities are constant."""
        return not (self.period > 0).any()

    def velocities(self, time: float) -> np.ndarray:
        """(3, 2, 3) at a time."""
        if self.steady:
            return self.velocity
        moving = self.period > 0
        turns = np.where(moving, time / np.where(moving, self.period, 1.0), 0.0)
        return self.velocity * np.where(moving, sine(turns + 0.25), 1.0)[:, :, None]


@inlined
def _row(h, rows, reach):
    """Row of a table, and the place in it, of the distance h; distances below 0 count as 0."""
    place = max(0.0, h) * (rows / reach)
    row = min(int(place), rows - 1)
    return row, place - row


@inlined
def _entry(tables, side, kind, row, part, column):
    one = tables[side, kind, row, column]
    return one + part * (tables[side, kind, row + 1, column] - one)


@inlined
def _distance(x, plane, side, start, period):
    folded = x - period * np.floor((x - start) / period)
    return plane - folded if side else folded - plane


def _continuum_forces(x, types, axis, planes, there, start, period, tables, reach, force, found, part, parts, team):
    """Add the forces, along the normal and away from the walls; ``found`` gets the energy, which counts from the end of the tables."""
    energy, width = 0.0, reach / (tables.shape[2] - 1)
    for i in range(len(x)):
        for side in range(2):
            h = _distance(x[i, axis], planes[side], side, start, period)
            if there[side] == 0.0 or h >= reach or types[i] < 0:
                continue
            row, part_of_it = _row(h, tables.shape[2] - 1, reach)
            push = _entry(tables, side, types[i], row, part_of_it, FORCE)
            end = tables[side, types[i], row + 1, FORCE]
            energy += tables[side, types[i], row + 1, ENERGY] + 0.5 * (push + end) * width * (1.0 - part_of_it)
            energy += push * max(0.0, -h)
            force[i, axis] += -push if side else push
    found[0] = energy
    return 0


continuum_forces = Kernel(_continuum_forces)


def _continuum_push(x, inv_mass, types, axis, planes, there, start, period, tables, reach, kick, impulses, part, parts, team):
    """Add what the force of the beads that move passes on to each wall of the axis in the time ``kick`` to the impulses (3, 2, 3)."""
    low, high = 0.0, 0.0
    for i in range(len(x)):
        for side in range(2):
            h = _distance(x[i, axis], planes[side], side, start, period)
            if inv_mass[i] > 0.0 and there[side] != 0.0 and h < reach and types[i] >= 0:
                row, part_of_it = _row(h, tables.shape[2] - 1, reach)
                push = _entry(tables, side, types[i], row, part_of_it, FORCE)
                if side:
                    high += push
                else:
                    low += -push
    impulses[axis, 0, axis] += kick * low
    impulses[axis, 1, axis] += kick * high
    return 0


continuum_push = Kernel(_continuum_push)


class _Drag(NamedTuple):
    """What friction and noise of walls depend on beside the beads."""

    velocity: np.ndarray  #: (3, 2, 3) of the walls
    dt: float
    kT: float
    key: np.uint64


def _continuum_drag(x, v, inv_mass, types, axis, planes, there, start, period, tables, reach, drag, taken, impulses, part, parts, team):
    """Friction and noise; adds what the walls get of momentum to the impulses (3, 2, 3), by way of ``taken`` (2, 3)."""
    taken[:] = 0.0
    for i in range(len(x)):
        for side in range(2):
            h = _distance(x[i, axis], planes[side], side, start, period)
            if inv_mass[i] == 0.0 or there[side] == 0.0 or h >= reach or types[i] < 0:
                continue
            row, part_of_it = _row(h, tables.shape[2] - 1, reach)
            number = pair_key(drag.key, i, i)
            for k in range(3):
                gamma = _entry(tables, side, types[i], row, part_of_it, NORMAL if k == axis else PLANE)
                lost = decay(EXACT, gamma * inv_mass[i] * drag.dt)
                noise = np.sqrt(drag.kT * inv_mass[i] * lost * (2.0 - lost)) * normal(number, 3 * side + k)
                change = noise - lost * (v[i, k] - drag.velocity[axis, side, k])
                v[i, k] += change
                taken[side, k] -= change / inv_mass[i]
    for side in range(2):
        for k in range(3):
            impulses[axis, side, k] += taken[side, k]
    return 0


_drag_kernel = Kernel(_continuum_drag)


@inlined
def _side(x, put, plane, start, period):
    """0 for a bead that the lower plane puts back, 1 for the upper one, else -1."""
    return -1 if put == x else 0 if x - period * np.floor((x - start) / period) < plane else 1


def _reflect_driven(x, v, inv_mass, low, high, start, period, back, velocity, last, taken, impulses, part, parts, team):
    """Reflect beads (:func:`.motion.reflect_beads`) at walls with velocities (3, 2, 3); if this is the ``last`` of the velocities, what
    each wall gets of momentum is added to the impulses (3, 2, 3), by way of ``taken``.  In an edge each wall turns the component along
    its normal, the first axis the rest."""
    taken[:] = 0.0
    for i in range(len(x)):
        inside = True
        for k in range(3):
            inside &= put_back(x[i, k], low[k], high[k], start[k], period[k]) == x[i, k]
        if inside or inv_mass[i] == 0.0:
            continue
        first, its = -1, 0
        for k in range(3):
            put = put_back(x[i, k], low[k], high[k], start[k], period[k])
            side = _side(x[i, k], put, low[k], start[k], period[k])
            if side >= 0 and back[k] != 0.0 and first < 0:
                first, its = k, side
        for k in range(3):
            put = put_back(x[i, k], low[k], high[k], start[k], period[k])
            side = _side(x[i, k], put, low[k], start[k], period[k])
            wall, there, speed = (k, side, 0.0) if side >= 0 else (first, its, velocity[first, its, k])
            if wall >= 0:
                turned = 2.0 * speed - v[i, k]
                if last:
                    taken[wall, there, k] -= (turned - v[i, k]) / inv_mass[i]
                v[i, k] = turned
            if last:
                x[i, k] = put
    for k in range(3):
        for side in range(2):
            for component in range(3):
                impulses[k, side, component] += taken[k, side, component]
    return 0


reflect_driven = Kernel(_reflect_driven)


def reflect(walls: tuple, driven: Any, m: Any, inv_mass: np.ndarray, velocities: Sequence[np.ndarray]) -> None:
    """Reflect beads at walls, which may be ``driven``; of several velocities the last one puts the positions back."""
    speeds = driven.velocities(m.time + 0.5 * m.dt) if isinstance(driven, Driven) else None
    for k, v in enumerate(velocities):
        if speeds is None:
            reflect_beads(m.x, v, inv_mass, *walls, k == len(velocities) - 1)
        else:
            reflect_driven(m.x, v, inv_mass, *walls, speeds, k == len(velocities) - 1, np.zeros((3, 2, 3)), m.impulses)


class ContinuumForce:
    """Computes the force of a :class:`Continuum`."""

    repeats = True

    def __init__(self, terms: Continuum):
        self._arguments, self._found = terms.arguments, np.zeros(1)

    def add_to(self, x: np.ndarray, box: np.ndarray | None, force: np.ndarray, scale: float) -> float:
        """See :class:`.extras.Evaluator`; the factor of body forces is not that of walls."""
        continuum_forces(x, *self._arguments, force, self._found)
        return float(self._found[0])


def drag_by_walls(
    walls: Continuum, x, v, velocity: np.ndarray, time: float, kT: float, seed: int, counter: int, impulses: np.ndarray
) -> None:
    """Friction and noise for a time; velocities and impulses are those of all walls, (3, 2, 3)."""
    drag = _Drag(velocity, time, kT, told_key(seed, counter, NOISE, kT))
    _drag_kernel(x, v, walls.inv_mass, *walls.arguments, drag, np.zeros((2, 3)), impulses)
