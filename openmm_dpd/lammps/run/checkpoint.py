"""Checkpoints of a deck: the progress of its runs and what they changed, in a subfolder of the results.

``run-K`` stores the state after the K-th run, written once at its end.  ``latest`` stores the number of completed runs, the position in the
present one, and the lengths of all files; it is renamed to ``before`` when the next one is written.  Each file is read back before it is
written, and has a checksum: if ``latest`` or a run is damaged, ``before`` is used.  To resume, the deck is read again from its first line;
completed runs are recalled instead of carried out, and nothing is written until the position of the checkpoint is reached.  So loops,
formulas and conditions need no special treatment.
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
from .adapting import put
from .options import RunOptions

#: Attributes of :class:`~openmm_dpd.lammps.state.deck_state.DeckState` that runs change, directly or in part: beads and box, averages,
#: dumps and computes with memory, random numbers of formulas.  Changes by commands are not stored: commands are carried out again.
PARTS = (
    *("atoms", "box", "step", "noise_counter", "restarts", "time_origin", "last_sample", "generators", "notes"),
    *("fixes", "computes", "dumps", "groups", "dynamic", "bonds", "angles", "dihedrals", "before"),
)

#: Modules whose classes may be in a checkpoint, besides plain values.  They hold data only, so unpickling them is safe.
_PACKAGES = tuple(
    f"openmm_dpd.{name}"
    for name in ("model.", "base.units", *(f"lammps.{part}." for part in "language state output values styles".split()))
)

#: Objects of numpy and the standard library that may be in a checkpoint.
_OTHERS = ARRAYS | {
    ("builtins", "range"),
    ("collections", "deque"),
    *(("numpy.random._pickle", name) for name in ("__generator_ctor", "__bit_generator_ctor")),
    ("numpy.random._pcg64", "PCG64"),
    *(("numpy.random.bit_generator", name) for name in ("SeedSequence", "__pyx_unpickle_SeedSequence")),
    *((module, name) for module in ("pathlib", "pathlib._local") for name in ("Path", "PosixPath", "WindowsPath")),
}


class _StateUnpickler(DataUnpickler):
    packages, registered, others, refusal = _PACKAGES, (), _OTHERS, "{} does not belong in a checkpoint"


def to_bytes(value: Any) -> bytes:
    """Pickle plain data, after checking that it can be read back.  ParameterError with the first object that :func:`from_bytes` would
    reject."""
    try:
        content = pickle.dumps(value, protocol=5)
    except (pickle.PicklingError, TypeError, AttributeError) as error:
        raise ParameterError(str(error)) from None
    from_bytes(content)
    return content


def from_bytes(content: bytes) -> Any:
    """Restore the data from :func:`to_bytes` without running any code, whatever the origin of ``content``.  ParameterError if it is
    invalid."""
    try:
        return _StateUnpickler(io.BytesIO(content)).load()
    except (pickle.UnpicklingError, EOFError, AttributeError, ImportError, IndexError, KeyError, TypeError, ValueError) as error:
        raise ParameterError(str(error)) from None


def recorded(state: DeckState) -> dict[str, Any]:
    """The parts of a deck that its runs have changed, for immediate storage: they are not copied."""
    return {name: getattr(state, name) for name in PARTS}


def recall(state: DeckState, parts: dict[str, Any]) -> None:
    """Restore the parts of a deck that its runs had changed."""
    for dump in state.dumps.values():
        dump.close()  # replaced below
    for name in PARTS:
        setattr(state, name, parts[name])
    for fix in state.fixes_of("adapt"):
        put(state, fix.parameters.get("now", {}))


_LOGGER = logging.getLogger("openmm_dpd")
#: Name of the checkpoint folder.
FOLDER = "checkpoint"
#: The latest checkpoint and the previous one.
_KEPT = ("latest", "before")
#: Options that may change when a run is resumed: they do not affect the results.
_FREE = ("threads", "checkpoint")


@dataclass(frozen=True)
class Latest:
    """Where a deck was interrupted: its file, the RunOptions, variables of the command line, the SHA-256 of each file read, the input of
    :meth:`openmm_dpd.base.file_ledger.FileLedger.put_back`, the number of completed runs, the interrupted run (None between two runs), and
    other requests of the caller, such as a file for the report."""

    deck: str
    options: dict[str, Any]
    variables: dict[str, str]
    inputs: dict[str, str]
    files: dict[str, Any]
    runs: int
    present: dict[str, Any] | None
    asked: dict[str, Any]

    def merged(self, options: RunOptions) -> RunOptions:
        """The options of the resumed run.  ParameterError if the given ones differ."""
        given = {name: value for name, value in asdict(options).items() if value != getattr(RunOptions, name)}
        self.check_given(given)
        return RunOptions(**self.options | {name: value for name, value in given.items() if name in _FREE})

    def check_given(self, given: Mapping[str, Any]) -> None:
        """Raise ParameterError if an option differs from that of the interrupted run."""
        for name, value in given.items():
            if name not in _FREE and value != self.options[name]:
                had = "none" if self.options[name] is None else self.options[name]
                raise ParameterError(f"--{name} {value} cannot be combined with --restart: the interrupted run had {had}; omit the option")

    def check(self, deck: Path, variables: Mapping[str, str]) -> None:
        """Raise ParameterError if the deck, a file that it reads, or a variable has changed."""
        if variables and dict(variables) != self.variables:
            raise ParameterError(
                f"--var cannot be changed by --restart: the interrupted run had {self.variables or 'none'}; omit the option"
            )
        for name, before in self.inputs.items():
            path = deck if name == self.deck else Path(name)
            if digest(path) != before:
                what = "is not the deck of the interrupted run" if name == self.deck else "is not the file that the interrupted run read"
                raise ParameterError(f"--restart: {path} {what}, or has changed since; restore it, or start again without --restart")


class Checkpoints:
    """The checkpoints of a deck in the folder of its results, and the ledger of its output files; ``asked``: see :class:`Latest`."""

    def __init__(self, out: Path, asked: Mapping[str, Any] | None = None):
        self.folder, self._asked = out / FOLDER, dict(asked or {})
        self.ledger = FileLedger(out, self.folder / "files")
        self._latest_is_bad = ""

    @staticmethod
    def at(place: Path) -> Path:
        """Folder of the results, from the argument of ``--restart``: that folder, its checkpoint folder, or a file in it."""
        folder = place.parent if place.is_file() else place
        folder = folder.parent if folder.name == FOLDER else folder
        if not any((folder / FOLDER / name).is_file() for name in _KEPT):
            done = " (completed runs have none)" if folder.is_dir() else ""
            raise ParameterError(f"--restart: there is no checkpoint in {folder}{done}; give the --out folder of the interrupted run")
        return folder

    # -- writing ------------------------------------------------------------------------------------------------------------------
    def save(
        self, state: DeckState, options: RunOptions, variables: dict[str, str], kept: dict[str, Any], *, done: bool, whole: bool = True
    ) -> None:
        """Store the state after a run (``done``), or within one.  A run whose final state is in no file (not ``whole``) is done again."""
        if done:
            self._write(f"run-{state.runs + 1}", kept)
        if not whole:
            return
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
            os.fsync(stream.fileno())  # the next checkpoint may replace the previous one

    def remedy(self, deck: Path, reason: str | None) -> str:
        """How to continue an interrupted run, as a command to copy, if it can be resumed."""
        if any((self.folder / name).exists() for name in _KEPT):
            before = "" if reason is None else f"from before the run that cannot be resumed ({reason}), "
            return f"{before}continue with: openmm-dpd run {shlex.quote(str(deck))} --restart {shlex.quote(str(self.folder.parent))}"
        return f"it cannot be resumed: {reason or 'nothing had been computed'}"

    def clear(self) -> None:
        """Delete all checkpoints."""
        if self.folder.is_dir():
            for name in (*_KEPT, "run-*", "files*", ".latest.*.tmp", ".run-*.tmp"):
                for path in self.folder.glob(name):
                    path.unlink(missing_ok=True)
            with suppress(OSError):
                self.folder.rmdir()

    def resume(self, latest: Latest) -> None:
        """Restore all output files, and protect them until the ledger's ``replaying`` ends."""
        self.ledger.put_back(latest.files)
        if self._latest_is_bad:
            _LOGGER.warning("%s; the run continues from the previous one", self._latest_is_bad)
            os.replace(self.folder / "before", self.folder / "latest")
        self.ledger.replaying = True

    # -- reading ------------------------------------------------------------------------------------------------------------------
    def latest(self) -> Latest:
        """Where the deck was interrupted, from the newest undamaged checkpoint."""
        wrong = ""
        for name in _KEPT:
            try:
                found = Latest(**self.read(name))
                # a state from read_restart counts earlier runs, which have no files here
                first = min((int(path.name[4:]) for path in self.folder.glob("run-*")), default=found.runs + 1)
                for number in range(first, found.runs + 1):
                    unsealed(self.folder / f"run-{number}")
                self._latest_is_bad = wrong.partition("; ")[0]
                return found
            except ParameterError as error:
                wrong = wrong or str(error)
        raise ParameterError(wrong)

    def read(self, name: str) -> dict[str, Any]:
        """Content of one of the files."""
        content = unsealed(self.folder / name)
        try:
            return from_bytes(content)
        except ParameterError as error:
            raise ParameterError(f"--restart: {self.folder / name} is not a checkpoint of this version ({error})") from None
