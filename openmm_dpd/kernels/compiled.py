"""One source, two compiled versions: serial and parallel."""

from __future__ import annotations

from collections.abc import Callable
from types import FunctionType

from numba import njit


def serial_and_parallel(function: Callable) -> tuple[Callable, Callable]:
    """Compile a function that loops with prange twice.

    The parallel version is compiled from a copy with a name of its own: numba keys its disk cache on the name alone, and one version
    would be loaded in place of the other.  Neither uses fastmath, so that both round alike and give the same bits.
    """
    copy = FunctionType(function.__code__, function.__globals__, f"{function.__name__}_parallel", function.__defaults__)
    copy.__qualname__ = f"{function.__qualname__}_parallel"
    copy.__module__ = function.__module__
    return njit(nogil=True, cache=True)(function), njit(nogil=True, cache=True, parallel=True)(copy)
