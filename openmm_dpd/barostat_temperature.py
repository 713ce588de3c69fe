"""The temperature of OpenMM's barostats, which is a context parameter of their own, beside that of the thermostat."""

import openmm

from .errors import PlanError
from .made import BAROSTATS

#: Relative difference that is taken for rounding of kT to kelvin by hand.
_SAME = 0.01


def active_barostats(system: openmm.System) -> list[openmm.Force]:
    """Those of OpenMM's barostats that change the box of a System."""
    return [force for force in system.getForces() if isinstance(force, BAROSTATS) and force.getFrequency() > 0]


def set_barostats(context: openmm.Context, kelvin: float) -> None:
    """Let the barostats of a Context hold the temperature that its thermostat has now."""
    for barostat in active_barostats(context.getSystem()):
        context.setParameter(barostat.Temperature(), kelvin)


def check_barostats(context: openmm.Context, kelvin: float, ramped: bool) -> None:
    """Raise PlanError if a barostat samples volumes at another temperature than the thermostat sets, or that follows a ramp."""
    for barostat in active_barostats(context.getSystem()):
        name, parameter = type(barostat).__name__, barostat.Temperature()
        if ramped:
            raise PlanError(f"a {name} has one temperature; a temperature ramp cannot be combined with it")
        held = context.getParameter(parameter)
        if abs(held - kelvin) > _SAME * kelvin:
            raise PlanError(
                f"the {name} samples volumes at {held:g} K (context parameter {parameter}), but the thermostat is at {kelvin:g} K; "
                "setTemperature of the integrator, set_temperature and set_kT of openmm_dpd set both"
            )
