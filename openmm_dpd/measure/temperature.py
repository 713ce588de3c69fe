"""Thermal energies of a Context: what is set, and setting it."""

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
    """Thermal energy, seed, noise counter and step size of a Context."""
    dt, parameters = bare(context.getIntegrator().getStepSize()), context.getParameters()
    if KT not in parameters:
        native = isinstance(context.getIntegrator(), openmm.DPDIntegrator)
        kT = BOLTZMANN * context.getIntegrator().getTemperature().value_in_unit(unit.kelvin) if native else plan.options.kT
        return kT, plan.options.seed, context.getStepCount(), dt
    return parameters[KT], int(parameters[SEED]), int(parameters[COUNTER]), dt


def check_context(context) -> None:
    """Raise ParameterError if this is no Context."""
    if not isinstance(context, openmm.Context):
        raise ParameterError(f"an openmm.Context is wanted here (simulation.context), not a {type(context).__name__}")


def set_temperature(context: openmm.Context, temperature) -> None:
    """Set the temperature of a running Context, that of OpenMM's barostats in it as well.

    Parameters
    ----------
    context : openmm.Context
    temperature : temperature or energy
        Bare numbers are kelvin, as for OpenMM's integrators; a Quantity may also be an energy.

    Raises
    ------
    ParameterError
        If the value is out of bounds, or the Context has no such parameter or a ramp that would overwrite it.
    """
    set_kT(context, thermal_energy_of(temperature))


def set_kT(context: openmm.Context, kT) -> None:
    """Set the thermal energy of a running Context: :func:`set_temperature` for reduced units.

    Parameters
    ----------
    context : openmm.Context
    kT : energy or temperature
        Bare numbers are kJ/mol; a Quantity may be in kelvin.

    Raises
    ------
    ParameterError
        As :func:`set_temperature`.
    """
    check_context(context)
    kT, integrator = thermal_energy(kT), context.getIntegrator()
    if KT not in context.getParameters():
        native = isinstance(integrator, openmm.DPDIntegrator)
        remedy = "use setTemperature of its DPDIntegrator" if native else "nothing in it has friction or noise"
        raise ParameterError(f"this Context has no thermostat of openmm_dpd's; {remedy}")
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
