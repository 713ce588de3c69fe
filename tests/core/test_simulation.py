"""Minimising: as low as OpenMM's minimiser goes, and where that one crashes or overshoots."""

import copy
import itertools

import numpy as np
import openmm
import pytest
from cases import raises
from devices import Device
from openmm import app, unit
from scenes import beads

import openmm_dpd as dpd
from openmm_dpd.base.platforms import platform_here

OPENCL = pytest.mark.parametrize("device", [Device("OpenCL", "single")], ids=str, indirect=True)
N, EDGE = 192, 4.0


def start(platform: str, properties=None, **options):
    scene = beads(N, edge=EDGE, bonds=[dpd.HarmonicBonds([[0, 1], [1, 2]], k=50.0, r0=0.7)])
    return dpd.build(scene, dt=0.02, platform=platform, seed=1, **options).simulation(properties=properties)


def argon():
    """Topology, System and positions of four atoms, one that stays, and two that are tied to each other."""
    topology, system, force = app.Topology(), openmm.System(), openmm.NonbondedForce()
    chain = topology.addChain()
    for k in range(4):
        topology.addAtom("AR", app.element.argon, topology.addResidue("AR", chain))
        system.addParticle(0.0 if k == 0 else 39.95)
        force.addParticle(0.0, 0.34, 1.0)
    force.setNonbondedMethod(openmm.NonbondedForce.CutoffPeriodic)
    force.setCutoffDistance(1.0)
    system.addForce(force)
    system.addConstraint(2, 3, 0.42)
    system.setDefaultPeriodicBoxVectors(*(np.eye(3) * EDGE))
    return topology, system, np.array([[1.0, 1, 1], [1.3, 1, 1], [2.0, 1, 1], [2.4, 1.1, 1]])


def energy_and_velocities(simulation):
    state = simulation.context.getState(energy=True, velocities=True)
    return state.getPotentialEnergy()._value, state.getVelocities(asNumpy=True)._value


@OPENCL
@pytest.mark.parametrize("conservative", ["openmm", "kernel"])
def test_minimising_on_opencl(device, conservative):
    """To the same minimum as on the CPU platform, in a box that is not the System's, and at the Context's parameters."""
    minima = []
    for platform, properties in (("OpenCL", device.properties), ("CPU", {"Threads": "1"})):
        simulation = start(platform, properties, conservative=conservative)
        simulation.context.setPeriodicBoxVectors(*(np.eye(3) * 1.1 * EDGE))
        before, v = energy_and_velocities(simulation)
        simulation.minimizeEnergy(tolerance=0.5, maxIterations=200)
        after, unchanged = energy_and_velocities(simulation)
        assert after < 0.6 * before
        np.testing.assert_array_equal(unchanged, v)
        minima.append(after)
        simulation.step(5)
    assert minima[0] == pytest.approx(minima[1], rel=2e-3)


@OPENCL
def test_a_thermostat_takes_the_platform_that_build_takes(device):
    """By itself, and where OpenCL is asked for."""
    for platform in (None, "OpenCL"):
        topology, system, x = argon()
        choices = {"topology": topology, "positions": x, "platform": platform, "seed": 1}
        simulation = dpd.add_thermostat(system, dpd.DPD(gamma=1.0, cutoff=0.8), 90, 0.002, **choices).simulation()
        assert simulation.context.getPlatform().getName() == platform_here(platform)
        before = energy_and_velocities(simulation)[0]
        simulation.minimizeEnergy(maxIterations=20)
        assert energy_and_velocities(simulation)[0] < before


def test_as_low_as_openmms():
    """Water with virtual sites and rigid molecules, after as many iterations; constraints hold."""
    field = app.ForceField("amber14/tip4pew.xml")
    modeller = app.Modeller(app.Topology(), [] * unit.nanometer)
    modeller.addSolvent(field, model="tip4pew", boxSize=openmm.Vec3(1.4, 1.4, 1.4) * unit.nanometer)
    choices = {"nonbondedMethod": app.CutoffPeriodic, "nonbondedCutoff": 0.65, "removeCMMotion": False}
    system = field.createSystem(modeller.topology, **choices)
    theirs = app.Simulation(modeller.topology, copy.deepcopy(system), openmm.VerletIntegrator(0.001), openmm.Platform.getPlatform("CPU"))
    theirs.context.setPositions(modeller.positions)
    friction = dpd.DPD(gamma=1.0, cutoff=0.6)
    built = dpd.add_thermostat(system, friction, 300, 0.002, topology=modeller.topology, positions=modeller.positions, platform="CPU")
    ours, energies = built.simulation(), []
    start = energy_and_velocities(ours)[0]
    for simulation in (theirs, ours):
        simulation.minimizeEnergy(maxIterations=100)
        energies.append(energy_and_velocities(simulation)[0])
    assert energies[1] - start < 0.9 * (energies[0] - start)
    x = ours.context.getState(positions=True).getPositions(asNumpy=True)._value
    tied = [system.getConstraintParameters(k) for k in range(system.getNumConstraints())]
    np.testing.assert_allclose([np.linalg.norm(x[i] - x[j]) / length._value for i, j, length in tied], 1, atol=2e-5)
    ours.context.computeVirtualSites()
    np.testing.assert_allclose(ours.context.getState(positions=True).getPositions(asNumpy=True)._value, x, atol=1e-6)


