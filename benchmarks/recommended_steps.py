"""Recommended steps, run: are both temperatures right within what was asked for?

Every scene of atlas_parts/scenes.py takes the scheme and the step that ``recommend`` gives it for an error of 1 %, and runs until both
temperatures are known to 0.25 %.  They are to be within 1.5 % and two standard errors (steps of the table are known to a tenth or two,
and errors go with their square).  Results are kept in ``out/recommended``, under scheme and step, so that what is not changed is not run again.

    python benchmarks/recommended_steps.py                  # about ten minutes of one core
    python benchmarks/recommended_steps.py --only layers    # scenes with this in their name
    python benchmarks/recommended_steps.py --scheme middle  # the step of this scheme, not of the cheapest
"""

from __future__ import annotations

import argparse
import sys
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
sys.path.insert(0, str(Path(__file__).parent))

from atlas_parts.scenes import SCENES, deviations  # noqa: E402
from atlas_parts.store import Store  # noqa: E402

import openmm_dpd as dpd  # noqa: E402
from openmm_dpd.model.schemes import SCHEMES  # noqa: E402

#: Deviation that is allowed beside two standard errors.
ALLOWED = 0.015


def row(name: str, options: argparse.Namespace, store: Store) -> tuple[str, bool]:
    """A line of the table, and whether the scene is within bounds (or refused)."""
    scene = SCENES[name](options.beads)
    found = dpd.recommend(scene, options.error)
    choice = next((c for c in found.choices if options.scheme in (None, c.scheme)), None)
    if choice is None:
        return f"| {name} | no advice: {'; '.join(found.notes)} | | | |", True
    dt = float(f"{choice.dt:.4g}")
    job = {"scene": name, "scheme": choice.scheme, "dt": dt, "beads": options.beads, "longest": options.longest}
    if job not in store:
        dpd.set_threads(1)
        result = deviations(scene, choice.scheme, dt, longest=options.longest, enough=0.0025)
        # the names under which a store keeps results
        store.add(job | ({"failed": "stops"} if result is None else {"T_kin": result["kin"], "T_conf": result["conf"]}))
    result = store.get(job)
    head = f"| {name} | {choice.scheme} {dt:g} ({choice.limit}) |"
    if "failed" in result:
        return head + " stops | stops | **no** |", False
    pairs = [result["T_kin"], result["T_conf"]]
    good = all(abs(value) < ALLOWED + 2 * sem for value, sem in pairs)
    texts = " | ".join(f"{100 * value:+.2f}({100 * sem:.2f}) %" for value, sem in pairs)
    return f"{head} {texts} | {'yes' if good else '**no**'} |", good


def main() -> None:
    """Run what is missing, print the table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--only", default="", help="part of the names of scenes")
    parser.add_argument("--scheme", choices=SCHEMES, help="another scheme than the cheapest")
    parser.add_argument("--error", type=float, default=0.01)
    parser.add_argument("--beads", type=int, default=900)
    parser.add_argument("--longest", type=float, default=2500.0, help="longest simulated time of a run")
    options = parser.parse_args()
    store = Store(ROOT / "out" / "recommended" / "results.jsonl")
    print("| scene | recommended (set by) | kinetic | configurational | within |\n| --- | --- | --- | --- | --- |")
    good = True
    for name in SCENES:
        if options.only in name:
            line, fine = row(name, options, store)
            print(line, flush=True)
            good &= fine
    sys.exit(not good)


if __name__ == "__main__":
    main()
