"""All runs of a store as one small object: errors, limits, times, and the ratios that were aimed at."""

from __future__ import annotations

import datetime
import importlib.metadata
import json
import os
import platform
import re
from pathlib import Path

import numpy as np

from . import timing
from .errors import crossing, errors, heat_capacity, pooled, reference
from .fluids import FLUIDS, methods
from .store import Store

#: What is compared where no energy is conserved.
EVERY = ("T_conf", "U", "T_kin", "P", "g", "D")
#: Error at which methods are compared, and the drift per ps that is accepted where energy is conserved.
BOUND, DRIFT = 0.01, 1e-7

#: What was aimed at: fluid, peer, {cores: times less wall time}.
TARGETS = (
    ("weak", "LAMMPS dpd + nve", {1: 2.0, 2: 1.6}),
    ("weak", "LAMMPS dpd/fdt + shardlow", {1: 3.5, 2: 3.5}),
    ("weak", "OpenMM DPDIntegrator, CPU", {1: 15.0, 2: 15.0}),
    ("strong", "LAMMPS dpd + nve", {1: 2.5, 2: 2.5}),
    ("energy", "LAMMPS dpd/fdt/energy + shardlow", {1: 3.0, 2: 3.0}),
)


def machine() -> dict:
    """Processor, cores and versions."""
    found = {"processor": platform.processor() or platform.machine(), "cores": os.cpu_count(), "python": platform.python_version()}
    info = Path("/proc/cpuinfo")
    names = re.findall(r"^model name\s*:\s*(.+)$", info.read_text(), re.M) if info.exists() else []
    if names:
        found["processor"] = names[0]
    for package in ("openmm-dpd", "openmm", "numba", "numpy", "lammps"):
        try:
            found[package] = importlib.metadata.version(package)
        except importlib.metadata.PackageNotFoundError:
            found[package] = None
    return found


def atlas(store: Store, settings: dict, quick: bool = False) -> dict:
    """The whole object, from what is in the store."""
    runs = [r for r in store.results.values() if r.get("part") in ("accuracy", "reference", "calibration")]
    times = timing.best(store)
    fluids = {}
    for name in FLUIDS:
        mine = [r for r in runs if r["fluid"] == name and r["part"] == "accuracy"]
        if mine:
            fluids[name] = _fluid(name, mine, runs, times)
    return {
        "date": datetime.date.today().isoformat(),
        "quick": quick,
        "machine": machine(),
        "settings": settings | {"bound": BOUND, "drift": DRIFT},
        "fluids": fluids,
        "targets": [t for fluid, peer, aims in TARGETS if fluid in fluids for t in _targets(fluids[fluid], fluid, peer, aims)],
    }


def _fluid(name: str, mine: list[dict], runs: list[dict], times: dict) -> dict:
    """One fluid: reference, calibration, and what each method does."""
    fluid = FLUIDS[name]
    same = [f.name for f in FLUIDS.values() if f.statics == fluid.statics]
    ref = reference([r for r in runs if r["part"] == "reference" and r["fluid"] in same])
    own = reference([r for r in runs if r["part"] == "reference" and r["fluid"] == name])
    ref["D"] = own.get("D")
    calibration = sorted(
        (r for r in runs if r["part"] == "calibration" and r["fluid"] in same and "failed" not in r), key=lambda r: r["kT"]
    )
    capacity = heat_capacity(calibration[0], calibration[-1]) if len(calibration) > 1 else None
    ref = {key: value for key, value in ref.items() if value is not None}
    found = {}
    for method in methods(name):
        rows = merged([r for r in mine if r["method"] == method.name])
        if not rows:
            continue
        table = [_row(r, errors(r, ref, capacity, fluid.conserves)) for r in rows]
        entry = {"kind": method.kind, "runs": table, "limits": _limits(table, fluid.conserves), "ms": {}, "wall": {}}
        for (f, m, threads, dt), ms in sorted(times.items()):
            if (f, m) == (name, method.name):
                entry["ms"].setdefault(str(threads), {})[f"{dt:g}"] = short(ms)
        for threads in sorted(entry["ms"]):
            entry["wall"][threads] = {
                measure: _wall(limit, times, name, method.name, int(threads)) for measure, limit in entry["limits"].items() if limit
            }
        found[method.name] = entry
    shown = {key: [short(v) for v in ref[key]] for key in ("U", "P", "D") if key in ref}
    return {"title": fluid.title, "reference": shown, "dU_dkT": [short(v) for v in capacity] if capacity else None, "methods": found}


