"""Diffusion and viscosity of the standard fluid over friction, scheme and step: what ``recommend(..., quantity=...)`` knows about dynamics.

Each run drives a fluid of density 3 and repulsion 25 (a few: others) by a force f sin(2 pi z/L) along x: viscosity from the amplitude of the flow, diffusion
from the displacements across it (docs/measure/transport_table.py).  Runs what is missing in ``out/transport``, then writes
openmm_dpd/advice/transport.json and the table of docs/atlas.md; it can be interrupted at any time.

    python benchmarks/transport.py                     # an hour of one core
    python benchmarks/transport.py --time 1500         # a quarter of it; errors twice as large
    python benchmarks/transport.py --only table        # only the file, from the runs that are there
    python benchmarks/transport.py --others            # other repulsions and densities: ten minutes
    python benchmarks/transport.py --check             # the steps that are recommended for diffusion, with 3,000 beads and other seeds: half an hour
    python benchmarks/transport.py --words 'LAMMPS dpd + nve' --friction 4.5  # a method of LAMMPS, run by LAMMPS
    python benchmarks/transport.py --words 'B A/2 S/2 S/2 A/2' --friction 40.5 --only runs  # others beside them
"""

from __future__ import annotations

import argparse
import dataclasses
import datetime
import functools
import json
import operator
import sys
import time
from pathlib import Path

import numpy as np

ROOT = Path(__file__).resolve().parents[1]
sys.path[:0] = [str(Path(__file__).parent), str(ROOT / "docs" / "measure")]

import transport_table  # noqa: E402
from atlas_parts import headline, page, peer  # noqa: E402
from atlas_parts.errors import pooled  # noqa: E402
from atlas_parts.fluids import FLUIDS, method_of  # noqa: E402
from atlas_parts.store import Store, carry_out  # noqa: E402
from atlas_parts.summary import machine, write  # noqa: E402

import openmm_dpd as dpd  # noqa: E402
from openmm_dpd.base.errors import DPDError  # noqa: E402

FILE = ROOT / "openmm_dpd" / "advice" / "transport.json"

#: Steps are these parts of the time between samples.
FAST, LONG, LONGER, OWN = (15, 10, 8, 6), (10, 6, 5, 4), (6, 4, 3), (6, 5, 4)
STEPS = {"middle": FAST, "basa": (*FAST, 5, 4), "bababo": LONG, "bababs": LONG, "bab3": LONGER}
#: Schemes here that do what LAMMPS does (dpd with nve or mvv/dpd, dpd/fdt with shardlow), the weight of the prediction, and steps.
PEERS = {"mvv": 0.5, "mvv, lambda 0.65": 0.65, "shardlow": 0.5}
LAMMPS = ("LAMMPS dpd + nve", "LAMMPS dpd + mvv/dpd, lambda 0.65", "LAMMPS dpd/fdt + shardlow")
PEER_STEPS = {
    4.5: dict.fromkeys((*PEERS, *LAMMPS), (50, 25, 15, 10)),
    40.5: {name: (50, 25, 15, 10) if "shardlow" in name else (100, 50, 25) for name in (*PEERS, *LAMMPS)},
}
#: Half the friction twice, in the place of once.
HALVES = "B A/2 S/2 S/2 A/2"
SHOWN = (*STEPS, *PEERS, *LAMMPS, HALVES)
#: And others, where errors of 1 % are at shorter ones.
STRONG = {
    1.5: {"middle": (15, 8), "basa": (15, 8), "bababo": (8, 5), "bababs": (8, 5), "bab3": (5, 3)},
    135.0: {
        "middle": (30, *FAST),
        "basa": (50, 30, 20, *FAST),
        "bababo": (30, 20, *LONG),
        "bababs": (20, *LONG),
        "bab3": (30, 20, *LONGER),
        HALVES: (20, 10),
    },
    450.0: {"middle": (100, 60, 30), "basa": (100, 60, 30), "bababo": (60, 30, 20), "bababs": (60, 30, 20), "bab3": (60, 30, 20)},
}
#: Frictions, with the finest steps of each that are the limit of short ones for all schemes.
FRICTIONS = {1.5: 25, 4.5: 25, 40.5: 40, 135.0: 100, 450.0: 333}
#: Drag (the gamma that gives it at density 3), repulsion and density of other fluids, their finest step, and steps of schemes: whether steps
#: go with (75/(A density))^(1/2), as recommend() has it.
OTHERS = (
    (4.5, 60.0, 3.0, 25, {"bababs": (8,)}),
    (40.5, 60.0, 3.0, 40, {"bababs": (8,)}),
    (13.5, 25.0, 6.0, 30, {"bababs": (7,)}),
)
#: Scheme whose run at the finest step is the limit.
LIMIT = "basa"
#: Seeds of the check.
SEEDS = (3, 4, 5)
#: Beads, and the speed of the flow: fast enough to be seen, slow enough for the viscosity at rest within what differences need.
BEADS, SPEED = 1000, 0.5


