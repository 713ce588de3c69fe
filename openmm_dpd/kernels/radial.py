"""Radial pair potentials that lie over the pair terms: Lennard-Jones, formulas and tables, between all beads of some types.

Lennard-Jones is U = 4 epsilon ((sigma/r)^12 - (sigma/r)^6) - shift.  A formula is a constant, a slope times r, an amplitude times a cosine,
and a sum of a r^-p exp(-b r - c r^2).  A table is a piecewise cubic in r, with a constant force below its first distance.  All are 0 from
the cutoff of the two types on.  Bonded neighbours have a factor for energy and force, 0 leaves them out; two beads at the same point leave
each other alone.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import ClassVar, NamedTuple

import numpy as np

from ..runtime import helper, inlined
from .columns import Motion, Totals, clear, deliver, factor_of, over_pairs, push_apart
from .elementary import exp, log, sine
from .exceptions import Exceptions, no_exceptions
from .pairs import PairList

#: The number of a table for types with a formula.
FORMULA = -2


@dataclass(frozen=True, eq=False)
class Tables:
    """Piecewise cubics, U = ((c0 t + c1) t + c2) t + c3 with t = r - knot, one after the other."""

    start: np.ndarray  #: (K + 1,) first knot of each table, and the end of the last one
    knots: np.ndarray  #: (M,) increasing within each table, evenly to a good approximation
    cubics: np.ndarray  #: (M, 4) coefficients from each knot on; those of a table's last knot are not used

    @staticmethod
    def of(pieces: list[tuple[np.ndarray, np.ndarray]]) -> Tables:
        """From knots (m,) and coefficients (4, m - 1) of each table, as scipy's piecewise polynomials have them."""
        start = np.cumsum([0] + [len(knots) for knots, _ in pieces]).astype(np.int64)
        knots = np.concatenate([np.zeros(0)] + [knots for knots, _ in pieces])
        cubics = np.zeros((len(knots), 4))
        for first, (_, coefficients) in zip(start, pieces, strict=False):
            cubics[first : first + coefficients.shape[1]] = coefficients.T
        return Tables(start, knots, cubics)


@dataclass(frozen=True, eq=False)
class RadialTerms:
    """A potential between the beads of T types."""

    term: ClassVar[str] = "conservative"
    types: np.ndarray  # (N,) int32 type of each bead, -1 for one that takes no part
    cutoff: np.ndarray  # (T, T) nm; 0 where two types do not interact
    which: np.ndarray  #: (T, T) number of the table of two types, -1 for Lennard-Jones, -2 for a formula
    #: (T, T, K) epsilon, sigma and shift of two types; or the numbers of :meth:`openmm_dpd.model.radial.RadialPair.numbers`
    numbers: np.ndarray
    tables: Tables
    # Bonded neighbours in compressed rows: start (N + 1,), bead (E,), factor (E,); start is empty if there are none
    exceptions: Exceptions = field(default_factory=no_exceptions)

    def evaluator(self) -> RadialEvaluator:
        """What computes it."""
        return RadialEvaluator(self)

    def few(self) -> tuple[RadialTerms, np.ndarray, np.ndarray]:
        """A few beads, too far from each other for any force, in a box with three cells along each edge."""
        reach = float(self.cutoff.max())
        x = np.array([[0.0, 0, 0], [2.0, 0, 0], [0, 2.0, 0], [2.0, 2.0, 2.0]]) * reach
        types = np.zeros(len(x), np.int32)
        return RadialTerms(types, self.cutoff, self.which, self.numbers, self.tables), x, np.diag([4.0 * reach] * 3)


@inlined
def _lennard_jones(r, epsilon, sigma, shift):
    """Energy and force at the distance r."""
    s2 = sigma * sigma / (r * r)
    s6 = s2 * s2 * s2
    return 4.0 * epsilon * s6 * (s6 - 1.0) - shift, 24.0 * epsilon * s6 * (2.0 * s6 - 1.0) / r


