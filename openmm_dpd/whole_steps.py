"""Many whole steps at once: from a Context to the kernel's loop and back.

:meth:`openmm_dpd.integrators.PairIntegrator.step` uses this where the pair force computes every fast force.  The program of the
integrator does the same step by step, with the same bits; this way positions and velocities are copied once for many steps.
"""

from itertools import accumulate

import numpy as np
import openmm

from . import names as shared
from .errors import RunError
from .execution import DOUBLE_PLATFORMS
from .fields import per_dof
from .forces.pair_force import Fields, PairForceFunction, fingerprint, unfolded, vectors
from .integrators import PairIntegrator
from .kernels import motion
from .kernels.steps import Moment, StepSpec
from .names import FIELD, RATES
from .units import BOLTZMANN
from .wording import in_units


class WholeSteps:
    """Does steps of one System.

    Parameters
    ----------
    function : PairForceFunction
        The callable of the pair force, with its terms and arrays.
    pair_group : int
        Force group of that force.
    """

    def __init__(self, function: PairForceFunction, pair_group: int):
        self.function, self.pair_group = function, pair_group
        self._held: tuple[float, dict[str, np.ndarray]] = (0.0, {})

    @property
    def spec(self) -> StepSpec:
        """What a step is."""
        assert self.function.steps is not None
        return self.function.steps

    def run(self, integrator: PairIntegrator, context: openmm.Context, n: int, *, slow: bool, barostats: bool) -> None:
        """Do n steps.  Before they are done the Context is changed only where OpenMM's forces need it.

        Parameters
        ----------
        slow : bool
            Whether forces of OpenMM act.
        barostats : bool
            Whether a barostat acts: it does at the end of all these steps.

        Raises
        ------
        openmm.OpenMMException
            If a step fails, with its number, as the program reports it.
        """
        own = self.function.thread_state()
        self._settle_temperature(integrator, context)
        dt = integrator.getStepSize()._value
        state = context.getState(positions=True, velocities=True, parameters=True)
        # the step size as the program would set it first
        count, parameters = state.getStepCount(), state.getParameters().asdict() | {shared.DT: dt}
        clock = list(accumulate([dt] * n, initial=state.getTime()._value))  # as OpenMM adds it up
        try:
            moment = self._moment(integrator, state, parameters, dt, own)
            loop = own.loop
            used = integrator.getIntegrationForceGroups()
            groups = {group for group in range(32) if used >> group & 1} - {self.pair_group}

            def forces(m: Moment, done: int) -> np.ndarray:
                if done:
                    context.setPositions(m.x)
                    context.setStepCount(count + done)
                    context.setTime(clock[done])
                    if self.spec.ramp is not None:
                        context.setParameter(shared.KT, m.kT)
                return context.getState(forces=True, groups=groups).getForces(asNumpy=True)._value

            loop.run(moment, n, forces if slow else None)
        except RunError as error:
            raise openmm.OpenMMException(f"step {count + getattr(error, 'steps_done', 0) + 1}: {error}") from error
        reached = (count, clock[0]) if barostats else (count + n, clock[-1])
        try:
            self._give_back(integrator, context, state, parameters, moment, own, reached)
        except BaseException:
            self._give_back(integrator, context, state, parameters, moment, own, reached)  # all of it, wherever that was interrupted
            raise
        if barostats:
            openmm.CustomIntegrator.setGlobalVariableByName(integrator, shared.AHEAD, float(n))
            try:
                openmm.CustomIntegrator.step(integrator, n)
                context.setTime(clock[-1])  # OpenMM counts with the step size that the Context was made with
            finally:
                openmm.CustomIntegrator.setGlobalVariableByName(integrator, shared.AHEAD, 0.0)

    def _settle_temperature(self, integrator: PairIntegrator, context: openmm.Context) -> None:
        """Which of the temperature in kelvin and the thermal energy was set since the last step holds, as the program has it."""
        if shared.TEMPERATURE not in integrator.variables():
            return
        get = integrator.getGlobalVariableByName
        kelvin, kT = get(shared.TEMPERATURE), context.getParameter(shared.KT)
        if kelvin != get(shared.SEEN_TEMPERATURE):
            integrator.agree(context, BOLTZMANN * kelvin, kelvin)
        elif kT != get(shared.SEEN_KT):
            integrator.agree(context, kT, kT / BOLTZMANN)

    def _moment(self, integrator: PairIntegrator, state, parameters, dt: float, own) -> Moment:
        """The state in which the first step begins."""
        function, spec = self.function, self.spec
        if not dt > 0.0:
            raise RunError(f"the step size must be > 0, but the integrator's is {in_units(dt, 'time')}")
        x, box = function.positions(state), function.box(state)
        function.scale_body_forces(own, parameters)
        v = vectors(state, openmm.State.Velocities)
        v[own.loop.still] = 0.0
        kT = function.thermal_energy(parameters)
        moment = Moment(x.copy(), v, box, dt, kT, int(parameters[shared.SEED]), int(parameters[shared.COUNTER]))
        if spec.slow_every > 1:
            moment.slow_step = int(integrator.getGlobalVariableByName(shared.SLOW_STEP))
        if spec.ramp is not None:
            moment.ramped = integrator.getGlobalVariableByName(shared.RAMP_STEP)
        values = self._values(integrator, list(self._variables()))
        fields = function.spec.fields
        if fields is not None:
            blocks = [values[f"{FIELD}{k}"].copy() for k in range(fields.n_blocks)]
            moment.values = self._shown_blocks(x, blocks, own.fields)
        if spec.predicts:
            valid = function.fingerprint(own, x, box, parameters) == integrator.getGlobalVariableByName("valid_for")
            if fields is not None:
                moment.rates = unfolded([values[f"rate{k}"] for k in range(fields.n_blocks)], fields)
            if valid:
                moment.acc = values["acc"].copy()
        return moment

    def _shown_blocks(self, x: np.ndarray, blocks: list[np.ndarray], fields: Fields) -> np.ndarray:
        """Values as a program would show them first: three at a time; those of immobile beads as they stand in the Context."""
        for k, block in enumerate(blocks):
            held = block[fields.spec.immobile]
            motion.as_shown(x, block, self.spec.field_shown, self.function.spec.inv_mass)
            fields.read(k, block, held)
        return fields.values.copy()

    def _give_back(
        self, integrator: PairIntegrator, context: openmm.Context, state, parameters, moment: Moment, own, reached: tuple[int, float]
    ) -> None:
        """Write the result of the last step into the Context."""
        function, spec = self.function, self.spec
        put = openmm.CustomIntegrator.setGlobalVariableByName
        still = own.loop.still
        if len(still):
            moment.v[still] = vectors(state, openmm.State.Velocities)[still]
        context.setPositions(moment.x)
        context.setVelocities(moment.v)
        context.setParameter(shared.COUNTER, float(moment.counter))
        context.setParameter(shared.TAU, shared.SHOWN)
        context.setParameter(shared.DT, moment.dt)
        if spec.slow_every > 1:
            put(integrator, shared.SLOW_STEP, float(moment.slow_step))
        if spec.ramp is not None:
            assert moment.ramped is not None
            context.setParameter(shared.KT, moment.kT)
            parameters[shared.KT] = moment.kT
            put(integrator, shared.RAMP_STEP, moment.ramped)
        if moment.values is not None:
            own.fields.values = moment.values
        held = {name: moment.block(block) for name, block in self._variables().items()}
        if spec.predicts:
            if moment.predicted is not None:
                held["vp"] = moment.predicted
            x, box = moment.x, moment.box
            if context.getPlatform().getName() in DOUBLE_PLATFORMS:
                own.fingerprinted = None  # these beads were not just folded
            else:  # positions are rounded there, and beads wrapped
                after = context.getState(positions=True)
                x, box = function.positions(after), function.box(after)
            last = function.fingerprint(own, x, box, parameters)
            put(integrator, "valid_for", last)
            put(integrator, "fingerprint", last)
        for name, values in held.items():
            openmm.CustomIntegrator.setPerDofVariableByName(integrator, name, values)
        if held:
            stamp = fingerprint(next(iter(held.values())) if len(held) == 1 else np.concatenate(list(held.values())), np.zeros(0))
            put(integrator, shared.STAMP, stamp)
            self._held = stamp, held
        context.setStepCount(reached[0])
        context.setTime(reached[1])

    def _variables(self) -> dict[str, int]:
        """Per-DOF variables with which a step begins, and the numbers of their blocks."""
        fields, predicts = self.function.spec.fields, self.spec.predicts
        blocks = range(0 if fields is None else fields.n_blocks)
        names = {f"{FIELD}{k}": k for k in blocks}
        return names | {f"rate{k}": RATES + k for k in blocks} | {"acc": shared.ACCELERATION} if predicts else names

    def _values(self, integrator: PairIntegrator, names: list[str]) -> dict[str, np.ndarray]:
        """Their values."""
        return {name: per_dof(integrator, name) for name in names}

    def kept(self, integrator: PairIntegrator) -> dict[str, np.ndarray]:
        """Those written last, if they are still there: reading them from OpenMM takes longer than some steps."""
        stamp, held = self._held
        return held if held and stamp == integrator.getGlobalVariableByName(shared.STAMP) else {}
