"""Bond and angle styles: what their coefficients are, and which term of the model they become."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

import numpy as np

from ...errors import ParameterError
from ...model.angles import CosineAngles, HarmonicAngles
from ...model.bonds import FENEBonds, HarmonicBonds, MorseBonds
from ...units import UnitSystem
from ..language import arguments as read
from .columns import FACTORS


@dataclass(frozen=True)
class BondedStyle:
    """A bond or angle style.

    Attributes
    ----------
    kind : type or None
        Class of the model, None for a style without energy.
    columns : dict
        Argument of that class by the name that LAMMPS's manual gives the coefficient: (argument, dimension).
    """

    kind: type | None
    columns: dict[str, tuple[str, str]] = field(default_factory=dict)

    def coefficient(self, words: list[str], usage: str, units: UnitSystem) -> dict[str, float]:
        """Arguments of the class, in MD units, from the words of a coefficient command that begins as ``usage`` says."""
        if self.kind is None:
            return {}
        read.count(words, f"{usage} {' '.join(self.columns)}", len(self.columns))
        values = {}
        for word, (label, (name, dimension)) in zip(words, self.columns.items(), strict=True):
            number = read.positive(word, label) if label in ("R0",) else read.non_negative(word, label)
            values[name] = number * FACTORS[dimension](units)
        if self.kind is FENEBonds and values["sigma"] == 0.0:
            if values["epsilon"] > 0.0:
                raise ParameterError("sigma must be > 0 where epsilon is")
            values["sigma"] = FACTORS["length"](units)  # of no consequence
        return values

    def words(self, values: dict[str, float], units: UnitSystem) -> list[str]:
        """The words of a coefficient command, in the deck's units."""
        return [f"{values[name] / FACTORS[dimension](units):.15g}" for name, dimension in self.columns.values()]

    def of(self, terms: Any, units: UnitSystem) -> list[np.ndarray]:
        """The coefficients of bonds or angles of the model, in the deck's units."""
        return [getattr(terms, name) / FACTORS[dimension](units) for name, dimension in self.columns.values()]

    def build(self, beads: np.ndarray, values: dict[str, float]) -> Any:
        """The bonds or angles of the model."""
        assert self.kind is not None
        return self.kind(beads, **values)


BOND_STYLES = {
    "harmonic": BondedStyle(HarmonicBonds, {"K": ("k", "energy/length^2"), "r0": ("r0", "length")}),
    "fene": BondedStyle(
        FENEBonds,
        {"K": ("k", "energy/length^2"), "R0": ("R0", "length"), "epsilon": ("epsilon", "energy"), "sigma": ("sigma", "length")},
    ),
    "morse": BondedStyle(MorseBonds, {"D": ("D", "energy"), "alpha": ("alpha", "1/length"), "r0": ("r0", "length")}),
    "zero": BondedStyle(None),
}

ANGLE_STYLES = {
    "harmonic": BondedStyle(HarmonicAngles, {"K": ("k", "energy"), "theta0": ("theta0", "degrees")}),
    "cosine": BondedStyle(CosineAngles, {"K": ("k", "energy")}),
    "zero": BondedStyle(None),
}
