"""One seed: the deck it makes, both programs' runs of it, and what came of it."""

from __future__ import annotations

import atexit
import re
import shutil
import zlib
from dataclasses import dataclass, field
from pathlib import Path

from . import xtc_text
from .areas import AREAS
from .compare import differences
from .data_text import in_order
from .deck import Deck
from .draw import Draw
from .reasons import why_expected
from .workers import Answer, Worker

#: What can come of a deck.  The last two fail.
OUTCOMES = ("agree", "both refuse", "ours refuses", "expected", "LAMMPS refuses", "difference", "crash")
FAILURES = ("LAMMPS refuses", "difference", "crash")


@dataclass(frozen=True)
class Outcome:
    """What came of a seed.

    Attributes
    ----------
    seed, area, kind : int, str, str
        ``kind`` is one of :data:`OUTCOMES`.
    message : str
        The refusal, or the quantity that differs and both values.
    scripts : list of str
        The deck.
    outputs : dict
        Text that both sides wrote, by file: (LAMMPS's, ours).
    """

    seed: int
    area: str
    kind: str
    message: str
    scripts: list[str]
    outputs: dict[str, tuple[str, str]] = field(default_factory=dict)

    def __str__(self) -> str:
        scripts = "\n--- next script ---\n".join(self.scripts)
        return f"seed {self.seed}, area {self.area}: {self.kind}\n{self.message}\n{scripts}"


def deck_of(seed: int, area: str | None = None) -> tuple[str, Deck]:
    """The deck of a seed; without an area the seed draws one."""
    draw = Draw(seed)
    if area is None:
        area = draw.choices(list(AREAS), [weight for weight, _ in AREAS.values()])[0]
    draw = Draw(seed * 1_000_003 + zlib.crc32(area.encode()))  # so that the areas do not begin with the same choices
    return area, AREAS[area][1](draw)


#: A deck leaves nothing behind in ours, so all trials share the process, with its imports and kernels.
_OURS = Worker("ours")
atexit.register(_OURS.close)


class Trial:
    """Both programs, ready to be asked."""

    def __init__(self, folder: Path):
        self.folder = folder
        self.sides = {"lammps": Worker("lammps"), "ours": _OURS}

    def close(self) -> None:
        """End the process of LAMMPS."""
        self.sides["lammps"].close()

    def __enter__(self) -> Trial:
        return self

    def __exit__(self, *_) -> None:
        self.close()

    def of(self, seed: int, area: str | None = None) -> Outcome:
        """What comes of a seed."""
        area, deck = deck_of(seed, area)
        return self.of_deck(seed, area, deck)

    def of_deck(self, seed: int, area: str, deck: Deck) -> Outcome:
        """What comes of a deck."""
        folders = {side: self.folder / side for side in self.sides}
        for folder in folders.values():
            shutil.rmtree(folder, ignore_errors=True)
            folder.mkdir(parents=True)
            for name, text in deck.files.items():
                (folder / name).write_text(text, encoding="utf-8")

        def outcome(kind: str, message: str, outputs: dict[str, tuple[str, str]] | None = None) -> Outcome:
            return Outcome(seed, area, kind, message, deck.texts, outputs or {})

        for number, text in enumerate(deck.texts):
            before = {name: (folders["ours"] / name).read_bytes() for name in _names(folders["ours"])}
            answers = {side: self._answer(folders[side], side, number, text, deck) for side in self.sides}
            lammps, ours = answers["lammps"], answers["ours"]
            written = {name for folder in folders.values() for name in _names(folder)} - set(deck.files) - {f"in.{number}"}
            written = {name for name in written if not _is_old(folders, name, before)}
            outputs = {name: _texts(folders, name) for name in sorted(written)} | {"thermo": (lammps.thermo, ours.thermo)}
            if ours.status == "crashed":
                return outcome("crash", ours.message, outputs)
            if lammps.status == "crashed":
                return outcome("expected", f"LAMMPS: {lammps.message}", outputs)
            if ours.status == "refused" and lammps.status == "done":
                return outcome("ours refuses", ours.message, outputs)
            reason = why_expected(area, lammps.message, ours.message)
            if ours.status == "done" and lammps.status == "refused":
                return outcome("expected" if reason else "LAMMPS refuses", lammps.message, outputs)
            if ours.status == "refused" and _stopped_earlier(outputs):
                return outcome("ours refuses", ours.message, outputs)
            found = _compare(outputs, deck, ours.status == "refused")
            if found is not None:
                return outcome(
                    "expected" if reason else "difference", found + ("" if ours.status == "done" else _both(lammps, ours)), outputs
                )
            if ours.status == "refused":
                return outcome("both refuse", _both(lammps, ours), outputs)
            _exchange(folders)
        for pair in deck.same:
            outputs = {" and ".join(pair): tuple((folders["ours"] / name).read_text() for name in pair)}
            if len({text for texts in outputs.values() for text in texts}) > 1:
                return outcome("difference", f"{' and '.join(pair)} of ours are not the same", outputs)
        return outcome("agree", "")

    def _answer(self, folder: Path, side: str, number: int, text: str, deck: Deck) -> Answer:
        for theirs, ours in deck.ours.items() if side == "ours" else ():
            text = text.replace(theirs, ours)
        (folder / f"in.{number}").write_text(text, encoding="utf-8")
        return self.sides[side].run(folder, f"in.{number}", deck.options)


def _both(lammps: Answer, ours: Answer) -> str:
    return f"\nLAMMPS: {lammps.message}\nours: {ours.message}"


def _stopped_earlier(outputs: dict[str, tuple[str, str]]) -> bool:
    """Whether ours wrote less than LAMMPS before both refused."""
    lammps, ours = (text.count("\n") if "(no such file)" not in text else 0 for text in outputs.get("values.txt", ("", "")))
    return ours < lammps


def _names(folder: Path) -> list[str]:
    found = (path for path in folder.rglob("*") if path.is_file() and path.name != "log.lammps" and path.suffix != ".restart")
    return [str(path.relative_to(folder)) for path in found]


def _is_old(folders: dict[str, Path], name: str, before: dict[str, bytes]) -> bool:
    path = folders["ours"] / name
    return name in before and path.exists() and before[name] == path.read_bytes() and re.match(r"in\.|lammps_|ours_", name) is not None


def _texts(folders: dict[str, Path], name: str) -> tuple[str, str]:
    paths = (folders["lammps"] / name, folders["ours"] / name)
    if name.endswith(".xtc") and all(path.exists() for path in paths):
        return xtc_text.texts(*paths)
    texts = [path.read_text(errors="replace") if path.exists() else "(no such file)" for path in paths]
    return (
        (in_order(texts[0]), in_order(texts[1]))
        if name.endswith(".data") and all(path.exists() for path in paths)
        else (texts[0], texts[1])
    )


def _compare(outputs: dict[str, tuple[str, str]], deck: Deck, refused: bool) -> str | None:
    """The differences; of decks that both refuse only those in what was printed by then."""
    found: list[str] = []
    for name, (lammps, ours) in outputs.items():
        if not refused or name == "values.txt":
            found += [f"{name}: {words}" for words in differences(lammps, ours, deck.accuracy, of_forces=deck.of_forces)]
    return "\n".join(found) or None


def _exchange(folders: dict[str, Path]) -> None:
    """Give both sides the data files of both."""
    for side, folder in folders.items():
        for path in folder.glob("*.data"):
            if path.name.startswith(("lammps_", "ours_")):
                continue
            for other in folders.values():
                shutil.copy(path, other / f"{side}_{path.name}")
