"""Other kinds than DPD at equal error: heat, species, many-body liquids, internal energies; here and in LAMMPS.

For each kind and method, errors at several steps give the step at which all of them are below 1 %; the cost is the time per step there divided
by the step.  LAMMPS runs the decks that ``export_lammps`` writes of the same scenes from the same states, and all frames are measured by the
same functions.

- *heat* (eDPD), *species* (tDPD): fluid of ``examples/decks/in.edpd`` with a heat capacity of 10^4.  Temperatures (concentrations) begin as
  1 + sin(kx)/4; the decay rate of the amplitude is compared with what exchange between these beads and their diffusion make it
  (``docs/measure/heat_steps.py``), the kinetic temperature with the mean of the beads' (with kT).
- *many-body liquid*: slab of Warren's liquid, with LAMMPS's kernel, beside vacuum.  Kinetic temperature (its force has no
  potential, which heats the liquid by 0.7 %), density in the middle and surface tension, relative to runs at a short step, here and in LAMMPS
  together.
- *internal energies*: change of the total energy in 1,000 units of time, and kinetic relative to internal temperature.

Runs what is missing in ``out/equal_error``, then writes docs/kinds.json and the tables of docs/atlas.md.

    python benchmarks/equal_error.py               # an hour on two cores
    python benchmarks/equal_error.py --only time   # the clock: ten minutes on a quiet machine
    python benchmarks/equal_error.py --only page
"""

from __future__ import annotations

import argparse
import datetime
import functools
import json
import os
import subprocess
import sys
import tempfile
import time
import warnings
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from openmm import unit

ROOT = Path(__file__).resolve().parents[1]
sys.path[:0] = [str(Path(__file__).parent), str(ROOT / "docs" / "measure")]

import heat_steps  # noqa: E402
from atlas_parts import errors, page, peer  # noqa: E402
from atlas_parts.scenes import conserving, fluid  # noqa: E402
from atlas_parts.store import Store, carry_out  # noqa: E402
from atlas_parts.summary import machine  # noqa: E402

import openmm_dpd as dpd  # noqa: E402
from openmm_dpd.lammps import export_lammps, read_lammps_dump  # noqa: E402

#: Bound of every error; LAMMPS's skins that are tried; beads and steps that are timed.
BOUND, SKINS, TIMED, STEPS = 0.01, (0.2, 0.45), 10_000, 100


def slab(beads: int, seed: int) -> dpd.Scene:
    """Liquid of density 6 between two free surfaces, as thick as it is wide, and vacuum of 3 beside it."""
    edge = (beads / 6.0) ** (1 / 3)
    x = np.random.default_rng(seed).random((beads, 3)) * edge
    pairs = {("A", "A"): dpd.MDPD(A=-40.0, B=25.0, gamma=18.0, kernel="lucy")}
    return dpd.Scene({"A": 1.0}, ["A"] * beads, x, pairs, 1.0, box=[edge, edge, edge + 3.0])


def energies(beads: int, seed: int) -> dpd.Scene:
    """Beads of heat capacity 60 at one temperature."""
    return conserving(beads, 60.0)


def exchanging(what: str, beads: int, seed: int) -> dpd.Scene:
    """The fluid of heat_steps.py, or a larger one."""
    small = heat_steps.scene(what, seed)
    if beads == small.n_beads:
        return small
    internal = dpd.BeadTemperatures(1.0, heat_steps.CAPACITY) if what == "heat" else dpd.Concentrations(np.ones(beads))
    return fluid(beads, small.pairs, rho=heat_steps.DENSITY, masses={"W": 1.0}, internal=internal)


@dataclass(frozen=True)
class Kind:
    """What is run; ``methods``: {scheme, or "LAMMPS" and the scheme that stands for its fixes: steps}."""

    title: str
    scene: Callable[[int, int], dpd.Scene]
    methods: dict[str, tuple[float, ...]]
    measures: dict[str, str]
    beads: int
    settle: float
    time: float
    sample: float
    seeds: int
    reference: tuple[str, ...] = ()