def jobs(length: float, frictions: list[float], words: list[str]) -> list[dict]:
    """All runs as plain data, the limits first."""
    found = []
    for gamma in frictions:
        finest = transport_table.EVERY / FRICTIONS[gamma]
        found += [] if words else [{"gamma": gamma, "scheme": LIMIT, "dt": finest, "time": length, "seed": 1}]
        known = STRONG.get(gamma) or STEPS | PEER_STEPS[gamma]
        for scheme in words or known:
            steps = [transport_table.EVERY / n for n in known.get(scheme, OWN)]
            found += [{"gamma": gamma, "scheme": scheme, "dt": dt, "time": length, "seed": 2} for dt in steps]
    return found


def work(job: dict) -> dict:
    """One run."""
    dpd.set_threads(1)
    begun = time.perf_counter()
    point = {**transport_table.BASE, "drag": job["gamma"]} | {name: job[name] for name in ("A", "density") if name in job}
    scheme, lam = job["scheme"].partition(",")[0], PEERS.get(job["scheme"], 0.5)
    try:
        if job["scheme"] in LAMMPS:
            found = lammps(job, point)
        else:
            found = transport_table.measure(point, job["time"], job["seed"], job.get("beads", BEADS), job["dt"], scheme, SPEED, lam)
        report = {name: round(found[name], 5) for name in ("D", "D_error", "eta", "eta_error")}
    except DPDError as error:
        report = {"failed": str(error).splitlines()[0][:200]}
    return job | report | {"seconds": round(time.perf_counter() - begun, 1)}


def lammps(job: dict, point: dict) -> dict:
    """A run of LAMMPS from random beads that have moved apart; the same force drives it, and the same is measured."""
    simulation, push, edge = transport_table.driven(point, job["seed"], BEADS, 0.01, "middle", SPEED)
    simulation.step(500)
    v = simulation.context.getState(velocities=True).getVelocities(asNumpy=True)._value
    fluid = dataclasses.replace(FLUIDS["weak"], gamma=job["gamma"])
    scene = dataclasses.replace(fluid.scene(BEADS, 1), positions=transport_table.positions(simulation), velocities=v)
    every = round(transport_table.EVERY / job["dt"])
    with peer.instance() as lmp:
        peer.prepare(lmp, fluid, method_of("weak", job["scheme"]), scene, {"kT": 1.0, "seed": job["seed"]})
        lmp.commands_list([f"variable push atom {push!r}*sin({2 * np.pi / edge!r}*z)", "fix push all addforce v_push 0.0 0.0"])
        lmp.commands_list([f"timestep {job['dt']!r}", "run 0 post no"])

        def where() -> np.ndarray:
            x, faces = (np.array(lmp.gather_atoms(name, kind, 3)).reshape(-1, 3) for name, kind in (("x", 1), ("image", 0)))
            return x + edge * faces

        return transport_table.watched(lambda n: lmp.command(f"run {n} pre no post no"), where, job["time"], every, push, edge)


