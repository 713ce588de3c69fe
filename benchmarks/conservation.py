"""Drift of the total energy U + K + sum u against friction, repulsion, scheme and step: what ``recommend(..., duration=...)`` knows about it.

Beads with internal energies in a small box; the drift is the slope of the energy per bead and time, in units of kT and rc (m/kT)^(1/2).  Sweeps
conserve the energy to rounding, so that the slope is that of kicks and drifts alone and is seen in short runs.  A large heat capacity
(1,000) keeps the fluid at its temperature meanwhile; others are on a line of their own.  A friction of 0.001 stands for none.  Runs what is
missing in ``out/conservation``, then writes openmm_dpd/advice/drift.json and the table of docs/schemes.md; it can be interrupted at any time.

    python benchmarks/conservation.py               # half an hour of one core
    python benchmarks/conservation.py --only table  # only the file, from the runs that are there
    python benchmarks/conservation.py --bonded      # drifts with bonds and charges, beside those of the fluid alone at the same steps
    python benchmarks/conservation.py --check       # the step for an energy within 1 % over 1,000 units of time, run for so long
"""

from __future__ import annotations

import argparse
import datetime
import functools
import json
import sys
import time
from dataclasses import replace
from pathlib import Path

import numpy as np
import openmm
from scipy.optimize import nnls

ROOT = Path(__file__).resolve().parents[1]
sys.path.insert(0, str(Path(__file__).parent))

from atlas_parts import page  # noqa: E402
from atlas_parts.scenes import SCENES, conserving, fluid  # noqa: E402
from atlas_parts.store import Store  # noqa: E402
from atlas_parts.summary import machine, short, write  # noqa: E402

import openmm_dpd as dpd  # noqa: E402
from openmm_dpd.advice.scene_groups import groups  # noqa: E402
from openmm_dpd.advice.stability_table import shipped_table  # noqa: E402
from openmm_dpd.base.errors import DPDError  # noqa: E402

FILE = ROOT / "openmm_dpd" / "advice" / "drift.json"
SCHEMES = ("shardlow", "middle", "basa", "aboba", "bababo", "bababs", "bab3")
BASE = {"gamma": 4.5, "a": 25.0, "rho": 3.0, "mass": 1.0, "s": 1.0, "cv": None}
#: Drifts, kT per bead and unit of time, for which the table has steps.
LEVELS = (1e-4, 1e-3, 1e-2, 1e-1)
#: Heat capacity that stands for a thermostat, factor between two steps, beads, and the longest run.
LARGE, FACTOR, BEADS, LONGEST = 1000.0, 1.35, 300, 75.0
#: First step that is tried at a repulsion of 25, which goes with its root.
FIRST = dict.fromkeys(SCHEMES, 0.04) | {"bababo": 0.07, "bababs": 0.07, "bab3": 0.12}

#: Schemes with Shardlow's updates have the drift of those with exact ones, as the first two points show; elsewhere they are not run.
ALIKE = {"basa": "middle", "bababs": "bababo"}
POINTS = (
    *(BASE | {"gamma": g, "a": a} for a in (25.0, 100.0, 6.0) for g in (4.5, 40.5, 0.001, 135.0)),
    *(BASE | {"cv": cv} for cv in (10.0, 3.0, 100.0)),
    *(BASE | {"gamma": g, "rho": 6.0} for g in (4.5, 0.001)),
)


def scene_of(point: dict, beads: int = BEADS) -> dpd.Scene:
    """The fluid of a point."""
    inside = dpd.InternalEnergy(dpd.ConstantHeatCapacity(point["cv"] or LARGE), 1.0)
    pairs = {("A", "A"): dpd.EnergyDPD(A=point["a"], sigma=(2 * point["gamma"]) ** 0.5, kappa=1.0)}
    return fluid(beads, pairs, rho=point["rho"], internal=inside)


