"""One seed: the deck it makes is interrupted at random moments and resumed, and every file compared with that of a run in one piece."""

from __future__ import annotations

import io
import shutil
import signal
import traceback
from contextlib import redirect_stderr
from pathlib import Path
from unittest.mock import patch

from interrupted_runs import contents, crash_in, interrupted

from openmm_dpd.__main__ import main

from .deck import Deck
from .draw import Draw
from .trial import Outcome, deck_of

#: What a run says that could not be resumed, and does not begin.
NOT_RESUMABLE = "--checkpoint: this run could not be resumed: OpenMM's MonteCarlo"
#: What a run says whose forces OpenMM computes.
AGREES = "agrees with an uninterrupted one up to the rounding of this platform's forces"


class Interruptions:
    """As :class:`~fuzz.trial.Trial`, with a run that was interrupted in the place of the other program."""

    def __init__(self, folder: Path):
        self.folder = folder

    def __enter__(self) -> Interruptions:
        return self

    def __exit__(self, *_) -> None:
        pass

    def of(self, seed: int, area: str | None = None) -> Outcome:
        """What comes of a seed."""
        area, deck = deck_of(seed, area)
        if area == "meso":  # steps that LAMMPS does not have
            deck.options["scheme"] = Draw(seed).pick(
                ["middle", "aboba", "bababo", "basa", "bab3", "O/4 B/2 A B/2 3O/4", "S/2 A/3 B 2A/3 S/2"]
            )
        return self.of_deck(seed, area, deck)

    def of_deck(self, seed: int, area: str, deck: Deck) -> Outcome:
        """What comes of a deck: ``agree``, ``both refuse`` (with the same error, perhaps behind its runs), or a failure."""
        shutil.rmtree(self.folder, ignore_errors=True)
        self.folder.mkdir(parents=True)
        for name, text in deck.files.items():
            (self.folder / name).write_text(text, encoding="utf-8")
        outcome = Outcome(seed, area, "both refuse", "", deck.texts)
        for number, text in enumerate(deck.texts):
            (self.folder / f"in.{number}").write_text(text, encoding="utf-8")
            try:
                with patch("openmm_dpd.lammps.run.main.thermo_picture", lambda *_, **__: None):  # most of the time
                    kind, message = self._compared(Draw(seed), number, deck.options, area)
            except Exception:
                kind, message = "crash", traceback.format_exc()
            outcome = Outcome(seed, area, kind, message, deck.texts)
            if kind != "agree":
                break
            for path in (self.folder / f"whole-{number}").glob("*.*"):
                for name in (path.name, f"lammps_{path.name}", f"ours_{path.name}"):
                    shutil.copy(path, self.folder / name)
        return outcome

    def _compared(self, draw: Draw, number: int, options: dict[str, str], area: str) -> tuple[str, str]:
        whole, crashed, stopped = (self.folder / f"{name}-{number}" for name in ("whole", "crashed", "stopped"))

        # where the kernel has all forces; OpenMM's own are not the same to the bit after a restart
        platform = "CPU" if draw.chance(0.5) and "conservative" not in options and area != "charges" else "Reference"

        def words(out: Path) -> list[str]:
            more = [word for name, value in options.items() for word in (f"--{name}", value)]
            return [str(self.folder / f"in.{number}"), "--out", str(out), "--platform", platform, *more, *every]

        every = ["--checkpoint", str(draw.whole(1, 4)), "--threads", "1", "--quiet"]
        with crash_in(whole, crashed, draw.whole(0, 10**6)) as calls:
            expected = results(whole, words(whole))
        if NOT_RESUMABLE in expected[0]:
            return "both refuse", expected[0]
        with redirect_stderr(io.StringIO()):
            interrupted(draw.whole(calls[0] // 3, calls[0]), signal.SIGINT, ["run", *words(stopped)])
        resumed = [out for out in (crashed, stopped) if (out / "checkpoint" / "latest").exists()]
        for out in resumed:
            found = results(out, [str(self.folder / f"in.{number}"), "--restart", str(out), "--quiet"])
            differing = [name for name in sorted({*found[1], *expected[1]}) if found[1].get(name) != expected[1].get(name)]
            if found[0] != expected[0]:
                return "difference", f"the error: of {out.name}, {found[0]!r}, and in one piece {expected[0]!r}"
            if differing and AGREES in (whole / "log.txt").read_text(encoding="utf-8"):
                return "expected", AGREES
            if differing:
                return "difference", f"{', '.join(differing)}: of {out.name}, in {out}"
        return "agree" if resumed and not expected[0] else "both refuse", expected[0]


def results(out: Path, words: list[str]) -> tuple[str, dict[str, object]]:
    """The error of a run, and what is in its folder then.  What is said when a run begins is not said by one that was over."""
    with redirect_stderr(io.StringIO()) as stream:
        main(["run", *words])
    said = stream.getvalue()
    found = {name: content for name, content in contents(out).items() if not name.startswith("checkpoint")} if out.exists() else {}
    return "".join(said.partition("openmm-dpd: error")[1:]).replace(str(out), "OUT"), found
