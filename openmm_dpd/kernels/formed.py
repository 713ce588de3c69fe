"""What follows from the bonds that form and break: angles, dihedrals and impropers that come with them, exceptions (:mod:`.reactions`)."""

from dataclasses import dataclass
from itertools import combinations
from typing import Protocol

import numpy as np

from ..base.geometry import minimum_images
from .exceptions import Exceptions


def bonds_in(table: np.ndarray, sort: int) -> np.ndarray:
    """(B, 2) uint32 bonds i < j of a sort, in their order."""
    i, place = np.nonzero((table > 0) & ((table - 1) // len(table) == sort))
    j = (table[i, place] - 1) % len(table)
    i, j = i[i < j], j[i < j]
    return np.column_stack([i, j])[np.lexsort((j, i))].astype(np.uint32)


def both_ways(pairs: np.ndarray, n: int) -> np.ndarray:
    """Bonds (B, 2) of n beads as numbers, partner + n bead, twice each, in their order."""
    i, j = pairs.T.astype(np.int64)
    return np.unique(np.concatenate([i * n + j, j * n + i]))


def angles_in(table: np.ndarray, start: np.ndarray) -> np.ndarray:
    """(K, 3) uint32 angles between two bonds of a bead, of which at least one has been made: it is not in ``start`` (:func:`both_ways`)."""
    now = bonds_now(table, start)
    vertex, partner, made = now // len(table), now % len(table), ~np.isin(now, start)
    found = [np.zeros((0, 3), np.int64)]
    for gap in range(1, np.bincount(vertex).max(initial=0)):
        first = np.flatnonzero((vertex[gap:] == vertex[:-gap]) & (made[gap:] | made[:-gap]))
        found.append(np.column_stack([partner[first], vertex[first], partner[first + gap]]))
    return np.concatenate(found).astype(np.uint32)


def dihedrals_in(table: np.ndarray, start: np.ndarray) -> np.ndarray:
    """(K, 4) uint32 dihedrals along three bonds in a row, of which at least one has been made, see :func:`angles_in`."""
    now, n = bonds_now(table, start), len(table)
    middle = now[now // n < now % n]
    (k, a), w = each_partner(now, middle // n, n), middle % n
    last, b = each_partner(now, w[k], n)
    v, w, a = middle[k[last]] // n, w[k[last]], a[last]
    made = np.any([~np.isin(one * n + other, start) for one, other in ((a, v), (v, w), (w, b))], axis=0)
    return np.column_stack([a, v, w, b])[made & (a != w) & (b != v) & (a != b)].astype(np.uint32)


def impropers_in(table: np.ndarray, start: np.ndarray) -> np.ndarray:
    """(K, 4) uint32 impropers of a bead and each three to which it has bonds, of which at least one has been made, see :func:`angles_in`.
    The three are in the order in which their bonds have come, those of the start first."""
    n, (i, place) = len(table), np.nonzero(table > 0)
    made = i * n + (table[i, place] - 1) % n
    now = np.concatenate([start[~np.isin(start, made)], made])
    now = now[np.argsort(now // n, kind="stable")]
    vertex, partner, made, found = now // n, now % n, ~np.isin(now, start), [np.zeros((0, 4), np.int64)]
    most = np.bincount(vertex).max(initial=0)
    for two, three in combinations(range(1, most), 2):
        first = np.arange(len(now) - three)
        first = first[(vertex[first] == vertex[first + three]) & (made[first] | made[first + two] | made[first + three])]
        found.append(np.column_stack([vertex[first], *(partner[first + gap] for gap in (0, two, three))]))
    return np.concatenate(found).astype(np.uint32)


#: Terms that come and go with bonds.
FORMED = {"angle": angles_in, "dihedral": dihedrals_in, "improper": impropers_in}


#: Bonds along terms.
ARMS = {"angle": ((0, 1), (1, 2)), "dihedral": ((0, 1), (1, 2), (2, 3)), "improper": ((0, 1), (0, 2), (0, 3))}


def of_sorts(pairs: list[np.ndarray], n: int) -> np.ndarray:
    """Bonds (B, 2) of n beads as numbers, of each sort: n^2 sort more than :func:`both_ways` has."""
    return np.concatenate([np.zeros(0, np.int64), *(both_ways(its, n) + k * n * n for k, its in enumerate(pairs))])


def left_of(what: str, beads: np.ndarray, first: np.ndarray, table: np.ndarray) -> np.ndarray:
    """Which terms with these beads (K, 3 or 4) have lost none of the bonds along them that there were at ``first`` (:func:`of_sorts`); one
    of another sort between the same beads is another one."""
    n, (i, place) = np.int64(len(table)), np.nonzero(table > 0)
    sort, partner = np.divmod(table[i, place] - 1, n)
    gone = np.setdiff1d(first, (sort * n + i) * n + partner) % (n * n)
    return ~np.any([np.isin(beads[:, a] * n + beads[:, b], gone) for a, b in ARMS[what]], axis=0)


class BeadsOf(Protocol):
    """What has the beads of some terms, by a table of bonds and the bonds at the start; a class, since saved Systems hold no functions."""

    def __call__(self, table: np.ndarray, start: np.ndarray) -> np.ndarray:
        """(K, width) beads of each term."""


@dataclass(frozen=True, eq=False)
class Formed:
    """Terms that come with bonds, see :data:`FORMED`."""

    what: str

    def __call__(self, table: np.ndarray, start: np.ndarray) -> np.ndarray:
        return FORMED[self.what](table, start)


@dataclass(frozen=True, eq=False)
class Left:
    """Terms that are left, see :func:`left_of`."""

    what: str
    beads: np.ndarray
    first: np.ndarray

    def __call__(self, table: np.ndarray, start: np.ndarray) -> np.ndarray:
        return self.beads[left_of(self.what, self.beads, self.first, table)].astype(np.uint32)


@dataclass(frozen=True, eq=False)
class Segments:
    """Segments that stay (S, 2), and the bonds of some sorts."""

    stay: np.ndarray
    sorts: tuple[int, ...]

    def __call__(self, table: np.ndarray, start: np.ndarray) -> np.ndarray:
        return np.concatenate([self.stay, *(bonds_in(table, k).astype(np.int64) for k in self.sorts)])


def each_partner(bonds: np.ndarray, beads: np.ndarray, n: int) -> tuple[np.ndarray, np.ndarray]:
    """Numbers of the beads (B,) and their partners, one after the other, by the bonds of n beads (:func:`both_ways`)."""
    first, last = np.searchsorted(bonds, [beads * n, beads * n + n])
    many = last - first
    return np.repeat(np.arange(len(beads)), many), bonds[np.arange(many.sum()) + np.repeat(first - np.cumsum(many) + many, many)] % n


def in_angles(bonds: np.ndarray, pairs: np.ndarray, x: np.ndarray, box: np.ndarray | None, bounds: tuple[float, float]) -> np.ndarray:
    """Which pairs (B, 2) have angles within bounds with all bonds (:func:`both_ways`) of their beads."""
    fit = np.ones(len(pairs), bool)
    for vertex, other in (pairs.T.astype(np.int64), pairs.T[::-1].astype(np.int64)):
        k, partner = each_partner(bonds, vertex, len(x))
        a, b = (minimum_images(x[end] - x[vertex[k]], box) for end in (other[k], partner))
        angle = np.arctan2(np.linalg.norm(np.cross(a, b), axis=1), (a * b).sum(axis=1))
        fit[k[(angle < bounds[0]) | (angle > bounds[1])]] = False
    return fit


def bonds_now(table: np.ndarray, others: np.ndarray) -> np.ndarray:
    """Bonds of a table and others (:func:`both_ways`)."""
    i, place = np.nonzero(table > 0)
    return np.union1d(others, i * len(table) + (table[i, place] - 1) % len(table))


def oldest_bonds(table: np.ndarray, others: np.ndarray) -> np.ndarray:
    """Of :func:`bonds_now` one for each bead: of the ``others``, or else the one that has come first."""
    n, (i, place) = len(table), np.nonzero(table > 0)
    codes = np.concatenate([others, i * n + (table[i, place] - 1) % n])  # rows have them in the order in which they came
    return np.sort(codes[np.unique(codes // n, return_index=True)[1]])


def exceptions_in(table: np.ndarray, stays: np.ndarray, factors: tuple[float, ...]) -> Exceptions:
    """Exceptions of beads one, two and three bonds apart, by the bonds of a table and those that stay (:func:`both_ways`)."""
    n = len(table)
    last = bonds = bonds_now(table, stays)
    seen, found = np.arange(n) * (n + 1), [np.zeros((0, 2))]
    for factor in factors:
        last = np.setdiff1d(last, seen)
        found.append(np.column_stack([last, np.full(len(last), factor)])[: len(last) if factor != 1.0 else 0])
        seen, (k, partner) = np.union1d(seen, last), each_partner(bonds, last % n, n)
        last = np.unique(last[k] // n * n + partner)
    codes, values = np.concatenate(found)[np.argsort(np.concatenate(found)[:, 0])].T
    return np.searchsorted(codes, np.arange(n + 1) * n), (codes % n).astype(np.int64), values.copy()
