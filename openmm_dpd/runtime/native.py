"""Kernels: compiled functions whose work threads share, called by address with arguments in memory.

A kernel is written as a function ``(..., part, parts, team)``.  All ``parts`` threads of a team call it at the same time, and each does its
share.  Where one thread needs the result of another, they meet (:func:`.team.meet`).  A kernel returns 0, or another number if it could not
complete its work, for want of room, say.  A single thread is a team of one, so one compiled version serves any number of threads.

Its own arguments are arrays, numbers, and tuples of these.  They are written to memory as consecutive 64-bit words: an array as the
address of its data, its lengths and its strides, a number as itself.  So all kernels are called in the same way, and a recorded call can be
repeated from compiled code with other numbers in some places (:mod:`.tape`).
"""

import ctypes
import functools
import hashlib
import itertools
import threading
from collections.abc import Callable
from struct import Struct
from types import FunctionType
from typing import Any, NamedTuple

import numba
import numpy as np
from numba import types

from .addresses import ENTRY, reader_of
from .decorators import BARE, SEMANTICS, at_address
from .team import CALL, the_team
from .threads import dispatch

#: Flags of an array: contiguous in C's order, and writeable.
_PLAIN = 0x0001 | 0x0400
_byte_of: Any = ctypes.c_char.from_buffer
_address_of = ctypes.addressof


def _add_words(value: Any, words: list[Any], kinds: list[Any]) -> None:
    """Append the words of an argument to ``words``, and what identifies their layout to ``kinds``."""
    kind = type(value)
    if kind is np.ndarray:
        flags = value.flags.num & _PLAIN
        # a quarter of a microsecond; numpy's own way to the address takes one
        if flags == _PLAIN and value.size:
            words.append(_address_of(_byte_of(value)))
        else:
            words.append(value.__array_interface__["data"][0])
        words += value.shape
        words += value.strides
        kinds.append(flags << 16 | value.ndim << 8 | value.dtype.num)
    elif isinstance(value, tuple):
        kinds.append(kind)
        for each in value:
            _add_words(each, words, kinds)
        kinds.append(len(value))
    else:
        words.append(value)
        kinds.append(kind)


def _format(number: Any) -> str:
    """Format character of :mod:`struct` for a number."""
    return {float: "d", np.float64: "d", np.uint64: "Q"}.get(type(number), "q")


class Laid(NamedTuple):
    """A tuple whose words are stored once, because many calls have it as an argument: they pass the address of the words."""

    value: tuple
    words: bytes
    address: int
    kind: int  #: Identifies the layout of the words


def _laid(value: Any, memory: dict[type, Laid | None]) -> Laid | None:
    """The stored words of a tuple; None for a value whose type is not in the memory."""
    if type(value) not in memory:
        return None
    found = memory[type(value)]
    if found is None or found.value is not value:
        words: list[Any] = []
        kinds: list[Any] = []
        _add_words(value, words, kinds)
        packed = Struct("".join(map(_format, words))).pack(*words)
        address = ctypes.cast(ctypes.c_char_p(packed), ctypes.c_void_p).value or 0
        memory[type(value)] = found = Laid(value, packed, address, _one(tuple(kinds)))
    return found


@functools.cache
def _one(kinds: tuple) -> int:
    """A negative number that identifies a layout, to be compared in each call."""
    return -1 - next(_NUMBERS)


_NUMBERS = itertools.count()


class Layout:
    """How the arguments of one call are laid out in memory, and the compiled function that reads them."""

    def __init__(self, name: str, made: Any, arguments: tuple, known: tuple, words: list[Any]):
        self.name, self.made, self.address, self.alone = name, made, made.address, CALL(made.address)
        self.pack = Struct("".join(map(_format, words))).pack
        #: first word of each field of a NamedTuple, by its name
        self.places: dict[str, int] = {}
        place = 0
        for each, elsewhere in zip(arguments, known, strict=True):
            place = place + 1 if elsewhere else self._walk(each, place, "")

    def _walk(self, value: Any, place: int, name: str) -> int:
        self.places[name] = place
        if isinstance(value, tuple):
            for each, its in zip(value, getattr(value, "_fields", [""] * len(value)), strict=True):
                place = self._walk(each, place, its)
            return place
        return place + (1 + 2 * value.ndim if isinstance(value, np.ndarray) else 1)


