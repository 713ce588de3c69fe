"""Operations that numba has no words for: on bits, and on eight numbers at once.

They are written as plain LLVM instructions, which exist on every processor; the compiler picks the best that the present one has.
"""

from typing import Any

from llvmlite import ir
from numba import types
from numba.extending import intrinsic

LANES = 8

#: Its arguments are values when it is called, and types when it is compiled.
instruction: Any = intrinsic


@instruction
def lowest_bit(typing, bits):
    """Place of the lowest bit that is set; anything from 0 to 64 if none is."""

    def code(context, builder, signature, arguments):
        return builder.cttz(arguments[0], ir.Constant(ir.IntType(1), 0))

    return types.uint64(types.uint64), code


@instruction
def bits_set(typing, bits):
    """How many bits are set."""

    def code(context, builder, signature, arguments):
        return builder.ctpop(arguments[0])

    return types.uint64(types.uint64), code


def lanes_at(context, builder, kind, array, index, vector):
    """Pointer to eight elements of an array."""
    data = context.make_array(kind)(context, builder, array).data
    return builder.bitcast(builder.gep(data, [index]), vector.as_pointer())


def splatted(builder, value, vector):
    """Eight times the same value."""
    one = builder.insert_element(ir.Constant(vector, ir.Undefined), value, ir.Constant(ir.IntType(32), 0))
    return builder.shuffle_vector(one, one, ir.Constant(ir.VectorType(ir.IntType(32), LANES), [0] * LANES))


@instruction
def copy_shifted(typing, source, first, shift, target, at):
    """target[at:at + 8] = source[first:first + 8] + shift, arrays of float64."""

    def code(context, builder, signature, arguments):
        vector = ir.VectorType(ir.DoubleType(), LANES)
        read = lanes_at(context, builder, signature.args[0], arguments[0], arguments[1], vector)
        write = lanes_at(context, builder, signature.args[3], arguments[3], arguments[4], vector)
        moved = builder.fadd(builder.load(read, align=8), splatted(builder, arguments[2], vector))
        builder.store(moved, write, align=8)
        return context.get_dummy_value()

    return types.void(source, first, shift, target, at), code


@instruction
def count_up(typing, first, target, at):
    """target[at:at + 8] = first, first + 1, ..., an array of uint32."""

    def code(context, builder, signature, arguments):
        vector = ir.VectorType(ir.IntType(32), LANES)
        write = lanes_at(context, builder, signature.args[1], arguments[1], arguments[2], vector)
        start = splatted(builder, builder.trunc(arguments[0], ir.IntType(32)), vector)
        builder.store(builder.add(start, ir.Constant(vector, list(range(LANES)))), write, align=4)
        return context.get_dummy_value()

    return types.void(first, target, at), code
