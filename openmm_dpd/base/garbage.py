"""Work that makes many objects which stay."""

import gc
import os
from collections.abc import Iterator
from contextlib import contextmanager
from threading import get_ident

#: Threads that have switched it off.
_QUIET: set[int] = set()


@contextmanager
def nothing_collected() -> Iterator[None]:
    """A block in which Python does not look for garbage, if it did before: it would look at all that stays, again and again."""
    collecting = gc.isenabled()
    try:
        if collecting:
            _QUIET.add(get_ident())
        gc.disable()
        yield
    finally:
        if collecting:
            gc.enable()
            _QUIET.discard(get_ident())


def _begin_anew() -> None:
    """A child process has none of its parent's other threads to switch it on again."""
    if _QUIET - {get_ident()}:
        gc.enable()


if hasattr(os, "register_at_fork"):
    os.register_at_fork(after_in_child=_begin_anew)
