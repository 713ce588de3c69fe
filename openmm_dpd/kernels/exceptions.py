"""Bonded neighbours whose pairs have a factor, or are left out of lists: factor 0."""

import numpy as np

from ..runtime import helper, inlined

#: Exceptions of a list without any: bonded neighbours in compressed rows, start (N + 1,), bead (E,), factor (E,).
Exceptions = tuple[np.ndarray, np.ndarray, np.ndarray]


def no_exceptions() -> Exceptions:
    """Exceptions of beads that have none: the rows have no start."""
    return np.zeros(0, np.int64), np.zeros(0, np.int64), np.zeros(0)


def compressed_exceptions(factors: dict[tuple[int, int], float], n_beads: int, changes: bool = False) -> Exceptions:
    """Factors of pairs of beads as exceptions, each in both directions; where they will change there are rows even without any."""
    if not factors and not changes:
        return no_exceptions()
    rows = sorted([(i, j, f) for (i, j), f in factors.items()] + [(j, i, f) for (i, j), f in factors.items()])
    first = np.array([row[0] for row in rows], np.int64)
    start = np.concatenate([[0], np.cumsum(np.bincount(first, minlength=n_beads))])
    return start.astype(np.int64), np.array([row[1] for row in rows], np.int64), np.array([row[2] for row in rows])


def most_apart(exceptions: Exceptions) -> np.uint64:
    """How far apart the numbers of two bonded neighbours are at most: pairs that are further apart need not be looked up."""
    start, bead, _ = exceptions
    return np.uint64(np.abs(np.repeat(np.arange(len(start) - 1), np.diff(start)) - bead).max(initial=0) if len(bead) else 0)


@inlined
def factor_of_beads(rule, i, j):
    """Factor of the bonded neighbours i, j; 1 if they are none."""
    if max(i, j) - min(i, j) > rule.exc_apart:
        return 1.0
    for k in range(rule.exc_start[i], rule.exc_start[i + 1]):
        if rule.exc_bead[k] == j:
            return rule.exc_factor[k]
    return 1.0


@helper
def leave_out(rule, order, bead, hits, m):
    """Leave out what the exceptions leave out; returns how many are left, with their factors."""
    who, whom, factor = hits
    n = np.uint64(0)
    for q in range(m):
        s, k = who[q], whom[q]
        who[n], whom[n], factor[n] = s, k, factor_of_beads(rule, order[bead[s]], order[bead[k]])
        n += np.uint64(factor[n] != 0.0)
    return n
