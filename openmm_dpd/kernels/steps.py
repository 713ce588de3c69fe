"""Whole steps on the kernel's own arrays: n of them in a loop, without a way back to OpenMM in between.

A step is a word of drifts, kicks and sweeps (see :mod:`openmm_dpd.model.schemes`), or the modified velocity Verlet scheme, whose
friction is a force.  All that a step begins with is in the :class:`Moment`, so that a run gives the same bits however it is cut.
"""

import math
from contextlib import nullcontext
from dataclasses import dataclass, field

import numpy as np

from ..base.errors import RunError
from ..base.signals import CTRL_C
from ..runtime import Recording, Tape, threads_for
from . import motion
from .columns import Totals
from .driven import continuum_push, drag_by_walls, reflect_driven
from .interface import Engine
from .layer import CONSERVATIVE, DISSIPATIVE, LAPLACIAN, RANDOM
from .moment import FASTEST, LastStep, Masses, Moment, SlowForces, StepSpec, Watch, ramped_energy
from .noise import key_again
from .seats import Seats
from .shear import AFTER, BEFORE, change_flow, join_flow, leave_flow, slide
from .sweeps import EXACT, SHARDLOW
from .validity import Recorded, Validity

#: Pair updates of the letters that sweep.
UPDATES = {"O": EXACT, "S": SHARDLOW}