def others(length: float, store: Store, processes: int) -> None:
    """Diffusion and viscosity of fluids with other repulsions and densities, beside their limits of short steps."""
    todo = []
    for gamma, A, density, finest, steps in OTHERS:
        fluid = {"gamma": gamma, "A": A, "density": density, "time": length}
        limit = fluid | {"scheme": LIMIT, "dt": transport_table.EVERY / finest, "seed": 1}
        todo.append((limit, [fluid | {"scheme": s, "dt": transport_table.EVERY / n, "seed": 2} for s, ns in steps.items() for n in ns]))
    carry_out([job for limit, jobs in todo for job in (limit, *jobs)], work, store, processes, functools.partial(print, flush=True))
    rows = []
    for limit, jobs in todo:
        base = store.get(limit)
        for job in jobs:
            row, cells = store.get(job), []
            for name in ("D", "eta"):
                sem = float(np.hypot(row[f"{name}_error"], base[f"{name}_error"])) / base[name]
                cells.append(_per_cent([row[name] / base[name] - 1, sem]))
            rows.append([f"{job['gamma']:g}, {job['A']:g}, {job['density']:g}", f"`{job['scheme']}`", f"{job['dt']:.3g}", *cells])
    text = page.table(["drag, A, density", "scheme", "step", "diffusion", "viscosity"], rows)
    page.update(ROOT / "docs" / "atlas.md", texts={"transport-others": text})


def check(length: float, frictions: list[float], seeds: list[int], store: Store, processes: int) -> None:
    """Diffusion and viscosity at the steps that are recommended for diffusion, beside the limit of short steps: other beads, other seeds."""
    todo: dict[float, tuple[list[dict], ...]] = {}
    for gamma in frictions:
        pairs, x = {("W", "W"): dpd.DPD(A=25.0, gamma=gamma)}, np.random.default_rng(3).random((81, 3)) * 3.0
        choice = dpd.recommend(dpd.Scene({"W": 1.0}, ["W"] * 81, x, pairs, kT=1.0, box=[3.0] * 3), quantity="diffusion")
        assert choice.dt is not None
        parts = {LIMIT: FRICTIONS[gamma]}, {choice.scheme: np.ceil(transport_table.EVERY / choice.dt)}
        todo[gamma] = tuple(
            [
                {"gamma": gamma, "scheme": s, "dt": transport_table.EVERY / n, "time": length, "seed": seed, "beads": 3 * BEADS}
                for s, n in part.items()
                for seed in seeds
            ]
            for part in parts
        )
    carry_out(
        [job for both in todo.values() for jobs in both for job in jobs], work, store, processes, functools.partial(print, flush=True)
    )
    for gamma, both in todo.items():
        limit, found = ([store.get(job) for job in jobs] for jobs in both)
        for name in ("D", "eta"):
            (short, error), (value, sem) = (_together(rows, name) for rows in (limit, found))
            off, sem = value / short - 1, float(np.hypot(sem, error)) / short
            within = "within 1 % and two standard errors" if abs(off) < 0.01 + 2 * sem else "OFF"
            print(f"friction {gamma:g}, {both[1][0]['scheme']} at {both[1][0]['dt']:.3g}: {name} {_per_cent([off, sem])}: {within}")


def _together(rows: list[dict], name: str) -> tuple[float, float]:
    """Mean of several seeds, with the larger of the errors that the runs say and that their spread says."""
    mean, sem = pooled([{name: (row[name], row[f"{name}_error"])} for row in rows], name)
    return mean, max(sem, float(np.std([row[name] for row in rows], ddof=1)) / len(rows) ** 0.5) if len(rows) > 1 else sem


def rows_of(table: dict) -> list[dict]:
    """The runs that a table was made of."""
    rows = []
    for point in table["points"]:
        limit = {"gamma": point["gamma"], "scheme": LIMIT, "seed": 1, "dt": transport_table.EVERY / FRICTIONS[point["gamma"]]}
        rows.append(limit | {key: v for name in ("D", "eta") for key, v in zip((name, f"{name}_error"), point[name], strict=True)})
        for scheme, runs in point["schemes"].items():
            for dt, *pairs in runs:
                row = {"gamma": point["gamma"], "scheme": scheme, "seed": 2, "dt": dt}
                for name, (off, sem) in zip(("D", "eta"), pairs, strict=True):
                    value, error = point[name]
                    row |= {name: value * (1 + off), f"{name}_error": max((value * sem) ** 2 - error**2, 0.0) ** 0.5}
                rows.append(row)
    return rows


