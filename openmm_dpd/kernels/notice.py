"""Who waits for the compiler is told so."""

import logging
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager

from numba.core import event

from ..kernel_cache import cache_folder

#: Where a script learns that it waits; logging.getLogger("openmm_dpd").setLevel("ERROR") silences it.
LOGGER = logging.getLogger("openmm_dpd")

#: Seconds of compiling after which it is said.
PATIENCE = 1.0


class _Compiling(event.Listener):
    """Starts a timer when the first function is compiled; what is loaded from the cache is none."""

    def __init__(self, notice: threading.Timer):
        self.notice = notice

    def on_start(self, event) -> None:
        if self.notice.ident is None:
            self.notice.start()

    def on_end(self, event) -> None:
        pass


@contextmanager
def announced(what: str, seconds: int, log: Callable[[str], None]) -> Iterator[None]:
    """A block that may have to compile the kernels of something, for about so long: if it does, ``log`` gets a line."""
    again = "" if cache_folder() is None else ", once: the next run finds them in the cache"
    notice = threading.Timer(PATIENCE, log, [f"compiling the kernels of {what}, some {seconds} s{again}"])
    notice.daemon = True
    try:
        with event.install_listener("numba:compile", _Compiling(notice)):
            yield
    finally:
        notice.cancel()
