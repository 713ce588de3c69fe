"""Angles between two bonds: compiled energies and forces.

With a = x_i - x_j, b = x_k - x_j and p = a x b, the angle of the beads i, j, k is theta = atan2(|p|, a.b), and the forces on its ends are
-U'(theta) a x p/(a^2 |p|) and U'(theta) b x p/(b^2 |p|).  The formula of a kind takes |p|, a.b, 1/(|a| |b|), the coefficients of all angles
and the number n of one, and gives U and U'.

Angles are taken a chunk at a time: their arms are collected, the arithmetic is one vectorised loop over the chunk, and then the forces are
handed out.
"""

from typing import Any

import numpy as np

from ..runtime import inlined
from .extras import CHUNK, BondedKernel, minimum_image

#: Least |a x b| (nm^2) that a force is divided by: beads in line have no direction to bend in, and OpenMM has the same bound.
LEAST_CROSS = 1e-6
# the formula of a kind
_formula: Any = None


@inlined
def angle(s, c):
    """atan2(s, c) for s >= 0, to the last bit or two, by the rational function of Cephes' atan; both 0 give 0.  It has no branches, so that
    the loop around it is vectorised, which the library's function is not."""
    size = abs(c)
    small, large = (s, size) if s < size else (size, s)
    # atan(t) = pi/4 + atan((t - 1)/(t + 1)) keeps the argument below 0.66
    wide = small > 0.66 * large
    top, bottom = (small - large, small + large) if wide else (small, large)
    t = top / bottom if bottom > 0.0 else 0.0
    z = t * t
    p = -8.750608600031904122785e-1 * z - 1.615753718733365076637e1
    p = ((p * z - 7.500855792314704667340e1) * z - 1.228866684490136173410e2) * z - 6.485021904942025371773e1
    q = (z + 2.485846490142306297962e1) * z + 1.650270098316988542046e2
    q = ((q * z + 4.328810604912902668951e2) * z + 4.853903996359136964868e2) * z + 1.945506571482613964425e2
    t += t * (z * p / q)
    t = t + 0.25 * np.pi if wide else t
    t = 0.5 * np.pi - t if s > size else t
    return np.pi - t if c < 0.0 else t


def _part(x, box, inverse, triples, p, begin, end, parts, first):
    work, energy, count = np.empty((7, CHUNK)), 0.0, end - begin
    for q in range(count):
        i, j, k = triples[begin + q, 0], triples[begin + q, 1], triples[begin + q, 2]
        work[0, q], work[1, q], work[2, q] = minimum_image(x[i, 0] - x[j, 0], x[i, 1] - x[j, 1], x[i, 2] - x[j, 2], box, inverse)
        work[3, q], work[4, q], work[5, q] = minimum_image(x[k, 0] - x[j, 0], x[k, 1] - x[j, 1], x[k, 2] - x[j, 2], box, inverse)
    for q in range(count):
        ax, ay, az, bx, by, bz = work[0, q], work[1, q], work[2, q], work[3, q], work[4, q], work[5, q]
        px, py, pz = ay * bz - az * by, az * bx - ax * bz, ax * by - ay * bx
        aa, bb, ab = ax * ax + ay * ay + az * az, bx * bx + by * by + bz * bz, ax * bx + ay * by + az * bz
        cross = np.sqrt(px * px + py * py + pz * pz)
        # an arm without a length has no direction
        aa, bb = 1.0 / aa if aa > 0.0 else 0.0, 1.0 / bb if bb > 0.0 else 0.0
        u, slope = _formula(cross, ab, np.sqrt(aa * bb), p, begin + q)
        slope /= cross if cross > LEAST_CROSS else LEAST_CROSS
        one, other = -slope * aa, slope * bb
        work[0, q] = one * (ay * pz - az * py)
        work[1, q] = one * (az * px - ax * pz)
        work[2, q] = one * (ax * py - ay * px)
        work[3, q] = other * (by * pz - bz * py)
        work[4, q] = other * (bz * px - bx * pz)
        work[5, q] = other * (bx * py - by * px)
        work[6, q] = u
    for q in range(count):
        n = 3 * (begin - first + q)
        fx, fy, fz, gx, gy, gz = work[0, q], work[1, q], work[2, q], work[3, q], work[4, q], work[5, q]
        energy += work[6, q]
        parts[n, 0], parts[n, 1], parts[n, 2] = fx, fy, fz
        parts[n + 1, 0], parts[n + 1, 1], parts[n + 1, 2] = -(fx + gx), -(fy + gy), -(fz + gz)
        parts[n + 2, 0], parts[n + 2, 1], parts[n + 2, 2] = gx, gy, gz
    return energy


class AngleTerms(BondedKernel):
    """All angles of a kind, the vertex in the middle."""

    part = staticmethod(_part)
    called = "an angle"
    sample = ((0.0, 0.0, 0.0), (1.0, 0.0, 0.0), (1.0, 1.0, 0.0))


class HarmonicAngleTerms(AngleTerms):
    """U = k (theta - theta0)^2 with p = k, theta0."""

    @staticmethod
    def formula(cross, dot, arms, p, n):
        bend = angle(cross, dot) - p[1, n]
        return p[0, n] * bend * bend, 2.0 * p[0, n] * bend


class CosineAngleTerms(AngleTerms):
    """U = k (1 + cos theta) with p = k."""

    @staticmethod
    def formula(cross, dot, arms, p, n):
        return p[0, n] * (1.0 + dot * arms), -p[0, n] * cross * arms
