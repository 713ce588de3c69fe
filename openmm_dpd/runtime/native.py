"""Kernels: compiled functions that threads share, called by their address with arguments that lie in memory.

A kernel is written as a function ``(..., part, parts, team)``.  All ``parts`` threads of a team call it at once, each does its share, and
where one needs what another has done they meet (:func:`.team.meet`).  It returns 0, or another number where it could not do its work: for
want of room, say.  One thread alone is a team of one, so there is one compiled version for any number of threads.

Its own arguments, arrays, numbers, and tuples of these, are written down as words behind each other: an array as the address of its data,
lengths and strides, a number as itself.  So all kernels are called alike, and what was called once can be called again from compiled code,
with other numbers in some places (:mod:`.tape`).
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
from .compiled import BARE, SEMANTICS, at_address
from .team import CALL, the_team
from .threads import dispatch

#: Flags of an array: contiguous in C's order, and writeable.
_PLAIN = 0x0001 | 0x0400
_byte_of: Any = ctypes.c_char.from_buffer
_address_of = ctypes.addressof


def _add_words(value: Any, words: list[Any], kinds: list[Any]) -> None:
    """Add the words of an argument, and what says how they are to be read."""
    kind = type(value)
    if kind is np.ndarray:
        flags = value.flags.num & _PLAIN
        # the short way to the address takes a quarter of a microsecond, numpy's own takes one
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
    """How a number is packed; whole numbers are signed, but for those of numpy that are not."""
    return {float: "d", np.float64: "d", np.uint64: "Q"}.get(type(number), "q")


class Laid(NamedTuple):
    """A tuple whose words lie where they are, since it is an argument of many calls: these have their address alone."""

    value: tuple
    words: bytes
    address: int
    kind: int  #: What says how they are to be read


def _laid(value: Any, memory: dict[type, Laid | None]) -> Laid | None:
    """The words of a tuple, None for what is of no type that the memory has."""
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
    """A number for all that are equal, less than 0: it is part of what is looked up for each call."""
    return -1 - next(_NUMBERS)


_NUMBERS = itertools.count()


class Layout:
    """How the arguments of one call lie in memory, and the compiled function that reads them there."""

    def __init__(self, name: str, made: Any, arguments: tuple, known: tuple, words: list[Any]):
        self.name, self.made, self.address, self.alone = name, made, made.address, CALL(made.address)
        self.pack = Struct("".join(map(_format, words))).pack
        #: where the numbers and arrays of records lie, by their names
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
    """Call a kernel with so many threads, where there are cores for them."""
    if parts == 1:
        return _alone(layout, packed, 1)
    return dispatch(lambda threads: (_together if threads > 1 else _alone)(layout, packed, threads), parts)


class KernelCall(NamedTuple):
    """A call that is recorded."""

    layout: Layout
    packed: bytes  #: Its arguments
    parts: int  #: Threads that share the work
    kept: tuple  #: What has to stay where it is


class _Running(threading.local):
    """The :class:`.tape.Tape` that this thread records on."""

    tape: Any = None


RUNNING = _Running()


class Kernel:
    """A function as above, compiled for each combination of types it is called with; ``bare`` and ``kept`` as in
    :func:`.compiled.compiled`."""

    def __init__(self, function: Callable, *, bare: bool = True, kept: bool = True):
        self.name, self._bare, self._kept = function.__name__, bare, kept
        self._inner = numba.njit(inline="always", **(BARE if bare else SEMANTICS))(function)
        self._layouts: dict[tuple, Layout] = {}

    def __call__(self, *arguments: Any, parts: int = 1, memory: dict[type, Any] | None = None) -> int:
        """Call it with so many threads.  A tuple that is an argument of many calls lies in a ``memory``, which has the last one of each of
        its types (None at first); calls have its address alone."""
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
        """For so many combinations of types it is compiled."""
        return len(self._layouts)

    def _compiled(self, kind: types.BaseTuple, elsewhere: tuple[bool, ...]) -> Any:
        """The function for arguments of this type; of those that lie elsewhere words have the address."""
        name = f"{self.name}_{hashlib.sha256(f'{kind}{elsewhere}'.encode()).hexdigest()[:12]}"
        return at_address(_entry(name, self._inner, kind, elsewhere), ENTRY, bare=self._bare, kept=self._kept)


def _entry(name: str, kernel: Callable, kind: types.BaseTuple, elsewhere: tuple[bool, ...]) -> FunctionType:
    """The function that is called by its address.  It is written out for so many arguments: what numba is given a list of it calls, and
    does not put in."""
    given = ", ".join(f"its[{k}]" for k in range(len(kind)))
    text = f"def {name}(words, part, parts, team):\n    its = arguments(words)\n    return kernel({given}, part, parts, team)\n"
    names: dict[str, Any] = {"kernel": kernel, "arguments": reader_of(kind, elsewhere), "__name__": __name__}
    exec(compile(text, __file__, "exec"), names)
    return names[name]
