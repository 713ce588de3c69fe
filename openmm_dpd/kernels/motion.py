"""Small loops over beads: velocities from displacements, kicks, impulses as forces, sorting.

Each is one pass without temporary arrays: an array of numpy's that lives for a moment costs more than the arithmetic on it, since
its memory comes from the operating system page by page.
"""

from __future__ import annotations

import numpy as np
from numba import njit

from .compiled import compiled


@compiled
def seen_velocities(x, kept, tau, v):
    """Write (x - kept)/tau to v (N, 3).

    The displacement is taken as it is, not by minimum image, which would hide a speed that crosses half a box in tau.  Nothing folds beads
    back between two positions of one step: GPU platforms do so when a step is complete, the others never.
    """
    for i in range(len(x)):
        v[i, 0] = (x[i, 0] - kept[i, 0]) / tau
        v[i, 1] = (x[i, 1] - kept[i, 1]) / tau
        v[i, 2] = (x[i, 2] - kept[i, 2]) / tau


@compiled
def same(x, y):
    """Whether two arrays (N, 3) are the same, bit for bit (zeros of both signs are)."""
    for i in range(len(x)):
        if x[i, 0] != y[i, 0] or x[i, 1] != y[i, 1] or x[i, 2] != y[i, 2]:
            return False
    return True


@compiled
def jumped(x, before, distance):
    """Whether any coordinate differs by more than a distance."""
    for i in range(len(x)):
        if abs(x[i, 0] - before[i, 0]) > distance or abs(x[i, 1] - before[i, 1]) > distance or abs(x[i, 2] - before[i, 2]) > distance:
            return True
    return False


@compiled
def kick(v, force, inv_mass, time):
    """Add time*force/mass to v (N, 3)."""
    for i in range(len(v)):
        scale = time * inv_mass[i]
        v[i, 0] += scale * force[i, 0]
        v[i, 1] += scale * force[i, 1]
        v[i, 2] += scale * force[i, 2]


@compiled
def as_force(change, inv_mass, dt):
    """Turn changes of velocities (N, 3) in place into the forces that make them in dt (0 for beads that do not move)."""
    for i in range(len(change)):
        scale = 1.0 / (dt * inv_mass[i]) if inv_mass[i] > 0.0 else 0.0
        change[i, 0] *= scale
        change[i, 1] *= scale
        change[i, 2] *= scale


@compiled
def gather(values, order, out):
    """Write values[order] to out, (M, 3) each."""
    for k in range(len(order)):
        i = order[k]
        out[k, 0] = values[i, 0]
        out[k, 1] = values[i, 1]
        out[k, 2] = values[i, 2]


@compiled
def scatter(values, order, out):
    """Write values to out[order], (M, 3) each."""
    for k in range(len(order)):
        i = order[k]
        out[i, 0] = values[k, 0]
        out[i, 1] = values[k, 1]
        out[i, 2] = values[k, 2]


@compiled
def as_shown(x, values, scale, inv_mass):
    """Round values (N, 3) in place to what is left of them after x + scale*values; 0 for beads that do not move."""
    for i in range(len(x)):
        if inv_mass[i] > 0.0:
            for k in range(3):
                values[i, k] = ((x[i, k] + scale * values[i, k]) - x[i, k]) / scale
        else:
            values[i, 0] = values[i, 1] = values[i, 2] = 0.0


@compiled
def column_as_shown(x, values, scale, inv_mass):
    """The same for one value (N,) of each bead, shown along one axis; beads that do not move keep theirs."""
    for i in range(len(x)):
        if inv_mass[i] > 0.0:
            values[i] = ((x[i] + scale * values[i]) - x[i]) / scale


@compiled
def drift(x, v, inv_mass, time):
    """Add time*v to the positions of beads that move."""
    for i in range(len(x)):
        if inv_mass[i] > 0.0:
            x[i, 0] += time * v[i, 0]
            x[i, 1] += time * v[i, 1]
            x[i, 2] += time * v[i, 2]


@compiled
def move(v, acceleration, time):
    """Add time*acceleration to v (N, 3)."""
    for i in range(len(v)):
        v[i, 0] += time * acceleration[i, 0]
        v[i, 1] += time * acceleration[i, 1]
        v[i, 2] += time * acceleration[i, 2]


@compiled
def largest(v):
    """Largest absolute component, or NaN if there is one that is none."""
    most = 0.0
    for i in range(len(v)):
        for k in range(3):
            size = abs(v[i, k])
            if not size <= most:
                most = size
                if size != size:
                    return size
    return most


@njit(inline="always")
def _put_back(x, low, high, start, period):
    """Coordinate after a reflection at two walls; see :mod:`openmm_dpd.programs.walls`."""
    folded = x - period * np.floor((x - start) / period)
    return x + 2.0 * max(0.0, low - folded) - 2.0 * max(0.0, folded - high)


@compiled
def reflect(x, v, inv_mass, low, high, start, period, back, last):
    """Turn the velocities of beads beyond the walls round, and put positions back if this is the ``last`` of the velocities."""
    for i in range(len(x)):
        if inv_mass[i] == 0.0:
            continue
        whole = False
        for k in range(3):
            if back[k] != 0.0 and _put_back(x[i, k], low[k], high[k], start[k], period[k]) != x[i, k]:
                whole = True
        for k in range(3):
            put = _put_back(x[i, k], low[k], high[k], start[k], period[k])
            if whole or put != x[i, k]:
                v[i, k] = -v[i, k]
            if last:
                x[i, k] = put


@compiled
def push(v, force, mass, time):
    """Add time*force/mass to the velocities (N, 3) of beads that move; in the order in which OpenMM evaluates that."""
    for i in range(len(v)):
        if mass[i] > 0.0:
            v[i, 0] += time * force[i, 0] / mass[i]
            v[i, 1] += time * force[i, 1] / mass[i]
            v[i, 2] += time * force[i, 2] / mass[i]


@compiled
def scatter_add(values, order, out):
    """Add values to out[order], (M, 3) each."""
    for k in range(len(order)):
        i = order[k]
        out[i, 0] += values[k, 0]
        out[i, 1] += values[k, 1]
        out[i, 2] += values[k, 2]