def retimed(before: dict, times: dict) -> dict:
    """The object of an earlier run with new times: trajectories, and so errors, are what they were."""
    timed = {(name, method, threads) for name, method, threads, _ in times}
    kept = {
        (name, method, int(threads), float(dt)): ms
        for name, fluid in before["fluids"].items()
        for method, entry in fluid["methods"].items()
        for threads, row in entry["ms"].items()
        for dt, ms in row.items()
        if (name, method, int(threads)) not in timed
    }
    times, fluids = kept | times, {}
    for name, fluid in before["fluids"].items():
        entries = {}
        for method, entry in fluid["methods"].items():
            limits, ms = _limits(entry["runs"], FLUIDS[name].conserves), dict[str, dict]()
            for (f, m, threads, dt), found in sorted(times.items()):
                if (f, m) == (name, method):
                    ms.setdefault(str(threads), {})[f"{dt:g}"] = short(found)
            walls = {
                threads: {measure: _wall(limit, times, name, method, int(threads)) for measure, limit in limits.items() if limit}
                for threads in ms
            }
            entries[method] = entry | {"limits": limits, "ms": ms, "wall": walls}
        fluids[name] = fluid | {"methods": entries}
    return (
        before
        | ({"date": datetime.date.today().isoformat(), "machine": machine()} if timed else {})
        | {
            "fluids": fluids,
            "targets": [t for fluid, peer, aims in TARGETS if fluid in fluids for t in _targets(fluids[fluid], fluid, peer, aims)],
        }
    )


#: The methods whose times bring those of two machines together, by the kind of what was added.
YARDSTICKS = {"ours": "bababo", "lammps": "LAMMPS dpd + nve"}


def extended(before: dict, fresh: dict, times: dict, names: list[str]) -> dict:
    """The object of an earlier run with methods of a later one; their times are brought to the earlier one's machine by those of a yardstick."""
    fluids = {}
    for name, fluid in before["fluids"].items():
        added = {}
        for method, entry in fresh["fluids"].get(name, {}).get("methods", {}).items():
            if method not in names:
                continue
            ms, yardstick = {}, YARDSTICKS[entry["kind"]]
            for threads, row in entry["ms"].items():
                here = [found for (f, m, t, _), found in times.items() if (f, m, t) == (name, yardstick, int(threads))]
                there = list(fluid["methods"][yardstick]["ms"][threads].values())
                scale = float(np.mean(there) / np.mean(here))
                ms[threads] = {dt: short(scale * value) for dt, value in row.items()}
            added[method] = entry | {"ms": ms}
        known = fluid["methods"] | added
        fluids[name] = fluid | {"methods": {m: known[m] for m in sorted(known, key=lambda m: known[m]["kind"] != "ours")}}
    return retimed(before | {"fluids": fluids}, {})


def merged(runs: list[dict]) -> list[dict]:
    """One result for each step, in order; of runs with several seeds the averages, with the spread of their drifts as its error.

    A step at which one of the runs failed is one that fails.
    """
    found = []
    for dt in sorted({r["dt"] for r in runs}):
        same = [r for r in runs if r["dt"] == dt]
        failed = [r for r in same if "failed" in r]
        one = failed[0] if failed else same[0]
        if len(same) > 1 and failed:
            one = one | {"failed": f"{len(failed)} of {len(same)} runs: {one['failed']}"}
        elif len(same) > 1:
            one = one | {
                name: list(pooled(same, name) or one[name]) for name in ("T_kin", "T_conf", "theta", "U", "P", "D") if one.get(name)
            }
            drifts = np.array([r["drift"][0] for r in same])
            one["drift"] = [float(drifts.mean()), float(drifts.std(ddof=1) / len(drifts) ** 0.5)]
        found.append(one)
    return found


def _row(result: dict, found: dict) -> dict:
    values = {name: [short(v) for v in result[name]] for name in ("T_kin", "T_conf", "theta", "U", "P", "D") if result.get(name)}
    row = {"dt": result["dt"], "values": values, "errors": {name: [short(v) for v in pair] for name, pair in found.items()}}
    return row | ({"failed": result["failed"]} if "failed" in result else {})


def _limits(table: list[dict], conserves: bool) -> dict:
    """Step at the bound, by each measure; a run that failed counts as entirely wrong."""
    if conserves:
        found = {"drift": _limit(table, lambda e: e.get("drift"), DRIFT), "agree": _limit(table, _disagreement, BOUND)}
        both = [limit for limit in found.values() if limit and "dt" in limit or limit and "at_least" in limit]
        steps = [limit.get("dt", limit.get("at_least")) for limit in both]
        found["both"] = both[int(np.argmin(steps))] if len(both) == 2 else next((v for v in found.values() if v and "at_most" in v), None)
        return found
    return {name: _limit(table, lambda e, name=name: e.get(name), BOUND) for name in EVERY}


