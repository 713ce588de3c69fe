"""The set temperature of a Context, how to change it, and a check that a run has it.

A time step that is too long first heats the fluid; beads that run away stop a run (``forces/pair_force.py``).
"""

from collections.abc import Sequence

import numpy as np
import openmm
from openmm import unit

from ..base.errors import A_CONTEXT, ParameterError, require
from ..base.names import COUNTER, KT, RAMP_STEP, SEED, TEMPERATURE, VOLUME_MOVES
from ..base.openmm_private import bare
from ..base.stats import block_average
from ..base.units import BOLTZMANN, thermal_energy, thermal_energy_of
from ..kernels.fields import ENERGY, TEMPERATURE as BEAD_TEMPERATURE
from ..plan.plan import Plan
from ..simulation.barostat_temperature import set_barostats
from ..simulation.integrators import RAMPED, PairIntegrator
from .sample import SystemSample


def noise_state(context: openmm.Context, plan: Plan) -> tuple[float, int, int, float]:
    """Thermal energy (kJ/mol), seed, noise counter and step size (ps) of a Context."""
    dt, parameters = bare(context.getIntegrator().getStepSize()), context.getParameters()
    if KT not in parameters:
        native = isinstance(context.getIntegrator(), openmm.DPDIntegrator)
        kT = BOLTZMANN * context.getIntegrator().getTemperature().value_in_unit(unit.kelvin) if native else plan.options.kT
        return kT, plan.options.seed, context.getStepCount(), dt
    return parameters[KT], int(parameters[SEED]), int(parameters[COUNTER]), dt


def set_temperature(context: openmm.Context, temperature) -> None:
    """Set the temperature of a running Context, and of OpenMM's barostats in it.

    Parameters
    ----------
    context : openmm.Context
    temperature : temperature or energy
        A bare number is in kelvin, as in OpenMM's integrators; a Quantity may also be an energy.

    Raises
    ------
    ParameterError
        If the value is out of bounds, the Context has no thermostat of this package, or a ramp would overwrite the value.
    """
    set_kT(context, thermal_energy_of(temperature))


def set_kT(context: openmm.Context, kT) -> None:
    """Set the thermal energy kT of a running Context, and of OpenMM's barostats in it.

    Parameters
    ----------
    context : openmm.Context
    kT : energy or temperature
        A bare number is in kJ/mol, or in reduced units for a reduced scene; a Quantity may be in kelvin.

    Raises
    ------
    ParameterError
        If the value is out of bounds, the Context has no thermostat of this package, or a ramp would overwrite the value.
    """
    require(context, openmm.Context, A_CONTEXT)
    kT, integrator = thermal_energy(kT), context.getIntegrator()
    plain = isinstance(integrator, PairIntegrator) and not {TEMPERATURE, RAMP_STEP} & integrator.variables()
    resting = plain and VOLUME_MOVES not in context.getParameters() and getattr(integrator.whole, "guide", None) is None
    if resting or KT not in context.getParameters():
        native = isinstance(integrator, openmm.DPDIntegrator)
        remedy = "use setTemperature of its DPDIntegrator" if native else "nothing in it has friction or noise"
        raise ParameterError(f"this Context has no thermostat of openmm_dpd; {remedy}")
    if isinstance(integrator, openmm.CustomIntegrator):
        names = map(integrator.getGlobalVariableName, range(integrator.getNumGlobalVariables()))
        if RAMP_STEP in names:
            raise ParameterError(RAMPED)
    if VOLUME_MOVES in context.getParameters():
        raise ParameterError("the beads of this Context have internal temperatures, which follow their energies; see write_fields")
    if isinstance(integrator, PairIntegrator) and TEMPERATURE in integrator.variables():
        integrator.settle(context)
        integrator.agree(context, kT, kelvin(kT))
    else:
        context.setParameter(KT, kT)
    set_barostats(context, kelvin(kT))


def kelvin(kT: float) -> float:
    """Temperature in kelvin of a thermal energy in kJ/mol."""
    return kT / BOLTZMANN


#: Tolerances of a mean temperature: a fraction of the set one, in a shear another, and a number of standard errors.
TOLERANCE, SHEARED, ERRORS = 0.05, 0.01, 4.0
#: Rows before the first check of a running simulation; the number doubles for each next one.
FIRST_LOOK = 20
#: Fewest rows for a warning: the second half of fewer cannot show whether the temperature still changes.
LEAST_ROWS = 6


