"""Storage of the ``variable`` command, and ``next``."""

import os
import re
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import TypeVar

import numpy as np

from ...base.errors import ParameterError
from . import arguments as read
from .arguments import as_float, identifier, integer, known
from .lexer import Line, errors_at

STYLES = ("equal", "atom", "string", "index", "loop", "format", "getenv", "delete")
#: Styles whose text is a formula.
FORMULAS = ("equal", "atom")
#: Styles that have several values, one after the other.
SERIES = ("index", "loop")
#: What a format-style variable may print a number with.
_FORMAT = re.compile(r"[^%]*%[-+ #0]*\d*(?:\.\d+)?l?[eEfFgG][^%]*", re.ASCII)


T = TypeVar("T")


@dataclass(frozen=True)
class Variable:
    """One variable."""

    style: str  #: One of :data:`STYLES`
    content: str  #: Formula, string, or name in the environment; of style format the name of the variable that is printed
    where: Line | None
    #: All values of an index- or loop-style one; ``at`` is the place of the present one, ``width`` the least number of digits.
    values: Sequence[str] | range = ()
    at: int = 0
    width: int = 0
    form: str = ""

    @property
    def text(self) -> str:
        """What it says: the formula of an equal-style one, otherwise its present value."""
        if self.style in SERIES:
            return str(self.values[self.at]).zfill(self.width)
        return os.environ.get(self.content, "") if self.style == "getenv" else self.content


class Variables:
    """The variables of a deck; its ``index`` and ``loop`` variables keep values of these names that the command line gives."""

    def __init__(self, command_line: dict[str, str] | None = None):
        self._found: dict[str, Variable] = {}
        self._evaluating: list[str] = []
        for name, value in (command_line or {}).items():
            identifier(name, "a variable's name")
            self._found[name] = Variable("index", "", None, (str(value),))

    def __contains__(self, name: str) -> bool:
        return name in self._found

    def define(self, args: list[str], where: Line, expand: Callable[[str], str]) -> None:
        """Carry out ``variable name style args``; ``expand`` substitutes ``$`` in the text of string-style variables."""
        if len(args) < 2:
            raise ParameterError("expected 'variable name style value'")
        name, style, *values = args
        identifier(name, "a variable's name")
        read.style(dict.fromkeys(STYLES), "variable", style)
        if style == "delete":
            self._found.pop(name, None)
            return
        least, most = {"loop": (1, 3), "index": (1, None), "format": (2, 2)}.get(style, (1, 1))
        if len(values) < least or (most is not None and len(values) > most):
            hint = "; put a formula with blanks into quotes" if style in FORMULAS else ""
            wanted = "one value" if most == 1 else f"{least} to {most} values" if most else "values"
            raise ParameterError(f"variable {name} {style}: expected {wanted}, but found {len(values)}{hint}")
        old = self._found.get(name)
        if style in SERIES:
            # one that exists keeps its value, so that the command line can override a deck, and a loop goes on
            if old is None:
                self._found[name] = _loop(name, values, where) if style == "loop" else Variable(style, "", where, tuple(values))
            return
        if old is not None and old.style != style:
            raise ParameterError(
                f"variable {name} is {old.style}-style already and cannot become {style}-style"
                + ("; a value given on the command line replaces index-style variables only" if old.where is None else "")
            )
        if style == "format" and not _FORMAT.fullmatch(values[1]):
            raise ParameterError(f"variable {name} format: expected a format such as %12.6f, not '{values[1]}'")
        content = expand(values[0]) if style == "string" else values[0]
        self._found[name] = Variable(style, content, where, form=values[1] if style == "format" else "")

    def advance(self, names: list[str]) -> bool:
        """Carry out ``next``: whether all have another value; those that have none are deleted.  ParameterError if a variable is not index-
        or loop-style, or they are not all of one style."""
        found = [(name, self.get(name)) for name in names]
        for name, variable in found:
            if variable.style not in SERIES:
                raise ParameterError(f"next: variable {name} is {variable.style}-style; only {' and '.join(SERIES)} have further values")
        if len({variable.style for _, variable in found}) > 1:
            raise ParameterError(f"next: the variables {', '.join(names)} must all be of one style")
        ended = [name for name, variable in found if variable.at + 1 == len(variable.values)]
        for name, variable in found:
            if name in ended:
                self._found.pop(name, None)
            else:
                self._found[name] = replace(variable, at=variable.at + 1)
        return not ended

    def get(self, name: str) -> Variable:
        """The variable; ParameterError if there is none."""
        return known(self._found, name, "variable")

    def value(self, name: str, evaluate: Callable[[str], float]) -> float:
        """Number that ``v_name`` is; ``evaluate`` gives the values of formulas."""
        variable = self.get(name)
        if variable.style == "atom":
            raise ParameterError(f"variable {name} is atom-style: it has a value for every bead; use compute reduce or fix ave/chunk")
        if variable.style != "equal":
            text = self.text(name, evaluate)
            try:
                return as_float(text)
            except ValueError:
                raise ParameterError(f"variable {name} is '{text}', which is not a number") from None
        return self._evaluated(name, variable, evaluate)

    def operand(self, name: str, evaluate: Callable[[str], float]) -> float:
        """What ``v_name`` is within another formula: LAMMPS reads the variable's text there, which has 15 digits of a formula."""
        return as_float(self.text(name, evaluate)) if self.get(name).style in FORMULAS else self.value(name, evaluate)

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
        """Text that replaces ``${name}``."""
        variable = self.get(name)
        if variable.style == "format":
            return variable.form.replace("l", "") % self._evaluated(name, variable, lambda shown: self.value(shown, evaluate))
        return f"{self.value(name, evaluate):.15g}" if variable.style in FORMULAS else variable.text


def _loop(name: str, words: list[str], where: Line) -> Variable:
    """Variable of ``loop N``, ``loop N pad``, ``loop N1 N2`` or ``loop N1 N2 pad``."""
    padded = words[-1] == "pad"
    numbers = [integer(word, f"an end of the loop {name}", 1 if len(words) - padded == 1 else 0) for word in words[: len(words) - padded]]
    if not 1 <= len(numbers) <= 2:
        raise ParameterError(f"variable {name} loop: expected 'loop N [pad]' or 'loop N1 N2 [pad]', not 'loop {' '.join(words)}'")
    first, last = numbers if len(numbers) == 2 else (1, numbers[0])
    if first > last:
        raise ParameterError(f"variable {name} loop: {first} is more than {last}")
    return Variable("loop", "", where, range(first, last + 1), width=len(str(last)) if padded else 0)