def _disagreement(found: dict) -> list[float] | None:
    pairs = [found[name] for name in ("T_conf", "T_kin") if name in found]
    return max(pairs, key=lambda pair: abs(pair[0])) if pairs else None


def _limit(table: list[dict], take, bound: float) -> dict | None:
    dts, values = [], []
    for row in table:
        pair = [10.0, 0.0] if "failed" in row else take(row["errors"])
        if pair is not None:
            dts.append(row["dt"])
            values.append(pair)
    if all("failed" in row or take(row["errors"]) is None for row in table):
        return None
    return {key: short(value) for key, value in crossing(dts, values, bound).items()}


def step_of(limit: dict) -> tuple[float, float, str]:
    """Step, its error, and what kind of bound it is: "", ">=" or "<="."""
    for word, sign in (("at_least", ">="), ("at_most", "<=")):
        if word in limit:
            return limit[word], 0.0, sign
    return limit["dt"], limit["sem"], ""


def _wall(limit: dict, times: dict, fluid: str, method: str, threads: int) -> dict | None:
    """Wall seconds for a unit of simulated time at a limit; a bound on the step is the opposite bound on the time."""
    dt, sem, sign = step_of(limit)
    ms = timing.at_step(times, fluid, method, threads, dt)
    if ms is None:
        return None
    return {"seconds": short(1e-3 * ms / dt), "sem": short(1e-3 * ms / dt * sem / dt), "bound": {">=": "<=", "<=": ">="}.get(sign, "")}


def _targets(fluid: dict, name: str, peer: str, aims: dict[int, float]) -> list[dict]:
    """What was aimed at beside what is reached by the scheme that does best by its worse measure."""
    measures = ("drift", "agree") if FLUIDS[name].conserves else ("T_conf", "U")
    found = []
    for cores, aim in aims.items():
        # a peer that always has one thread was timed on one core only
        other = fluid["methods"].get(peer, {}).get("wall", {})
        other = other.get(str(cores)) or (other.get("1") if "DPDIntegrator" in peer else None)
        if not other or any(not other.get(m) for m in measures):
            continue
        ratios = {}
        for scheme, entry in fluid["methods"].items():
            mine = entry["wall"].get(str(cores))
            if entry["kind"] == "ours" and mine and all(mine.get(m) for m in measures):
                ratios[scheme] = {m: ratio(other[m], mine[m]) for m in measures}
        if ratios:
            best = max(ratios, key=lambda s: min(ratios[s][m]["ratio"] for m in measures))
            reached = all(ratios[best][m]["ratio"] >= aim and ratios[best][m]["bound"] != "<=" for m in measures)
            found.append({"fluid": name, "peer": peer, "cores": cores, "aim": aim, "scheme": best, "reached": reached, "ratios": ratios})
    return found


def ratio(peer: dict, mine: dict) -> dict:
    """How many times less wall time, with its error, and what kind of bound it is."""
    ratio = peer["seconds"] / mine["seconds"]
    relative = float(np.hypot(peer["sem"] / peer["seconds"], mine["sem"] / mine["seconds"]))
    # a peer's lower bound and our upper bound both make the true ratio larger
    larger, smaller = peer["bound"] == ">=" or mine["bound"] == "<=", peer["bound"] == "<=" or mine["bound"] == ">="
    return {
        "ratio": short(ratio),
        "sem": short(ratio * relative),
        "bound": "?" if larger and smaller else ">=" if larger else "<=" if smaller else "",
    }


def short(value: float | None, digits: int = 4) -> float | None:
    """Rounded to a few digits, so that the file stays small."""
    return None if value is None or not np.isfinite(value) else float(f"{value:.{digits}g}")


def write(atlas: dict, file: Path) -> None:
    """JSON with one line per run."""
    file.parent.mkdir(parents=True, exist_ok=True)
    text = json.dumps(atlas, indent=1)
    # lists of numbers and small objects on one line
    text = re.sub(r"\[\s+([^\[\]{}]*?)\s+\]", lambda m: "[" + re.sub(r"\s+", " ", m.group(1)) + "]", text)
    text = re.sub(r"\{\s+([^\[\]{}]*?)\s+\}", lambda m: "{" + re.sub(r"\s+", " ", m.group(1)) + "}", text)
    file.write_text(text + "\n")
