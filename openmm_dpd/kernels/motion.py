"""Small loops over beads: velocities from displacements, kicks, impulses as forces, sorting.

Each is one pass without temporary arrays: an array of numpy's that lives for a moment costs more than the arithmetic on it, since
its memory comes from the operating system page by page.
"""

from __future__ import annotations

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
def as_force(change, inv_mass, dt, share, force):
    """Turn changes of velocities (N, 3) in place into the forces that make them in dt (0 for beads that do not move).

    A share of another force is added.
    """
    for i in range(len(change)):
        scale = 1.0 / (dt * inv_mass[i]) if inv_mass[i] > 0.0 else 0.0
        change[i, 0] = change[i, 0] * scale + share * force[i, 0]
        change[i, 1] = change[i, 1] * scale + share * force[i, 1]
        change[i, 2] = change[i, 2] * scale + share * force[i, 2]


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