def sets_temperature(plan: Plan) -> bool:
    """Whether anything sets a temperature; nothing does without friction, or for beads with internal temperatures."""
    return (
        plan.options.thermostat
        and not plan.options.frictionless
        and (plan.spec.fields is None or plan.spec.fields.kind not in (ENERGY, BEAD_TEMPERATURE))
    )


def has_set_temperature(plan: Plan) -> bool:
    """Whether the kinetic temperature of a run should always be the set one.

    It should not with a ramp, where forces on beads are removed, or where a body force or moving wall drives a flow, whose energy counts as
    kinetic.  In a shear it is relative to the flow, and too high if friction does not remove the work of the shear.
    """
    scene = plan.scene
    moving_wall = scene.mobile is not None and scene.velocities is not None and bool(np.any(scene.velocities[~scene.mobile]))
    driven = moving_wall or any(wall.moves for wall in scene.walls) or any(source.pushes for source in scene.sources)
    return (
        sets_temperature(plan)
        and plan.options.ramp is None
        and not (scene.body_forces or plan.options.guided or driven or scene.interacting is not None)
    )


def temperature_warning(kT: Sequence[float], target: float, dof: int, unit: str = "", *, sheared: bool = False) -> str | None:
    """Warning if the mean kinetic temperature of the second half of the rows is not the set one, or None.

    The standard error comes from blocks, and from theory: at equilibrium the kinetic energy of ``dof`` degrees of freedom varies by
    sqrt(2/dof) of its mean, and the part of this variance that rows close in time do not show is in their mean.

    Parameters
    ----------
    kT : sequence of float
        Kinetic temperatures, row by row, at one set temperature.
    target : float
        Set temperature in the same unit; if it is 0, there is no warning.
    dof : int
        Degrees of freedom of a row.
    unit : str
        Unit of temperature in the warning.
    sheared : bool
        Whether the temperatures are those relative to the flow of a shear.  Viscosities depend on a temperature that the shear raises,
        so 1 % counts there, the error of recommended steps, in place of 5 %.
    """
    rows = np.asarray(kT, dtype=float)[len(kT) // 2 :]
    if len(kT) < LEAST_ROWS or target <= 0 or dof <= 0:
        return None
    average = block_average(rows)
    assert average.mean is not None
    # variance of one row; the part that the rows do not show is in their mean
    variance = average.mean**2 * 2.0 / dof
    error = max(average.sem or 0.0, max(variance - rows.var(), variance / len(rows)) ** 0.5)
    off = average.mean - target
    if abs(off) <= max((SHEARED if sheared else TOLERANCE) * target, ERRORS * error):
        return None
    earlier, later = (abs(half.mean() - target) for half in np.array_split(rows, 2))
    if earlier - later > max(variance**0.5, 0.1 * earlier):
        return None  # on its way to the set temperature, as after a quench
    why = (
        "the shear heats the beads faster than friction cools them, or the step size is too large: a run at rest shows which, and lower "
        "rates heat less, with the square of the rate"
        if sheared and off > 0
        else "the step size may be too large, or the beads flow or are not equilibrated"
    )
    return (
        f"the kinetic temperature of the last {len(rows)} rows{' relative to the flow' * sheared} is {average.mean:.4g}{unit}, "
        f"{100 * abs(off) / target:.3g} % {'above' if off > 0 else 'below'} the set {target:.4g}{unit}; {why}"
    )


class TemperatureWatch:
    """Compares the temperature of a running simulation with the set one after 20, 40, 80, ... rows, until the first warning.

    Rows count from the last change of the set temperature.

    Parameters
    ----------
    plan : Plan
    """

    def __init__(self, plan: Plan):
        self._quiet, self._sheared = not has_set_temperature(plan), plan.scene.shear is not None
        self._target, self._rows, self._look = 0.0, list[float](), FIRST_LOOK

    def add(self, sample: SystemSample) -> str | None:
        """Add a row; return a warning, once, or None."""
        if self._quiet:
            return None
        if sample.target_kT != self._target:
            self._target, self._rows, self._look = sample.target_kT, [], FIRST_LOOK
        self._rows.append(sample.kT)
        if len(self._rows) < self._look:
            return None
        self._look *= 2
        wrong = temperature_warning(self._rows, self._target, sample.dof, " kJ/mol", sheared=self._sheared)
        self._quiet = wrong is not None
        return wrong
