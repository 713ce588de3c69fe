r"""The lattice part of an Ewald sum, wave by wave.

.. math:: U = \frac{4\pi C}{V} \sum_{k} \frac{e^{-k^2/4\alpha^2}}{k^2} |S(k)|^2, \qquad S(k) = \sum_j q_j e^{i k \cdot x_j}

over half of all waves with 0 < |k| <= some limit.  A wave has the whole numbers (n1, n2, n3), k = 2 pi (n1 b1 + n2 b2 + n3 b3) with the
reciprocal vectors b of the present box.  Eight waves with successive n2 are one *block*; n1 goes from 0 to the block's depth, and the waves
n1 and -n1 share their work: with c + is of the first axis and a + ib of the other two,

    S(n1) = (P - Q) + i(R + U),  S(-n1) = (P + Q) + i(R - U),  P = sum q c a,  Q = sum q s b,  R = sum q c b,  U = sum q s a.

The force on a charge is the same backwards: the waves of n1 are summed up first, for each column (n2, n3) two complex numbers.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from ..base.geometry import AXES_OF_TENSOR
from ..runtime import compiled, helper, inlined
from .elementary import exp
from .vectors import LANES, floor, load_lanes, splat, store_lanes, total

#: Charges are dealt with in such strips: two vectors at once.
STRIP = 2 * LANES
#: Numbers for each row of waves (a block at one n1): weights, and energies, of both signs; what forces are made of.
WEIGHTS, PULLS = 2 * LANES, 8 * LANES


#: One along the diagonal, as a tensor with six components.
ISOTROPIC = np.array([1.0, 1.0, 1.0, 0.0, 0.0, 0.0])


class Waves(NamedTuple):
    """All waves of a box, B blocks with R rows."""

    most: np.ndarray  #: (3,) largest n of each axis
    recip: np.ndarray  #: (3, 3) rows are the reciprocal vectors, without the factor 2 pi
    blocks: np.ndarray  #: (B, 4) first n2, n3, how many n1 (an even number), first row
    depth: np.ndarray  #: (8 B,) how many n1 each column of a block has; 0 for one that is not needed
    #: (16 R,) factor of |S|^2 in the energy for n1 and for -n1; 0 beyond the limit, and where a wave would count twice
    weights: np.ndarray

    @staticmethod
    def none() -> Waves:
        """No waves at all."""
        return Waves(np.zeros(3, np.int64), np.zeros((3, 3)), np.zeros((0, 4), np.int64), np.zeros(0, np.int64), np.zeros(0))

    @staticmethod
    def of(box: np.ndarray, k_max: float, alpha: float, constant: float) -> Waves:
        """All waves of a box up to a limit (1/nm) with the splitting parameter alpha (1/nm) and the Coulomb constant (kJ/mol nm)."""
        # the longest n of a wave within the limit: n_a = k.a/(2 pi)
        most = np.floor(k_max / (2 * math.pi) * np.linalg.norm(box, axis=1)).astype(np.int64)
        a, b, c = box
        recip = np.stack([np.cross(b, c), np.cross(c, a), np.cross(a, b)]) / np.prod(np.diag(box))
        found, depth, rows = [], [], 0
        for n3, columns in enumerate(_depths(recip, k_max, most)):
            there = np.flatnonzero(columns)
            for first in range(there[0], there[-1] + 1, LANES) if len(there) else ():
                its = columns[first : first + LANES].tolist()
                deep = max(its) + max(its) % 2
                found.append((first - most[1], n3, deep, rows))
                depth += its
                rows += deep
        blocks, weights = np.array(found, np.int64), np.zeros(WEIGHTS * rows)
        _weigh(recip, k_max, alpha, constant * float(np.prod(np.diag(recip))), blocks, weights)
        return Waves(most, recip, blocks, np.array(depth, np.int64), weights)

    @property
    def tables(self) -> tuple[int, int, int]:
        """How many n the tables of phases need along each axis: an even number along the first one, a block along the second one."""
        n1, n2, n3 = self.most.tolist()
        return n1 + 2, max(n2 + LANES, LANES), n3 + 1

    def strains(self, alpha: float) -> np.ndarray:
        r"""(16 R, 6) sums of r F of each wave over its energy; waves stand as their weights do.

        .. math:: 1 - 2\,\mathbf k\mathbf k \left(\frac{1}{k^2} + \frac{1}{4\alpha^2}\right)
        """
        first, n3, deep, row = (np.repeat(values, self.blocks[:, 2]) for values in self.blocks.T)
        n = np.zeros((len(row), 2, LANES, 3))
        n[..., 0] = (np.arange(len(row)) - row)[:, None, None] * np.array([1.0, -1.0])[:, None]
        n[..., 1] = first[:, None, None] + np.arange(LANES)
        n[..., 2] = n3[:, None, None]
        k = 2 * np.pi * np.sum(n.reshape(-1, 3, 1) * self.recip, axis=1)  # a product of matrices has other bits on other machines
        square = np.maximum(np.sum(k * k, axis=1), 1e-300)  # there is no energy at k = 0
        one, other = zip(*AXES_OF_TENSOR, strict=True)
        return ISOTROPIC - 2 * (1 / square + 0.25 / alpha**2)[:, None] * k[:, one] * k[:, other]


def _depths(recip: np.ndarray, k_max: float, most: np.ndarray) -> np.ndarray:
    """How many n1 from 0 on have a wave within the limit, for either sign of n1, for each n3 from 0 and n2 from -most; 0 if none has, if
    those of -n2, -n3 are the same, and for a block beyond the last n2."""
    limit, n2, n3 = k_max / (2.0 * np.pi), np.arange(-most[1], most[1] + LANES + 1), np.arange(most[2] + 1)[:, None]
    vx, vy, vz = (n2 * recip[1, axis] + n3 * recip[2, axis] for axis in range(3))
    square = recip[0, 0] ** 2 + recip[0, 1] ** 2 + recip[0, 2] ** 2
    along = recip[0, 0] * vx + recip[0, 1] * vy + recip[0, 2] * vz
    rest = along * along - square * (vx * vx + vy * vy + vz * vz - limit * limit)
    found = np.floor((np.abs(along) + np.sqrt(np.maximum(rest, 0.0))) / square).astype(np.int64) + 1
    found[(rest < 0.0) | (n2 > most[1]) | ((n3 == 0) & (n2 < 0))] = 0
    return found


@compiled
def _weigh(recip, k_max, alpha, scale, blocks, weights):
    """Write the weights of all waves; ``scale`` is C/V."""
    for block in range(len(blocks)):
        n3 = blocks[block, 1]
        for n1 in range(blocks[block, 2]):
            at = WEIGHTS * (blocks[block, 3] + n1)
            for lane in range(LANES):
                n2 = blocks[block, 0] + lane
                for side in range(2):
                    m = n1 if side == 0 else -n1
                    # (0, 0, 0), and (-n1, 0, 0), (-0, n2, n3) once more
                    if (side == 1 and (n1 == 0 or (n2 == 0 and n3 == 0))) or (n1 == 0 and n2 == 0 and n3 == 0):
                        continue
                    k2 = 0.0
                    for axis in range(3):
                        k = 2.0 * np.pi * (m * recip[0, axis] + n2 * recip[1, axis] + n3 * recip[2, axis])
                        k2 += k * k
                    if k2 > k_max * k_max:
                        continue
                    weights[at + LANES * side + lane] = 4.0 * np.pi * scale * exp(-k2 / (4.0 * alpha * alpha)) / k2


#: Taylor coefficients of cos and sin in the square of the angle; exact to rounding up to pi/4.
_COS = tuple((-1.0) ** n / math.factorial(2 * n) for n in range(9))
_SIN = tuple((-1.0) ** n / math.factorial(2 * n + 1) for n in range(9))


@inlined
def _turn(part):
    """cos and sin of 2 pi times a number between -1/2 and 1/2: of a quarter of the angle, doubled twice."""
    angle = part * splat(0.5 * np.pi)
    square = angle * angle
    c, s = splat(_COS[8]), splat(_SIN[8])
    for n in range(7, -1, -1):
        c = c * square + splat(_COS[n])
        s = s * square + splat(_SIN[n])
    s = s * angle
    for _ in range(2):
        c, s = c * c - s * s, splat(2.0) * c * s
    return c, s


@helper
def write_phases(xs, room, recip, counts, tables, start, first):
    """Write exp(2 pi i n s) of a vector of charges: n from 0 on, fractional coordinates s of each axis.  ``xs`` holds x, y and z of
    ``room`` charges one after the other; cos n of axis a begins at (start[a] + 2 n) room of ``tables``, and sin n after it."""
    x, y, z = load_lanes(xs, first), load_lanes(xs, room + first), load_lanes(xs, 2 * room + first)
    for axis in range(3):
        place = x * splat(recip[axis, 0]) + y * splat(recip[axis, 1]) + z * splat(recip[axis, 2])
        c1, s1 = _turn(place - floor(place + splat(0.5)))
        c, s = splat(1.0), splat(0.0)
        at = start[axis] * room + first
        for _ in range(counts[axis]):
            store_lanes(tables, at, c)
            store_lanes(tables, at + room, s)
            c, s = c * c1 - s * s1, s * c1 + c * s1
            at += 2 * room


@helper
def copy_steps(tables, room, at, steps, first):
    """The phases 0 to 7 of the second axis of a vector of charges, charge by charge: eight times cos, eight times sin."""
    for lane in range(LANES):
        for j in range(first, first + LANES):
            steps[STRIP * j + lane] = tables[at + 2 * lane * room + j]
            steps[STRIP * j + LANES + lane] = tables[at + (2 * lane + 1) * room + j]


@inlined
def _both(tables, room, start, n2, n3, at):
    """Phases of a vector of charges: of the second axis (n2 may be below 0) times the third one."""
    cy, sy = load_lanes(tables, (start[1] + 2 * abs(n2)) * room + at), load_lanes(tables, (start[1] + 2 * abs(n2) + 1) * room + at)
    cz, sz = load_lanes(tables, (start[2] + 2 * n3) * room + at), load_lanes(tables, (start[2] + 2 * n3 + 1) * room + at)
    sy = sy * splat(1.0 if n2 >= 0 else -1.0)
    return cy * cz - sy * sz, cy * sz + sy * cz


@inlined
def _finish(p, q, r, u, n1, weights, energies, pulls, at):
    """Energy of a row of waves from its four sums; writes down what forces are made of."""
    re0, im0, re1, im1 = p - q, r + u, p + q, r - u
    w0, w1 = load_lanes(weights, WEIGHTS * at), load_lanes(weights, WEIGHTS * at + LANES)
    energy0, energy1 = w0 * (re0 * re0 + im0 * im0), w1 * (re1 * re1 + im1 * im1)
    store_lanes(energies, WEIGHTS * at, energy0)
    store_lanes(energies, WEIGHTS * at + LANES, energy1)
    re0, im0, re1, im1 = re0 * w0, im0 * w0, re1 * w1, im1 * w1
    n, to = splat(n1), PULLS * at
    # sums and differences of the conjugates, and n1 times them
    store_lanes(pulls, to, re0 + re1)
    store_lanes(pulls, to + LANES, splat(0.0) - (im0 + im1))
    store_lanes(pulls, to + 2 * LANES, re0 - re1)
    store_lanes(pulls, to + 3 * LANES, im1 - im0)
    store_lanes(pulls, to + 4 * LANES, n * (re0 + re1))
    store_lanes(pulls, to + 5 * LANES, splat(0.0) - n * (im0 + im1))
    store_lanes(pulls, to + 6 * LANES, n * (re0 - re1))
    store_lanes(pulls, to + 7 * LANES, n * (im1 - im0))
    return energy0 + energy1


@helper
def structure_factors(waves, block, q, n, tables, room, start, steps, outer, energies, pulls):
    """Energy of a block of waves; writes down those of its waves, and what forces are made of.  ``outer`` is scratch for the charges."""
    first, n3, deep, row = waves.blocks[block, 0], waves.blocks[block, 1], waves.blocks[block, 2], waves.blocks[block, 3]
    begin = STRIP * room
    for at in range(0, n, LANES):
        a, b = _both(tables, room, start, first, n3, at)
        charge = load_lanes(q, at)
        store_lanes(outer, begin + at, charge * a)
        store_lanes(outer, begin + room + at, charge * b)
    for j in range(n):
        a, b = splat(outer[begin + j]), splat(outer[begin + room + j])
        c, s = load_lanes(steps, STRIP * j), load_lanes(steps, STRIP * j + LANES)
        store_lanes(outer, STRIP * j, a * c - b * s)
        store_lanes(outer, STRIP * j + LANES, a * s + b * c)
    energy = splat(0.0)
    for n1 in range(0, deep, 2):
        c_at = (start[0] + 2 * n1) * room
        p0, q0, r0, u0 = splat(0.0), splat(0.0), splat(0.0), splat(0.0)
        p1, q1, r1, u1 = splat(0.0), splat(0.0), splat(0.0), splat(0.0)
        for j in range(n):
            a, b = load_lanes(outer, STRIP * j), load_lanes(outer, STRIP * j + LANES)
            c, s = splat(tables[c_at + j]), splat(tables[c_at + room + j])
            p0, q0, r0, u0 = p0 + c * a, q0 + s * b, r0 + c * b, u0 + s * a
            c, s = splat(tables[c_at + 2 * room + j]), splat(tables[c_at + 3 * room + j])
            p1, q1, r1, u1 = p1 + c * a, q1 + s * b, r1 + c * b, u1 + s * a
        energy = energy + _finish(p0, q0, r0, u0, float(n1), waves.weights, energies, pulls, row + n1)
        energy = energy + _finish(p1, q1, r1, u1, float(n1 + 1), waves.weights, energies, pulls, row + n1 + 1)
    return total(energy)


@inlined
def _pull(gr, gi, hr, hi, a, b, n2, n3, f1, f2, f3):
    """Add the forces of a column along the three axes."""
    along = splat(0.0) + (a * gi + b * gr)
    return f1 + (a * hi + b * hr), f2 + n2 * along, f3 + n3 * along


@helper
def lattice_forces(waves, q, tables, room, start, pulls, out, at):
    """Write the lattice's forces on a strip of charges to ``out``: x, y and z of all charges one after the other."""
    zero = splat(0.0)
    x1, x2, x3, y1, y2, y3 = zero, zero, zero, zero, zero, zero
    for block in range(len(waves.blocks)):
        first, n3, row = waves.blocks[block, 0], waves.blocks[block, 1], waves.blocks[block, 3]
        for lane in range(LANES):
            deep = waves.depth[LANES * block + lane]
            if deep == 0:
                continue
            # the complex sums over n1 (g), and the same with a factor n1 (h), of two vectors of charges
            gr0, gi0, hr0, hi0, gr1, gi1, hr1, hi1 = zero, zero, zero, zero, zero, zero, zero, zero
            come, c_at = PULLS * row + lane, start[0] * room + at
            for _ in range(deep):
                c0, s0 = load_lanes(tables, c_at), load_lanes(tables, c_at + room)
                c1, s1 = load_lanes(tables, c_at + LANES), load_lanes(tables, c_at + room + LANES)
                sum_r, sum_i = splat(pulls[come]), splat(pulls[come + LANES])
                less_r, less_i = splat(pulls[come + 2 * LANES]), splat(pulls[come + 3 * LANES])
                gr0, gi0 = gr0 + c0 * sum_r - s0 * less_i, gi0 + c0 * sum_i + s0 * less_r
                gr1, gi1 = gr1 + c1 * sum_r - s1 * less_i, gi1 + c1 * sum_i + s1 * less_r
                sum_r, sum_i = splat(pulls[come + 4 * LANES]), splat(pulls[come + 5 * LANES])
                less_r, less_i = splat(pulls[come + 6 * LANES]), splat(pulls[come + 7 * LANES])
                hr0, hi0 = hr0 + c0 * less_r - s0 * sum_i, hi0 + c0 * less_i + s0 * sum_r
                hr1, hi1 = hr1 + c1 * less_r - s1 * sum_i, hi1 + c1 * less_i + s1 * sum_r
                come += PULLS
                c_at += 2 * room
            n2 = first + lane
            a, b = _both(tables, room, start, n2, n3, at)
            x1, x2, x3 = _pull(gr0, gi0, hr0, hi0, a, b, splat(float(n2)), splat(float(n3)), x1, x2, x3)
            a, b = _both(tables, room, start, n2, n3, at + LANES)
            y1, y2, y3 = _pull(gr1, gi1, hr1, hi1, a, b, splat(float(n2)), splat(float(n3)), y1, y2, y3)
    recip = waves.recip
    for axis in range(3):
        to = axis * room + at
        g1, g2, g3 = splat(4.0 * np.pi * recip[0, axis]), splat(4.0 * np.pi * recip[1, axis]), splat(4.0 * np.pi * recip[2, axis])
        store_lanes(out, to, load_lanes(q, at) * (x1 * g1 + x2 * g2 + x3 * g3))
        store_lanes(out, to + LANES, load_lanes(q, at + LANES) * (y1 * g1 + y2 * g2 + y3 * g3))
