"""Momentum with everything on, energy with the thermostat off."""

import numpy as np
import pytest
from devices import CPU, DEVICES, REFERENCE
from openmm import unit
from scenes import BOXES, EXTENDED, SCHEME, SCHEMES, D, chains, fluid, run_of, state_of, stepped

import openmm_dpd as dpd


def momentum_per_bead(simulation, masses) -> float:
    """Largest component of the total, over the number of beads."""
    _, v = state_of(simulation.context)
    return float(np.abs(masses @ v).max() / len(masses))


@SCHEME
def test_momentum_after_2000_steps(host, choices):
    """Unequal masses, bonds, factors: rounding only, 1e-13 per bead (the requirement is 1e-9 after 100,000 steps)."""
    scene = chains(BOXES["ortho"], n=110, table=EXTENDED, k=20.0)
    simulation = run_of(scene, host, dt=0.02, conservative="kernel", **choices)
    simulation.step(2000 if host.platform == "CPU" and choices["scheme"] in ("mvv", "middle") else 200)
    assert momentum_per_bead(simulation, scene.bead_masses) < 1e-13  # OpenMM's own bond force on the CPU platform is double precision


@pytest.mark.parametrize("device", [d for d in DEVICES if d.precision in ("single", "mixed")], indirect=True, ids=str)
@pytest.mark.parametrize("conservative", ["kernel", "openmm"])
def test_momentum_on_gpu_platforms(device, conservative):
    """Impulses pass through float32 and, in mixed precision, through 64-bit fixed point: 3e-7 per bead after 200 steps."""
    scene = fluid(EXTENDED, BOXES["ortho"], n=100)
    simulation = stepped(run_of(scene, device, dt=0.02, scheme="middle", conservative=conservative), 200)
    assert momentum_per_bead(simulation, scene.bead_masses) < 3e-7


# -- energy --------------------------------------------------------------------------------------------------------------------------
def energy_errors(scene, device, dt, time, conservative, choices) -> float:
    """RMS deviation of the total energy from its start over a run without friction; middle reads velocities half a step late."""
    simulation = run_of(scene, device, dt=dt, conservative=conservative, **choices)
    kilojoule, mass = unit.kilojoule_per_mole, scene.bead_masses[:, None]
    late = 0.5 * dt if choices["scheme"] == "middle" else 0.0

    def total():
        state = simulation.context.getState(energy=True, forces=True, velocities=True)
        force = state.getForces(asNumpy=True).value_in_unit(kilojoule / unit.nanometer)
        v = state.getVelocities(asNumpy=True).value_in_unit(unit.nanometer / unit.picosecond) + late * force / mass
        return state.getPotentialEnergy().value_in_unit(kilojoule) + 0.5 * np.sum(mass * v**2)

    if late:
        # start it as it goes on: velocities half a step before the positions
        force = simulation.context.getState(forces=True).getForces(asNumpy=True).value_in_unit(kilojoule / unit.nanometer)
        simulation.context.setVelocities(scene.velocities - late * force / mass)
    energies = [total()]
    for _ in range(round(time / dt)):
        simulation.step(1)
        energies.append(total())
    return float(np.sqrt(np.mean((np.array(energies) - energies[0]) ** 2)))


@pytest.mark.parametrize("conservative", ["kernel", "openmm"])
@SCHEME
def test_energy_without_friction_is_conserved_to_second_order(choices, conservative):
    """Half the step, a quarter of the error (3 to 5 allowed: the force has a kink at the cutoff); soft beads and bonds, no PythonForce needed."""
    table = {("A", "A"): D(A=25), ("A", "B"): D(A=35, cutoff=1.2), ("B", "B"): D(A=18)}
    scene = chains(BOXES["ortho"], n=70, table=table, k=30.0, bonded_factors=(1.0, 0.5, 1.0))
    coarse, fine = (energy_errors(scene, REFERENCE, dt, 0.5, conservative, choices) for dt in (0.01, 0.005))
    if choices["scheme"] == "bababo":  # so accurate that the kinks take part
        assert coarse < 0.002 * scene.n_beads
        assert fine < 0.5 * coarse
        return
    assert 3 < coarse / fine < 5
    assert coarse < 0.02 * scene.n_beads


def test_bababo_is_of_second_order():
    """The same with bonds alone, which have no kinks."""
    table = {pair: D(gamma=0.0) for pair in (("A", "A"), ("A", "B"), ("B", "B"))}
    scene = chains(BOXES["ortho"], n=70, table=table, k=300.0)
    coarse, fine = (energy_errors(scene, REFERENCE, dt, 0.5, "openmm", {"scheme": "bababo"}) for dt in (0.02, 0.01))
    assert 3 < coarse / fine < 5


def test_zero_temperature_friction_only_takes_energy_out():
    scene = fluid(EXTENDED, BOXES["ortho"], n=80, kT=0.0)
    for choices in SCHEMES.values():
        simulation = run_of(scene, CPU, dt=0.01, conservative="kernel", **choices)

        def total(simulation=simulation):
            _, v = state_of(simulation.context)
            potential = simulation.context.getState(energy=True).getPotentialEnergy().value_in_unit(unit.kilojoule_per_mole)
            return potential + 0.5 * np.sum(scene.bead_masses[:, None] * v**2)

        energies = [total()]
        for _ in range(10):
            simulation.step(20)
            energies.append(total())
        assert np.all(np.diff(energies) < 0)
        assert energies[-1] < 0.7 * energies[0]


def test_a_single_bead_flies_straight():
    """No pair, no force, no noise; also without a box."""
    for box in ([4.0] * 3, None):
        table, v = {("W", "W"): D(A=25, gamma=4.5)}, [[1.0, -2.0, 0.5]]
        scene = dpd.Scene({"W": 2.0}, ["W"], [[0.1, 0.2, 0.3]], table, 1.0, box=box, velocities=v)
        for choices in SCHEMES.values():
            x, v = state_of(stepped(run_of(scene, REFERENCE, dt=0.05, conservative="kernel", **choices), 40).context)
            np.testing.assert_allclose(v, [[1.0, -2.0, 0.5]], rtol=1e-12)
            np.testing.assert_allclose(x, [[2.1, -3.8, 1.3]], rtol=1e-12)
