"""build, add_thermostat and create_mixed_system return the same kind of object, which Observer and reporters take."""

from io import StringIO

import numpy as np
import openmm
import pytest
from cases import raises
from openmm import app, unit

import openmm_dpd as dpd
from openmm_dpd.units import BOLTZMANN

N, EDGE, DT, T = 64, 2.0, 0.002, 300.0
BEADS = {("oil", "oil"): dpd.DPD(A=50, gamma=20, cutoff=0.6)}
X = np.stack(np.meshgrid(*[np.arange(4) * EDGE / 4] * 3), axis=-1).reshape(-1, 3) + 0.05


def argon(count: int = N, constrained: bool = False) -> tuple[app.Topology, openmm.System]:
    """Atoms with a soft repulsion of OpenMM's own."""
    system, topology = openmm.System(), app.Topology()
    system.setDefaultPeriodicBoxVectors(*(EDGE * np.eye(3)))
    topology.setUnitCellDimensions(openmm.Vec3(EDGE, EDGE, EDGE) * unit.nanometer)
    chain, force = topology.addChain(), openmm.CustomNonbondedForce("50*(1-r/0.6)^2")
    force.setNonbondedMethod(force.CutoffPeriodic)
    force.setCutoffDistance(0.6)
    for _ in range(count):
        system.addParticle(39.9)
        force.addParticle([])
        topology.addAtom("Ar", app.Element.getBySymbol("Ar"), topology.addResidue("Ar", chain))
    if constrained:
        system.addConstraint(0, 1, 0.4)
        force.addExclusion(0, 1)
    system.addForce(force)
    return topology, system


def beads() -> dpd.Scene:
    return dpd.Scene({"oil": 40.0}, ["oil"] * N, X, BEADS, kT=T * unit.kelvin, box=[EDGE] * 3)


def thermostat(**choices) -> dpd.BuiltSystem:
    topology, system = argon()
    friction = dpd.DPD(gamma=20, cutoff=0.6)
    return dpd.add_thermostat(system, friction, T, DT, seed=1, platform="Reference", topology=topology, positions=X, **choices)


def mixed() -> dpd.BuiltSystem:
    topology, system = argon(8)
    cross = {("Ar", "oil"): dpd.DPD(A=50, gamma=20, cutoff=0.6)}
    choices = {"dt": DT, "seed": 1, "platform": "Reference"}
    return dpd.create_mixed_system(beads(), topology, system, X[:8] + 0.2, atoms=["Ar"] * 8, cross=cross, **choices)


WAYS = {"build": lambda: dpd.build(beads(), dt=DT, seed=1, platform="Reference"), "thermostat": thermostat, "mixed": mixed}


@pytest.mark.parametrize("way", WAYS)
def test_all_ways_have_the_same_face(way):
    built = WAYS[way]()
    assert isinstance(built, dpd.BuiltSystem) and isinstance(built.plan, dpd.Plan)
    simulation = built.simulation()
    assert simulation.integrator is built.integrator and simulation.system.getNumParticles() == built.system.getNumParticles()
    out, friction = StringIO(), "friction and noise: compiled pair kernel"
    assert friction in built.explain() and "program middle" in built.explain() and f"seed of the noise: {1}" in built.explain()
    assert ("particles of a System made elsewhere" in built.explain()) == (way != "build")
    simulation.reporters.append(dpd.DPDReporter(out, 5, built))
    before = dpd.Observer(built).sample(simulation.context)
    simulation.step(10)
    after = dpd.Observer(built).sample(simulation.context)
    mass = np.array([m._value for m in map(built.system.getParticleMass, range(built.system.getNumParticles()))])
    state = simulation.context.getState(velocities=True, energy=True)
    v = state.getVelocities(asNumpy=True)._value
    assert after.kT == pytest.approx(float(mass @ (v**2).sum(axis=1)) / (3 * len(mass) - 3), rel=1e-12)
    assert after.potential == pytest.approx(state.getPotentialEnergy()._value, rel=1e-9)
    assert after.target_kT == pytest.approx(BOLTZMANN * T) and after.volume == EDGE**3
    np.testing.assert_allclose(after.momentum, before.momentum, atol=1e-9)
    rows = np.genfromtxt(StringIO(out.getvalue()), delimiter=",", names=True)
    assert rows["step"].tolist() == [5, 10] and rows["kT"][-1] == pytest.approx(after.kT, rel=1e-8)
    assert ("kT_beads" in (rows.dtype.names or ())) == (way == "mixed")


