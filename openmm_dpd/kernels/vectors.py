"""Operations that numba has no words for: on bits, and on eight numbers at once, as instructions of llvmlite.

They are plain LLVM instructions, which exist on every processor; the compiler picks the best that the present one has.

Loops that add up many things at once are not vectorised without fastmath, and numba does not know which arrays overlap.  With eight
numbers as one value (``Lanes``), which stays in vector registers through a loop, both are written down::

    total = splat(0.0)
    for k in range(n):
        total = total + load_lanes(a, 8 * k) * splat(b[k])
    store_lanes(c, 0, total)

Each lane is plain arithmetic on float64, in the order in which it is written, on every processor.

Where a release of numba or llvmlite changes these instructions, ``tests/core/test_private_interfaces.py`` fails: each of them is a loop
over eight numbers that numba compiles too, with the same results.
"""

import operator

from llvmlite import ir
from numba import types
from numba.extending import models, overload, register_model

from ..runtime import instruction

LANES = 8
#: So many numbers of half the length are treated at once.
_SINGLES = 16


@instruction(lambda bits: types.uint64(types.uint64))
def lowest_bit(context, builder, signature, arguments):
    """Place of the lowest bit that is set; anything from 0 to 64 if none is."""
    return builder.cttz(arguments[0], ir.Constant(ir.IntType(1), 0))


@instruction(lambda bits: types.uint64(types.uint64))
def bits_set(context, builder, signature, arguments):
    """How many bits are set."""
    return builder.ctpop(arguments[0])


def lanes_at(context, builder, kind, array, index, vector):
    """Pointer to eight elements of an array."""
    data = context.make_array(kind)(context, builder, array).data
    return builder.bitcast(builder.gep(data, [index]), vector.as_pointer())


def splatted(builder, value, vector):
    """The same value in each place of a vector."""
    one = builder.insert_element(ir.Constant(vector, ir.Undefined), value, ir.Constant(ir.IntType(32), 0))
    return builder.shuffle_vector(one, one, ir.Constant(ir.VectorType(ir.IntType(32), vector.count), [0] * vector.count))


@instruction(lambda source, first, shift, target, at: types.void(source, first, shift, target, at))
def copy_shifted(context, builder, signature, arguments):
    """target[at:at + 8] = source[first:first + 8] + shift, arrays of float64."""
    vector = ir.VectorType(ir.DoubleType(), LANES)
    read = lanes_at(context, builder, signature.args[0], arguments[0], arguments[1], vector)
    write = lanes_at(context, builder, signature.args[3], arguments[3], arguments[4], vector)
    moved = builder.fadd(builder.load(read, align=8), splatted(builder, arguments[2], vector))
    builder.store(moved, write, align=8)
    return context.get_dummy_value()


@instruction(lambda first, target, at: types.void(first, target, at))
def count_up(context, builder, signature, arguments):
    """target[at:at + 8] = first, first + 1, ..., an array of uint32."""
    vector = ir.VectorType(ir.IntType(32), LANES)
    write = lanes_at(context, builder, signature.args[1], arguments[1], arguments[2], vector)
    start = splatted(builder, builder.trunc(arguments[0], ir.IntType(32)), vector)
    builder.store(builder.add(start, ir.Constant(vector, list(range(LANES)))), write, align=4)
    return context.get_dummy_value()