_FORCE, _SWEEP, _LONG = (0.005, 0.01, 0.02, 0.04), (0.04, 0.08, 0.12), (0.06, 0.1, 0.14, 0.18, 0.22)
_EXCHANGING = {"mvv": _FORCE, "middle": _SWEEP, "bababo": _LONG, "LAMMPS mvv": _FORCE}
_RATES = {"rate": "decay rate", "T_kin": "T_kin"}
KINDS = {
    "heat": Kind("eDPD", functools.partial(exchanging, "heat"), _EXCHANGING, _RATES, 1000, 3.0, 4.0, 0.08, 4),
    "species": Kind("tDPD", functools.partial(exchanging, "species"), _EXCHANGING, _RATES, 1000, 3.0, 4.0, 0.08, 4),
    "many-body": Kind(
        "many-body liquid",
        slab,
        {
            "mvv": (0.005, 0.01, 0.02, 0.03),
            "middle": (0.01, 0.02, 0.03, 0.04),
            "bababo": (0.03, 0.05, 0.07, 0.09),
            "LAMMPS mvv": (0.005, 0.01, 0.02, 0.03),
        },
        {"T_kin": "T_kin", "density": "density", "tension": "surface tension"},
        1500,
        20.0,
        100.0,
        0.2,
        2,
        ("middle 0.01", "mvv 0.005", "LAMMPS mvv 0.005"),
    ),
    "energies": Kind(
        "internal energies",
        energies,
        {
            "mvv": (0.0025, 0.005),
            "shardlow": (0.01, 0.02, 0.03, 0.04, 0.05),
            "middle": (0.015, 0.03, 0.045),
            "bababo": (0.03, 0.06, 0.08, 0.1),
            "LAMMPS mvv": (0.0025, 0.005),
            "LAMMPS shardlow": (0.01, 0.02, 0.03, 0.04, 0.05),
        },
        {"drift": "energy in 1,000 units", "T_kin": "T_kin"},
        500,
        20.0,
        400.0,
        0.5,
        2,
    ),
}  # fmt: skip


def positions(context) -> np.ndarray:
    """(N, 3), nm."""
    return context.getState(positions=True).getPositions(asNumpy=True).value_in_unit(unit.nanometer)


def start(name: str, beads: int, seed: int) -> dpd.Scene:
    """The scene of a run in equilibrium, with the profile whose decay is measured.  Its noise is that of another seed than the run's: the same
    noise again takes beads back part of their way."""
    kind = KINDS[name]
    scene = kind.scene(beads, seed)
    built = dpd.build(scene, dt=0.01, scheme="middle", platform="CPU", seed=seed + 1000)
    simulation = built.simulation(properties={"Threads": "1"})
    simulation.step(round(kind.settle / 0.01))
    x = positions(simulation.context)
    v = simulation.context.getState(velocities=True).getVelocities(asNumpy=True).value_in_unit(unit.nanometer / unit.picosecond)
    wave = 1.0 + heat_steps.AMPLITUDE * np.sin(heat_steps.WAVE * x[:, 0])
    internal = scene.internal
    if name == "heat":
        internal = dpd.BeadTemperatures(wave, heat_steps.CAPACITY)
    elif name == "species":
        internal = dpd.Concentrations(wave)
    elif name == "energies":
        fields = dpd.read_fields(simulation.context, built.plan)
        internal = dpd.InternalEnergy(internal.eos, fields["theta"], fields["u_cond"])
    return replace(scene, positions=x, velocities=v, internal=internal)


class Series:
    """Frames of one run, whoever made them; what they say about each kind."""

    def __init__(self, name: str, first: dpd.Scene):
        self.name, self.rows = name, list[tuple]()
        self._edges, self._first, self._x = np.diag(first.box), first.positions, first.positions
        if name in ("heat", "species"):
            self.add(0.0, first.positions, 1.0, wave=1.0 + heat_steps.AMPLITUDE * np.sin(heat_steps.WAVE * first.positions[:, 0]))

    def add(self, now: float, x: np.ndarray, kT: float, *, wave=None, total: float = 0.0, theta: float = 1.0, pressures=None) -> None:
        """Take one: positions, kinetic temperature, values of the beads; energy, internal temperature and pressure tensor."""
        more: tuple = ()
        if wave is not None:
            self._x = x + self._edges * np.rint((self._x - x) / self._edges)
            slow = heat_steps.by_exchange(x) if len(self.rows) % 10 == 0 else np.nan
            more = 2 * np.mean((wave - wave.mean()) * np.sin(heat_steps.WAVE * x[:, 0])), slow, np.mean((self._x - self._first) ** 2)
            theta = wave.mean() if self.name == "heat" else 1.0
        elif pressures is not None:
            z = x[:, 2] / self._edges[2]
            middle = np.angle(np.mean(np.exp(2j * np.pi * z))) / (2 * np.pi)
            apart = self._edges[2] * np.abs(z - middle - np.rint(z - middle))
            depth = 0.3 * self._edges[0]
            tension = 0.5 * self._edges[2] * (pressures[2] - 0.5 * (pressures[0] + pressures[1]))
            more = np.mean(apart < depth) * len(x) / (2 * depth * self._edges[0] * self._edges[1]), tension
        self.rows.append((now, kT / theta - 1.0, total, *more))

    def report(self) -> dict[str, float]:
        """One number for each measure."""
        now, kT, total, *more = np.array(self.rows).T
        if self.name in ("heat", "species"):
            amplitude, slow, moved = more
            rate = -np.polyfit(now, np.log(amplitude), 1)[0]
            expected = np.nanmean(slow) + heat_steps.WAVE**2 * moved[-1] / (2 * now[-1])
            return {"rate": rate / expected - 1.0, "T_kin": float(np.mean(kT[1:]))}
        if self.name == "many-body":
            return {"T_kin": float(np.mean(kT)), "density": float(np.mean(more[0])), "tension": float(np.mean(more[1]))}
        return {"T_kin": float(np.mean(kT)), "drift": 1000.0 * float(np.polyfit(now, total, 1)[0] / total[0])}


