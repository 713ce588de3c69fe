"""Where compiled kernels are kept on disk: in a folder of the user's own, or nowhere.

What is in the files is unpickled and run, so a folder that somebody else can write to is not used.  A cache that is full or damaged is
never in the way: the kernels are compiled, and that is said once.
"""

import functools
import hashlib
import logging
import os
import pickle
import stat
import sys
import tempfile
from contextlib import suppress
from pathlib import Path
from typing import Any

import numba

from .errors import OutputError
from .files import write_whole
from .numba_private import NullCache, dumps, packed, set_cache, unpacked
from .signals import CTRL_C

_LOGGER = logging.getLogger("openmm_dpd")
_REMEDY = "set NUMBA_CACHE_DIR to a folder of your own"
#: Bytes of the hash in front of every file.
_SEAL = hashlib.sha256().digest_size
#: What was said already, once in the life of the process.
_SAID: set[str] = set()


def _say(topic: str, text: str) -> None:
    """Say something on a topic for the first time."""
    if topic not in _SAID:
        _SAID.add(topic)
        _LOGGER.warning(text)


def why_unusable(folder: Path) -> str | None:
    """Why compiled code cannot be kept in a folder, which is made if it is not there; None if it can."""
    try:
        folder.parent.mkdir(parents=True, exist_ok=True)
        if not os.path.lexists(folder):
            folder.mkdir(mode=0o700, exist_ok=True)
        found = os.lstat(folder)
        if not stat.S_ISDIR(found.st_mode):
            return "it is a link or a file, not a folder"
        if hasattr(os, "geteuid"):
            if found.st_uid != os.geteuid():
                return "it belongs to another user"
            if found.st_mode & (stat.S_IWGRP | stat.S_IWOTH):
                return "others can write to it"
            for parent in folder.resolve().parents:
                mode = parent.stat().st_mode
                if mode & stat.S_IWOTH and not mode & stat.S_ISVTX:
                    return f"others can write to {parent}"
        tempfile.TemporaryFile(dir=folder).close()
    except OSError as error:
        return error.strerror or str(error)
    return None


def _candidates() -> list[Path]:
    """Folders for the cache, the best one first.  Beside the package it would survive an uninstall and shadow the next installation."""
    given = numba.config.CACHE_DIR  # type: ignore[attr-defined]
    if given:
        return [Path(given)]
    user = os.getuid() if hasattr(os, "getuid") else "cache"
    found = []
    for make in (
        lambda: Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache") / "openmm_dpd" / "kernels",
        lambda: Path(tempfile.gettempdir()) / f"openmm_dpd-{user}",
    ):
        try:
            found.append(make())
        except (RuntimeError, OSError):  # no home, or no folder for temporary files
            continue
    return found


@functools.cache
def cache_folder() -> Path | None:
    """The folder that compiled kernels are kept in; None, with one message, if there is none.

    ``NUMBA_CACHE_DIR`` if that is set, else ``openmm_dpd/kernels`` in the user's cache folder, else one in the folder for temporary files;
    whichever belongs to the user and can be written by nobody else.
    """
    refused = []
    for folder in _candidates():
        why = why_unusable(folder)
        if why is None:
            return folder
        refused.append(f"{folder}: {why}")
    reasons = "; ".join(refused) or "there is neither a home nor a folder for temporary files"
    _say("place", f"kernels are compiled at every start, since there is no place to keep them ({reasons}); {_REMEDY}")
    return None


class KernelFiles:
    """The files of one kernel, one for each signature and machine: a hash, then the pickled key and code.

    Their names begin with ``name``; ``stamp`` is what must be unchanged for a file to be found, such as the kernel's source.
    """

    def __init__(self, folder: str | os.PathLike, name: str, stamp: Any):
        self.folder, self.name, self.stamp = Path(folder), name, (stamp, numba.__version__, sys.implementation.cache_tag)

    def _path(self, key: Any) -> Path:
        return self.folder / f"{self.name}.{hashlib.sha256(repr((key, self.stamp)).encode()).hexdigest()[:16]}.kernel"

    def load(self, key: Any) -> Any:
        """What was saved, or None."""
        try:
            content = self._path(key).read_bytes()
        except FileNotFoundError:
            return None
        seal, payload = content[:_SEAL], content[_SEAL:]
        if hashlib.sha256(payload).digest() != seal:
            raise ValueError(f"{self._path(key).name} is damaged")
        found, data = pickle.loads(payload)
        return data if found == (key, self.stamp) else None

    def save(self, key: Any, data: Any) -> None:
        """Save what :meth:`load` finds."""
        payload = dumps(((key, self.stamp), data))
        write_whole(self._path(key), hashlib.sha256(payload).digest() + payload, "the compiled kernel")


class KernelCache(NullCache):
    """A cache for numba in :class:`KernelFiles`: what it cannot load is compiled anew, what it cannot save is not kept."""

    def __init__(self, folder: Path, function) -> None:
        code = function.__code__
        source: Any = ()  # the package's own kernels have the digest of their sources in their names
        if Path(code.co_filename).parent != Path(__file__).parent.parent / "kernels":
            found = os.stat(code.co_filename)
            source = code.co_filename, code.co_firstlineno, found.st_mtime, found.st_size
        stamp = source, hashlib.sha256(code.co_code).hexdigest()
        self._files = KernelFiles(folder, function.__name__, stamp)

    def load_overload(self, sig, target_context):
        """The compiled function, or None."""
        CTRL_C.check()  # to compile all that a step calls may take a minute
        try:
            target_context.refresh()
            data = self._files.load((sig, target_context.codegen().magic_tuple()))
            return None if data is None else unpacked(target_context, data)
        except Exception as error:  # what is pickled badly can fail in any way
            _say("read", f"compiled kernels in {cache_folder()} cannot be read ({error}); they are compiled anew, and replaced")
            return None

    def save_overload(self, sig, data):
        """Keep a compiled function, if that is possible."""
        try:
            if not data.library.has_dynamic_globals:
                self._files.save((sig, data.codegen.magic_tuple()), packed(data))
        except (OutputError, OSError) as error:
            _say("save", f"kernels are compiled at every start, since they cannot be kept: {error} ({_REMEDY})")


def keep_on_disk(dispatcher: Any) -> None:
    """Give a function that numba compiles a place on disk, if there is one."""
    folder = cache_folder()
    if folder is not None:
        with suppress(OSError):  # a function that was typed in has no file
            set_cache(dispatcher, KernelCache(folder, dispatcher.__wrapped__))
