"""Whole steps on the kernel's own arrays: n of them in a loop, without returning to OpenMM in between.

A step is a word of drifts, kicks and sweeps (:mod:`openmm_dpd.model.schemes`), or the modified velocity Verlet scheme, in which friction is
a force.  The :class:`.moment.Moment` holds everything that a step depends on, so a run gives the same bits however it is divided.
"""

import math
from dataclasses import dataclass, field

import numpy as np

from ..base.errors import RunError
from ..base.signals import CTRL_C
from ..runtime import Tape, threads_for
from . import bodies, motion
from .columns import Totals
from .driven import continuum_push, drag_by_walls, reflect
from .interface import Engine
from .layer import CONSERVATIVE, DISSIPATIVE, LAPLACIAN, RANDOM
from .moment import FASTEST, NO_GUIDE, LastStep, Looks, Masses, Moment, SlowForces, StepSpec, Watch, ramped_energy
from .noise import key_again
from .seats import Seats
from .shear import AFTER, BEFORE, change_flow, join_flow, leave_flow, slide
from .sweeps import EXACT, SHARDLOW
from .validity import Recorded, Validity

#: Pair updates of the letters that sweep.
UPDATES = {"O": EXACT, "S": SHARDLOW}


@dataclass(eq=False)
class StepLoop:
    """The :class:`.moment.Stepper` of engines that work on arrays: does steps one by one, or plays a recorded one again."""

    spec: StepSpec
    engine: Engine
    watch: Watch
    reach: float  #: ``watch`` is called where a component of a velocity would carry a bead this far in a step and is not thermal
    parts: bool = False  #: Whether this loop does parts of the runs of another loop, in arrays of its own
    force: np.ndarray = field(init=False)

    def __post_init__(self):
        n = len(self.engine.spec.types)
        self.masses = Masses.of(self.engine.spec.inv_mass)
        self.force = np.zeros((n, 3))
        self.valid = Validity(self.engine)
        self.more = 0
        self.looks: Looks | None = None
        #: in a shear: velocities relative to the flow, and the sum of :meth:`.interface.Engine.passed` over the last step
        self._relative = np.zeros((0 if self.spec.shear is None else n, 3))
        self.passed: np.ndarray | float = 0.0
        self._spare: dict[str, np.ndarray] = {}
        #: does steps with the beads in the order of their cells
        self._seats: Seats | None = None

    def run(self, moment: Moment, n: int, slow: SlowForces | None = None) -> None:
        """See :meth:`.moment.Stepper.run`.  The last step is always done by this engine, which then holds its lists, forces and sums."""
        done, given = 0, False
        if (
            threads_for(len(moment.x)) > 1
            and self.engine.number
            and not (self.spec.driven or self.looks)
            and self._repeats(moment, slow, n)
        ):
            if self._seats is None:
                self._seats = Seats(StepLoop(self.spec, self.engine.another(), self.watch, self.reach, parts=True))
            self.valid.begin(moment.x, moment.box, False)
            given = self.has_force
            if n > 3:
                done, given = self._seats.run(moment, n - 1, self, given)
        self.carry_out(moment, n - done, slow, given, done)

    def carry_out(self, moment: Moment, n: int, slow: SlowForces | None, given: bool = False, already: int = 0) -> None:
        """Do n steps with the beads in their present order, after ``already`` steps of the run.  ``given``: the force is that at the
        positions of the moment."""
        step = self._predicting if self.spec.predicts else self._word
        before, after = self.spec.slow_kicks
        if moment.guide is not NO_GUIDE and slow is not None:
            forces, start, slow = slow, moment.number, None
            moment.others = lambda m, step: forces(m, step - start)
        # the last step of a run is not played, so that its lists, forces and sums are there
        done, last = 0, n if self.parts else n - 1
        try:
            self.valid.begin(moment.x, moment.box, given)
            if self.valid.placed:  # a recorded step reads the array of positions that it was recorded with
                self.engine.resume(moment.x, moment.box)
            force = None
            while done < n:
                CTRL_C.check()
                repeats = self._repeats(moment, slow, n - done)
                if repeats and done < last and (played := self._play(moment, last - done)):
                    done += played
                    continue
                number = moment.number + self.spec.predicts  # sweeps begin with the force that the last step is measured with
                looks = None if self.looks is None or self.looks.until(number) else self.looks
                begun, counter, tape, taken = self.valid.computed(moment), moment.counter, Tape(key_again), self.valid.take()
                taken.pop(looks is not None, None)
                if slow is not None and moment.slow_step == 0 and before:
                    force = slow(moment, done) if force is None else force
                    if self.spec.predicts and (moment.acc is None or self.spec.foresees):
                        moment.unkicked = moment.v.copy()
                    self._move(moment, force, before * moment.dt)
                if self.spec.predicts and moment.acc is None:
                    # with the noise of the last half kick: another one would halve its variance, as both halves of a step share it
                    moment.acc = np.empty_like(self.force)
                    self._accelerate(moment, moment.v if moment.unkicked is None else moment.unkicked, moment.values, 0.0)
                moment.more = (self.more if done + 1 == n else 0) | (0 if looks is None else looks.more)
                with tape.recording():
                    if looks is not None and not self.spec.predicts:
                        self._place(moment)
                        self._sum(CONSERVATIVE | looks.more, None, 0.0, 1.0, 0, 0, moment.values)
                        looks.take(moment, self.force, tape, number)
                    step(moment)
                    if looks is not None and self.spec.predicts:
                        looks.take(moment, self._room("conservative"), tape, number)
                if repeats and tape.smooth:  # otherwise arrays have moved
                    if begun == self.valid.computed(moment):
                        tape.finish(counter, moment.counter - counter, moment.state, self.engine.tables)
                        taken[looks is not None] = Recorded(tape, begun, self._conditions(moment))
                    self.valid.record(taken)
                self._count(moment, 1)
                done += 1
                moment.guide.end(moment)
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
            m.number += 1
            m.slow_step = (m.slow_step + 1) % self.spec.slow_every

    def _repeats(self, m: Moment, slow: SlowForces | None, steps: int) -> bool:
        """Whether each step calls the same kernels with other noise, and there are enough steps left for recording one to pay."""
        spec = self.spec
        plain = slow is None and m.guide is NO_GUIDE and m.box is not None
        plain = plain and (spec.driven is None or spec.driven.steady and not self._heats(m))
        return plain and steps > 2 and (m.values is None or spec.field_lam == 0.5) and self.engine.repeats

    def _conditions(self, m: Moment) -> tuple:
        """What a recorded step depends on besides the arrays of the moment."""
        box = m.box if m.box is None or m.flow is None else m.box.diagonal()  # the offset of sliding images is part of the state
        kT, placed = None if self._heats(m) else m.kT, None if box is None else box.tobytes()
        return m.dt, kT, m.seed, placed, self.engine.body_scale, threads_for(len(m.x))

    def _play(self, m: Moment, steps: int) -> int:
        """Repeat the recorded step up to ``steps`` times, if there is one that fits; returns how many steps were done."""
        number = m.number + self.spec.predicts
        fitting = self.valid.fitting(self.looks, number, steps, m.state, self._conditions(m))
        if fitting is None:
            return 0
        taken, recorded, steps, seldom = fitting
        before, again = recorded.before, Tape(key_again)
        with again.recording():  # compute what the recorded step found computed, and uses
            if before.placed and self.spec.looks_first:
                self._place(m)
            if before.forced and not self.spec.predicts:
                self._conserve(m)
        if not again.smooth:  # arrays have moved
            return 0
        levels = (ramped_energy(self.spec.ramp, m.ramped + 1.0 + k) for k in range(steps))  # type: ignore[operator]
        heats = np.array(list(levels)) if self._heats(m) else None
        played, sound = recorded.step.play(m.counter, steps, heats, seldom)
        if seldom is not None and self.looks is not None:
            self.looks.played(number, played, *seldom)
        m.counter += recorded.step.counted * played
        self._count(m, played)
        if heats is not None and played:
            m.ramped, m.kT = m.ramped + played, float(heats[played - 1])  # type: ignore[operator]
        if played or sound is not None:
            self.valid.played(before if sound is None else None)  # the step that was refused has made other lists
        if sound or played == steps:
            self.valid.record(taken)
        if sound:
            played += self._play(m, sound)
            self.valid.take()
        return played

    @property
    def has_force(self) -> bool:
        """Whether the force is the whole force at the positions of the moment, whatever velocities and fields are."""
        return self.valid.placed and self.valid.forced and not self.spec.predicts and not self._acting

    @property
    def _acting(self) -> bool:
        """Whether conservative forces depend on fields, which may change while positions do not."""
        fields = self.engine.spec.fields
        return fields is not None and fields.acts

    def _place(self, m: Moment) -> None:
        """List the pairs at the positions of the moment, unless they are listed."""
        if not self.valid.placed:
            self.engine.place(m.x, m.box)
            self.valid.listed()

    # -- words -------------------------------------------------------------------------------------------------------------------
    def _word(self, m: Moment) -> None:
        """One step of a word.  Kicks are delayed, so that all that lies between two passes over the pairs is one pass over the beads."""
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
        """Kick by the kernel's force, whose reaction pushes the walls, and drift."""
        walls = self.spec.driven
        if kick and walls is not None and walls.continuum is not None:
            continuum_push(m.x, walls.continuum.inv_mass, *walls.continuum.arguments, kick, m.impulses)
        return self._move(m, self.force, kick, time)

    def _move(self, m: Moment, force: np.ndarray, kick: float, time: float = 0.0) -> int:
        """Kick by a force and drift; returns how many beads have to be watched (in a shear :meth:`_look` finds most of them)."""
        if time:
            self.valid.drift()
        flat = force.ravel(), self.masses.components
        if time:
            self._slide(m, time, BEFORE, m.v)
        found = bodies.move_all(self.engine.bodies, self.spec.driven, m, *flat, kick, time, self._limit(m) if m.flow is None else np.inf)
        if time:
            self._slide(m, 0.0, AFTER, m.v)
        return found

    def _limit(self, m: Moment) -> float:
        """Speed that some component of the velocity of every bead that runs away exceeds."""
        ramp = self.spec.ramp
        kT = m.kT if ramp is None else min(m.kT, ramp.kT_start, ramp.kT_end)  # one limit for the whole ramp
        return max(self.reach / m.dt, FASTEST * self.masses.slowest * math.sqrt(kT / 3.0))

    def _slide(self, m: Moment, time: float, which: int, *velocities: np.ndarray) -> None:
        """In a shear, slide the images for a time (0: not at all), and change the velocities of beads that follow the flow with it."""
        if m.flow is not None and time:
            slide(self.spec.shear, self.spec.tilt, m.box, m.flow, time)  # type: ignore[arg-type]
        for v in () if m.flow is None or self.spec.shear.constant else velocities:
            change_flow(v, m.x, m.flow, which)

    def _seen(self, m: Moment, v: np.ndarray, limit: float = np.inf) -> tuple[np.ndarray, int]:
        """Velocities as friction sees them, relative to the flow of a shear, and how many of their components exceed a limit."""
        if m.flow is None:
            return v, 0
        self.engine.set_flow(m.flow)
        return self._relative, leave_flow(v, m.x, m.flow, limit, self._relative)

    def _look(self, m: Moment, v: np.ndarray, fast: int) -> None:
        """Call ``watch`` if some beads are fast."""
        v, found = self._seen(m, v, self._limit(m))
        if fast or found:
            self.watch(v, self.masses.inverse, m)

    def _reflect(self, m: Moment, *velocities: np.ndarray) -> None:
        if self.spec.walls is not None:
            reflect(self.spec.walls, self.spec.driven, m, self.masses.inverse, velocities)

    def _conserve(self, m: Moment) -> None:
        """Sum the conservative force at the positions of the moment, unless it is there."""
        if not self.valid.given:
            self._place(m)
            self.conserve(m.values)

    def swept(self, counter: int) -> np.ndarray | None:
        """See :meth:`.moment.Stepper.swept`."""
        m = self.valid.moment
        there = m is not None and m.counter == counter and self.engine.holds(m.x, m.box)
        return self.passed if there and isinstance(self.passed, np.ndarray) else None

    def last(self) -> LastStep | None:
        """See :meth:`.moment.Stepper.last`."""
        moment, totals = self.valid.moment, self.valid.totals
        if not self.spec.predicts or not self.valid.forced or moment is None:
            return None
        return LastStep(moment, self.force, totals, None if totals.conservative is None else self._room("conservative"))

    def forget(self) -> None:
        """See :meth:`.moment.Stepper.forget`."""
        self.valid.end(None)

    def conserve(self, values: np.ndarray | None, more: int = 0) -> tuple[np.ndarray, Totals]:
        """See :meth:`.moment.Stepper.conserve`; a force that is there is not summed again, unless it depends on fields."""
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
        """Advance a temperature ramp by one step."""
        if self._heats(m):
            m.ramped += 1.0  # type: ignore[operator]  # there is one
            m.kT = ramped_energy(self.spec.ramp, m.ramped)

    def _heats(self, m: Moment) -> bool:
        """Whether this loop, and not its caller, follows a temperature ramp."""
        return self.spec.ramp is not None and m.ramped is not None and self.spec.thermostat

    # -- modified velocity Verlet ----------------------------------------------------------------------------------------------------
    def _predicting(self, m: Moment) -> None:
        lam, dt, guide = self.spec.lam, m.dt, m.guide
        guide.begin(m)
        limit = self._limit(m) if m.flow is None else np.inf
        predicted, quick = (None, 0) if lam == 0.5 else self._predicted(m, lam, limit)
        m.unkicked = None
        seen = m.values
        if m.values is not None:
            if self.spec.field_lam != 0.5:
                seen = m.values + self.spec.field_lam * dt * m.rates  # type: ignore[operator]  # where there are values
            motion.advance(m.values, m.rates, 0.5 * dt)
        self.valid.drift()
        flat = m.acc.ravel(), self.masses.moving  # type: ignore[union-attr]  # carry_out has seen to it
        moving = (m.v,) if predicted is None else (predicted, m.v)
        self._slide(m, dt, BEFORE, *moving)
        if guide.limits:
            bodies.move_all(self.engine.bodies, self.spec.driven, m, *flat, 0.5 * dt, 0.0, np.inf)
            guide.limit(m)
        fast = bodies.move_all(self.engine.bodies, self.spec.driven, m, *flat, 0.0 if guide.limits else 0.5 * dt, dt, limit)
        self._slide(m, 0.0, AFTER, *moving)
        self._reflect(m, *moving)
        guide.place(m, moving[0])
        self._warm(m)
        m.counter += 1
        v = m.v if predicted is None else predicted
        self._look(m, v, fast if predicted is None else quick)
        self._accelerate(m, v, seen, 0.5 * dt)
        guide.limit(m)
        if m.values is not None:
            motion.advance(m.values, m.rates, 0.5 * dt)
        m.predicted = predicted

    def _predicted(self, m: Moment, lam: float, limit: float) -> tuple[np.ndarray, int]:
        """Predicted velocities v + lam dt a with all accelerations a, and how many beads are fast then; slow forces have kicked for half a
        step already."""
        seen = self._room("predicted")
        quick = motion.predict(seen.ravel(), m.v.ravel(), m.acc.ravel(), lam * m.dt, limit)  # type: ignore[union-attr]  # see carry_out
        if m.unkicked is None or not self.spec.foresees:
            return seen, quick
        seen += (2.0 * lam - 1.0) * (m.v - m.unkicked)
        return seen, len(seen)

    def _room(self, name: str) -> np.ndarray:
        """(N, 3) array: conservative forces of the last step of a run, where they are summed separately, or predicted velocities."""
        return self._spare.setdefault(name, np.empty_like(self.force))

    def _accelerate(self, m: Moment, v: np.ndarray, values: np.ndarray | None, kick: float) -> None:
        """Compute acceleration and rates at the positions of the moment, with friction and noise, and kick for a time ``kick``."""
        self._place(m)
        more = (m.more | m.guide.more) & (-1 if self.engine.parts_forces else ~LAPLACIAN)
        apart = {"held": self._room("conservative")} if more & LAPLACIAN else {}
        which = CONSERVATIVE | DISSIPATIVE | RANDOM | more
        self._sum(which, self._seen(m, v)[0], m.kT, m.dt, m.seed, m.counter, values, **apart)
        step = m.number + (kick > 0.0)
        force = m.guide.forces(m, v, self.force if m.others is None else self.force + m.others(m, step), step)
        bodies.accelerate_all(self.engine.bodies, m, force.ravel(), self.masses.components, kick)
        if values is not None:
            motion.take_moving(m.rates, self.engine.rates, self.masses.inverse)
