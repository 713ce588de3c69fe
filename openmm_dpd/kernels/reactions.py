"""Bonds that form and break: the table of bonds, and what a trial does to it.

The table (N, W) has a row for each bead and a number for each of its bonds, 1 + partner + N sort, 0 where there is none; -1 - sort stands
for one that is broken and counts nevertheless, and -1 - sorts - type for another type of the bead than at the start.  What is computed from
it depends on the places in the rows only where bonds have to be in the order in which they have come: broken ones that count keep theirs.
"""

from dataclasses import dataclass
from functools import partial
from typing import Any, NamedTuple

import numpy as np

from ..base.errors import RunError
from ..base.geometry import minimum_images
from ..runtime import compiled, inlined
from .exceptions import Exceptions
from .extras import BondedKernel
from .formed import BeadsOf, bonds_in, bonds_now, exceptions_in, in_angles, oldest_bonds
from .moment import Moment, SlowForces, StepSpec, Watch
from .noise import noise_key, pair_key, uniform
from .pairs import PairList
from .segments import SegmentSpec
from .steps import StepLoop

#: Layers of noise from here on are those of reactions.
_LAYER = 1 << 32


@dataclass(frozen=True, eq=False)
class ReactionSpec:
    """One reaction: immutable, can be pickled."""

    model: Any  #: A BondFormation or BondBreaking of the model
    sort: int  #: Number of the sort of bonds
    role_of: np.ndarray  #: (T,) int32 by type, 0 and 1 for the two types of beads (0 if they are the same), 2 for others
    valences: np.ndarray  #: (3,) most bonds of the sort that beads of each role may have
    becomes: np.ndarray | None  #: (3,) type that beads of each role take once they have them, -1 for no other one; None if none changes


@dataclass(frozen=True, eq=False)
class BondsSpec:
    """All bonds that may form and break."""

    reactions: tuple[ReactionSpec, ...]
    #: One bond of each sort, then one of each angle, dihedral and improper that come and go with bonds, then the segments
    sorts: tuple[BondedKernel | SegmentSpec, ...]
    initial: np.ndarray  #: (N, W) table at the start
    neighbours: Exceptions  #: Beads with bonds that stay, of the factor 0: they get no other one
    stays: np.ndarray  #: Bonds that stay, and with those of the initial table, see :func:`both_ways`
    start: np.ndarray
    bent: tuple[BeadsOf, ...]  #: What has the beads of each of the latter, of a table and ``start``
    types: np.ndarray  #: (N,) types of the beads at the start
    turns: bool  #: Whether types change
    factors: tuple[float, ...] | None  #: Of the pair terms of beads one, two and three bonds apart, if any differs from 1


class Event(NamedTuple):
    """A bond that was made or broken."""

    step: int
    reaction: int
    change: int  #: 1 or -1
    i: int
    j: int
    length: float  #: nm
    energy: float  #: Change of the energy of the bond, kJ/mol


def types_in(table: np.ndarray, start: np.ndarray, sorts: int) -> np.ndarray:
    """(N,) types of beads whose types at the ``start`` are given."""
    if table.min() >= -sorts:  # none has changed
        return start
    least = table.min(axis=1)
    return np.where(least < -sorts, -1 - sorts - least, start).astype(np.int32)


def set_types(table: np.ndarray, beads: np.ndarray, types: np.ndarray, sorts: int) -> None:
    """Have beads (B,) be of other types."""
    rows = table[beads]
    table[beads, np.argmin(np.where(rows < -sorts, -1, rows != 0), axis=1)] = -1 - sorts - types


