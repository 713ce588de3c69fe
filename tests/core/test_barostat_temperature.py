"""One temperature for the thermostat and the barostats of OpenMM beside it, however either is set."""

from dataclasses import replace
from functools import partial

import numpy as np
import openmm
import pytest
from cases import cases, raises
from judged import any_seed, bounded
from kinds import KINDS
from openmm import unit
from scenes import beads, stepped

import openmm_dpd as dpd
from openmm_dpd.units import BOLTZMANN

BARS = 16.6054


def fluid(scheme: str = "middle", kT=1.0, seed: int = 1) -> dpd.BuiltSystem:
    return dpd.build(beads(192, edge=4.0, kT=kT), dt=0.02, scheme=scheme, platform="Reference", seed=seed)


def barostats() -> list[openmm.Force]:
    bar, kelvin = 23.6 * BARS, 1 / BOLTZMANN
    return [
        openmm.MonteCarloBarostat(bar, kelvin, 5),
        openmm.MonteCarloAnisotropicBarostat(openmm.Vec3(bar, bar, bar), kelvin, True, True, True, 5),
        openmm.MonteCarloMembraneBarostat(bar, 0.0, kelvin, 0, 0, 5),
    ]


def held(simulation) -> list[float]:
    """Temperatures of the barostats of a Context, as energies."""
    names = {"MonteCarloTemperature", "AnisotropicMonteCarloTemperature", "MembraneMonteCarloTemperature"}
    found = {name: value for name, value in simulation.context.getParameters().items() if name in names}
    assert found
    return [BOLTZMANN * value for value in found.values()]


@pytest.mark.parametrize("kind", range(3))
@pytest.mark.parametrize("scheme", ["middle", "mvv"])
def test_setting_the_temperature_sets_that_of_the_barostat(scheme, kind):
    built = fluid(scheme)
    built.system.addForce(barostats()[kind])
    simulation = stepped(built.simulation(), 5)
    dpd.set_kT(simulation.context, 1.5)
    assert held(simulation) == pytest.approx([1.5])
    simulation.step(5)
    dpd.set_temperature(simulation.context, 200)
    assert held(simulation) == pytest.approx([200 * BOLTZMANN])
    simulation.step(5)
    built.integrator.setTemperature(150 * unit.kelvin)
    assert held(simulation) == pytest.approx([150 * BOLTZMANN])
    simulation.step(5)
    assert simulation.context.getParameter("dpd_kT") == pytest.approx(150 * BOLTZMANN)


def test_before_the_context():
    built = fluid()
    dpd.add_barostat(built, 23.6, interval=5)
    built.integrator.setTemperature(200)
    assert held(stepped(built.simulation(), 5)) == pytest.approx([200 * BOLTZMANN])


@pytest.mark.parametrize("scheme", ["middle", "mvv", "bababo"])
@pytest.mark.parametrize("way", ["parameter", "variable", "barostat"])
def test_one_without_the_other_is_refused(scheme, way):
    built = fluid(scheme)
    dpd.add_barostat(built, 23.6, interval=5)
    simulation = stepped(built.simulation(), 5)
    if way == "parameter":
        simulation.context.setParameter("dpd_kT", 1.5)
    elif way == "variable":
        openmm.CustomIntegrator.setGlobalVariableByName(built.integrator, "temperature", 1.5 / BOLTZMANN)
    else:
        simulation.context.setParameter("MonteCarloTemperature", 300)
    reason = "MonteCarloBarostat samples volumes at .* K .*MonteCarloTemperature.* thermostat is at .* set both"
    raises(dpd.PlanError, reason, lambda: simulation.step(5))
    if way != "barostat":
        simulation.context.setParameter("MonteCarloTemperature", 1.5 / BOLTZMANN)
    else:
        simulation.context.setParameter("MonteCarloTemperature", 1.001 / BOLTZMANN)  # rounded by hand
    simulation.step(5)


