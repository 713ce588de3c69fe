"""Dihedrals: compiled energies and forces.

With f = x_i - x_j, g = x_j - x_k, h = x_l - x_k, a = f x g and b = h x g, the dihedral phi of the beads i, j, k, l has
cos phi = a.b/(|a| |b|) and sin phi = |g| h.a/(|a| |b|).  Its gradients are -|g| a/a^2 at i, |g| b/b^2 at l, and those that balance force
and torque at j and k (Blondel and Karplus, J. Comput. Chem. 17, 1132 (1996)).  The formula of a kind takes cos phi, sin phi, the
coefficients p of all dihedrals and the number n of one, and gives U and U'.
"""

from typing import Any

import numpy as np

from .extras import BondedKernel, minimum_image

#: Least square of the sine between two bonds that a force is divided by.
LEAST_SINE2 = 1e-12
# the formula of a kind
_formula: Any = None


def _part(x, box, inverse, quads, p, begin, end, parts, first):
    energy = 0.0
    for n in range(begin, end):
        i, j, k, m = quads[n, 0], quads[n, 1], quads[n, 2], quads[n, 3]
        fx, fy, fz = minimum_image(x[i, 0] - x[j, 0], x[i, 1] - x[j, 1], x[i, 2] - x[j, 2], box, inverse)
        gx, gy, gz = minimum_image(x[j, 0] - x[k, 0], x[j, 1] - x[k, 1], x[j, 2] - x[k, 2], box, inverse)
        hx, hy, hz = minimum_image(x[m, 0] - x[k, 0], x[m, 1] - x[k, 1], x[m, 2] - x[k, 2], box, inverse)
        ax, ay, az = fy * gz - fz * gy, fz * gx - fx * gz, fx * gy - fy * gx
        bx, by, bz = hy * gz - hz * gy, hz * gx - hx * gz, hx * gy - hy * gx
        aa, bb, gg = ax * ax + ay * ay + az * az, bx * bx + by * by + bz * bz, gx * gx + gy * gy + gz * gz
        length = np.sqrt(gg)
        cosine, sine = ax * bx + ay * by + az * bz, length * (hx * ax + hy * ay + hz * az)
        size = np.sqrt(cosine * cosine + sine * sine)
        # beads in line have no plane: as trans as they are cis, and no direction to turn in
        cosine, sine = (cosine / size, sine / size) if size > 0.0 else (1.0, 0.0)
        u, slope = _formula(cosine, sine, p, n)
        energy += u
        aa = max(aa, LEAST_SINE2 * gg * (fx * fx + fy * fy + fz * fz))
        bb = max(bb, LEAST_SINE2 * gg * (hx * hx + hy * hy + hz * hz))
        over_a, over_b, along = slope / aa if aa > 0.0 else 0.0, slope / bb if bb > 0.0 else 0.0, 1.0 / length if length > 0.0 else 0.0
        fg, hg = (fx * gx + fy * gy + fz * gz) * along * over_a, (hx * gx + hy * gy + hz * gz) * along * over_b
        over_a *= length
        over_b *= length
        # forces on i and l, and what turns with them at j and k
        ix, iy, iz = over_a * ax, over_a * ay, over_a * az
        mx, my, mz = -over_b * bx, -over_b * by, -over_b * bz
        tx, ty, tz = hg * bx - fg * ax, hg * by - fg * ay, hg * bz - fg * az
        q = 4 * (n - first)
        parts[q, 0], parts[q, 1], parts[q, 2] = ix, iy, iz
        parts[q + 1, 0], parts[q + 1, 1], parts[q + 1, 2] = tx - ix, ty - iy, tz - iz
        parts[q + 2, 0], parts[q + 2, 1], parts[q + 2, 2] = -tx - mx, -ty - my, -tz - mz
        parts[q + 3, 0], parts[q + 3, 1], parts[q + 3, 2] = mx, my, mz
    return energy


class DihedralTerms(BondedKernel):
    """All dihedrals of a kind."""

    part = staticmethod(_part)
    called = "a dihedral"
    sample = ((0.0, 1.0, 0.0), (0.0, 0.0, 0.0), (1.0, 0.0, 0.0), (1.0, 0.5, 0.5))


class HarmonicDihedralTerms(DihedralTerms):
    """U = k [1 + d cos(n phi)] with p = k, d, n."""

    @staticmethod
    def formula(cosine, sine, p, n):
        c, s = 1.0, 0.0
        for _ in range(int(p[2, n])):
            c, s = c * cosine - s * sine, s * cosine + c * sine
        return p[0, n] * (1.0 + p[1, n] * c), -p[0, n] * p[1, n] * p[2, n] * s


class OPLSDihedralTerms(DihedralTerms):
    """U = 1/2 {K1 [1 + cos phi] + K2 [1 - cos 2 phi] + K3 [1 + cos 3 phi] + K4 [1 - cos 4 phi]} with p = K1, K2, K3, K4."""

    @staticmethod
    def formula(cosine, sine, p, n):
        c2, s2 = cosine * cosine - sine * sine, 2.0 * sine * cosine
        c3, s3 = c2 * cosine - s2 * sine, s2 * cosine + c2 * sine
        c4, s4 = c2 * c2 - s2 * s2, 2.0 * s2 * c2
        energy = p[0, n] * (1.0 + cosine) + p[1, n] * (1.0 - c2) + p[2, n] * (1.0 + c3) + p[3, n] * (1.0 - c4)
        return 0.5 * energy, 0.5 * (2.0 * p[1, n] * s2 - p[0, n] * sine - 3.0 * p[2, n] * s3 + 4.0 * p[3, n] * s4)


class MultiHarmonicDihedralTerms(DihedralTerms):
    """U = A1 + A2 cos phi + A3 cos^2 phi + A4 cos^3 phi + A5 cos^4 phi with p = A1, A2, A3, A4, A5."""

    @staticmethod
    def formula(cosine, sine, p, n):
        c = cosine
        energy = p[0, n] + c * (p[1, n] + c * (p[2, n] + c * (p[3, n] + c * p[4, n])))
        return energy, -sine * (p[1, n] + c * (2.0 * p[2, n] + c * (3.0 * p[3, n] + c * 4.0 * p[4, n])))
