"""Diffusion beside a published value: 1,000 beads of density 3 without repulsion, friction 6.75, step 0.04.

OpenMM's test of its DPDIntegrator (TestDPDIntegrator.h, testDiffusion) has 0.5203 of such a box, "computed with LAMMPS"; no correction
for its size, no error given, 5 % allowed.  Printed for schemes here at that step and at half of it.

    python docs/measure/published_diffusion.py       # half a minute of one core
"""

from __future__ import annotations

import mdtraj
import numpy as np
from openmm import unit

import openmm_dpd as dpd
from openmm_dpd.analysis import diffusion_coefficient, mean_squared_displacement

BEADS, DENSITY, GAMMA = 1000, 3.0, 6.75
EVERY, TIME, FIT = 0.4, 2000.0, (8.0, 40.0)


def diffusion(scheme: str, dt: float) -> tuple[float, float]:
    """Slope of the mean squared displacement, with its standard error."""
    edge = (BEADS / DENSITY) ** (1 / 3)
    x, pairs = np.random.default_rng(1).random((BEADS, 3)) * edge, {("W", "W"): dpd.DPD(A=0.0, gamma=GAMMA)}
    scene = dpd.Scene({"W": 1.0}, ["W"] * BEADS, x, pairs, kT=1.0, box=[edge] * 3)
    simulation, every = dpd.build(scene, dt=dt, scheme=scheme, platform="CPU", seed=1).simulation(), round(EVERY / dt)
    simulation.step(20 * every)
    paths = np.empty((round(TIME / EVERY), BEADS, 3), np.float32)
    for frame in paths:
        simulation.step(every)
        frame[:] = simulation.context.getState(positions=True).getPositions(asNumpy=True).value_in_unit(unit.nanometer)
    topology = mdtraj.Topology()
    chain = topology.add_chain()
    for _ in range(BEADS):
        topology.add_atom("W", mdtraj.element.virtual, topology.add_residue("W", chain))
    moved = mean_squared_displacement(mdtraj.Trajectory(paths, topology), interval=EVERY, lags=np.arange(20, 101, 20), unwrap=False)
    found = diffusion_coefficient(moved, FIT)
    return found.mean, found.sem


if __name__ == "__main__":
    dpd.set_threads(1)
    for name, step in (("mvv", 0.04), ("mvv", 0.02), ("basa", 0.04), ("basa", 0.02)):
        print("{} {:g}: {:.4f} ± {:.4f}".format(name, step, *diffusion(name, step)), flush=True)
