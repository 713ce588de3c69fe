"""One run of one method: from a job, plain data, to a report, plain data."""

from __future__ import annotations

import json
import subprocess
import sys
import time
from dataclasses import replace
from pathlib import Path

import numpy as np
import openmm
from openmm import unit

import openmm_dpd as dpd
from openmm_dpd.base.errors import DPDError

from . import peer
from .fluids import FLUIDS, Fluid, Method, method_of
from .sampling import Measurer, Series

_NM, _V = unit.nanometer, unit.nanometer / unit.picosecond


def range_of_pairs(scene: dpd.Scene) -> float:
    """Longest cutoff of the pair tables."""
    return max(c.cutoff for table in scene.tables for c in table.resolve(scene.type_names).values())


def states(job: dict, folder: Path) -> Path:
    """Equilibrated positions, velocities and internal energies of a fluid, made once and kept in a file."""
    fluid = FLUIDS[job["fluid"]]
    file = folder / f"start_{fluid.name}_{job['beads']}_{job['kT']:g}_{job['equilibrate']:g}.npz"
    if file.exists():
        return file
    scene = fluid.scene(job["beads"], job["seed"], job["kT"])
    built = dpd.build(scene, dt=fluid.settle_dt, scheme="middle", platform="CPU", seed=job["seed"])
    simulation = built.simulation(properties={"Threads": "1"})
    simulation.step(round(job["equilibrate"] / fluid.settle_dt))
    state = simulation.context.getState(positions=True, velocities=True)
    x, v = state.getPositions(asNumpy=True).value_in_unit(_NM), state.getVelocities(asNumpy=True).value_in_unit(_V)
    carried = dpd.read_fields(simulation.context, built.plan)
    part = file.with_suffix(f".{time.time_ns()}.npz")
    np.savez(part, x=x, v=v, **{name: carried[name] for name in ("theta", "u_cond") if name in carried})
    part.replace(file)
    return file


def started(job: dict, folder: Path) -> dpd.Scene:
    """The scene of a job in the state it starts from."""
    scene = FLUIDS[job["fluid"]].scene(job["beads"], job["seed"], job["kT"])
    with np.load(states(job, folder)) as data:
        changes = {"positions": data["x"], "velocities": data["v"]}
        if "theta" in data:
            changes["internal"] = dpd.InternalEnergy(scene.internal.eos, data["theta"], data["u_cond"])
    return replace(scene, **changes)


def run(job: dict, folder: Path) -> dict:
    """Carry out a job: ``fluid``, ``method``, ``dt``, ``time``, ``discard``, ``beads``, ``seed``, ``kT``, ``equilibrate``."""
    dpd.set_threads(1)
    method = method_of(job["fluid"], job["method"])
    begun = time.perf_counter()
    try:
        report = _lammps(job, folder) if method.kind == "lammps" else ours(job, method, folder)
    except (DPDError, openmm.OpenMMException) as error:
        report = {"failed": str(error).splitlines()[0][:200]}
    return job | report | {"seconds": round(time.perf_counter() - begun, 2)}


def ours(job: dict, method: Method, folder: Path) -> dict:
    """A run in OpenMM."""
    fluid, dt = FLUIDS[job["fluid"]], job["dt"]
    scene = started(job, folder)
    choices = {"scheme": method.scheme, "lam": method.lam, "platform": method.platform, "engine": method.engine, "seed": job["seed"]}
    built = dpd.build(scene, dt=dt, **choices)
    properties = {"Threads": "1"} if method.platform == "CPU" else {"Precision": method.precision} if method.precision else None
    simulation = built.simulation(properties=properties)
    observer, context = dpd.Observer(built), simulation.context
    series = Series(np.diag(scene.box), range_of_pairs(scene))
    every = max(1, round(fluid.sample / dt))
    simulation.step(round(job["discard"] / dt))
    for k in range(max(1, round(job["time"] / dt / every))):
        simulation.step(every)
        s = observer.sample(context)
        x = context.getState(positions=True).getPositions(asNumpy=True).value_in_unit(_NM)
        carried = (s.theta, s.total) if fluid.conserves else (None, None)
        series.add(s, x, (k + 1) * every * dt, *carried)
        if s.kT > 5 * job["kT"] and not fluid.conserves:
            return {"failed": f"the kinetic temperature is {s.kT:.3g}"}
    return series.report(fluid.lags)


def _lammps(job: dict, folder: Path) -> dict:
    """A run in LAMMPS, in a process of its own: it ends the process when something goes wrong."""
    if not FLUIDS[job["fluid"]].deck:
        states(job, folder)
    command = [sys.executable, "-m", "atlas_parts.drivers", json.dumps(job), str(folder)]
    done = subprocess.run(command, cwd=Path(__file__).parents[1], capture_output=True, text=True, env=peer.environment())
    lines = [line for line in done.stdout.splitlines() if line.startswith("{")]
    if done.returncode or not lines:
        last = (done.stdout + done.stderr).strip().splitlines()[-1:] or ["no output"]
        return {"failed": last[0][:200]}
    return json.loads(lines[-1])


def lammps(job: dict, folder: Path) -> dict:
    """The run of :func:`_lammps`, in that process."""
    fluid: Fluid = FLUIDS[job["fluid"]]
    method = method_of(job["fluid"], job["method"])
    dt, every = job["dt"], max(1, round(fluid.sample / job["dt"]))
    scene = fluid.scene(job["beads"], job["seed"], job["kT"]) if fluid.deck else started(job, folder)
    edges, unit_length = np.diag(scene.box), fluid.length_unit
    measure, series = Measurer(scene), Series(edges, range_of_pairs(scene))
    with peer.instance() as lmp:
        peer.prepare(lmp, fluid, method, scene, job)
        lmp.command(f"timestep {dt!r}")
        # a deck has run before, to equilibrate; setting up again would move the energy by a first half step
        lmp.command(f"run {round(job['discard'] / dt)} {'pre no ' if fluid.deck else ''}post no")
        for k in range(max(1, round(job["time"] / dt / every))):
            lmp.command(f"run {every} pre no post no")
            x, v = (unit_length * np.array(lmp.gather_atoms(name, 1, 3)).reshape(-1, 3) for name in "xv")
            s = measure(x, v)
            theta = total = None
            if fluid.conserves:
                theta = peer.BOLTZMANN * lmp.extract_variable("atlas_theta")
                total = lmp.extract_variable("atlas_total")
            series.add(s, x, (k + 1) * every * dt, theta, total)
            if s.kT > 5 * job["kT"] and not fluid.conserves:
                return {"failed": f"the kinetic temperature is {s.kT:.3g}"}
    return series.report(fluid.lags)


if __name__ == "__main__":
    dpd.set_threads(1)
    print(json.dumps(lammps(json.loads(sys.argv[1]), Path(sys.argv[2]))))
