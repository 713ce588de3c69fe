"""Formulas: a recursive-descent evaluator of LAMMPS's grammar, for a single number (equal-style) or one number per bead (atom-style).

Operators in order of increasing precedence, all left-associative: ``||``, ``&&``, ``== !=``, ``< <= > >=``, ``+ -``, ``* / %``, ``^``, and
unary ``-`` and ``!``, so that ``-2^2`` is 4 and ``2^3^2`` is 64.  Operators and functions are for numbers, arrays over beads and OpenMM
expressions.
"""

import math
import operator
import re
from abc import ABC, abstractmethod
from collections.abc import Callable
from functools import lru_cache
from typing import Any, NamedTuple, NoReturn, TypeVar

import numpy as np

from ...base.errors import DPDError, ParameterError
from .arguments import near


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


T = TypeVar("T")
#: Functions of groups and of labels of types: their arguments are names, not formulas.
GROUP_FUNCTIONS = ("count", "mass", "charge", "xcm", "vcm", "ke", "bound", "label2type", "is_typelabel")
#: Functions of all values of a vector, whose argument is its name.
VECTOR_FUNCTIONS: dict[str, Callable[[np.ndarray], float]] = {
    **{"sum": lambda x: float(np.sum(x)), "min": lambda x: float(np.min(x)), "max": lambda x: float(np.max(x))},
    **{"ave": lambda x: float(np.mean(x)), "trap": lambda x: float(np.sum(x) - (x[0] + x[-1]) / 2)},
    "slope": lambda x: float(np.polyfit(np.arange(len(x)), x, 1)[0]) if len(x) > 1 else 1e20,
}
#: Values of a single bead that formulas may use, by its id: ``x[17]``.
ATOM_VALUES = ("id", "mass", "type", "mol", "x", "y", "z", "vx", "vy", "vz", "fx", "fy", "fz", "q")
CONSTANTS = {"PI": math.pi, "yes": 1.0, "on": 1.0, "true": 1.0, "no": 0.0, "off": 0.0, "false": 0.0}


#: Functions that depend on the state of the run: number of arguments by name.
STATE_FUNCTIONS = {"random": 3, "normal": 3, "ramp": 2, "vdisplace": 2, "swiggle": 3, "cwiggle": 3}

_TOKEN = re.compile(
    r"\s*(?:(?P<number>(?:\d+\.?\d*|\.\d+)(?:[eE][+-]?\d+)?)"
    r"|(?P<name>[A-Za-z_]\w*)"
    r"|(?P<operator>\|\||&&|==|!=|<=|>=|[-+*/%^()<>!,\[\]])"
    r"|(?P<bad>\S))",
    re.ASCII,
)


@lru_cache
def _tokens(pattern: re.Pattern[str], text: str) -> list[tuple[str, str]]:
    """Kind and text of each token, and of the end or the first bad one; cached, since an expression may be evaluated at every step."""
    found = [(str(match.lastgroup), str(match[match.lastgroup or 0])) for match in pattern.finditer(text)]
    return [*found, next((token for token in found if token[0] == "bad"), ("end", ""))]


def evaluate(text: str, resolver: Any) -> float:
    """Value of a formula such as ``pe/count(all)+v_offset``.  The methods ``thermo``, ``variable``, ``compute``, ``fix``, ``group``,
    ``atom`` and ``call`` of ``resolver`` return the values of names.  ParameterError if the formula is malformed, divides by zero, leaves
    the domain of a function, or uses an unknown name."""
    return Formula(text, resolver).value()