class Energies(openmm.MinimizationReporter):
    """Keeps the energies that are reported, and ends after five."""

    def __init__(self):
        super().__init__()
        self.energies: list[float] = []

    def report(self, iteration, x, grad, args):
        assert iteration == len(self.energies) and len(x) == len(grad) == 3 * N and args["max constraint error"] == 0
        self.energies.append(args["system energy"])
        return len(self.energies) == 5


def test_reporters_are_told_and_end_it():
    """Every iteration lowers the energy."""
    simulation, reported = start("Reference"), Energies()
    simulation.minimizeEnergy(0.0, 0, reported)
    assert len(reported.energies) == 5 and np.all(np.diff(reported.energies) < 0)
    assert reported.energies[-1] == pytest.approx(energy_and_velocities(simulation)[0], rel=1e-12)


@pytest.mark.parametrize("loop", [True, False])
def test_impossible_starts_name_the_bond(loop):
    """Nothing moves then."""
    bonds = [dpd.FENEBonds([[0, 1], [2, 3]], k=30.0, R0=1.5)]
    x = np.array([[0.0, 0, 0], [0.7, 0, 0], [0, 1, 0], [0.7, 1, 0]])
    scene = beads(4, positions=x, edge=EDGE, bonds=bonds)
    simulation = dpd.build(scene, dt=0.01, platform="Reference", seed=1, loop=loop).simulation()
    x[3, 0] = 1.7
    simulation.context.setPositions(x)
    raises(dpd.RunError, r"bond between beads 2 and 3 \(counted from 0\) is 1.7 nm long, which .* R0 of 1.5 nm", simulation.minimizeEnergy)
    np.testing.assert_array_equal(simulation.context.getState(positions=True).getPositions(asNumpy=True)._value, x)


# -- steps and reports -------------------------------------------------------------------------------------------------------------
class Asking:
    """A reporter that answers something else each time it is asked; in the older form of OpenMM's answers, if wanted."""

    def __init__(self, intervals, old: bool, include=("positions",), periodic=None):
        self.intervals, self.old, self.include, self.periodic = iter(intervals), old, include, periodic
        self.found: list[tuple] = []

    def describeNextReport(self, simulation):
        steps = next(self.intervals)
        if self.old:
            return (steps, *(what in self.include for what in ("positions", "velocities", "forces", "energy")), self.periodic)
        return {"steps": steps, "periodic": self.periodic, "include": list(self.include)}

    def report(self, simulation, state):
        x = state.getPositions(asNumpy=True)._value.copy() if "positions" in self.include else None
        self.found.append((simulation.currentStep, x))


@pytest.mark.parametrize("old", [False, True])
def test_reporters_are_asked_once_for_each_report(old):
    """They report at the same steps, and see the same positions, folded or not, as those of an app.Simulation."""
    found = []
    for ours in (True, False):
        simulation = start("CPU")
        if not ours:
            simulation.__class__ = app.Simulation
        asking = [
            Asking(itertools.repeat(25), old),
            Asking(np.random.default_rng(1).geometric(0.03, 200).tolist(), old, periodic=False),
            Asking(itertools.cycle([7, 40, 0, 3]), old, ("velocities",)),
        ]
        simulation.reporters += asking
        simulation.step(90)
        simulation.step(90)
        found.append([one.found for one in asking])
    assert [[step for step, _ in one] for one in found[0]] == [[step for step, _ in one] for one in found[1]]
    assert all(len(one) > 2 for one in found[0])
    for one, other in zip(*found, strict=True):
        assert all(x is None and y is None or np.array_equal(x, y) for (_, x), (_, y) in zip(one, other, strict=True))


@pytest.mark.parametrize("steps", [20.0, np.int32(20), np.float64(20), 20])
def test_whole_numbers_of_steps_of_any_type(steps):
    simulation = start("CPU")
    simulation.step(steps)
    simulation.integrator.step(steps)
    assert simulation.currentStep == 40
    for wrong in (20.5, "20"):
        for step in (simulation.step, simulation.integrator.step):
            raises(TypeError, "must be a whole one", step, wrong)
    assert simulation.currentStep == 40


def test_forces_without_a_potential_have_no_minimum(caplog):
    """... which is said."""
    for kernel in ("quadratic", "lucy"):
        x, pair = np.random.default_rng(1).random((N, 3)) * EDGE, dpd.MDPD(A=-40, B=25, gamma=4.5, kernel=kernel)
        scene = dpd.Scene({"W": 1.0}, ["W"] * N, x, {("W", "W"): pair}, kT=1.0, box=[EDGE] * 3)
        dpd.build(scene, dt=0.01, platform="CPU", seed=1).simulation().minimizeEnergy(maxIterations=2)
        assert ("derives from no potential" in caplog.text) == (kernel == "lucy")
