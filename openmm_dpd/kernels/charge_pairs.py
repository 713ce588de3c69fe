"""The short-ranged part of smeared charges: every charge with every other one.

All pairs are looked at: where a sum over waves is worth while at all, they are few.  The first charges of pairs are dealt out to
:data:`SHARES`, whose forces are added up in the end, so that any number of threads gives the same bits.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from ..runtime import helper, inlined
from .elementary import erfc, exp
from .extras import inverse_edges
from .vectors import LANES, floor, load_lanes, splat, store_lanes

#: See above.
SHARES = 8
#: Square of a distance, nm^2, below which there is no direction.
TINY = 1e-200


@dataclass(frozen=True, eq=False)
class Quintics:
    """An even function of the distance as polynomials on pieces of the same length, with two continuous derivatives."""

    coefficients: np.ndarray  #: (K, 6) of the powers 0 to 5 of the place in the piece, from 0 to 1
    end: float  #: Where the last piece ends, nm

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
    k = min(np.uint64(place), np.uint64(len(coefficients) - 1))  # unsigned: numba looks out for indices below zero otherwise
    t = place - np.float64(np.int64(k))
    c1, c2, c3, c4, c5 = coefficients[k, 1], coefficients[k, 2], coefficients[k, 3], coefficients[k, 4], coefficients[k, 5]
    value = ((((c5 * t + c4) * t + c3) * t + c2) * t + c1) * t + coefficients[k, 0]
    return value, ((((5.0 * c5 * t + 4.0 * c4) * t + 3.0 * c3) * t + 2.0 * c2) * t + c1) * per_length


@inlined
def smooth(r, end, per_length, coefficients, bare, soft2):
    """The function and its slope, with bare/r for point charges; 1/r from the end on.  From soft2 = 0 on, bare/sqrt(r^2 + soft2), times the
    function before the end."""
    if soft2 >= 0.0:
        root = 1.0 / np.sqrt(r * r + soft2)
        value, slope = bare * root, -bare * r * root * root * root
        if r < end:
            part, its_slope = _quintic(r, per_length, coefficients)
            return part * value, its_slope * value + part * slope
        return value, slope
    if r < end:
        value, slope = _quintic(r, per_length, coefficients)
        if bare != 0.0:
            value, slope = value + bare / r, slope - bare / (r * r)
        return value, slope
    return 1.0 / r, -1.0 / (r * r)


@inlined
def _nearest(dx, dy, dz, box, inverse):
    """Eight vectors by minimum image, see :func:`.extras.minimum_image`."""
    half = splat(0.5)
    turns = floor(dz * splat(inverse[2]) + half)
    dx, dy, dz = dx - turns * splat(box[2, 0]), dy - turns * splat(box[2, 1]), dz - turns * splat(box[2, 2])
    turns = floor(dy * splat(inverse[1]) + half)
    dx, dy = dx - turns * splat(box[1, 0]), dy - turns * splat(box[1, 1])
    return dx - floor(dx * splat(inverse[0]) + half) * splat(box[0, 0]), dy, dz


@inlined
def _differences(xs, n, room, i, box, inverse, row):
    """Vectors by minimum image from the charges after charge i to it, and their squares: four rows of ``room`` numbers."""
    x, y, z = splat(xs[i]), splat(xs[room + i]), splat(xs[2 * room + i])
    for at in range((i + 1) // LANES * LANES, n, LANES):
        dx, dy, dz = x - load_lanes(xs, at), y - load_lanes(xs, room + at), z - load_lanes(xs, 2 * room + at)
        dx, dy, dz = _nearest(dx, dy, dz, box, inverse)
        store_lanes(row, at, dx)
        store_lanes(row, room + at, dy)
        store_lanes(row, 2 * room + at, dz)
        store_lanes(row, 3 * room + at, dx * dx + dy * dy + dz * dz)


@helper
def charge_row(xs, q, n, room, i, box, cut2, end, per_length, coefficients, bare, soft2, row, hits, f, to, tensor):
    """Energy of charge i with those after it within the cutoff, and if wanted six sums of r F; without the Coulomb constant.  Adds the
    forces to f[to:], x of all ``room`` charges first."""
    _differences(xs, n, room, i, box, inverse_edges(box), row)
    at_y, at_z, at_r = np.uint64(room), np.uint64(2 * room), np.uint64(3 * room)
    found = np.uint64(0)
    for other in range(np.uint64(i + 1), np.uint64(n)):
        hits[found] = other
        found += np.uint64(row[at_r + other] < cut2)
    to_x, to_y, to_z = np.uint64(to), np.uint64(to + room), np.uint64(to + 2 * room)
    energy, fx, fy, fz = 0.0, 0.0, 0.0, 0.0
    xx, yy, zz, xy, xz, yz = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
    charge = q[i]
    for k in range(np.uint64(0), found):
        j = np.uint64(hits[k])
        r2 = row[at_r + j]
        # at the same point the slope is 0
        inverse = 1.0 / np.sqrt(max(r2, TINY))
        value, slope = smooth(r2 * inverse, end, per_length, coefficients, bare, soft2)
        qq = charge * q[j]
        pull = -qq * slope * inverse
        energy += qq * value
        px, py, pz = pull * row[j], pull * row[at_y + j], pull * row[at_z + j]
        if tensor:
            xx += px * row[j]
            yy += py * row[at_y + j]
            zz += pz * row[at_z + j]
            xy += px * row[at_y + j]
            xz += px * row[at_z + j]
            yz += py * row[at_z + j]
        fx += px
        fy += py
        fz += pz
        f[to_x + j] -= px
        f[to_y + j] -= py
        f[to_z + j] -= pz
    me = np.uint64(i)
    f[to_x + me] += fx
    f[to_y + me] += fy
    f[to_z + me] += fz
    return energy, xx, yy, zz, xy, xz, yz


@inlined
def exception(r, factor, cutoff, alpha, end, per_length, coefficients, bare, soft2):
    """What a pair with the factor f has beyond that of all pairs: energy and slope of (f - 1) s(r), and of f s(r) - erf(alpha r)/r where
    the others have nothing, from the cutoff on; of softened charges with s(r) in the place of 1/r."""
    value, slope = smooth(r, end, per_length, coefficients, bare, soft2)
    if r < cutoff:
        return (factor - 1.0) * value, (factor - 1.0) * slope
    if alpha == 0.0:
        return 0.0, 0.0
    base, base_slope = (value, slope) if soft2 >= 0.0 else (1.0 / r, -1.0 / (r * r))
    image = 1.0 - erfc(alpha * r)
    image_slope = 2.0 / math.sqrt(math.pi) * alpha * exp(-alpha * alpha * r * r) * base + image * base_slope
    return factor * value - image * base, factor * slope - image_slope