@functools.lru_cache(maxsize=4)
def settled(text: str, beads: int) -> np.ndarray:
    """Positions in equilibrium, by a medium friction, of a point or a scene with bonds or charges."""
    scene = kept(text) if text in BONDED else scene_of(json.loads(text) | {"gamma": 4.5, "cv": None}, beads)
    dt = 0.001 if text in BONDED else 0.004
    simulation = dpd.build(scene, dt=dt, scheme="middle", platform="CPU", seed=1).simulation()
    simulation.step(round(10.0 / dt))
    return simulation.context.getState(positions=True).getPositions(asNumpy=True)


def slope(times: np.ndarray, energies: np.ndarray, pieces: int = 8) -> tuple[float, float]:
    """Slope of the energy, and its standard error from the differences between means of pieces."""
    t, e = (np.array([part.mean() for part in np.array_split(column, pieces)]) for column in (times, energies))
    slopes = np.diff(e) / np.diff(t)
    return float(np.polyfit(times, energies, 1)[0]), float(np.std(slopes, ddof=1) / len(slopes) ** 0.5)


def work(job: dict) -> dict:
    """Drift of one run."""
    dpd.set_threads(1)
    begun, dt = time.perf_counter(), job["dt"]
    name = job.get("scene") or json.dumps(job["point"])
    built = dpd.build(
        kept(name) if "scene" in job else scene_of(job["point"], job["beads"]), dt=dt, scheme=job["scheme"], platform="CPU", seed=2
    )
    simulation, observer = built.simulation(properties={"Threads": "1"}), dpd.Observer(built)
    simulation.context.setPositions(settled(name, job["beads"]))
    every, rows = max(1, round(0.2 / dt)), []
    try:
        simulation.step(round(4.0 / dt))
        while True:
            for _ in range(round(15.0 / (every * dt))):
                simulation.step(every)
                s = observer.sample(simulation.context)
                rows.append((s.time, s.total / job["beads"]))
            drift, sem = slope(*np.array(rows).T)
            if not np.isfinite(drift) or abs(drift) > 2.0:
                return job | {"failed": "blows up"}
            if sem < max(0.1 * abs(drift), 1e-5) or len(rows) * every * dt > job["time"]:
                break
    except (DPDError, openmm.OpenMMException, FloatingPointError):
        return job | {"failed": "blows up"}
    return job | {"drift": [short(drift), short(sem, 2)], "seconds": round(time.perf_counter() - begun, 1)}


def ladder(scheme: str, point: dict, store: Store) -> None:
    """Steps up to a drift beyond the last level, and down to one below the first."""

    def drift(dt: float) -> float:
        job = {"scheme": scheme, "point": point, "dt": float(f"{dt:.4g}"), "beads": BEADS, "time": LONGEST}
        if job not in store:
            store.add(work(job))
        known = store.get(job)
        return np.inf if "failed" in known else abs(known["drift"][0])

    first = FIRST[scheme] * min(1.5, (25.0 / point["a"]) ** 0.5)
    dt = first
    while drift(dt) < LEVELS[-1] and dt < 0.5:
        dt *= FACTOR
    dt = first
    while drift(dt) > LEVELS[0] and dt > 0.004:
        dt /= FACTOR


def level(rows: list[list[float]], bound: float) -> list:
    """The step at which the drift reaches a bound, [dt, standard error, ""].

    All runs together make one curve, a sum of dt^4, dt^6, dt^8 and dt^12 with no negative coefficient; a tenth of each drift is left to what
    it cannot follow.  So the fourth power is the slowest way in which a drift gets lost in its noise.
    """
    dt, drift, sem = np.array(rows).T
    powers = np.array([4, 6, 8, 12])
    weight = 1 / np.hypot(np.maximum(sem, 1e-5), 0.1 * drift)
    grid = np.geomspace(0.3 * dt[0], dt[-1], 400)

    def first(values: np.ndarray) -> float:
        coefficients = nnls((dt[:, None] / dt[-1]) ** powers * weight[:, None], values * weight)[0]
        curve = (grid[:, None] / dt[-1]) ** powers @ coefficients
        return float(np.interp(np.log(bound), np.log(np.maximum(curve, 1e-12)), grid))

    rng = np.random.default_rng(0)
    return [short(first(drift)), short(float(np.std([first(rng.normal(drift, sem)) for _ in range(100)])), 2), ""]


