"""Calls per step through Simulation.step, with count.c preloaded: one line of JSON."""

import ctypes
import json
import sys

import numpy as np
import openmm

import openmm_dpd as dpd

steps, scheme, beside = int(sys.argv[1]), sys.argv[2], sys.argv[3].split("+")
counts = (ctypes.c_long * 3).in_dll(ctypes.CDLL(None), "counts")
n, edge = 3000, 10.0
rng = np.random.default_rng(1)
x = np.stack(np.meshgrid(*[np.arange(15) * edge / 15] * 3), -1).reshape(-1, 3)[:n] + rng.random((n, 3)) * 0.1
more = {"bonds": [dpd.HarmonicBonds(np.arange(1000).reshape(-1, 2), k=20, r0=0.6)]} if "bonds" in beside else {}
if "charges" in beside:
    more |= {
        "charges": np.where(np.arange(n) < 300, np.arange(n) % 2 * 2.0 - 1, 0),
        "electrostatics": dpd.SlaterCharges(0.25, bjerrum_length=1.0),
    }
scene = dpd.Scene({"W": 1}, ["W"] * n, x, {("W", "W"): dpd.DPD(A=25, gamma=4.5)}, kT=1, box=[edge] * 3, **more)
if scheme == "langevin":
    built = dpd.build(scene, dt=0.04, platform="OpenCL", seed=1, engine="host", conservative="openmm", loop=False)
    integrator = openmm.LangevinMiddleIntegrator(120, 1, 0.04)
    system = openmm.XmlSerializer.clone(built.system)
    system.removeForce(next(k for k, force in enumerate(system.getForces()) if isinstance(force, openmm.PythonForce)))
    simulation = openmm.app.Simulation(
        built.topology, system, integrator, openmm.Platform.getPlatformByName("OpenCL"), {"Precision": "single"}
    )
    simulation.context.setPositions(x)
else:
    built = dpd.build(scene, dt=0.04, scheme=scheme, platform="OpenCL", seed=1, engine="device")
    simulation = built.simulation(properties={"Precision": "single"})
simulation.step(20)
before = list(counts)
simulation.step(steps)
print(json.dumps([(now - then) / steps for now, then in zip(counts, before, strict=True)]))
