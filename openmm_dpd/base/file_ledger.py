"""Which files a run has written, and how long they were at a checkpoint: so that a run that is resumed finds them as they were then."""

import json
import os
from collections.abc import Iterator
from contextlib import contextmanager
from contextvars import ContextVar
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from .errors import OutputError


@dataclass
class _Entry:
    """One file: whether it grows (or is written whole), how often it was begun, its length before the first time, and where the part at
    its end begins that the next block overwrites."""

    grows: bool
    begun: int
    before: int | None
    tail: int | None = None


class FileLedger:
    """The files of a run.  Everything in :mod:`openmm_dpd.base.files` reports to the ledger that is in use.

    Files that grow are cut back to a checkpoint; files that are written whole, and those that were begun anew since, will be written
    again.  What is touched for the first time is noted on disk before, in ``journal``, so that this holds after a run was killed as well.
    Names of files in ``root``, the folder of the results, are kept relative to it; other files of the journal's folder are none of the run.
    While ``replaying``, a run is on its way to where it was interrupted: nothing is written, what comes there is in the files already.
    """

    def __init__(self, root: Path, journal: Path):
        self.root, self.journal, self.replaying = Path(os.path.abspath(root)), Path(os.path.abspath(journal)), False
        self._entries: dict[str, _Entry] = {}

    @contextmanager
    def in_use(self) -> Iterator[None]:
        """Take the reports of all files that are written within."""
        before = _LEDGER.set(self)
        try:
            yield
        finally:
            _LEDGER.reset(before)

    # -- reports ------------------------------------------------------------------------------------------------------------------
    def touch(self, path: str | os.PathLike, *, grows: bool, anew: bool) -> None:
        """Take note of a file that will be written."""
        if self.replaying or (os.path.exists(path) and not os.path.isfile(path)):  # a device or a pipe has nothing to keep
            return
        name = self._name(path)
        if (self.root / name).parent == self.journal.parent:
            return
        entry = self._entries.get(name)
        if entry is not None and entry.grows == grows and not (anew and grows):
            return
        if entry is None:
            before = os.path.getsize(path) if os.path.exists(path) and not anew else None
            entry = self._entries[name] = _Entry(grows, 1, before)
        else:
            entry.grows, entry.begun, entry.tail = grows, entry.begun + 1, None
        self._note(name, entry)

    def tail(self, path: str | os.PathLike, start: int) -> None:
        """Take note of where the part at the end of a growing file begins that the next block overwrites."""
        entry = self._entries.get(self._name(path))
        if entry is not None:
            entry.tail = start

    def holds(self, path: str | os.PathLike) -> bool:
        """Whether the run itself has written a file."""
        return self._name(path) in self._entries

    def _name(self, path: str | os.PathLike) -> str:
        whole = os.path.abspath(path)
        return os.path.relpath(whole, self.root) if Path(whole).is_relative_to(self.root) else whole

    def _note(self, name: str, entry: _Entry) -> None:
        self.journal.parent.mkdir(parents=True, exist_ok=True)
        with open(self.journal, "a", encoding="utf-8") as stream:
            stream.write(_line(name, entry))

    # -- checkpoints --------------------------------------------------------------------------------------------------------------
    def lengths(self) -> dict[str, dict[str, Any]]:
        """What :meth:`put_back` needs to know of the present files."""
        found: dict[str, dict[str, Any]] = {}
        for name, entry in self._entries.items():
            path = self.root / name
            found[name] = {"grows": entry.grows, "begun": entry.begun, "before": entry.before}
            if entry.grows and path.is_file():
                found[name] |= {"length": path.stat().st_size, "tail": _end(path, entry.tail)}
        return found

    def put_back(self, lengths: dict[str, dict[str, Any]]) -> None:
        """Make the files what they were when :meth:`lengths` was asked, and go on from there.  OutputError if a file has gone, or is
        shorter than it was."""
        now = self._read_journal()
        self.journal.parent.mkdir(parents=True, exist_ok=True)
        for name, was in lengths.items():
            path = self.root / name
            if not was["grows"] or "length" not in was or now.get(name, (True, was["begun"]))[:2] != (True, was["begun"]):
                continue  # it will be written anew
            size = path.stat().st_size if path.is_file() else 0
            if size < was["length"]:
                raise OutputError(
                    f"{path} has {size} bytes, and had {was['length']} at the checkpoint: the run cannot go on with it; put the file back"
                )
            with open(path, "r+b") as stream:
                stream.truncate(was["length"])
                stream.seek(was["length"] - len(was["tail"]))
                stream.write(was["tail"])
        for name, (grows, _, before) in now.items():
            path = self.root / name
            if name in lengths or not grows or not path.is_file():
                continue
            if before is None:
                path.unlink()
            else:
                os.truncate(path, min(before, path.stat().st_size))
        self._entries = {
            name: _Entry(was["grows"], was["begun"], was["before"], was["length"] - len(was["tail"]) if was.get("tail") else None)
            for name, was in lengths.items()
        }
        beside = self.journal.with_name(f"{self.journal.name}.new")
        beside.write_text("".join(_line(name, entry) for name, entry in self._entries.items()), encoding="utf-8")
        os.replace(beside, self.journal)

    def _read_journal(self) -> dict[str, tuple[bool, int, int | None]]:
        """For each file whether it grows, how often it was begun, and its length before the first time."""
        found: dict[str, tuple[bool, int, int | None]] = {}
        for line in self.journal.read_text(encoding="utf-8").splitlines() if self.journal.exists() else ():
            try:
                name, grows, begun, before = json.loads(line)
            except ValueError:
                continue  # cut short together with the run
            found[name] = (grows, begun, found[name][2] if name in found else before)
        return found


def _line(name: str, entry: _Entry) -> str:
    return json.dumps([name, entry.grows, entry.begun, entry.before]) + "\n"


def _end(path: Path, start: int | None) -> bytes:
    if start is None:
        return b""
    with open(path, "rb") as stream:
        stream.seek(start)
        return stream.read()


_LEDGER: ContextVar[FileLedger | None] = ContextVar("ledger", default=None)


def ledger_in_use() -> FileLedger | None:
    """The ledger that takes reports now."""
    return _LEDGER.get()