def tabulate(store: Store) -> dict:
    """The table of the package."""
    points: dict[str, dict] = {}
    for scheme in SCHEMES:
        for point in POINTS:
            of = scheme if point in POINTS[:2] else ALIKE.get(scheme, scheme)
            runs = [r for r in store.results.values() if r["scheme"] == of and r.get("point") == point]
            blown = min((r["dt"] for r in runs if "failed" in r), default=np.inf)
            rows = [[r["dt"], *r["drift"]] for r in sorted(runs, key=lambda r: r["dt"]) if r["dt"] < blown]
            if rows:
                entry = points.setdefault(json.dumps(point), point | {"schemes": {}})
                entry["schemes"][scheme] = {"drift": {f"{100 * bound:g}": level(rows, bound) for bound in LEVELS}}
    return {
        "about": "steps at which the total energy drifts by 1e-4, 1e-3, 1e-2, 1e-1 kT per bead and unit of time, in units of rc (m/kT)^(1/2): "
        "[dt, standard error, kind of bound]; a friction of 0.001 stands for none; written by benchmarks/conservation.py",
        "date": datetime.date.today().isoformat(),
        "machine": machine(),
        "levels": LEVELS,
        "order": 4,
        "base": BASE,
        "cost": dict.fromkeys(SCHEMES, 1.0),
        "points": sorted(points.values(), key=lambda p: [p["cv"] or LARGE, p["rho"], p["a"], p["gamma"]]),
    }


def text(table: dict) -> str:
    """The table of the page: steps for a drift of 0.001."""
    lines = ["| friction, A, density, heat capacity | " + " | ".join(f"`{s}`" for s in SCHEMES) + " |", "| --- " * (len(SCHEMES) + 1) + "|"]
    for p in table["points"]:
        head = f"{'none' if p['gamma'] < 0.01 else format(p['gamma'], 'g')}, {p['a']:g}, {p['rho']:g}, {p['cv'] or LARGE:g}"
        cells = [p["schemes"][s]["drift"]["0.1"] if s in p["schemes"] else None for s in SCHEMES]
        lines.append(f"| {head} | " + " | ".join(f"{c[0]:.2g} ± {c[1]:.1g}" if c else "-" for c in cells) + " |")
    return "\n".join(lines)


#: Fluids with ions: part of the beads that are ions, and width of their charges.
IONS = {"a fifth are ions": (0.2, 0.25), "all are ions": (1.0, 0.35)}
#: Scenes with bonds, angles and charges whose beads keep their energy, in a fluid of A 25 (the electrolyte's is 78).
BONDED = (
    "chains, k 4, rest length 0",
    "chains, k 100",
    "chains, k 1000",
    "FENE chains, k 30, R0 1.5",
    "Morse chains, D 50, alpha 8",
    "chains, k 100, angles k 50",
    "electrolyte, A 78",
    *IONS,
)


def ions(part: float, lamda: float, beads: int = 400) -> dpd.Scene:
    """A fluid, part of whose beads are ions with Slater charges, one half of either sign."""
    charges = np.zeros(beads)
    charges[: round(part * beads)] = np.tile([1.0, -1.0], round(part * beads / 2))
    electrostatics = dpd.SlaterCharges(lamda=lamda, bjerrum_length=1.1)
    return fluid(beads, {("A", "A"): dpd.DPD(A=25, gamma=4.5)}, charges=charges, electrostatics=electrostatics)


def kept(name: str) -> dpd.Scene:
    """A scene of :mod:`atlas_parts.scenes`, or with ions, with internal energies in its beads."""
    scene = ions(*IONS[name]) if name in IONS else SCENES[name](BEADS)
    pairs = {("*", "*"): dpd.EnergyDPD(A=78.0 if "78" in name else 25.0, sigma=3.0, kappa=1.0)}
    return replace(scene, pairs=pairs, internal=dpd.InternalEnergy(dpd.ConstantHeatCapacity(LARGE), 1.0), bead_masses=None)


