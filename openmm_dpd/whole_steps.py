"""Many whole steps at once: from a Context to the kernel's loop and back.

This is what :meth:`openmm_dpd.integrators.PairIntegrator.step` does where the pair force holds every fast force.  The program of the
integrator does the same step by step, with the same bits; here positions and velocities pass once for many steps.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import openmm

from .errors import RunError
from .fields import per_dof
from .forces.pair_force import PairForceFunction, fingerprint, in_block, unfolded
from .kernels import motion
from .kernels.fields import ENERGY
from .kernels.steps import Moment, StepSpec
from .names import AHEAD, COUNTER, DT, FIELD, KT, RAMP_STEP, SEED, SEEN_KT, SEEN_TEMPERATURE, STAMP, TAU, TEMPERATURE
from .units import BOLTZMANN

if TYPE_CHECKING:
    from .integrators import PairIntegrator


class WholeSteps:
    """Carries out steps of one System.

    Parameters
    ----------
    function : PairForceFunction
        The callable of the pair force, which holds the terms and the arrays.
    pair_group : int
        Force group of that force.
    tau_ratio, trial : float, float or None
        Trial drift with which a program shows velocities, in units of the step size, or (if not None) in ps.
    """

    def __init__(self, function: PairForceFunction, pair_group: int, tau_ratio: float, trial: float | None):
        self.function, self.pair_group, self.tau_ratio, self.trial = function, pair_group, tau_ratio, trial
        self._held: tuple[float, dict[str, np.ndarray]] = (0.0, {})

    @property
    def spec(self) -> StepSpec:
        """What a step is."""
        assert self.function.steps is not None
        return self.function.steps

    def run(self, integrator: PairIntegrator, context: openmm.Context, n: int, *, slow: bool, barostats: bool) -> None:
        """Carry out n steps; the Context is not touched before all are done, but for the forces that stay OpenMM's.

        Parameters
        ----------
        slow : bool
            Whether there are such forces.
        barostats : bool
            Whether something has to hear of the steps: it acts at the end of them all.

        Raises
        ------
        RunError
            If a step fails, with its number.
        """
        function, here = self.function, self.function.here()
        self._settle_temperature(integrator, context)
        state = context.getState(positions=True, velocities=True, parameters=True)
        count, time, parameters = state.getStepCount(), state.getTime()._value, state.getParameters()
        dt = integrator.getStepSize()._value
        try:
            moment = self._moment(integrator, state, parameters, dt, here)
            loop, begun = here.loop, moment.counter
            done = time
            if slow:
                groups = integrator.getIntegrationForceGroups() & ~(1 << self.pair_group)
                times = iter(range(count, count + n + 1))

                def forces(m: Moment) -> np.ndarray:
                    nonlocal done
                    number = next(times)
                    if number > count:
                        done += dt
                        context.setPositions(m.x)
                        context.setStepCount(number)
                        context.setTime(done)
                    return context.getState(forces=True, groups=groups).getForces(asNumpy=True)._value

                loop.run(moment, n, forces)
            else:
                loop.run(moment, n)
        except RunError as error:
            raise RunError(f"step {count + getattr(error, 'steps_done', 0) + 1}: {error}") from error
        for _ in range(n):  # as OpenMM adds it up
            time += dt
        here.conserved_energy = None
        self._give_back(integrator, context, state, moment, begun, here)
        if barostats:
            context.setStepCount(count)
            context.setTime(state.getTime())
            openmm.CustomIntegrator.setGlobalVariableByName(integrator, AHEAD, float(n))
            try:
                openmm.CustomIntegrator.step(integrator, n)
            finally:
                openmm.CustomIntegrator.setGlobalVariableByName(integrator, AHEAD, 0.0)
        else:
            context.setStepCount(count + n)
            context.setTime(time)

    def _settle_temperature(self, integrator: PairIntegrator, context: openmm.Context) -> None:
        """Which of the temperature in kelvin and the thermal energy was set since the last step holds, as the program has it."""
        if TEMPERATURE not in integrator.variables():
            return
        get, put = integrator.getGlobalVariableByName, openmm.CustomIntegrator.setGlobalVariableByName
        kelvin, kT = get(TEMPERATURE), context.getParameter(KT)
        if kelvin != get(SEEN_TEMPERATURE):
            kT = BOLTZMANN * kelvin
            context.setParameter(KT, kT)
        elif kT != get(SEEN_KT):
            kelvin = kT / BOLTZMANN
            put(integrator, TEMPERATURE, kelvin)
        else:
            return
        put(integrator, SEEN_KT, kT)
        put(integrator, SEEN_TEMPERATURE, kelvin)

    def _moment(self, integrator: PairIntegrator, state, parameters, dt: float, here) -> Moment:
        """What the first step begins with."""
        function, spec = self.function, self.spec
        if not dt > 0.0:
            raise RunError(f"the step size must be > 0, but the integrator's is {dt:g} ps")
        x, box = function.positions(state), function.box(state)
        v = state.getVelocities(asNumpy=True)._value.copy()
        v[function.spec.inv_mass == 0.0] = 0.0
        tau = dt * self.tau_ratio if self.trial is None else self.trial
        kT = function.thermal_energy(parameters)
        moment = Moment(x.copy(), v, box, dt, tau, kT, int(parameters[SEED]), int(parameters[COUNTER]))
        if spec.ramp is not None:
            moment.ramped = integrator.getGlobalVariableByName(RAMP_STEP)
        names = self._variables()
        values = self._values(integrator, names)
        fields = function.spec.fields
        if fields is not None:
            blocks = [values[f"{FIELD}{k}"].copy() for k in range(fields.n_blocks)]
            moment.values = self._shown_blocks(x, blocks, here)
        if spec.predicts:
            valid = function.note(here, x, box, parameters) == integrator.getGlobalVariableByName("last")
            if fields is not None:
                moment.rates = unfolded([values[f"rate{k}"] for k in range(fields.n_blocks)], fields)
            if valid:
                moment.acc = values["acc"].copy()
        return moment

    def _shown_blocks(self, x: np.ndarray, blocks: list[np.ndarray], here) -> np.ndarray:
        """Fields as a program would show them first: three values at a time, of which energies add two up."""
        spec = self.function.spec.fields
        for block in blocks:
            motion.as_shown(x, block, self.spec.field_shown, self.function.spec.inv_mass)
            if spec.kind == ENERGY:
                block[:, 1] += block[:, 2]
        values = unfolded(blocks, spec)
        return np.where(spec.immobile[:, None], here.fields.values, values)

    def _give_back(self, integrator: PairIntegrator, context: openmm.Context, state, moment: Moment, begun: int, here) -> None:
        """Put what the last step left into the Context."""
        function, spec = self.function, self.spec
        put = openmm.CustomIntegrator.setGlobalVariableByName
        still = function.spec.inv_mass == 0.0
        if still.any():
            moment.v[still] = state.getVelocities(asNumpy=True)._value[still]
        context.setPositions(moment.x)
        context.setVelocities(moment.v)
        context.setParameter(COUNTER, float(moment.counter))
        context.setParameter(TAU, moment.tau)
        context.setParameter(DT, moment.dt)
        if spec.ramp is not None:
            context.setParameter(KT, moment.kT)
            put(integrator, RAMP_STEP, moment.ramped)
        held: dict[str, np.ndarray] = {}
        if moment.values is not None:
            here.fields.values = moment.values
            for k in range(function.spec.fields.n_blocks):
                held[f"{FIELD}{k}"] = in_block(moment.values, k)
                if spec.predicts:
                    held[f"rate{k}"] = in_block(moment.rates, k)
        if spec.predicts:
            held["acc"] = moment.acc
            if moment.predicted is not None:
                held["vp"] = moment.predicted
            after = context.getState(positions=True, parameters=True)
            put(integrator, "last", function.note(here, function.positions(after), function.box(after), after.getParameters()))
            put(integrator, "here", integrator.getGlobalVariableByName("last"))
        for name, values in held.items():
            openmm.CustomIntegrator.setPerDofVariableByName(integrator, name, values)
        if held:
            stamp = fingerprint(np.concatenate([held[name] for name in self._variables()]), np.zeros(0))
            put(integrator, STAMP, stamp)
            self._held = stamp, held

    def _variables(self) -> list[str]:
        """Per-DOF variables with which a step begins."""
        fields = self.function.spec.fields
        blocks = 0 if fields is None else fields.n_blocks
        names = [f"{FIELD}{k}" for k in range(blocks)]
        return [*names, *(f"rate{k}" for k in range(blocks)), "acc"] if self.spec.predicts else names

    def _values(self, integrator: PairIntegrator, names: list[str]) -> dict[str, np.ndarray]:
        """Their values; asking OpenMM takes longer than some steps, so those that were set here last are remembered with a fingerprint."""
        if not names:
            return {}
        stamp, held = self._held
        if held and stamp == integrator.getGlobalVariableByName(STAMP):
            return held
        return {name: per_dof(integrator, name) for name in names}


__all__ = ["WholeSteps"]
