"""Steps with the beads in the order of their cells, so that the beads a thread works on lie together in memory."""

import math
from dataclasses import replace
from typing import Any

import numpy as np

from ..base.errors import RunError
from .moment import Moment
from .motion import take_rows

#: Beads are sorted again when one of thermal velocity could have moved RESEATED times the distance that the loop watches, but after SOONEST
#: steps at the earliest and LATEST at the latest.
RESEATED, SOONEST, LATEST = 3.0, 10, 200


class Seats:
    """Does parts of a run with a :class:`.steps.StepLoop` of its own.  A seat is a row of its arrays; these stay where they are in memory
    when beads change seats, so the loop can go on playing a recorded step."""

    def __init__(self, loop: Any):
        self.loop = loop
        #: arrays of the loop, and copies of their contents from when beads last changed seats
        self._room: dict[str, np.ndarray] = {}
        self._before: dict[str, np.ndarray] = {}
        self._spare = np.empty_like(loop.force)
        #: the bead in each seat, the seat of each bead, and the number of steps since they were seated
        self._names, self._places, self._steps = np.zeros(0, np.uint32), np.zeros(len(loop.force), np.uint32), 0

    def run(self, m: Moment, n: int, main: Any, given: bool) -> tuple[int, bool]:
        """Do n steps for ``main``, the loop of the run, whose engine has placed its beads; ``given`` says whether its force is that at the
        positions of the moment.

        Returns how many steps were done, and whether the force of ``main`` is that at the positions after them.  If a step fails, the
        moment is that of the last change of seats: ``main`` repeats the steps since, and its error message has the numbers of the beads.
        """
        loop, done, has_force = self.loop, 0, given
        if not len(self._names):
            self._seat(main.engine.sorted_beads())
        there, kept, done_then = _like(m, self._room), None, 0
        _take(m, there, self._names, (main.force, loop.force) if given else None)
        loop.engine.body_scale = main.engine.body_scale
        try:
            while done < n:
                longest = self._longest(there)
                steps = min(n - done, longest)
                if self._steps + steps // 2 > longest and loop.engine.number:
                    kept, done_then = self._change(there, has_force), done
                loop.carry_out(there, steps, None, has_force)
                done, self._steps, has_force = done + steps, self._steps + steps, loop.has_force
        except RunError:
            if kept is None:
                return 0, given
            there, done, has_force = kept, done_then, False
        if there.acc is not None and m.acc is None:
            m.acc = np.empty_like(there.acc)
        main.valid.lose_force()
        _take(there, m, self._places, (loop.force, main.force) if has_force else None)
        m.counter, m.time, m.slow_step, m.ramped, m.kT = there.counter, there.time, there.slow_step, there.ramped, there.kT
        return done, has_force

    def _longest(self, m: Moment) -> int:
        """Number of steps for which beads keep their seats."""
        going = m.dt * self.loop.masses.slowest * math.sqrt(m.kT)
        return int(min(max(SOONEST, RESEATED * self.loop.reach / going), LATEST)) if going else LATEST

    def _change(self, m: Moment, has_force: bool) -> Moment:
        """Seat the beads in the order of their present cells; returns a copy of the moment in these seats, to come back to."""
        names, kept = self.loop.engine.sorted_beads(), _like(m, self._before)
        force = self.loop.force, self._spare
        self._names = names[:0]  # none are, until all are
        _take(m, kept, self._places[names], force if has_force else None, back=True)
        self._seat(names)
        return kept

    def set_bonds(self, beads: list[np.ndarray], exceptions: Any = None, types: np.ndarray | None = None) -> None:
        """See :meth:`.interface.Engine.set_bonds`."""
        self.loop.engine.set_bonds(beads, exceptions, types)
        if len(self._names):
            self.loop.engine.seat(self._names, self._places)
        self.loop.valid.take()

    def _seat(self, names: np.ndarray) -> None:
        """Give each bead a seat, in the order of these numbers (N,)."""
        loop = self.loop
        self._places[names] = np.arange(len(names), dtype=names.dtype)
        loop.engine.seat(names, self._places)
        loop.masses.seat(loop.engine.spec.inv_mass, names)
        loop.valid.lose_force()
        self._names, self._steps = names, 0


def _like(m: Moment, room: dict[str, np.ndarray]) -> Moment:
    """A copy of a moment whose arrays are those of ``room``, made where they are missing; their contents are not copied."""
    its = m.arrays | m.beside
    for name, rows in its.items():
        if name not in room:
            room[name] = np.empty_like(rows)
    return replace(m, **{name: room[name] for name in its})  # type: ignore[arg-type]


def _take(m: Moment, to: Moment, names: np.ndarray, forces: tuple[np.ndarray, np.ndarray] | None, back: bool = False) -> None:
    """Copy the rows ``names`` (N,) of all arrays of a moment, in this order, to those of another one, and of the first of two forces to the
    second.  With ``back`` the first moment and force then get the rows in this order, too."""
    for name, values in m.beside.items():
        to.beside[name][...] = values
    take_rows([*zip(m.arrays.values(), to.arrays.values(), strict=True), *([forces] if forces else [])], names, back)
