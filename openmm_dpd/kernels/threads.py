"""How many threads the kernels use, and how they are called with them."""

import os
import threading
import time

import numba

from ..base.errors import ParameterError

# Threads of GNU OpenMP that spin while they wait stall each other, and OpenMM's own, wherever there are fewer free cores than threads
# (a step can take ten times as long); the variable is read when the library is loaded, at the first parallel call, and a user's own
# choice is kept.
os.environ.setdefault("OMP_WAIT_POLICY", "PASSIVE")

# Threads that go to sleep at once take longer to wake up than most loops take, and often wake up on the core of the one that woke them.
# 100,000 rounds (3 ms) bridge the gaps of a run: mean steps of mvv, 10,000 beads, two free cores: 1.0 ms with 0 as with one thread,
# 0.83 ms with 2000, 0.87 ms with 20,000, 0.71 ms with 100,000; beside another busy process 1.08, 1.12 and 1.16 ms, one thread 1.07 ms.
os.environ.setdefault("GOMP_SPINCOUNT", "100000")

#: Numba's default threading layer must not be entered from two threads at once.
_PARALLEL_LOCK = threading.Lock()
_MOST_THREADS: int = numba.config.NUMBA_NUM_THREADS  # type: ignore[attr-defined]
_thread_count: int | None = None


def set_threads(threads: int | None) -> None:
    """Number of threads the pair kernel uses (None: all cores this process may run on; never more than numba was started with)."""
    global _thread_count
    if threads is not None and (isinstance(threads, bool) or not isinstance(threads, int) or threads < 1):
        raise ParameterError(f"the number of threads must be an integer >= 1, or None for all cores, not {threads!r}")
    _thread_count = None if threads is None else max(1, min(int(threads), _MOST_THREADS))


def get_threads() -> int:
    """Number of threads the pair kernel uses."""
    if _thread_count is not None:
        return _thread_count
    if _MOST_THREADS == 1:
        return 1
    available = len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1
    return max(1, min(available, _MOST_THREADS))


class _Watch:
    """Notices where threads do not have a core each, and leaves the work to one of them for a while.  Beside another busy process two
    threads often share a core, and spin until the other one gets its turn (2 to 4 ms in place of 1.1 ms). The CPU time of the process shows
    this: it is then no more than the wall time."""

    #: Seconds of work that are judged together, of rest, of a call that was not work (but the compiler's), and of a pause between two
    #: calls that counts as work: to look at the clock of the process takes half a microsecond.
    SPAN, REST, LONGEST, PAUSE = 0.05, 1.0, 0.1, 5e-5
    #: Threads are as good as their number if they run for this part of the time.
    ENOUGH = 0.6

    def __init__(self) -> None:
        self.passed = self.spent = self.until = 0.0
        #: Both clocks at the end of the last call.
        self.last = (-1.0, 0.0)

    def call(self, threads: int, function, arguments: tuple):
        """Call a function with so many threads, and look at its times."""
        begun, before = self.last
        now = time.perf_counter()
        if not 0.0 <= now - begun < self.PAUSE:
            begun, before = now, time.process_time()
        result = function(*arguments)
        now, spent = time.perf_counter(), time.process_time()
        self.last = now, spent
        if now - begun < self.LONGEST:
            self.passed += now - begun
            self.spent += spent - before
            if self.passed > self.SPAN:
                if self.spent < self.ENOUGH * threads * self.passed:
                    self.until = now + self.REST
                self.passed = self.spent = 0.0
        return result


_WATCH = _Watch()


class _Chosen(threading.local):
    """The number of threads last set in numba for this thread; setting it takes a microsecond."""

    threads = 0


_CHOSEN = _Chosen()


def dispatch(serial, parallel, *arguments):
    """Call the parallel version under the lock, with the right number of threads, or the serial one (also if there is no parallel one)."""
    threads = 1 if parallel is None else get_threads()
    if threads == 1 or time.perf_counter() < _WATCH.until:
        return serial(*arguments)
    with _PARALLEL_LOCK:
        if _CHOSEN.threads != threads:
            numba.set_num_threads(threads)
            _CHOSEN.threads = threads
        return _WATCH.call(threads, parallel, arguments)
