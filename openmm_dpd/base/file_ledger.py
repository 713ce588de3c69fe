"""Files that a run has written, and their lengths at a checkpoint, so that a resumed run finds them as they were then."""

import hashlib
import json
import os
import re
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from contextvars import ContextVar
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from .errors import OutputError, ParameterError

#: Name and version of the layout of restart files, which begin with it.
LAYOUT = b"openmm-dpd checkpoint 3"


def sealed(content: bytes) -> bytes:
    """The content after a line with the layout and a checksum, to be read by :func:`unsealed`."""
    return LAYOUT + b" " + hashlib.sha256(content).hexdigest().encode() + b"\n" + content


def unsealed(path: Path) -> bytes:
    """Content of a file from :func:`sealed`; ParameterError if it is damaged, missing, or of another version."""
    whole = b""
    with suppress(OSError):
        whole = path.read_bytes()
    content = whole.partition(b"\n")[2]
    if whole != sealed(content):
        layout = re.findall(rb"openmm-dpd checkpoint \d+", whole[:99])
        other = layout and layout[0] != LAYOUT and f"was written by another version ({layout[0].decode()}, not {LAYOUT[-1:].decode()})"
        wrong = other or "is missing, damaged or no checkpoint"
        raise ParameterError(f"--restart: {path} {wrong}; put back the original file, or start anew without --restart")
    return content


@dataclass
class _Entry:
    """One file: whether it grows (or is written whole), how often it was started, its length before the first time, the start of the part
    at its end that the next block overwrites, and the length that is known to be on the disk."""

    grows: bool
    begun: int
    before: int | None
    tail: int | None = None
    safe: int | None = None


class FileLedger:
    """The files of a run.  All functions in :mod:`openmm_dpd.base.files` report to the ledger in use.

    At a restart, growing files are truncated to the checkpoint; files that are written whole, or were started anew since, are written
    again.  A file is noted in ``journal`` on disk before it is first written, so that this works after a run was killed, too.  Files in
    ``root``, the folder of the results, are named relative to it; other files in the journal's folder do not belong to the run.  While
    ``replaying``, up to the point of interruption, nothing is written, since the files have it already.
    """

    def __init__(self, root: Path, journal: Path):
        self.root, self.journal, self.replaying = Path(os.path.abspath(root)), Path(os.path.abspath(journal)), False
        self._entries: dict[str, _Entry] = {}
        self._noted = b""

    @contextmanager
    def in_use(self) -> Iterator[None]:
        """Record all files that are written within the block."""
        before = _LEDGER.set(self)
        try:
            yield
        finally:
            _LEDGER.reset(before)

    # -- reports ------------------------------------------------------------------------------------------------------------------
    def touch(self, path: str | os.PathLike, *, grows: bool, anew: bool) -> None:
        """Note a file that will be written: whether it grows, or is started anew."""
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
        self._note({name: entry})

    def tail(self, path: str | os.PathLike, start: int) -> None:
        """Note the start of the part at the end of a growing file that the next block overwrites."""
        entry = self._entries.get(self._name(path))
        if entry is not None:
            entry.tail = start

    def _name(self, path: str | os.PathLike) -> str:
        whole = os.path.abspath(path)
        return os.path.relpath(whole, self.root) if Path(whole).is_relative_to(self.root) else whole

    def _note(self, entries: dict[str, _Entry]) -> None:
        for name, entry in entries.items():
            self._noted += json.dumps([name, entry.grows, entry.begun, entry.before]).encode() + b"\n"
        self.journal.parent.mkdir(parents=True, exist_ok=True)
        beside = self.journal.with_name(f"{self.journal.name}.new")
        beside.write_bytes(sealed(self._noted))
        os.replace(beside, self.journal)

    # -- checkpoints --------------------------------------------------------------------------------------------------------------
    def lengths(self) -> dict[str, dict[str, Any]]:
        """State of the present files for :meth:`put_back`, after flushing them to the disk."""
        found: dict[str, dict[str, Any]] = {}
        for name, entry in self._entries.items():
            path = self.root / name
            found[name] = {"grows": entry.grows, "begun": entry.begun, "before": entry.before}
            if entry.grows and path.is_file():
                with open(path, "rb") as stream:
                    length = stream.seek(0, os.SEEK_END)
                    if length != entry.safe and os.name != "nt":  # Windows needs files open for writing
                        os.fsync(stream.fileno())
                    entry.safe = length
                    stream.seek(length if entry.tail is None else entry.tail)
                    found[name] |= {"length": length, "tail": stream.read()}
        return found

    def put_back(self, lengths: dict[str, dict[str, Any]]) -> None:
        """Restore the files to their state at :meth:`lengths`, and continue from there.  OutputError if a file is missing or shorter than
        it was; ParameterError if the journal is damaged."""
        now = self._read_journal()
        for name, was in lengths.items():
            path, present = self.root / name, now.get(name, (True, was["begun"]))[:2]
            tail = was["length"] - len(was["tail"]) if was.get("tail") else None
            self._entries[name] = _Entry(was["grows"], present[1], was["before"], tail)
            if not was["grows"] or "length" not in was or present != (True, was["begun"]):
                continue  # it will be written anew, even if the run is killed before
            size = path.stat().st_size if path.is_file() else 0
            if size < was["length"]:
                raise OutputError(
                    f"{path} has {size} bytes, but had {was['length']} at the checkpoint: the run cannot continue; put the file back"
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
        self._noted = b""
        self._note(self._entries)

    def _read_journal(self) -> dict[str, tuple[bool, int, int | None]]:
        """For each file: whether it grows, how often it was started, and its length before the first time."""
        found: dict[str, tuple[bool, int, int | None]] = {}
        for name, grows, begun, before in map(json.loads, unsealed(self.journal).splitlines()):
            found[name] = (grows, begun, found[name][2] if name in found else before)
        return found


_LEDGER: ContextVar[FileLedger | None] = ContextVar("ledger", default=None)


def ledger_in_use() -> FileLedger | None:
    """The ledger in use, or None."""
    return _LEDGER.get()