@inlined
def _formula(r, n):
    """Energy and force at the distance r, from the numbers n."""
    energy, force, logarithm = n[0] + n[1] * r, -n[1], log(r)
    if n[2] != 0.0:
        energy += n[2] * sine(n[3] * r + 0.25)
        force += 2.0 * np.pi * n[3] * n[2] * sine(n[3] * r)
    for k in range(4, len(n), 4):
        part = n[k] * exp(-n[k + 1] * logarithm - (n[k + 2] + n[k + 3] * r) * r)
        energy += part
        force += part * (n[k + 1] / r + n[k + 2] + 2.0 * n[k + 3] * r)
    return energy, force


@inlined
def _cubic(r, first, last, knots, cubics):
    """Energy and force at the distance r of the table with the knots first to last."""
    inside = max(r, knots[first])
    k = first + int((inside - knots[first]) * (last - first) / (knots[last] - knots[first]))
    # the knots are even to some digits only
    k = min(max(k, first), last - 1)
    while k > first and inside < knots[k]:
        k -= 1
    while k < last - 1 and inside >= knots[k + 1]:
        k += 1
    t = inside - knots[k]
    c0, c1, c2, c3 = cubics[k, 0], cubics[k, 1], cubics[k, 2], cubics[k, 3]
    force = -((3.0 * c0 * t + 2.0 * c1) * t + c2)
    return ((c0 * t + c1) * t + c2) * t + c3 + force * (inside - r), force


class Potential(NamedTuple):
    """What the loop reads and writes beside the pairs."""

    which: np.ndarray
    numbers: np.ndarray
    start: np.ndarray
    knots: np.ndarray
    cubics: np.ndarray
    motion: Motion


@helper
def _radial_pair(pairs, data, scratch, n, k, column):
    i, j, r = pairs.pi[n], pairs.pj[n], pairs.geometry[3, n]
    a, b = pairs.types[i], pairs.types[j]
    table = data.which[a, b]
    if table == FORMULA:
        energy, size = _formula(r, data.numbers[a, b])
    elif table < 0:
        energy, size = _lennard_jones(r, data.numbers[a, b, 0], data.numbers[a, b, 1], data.numbers[a, b, 2])
    else:
        energy, size = _cubic(r, data.start[table], data.start[table + 1] - 1, data.knots, data.cubics)
    factor = factor_of(pairs, n)
    return factor * energy, push_apart(pairs, data.motion.f, n, i, j, factor * size), 0.0


radial_forces = over_pairs("radial_forces", _radial_pair, first=clear, last=deliver)


class RadialEvaluator:
    """Computes :class:`RadialTerms`, with a pair list of its own, made anew at each call."""

    repeats = True

    def __init__(self, terms: RadialTerms):
        self.terms = terms
        self.list = PairList(terms.types, np.ones(len(terms.types)), terms.cutoff, terms.exceptions)
        self._f, tables = np.zeros((len(self.list.beads), 3)), terms.tables
        self._tables = terms.which, terms.numbers, tables.start, tables.knots, tables.cubics

    def seat(self, names: np.ndarray, places: np.ndarray) -> None:
        """See :meth:`.pairs.PairList.seat`."""
        self.list.seat(names, places)

    def add_to(self, x: np.ndarray, box: np.ndarray | None, force: np.ndarray, scale: float) -> float:
        """See :class:`.extras.Evaluator`; RunError if a position is not finite."""
        return self._sums(x, box, force).energy

    def stress(self, x: np.ndarray, box: np.ndarray | None) -> np.ndarray:
        """(6,) sums of r F (xx, yy, zz, xy, xz, yz) at the positions x; RunError as :meth:`add_to`."""
        found = self._sums(x, box, np.zeros_like(x), tensor=True).stress
        return np.zeros(6) if found is None else found

    def shared(self) -> tuple[np.ndarray, np.ndarray]:
        """See :meth:`.pairs.PairList.shared`."""
        return self.list.shared()

    def _sums(self, x: np.ndarray, box: np.ndarray | None, force: np.ndarray, tensor: bool = False) -> Totals:
        if not len(self.list.beads):
            return Totals(0.0, 0.0, 0.0)
        self.list.build(x, box)
        return radial_forces(self.list, Potential(*self._tables, Motion(self._f, force)), tensor)
