"""Conditions of the ``if`` command: numbers and strings, compared and combined.

Operators from loose to tight, all from left to right: ``||`` and ``|^`` (one or the other, not both), ``&&``, ``== !=``, ``< <= > >=``, and
``!``.  Strings are letters, digits, ``_`` and ``/``, begin with a letter, and can be compared by ``==`` and ``!=`` only.
"""

from __future__ import annotations

import operator
import re
from collections.abc import Callable
from typing import NoReturn

from ...errors import ParameterError

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


class _Condition:
    """One evaluation."""

    def __init__(self, text: str):
        self.text, self.at = text, 0
        self.tokens = [(str(match.lastgroup), str(match[match.lastgroup or 0])) for match in _TOKEN.finditer(text)]

    def fail(self, why: str) -> NoReturn:
        raise ParameterError(f"cannot evaluate the condition '{self.text}': {why}")

    def take(self, expected: str | None = None) -> tuple[str, str]:
        if self.at == len(self.tokens):
            self.fail("it ends too early" if self.tokens else "it is empty")
        kind, token = self.tokens[self.at]
        if kind == "bad" or (expected is not None and token != expected):
            self.fail(f"unexpected {token!r}")
        self.at += 1
        return kind, token

    def operation(self, level: int) -> str | None:
        """The operator that comes next, if it is one of this level."""
        if self.at < len(self.tokens) and self.tokens[self.at][1] in _LEVELS[level]:
            return self.take()[1]
        return None

    def binary(self, level: int) -> Value:
        if level == len(_LEVELS):
            return self.unary()
        left = self.binary(level + 1)
        while (found := self.operation(level)) is not None:
            right = self.binary(level + 1)
            texts = isinstance(left, str) + isinstance(right, str)
            if texts == 1 or (texts and found not in ("==", "!=")):
                self.fail(f"{found} cannot compare {_name(left)} with {_name(right)}")
            left = float(_LEVELS[level][found](left, right))  # type: ignore[arg-type]
        return left

    def unary(self) -> Value:
        kind, token = self.take()
        if token == "(":
            inside = self.binary(0)
            self.take(")")
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
    value = condition.binary(0)
    if condition.at < len(condition.tokens):
        condition.fail(f"unexpected {condition.tokens[condition.at][1]!r}")
    if isinstance(value, str):
        condition.fail(f"it is {_name(value)}; compare it, as in '{value} == yes'")
    return value != 0
