"""Recommended steps, run: is what was asked for right, and would another scheme or a longer step have cost less?

Every scene of atlas_parts/scenes.py takes the scheme and the step that ``recommend`` gives it for an error of 1 %, and runs from equilibrium
until both temperatures are known to 0.25 %.  They are to be within 1.5 % and two standard errors (steps of the table are known to a tenth or
two, and errors go with their square).  With ``--twelve`` the potential energy has to be right as well, beside a run at a quarter of the step
with ``middle``, no run of 100,000 steps may stop, and every scheme that is not thought to cost more than twice as much is tried at the step at
which it would cost 1.3 times less: each should be wrong there by more than what was asked for, or the recommendation is too careful.  Results are kept in ``out/recommended``, so that nothing is run again.

    python benchmarks/recommended_steps.py                  # about ten minutes of one core
    python benchmarks/recommended_steps.py --twelve         # an hour of one core
    python benchmarks/recommended_steps.py --only layers    # scenes with this in their name
    python benchmarks/recommended_steps.py --scheme middle  # the step of this scheme, not of the cheapest
    python benchmarks/recommended_steps.py --random 0:60    # the promise: how many measures of scenes drawn at random are within the error
"""

from __future__ import annotations

import argparse
import sys
from dataclasses import asdict
from pathlib import Path

import numpy as np

ROOT = Path(__file__).resolve().parents[1]
sys.path.insert(0, str(Path(__file__).parent))

from atlas_parts.scenes import SCENES, TWELVE, Averages, averages, drawn  # noqa: E402
from atlas_parts.store import Store  # noqa: E402

import openmm_dpd as dpd  # noqa: E402
from openmm_dpd.model.schemes import SCHEMES  # noqa: E402

#: Deviation that is allowed beside two standard errors; how much less another choice may cost; steps that a run has to take.
ALLOWED, CHEAPER, STEPS = 0.015, 1.3, 100_000


class Runs:
    """Runs of one scene, from the store where they are there."""

    def __init__(self, name: str, options: argparse.Namespace, store: Store):
        self.name, self.options, self.store = name, options, store
        self.scene = SCENES[name](options.beads) if name in SCENES else drawn(int(name.split()[-1]), options.beads)

    def __call__(self, scheme: str, dt: float, enough: float = 0.0025, steps: int = 0) -> Averages | None:
        """Averages of a run; None if it stops."""
        dt = float(f"{dt:.4g}")
        job = {"scene": self.name, "scheme": scheme, "dt": dt, "beads": self.options.beads, "longest": self.options.longest, "steps": steps}
        job["enough"] = enough
        if job not in self.store:
            dpd.set_threads(1)
            found = averages(self.scene, scheme, dt, longest=self.options.longest, enough=enough, steps=steps)
            self.store.add(job | ({"failed": "stops"} if found is None else {"averages": asdict(found)}))
        known = self.store.get(job)
        return None if "failed" in known else Averages(**known["averages"])


def text(pair: tuple[float, float] | None) -> str:
    """A deviation with its standard error."""
    return "-" if pair is None else f"{100 * pair[0]:+.2f}({100 * pair[1]:.2f}) %"


def right(pairs: list[tuple[float, float]], allowed: float = ALLOWED, errors: float = 2.0) -> bool:
    """Whether all deviations are allowed, with so many standard errors beside them."""
    return all(abs(value) < allowed + errors * sem for value, sem in pairs)