def counts_in(table: np.ndarray, sort: int) -> np.ndarray:
    """(N,) bonds of a sort that count for each bead."""
    return (((table > 0) & ((table - 1) // len(table) == sort)) | (table == -1 - sort)).sum(axis=1)


@inlined
def _bond_between(table, i, j):
    """Sort of the bond between two beads, -1 if there is none."""
    n, found = len(table), -1
    for code in table[i]:
        if code > 0 and (code - 1) % n == j:
            found = (code - 1) // n
    return found


@compiled
def turn(table, counts, valences, pairs, wanted, sort, left):
    """Make or break bonds of pairs (B, 2), one after the other, so that those that may have one have it where it is ``wanted``; ``left`` is
    put in the places of broken ones.  Returns the changes, 1, -1 or 0."""
    n, changes = len(table), np.zeros(len(pairs), np.int64)
    for k in range(len(pairs)):
        i, j = np.int64(pairs[k, 0]), np.int64(pairs[k, 1])
        there = _bond_between(table, i, j) == sort
        if there == wanted[k] or (wanted[k] and (counts[i] >= valences[i] or counts[j] >= valences[j])):
            continue
        changes[k] = 1 if wanted[k] else -1
        for one, other in ((i, j), (j, i)):
            code = 1 + other + n * sort
            place = 0
            while place < table.shape[1] - 1 and table[one, place] != (0 if wanted[k] else code):
                place += 1
            table[one, place] = code if wanted[k] else left
            counts[one] += changes[k]
    return changes


@compiled
def uniforms(key, pairs, stream):
    """Uniform number of each pair (B, 2) of beads."""
    found = np.empty(len(pairs))
    for k in range(len(pairs)):
        found[k] = uniform(pair_key(key, pairs[k, 0], pairs[k, 1]), stream)
    return found


@compiled
def candidates(order, pi, pj, r, start, found, table, counts, valences, sort, turns, key, chance, within):
    """Pairs (B, 2) i < j of beads that may react, and their distances: those without a bond that may have one, or if it ``turns``, without
    one of another sort, and then only those that are chosen by chance.  They come in the order of the list, which positions decide."""
    room = 0
    for c in range(len(found)):
        room += int(found[c])
    pairs, lengths, some = np.empty((room, 2), np.uint32), np.empty(room), 0
    for c in range(len(found)):
        for k in range(np.int64(start[c]), np.int64(start[c]) + np.int64(found[c])):
            i, j = np.int64(order[pi[k]]), np.int64(order[pj[k]])
            full = counts[i] >= valences[i] or counts[j] >= valences[j]
            if not r[k] < within or (full and not turns):
                continue
            if turns:
                if not uniform(pair_key(key, i, j), 0) < chance:
                    continue
            there = _bond_between(table, i, j)
            if there == -1 or (turns and there == sort):
                pairs[some, 0], pairs[some, 1], lengths[some] = min(i, j), max(i, j), r[k]
                some += 1
    return pairs[:some].copy(), lengths[:some].copy()


@compiled
def mutual(n, pairs, r):
    """Which of the pairs (B, 2) of n beads have the least r of all those of either bead; of equal ones that of the first beads."""
    best = np.full(n, -1)
    for k in range(len(pairs)):
        for place in range(2):
            i, other = pairs[k, place], pairs[k, 1 - place]
            b = best[i]
            if b < 0 or r[k] < r[b] or (r[k] == r[b] and other < pairs[b, 0] + pairs[b, 1] - i):
                best[i] = k
    chosen = np.zeros(len(pairs), np.bool_)
    for k in range(len(pairs)):
        chosen[k] = best[pairs[k, 0]] == k and best[pairs[k, 1]] == k
    return chosen


def _later(slow: SlowForces, done: int, m: Moment, more: int) -> np.ndarray:
    return slow(m, done + more)


class ReactingLoop(StepLoop):
    """Does steps in which bonds form and break, after the last drift of a step: forces at the new positions have the new bonds."""

    def __init__(self, spec: StepSpec, engine: Any, watch: Watch, reach: float):
        super().__init__(spec, engine, watch, reach)
        self._bonds: BondsSpec = spec.reactions
        self._sorts = len(self._bonds.sorts) - len(self._bonds.bent)
        self._drifts = sum(letter == "A" for letter, _ in spec.letters)
        self._shown: np.ndarray | None = None
        self._due, self._step, self._left, self._drifted = False, 0, 0, 0
        self.events: list[Event] | None = None  #: Those of the present run, if somebody wants them
        self._lists = {k: self._list(each) for k, each in enumerate(self._bonds.reactions) if each.model.forms}
        self.show(self._bonds.initial)

    def _list(self, each: ReactionSpec) -> PairList:
        roles, alike = each.role_of[self._bonds.types], not (each.role_of == 1).any()
        reach = each.model.within * np.array([[alike, not alike, 0.0], [not alike, 0.0, 0.0], [0.0, 0.0, 0.0]])
        roles = roles if self._bonds.turns else np.where(roles == 2, -1, roles).astype(np.int32)  # others are not even sorted
        pairs = PairList(roles, np.ones(len(roles)), reach, self._bonds.neighbours)
        pairs.slides = self.engine.spec.sheared
        return pairs

    def show(self, table: np.ndarray) -> None:
        """Have the bonds of a table act."""
        if self._shown is not None and np.array_equal(table, self._shown):
            return
        beads, types = [bonds_in(table, k) for k in range(self._sorts)], types_in(table, self._bonds.types, self._sorts)
        later = np.concatenate([np.zeros(0, int), *(each.becomes for each in self._bonds.reactions if each.becomes is not None)])
        alien = not np.isin(-1 - self._sorts - table[table < -self._sorts], later[later >= 0]).all()
        if alien or np.count_nonzero(table > 0) != 2 * sum(map(len, beads)):
            what = "types" if alien else "bonds"
            raise RunError(f"the state has {what} that this scene's reactions cannot make: a script with others wrote it")
        beads += [beads_of(table, self._bonds.start) for beads_of in self._bonds.bent]
        self._shown, factors = None, self._bonds.factors  # until all have them
        apart = None if factors is None else exceptions_in(table, self._bonds.stays, factors)
        acting = types if self._bonds.turns else None
        self.engine.set_bonds(beads, apart, acting)
        self.valid.take()
        if self._seats is not None:
            self._seats.set_bonds(beads, apart, acting)
        if factors is not None:  # in LAMMPS, too, beads that had no pair terms before a step are not bonded in it
            gone = exceptions_in(table, self._bonds.stays, (0.0, *(float(factor != 0.0) for factor in factors[1:])))
            for pairs in self._lists.values():
                pairs.leave_out(gone)
        self._shown = table.copy()

    def run(self, moment: Moment, n: int, slow: SlowForces | None = None) -> None:
        """See :meth:`.moment.Stepper.run`."""
        begun, done = moment.number, 0
        self.show(moment.bonds)  # type: ignore[arg-type]  # there are some
        try:
            while done < n:
                wait = min(each.model.until(begun + done) for each in self._bonds.reactions)
                piece = min(n - done, wait)
                self._due, self._step = piece == wait, begun + done + piece  # a moment does not count steps with seats
                super().run(moment, piece, None if slow is None else partial(_later, slow, done))
                done += piece
                moment.number = begun + done
        except RunError as error:
            error.steps_done = done + getattr(error, "steps_done", 0)  # type: ignore[attr-defined]
            raise

    def carry_out(self, moment: Moment, n: int, slow: SlowForces | None = None, given: bool = False, already: int = 0) -> None:
        self._left, self._drifted = n, 0
        super().carry_out(moment, n, slow, given, already)

    def _count(self, m: Moment, steps: int) -> None:
        super()._count(m, steps)
        self._left, self._drifted = self._left - steps, 0

    def _reflect(self, m: Moment, *velocities: np.ndarray) -> None:
        super()._reflect(m, *velocities)
        self._drifted += 1
        if self._drifted == self._drifts:
            self._react(m)

    def _accelerate(self, m: Moment, v: np.ndarray, values: np.ndarray | None, kick: float) -> None:
        if kick:  # all beads have drifted, and have been put where they belong
            self._react(m)
        super()._accelerate(m, v, values, kick)

    def _react(self, m: Moment) -> None:
        """Try what is due at the end of a step."""
        if not self._due or self._left != 1:
            return
        assert m.bonds is not None
        numbers = m.numbers[-3 * len(self._bonds.reactions) :].reshape(-1, 3)
        before = m.bonds.copy()
        m.counter += 1
        for k, each in enumerate(self._bonds.reactions):
            if each.model.until(self._step - 1) == 1:
                pairs, r, changes = self._tried(m, before, k, each)
                numbers[k] += np.count_nonzero(changes > 0), np.count_nonzero(changes < 0), 0
                numbers[k, 2] = np.count_nonzero(changes)
                if self.events is not None and numbers[k, 2]:
                    energies = changes * each.model.bonds.curve(r)[0]
                    rows = zip(changes.tolist(), *pairs.T.tolist(), r.tolist(), energies.tolist(), strict=True)
                    self.events += [Event(self._step, k, *row) for row in rows if row[0]]
        self.show(m.bonds)

    def _tried(self, m: Moment, before: np.ndarray, k: int, each: ReactionSpec) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Pairs (B, 2), their distances, and what has been done to them; bonds that were not there ``before`` these trials do not break."""
        table: Any = m.bonds
        model, sort, key, left = each.model, each.sort, noise_key(m.seed, m.counter, _LAYER + k, m.kT), 0
        counts, types = counts_in(table, sort), types_in(table, self._bonds.types, self._sorts)
        roles = each.role_of[types]
        valences = each.valences[roles]
        if model.forms:
            self._lists[k].set_types(roles)
            self._lists[k].build(m.x, m.box)
            its, turns, chance = self._lists[k].arrays, model.energy is not None, float(model.chance(m.dt))
            where = its.order, its.pi, its.pj, its.geometry[3], its.start, its.found
            pairs, r = candidates(*where, table, counts, valences, sort, turns, key, chance, model.within)
            if model.molecules is not None:
                fit = (model.molecules[pairs[:, 0]] == model.molecules[pairs[:, 1]]) == model.inside
                pairs, r = pairs[fit], r[fit]
            if turns:
                wanted = uniforms(key, pairs, 1) * (1.0 + model.weight(r, m.kT)) < 1.0
                return pairs, r, turn(table, counts, valences, pairs, wanted, sort, left)
            if model.between is not None:
                others = (oldest_bonds if model.first else bonds_now)(table, self._bonds.stays)
                fit = in_angles(others, pairs, m.x, m.box, model.between)
                pairs, r = pairs[fit], r[fit]
            chosen = mutual(len(table), pairs, r) & (uniforms(key, pairs, 1) < chance)
        else:
            pairs, left = bonds_in(np.where(table == before, table, 0), sort), -1 - sort if model.spends else 0
            r = np.linalg.norm(minimum_images(m.x[pairs[:, 0]] - m.x[pairs[:, 1]], m.box), axis=1)
            if model.beyond is not None:
                pairs, r = pairs[r > model.beyond], r[r > model.beyond]
            chosen = uniforms(key, pairs, 1) < model.chance(m.dt, model.faster(r, m.kT))
            chosen &= model.beyond is None or mutual(len(table), pairs, -r)
        pairs, r = pairs[chosen], r[chosen]
        changes = turn(table, counts, valences, pairs, np.full(len(pairs), model.forms), sort, left)
        if each.becomes is not None:
            full = np.array([i for i in pairs[changes > 0].ravel().tolist() if counts[i] == valences[i]], np.int64)
            full = full[each.becomes[roles[full]] >= 0]
            set_types(table, full, each.becomes[roles[full]], self._sorts)
        return pairs, r, changes


def step_loop(spec: StepSpec, engine: Any, watch: Watch, reach: float) -> StepLoop:
    """The loop over steps of engines that work on arrays."""
    return (StepLoop if spec.reactions is None else ReactingLoop)(spec, engine, watch, reach)
