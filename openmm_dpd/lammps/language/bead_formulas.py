"""Atom-style formulas: the grammar of :mod:`~openmm_dpd.lammps.language.expressions` with one value per bead."""

from __future__ import annotations

from typing import Protocol

import numpy as np

from ...errors import ParameterError
from .expressions import ATOM_VALUES, Formula, Names

Values = np.ndarray | float


class BeadNames(Names, Protocol):
    """What an atom-style formula may refer to beside what an equal-style one may."""

    def bead_variable(self, name: str) -> Values:
        """Value of ``v_name``, one number or one per bead."""

    def bead_word(self, word: str) -> np.ndarray | None:
        """Values of a word such as ``vx``; None if it is not one of single beads."""

    def is_bead_compute(self, name: str) -> bool:
        """Whether ``c_name`` has values of single beads."""

    def bead_compute(self, name: str, column: int | None) -> np.ndarray:
        """Values of ``c_name`` or ``c_name[column]``."""


def evaluate_beads(text: str, resolver: BeadNames, n: int) -> np.ndarray:
    """(n,) values of a formula.

    Parameters
    ----------
    text : str
        The formula, such as ``0.5*mass*(vx^2+vy^2)``.
    resolver : BeadNames
        Gives values of single beads, and everything that equal-style formulas know.
    n : int
        Number of beads.

    Raises
    ------
    ParameterError
        If the formula is malformed, divides by zero or leaves the domain of a function for some bead, or names something unknown.
    """
    formula = _BeadFormula(text, resolver)
    try:
        with np.errstate(divide="raise", invalid="raise", over="raise"):
            return np.broadcast_to(np.asarray(formula.value(), dtype=np.float64), (n,))
    except FloatingPointError as error:
        raise ParameterError(f"cannot evaluate the formula '{text}': {error}") from None


class _BeadFormula(Formula):
    kind = "beads"
    resolver: BeadNames

    @staticmethod
    def negated(value):
        return np.asarray(np.equal(value, 0), dtype=np.float64)

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
