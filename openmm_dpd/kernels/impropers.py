"""Impropers: compiled energies and forces, as those of :mod:`.bonded`."""

from typing import Any

import numpy as np

from .bonded import LEAST_SINE2, DihedralTerms, HarmonicDihedralTerms, angle
from .elementary import sine
from .extras import minimum_image

#: Least |cos omega| that a force of an umbrella is divided by.
LEAST_COSINE = 1e-6
# the formula of a kind
_formula: Any = None


class ImproperTerms(DihedralTerms):
    """All impropers of a kind whose angle is that of a dihedral."""

    called = "an improper"


class HarmonicImproperTerms(ImproperTerms):
    """U = k (|phi| - chi0)^2 with p = k, chi0."""

    @staticmethod
    def formula(cosine, sine, p, n):
        off = angle(abs(sine), cosine) - p[1, n]
        return p[0, n] * off * off, 2.0 * p[0, n] * off * np.copysign(1.0, sine)


class CosineImproperTerms(ImproperTerms):
    """U = k [1 + d cos(n phi)] with p = k, d, n."""

    formula = staticmethod(HarmonicDihedralTerms.formula)


def _umbrella_part(x, box, inverse, quads, p, begin, end, parts, first):
    energy = 0.0
    for m in range(begin, end):
        i, j, k, o = quads[m, 0], quads[m, 1], quads[m, 2], quads[m, 3]
        ax, ay, az = minimum_image(x[j, 0] - x[i, 0], x[j, 1] - x[i, 1], x[j, 2] - x[i, 2], box, inverse)
        bx, by, bz = minimum_image(x[k, 0] - x[i, 0], x[k, 1] - x[i, 1], x[k, 2] - x[i, 2], box, inverse)
        hx, hy, hz = minimum_image(x[o, 0] - x[i, 0], x[o, 1] - x[i, 1], x[o, 2] - x[i, 2], box, inverse)
        nx, ny, nz = ay * bz - az * by, az * bx - ax * bz, ax * by - ay * bx
        aa, bb = np.sqrt(ax * ax + ay * ay + az * az), np.sqrt(bx * bx + by * by + bz * bz)
        # beads in line have no plane, and no direction to move in
        size = max(np.sqrt(nx * nx + ny * ny + nz * nz), np.sqrt(LEAST_SINE2) * aa * bb)
        over_n, over_h = 1.0 / size if size > 0.0 else 0.0, np.sqrt(hx * hx + hy * hy + hz * hz)
        over_h = 1.0 / over_h if over_h > 0.0 else 0.0
        nx, ny, nz, ux, uy, uz = nx * over_n, ny * over_n, nz * over_n, hx * over_h, hy * over_h, hz * over_h
        sx, sy, sz = ny * uz - nz * uy, nz * ux - nx * uz, nx * uy - ny * ux
        sine, cosine = nx * ux + ny * uy + nz * uz, np.sqrt(sx * sx + sy * sy + sz * sz)
        side = (ux * ax + uy * ay + uz * az) * bb + (ux * bx + uy * by + uz * bz) * aa
        cosine = -cosine if side > 0.0 else cosine
        u, slope = _formula(cosine, p, m)
        energy += u
        # times the gradients of the sine: those of the normal, and then of what it is made of
        slope *= sine / (cosine if abs(cosine) > LEAST_COSINE else np.copysign(LEAST_COSINE, cosine))
        gx, gy, gz = slope * over_n * (ux - sine * nx), slope * over_n * (uy - sine * ny), slope * over_n * (uz - sine * nz)
        jx, jy, jz = by * gz - bz * gy, bz * gx - bx * gz, bx * gy - by * gx
        kx, ky, kz = gy * az - gz * ay, gz * ax - gx * az, gx * ay - gy * ax
        lx, ly, lz = slope * over_h * (nx - sine * ux), slope * over_h * (ny - sine * uy), slope * over_h * (nz - sine * uz)
        q = 4 * (m - first)
        parts[q, 0], parts[q, 1], parts[q, 2] = -(jx + kx + lx), -(jy + ky + ly), -(jz + kz + lz)
        parts[q + 1, 0], parts[q + 1, 1], parts[q + 1, 2] = jx, jy, jz
        parts[q + 2, 0], parts[q + 2, 1], parts[q + 2, 2] = kx, ky, kz
        parts[q + 3, 0], parts[q + 3, 1], parts[q + 3, 2] = lx, ly, lz
    return energy


class UmbrellaImproperTerms(ImproperTerms):
    """U = k/(2 sin^2 omega0) (cos omega - cos omega0)^2, k (1 - cos omega) for omega0 = 0, with p = k, omega0.

    With a, b, h from the first bead to the others, n = a x b and s = n.h/(|n| |h|), cos omega is the root of 1 - s^2, with a minus sign if
    h.(a/|a| + b/|b|) > 0.  The formula takes cos omega, p and the number of the term, and gives U and dU/dcos omega; the forces are that
    times s/cos omega and the gradients of s.
    """

    part = staticmethod(_umbrella_part)
    around = True

    @staticmethod
    def formula(cosine, p, n):
        if p[1, n] == 0.0:
            return p[0, n] * (1.0 - cosine), -p[0, n]
        s, off = sine(p[1, n] * (0.5 / np.pi)), cosine - sine(p[1, n] * (0.5 / np.pi) + 0.25)
        slope = p[0, n] / (s * s) * off
        return 0.5 * slope * off, slope
