"""The short-ranged part of smeared charges: every charge with every other one.

All pairs are looked at: where a sum over waves is worth while at all, they are few.  Each charge meets all others, so that every pair is
met twice, and nothing is added to the force on another charge: any number of threads can share that.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from .compiled import helper, inlined
from .extras import inverse_edges, minimum_image


@dataclass(frozen=True, eq=False)
class Quintics:
    """An even function of the distance as polynomials on pieces of the same length, with two continuous derivatives.

    Attributes
    ----------
    coefficients : (K, 6) float64
        Of the powers 0 to 5 of the place in the piece, from 0 to 1.
    end : float
        Where the last piece ends, nm.
    """

    coefficients: np.ndarray
    end: float

    @staticmethod
    def of(values: np.ndarray, slopes: np.ndarray, curvatures: np.ndarray, end: float) -> Quintics:
        """From the function and its derivatives at the ends of all pieces."""
        h = end / (len(values) - 1)
        f0, f1 = values[:-1], values[1:]
        d0, d1 = h * slopes[:-1], h * slopes[1:]
        c0, c1 = 0.5 * h * h * curvatures[:-1], 0.5 * h * h * curvatures[1:]
        # what is missing at the far end of a parabola
        f, d, c = f1 - f0 - d0 - c0, d1 - d0 - 2 * c0, c1 - c0
        rows = f0, d0, c0, 10 * f - 4 * d + c, -15 * f + 7 * d - 2 * c, 6 * f - 3 * d + c
        return Quintics(np.ascontiguousarray(np.stack(rows, axis=1)), float(end))

    @property
    def per_length(self) -> float:
        """Pieces per nm."""
        return len(self.coefficients) / self.end


@inlined
def _quintic(r, per_length, coefficients):
    """The function and its slope at a distance before the end."""
    place = r * per_length
    k = min(int(place), len(coefficients) - 1)
    t = place - k
    c1, c2, c3, c4, c5 = coefficients[k, 1], coefficients[k, 2], coefficients[k, 3], coefficients[k, 4], coefficients[k, 5]
    value = ((((c5 * t + c4) * t + c3) * t + c2) * t + c1) * t + coefficients[k, 0]
    return value, ((((5.0 * c5 * t + 4.0 * c4) * t + 3.0 * c3) * t + 2.0 * c2) * t + c1) * per_length


@inlined
def smooth(r, end, per_length, coefficients):
    """The function and its slope; 1/r from the end on."""
    if r < end:
        return _quintic(r, per_length, coefficients)
    return 1.0 / r, -1.0 / (r * r)


@helper
def _differences(xs, n, room, i, box, inverse, row):
    """Vectors by minimum image from all charges to charge i, and their squares: four rows of ``room`` numbers."""
    x, y, z = xs[i], xs[room + i], xs[2 * room + i]
    # unsigned: numba looks out for indices below zero otherwise, and nothing is vectorised
    at_y, at_z, at_r = np.uint64(room), np.uint64(2 * room), np.uint64(3 * room)
    for j in range(np.uint64(0), np.uint64(n)):
        dx, dy, dz = minimum_image(x - xs[j], y - xs[at_y + j], z - xs[at_z + j], box, inverse)
        row[j], row[at_y + j], row[at_z + j] = dx, dy, dz
        row[at_r + j] = dx * dx + dy * dy + dz * dz


@helper
def charge_row(xs, q, n, room, i, box, cut2, end, per_length, coefficients, row, hits):
    """Energy, virial and force of charge i with all others within the cutoff, without the Coulomb constant; half the energy and virial."""
    _differences(xs, n, room, i, box, inverse_edges(box), row)
    found, mine = np.uint64(0), np.uint64(i)
    at_y, at_z, at_r = np.uint64(room), np.uint64(2 * room), np.uint64(3 * room)
    for j in range(np.uint64(0), np.uint64(n)):
        hits[found] = j
        found += np.uint64((row[at_r + j] < cut2) & (j != mine))
    energy, virial, fx, fy, fz = 0.0, 0.0, 0.0, 0.0, 0.0
    for k in range(np.uint64(0), found):
        j = np.uint64(hits[k])
        r = np.sqrt(row[at_r + j])
        value, slope = smooth(r, end, per_length, coefficients)
        pull = -q[j] * slope / r if r > 0.0 else 0.0
        energy += q[j] * value
        virial += pull * row[at_r + j]
        fx += pull * row[j]
        fy += pull * row[at_y + j]
        fz += pull * row[at_z + j]
    charge = q[i]
    return 0.5 * charge * energy, 0.5 * charge * virial, charge * fx, charge * fy, charge * fz


@inlined
def exception(r, factor, cutoff, alpha, end, per_length, coefficients):
    """What a pair with the factor f has beyond that of all pairs: energy and slope of (f - 1) s(r), and of s(r) - erf(alpha r)/r where
    the others have nothing, from the cutoff on."""
    value, slope = smooth(r, end, per_length, coefficients)
    if r < cutoff:
        return (factor - 1.0) * value, (factor - 1.0) * slope
    image = math.erf(alpha * r) / r
    image_slope = (2.0 / math.sqrt(math.pi) * alpha * math.exp(-alpha * alpha * r * r) - image) / r
    return factor * value - image, factor * slope - image_slope
