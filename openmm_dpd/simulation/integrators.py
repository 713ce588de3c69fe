"""The integrators of this package, with a temperature and a seed as OpenMM's own integrators have them."""

from __future__ import annotations

import time
from dataclasses import replace
from typing import Any, Protocol

import numpy as np
import openmm
from openmm import unit

from ..base.errors import ParameterError, what_is
from ..base.names import AHEAD, BY_SEED, FIRST, KT, LAST, RAMP_STEP, SEED, SEEN_KT, SEEN_TEMPERATURE, SHOWN, SLOW_STEP, STAMP, TEMPERATURE
from ..base.units import BOLTZMANN, to_md
from ..plan.choices import checked_seed
from ..plan.forces.thread_state import Shown
from .barostat_temperature import set_barostats
from .fields import check_written, hand_over, raw_bonds, raw_fields
from .watching import MOST, PIECE, STRAIGHT, Watching

#: Lines of a program (kind, target, expression, why) that reconcile temperature and thermal energy: whichever was set last holds, and the
#: other one follows.  Which one that is follows from their values when they last agreed.  :meth:`PairIntegrator.settle` does this before
#: steps; programs need it because OpenMM may execute them by itself.  A thermal energy that is not changed keeps its bits.
AGREE = (
    ("if", "", f"abs({TEMPERATURE}-{SEEN_TEMPERATURE})+abs({KT}-{SEEN_KT}) > 0", "was one of them set?"),
    ("if", "", f"{TEMPERATURE} != {SEEN_TEMPERATURE}", "was it the temperature?"),
    ("global", KT, f"{BOLTZMANN!r}*{TEMPERATURE}", ""),
    ("global", SEEN_KT, KT, ""),
    ("end", "", "", ""),
    ("if", "", f"{KT} != {SEEN_KT}", "was it the thermal energy?"),
    ("global", TEMPERATURE, f"{KT}/{BOLTZMANN!r}", ""),
    ("end", "", "", ""),
    ("global", SEEN_KT, KT, ""),
    ("global", SEEN_TEMPERATURE, TEMPERATURE, ""),
    ("end", "", "", ""),
)


class StepsAtOnce(Protocol):
    """Carries out many whole steps of a Context (:class:`openmm_dpd.simulation.whole_steps.WholeSteps`)."""

    function: Any
    guide: Any
    pair_group: int

    def run(self, integrator: PairIntegrator, context: openmm.Context, n: int, *, slow: bool, barostats: bool) -> None:
        """Carry out n steps; ``slow``: some forces are OpenMM's, ``barostats``: a barostat acts behind them."""

    def kept(self, integrator: PairIntegrator) -> dict[str, np.ndarray]:
        """Per-DOF variables that the last steps have written, by name, if nobody has changed any since."""


