"""Measuring within a run: steps that are looked at are done, and played, as all others, and what their kernels found is read afterwards.

This is for plain scenes: the kernel has all forces, and they are those of pairs.  All other samples are taken of a Context, between runs.
"""

import sys
from collections.abc import Callable, Iterator, Sequence
from itertools import accumulate, repeat
from typing import NamedTuple

import numpy as np
import openmm

from ..base.openmm_private import bare
from ..base.signals import unbroken
from ..kernels import motion
from ..kernels.layer import DISSIPATIVE, STRESS
from ..kernels.moment import Moment
from ..runtime import Tape
from .present import Present


class Row(NamedTuple):
    """What was found at one step: moments (:func:`.motion.moments`), and sums over pairs, which are energy, virial, virial of friction,
    Laplacian, and virial of conservative forces."""

    number: int
    time: float
    sums: list[float]  #: That came with the forces
    stress: np.ndarray  #: (6,) with these sums, if it was asked for
    moving: list[float]  #: Moments of the masses and velocities
    on_step: list[float]  #: The same, of velocities at the time of the positions
    pushed: list[float]  #: Moments of 1/masses and conservative forces, where the kinetic stress needs them
    slopes: list[float]  #: Moments of the conservative forces on mobile beads, in a sample
    friction: list[float]  #: Sums of friction, where it is no force, in a sample
    tensors: np.ndarray  #: (2, 6) and ``affine``: what :meth:`.present.Present.tensors` returns, if it was asked for
    affine: float


class Within:
    """What is measured at steps of a run: ``more`` is summed with the forces; ``sample``: what a :class:`.sample.Sample` has is measured;
    ``tensors``: what :meth:`.present.Present.tensors` returns is."""

    def __init__(self, present: Present, masses: np.ndarray, more: int, sample: bool = False, tensors: bool = False):
        self.present, self._masses, self.more, self._sample, self._tensors = present, masses, more, sample, tensors
        self._scheme, self._inv_mass = present.plan.options.scheme, present.plan.spec.inv_mass
        self._counted, self._components = (present.mass > 0).astype(float), np.repeat(self._inv_mass, 3)
        self._resting = (masses > 0) & (self._inv_mass == 0)  #: Beads that count, but whose velocities the loop takes as 0
        self._v, self._force = np.zeros((2, len(masses), 3))

    def run(self, context: openmm.Context, first: int, every: int, end: int, take: Callable[[Row], None]) -> bool:
        """Step the Context to step ``end``, and have what is found at the steps ``first``, ``first + every``, ... before it taken, if that
        can be measured within a run; otherwise do nothing, and return False."""
        integrator, loop = context.getIntegrator(), self.present.loop
        if loop is None or not integrator.whole or integrator.whole.function.thread_state().loop is not loop:
            return False  # another System, or a copy of the integrator, does the steps
        integrator.look_at(context)  # what has changed since the last step: forces, barostats, the state
        state = self.present.look(context)
        acted = integrator.whole.guide is not None or integrator.beside
        if acted or not self.present.plain or self.present.v[self._resting].any():
            return False
        self._first, self.every, self._end, begun = first, every, end, state.getStepCount()
        #: numbers of S steps, and all that was noted in each of them, (S, ...); the sums that came with the forces are first
        self.found: list[tuple[Sequence[int], list[np.ndarray]]] = []
        times = list(accumulate([self.present.dt] * (end - begun), initial=bare(state.getTime())))
        loop.looks = self
        try:
            integrator.step(end - begun)
        finally:
            loop.looks, reached = None, context.getStepCount()
            with unbroken():  # rows that wait are not lost
                for numbers, found in self.found:
                    for row in self._rows(numbers, found, times[numbers[0] - begun :: every]):
                        if row.number <= reached:  # steps of a call that has failed are taken back
                            take(row)
        return True

    def kinetic_stress(self, row: Row) -> np.ndarray:
        """(6,) kinetic part of the stress, see :meth:`.present.Present.kinetic_stress`."""
        moments = iter((row.on_step, row.pushed))
        return self.present.kinetic_stress(self._v, self._force, lambda *_: np.array(next(moments)[:6]))

    def until(self, number: int) -> int:
        """Steps from this one to the next at which something is measured."""
        wait = max(self._first - number, (self._first - number) % self.every)
        return wait if number + wait < self._end else sys.maxsize

    def played(self, number: int, steps: int, tape: Tape, until: int, every: int, room: list[np.ndarray]) -> None:
        """Steps from ``number`` on were played, and some left in ``room`` what a tape has noted, see :meth:`.Tape.play`."""
        if numbers := range(number + until, number + steps, every):
            self.found.append((numbers, [each[: len(numbers)] for each in room]))

    def take(self, m: Moment, force: np.ndarray, tape: Tape, number: int) -> None:
        """Measure step ``number``, at the positions of a moment and with the conservative force (N, 3) there, while a tape records."""
        self._measure(m, force)
        self.found.append(([number], [each[None].copy() for each in tape.noted]))

    def _measure(self, m: Moment, force: np.ndarray) -> None:
        """Call the kernels."""
        loop, v = self.present.loop, m.v
        assert loop is not None
        motion.moments(self._masses, v)
        if self._scheme.lag:
            v = self._v
            motion.see(m.v, self._inv_mass, m.v, v)
            motion.move(self._force.ravel(), v.ravel(), force.ravel(), self._components, self._scheme.lag * m.dt, 0.0, np.inf)
            motion.moments(self._masses, v)
        if self.present.corrected:
            motion.moments(self._inv_mass, force)
        if self._sample:
            motion.moments(self._counted, force)
            if not self._scheme.predicts:
                loop.engine.sums(DISSIPATIVE, v, m.kT, m.dt, m.seed, m.counter, None, self._force)
        if self._tensors:
            loop.engine.tensors(v, m.kT)

    def _rows(self, numbers: Sequence[int], found: list[np.ndarray], times: list[float]) -> Iterator[Row]:
        """What was found at steps of these numbers."""
        arrays = iter(found)

        def totals(tensors: int) -> tuple[np.ndarray, np.ndarray]:
            """Sums (S, 5) over the pairs of all layers, and so many tensors (S, tensors, 6)."""
            sums, stress = np.zeros((len(numbers), 5)), np.zeros((len(numbers), tensors, 6))
            for _ in self.present.plan.layers:
                sums += next(arrays)
                stress += next(arrays).reshape(len(numbers), tensors, -1, 6).sum(axis=2) if tensors else 0.0
            return sums, stress

        def one_if(asked: bool):
            return next(arrays).tolist() if asked else repeat(None)

        sums, stress = totals(int(self.more & STRESS > 0))
        moving = one_if(True)
        on_step, pushed, slopes = one_if(True) if self._scheme.lag else moving, one_if(self.present.corrected), one_if(self._sample)
        friction = totals(0)[0].tolist() if self._sample and not self._scheme.predicts else repeat(None)
        affine, tensors = totals(2) if self._tensors else (sums, repeat(None))
        all_stress = stress[:, 0] if self.more & STRESS else repeat(None)
        return map(
            Row, numbers, times, sums.tolist(), all_stress, moving, on_step, pushed, slopes, friction, tensors, affine[:, 0].tolist()
        )
