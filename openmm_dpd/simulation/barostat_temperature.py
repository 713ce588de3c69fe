"""The temperature of OpenMM's barostats, which is a context parameter of their own, beside that of the thermostat."""

import logging

import openmm

from ..base.errors import PlanError
from ..base.names import CONVERTED
from ..base.units import BAR_PER_MD_PRESSURE, BOLTZMANN
from ..plan.made import BAROSTATS, Made

_LOGGER = logging.getLogger("openmm_dpd")
#: Relative difference that is taken for rounding of kT to kelvin by hand.
_SAME = 0.01
#: Temperatures (kelvin) between which a scene may be meant in everyday units; kT = 1 is 120 K.
_EVERYDAY = (200.0, 600.0)


def barostats(context: openmm.Context) -> list[openmm.Force]:
    """Those of OpenMM's barostats that a Context has, switched on or not; it has none that came into the System later."""
    found = [force for force in context.getSystem().getForces() if isinstance(force, BAROSTATS)]
    parameters = context.getParameters() if found else {}
    return [force for force in found if force.Temperature() in parameters]


def tell_pressures(context: openmm.Context, made: Made) -> None:
    """Say what the pressure in bar of somebody else's barostats is in the units of a reduced scene, which may be what was meant."""
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
    """Let the barostats of a Context hold the temperature that its thermostat has now."""
    for barostat in barostats(context):
        context.setParameter(barostat.Temperature(), kelvin)


def _axes(barostat: openmm.Force) -> str:
    """Those that its moves change."""
    flat = isinstance(barostat, openmm.MonteCarloMembraneBarostat) and barostat.getZMode() == barostat.ZFixed
    return "xy" if flat else "".join(axis for axis in "xyz" if getattr(barostat, f"getScale{axis.upper()}", lambda: True)())


def check_barostats(context: openmm.Context, moving: list[openmm.Force], kelvin: float | None, made: Made) -> None:
    """Raise PlanError if a barostat cannot act, or samples volumes at another temperature than the thermostat sets, or follows a ramp."""
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