def test_velocities_of_a_thermostatted_system():
    """They have no total momentum, and exactly the temperature where there are no constraints."""
    built = thermostat()
    sample = dpd.Observer(built).sample(built.simulation().context)
    assert sample.kT == pytest.approx(BOLTZMANN * T, rel=1e-9)
    np.testing.assert_allclose(sample.momentum, 0.0, atol=1e-9)


def test_constraints_hold_from_the_start():
    topology, system = argon(constrained=True)
    x = X.copy()
    built = dpd.add_thermostat(system, dpd.DPD(gamma=20, cutoff=0.6), T, DT, seed=1, platform="Reference", topology=topology, positions=x)
    context = built.simulation().context
    state = context.getState(positions=True, velocities=True)
    x, v = state.getPositions(asNumpy=True)._value, state.getVelocities(asNumpy=True)._value
    assert np.linalg.norm(x[1] - x[0]) == pytest.approx(0.4, rel=1e-5)
    assert abs((x[1] - x[0]) @ (v[1] - v[0])) < 1e-4
    assert dpd.Observer(built).sample(context).dof == 3 * N - 4


def test_particles_left_out_are_told():
    types = [None if k % 4 == 0 else "Ar" for k in range(N)]
    topology, system = argon()
    built = dpd.add_thermostat(system, {("Ar", "Ar"): dpd.DPD(gamma=20, cutoff=0.6)}, T, DT, types=types, seed=1)
    assert f"{N} particles of a System made elsewhere, {N // 4} of them without friction" in built.explain()
    assert built.topology is None and built.positions is None and built.system is system
    raises(dpd.PlanError, "give them to add_thermostat, or make your own app.Simulation", built.simulation)


def test_what_a_system_made_elsewhere_has_not():
    built = thermostat()
    with pytest.raises(dpd.ParameterError, match="kT_atoms are not measured for a System made elsewhere"):
        dpd.DPDReporter(StringIO(), 5, built, ["kT_atoms"])
    raises(dpd.ParameterError, "not those of a System made elsewhere", lambda: dpd.measure.StressReporter(5, built))
    raises(dpd.ParameterError, "getState", lambda: dpd.force_terms(built))
    raises(dpd.PlanError, "already; build it again", lambda: [built.simulation() for _ in range(2)])


@pytest.mark.parametrize("wrong", [X[:-1], X * np.nan])
def test_positions_must_fit(wrong):
    topology, system = argon()
    with pytest.raises(dpd.ParameterError, match="positions"):
        dpd.add_thermostat(system, dpd.DPD(gamma=20, cutoff=0.6), T, DT, topology=topology, positions=wrong)


def test_a_bare_temperature_is_kelvin_and_kT_an_energy():
    context = thermostat().simulation().context
    dpd.set_temperature(context, 310)
    assert context.getParameter("dpd_kT") == pytest.approx(310 * BOLTZMANN)
    dpd.set_kT(context, 2.0)
    assert context.getParameter("dpd_kT") == 2.0
    for call, value in ((dpd.set_temperature, 3.0 * unit.kilojoule_per_mole), (dpd.set_kT, 3.0 / BOLTZMANN * unit.kelvin)):
        call(context, value)
        assert context.getParameter("dpd_kT") == pytest.approx(3.0)
        context.setParameter("dpd_kT", 1.0)
