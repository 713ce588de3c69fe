"""What this package takes from inside numba, which may change with any release: nothing else imports ``numba.core``.

``tests/core/test_private_interfaces.py`` tries each part, and prints what to do where one has changed:

- ``NullCache``, ``packed``, ``unpacked``, ``set_cache``, ``dumps``: adapt them to the new cache.  Until then let
  ``keep_on_disk`` of ``kernel_cache.py`` return at once: kernels are then compiled in each process, and nothing else is lost.
- ``ready_to_run``: let it call ``target.refresh()``.  Kernels from disk then load the compiler, too, which takes 0.2 s.
- ``NO_REFERENCE_COUNTS``: make it ``{}``.  Results keep their bits; where many pairs go through a helper it is slower.
- ``ONLY_LINKED``: make it ``{}``.  Nothing changes but the time to compile, by a third.
- ``CFunc``: what ``numba.cfunc`` makes, which compiles at once and takes no cache of our own; adapt ``at_address`` of ``decorators.py``.
- ``global_compiler_lock``: remove it.  A child process forked while another thread compiles may then wait forever.
- ``compiling``: let it yield and call nothing.  Then users are not told that kernels are being compiled.
"""

import os
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any

import numba.cpython.hashing  # noqa: F401  code that hashes finds its secret numbers by name
import numpy.ma  # noqa: F401  numba imports it with the first array: a child forked meanwhile would wait for an import that never ends
from numba.core.caching import NullCache
from numba.core.ccallback import CFunc
from numba.core.codegen import JITCodeLibrary
from numba.core.compiler import Compiler, CompileResult
from numba.core.compiler_lock import global_compiler_lock as _COMPILER
from numba.core.event import Listener, install_listener
from numba.core.runtime import rtsys
from numba.core.serialize import dumps

# a fork waits for the kernel that another thread compiles: the child would wait for that thread, which it has not
if hasattr(os, "register_at_fork"):
    os.register_at_fork(before=_COMPILER.acquire, after_in_parent=_COMPILER.release, after_in_child=_COMPILER.release)


class _Linked(JITCodeLibrary):
    """Code that is linked into that of its callers, and optimised and translated there."""

    def get_pointer_to_function(self, name: str) -> int:
        return 0  # Python cannot call it

    @property
    def codegen(self) -> Any:
        return self

    def set_env(self, name: str, environment: Any) -> None:
        """Do nothing: it needs no objects of Python."""

    def _optimize_final_module(self) -> None:
        pass

    def _finalize_final_module(self) -> None:
        self._finalize_dynamic_globals()
        self._verify_declare_only_symbols()
        self._finalized = True


class _Linker(Compiler):
    """Compiles code that is only linked into that of its callers."""

    def define_pipelines(self):
        self.state.library = _Linked(self.state.targetctx.codegen(), self.state.func_id.func_qualname)
        return super().define_pipelines()


#: Options of ``numba.njit`` for functions that only compiled code calls.
ONLY_LINKED: dict[str, Any] = {"no_cpython_wrapper": True, "no_cfunc_wrapper": True, "pipeline_class": _Linker}
#: Option of ``numba.njit`` for code that allocates nothing: references to arrays are not counted.
NO_REFERENCE_COUNTS = {"_nrt": False}


def packed(compiled: CompileResult) -> Any:
    """The part of a compiled function that can be pickled."""
    return compiled._reduce()


def unpacked(target: Any, data: Any) -> CompileResult:
    """The compiled function that :func:`packed` has taken apart."""
    return CompileResult._rebuild(target, *data)


def ready_to_run(target: Any) -> None:
    """Make known by name what compiled code may call, for code from disk: all else that numba has is needed to compile alone."""
    rtsys.initialize(target)


def set_cache(dispatcher: Any, cache: NullCache) -> None:
    """Give a function that numba compiles a cache."""
    dispatcher._cache = cache


class _Compiling(Listener):
    def __init__(self, begun: Callable[[], None]):
        self._begun = begun

    def on_start(self, event) -> None:
        self._begun()

    def on_end(self, event) -> None:
        pass


@contextmanager
def compiling(begun: Callable[[], None]) -> Iterator[None]:
    """Context in which ``begun`` is called when numba compiles a function, not when it loads one from the cache."""
    with install_listener("numba:compile", _Compiling(begun)):
        yield


__all__ = [
    "NO_REFERENCE_COUNTS",
    "ONLY_LINKED",
    "CFunc",
    "NullCache",
    "compiling",
    "dumps",
    "packed",
    "ready_to_run",
    "set_cache",
    "unpacked",
]
