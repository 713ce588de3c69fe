"""Writing files so that a full disk destroys nothing: whole files, whole blocks, or a clear error."""

from __future__ import annotations

import errno
import hashlib
import os
import threading
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

from .errors import OutputError
from .file_ledger import ledger_in_use

#: Remedies by the kind of error; for all others, writing elsewhere.
_REMEDIES = {
    errno.ENOSPC: "free some space there, or write elsewhere",
    errno.EDQUOT: "free some of your quota there, or write elsewhere",
    errno.EFBIG: "it would be longer than files of this process may be (ulimit -f)",
}


@contextmanager
def writing(path: str | os.PathLike, what: str) -> Iterator[None]:
    """Turn an OSError in the block into an OutputError with what could not be written, where, why, and what to do."""
    try:
        yield
    except OSError as error:
        remedy = _REMEDIES.get(error.errno or 0, "write elsewhere")
        raise OutputError(f"{what} {os.fspath(path)} cannot be written ({error.strerror or error}); {remedy}") from None


def digest(path: Path) -> str:
    """SHA-256 of a file in hexadecimal digits; empty if it cannot be read."""
    with suppress(OSError):
        return hashlib.sha256(path.read_bytes()).hexdigest()
    return ""


def write_whole(path: str | os.PathLike, content: str | bytes, what: str) -> None:
    """Write a file whole, replacing an existing one, or leave that as it is.

    Parameters
    ----------
    path : path-like
    content : str or bytes
        Text is written in UTF-8.
    what : str
        Name of the content in the error, such as ``the report``.

    Raises
    ------
    OutputError
        If the file cannot be written; nothing is left behind.
    """
    data = content.encode() if isinstance(content, str) else content
    ledger = ledger_in_use()
    if ledger is not None and ledger.replaying:
        return  # the file exists already
    # a link remains a link
    target = Path(os.path.realpath(path))
    with writing(path, what):
        if ledger is not None:
            ledger.touch(target, grows=False, anew=True)
        if target.exists() and not target.is_file():
            with open(target, "wb", buffering=0) as stream:  # a device or a pipe has nothing to keep
                _write_all(stream, data)
            return
        beside = target.with_name(f".{target.name[:100]}.{os.getpid()}.{threading.get_ident()}.tmp")
        try:
            with open(beside, "wb", buffering=0) as stream:
                _write_all(stream, data)
            os.replace(beside, target)
        except BaseException:
            with suppress(OSError):
                beside.unlink()
            raise


class BlockFile:
    """A file that grows by whole blocks: if a block cannot be written to its end, the file is left as before.

    Parameters
    ----------
    path : path-like
    what : str
        Name of the content in errors.
    append : bool, default False
        Append to an existing file.

    Raises
    ------
    OutputError
        If the file cannot be opened; raised by all methods if they cannot write.
    """

    def __init__(self, path: str | os.PathLike, what: str, append: bool = False):
        self.path, self._what, self._ledger = path, what, ledger_in_use()
        with writing(path, what):
            if self._ledger is not None:
                self._ledger.touch(path, grows=True, anew=not append)
            self._stream = open(path, "wb", buffering=0, opener=_opener(append or self._replaying))

    @property
    def _replaying(self) -> bool:
        return self._ledger is not None and self._ledger.replaying

    def __enter__(self) -> BlockFile:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def write(self, block: str | bytes) -> None:
        """Append a block."""
        if self._replaying:
            return
        stream = self._stream
        with writing(self.path, self._what):
            end = stream.seek(0, os.SEEK_END) if stream.seekable() else None
            try:
                _write_all(stream, block.encode() if isinstance(block, str) else block)
            except BaseException:
                if end is not None:
                    stream.truncate(end)
                raise

    def replace(self, start: int, part: bytes) -> None:
        """Overwrite existing bytes from ``start`` on."""
        if self._replaying:
            return
        with writing(self.path, self._what):
            self._stream.seek(start)
            _write_all(self._stream, part)

    def close(self) -> None:
        """Close the file."""
        with writing(self.path, self._what):
            self._stream.close()


def _opener(keeping: bool):
    """Opener for writing anywhere in a file: keeping its content, or truncated."""
    flags = os.O_WRONLY | os.O_CREAT | getattr(os, "O_BINARY", 0) | (0 if keeping else os.O_TRUNC)
    return lambda path, _: os.open(path, flags, 0o666)


def append_block(path: str | os.PathLike, block: str, what: str, *, anew: bool = False) -> None:
    """Append a block to a file (or to a new one if ``anew``), opening and closing it; OutputError if this fails."""
    with BlockFile(path, what, append=not anew) as file:
        file.write(block)


def _write_all(stream, data: bytes) -> None:
    """Write all data to an unbuffered file, which may take only parts at a time."""
    rest = memoryview(data)
    while rest:
        rest = rest[stream.write(rest) :]
