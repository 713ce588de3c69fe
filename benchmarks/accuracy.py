"""Accuracy of every scheme against the time step: kinetic and configurational temperature and potential energy per bead.

The standard fluid: rho = 3, A = 25, kT = 1, cutoff 1, at gamma = 4.5 and 40.5.  Prints one table per gamma; every entry carries its
standard error from block averages.  Potential energy per bead tends to 4.543(2) as dt -> 0.

    python benchmarks/accuracy.py                 # about 12 minutes on one core
    python benchmarks/accuracy.py --time 30       # a quick look
"""

from __future__ import annotations

import argparse
import json

import numpy as np

import openmm_dpd as dpd
from openmm_dpd.stats import block_average, ratio_average

STEPS = {4.5: (0.02, 0.05, 0.08, 0.10), 40.5: (0.01, 0.03, 0.06)}
SCHEMES = (("mvv", 0.5), ("mvv", 0.65), ("shardlow", 0.5), ("middle", 0.5), ("aboba", 0.5))


def equilibrated(n: int, gamma: float, seed: int) -> dpd.Scene:
    """The fluid after 20 time units at a small step."""
    edge = (n / 3.0) ** (1 / 3)
    pairs = {("W", "W"): dpd.DPD(A=25, gamma=gamma, cutoff=1)}
    scene = dpd.Scene({"W": 1.0}, ["W"] * n, np.random.default_rng(seed).random((n, 3)) * edge, pairs, kT=1.0, box=[edge] * 3)
    simulation = dpd.build(scene, dt=0.01, scheme="aboba", platform="CPU", seed=seed).simulation()
    simulation.step(2000)
    positions = simulation.context.getState(positions=True).getPositions(asNumpy=True)
    return dpd.Scene({"W": 1.0}, ["W"] * n, positions, pairs, kT=1.0, box=[edge] * 3)


def measure(scene: dpd.Scene, scheme: str, lam: float, dt: float, time: float, seed: int) -> dict | None:
    """Averages over ``time`` after a tenth of it, one sample every 0.2 time units; None if the run breaks down."""
    built = dpd.build(scene, dt=dt, scheme=scheme, lam=lam, platform="CPU", seed=seed)
    simulation, observer = built.simulation(), dpd.Observer(built)
    every = max(1, round(0.2 / dt))
    rows = []
    try:
        simulation.step(round(0.1 * time / dt))
        for _ in range(round(time / dt / every)):
            simulation.step(every)
            s = observer.sample(simulation.context)
            rows.append((s.kT, s.potential / scene.n_beads, s.gradient2, s.laplacian))
    except Exception as error:  # a run that breaks down is a result here
        print(f"# {scheme} lambda {lam} dt {dt}: {error}")
        return None
    kT, energy, gradient2, laplacian = np.array(rows).T
    values = {"kT": block_average(kT), "kT_conf": ratio_average(gradient2, laplacian), "U": block_average(energy)}
    return {name: (average.mean, average.sem) for name, average in values.items()}


def main() -> None:
    """Print the tables."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--beads", type=int, default=1500)
    parser.add_argument("--time", type=float, default=200.0, help="simulated time of each entry")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--threads", type=int, default=1)
    parser.add_argument("--gamma", type=float, nargs="*", default=list(STEPS))
    parser.add_argument("--json", help="write all numbers to this file")
    options = parser.parse_args()
    dpd.set_threads(options.threads)
    report = []
    for gamma in options.gamma:
        scene = equilibrated(options.beads, gamma, options.seed)
        print(f"\ngamma = {gamma:g}, {options.beads} beads: kinetic kT, configurational kT, U/N, with standard errors")
        for scheme, lam in SCHEMES:
            for dt in STEPS[gamma]:
                found = measure(scene, scheme, lam, dt, options.time, options.seed)
                report.append({"gamma": gamma, "scheme": scheme, "lambda": lam, "dt": dt, "result": found})
                name = f"{scheme} {lam:g}" if scheme == "mvv" else scheme
                text = "breaks down" if found is None else "  ".join(f"{key} {mean:.4f}({sem:.4f})" for key, (mean, sem) in found.items())
                print(f"{name:10s} dt {dt:<5g} {text}", flush=True)
    if options.json:
        with open(options.json, "w") as file:
            json.dump(report, file, indent=1)


if __name__ == "__main__":
    main()