def _alone(layout: Layout, packed: bytes, parts: int) -> int:
    return layout.alone(packed, 0, 1, 0)


def _together(layout: Layout, packed: bytes, parts: int) -> int:
    return the_team().run(layout.address, packed, parts)


def run(layout: Layout, packed: bytes, parts: int) -> int:
    """Call a kernel with up to ``parts`` threads: fewer, if there are not enough cores."""
    if parts == 1:
        return _alone(layout, packed, 1)
    return dispatch(lambda threads: (_together if threads > 1 else _alone)(layout, packed, threads), parts)


class KernelCall(NamedTuple):
    """A recorded call."""

    layout: Layout
    packed: bytes  #: Words of its arguments
    parts: int  #: Number of threads
    kept: tuple  #: Objects that must stay alive


class _Running(threading.local):
    """The :class:`.tape.Tape` on which this thread records."""

    tape: Any = None


RUNNING = _Running()


class Kernel:
    """A function ``(..., part, parts, team)``, compiled for each combination of argument types.  One that allocates arrays must not be
    ``bare``; one that is not ``kept`` is compiled in each process."""

    def __init__(self, function: Callable, *, bare: bool = True, kept: bool = True):
        self.name, self._bare, self._kept = function.__name__, bare, kept
        self._inner = numba.njit(inline="always", **(BARE if bare else SEMANTICS))(function)
        self._layouts: dict[tuple, Layout] = {}

    def __call__(self, *arguments: Any, parts: int = 1, memory: dict[type, Any] | None = None) -> int:
        """Call it with up to ``parts`` threads.  A ``memory`` maps types of tuples to None at first; it stores the last tuple of each, so
        that later calls with the same tuple pass its address only."""
        words: list[Any] = []
        kinds: list[Any] = []
        there = () if memory is None else tuple(_laid(each, memory) for each in arguments)
        for known, each in zip(there or (None,) * len(arguments), arguments, strict=True):
            if known is None:
                _add_words(each, words, kinds)
            else:
                words.append(known.address)
                kinds.append(known.kind)
        how = tuple(kinds)
        layout = self._layouts.get(how)
        if layout is None:
            elsewhere = tuple(known is not None for known in there) or (False,) * len(arguments)
            made = self._compiled(numba.typeof(arguments), elsewhere)
            layout = self._layouts[how] = Layout(self.name, made, arguments, elsewhere, words)
        packed = layout.pack(*words)
        tape, found = RUNNING.tape, run(layout, packed, parts)
        if tape is not None:
            tape.calls.append(KernelCall(layout, packed, parts, (arguments, there)))
            tape.smooth = tape.smooth and found == 0
        return found

    @property
    def versions(self) -> int:
        """Number of compiled versions."""
        return len(self._layouts)

    def _compiled(self, kind: types.BaseTuple, elsewhere: tuple[bool, ...]) -> Any:
        """The function for arguments of these types; for those that lie ``elsewhere`` there is a word with their address."""
        name = f"{self.name}_{hashlib.sha256(f'{kind}{elsewhere}'.encode()).hexdigest()[:12]}"
        return at_address(_entry(name, self._inner, kind, elsewhere), ENTRY, bare=self._bare, kept=self._kept)


def _entry(name: str, kernel: Callable, kind: types.BaseTuple, elsewhere: tuple[bool, ...]) -> FunctionType:
    """The function that is called by its address.  Its arguments are written out: numba does not inline a call with ``*arguments``."""
    given = ", ".join(f"its[{k}]" for k in range(len(kind)))
    text = f"def {name}(words, part, parts, team):\n    its = arguments(words)\n    return kernel({given}, part, parts, team)\n"
    names: dict[str, Any] = {"kernel": kernel, "arguments": reader_of(kind, elsewhere), "__name__": __name__}
    exec(compile(text, __file__, "exec"), names)
    return names[name]
