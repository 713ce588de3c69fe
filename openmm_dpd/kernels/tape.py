"""What one step calls, recorded, so that many more can be done without Python.

A step calls the same kernels with the same arrays as the one before it; what differs is the key of the noise.  So one step is recorded
while Python does it (:class:`Tape`), and :func:`play` repeats it in compiled code until a kernel has something to say: that a list has
too little room, or that a bead is fast.  The step in which that happens is left to Python, from its beginning.
"""

import threading
from typing import Any

import numpy as np


class Tape:
    """Kernels that are being called, and the keys that are being made."""

    def __init__(self) -> None:
        #: (layout, its packed arguments, threads, the arguments, which are to stay where they are)
        self.calls: list[tuple[Any, bytes, int, tuple]] = []
        #: by the key: seed, count, layer and thermal energy that it was made of
        self.keys: dict[int, tuple[int, int, int, float]] = {}

    def add(self, layout: Any, packed: bytes, parts: int, arguments: tuple) -> None:
        """Record a call."""
        self.calls.append((layout, packed, parts, arguments))


class Tapes(threading.local):
    """The one that is recorded by this thread."""

    running: Tape | None = None


TAPES = Tapes()
