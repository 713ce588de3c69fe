"""Rigid bodies by linear algebra: every velocity that the bodies allow is a combination of columns, and all else is taken off.

With the columns B of one coordinate each (three of a free bead; of a body its translations and rotations about its centre) and the masses
M, the projector B (B^T M B)^+ B^T M takes off what the forces of constraint would; it knows nothing of centres, tensors of inertia and the
like that the engine has.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable

import numpy as np
from scipy.integrate import solve_ivp


class Constrained:
    """N beads, some in bodies: indices of its beads, axes along which it moves, whether it turns."""

    def __init__(self, masses: np.ndarray, bodies: Iterable[tuple[np.ndarray, str, bool]]):
        self.masses, self.bodies = masses, [(np.asarray(beads), moves, turns) for beads, moves, turns in bodies]

    def projector(self, x: np.ndarray) -> np.ndarray:
        """(3N, 3N) at positions (N, 3)."""
        n, free, columns = len(x), np.ones(len(x), bool), []
        for beads, moves, turns in self.bodies:
            free[beads] = False
            centre = self.masses[beads] @ x[beads] / self.masses[beads].sum()
            for axis in range(3):
                for turning, allowed in ((False, "xyz"[axis] in moves), (True, turns)):
                    column, unit = np.zeros((n, 3)), np.eye(3)[axis]
                    column[beads] = np.cross(unit, x[beads] - centre) if turning else unit
                    columns += [column.ravel()] if allowed else []
        columns += [np.eye(3 * n)[3 * i + axis] for i in np.flatnonzero(free) for axis in range(3)]
        b, m = np.array(columns).T, np.repeat(self.masses, 3)
        return b @ np.linalg.pinv(b.T @ (m[:, None] * b), rcond=1e-10, hermitian=True) @ (b.T * m)

    def projected(self, x: np.ndarray, v: np.ndarray) -> np.ndarray:
        """Velocities (N, 3) without what the bodies do not allow."""
        return (self.projector(x) @ v.ravel()).reshape(-1, 3)

    def sweep(self, x, v, order, strength: Callable, box, kT: float, dt: float, noise: Callable, shardlow: bool = False) -> np.ndarray:
        """Update pairs (i, j), i < j, one after the other; ``strength(i, j, r)`` is the friction, ``noise(i, j)`` the number of a pair."""
        projector, inverse, v = self.projector(x), np.repeat(1 / self.masses, 3), v.copy()
        for i, j in order:
            d = x[i] - x[j] - (0 if box is None else np.diag(box) * np.round((x[i] - x[j]) / np.diag(box)))
            r = np.linalg.norm(d)
            along = np.zeros((len(x), 3))
            along[i], along[j] = d / r, -d / r
            change = projector @ (inverse * along.ravel())
            mobility, speed, g = along.ravel() @ change, along.ravel() @ v.ravel(), strength(i, j, r)
            if mobility < 1e-12:
                continue
            factor = g * mobility * dt
            q = (1 - factor / 2) / (1 + factor / 2) if shardlow else np.exp(-factor)
            after = q * speed + np.sqrt((1 - q * q) * kT * mobility) * noise(i, j)
            v += ((after - speed) / mobility * change).reshape(-1, 3)
        return v

    def drift(self, x: np.ndarray, v: np.ndarray, time: float) -> tuple[np.ndarray, np.ndarray]:
        """Free motion: beads go straight, bodies turn by Newton's second law with w x (w x r) as the only acceleration."""
        x, v = x.copy(), v.copy()
        inside = np.concatenate([beads for beads, _, _ in self.bodies])
        free = np.setdiff1d(np.arange(len(x)), inside)
        x[free] += time * v[free]
        for beads, _, _ in self.bodies:
            m = self.masses[beads]
            centre, speed = m @ x[beads] / m.sum(), m @ v[beads] / m.sum()
            r, momentum = x[beads] - centre, np.cross(x[beads] - centre, m[:, None] * v[beads]).sum(axis=0)

            def slope(_, flat, m=m, momentum=momentum):
                r = flat.reshape(-1, 3)
                return np.cross(_spin(m, r, momentum), r).ravel()

            r = solve_ivp(slope, (0, time), r.ravel(), method="DOP853", rtol=1e-13, atol=1e-13).y[:, -1].reshape(-1, 3)
            x[beads], v[beads] = centre + time * speed + r, speed + np.cross(_spin(m, r, momentum), r)
        return x, v


def _spin(m: np.ndarray, r: np.ndarray, momentum: np.ndarray) -> np.ndarray:
    """Angular velocity of points with an angular momentum, the smallest one."""
    inertia = np.sum(m * np.sum(r * r, axis=1)) * np.eye(3) - (m[:, None] * r).T @ r
    return np.linalg.pinv(inertia, rcond=1e-10, hermitian=True) @ momentum
