"""Bonds, angles and dihedrals: compiled energies and forces.

The formula of a kind takes the coefficients p of all its terms and the number n of one.
"""

from typing import Any

import numpy as np

from ..base.errors import NONLINEAR_END, QUARTIC_END, bead_names, in_length, out_of_range, overstretched
from ..base.geometry import minimum_images
from ..runtime import inlined
from .elementary import exp, log, sine
from .extras import CHUNK, BondedKernel, minimum_image, nearest_image

#: r/sigma where the repulsion of a FENE bond ends, the minimum of Lennard-Jones.
WCA_END = 2.0 ** (1.0 / 6.0)
_ONE, _TWO = np.uint64(1), np.uint64(2)
# the formula of a kind
_formula: Any = None


def _bond_part(x, box, inverse, pairs, p, begin, end, parts, first):
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
    """All bonds of a kind.

    With r the length of a bond and d = x_i - x_j, the force on its first bead is -U'(r) d/r; at r = 0 it has no direction and is 0, as with
    OpenMM.  The formula of a kind takes r, r^2, p and n, and gives U and -U'/r.
    """

    part = staticmethod(_bond_part)
    called = "a bond"
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


class NonlinearBondTerms(BondTerms):
    """U = epsilon (r - r0)^2/(lamda^2 - (r - r0)^2) with p = epsilon, r0, lamda; infinite where there is none."""

    @staticmethod
    def formula(r, r2, p, n):
        stretch, rest = r - p[1, n], p[2, n] * p[2, n] - (r - p[1, n]) * (r - p[1, n])
        if not rest > 0.0:
            return np.inf, 0.0
        slope = 2.0 * p[0, n] * p[2, n] * p[2, n] * stretch / (rest * rest)
        return p[0, n] * stretch * stretch / rest, -slope / r if r > 0.0 else 0.0

    def beyond(self, r: np.ndarray) -> str | None:
        _, r0, lamda = self.parameters
        return out_of_range("nonlinear", self.beads, r, r0 - lamda, r0 + lamda, NONLINEAR_END)


class QuarticBondTerms(BondTerms):
    """U = k s^2 (s - B1)(s - B2) + U0, s = r - Rc, + 4 [(1/r)^12 - (1/r)^6] + 1 for r < 2^(1/6), with p = k, B1, B2, Rc, U0; infinite from
    Rc on."""

    @staticmethod
    def formula(r, r2, p, n):
        s, total, product = r - p[3, n], p[1, n] + p[2, n], p[1, n] * p[2, n]
        if not s < 0.0 or r2 == 0.0:
            return np.inf, 0.0
        energy = p[0, n] * s * s * (s * s - total * s + product) + p[4, n]
        pull = -p[0, n] * s * (4.0 * s * s - 3.0 * total * s + 2.0 * product) / r
        if r < WCA_END:
            s6 = 1.0 / (r2 * r2 * r2)
            energy += 4.0 * s6 * (s6 - 1.0) + 1.0
            pull += 24.0 * s6 * (2.0 * s6 - 1.0) / r2
        return energy, pull

    def beyond(self, r: np.ndarray) -> str | None:
        return out_of_range("quartic", self.beads, r, -self.parameters[3], self.parameters[3], QUARTIC_END)


#: Least |a x b| (nm^2) that a force is divided by: beads in line have no direction to bend in, and OpenMM has the same bound.
LEAST_CROSS = 1e-6


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


def _angle_part(x, box, inverse, triples, p, begin, end, parts, first):
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
    """All angles of a kind, the vertex in the middle.

    With a = x_i - x_j, b = x_k - x_j and p = a x b, the angle of the beads i, j, k is theta = atan2(|p|, a.b), and the forces on its ends
    are -U'(theta) a x p/(a^2 |p|) and U'(theta) b x p/(b^2 |p|).  The formula of a kind takes |p|, a.b, 1/(|a| |b|), the coefficients p and
    n, and gives U and U'.  Angles are taken a chunk at a time: their arms are collected, the arithmetic is one vectorised loop over the
    chunk, and then the forces are handed out.
    """

    part = staticmethod(_angle_part)
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


class CosineDeltaAngleTerms(AngleTerms):
    """U = k [1 - cos(theta - theta0)] with p = k, theta0."""

    @staticmethod
    def formula(cross, dot, arms, p, n):
        s, c = sine(p[1, n] * (0.5 / np.pi)), sine(p[1, n] * (0.5 / np.pi) + 0.25)
        return p[0, n] * (1.0 - (dot * c + cross * s) * arms), p[0, n] * (cross * c - dot * s) * arms


class CosineSquaredAngleTerms(AngleTerms):
    """U = k (cos theta - cos theta0)^2 with p = k, theta0."""

    @staticmethod
    def formula(cross, dot, arms, p, n):
        off = dot * arms - sine(p[1, n] * (0.5 / np.pi) + 0.25)
        return p[0, n] * off * off, -2.0 * p[0, n] * off * cross * arms


class PeriodicAngleTerms(AngleTerms):
    """U = 2 C/n^2 [1 - B (-1)^n cos(n theta)] with p = C, B, n."""

    @staticmethod
    def formula(cross, dot, arms, p, n):
        wave, slope, c, s = 1.0, 0.0, -dot * arms, -cross * arms
        for _ in range(int(p[2, n])):
            wave, slope = wave * c - slope * s, slope * c + wave * s
        size = 2.0 * p[0, n] / (p[2, n] * p[2, n])
        return size * (1.0 - p[1, n] * wave), size * p[1, n] * p[2, n] * slope


#: Least square of the sine between two bonds that a force is divided by.
LEAST_SINE2 = 1e-12


def _dihedral_part(x, box, inverse, quads, p, begin, end, parts, first):
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
    """All dihedrals of a kind.

    With f = x_i - x_j, g = x_j - x_k, h = x_l - x_k, a = f x g and b = h x g, the dihedral phi of the beads i, j, k, l has
    cos phi = a.b/(|a| |b|) and sin phi = |g| h.a/(|a| |b|).  Its gradients are -|g| a/a^2 at i, |g| b/b^2 at l, and those that balance
    force and torque at j and k (Blondel and Karplus, J. Comput. Chem. 17, 1132 (1996)).  The formula of a kind takes cos phi, sin phi, p
    and n, and gives U and U'.
    """

    part = staticmethod(_dihedral_part)
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
