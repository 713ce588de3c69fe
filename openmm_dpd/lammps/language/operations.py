"""Operators and functions of formulas for three kinds of values: numbers, arrays over beads, and OpenMM expressions."""

import math
import operator
from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np


class Operation(NamedTuple):
    """An operator or function for numbers, for arrays over beads, and for texts in OpenMM's expression language."""

    number: Callable[..., float]
    beads: Callable[..., Any]
    text: Callable[..., str]


def _rounded(value: float) -> float:
    """The nearest whole number; halves are rounded up."""
    return math.copysign(math.ceil(value) if value - math.floor(value) >= 0.5 else math.floor(value), value)


def _truth(function: Callable[..., Any]) -> Callable[..., np.ndarray]:
    """Wrap a function so that it returns 0 and 1 instead of booleans."""
    return lambda *values: np.asarray(function(*values), dtype=np.float64)


def _power(base: Any, exponent: Any) -> np.ndarray:
    if np.any(np.asarray(exponent) == 0):
        raise ValueError("the exponent is 0, which LAMMPS rejects in atom-style formulas")
    return np.power(base, exponent)


def _remainder(a: str, b: str) -> str:
    return f"({a}-{b}*select(step({a}/{b}),floor({a}/{b}),ceil({a}/{b})))"


#: Unary operators, which have the highest precedence.
UNARY = {
    "+": Operation(lambda a: a, lambda a: a, lambda a: a),
    "-": Operation(operator.neg, np.negative, lambda a: f"(-{a})"),
    "!": Operation(lambda a: float(a == 0), _truth(np.logical_not), lambda a: f"delta({a})"),
}

#: Conversion of a literal number.
LITERAL = Operation(float, float, lambda word: repr(float(word)))

#: Binary operators in order of increasing precedence.
LEVELS: tuple[dict[str, Operation], ...] = (
    {"||": Operation(lambda a, b: float(a != 0 or b != 0), _truth(np.logical_or), lambda a, b: f"(1-delta({a})*delta({b}))")},
    {"&&": Operation(lambda a, b: float(a != 0 and b != 0), _truth(np.logical_and), lambda a, b: f"((1-delta({a}))*(1-delta({b})))")},
    {
        "==": Operation(lambda a, b: float(a == b), _truth(np.equal), lambda a, b: f"delta({a}-{b})"),
        "!=": Operation(lambda a, b: float(a != b), _truth(np.not_equal), lambda a, b: f"(1-delta({a}-{b}))"),
    },
    {
        "<": Operation(lambda a, b: float(a < b), _truth(np.less), lambda a, b: f"(1-step({a}-{b}))"),
        "<=": Operation(lambda a, b: float(a <= b), _truth(np.less_equal), lambda a, b: f"step({b}-{a})"),
        ">": Operation(lambda a, b: float(a > b), _truth(np.greater), lambda a, b: f"(1-step({b}-{a}))"),
        ">=": Operation(lambda a, b: float(a >= b), _truth(np.greater_equal), lambda a, b: f"step({a}-{b})"),
    },
    {"+": Operation(operator.add, np.add, lambda a, b: f"({a}+{b})"), "-": Operation(operator.sub, np.subtract, lambda a, b: f"({a}-{b})")},
    {
        "*": Operation(operator.mul, np.multiply, lambda a, b: f"({a}*{b})"),
        "/": Operation(operator.truediv, np.divide, lambda a, b: f"({a}/{b})"),
        "%": Operation(math.fmod, np.fmod, _remainder),
    },
    {"^": Operation(math.pow, _power, lambda a, b: f"({a}^{b})")},
)


def _plain(name: str, number: Callable[..., float], beads: Callable[..., Any]) -> tuple[int, Operation]:
    """A function of one argument; ``name`` is its name in OpenMM."""
    return 1, Operation(number, beads, lambda a: f"{name}({a})")


#: Functions by name: number of arguments and operation.
FUNCTIONS: dict[str, tuple[int, Operation]] = {
    "sqrt": _plain("sqrt", math.sqrt, np.sqrt),
    "exp": _plain("exp", math.exp, np.exp),
    "ln": _plain("log", math.log, np.log),
    "log": (1, Operation(math.log10, np.log10, lambda a: f"(log({a})/log(10))")),
    "abs": _plain("abs", abs, np.abs),
    "sign": (
        1,
        Operation(lambda x: 1.0 if x >= 0 else -1.0, lambda x: np.where(np.asarray(x) >= 0, 1.0, -1.0), lambda a: f"(2*step({a})-1)"),
    ),
    **{name: _plain(name, getattr(math, name), getattr(np, name)) for name in ("sin", "cos", "tan")},
    **{name: _plain(name, getattr(math, name), getattr(np, f"arc{name[1:]}")) for name in ("asin", "acos", "atan")},
    "atan2": (2, Operation(math.atan2, np.arctan2, lambda a, b: f"atan2({a},{b})")),
    "ceil": _plain("ceil", lambda x: math.copysign(math.ceil(x), x), np.ceil),
    "floor": _plain("floor", lambda x: math.copysign(math.floor(x), x), np.floor),
    "round": (
        1,
        Operation(
            _rounded,
            lambda x: np.where(x - np.floor(x) >= 0.5, np.ceil(x), np.floor(x)),
            lambda a: f"select(step({a}-floor({a})-0.5),ceil({a}),floor({a}))",
        ),
    ),
    "ternary": (
        3,
        Operation(
            lambda test, yes, no: yes if test else no,
            lambda test, yes, no: np.where(np.asarray(test) != 0, yes, no),
            lambda test, yes, no: f"select({test},{yes},{no})",
        ),
    ),
}
