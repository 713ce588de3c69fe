"""Many whole steps at once: the state goes from the Context to the kernel's loop and back.

:meth:`openmm_dpd.simulation.integrators.PairIntegrator.step` does this where the pair force computes every fast force, so that positions
and velocities are copied once for many steps.  The program of the integrator does equal steps one by one; both agree to rounding.
"""

from itertools import accumulate

import numpy as np
import openmm

from ..base import names as shared
from ..base.errors import PlanError, RunError
from ..base.openmm_private import bare, vectors
from ..kernels import motion
from ..kernels.moment import NO_GUIDE, Guide, Moment, StepSpec
from ..kernels.shear import TIME, flow_at, sheared_box, strain_at
from ..plan.execution import DOUBLE_PLATFORMS
from ..plan.forces.pair_force import PairForceFunction
from ..plan.forces.thread_state import ThreadState, fingerprint
from .fields import field_variables, per_dof, raw_bonds, raw_fields, raw_rates
from .integrators import PairIntegrator
from .watching import BESIDE_SHEAR


def guide_variables(guide: Guide | None, more: int = 0) -> list[str]:
    """Global variables of an integrator with what a guide keeps from step to step, and with so ``more`` numbers about reactions."""
    return [f"{shared.GUIDE}{k}" for k in range(more + (0 if guide is None else len(guide.numbers)))]


