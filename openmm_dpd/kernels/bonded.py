"""Bonds: compiled energies and forces.

With r the length of a bond and d = x_i - x_j, the force on its first bead is -U'(r) d/r; at r = 0 it has no direction and is 0, as with
OpenMM.  The formula of a kind takes r, r^2, the coefficients p of all bonds and the number n of one, and gives U and -U'/r.
"""

from typing import Any

import numpy as np

from ..base.errors import bead_names, in_length, overstretched
from ..base.geometry import minimum_images
from .elementary import exp, log
from .extras import BondedKernel, nearest_image

#: r/sigma where the repulsion of a FENE bond ends, the minimum of Lennard-Jones.
WCA_END = 2.0 ** (1.0 / 6.0)
_ONE, _TWO = np.uint64(1), np.uint64(2)
# the formula of a kind
_formula: Any = None


def _part(x, box, inverse, pairs, p, begin, end, parts, first):
    # what is read and written at places that are not known before has loops of its own: in the other one several bonds are done at once
    energy, count, begin, first = 0.0, np.uint64(end - begin), np.uint64(begin), np.uint64(first)
    ax, bx, by, cx, cy, cz = box[0, 0], box[1, 0], box[1, 1], box[2, 0], box[2, 1], box[2, 2]
    some = np.empty((4, count))
    for k in range(count):
        i, j = pairs[begin + k, 0], pairs[begin + k, 1]
        some[0, k], some[1, k], some[2, k] = x[i, 0] - x[j, 0], x[i, 1] - x[j, 1], x[i, 2] - x[j, 2]
    for k in range(count):
        dx, dy, dz = nearest_image(some[0, k], some[1, k], some[2, k], ax, bx, by, cx, cy, cz, inverse)
        r2 = dx * dx + dy * dy + dz * dz
        some[3, k], pull = _formula(np.sqrt(r2), r2, p, begin + k)
        some[0, k], some[1, k], some[2, k] = pull * dx, pull * dy, pull * dz
    for k in range(count):
        fx, fy, fz, n = some[0, k], some[1, k], some[2, k], _TWO * (begin + k - first)
        energy += some[3, k]
        parts[n, 0], parts[n, 1], parts[n, 2] = fx, fy, fz
        parts[n + _ONE, 0], parts[n + _ONE, 1], parts[n + _ONE, 2] = -fx, -fy, -fz
    return energy


class BondTerms(BondedKernel):
    """All bonds of a kind."""

    part = staticmethod(_part)
    sample = ((0.0, 0.0, 0.0), (0.5, 0.0, 0.0))

    def what_is_wrong(self, x: np.ndarray, box: np.ndarray | None) -> str:
        """Which bond has no finite energy at the positions x."""
        r = np.linalg.norm(minimum_images(x[self.beads[:, 0]] - x[self.beads[:, 1]], box), axis=1)
        bad = np.flatnonzero(~np.isfinite(r))
        n = int(bad[0]) if len(bad) else int(np.argmin(r))
        text = self.beyond(r) or f"the bond between {bead_names(*self.beads[n])} is {in_length(r[n])} long, where it has no finite energy"
        return f"{text}; the step size may be too large"

    def beyond(self, r: np.ndarray) -> str | None:
        """Which of these lengths a bond of this kind cannot have, in the words in which a scene with it is refused."""
        return None


class HarmonicBondTerms(BondTerms):
    """U = k (r - r0)^2 with p = k, r0."""

    @staticmethod
    def formula(r, r2, p, n):
        stretch = r - p[1, n]
        return p[0, n] * stretch * stretch, -(2.0 * p[0, n] * stretch) / r if r > 0.0 else 0.0


class FENEBondTerms(BondTerms):
    """U = -1/2 k R0^2 ln(1 - (r/R0)^2), + 4 epsilon [(sigma/r)^12 - (sigma/r)^6] + epsilon for r < 2^(1/6) sigma, with p = k, R0, epsilon,
    sigma; infinite where there is none."""

    @staticmethod
    def formula(r, r2, p, n):
        k, longest, epsilon, sigma = p[0, n], p[1, n], p[2, n], p[3, n]
        if not r < longest:
            return np.inf, 0.0
        rest = 1.0 - (r / longest) * (r / longest)
        if rest <= 0.0:  # shorter than R0 by less than rounding
            return np.inf, 0.0
        energy, pull = -0.5 * k * longest * longest * log(rest), -k / rest
        if epsilon > 0.0 and r < WCA_END * sigma:
            if r2 == 0.0:
                return np.inf, 0.0
            s2 = sigma * sigma / r2
            s6 = s2 * s2 * s2
            energy += epsilon * (4.0 * s6 * (s6 - 1.0) + 1.0)
            pull += 24.0 * epsilon * s6 * (2.0 * s6 - 1.0) / r2
        return energy, pull

    def beyond(self, r: np.ndarray) -> str | None:
        return overstretched(self.beads, r, *self.parameters[1:3])


class MorseBondTerms(BondTerms):
    """U = D (1 - exp(-alpha (r - r0)))^2 with p = D, alpha, r0."""

    @staticmethod
    def formula(r, r2, p, n):
        e = exp(-p[1, n] * (r - p[2, n]))
        slope = 2.0 * p[0, n] * p[1, n] * e * (1.0 - e)
        return p[0, n] * (1.0 - e) * (1.0 - e), -slope / r if r > 0.0 else 0.0
