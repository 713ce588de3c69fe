"""Whole steps on the kernel's own arrays: n of them in a loop, without a way back to OpenMM in between.

A step is a word of drifts, kicks and sweeps (see :mod:`openmm_dpd.schemes`), or the modified velocity Verlet scheme, whose
friction is a force.  What a step begins with has passed through OpenMM's positions if a program made it, as ((x + s a) - x)/s; here it
is rounded so before each step, so that a run gives the same bits however it is cut.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np

from ..errors import RunError
from ..names import ACCELERATION, PREDICTED, RATES, SHOWN, VELOCITY
from . import motion
from .engine import CONSERVATIVE, DISSIPATIVE, RANDOM, PairEngine
from .sweeps import EXACT, SHARDLOW

#: Pair updates of the letters that sweep.
UPDATES = {"O": EXACT, "S": SHARDLOW}


@dataclass(frozen=True, eq=False)
class Walls:
    """Planes that beads do not pass, as three values each, one for every axis (see :mod:`openmm_dpd.programs.walls`)."""

    low: np.ndarray
    high: np.ndarray
    start: np.ndarray
    period: np.ndarray
    back: np.ndarray


@dataclass(frozen=True)
class Ramp:
    """Thermal energy from ``start`` to ``stop`` between two steps."""

    start: float
    stop: float
    begin: int
    end: int

    def at(self, steps: float) -> float:
        """Thermal energy after some steps; as :func:`openmm_dpd.programs.program.ramp_expression` has it, to the bit."""
        return self.start + (self.stop - self.start) * min(1.0, max(0.0, (steps - self.begin) * (1.0 / (self.end - self.begin))))


@dataclass(frozen=True, eq=False)
class StepSpec:
    """What a step is, as far as it never changes.

    Attributes
    ----------
    letters : tuple of (letter, part of the step)
        Empty for the modified velocity Verlet scheme.
    mass : (N,) array
        0 for beads that do not move.
    slow_kicks : (float, float)
        Over how many steps forces that are not the kernel's kick before and after.
    slow_every : int
        How many steps lie between the two.
    thermostat : bool
        Whether there is friction or noise.
    lam, field_lam : float
        Weights of the prediction of velocities and of fields in that scheme.
    walls : Walls or None
    ramp : Ramp or None
    field_shown : float
        Displacement by which a program shows a field, or a rate, of 1.
    """

    letters: tuple[tuple[str, float], ...]
    mass: np.ndarray
    slow_kicks: tuple[float, float] = (0.5, 0.5)
    slow_every: int = 1
    thermostat: bool = True
    lam: float = 0.5
    field_lam: float = 0.5
    walls: Walls | None = None
    ramp: Ramp | None = None
    field_shown: float = 1.0

    @property
    def predicts(self) -> bool:
        """Whether friction is a force of a predicted velocity."""
        return not self.letters


@dataclass(eq=False)
class Moment:
    """What a step begins with; :meth:`StepLoop.run` changes it in place.

    Attributes
    ----------
    x, v : (N, 3) arrays
        Positions and velocities; beads that do not move have the velocity 0.
    box : (3, 3) array or None
    dt : float
        Step size.
    kT : float
        Thermal energy.
    seed, counter : int
        Key of the noise.
    ramped : float or None
        Steps done, for a temperature ramp that the loop follows; None where somebody else has seen to it.
    slow_step : int
        Steps done since forces that are not the kernel's kicked.
    values, rates : (N, K) arrays or None
        Fields and, if friction is a force, their changes per time.
    acc : (N, 3) array or None
        Acceleration at x if friction is a force; None to have it computed.
    predicted : (N, 3) array or None
        Velocities that friction saw last, if they are not those of the half step.
    """

    x: np.ndarray
    v: np.ndarray
    box: np.ndarray | None
    dt: float
    kT: float
    seed: int
    counter: int
    ramped: float | None = None
    slow_step: int = 0
    values: np.ndarray | None = None
    rates: np.ndarray | None = None
    acc: np.ndarray | None = None
    predicted: np.ndarray | None = None

    def block(self, block: int) -> np.ndarray:
        """(N, 3) values of a block, as a program numbers them (see :mod:`openmm_dpd.names`)."""
        arrays = {VELOCITY: self.v, ACCELERATION: self.acc, PREDICTED: self.predicted}
        if block in arrays:
            found = arrays[block]
            assert found is not None
            return found
        values = self.values if block < RATES else self.rates
        assert values is not None
        first = 3 * (block if block < RATES else block - RATES)
        part = values[:, first : first + 3]
        result = np.zeros((len(part), 3))
        result[:, : part.shape[1]] = part
        return result


@dataclass(eq=False)
class StepLoop:
    """Carries out steps with one engine.

    Attributes
    ----------
    watch : callable
        (velocities, moment) -> None; raises RunError if beads run away.
    """

    spec: StepSpec
    engine: PairEngine
    watch: Callable[[np.ndarray, Moment], None]
    force: np.ndarray = field(init=False)

    def __post_init__(self):
        pairs = self.engine.spec
        self.inv_mass = pairs.inv_mass
        self.still = np.flatnonzero(self.inv_mass == 0.0)
        self.force = np.zeros((len(pairs.types), 3))
        #: which list of the engine the force belongs to
        self.forced = -1

    def run(self, moment: Moment, n: int, slow: Callable[[Moment, int], np.ndarray] | None = None, *, shown: bool = False) -> None:
        """Carry out n steps.

        Parameters
        ----------
        moment : Moment
            Its fields are as a program would have shown them.
        n : int
        slow : callable, optional
            Forces (N, 3) at the positions of the moment, after so many of these steps, that kick before and after.
        shown : bool
            Whether a program has shown the moment and makes it kick.

        Raises
        ------
        RunError
            If a step fails; ``steps_done`` is how many were complete, and the moment is worth nothing.
        """
        step = self._predicting if self.spec.predicts else self._word
        before, after = self.spec.slow_kicks
        done = 0
        try:
            force = None
            for done in range(n):
                if slow is not None and moment.slow_step == 0 and before:
                    force = slow(moment, done) if force is None else force
                    motion.push(moment.v, force, self.spec.mass, before * moment.dt)
                if done or not shown:
                    self.show(moment, fields=done > 0)
                step(moment)
                if shown:
                    continue
                moment.slow_step = (moment.slow_step + 1) % self.spec.slow_every
                if slow is not None and moment.slow_step == 0:
                    force = slow(moment, done + 1) if after or done + 1 < n else None
                    if after:
                        motion.push(moment.v, force, self.spec.mass, after * moment.dt)
        except RunError as error:
            error.steps_done = done  # type: ignore[attr-defined]
            raise

    def show(self, moment: Moment, *, fields: bool) -> None:
        """Round what a step begins with as if a program had shown it, with or without the fields."""
        spec, x = self.spec, moment.x
        motion.as_shown(x, moment.v, SHOWN, self.inv_mass)
        if moment.values is not None and fields:
            self.show_columns(x, moment.values, spec.field_shown)
        if spec.predicts:
            if moment.acc is not None:
                motion.as_shown(x, moment.acc, SHOWN, self.inv_mass)
            if moment.rates is not None:
                self.show_columns(x, moment.rates, spec.field_shown)

    def show_columns(self, x: np.ndarray, values: np.ndarray, scale: float) -> None:
        """The same for values of beads; those of immobile ones are not shown."""
        for k in range(values.shape[1]):
            motion.column_as_shown(x, values, k % 3, k, scale, self.inv_mass)

    # -- words -------------------------------------------------------------------------------------------------------------------
    def _word(self, m: Moment) -> None:
        first = True
        for letter, part in self.spec.letters:
            if letter == "A":
                self._drift(m, part * m.dt)
            elif letter == "B":
                self._conserve(m)
                motion.kick(m.v, self.force, self.inv_mass, part * m.dt)
            else:
                if first:
                    self._warm(m)
                    self.watch(m.v, m)
                    first = False
                self._sweep(m, part, UPDATES[letter])
        if first:
            self._warm(m)

    def _drift(self, m: Moment, time: float) -> None:
        motion.drift(m.x, m.v, self.inv_mass, time)
        self._reflect(m, m.v)

    def _reflect(self, m: Moment, *velocities: np.ndarray) -> None:
        walls = self.spec.walls
        if walls is not None:
            # the last one puts the positions back
            for k, v in enumerate(velocities):
                motion.reflect(
                    m.x, v, self.inv_mass, walls.low, walls.high, walls.start, walls.period, walls.back, k == len(velocities) - 1
                )

    def _conserve(self, m: Moment) -> None:
        """Conservative force at x, unless it is there already."""
        self.engine.prepare(m.x, m.box)
        if self.forced != self.engine.number:
            self.engine.forces(CONSERVATIVE, None, 0.0, 1.0, 0, 0, m.values, self.force)
            self.forced = self.engine.number

    def _sweep(self, m: Moment, part: float, update: int) -> None:
        self.engine.prepare(m.x, m.box)
        m.counter += 1
        self.engine.swept(m.v, m.kT, part * m.dt, m.seed, m.counter, m.values, m.v, update)
        if len(self.still):
            m.v[self.still] = 0.0
        if m.values is not None:
            m.values += np.where(self.inv_mass[:, None] > 0.0, self.engine.flow, 0.0)

    def _warm(self, m: Moment) -> None:
        """The thermal energy of this step."""
        if self.spec.ramp is not None and m.ramped is not None and self.spec.thermostat:
            m.ramped += 1.0
            m.kT = self.spec.ramp.at(m.ramped)

    # -- modified velocity Verlet ----------------------------------------------------------------------------------------------------
    def _predicting(self, m: Moment) -> None:
        lam, dt = self.spec.lam, m.dt
        if m.acc is None:
            # with the noise of the last half kick: another one would halve its variance, as both halves of a step share it
            self._accelerate(m, m.v, m.values)
        assert m.acc is not None
        predicted = None if lam == 0.5 else m.v + lam * dt * m.acc
        seen = m.values
        if m.values is not None:
            assert m.rates is not None
            before = m.values
            m.values = before + 0.5 * dt * m.rates
            seen = m.values if self.spec.field_lam == 0.5 else before + self.spec.field_lam * dt * m.rates
        motion.half_kick(m.v, m.acc, 0.5 * dt)
        motion.drift(m.x, m.v, self.inv_mass, dt)
        self._reflect(m, *((m.v,) if predicted is None else (predicted, m.v)))
        self._warm(m)
        m.counter += 1
        v = m.v if predicted is None else predicted
        self.watch(v, m)
        self._accelerate(m, v, seen)
        motion.half_kick(m.v, m.acc, 0.5 * dt)
        if m.values is not None:
            assert m.rates is not None
            m.values += 0.5 * dt * m.rates
        m.predicted = predicted

    def _accelerate(self, m: Moment, v: np.ndarray, values: np.ndarray | None) -> None:
        """Acceleration and rates at x, friction and noise included."""
        self.engine.prepare(m.x, m.box)
        which = CONSERVATIVE | DISSIPATIVE | RANDOM
        self.engine.forces(which, v, m.kT, m.dt, m.seed, m.counter, values, self.force)
        m.acc = np.empty_like(self.force) if m.acc is None else m.acc
        motion.accelerate(m.acc, self.force, self.inv_mass)
        if values is not None:
            m.rates = np.where(self.inv_mass[:, None] > 0.0, self.engine.rates, 0.0)


__all__ = ["Moment", "Ramp", "StepLoop", "StepSpec", "Walls"]
