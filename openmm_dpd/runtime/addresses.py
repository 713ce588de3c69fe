"""Access to memory by address from compiled code: words, functions, and words that several threads share.

A *word* is 64 bits: an integer, or the bits of a float64.  The instructions are written with llvmlite; ``tests/core/test_runtime.py`` tries
them.
"""

import platform
from collections.abc import Callable
from inspect import Parameter, Signature
from typing import Any

from llvmlite import ir
from numba import types
from numba.extending import intrinsic

_WORD, _INT = ir.IntType(64), types.int64
#: Arguments of every compiled kernel: address of the words of its own arguments, number of this thread, number of threads, and address of
#: the team where they meet (:mod:`.team`).
ENTRY = (_INT, _INT, _INT, _INT)


def instruction(signature: Callable) -> Callable[[Callable], Any]:
    """Decorator of a function that emits LLVM code for a call in a kernel; ``signature`` maps types of arguments to numba's signature."""

    def made(code):
        def of_types(typing, *kinds):
            return signature(*kinds), code

        of_types.__name__, of_types.__doc__ = code.__name__, code.__doc__
        given = Parameter("typing", Parameter.POSITIONAL_OR_KEYWORD), *Signature.from_callable(signature).parameters.values()
        of_types.__signature__ = Signature(given)  # type: ignore[attr-defined]
        return intrinsic(of_types)

    return made


def _pointer(builder, address, place, kind=_WORD):
    """Pointer to word number ``place`` from an address on."""
    offset = builder.mul(place, ir.Constant(_WORD, 8))
    return builder.inttoptr(builder.add(address, offset), kind.as_pointer())


@instruction(lambda address, place: _INT(_INT, _INT))
def word(context, builder, signature, arguments):
    """The word at a place."""
    return builder.load(_pointer(builder, *arguments))


@instruction(lambda address, place, value: types.void(_INT, _INT, _INT))
def put_word(context, builder, signature, arguments):
    """Write a word to a place."""
    builder.store(arguments[2], _pointer(builder, *arguments[:2]))
    return context.get_dummy_value()


@instruction(lambda source, target, count: types.void(_INT, _INT, _INT))
def copy_words(context, builder, signature, arguments):
    """Copy ``count`` words from one address to another; the two ranges must not overlap."""
    source, target, count = arguments
    pointer = ir.IntType(8).as_pointer()
    function = builder.module.declare_intrinsic("llvm.memcpy", [pointer, pointer, _WORD])
    places, size = (builder.inttoptr(each, pointer) for each in (target, source)), builder.mul(count, ir.Constant(_WORD, 8))
    builder.call(function, [*places, size, ir.Constant(ir.IntType(1), 0)])
    return context.get_dummy_value()


@instruction(lambda address, place: _INT(_INT, _INT))
def shared_word(context, builder, signature, arguments):
    """The word at a place that another thread writes; whatever that thread wrote before it is visible from then on."""
    return builder.load_atomic(_pointer(builder, *arguments), "acquire", 8)


@instruction(lambda address, place, value: types.void(_INT, _INT, _INT))
def share_word(context, builder, signature, arguments):
    """Write a word that another thread reads with :func:`shared_word`."""
    builder.store_atomic(arguments[2], _pointer(builder, *arguments[:2]), "release", 8)
    return context.get_dummy_value()


@instruction(lambda address, place, value: _INT(_INT, _INT, _INT))
def add_to_word(context, builder, signature, arguments):
    """Add to a word that other threads add to as well; returns its previous value."""
    return builder.atomic_rmw("add", _pointer(builder, *arguments[:2]), arguments[2], "seq_cst")


@instruction(lambda: types.void())
def pause(context, builder, signature, arguments):
    """Leave the core to its other hardware thread for a moment, on processors that can."""
    if platform.machine() in ("x86_64", "AMD64"):
        builder.call(builder.module.declare_intrinsic("llvm.x86.sse2.pause", (), ir.FunctionType(ir.VoidType(), [])), [])
    return context.get_dummy_value()


