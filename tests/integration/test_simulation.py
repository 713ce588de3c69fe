"""Minimising where OpenMM's minimiser crashes: on OpenCL through PoCL."""

from __future__ import annotations

import numpy as np
import openmm
import pytest
from devices import Device
from openmm import app, unit

import openmm_dpd as dpd
from openmm_dpd.build import _opencl_is_a_gpu
from openmm_dpd.simulation import PoclSimulation

OPENCL = pytest.mark.parametrize("device", [Device("OpenCL", "single")], ids=str, indirect=True)
N, EDGE = 192, 4.0


def start(platform: str, properties=None, **options):
    x = np.random.default_rng(1).random((N, 3)) * EDGE
    bonds = [dpd.HarmonicBonds([[0, 1], [1, 2]], k=50.0, r0=0.7)]
    scene = dpd.Scene({"W": 1.0}, ["W"] * N, x, {("W", "W"): dpd.DPD(A=25, gamma=4.5)}, kT=1.0, box=[EDGE] * 3, bonds=bonds)
    return dpd.build(scene, dt=0.02, platform=platform, seed=1, **options).simulation(properties=properties)


def energy_and_velocities(simulation):
    state = simulation.context.getState(energy=True, velocities=True)
    return state.getPotentialEnergy()._value, state.getVelocities(asNumpy=True)._value


@OPENCL
@pytest.mark.parametrize("conservative", ["openmm", "kernel"])
def test_minimising_on_opencl(device, conservative, caplog):
    """To the same minimum as on the CPU platform, in a box that is not the System's, and at the Context's parameters."""
    if _opencl_is_a_gpu(openmm.Platform.getPlatformByName("OpenCL")):
        pytest.skip("OpenCL is a GPU here, which has OpenMM's own minimiser")
    minima = []
    for platform, properties in (("OpenCL", device.properties), ("CPU", {"Threads": "1"})):
        simulation = start(platform, properties, conservative=conservative)
        assert isinstance(simulation, PoclSimulation) == (platform == "OpenCL")
        simulation.context.setPeriodicBoxVectors(*(np.eye(3) * 1.1 * EDGE))
        before, v = energy_and_velocities(simulation)
        simulation.minimizeEnergy(tolerance=0.5, maxIterations=200)
        after, unchanged = energy_and_velocities(simulation)
        assert after < 0.6 * before
        np.testing.assert_array_equal(unchanged, v)
        minima.append(after)
        simulation.step(5)
    assert minima[0] == pytest.approx(minima[1], rel=2e-3)
    assert [record.getMessage() for record in caplog.records if "compiling" not in record.getMessage()] == [
        "minimising on the CPU platform: OpenMM's minimiser crashes on OpenCL through PoCL"
    ]


@OPENCL
def test_minimising_atoms_and_beads_on_opencl(device):
    """An argon atom of mass 0 stays, and so does a rigid bond."""
    topology, system, force = app.Topology(), openmm.System(), openmm.NonbondedForce()
    chain = topology.addChain()
    x = np.array([[1.0, 1, 1], [1.4, 1, 1], [2.0, 1, 1], [2.4, 1.1, 1]])
    for k in range(4):
        topology.addAtom("AR", app.element.argon, topology.addResidue("AR", chain))
        system.addParticle(0.0 if k == 0 else 39.95)
        force.addParticle(0.0, 0.34, 1.0)
    force.setNonbondedMethod(openmm.NonbondedForce.CutoffPeriodic)
    force.setCutoffDistance(1.0)
    system.addForce(force)
    system.addConstraint(2, 3, 0.42)
    system.setDefaultPeriodicBoxVectors(*(np.eye(3) * EDGE))
    soft = dpd.DPD(A=25, gamma=4.5)
    beads = dpd.Scene({"W": 40.0}, ["W"] * 60, np.random.default_rng(2).random((60, 3)) * EDGE, {("W", "W"): soft}, kT=1.0, box=[EDGE] * 3)
    whole = dpd.create_mixed_system(
        beads, topology, system, x, atoms=["C"] * 4, cross={("C", "W"): soft}, dt=0.002, platform="OpenCL", seed=3
    )
    simulation = whole.simulation(properties=device.properties)
    before = energy_and_velocities(simulation)[0]
    simulation.minimizeEnergy(maxIterations=50)
    assert energy_and_velocities(simulation)[0] < before
    found = simulation.context.getState(positions=True).getPositions(asNumpy=True).value_in_unit(unit.nanometer)
    np.testing.assert_allclose(found[0], x[0], atol=1e-6)
    assert np.linalg.norm(found[2] - found[3]) == pytest.approx(0.42, rel=1e-4)


def test_elsewhere_it_is_openmms_own():
    for platform in ("Reference", "CPU"):
        assert type(start(platform)).minimizeEnergy is app.Simulation.minimizeEnergy
