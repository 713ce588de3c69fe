"""Peptides and water placed at random in a box, from overlaps to a run at constant pressure.

Four copies of the last ten residues of the villin headpiece, which OpenMM ships, and 450 TIP3P waters have random places and
orientations: molecules overlap, and some bonds pierce rings.  relax_dense() separates them; OpenMM's minimiser and a barostat continue.
For comparison the minimiser starts from the same places.

    python examples/13_peptides_in_water.py
"""

from __future__ import annotations

import random
import time
from pathlib import Path

import numpy as np
import openmm
from openmm import app, unit
from scipy.spatial.transform import Rotation

import openmm_dpd as dpd
from openmm_dpd.molecules import find_piercings, relax_dense

COPIES, RESIDUES, WATERS, EDGE = 4, 10, 450, 2.7  # nm
TEMPERATURE = 300 * unit.kelvin
ITERATIONS, STEPS = 200, 1000  # of the minimiser; of 2 fs, at constant pressure
SEED = 1
PROTEIN = Path(app.__file__).parent / "data" / "test.pdb"


def peptide(field: app.ForceField) -> app.Modeller:
    """The last residues of the protein, with hydrogens that fit the new end."""
    pdb = app.PDBFile(str(PROTEIN))
    modeller = app.Modeller(pdb.topology, pdb.positions)
    protein = [residue for residue in pdb.topology.residues() if residue.name not in ("HOH", "Cl")]
    kept = set(protein[-RESIDUES:])
    modeller.delete([residue for residue in pdb.topology.residues() if residue not in kept])
    modeller.delete([atom for atom in modeller.topology.atoms() if atom.element is app.element.hydrogen])
    random.seed(SEED)  # hydrogens start at random places
    modeller.addHydrogens(field, platform=openmm.Platform.getPlatformByName("Reference"))
    return modeller


def packed() -> tuple[app.Topology, openmm.System, np.ndarray]:
    """Topology, System and positions (nm): every molecule turned at random, at a random place."""
    field = app.ForceField("amber14-all.xml", "amber14/tip3p.xml")
    one = peptide(field)
    box = app.Modeller(app.Topology(), [] * unit.nanometer)
    for _ in range(COPIES):
        box.add(one.topology, one.positions)
    water = app.Modeller(app.Topology(), [] * unit.nanometer)
    water.addSolvent(field, numAdded=WATERS)
    box.add(water.topology, water.positions)
    box.topology.setPeriodicBoxVectors(np.eye(3) * EDGE * unit.nanometer)
    x, rng = np.array(box.positions.value_in_unit(unit.nanometer)), np.random.default_rng(SEED)
    sizes = [one.topology.getNumAtoms()] * COPIES + [3] * WATERS
    for part in np.split(np.arange(len(x)), np.cumsum(sizes)[:-1]):
        x[part] = Rotation.random(random_state=rng).apply(x[part] - x[part].mean(axis=0)) + EDGE * rng.random(3)
    system = field.createSystem(box.topology, nonbondedMethod=app.PME, nonbondedCutoff=0.9 * unit.nanometer, constraints=app.HBonds)
    return box.topology, system, x


def minimised(topology: app.Topology, system: openmm.System, positions) -> tuple[app.Simulation, float, float]:
    """A Simulation after some iterations of OpenMM's minimiser, its energy (kJ/mol), and seconds."""
    integrator = openmm.LangevinMiddleIntegrator(TEMPERATURE, 1 / unit.picosecond, 2 * unit.femtosecond)
    integrator.setRandomNumberSeed(SEED)
    simulation = app.Simulation(topology, system, integrator, openmm.Platform.getPlatformByName(dpd.fastest_platform()))
    simulation.context.setPositions(positions)
    begun = time.perf_counter()
    simulation.minimizeEnergy(maxIterations=ITERATIONS)
    energy = simulation.context.getState(energy=True).getPotentialEnergy().value_in_unit(unit.kilojoule_per_mole)
    return simulation, energy, time.perf_counter() - begun


def pierced(simulation: app.Simulation) -> int:
    """Number of bonds that pierce rings."""
    return len(find_piercings(simulation.topology, simulation.context.getState(positions=True).getPositions(asNumpy=True)))


def main() -> dict[str, float]:
    """Soft start, minimisation and constant pressure; energies, seconds, pierced rings and the edge of the box."""
    topology, system, places = packed()
    done = relax_dense(system, topology, places, temperature=TEMPERATURE, seed=SEED)
    print(done)
    for piercing in done.resolved:
        print("resolved:", piercing)
    system.addForce(openmm.MonteCarloBarostat(1 * unit.bar, TEMPERATURE))
    simulation, energy, seconds = minimised(topology, system, done.positions)
    simulation.context.setVelocitiesToTemperature(TEMPERATURE, SEED)
    simulation.step(STEPS)
    volume = simulation.context.getState().getPeriodicBoxVolume().value_in_unit(unit.nanometer**3)
    other, direct, direct_seconds = minimised(topology, system, places * unit.nanometer)
    return {
        "energy of the random places": done.energy_before.value_in_unit(unit.kilojoule_per_mole),
        "energy after the soft start": done.energy_after.value_in_unit(unit.kilojoule_per_mole),
        "energy after minimising from there": energy,
        "energy after minimising the places": direct,
        "seconds of the soft start": done.seconds,
        "seconds of minimising from there": seconds,
        "seconds of minimising the places": direct_seconds,
        "bonds through rings at the end": pierced(simulation),
        "bonds through rings without soft start": pierced(other),
        "edge of the box at the end": volume ** (1 / 3),
    }


if __name__ == "__main__":
    for name, value in main().items():
        print(f"{name:40s} {value:.4g}")
