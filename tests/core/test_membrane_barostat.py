"""Constant pressure and surface tension: what the System has, what is refused, restarts, and what is measured."""

import numpy as np
import openmm
import pytest
from cases import cases, raises
from judged import any_seed, judge, quantile
from openmm import unit

import openmm_dpd as dpd
from openmm_dpd.analysis import surface_tension
from openmm_dpd.measure import StressReporter
from openmm_dpd.molecules import Bilayer, grafmueller_2009, pack, relax
from openmm_dpd.units import BAR_PER_MD_PRESSURE, BOLTZMANN

Membrane = openmm.MonteCarloMembraneBarostat


def fluid(box=(4.0, 4.0, 4.0), kT=1.0) -> dpd.Scene:
    n = 192
    positions = np.random.default_rng(3).random((n, 3)) @ dpd.Scene({"W": 1.0}, ["W"], [[0, 0, 0]], PAIRS, kT=1.0, box=box).box
    return dpd.Scene({"W": 1.0}, ["W"] * n, positions, PAIRS, kT=kT, box=box)


PAIRS = {("W", "W"): dpd.DPD(A=25.0, gamma=4.5)}


def build(scene=None, **options) -> dpd.BuiltSystem:
    return dpd.build(scene or fluid(), **{"dt": 0.04, "platform": "CPU", "seed": 5, **options})


def test_the_system_has_the_numbers_in_openmms_units():
    built = build()
    barostat = dpd.add_barostat(built, 20.0, surface_tension=0.5, interval=7, xymode="anisotropic", zmode="fixed")
    assert sum(isinstance(force, Membrane) for force in built.system.getForces()) == 1
    assert isinstance(barostat, Membrane) and barostat.getFrequency() == 7
    assert barostat.getDefaultPressure() / unit.bar == pytest.approx(20 * 16.6054, rel=1e-5)
    assert barostat.getDefaultSurfaceTension() / (unit.bar * unit.nanometer) == pytest.approx(0.5 * 16.6054, rel=1e-5)
    assert barostat.getDefaultTemperature() / unit.kelvin == pytest.approx(120.272, rel=1e-5)
    assert (barostat.getXYMode(), barostat.getZMode()) == (Membrane.XYAnisotropic, Membrane.ZFixed)
    assert barostat.getRandomNumberSeed() == built.plan.options.openmm_seed


@cases(
    "tension",
    0.5,
    0.5 * unit.kilojoule_per_mole / unit.nanometer**2,
    0.5 * BAR_PER_MD_PRESSURE * unit.bar * unit.nanometer,
    0.5 * BAR_PER_MD_PRESSURE * 1e-4 * unit.newton / unit.meter,
    0.5 * BAR_PER_MD_PRESSURE * 1e-4 * unit.joule / unit.meter**2,
    ids=str,
)
def test_units_of_a_tension(tension):
    barostat = dpd.add_barostat(build(), 300 * unit.bar, surface_tension=tension)
    assert barostat.getDefaultSurfaceTension() / (unit.bar * unit.nanometer) == pytest.approx(0.5 * BAR_PER_MD_PRESSURE)
    assert barostat.getDefaultPressure() / unit.bar == pytest.approx(300)


@pytest.mark.parametrize("xymode", ["isotropic", "anisotropic"])
@pytest.mark.parametrize("zmode", ["free", "fixed", "constant volume"])
def test_edges_change_as_the_modes_say(xymode, zmode):
    built = build()
    dpd.add_barostat(built, None if zmode == "constant volume" else 23.0, surface_tension=0, xymode=xymode, zmode=zmode, interval=2)
    simulation, edges = built.simulation(), []
    for _ in range(50):
        simulation.step(2)
        edges.append(np.diag(simulation.context.getState().getPeriodicBoxVectors(asNumpy=True)._value))
    x, y, z = np.array(edges).T
    assert np.ptp(x) > 0
    assert np.allclose(x, y, rtol=1e-12) == (xymode == "isotropic")
    assert np.allclose(z, 4.0, rtol=1e-12) == (zmode == "fixed")
    assert np.allclose(x * y * z, 64.0, rtol=1e-9) == (zmode == "constant volume")


@cases(
    "options, message",
    ({"pressure": 20.0, "zmode": "constant volume"}, "a pressure has no effect at constant volume"),
    ({}, "zmode='free' changes the volume and needs a pressure"),
    ({"zmode": "fixed"}, "zmode='fixed' changes the volume and needs a pressure"),
    ({"pressure": 20.0, "xymode": "both"}, "xymode must be one of isotropic, anisotropic, not 'both'"),
    ({"pressure": 20.0, "zmode": "constant"}, "zmode must be one of .*constant volume, not 'constant'"),
    ({"pressure": 20.0, "axes": (True, True, False)}, "axes and coupled do not go with a surface_tension"),
    ({"pressure": 20.0, "coupled": False}, "axes and coupled do not go with a surface_tension"),
    ({"pressure": 20.0, "surface_tension": None, "xymode": "anisotropic"}, "xymode and zmode go with a surface_tension alone"),
    ({"pressure": 20.0, "surface_tension": None, "zmode": "fixed"}, "xymode and zmode go with a surface_tension alone"),
    ({"surface_tension": None}, "a barostat needs a pressure"),
    ({"pressure": 20.0, "surface_tension": 1 * unit.bar}, "the surface tension has the unit bar; expected a unit such as"),
    ({"pressure": 20.0, "surface_tension": float("nan")}, "the surface tension holds nan"),
    ({"pressure": 20.0, "surface_tension": [0.0, 0.0]}, "the surface tension must be a single number"),
)
def test_what_would_not_act_is_refused(options, message):
    raises((dpd.ParameterError, dpd.PlanError), message, lambda: dpd.add_barostat(build(), **{"surface_tension": 0.0, **options}))