class PairIntegrator(Watching, openmm.CustomIntegrator):
    """A scheme of this package: a CustomIntegrator with a temperature and a seed, as OpenMM's own integrators have them.

    Where a CustomIntegrator has them, ``temperature`` (kelvin), :meth:`setTemperature`, :func:`openmm_dpd.set_temperature` and the
    context parameter ``dpd_kT`` (kJ/mol) all set the thermostat, and whichever was set last holds.
    """

    _variables: frozenset[str] = frozenset()
    _touched = True
    whole: StepsAtOnce | None
    _shown: Shown | None = None

    def _take(self, context: openmm.Context, steps: int) -> None:
        if self.whole is None and FIRST in self.variables() and steps > 1:
            with self._or_back(context):
                for n, first, last in ((1, 1.0, 0.0), (steps - 2, 0.0, 0.0), (1, 0.0, 1.0), (0, 1.0, 1.0)):
                    self.setGlobalVariableByName(FIRST, first)
                    self.setGlobalVariableByName(LAST, last)
                    openmm.CustomIntegrator.step(self, n)
        elif self.whole is None:
            super()._take(context, steps)
        elif self.beside:
            with self._or_back(context):
                self.whole.run(self, context, steps, slow=self._slow, barostats=self._barostats)
        else:  # the Context is not changed before all steps are done, so there is nothing to go back from
            begun = time.monotonic()
            self.whole.run(self, context, steps, slow=False, barostats=False)
            self.straight = int(min(max(PIECE, steps * STRAIGHT / max(time.monotonic() - begun, 1e-6)), 2 * self.straight, MOST))
        if self.whole is None:
            self._show_now(context)  # OpenMM's minimizer asks for forces without a look before

    def variables(self) -> frozenset[str]:
        """Names of the global variables."""
        if len(self._variables) != self.getNumGlobalVariables():
            self._variables = frozenset(map(self.getGlobalVariableName, range(self.getNumGlobalVariables())))
        return self._variables

    def _take_kT(self, context: openmm.Context, kT: float) -> None:
        if TEMPERATURE in self.variables():
            self.agree(context, kT, kT / BOLTZMANN)
        elif KT in context.getParameters() and RAMP_STEP not in self.variables():
            context.setParameter(KT, kT)

    def bind(self, context: openmm.Context) -> None:
        """Called when the Context was made or reinitialized.  Forces of others may have changed since a program stored an acceleration."""
        super().bind(context)
        self._touched = True
        if self._mixed and self.whole is None:
            self._forget_acceleration()
        self._show_now(context)

    def changed(self, context: openmm.Context, ours: bool = True) -> None:
        """Called before the state of the Context is changed from outside; a device notices only changes of positions and box by itself, and
        of forces of others."""
        super().changed(context, ours)
        if self.device_group is not None and ours:
            self._touched = True
            self._forget_acceleration()

    def looked(self, context: openmm.Context, forces: bool) -> None:
        """Called before the state of the Context is read; for forces, the pair force gets the fields and bonds of this Context."""
        super().looked(context, forces)
        if forces:
            self._show_now(context)
            if self.device_group is not None and self._touched:
                hand_over(context, self.device_group)

    def _show_now(self, context: openmm.Context) -> None:
        if self.shown_to is not None:
            spec = self.shown_to.spec
            values = None if spec.fields is None else raw_fields(context, spec.fields)
            self.show(context, raw_bonds(self) if spec.sorts else None, values)

    def show(self, context: openmm.Context, bonds: np.ndarray | None, values: np.ndarray | None) -> float:
        """Have the forces in a Context depend on a table of bonds, and on values of fields if they act; returns the number of both."""
        self._shown, parameters = Shown.of(self.shown_to.spec, bonds, values), context.getParameters()
        if SHOWN in parameters and parameters[SHOWN] != self._shown.number:
            openmm.Context.setParameter(context, SHOWN, self._shown.number)
        return self._shown.number

    def _announce(self, steps: int) -> None:
        put = openmm.CustomIntegrator.setGlobalVariableByName
        if self._touched:
            check_written(self.context())
        put(self, AHEAD, float(steps))
        if self.getGlobalVariableByName("valid_for") != 1.0:
            put(self, "valid_for", -1.0)  # forces of others may have other parameters than in the last call
        elif not self._touched:
            put(self, "valid_for", 2.0 if self._mixed else 0.0)  # the pair force has kept it since the last step
        self._touched = False

    def _forget_acceleration(self) -> None:
        if "valid_for" in self.variables():
            openmm.CustomIntegrator.setGlobalVariableByName(self, "valid_for", -1.0)

    def _begin(self, context: openmm.Context) -> None:
        names, parameters, put = self.variables(), context.getParameters(), openmm.CustomIntegrator.setGlobalVariableByName
        assert self.made is not None
        self._forget_acceleration()  # a reinitialized Context has lost its variables
        self._forget()
        for name in (RAMP_STEP, SLOW_STEP) if self._begun else ():
            if name in names:
                put(self, name, 0.0)
        if TEMPERATURE in names:
            # a thermal energy that was set in this Context is later than what the integrator had before
            earlier = parameters[KT] != self.made.kT
            put(self, SEEN_TEMPERATURE, self.getGlobalVariableByName(TEMPERATURE) if earlier else self.made.kT / BOLTZMANN)
            put(self, SEEN_KT, self.made.kT)
            self._agree_on_temperature(context)
            if context.getParameter(KT) != self.made.kT:
                set_barostats(context, self.getGlobalVariableByName(TEMPERATURE))
        if self._begun and self.made.seed is None and SEED in parameters and parameters[SEED] == parameters[BY_SEED]:
            context.setParameter(SEED, checked_seed(None))  # nobody asked for the same noise in every Context

    def settle(self, context: openmm.Context) -> None:
        """Begin a new Context or check where its state comes from; the one of temperature and thermal energy that was set last holds."""
        super().settle(context)
        if self.made is not None and TEMPERATURE in self.variables() and KT in context.getParameters():
            self._agree_on_temperature(context)

    def _agree_on_temperature(self, context: openmm.Context) -> None:
        """Reconcile temperature and thermal energy, as the lines :data:`AGREE` of a program do."""
        kelvin, kT = self.getGlobalVariableByName(TEMPERATURE), context.getParameter(KT)
        if kelvin != self.getGlobalVariableByName(SEEN_TEMPERATURE):
            self.agree(context, BOLTZMANN * kelvin, kelvin)
        elif kT != self.getGlobalVariableByName(SEEN_KT):
            self.agree(context, kT, kT / BOLTZMANN)

    def agree(self, context: openmm.Context, kT: float, kelvin: float) -> None:
        """Set thermal energy (kJ/mol) and the same temperature in kelvin together, so that a later change of one of them is noticed."""
        put = openmm.CustomIntegrator.setGlobalVariableByName
        context.setParameter(KT, kT)
        put(self, TEMPERATURE, kelvin)
        put(self, SEEN_TEMPERATURE, kelvin)
        put(self, SEEN_KT, kT)

    def getTemperature(self) -> unit.Quantity:
        """The temperature of the thermostat, kelvin; on a temperature ramp, that of the present step.

        Raises
        ------
        ParameterError
            If there is no thermostat with one temperature.
        """
        names, context = self.variables(), self.context()
        if not names & {TEMPERATURE, RAMP_STEP}:
            raise ParameterError(_NOT_SETTABLE)
        if context is None:
            value = self.getGlobalVariableByName(TEMPERATURE) if TEMPERATURE in names else self.made.kT / BOLTZMANN  # type: ignore[union-attr]
            return value * unit.kelvin
        self.settle(context)
        return self._kelvin(context) * unit.kelvin

    def _kelvin(self, context: openmm.Context) -> float | None:
        if TEMPERATURE in self.variables():
            return self.getGlobalVariableByName(TEMPERATURE)
        return context.getParameter(KT) / BOLTZMANN if RAMP_STEP in self.variables() else None

    def setTemperature(self, temperature) -> None:
        """Set the temperature of the thermostat, and of OpenMM's barostats beside it.

        Parameters
        ----------
        temperature : temperature
            Bare numbers: kelvin, as for OpenMM's integrators.

        Raises
        ------
        ParameterError
            If it is no temperature, or none can be set: it follows a ramp, nothing has friction or noise, or beads have temperatures of
            their own.
        """
        names = self.variables()
        if TEMPERATURE not in names:
            raise ParameterError(RAMPED if RAMP_STEP in names else _NOT_SETTABLE)
        kelvin = to_md(temperature, "temperature", "the temperature")
        if not isinstance(kelvin, float) or not 0.0 <= kelvin < np.inf:
            raise ParameterError(f"the temperature must be a single number of kelvin >= 0, not {what_is(temperature)}")
        context, put = self.context(), openmm.CustomIntegrator.setGlobalVariableByName
        if context is None:  # for the next step to take, regardless of what it took before
            put(self, TEMPERATURE, kelvin)
            put(self, SEEN_TEMPERATURE, -1.0)
        elif kelvin != self.getTemperature().value_in_unit(unit.kelvin):
            self.agree(context, BOLTZMANN * kelvin, kelvin)
            set_barostats(context, kelvin)

    def setGlobalVariableByName(self, name: str, value) -> None:
        """Set a global variable; ``temperature`` is :meth:`setTemperature`."""
        if name == TEMPERATURE:
            self.setTemperature(value)
        else:
            super().setGlobalVariableByName(name, value)

    def setGlobalVariable(self, index: int, value) -> None:
        """Set a global variable by its number; ``temperature`` is :meth:`setTemperature`."""
        self.setGlobalVariableByName(self.getGlobalVariableName(index), value)

    def setPerDofVariableByName(self, name: str, values) -> None:
        """Set a per-DOF variable by its name."""
        super().setPerDofVariableByName(name, values)
        self._forget()
        if self.device_group is not None:
            self._touched = True
            self._forget_acceleration()
        context = self.context() if self.shown_to is not None else None
        if context is not None:
            self.looked(context, True)

    def setPerDofVariable(self, index: int, values) -> None:
        """Set a per-DOF variable by its number."""
        self.setPerDofVariableByName(self.getPerDofVariableName(index), values)

    def getPerDofVariableByName(self, name: str):
        """A per-DOF variable by its name; openmm.OpenMMException if a device has failed in the steps before."""
        context = self.context() if self.device_group is not None else None
        if context is not None:
            self.verify(context)
        return super().getPerDofVariableByName(name)

    def _forget(self) -> None:
        """Note that per-DOF variables may differ from what a loop of steps has written."""
        if STAMP in self.variables():
            openmm.CustomIntegrator.setGlobalVariableByName(self, STAMP, 0.0)

    def setRandomNumberSeed(self, seed: int) -> None:
        """Set the seed of the noise, and that of OpenMM's barostats in Contexts that are made later; 0 draws a seed, as in OpenMM.

        The noise has it from the next step on, also in a state that was loaded with another seed.
        """
        super().setRandomNumberSeed(seed)
        if self.made is not None:
            chosen, context = int(seed) % 2**31 or checked_seed(None), self.context()
            self.made = replace(self.made, seed=chosen)
            if context is not None:
                self.settle(context)
                self._take_seed(context, chosen)


class NativeIntegrator(Watching, openmm.DPDIntegrator):
    """OpenMM's own DPDIntegrator."""

    def step(self, steps: int) -> None:
        """Take steps, see :meth:`Watching.step`; a step size of 0, which OpenMM would turn into NaN, is an error."""
        dt = self.getStepSize().value_in_unit(unit.picosecond)
        if not dt > 0:
            raise openmm.OpenMMException(f"the step size must be > 0, but the integrator's is {dt:g} ps")
        super().step(steps)

    def _kelvin(self, context: openmm.Context) -> float | None:
        return self.getTemperature().value_in_unit(unit.kelvin)


#: Why a temperature cannot be set.
RAMPED = "the temperature of this Context follows a ramp, which would overwrite it at the next step"
_NOT_SETTABLE = "there is no temperature to set: nothing has friction or noise, or the beads have temperatures of their own (write_fields)"
