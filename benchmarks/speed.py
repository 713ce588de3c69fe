"""Time per step beside the peers, in one chain on the same cores: 10,000 beads, rho = 3, dt = 0.05, after equilibration.

LAMMPS pair dpd + fix nve (MPI ranks = threads), OpenMM's DPDIntegrator on the CPU platform, and every scheme here with the
conservative force in
the pair kernel (plan left on auto) and as a CustomNonbondedForce.  Prints ms per step and the ratio to LAMMPS; several rounds, the
best of each, since a shared machine only ever makes things slower.

    python benchmarks/speed.py --threads 1
    python benchmarks/speed.py --threads 2
"""

from __future__ import annotations

import argparse
import json
import os
import platform
import re
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import numpy as np
import openmm

import openmm_dpd as dpd

DECK = """units lj
atom_style atomic
comm_modify vel yes
newton on
read_data {data}
pair_style dpd 1.0 1.0 34387
pair_coeff 1 1 25.0 4.5 1.0
neighbor 0.3 bin
neigh_modify delay 0 every 1 check yes
fix 1 all nve
timestep {dt}
thermo 1000000
run {warm}
run {steps}
"""


def fluid(n: int, seed: int) -> dpd.Scene:
    """The equilibrated standard fluid."""
    edge = (n / 3.0) ** (1 / 3)
    pairs = {("W", "W"): dpd.DPD(A=25, gamma=4.5, cutoff=1)}
    scene = dpd.Scene({"W": 1.0}, ["W"] * n, np.random.default_rng(seed).random((n, 3)) * edge, pairs, kT=1.0, box=[edge] * 3)
    simulation = dpd.build(scene, dt=0.02, scheme="middle", platform="CPU", seed=seed).simulation()
    simulation.step(500)
    state = simulation.context.getState(positions=True, velocities=True)
    x, v = state.getPositions(asNumpy=True), state.getVelocities(asNumpy=True)
    return dpd.Scene({"W": 1.0}, ["W"] * n, x, pairs, kT=1.0, box=[edge] * 3, velocities=v)


def lammps(scene: dpd.Scene, dt: float, steps: int, threads: int) -> float:
    """ms per step of LAMMPS in a process of its own."""
    n, edge = scene.n_beads, float(scene.box[0, 0])
    with tempfile.TemporaryDirectory() as folder:
        lines = [
            f"fluid\n\n{n} atoms\n1 atom types\n",
            *(f"0 {edge!r} {a}lo {a}hi" for a in "xyz"),
            "\nMasses\n\n1 1.0\n\nAtoms # atomic\n",
        ]
        lines += [f"{k + 1} 1 {x[0]!r} {x[1]!r} {x[2]!r}" for k, x in enumerate((scene.positions % edge).tolist())]
        lines += ["\nVelocities\n", *(f"{k + 1} {v[0]!r} {v[1]!r} {v[2]!r}" for k, v in enumerate(scene.velocities.tolist()))]
        data, deck = Path(folder) / "data", Path(folder) / "in"
        data.write_text("\n".join(lines) + "\n")
        deck.write_text(DECK.format(data=data, dt=dt, warm=max(20, steps // 5), steps=steps))
        # the lmp of this environment, whose wheel needs the MPI that stands beside it
        bin_folder = Path(sys.executable).parent
        environment = os.environ | {"OMP_NUM_THREADS": "1", "LD_LIBRARY_PATH": str(Path(sys.prefix) / "lib")}
        command = [str(bin_folder / "lmp"), "-in", str(deck), "-log", "none"]
        if threads > 1:
            command = [str(bin_folder / "mpirun"), "-np", str(threads), *command]
        output = subprocess.run(command, capture_output=True, text=True, env=environment, cwd=folder, check=True).stdout
    loops = re.findall(r"Loop time of ([\d.eE+-]+) on", output)
    return float(loops[-1]) / steps * 1e3


def ours(scene: dpd.Scene, scheme: str, conservative: str, dt: float, steps: int, threads: int) -> float:
    """ms per step of one scheme of this package, or of OpenMM's DPDIntegrator (scheme native)."""
    built = dpd.build(scene, dt=dt, scheme=scheme, conservative=conservative, platform="CPU", seed=1)
    simulation = built.simulation(properties={"Threads": str(threads)})
    simulation.step(max(20, steps // 5))
    begun = time.perf_counter()
    simulation.step(steps)
    return (time.perf_counter() - begun) / steps * 1e3


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--threads", type=int, default=1)
    parser.add_argument("--beads", type=int, default=10000)
    parser.add_argument("--dt", type=float, default=0.05)
    parser.add_argument("--steps", type=int, default=200)
    parser.add_argument("--rounds", type=int, default=3)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--json", help="write all numbers to this file")
    options = parser.parse_args()
    dpd.set_threads(options.threads)
    scene = fluid(options.beads, options.seed)
    jobs = {"LAMMPS pair dpd + fix nve": lambda: lammps(scene, options.dt, options.steps, options.threads)}
    for scheme in ("mvv", "shardlow", "middle", "aboba"):
        for where in ("auto", "openmm"):
            jobs[f"{scheme}, conservative={where}"] = lambda s=scheme, w=where: ours(
                scene, s, w, options.dt, options.steps, options.threads
            )
    jobs["OpenMM DPDIntegrator"] = lambda: ours(scene, "native", "openmm", options.dt, max(20, options.steps // 10), options.threads)
    best = dict.fromkeys(jobs, float("inf"))
    for _ in range(options.rounds):
        for name, job in jobs.items():
            best[name] = min(best[name], job())
    reference = best["LAMMPS pair dpd + fix nve"]
    print(
        f"{options.beads} beads, dt {options.dt:g}, {options.threads} thread(s), "
        f"OpenMM {openmm.__version__}, {platform.processor() or platform.machine()}"
    )
    for name, value in best.items():
        print(f"{name:32s} {value:8.2f} ms/step   {value / reference:6.2f} x LAMMPS")
    if options.json:
        Path(options.json).write_text(json.dumps({**vars(options), "ms_per_step": best}, indent=1))


if __name__ == "__main__":
    main()