def tabulate(results: list[dict], before: dict) -> dict:
    """Relative errors of D and viscosity of every run beside the limit of short steps, with their standard errors; runs of the table before
    stay where there is none of the same step."""
    points, place = [], operator.itemgetter("gamma", "scheme", "seed", "dt")
    known = [row | {"dt": round(row["dt"], 6)} for row in [*rows_of(before), *results]]
    results = list({place(row): row for row in known}.values())
    for gamma in sorted({row["gamma"] for row in results}):
        good = [row for row in results if row["gamma"] == gamma and "failed" not in row]
        finest = [row for row in good if row["seed"] == 1]
        limit = {name: pooled([{name: (row[name], row[f"{name}_error"])} for row in finest], name) for name in ("D", "eta")}
        schemes: dict[str, list] = {}
        for row in sorted((row for row in good if row["seed"] != 1), key=lambda row: row["dt"]):
            errors = [
                [round(row[name] / value - 1, 5), round(float(np.hypot(row[f"{name}_error"], sem)) / value, 5)]
                for name, (value, sem) in limit.items()
            ]
            schemes.setdefault(row["scheme"], []).append([round(row["dt"], 6), *errors])
        points.append({"gamma": gamma} | {name: [round(part, 5) for part in pair] for name, pair in limit.items()} | {"schemes": schemes})
    return {
        "about": "relative errors of diffusion and viscosity beside the limit of short steps: scheme: [dt, [D, sem], [eta, sem]] in units of "
        "rc (m/kT)^(1/2), at density 3 and repulsion 25; written by benchmarks/transport.py",
        "date": datetime.date.today().isoformat(),
        "machine": machine(),
        "points": points,
    }


def blocks(table: dict) -> dict[str, str]:
    """Blocks of the page: errors of all runs, in per cent."""
    m, found = table["machine"], []
    for point in table["points"]:
        for scheme in SHOWN:
            rows = point["schemes"].get(scheme, [])
            found += [[f"{point['gamma']:g}", f"`{scheme}`", f"{dt:.3g}", *(_per_cent(pair) for pair in pairs)] for dt, *pairs in rows]
    limits = ", ".join(
        f"{p['D'][0]:.3g} ± {p['D'][1]:.1g} and {p['eta'][0]:.3g} ± {p['eta'][1]:.1g} at friction {p['gamma']:g}" for p in table["points"]
    )
    text = page.table(["friction", "scheme", "step", "diffusion", "viscosity"], found)
    return {"transport": f"{table['date']}, {m['processor']}. Limits of short steps: {limits}.\n\n{text}"}


def _per_cent(pair: list[float]) -> str:
    return f"{100 * pair[0]:+.1f} ± {100 * pair[1]:.1f} %"


def main() -> None:
    """Run what is missing, write the file."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--time", type=float, default=3000.0, help="length of a run")
    parser.add_argument("--friction", type=float, nargs="+", default=list(FRICTIONS), choices=FRICTIONS)
    parser.add_argument("--words", nargs="+", default=[], help="only these schemes or words")
    parser.add_argument("--processes", type=int, default=2)
    parser.add_argument("--only", choices=("runs", "table"))
    parser.add_argument("--others", action="store_true", help="only the fluids of other repulsions and densities")
    parser.add_argument("--check", action="store_true", help="only whether the recommended steps hold for other beads")
    parser.add_argument("--seeds", type=int, nargs="+", default=list(SEEDS), help="of the check")
    options = parser.parse_args()
    store = Store(ROOT / "out" / "transport" / "results.jsonl")
    if options.others:
        others(options.time, store, options.processes)
        return
    if options.check:
        check(0.5 * options.time, options.friction, options.seeds, store, options.processes)
        return
    if options.only != "table":
        carry_out(jobs(options.time, options.friction, options.words), work, store, options.processes, functools.partial(print, flush=True))
    if options.only != "runs":
        named = [row for row in store.results.values() if row["scheme"] in SHOWN and "beads" not in row and "A" not in row]
        table = tabulate(named, json.loads(FILE.read_text()))
        write(table, FILE)
        page.update(ROOT / "docs" / "atlas.md", texts=blocks(table))
        headline.publish()


if __name__ == "__main__":
    main()
