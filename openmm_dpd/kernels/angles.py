"""Angles between two bonds: compiled energies and forces.

With a = x_i - x_j, b = x_k - x_j and p = a x b, the angle of the beads i, j, k is theta = atan2(|p|, a.b), and the forces on its ends are
-U'(theta) a x p/(a^2 |p|) and U'(theta) b x p/(b^2 |p|).  The kinds::

    HARMONIC    k, theta0    U = k (theta - theta0)^2
    COSINE      k            U = k (1 + cos theta)

Threads share the work as they do for bonds (:class:`.extras.TermEvaluator`).  Angles are taken a chunk at a time: their arms are collected,
the arithmetic is one vectorised loop over the chunk, and then the forces are handed out.
"""

from dataclasses import dataclass
from typing import ClassVar

import numpy as np
from numba import njit

from ..wording import bead_names
from .compiled import compiled
from .extras import CHUNK, Extra, TermEvaluator, by_rows, inverse_edges, minimum_image

HARMONIC, COSINE = range(2)

#: Least |a x b| (nm^2) that a force is divided by: beads in line have no direction to bend in, and OpenMM has the same bound.
LEAST_CROSS = 1e-6


@njit(inline="always")
def _angle(s, c):
    """atan2(s, c) for s >= 0, to the last bit or two, by the rational function of Cephes' atan; both 0 give 0.

    It has no branches, so that the loop around it is vectorised, which the library's function is not.
    """
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


@njit(inline="always")
def _arms(x, box, inverse, triples, p, first, count, work):
    """Write the arms a and b and the coefficients of the angles from the first on to columns of ``work``."""
    for q in range(count):
        n = first + q
        i, j, k = triples[n, 0], triples[n, 1], triples[n, 2]
        work[0, q], work[1, q], work[2, q] = minimum_image(x[i, 0] - x[j, 0], x[i, 1] - x[j, 1], x[i, 2] - x[j, 2], box, inverse)
        work[3, q], work[4, q], work[5, q] = minimum_image(x[k, 0] - x[j, 0], x[k, 1] - x[j, 1], x[k, 2] - x[j, 2], box, inverse)
        work[6, q], work[7, q] = p[n, 0], p[n, 1]


@njit(error_model="numpy")  # a division that could raise an error is not vectorised
def _forces_on_ends(kinds, first, count, work):
    """Turn the arms and coefficients in ``work`` into the forces on both ends and the energies of the angles."""
    for q in range(count):
        ax, ay, az, bx, by, bz = work[0, q], work[1, q], work[2, q], work[3, q], work[4, q], work[5, q]
        px, py, pz = ay * bz - az * by, az * bx - ax * bz, ax * by - ay * bx
        aa, bb, ab = ax * ax + ay * ay + az * az, bx * bx + by * by + bz * bz, ax * bx + ay * by + az * bz
        cross = np.sqrt(px * px + py * py + pz * pz)
        # an arm without a length has no direction
        aa, bb = 1.0 / aa if aa > 0.0 else 0.0, 1.0 / bb if bb > 0.0 else 0.0
        arms = np.sqrt(aa * bb)
        cosine = kinds[first + q] == COSINE
        stiffness, bend = work[6, q], _angle(cross, ab) - work[7, q]
        slope = -stiffness * cross * arms if cosine else 2.0 * stiffness * bend
        slope /= cross if cross > LEAST_CROSS else LEAST_CROSS
        one, other = -slope * aa, slope * bb
        work[0, q] = one * (ay * pz - az * py)
        work[1, q] = one * (az * px - ax * pz)
        work[2, q] = one * (ax * py - ay * px)
        work[3, q] = other * (by * pz - bz * py)
        work[4, q] = other * (bz * px - bx * pz)
        work[5, q] = other * (bx * py - by * px)
        work[6, q] = stiffness * (1.0 + ab * arms) if cosine else stiffness * bend * bend


@compiled
def _angles(x, box, triples, kinds, p, rows, start, slots, parts, energies, force):
    """Add the forces of all angles, one after the other; returns the energy."""
    inverse, total, work = inverse_edges(box), 0.0, np.empty((8, CHUNK))
    for chunk in range(len(energies)):
        energy, first = 0.0, chunk * CHUNK
        count = min(CHUNK, len(triples) - first)
        _arms(x, box, inverse, triples, p, first, count, work)
        _forces_on_ends(kinds, first, count, work)
        for q in range(count):
            i, j, k = triples[first + q, 0], triples[first + q, 1], triples[first + q, 2]
            fx, fy, fz, gx, gy, gz = work[0, q], work[1, q], work[2, q], work[3, q], work[4, q], work[5, q]
            energy += work[6, q]
            force[i, 0] += fx
            force[i, 1] += fy
            force[i, 2] += fz
            force[j, 0] -= fx + gx
            force[j, 1] -= fy + gy
            force[j, 2] -= fz + gz
            force[k, 0] += gx
            force[k, 1] += gy
            force[k, 2] += gz
        total += energy
    return total


@njit(error_model="numpy")
def _part(x, box, inverse, triples, kinds, p, begin, end, parts):
    work, energy, count = np.empty((8, CHUNK)), 0.0, end - begin
    _arms(x, box, inverse, triples, p, begin, count, work)
    _forces_on_ends(kinds, begin, count, work)
    for q in range(count):
        n = 3 * (begin + q)
        fx, fy, fz, gx, gy, gz = work[0, q], work[1, q], work[2, q], work[3, q], work[4, q], work[5, q]
        energy += work[6, q]
        parts[n, 0], parts[n, 1], parts[n, 2] = fx, fy, fz
        parts[n + 1, 0], parts[n + 1, 1], parts[n + 1, 2] = -(fx + gx), -(fy + gy), -(fz + gz)
        parts[n + 2, 0], parts[n + 2, 1], parts[n + 2, 2] = gx, gy, gz
    return energy


_angles_parallel = by_rows("angles_by_rows", _part)


@dataclass(frozen=True, eq=False)
class AngleTerms:
    """All angles.

    Attributes
    ----------
    triples : (K, 3) uint32
        Beads of each angle, the vertex in the middle.
    kinds : (K,) uint8
        ``HARMONIC`` or ``COSINE``.
    parameters : (K, 2) float64
        Coefficients of each angle, in the order in which they are named above.
    """

    term: ClassVar[str] = "bond"

    triples: np.ndarray
    kinds: np.ndarray
    parameters: np.ndarray

    def evaluator(self) -> TermEvaluator:
        """What computes it."""
        return TermEvaluator(self, self.triples, (_angles, _angles_parallel), _what_is_wrong)

    def few(self) -> tuple[Extra, np.ndarray, np.ndarray]:
        """One angle of three beads."""
        one = AngleTerms(np.array([[0, 1, 2]], np.uint32), np.array([HARMONIC], np.uint8), np.ones((1, 2)))
        return one, np.array([[0.0, 0, 0], [1.0, 0, 0], [1.0, 1.0, 0]]), np.diag([4.0] * 3)


def _what_is_wrong(terms: AngleTerms, x: np.ndarray, box: np.ndarray | None) -> str:
    broken = terms.triples[~np.isfinite(x[terms.triples]).all(axis=(1, 2))]
    which = f"of the {bead_names(*broken[0])} " if len(broken) else ""
    return f"an angle {which}has no finite energy"
