"""Steps with beads in the order of the cells they are in, so that what a thread works on lies together."""

from dataclasses import replace
from typing import Any

import numpy as np

from ..base.errors import RunError
from .interface import Engine
from .moment import Moment


class Seats:
    """Does parts of a run with a loop of its own, a :class:`.steps.StepLoop`.  All its arrays of beads stay where they are, so that what
    the loop has recorded can be played again when beads change seats."""

    def __init__(self, loop: Any):
        self.loop = loop
        beads = len(loop.inv_mass)
        self._room = np.empty((beads, 3)), np.empty((beads, 3)), np.empty((beads, 3))
        loop.inv_mass, loop.inv_mass_3 = loop.inv_mass.copy(), loop.inv_mass_3.copy()

    def run(self, m: Moment, n: int, engine: Engine) -> int:
        """Do n steps; returns n, or 0 if they failed.  ``engine`` is that of the run, which has seen its beads."""
        loop = self.loop
        names = (loop.engine if loop.engine.number else engine).sorted_beads()
        loop.engine.body_scale = engine.body_scale
        there = self._seat(m, names)
        try:
            loop.carry_out(there, n, None)
        except RunError:  # it is to be said with the numbers of the beads
            return 0
        m.x[names], m.v[names] = there.x, there.v
        if there.acc is not None:
            m.acc = np.empty_like(there.acc) if m.acc is None else m.acc
            m.acc[names] = there.acc
        m.counter, m.time, m.slow_step, m.ramped, m.kT = there.counter, there.time, there.slow_step, there.ramped, there.kT
        return n

    def _seat(self, m: Moment, names: np.ndarray) -> Moment:
        """A moment with the bead of number ``names`` (N,) in each row."""
        loop = self.loop
        loop.engine.seat(names)
        loop.forced = -1
        np.take(loop.engine.spec.inv_mass, names, out=loop.inv_mass)
        loop.inv_mass_3.reshape(-1, 3)[...] = loop.inv_mass[:, None]
        x, v, acc = self._room
        for given, out in zip((m.x, m.v, m.acc), self._room, strict=True):
            if given is not None:
                np.take(given, names, axis=0, out=out)
        return replace(m, x=x, v=v, acc=None if m.acc is None else acc)
