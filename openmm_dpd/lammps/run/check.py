"""Reading a deck to its end without carrying out its runs, past everything that is refused, to say it all at once."""

import re
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import asdict, dataclass
from itertools import takewhile
from pathlib import Path
from typing import Any

import numpy as np

from ...base.errors import DeckError, DPDError
from ..commands.interactions import HYBRID, is_number
from ..files.data_file import JOINED
from ..language.arguments import INSTEAD
from ..language.lexer import Line
from ..scene.reacting import keep_reacted
from ..state.box import Box
from ..state.deck_state import DeckState
from ..state.records import DeckSample
from ..state.rigid import keep_rigid
from .building import build_request, connect_barostat
from .deck import at_line, execute_file, open_deck
from .options import RunOptions
from .request import RunRequest

#: How often a jump is followed, and the number of pieces of a ``run N every M``.
MOST_ROUNDS = 100


@dataclass(frozen=True)
class Finding:
    """Something to say about a line of a deck."""

    kind: str  #: ``refused``, or ``note`` for what is accepted with a remark
    file: str
    line: int | None  #: Number of the line, from 1
    word: str  #: What is refused, such as ``fix npt``, or the command that a note is about
    message: str
    instead: str | None = None  #: What to write instead, if that is known; ``message`` has it too

    def __str__(self) -> str:
        where = self.file if self.line is None else f"{self.file}:{self.line}"
        return f"{where}: {'note: ' * (self.kind == 'note')}{re.sub('; supported are [^;]{100,}', '', self.message)}"


#: Commands with words that are independent of each other: the first of them.
_FREE = {"thermo_style": 2, "dump": 6}
#: Commands that need what others define; if one of those was refused, nothing more is said about them.
_BEADS = {"box", "create_atoms", "molecule"}
_NEEDS: dict[str, set[str]] = {
    **{word: {"box"} for word in ("write_data", "dump_modify", "create_box", "read_restart", "change_box")},
    **{word: _BEADS for word in "set velocity delete_atoms displace_atoms replicate reset_atoms delete_bonds create_bonds".split()},
    "create_atoms": {"box", "lattice", "molecule"},
    "read_data": {"atom_style"},
    **{f"pair_{word}": {"pair_style"} for word in ("coeff", "modify")},
    **{f"{what}_coeff": {f"{what}_style"} for what in JOINED},
    "kspace_modify": {"kspace_style"},
}
#: Commands that no run depends on, and those that a run refuses itself if they are missing.
_ONLY_OUTPUT = set("compute compute_modify dump dump_modify undump write_dump write_data write_restart restart print thermo".split())
_ONLY_OUTPUT |= set("thermo_style thermo_modify uncompute log shell info run minimize label jump next".split())
#: Commands that define the box, and those that may define anything.  In place of a box that is refused there is one with many types.
_MANY = 100
_BOXES, _ANYTHING = {"create_box": "box", "read_data": "box", "read_restart": "box"}, ("include", "read_restart")
#: What follows from an earlier refusal, by the message: the kind and name of what is missing.
_MISSING = tuple(
    map(
        re.compile,
        (
            r"there is no (?P<kind>(?!file)\w+) '(?P<name>[^']*)'",
            r"'(?P<name>[^']*)' is not the id of a (?P<kind>\w+)",
            r"one of the (?P<kind>styles) .*not '(?P<name>[^']*)'",
        ),
    )
)


