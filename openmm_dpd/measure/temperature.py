"""The set temperature of a Context, and how to change it."""

import openmm
from openmm import unit

from ..base.errors import ParameterError
from ..base.names import COUNTER, KT, RAMP_STEP, SEED, TEMPERATURE, VOLUME_MOVES
from ..base.openmm_private import bare
from ..base.units import BOLTZMANN, thermal_energy, thermal_energy_of
from ..plan.plan import Plan
from ..simulation.barostat_temperature import set_barostats
from ..simulation.integrators import RAMPED, PairIntegrator


def noise_state(context: openmm.Context, plan: Plan) -> tuple[float, int, int, float]:
    """Thermal energy (kJ/mol), seed, noise counter and step size (ps) of a Context."""
    dt, parameters = bare(context.getIntegrator().getStepSize()), context.getParameters()
    if KT not in parameters:
        native = isinstance(context.getIntegrator(), openmm.DPDIntegrator)
        kT = BOLTZMANN * context.getIntegrator().getTemperature().value_in_unit(unit.kelvin) if native else plan.options.kT
        return kT, plan.options.seed, context.getStepCount(), dt
    return parameters[KT], int(parameters[SEED]), int(parameters[COUNTER]), dt


def check_context(context) -> None:
    """Raise ParameterError if this is no Context."""
    if not isinstance(context, openmm.Context):
        raise ParameterError(f"context must be an openmm.Context, such as simulation.context, not a {type(context).__name__}")


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
    check_context(context)
    kT, integrator = thermal_energy(kT), context.getIntegrator()
    if KT not in context.getParameters():
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
