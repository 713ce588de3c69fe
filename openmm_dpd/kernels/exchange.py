"""How much a pair exchanges in a sweep: of heat, or of a species.

A difference of 1 makes e flow in a step, and an amount of 1 changes the value of a bead by b (1/C; 0 where it stays).  Between two beads
alone a difference falls by the part 1 - exp(-y), y = e (b_i + b_j).  Among others what has come leaves to them too, before it comes back.
With the sums W of e over all neighbours of a bead::

    others = [b_i^2 (W_i - e) + b_j^2 (W_j - e)]/(b_i + b_j),   l = y + others,
    s      = 10 kT (1/m_i + 1/m_j) (dt/range)^2
    lost   = y {1 - (y/l) [1 - (1 - exp(-l))/l/(1 + s others)]},  at most 1 + 3/4 of the smaller b over the larger one

is the part of it that a sweep takes away: 1 - exp(-y) with others = 0.  s is due to the motion, from which a sweep is apart; its number was
measured.  All depends on positions, and on what the update of a pair keeps: so updates that leave a weight unchanged still do.

Where exchange is slow for the motion (:data:`_SLOW`), others are left out, and lists are the usual ones.

A bead must not exchange with its neighbours one right after the other: sweeps that exchange go around several times, with other pairs of
each column every time, and pairs of a bead are listed far apart (``spread`` in :class:`.pairs.PairList`; docs/theory_energy.md).
"""

from typing import NamedTuple

import numpy as np

from ..runtime import helper, inlined
from .chunks import look_up, powers
from .columns import over_pairs
from .layer import PairSpec, table_of
from .pairs import SECOND, PairList, rows

#: Rows of scratch: factor, coefficients, weight; then those of each species.
_FACTOR, _KAPPA, _CUTOFF, _EXPONENT, _WEIGHT, _RATE = rows(6)
#: A difference of two like beads becomes -3/4 of what it was, at most: were it swapped in all pairs, it would never be gone.
_BEYOND = 0.75
#: Up to this rate all neighbours together change the decay of a sine by about 1 % at most, at any step that the motion allows.
_SLOW = 2.5
#: Measured in the fluid of A = 25 at density 3 with steps from 0.06 to 0.22.
_DRIFTED = 10.0


class Around(NamedTuple):
    """What the sums are made of: coefficients (K, T*T, 3) of K species, kappa, range, half the exponent; ``weights`` (M,) of the sorted
    beads; ``sums`` (K, M) over neighbours j of kappa w^p weights[j]."""

    coefficients: np.ndarray
    weights: np.ndarray
    sums: np.ndarray


def fast(spec: PairSpec, rate: float) -> bool:
    """Whether a scheme has sweeps in which others count; ``rate``: the largest of two beads, per longest range times (m/kT)^(1/2)."""
    return spec.sweeps and not rate <= _SLOW


def around(pairs: PairList, spec: PairSpec, rate: float, kappa, cutoff, exponent, weights: np.ndarray | None = None) -> Around:
    """For arrays (T, T) or (T, T, K), and weights, by default 1.  If the exchange is :func:`fast`, the list will be spread."""
    pairs.spread, m = fast(spec, rate), len(pairs.order)
    each = np.moveaxis(np.atleast_3d(kappa), 2, 0), np.moveaxis(np.atleast_3d(exponent), 2, 0)
    coefficients = np.stack([table_of(one, cutoff, 0.5 * p) for one, p in zip(*each, strict=True)])
    return Around(coefficients, np.ones(m) if weights is None else weights, np.zeros((len(coefficients), m)))


@helper
def _rates(pairs, data, begin, m, scratch):
    values, r = scratch.values, pairs.geometry[3]
    for species in range(len(data.sums)):
        look_up(data.coefficients[species], (0, 1, 2), pairs, begin, m, scratch, _FACTOR)
        for k in range(m):
            values[_WEIGHT + k] = 1.0 - r[begin + k] / values[_CUTOFF + k]
        powers(m, scratch, _WEIGHT, _EXPONENT)
        row = _RATE + np.uint64(species) * SECOND
        for k in range(m):
            w = values[_WEIGHT + k]
            values[row + k] = values[_KAPPA + k] * w * w if values[_FACTOR + k] != 0.0 else 0.0


@inlined
def _pair_rate(pairs, data, scratch, n, k, column):
    i, j, values, sums = pairs.pi[n], pairs.pj[n], scratch.values, data.sums
    for species in range(len(sums)):
        rate = values[_RATE + np.uint64(species) * SECOND + k]
        sums[species, i] += rate * data.weights[j]
        sums[species, j] += rate * data.weights[i]
    return 0.0, 0.0, 0.0


@helper
def _clear(pairs, data, begin, end):
    for species in range(len(data.sums)):
        data.sums[species, begin:end] = 0.0


sum_around = over_pairs("sum_around", _pair_rate, _rates, first=_clear)


@inlined
def all_of(e, bi, bj, wi, wj):
    """The rate l of a pair with what flows to others; nothing does where sums are 0, since they are not needed."""
    return e * (bi + bj) + (bi * bi * max(wi - e, 0.0) + bj * bj * max(wj - e, 0.0)) / (bi + bj)


@inlined
def alike(bi, bj):
    """The smaller of two numbers over the larger one."""
    return min(bi, bj) / max(bi, bj)


@inlined
def drifted(kT, im, dt, cutoff):
    """The number s."""
    return _DRIFTED * kT * im * (dt / cutoff) ** 2


@inlined
def part_of(y, every, left, alike, moving):
    """The part ``lost`` of a difference, with l = ``every`` >= y > 0, ``left`` = 1 - exp(-l), s = ``moving``."""
    if every == y:  # nobody else
        return left
    more = every + moving * every * (every - y)
    # the quotient need not wait for the exponential
    return min(1.0 + _BEYOND * alike, y - y * y / (every * more) * (more - left))