class Findings:
    """What was found in a deck so far, and what has been refused, so that its consequences are not said as well."""

    def __init__(self, deck: DeckState):
        self.deck, self.found = deck, list[Finding]()
        self._lost: set[str] = set()  # commands, and the names they would have defined
        self._rounds: dict[tuple[str, int], int] = {}
        self._said: dict[tuple[str, int | None], int] = {}  # the visit at which a line was said to be wrong
        self._visits = 0
        self.written: set[str] = set()  # files that a run would have written here
        self.has_run = self.conditional = False

    # -- what the reader of the deck asks --------------------------------------------------------------------------------------
    def visit(self, line: Line) -> None:
        """Begin a line of a file."""
        self._visits += 1
        word = line.text.split()[0]
        self.has_run, self.conditional = self.has_run or word == "run", word == "if"
        if word == "clear":
            self._lost = {name for name in self._lost if name.startswith("variable")}

    def note(self, text: str) -> None:
        """A remark of the line that is being carried out."""
        if text.startswith("no fix moves") and "fix" in self._lost:
            return
        here = self.deck.here or Line("", str(self.deck.path), 0)
        self.found.append(Finding("note", here.file, here.number or None, "".join(here.text.split()[:1]), text))

    def follows(self) -> bool:
        """Whether the jump of the present line is followed once more."""
        here = self.deck.here
        assert here is not None
        at = here.file, here.number
        self._rounds[at] = self._rounds.get(at, 0) + 1
        if self._rounds[at] == MOST_ROUNDS:
            self.note(f"this jump was followed {MOST_ROUNDS} times and no more: its loop is longer, ends by values of runs, or never does")
        return self._rounds[at] < MOST_ROUNDS

    def passes_over(self, command: str) -> bool:
        """Whether a command would fill the large box that stands for the deck's."""
        return command in ("create_atoms", "replicate") and bool(self._lost & {"box", "lattice"})

    def refuse(self, line: Line, words: list[str], error: DeckError) -> list[str]:
        """Take an error of a line with these words; return words of the line that can be tried without the one that was refused."""
        command = words[0] if words else line.text.split()[0]
        consequence, left = self._follows_from(command, error.message), list[str]()
        if not consequence:
            self._say(line, command, error)
        said = [found for quoted in re.findall("'([^']*)'", error.message) for found in (quoted, f"v_{quoted}")]
        said += re.findall(r"^(\S+): there is no", error.message)
        at = next((words.index(word, 1) for word in said if word in words[1:]), 0)
        if at >= _FREE.get(command, len(words)):
            left = words[:at] + words[at + 1 :]
        elif command == "pair_style" and words[1] in HYBRID and at > 1:
            left = words[:at] + words[at + 1 + len(list(takewhile(is_number, words[at + 1 :]))) :]
            self._lost |= {"hybrid", f"styles {words[at]}"}
        retried = len(left) > _FREE.get(command, 2)
        if not (retried and command == "pair_style"):
            self._lose(command, words)
        return left if retried else []

    # -- what it answers by ------------------------------------------------------------------------------------------------------
    def _follows_from(self, command: str, message: str) -> bool:
        """Whether an error is a consequence of an earlier one."""
        lost = self._lost
        missing = [found for pattern in _MISSING for found in pattern.finditer(message)]
        return bool(
            any(f"{found['kind']} {found['name']}" in lost for found in missing)
            or (missing and lost.intersection(_ANYTHING))
            or lost & (_NEEDS.get(command, set()))
            or (command in ("run", "minimize") and lost - _ONLY_OUTPUT - {name for name in lost if " " in name})
            or any(
                str(self.deck.output / self.deck.placed(name)) in self.written for name in re.findall("there is no file '([^']*)'", message)
            )
            or ("atom_style" in lost and "atom_style" in message)
            or ("units" in lost and "units" in message)
            or ("cannot evaluate the formula" in message and self.deck.runs)  # of values that no run has computed
        )

    def _lose(self, command: str, words: list[str]) -> None:
        """Remember what a refused command would have defined, and put something in the place of a box."""
        self._lost |= {_BOXES.get(command, command), *(f"{command} {word}" for word in words[1:2])}
        if command in _BOXES and self.deck.box is None:
            deck, number = self.deck, next((int(word) for word in words[1:2] if word.isdigit()), _MANY)
            deck.box = Box(np.zeros(3), np.full(3, 1000.0), np.zeros(3), True, deck.periodic)
            deck.n_types = number
            for what in JOINED:
                setattr(deck, f"n_{what}_types", _MANY)

    def _say(self, line: Line, command: str, error: DeckError) -> None:
        at = line.file, line.number
        if self._said.setdefault(at, self._visits) != self._visits:
            return
        name = next((name for name, hint in INSTEAD.items() if error.message.endswith(hint) and name.split()[0] in (command, "pair")), None)
        quoted = re.search(r"^(?:unknown or unsupported command|(\w+) style|(\w+) word) '([^']*)'", error.message)
        word = name or (command if quoted is None or quoted[3] == command else f"{quoted[1] or quoted[2]} {quoted[3]}")
        found = Finding("refused", error.file or str(self.deck.path), error.line, word, error.message, INSTEAD.get(name or ""))
        again = command in ("run", "minimize") and error.message in [one.message for one in self.found]
        if not again and found not in self.found:
            self.found.append(found)


