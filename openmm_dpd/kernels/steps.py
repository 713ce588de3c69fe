"""Whole steps on the kernel's own arrays: n of them in a loop, without a way back to OpenMM in between.

A step is a word of drifts, kicks and sweeps (see :mod:`openmm_dpd.model.schemes`), or the modified velocity Verlet scheme, whose
friction is a force.  All that a step begins with is in the :class:`Moment`, so that a run gives the same bits however it is cut.
"""

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any, NamedTuple, Protocol

import numpy as np

from ..base.errors import RunError
from ..base.signals import CTRL_C
from . import motion
from .columns import Totals
from .driven import Driven, continuum_push, drag_by_walls, reflect_driven
from .interface import Engine
from .layer import CONSERVATIVE, DISSIPATIVE, LAPLACIAN, RANDOM, STRESS
from .shear import add_flow, rate_at, sheared_box, strain_at
from .sweeps import EXACT, SHARDLOW

#: Pair updates of the letters that sweep.
UPDATES = {"O": EXACT, "S": SHARDLOW}


def ramped_energy(ramp: Any, steps: float) -> float:
    """Thermal energy on a temperature ramp after some steps; as :func:`openmm_dpd.simulation.programs.program.ramp_expression` has it, to
    the bit."""
    part = (steps - ramp.first_step) * (1.0 / (ramp.last_step - ramp.first_step))
    return ramp.kT_start + (ramp.kT_end - ramp.kT_start) * min(1.0, max(0.0, part))


@dataclass(frozen=True, eq=False)
class StepSpec:
    """The part of a step that never changes."""

    letters: tuple[tuple[str, float], ...]  #: (letter, part of the step); empty for the modified velocity Verlet scheme
    slow_kicks: tuple[float, float] = (0.5, 0.5)  #: Over how many steps forces that are not the kernel's kick before and after
    slow_every: int = 1  #: How many steps lie between the two
    thermostat: bool = True  #: Whether there is friction or noise
    lam: float = 0.5  #: Weight of the prediction of velocities in that scheme
    field_lam: float = 0.5  #: Weight of that of fields
    #: Planes that beads do not pass, five arrays (3,): low, high, start, period, back (see :mod:`openmm_dpd.simulation.programs.walls`).
    walls: tuple[np.ndarray, ...] | None = None
    driven: Driven | None = None  #: The same walls where some move or have something behind them
    ramp: Any = None  #: A TemperatureRamp of the model, or None
    shear: Any = None  #: A LeesEdwards of the model, or None
    tilt: float = 0.0  #: Of the box that a shear begins with

    @property
    def predicts(self) -> bool:
        """Whether friction is a force of a predicted velocity."""
        return not self.letters

    @property
    def foresees(self) -> bool:
        """Whether a kick by slow forces before a step is not just what they add to that prediction; impulses are taken as they are."""
        return self.lam != 0.5 and self.slow_every == 1


@dataclass(eq=False)
class Moment:
    """What a step begins with; :meth:`StepLoop.run` changes it in place."""

    x: np.ndarray  #: (N, 3) positions
    v: np.ndarray  #: (N, 3) velocities; beads that do not move have the velocity 0
    box: np.ndarray | None  #: (3, 3) box vectors
    dt: float  #: Step size
    kT: float  #: Thermal energy
    seed: int  #: Key of the noise, with the counter
    counter: int  #: The other part of the key
    ramped: float | None = None  #: Steps done, for a temperature ramp that the loop follows; None where the caller follows it
    slow_step: int = 0  #: Steps done since forces that are not the kernel's kicked
    time: float = 0.0  #: Of the Context, where walls are driven
    #: (3, 2, 3) what walls have taken up of momentum, by axis, side and component, where they are driven
    impulses: np.ndarray | None = None
    values: np.ndarray | None = None  #: (N, K) fields
    rates: np.ndarray | None = None  #: (N, K) their changes per time, if friction is a force
    acc: np.ndarray | None = None  #: (N, 3) acceleration at x if friction is a force; None to have it computed
    predicted: np.ndarray | None = None  #: (N, 3) velocities that friction saw last, if they are not those of the half step
    #: If friction is a force: (N, 3) velocities before the slow forces kicked, where that makes a difference.
    unkicked: np.ndarray | None = None
    sheared: float | None = None  #: Time that has been sheared, which the box vectors belong to; None without a shear


#: Forces (N, 3) of others at the positions of a moment, after so many of the steps that are being done.
SlowForces = Callable[[Moment, int], np.ndarray]