class Expression(ABC):
    """A text of values, operators and parentheses, evaluated while it is parsed."""

    #: Its name in error messages, the pattern of its tokens, and its binary operators in order of increasing precedence.
    what: str
    pattern: re.Pattern[str]
    levels: tuple[dict[str, Any], ...]
    ranks: dict[str, int]  #: Index into ``levels`` for each operator

    def __init_subclass__(cls):
        if "levels" in vars(cls):
            cls.ranks = {operator: level for level, operators in enumerate(cls.levels) for operator in operators}

    def __init__(self, text: str):
        self.text, self.at, self.tokens = text, 0, _tokens(self.pattern, text)
        if self.tokens[-1][0] == "bad":
            self.fail(f"unexpected {self.tokens[-1][1]!r}")

    def fail(self, why: str) -> NoReturn:
        raise ParameterError(f"cannot evaluate the {self.what} '{self.text}': {why}")

    def value(self) -> Any:
        """Evaluate the whole text."""
        try:
            result = self.binary(0)
        except ZeroDivisionError:
            self.fail("division by zero")
        except RecursionError:
            raise ParameterError(f"cannot evaluate the {self.what} '{self.text[:40]} ...': it is nested too deeply") from None
        except (ValueError, OverflowError) as error:
            if isinstance(error, DPDError):
                raise
            self.fail(str(error))
        if self.peek()[0] != "end":
            self.fail(f"unexpected {self.peek()[1]!r}")
        return result

    def peek(self) -> tuple[str, str]:
        return self.tokens[self.at]

    def take(self) -> tuple[str, str]:
        token = self.tokens[self.at]
        if token[0] == "end":
            self.fail("it ends unexpectedly" if self.at else "it is empty")
        self.at += 1
        return token

    def binary(self, level: int) -> Any:
        left = self.unary()
        while (found := self.ranks.get(self.tokens[self.at][1], -1)) >= level:
            operator = self.take()[1]
            left = self.combined(operator, self.levels[found][operator], left, self.binary(found + 1))
        return left

    @abstractmethod
    def unary(self) -> Any:
        """Evaluate the next value, including its unary operators."""

    @abstractmethod
    def combined(self, operator: str, operation: Any, left: Any, right: Any) -> Any:
        """Apply a binary operator, whose entry in ``levels`` is ``operation``, to two values."""


class Formula(Expression):
    """One evaluation of a formula."""

    what, pattern, levels = "formula", _TOKEN, LEVELS
    #: The field of Operation that it uses.
    kind = "number"

    def __init__(self, text: str, resolver: Any):
        super().__init__(text)
        self.resolver = resolver

    def expect(self, operator: str) -> None:
        if self.peek()[1] != operator:
            found = repr(self.peek()[1]) if self.peek()[1] else "its end"
            self.fail(f"expected {operator!r} instead of {found}")
        self.at += 1

    def combined(self, operator: str, operation: Operation, left: Any, right: Any) -> Any:
        return getattr(operation, self.kind)(left, right)

    def unary(self) -> float:
        kind, token = self.take()
        if token in UNARY:
            return getattr(UNARY[token], self.kind)(self.unary())
        if token == "(":
            inside = self.binary(0)
            self.expect(")")
            return inside
        if kind == "number":
            return getattr(LITERAL, self.kind)(token)
        if kind == "name":
            return self.name(token)
        self.fail(f"unexpected {token!r}")

    def name(self, token: str) -> float:
        following = self.tokens[self.at][1]
        if token.startswith("v_"):
            return self.resolver.variable(token[2:], self.index()) if following == "[" else self.resolver.variable(token[2:])
        if token.startswith("c_"):
            return self.indexed(self.resolver.compute, token[2:])
        if token.startswith("f_"):
            return self.indexed(self.resolver.fix, token[2:])
        if following == "(":
            return self.function(token)
        if following == "[" and token in ATOM_VALUES:
            return self.resolver.atom(token, self.index() or 0)
        if token in CONSTANTS:
            return CONSTANTS[token]
        return self.resolver.thermo(token)

    def indexed(self, ask: Callable[..., float], name: str) -> float:
        index = self.index()
        return ask(name, index) if self.peek()[1] != "[" else ask(name, index, self.index())

    def index(self) -> int | None:
        if self.peek()[1] != "[":
            return None
        self.take()
        value = self.binary(0)
        self.expect("]")
        return int(value)

    def function(self, token: str) -> float:
        if token in GROUP_FUNCTIONS:
            return self.resolver.group(token, self.listed(self.word))
        if token in VECTOR_FUNCTIONS:
            self.expect("(")
            index = self.index() if (word := self.take()[1]) and self.peek()[1] == "[" else None
            self.expect(")")
            values = self.resolver.vector(word if index is None else f"{word}[{index}]")
            return VECTOR_FUNCTIONS[token](values) if len(values) else self.fail(f"{word} has no values yet")
        expected = FUNCTIONS[token][0] if token in FUNCTIONS else STATE_FUNCTIONS.get(token)
        if expected is None:
            known = sorted([*FUNCTIONS, *STATE_FUNCTIONS, *GROUP_FUNCTIONS, *VECTOR_FUNCTIONS])
            self.fail(f"there is no function {token}; known are {', '.join(known)}{near(token, known)}")
        arguments = self.listed(lambda: self.binary(0))
        if len(arguments) != expected:
            self.fail(f"{token} takes {expected} arguments, not {len(arguments)}")
        if token in FUNCTIONS:
            return getattr(FUNCTIONS[token][1], self.kind)(*arguments)
        return self.resolver.call(token, arguments)

    def word(self) -> str:
        """A name, up to the next comma or parenthesis; labels have other characters, too."""
        found = self.take()[1]
        while self.peek()[1] not in (",", ")", ""):
            found += self.take()[1]
        return found

    def listed(self, one: Callable[[], T], marks: str = "()") -> list[T]:
        """Parse comma-separated items between parentheses, or two other marks."""
        self.expect(marks[0])
        found = [one()]
        while self.peek()[1] == ",":
            self.take()
            found.append(one())
        self.expect(marks[1])
        return found