def _measured(request: RunRequest) -> DeckSample:
    """Values in the place of those that the run would have measured at its end."""
    state, n = request.state, len(request.state.atoms)
    values: dict[str, Any] = dict.fromkeys("kinetic pair_energy virial virial_full force_norm force_max kT_conf".split(), 1.0)
    values |= {"virial_tensor": np.ones(6), "kinetic_tensor": np.ones(6), "forces": np.ones((n, 3))}
    return DeckSample(request.last_step, **values, acted={fix.name: [1.0] * 100 for fix in state.fixes.values()})


def _pass_over(request: RunRequest, findings: Findings, built: set[tuple[str, int]]) -> None:
    """Build a run, when it is first met, and go on as if it had been carried out."""
    at = request.where
    assert at is not None
    if (at.file, at.number) not in built:
        built.add((at.file, at.number))
        try:
            with at_line(at):
                scene = request.scene()
                if request.minimization is None:
                    connect_barostat(request, build_request(request, scene, RunOptions()))
        except DPDError as error:
            where = error if isinstance(error, DeckError) else DeckError(str(error), at.file, at.number)
            findings.refuse(at, at.text.split(), where)
    state = request.state
    state.step = request.last_step
    state.last_sample = _measured(request)
    keep_reacted(state, {})
    if request.steps and not state.atoms.velocities.any():  # a run has beads move, and what follows may need a temperature
        state.atoms.velocities = np.resize([1.0, -0.5, -1.0, 0.5], state.atoms.velocities.shape)
    keep_rigid(state)


def check_deck(path: str | Path, *, variables: Mapping[str, str] | None = None) -> list[Finding]:
    """Read a LAMMPS deck to its end, past all that is not supported; no run is carried out, and no file written.

    Parameters
    ----------
    path : str or Path
        The deck.
    variables : mapping, optional
        Index variables of the deck (LAMMPS: ``-var``).

    Returns
    -------
    list of Finding
        What is refused, and what is accepted with a remark, in the order of the deck.  The deck runs if nothing is refused.  What only
        follows from an earlier refusal is left out, and a line in a loop is there once.  Values that runs would compute are made up, so
        conditions on them may select another branch than in a run.
    """
    path, built = Path(path), set[tuple[str, int]]()
    with open_deck(path, variables, Path("."), lambda _: None, carried_out=False) as deck:
        deck.findings = findings = Findings(deck)
        try:
            for request in execute_file(deck, path):
                _pass_over(request, findings, built)
        except DeckError as error:  # the file cannot be read
            findings.found.append(Finding("refused", error.file or str(path), error.line, "", error.message))
            findings.has_run = True  # as far as is known
        if not findings.has_run:
            message = "the deck has no run command; add one at its end, such as 'run 0' after minimize"
            findings.found.append(Finding("refused", str(path), None, "run", message))
        return findings.found


def as_data(found: list[Finding]) -> dict:
    """Findings as plain data: whether the deck ``runs``, what is ``refused``, and the ``notes``."""
    rows = {kind: [asdict(one) for one in found if one.kind == kind] for kind in ("refused", "note")}
    return {"runs": not rows["refused"], "refused": rows["refused"], "notes": rows["note"]}


@contextmanager
def all_said(path: str | Path, variables: Mapping[str, str] | None, begun: Callable[[], object] = lambda: False) -> Iterator[None]:
    """In this block an error of a deck gets the others of the deck as further lines, unless its runs have ``begun``."""
    try:
        yield
    except DeckError as error:
        if begun():
            raise
        others = [one for one in check_deck(path, variables=variables) if one.kind == "refused"]
        same = next((k for k, one in enumerate(others) if (one.file, one.line) == (error.file or str(path), error.line)), len(others))
        rest = map(str, others[:same] + others[same + 1 :])
        raise DeckError("\n".join([error.message, *rest]), error.file, error.line) from None
