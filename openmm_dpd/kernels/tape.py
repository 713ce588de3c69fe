"""What one step calls, recorded, so that many more can be done without Python.

A step calls the same kernels with the same arrays as the one before it; what differs is the key of the noise.  So one step is recorded
while Python does it, and :func:`.replay.play` repeats it in compiled code until a kernel has something to say: that a list has too little
room, or that a bead is fast.  The step in which that happens is left to Python, from its beginning.
"""

import threading
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any, NamedTuple

import numpy as np

from .noise import noise_key


class KernelCall(NamedTuple):
    """A call of a kernel, see :mod:`.native`."""

    layout: Any
    packed: bytes  #: Its arguments
    parts: int  #: Threads that share the work
    kept: tuple  #: What has to stay where it is


class KeyMade(NamedTuple):
    """What a key of the noise was made of."""

    seed: int
    counted: int
    layer: int
    kT: float


class Tape:
    """Calls of kernels, and keys."""

    def __init__(self) -> None:
        self.calls: list[KernelCall] = []
        self.keys: dict[int, KeyMade] = {}
        #: whether no kernel had anything to say
        self.smooth = True

    @contextmanager
    def recording(self) -> Iterator[None]:
        """A block in which all that this thread calls is recorded."""
        TAPES.running = self
        try:
            yield
        finally:
            TAPES.running = None


class Tapes(threading.local):
    """The one that this thread records on."""

    running: Tape | None = None


TAPES = Tapes()


def told_key(seed: int, counter: int, layer: int, kT: float) -> np.uint64:
    """A :func:`.noise.noise_key`, of which a tape that is running is told."""
    key = noise_key(seed, counter, layer, kT)
    if TAPES.running is not None:
        TAPES.running.keys[int(key)] = KeyMade(seed, counter, layer, kT)
    return key
