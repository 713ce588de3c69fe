"""Time of a step of TIP3P water with Langevin dynamics and with pairwise friction on all atoms, on the CPU platform."""

from __future__ import annotations

import time

import openmm
from openmm import app, unit

import openmm_dpd as dpd


def milliseconds(thermostat: str) -> tuple[int, float]:
    """Atoms, and the shortest mean time of 50 steps of five tries."""
    field = app.ForceField("amber14-all.xml", "amber14/tip3p.xml")
    modeller = app.Modeller(app.Topology(), [] * unit.nanometer)
    modeller.addSolvent(field, boxSize=openmm.Vec3(2.2, 2.2, 2.2) * unit.nanometer)
    choices = {"nonbondedMethod": app.PME, "nonbondedCutoff": 0.9, "constraints": app.HBonds, "removeCMMotion": False}
    system = field.createSystem(modeller.topology, **choices)
    if thermostat == "Langevin":
        integrator = openmm.LangevinMiddleIntegrator(300, 1, 0.002)
    else:
        integrator = dpd.add_thermostat(system, dpd.DPD(gamma=2, cutoff=0.8), 300, 0.002, seed=1).integrator
    simulation = app.Simulation(modeller.topology, system, integrator, openmm.Platform.getPlatformByName("CPU"))
    simulation.context.setPositions(modeller.positions)
    simulation.minimizeEnergy(maxIterations=50)
    simulation.context.setVelocitiesToTemperature(300, 1)
    simulation.step(50)
    times = []
    for _ in range(5):
        begun = time.perf_counter()
        simulation.step(50)
        times.append((time.perf_counter() - begun) / 50)
    return system.getNumParticles(), 1e3 * min(times)


if __name__ == "__main__":
    for name in ("Langevin", "pairwise friction"):
        atoms, cost = milliseconds(name)
        print(f"{name}: {atoms} atoms, {cost:.2f} ms per step")