class Stepper(Protocol):
    """Does whole steps with one engine, and keeps what it has computed in the last one."""

    spec: StepSpec
    tensor: bool  #: Whether the forces of last steps are to be summed with their stress tensor, where friction is a force
    parted: bool  #: Whether their conservative forces are to be had apart too, from engines that can

    def run(self, moment: Moment, n: int, slow: SlowForces | None = None) -> None:
        """Do n steps; ``slow`` are forces of others (N, 3), at the positions of the moment, that kick before and after.  RunError if a step
        fails; ``steps_done`` is how many were complete, and the moment is worth nothing."""

    def conserve(self, values: np.ndarray | None, more: int = 0) -> tuple[np.ndarray, Totals]:
        """Conservative force (N, 3) at the positions that were placed last, and its sums, STRESS and LAPLACIAN as well if asked for."""
        ...

    def swept(self, counter: int) -> np.ndarray | None:
        """In a shear: (6,) sum of r J over the sweeps of the last step, if that is the one with this counter of the noise.  J are impulses
        of friction along the lines between beads.  None where friction is a force."""
        ...

    def last(self) -> "LastStep | None":
        """Where friction is a force: what the last step computed, if the engine is still there."""
        ...


class LastStep(NamedTuple):
    """What the last step of a run has computed, where friction is a force."""

    moment: Moment  #: After the step
    force: np.ndarray  #: (N, 3) all forces there
    totals: Totals
    held: np.ndarray | None  #: (N, 3) conservative forces alone, if they were parted: the totals have their Laplacian and virial then


