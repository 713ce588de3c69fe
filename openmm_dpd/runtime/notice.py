"""Tells users when they wait for the compiler."""

import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager

from .kernel_cache import cache_folder
from .numba_private import compiling

#: Seconds of compiling after which the notice is given.
PATIENCE = 1.0
#: Topics of notices that have been given.
_SAID: set[str] = set()


@contextmanager
def announced(what: str, seconds: int, log: Callable[[str], None]) -> Iterator[None]:
    """Context in which the kernels of ``what`` may have to be compiled, in some ``seconds``.  If so, ``log`` gets one line per process."""
    again = "" if cache_folder() is None else ", once: later runs on this machine find them in the cache"

    def say() -> None:
        if what not in _SAID:
            _SAID.add(what)
            log(f"compiling the kernels of {what}, some {seconds} s{again}")

    notice = threading.Timer(PATIENCE, say)
    notice.daemon = True

    def begin() -> None:
        if notice.ident is None:
            notice.start()

    try:
        with compiling(begin):
            yield
    finally:
        notice.cancel()
