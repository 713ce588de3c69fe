"""Formulas: a recursive-descent evaluator with LAMMPS's grammar, for one number (equal-style) or one per bead (atom-style).

Operators from loose to tight, all from left to right: ``||``, ``&&``, ``== !=``, ``< <= > >=``, ``+ -``, ``* / %``, ``^``, and
unary ``-`` and ``!`` which bind tightest of all, so that ``-2^2`` is 4 and ``2^3^2`` is 64.
"""

from __future__ import annotations

import math
import re
from collections.abc import Callable
from typing import NoReturn, TypeVar

import numpy as np

from ...errors import DPDError, ParameterError
from .operations import FUNCTIONS, LEVELS, LITERAL, UNARY

T = TypeVar("T")

#: Group functions: their arguments are names, not formulas.
GROUP_FUNCTIONS = ("count", "mass", "charge", "xcm", "vcm", "ke", "bound")

#: Formulas may ask for these values of one bead, by its id: ``x[17]``.
ATOM_VALUES = ("id", "mass", "type", "mol", "x", "y", "z", "vx", "vy", "vz", "fx", "fy", "fz", "q")

CONSTANTS = {"PI": math.pi, "yes": 1.0, "on": 1.0, "true": 1.0, "no": 0.0, "off": 0.0, "false": 0.0}


class Names:
    """What a formula may refer to.  All of it is refused here; whoever knows some of it says so."""

    def refuse(self, what: str) -> NoReturn:
        """The error for what is not known."""
        raise ParameterError(f"'{what}' has no value here")

    def thermo(self, word: str) -> float:
        """Value of a thermo word."""
        self.refuse(word)

    def variable(self, name: str) -> float:
        """Value of ``v_name``."""
        self.refuse(f"v_{name}")

    def compute(self, name: str, index: int | None, column: int | None = None) -> float:
        """Value of ``c_name``, ``c_name[index]`` or ``c_name[index][column]``."""
        self.refuse(f"c_{name}")

    def fix(self, name: str, index: int | None, column: int | None = None) -> float:
        """Value of ``f_name``, ``f_name[index]`` or ``f_name[index][column]``."""
        self.refuse(f"f_{name}")

    def group(self, function: str, arguments: list[str]) -> float:
        """Value of a group function such as ``count(all)``."""
        self.refuse(function)

    def atom(self, quantity: str, bead: int) -> float:
        """Value of one bead, such as ``x[17]``."""
        self.refuse(f"{quantity}[{bead}]")

    def call(self, function: str, arguments: list[float]) -> float:
        """Value of a function that depends on the state: ``random``, ``normal``, ``ramp`` ..."""
        self.refuse(function)

    # -- what atom-style formulas may refer to on top of it ----------------------------------------------------------------------
    def bead_variable(self, name: str) -> np.ndarray | float:
        """Value of ``v_name``, one number or one per bead."""
        self.refuse(f"v_{name}")

    def bead_word(self, word: str) -> np.ndarray | None:
        """Values of a word such as ``vx``; None if it is not one of single beads."""
        return None

    def is_bead_compute(self, name: str) -> bool:
        """Whether ``c_name`` has values of single beads."""
        return False

    def bead_compute(self, name: str, column: int | None) -> np.ndarray:
        """Values of ``c_name`` or ``c_name[column]``."""
        self.refuse(f"c_{name}")


#: Functions that need the resolver: name -> number of arguments.
STATE_FUNCTIONS = {"random": 3, "normal": 3, "ramp": 2, "vdisplace": 2, "swiggle": 3, "cwiggle": 3}

_TOKEN = re.compile(
    r"\s*(?:(?P<number>(?:\d+\.?\d*|\.\d+)(?:[eE][+-]?\d+)?)"
    r"|(?P<name>[A-Za-z_]\w*)"
    r"|(?P<operator>\|\||&&|==|!=|<=|>=|[-+*/%^()<>!,\[\]])"
    r"|(?P<bad>\S))",
    re.ASCII,
)


def evaluate(text: str, resolver: Names) -> float:
    """Value of a formula.

    Parameters
    ----------
    text : str
        The formula, such as ``pe/count(all)+v_offset``.
    resolver : Names
        Gives thermo words, variables, computes and group functions.

    Raises
    ------
    ParameterError
        If the formula is malformed, divides by zero, leaves the domain of a function, or names something unknown.
    """
    return Formula(text, resolver).value()