def test_other_refusals_hold_with_a_tension():
    raises(dpd.PlanError, "orthorhombic", dpd.add_barostat, build(fluid(box=[[4, 0, 0], [1, 4, 0], [0, 0, 4]])), 20.0, surface_tension=0)
    raises(dpd.PlanError, "temperature.*is 0", lambda: dpd.add_barostat(build(fluid(kT=0.0)), 20.0, surface_tension=0))
    built = build()
    dpd.add_barostat(built, 20.0, surface_tension=0)
    raises(dpd.PlanError, "has a MonteCarloMembraneBarostat already", lambda: dpd.add_barostat(built, 20.0))


def test_a_restart_has_box_and_step_and_takes_the_new_temperature(tmp_path):
    """Box, positions and velocities are those of the checkpoint and the run goes on; another temperature reaches the barostat too."""

    def made(kT):
        built = build(fluid(kT=kT))
        barostat = dpd.add_barostat(built, surface_tension=0.3, zmode="constant volume", interval=5)
        return built, built.simulation(), barostat

    built, simulation, _ = made(1.0)
    simulation.step(200)
    simulation.saveCheckpoint(str(tmp_path / "chk"))
    simulation.saveState(str(tmp_path / "xml"))
    edges = simulation.context.getState().getPeriodicBoxVectors(asNumpy=True)._value
    assert edges[0, 0] != 4.0
    for kT in (1.0, 1.5):
        for name in ("chk", "xml"):
            again, other, barostat = made(kT)
            other.loadCheckpoint(str(tmp_path / name)) if name == "chk" else other.loadState(str(tmp_path / name))
            assert other.currentStep == 200
            assert np.allclose(other.context.getState().getPeriodicBoxVectors(asNumpy=True)._value, edges, rtol=1e-12)
            other.step(50)
            assert other.context.getParameter(barostat.Temperature()) == pytest.approx(kT / BOLTZMANN)
            assert other.context.getParameter(barostat.SurfaceTension()) == pytest.approx(0.3 * BAR_PER_MD_PRESSURE)
            now = other.context.getState().getPeriodicBoxVectors(asNumpy=True)._value
            assert np.linalg.det(now) == pytest.approx(64.0) and now[0, 0] != edges[0, 0]


@pytest.mark.slow
@any_seed(1)
@pytest.mark.parametrize("tension", [1.5, -1.5])
def test_the_area_of_an_ideal_gas_is_exact(tension, seed):
    """Beads that do not repel each other: p(A) ~ A^N exp(-(P L_z - gamma) A), a gamma distribution.  5 % off is seen."""
    n = 64
    positions = np.random.default_rng(1).random((n, 3)) * 4
    pairs = {("W", "W"): dpd.DPD(A=0.0, gamma=4.5, cutoff=0.5)}
    built = build(dpd.Scene({"W": 1.0}, ["W"] * n, positions, pairs, kT=1.0, box=[4.0] * 3), seed=seed)
    dpd.add_barostat(built, 1.0, surface_tension=tension, zmode="fixed", interval=1)
    simulation, areas = built.simulation(), []
    simulation.step(200)
    for _ in range(450):
        simulation.step(4)
        edges = np.diag(simulation.context.getState().getPeriodicBoxVectors(asNumpy=True)._value)
        areas.append(edges[0] * edges[1])
    exact = (n + 1) / (4.0 - tension)
    judge(areas, exact, error=0.02 * exact)


@pytest.mark.slow
@any_seed(1)
@pytest.mark.parametrize("tension", [pytest.param(0.0, marks=pytest.mark.long), 2.0])
def test_a_bilayer_has_the_pressure_and_the_tension_that_were_set(tension, seed):
    """Within Student's bounds, from eight blocks of 20 units of time, in which the area forgets where it was.

    The bonds of this lipid are so stiff for the step that velocities at full steps alone would make pressures 0.2 too low.  The mean of
    L_z (P_z - P_xy) is the tension less kT <1/A>, as integration by parts says.
    """
    model, pressure = grafmueller_2009(), 17.5
    mixture = pack({model.molecule: Bilayer(30)}, solvent="W", density=model.density, box=[5.0, 5.0, 8.0], seed=seed)
    built = build(relax(mixture.scene(pairs=model.pairs(), kT=1.0)), dt=0.04, seed=seed)
    dpd.add_barostat(built, pressure, surface_tension=tension, interval=1)
    simulation = built.simulation()
    simulation.step(1500)
    stress = StressReporter(2, built)
    simulation.reporters.append(stress)
    simulation.step(4000)
    assert np.ptp(stress.edges[:, 0]) > 0 and np.ptp(stress.edges[:, 2]) > 0

    def blocks(series):
        means = np.array([block.mean() for block in np.array_split(series, 8)])
        return means.mean(), means.std(ddof=1) / 8**0.5

    across, height = stress.pressures[:, :2].mean(axis=1), stress.edges[:, 2]
    measured, error = blocks(height * (stress.pressures[:, 2] - across))
    assert measured == pytest.approx(surface_tension(stress.pressures, height, axis="z", interfaces=1).mean)
    along, its_error = blocks(stress.pressures[:, 2])
    expected = tension - np.mean(1 / np.prod(stress.edges[:, :2], axis=1))
    print(f"tension {measured:.3f}({error:.3f}), expected {expected:.3f}; along z {along:.3f}({its_error:.3f}), expected {pressure}")
    assert error < 0.4 and abs(measured - expected) < quantile(8) * error
    assert its_error < 0.05 and abs(along - pressure) < quantile(8) * its_error