@instruction(lambda: _INT())
def cycles(context, builder, signature, arguments):
    """The cycle counter of the processor."""
    return builder.call(builder.module.declare_intrinsic("llvm.readcyclecounter", (), ir.FunctionType(_WORD, [])), [])


@instruction(lambda function: types.void(_INT))
def call_plain(context, builder, signature, arguments):
    """Call a C function without arguments by its address."""
    function = ir.FunctionType(ir.IntType(32), [])
    builder.call(builder.inttoptr(arguments[0], function.as_pointer()), [])
    return context.get_dummy_value()


@instruction(lambda function, words, part, parts, team: _INT(_INT, *ENTRY))
def call_kernel(context, builder, signature, arguments):
    """Call a kernel by its address."""
    function = ir.FunctionType(_WORD, [_WORD] * len(ENTRY))
    return builder.call(builder.inttoptr(arguments[0], function.as_pointer()), arguments[1:])


def _laid_down(context, builder, kind, address, place: int) -> tuple[Any, int]:
    """A value of a type, read from the words at an address from number ``place`` on; and the number of the next word."""

    def read(n: int, of=_WORD):
        return builder.load(_pointer(builder, address, ir.Constant(_WORD, n), of))

    if isinstance(kind, types.BaseTuple):
        found = []
        for each in kind:  # type: ignore[attr-defined]  # of all tuples that numba has
            value, place = _laid_down(context, builder, each, address, place)
            found.append(value)
        return context.make_tuple(builder, kind, found), place
    if isinstance(kind, types.Array):
        array, n = context.make_array(kind)(context, builder), kind.ndim
        element = context.get_data_type(kind.dtype)
        size = context.get_abi_sizeof(element)
        lengths = [read(place + 1 + k) for k in range(n)]
        if kind.layout == "C":  # known to the compiler, which can then keep to whole vectors
            strides = [ir.Constant(_WORD, size)] * n
            for k in reversed(range(n - 1)):
                strides[k] = builder.mul(strides[k + 1], lengths[k + 1])
        else:
            strides = [read(place + 1 + n + k) for k in range(n)]
        items = ir.Constant(_WORD, 1)
        for length in lengths:
            items = builder.mul(items, length)
        array.data = builder.inttoptr(read(place), element.as_pointer())
        array.shape, array.strides = (_packed(builder, numbers) for numbers in (lengths, strides))
        array.itemsize, array.nitems = ir.Constant(_WORD, size), items
        array.meminfo = ir.Constant(array.meminfo.type, None)
        array.parent = ir.Constant(array.parent.type, None)
        return array._getvalue(), place + 1 + 2 * n
    if isinstance(kind, types.Float):
        return read(place, ir.DoubleType()), place + 1
    whole = read(place)
    if isinstance(kind, types.Boolean):
        return builder.icmp_unsigned("!=", whole, ir.Constant(_WORD, 0)), place + 1
    return whole, place + 1


def _packed(builder, numbers):
    made = ir.Constant(ir.ArrayType(_WORD, len(numbers)), ir.Undefined)
    for k, number in enumerate(numbers):
        made = builder.insert_value(made, number, k)
    return made


def reader_of(kind: types.BaseTuple, elsewhere: tuple[bool, ...]) -> Any:
    """Instruction (address of words) -> tuple of this type, read from consecutive words as :mod:`.native` writes them; items that lie
    ``elsewhere`` have one word there, the address of their own words."""

    @instruction(lambda address: kind(_INT))
    def laid_down(context, builder, signature, arguments):
        found, place = [], 0
        for each, away in zip(kind, elsewhere, strict=True):  # type: ignore[call-overload]
            if away:
                there = builder.load(_pointer(builder, arguments[0], ir.Constant(_WORD, place)))
                value, place = _laid_down(context, builder, each, there, 0)[0], place + 1
            else:
                value, place = _laid_down(context, builder, each, arguments[0], place)
            found.append(value)
        return context.make_tuple(builder, kind, found)

    return laid_down
