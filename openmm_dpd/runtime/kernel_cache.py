"""Where compiled kernels are kept on disk: in a folder that belongs to the user, or nowhere.

A kernel is found by its code (:func:`contents`), its argument types and the compiler.  So each kernel is compiled once per machine,
wherever the package is installed.  Files are unpickled and run, so a folder that others can write to is not used.  A cache that is full or
damaged does no harm: kernels are compiled in each process, with one message.
"""

import errno
import functools
import hashlib
import logging
import os
import pickle
import stat
import sys
import tempfile
import time
from collections.abc import Iterator
from contextlib import suppress
from importlib.metadata import version
from pathlib import Path
from types import CodeType, FunctionType, ModuleType
from typing import Any

import numba
import numpy as np

from ..base.errors import OutputError
from ..base.files import write_whole
from ..base.signals import CTRL_C
from .numba_private import NullCache, dumps, packed, ready_to_run, set_cache, unpacked

try:
    import fcntl
except ImportError:  # on Windows two processes may compile the same kernel at once
    fcntl = None  # type: ignore[assignment]

_LOGGER = logging.getLogger("openmm_dpd")
_REMEDY = "set NUMBA_CACHE_DIR to a folder of your own"
#: Length of the hash at the beginning of every file.
_SEAL = hashlib.sha256().digest_size
#: Topics on which something was said: each once per process.
_SAID: set[str] = set()


def _say(topic: str, text: str) -> None:
    """Log a warning, unless there was one on this topic."""
    if topic not in _SAID:
        _SAID.add(topic)
        _LOGGER.warning(text)


