"""How kernels are compiled and kept on disk."""

from __future__ import annotations

import hashlib
import os
import tempfile
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from types import FunctionType
from typing import Any

import numba


def _digest() -> str:
    """Hash of all kernel sources."""
    sources = sorted(Path(__file__).parent.glob("*.py"))
    return hashlib.sha256(b"".join(path.read_bytes() for path in sources)).hexdigest()[:12]


_DIGEST = _digest()


@contextmanager
def _user_cache() -> Iterator[None]:
    """Keep compiled code in the user's cache folder, unless NUMBA_CACHE_DIR says otherwise.

    Beside the package it would survive an uninstall and leave a folder that shadows the next installation.
    """
    config: Any = numba.config
    given = config.CACHE_DIR
    if not given:
        folder = Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache") / "openmm_dpd"
        try:
            folder.mkdir(parents=True, exist_ok=True)
        except OSError:
            folder = Path(tempfile.gettempdir()) / f"openmm_dpd-{os.getuid() if hasattr(os, 'getuid') else 'cache'}"
            folder.mkdir(parents=True, exist_ok=True)
        config.CACHE_DIR = str(folder)
    try:
        yield
    finally:
        config.CACHE_DIR = given


def compiled(function: Callable, *, parallel: bool = False) -> Any:
    """Compile a kernel; without the interpreter's lock, and cached on disk.

    Numba keys its cache on a function's name and file alone: it would load a serial version in place of a parallel one, and old code where
    only a function in another file, inlined here, has changed.  So the function is compiled under a name that says both.  No fastmath, so
    that both versions round alike and give the same bits.
    """
    name = f"{function.__name__}_{'parallel' if parallel else 'serial'}_{_DIGEST}"
    copy = FunctionType(function.__code__, function.__globals__, name, function.__defaults__)
    copy.__qualname__ = name
    copy.__module__ = function.__module__
    copy.__doc__ = function.__doc__
    with _user_cache():
        return numba.njit(nogil=True, cache=True, parallel=parallel)(copy)


def serial_and_parallel(function: Callable) -> tuple[Any, Any]:
    """Compile a function that loops with prange twice."""
    return compiled(function), compiled(function, parallel=True)
