"""The stability map: for every scheme the step at which temperatures are 1, 5 and 10 % off, and the one at which it blows up.

Small systems, found by bisection.  Reduced units: cutoff 1, mass of the lightest bead 1, kT 1.  Runs what is missing in ``out/stability``,
then writes openmm_dpd/advice/stability.json, the maps in docs/figures and the tables of docs/atlas.md; it can be interrupted at any time.

    python benchmarks/stability.py --beads 300           # as the shipped table (velocity Verlet and shardlow: --loose 4): an hour of one
                                                         # core for native, up to twenty minutes for each other scheme
    python benchmarks/stability.py                       # twice the beads
    python benchmarks/stability.py --coarse              # a quarter of the points
    python benchmarks/stability.py --coarse --loose 4    # errors twice as large: some minutes
    python benchmarks/stability.py --missing             # only what the shipped table lacks
    python benchmarks/stability.py --only table          # only the table, the maps and the page
    python benchmarks/stability.py --noisy --loose 1 --schemes bababo  # points of the shipped table whose step of 1 % is badly known, again and
                                                         # longer: about a minute of one core each

What is not in ``out/stability`` stays in the data file as it is, so that single points can be measured again without all others.
"""

from __future__ import annotations

import argparse
import copy
import datetime
import functools
import json
import sys
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np
import openmm

ROOT = Path(__file__).resolve().parents[1]
sys.path.insert(0, str(Path(__file__).parent))

from atlas_parts import maps, page  # noqa: E402
from atlas_parts.errors import crossing  # noqa: E402
from atlas_parts.store import Store, carry_out  # noqa: E402
from atlas_parts.summary import machine, short, write  # noqa: E402

import openmm_dpd as dpd  # noqa: E402
from openmm_dpd.advice.stability_table import StabilityTable, shipped_table  # noqa: E402
from openmm_dpd.base.errors import DPDError  # noqa: E402
from openmm_dpd.stats import block_average, ratio_average  # noqa: E402

SCHEMES = ("mvv", "shardlow", "middle", "basa", "aboba", "bababo", "bababs", "bab3", "native")
#: Name of the native scheme in the atlas.
NATIVE = "OpenMM DPDIntegrator, CPU"

BASE = {"gamma": 4.5, "a": 25.0, "rho": 3.0, "mass": 1.0, "s": 1.0, "cv": None}
LEVELS = (0.01, 0.05, 0.10)

#: First step that is tried, and the factor between two of them; errors go as a power of the step between two.  Those of bababo do not:
#: they pass through zero more than once.
FIRST, FACTORS = 0.05, {"bababo": 1.2, "bababs": 1.2, "bab3": 1.2}
FACTOR = 1.5

#: Steps of schemes, times (a rho/3)^(1/2), from which on the configurational temperature is more than 1 % too low and comes back before it rises;
#: the curve through all runs does not follow that.  At friction 13.5 and repulsion 100 (600 beads, ``--loose 1``) the errors of bab3 are -0.2(2) %
#: at 0.086, -1.4(2) at 0.101, -1.6(2) at 0.104, -0.6(2) at 0.124 and +0.5(2) at 0.149.
DIPS = {"bab3": 1.1}

#: Shortest step that is tried where nothing blows up.
SHORTEST = 0.004

#: Longest step that is tried; nothing is learnt about real fluids beyond it.
LONGEST = 1.0

#: Relative standard error of a step of 1 %, and factor between it and the median of its neighbours, beyond which it is measured again.
NOISY = (0.3, 1.8)

FULL = {
    "gamma": (0.5, 1.5, 4.5, 13.5, 40.5, 135.0, 450.0), "a": (0.0, 6.0, 25.0, 50.0, 100.0), "rho": (1.0, 2.0, 4.0, 6.0, 8.0),
    "mass": (3.0, 10.0, 30.0, 100.0), "s": (0.25, 0.5, 2.0), "cv": (1.0, 3.0, 10.0, 100.0, 1e3, 1e5),
}  # fmt: skip
COARSE = {
    "gamma": (0.5, 4.5, 40.5, 450.0), "a": (0.0, 6.0, 25.0, 50.0, 100.0), "rho": (1.0, 8.0), "mass": (10.0, 100.0), "s": (0.25, 2.0), "cv": (1.0, 10.0, 1e5),
}  # fmt: skip