class Formula:
    """One evaluation of a formula."""

    #: Which kind of values it has, a field of Operation.
    kind = "number"

    def __init__(self, text: str, resolver: Names):
        self.text, self.resolver, self.at = text, resolver, 0
        self.tokens: list[tuple[str, str]] = []
        for match in _TOKEN.finditer(text):
            kind = str(match.lastgroup)
            if kind == "bad":
                self.fail(f"unexpected {match.group(kind)!r}")
            self.tokens.append((kind, match.group(kind)))
        if not self.tokens:
            self.fail("it is empty")

    def fail(self, why: str) -> NoReturn:
        raise ParameterError(f"cannot evaluate the formula '{self.text}': {why}")

    def value(self) -> float:
        """The value."""
        try:
            result = self.binary(0)
        except ZeroDivisionError:
            self.fail("division by zero")
        except RecursionError:
            raise ParameterError(f"cannot evaluate the formula '{self.text[:40]} ...': it is nested too deeply") from None
        except (ValueError, OverflowError) as error:
            if isinstance(error, DPDError):
                raise
            self.fail(str(error))
        if self.at < len(self.tokens):
            self.fail(f"unexpected {self.tokens[self.at][1]!r}")
        return result

    # -- tokens ------------------------------------------------------------------------------------------------------------
    def peek(self) -> tuple[str, str]:
        return self.tokens[self.at] if self.at < len(self.tokens) else ("end", "")

    def take(self) -> tuple[str, str]:
        token = self.peek()
        if token[0] == "end":
            self.fail("it ends too early")
        self.at += 1
        return token

    def expect(self, operator: str) -> None:
        if self.peek()[1] != operator:
            found = repr(self.peek()[1]) if self.peek()[1] else "its end"
            self.fail(f"expected {operator!r} instead of {found}")
        self.at += 1

    # -- grammar -----------------------------------------------------------------------------------------------------------
    def binary(self, level: int) -> float:
        if level == len(LEVELS):
            return self.unary()
        left = self.binary(level + 1)
        while self.peek()[0] == "operator" and self.peek()[1] in LEVELS[level]:
            operation = LEVELS[level][self.take()[1]]
            left = getattr(operation, self.kind)(left, self.binary(level + 1))
        return left

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
        if token.startswith("v_"):
            return self.resolver.variable(token[2:])
        if token.startswith("c_"):
            return self.indexed(self.resolver.compute, token[2:])
        if token.startswith("f_"):
            return self.indexed(self.resolver.fix, token[2:])
        if self.peek()[1] == "(":
            return self.function(token)
        if self.peek()[1] == "[" and token in ATOM_VALUES:
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
            return self.resolver.group(token, self.names())
        expected = FUNCTIONS[token][0] if token in FUNCTIONS else STATE_FUNCTIONS.get(token)
        if expected is None:
            known = ", ".join(sorted([*FUNCTIONS, *STATE_FUNCTIONS, *GROUP_FUNCTIONS]))
            self.fail(f"there is no function {token}; known are {known}")
        arguments = self.arguments()
        if len(arguments) != expected:
            self.fail(f"{token} takes {expected} arguments, not {len(arguments)}")
        if token in FUNCTIONS:
            return getattr(FUNCTIONS[token][1], self.kind)(*arguments)
        return self.resolver.call(token, arguments)

    def arguments(self) -> list[float]:
        return self.listed(lambda: self.binary(0))

    def names(self) -> list[str]:
        return self.listed(lambda: self.take()[1])

    def listed(self, one: Callable[[], T]) -> list[T]:
        """What stands between parentheses, separated by commas."""
        self.expect("(")
        found = [one()]
        while self.peek()[1] == ",":
            self.take()
            found.append(one())
        self.expect(")")
        return found


class _BeadFormula(Formula):
    kind = "beads"

    def name(self, token: str):
        if token in ("random", "normal"):
            self.fail(f"{token} is supported in equal-style variables only")
        if token.startswith("v_"):
            return self.resolver.bead_variable(token[2:])
        if token.startswith("c_") and self.resolver.is_bead_compute(token[2:]):
            return self._of_compute(token[2:])
        following = self.peek()[1]
        if following == "(" or (following == "[" and token in ATOM_VALUES):
            return super().name(token)
        values = self.resolver.bead_word(token)
        return super().name(token) if values is None else values

    def _of_compute(self, name: str):
        index = self.index()
        whole = self.resolver.bead_compute(name, None)
        if index is None or whole.ndim == 1:
            if whole.ndim > 1:
                self.fail(f"compute {name} has {whole.shape[1]} values per bead; use c_{name}[1] and so on")
            return whole if index is None else self.resolver.compute(name, index)
        if not 1 <= index <= whole.shape[1]:
            self.fail(f"c_{name}[{index}] is out of range: compute {name} has {whole.shape[1]} values per bead")
        return whole[:, index - 1]


def evaluate_beads(text: str, resolver: Names, n: int) -> np.ndarray:
    """(n,) values of an atom-style formula, such as ``0.5*mass*(vx^2+vy^2)``, one for each of n beads.

    Raises
    ------
    ParameterError
        As :func:`evaluate`, for any of the beads.
    """
    formula = _BeadFormula(text, resolver)
    try:
        with np.errstate(divide="raise", invalid="raise", over="raise"):
            return np.broadcast_to(np.asarray(formula.value(), dtype=np.float64), (n,))
    except FloatingPointError as error:
        raise ParameterError(f"cannot evaluate the formula '{text}': {error}") from None
