"""What styles write, and what they say about it: numbers, coefficients, differences between a scene and LAMMPS."""

from __future__ import annotations

import warnings
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from ...errors import ParameterError
from ...model.scene import Scene
from ...units import UnitSystem
from .columns import Columns

Pair = tuple[str, str]


class ExportWarning(UserWarning):
    """LAMMPS will do something else than the scene says; the message names the difference."""


@dataclass
class Differences:
    """What an exported deck does differently, in the order it came up; each becomes a warning and a comment of the deck."""

    found: list[str] = field(default_factory=list)
    remarks: list[str] = field(default_factory=list)

    def add(self, text: str) -> None:
        """Note that LAMMPS's averages may differ from the scene's."""
        if text not in self.found:
            self.found.append(text)

    def remark(self, text: str) -> None:
        """Note something the reader of the deck should know; no warning."""
        if text not in self.remarks:
            self.remarks.append(text)

    def warn(self, stacklevel: int) -> None:
        """Issue the warnings."""
        for text in self.found:
            warnings.warn(text, ExportWarning, stacklevel=stacklevel + 1)


def exact(values) -> str:
    """A number, or several with spaces between them: the shortest texts that read back as the same doubles."""
    return " ".join(repr(value) for value in np.ravel(values).astype(float).tolist())


@dataclass
class StyleUse:
    """One pair style and its coefficients.

    Attributes
    ----------
    name : str
    settings : str
        Words after the name, with ``{start}``, ``{stop}`` and ``{seed}`` where temperatures and seed go.
    coefficients : dict of pair to words
        By pair of the scene's bead types.
    cutoff : float
        Largest range, nm.
    modify : str
        Words of a pair_modify command, if it needs one.
    constant : bool
        Whether its temperature is 0 whatever the scene's (it has no friction).
    """

    name: str
    settings: str
    coefficients: dict[Pair, str]
    cutoff: float
    modify: str = ""
    constant: bool = False


@dataclass
class PairExport:
    """What the translation of tables needs to know, and the files it makes."""

    scene: Scene
    units: UnitSystem
    shardlow: bool
    name: str
    differences: Differences
    tables: dict[str, list[str]] = field(default_factory=dict)

    @property
    def ramps(self) -> bool:
        """Whether the temperature changes."""
        kT = self.scene.kT
        return not isinstance(kT, float) and kT.start != kT.stop

    def require_reduced(self, what: str) -> None:
        """ParameterError if LAMMPS has not this kind of terms with the units, or the temperature, of the scene."""
        if self.ramps and what != "EDPD":
            raise ParameterError(f"{what} goes with one temperature in LAMMPS, but the scene has a ramp; LAMMPS has ramps for DPD only")
        if self.units.name != "lj":
            raise ParameterError(f"{what} goes with units lj only in LAMMPS, not with units {self.units.name}")


def plain_use(name: str, settings: str, columns: Columns, export: PairExport, entries: dict[Pair, Any], modify: str = "") -> StyleUse:
    """Use of a style whose coefficients are some numbers and the cutoff; ``settings`` has ``{cutoff}`` where the longest one goes."""
    units, longest = export.units, max(c.cutoff for c in entries.values())
    words = {pair: exact([*columns.of(c, units), c.cutoff / units.length]) for pair, c in entries.items()}
    return StyleUse(name, settings.replace("{cutoff}", exact(longest / units.length)), words, longest, modify)


#: From the kind of a table of a scene to the styles that say the same.
Exports = dict[type, Callable[[PairExport, dict[Pair, Any]], list[StyleUse]]]