def points(grid: dict[str, tuple[float, ...]]) -> list[dict]:
    """Friction times repulsion as a plane; density, mass ratio and exponent as lines at two frictions; heat capacity as one line."""
    plane = [BASE | {"gamma": g, "a": a} for g in grid["gamma"] for a in grid["a"]]
    lines = [BASE | {"gamma": g, name: value} for name in ("rho", "mass", "s") for g in (4.5, 40.5) for value in grid[name]]
    return [*plane, *lines, *(BASE | {"cv": value} for value in grid["cv"])]


def noisy(table: StabilityTable) -> list[tuple[str, dict]]:
    """Schemes and points of the plane whose step of 1 % is badly known: by its standard error, or beside what its neighbours say.

    Neighbours in repulsion are brought to it with 1/omega ~ a^(-1/2), by which steps go if the repulsion limits them.
    """
    plane = {(p["gamma"], p["a"]): p for p in table.plane}
    gammas, repulsions = (sorted({key[k] for key in plane if key[1]}) for k in (0, 1))

    def beside(keys: list[tuple], key: tuple, scheme: str, kind: str) -> list[tuple]:
        """Those before and after it, of the points that have the scheme."""
        known = sorted(other for other in keys if scheme in plane[other]["schemes"])
        k = known.index(key)
        return [(other, plane[other]["schemes"][scheme][kind]["1"][0]) for other in known[max(k - 1, 0) : k] + known[k + 1 : k + 2]]

    found = []
    for (g, a), point in plane.items():
        for scheme in point["schemes"] if a else ():
            for kind in ("conf", "kin"):
                dt, sem, _ = point["schemes"][scheme][kind]["1"]
                near = [step for _, step in beside([(other, a) for other in gammas], (g, a), scheme, kind)]
                near += [step * (key[1] / a) ** 0.5 for key, step in beside([(g, other) for other in repulsions], (g, a), scheme, kind)]
                if sem > NOISY[0] * dt or abs(np.log(dt / np.median(near))) > np.log(NOISY[1]):
                    found.append((scheme, {name: point[name] for name in BASE}))
                    break
    return found


def possible(point: dict, scheme: str) -> bool:
    """Whether a scheme can run the fluid of a point."""
    return scheme != "native" or (point["s"] == 1.0 and point["cv"] is None)


