"""Pairs eight at a time, none of which have a bead in common, for updates in which a pair needs what others have left in its beads.

So a processor computes all of a group at once, divisions, roots and logarithms too.  Each pair is in a group after those of all pairs
before it in the list that have a bead in common with it: results are those of one pair after the other.
"""

from typing import Any

import numpy as np

from ..runtime import merged
from .pairs import CHUNK, PairList, Pairs
from .vectors import lowest_bit

#: So many pairs are in a group, at most.
EIGHT = np.uint64(8)
_GROUPS, _ONE, _CHUNK = np.uint64(CHUNK // 8), np.uint64(1), np.uint64(CHUNK)
_ALL = (_ONE << _GROUPS) - _ONE


def seats_for(pairs: PairList) -> tuple:
    """Seats in :data:`_GROUPS` groups for each thread, with pi, pj, geometry and factors as in :class:`.pairs.Pairs`; (threads, groups) how
    many pairs these have; (M,) the first group that is free for a bead."""
    each, threads = np.zeros((2, pairs.threads, CHUNK), np.uint32), pairs.threads
    factors, sizes = np.zeros((threads, CHUNK * (len(pairs.exceptions[0]) > 0))), np.zeros((threads, int(_GROUPS)), np.uint64)
    return *each, np.zeros((threads, 4, CHUNK)), factors, sizes, np.zeros(len(pairs.order), np.uint64)


@merged
def _seat(pairs, seats, sizes, after, begin, stop):
    """Seat pairs from ``begin`` on, until one finds no seat; returns its number, and how many groups there are."""
    sizes[:] = np.uint64(0)
    n, free, groups = begin, _ALL, np.uint64(0)
    while n < stop:
        i, j = pairs.pi[n], pairs.pj[n]
        group = lowest_bit(free & (_ALL << max(after[i], after[j])))
        if group >= _GROUPS:
            break
        k = group * EIGHT + sizes[group]
        sizes[group] += _ONE
        free &= ~(sizes[group] // EIGHT << group)
        after[i] = after[j] = group + _ONE
        groups = max(groups, group + _ONE)
        seats.pi[k], seats.pj[k] = i, j
        for row in range(4):
            seats.geometry[row, k] = pairs.geometry[row, n]
        if len(pairs.factors):
            seats.factors[k] = pairs.factors[n]
        n += _ONE
    for k in range(begin, n):
        after[pairs.pi[k]] = after[pairs.pj[k]] = np.uint64(0)
    return n, groups


def grouped_column(pairs, data, space, source, column, part, turn):
    """One column: ``pair`` gets the first seat of a group, and how many of its seats are taken."""
    pi, pj, geometry, factors, counts, after = source
    sizes, begin, stop = counts[part], pairs.start[column], pairs.start[column] + pairs.found[column]
    seats = Pairs(
        pairs.order, pairs.seats, pairs.types, pairs.inv_mass, pairs.ntypes, pi[part], pj[part], geometry[part], factors[part],
        pairs.start, pairs.found, pairs.sums, pairs.stress, pairs.flow,
    )  # fmt: skip
    pairs.sums[column] = 0.0
    for here in range(begin + np.uint64(turn) * _CHUNK, stop, _ROUNDS * _CHUNK):
        n, last = here, min(here + _CHUNK, stop)
        while n < last:
            n, groups = _seat(pairs, seats, sizes, after, n, last)
            _before(seats, data, np.uint64(0), groups * EIGHT, space)
            for group in range(groups):
                _pair(seats, data, space, group * EIGHT, sizes[group], column)


# what over_pairs() puts in
_before: Any = None
_pair: Any = None
_ROUNDS = _ONE
