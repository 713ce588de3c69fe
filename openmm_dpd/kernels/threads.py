"""How many threads the kernels use, and how they are called with them."""

from __future__ import annotations

import os
import threading

import numba

from ..errors import ParameterError

# Threads of GNU OpenMP that spin while they wait stall each other, and OpenMM's own, wherever there are fewer free cores than threads
# (a step can take ten times as long); the variable is read when the library is loaded, at the first parallel call, and a user's own
# choice is kept.
os.environ.setdefault("OMP_WAIT_POLICY", "PASSIVE")

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
    available = len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1
    return max(1, min(available, _MOST_THREADS))


def run(serial, parallel, *arguments):
    """Call the parallel version under the lock, with the right number of threads, or the serial one (also if there is no parallel one)."""
    threads = get_threads()
    if threads == 1:
        return serial(*arguments)
    with _PARALLEL_LOCK:
        numba.set_num_threads(threads)
        return (parallel or serial)(*arguments)