def scene_of(point: dict, beads: int) -> dpd.Scene:
    """The fluid of a point on random positions; with a mass ratio, every other bead is the heavy one."""
    n = max(beads, int(np.ceil(point["rho"] * 2.2**3)))
    edge = (n / point["rho"]) ** (1 / 3)
    types = ["L", "H"] * (n // 2) + ["L"] * (n % 2) if point["mass"] != 1 else ["L"] * n
    masses = {"L": 1.0, "H": point["mass"]} if point["mass"] != 1 else {"L": 1.0}
    carried = {}
    if point["cv"] is None:
        coefficient = dpd.DPD(A=point["a"], gamma=point["gamma"], exponent=point["s"], cutoff=1)
    else:
        coefficient = dpd.EnergyDPD(A=point["a"], sigma=(2 * point["gamma"]) ** 0.5, kappa=1.0, cutoff=1)
        carried["internal"] = dpd.InternalEnergy(dpd.ConstantHeatCapacity(point["cv"]), 1.0)
    names = list(masses)
    pairs = {(a, b): coefficient for k, a in enumerate(names) for b in names[k:]}
    x = np.random.default_rng(1).random((n, 3)) * edge
    return dpd.Scene(masses, types, x, pairs, kT=1.0, box=[edge] * 3, **carried)


class Point:
    """One point of the map: its equilibrated fluid and what has been found about a scheme there."""

    def __init__(self, job: dict, scene_of: Callable[[dict, int], dpd.Scene]):
        self.job, self.point, self.scheme = job, job["point"], job["scheme"]
        self.factor = FACTORS.get(self.scheme, FACTOR)
        scene = scene_of(self.point, job["beads"])
        # random points overlap, and the heat of that must go before anything is measured; friction does not change the equilibrium, and
        # with a medium one it is reached soonest: weak friction takes the heat too slowly, strong friction holds the beads where they are
        first = scene_of(self.point | {"gamma": BASE["gamma"]}, job["beads"])
        built = dpd.build(first, dt=0.004, scheme="middle", platform="CPU", seed=1)
        simulation = built.simulation(properties={"Threads": "1"})
        simulation.step(job["settle"])
        state = simulation.context.getState(positions=True, velocities=True)
        self.x = state.getPositions(asNumpy=True)
        self.scene = scene
        self.tried: dict[float, dict] = {}

    def measure(self, dt: float, bound: float) -> dict:
        """{"conf": [error, sem], "kin": [error, sem]} at a step, or {"blown": True}; errors no larger than a quarter of the bound."""
        dt = float(f"{dt:.4g}")
        known = self.tried.get(dt)
        if known is not None and (known.get("blown") or known["bound"] <= bound):
            return known
        try:
            found = self._run(dt, bound)
        except (DPDError, openmm.OpenMMException, FloatingPointError):
            found = {"blown": True}
        self.tried[dt] = found | {"bound": bound}
        return self.tried[dt]

    def _run(self, dt: float, bound: float) -> dict:
        built = dpd.build(self.scene, dt=dt, scheme=self.scheme, platform="CPU", seed=2)
        simulation, observer = built.simulation(properties={"Threads": "1"}), dpd.Observer(built)
        simulation.context.setPositions(self.x)
        every = max(1, round(0.15 / dt))
        simulation.step(max(round(5.0 / dt), 20))
        rows: list[tuple] = []
        while True:
            for _ in range(60):
                simulation.step(every)
                s = observer.sample(simulation.context)
                target = s.theta if self.point["cv"] is not None else 1.0
                rows.append((s.kT, target, s.gradient2, (s.laplacian or 0.0) * target))
            found = self._errors(np.array(rows).T)
            size = max(abs(pair[0]) for pair in found.values())
            if size > 2.0 or not np.isfinite(size):
                return {"blown": True}
            wanted = max(0.25 * bound * self.job["loose"], 0.1 * min(abs(pair[0]) for pair in found.values()))
            if all(pair[1] < wanted for pair in found.values()) or len(rows) * every * dt > self._longest(bound):
                return found

    def _longest(self, bound: float) -> float:
        # errors go with the root of the length: a rough error needs a short run only; with weak friction the energy fluctuates slowly
        slow = 2.0 if self.point["gamma"] < 1 else 1.0
        return slow * self.job["longest"] * min(1.0, (3 * LEVELS[0] / bound) ** 2)

    def _errors(self, columns: np.ndarray) -> dict[str, list[float]]:
        kT, target, above, below = columns
        kinetic = block_average(kT / target)
        found = {"kin": [kinetic.mean - 1, kinetic.sem]}
        if below.any():
            conf = ratio_average(above, below)
            found["conf"] = [conf.mean - 1, conf.sem]
        return found

    def largest(self, dt: float, bound: float) -> float:
        """The larger of the two |errors|, as far as it is seen above its noise; infinite when blown up."""
        found = self.measure(dt, bound)
        if found.get("blown"):
            return np.inf
        pairs = [found[name] for name in ("conf", "kin") if name in found]
        return max((abs(value) for value, sem in pairs if abs(value) > 2 * sem), default=0.0)

    def search(self) -> dict:
        """Up by factors until it blows up, down until the errors are small, bisection of the blow-up, and a run at each step of 1 %."""
        dt = FIRST
        while dt <= LONGEST and self.largest(dt, LEVELS[-1]) < np.inf:
            dt *= self.factor
        dt = FIRST
        while self.largest(dt, LEVELS[0]) > 0.6 * LEVELS[0] and dt > (SHORTEST if self.largest(dt, LEVELS[0]) < 10 else 1e-4):
            dt /= self.factor
        self._bisect_blow()
        for name in ("conf", "kin"):
            self._refine(name)
        return {"blow": self.blow()}

    def _refine(self, name: str) -> None:
        """Measure well around the step of 1 %: the way up was measured roughly, and an error can come and go.

        Beyond that step as well: one curve goes through all runs, and a rough one just above would bend it.
        """
        for _ in range(2):
            guess = self.level(name, LEVELS[0])
            if guess is None or guess[2]:
                return
            for dt in sorted(dt for dt in self.tried if 0.4 * guess[0] < dt < 1.5 * guess[0]):
                self.measure(dt, LEVELS[0])
            again = self.level(name, LEVELS[0])
            if again is None or again[2]:
                return
            self.measure(again[0], LEVELS[0])

    def _bisect_blow(self) -> None:
        """Halve the interval (of log dt) in which the run blows up, twice."""
        for _ in range(2):
            bad = [dt for dt, found in self.tried.items() if found.get("blown")]
            good = [dt for dt in self.tried if bad and dt < min(bad)]
            if good:
                self.measure((max(good) * min(bad)) ** 0.5, LEVELS[-1])

    def blow(self) -> list:
        """The step that blows up, half a bisection interval as its error."""
        bad = [dt for dt, found in self.tried.items() if found.get("blown")]
        if not bad:
            return [max(self.tried), 0.0, ">"]
        good = [dt for dt in self.tried if dt < min(bad)]
        if not good:
            return [min(bad), 0.0, "<"]
        return [short((max(good) * min(bad)) ** 0.5), short(0.5 * (min(bad) - max(good)), 2), ""]

    def level(self, name: str, bound: float) -> list | None:
        """The step at which an error reaches a bound; None if it has no meaning (there is no repulsion)."""
        rows = sorted(self.tried.items())
        if not any(name in found for _, found in rows):
            return None
        # a run that blew up is off by far; the interpolation must not see more of it than that
        values = [[3.0, 0.0] if found.get("blown") else found.get(name, [0.0, 0.0]) for _, found in rows]
        found = crossing([dt for dt, _ in rows], values, bound, 200)
        for word, sign in (("at_least", ">"), ("at_most", "<")):
            if word in found:
                return [short(found[word]), 0.0, sign]
        return [short(found["dt"]), short(found["sem"], 2), ""]

    def sign(self, name: str) -> int:
        """+1 if the fluid is too hot where the error is first clearly seen, -1 if too cold."""
        clear = [
            found[name] for _, found in sorted(self.tried.items()) if name in found and abs(found[name][0]) > max(0.005, 3 * found[name][1])
        ]
        return int(np.sign(clear[0][0])) if clear else 1


def work(job: dict, scene_of: Callable[[dict, int], dpd.Scene] = scene_of) -> dict:
    """One scheme at one point."""
    dpd.set_threads(1)
    begun = time.perf_counter()
    point = Point(job, scene_of)
    levels = point.search() | {"sign": {name: point.sign(name) for name in ("conf", "kin")}}
    ladder = [[dt, *(None if found.get("blown") else [short(v) for v in found.get(n, [0, 0])] for n in ("conf", "kin"))] for dt, found in sorted(point.tried.items())]  # fmt: skip
    return job | {"levels": levels, "ladder": ladder, "seconds": round(time.perf_counter() - begun, 1)}


def fitted(ladder: list[list], column: int, bound: float, draws: int = 100) -> list | None:
    """The step at which an error first reaches a bound, as [dt, standard error, kind of bound]; None if the error has no meaning.

    All runs together make one curve, c2 dt^2 + c4 dt^4 + c6 dt^6: single errors near the bound are lost in their noise, and the first
    that happens to be large would be taken for the bound.  Errors over a quarter are left out.
    """
    good = [(row[0], *row[column]) for row in ladder if row[column] is not None and row[column][1] > 0]
    use = [point for point in good if abs(point[1]) < 0.25]
    if not use:
        return [short(good[0][0]), 0.0, "<"] if good else None
    dt, value, sem = np.array(use).T
    # a tenth of an error is left to what the curve cannot follow
    sem = np.hypot(np.maximum(sem, 0.003), 0.1 * value)
    powers = 2 * np.arange(1, min(3, len(use)) + 1)
    terms = (dt[:, None] / dt.max()) ** powers
    grid = np.geomspace(dt.min(), dt.max(), 300)

    def first(values: np.ndarray) -> float | None:
        # no coefficient is much larger than 1, so that few points do not make a wild curve
        matrix, right = np.vstack([terms / sem[:, None], np.eye(len(powers))]), np.append(values / sem, np.zeros(len(powers)))
        curve = np.abs((grid[:, None] / dt.max()) ** powers @ np.linalg.lstsq(matrix, right, rcond=None)[0])
        if curve[0] > bound:  # below the shortest step nothing but the order is known
            return float(dt.min() * (bound / curve[0]) ** 0.5)
        over = np.flatnonzero(curve > bound)
        return float(grid[over[0]]) if len(over) else None

    best = first(value)
    above = [row[0] for row in ladder if row[0] > dt.max()]
    if best is None:
        return (
            [short((dt.max() * min(above)) ** 0.5), short(0.5 * (min(above) - dt.max()), 2), ""] if above else [short(dt.max()), 0.0, ">"]
        )
    if best < 0.5 * dt.min():
        return [short(0.5 * dt.min()), 0.0, "<"]
    rng = np.random.default_rng(0)
    spread = np.std([first(rng.normal(value, sem)) or dt.max() for _ in range(draws)])
    return [short(best), short(float(spread), 2), ""]


def tabulate(store: Store, costs: dict[str, float], before: dict) -> dict:
    """The table of the package: all runs of the store at a point together give its steps, the last the blow-up; the rest stays as before."""
    found = {json.dumps({name: p[name] for name in BASE}, sort_keys=True): p for p in copy.deepcopy(before["points"])}
    ladders: dict[str, dict[str, list]] = {}
    loosest = before["loose"]
    for result in sorted(store.results.values(), key=lambda r: -r["loose"]):
        key = json.dumps({name: result["point"][name] for name in BASE}, sort_keys=True)
        entry = found.setdefault(key, result["point"] | {"schemes": {}})
        ladders.setdefault(key, {}).setdefault(result["scheme"], []).extend(result["ladder"])
        entry["schemes"][result["scheme"]] = {name: result["levels"][name] for name in ("blow", "sign")}
    for key, measured in ladders.items():
        for scheme, ladder in measured.items():
            levels, rows = found[key]["schemes"][scheme], sorted(ladder, key=lambda row: row[0])
            # where one run has blown up, another that was luckier says nothing about errors
            shortest = min((row[0] for row in rows if row[1] is None and row[2] is None), default=np.inf)
            rows = [row for row in rows if row[0] <= shortest]
            for column, name in ((1, "conf"), (2, "kin")):
                levels[name] = {f"{100 * b:g}": fitted(rows, column, b) for b in LEVELS}
    for result in store.results.values():
        loosest = max(loosest, result["loose"])
    return {
        "about": "steps at which temperatures are off by 1, 5, 10 %, in units of rc (m/kT)^(1/2): [dt, standard error, kind of bound]; "
        "written by benchmarks/stability.py",
        "date": datetime.date.today().isoformat(),
        "machine": machine(),
        "loose": loosest,
        "base": BASE,
        "dips": DIPS,
        "cost": costs,
        "points": sorted(found.values(), key=lambda p: [p[k] or 0.0 for k in ("cv", "s", "mass", "rho", "gamma", "a")]),
    }


#: Schemes that the atlas does not have, beside one that it has: ratios of the best of three rounds on one core, the mean of both friction's
#: fluids (``benchmarks/atlas.py --only time --methods middle basa bababs bab3``).
ALIKE = {"basa": ("middle", 0.99), "bababs": ("bababo", 1.05), "bab3": ("bababo", 1.29)}


def costs(file: Path) -> dict[str, float]:
    """Time of a step of each scheme beside that of mvv, from the atlas, or from docs/validation.md where there is none yet."""
    usual = {
        "mvv": 1.0,
        "shardlow": 1.33,
        "middle": 1.18,
        "basa": 1.18,
        "aboba": 1.0,
        "bababo": 1.4,
        "bababs": 1.4,
        "bab3": 2.0,
        "native": 20.0,
    }
    atlas = json.loads(file.read_text()) if file.exists() else {"quick": True}
    entries = {} if atlas["quick"] else atlas["fluids"].get("weak", {}).get("methods", {})
    ms = {name: float(np.mean(list(entry["ms"]["1"].values()))) for name, entry in entries.items() if entry["ms"].get("1")}
    ms |= {"native": ms[NATIVE]} if NATIVE in ms else {}
    usual |= {name: short(ms[name] / ms["mvv"], 3) for name in usual if name in ms and "mvv" in ms}
    usual |= {name: short(factor * usual[other], 3) for name, (other, factor) in ALIKE.items()}
    return {name: usual[name] for name in SCHEMES}


def main() -> None:
    """Run what is missing, write table, maps and page."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--coarse", action="store_true", help="fewer points")
    parser.add_argument(
        "--loose", type=float, default=2.0, help="standard errors in units of a quarter of the bound (1: four times the time)"
    )
    parser.add_argument("--beads", type=int, default=600)
    parser.add_argument("--processes", type=int, default=2)
    parser.add_argument("--schemes", nargs="+", choices=SCHEMES, default=SCHEMES)
    parser.add_argument("--only", choices=("runs", "table"))
    parser.add_argument("--noisy", action="store_true", help="only points of the shipped table that are badly known")
    parser.add_argument("--missing", action="store_true", help="only schemes and points that the shipped table lacks")
    parser.add_argument("--limit", type=int, help="no more than this many runs")
    options = parser.parse_args()
    store = Store(ROOT / "out" / "stability" / "results.jsonl")
    # the length of a run is bounded: where the fluid relaxes slowly the error stays larger, and is stated
    length = {"beads": options.beads, "loose": options.loose, "longest": 400.0 / options.loose**2, "settle": 2500}
    grid = points(COARSE if options.coarse else FULL)
    wanted = noisy(shipped_table()) if options.noisy else [(s, p) for p in grid for s in SCHEMES if possible(p, s)]
    if options.missing:
        known = {(s, *(p[name] for name in BASE)) for p in shipped_table().data["points"] for s in p["schemes"]}
        wanted = [(s, p) for s, p in wanted if (s, *(p[name] for name in BASE)) not in known]
    jobs = [{"part": "stability", "scheme": s, "point": p, **length} for s, p in wanted if s in options.schemes]
    if options.only != "table":
        left = [job for job in jobs if job not in store][: options.limit]
        carry_out(left, work, store, options.processes, functools.partial(print, flush=True))
    if options.only != "runs":
        table = tabulate(store, costs(ROOT / "docs" / "atlas.json"), shipped_table().data)
        write(table, ROOT / "openmm_dpd" / "advice" / "stability.json")
        maps.draw(table, ROOT / "docs" / "figures")
        page.update(ROOT / "docs" / "atlas.md", texts=maps.blocks(table))


if __name__ == "__main__":
    main()
