"""Formulas of variables as OpenMM expressions of the position, for forces that OpenMM evaluates.

The grammar is that of :mod:`~openmm_dpd.lammps.language.expressions`; values are texts instead of numbers.
"""

import re
from dataclasses import dataclass
from typing import NoReturn

from ...base.errors import ParameterError
from .expressions import CONSTANTS, Formula, evaluate
from .variables import Variables

#: Words that have one value for all beads of a type.
BEAD_CONSTANTS = ("type", "mass")


@dataclass(frozen=True)
class Known:
    """Names that a formula may use besides x, y and z: variables, and words with known values; ``length`` is the deck's unit in nm."""

    variables: Variables
    length: float
    words: dict[str, float]

    def refuse(self, what: str) -> NoReturn:
        raise ParameterError(
            f"the variable of a force may depend only on x, y, z, type, mass and the box; '{what}' depends on something else (the step, "
            "velocities, the state of the run), which is not supported"
        )

    def thermo(self, word: str) -> float:
        return self.words[word] if word in self.words else self.refuse(word)

    def variable(self, name: str) -> float:
        return self.variables.operand(name, lambda text: evaluate(text, self))

    def compute(self, name: str, *_: int | None) -> NoReturn:
        self.refuse(f"c_{name}")

    def fix(self, name: str, *_: int | None) -> NoReturn:
        self.refuse(f"f_{name}")

    def group(self, function: str, _: list) -> NoReturn:
        self.refuse(function)

    call = group

    def atom(self, quantity: str, bead: int) -> NoReturn:
        self.refuse(f"{quantity}[{bead}]")


def depends_on(text: str, variables: Variables, words: set[str], within: tuple[str, ...] = ()) -> bool:
    """Whether a formula, or a variable that it uses, contains one of these words."""
    for name in re.findall(r"(?<![\w.])[A-Za-z_]\w*", text):
        if name in words:
            return True
        if name.startswith("v_") and name not in within and depends_on(variables.get(name[2:]).text, variables, words, (*within, name)):
            return True
    return False


def position_formula(text: str, known: Known) -> str:
    """The formula as an OpenMM expression of x, y and z in nm.  ParameterError if it is malformed, or uses anything but positions, numbers,
    and variables made of these."""
    return str(_PositionFormula(text, known).value())


class _PositionFormula(Formula):
    kind = "text"
    resolver: Known

    def name(self, token: str):
        if self.peek()[1] == "[":
            self.resolver.refuse(f"{token}[...]")
        if token in ("x", "y", "z"):
            return f"({token}/{self.resolver.length!r})"
        if token.startswith("v_"):
            variables, name = self.resolver.variables, token[2:]
            if variables.get(name).style != "atom":
                return _number(self.resolver.variable(name))
            return variables._evaluated(name, variables.get(name), lambda text: position_formula(text, self.resolver))
        if token in CONSTANTS and self.peek()[1] != "(":
            return _number(CONSTANTS[token])
        result = super().name(token)
        return result if isinstance(result, str) else _number(result)


def _number(value: float) -> str:
    return f"({float(value)!r})"