@cases(
    "kT, reason",
    (1.0, "at 300 K .* thermostat is at 120.27"),
    (dpd.TemperatureRamp(1.0, 2.0, 0, 100), "have one temperature; a temperature ramp"),
)
def test_a_barostat_of_the_users_has_the_temperature_of_the_thermostat(kT, reason):
    built, off = fluid(kT=kT), fluid(kT=kT)
    built.system.addForce(openmm.MonteCarloBarostat(23.6 * BARS, 300, 25))
    raises(dpd.PlanError, f"MonteCarloBarostat.*{reason}", built.simulation().step, 1)
    off.system.addForce(openmm.MonteCarloBarostat(23.6 * BARS, 300, 0))
    off.simulation().step(1)


@cases(
    "kind, reason",
    ("immobile", "scale the positions of immobile beads"),
    ("mdpd lucy", "judges volumes by an energy, but the many-body force of the Lucy kernel derives from no potential"),
    ("specular", "a barostat that changes z would move beads behind walls"),
    ("energies", "use EnthalpyBarostat"),
    ("edpd", "temperatures or concentrations"),
    ("tdpd", "temperatures or concentrations"),
)
def test_scenes_without_a_barostat(kind, reason):
    """Refused where it is added, and by the first step where somebody else added one; one that is switched off does nothing."""
    scene = replace(KINDS[kind](), mobile=None) if kind in ("edpd", "tdpd") else KINDS[kind]()

    def built() -> dpd.BuiltSystem:
        return dpd.build(scene, dt=0.005, scheme="middle", platform="CPU", seed=1)

    raises(dpd.PlanError, reason, dpd.add_barostat, built(), 20.0)
    for frequency in (5, 0):
        theirs = built()
        theirs.system.addForce(openmm.MonteCarloBarostat(23.6 * BARS, 1 / BOLTZMANN, frequency))
        step = theirs.simulation().step
        if frequency:
            raises(dpd.PlanError, f"the System has a MonteCarloBarostat: .*{reason}", step, 1)
        else:
            step(1)


def anisotropic(built: dpd.BuiltSystem, pressure, axes, coupled):
    built.system.addForce(openmm.MonteCarloAnisotropicBarostat(openmm.Vec3(pressure, pressure, pressure), 1 / BOLTZMANN, *axes, 5))
    built.simulation().step(1)


def membrane(built: dpd.BuiltSystem, pressure, axes, coupled):
    built.system.addForce(openmm.MonteCarloMembraneBarostat(pressure, 0.0, 1 / BOLTZMANN, 0, 0 if axes[2] else 1, 5))
    built.simulation().step(1)


@pytest.mark.parametrize("make", [dpd.add_barostat, dpd.EnthalpyBarostat, anisotropic, membrane])
def test_walls_stay_where_they_are(make):
    """Refused where it is added, or by the first step where somebody else added it."""
    for z in (True, False):
        scene = KINDS["energies between walls" if make is dpd.EnthalpyBarostat else "specular"]()
        call = partial(make, dpd.build(scene, dt=0.005, platform="CPU", seed=1), 20.0, axes=(True, True, z), coupled=False)
        if z:
            raises(dpd.PlanError, "a barostat that changes z would move beads behind walls", call)
        else:
            call()


@pytest.mark.slow
@any_seed(1)
def test_the_density_of_a_hotter_run(seed):
    """After set_kT the density is that of a run which was hot from the beginning: 2.91 at kT 1.5 and P 23.6, 3.00 at 1."""
    means = []
    for begin in (1.0, 1.5):
        built = fluid(kT=begin, seed=seed)
        dpd.add_barostat(built, 23.6, interval=5)
        simulation, volumes = built.simulation(), []
        simulation.step(200)
        dpd.set_kT(simulation.context, 1.5)
        simulation.step(400)
        for _ in range(250):
            simulation.step(20)
            volumes.append(simulation.context.getState().getPeriodicBoxVolume()._value)
        means.append(bounded(volumes))
    (a, sem, bound), (b, its_sem, its_bound) = means
    assert abs(a - b) < np.hypot(bound, its_bound) and np.hypot(sem, its_sem) < 0.4
    assert 192 / a == pytest.approx(2.909, abs=2.909 * bound / a + 0.01)
