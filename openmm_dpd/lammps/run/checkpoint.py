"""Checkpoints of a deck: what its runs have reached and changed in it, in a folder beside the results.

``run-K`` has what the K-th run made of the deck, written once when it ended.  ``latest`` has how many runs are done, where the present one
is, and how long all files were; the next one makes it ``before``.  They are read back before they are written, and have checksums: where
``latest`` or a run is damaged, ``before`` is used.  To resume, the deck is read again from its first line; runs that are done are not
carried out but recalled, and nothing is written until the place of the checkpoint is reached.  So loops, formulas and conditions of the
deck need nothing of their own.
"""

import io
import logging
import os
import pickle
import shlex
from collections.abc import Mapping
from contextlib import suppress
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

from ...base.errors import ParameterError
from ...base.file_ledger import FileLedger, sealed, unsealed
from ...base.files import digest, write_whole, writing
from ...base.serialized import ARRAYS, DataUnpickler
from ..state.deck_state import DeckState
from .options import RunOptions

#: Attributes of :class:`~openmm_dpd.lammps.state.deck_state.DeckState` that runs change, or what is in them: beads and box, averages, dumps
#: and computes that remember, random numbers of formulas.  What commands do need not be stored: they are carried out again.
PARTS = (
    *("atoms", "box", "step", "noise_counter", "restarts", "time_origin", "last_sample", "generators", "notes"),
    *("fixes", "computes", "dumps"),
)

#: What may be in a checkpoint beside plain values, for writing and reading.  Classes of these packages hold data only: unpickling
#: them cannot do anything else.
_PACKAGES = tuple(
    f"openmm_dpd.{name}"
    for name in ("model.", "base.units", *(f"lammps.{part}." for part in "language state output values styles".split()))
)

#: What numpy and the standard library need.
_OTHERS = ARRAYS | {
    ("builtins", "range"),
    ("collections", "deque"),
    *(("numpy.random._pickle", name) for name in ("__generator_ctor", "__bit_generator_ctor")),
    ("numpy.random._pcg64", "PCG64"),
    *(("numpy.random.bit_generator", name) for name in ("SeedSequence", "__pyx_unpickle_SeedSequence")),
    *((module, name) for module in ("pathlib", "pathlib._local") for name in ("Path", "PosixPath", "WindowsPath")),
}


class _StateUnpickler(DataUnpickler):
    packages, registered, others, refusal = _PACKAGES, (), _OTHERS, "{} does not belong into a checkpoint"


def to_bytes(value: Any) -> bytes:
    """Anything that consists of data, which has been read back; ParameterError with what is none, or :func:`from_bytes` would refuse."""
    try:
        content = pickle.dumps(value, protocol=5)
    except (pickle.PicklingError, TypeError, AttributeError) as error:
        raise ParameterError(str(error)) from None
    from_bytes(content)
    return content


def from_bytes(content: bytes) -> Any:
    """What :func:`to_bytes` was given; no code is run, whoever wrote it; ParameterError if it is none."""
    try:
        return _StateUnpickler(io.BytesIO(content)).load()
    except (pickle.UnpicklingError, EOFError, AttributeError, ImportError, IndexError, KeyError, TypeError, ValueError) as error:
        raise ParameterError(str(error)) from None


def recorded(state: DeckState) -> dict[str, Any]:
    """What the runs until now have made of a deck, to be stored at once: it is not a copy."""
    return {name: getattr(state, name) for name in PARTS}


def recall(state: DeckState, parts: dict[str, Any]) -> None:
    """Bring a deck to where its runs had brought it."""
    for dump in state.dumps.values():
        dump.close()  # it is replaced
    for name in PARTS:
        setattr(state, name, parts[name])


_LOGGER = logging.getLogger("openmm_dpd")
#: Name of the folder.
FOLDER = "checkpoint"
#: The newest checkpoint, and the one before.
_KEPT = ("latest", "before")
#: Options that a resumed run may have anew: they do not change what is computed.
_FREE = ("threads", "checkpoint")


@dataclass(frozen=True)
class Latest:
    """Where a deck was interrupted.  Its file, the RunOptions, variables of the command line, the SHA-256 of each file that was read, what
    :meth:`openmm_dpd.base.file_ledger.FileLedger.put_back` needs, how many runs are done, the one that was interrupted (None between two
    runs), and what the caller was asked for beside all this, such as a file for the report."""

    deck: str
    options: dict[str, Any]
    variables: dict[str, str]
    inputs: dict[str, str]
    files: dict[str, Any]
    runs: int
    present: dict[str, Any] | None
    asked: dict[str, Any]

    def merged(self, options: RunOptions) -> RunOptions:
        """The options of the run to be resumed; ParameterError if others were asked for."""
        given = {name: value for name, value in asdict(options).items() if value != getattr(RunOptions, name)}
        self.check_given(given)
        return RunOptions(**self.options | {name: value for name, value in given.items() if name in _FREE})

    def check_given(self, given: Mapping[str, Any]) -> None:
        """ParameterError if one of the options is not that of the run to be resumed."""
        for name, value in given.items():
            if name not in _FREE and value != self.options[name]:
                had = "none" if self.options[name] is None else self.options[name]
                raise ParameterError(f"--{name} {value} cannot be combined with --restart: the interrupted run had {had}; leave it out")

    def check(self, deck: Path, variables: Mapping[str, str]) -> None:
        """ParameterError if it is another deck now, or reads other files, or has other variables."""
        if variables and dict(variables) != self.variables:
            raise ParameterError(f"--var cannot be changed by --restart: the interrupted run had {self.variables or 'none'}; leave it out")
        for name, before in self.inputs.items():
            path = deck if name == self.deck else Path(name)
            if digest(path) != before:
                what = "is not the deck of the interrupted run" if name == self.deck else "is not what the interrupted run has read"
                raise ParameterError(f"--restart: {path} {what}, or has changed since; put it back, or begin anew without --restart")