def why_unusable(folder: Path) -> str | None:
    """Why compiled code cannot be kept in a folder; None if it can.  The folder is made if it does not exist."""
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
    """Folders for the cache, the best one first.  None is beside the package, where it would survive an uninstall."""
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
    """The folder in which compiled kernels are kept; None, with one message, if there is none.

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


@functools.cache
def _file(path: str) -> bytes:
    """Hash of a source file; empty if it cannot be read, as for functions that were typed in."""
    try:
        return hashlib.sha256(Path(path).read_bytes()).digest()
    except OSError:
        return b""


#: Files whose options decide how everything is compiled.  They are read now, with all kernels, so that they are the ones imported.
_PACKAGE = Path(__file__).parent.parent
_OPTIONS = [str(_PACKAGE / "runtime" / name) for name in ("decorators.py", "numba_private.py")]
for _room in ("runtime", "kernels"):
    for _path in (_PACKAGE / _room).glob("*.py"):
        _file(str(_path))
#: Libraries whose code is not hashed: their versions are part of the key.  Functions of Python's own lead to paths, such as sys.executable.
_LIBRARIES = sys.stdlib_module_names | {"llvmlite", "numba", "numpy"}


def _parts(value: Any, seen: set[int], names: tuple[str, ...] = ()) -> Iterator[bytes]:
    """What a value contributes to compiled code that refers to it; for a function its source file, its code and the values it refers to."""
    value = getattr(value, "py_func", getattr(value, "_defn", value))  # dispatchers of numba, and its intrinsics
    library = str(getattr(value, "__module__", getattr(value, "__name__", ""))).partition(".")[0] in _LIBRARIES
    if isinstance(value, FunctionType) and not library and id(value) not in seen:
        seen.add(id(value))
        closure = dict(zip(value.__code__.co_freevars, value.__closure__ or (), strict=True))
        yield _file(value.__code__.co_filename)
        yield from _code(value.__code__, value.__globals__ | {name: cell.cell_contents for name, cell in closure.items()}, seen)
        yield from _parts(value.__defaults__, seen)
    elif isinstance(value, ModuleType) and not library:
        for name in names:
            yield from _parts(getattr(value, name, None), seen)
    elif isinstance(value, tuple):
        yield type(value).__name__.encode()
        for each in value:
            yield from _parts(each, seen)
    elif isinstance(value, np.ndarray):
        yield f"{value.dtype}{value.shape}".encode() + value.tobytes()
    elif isinstance(value, type):
        yield f"{value.__qualname__}{getattr(value, '_fields', '')}".encode()
    elif value is None or isinstance(value, (bool, int, float, str, bytes, np.generic, numba.types.Type)):
        yield repr(value).encode()


def _code(code: CodeType, known: dict[str, Any], seen: set[int]) -> Iterator[bytes]:
    yield code.co_code
    for constant in code.co_consts:
        yield from _code(constant, known, seen) if isinstance(constant, CodeType) else _parts(constant, seen)
    for name in (*code.co_names, *code.co_freevars):
        yield name.encode()
        if name in known:
            yield from _parts(known[name], seen, code.co_names)


def contents(function: FunctionType) -> str:
    """Hash of all that is compiled with a function: its code and that of functions it calls, their source files, and values they use.

    Neither paths nor times are part of it.  The files contribute what a function does not show, such as overloads.
    """
    found = hashlib.sha256()
    for part in (*map(_file, _OPTIONS), *_parts(function, set())):
        found.update(len(part).to_bytes(8, "little") + part)
    return found.hexdigest()


@functools.cache
def _lock_file(folder: Path) -> int:
    """The file whose bytes are locks.  It stays open: closing it would release all of them."""
    return os.open(folder / "lock", os.O_RDWR | os.O_CREAT, 0o600)


class KernelFiles:
    """The files of one kernel, one for each signature and machine: a hash, then the pickled key and code.

    Their names begin with ``name``; ``stamp`` is what must be unchanged for a file to be found, such as the kernel's :func:`contents`.
    """

    #: Seconds after which a kernel that another process is compiling is compiled here, too.
    PATIENCE = 60.0

    def __init__(self, folder: str | os.PathLike, name: str, stamp: Any):
        self.folder, self.name = Path(folder), name
        self.stamp = stamp, numba.__version__, version("llvmlite"), sys.implementation.cache_tag

    def _path(self, key: Any) -> Path:
        return self.folder / f"{self.name}.{hashlib.sha256(repr((key, self.stamp)).encode()).hexdigest()[:16]}.kernel"

    def load(self, key: Any) -> Any:
        """Return what was saved with a key, or None."""
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
        """Save data for :meth:`load`."""
        payload = dumps(((key, self.stamp), data))
        write_whole(self._path(key), hashlib.sha256(payload).digest() + payload, "the compiled kernel")

    def begin(self, key: Any) -> None:
        """Wait until no other process compiles this kernel, and let others wait until :meth:`end`.  The lock ends with the process."""
        if fcntl is None:
            return
        place, until = int(self._path(key).suffixes[-2][1:9], 16), time.monotonic() + self.PATIENCE
        while time.monotonic() < until:
            try:
                fcntl.lockf(_lock_file(self.folder), fcntl.LOCK_EX | fcntl.LOCK_NB, 1, place)
                return
            except OSError as error:
                if error.errno not in (errno.EACCES, errno.EAGAIN):  # a file system without locks
                    return
            CTRL_C.check()
            time.sleep(0.02)

    def end(self) -> None:
        """Release the locks of :meth:`begin`."""
        if fcntl is not None:
            with suppress(OSError):
                fcntl.lockf(_lock_file(self.folder), fcntl.LOCK_UN)


class KernelCache(NullCache):
    """A cache for numba in :class:`KernelFiles`: what it cannot load is compiled anew, what it cannot save is not kept."""

    def __init__(self, folder: Path, function: FunctionType) -> None:
        self._folder, self._function = folder, function

    @functools.cached_property
    def files(self) -> KernelFiles:
        """Files of the kernel; first used when it is called, since all functions it calls are defined then."""
        return KernelFiles(self._folder, self._function.__name__, contents(self._function))

    def load_overload(self, sig, target_context):
        """The compiled function, or None: then other processes wait until :meth:`save_overload`."""
        CTRL_C.check()  # compiling all kernels of a step may take a minute
        try:
            ready_to_run(target_context)
            key = sig, target_context.codegen().magic_tuple()
            data = self.files.load(key)
            if data is None:
                self.files.begin(key)
                data = self.files.load(key)
            if data is None:
                target_context.refresh()
                return None
            self.files.end()
            return unpacked(target_context, data)
        except Exception as error:  # damaged pickles can fail in any way
            _say("read", f"compiled kernels in {cache_folder()} cannot be read ({error}); they are compiled anew, and replaced")
            return None

    def save_overload(self, sig, data):
        """Save a compiled function, if possible."""
        try:
            if not data.library.has_dynamic_globals:
                self.files.save((sig, data.codegen.magic_tuple()), packed(data))
        except (OutputError, OSError) as error:
            _say("save", f"kernels are compiled at every start, since they cannot be kept: {error} ({_REMEDY})")
        finally:
            self.files.end()


def keep_on_disk(dispatcher: Any) -> None:
    """Let numba keep a compiled function on disk, if there is a folder for it."""
    folder = cache_folder()
    if folder is not None:
        set_cache(dispatcher, KernelCache(folder, dispatcher.__wrapped__))
