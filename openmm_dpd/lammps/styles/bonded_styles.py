"""Bond and angle styles: what their coefficients are, and which term of the model they become."""

from dataclasses import dataclass, field
from types import SimpleNamespace
from typing import Any

import numpy as np

from ...errors import ParameterError
from ...model.angles import CosineAngles, HarmonicAngles
from ...model.bonds import FENEBonds, HarmonicBonds, MorseBonds
from ...units import UnitSystem
from ..language import arguments as read
from .columns import Columns


@dataclass(frozen=True)
class BondedStyle:
    """A bond or angle style.

    Attributes
    ----------
    kind : type or None
        Class of the model, None for a style without energy.
    columns : Columns
        Arguments of that class and their dimensions.
    labels : tuple of str
        What LAMMPS's manual calls them.
    """

    kind: type | None
    columns: Columns = field(default_factory=lambda: Columns({}))
    labels: tuple[str, ...] = ()

    def coefficient(self, words: list[str], usage: str, units: UnitSystem) -> dict[str, float]:
        """Arguments of the class, in MD units, from the words of a coefficient command that begins as ``usage`` says."""
        if self.kind is None:
            return {}
        read.count(words, f"{usage} {' '.join(self.labels)}", len(self.labels))
        values = {}
        for name, label, word in zip(self.columns.dimensions, self.labels, words, strict=True):
            values[name] = read.positive(word, label) if label == "R0" else read.non_negative(word, label)
        values = self.columns.to_md(values, units)
        if self.kind is FENEBonds and values["sigma"] == 0.0:
            if values["epsilon"] > 0.0:
                raise ParameterError("sigma must be > 0 where epsilon is")
            values["sigma"] = units.length  # of no consequence
        return values

    def words(self, values: dict[str, float], units: UnitSystem) -> list[str]:
        """The words of a coefficient command, in the deck's units."""
        return [f"{value:.15g}" for value in self.columns.of(SimpleNamespace(**values), units)]

    def build(self, beads: np.ndarray, values: dict[str, float]) -> Any:
        """The bonds or angles of the model."""
        assert self.kind is not None
        return self.kind(beads, **values)


_FENE = Columns({"k": "energy/length^2", "R0": "length", "epsilon": "energy", "sigma": "length"})

BOND_STYLES = {
    "harmonic": BondedStyle(HarmonicBonds, Columns({"k": "energy/length^2", "r0": "length"}), ("K", "r0")),
    "fene": BondedStyle(FENEBonds, _FENE, ("K", "R0", "epsilon", "sigma")),
    "morse": BondedStyle(MorseBonds, Columns({"D": "energy", "alpha": "1/length", "r0": "length"}), ("D", "alpha", "r0")),
    "zero": BondedStyle(None),
}

ANGLE_STYLES = {
    "harmonic": BondedStyle(HarmonicAngles, Columns({"k": "energy", "theta0": "degrees"}), ("K", "theta0")),
    "cosine": BondedStyle(CosineAngles, Columns({"k": "energy"}), ("K",)),
    "zero": BondedStyle(None),
}