@instruction(lambda xs, ys, zs, first, x, y, z, reach2: types.uint64(xs, ys, zs, first, x, y, z, reach2))
def close_by(context, builder, signature, arguments):
    """Which of the 64 points from the first one on, arrays of float32, are closer to (x, y, z) than a distance whose square is given, as
    bits."""
    vector, word, lanes = ir.VectorType(ir.FloatType(), _SINGLES), ir.IntType(64), ir.IntType(_SINGLES)
    middle, reach2 = [splatted(builder, a, vector) for a in arguments[4:7]], splatted(builder, arguments[7], vector)
    bits = ir.Constant(word, 0)
    for begin in range(0, 64, _SINGLES):
        index, squares = builder.add(arguments[3], ir.Constant(word, begin)), []
        for kind, array, at in zip(signature.args, arguments, middle, strict=False):
            apart = builder.fsub(at, builder.load(lanes_at(context, builder, kind, array, index, vector), align=4))
            squares.append(builder.fmul(apart, apart))
        r2 = builder.fadd(builder.fadd(squares[0], squares[1]), squares[2])
        found = builder.zext(builder.bitcast(builder.fcmp_ordered("<", r2, reach2), lanes), word)
        bits = builder.or_(bits, builder.shl(found, ir.Constant(word, begin)))
    return bits


@instruction(lambda array, index: types.void(array, types.uint64))
def fetch(context, builder, signature, arguments):
    """Have the processor bring nearer what is at a place of a contiguous array."""
    number, place = ir.IntType(32), ir.IntType(8).as_pointer()
    data = context.make_array(signature.args[0])(context, builder, arguments[0]).data
    its = ir.FunctionType(ir.VoidType(), [place, number, number, number])
    function = builder.module.declare_intrinsic("llvm.prefetch.p0", (), its)
    how = [ir.Constant(number, k) for k in (0, 2, 1)]  # to be read, to the second cache, data
    builder.call(function, [builder.bitcast(builder.gep(data, [arguments[1]]), place), *how])
    return context.get_dummy_value()


_VECTOR = ir.VectorType(ir.DoubleType(), LANES)


class Lanes(types.Type):
    """Type of eight float64."""

    def __init__(self) -> None:
        super().__init__(name="Lanes")


lanes = Lanes()


@register_model(Lanes)
class _LanesModel(models.PrimitiveModel):
    def __init__(self, manager, kind):
        super().__init__(manager, kind, _VECTOR)


@instruction(lambda array, index: lanes(array, types.intp))
def load_lanes(context, builder, signature, arguments):
    """array[index:index + 8] of a contiguous array of float64."""
    return builder.load(lanes_at(context, builder, signature.args[0], arguments[0], arguments[1], _VECTOR), align=8)


@instruction(lambda array, index, value: types.void(array, types.intp, lanes))
def store_lanes(context, builder, signature, arguments):
    """array[index:index + 8] = value."""
    builder.store(arguments[2], lanes_at(context, builder, signature.args[0], arguments[0], arguments[1], _VECTOR), align=8)
    return context.get_dummy_value()


@instruction(lambda value: lanes(types.float64))
def splat(context, builder, signature, arguments):
    """Eight times the same number."""
    return splatted(builder, arguments[0], _VECTOR)


@instruction(lambda value: lanes(lanes))
def floor(context, builder, signature, arguments):
    """The largest whole numbers that are not larger."""
    function = builder.module.declare_intrinsic(f"llvm.floor.v{LANES}f64", (), ir.FunctionType(_VECTOR, [_VECTOR]))
    return builder.call(function, arguments)


@instruction(lambda value: types.float64(lanes))
def total(context, builder, signature, arguments):
    """The sum of the eight, one after the other."""
    found = builder.extract_element(arguments[0], ir.Constant(ir.IntType(32), 0))
    for lane in range(1, LANES):
        found = builder.fadd(found, builder.extract_element(arguments[0], ir.Constant(ir.IntType(32), lane)))
    return found


def _arithmetic(word, build: str) -> None:
    """Let an operator work on two Lanes."""

    @instruction(lambda first, second: lanes(lanes, lanes))
    def of_two(context, builder, signature, arguments):
        return getattr(builder, build)(*arguments)

    @overload(word)
    def _operator(first, second):
        if isinstance(first, Lanes) and isinstance(second, Lanes):
            return lambda first, second: of_two(first, second)


_arithmetic(operator.add, "fadd")
_arithmetic(operator.sub, "fsub")
_arithmetic(operator.mul, "fmul")
