"""How many threads kernels use, and what happens where there are not enough cores for them."""

import os
import threading
import time
from collections.abc import Callable

import numba

from ..base.errors import ParameterError, what_is

#: Only one thread at a time may call the team.
_PARALLEL_LOCK = threading.Lock()
_MOST_THREADS: int = numba.config.NUMBA_NUM_THREADS  # type: ignore[attr-defined]
_thread_count: int | None = None


def set_threads(threads: int | None) -> None:
    """Set the number of threads that kernels use (None: all cores this process may run on; never more than numba was started with)."""
    global _thread_count
    if threads is not None and (isinstance(threads, bool) or not isinstance(threads, int) or threads < 1):
        raise ParameterError(f"the number of threads must be an integer >= 1, or None for all cores, not {what_is(threads)}")
    _thread_count = None if threads is None else max(1, min(int(threads), _MOST_THREADS))


def get_threads() -> int:
    """Number of threads that kernels use."""
    if _thread_count is not None:
        return _thread_count
    if _MOST_THREADS == 1:
        return 1
    available = len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1
    return max(1, min(available, _MOST_THREADS))


#: Fewer beads per thread than this are not worth its waiting for the others.
LEAST = 400


def threads_for(beads: int) -> int:
    """Number of threads that share the work on so many beads."""
    return max(1, min(get_threads(), beads // LEAST))


class _Watch:
    """Notices where threads do not have a core each, and leaves the work to half of them for a while.

    Beside another busy process two threads often share a core, and one spins until the other gets its turn (2 to 4 ms instead of 1.1 ms).
    The CPU time of the process shows this: it is then no more than the wall time.
    """

    #: Seconds of work that are judged together, of rest, and of a pause between two calls that counts as work, since reading the clock of
    #: the process takes half a microsecond.
    SPAN, REST, PAUSE = 0.05, 1.0, 5e-5
    #: Threads have enough cores if they run for this part of the time.
    ENOUGH = 0.6

    def __init__(self) -> None:
        self.passed = self.spent = self.until = 0.0
        #: Wall time and CPU time at the end of the last call.
        self.last = (-1.0, 0.0)
        #: Number of threads in the last call, and in those until ``until``.
        self.working = self.left = 1

    def judge(self) -> None:
        """Halve the number of threads for a while, if those of the last calls did not run for long enough."""
        if self.spent < self.ENOUGH * self.working * self.passed:
            self.until, self.left = self.last[0] + self.REST, max(1, self.working // 2)
        self.passed = self.spent = 0.0

    def call(self, threads: int, function: Callable[[int], int]) -> int:
        """Call a function of the number of threads, and add up its times."""
        if threads != self.working:  # the times so far are of as many as before
            self.working, self.passed, self.spent = threads, 0.0, 0.0
        begun, before = self.last
        now = time.perf_counter()
        if not 0.0 <= now - begun < self.PAUSE:
            begun, before = now, time.process_time()
        result = function(threads)
        now, spent = time.perf_counter(), time.process_time()
        self.last = now, spent
        self.passed += now - begun
        self.spent += spent - before
        if self.passed > self.SPAN:
            self.judge()
        return result


_WATCH = _Watch()


def look() -> None:
    """Judge at once, since threads have waited for each other for long.  They may have a core each nevertheless: a virtual machine stops
    one now and then, or one has more work than the others."""
    with _PARALLEL_LOCK:
        _WATCH.judge()


def dispatch(function: Callable[[int], int], threads: int) -> int:
    """Call a function with so many threads, or fewer if they lack cores; calls with several threads wait for each other."""
    if threads > 1 and time.perf_counter() < _WATCH.until:
        threads = min(threads, _WATCH.left)
    if threads == 1:
        return function(1)
    with _PARALLEL_LOCK:
        return _WATCH.call(threads, function)


def _begin_anew() -> None:
    """Make lock and watch anew in a child process: it has none of its parent's other threads, one of which may hold the lock."""
    global _PARALLEL_LOCK, _WATCH
    _PARALLEL_LOCK, _WATCH = threading.Lock(), _Watch()


if hasattr(os, "register_at_fork"):
    os.register_at_fork(after_in_child=_begin_anew)
