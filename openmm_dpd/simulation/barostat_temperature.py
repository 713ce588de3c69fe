"""OpenMM's barostats beside a thermostat: each has a context parameter for its temperature, which has to be that of the thermostat."""

import logging

import openmm

from ..base.errors import PlanError
from ..base.names import CONVERTED
from ..base.units import BAR_PER_MD_PRESSURE, BOLTZMANN
from ..plan.made import BAROSTATS, Made

_LOGGER = logging.getLogger("openmm_dpd")
#: Largest relative difference of two temperatures that passes for rounding when kT is converted to kelvin by hand.
_SAME = 0.01
#: Temperatures (kelvin) between which a scene is taken to have real units, not reduced ones; kT = 1 is 120 K.
_EVERYDAY = (200.0, 600.0)


def barostats(context: openmm.Context) -> list[openmm.Force]:
    """OpenMM's barostats in a Context, switched on or not; those added to the System later are not in it."""
    found = [force for force in context.getSystem().getForces() if isinstance(force, BAROSTATS)]
    parameters = context.getParameters() if found else {}
    return [force for force in found if force.Temperature() in parameters]


def tell_pressures(context: openmm.Context, made: Made) -> None:
    """Warn what the pressures of barostats that the user has made, in bar, are in the units of a reduced scene."""
    if made.maker != "build()" or _EVERYDAY[0] < made.kT / BOLTZMANN < _EVERYDAY[1]:
        return
    for barostat in barostats(context):
        if barostat.getName() != CONVERTED:
            names = [name for name in ("Pressure", "PressureX", "PressureY", "PressureZ") if hasattr(barostat, name)]
            bar = [context.getParameter(getattr(barostat, name)()) for name in names]
            _LOGGER.warning(
                "the %s holds %s bar, which is %s in the units of a scene (kJ/mol/nm^3); openmm_dpd.add_barostat takes pressures in these",
                type(barostat).__name__,
                *(", ".join(f"{value:g}" for value in values) for values in (bar, [value / BAR_PER_MD_PRESSURE for value in bar])),
            )


def set_barostats(context: openmm.Context, kelvin: float) -> None:
    """Set the temperature of the barostats of a Context to that of its thermostat."""
    for barostat in barostats(context):
        context.setParameter(barostat.Temperature(), kelvin)


def _axes(barostat: openmm.Force) -> str:
    """Axes along which a barostat changes the box."""
    flat = isinstance(barostat, openmm.MonteCarloMembraneBarostat) and barostat.getZMode() == barostat.ZFixed
    return "xy" if flat else "".join(axis for axis in "xyz" if getattr(barostat, f"getScale{axis.upper()}", lambda: True)())


def check_barostats(context: openmm.Context, moving: list[openmm.Force], kelvin: float | None, made: Made) -> None:
    """Raise PlanError if a barostat cannot act in this scene, or has another temperature than the thermostat."""
    for barostat in moving:
        name, parameter, reason = type(barostat).__name__, barostat.Temperature(), made.no_barostat(_axes(barostat))
        if reason is not None:
            raise PlanError(f"the System has a {name}: {reason}")
        held = context.getParameter(parameter)
        if kelvin is not None and abs(held - kelvin) > _SAME * kelvin:
            raise PlanError(
                f"the {name} samples volumes at {held:g} K (context parameter {parameter}), but the thermostat is at {kelvin:g} K; "
                "setTemperature of the integrator, set_temperature and set_kT of openmm_dpd set both"
            )
