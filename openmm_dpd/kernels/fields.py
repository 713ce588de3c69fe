"""Per-bead fields for the kernel: internal energies, temperatures, concentrations; and how those with a range are sorted."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar, Protocol

import numpy as np

from .eos import EOSTable, in_range, inverse_temperature
from .motion import counting, over_beads

#: Kinds of fields.
ENERGY, TEMPERATURE, SPECIES = "energy", "temperature", "species"


class FieldSource(Protocol):
    """What changes the fields besides the pair terms, or pushes beads by them (:mod:`openmm_dpd.model.sources`).  Where all sources of a
    scene have a ``row`` of numbers and a mask of ``beads``, as :class:`openmm_dpd.Source`, :meth:`add_to` is not called."""

    pushes: ClassVar[bool]  #: Whether it does the latter

    def add_to(self, rates: np.ndarray, x: np.ndarray, box: np.ndarray | None) -> None:
        """Add to the rates (N, K) at positions x (N, 3)."""

    def push(self, force: np.ndarray, values: np.ndarray) -> None:
        """Add to the forces (N, 3) on beads with these values (N, K)."""


@dataclass(frozen=True, eq=False)
class FieldSpec:
    """The part of per-bead fields that never changes."""

    kind: str  # ENERGY (columns: conductive, mechanical), TEMPERATURE (one column) or SPECIES (one column each)
    initial: np.ndarray  #: (N, K) values at the start
    immobile: np.ndarray  #: (N,) of bool beads whose values the program does not change
    capacity: np.ndarray | None = None  # (N,) or None; TEMPERATURE: heat capacities
    eos: EOSTable | None = None  # ENERGY: equations of state
    sources: tuple[FieldSource, ...] = ()

    @property
    def n_values(self) -> int:
        """Number of values per bead."""
        return self.initial.shape[1]

    @property
    def acts(self) -> bool:
        """Whether forces depend on them, as the repulsion of eDPD does on temperatures, or a source pushes."""
        return self.kind == TEMPERATURE or self.pushes

    @property
    def pushes(self) -> bool:
        """Whether a source pushes beads."""
        return any(source.pushes for source in self.sources)

    @property
    def n_blocks(self) -> int:
        """Number of per-DOF variables it takes: three values fit in each.  Energies have a third component for what rounding lost."""
        return -(-self.n_values // 3)

    def written(self, values: np.ndarray) -> bool:
        """Whether beads that do not move have other values (N, K) than at the start, beyond single precision."""
        return not np.allclose(values[self.immobile], self.initial[self.immobile], rtol=1e-6, atol=0.0)

    def of(self, beads: np.ndarray) -> FieldSpec:
        """The fields of a choice of beads, without sources."""
        eos = None if self.eos is None else self.eos.of(beads)
        capacity = None if self.capacity is None else self.capacity[beads]
        return FieldSpec(self.kind, self.initial[beads], self.immobile[beads], capacity, eos)


@over_beads
def _add_rows(begin, end, rates, x, box, rows, takes):
    """Add the rates of sources in numbers (S, 12) to those (N, K) of beads at x (N, 3), where a bit of ``takes`` (N,) is set for each."""
    for i in range(begin, end):
        for k in range(len(rows)):
            if not takes[i] >> k & 1:
                continue
            px, py, pz = x[i, 0] - rows[k, 0], x[i, 1] - rows[k, 1], x[i, 2] - rows[k, 2]
            if len(box):  # as base/geometry.py folds
                c = pz / box[2, 2]
                turns = np.floor(c)
                c, px, py, pz = c - turns, px - turns * box[2, 0], py - turns * box[2, 1], pz - turns * box[2, 2]
                b = (py - c * box[2, 1]) / box[1, 1]
                turns = np.floor(b)
                b, px, py = b - turns, px - turns * box[1, 0], py - turns * box[1, 1]
                px -= np.floor((px - (b * box[1, 0] + c * box[2, 0])) / box[0, 0]) * box[0, 0]
            px, py, pz = px + rows[k, 0], py + rows[k, 1], pz + rows[k, 2]
            if rows[k, 3] != 0.0:
                dx, dy, dz = px - rows[k, 4], py - rows[k, 5], pz - rows[k, 6]
                inside = dx * dx + dy * dy + dz * dz < rows[k, 8]
            else:
                inside = (px >= rows[k, 4]) & (px <= rows[k, 8]) & (py >= rows[k, 5]) & (py <= rows[k, 9])
                inside &= (pz >= rows[k, 6]) & (pz <= rows[k, 10])
            if inside:
                rates[i, np.int64(rows[k, 11])] += rows[k, 7]


#: A box of which there is none; most sources that are added in compiled code, one bit each.
_OPEN, _MOST = np.zeros((0, 3)), 62


class Sources:
    """Adds up what sources give: by one pass over the beads if they are ``steady``, all in numbers (``row``), else one after the other."""

    def __init__(self, fields: FieldSpec | None):
        self._fields, self.all = fields, () if fields is None else fields.sources
        self._rows = np.array([row for each in self.all if (row := getattr(each, "row", None)) is not None]).reshape(-1, 12)
        self.steady = len(self._rows) == len(self.all) <= _MOST
        if self.all and self.steady and fields is not None:
            bits = [np.where(True if each.beads is None else each.beads, 1 << k, 0) for k, each in enumerate(self.all)]  # type: ignore[attr-defined]
            taken = np.zeros(len(fields.initial), np.int64) + sum(bits)
            self._given, self._takes = np.array([taken, np.where(fields.immobile, 0, taken)]).T.copy(), np.zeros((2, len(taken)), np.int64)
            self.seat(np.arange(len(taken)))

    def seat(self, names: np.ndarray) -> None:
        """Take arrays of beads in another order from now on."""
        if self.all and self.steady:
            self._takes[...] = self._given[names].T

    def add_to(self, rates: np.ndarray, x: np.ndarray, box: np.ndarray | None, moving: bool = False) -> None:
        """Add to rates (N, K) at positions x (N, 3), or those of ``moving`` beads alone, which begin with 0."""
        if self.all and self.steady:
            _add_rows(rates, x, _OPEN if box is None else box, self._rows, self._takes[int(moving)])
        else:
            for source in self.all:
                source.add_to(rates, x, box)
            if moving and self._fields is not None:
                rates[self._fields.immobile] = 0.0


#: Where nothing is to be added to fields.
NO_INCREMENTS = np.zeros((0, 1))


@counting
def sort_energies(begin, end, order, seats, energies, increments, capacities, numbers, start, nodes, pieces, u, inverse):
    """Sort internal energies, the conductive and the mechanical part of (N, 2) of two arrays added up (the second may be of length 0), into
    ``u`` (M,), and 1/theta into ``inverse`` (M,); returns how many have none."""
    count = 0
    for k in range(begin, end):
        i, n = seats[k], order[k]
        u[k] = energies[i, 0] + energies[i, 1]
        if len(increments):
            u[k] += increments[i, 0] + increments[i, 1]
        count += not in_range(u[k], capacities[n], numbers[n], start, nodes)
        # of theta itself, which is what others read
        inverse[k] = 1.0 / (1.0 / inverse_temperature(u[k], capacities[n], numbers[n], start, nodes, pieces))
    return count


@counting
def sort_temperatures(begin, end, order, seats, values, increments, capacities, before, temperature, capacity, failed):
    """Sort temperatures, ``values`` (N, 1) and ``increments`` (N, 1, or of length 0) added up, into both ``before`` and ``temperature``
    (M,), and heat capacities into ``capacity`` (M,); returns how many temperatures are not > 0.  Rows of ``failed`` (columns, 2) begin
    with 0."""
    count = 0
    for column in range(len(failed) * begin // len(order), len(failed) * end // len(order)):
        failed[column, 0] = 0.0
    for k in range(begin, end):
        i = seats[k]
        before[k] = temperature[k] = values[i, 0] + increments[i, 0] if len(increments) else values[i, 0]
        capacity[k] = capacities[order[k]]
        count += not before[k] > 0.0
    return count


@counting
def count_failed(begin, end, order, failed):
    """How many rows of ``failed`` (columns, 2) do not begin with 0."""
    count = 0
    for column in range(len(failed) * begin // len(order), len(failed) * end // len(order)):
        count += failed[column, 0] != 0.0
    return count
