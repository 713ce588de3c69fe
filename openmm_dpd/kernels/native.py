"""Kernels: compiled functions that threads share, called by their address with arguments that lie in memory.

A kernel is written as a function ``(..., part, parts, team)``.  All ``parts`` threads of a team call it at once, each does its share, and
where one needs what another has done they meet (:func:`.team.meet`).  It returns 0, or another number where it could not do its work: for
want of room, say.  One thread alone is a team of one, so there is one compiled version for any number of threads.

Its own arguments, arrays, numbers, and tuples of these, are written down as words behind each other: an array as the address of its data,
lengths and strides, a number as itself.  So all kernels are called alike, and what was called once can be called again from compiled code,
with other numbers in some places (:mod:`.tape`).
"""

import ctypes
import hashlib
from collections.abc import Callable
from struct import Struct
from types import FunctionType
from typing import Any

import numba
import numpy as np
from numba import types

from .addresses import ENTRY, reader_of
from .compiled import BARE, DIGEST, SEMANTICS, at_address
from .tape import TAPES, KernelCall
from .team import CALL, the_team
from .threads import dispatch, rest

#: Flags of an array: contiguous in C's order, and writeable.
_PLAIN = 0x0001 | 0x0400
_byte_of: Any = ctypes.c_char.from_buffer
_address_of = ctypes.addressof


def _add_words(value: Any, words: list[Any], kinds: list[Any]) -> None:
    """Add the words of an argument, and what says how they are to be read."""
    if isinstance(value, np.ndarray):
        flags = value.flags.num & _PLAIN
        # the short way to the address takes a quarter of a microsecond, numpy's own takes one
        quick = flags == _PLAIN and value.size
        words.append(_address_of(_byte_of(value)) if quick else value.__array_interface__["data"][0])
        words += value.shape
        words += value.strides
        kinds += value.dtype.num, value.ndim, flags
    elif isinstance(value, tuple):
        kinds.append(type(value))
        for each in value:
            _add_words(each, words, kinds)
        kinds.append(len(value))
    else:
        words.append(value)
        kinds.append(type(value))


#: How a number is packed; whole numbers are signed, but for those of numpy that are not.
_FORMATS = {float: "d", np.float64: "d", np.uint64: "Q"}


class Memory:
    """Words of the last tuple of each of some kinds: those that stay the same for many calls."""

    def __init__(self, *kinds: type):
        self.kinds: dict[type, tuple] = {kind: (None,) for kind in kinds}

    def add_words(self, value: tuple, words: list[Any], kinds: list[Any]) -> None:
        """As :func:`_add_words`."""
        known = self.kinds[type(value)]
        if known[0] is not value:
            known = value, [], []
            _add_words(*known)
            self.kinds[type(value)] = known
        words += known[1]
        kinds += known[2]


class Layout:
    """How the arguments of one call lie in memory, and the compiled function that reads them there."""

    def __init__(self, made: Any, arguments: tuple):
        self.made, self.address, self.alone = made, made.address, CALL(made.address)
        formats: list[str] = []
        #: where the numbers and arrays of records lie, by their names: those of the last one that has this name
        self.places: dict[str, int] = {}
        self._walk(arguments, formats, "")
        self.pack = Struct("".join(formats)).pack

    def _walk(self, value: Any, formats: list[str], name: str) -> None:
        self.places[name] = len(formats)
        if isinstance(value, tuple):
            for each, its in zip(value, getattr(value, "_fields", [""] * len(value)), strict=True):
                self._walk(each, formats, its)
        elif isinstance(value, np.ndarray):
            formats += "q" * (1 + 2 * value.ndim)
        else:
            formats.append(_FORMATS.get(type(value), "q"))


def _alone(layout: Layout, packed: bytes, parts: int) -> int:
    return layout.alone(packed, 0, 1, 0)


def _together(layout: Layout, packed: bytes, parts: int) -> int:
    found = the_team().run(layout.address, packed, parts)
    if the_team().crowded:
        rest()
    return found


def run(layout: Layout, packed: bytes, parts: int) -> int:
    """Call a kernel with so many threads, where there are cores for them."""
    return _alone(layout, packed, 1) if parts == 1 else dispatch(_alone, _together, layout, packed, parts, threads=parts)


class Kernel:
    """A function as above, compiled for each combination of types it is called with; ``bare`` and ``kept`` as in
    :func:`.compiled.compiled`."""

    def __init__(self, function: Callable, *, bare: bool = True, kept: bool = True):
        self.name, self._bare, self._kept = function.__name__, bare, kept
        self._inner = numba.njit(inline="always", **(BARE if bare else SEMANTICS))(function)
        self._layouts: dict[tuple, Layout] = {}

    def __call__(self, *arguments: Any, parts: int = 1, memory: Memory | None = None) -> int:
        """Call it with so many threads; ``memory`` belongs to who has the tuples in it."""
        words: list[Any] = []
        kinds: list[Any] = []
        for each in arguments:
            if memory is not None and type(each) in memory.kinds:
                memory.add_words(each, words, kinds)
            else:
                _add_words(each, words, kinds)
        found = tuple(kinds)
        layout = self._layouts.get(found)
        if layout is None:
            layout = self._layouts[found] = Layout(self._compiled(numba.typeof(arguments)), arguments)
        packed = layout.pack(*words)
        if TAPES.running is not None:
            TAPES.running.calls.append(KernelCall(layout, packed, parts, arguments))
        return run(layout, packed, parts)

    @property
    def versions(self) -> int:
        """For so many combinations of types it is compiled."""
        return len(self._layouts)

    def _compiled(self, kind: types.BaseTuple) -> Any:
        """The function for arguments of this type."""
        name = f"{self.name}_{DIGEST}_{hashlib.sha256(str(kind).encode()).hexdigest()[:12]}"
        return at_address(_entry(name, self._inner, kind), ENTRY, bare=self._bare, kept=self._kept)


def _entry(name: str, kernel: Callable, kind: types.BaseTuple) -> FunctionType:
    """The function that is called by its address.  It is written out for so many arguments: what numba is given a list of it calls, and
    does not put in."""
    given = ", ".join(f"its[{k}]" for k in range(len(kind)))
    text = f"def {name}(words, part, parts, team):\n    its = arguments(words)\n    return kernel({given}, part, parts, team)\n"
    names: dict[str, Any] = {"kernel": kernel, "arguments": reader_of(kind), "__name__": __name__}
    exec(compile(text, __file__, "exec"), names)
    return names[name]
