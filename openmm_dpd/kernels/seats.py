"""Steps with beads in the order of the cells they are in, so that what a thread works on lies together."""

import math
from dataclasses import replace
from typing import Any

import numpy as np

from ..base.errors import RunError
from .moment import Moment
from .motion import take_rows

#: Beads are put in order again when one of thermal velocity could have gone so many times as far as is watched, and after no fewer and
#: no more steps than these.
RESEATED, SOONEST, LATEST = 3.0, 10, 200


class Seats:
    """Does parts of a run with a loop of its own, a :class:`.steps.StepLoop`.  All its arrays of beads stay where they are, so that what
    the loop has recorded can be played again when beads change seats."""

    def __init__(self, loop: Any):
        self.loop = loop
        self._room: dict[str, np.ndarray] = {}
        #: the bead in each seat, the seat of each bead, and how many steps they have done there
        self._names, self._places, self._steps = np.zeros(0, np.uint32), np.zeros(len(loop.inv_mass), np.uint32), 0
        loop.inv_mass = loop.inv_mass.copy()

    def run(self, m: Moment, n: int, main: Any, given: bool) -> tuple[int, bool] | None:
        """Do up to n steps for the loop of a run, ``main``, whose engine has seen its beads; ``given``: its force is that at the positions
        of the moment.  Returns how many were done, and whether its force is that at the positions after them; None if they failed."""
        loop, seated = self.loop, self._longest(m)
        n = min(n, seated)
        if not len(self._names) or self._steps + n // 2 > seated:
            self._seat(main.engine)
        there = replace(m, **{name: self._room.setdefault(name, np.empty_like(rows)) for name, rows in m.arrays.items()})  # type: ignore[arg-type]
        for rows, out in zip(m.arrays.values(), there.arrays.values(), strict=True):
            take_rows(out, rows, self._names)
        if given:
            take_rows(loop.force, main.force, self._names)
        loop.engine.body_scale = main.engine.body_scale
        try:
            loop.carry_out(there, n, None, given)
        except RunError:  # it is to be said with the numbers of the beads
            return None
        self._steps += n
        if there.acc is not None and m.acc is None:
            m.acc = np.empty_like(there.acc)
        given = loop.has_force
        main.forced = -1
        for rows, out in zip(there.arrays.values(), m.arrays.values(), strict=True):
            take_rows(out, rows, self._places)
        if given:
            take_rows(main.force, loop.force, self._places)
        m.counter, m.time, m.slow_step, m.ramped, m.kT = there.counter, there.time, there.slow_step, there.ramped, there.kT
        return n, given

    def _longest(self, m: Moment) -> int:
        """For so many steps beads keep their seats."""
        going = m.dt * self.loop.slowest * math.sqrt(m.kT)
        return int(min(max(SOONEST, RESEATED * self.loop.reach / going), LATEST)) if going else LATEST

    def _seat(self, engine: Any) -> None:
        """Give the beads seats, in the order of their cells; ``engine`` is that of the run."""
        loop = self.loop
        names = (loop.engine if loop.engine.number else engine).sorted_beads()
        self._names = names[:0]  # until all are seated
        self._places[names] = np.arange(len(names), dtype=names.dtype)
        loop.engine.seat(names, self._places)
        np.take(loop.engine.spec.inv_mass, names, out=loop.inv_mass)
        if len(loop.inv_masses) > 1:
            loop.inv_masses.reshape(-1, 3)[...] = loop.inv_mass[:, None]
        loop.forced, self._names, self._steps = -1, names, 0
