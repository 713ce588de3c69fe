"""Bending modulus of the solvent-free lipids of Cooke, Kremer and Deserno, Phys. Rev. E 72, 011506 (2005), with a DPD thermostat.

A head and two tail beads, made of OpenMM's own forces: a check of the analysis on a membrane that others have measured.  Pieces of a run go on
where the last one with the same ``--out`` stopped:

    python docs/measure/cooke_membrane.py --out out/cooke --steps 200000      # repeat; 4 minutes each on one core
    python docs/measure/cooke_membrane.py --out out/cooke --steps 0           # the numbers

sigma = 1 nm, epsilon = 1 kJ/mol, m = 1 Da; the range of the attraction of tails w_c = 1.6 sigma at kT = 1.1 epsilon.
"""

from __future__ import annotations

import argparse
from pathlib import Path

import mdtraj
import numpy as np
import openmm
from bending_modulus import joined, print_sizes, print_spectrum
from openmm import app, unit

import openmm_dpd as dpd

KT, RANGE, DT, EVERY, EQUILIBRATION = 1.1, 1.6, 0.01, 200, 500.0
AREA, HEIGHT = 1.21, 24.0
HEAD, TAIL = 0.95, 1.0  # sizes of pairs with a head, and of two tails


def forces(n_lipids: int) -> list[openmm.Force]:
    """Repulsion, attraction of tails, springs of finite extension, and the springs that keep lipids straight."""
    cut = 2 ** (1 / 6) * TAIL
    pair = openmm.CustomNonbondedForce(
        "4*((b/r)^12 - (b/r)^6 + 1/4)*step(2^(1/6)*b - r) - tails*select(step(r - cut), cos(half*(r - cut)/wc)^2, 1);"
        f"b = select(tails, {TAIL}, {HEAD}); tails = tail1*tail2; half = {np.pi / 2!r}; cut = {cut!r}; wc = {RANGE}"
    )
    pair.addPerParticleParameter("tail")
    pair.setNonbondedMethod(openmm.CustomNonbondedForce.CutoffPeriodic)
    pair.setCutoffDistance(cut + RANGE)
    spring = openmm.CustomBondForce("-0.5*30*1.5^2*log(1 - (r/1.5)^2)")
    straight = openmm.HarmonicBondForce()
    for head in range(0, 3 * n_lipids, 3):
        for tail in (0.0, 1.0, 1.0):
            pair.addParticle([tail])
        spring.addBond(head, head + 1)
        spring.addBond(head + 1, head + 2)
        straight.addBond(head, head + 2, 4.0, 10.0)
    for force in (spring, straight):
        force.setUsesPeriodicBoundaryConditions(True)
    return [pair, spring, straight]


def membrane(edge: float) -> tuple[app.Topology, openmm.System, np.ndarray]:
    """A flat bilayer of lipids on a square lattice."""
    side = round(edge / AREA**0.5)
    edge, n_lipids = side * AREA**0.5, 2 * side**2
    system, topology = openmm.System(), app.Topology()
    vectors = [openmm.Vec3(edge, 0, 0), openmm.Vec3(0, edge, 0), openmm.Vec3(0, 0, HEIGHT)]
    system.setDefaultPeriodicBoxVectors(*vectors)
    topology.setPeriodicBoxVectors(vectors * unit.nanometer)
    chain = topology.addChain()
    for _ in range(n_lipids):
        residue = topology.addResidue("LIP", chain)
        beads = [topology.addAtom(name, None, residue) for name in "HTT"]
        topology.addBond(beads[0], beads[1])
        topology.addBond(beads[1], beads[2])
        for _ in beads:
            system.addParticle(1.0)
    for force in forces(n_lipids):
        system.addForce(force)
    grid = (np.arange(side) + 0.5) * edge / side
    flat = np.stack(np.meshgrid(grid, grid), axis=-1).reshape(-1, 2)
    x = [(*place, HEIGHT / 2 + up * (0.6 + 0.95 * k)) for up in (1, -1) for place in flat for k in (2, 1, 0)]
    return topology, system, np.array(x)


def run(out: Path, steps: int, edge: float, seed: int) -> None:
    """Begin, or go on from the checkpoint; every piece is a trajectory of its own."""
    topology, system, x = membrane(edge)
    built = dpd.add_thermostat(
        system, dpd.DPD(gamma=2.0, cutoff=1.4), KT * unit.kilojoule_per_mole, DT, topology=topology, positions=x, platform="CPU", seed=seed
    )
    dpd.add_barostat(built, 0.0, surface_tension=0, zmode="fixed", interval=25)
    simulation, checkpoint = built.simulation(), out / "end.chk"
    if checkpoint.exists():
        simulation.loadCheckpoint(str(checkpoint))
    else:
        simulation.minimizeEnergy(maxIterations=50)
        simulation.context.setVelocitiesToTemperature(KT * unit.kilojoule_per_mole / unit.MOLAR_GAS_CONSTANT_R, seed)
        with (out / "start.pdb").open("w") as file:
            app.PDBFile.writeFile(topology, x * unit.nanometer, file)
    piece = out / f"piece_{simulation.currentStep:09d}.dcd"
    simulation.reporters.append(app.DCDReporter(str(piece), EVERY))
    simulation.step(steps)
    simulation.saveCheckpoint(str(checkpoint))


def analyse(out: Path, edge: float) -> None:
    """Print what all pieces together say."""
    trajectory = joined(out, mdtraj.Topology.from_openmm(membrane(edge)[0]), EVERY * DT, EQUILIBRATION)
    print_sizes(trajectory, EVERY * DT)
    print_spectrum(trajectory, (0.55, 0.75, 1.2))


def main() -> None:
    """A piece of the run, then the numbers."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--out", type=Path, default=Path("out/cooke_membrane"))
    parser.add_argument("--steps", type=int, default=200_000)
    parser.add_argument("--edge", type=float, default=17.6, help="of the membrane at the start")
    parser.add_argument("--seed", type=int, default=1)
    options = parser.parse_args()
    options.out.mkdir(parents=True, exist_ok=True)
    if options.steps:
        run(options.out, options.steps, options.edge, options.seed)
    analyse(options.out, options.edge)


if __name__ == "__main__":
    main()