@dataclass(eq=False)
class StepLoop:
    """Does steps with one engine, on its arrays: a :class:`Stepper`."""

    spec: StepSpec
    engine: Engine
    watch: Callable[[np.ndarray, Moment], None]  #: (velocities, moment) -> None; raises RunError if beads run away
    reach: float  #: It is asked where a bead has a component of the velocity with which it would go so far in a step
    force: np.ndarray = field(init=False)

    def __post_init__(self):
        pairs = self.engine.spec
        self.inv_mass, self._inv_mass = pairs.inv_mass, np.repeat(pairs.inv_mass, 3)
        self.still = np.flatnonzero(self.inv_mass == 0.0)
        self.force = np.zeros((len(pairs.types), 3))
        #: which list of the engine the force and its sums belong to: the conservative one, or all where friction is a force
        self.forced, self._summed, self.totals = -1, 0, Totals(0.0, 0.0, 0.0)
        #: the moment after the last step, None where there is none; whether the forces of last steps are summed with their stress tensor
        self.moment: Moment | None = None
        self.tensor = self.parted = False
        self._last, self._held = False, np.zeros((0, 3))
        #: whether conservative forces depend on fields, which may change where positions do not
        self._acting = pairs.fields is not None and pairs.fields.acts
        #: in a shear: what the friction of the last step has passed on, see :meth:`.interface.Engine.passed`
        self.passed: np.ndarray | float = 0.0
        #: whether the lists of the engine are those of the moment's positions
        self.placed = False

    def run(self, moment: Moment, n: int, slow: SlowForces | None = None) -> None:
        """See :meth:`Stepper.run`."""
        step = self._predicting if self.spec.predicts else self._word
        before, after = self.spec.slow_kicks
        done = 0
        try:
            self.moment = None
            self.placed = self.engine.holds(moment.x, moment.box)
            force = None
            for done in range(n):
                CTRL_C.check()
                if slow is not None and moment.slow_step == 0 and before:
                    force = slow(moment, done) if force is None else force
                    if self.spec.predicts and (moment.acc is None or self.spec.foresees):
                        moment.unkicked = moment.v.copy()
                    self._move(moment, force, before * moment.dt)
                self._last = done + 1 == n
                step(moment)
                moment.time += moment.dt
                moment.slow_step = (moment.slow_step + 1) % self.spec.slow_every
                if slow is not None and moment.slow_step == 0:
                    force = slow(moment, done + 1) if after or done + 1 < n else None
                    if after and force is not None:
                        self._move(moment, force, after * moment.dt)
            if self.placed:
                self.engine.keep()
            self.moment = moment
        except RunError as error:
            error.steps_done = done  # type: ignore[attr-defined]
            raise

    def _place(self, m: Moment) -> None:
        """List the pairs at x, unless they are listed."""
        if not self.placed:
            self.engine.place(m.x, m.box)
            self.placed = True

    # -- words -------------------------------------------------------------------------------------------------------------------
    def _word(self, m: Moment) -> None:
        """What lies between two looks at the pairs is done in one pass: kicks wait until then."""
        first, kick, self.passed = True, 0.0, 0.0
        for letter, part in self.spec.letters:
            if letter == "A":
                self._push(m, kick, part * m.dt)
                self._reflect(m, m.v)
                kick = 0.0
            elif letter == "B":
                if kick:
                    self._push(m, kick)
                self._conserve(m)
                kick = part * m.dt
            else:
                if first or kick:
                    fast = self._push(m, kick)
                    kick = 0.0
                if first:
                    self._warm(m)
                    if fast or m.sheared is not None:
                        self.watch(self._seen(m, m.v), m)
                    first = False
                self._sweep(m, part, UPDATES[letter])
        if kick:
            self._push(m, kick)
        if first:
            self._warm(m)

    def _push(self, m: Moment, kick: float, time: float = 0.0) -> int:
        """Kick by the kernel's force at x, which walls are pushed by as well, and drift."""
        walls = self.spec.driven
        if kick and walls is not None and walls.continuum is not None:
            its, taken = walls.continuum, np.zeros(2)
            continuum_push(m.x, its.inv_mass, *its.arguments, taken)
            assert m.impulses is not None
            m.impulses[its.axis, :, its.axis] += kick * taken
        return self._move(m, self.force, kick, time)

    def _move(self, m: Moment, force: np.ndarray, kick: float, time: float = 0.0) -> int:
        """Kick and drift; returns how many beads are to be watched."""
        if time:
            self.placed = False
        flat = m.x.ravel(), m.v.ravel(), force.ravel(), self._inv_mass
        if not time or m.sheared is None:
            return motion.move(*flat, kick, time, self.reach / m.dt)
        before, after = self._shear(m, time)
        if before:
            add_flow(m.v, before, m.x)
        found = motion.move(*flat, kick, time, self.reach / m.dt)
        if after:
            add_flow(m.v, after, m.x)
        return found

    def _shear(self, m: Moment, time: float) -> tuple[float, float]:
        """Slide the images for a time; returns what the rate of the flow changes by before and after beads drift for that time, so that
        those that follow it go on to do so."""
        shear, begin = self.spec.shear, m.sheared
        assert begin is not None and m.box is not None
        m.sheared = end = begin + time
        m.box = sheared_box(m.box, strain_at(shear, end), self.spec.tilt)
        if shear.constant:
            return 0.0, 0.0
        mean = (strain_at(shear, end) - strain_at(shear, begin)) / time
        return mean - rate_at(shear, begin), rate_at(shear, end) - mean

    def _seen(self, m: Moment, v: np.ndarray) -> np.ndarray:
        """Velocities as friction sees them: relative to the flow, if there is one."""
        if m.sheared is None:
            return v
        rate, seen = rate_at(self.spec.shear, m.sheared), v.copy()
        self.engine.set_flow(rate)
        add_flow(seen, -rate, m.x)
        return seen

    def _reflect(self, m: Moment, *velocities: np.ndarray) -> None:
        walls, driven = self.spec.walls, self.spec.driven
        if driven is not None:
            speeds, taken = driven.velocities(m.time + 0.5 * m.dt), np.zeros((3, 2, 3))
            for k, v in enumerate(velocities):
                reflect_driven(m.x, v, self.inv_mass, *walls, speeds, k == len(velocities) - 1, taken)  # type: ignore[misc]
            m.impulses += taken  # type: ignore[operator]
        elif walls is not None:
            # the last one puts the positions back
            for k, v in enumerate(velocities):
                motion.reflect_beads(m.x, v, self.inv_mass, *walls, k == len(velocities) - 1)

    def _conserve(self, m: Moment) -> None:
        """Conservative force at x, unless it is there already."""
        self._place(m)
        self.conserve(m.values)

    def swept(self, counter: int) -> np.ndarray | None:
        """See :class:`Stepper`."""
        there = self.moment is not None and self.moment.counter == counter and self.engine.holds(self.moment.x, self.moment.box)
        return self.passed if there and isinstance(self.passed, np.ndarray) else None

    def last(self) -> LastStep | None:
        """See :class:`Stepper`."""
        if not self.spec.predicts or self.forced != self.engine.number or self.moment is None:
            return None
        return LastStep(self.moment, self.force, self.totals, None if self.totals.conservative is None else self._held)

    def conserve(self, values: np.ndarray | None, more: int = 0) -> tuple[np.ndarray, Totals]:
        """See :class:`Stepper`; what is there already is not computed again, unless it depends on fields."""
        if self._acting or self.forced != self.engine.number or more & ~self._summed:
            self._sum(CONSERVATIVE | more, None, 0.0, 1.0, 0, 0, values)
        return self.force, self.totals

    def _sum(self, which: int, v, kT: float, dt: float, seed: int, counter: int, values: np.ndarray | None, **apart) -> None:
        self.forced = -1  # until all of it is there
        self.totals = self.engine.sums(which, v, kT, dt, seed, counter, values, self.force, **apart)
        self.forced, self._summed = self.engine.number, which

    def _sweep(self, m: Moment, part: float, update: int) -> None:
        self._place(m)
        m.counter += 1
        v = self._seen(m, m.v)
        self.engine.swept(v, m.kT, part * m.dt, m.seed, m.counter, m.values, v, update)
        if m.sheared is not None:
            add_flow(v, rate_at(self.spec.shear, m.sheared), m.x)
            m.v = v
            self.passed = self.passed + self.engine.passed()
        if len(self.still):
            m.v[self.still] = 0.0
        driven = self.spec.driven
        if driven is not None and driven.continuum is not None:
            axis, taken = driven.continuum.axis, np.zeros((2, 3))
            speeds = driven.velocities(m.time + 0.5 * m.dt)[axis]
            drag_by_walls(driven.continuum, m.x, m.v, speeds, part * m.dt, m.kT, m.seed, m.counter, taken)
            m.impulses[axis] += taken  # type: ignore[index]
        if m.values is not None:
            motion.add_to_moving(m.values, self.engine.increments, self.inv_mass)

    def _warm(self, m: Moment) -> None:
        """The thermal energy of this step."""
        if self.spec.ramp is not None and m.ramped is not None and self.spec.thermostat:
            m.ramped += 1.0
            m.kT = ramped_energy(self.spec.ramp, m.ramped)

    # -- modified velocity Verlet ----------------------------------------------------------------------------------------------------
    def _predicting(self, m: Moment) -> None:
        lam, dt = self.spec.lam, m.dt
        if m.acc is None:
            # with the noise of the last half kick: another one would halve its variance, as both halves of a step share it
            m.acc = np.empty_like(self.force)
            self._accelerate(m, m.v if m.unkicked is None else m.unkicked, m.values, 0.0)
        predicted = None if lam == 0.5 else self._predicted(m, lam)
        m.unkicked = None
        seen = m.values
        if m.values is not None:
            assert m.rates is not None
            before = m.values
            m.values = before + 0.5 * dt * m.rates
            seen = m.values if self.spec.field_lam == 0.5 else before + self.spec.field_lam * dt * m.rates
        self.placed = False
        flat = m.x.ravel(), m.v.ravel(), m.acc.ravel(), self._inv_mass
        moving = (m.v,) if predicted is None else (predicted, m.v)
        changes = (0.0, 0.0) if m.sheared is None else self._shear(m, dt)
        for velocities in moving if changes[0] else ():
            add_flow(velocities, changes[0], m.x)
        fast = motion.move_accelerated(*flat, 0.5 * dt, dt, self.reach / dt)
        for velocities in moving if changes[1] else ():
            add_flow(velocities, changes[1], m.x)
        self._reflect(m, *moving)
        self._warm(m)
        m.counter += 1
        v = m.v if predicted is None else predicted
        if fast or predicted is not None or m.sheared is not None:
            self.watch(self._seen(m, v), m)
        self._accelerate(m, v, seen, 0.5 * dt)
        if m.values is not None:
            assert m.rates is not None
            m.values += 0.5 * dt * m.rates
        m.predicted = predicted

    def _predicted(self, m: Moment, lam: float) -> np.ndarray:
        """v + lam dt a with all accelerations a: slow forces have kicked for half a step already."""
        assert m.acc is not None
        seen = m.v + lam * m.dt * m.acc
        return seen + (2.0 * lam - 1.0) * (m.v - m.unkicked) if m.unkicked is not None and self.spec.foresees else seen

    def _accelerate(self, m: Moment, v: np.ndarray, values: np.ndarray | None, kick: float) -> None:
        """Acceleration and rates at x, friction and noise included, and a kick of that duration."""
        assert m.acc is not None
        self._place(m)
        which, apart = CONSERVATIVE | DISSIPATIVE | RANDOM | STRESS * (self.tensor and self._last), {}
        if self.parted and self._last and self.engine.parts_forces:
            which |= LAPLACIAN
            self._held = self._held if len(self._held) else np.empty_like(self.force)
            apart = {"held": self._held}
        self._sum(which, self._seen(m, v), m.kT, m.dt, m.seed, m.counter, values, **apart)
        motion.accelerate(m.acc.ravel(), m.v.ravel(), self.force.ravel(), self._inv_mass, kick)
        if values is not None:
            m.rates = np.where(self.inv_mass[:, None] > 0.0, self.engine.rates, 0.0)