class WholeSteps:
    """Does whole steps of one System; ``function`` is the callable of its pair force in ``pair_group``, ``guide`` acts within the steps."""

    def __init__(self, function: PairForceFunction, pair_group: int, guide: Guide | None = None):
        self.function, self.pair_group, self.guide = function, pair_group, guide
        self._still = np.flatnonzero(function.spec.inv_mass == 0.0)
        self._moving = np.flatnonzero(function.spec.inv_mass) if len(self._still) else slice(None)
        fields = () if function.spec.fields is None else range(function.spec.fields.n_blocks)
        #: per-DOF variables that a stored acceleration depends on, besides positions, box and parameters
        self._left = [f"{shared.FIELD}{k}" for k in fields] + ["v"] * (function.steps is not None and function.steps.thermostat)
        self._held: tuple[float, dict[str, np.ndarray]] = (0.0, {})
        self._known: np.ndarray | None = None  #: Table of bonds that is in the integrator, and in what is held
        self.heard: list[list] = []  #: Lists that get what happens to bonds from now on, :class:`openmm_dpd.kernels.reactions.Event`
        bonds = None if function.steps is None else function.steps.reactions
        self._numbers = guide_variables(guide, 0 if bonds is None else 3 * len(bonds.reactions))

    @property
    def spec(self) -> StepSpec:
        """What a step is."""
        assert self.function.steps is not None
        return self.function.steps

    def run(self, integrator: PairIntegrator, context: openmm.Context, n: int, *, slow: bool, barostats: bool) -> None:
        """Do n steps; until they are done, the Context is changed only as far as OpenMM's forces need it.

        ``slow``: forces of OpenMM act; ``barostats``: a barostat acts behind these steps.  OpenMMException if a step fails, with its
        number.
        """
        if self.spec.shear is not None and slow:
            raise PlanError(BESIDE_SHEAR)
        own = self.function.thread_state()
        dt = bare(integrator.getStepSize())
        state = context.getState(positions=True, parameters=True)
        count, parameters = state.getStepCount(), _parameters(state, dt)
        clock = list(accumulate([dt] * n, initial=bare(state.getTime())))  # as OpenMM adds it up
        try:
            loop = own.loop
            assert loop is not None
            # free arrays early: each has 24 bytes per bead
            loop.forget()
            loop.events = [] if self.heard else None  # type: ignore[attr-defined]
            x, box = self.function.positions(state), self.function.box(state)
            del state
            moment, resting = self._moment(integrator, context, x, box, clock[0], parameters, own)
            moment.number, moment.guide = count, self.guide or NO_GUIDE

            def forces(m: Moment, done: int) -> np.ndarray:
                if done:
                    if m.guide.resizes:
                        context.setPeriodicBoxVectors(*m.box)  # type: ignore[misc]
                    context.setPositions(m.x)
                    context.setStepCount(count + done)
                    context.setTime(clock[done])
                    if self.spec.ramp is not None:
                        context.setParameter(shared.KT, m.kT)
                used = integrator.getIntegrationForceGroups()
                groups = {group for group in range(32) if used >> group & 1} - {self.pair_group}
                its = openmm.Context.getState(context, forces=True, groups=groups)  # its own method would show bonds of before this run
                return bare(its.getForces(asNumpy=True))

            loop.run(moment, n, forces if slow else None)
        except RunError as error:
            raise openmm.OpenMMException(f"step {count + getattr(error, 'steps_done', 0) + 1}: {error}") from error
        reached = (count, clock[0]) if barostats else (count + n, clock[-1])
        try:
            self._give_back(integrator, context, resting, parameters, moment, own, reached)
        except BaseException:
            self._give_back(integrator, context, resting, parameters, moment, own, reached)  # completely, wherever it was cut short
            raise
        if barostats:
            openmm.CustomIntegrator.setGlobalVariableByName(integrator, shared.AHEAD, float(n))
            try:
                openmm.CustomIntegrator.step(integrator, n)
                context.setTime(clock[-1])  # OpenMM counts with the step size that the Context was made with
            finally:
                openmm.CustomIntegrator.setGlobalVariableByName(integrator, shared.AHEAD, 0.0)
        for events in self.heard:
            events += loop.events  # type: ignore[attr-defined]

    def _moment(
        self, integrator: PairIntegrator, context: openmm.Context, x: np.ndarray, box, time: float, parameters, own: ThreadState
    ) -> tuple[Moment, np.ndarray]:
        """The moment before the first step, at positions x, and the velocities in the Context of beads that do not move."""
        function, spec = self.function, self.spec
        dt = function.step_size(parameters)
        function.take_over(own, parameters)
        v = vectors(context.getState(velocities=True), openmm.State.Velocities)
        resting = v[self._still]
        v[self._still] = 0.0
        kT = function.thermal_energy(parameters)
        moment = Moment(x, v, box, dt, kT, *function.noise(parameters))
        moment.numbers = np.array([integrator.getGlobalVariableByName(name) for name in self._numbers])
        if spec.slow_every > 1:
            moment.slow_step = int(integrator.getGlobalVariableByName(shared.SLOW_STEP))
        if spec.driven is not None:
            moment.time, moment.impulses = time, np.zeros(spec.driven.shape)
            for place, name in spec.driven.impulses.items():
                moment.impulses[place] = parameters.get(name, 0.0)
        if spec.ramp is not None:
            moment.ramped = integrator.getGlobalVariableByName(shared.RAMP_STEP)
        if spec.shear is not None:
            moment.flow = flow_at(spec.shear, parameters[shared.SHEARED])
            assert box is not None
            moment.box = sheared_box(box, strain_at(spec.shear, parameters[shared.SHEARED]), spec.tilt)
            if not np.array_equal(moment.box, sheared_box(box, 0.0, box[1, 0])):  # half an edge to the left is half an edge to the right
                raise RunError(
                    f"the box is tilted by {box[1, 0]:g} and not by the {moment.box[1, 0]:g} nm of the shear: it was set, or comes from a "
                    "state without its parameters; load states whole"
                )
        if spec.reactions is not None:
            kept, moment.bonds = self.kept(integrator), raw_bonds(integrator)
            self._known = moment.bonds.copy() if kept else None
        fields = function.spec.fields
        if fields is not None:
            moment.values = raw_fields(context, fields)
        if function.hidden:
            parameters[shared.SHOWN] = integrator.show(context, moment.bonds, moment.values)
        if spec.predicts:
            if fields is not None:
                moment.rates = raw_rates(context, fields)
            here = own.fingerprints.of(x, box, parameters)
            own.fingerprints.forget()  # x changes now
            now = {name: v if name == "v" else per_dof(integrator, name) for name in self._left}
            left = (motion.same(values[self._moving], per_dof(integrator, shared.LEFT + k)[self._moving]) for k, values in now.items())
            if here == integrator.getGlobalVariableByName("valid_for") and all(left):
                moment.acc = per_dof(integrator, "acc")
                self._held = 0.0, {}  # steps change it as well; after an error it is read from the Context again
        return moment, resting

    def _give_back(
        self, integrator: PairIntegrator, context: openmm.Context, resting, parameters, moment: Moment, own: ThreadState, reached
    ) -> None:
        """Write the result of the last step into the Context."""
        function, spec = self.function, self.spec
        put = openmm.CustomIntegrator.setGlobalVariableByName
        now = {shared.COUNTER: float(moment.counter), shared.DT: moment.dt}
        if len(self._still):
            moment.v[self._still] = resting
            if function.spec.carried is not None:
                function.spec.carried.see(moment.x, moment.v)
        if moment.flow is not None:
            context.setPeriodicBoxVectors(*moment.box)  # type: ignore[misc]  # a shear has one
            now[shared.SHEARED] = float(moment.flow[TIME])
        elif moment.guide.resizes:
            context.setPeriodicBoxVectors(*moment.box)  # type: ignore[misc]
        context.setPositions(moment.x)
        context.setVelocities(moment.v)
        for name, value in zip(self._numbers, moment.numbers.tolist(), strict=True):
            put(integrator, name, value)
        if spec.slow_every > 1:
            put(integrator, shared.SLOW_STEP, float(moment.slow_step))
        if spec.ramp is not None:
            now[shared.KT] = moment.kT
            put(integrator, shared.RAMP_STEP, moment.ramped)
        if spec.driven is not None and moment.impulses is not None:
            now |= {name: float(moment.impulses[place]) for place, name in spec.driven.impulses.items() if name in parameters}
        if (fields := function.spec.fields) is not None and shared.WRITTEN in parameters:
            now[shared.WRITTEN] = float(fields.written(moment.values))  # type: ignore[arg-type]  # where there are fields, there are values
        for name, value in now.items():
            context.setParameter(name, value)
        parameters |= now
        held = {}
        if moment.values is not None:
            held = field_variables(moment.values)
        there = set[str]()
        if moment.bonds is not None:
            bonds = field_variables(moment.bonds, shared.BONDS)
            held, there = held | bonds, set(bonds if self._known is not None and np.array_equal(moment.bonds, self._known) else ())
        if function.hidden:
            parameters[shared.SHOWN] = integrator.show(context, moment.bonds, moment.values)
        if spec.predicts:
            assert moment.acc is not None
            held |= {"acc": moment.acc} | ({} if moment.rates is None else field_variables(moment.rates, shared.RATE))
            if moment.predicted is not None:
                held["vp"] = moment.predicted.copy()
            x, v, box = moment.x, moment.v, moment.box
            if context.getPlatform().getName() not in DOUBLE_PLATFORMS:  # positions are rounded there, and beads wrapped
                after = context.getState(positions=True, velocities=True)
                x, box, v = function.positions(after), function.box(after), vectors(after, openmm.State.Velocities)
            held |= {shared.LEFT + name: v if name == "v" else held[name] for name in self._left}
            last = own.fingerprints.of(x, box, parameters)
            if x is moment.x:
                own.fingerprints.forget()  # nobody folds these beads
            put(integrator, "valid_for", last)
            put(integrator, "fingerprint", last)
        for name in held.keys() - there:  # to write what is there would take longer than a step
            openmm.CustomIntegrator.setPerDofVariableByName(integrator, name, held[name])
        if len(held) > len(there):
            first, *more = held.values()
            stamp = fingerprint(first, np.concatenate(more).ravel() if more else np.zeros(0))
            put(integrator, shared.STAMP, stamp)
            # others may round: the next step begins with what checkpoints and states have
            self._held = (stamp, held) if context.getPlatform().getName() in DOUBLE_PLATFORMS else (0.0, {})
        context.setStepCount(reached[0])
        context.setTime(reached[1])

    def keep_forces(self, integrator: PairIntegrator, context: openmm.Context) -> None:
        """Have the next step begin with the forces of the last one (``mvv``), though positions and box have been changed since."""
        if self.spec.predicts:
            own, state = self.function.thread_state(), context.getState(positions=True, parameters=True)
            own.fingerprints.forget()
            parameters = _parameters(state, bare(integrator.getStepSize()))
            last = own.fingerprints.of(self.function.positions(state), self.function.box(state), parameters)
            for name in ("valid_for", "fingerprint"):
                openmm.CustomIntegrator.setGlobalVariableByName(integrator, name, last)

    def kept(self, integrator: PairIntegrator) -> dict[str, np.ndarray]:
        """Per-DOF variables that the last steps have written, by name, if nobody has changed any since.  Reading them from OpenMM takes
        longer than a step."""
        stamp, held = self._held
        return held if held and stamp == integrator.getGlobalVariableByName(shared.STAMP) else {}


def _parameters(state: openmm.State, dt: float) -> dict[str, float]:
    """Parameters in a state, with the step size; not those of forces of others, which kick apart: nothing that is kept depends on them."""
    return {name: value for name, value in state.getParameters().asdict().items() if name.startswith(shared.OWN)} | {shared.DT: dt}
