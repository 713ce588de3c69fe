"""Soft starts of ten randomly packed systems, then minimisation and constant pressure, beside OpenMM's minimiser from the same start.

    python docs/measure/dense_start.py
    python docs/measure/dense_start.py --only polystyrene --time 10

Prints the rows of the table in docs/howto/dense_start.md: largest overlaps, rings with bonds through them at the start and after either
way, processor seconds (OPENMM_CPU_THREADS=1 for one thread), energies after minimisation, and temperature and density at the end of a run at 300 K and 1 bar with steps of 2 fs.
"""

from __future__ import annotations

import argparse
import time

import numpy as np
import openmm
from dense_systems import PER_VOLUME, SYSTEMS
from openmm import app, unit

from openmm_dpd import degrees_of_freedom, fastest_platform
from openmm_dpd.molecules import find_piercings, relax_dense
from openmm_dpd.units import BOLTZMANN

STEP = 0.002  # ps

#: Most iterations of OpenMM's minimiser, in both ways.
ITERATIONS = 500


def minimised(topology: app.Topology, system: openmm.System, x) -> tuple[app.Simulation, float, float, int]:
    """A Simulation at 300 K and 1 bar after OpenMM's minimiser; its energy (kJ/mol), seconds, and bonds through rings."""
    system = openmm.XmlSerializer.clone(system)
    system.addForce(openmm.MonteCarloBarostat(1 * unit.bar, 300 * unit.kelvin, 25))
    integrator = openmm.LangevinMiddleIntegrator(300 * unit.kelvin, 1 / unit.picosecond, STEP)
    integrator.setRandomNumberSeed(1)
    simulation = app.Simulation(topology, system, integrator, openmm.Platform.getPlatformByName(fastest_platform()))
    simulation.context.setPositions(x)
    simulation.context.computeVirtualSites()
    begun = time.process_time()
    simulation.minimizeEnergy(maxIterations=ITERATIONS)
    seconds = time.process_time() - begun
    state = simulation.context.getState(energy=True, positions=True)
    left = find_piercings(topology, state.getPositions(asNumpy=True))
    return simulation, state.getPotentialEnergy().value_in_unit(unit.kilojoule_per_mole), seconds, len(left)


def constant_pressure(simulation: app.Simulation, picoseconds: float) -> tuple[float, float]:
    """Mean temperature (K) of the second half of a run, and density (g/cm^3) at its end; NaN if it blew up."""
    system = simulation.system
    freedom, temperatures = degrees_of_freedom(system), []
    simulation.context.setVelocitiesToTemperature(300 * unit.kelvin, 1)
    pieces = 20
    try:
        for _ in range(pieces):
            simulation.step(round(picoseconds / STEP / pieces))
            state = simulation.context.getState(energy=True)
            kinetic = state.getKineticEnergy().value_in_unit(unit.kilojoule_per_mole)
            temperatures.append(2 * kinetic / (freedom * BOLTZMANN))
    except openmm.OpenMMException:
        return float("nan"), float("nan")
    volume = state.getPeriodicBoxVolume().value_in_unit(unit.nanometer**3)
    mass = sum(system.getParticleMass(k).value_in_unit(unit.dalton) for k in range(system.getNumParticles()))
    return float(np.mean(temperatures[pieces // 2 :])), mass / PER_VOLUME / volume


def row(name: str, picoseconds: float) -> str:
    """One line of the table."""
    topology, system, x = SYSTEMS[name]()
    pierced = len(find_piercings(topology, x)) if topology.getNumBonds() else 0
    begun = time.process_time()
    done = relax_dense(system, topology, x)
    soft = time.process_time() - begun
    simulation, energy, seconds, left = minimised(topology, system, done.positions)
    temperature, density = constant_pressure(simulation, picoseconds)
    _, direct, direct_seconds, direct_left = minimised(topology, system, x * unit.nanometer)
    overlap = f"{done.overlap_before:.0%} -> {done.overlap_after:.0%}"
    ways = f"{soft:.0f} + {seconds:.0f} | {energy:.0f} | {left}", f"{direct_seconds:.0f} | {direct:.0f} | {direct_left}"
    return f"| {name} | {len(x)} | {overlap} | {pierced} | {ways[0]} | {temperature:.0f} | {density:.2f} | {ways[1]} |"


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--only", default="", help="systems with this in their name")
    parser.add_argument("--time", type=float, default=10.0, help="picoseconds at constant pressure")
    options = parser.parse_args()
    topology, system, x = SYSTEMS["benzene, 100"]()
    relax_dense(system, topology, x, steps=1)  # kernels are compiled once
    for name in SYSTEMS:
        if options.only in name:
            print(row(name, options.time), flush=True)
