import numpy as np
from openmm import app

import openmm_dpd as dpd
from openmm_dpd.trajectory import write_psf

N, EDGE, STEPS = 3000, 10.0, 2000  # three beads in a unit of volume
positions = np.random.default_rng(1).random((N, 3)) * EDGE
pairs = {("W", "W"): dpd.DPD(A=25.0, gamma=4.5, cutoff=1.0)}
scene = dpd.Scene(masses={"W": 1.0}, types=["W"] * N, positions=positions, pairs=pairs, kT=1.0, box=[EDGE] * 3)
built = dpd.build(scene, dt=0.05, scheme="middle", seed=2024)
simulation = built.simulation()  # an openmm.app.Simulation like any other
simulation.step(500)  # equilibrate
simulation.reporters.append(app.DCDReporter("fluid.dcd", 100))
simulation.reporters.append(dpd.DPDReporter("fluid.csv", 100, built))
simulation.step(STEPS)
write_psf("fluid.psf", names=scene.types, masses=scene.bead_masses)  # mdtraj opens fluid.dcd with it