def bonded(store: Store, schemes: tuple[str, ...] = ("middle", "bababo", "bab3")) -> None:
    """Drifts at the steps that are recommended for temperatures, beside what the table says of the fluid."""
    drift = shipped_table("drift")
    print("| scene | scheme, step (limit) | kT per bead and time | of the fluid alone |\n| --- | --- | --- | --- |")
    for name in BONDED:
        scene = kept(name)
        for choice in (one for one in dpd.recommend(scene, 0.01).choices if one.scheme in schemes):
            job = {"scene": name, "scheme": choice.scheme, "dt": float(f"{choice.dt:.4g}"), "beads": scene.n_beads, "time": 4 * LONGEST}
            if job not in store:
                store.add(work(job))
            known, alone = store.get(job), drift.error(choice.scheme, groups(scene)[0][0], choice.dt, "drift")
            text = known.get("failed") or f"{known['drift'][0]:+.2g}({known['drift'][1]:.1g})"
            print(f"| {name} | `{choice.scheme}`, {choice.dt:.3g} ({choice.limit}) | {text} | {alone:.2g} |", flush=True)


def check(length: float) -> None:
    """Change of the energy in a run of this length, as a part of the heat in the beads, at the steps of the three cheapest schemes."""
    for name, scene, heat in (
        ("heat capacity 10", conserving(BEADS, 10.0), 11.5),
        ("heat capacity 60", conserving(BEADS, 60.0), 61.5),
        ("no friction, A 50", fluid(BEADS, {("A", "A"): dpd.DPD(A=50, gamma=0)}), 1.5),
    ):
        found = dpd.recommend(scene, 0.01, duration=length)
        first = fluid(BEADS, {("A", "A"): dpd.DPD(A=50 if heat < 2 else 25, gamma=4.5)})
        simulation = dpd.build(first, dt=0.004, scheme="middle", platform="CPU", seed=7).simulation(properties={"Threads": "1"})
        simulation.step(4000)
        state = simulation.context.getState(positions=True, velocities=True)
        for choice in found.choices[:3]:
            built = dpd.build(scene, dt=choice.dt, scheme=choice.scheme, platform="CPU", seed=8)
            simulation, observer = built.simulation(properties={"Threads": "1"}), dpd.Observer(built)
            simulation.context.setPositions(state.getPositions())
            simulation.context.setVelocities(state.getVelocities())
            ends = []
            for steps in (20.0, length):
                simulation.step(round(steps / choice.dt))
                total = []
                for _ in range(50):
                    simulation.step(max(1, round(0.1 / choice.dt)))
                    total.append(observer.sample(simulation.context).total / BEADS)
                ends.append(np.mean(total))
            off = (ends[1] - ends[0]) / heat
            print(f"{name}, {choice.scheme} {choice.dt:.3g} ({choice.limit}): energy {100 * off:+.2f} %", flush=True)


def main() -> None:
    """Run what is missing, write table and page."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--only", choices=("runs", "table"))
    parser.add_argument("--schemes", nargs="+", choices=SCHEMES, default=SCHEMES)
    parser.add_argument("--check", action="store_true")
    parser.add_argument("--bonded", action="store_true")
    parser.add_argument("--length", type=float, default=1000.0)
    options = parser.parse_args()
    if options.check:
        return check(options.length)
    store = Store(ROOT / "out" / "conservation" / "results.jsonl")
    if options.bonded:
        return bonded(store)
    if options.only != "table":
        for point in POINTS:
            for scheme in options.schemes:
                if scheme not in ALIKE or point in POINTS[:2]:
                    ladder(scheme, point, store)
                    print(scheme, point, flush=True)
    if options.only != "runs":
        table = tabulate(store)
        write(table, FILE)
        page.update(ROOT / "docs" / "schemes.md", texts={"drift": text(table)})


if __name__ == "__main__":
    main()
