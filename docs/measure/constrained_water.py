"""Temperature of rigid TIP3P water under pairwise friction, against friction and step size.

python docs/measure/constrained_water.py --gamma 5 --dt 2
"""

from __future__ import annotations

import argparse

import numpy as np
import openmm
from openmm import app, unit

import openmm_dpd as dpd
from openmm_dpd.measure import kelvin
from openmm_dpd.stats import block_average

CUTOFF = 0.8  # nm
MASSES = {"O": 15.99943, "H": 1.007947}


def water(edge: float, platform: openmm.Platform) -> tuple[app.Modeller, openmm.System]:
    """A box of rigid water."""
    field = app.ForceField("amber14/tip3p.xml")
    modeller = app.Modeller(app.Topology(), [] * unit.nanometer)
    modeller.addSolvent(field, boxSize=openmm.Vec3(edge, edge, edge) * unit.nanometer)
    system = field.createSystem(
        modeller.topology, nonbondedMethod=app.PME, nonbondedCutoff=0.9 * unit.nanometer, rigidWater=True, removeCMMotion=False
    )
    return modeller, system


def rate(positions: np.ndarray, edge: float, gamma: float, atom: int) -> float:
    """Friction rate of one atom, 1/ps: sum over neighbours of gamma w^2/m."""
    d = positions - positions[atom]
    d -= edge * np.rint(d / edge)
    r = np.linalg.norm(d, axis=1)
    near = (r < CUTOFF) & (r > 0)
    return float(gamma * np.sum((1 - r[near] / CUTOFF) ** 2))


def main() -> None:
    """Run and print one line."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--gamma", type=float, default=5.0, help="Da/ps")
    parser.add_argument("--dt", type=float, default=2.0, help="fs")
    parser.add_argument("--edge", type=float, default=1.9, help="nm")
    parser.add_argument("--equilibration", type=float, default=10.0, help="ps")
    parser.add_argument("--time", type=float, default=40.0, help="ps")
    parser.add_argument("--seed", type=int, default=1)
    options = parser.parse_args()
    platform = openmm.Platform.getPlatformByName("CPU")
    modeller, system = water(options.edge, platform)
    friction = dpd.DPD(gamma=options.gamma, cutoff=CUTOFF)
    integrator = dpd.add_thermostat(system, friction, 300, options.dt * unit.femtosecond, platform="CPU", seed=options.seed).integrator
    simulation = app.Simulation(modeller.topology, system, integrator, platform)
    simulation.context.setPositions(modeller.positions)
    simulation.minimizeEnergy(maxIterations=200)
    simulation.context.setVelocitiesToTemperature(300, options.seed)
    velocity = unit.nanometer / unit.picosecond
    masses = np.array([m.value_in_unit(unit.dalton) for m in map(system.getParticleMass, range(system.getNumParticles()))])
    v = simulation.context.getState(velocities=True).getVelocities(asNumpy=True).value_in_unit(velocity)
    simulation.context.setVelocities(v - masses @ v / masses.sum())
    simulation.step(round(options.equilibration * 1000 / options.dt))
    freedom = dpd.degrees_of_freedom(system)
    every = max(1, round(40 / options.dt))
    temperatures = []
    for _ in range(round(options.time * 1000 / options.dt / every)):
        simulation.step(every)
        v = simulation.context.getState(velocities=True).getVelocities(asNumpy=True).value_in_unit(velocity)
        temperatures.append(kelvin(float(masses @ (v**2).sum(axis=1)) / freedom))
    found = block_average(temperatures)
    x = simulation.context.getState(positions=True).getPositions(asNumpy=True).value_in_unit(unit.nanometer)
    hydrogens = np.flatnonzero(masses < 2)[:100]
    mean_rate = np.mean([rate(x, options.edge, options.gamma, k) for k in hydrogens]) / MASSES["H"]
    print(
        f"{len(masses) // 3} waters, gamma {options.gamma:g} Da/ps, dt {options.dt:g} fs: {found.mean:.1f}({found.sem:.1f}) K, "
        f"friction rate of a hydrogen {mean_rate:.0f}/ps"
    )


if __name__ == "__main__":
    main()