@dataclass(eq=False)
class StepLoop:
    """Does steps with one engine, on its arrays: a :class:`Stepper`."""

    spec: StepSpec
    engine: Engine
    watch: Watch
    reach: float  #: It is asked where a bead has a component of the velocity with which it would go so far in a step, if it is hot as well
    parts: bool = False  #: Whether it does parts of the runs of another one, in arrays of its own
    force: np.ndarray = field(init=False)

    def __post_init__(self):
        n = len(self.engine.spec.types)
        self.masses = Masses.of(self.engine.spec.inv_mass)
        self.force = np.zeros((n, 3))
        self.valid = Validity(self.engine)
        self.more = 0
        #: in a shear: velocities relative to the flow, and what the friction of the last step has passed on
        #: (:meth:`.interface.Engine.passed`)
        self._relative = np.zeros((0 if self.spec.shear is None else n, 3))
        self.passed: np.ndarray | float = 0.0
        #: conservative forces of a last step, where they are summed apart
        self._held = np.zeros((0, 3))
        #: does steps with beads in another order
        self._seats: Seats | None = None

    def run(self, moment: Moment, n: int, slow: SlowForces | None = None) -> None:
        """See :meth:`Stepper.run`.  The last step is done here, so that this engine has all that belongs to it."""
        done, given = 0, False
        if threads_for(len(moment.x)) > 1 and self.engine.number and self.spec.driven is None and self._repeats(moment, slow, n):
            if self._seats is None:
                self._seats = Seats(StepLoop(self.spec, self.engine.another(), self.watch, self.reach, parts=True))
            self.valid.begin(moment.x, moment.box, False)
            given = self.has_force
            if n > 3:
                done, given = self._seats.run(moment, n - 1, self, given)
        self.carry_out(moment, n - done, slow, given, done)

    def carry_out(self, moment: Moment, n: int, slow: SlowForces | None, given: bool = False, already: int = 0) -> None:
        """Do steps with beads where they are, so many after the first of the run.  ``given``: the force is that at the positions of the
        moment."""
        step = self._predicting if self.spec.predicts else self._word
        before, after = self.spec.slow_kicks
        # the last step of a run is done here, so that all that belongs to it is there
        done, last = 0, n if self.parts else n - 1
        try:
            self.valid.begin(moment.x, moment.box, given)
            if self.valid.placed:  # what is recorded reads the array that beads move in
                self.engine.resume(moment.x, moment.box)
            force = None
            while done < n:
                CTRL_C.check()
                repeats = self._repeats(moment, slow, n - done)
                if repeats and done < last and (played := self._play(moment, last - done)):
                    done += played
                    continue
                begun, counter, tape = self.valid.computed(moment), moment.counter, Tape(key_again) if repeats else None
                self.valid.take()
                if slow is not None and moment.slow_step == 0 and before:
                    force = slow(moment, done) if force is None else force
                    if self.spec.predicts and (moment.acc is None or self.spec.foresees):
                        moment.unkicked = moment.v.copy()
                    self._move(moment, force, before * moment.dt)
                self.valid.final = done + 1 == n
                with nullcontext() if tape is None else tape.recording():
                    step(moment)
                if tape is not None and tape.smooth and begun == self.valid.computed(moment):
                    recording = Recording(tape, counter, moment.counter - counter, moment.state, self.engine.tables)
                    self.valid.record(Recorded(recording, begun, self._conditions(moment)))
                self._count(moment, 1)
                done += 1
                if slow is not None and moment.slow_step == 0:
                    force = slow(moment, done) if after or done < n else None
                    if after and force is not None:
                        self._move(moment, force, after * moment.dt)
            if self.valid.placed and not self.parts:
                self.engine.keep()
            self.valid.end(moment)
        except RunError as error:
            error.steps_done = already + min(done, n - 1)  # type: ignore[attr-defined]
            raise

    def _count(self, m: Moment, steps: int) -> None:
        for _ in range(steps):
            m.time += m.dt
            m.slow_step = (m.slow_step + 1) % self.spec.slow_every

    def _repeats(self, m: Moment, slow: SlowForces | None, steps: int) -> bool:
        """Whether a step does what the one before it has done, with other noise, and so many are enough for that to pay."""
        spec = self.spec
        plain = slow is None and m.box is not None and (spec.driven is None or spec.driven.steady and not self._heats(m))
        return plain and steps > 2 and spec.lam == 0.5 and (m.values is None or spec.field_lam == 0.5) and self.engine.repeats

    def _conditions(self, m: Moment) -> tuple:
        """What a recorded step depends on beside the arrays it begins with."""
        box = m.box if m.box is None or m.flow is None else m.box.diagonal()  # what slides is in the state
        return (
            m.dt,
            None if self._heats(m) else m.kT,
            m.seed,
            None if box is None else box.tobytes(),
            self.engine.body_scale,
            threads_for(len(m.x)),
        )

    def _play(self, m: Moment, steps: int) -> int:
        """Repeat the recorded step for a while, if there is one that fits; returns how many steps were done."""
        recorded = self.valid.take()  # it is kept if all goes well
        if recorded is None or not recorded.step.begins_with(*m.state) or recorded.conditions != self._conditions(m):
            return 0
        before, again = recorded.before, Tape(key_again)
        steps = min(steps, recorded.step.at_once)
        with again.recording():  # what was known before the recorded step, and is used in it
            if before.placed and self.spec.looks_first:
                self._place(m)
            if before.forced and not self.spec.predicts:
                self._conserve(m)
        if not again.smooth:  # there are other arrays now
            return 0
        heats = None
        if self._heats(m):
            heats = np.array([ramped_energy(self.spec.ramp, m.ramped + 1.0 + k) for k in range(steps)])  # type: ignore[operator]
        played, sound = recorded.step.play(m.counter, steps, heats)
        m.counter += recorded.step.counted * played
        self._count(m, played)
        if heats is not None and played:
            m.ramped, m.kT = m.ramped + played, float(heats[played - 1])  # type: ignore[operator]
        if played or sound is not None:
            self.valid.played(before if sound is None else None)  # a step that is not to be done has other lists
        if sound or played == steps:
            self.valid.record(recorded)
        if sound:
            played += self._play(m, sound)
            self.valid.take()
        return played

    @property
    def has_force(self) -> bool:
        """Whether the force is all of that at the positions of the moment, whatever happens to velocities and fields."""
        return self.valid.placed and self.valid.forced and not self.spec.predicts and not self._acting

    @property
    def _acting(self) -> bool:
        """Whether conservative forces depend on fields, which may change where positions do not."""
        fields = self.engine.spec.fields
        return fields is not None and fields.acts

    def _place(self, m: Moment) -> None:
        """List the pairs at x, unless they are listed."""
        if not self.valid.placed:
            self.engine.place(m.x, m.box)
            self.valid.listed()

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
                    self._look(m, m.v, fast)
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
            continuum_push(m.x, walls.continuum.inv_mass, *walls.continuum.arguments, kick, m.impulses)
        return self._move(m, self.force, kick, time)

    def _move(self, m: Moment, force: np.ndarray, kick: float, time: float = 0.0) -> int:
        """Kick and drift; returns how many beads are to be watched (in a shear :meth:`_look` finds most of them)."""
        if time:
            self.valid.drift()
        flat = m.x.ravel(), m.v.ravel(), force.ravel(), self.masses.components
        if time:
            self._slide(m, time, BEFORE, m.v)
        found = motion.move(*flat, kick, time, self._limit(m) if m.flow is None else np.inf)
        if time:
            self._slide(m, 0.0, AFTER, m.v)
        return found

    def _limit(self, m: Moment) -> float:
        """No bead runs away without a component of the velocity above this one."""
        ramp = self.spec.ramp
        kT = m.kT if ramp is None else min(m.kT, ramp.kT_start, ramp.kT_end)  # the same one as long as it acts
        return max(self.reach / m.dt, FASTEST * self.masses.slowest * math.sqrt(kT / 3.0))

    def _slide(self, m: Moment, time: float, which: int, *velocities: np.ndarray) -> None:
        """In a shear slide the images for a time, if there is one, and give beads that follow the flow what it changes by."""
        if m.flow is not None and time:
            slide(self.spec.shear, self.spec.tilt, m.box, m.flow, time)  # type: ignore[arg-type]
        for v in () if m.flow is None or self.spec.shear.constant else velocities:
            change_flow(v, m.x, m.flow, which)

    def _seen(self, m: Moment, v: np.ndarray, limit: float = np.inf) -> tuple[np.ndarray, int]:
        """Velocities as friction sees them: relative to the flow, if there is one; and how many components of these are beyond a limit."""
        if m.flow is None:
            return v, 0
        self.engine.set_flow(m.flow)
        return self._relative, leave_flow(v, m.x, m.flow, limit, self._relative)

    def _look(self, m: Moment, v: np.ndarray, fast: int) -> None:
        """Watch beads, where some are fast."""
        v, found = self._seen(m, v, self._limit(m))
        if fast or found:
            self.watch(v, self.masses.inverse, m)

    def _reflect(self, m: Moment, *velocities: np.ndarray) -> None:
        walls, driven = self.spec.walls, self.spec.driven
        if driven is not None:
            speeds, taken = driven.velocities(m.time + 0.5 * m.dt), np.zeros((3, 2, 3))
            for k, v in enumerate(velocities):
                reflect_driven(m.x, v, self.masses.inverse, *walls, speeds, k == len(velocities) - 1, taken, m.impulses)  # type: ignore[misc]
        elif walls is not None:
            # the last one puts the positions back
            for k, v in enumerate(velocities):
                motion.reflect_beads(m.x, v, self.masses.inverse, *walls, k == len(velocities) - 1)

    def _conserve(self, m: Moment) -> None:
        """Conservative force at x, unless it is there already."""
        if not self.valid.given:
            self._place(m)
            self.conserve(m.values)

    def swept(self, counter: int) -> np.ndarray | None:
        """See :class:`Stepper`."""
        m = self.valid.moment
        there = m is not None and m.counter == counter and self.engine.holds(m.x, m.box)
        return self.passed if there and isinstance(self.passed, np.ndarray) else None

    def last(self) -> LastStep | None:
        """See :class:`Stepper`."""
        moment, totals = self.valid.moment, self.valid.totals
        if not self.spec.predicts or not self.valid.forced or moment is None:
            return None
        return LastStep(moment, self.force, totals, None if totals.conservative is None else self._held)

    def forget(self) -> None:
        """See :class:`Stepper`."""
        self.valid.end(None)

    def conserve(self, values: np.ndarray | None, more: int = 0) -> tuple[np.ndarray, Totals]:
        """See :class:`Stepper`; what is there already is not computed again, unless it depends on fields."""
        if self._acting or not self.valid.has(more):
            self._sum(CONSERVATIVE | more, None, 0.0, 1.0, 0, 0, values)
        return self.force, self.valid.totals

    def _sum(self, which: int, v, kT: float, dt: float, seed: int, counter: int, values: np.ndarray | None, **apart) -> None:
        self.valid.lose_force()  # until all of it is there
        self.valid.summed(which, self.engine.sums(which, v, kT, dt, seed, counter, values, self.force, **apart))

    def _sweep(self, m: Moment, part: float, update: int) -> None:
        self._place(m)
        m.counter += 1
        v, _ = self._seen(m, m.v)
        self.engine.swept(v, m.kT, part * m.dt, m.seed, m.counter, m.values, v, update)
        if m.flow is not None:
            join_flow(m.v, m.x, m.flow, v)
            self.passed = self.passed + self.engine.passed()
        if self.masses.some_rest:
            motion.hold(m.v, self.masses.inverse)
        driven = self.spec.driven
        if driven is not None and driven.continuum is not None:
            assert m.impulses is not None
            speeds = driven.velocities(m.time + 0.5 * m.dt)
            drag_by_walls(driven.continuum, m.x, m.v, speeds, part * m.dt, m.kT, m.seed, m.counter, m.impulses)
        if m.values is not None:
            motion.add_to_moving(m.values, self.engine.increments, self.masses.inverse)

    def _warm(self, m: Moment) -> None:
        """The thermal energy of this step."""
        if self._heats(m):
            assert m.ramped is not None
            m.ramped += 1.0
            m.kT = ramped_energy(self.spec.ramp, m.ramped)

    def _heats(self, m: Moment) -> bool:
        """Whether the loop follows a temperature ramp."""
        return self.spec.ramp is not None and m.ramped is not None and self.spec.thermostat

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
            if self.spec.field_lam != 0.5:
                seen = m.values + self.spec.field_lam * dt * m.rates  # type: ignore[operator]  # where there are values
            motion.advance(m.values, m.rates, 0.5 * dt)
        self.valid.drift()
        flat = m.x.ravel(), m.v.ravel(), m.acc.ravel(), self.masses.components
        moving = (m.v,) if predicted is None else (predicted, m.v)
        self._slide(m, dt, BEFORE, *moving)
        fast = motion.move_accelerated(*flat, 0.5 * dt, dt, self._limit(m) if m.flow is None else np.inf)
        self._slide(m, 0.0, AFTER, *moving)
        self._reflect(m, *moving)
        self._warm(m)
        m.counter += 1
        v = m.v if predicted is None else predicted
        self._look(m, v, fast if predicted is None else len(v))
        self._accelerate(m, v, seen, 0.5 * dt)
        if m.values is not None:
            motion.advance(m.values, m.rates, 0.5 * dt)
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
        more, apart = self.more if self.valid.final else 0, {}
        if not self.engine.parts_forces:
            more &= ~LAPLACIAN
        if more & LAPLACIAN:
            self._held = self._held if len(self._held) else np.empty_like(self.force)
            apart = {"held": self._held}
        which = CONSERVATIVE | DISSIPATIVE | RANDOM | more
        self._sum(which, self._seen(m, v)[0], m.kT, m.dt, m.seed, m.counter, values, **apart)
        motion.accelerate(m.acc.ravel(), m.v.ravel(), self.force.ravel(), self.masses.components, kick)
        if values is not None:
            motion.take_moving(m.rates, self.engine.rates, self.masses.inverse)
