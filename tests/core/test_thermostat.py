"""The thermostat on Systems made by openmm.app.ForceField."""

import numpy as np
import openmm
import pytest
from cases import cases, raises
from judged import any_seed, judge
from openmm import app, unit

import openmm_dpd as dpd


def water(model: str = "tip3p", edge: float = 1.9):
    """A small box of rigid water: (topology, positions, System)."""
    forcefield = app.ForceField(f"amber14/{model}.xml")
    modeller = app.Modeller(app.Topology(), [] * unit.nanometer)
    kind = "tip4pew" if "4" in model else "tip3p"
    modeller.addSolvent(forcefield, boxSize=openmm.Vec3(edge, edge, edge) * unit.nanometer, model=kind)
    choices = {"nonbondedMethod": app.PME, "nonbondedCutoff": 0.8 * unit.nanometer, "constraints": app.HBonds}
    system = forcefield.createSystem(modeller.topology, removeCMMotion=False, **choices)
    return modeller.topology, modeller.positions, system


def masses_of(system: openmm.System) -> np.ndarray:
    return np.array([system.getParticleMass(k).value_in_unit(unit.dalton) for k in range(system.getNumParticles())])


def run(system, topology, positions, integrator, steps: int):
    simulation = app.Simulation(topology, system, integrator, openmm.Platform.getPlatformByName("CPU"), {"Threads": "1"})
    simulation.context.setPositions(positions)
    simulation.context.computeVirtualSites()
    simulation.minimizeEnergy(maxIterations=50)
    simulation.context.setVelocitiesToTemperature(300 * unit.kelvin, 7)
    simulation.step(steps)
    return simulation


@pytest.mark.parametrize("model, scheme", [("tip4pew", "middle"), ("tip3p", "basa")])
def test_constraints_and_virtual_sites_hold(model, scheme):
    topology, positions, system = water(model)
    built = dpd.add_thermostat(system, dpd.DPD(gamma=2, cutoff=0.7), 300 * unit.kelvin, 2 * unit.femtosecond, scheme=scheme, seed=2)
    simulation = run(system, topology, positions, built.integrator, 30)
    x = simulation.context.getState(positions=True).getPositions(asNumpy=True)._value
    for k in range(system.getNumConstraints()):
        i, j, distance = system.getConstraintParameters(k)
        assert np.linalg.norm(x[i] - x[j]) == pytest.approx(distance._value, rel=2e-5)
    simulation.context.computeVirtualSites()
    np.testing.assert_allclose(x, simulation.context.getState(positions=True).getPositions(asNumpy=True)._value, atol=1e-6)


def test_momentum_of_the_pair_terms():
    """Friction and noise alone change the momentum only by rounding; what the System's own PME does is not ours."""
    topology, positions, system = water()
    while system.getNumForces():
        system.removeForce(0)
    silent = openmm.HarmonicBondForce()  # a System without periodic forces is not periodic: keep one that does nothing
    silent.setUsesPeriodicBoundaryConditions(True)
    system.addForce(silent)
    integrator = dpd.add_thermostat(system, dpd.DPD(gamma=2, gamma_perp=1, cutoff=0.7), 300 * unit.kelvin, 0.002, seed=2).integrator
    simulation = app.Simulation(topology, system, integrator, openmm.Platform.getPlatformByName("Reference"))
    simulation.context.setPositions(positions)
    simulation.context.setVelocitiesToTemperature(300, 7)
    mass = masses_of(system)

    def momentum():
        return mass @ simulation.context.getState(velocities=True).getVelocities(asNumpy=True)._value

    before = momentum()
    simulation.step(20)
    np.testing.assert_allclose(momentum(), before, atol=1e-8)


@pytest.mark.slow
@pytest.mark.long
@any_seed(2)
@pytest.mark.parametrize("model", ["tip3p", "tip4pew"])
def test_temperature_of_rigid_water(model, seed):
    """300 K for the degrees of freedom left by constraints, at friction that damps far harder than Langevin dynamics usually does.

    1,300 degrees of freedom fluctuate by 12 K and remember that for 0.34 ps, so 30 ps give a standard error of about 1.8 K.
    """
    topology, positions, system = water(model)
    integrator = dpd.add_thermostat(system, dpd.DPD(gamma=2, cutoff=0.7), 300 * unit.kelvin, 2 * unit.femtosecond, seed=seed).integrator
    simulation = run(system, topology, positions, integrator, 3000)
    dof = 3 * int(np.sum(masses_of(system) > 0)) - system.getNumConstraints() - 3
    rows = []
    for _ in range(3000):
        simulation.step(5)
        kinetic = simulation.context.getState(energy=True).getKineticEnergy().value_in_unit(unit.kilojoule_per_mole)
        rows.append(2 * kinetic / dof / dpd.units.BOLTZMANN)
    judge(rows, 300.0, error=3.0, beside=1.5)  # 0.5 % for the first-order error of pair updates under constraints


