"""The atlas of speed against accuracy: every scheme here and every peer, error against time step and against wall time.

Runs what is missing in ``out/atlas``, then writes docs/atlas.json, the pictures in docs/figures and the tables of docs/atlas.md.  It can be
interrupted at any time; the same command goes on where it stopped.

    python benchmarks/atlas.py                      # about two hours on 2 cores
    python benchmarks/atlas.py --time-scale 0.5     # one; errors are larger by the root of two
    python benchmarks/atlas.py --quick              # five minutes; files go to out/atlas-quick
    python benchmarks/atlas.py --only accuracy      # the runs that may share the machine with other work
    python benchmarks/atlas.py --only time          # the clock: on a quiet machine
    python benchmarks/atlas.py --only clock         # the same, for the accuracy that stands in docs/atlas.json: half an hour
    python benchmarks/atlas.py --methods basa bab3  # these beside what stands in docs/atlas.json, their times brought to its machine by bababo's
    python benchmarks/atlas.py --only page          # only JSON, pictures and tables, from the runs that are there, else from docs/atlas.json
"""

from __future__ import annotations

import argparse
import functools
import json
import sys
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
sys.path.insert(0, str(Path(__file__).parent))

from atlas_parts import drivers, figures, headline, page, peer, summary, timing  # noqa: E402
from atlas_parts.fluids import FLUIDS, available, methods  # noqa: E402
from atlas_parts.store import Store, carry_out  # noqa: E402

#: Beads, time that is measured, time before it, time of equilibration, and of the clock: beads, steps, rounds.
FULL = {"beads": 1500, "time": 300.0, "discard": 20.0, "equilibrate": 20.0, "clock": (10125, 100, 3)}
QUICK = {"beads": 500, "time": 10.0, "discard": 2.0, "equilibrate": 5.0, "clock": (2000, 30, 1)}

#: Where energy is conserved: further seeds at the steps at which the drift is near its bound.
SEEDS, NEAR = range(2, 6), (0.04, 0.25)

#: More where what is asked for hangs on it: {method: (seeds, steps)}.  From 0.02 or so on it is chance whether Shardlow's splitting stops.
MORE = {
    "LAMMPS dpd/fdt/energy + shardlow": (SEEDS, (0.02, 0.025, 0.03)),
    "shardlow": (SEEDS, (0.02, 0.025, 0.03)),
    "bababo": (range(6, 11), (0.1, 0.15, 0.2)),
}

#: Step, scheme and length (in times of the others) of the reference runs.
REFERENCE = {"dt": 0.01, "methods": ("aboba", "middle"), "longer": 2.0}


def say(text: str) -> None:
    print(text, flush=True)


def job(fluid, method, dt: float, settings: dict, part: str = "accuracy", kT: float = 1.0, longer: float = 1.0, seed: int = 1) -> dict:
    """One run as plain data."""
    length = settings["time"] * fluid.share * longer / (4 if method.slow else 1)
    discard, settle = settings["discard"], settings["equilibrate"]
    if fluid.conserves:
        # ps; a run of at most 30,000 steps, which at the shortest steps is what an hour allows
        length, discard = min(length, 30000 * dt * settings["time"] / FULL["time"]), min(discard, 3000 * dt)
        settle *= 3
    return {
        "part": part, "fluid": fluid.name, "method": method.name, "dt": dt, "time": length, "discard": discard, "kT": kT,
        "beads": 0 if fluid.deck else settings["beads"], "equilibrate": settle, "seed": seed,
    }  # fmt: skip


def accuracy_jobs(names: list[str], settings: dict, quick: bool, lammps: bool, wanted: list[str]) -> list[dict]:
    """Reference, calibration and error runs; of the wanted methods, or of all."""
    jobs, seen = [], set()
    for fluid in (FLUIDS[name] for name in names):
        known = {m.name: m for m in methods(fluid.name)}
        if not fluid.conserves:
            for name in REFERENCE["methods"]:
                jobs.append(job(fluid, known[name], REFERENCE["dt"], settings, "reference", longer=REFERENCE["longer"]))
            if fluid.statics not in seen:
                seen.add(fluid.statics)
                jobs += [job(fluid, known["aboba"], 0.02, settings, "calibration", kT, 2.0) for kT in (0.98, 1.02)]
        for method in known.values():
            if wanted and method.name not in wanted:
                continue
            if method.kind != "lammps" or lammps:
                steps = fluid.dts(method, quick)
                jobs += [job(fluid, method, dt, settings) for dt in steps]
                if fluid.conserves and not quick:
                    jobs += [job(fluid, method, dt, settings, seed=s) for s in SEEDS for dt in steps if NEAR[0] < dt < NEAR[1]]
                    seeds, decisive = MORE.get(method.name, ((), ()))
                    jobs += [job(fluid, method, dt, settings, seed=s) for s in seeds for dt in decisive]
    return jobs


def main() -> None:
    """Run what is missing and write everything."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--quick", action="store_true", help="short runs, to see that everything works")
    parser.add_argument("--only", choices=("accuracy", "time", "clock", "page"), help="only this part")
    parser.add_argument("--fluids", nargs="+", choices=FLUIDS, default=list(FLUIDS))
    parser.add_argument("--methods", nargs="+", default=[], help="only these, added to docs/atlas.json")
    parser.add_argument("--processes", type=int, default=2, help="runs at a time, one core each (accuracy only)")
    parser.add_argument("--cores", type=int, nargs="+", default=[1, 2], help="numbers of cores that are timed")
    parser.add_argument("--time-scale", type=float, default=1.0, help="length of the accuracy runs, in times of the usual")
    parser.add_argument("--publish", action="store_true", help="write to docs/ after a quick run too; the page says that it was one")
    options = parser.parse_args()
    settings = dict(QUICK if options.quick else FULL)
    settings["time"] *= options.time_scale
    folder = ROOT / "out" / ("atlas-quick" if options.quick else "atlas")
    store = Store(folder / "results.jsonl")
    names = [name for name in options.fluids if available(FLUIDS[name])]
    lacking = peer.why_missing()
    if lacking:
        say(f"without LAMMPS: {lacking}")
    if options.only in (None, "accuracy"):
        jobs = accuracy_jobs(names, settings, options.quick, lacking is None, options.methods)
        carry_out(jobs, functools.partial(drivers.run, folder=folder), store, options.processes, say)
    if options.only in (None, "time", "clock"):
        beads, steps, rounds = settings["clock"]
        for cores in options.cores:
            todo = [j for j in timing.jobs(names, beads, steps, cores) if lacking is None or not j["method"].startswith("LAMMPS")]
            timed = [j for j in todo if not options.methods or j["method"] in (*summary.YARDSTICKS.values(), *options.methods)]
            timing.chain(timed, rounds, folder, store, say)
    if options.only == "clock" or (options.only == "page" and not store.results):
        atlas = summary.retimed(json.loads((ROOT / "docs" / "atlas.json").read_text(encoding="utf-8")), timing.best(store))
    else:
        atlas = summary.atlas(store, settings, quick=options.quick)
        if options.methods:
            before = json.loads((ROOT / "docs" / "atlas.json").read_text(encoding="utf-8"))
            atlas = summary.extended(before, atlas, timing.best(store), options.methods)
    publish = options.publish or not options.quick
    target = ROOT / "docs" if publish else folder
    summary.write(atlas, target / "atlas.json")
    figures.draw(atlas, target / "figures")
    say(page.summary_text(atlas))
    if publish:
        page.update(ROOT / "docs" / "atlas.md", atlas)
        headline.publish()


if __name__ == "__main__":
    main()
