"""Loops over beads: velocities from displacements, drifts, kicks, walls, sorting.

Each is one pass without temporary arrays: an array of numpy's that lives for a moment costs more than the arithmetic on it, since its
memory comes from the operating system page by page.  Several threads share a pass where there are beads enough for them.
"""

from collections.abc import Callable, Sequence
from functools import partial
from typing import Any

import numpy as np

from ..runtime import Kernel, Tape, helper, inlined, meet, threads_for
from .templates import renamed


def _over_beads(beads, counts, arguments, part, parts, team):
    begin, end = beads // _EACH * part // parts * _EACH, beads // _EACH * (part + 1) // parts * _EACH
    if _COUNTS:
        counts[part] = _rows(begin, end, *arguments)
        return counts[part]
    _rows(begin, end, *arguments)
    return 0


# what over_beads() puts in
_rows: Any = None
_COUNTS, _EACH = False, 1


def over_beads(function: Callable, counts: bool = False, each: int = 1) -> Callable:
    """Make a pass over all beads of one over the rows ``begin`` to ``end`` of the first argument, of which ``each`` has so many.  One that
    ``counts`` returns a number for its rows, and the pass returns the sum."""
    kernel = Kernel(renamed(_over_beads, function.__name__, {"_rows": helper(function), "_COUNTS": counts, "_EACH": each}))

    def call(first, *others):
        parts = threads_for(len(first) // each)
        found = np.zeros(parts, np.int64)
        kernel(len(first), found, (first, *others), parts=parts)
        return sum(found.tolist()) if counts else None

    call.__doc__ = function.__doc__
    return call


#: Decorators of passes that return a count, and of passes over components.
counting, over_components = partial(over_beads, counts=True), partial(over_beads, each=3)
counting_components = partial(counting, each=3)


@over_beads
def seen_velocities(begin, end, x, kept, tau, v):
    """Write (x - kept)/tau to v (N, 3).  The displacement is taken as it is, not by minimum image, which would hide a speed that crosses
    half a box in tau.  Nothing folds beads back between two positions of one step: GPU platforms do so when a step is complete, the others
    never."""
    for i in range(begin, end):
        v[i, 0] = (x[i, 0] - kept[i, 0]) / tau
        v[i, 1] = (x[i, 1] - kept[i, 1]) / tau
        v[i, 2] = (x[i, 2] - kept[i, 2]) / tau


@over_beads
def add_to_moving(begin, end, values, changes, inv_mass):
    """Add changes (N, K) to the values of beads that move."""
    for i in range(begin, end):
        if inv_mass[i] > 0.0:
            for k in range(values.shape[1]):
                values[i, k] += changes[i, k]


def _take_rows(rows, out, names, back, part, parts, team):
    begin, end = len(names) * part // parts, len(names) * (part + 1) // parts
    for k in range(len(rows)):
        its, there = rows[k], out[k]
        for i in range(begin, end):
            for n in range(its.shape[1]):
                there[i, n] = its[names[i], n]
    if back:
        meet(team, parts)
        for k in range(len(rows)):
            its, there = rows[k], out[k]
            for i in range(begin, end):
                for n in range(its.shape[1]):
                    its[i, n] = there[i, n]
    return 0


_take_rows_kernel = Kernel(_take_rows)
#: So many arrays are moved at once, some of them empty: one compiled version does for all.
_ARRAYS, _EMPTY = 6, np.zeros((0, 0))


def take_rows(arrays: Sequence[tuple[np.ndarray, np.ndarray]], names: np.ndarray, back: bool = False) -> None:
    """Write the rows of these numbers (N,) of the first of two arrays (N, K) to the second, in their order, and from there ``back`` if
    wanted.  The arrays are contiguous, of float64."""
    rows, out = zip(*arrays, *[(_EMPTY, _EMPTY)] * (_ARRAYS - len(arrays)), strict=True)
    _take_rows_kernel(rows, out, names, back, parts=threads_for(len(names)))


@over_beads
def take_moving(begin, end, out, values, inv_mass):
    """Write the values (N, K) of beads that move to ``out``, and 0 for those that do not."""
    for i in range(begin, end):
        for k in range(values.shape[1]):
            out[i, k] = values[i, k] if inv_mass[i] > 0.0 else 0.0


@over_beads
def advance(begin, end, values, rates, time):
    """Add what the rates (N, K) make in a time to the values (N, K)."""
    for i in range(begin, end):
        for k in range(values.shape[1]):
            values[i, k] += time * rates[i, k]


@over_beads
def clear_values(begin, end, values):
    """Set the values (N, K) to 0."""
    for i in range(begin, end):
        for k in range(values.shape[1]):
            values[i, k] = 0.0


@over_beads
def see(begin, end, v, inv_mass, prescribed, out):
    """Write velocities (N, 3) to ``out``, which may be they themselves: those of beads that do not move are ``prescribed`` (N, 3)."""
    for i in range(begin, end):
        for k in range(3):
            out[i, k] = v[i, k] if inv_mass[i] > 0.0 else prescribed[i, k]


@over_beads
def hold(begin, end, v, inv_mass):
    """Set the velocities (N, 3) of beads that do not move to 0."""
    for i in range(begin, end):
        if inv_mass[i] == 0.0:
            v[i, 0] = v[i, 1] = v[i, 2] = 0.0


@inlined
def _move_component(x, v, c, change, time):
    """Change a component of the velocity, and let it drift; returns it."""
    speed = v[c] + change
    v[c] = speed
    x[c] += time * speed
    return speed


@helper
def _fast(v, begin, end, limit):
    """How many beads, whose components are (3N,), are not slower than the square root of 3 times the limit."""
    count = 0
    for c in range(begin, end, 3):
        count += not v[c] * v[c] + v[c + 1] * v[c + 1] + v[c + 2] * v[c + 2] <= 3.0 * limit * limit
    return count


@counting_components
def move(begin, end, x, v, force, inv_mass, kick, time, limit):
    """Kick and drift: all that a step does between two looks at the pairs.  The force acts for the time ``kick``, beads that move then
    drift for ``time``.  Arrays are (3N,), all components one after the other: this way (and counted without a sign) several of them are
    treated at once; ``inv_mass`` may be (1,), the same for all.  Returns how many beads are faster than the square root of 3 times the
    ``limit``, which only those can be that have a component beyond it."""
    count, first, last = 0, np.uint64(begin), np.uint64(end)
    if len(inv_mass) == 1:
        scale, drift = kick * inv_mass[0], time if inv_mass[0] > 0.0 else 0.0
        for c in range(first, last):
            count += not abs(_move_component(x, v, c, scale * force[c], drift)) <= limit
    else:
        for c in range(first, last):
            drift = time if inv_mass[c] > 0.0 else 0.0
            count += not abs(_move_component(x, v, c, (kick * inv_mass[c]) * force[c], drift)) <= limit
    return _fast(v, begin, end, limit) if count else 0


@counting_components
def predict(begin, end, out, v, acc, time, limit):
    """Write to ``out`` what velocities will be after a time; (3N,) each.  Returns how many beads are fast then, as :func:`move`."""
    for c in range(np.uint64(begin), np.uint64(end)):
        out[c] = v[c] + time * acc[c]
    return _fast(out, begin, end, limit)


@over_components
def accelerate(begin, end, acc, v, force, inv_mass, kick):
    """Write force/mass to the accelerations, and add kick times that to v; (3N,) each, masses as in :func:`move`."""
    if len(inv_mass) == 1:
        for c in range(np.uint64(begin), np.uint64(end)):
            acc[c] = force[c] * inv_mass[0]
            v[c] += kick * acc[c]
    else:
        for c in range(np.uint64(begin), np.uint64(end)):
            acc[c] = force[c] * inv_mass[c]
            v[c] += kick * acc[c]


@over_beads
def as_force(begin, end, change, inv_mass, dt):
    """Turn changes of velocities (N, 3) in place into the forces that make them in dt (0 for beads that do not move)."""
    for i in range(begin, end):
        scale = 1.0 / (dt * inv_mass[i]) if inv_mass[i] > 0.0 else 0.0
        change[i, 0] *= scale
        change[i, 1] *= scale
        change[i, 2] *= scale


@inlined
def put_back(x, low, high, start, period):
    """Coordinate after a reflection at two walls; see :mod:`openmm_dpd.simulation.programs.walls`."""
    folded = x - period * np.floor((x - start) / period)
    return x + 2.0 * max(0.0, low - folded) - 2.0 * max(0.0, folded - high)


@over_beads
def reflect_beads(begin, end, x, v, inv_mass, low, high, start, period, back, last):
    """Turn the velocities of beads beyond the walls round, and put positions back if this is the ``last`` of the velocities."""
    for i in range(begin, end):
        if inv_mass[i] == 0.0:
            continue
        whole = False
        for k in range(3):
            if back[k] != 0.0 and put_back(x[i, k], low[k], high[k], start[k], period[k]) != x[i, k]:
                whole = True
        for k in range(3):
            put = put_back(x[i, k], low[k], high[k], start[k], period[k])
            if whole or put != x[i, k]:
                v[i, k] = -v[i, k]
            if last:
                x[i, k] = put


def same(x: np.ndarray, y: np.ndarray) -> bool:
    """Whether two arrays (N, 3) are the same, bit for bit (zeros of both signs are)."""
    return bool((x == y).all())


def jumped(x: np.ndarray, before: np.ndarray, distance: float) -> bool:
    """Whether any coordinate differs by more than a distance."""
    with np.errstate(invalid="ignore"):  # from infinity to infinity is no jump
        return bool((np.abs(x - before) > distance).any())


def largest(v: np.ndarray) -> float:
    """Largest absolute component, or NaN if there is one that is none."""
    return float(np.abs(v).max(initial=0.0))


def _moments(weights, vectors, found, part, parts, team):
    xx, yy, zz, xy, xz, yz, mx, my, mz = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
    for i in range(len(vectors)):
        x, y, z = vectors[i, 0], vectors[i, 1], vectors[i, 2]
        wx, wy, wz = weights[i] * x, weights[i] * y, weights[i] * z
        xx += wx * x
        yy += wy * y
        zz += wz * z
        xy += wx * y
        xz += wx * z
        yz += wy * z
        mx += wx
        my += wy
        mz += wz
    for k, value in enumerate((xx, yy, zz, xy, xz, yz, mx, my, mz)):
        found[k] = value
    return 0


_moments_kernel = Kernel(_moments)


def moments(weights: np.ndarray, vectors: np.ndarray) -> np.ndarray:
    """(9,) sums over rows of weight a b with the components of a vector (xx, yy, zz, xy, xz, yz), and of weight a."""
    found = np.empty(9)
    _moments_kernel(weights, vectors, found)
    Tape.note(found)
    return found
