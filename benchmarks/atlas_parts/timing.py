"""Time per step of every method in one chain on the same cores, round after round; the best round counts.

A shared machine only ever makes things slower, and a peer that had a bad minute has the next round like everybody else.
"""

from __future__ import annotations

import json
import os
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np

import openmm_dpd as dpd

from . import peer
from .drivers import started
from .fluids import DECKS, DTS, FLUIDS, Method, available, method_of, methods
from .store import Store

#: Skins of LAMMPS's neighbour list that are tried; the faster one counts.
SKINS = (0.3, 0.65)


def steps_of(fluid_name: str, method: Method) -> tuple[float, ...]:
    """Step sizes at which a method is timed: LAMMPS's list is rebuilt more often at longer steps, the rest hardly depends on it."""
    steps = DTS[FLUIDS[fluid_name].grid][method.steps]
    return (steps[1], steps[len(steps) // 2], steps[-2]) if method.kind == "lammps" else (steps[len(steps) // 2],)


def jobs(fluids: list[str], beads: int, steps: int, threads: int, schemes: tuple[str, ...] | None = None) -> list[dict]:
    """Everything to be timed on a number of cores."""
    found = []
    for name in fluids:
        for method in methods(name):
            if not available(FLUIDS[name]) or (method.kind == "native" and threads > 1 and method.platform == "CPU" and name != "weak"):
                continue
            if schemes is not None and method.kind == "ours" and method.scheme not in schemes:
                continue
            for dt in steps_of(name, method):
                count = max(10, steps // 8) if method.slow else steps
                found.append(
                    {"part": "time", "fluid": name, "method": method.name, "dt": dt, "threads": threads, "beads": beads, "steps": count}
                )
    return found


def chain(todo: list[dict], rounds: int, folder: Path, store: Store, say: Callable[[str], None]) -> None:
    """Time all jobs, round after round; each round of each job is kept."""
    for turn in range(rounds):
        for job in todo:
            this = job | {"round": turn}
            if this in store:
                continue
            ms, failed = _in_a_process(this, folder)
            store.add(this | ({"failed": failed} if ms is None else {"ms": ms}))
            say(
                f"round {turn + 1}: {job['fluid']}, {job['method']}, dt {job['dt']:g}, {job['threads']} core(s): {f'{ms:.2f} ms' if ms else failed}"
            )


def best(store: Store) -> dict[tuple, float]:
    """The best round: {(fluid, method, threads, dt): ms}."""
    found: dict[tuple, float] = {}
    for r in store.results.values():
        if r.get("part") == "time" and "ms" in r:
            name = (r["fluid"], r["method"], r["threads"], r["dt"])
            found[name] = min(found.get(name, np.inf), r["ms"])
    return found


def at_step(times: dict[tuple, float], fluid: str, method: str, threads: int, dt: float) -> float | None:
    """ms per step at a step size, linear between those that were measured."""
    points = sorted((d, ms) for (f, m, t, d), ms in times.items() if (f, m, t) == (fluid, method, threads))
    return float(np.interp(dt, *np.array(points).T)) if points else None


def _in_a_process(job: dict, folder: Path) -> tuple[float | None, str]:
    threads = str(job["threads"])
    environment = peer.environment() | {"OMP_NUM_THREADS": threads, "NUMBA_NUM_THREADS": threads}
    command = [sys.executable, "-m", "atlas_parts.timing", json.dumps(job), str(folder)]
    done = subprocess.run(command, cwd=Path(__file__).parents[1], capture_output=True, text=True, env=environment)
    try:
        return float(done.stdout.split()[-1]), ""
    except (IndexError, ValueError):
        return None, ((done.stdout + done.stderr).strip().splitlines()[-1:] or ["no output"])[0][:200]


def measure(job: dict, folder: Path) -> float:
    """ms per step of one job, in this process."""
    cores = sorted(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else []
    if len(cores) >= job["threads"] > 0:
        os.sched_setaffinity(0, cores[: job["threads"]])
    dpd.set_threads(job["threads"])
    fluid = FLUIDS[job["fluid"]]
    method = method_of(job["fluid"], job["method"])
    scene = started({"fluid": job["fluid"], "beads": job["beads"], "seed": 1, "kT": 1.0, "equilibrate": 5.0}, folder)
    if method.kind == "lammps":
        return _lammps(job, fluid, method, scene)
    built = dpd.build(scene, dt=job["dt"], scheme=method.scheme, lam=method.lam, platform=method.platform, seed=1)
    properties = {"Threads": str(job["threads"])} if method.platform == "CPU" else None
    simulation = built.simulation(properties=properties)
    simulation.step(max(20, job["steps"] // 5))
    simulation.context.getState(energy=True)
    begun = time.perf_counter()
    simulation.step(job["steps"])
    simulation.context.getState(energy=True)  # waits for an OpenCL queue
    return (time.perf_counter() - begun) / job["steps"] * 1e3


def _lammps(job: dict, fluid, method: Method, scene: dpd.Scene) -> float:
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        data = folder / "data"
        if not fluid.deck:
            data.write_text(peer.data_file(scene, method))
        found = []
        for skin in (None,) if fluid.deck else SKINS:
            lines = peer.timing_lines(fluid, method, data, job["dt"], job["steps"], skin)
            found.append(peer.timed(lines, folder, DECKS if fluid.deck else folder, job["steps"], job["threads"]))
        return min(found)


if __name__ == "__main__":
    print(measure(json.loads(sys.argv[1]), Path(sys.argv[2])))
