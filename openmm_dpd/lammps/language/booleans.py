"""Conditions of the ``if`` command: numbers and strings, compared and combined.

Operators from loose to tight, all from left to right: ``||`` and ``|^`` (one or the other, not both), ``&&``, ``== !=``, ``< <= > >=``, and
``!``.  Strings are letters, digits, ``_`` and ``/``, begin with a letter, and can be compared by ``==`` and ``!=`` only.
"""

import operator
import re
from collections.abc import Callable

from .expressions import Expression

Value = float | str

_LEVELS: tuple[dict[str, Callable[[float, float], bool]], ...] = (
    {"||": lambda a, b: a != 0 or b != 0, "|^": lambda a, b: (a != 0) != (b != 0)},
    {"&&": lambda a, b: a != 0 and b != 0},
    {"==": operator.eq, "!=": operator.ne},
    {"<": operator.lt, "<=": operator.le, ">": operator.gt, ">=": operator.ge},
)

_TOKEN = re.compile(
    r"\s*(?:(?P<number>-?(?:\d+\.?\d*|\.\d+)(?:[eE][+-]?\d+)?)"
    r"|(?P<text>[A-Za-z][A-Za-z0-9_/]*)"
    r"|(?P<operator>\|\||\|\^|&&|==|!=|<=|>=|[<>!()])"
    r"|(?P<bad>\S))",
    re.ASCII,
)


class _Condition(Expression):
    """One evaluation."""

    what, pattern, levels = "condition", _TOKEN, _LEVELS

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
    """Whether the condition of an ``if`` command holds, in which variables have been replaced by their values.

    Raises
    ------
    ParameterError
        If it is malformed, compares a string with a number, or is a single string.

    Examples
    --------
    >>> condition_holds("2 < 3 && north != south")
    True
    """
    condition = _Condition(text)
    value: Value = condition.value()
    if isinstance(value, str):
        condition.fail(f"it is {_name(value)}; compare it, as in '{value} == yes'")
    return value != 0
