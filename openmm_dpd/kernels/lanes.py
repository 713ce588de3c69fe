"""Eight numbers at once as values of compiled functions: they live in vector registers through a loop.

Loops that add up many things at once are not vectorised without fastmath, and numba does not know which arrays overlap.  Here both are
written down::

    total = splat(0.0)
    for k in range(n):
        total = total + load_lanes(a, 8 * k) * splat(b[k])
    store_lanes(c, 0, total)

Each lane is plain arithmetic on float64, in the order in which it stands, on every processor.
"""

import operator

from llvmlite import ir
from numba import types
from numba.extending import models, overload, register_model

from .vectors import LANES, instruction, lanes_at, splatted

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