def taken(series: Series, name: str, now: float, simulation, observer: dpd.Observer, stress, plan, values=None) -> None:
    """Add what a Context holds to a series, with ``values`` of the beads that it does not hold."""
    sample, context = observer.sample(simulation.context), simulation.context
    fields = values or dpd.read_fields(context, plan)
    if name in ("heat", "species"):
        series.add(now, positions(context), sample.kT, wave=np.ravel(fields["theta" if name == "heat" else "concentrations"]))
    elif name == "many-body":
        stress.report(simulation, None)
        series.add(now, positions(context), sample.kT, pressures=stress.pressures[-1])
    else:
        inside = np.sum(fields["u_cond"] + fields["u_mech"])
        series.add(
            now,
            positions(context),
            sample.kT,
            total=sample.potential + sample.kinetic_on_step + inside,
            theta=1 / np.mean(1 / fields["theta"]),
        )


def frames_of_lammps(
    scene: dpd.Scene, scheme: str, job: dict, every: int, steps: int
) -> Iterator[tuple[float, np.ndarray, np.ndarray, dict]]:
    """Time, positions, velocities and fields of the frames of a run in LAMMPS."""
    with tempfile.TemporaryDirectory() as folder:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            made = export_lammps(scene, folder, "run", dt=job["dt"], steps=steps, scheme=scheme, seed=job["seed"], every=every)
        command = [str(peer.executable()), "-in", made.deck.name, "-log", "none"]
        done = subprocess.run(command, cwd=folder, capture_output=True, text=True, env=peer.environment())
        if done.returncode:
            raise RuntimeError((done.stdout + done.stderr).strip().splitlines()[-1][:200])
        frames = read_lammps_dump(made.dump, scene)
        for k in range(1, len(frames)):
            its = {name: values[k] for name, values in frames.fields.items()}
            its |= {"theta": its["temperature"]} if "temperature" in its else {"concentrations": its["c1"]} if "c1" in its else {}
            yield job["dt"] * (frames.steps[k] - frames.steps[0]), frames.positions[k], frames.velocities[k], its


