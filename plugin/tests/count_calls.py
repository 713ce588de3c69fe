"""Calls per step through Simulation.step, with count.c preloaded: one line of JSON.

python count_calls.py STEPS none|bonds+charges SCHEME ...
"""

import ctypes
import json
import sys

import numpy as np
import openmm

import openmm_dpd as dpd

COUNTS = (ctypes.c_long * 3).in_dll(ctypes.CDLL(None), "counts")
BEADS, EDGE = 648, 6.0


def scene(beside: list[str]) -> dpd.Scene:
    """A fluid, with some bonds and charges if they are asked for."""
    rng = np.random.default_rng(1)
    x = np.stack(np.meshgrid(*[np.arange(9) * EDGE / 9] * 3), -1).reshape(-1, 3)[:BEADS] + rng.random((BEADS, 3)) * 0.1
    more = {"bonds": [dpd.HarmonicBonds(np.arange(216).reshape(-1, 2), k=20, r0=0.6)]} if "bonds" in beside else {}
    if "charges" in beside:
        more |= {
            "charges": np.where(np.arange(BEADS) < 64, np.arange(BEADS) % 2 * 2.0 - 1, 0),
            "electrostatics": dpd.SlaterCharges(0.25, bjerrum_length=1.0),
        }
    return dpd.Scene({"W": 1}, ["W"] * BEADS, x, {("W", "W"): dpd.DPD(A=25, gamma=4.5)}, kT=1, box=[EDGE] * 3, **more)


def started(scheme: str, beside: list[str]) -> openmm.app.Simulation:
    """A scheme on the device; "langevin" is OpenMM's own dynamics of the same beads."""
    precision = {"Precision": "single"}
    if scheme != "langevin":
        return dpd.build(scene(beside), dt=0.04, scheme=scheme, platform="OpenCL", seed=1, engine="device").simulation(properties=precision)
    built = dpd.build(scene(beside), dt=0.04, platform="OpenCL", seed=1, engine="host", conservative="openmm", loop=False)
    integrator = openmm.LangevinMiddleIntegrator(120, 1, 0.04)
    system = openmm.XmlSerializer.clone(built.system)
    system.removeForce(next(k for k, force in enumerate(system.getForces()) if isinstance(force, openmm.PythonForce)))
    simulation = openmm.app.Simulation(built.topology, system, integrator, openmm.Platform.getPlatformByName("OpenCL"), precision)
    simulation.context.setPositions(built.positions)
    return simulation


def counted(scheme: str, beside: list[str], steps: int) -> list[float]:
    """Launches, blocking transfers and waits of a step."""
    simulation = started(scheme, beside)
    simulation.step(20)
    before = list(COUNTS)
    simulation.step(steps)
    return [(now - then) / steps for now, then in zip(COUNTS, before, strict=True)]


print(json.dumps({scheme: counted(scheme, sys.argv[2].split("+"), int(sys.argv[1])) for scheme in sys.argv[3:]}))
