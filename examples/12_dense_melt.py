"""A melt of polyethylene, from overlapping random walks to a run at constant pressure.

Chains of united atoms (TraPPE-UA, rigid bonds) are drawn as random walks at random places, at a density near the melt's.  relax_dense()
lets them pass through each other under the soft repulsion of DPD, which rises until they separate; OpenMM's minimiser and a barostat
continue.  For comparison the minimiser starts from the same walks.

    python examples/12_dense_melt.py
"""

from __future__ import annotations

import time
from io import StringIO

import numpy as np
import openmm
from openmm import app, unit

import openmm_dpd as dpd
from openmm_dpd.molecules import DenseStart, relax_dense

CHAINS, LENGTH = 10, 100
DENSITY = 0.76  # g/cm^3
TEMPERATURE = 450 * unit.kelvin
STEPS = 2000  # of 2 fs, at constant pressure
SEED = 1
GRAMS_PER_CM3 = 1.0 / 602.214  # 1 Da/nm^3

#: M. G. Martin and J. I. Siepmann, J. Phys. Chem. B 102, 2569 (1998); energies of one kelvin are 0.00831446 kJ/mol.
TRAPPE = """<ForceField>
<AtomTypes>
 <Type name="CH3" class="C" element="C" mass="15.035"/>
 <Type name="CH2" class="C" element="C" mass="14.027"/>
</AtomTypes>
<Residues>
 <Residue name="CH3"><Atom name="C" type="CH3"/><ExternalBond atomName="C"/></Residue>
 <Residue name="CH2"><Atom name="C" type="CH2"/><ExternalBond atomName="C"/><ExternalBond atomName="C"/></Residue>
</Residues>
<HarmonicBondForce><Bond class1="C" class2="C" length="0.154" k="0"/></HarmonicBondForce>
<HarmonicAngleForce><Angle class1="C" class2="C" class3="C" angle="1.98968" k="519.65"/></HarmonicAngleForce>
<PeriodicTorsionForce><Proper class1="C" class2="C" class3="C" class4="C" periodicity1="1" phase1="0" k1="2.9519"
 periodicity2="2" phase2="3.14159265" k2="-0.5670" periodicity3="3" phase3="0" k3="6.5794"/></PeriodicTorsionForce>
<NonbondedForce coulomb14scale="0" lj14scale="0">
 <Atom type="CH3" charge="0" sigma="0.375" epsilon="0.8148"/>
 <Atom type="CH2" charge="0" sigma="0.395" epsilon="0.3825"/>
</NonbondedForce></ForceField>"""


def walk(start: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    """A chain with bonds of 0.154 nm, angles of 114 degrees and any torsions: it may cross itself and others."""
    places, way = [start], rng.normal(size=3)
    for _ in range(LENGTH - 1):
        way /= np.linalg.norm(way)
        places.append(places[-1] + 0.154 * way)
        side = np.cross(way, rng.normal(size=3))
        way = np.cos(np.radians(66)) * way + np.sin(np.radians(66)) * side / np.linalg.norm(side)
    return np.array(places)


def melt() -> tuple[app.Topology, openmm.System, np.ndarray]:
    """Topology, System and positions (nm) of the chains."""
    rng = np.random.default_rng(SEED)
    edge = (CHAINS * (14.027 * LENGTH + 2.016) * GRAMS_PER_CM3 / DENSITY) ** (1 / 3)
    topology, positions = app.Topology(), []
    for _ in range(CHAINS):
        chain, atoms = topology.addChain(), []
        for k in range(LENGTH):
            residue = topology.addResidue("CH3" if k in (0, LENGTH - 1) else "CH2", chain)
            atoms.append(topology.addAtom("C", app.element.carbon, residue))
        for one, other in zip(atoms, atoms[1:], strict=False):
            topology.addBond(one, other)
        positions.append(walk(edge * rng.random(3), rng))
    topology.setPeriodicBoxVectors(np.eye(3) * edge * unit.nanometer)
    system = app.ForceField(StringIO(TRAPPE)).createSystem(
        topology, nonbondedMethod=app.CutoffPeriodic, nonbondedCutoff=1.0 * unit.nanometer, constraints=app.AllBonds
    )
    return topology, system, np.concatenate(positions)


def minimised(topology: app.Topology, system: openmm.System, positions) -> tuple[app.Simulation, float, float]:
    """A Simulation after OpenMM's minimiser, its energy (kJ/mol), and seconds."""
    integrator = openmm.LangevinMiddleIntegrator(TEMPERATURE, 1 / unit.picosecond, 2 * unit.femtosecond)
    integrator.setRandomNumberSeed(SEED)
    simulation = app.Simulation(topology, system, integrator, openmm.Platform.getPlatformByName(dpd.fastest_platform()))
    simulation.context.setPositions(positions)
    begun = time.perf_counter()
    simulation.minimizeEnergy()
    energy = simulation.context.getState(energy=True).getPotentialEnergy().value_in_unit(unit.kilojoule_per_mole)
    return simulation, energy, time.perf_counter() - begun


def main() -> dict[str, float]:
    """Soft start, minimisation and constant pressure; energies, seconds and the density."""
    topology, system, walks = melt()
    done: DenseStart = relax_dense(system, topology, walks, temperature=TEMPERATURE, seed=SEED)
    print(done)
    system.addForce(openmm.MonteCarloBarostat(1 * unit.bar, TEMPERATURE))
    simulation, energy, seconds = minimised(topology, system, done.positions)
    simulation.context.setVelocitiesToTemperature(TEMPERATURE, SEED)
    simulation.step(STEPS)
    volume = simulation.context.getState().getPeriodicBoxVolume().value_in_unit(unit.nanometer**3)
    _, direct, direct_seconds = minimised(topology, system, walks * unit.nanometer)
    return {
        "energy of the walks": done.energy_before.value_in_unit(unit.kilojoule_per_mole),
        "energy after the soft start": done.energy_after.value_in_unit(unit.kilojoule_per_mole),
        "energy after minimising from there": energy,
        "energy after minimising the walks": direct,
        "seconds of the soft start": done.seconds,
        "seconds of minimising from there": seconds,
        "seconds of minimising the walks": direct_seconds,
        "largest overlap after the soft start": done.overlap_after,
        "density at the end": CHAINS * (14.027 * LENGTH + 2.016) * GRAMS_PER_CM3 / volume,
    }


if __name__ == "__main__":
    for name, value in main().items():
        print(f"{name:40s} {value:.4g}")