def run(job: dict) -> dict:
    """Carry out a job: ``kind``, ``method``, ``dt``, ``seed``, ``time``, ``beads``."""
    dpd.set_threads(1)
    name, kind, dt = job["kind"], KINDS[job["kind"]], job["dt"]
    begun, lammps = time.perf_counter(), job["method"].startswith("LAMMPS ")
    scheme = job["method"].removeprefix("LAMMPS ")
    scene = start(name, job["beads"], job["seed"])
    every = max(1, round(kind.sample / dt))
    steps = round(job["time"] / dt / every) * every
    built = dpd.build(scene, dt=dt, scheme="mvv" if lammps else scheme, platform="CPU", seed=job["seed"])
    simulation, series = built.simulation(properties={"Threads": "1"}), Series(name, scene)
    tools = simulation, dpd.Observer(built), dpd.measure.StressReporter(1, built) if name == "many-body" else None, built.plan
    try:
        if lammps:
            for now, x, v, fields in frames_of_lammps(scene, scheme, job, every, steps):
                simulation.context.setPositions(x)
                simulation.context.setVelocities(v)
                taken(series, name, now, *tools, fields)
        else:
            for k in range(steps // every):
                simulation.step(every)
                taken(series, name, (k + 1) * every * dt, *tools)
        found = {"averages": series.report()}
    except Exception as error:  # a run that breaks down is a result
        found = {"failed": str(error).splitlines()[0][:200]}
    return job | found | {"seconds": round(time.perf_counter() - begun, 1)}


def jobs(scale: float) -> list[dict]:
    """All runs."""
    return [
        {"kind": name, "method": method, "dt": dt, "seed": seed, "time": kind.time * scale, "beads": kind.beads}
        for name, kind in KINDS.items()
        for method, steps in kind.methods.items()
        for dt in steps
        for seed in range(1, kind.seeds + 1)
    ]


def clock(name: str, method: str, dt: float, threads: int) -> float:
    """ms per step, in a process of its own."""
    environment = peer.environment() | {"OMP_NUM_THREADS": str(threads), "NUMBA_NUM_THREADS": str(threads)}
    command = [sys.executable, __file__, "--clock", json.dumps([name, method, dt, threads])]
    return float(subprocess.run(command, capture_output=True, text=True, env=environment, check=True).stdout.split()[-1])


def timed(name: str, method: str, dt: float, threads: int) -> float:
    """ms per step in this process (LAMMPS: in its own, with the better one of two skins)."""
    if hasattr(os, "sched_setaffinity"):
        os.sched_setaffinity(0, sorted(os.sched_getaffinity(0))[:threads])
    dpd.set_threads(threads)
    scene = KINDS[name].scene(TIMED, 1)
    built = dpd.build(scene, dt=0.004, scheme="mvv", platform="CPU", seed=1)
    simulation = built.simulation(properties={"Threads": str(threads)})
    simulation.step(150)
    scene = replace(scene, positions=positions(simulation.context))
    scheme = method.removeprefix("LAMMPS ")
    if scheme == method:
        simulation = dpd.build(scene, dt=dt, scheme=scheme, platform="CPU", seed=1).simulation(properties={"Threads": str(threads)})
        simulation.step(STEPS // 2)
        begun = time.perf_counter()
        simulation.step(STEPS)
        return (time.perf_counter() - begun) / STEPS * 1e3
    with tempfile.TemporaryDirectory() as folder, warnings.catch_warnings():
        warnings.simplefilter("ignore")
        made = export_lammps(scene, folder, "run", dt=dt, steps=STEPS, scheme=scheme, seed=1)
        text = [line for line in made.deck.read_text().splitlines() if not line.startswith(("dump", "thermo", "write_data"))]
        skinned = [[f"neighbor {skin} bin" if line.startswith("neighbor") else line for line in text] for skin in SKINS]
        warm = [f"run {STEPS // 2}"]
        decks = [[*lines[: lines.index(f"run {STEPS}")], "thermo 1000000", *warm, f"run {STEPS}"] for lines in skinned]
        return min(peer.timed(lines, Path(folder), Path(folder), STEPS, threads) for lines in decks)


def tabulate(store: Store, scale: float, before: dict) -> dict:
    """Errors, steps and costs of all kinds; of those without stored runs the ones from before."""
    found: dict = {"date": f"{datetime.date.today()}", "machine": machine(), "ms": before.get("ms", {}), "kinds": {}}
    for name, kind in KINDS.items():
        runs: dict[tuple[str, float], dict[str, list[float]]] = {}
        for job in jobs(scale):
            result = store.get(job)
            if result is not None and job["kind"] == name:
                its = runs.setdefault((job["method"], job["dt"]), {})
                for measure in kind.measures:
                    its.setdefault(measure, []).append(result.get("averages", {}).get(measure, np.nan))
        if not runs and name in before.get("kinds", {}):
            found["kinds"][name] = before["kinds"][name]
            continue
        # few runs at each step say little about their spread: that of all steps at which none stopped is taken
        spread = {m: np.mean([v for v in (np.var(its[m], ddof=1) for its in runs.values()) if np.isfinite(v)]) for m in kind.measures}
        means = {place: {m: (np.mean(v), (spread[m] / len(v)) ** 0.5) for m, v in its.items()} for place, its in runs.items()}
        for measure in kind.measures if kind.reference else ():
            both = [means[method, float(dt)][measure] for method, dt in (text.rsplit(" ", 1) for text in kind.reference)]
            limit = np.mean([mean for mean, _ in both]) + (measure == "T_kin")  # which is a deviation from 1
            for its in means.values():
                its[measure] = (its[measure][0] + (measure == "T_kin")) / limit - 1.0, its[measure][1] / limit
        found["kinds"][name] = {
            method: {
                "errors": {str(dt): {m: [float(f"{v:.3g}") for v in pair] for m, pair in means[method, dt].items()} for dt in steps if (method, dt) in means},
                "limits": {m: limit_of(means, method, steps, m) for m in kind.measures},
            }
            for method, steps in kind.methods.items()
        }  # fmt: skip
    return found


def limit_of(means: dict, method: str, steps: tuple[float, ...], measure: str) -> dict:
    """The step at which an error reaches the bound; one that breaks down is too long."""
    pairs = [(dt, means[method, dt][measure]) for dt in steps if (method, dt) in means]
    values = [[1.0, 0.0] if np.isnan(pair[0]) else list(pair) for _, pair in pairs]
    return errors.crossing([dt for dt, _ in pairs], values, BOUND)


def longest(limits: dict) -> tuple[float, str]:
    """The step that all measures allow, with < or > where it was not reached."""
    steps = [
        (one.get("dt") or one.get("at_least") or one["at_most"], "> " if "at_least" in one else "< " if "at_most" in one else "")
        for one in limits.values()
    ]
    return min(steps)


def blocks(table: dict) -> dict[str, str]:
    """The tables of docs/atlas.md."""
    texts = {"kinds-machine": f"{table['date']}, {table['machine']['processor']}, LAMMPS {table['machine']['lammps']}."}
    gains = []
    for name, methods in table["kinds"].items():
        kind, rows, costs = KINDS[name], [], {}
        for method, entry in methods.items():
            cells = []
            for limit in entry["limits"].values():
                sign = "> " if "at_least" in limit else "< " if "at_most" in limit else ""
                dt = limit.get("dt") or limit.get("at_least") or limit["at_most"]
                cells.append(f"{sign}{dt:.3g}" + (f" ± {limit['sem']:.1g}" if "sem" in limit else ""))
            dt, sign = longest(entry["limits"])
            for threads in (1, 2):
                ms = table["ms"].get(f"{name} {method} {threads}")
                costs[method, threads] = np.nan if ms is None else ms / dt
                cells.append("-" if ms is None else f"{ms:.2f}")
            rows.append([f"`{method}`" if not method.startswith("LAMMPS") else method, *cells])
        heads = [f"dt, {text}" for text in kind.measures.values()]
        texts[f"kinds-{name}"] = page.table([kind.title, *heads, "ms per step, 1 core", "2 cores"], rows)
        best = []
        for threads in (1, 2):
            ours, theirs = (
                min((cost, m) for m, cost in ((m, costs[m, threads]) for m in methods if m.startswith("LAMMPS") == peers))
                for peers in (False, True)
            )
            best.append((theirs[0] / ours[0], ours[1], theirs[1]))
        signs = [longest(methods[m]["limits"]) for m in best[0][1:]]
        if not all(np.isfinite(gain) for gain, _, _ in best):
            continue
        gains.append(
            [
                kind.title,
                *(f"{gain:.1f}" for gain, _, _ in best),
                f"`{best[0][1]}` at {signs[0][1]}{signs[0][0]:.3g}",
                f"{best[0][2]} at {signs[1][1]}{signs[1][0]:.3g}",
            ]
        )
    texts["kinds-gains"] = page.table(["kind", "speed-up, 1 core", "2 cores", "here", "LAMMPS"], gains)
    return texts


def main() -> None:
    """Run what is missing, write table and page."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--only", choices=("accuracy", "time", "page"))
    parser.add_argument("--kinds", nargs="+", choices=KINDS, default=list(KINDS))
    parser.add_argument("--time-scale", type=float, default=1.0, help="length of the runs, in times of the usual")
    parser.add_argument("--processes", type=int, default=2)
    parser.add_argument("--clock", help=argparse.SUPPRESS)
    options = parser.parse_args()
    if options.clock:
        print(timed(*json.loads(options.clock)))
        return
    file, store = ROOT / "docs" / "kinds.json", Store(ROOT / "out" / "equal_error" / "results.jsonl")
    say = functools.partial(print, flush=True)
    if options.only in (None, "accuracy"):
        carry_out([job for job in jobs(options.time_scale) if job["kind"] in options.kinds], run, store, options.processes, say)
    table = tabulate(store, options.time_scale, json.loads(file.read_text()) if file.exists() else {})
    if options.only in (None, "time"):
        for _ in range(2):
            for name in options.kinds:
                for method, entry in table["kinds"][name].items():
                    for threads in (1, 2):
                        ms, key = clock(name, method, longest(entry["limits"])[0], threads), f"{name} {method} {threads}"
                        table["ms"][key] = min(table["ms"].get(key, np.inf) if _ else np.inf, float(f"{ms:.4g}"))
                        say(f"{key}: {ms:.2f} ms")
    if options.only != "accuracy":
        file.write_text(json.dumps(table, indent=1) + "\n")
        page.update(ROOT / "docs" / "atlas.md", texts=blocks(table))


if __name__ == "__main__":
    main()
