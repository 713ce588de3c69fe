"""What one step calls, recorded, so that many more can be done without Python.

A step calls the same kernels with the same arrays as the one before it; what differs is a word of some calls, such as the key of the noise.
So one step is recorded while Python does it, and :class:`.replay.Recording` repeats it in compiled code until a kernel has something to
say: that a list has too little room, for example.  The step in which that happens is left to Python, from its beginning.
"""

import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any, NamedTuple


class KernelCall(NamedTuple):
    """A call of a kernel, see :mod:`.native`."""

    layout: Any
    packed: bytes  #: Its arguments
    parts: int  #: Threads that share the work
    kept: tuple  #: What has to stay where it is


class Changing(NamedTuple):
    """What a word was made of that is another one in each step."""

    counted: int  #: Goes up from step to step
    kT: float  #: Thermal energy
    numbers: tuple[int, ...]  #: The first of them says whose coefficients change with the thermal energy


class Tape:
    """Calls of kernels, and words of them that are other ones in each step.

    Parameters
    ----------
    make : callable
        Compiled function (numbers, count, bits of kT), all of 64 bits without a sign, -> such a word; see :class:`Changing`.
    """

    def __init__(self, make: Callable) -> None:
        self.make = make
        self.calls: list[KernelCall] = []
        self.words: dict[int, Changing] = {}
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

    @staticmethod
    def tell(word: Any, counted: int, kT: float, *numbers: Any) -> None:
        """Say what a word was made of, to the tape that is running, if there is one."""
        if TAPES.running is not None:
            TAPES.running.words[int(word)] = Changing(counted, kT, numbers)


class Tapes(threading.local):
    """The one that this thread records on."""

    running: Tape | None = None


TAPES = Tapes()
