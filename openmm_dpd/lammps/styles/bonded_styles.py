"""Bond, angle and dihedral styles: their coefficients, and the terms of the model that they become."""

from dataclasses import dataclass
from types import SimpleNamespace
from typing import Any

import numpy as np

from ...base.units import UnitSystem
from ...plan.kinds import BONDED_KINDS, BondedKind
from ..files.atom_styles import JOINED
from ..language import arguments as read
from .words import Columns

#: Parsers of numbers with a bound.
_READERS = {"> 0": read.positive, ">= 0": read.non_negative}


@dataclass(frozen=True)
class BondedStyle:
    """A bond, angle or dihedral style; ``kind`` is None for a style without energy."""

    kind: BondedKind | None

    @property
    def columns(self) -> Columns:
        """Arguments of the model's class, and their dimensions."""
        return Columns({} if self.kind is None else {name: dimension for name, (dimension, _) in self.kind.words.items()})

    def coefficient(self, words: list[str], usage: str, units: UnitSystem) -> dict[str, float]:
        """Arguments of the model's class, in MD units, from the words of a coefficient command; ``usage`` is the beginning of that
        command."""
        if self.kind is None:
            return {}
        labels = [label for _, label in self.kind.words.values()]
        read.count(words, f"{usage} {' '.join(labels)}", len(labels))
        values = {}
        for name, label, word in zip(self.kind.words, labels, words, strict=True):
            values[name] = _READERS.get(self.kind.terms._DIMENSIONS[name][1], read.number)(word, label)
        values = self.columns.to_md(values, units)
        self.build(np.arange(self.kind.width)[None, :], values)  # built once here, so that an invalid value is reported with its line
        return values

    def words(self, values: dict[str, float], units: UnitSystem) -> list[str]:
        """The words of a coefficient command, in the deck's units."""
        return [f"{value:.15g}" for value in self.columns.of(SimpleNamespace(**values), units)]

    def build(self, beads: np.ndarray, values: dict[str, float]) -> Any:
        """The bonds, angles or dihedrals of the model."""
        assert self.kind is not None
        terms: Any = self.kind.terms
        return terms(beads, **values)


def bonded_styles(what: str) -> dict[str, BondedStyle]:
    """Styles of bonds, angles or dihedrals by name: those of all registered kinds, and ``zero``."""
    known = {kind.style: BondedStyle(kind) for kind in BONDED_KINDS.values() if kind.style and kind.width == JOINED[what][0]}
    return {**known, "zero": BondedStyle(None)}