class Checkpoints:
    """The checkpoints of one deck in the folder of its results, and the ledger of what is written there; ``asked``: see :class:`Latest`."""

    def __init__(self, out: Path, asked: Mapping[str, Any] | None = None):
        self.folder, self._asked = out / FOLDER, dict(asked or {})
        self.ledger = FileLedger(out, self.folder / "files")
        self._latest_is_bad = ""

    @staticmethod
    def at(place: Path) -> Path:
        """Folder of the results from what ``--restart`` says: that folder, its checkpoint, or a file of that."""
        folder = place.parent if place.is_file() else place
        folder = folder.parent if folder.name == FOLDER else folder
        if not any((folder / FOLDER / name).is_file() for name in _KEPT):
            done = " (a run that has come to its end has none any more)" if folder.is_dir() else ""
            raise ParameterError(f"--restart: there is no checkpoint in {folder}{done}; give the --out folder of the interrupted run")
        return folder

    # -- writing ------------------------------------------------------------------------------------------------------------------
    def save(self, state: DeckState, options: RunOptions, variables: dict[str, str], kept: dict[str, Any], *, done: bool) -> None:
        """Store what a run has made of the deck: the next one, which is done or which is interrupted here."""
        if done:
            self._write(f"run-{state.runs + 1}", kept)
        with writing(self.folder, "the checkpoint"):
            place = str(state.path.resolve()), asdict(options), variables, state.inputs, self.ledger.lengths()
        self._write("latest", vars(Latest(*place, state.runs + done, None if done else kept, self._asked)))

    def _write(self, name: str, content: dict[str, Any]) -> None:
        path, whole = self.folder / name, sealed(to_bytes(content))
        with writing(self.folder, "the checkpoint"):
            self.folder.mkdir(parents=True, exist_ok=True)
            if name == "latest" and path.exists():
                os.replace(path, self.folder / "before")
        write_whole(path, whole, "the checkpoint")
        with writing(path, "the checkpoint"), open(path, "r+b") as stream:
            os.fsync(stream.fileno())  # the next one may replace the one before

    def remedy(self, deck: Path, reason: str | None) -> str:
        """How an interrupted run can go on, as a command that can be copied, if it can."""
        if any((self.folder / name).exists() for name in _KEPT):
            before = "" if reason is None else f"from before the run that cannot be resumed ({reason}), "
            return f"{before}go on with: openmm-dpd run {shlex.quote(str(deck))} --restart {shlex.quote(str(self.folder.parent))}"
        return f"it cannot be resumed: {reason or 'nothing had been computed'}"

    def clear(self) -> None:
        """Take all of it away: there is nothing to resume."""
        if self.folder.is_dir():
            for name in (*_KEPT, "run-*", "files*", ".latest.*.tmp", ".run-*.tmp"):
                for path in self.folder.glob(name):
                    path.unlink(missing_ok=True)
            with suppress(OSError):
                self.folder.rmdir()

    def resume(self, latest: Latest) -> None:
        """Make all files what they were, and keep them so until the ledger's ``replaying`` ends."""
        self.ledger.put_back(latest.files)
        if self._latest_is_bad:
            _LOGGER.warning("%s; the run goes on from the one before", self._latest_is_bad)
            os.replace(self.folder / "before", self.folder / "latest")
        self.ledger.replaying = True

    # -- reading ------------------------------------------------------------------------------------------------------------------
    def latest(self) -> Latest:
        """Where the deck was interrupted, by the newest checkpoint of which nothing is damaged."""
        wrong = ""
        for name in _KEPT:
            try:
                found = Latest(**self.read(name))
                # a state that was read by read_restart counts the runs before it, which have no files here
                first = min((int(path.name[4:]) for path in self.folder.glob("run-*")), default=found.runs + 1)
                for number in range(first, found.runs + 1):
                    unsealed(self.folder / f"run-{number}")
                self._latest_is_bad = wrong.partition("; ")[0]
                return found
            except ParameterError as error:
                wrong = wrong or str(error)
        raise ParameterError(wrong)

    def read(self, name: str) -> dict[str, Any]:
        """What one of the files holds."""
        content = unsealed(self.folder / name)
        try:
            return from_bytes(content)
        except ParameterError as error:
            raise ParameterError(f"--restart: {self.folder / name} is no checkpoint of this version ({error})") from None
