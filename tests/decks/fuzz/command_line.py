"""Run many seeds by hand: a table of outcomes, and the failing decks with both outputs in a folder."""

import argparse
import re
import tempfile
import time
from collections import Counter
from pathlib import Path

from .areas import AREAS
from .interruptions import Interruptions
from .shrink import shrunk
from .trial import FAILURES, OUTCOMES, Outcome, Trial, deck_of


def main(words: list[str] | None = None) -> int:
    """Exit status 1 if a seed fails."""
    parser = argparse.ArgumentParser(prog="fuzz", description="Run random decks by LAMMPS and by openmm_dpd and compare.")
    parser.add_argument("--seeds", default="0:200", help="first:last (last is left out), or single ones: 3,17")
    parser.add_argument("--area", choices=list(AREAS), help="only this area (by default every seed draws one)")
    parser.add_argument("--keep", type=Path, help="folder for failing decks and both outputs")
    parser.add_argument("--minutes", type=float, help="stop after so many minutes")
    parser.add_argument("--shrink", action="store_true", help="drop lines of failing decks as long as they fail in the same way")
    parser.add_argument("--resume", action="store_true", help="no LAMMPS: interrupt each deck, resume it, and compare all files")
    parser.add_argument("--quiet", action="store_true", help="say only which seeds fail, and why")
    options = parser.parse_args(words)
    found: list[Outcome] = []
    begun = time.perf_counter()
    with tempfile.TemporaryDirectory() as folder, (Interruptions if options.resume else Trial)(Path(folder) / "decks") as trial:
        for seed in _seeds(options.seeds):
            outcome = trial.of(seed, options.area)
            found.append(outcome)
            if outcome.kind in FAILURES:
                if options.shrink:
                    outcome = shrunk(trial, outcome, deck_of(seed, options.area)[1])
                print(f"{outcome.seed} {outcome.area} {outcome.kind}: {outcome.message}" if options.quiet else f"{outcome}\n", flush=True)
                if options.keep is not None:
                    keep(options.keep, outcome)
            if options.minutes is not None and time.perf_counter() - begun > 60 * options.minutes:
                print(f"stopped after seed {seed}")
                break
    print(table(found))
    print(f"{(time.perf_counter() - begun) / max(len(found), 1):.3f} s per deck")
    return int(any(outcome.kind in FAILURES for outcome in found))


def _seeds(text: str) -> list[int]:
    first, colon, last = text.partition(":")
    return list(range(int(first), int(last))) if colon else [int(word) for word in text.split(",")]


def keep(folder: Path, outcome: Outcome) -> None:
    """Write a deck and what both programs made of it."""
    place = folder / f"{outcome.area}_{outcome.seed}"
    place.mkdir(parents=True, exist_ok=True)
    for number, script in enumerate(outcome.scripts):
        (place / f"in.{number}").write_text(script)
    (place / "outcome.txt").write_text(f"{outcome.kind}: {outcome.message}\n")
    for name, (lammps, ours) in outcome.outputs.items():
        (place / f"{name}.lammps").write_text(lammps)
        (place / f"{name}.ours").write_text(ours)


def table(found: list[Outcome]) -> str:
    """Outcomes by area, and what was refused how often."""
    counts = Counter((outcome.area, outcome.kind) for outcome in found)
    areas = [area for area in AREAS if any((area, kind) in counts for kind in OUTCOMES)]
    rows = [["area", *OUTCOMES], *([area, *(str(counts[area, kind]) for kind in OUTCOMES)] for area in areas)]
    widths = [max(map(len, column)) for column in zip(*rows, strict=True)]
    lines = ["  ".join(cell.rjust(width) for cell, width in zip(row, widths, strict=True)) for row in rows]
    for kind in ("ours refuses", "expected", "both refuse"):
        messages = Counter(_kind_of_message(outcome.message) for outcome in found if outcome.kind == kind)
        lines += [f"{kind}:"] * bool(messages) + [f"  {count:5d}  {message}" for message, count in messages.most_common(12)]
    return "\n".join(lines)


def _kind_of_message(message: str) -> str:
    """A message without what is different in every deck."""
    text = re.sub(r"in\.\d+:\d+: ", "", message.partition("ours: ")[2] or message.strip())
    return re.sub(r"(?<![\w/])[-+]?\d[\d.e+-]*|\b[rgcfvad]\d+\b|'[^']*'", "#", text.splitlines()[0] if text else "")[:150]