def row(name: str, options: argparse.Namespace, store: Store) -> tuple[str, bool]:
    """A line of the table, and whether the scene is within bounds (or refused)."""
    run = Runs(name, options, store)
    found = dpd.recommend(run.scene, options.error)
    choice = next((c for c in found.choices if options.scheme in (None, c.scheme)), None)
    if choice is None:
        return f"| {name} | no advice: {'; '.join(found.notes)} | | | | | |", True
    result = run(choice.scheme, choice.dt, steps=STEPS if options.twelve else 0)
    head = f"| {name} | {choice.scheme} {choice.dt:.4g} ({choice.limit}) |"
    if result is None:
        return head + " stops | stops | | **no** | |", False
    pairs, energy, rivals = list(result.temperatures), "", ""
    if options.twelve:
        reference = run("middle", 0.25 * next(c.dt for c in found.choices if c.scheme == "middle"), 0.001)
        assert reference is not None, "a quarter of the step of middle stops"
        kT = run.scene.initial_kT
        off = result.potential_off(reference, kT)
        pairs, energy = [*pairs, off], text(off)
        better = []
        for other in (c for c in found.choices if c.scheme != "native" and c.relative_cost < 2.0 * choice.relative_cost):
            # the step at which it costs so much less
            dt = CHEAPER * other.dt * other.relative_cost / choice.relative_cost
            tried = run(other.scheme, dt)
            if tried is not None and right([*tried.temperatures, tried.potential_off(reference, kT)], options.error, 0.0):
                better.append(f"{other.scheme} {dt:.3g}")
        rivals = ", ".join(better) or "none"
    good = right(pairs)
    texts = f"{text(result.kin)} | {text(result.conf)}"
    return f"{head} {texts} | {energy} | {'yes' if good else '**no**'} | {rivals} |", good and rivals in ("", "none")


def promise(seeds: range, options: argparse.Namespace, store: Store) -> None:
    """Steps of scenes drawn at random: how many deviations of both temperatures are within the error that was asked for."""
    found: list[tuple[float, float]] = []
    for seed in seeds:
        run = Runs(f"drawn {seed}", options, store)
        advised = dpd.recommend(run.scene, options.error)
        choice = next((c for c in advised.choices if options.scheme in (None, c.scheme)), None)
        if choice is None:
            print(f"| drawn {seed} | no advice: {'; '.join(advised.notes)} | | |")
            continue
        result = run(choice.scheme, options.times * choice.dt)
        pairs = [(np.inf, 0.0)] if result is None else result.temperatures
        found += pairs
        print(
            f"| drawn {seed} | {choice.scheme} {options.times * choice.dt:.4g} ({choice.limit}) | {' | '.join(map(text, pairs))} |",
            flush=True,
        )
    off, sem = np.abs(np.array(found)).T
    within = int(np.sum(off <= options.error))
    share, surely = within / len(off), int(np.sum(off > options.error + 2 * sem))
    print(
        f"{within} of {len(off)} within {100 * options.error:g} %: {100 * share:.1f}({100 * (share * (1 - share) / len(off)) ** 0.5:.1f}) %; ",
        end="",
    )
    print(f"beyond it by more than two standard errors {surely}; 95 % are within {100 * np.quantile(off, 0.95):.2f} %")


def main() -> None:
    """Run what is missing, print the table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--only", default="", help="part of the names of scenes")
    parser.add_argument("--scheme", choices=SCHEMES, help="another scheme than the cheapest")
    parser.add_argument("--error", type=float, default=0.01)
    parser.add_argument("--beads", type=int, default=900)
    parser.add_argument("--longest", type=float, default=2500.0, help="longest simulated time of a run")
    parser.add_argument("--twelve", action="store_true", help="one scene of each kind, with its potential energy, stability and cost")
    parser.add_argument("--random", help="first and last seed of scenes drawn at random, as 0:60")
    parser.add_argument("--times", type=float, default=1.0, help="times the recommended step")
    options = parser.parse_args()
    store = Store(ROOT / "out" / "recommended" / "results.jsonl")
    if options.random:
        return promise(range(*map(int, options.random.split(":"))), options, store)
    print("| scene | recommended (set by) | kinetic | configurational | potential energy | within | right for less |")
    print("| --- | --- | --- | --- | --- | --- | --- |")
    good = True
    for name in TWELVE if options.twelve else SCENES:
        if options.only in name:
            line, fine = row(name, options, store)
            print(line, flush=True)
            good &= fine
    sys.exit(not good)


if __name__ == "__main__":
    main()
