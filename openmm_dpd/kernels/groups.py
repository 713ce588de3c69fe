"""Pairs many at a time, none of which have a bead in common, for updates in which a pair needs what others have left in its beads.

So a processor computes all of a group at once, divisions, roots and logarithms too.  Each pair is in a group after those of all pairs
before it in the list that have a bead in common with it: results are those of one pair after the other.  Where two columns that follow
each other touch no bead both, groups have pairs of either: eight pairs alone wait for their own results most of the time.
"""

from typing import Any

import numpy as np

from ..runtime import merged
from .pairs import CHUNK, PairList, Pairs
from .shares import apart
from .vectors import lowest_bit

#: So many pairs a processor computes at once; so many are in a group, at most.
EIGHT, _MOST = np.uint64(8), np.uint64(16)
_GROUPS, _ONE, _CHUNK, _BYTE = np.uint64(CHUNK // 16), np.uint64(1), np.uint64(CHUNK), np.uint64(8)
#: A byte for each of the eight groups: its highest bit, and what it begins with, so that this bit is set when sixteen seats are taken.
_FULL, _NONE = np.uint64(0x8080808080808080), np.uint64(0x7070707070707070)


def seats_for(pairs: PairList) -> tuple:
    """Seats in :data:`_GROUPS` groups for each thread, with pi, pj, geometry and factors as in :class:`.pairs.Pairs`; (M,) bits of the
    groups that come too early for a bead; how many columns there are along y and z."""
    each, threads = np.zeros((2, pairs.threads, CHUNK), np.uint32), pairs.threads
    factors = np.zeros((threads, CHUNK * (len(pairs.exceptions[0]) > 0)))
    return *each, np.zeros((threads, 4, CHUNK)), factors, np.zeros(len(pairs.order), np.uint64), *pairs.across


@merged
def _seat(pairs, seats, after, begin, stop, beside, end):
    """Seat pairs from ``begin`` and from ``beside`` on, in turn, until one finds no seat; returns their numbers, and how many seats of each
    group are taken: a byte each, whose highest bit is set when all are."""
    n, other, taken = begin, beside, _NONE
    while n < stop or other < end:
        late = end - other > stop - n
        p = other if late else n
        i, j = pairs.pi[p], pairs.pj[p]
        free = ~(taken | after[i] | after[j]) & _FULL
        if not free:
            break
        after[i] = after[j] = free ^ (free - _ONE)  # the bits of this group and those before it
        byte = lowest_bit(free) - np.uint64(7)
        k = (byte << _ONE) + (taken >> byte & (_MOST - _ONE))
        taken += _ONE << byte
        seats.pi[k], seats.pj[k] = i, j
        for row in range(4):
            seats.geometry[row, k] = pairs.geometry[row, p]
        if len(pairs.factors):
            seats.factors[k] = pairs.factors[p]
        n, other = (n, other + _ONE) if late else (n + _ONE, other)
    for first, last in ((begin, n), (beside, other)):
        for k in range(first, last):
            after[pairs.pi[k]] = after[pairs.pj[k]] = np.uint64(0)
    return n, other, taken


def grouped_columns(pairs, data, space, source, columns, part, turn):
    """Some columns: ``pair`` gets the first seat of a group, and how many of its seats are taken."""
    pi, pj, geometry, factors, after, ny, nz = source
    start, found = pairs.start, pairs.found
    seats = Pairs(
        pairs.order, pairs.seats, pairs.types, pairs.inv_mass, pairs.ntypes, pi[part], pj[part], geometry[part], factors[part],
        pairs.start, pairs.found, pairs.sums, pairs.stress, pairs.flow,
    )  # fmt: skip
    at, ends = np.uint64(0), np.uint64(len(columns))
    while at < ends:
        column, other = columns[at], columns[min(at + _ONE, ends - _ONE)]
        two = np.uint64(apart(column, other, ny, nz))
        at += _ONE + two
        mine, its = found[column], two * found[other]
        pairs.sums[column] = pairs.sums[other] = 0.0
        for here in range(np.uint64(turn) * _CHUNK, max(mine, its), _ROUNDS * _CHUNK):
            n, last = start[column] + min(here, mine), start[column] + min(here + _CHUNK, mine)
            beside, end = start[other] + min(here, its), start[other] + min(here + _CHUNK, its)
            while n < last or beside < end:
                n, beside, taken = _seat(pairs, seats, after, n, last, beside, end)
                taken -= _NONE
                groups = _GROUPS
                while not taken >> _BYTE * (groups - _ONE):
                    groups -= _ONE
                _before(seats, data, np.uint64(0), groups * _MOST, space)
                for group in range(groups):
                    _pair(seats, data, space, group * _MOST, taken >> _BYTE * group & np.uint64(255), column)


# what over_pairs() puts in
_before: Any = None
_pair: Any = None
_ROUNDS = _ONE
