"""A notice for those who wait for the compiler."""

import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager

from .kernel_cache import cache_folder
from .numba_private import compiling

#: Seconds of compiling after which it is said.
PATIENCE = 1.0
#: What was said already.
_SAID: set[str] = set()


@contextmanager
def announced(what: str, seconds: int, log: Callable[[str], None]) -> Iterator[None]:
    """A block that may have to compile the kernels of something, for about so long: if it does, ``log`` gets a line, the first time."""
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
