"""Storage of the ``variable`` command: equal, string, index and loop styles."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import TypeVar

import numpy as np

from ...errors import ParameterError
from .arguments import as_float, identifier, known
from .lexer import Line, errors_at

STYLES = ("equal", "atom", "string", "index", "loop", "delete")

#: Styles whose text is a formula.
FORMULAS = ("equal", "atom")


T = TypeVar("T")


@dataclass(frozen=True)
class Variable:
    """One variable: its style, its text (the formula of an equal-style one) and where it was defined."""

    style: str
    text: str
    where: Line | None


class Variables:
    """The variables of a deck.

    Parameters
    ----------
    command_line : mapping of str to str
        Values given from outside; the deck's ``index`` and ``loop`` variables of these names keep them.
    """

    def __init__(self, command_line: dict[str, str] | None = None):
        self._found: dict[str, Variable] = {}
        self._evaluating: list[str] = []
        for name, value in (command_line or {}).items():
            identifier(name, "a variable's name")
            self._found[name] = Variable("index", str(value), None)

    def __contains__(self, name: str) -> bool:
        return name in self._found

    def define(self, args: list[str], where: Line, expand: Callable[[str], str]) -> None:
        """Carry out ``variable name style args``; ``expand`` substitutes ``$`` in the text of string-style variables."""
        if len(args) < 2:
            raise ParameterError("expected 'variable name style value'")
        name, style, *values = args
        identifier(name, "a variable's name")
        if style not in STYLES:
            raise ParameterError(f"variable style '{style}' is not supported; supported are {', '.join(STYLES)}")
        if style == "delete":
            self._found.pop(name, None)
            return
        if not values or (style in (*FORMULAS, "string", "loop") and len(values) > 1):
            hint = "; put a formula with blanks into quotes" if style in FORMULAS else ""
            raise ParameterError(f"variable {name} {style}: expected one value, but found {len(values)}{hint}")
        old = self._found.get(name)
        if style in ("index", "loop"):
            # an index variable that exists keeps its value, so that the command line can override a deck
            if old is None:
                self._found[name] = Variable(style, values[0] if style == "index" else "1", where)
            return
        if old is not None and old.style != style:
            raise ParameterError(
                f"variable {name} is {old.style}-style already and cannot become {style}-style"
                + ("; a value given on the command line replaces index-style variables only" if old.where is None else "")
            )
        self._found[name] = Variable(style, expand(values[0]) if style == "string" else values[0], where)

    def get(self, name: str) -> Variable:
        """The variable; ParameterError if there is none."""
        return known(self._found, name, "variable")

    def value(self, name: str, evaluate: Callable[[str], float]) -> float:
        """Number that ``v_name`` stands for; ``evaluate`` gives the values of formulas."""
        variable = self.get(name)
        if variable.style == "atom":
            raise ParameterError(f"variable {name} is atom-style: it has a value for every bead; use compute reduce or fix ave/chunk")
        if variable.style != "equal":
            try:
                return as_float(variable.text)
            except ValueError:
                raise ParameterError(f"variable {name} is '{variable.text}', which is not a number") from None
        return self._evaluated(name, variable, evaluate)

    def operand(self, name: str, evaluate: Callable[[str], float]) -> float:
        """What ``v_name`` is within another formula: LAMMPS reads the variable's text there, which has 15 digits of a formula."""
        formula = self.get(name).style in FORMULAS
        return as_float(self.text(name, evaluate)) if formula else self.value(name, evaluate)

    def bead_values(self, name: str, evaluate: Callable[[str], np.ndarray]) -> np.ndarray:
        """(N,) values of an atom-style variable."""
        variable = self.get(name)
        if variable.style != "atom":
            raise ParameterError(f"variable {name} is {variable.style}-style; an atom-style one is expected")
        return self._evaluated(name, variable, evaluate)

    def _evaluated(self, name: str, variable: Variable, evaluate: Callable[[str], T]) -> T:
        if name in self._evaluating:
            raise ParameterError(f"variable {name} refers to itself: {' -> '.join([*self._evaluating, name])}")
        self._evaluating.append(name)
        try:
            with errors_at(variable.where, f"variable {name}: "):
                return evaluate(variable.text)
        finally:
            self._evaluating.pop()

    def text(self, name: str, evaluate: Callable[[str], float]) -> str:
        """Text that ``${name}`` stands for."""
        variable = self.get(name)
        return f"{self.value(name, evaluate):.15g}" if variable.style in FORMULAS else variable.text
