"""Steps for many-body liquids with a surface: temperatures off by 1, 5 and 10 %, and the step that blows up, by friction and stiffness.

Slabs of liquid with vacuum beside them, by the search of benchmarks/stability.py, in reduced units (cutoff of the attraction, mass and kT are
1, the repulsion reaches 0.75).  Runs what is missing in ``out/many_body``, then writes openmm_dpd/advice/many_body.json and the
table of docs/schemes.md; it can be interrupted at any time.

    python benchmarks/many_body.py               # twenty minutes of one core
    python benchmarks/many_body.py --cost        # the time of a step of each scheme, 3,000 beads
    python benchmarks/many_body.py --only table  # only the table, from the runs that are there
"""

from __future__ import annotations

import argparse
import functools
import json
import time
from pathlib import Path

import numpy as np
import stability
from atlas_parts import page
from atlas_parts.scenes import slab
from atlas_parts.store import Store, carry_out
from atlas_parts.summary import short, write

import openmm_dpd as dpd
from openmm_dpd.advice.scene_groups import liquid_density, stiffness

ROOT = Path(__file__).resolve().parents[1]
FILE = ROOT / "openmm_dpd" / "advice" / "many_body.json"

SCHEMES = ("mvv", "shardlow", "middle", "basa", "aboba", "bababo", "bababs", "bab3")
#: Attraction and repulsion of Warren's liquid, and of that at half and at twice its temperature.
LIQUIDS, FRICTIONS = ((-20.0, 12.5), (-40.0, 25.0), (-80.0, 50.0)), (4.5, 40.5)


def points() -> list[dict]:
    """Stiffness stands where the stability map has repulsion."""
    stiff = {ab: short(stiffness(*ab, liquid_density(*ab)), 4) for ab in LIQUIDS}
    return [stability.BASE | {"gamma": g, "a": stiff[ab], "A": ab[0], "B": ab[1]} for g in FRICTIONS for ab in LIQUIDS]


def scene_of(point: dict, beads: int) -> dpd.Scene:
    """Liquid between two free surfaces."""
    return slab(beads, point["A"], point["B"], point["gamma"])


def work(job: dict) -> dict:
    """One scheme at one point."""
    return stability.work(job, scene_of)


def costs(beads: int = 3000, rounds: int = 5, steps: int = 40) -> dict[str, float]:
    """Time of a step of each scheme beside that of mvv, Warren's liquid; the best of some rounds, in turn."""
    dpd.set_threads(1)
    scene, best = scene_of(points()[1], beads), dict.fromkeys(SCHEMES, np.inf)
    runs = {scheme: dpd.build(scene, dt=0.004, scheme=scheme, platform="CPU", seed=1).simulation() for scheme in SCHEMES}
    for run in runs.values():
        run.step(2500 if run is runs["mvv"] else 100)
        run.context.setPositions(runs["mvv"].context.getState(positions=True).getPositions())
    for _ in range(rounds):
        for scheme, run in runs.items():
            begun = time.perf_counter()
            run.step(steps)
            best[scheme] = min(best[scheme], time.perf_counter() - begun)
    return {scheme: short(value / best["mvv"], 3) for scheme, value in best.items()}


def blocks(table: dict) -> dict[str, str]:
    """Steps of 1 % of both temperatures, and what blows up."""
    tables = []
    for name, quantity in (("1 % of T_conf", "conf"), ("1 % of T_kin", "kin"), ("blows up", "blow")):
        rows = []
        for point in table["points"]:
            found = [point["schemes"][scheme][quantity] for scheme in SCHEMES]
            steps = [one if quantity == "blow" else one["1"] for one in found]
            texts = [f"{sign} {dt:.2g}" if sign else f"{dt:.2g} ± {sem:.1g}" for dt, sem, sign in steps]
            rows.append([f"{point['A']:g}, {point['B']:g}, {point['gamma']:g}", *texts])
        tables.append(page.table([f"{name}: A, B, friction", *(f"`{scheme}`" for scheme in SCHEMES)], rows))
    return {"many-body": "\n\n".join(tables)}


def main() -> None:
    """Run what is missing, write table and page."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--beads", type=int, default=400)
    parser.add_argument("--loose", type=float, default=2.0, help="standard errors in units of a quarter of the bound")
    parser.add_argument("--processes", type=int, default=1)
    parser.add_argument("--schemes", nargs="+", choices=SCHEMES, default=SCHEMES)
    parser.add_argument("--only", choices=("runs", "table"))
    parser.add_argument("--cost", action="store_true", help="only the times of a step")
    options = parser.parse_args()
    store = Store(ROOT / "out" / "many_body" / "results.jsonl")
    before = json.loads(FILE.read_text()) if FILE.exists() else {"points": [], "loose": 0.0, "cost": {}}
    length = {"beads": options.beads, "loose": options.loose, "longest": 400.0 / options.loose**2, "settle": 2500}
    jobs = [{"part": "many-body", "scheme": s, "point": p, **length} for s in options.schemes for p in points()]
    if options.only != "table" and not options.cost:
        carry_out(jobs, work, store, options.processes, functools.partial(print, flush=True))
    if options.only != "runs":
        table = stability.tabulate(store, costs() if options.cost else before["cost"], before)
        table |= {"about": table["about"].replace("stability.py", "many_body.py"), "a is": "stiffness B rho^2 of the liquid"}
        write(table, FILE)
        page.update(ROOT / "docs" / "schemes.md", texts=blocks(table))


if __name__ == "__main__":
    main()
