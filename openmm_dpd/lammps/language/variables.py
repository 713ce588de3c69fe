"""The variables of a deck, for the commands ``variable`` and ``next``."""

import os
import re
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import TypeVar

import numpy as np

from ...base.errors import ParameterError
from . import arguments as read
from .arguments import as_float, identifier, integer, known
from .lexer import Line, TextFile, errors_at

STYLES = ("equal", "atom", "atomfile", "vector", "string", "index", "loop", "format", "getenv", "internal", "timer", "delete")
#: Styles with a single number, that output may have.
NUMBERS = ("equal", "internal", "timer")
#: Styles whose text is a formula.
FORMULAS = ("equal", "atom")
#: Styles with a series of values, one at a time.
SERIES = ("index", "loop")
#: Formats that a format-style variable accepts.
_FORMAT = re.compile(r"[^%]*%[-+ #0]*\d*(?:\.\d+)?l?[eEfFgG][^%]*", re.ASCII)


T = TypeVar("T")


@dataclass(frozen=True)
class Variable:
    """One variable."""

    style: str  #: One of :data:`STYLES`
    content: str  #: Formula, string, or name of the environment variable; for style format, the name of the variable that is printed
    where: Line | None
    #: All values of an index- or loop-style variable, the index of the current one, and the minimum number of digits.
    values: Sequence[str] | range = ()
    at: int = 0
    width: int = 0
    form: str = ""
    table: Mapping[int, float] = field(default_factory=dict)  #: Of style atomfile: values by ids of beads; others have 0

    @property
    def text(self) -> str:
        """Its formula if it is equal- or atom-style, otherwise its current value."""
        if self.style in SERIES:
            return str(self.values[self.at]).zfill(self.width)
        return os.environ.get(self.content, "") if self.style == "getenv" else self.content


class Variables:
    """The variables of a deck.  ``index`` and ``loop`` commands do not change variables set on the command line."""

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
        if style in (*FORMULAS, "vector") and values:
            values = [" ".join(values)]  # a formula with blanks needs no quotes
        least, most = {"loop": (1, 3), "index": (1, None), "format": (2, 2), "timer": (0, 0)}.get(style, (1, 1))
        if len(values) < least or (most is not None and len(values) > most):
            wanted = "one value" if most == 1 else f"{least} to {most} values" if most else "values"
            raise ParameterError(f"variable {name} {style}: expected {wanted}, but found {len(values)}")
        old = self._found.get(name)
        if style in SERIES:
            # an existing one keeps its value, so that the command line can override a deck, and loops continue
            if old is None:
                self._found[name] = _loop(name, values, where) if style == "loop" else Variable(style, "", where, tuple(values))
            return
        if style == "atomfile":
            self._found[name] = old or Variable(style, values[0], where, table=_of_beads(Path(values[0])))
            return
        if old is not None and old.style != style:
            raise ParameterError(
                f"variable {name} is already {old.style}-style and cannot become {style}-style"
                + ("; a value from the command line can only replace an index-style variable" if old.where is None else "")
            )
        if style == "format" and not _FORMAT.fullmatch(values[1]):
            raise ParameterError(f"variable {name} format: expected a format such as %12.6f, not '{values[1]}'")
        if style == "internal":
            read.number(values[0], f"variable {name}")
        content = str(time.monotonic()) if style == "timer" else expand(values[0]) if style == "string" else values[0]
        self._found[name] = Variable(style, content, where, form=values[1] if style == "format" else "")

    def advance(self, names: list[str]) -> bool:
        """Carry out ``next``: return whether all variables have another value; those that have none are deleted.  ParameterError if a
        variable is not index- or loop-style, or the styles differ."""
        found = [(name, self.get(name)) for name in names]
        for name, variable in found:
            if variable.style not in SERIES:
                raise ParameterError(
                    f"next: variable {name} is {variable.style}-style; only {' and '.join(SERIES)} variables have a series of values"
                )
        if len({variable.style for _, variable in found}) > 1:
            raise ParameterError(f"next: the variables {', '.join(names)} must all have the same style")
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
        """The number that ``v_name`` stands for; ``evaluate`` computes formulas."""
        variable = self.get(name)
        if variable.style == "vector":
            raise ParameterError(f"variable {name} is vector-style: use v_{name}[i], or a function such as sum(v_{name})")
        if variable.style.startswith("atom"):
            what = "it has a value for every bead; use compute reduce or fix ave/chunk"
            raise ParameterError(f"variable {name} is {variable.style}-style: {what}")
        if variable.style != "equal":
            text = self.text(name, evaluate)
            try:
                return as_float(text)
            except ValueError:
                raise ParameterError(f"variable {name} is '{text}', which is not a number") from None
        return self._evaluated(name, variable, evaluate)

    def operand(self, name: str, evaluate: Callable[[str], float]) -> float:
        """Value of ``v_name`` within another formula.  There LAMMPS uses the variable's text, which has 15 digits."""
        return as_float(self.text(name, evaluate)) if self.get(name).style in FORMULAS else self.value(name, evaluate)

    def values(self, name: str, style: str, evaluate: Callable[[str], np.ndarray]) -> np.ndarray:
        """All values of a variable of style ``atom`` or ``vector``."""
        variable = self.get(name)
        if variable.style != style:
            raise ParameterError(f"variable {name} is {variable.style}-style; expected a{'n' * (style == 'atom')} {style}-style variable")
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
        """The text that replaces ``${name}``; ``evaluate`` computes formulas."""
        variable = self.get(name)
        if variable.style == "format":
            return variable.form.replace("l", "") % self._evaluated(name, variable, lambda shown: self.value(shown, evaluate))
        return f"{self.value(name, evaluate):.15g}" if variable.style in (*FORMULAS, "atomfile") else variable.text


def _of_beads(path: Path) -> dict[int, float]:
    """The first set of values in a file of style ``atomfile``: a line with their number, and lines of an id and a value."""
    file = TextFile.read(path)
    first, *rows = list(file.rows()) or [(1, [])]
    count = int(file.numbers(first, first[1], 1, "the number of values", "the number of values")[0])
    if len(rows) < count:
        raise file.error(f"expected {count} lines of an id and a value, but found {len(rows)}")
    found = [(row, file.numbers(row, row[1], 2, "an id and a value", "a value")) for row in rows[:count]]
    return {file.integers(row, row[1][:1], "an id and a value")[0]: value for row, (_, value) in found}


def _loop(name: str, words: list[str], where: Line) -> Variable:
    """The variable that ``loop N``, ``loop N pad``, ``loop N1 N2`` or ``loop N1 N2 pad`` defines."""
    padded = words[-1] == "pad"
    numbers = [integer(word, f"an end of the loop {name}", 1 if len(words) - padded == 1 else 0) for word in words[: len(words) - padded]]
    if not 1 <= len(numbers) <= 2:
        raise ParameterError(f"variable {name} loop: expected 'loop N [pad]' or 'loop N1 N2 [pad]', not 'loop {' '.join(words)}'")
    first, last = numbers if len(numbers) == 2 else (1, numbers[0])
    if first > last:
        raise ParameterError(f"variable {name} loop: {first} is greater than {last}")
    return Variable("loop", "", where, range(first, last + 1), width=len(str(last)) if padded else 0)