Value = float | str

_CONDITION_LEVELS: tuple[dict[str, Callable[[float, float], bool]], ...] = (
    {"||": lambda a, b: a != 0 or b != 0, "|^": lambda a, b: (a != 0) != (b != 0)},
    {"&&": lambda a, b: a != 0 and b != 0},
    {"==": operator.eq, "!=": operator.ne},
    {"<": operator.lt, "<=": operator.le, ">": operator.gt, ">=": operator.ge},
)

_CONDITION_TOKEN = re.compile(
    r"\s*(?:(?P<number>-?(?:\d+\.?\d*|\.\d+)(?:[eE][+-]?\d+)?)"
    r"|(?P<text>[A-Za-z][A-Za-z0-9_/]*)"
    r"|(?P<operator>\|\||\|\^|&&|==|!=|<=|>=|[<>!()])"
    r"|(?P<bad>\S))",
    re.ASCII,
)


class _Condition(Expression):
    """A condition: numbers and strings, compared and combined.

    Operators in order of increasing precedence, all left-associative: ``||`` and ``|^`` (exclusive or), ``&&``, ``== !=``, ``< <= > >=``,
    and ``!``.  Strings consist of letters, digits, ``_`` and ``/``, begin with a letter, and can only be compared by ``==`` and ``!=``.
    """

    what, pattern, levels = "condition", _CONDITION_TOKEN, _CONDITION_LEVELS

    def combined(self, operator: str, operation: Callable[[Value, Value], bool], left: Value, right: Value) -> Value:
        texts = isinstance(left, str) + isinstance(right, str)
        if texts == 1 or (texts and operator not in ("==", "!=")):
            self.fail(f"{operator} cannot compare {_name(left)} with {_name(right)}")
        return float(operation(left, right))

    def unary(self) -> Value:
        kind, token = self.take()
        if token == "(":
            inside = self.binary(0)
            if self.peek()[1] not in (")", ""):
                self.fail(f"unexpected {self.peek()[1]!r}")
            self.take()
            return inside
        if token == "!":
            value = self.unary()
            if isinstance(value, str):
                self.fail(f"! needs a number, not {_name(value)}")
            return float(value == 0)
        if kind == "number":
            return float(token)
        if kind == "text":
            return token
        self.fail(f"unexpected {token!r}")


def _name(value: Value) -> str:
    return f"the string '{value}'" if isinstance(value, str) else f"the number {value:g}"


def condition_holds(text: str) -> bool:
    """Whether the condition of an ``if`` command is true; variables must already be substituted.  ParameterError if it is malformed,
    compares a string with a number, or is a single string.

    >>> condition_holds("2 < 3 && north != south")
    True
    """
    condition = _Condition(text)
    value: Value = condition.value()
    if isinstance(value, str):
        condition.fail(f"it is {_name(value)}; compare it, as in '{value} == yes'")
    return value != 0
