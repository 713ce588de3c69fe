"""Garbage collection, switched off while many permanent objects are made."""

import gc
import os
from collections.abc import Iterator
from contextlib import contextmanager
from threading import get_ident

#: Number of threads that have switched garbage collection off.
_QUIET: set[int] = set()


@contextmanager
def nothing_collected() -> Iterator[None]:
    """A block without Python's garbage collection, which would scan all permanent objects again and again; once it ends they count as old
    (unless objects are frozen, which that would thaw)."""
    collecting = gc.isenabled()
    try:
        if collecting:
            _QUIET.add(get_ident())
        gc.disable()
        yield
    finally:
        if collecting:
            if not gc.get_freeze_count():
                gc.freeze()
                gc.unfreeze()
            gc.enable()
            _QUIET.discard(get_ident())


def _begin_anew() -> None:
    """Switch collection on in a forked child, which lacks the parent's threads that would do so."""
    if _QUIET - {get_ident()}:
        gc.enable()


if hasattr(os, "register_at_fork"):
    os.register_at_fork(after_in_child=_begin_anew)
