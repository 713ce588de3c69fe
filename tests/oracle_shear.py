"""Lees-Edwards shear as its authors have it, in numpy: beads are folded into the box, and one that leaves it across y comes back at another x
with another velocity.  The package never folds, and counts no images: only pairs, forces and noise are as in :mod:`oracle`."""

import itertools

import numpy as np
import oracle

#: How many boxes away images are, along y and z.
IMAGES = np.array(list(itertools.product((-1, 0, 1), repeat=2)))


class FoldedShear:
    """Beads in a rectangular box (3,), sheared along x across y by a strain that is a function of time, ``strain(t)``, with its rate
    ``rate(t)``.  While the rate changes the flow keeps its linear profile: beads at y get the change times y (SLLOD)."""

    def __init__(self, x, v, box, types, params, inv_m, strain, rate):
        self.x, self.v, self.box, self.types, self.params = np.array(x), np.array(v), np.asarray(box), types, params
        self.inv_m, self.strain, self.rate, self.time, self.turns = np.asarray(inv_m), strain, rate, 0.0, np.zeros(len(x))
        self.fold()

    def fold(self) -> None:
        """Put every bead back into the box; ``turns`` counts how often it left across y."""
        turns = np.floor(self.x[:, 1] / self.box[1])
        self.turns += turns
        self.x[:, 1] -= turns * self.box[1]
        self.x[:, 0] -= turns * self.strain(self.time) * self.box[1]
        self.v[:, 0] -= turns * self.rate(self.time) * self.box[1]
        for axis in (0, 2):
            self.x[:, axis] -= self.box[axis] * np.floor(self.x[:, axis] / self.box[axis])

    def pair(self, i: int, j: int):
        """(distance, unit vector from j to i, velocity of the nearest image of j) of two beads."""
        lx, ly, lz = self.box
        d = self.x[i] - self.x[j] - IMAGES @ np.array([[self.strain(self.time) * ly, ly, 0], [0, 0, lz]])
        d[:, 0] -= lx * np.round(d[:, 0] / lx)
        squares = np.einsum("ia,ia->i", d, d)
        nearest = np.argmin(squares)
        r = np.sqrt(squares[nearest])
        return r, d[nearest] / r, self.v[j] + [IMAGES[nearest, 0] * self.rate(self.time) * ly, 0, 0]

    def force(self, dissipative: bool = False, noise=None, kT: float = 0.0, dt: float = 1.0) -> np.ndarray:
        """Forces: conservative, and friction and noise where they are forces."""
        force, p = np.zeros_like(self.x), self.params
        for i, j in itertools.combinations(range(len(self.x)), 2):
            a, b = self.types[i], self.types[j]
            r, e, v_j = self.pair(i, j)
            if r >= p.cutoff[a, b]:
                continue
            w = 1 - r / p.cutoff[a, b]
            f = p.A[a, b] * w * e
            if dissipative:
                u = self.v[i] - v_j
                f = f - p.gamma[a, b] * w ** (2 * p.s[a, b]) * (e @ u) * e
                f = f - p.gamma_perp[a, b] * w ** (2 * p.s_perp[a, b]) * (u - (e @ u) * e)
            if noise is not None:
                z = np.array([noise(i, j, k) for k in (1, 2, 3)])
                f = f + np.sqrt(2 * kT * p.gamma[a, b] / dt) * w ** p.s[a, b] * noise(i, j, 0) * e
                f = f + np.sqrt(2 * kT * p.gamma_perp[a, b] / dt) * w ** p.s_perp[a, b] * (z - (e @ z) * e)
            force[i] += f
            force[j] -= f
        return force

    def sweep(self, order, kT: float, dt: float, noise, update) -> np.ndarray:
        """Pair updates in an order; returns the sum (3, 3) of r J, J the impulses of the friction along the lines between beads."""
        p, passed = self.params, np.zeros((3, 3))
        for pair in order:
            i, j = sorted(pair)
            a, b = self.types[i], self.types[j]
            r, e, seen = self.pair(i, j)
            w = 1 - r / p.cutoff[a, b]
            g, g_perp = p.gamma[a, b] * w ** (2 * p.s[a, b]), p.gamma_perp[a, b] * w ** (2 * p.s_perp[a, b])
            z = [noise(i, j, k) for k in range(4)]
            without_noise = update(self.v[i], seen, e, self.inv_m[i], self.inv_m[j], g, 0.0, 0.0, dt, 0.0)[0]
            passed += np.outer(r * e, (without_noise - self.v[i]) / self.inv_m[i])
            v_i, v_j = update(self.v[i], seen, e, self.inv_m[i], self.inv_m[j], g, g_perp, kT, dt, z[0], z[1:])
            self.v[i], self.v[j] = v_i, self.v[j] + (v_j - seen)
        return passed

    def drift(self, time: float) -> None:
        """Drift; a bead of this box and its images do so together."""
        y = self.x[:, 1] + self.turns * self.box[1]
        before, mean = self.rate(self.time), (self.strain(self.time + time) - self.strain(self.time)) / time
        # relative to the flow at its own place in the box a bead drifts freely
        self.v[:, 0] += (mean - before) * self.x[:, 1]
        self.x = self.x + time * self.v
        self.time += time
        self.v[:, 0] += (self.rate(self.time) - mean) * self.x[:, 1]
        self.fold()
        assert np.allclose(self.x[:, 1] + self.turns * self.box[1], y + time * self.v[:, 1])

    def kick(self, time: float) -> None:
        """Conservative forces for a time."""
        self.v = self.v + time * self.inv_m[:, None] * self.force()

    def lattice(self) -> np.ndarray:
        """(3, 3) box vectors of the images."""
        lx, ly, _ = self.box
        box, slide = np.diag(self.box).astype(float), self.strain(self.time) * ly
        box[1, 0] = slide - lx * np.round(slide / lx)
        return box


def folded_state(x, v, box, strain: float, rate: float):
    """Positions and velocities of the package, folded as here."""
    x, v = np.array(x), np.array(v)
    turns = np.floor(x[:, 1] / box[1])
    x -= np.outer(turns, [strain * box[1], box[1], 0])
    v[:, 0] -= turns * rate * box[1]
    for axis in (0, 2):
        x[:, axis] -= box[axis] * np.floor(x[:, axis] / box[axis])
    return x, v


__all__ = ["FoldedShear", "folded_state", "oracle"]