def system_of(n: int = 4, edge: float = 3.0) -> openmm.System:
    system = openmm.System()
    system.setDefaultPeriodicBoxVectors(*(edge * np.eye(3)))
    force = openmm.CustomExternalForce("0*periodicdistance(x, y, z, 0, 0, 0)")
    for k in range(n):
        system.addParticle(1.0)
        force.addParticle(k)
    system.addForce(force)
    return system


ALIKE = {("A", "A"): dpd.DPD(gamma=1)}


@cases(
    "arguments, message",
    ({"friction": dpd.DPD(A=1, gamma=1)}, "a thermostat has no repulsion"),
    ({"friction": dpd.DPD(gamma=1, cutoff=2)}, "over half the box"),
    ({"friction": ALIKE, "types": ["A", "A", "B", "B"]}, r"no pair coefficients for types \(A, B\)"),
    ({"friction": ALIKE}, "`types` must name the type"),
    ({"friction": ALIKE, "types": ["A"]}, "types names 1 particles, but the System has 4"),
    ({"friction": ALIKE, "types": ["A", 1, "A", "A"]}, "types must hold the name.*1"),
    ({"friction": dpd.DPD(cutoff=1.0)}, "no pair of types has any friction"),
    ({"friction": 5}, "friction must be a DPD.*5"),
    ({"friction": dpd.LennardJones(1, 1, 1)}, "friction must be a DPD"),
    ({"temperature": -3}, r"temperature must be a single number >= 0, but is -3\.0 K"),
    ({"temperature": None}, "temperature must be a number.*None"),
    ({"friction": dpd.DPD(gamma=1, sigma=2), "temperature": dpd.TemperatureRamp(2.0, 3.0, 0, 9)}, "contradict the temperature.*kT = 3"),
    ({"friction": dpd.DPD(sigma=2), "temperature": dpd.TemperatureRamp(2.0, 0.0, 0, 9)}, "temperature of 0"),
    ({"scheme": "mvv", "lam": 5}, "lam.*between 0 and 1.*5"),
    ({"scheme": "mvv", "lam": float("nan")}, "lam.*nan"),
    ({"platform": "cpu"}, "platform.*'cpu'"),
    ({"dt": 0}, "dt must be > 0, but is 0"),
    ({"scheme": "native"}, "OpenMM's own thermostat; make a DPDIntegrator"),
    ({"scheme": "verlet"}, "unknown scheme 'verlet'.*or a word"),
)
def test_bad_input(arguments, message):
    settings = {"friction": dpd.DPD(gamma=1), "temperature": 300, "dt": 0.002} | arguments
    raises(dpd.ParameterError, message, dpd.add_thermostat, system_of(), **settings)


def test_somebody_must_take_part():
    raises(dpd.ParameterError, "not a Topology", lambda: dpd.add_thermostat(app.Topology(), dpd.DPD(gamma=1), 300, 0.002))
    system = system_of()
    raises(dpd.ParameterError, "every particle is left out", dpd.add_thermostat, system, ALIKE, 300, 0.002, types=[None] * 4)
    for k in range(4):
        system.setParticleMass(k, 0)
    raises(dpd.ParameterError, "have mass 0", lambda: dpd.add_thermostat(system, dpd.DPD(gamma=1), 300, 0.002))


def test_what_cannot_go_together():
    thermostat = (dpd.DPD(gamma=1), 300, 0.002)
    for change, message, scheme in (
        (lambda system: system.addForce(openmm.AndersenThermostat(300, 1)), "AndersenThermostat", "middle"),
        (lambda system: system.addForce(openmm.CMMotionRemover()), "removeCMMotion=False", "middle"),
        (lambda system: system.addConstraint(0, 1, 0.1), "use scheme='middle'", "mvv"),
        (lambda system: dpd.add_thermostat(system, *thermostat), "has DPD pair terms already", "middle"),
    ):
        system = system_of()
        change(system)
        raises(dpd.PlanError, message, dpd.add_thermostat, system, *thermostat, scheme=scheme)
