"""The pair, bond, angle and dihedral styles of a deck and their coefficients, as data; what the styles are is in the folder ``styles``."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from ...base.errors import DeckError
from ...base.units import UnitSystem
from ..language.lexer import Line, located


@dataclass(frozen=True)
class Coefficient:
    """What one ``pair_coeff`` line says about one pair of types, in the deck's units."""

    values: dict  #: Values by name, in the order of the command, without the cutoff (unless the style has several; then all are here)
    cutoff: float | None  #: The cutoff, if the line gives one; the style's otherwise
    where: Line | None


#: Values of a coefficient, and its cutoff or None.
Values = tuple[dict, float | None]
#: A term of the model, and a remark or None.
Term = tuple[Any, str | None]
#: From the name of a file in the deck to the file.
Find = Callable[[str], Path]


@dataclass
class PairStyle:
    """One pair style as the deck set it up."""

    name: str  #: A key of :data:`~openmm_dpd.lammps.styles.pair_styles.PAIR_STYLES`, and ``spec`` what stands there
    spec: Spec
    settings: dict  #: The style's own arguments: ``start`` and ``stop`` temperatures, ``cutoff``, ``seed``, ...; ``species`` of tdpd
    where: Line
    coefficients: dict[tuple[int, int], Coefficient] = field(default_factory=dict)  #: :class:`Coefficient` by type pair (i <= j)
    mix: str = "geometric"  #: Mixing rule
    shift: bool = False  #: Whether energies are shifted to zero at the cutoff

    def error(self, message: str) -> DeckError:
        """An error about this style."""
        return located(self.where, f"pair style {self.name}: {message}")

    def cutoff(self, coefficient: Coefficient) -> float | None:
        """Cutoff of a coefficient, the style's if it has none of its own."""
        return coefficient.cutoff if coefficient.cutoff is not None else self.settings.get("cutoff")

    def words(self, coefficient: Coefficient) -> list[str]:
        """Words after the types on a ``pair_coeff`` line, in the deck's units, the cutoff included."""
        if self.spec.write is not None:
            return self.spec.write(self, coefficient)
        words: list[str] = []
        for name, value in coefficient.values.items():
            if name.endswith("_polynomial"):
                words.append("power" if name.startswith("exponent") else "kappa")
            words += [w if isinstance(w, str) else f"{w:.15g}" for w in (value if isinstance(value, tuple) else (value,))]
        return words if self.spec.own_cutoffs else [*words, f"{self.cutoff(coefficient):.15g}"]


@dataclass(frozen=True)
class Spec:
    """How a style reads its arguments and what it builds."""

    settings: Callable[[list[str]], dict]  #: From the words after the style's name to its settings
    coefficient: Callable[[PairStyle, list[str], Find], Values]  #: From (style, words, folder of the deck) to (values, cutoff or None)
    build: Callable[[PairStyle, Coefficient, UnitSystem], Term]  #: From (style, coefficient, units) to (pair term, remark or None)
    #: From (style, coefficient) to the words that ``coefficient`` reads, where these are not its values and the cutoff.
    write: Callable[[PairStyle, Coefficient], list[str]] | None = None
    thermostat: bool = False  #: Whether the style has friction and noise, and so a temperature and a seed
    #: From (style, coefficient of i, i, that of j, j) to that of i, j where it is not set.
    mixed: Callable[[PairStyle, Coefficient, Coefficient], Coefficient] | None = None
    #: Whether re-issuing pair_style with the same style keeps the coefficients (cutoffs go back to the global one).
    keeps_coefficients: bool = True
    atom_style: str | None = None  #: The only atom style it works with
    own_cutoffs: bool = False  #: Whether cutoffs are ordinary coefficients, in the midst of the others
    words: frozenset[str] = frozenset()  #: Words among its settings that are no numbers, for finding the next style of hybrid
    of_bonds: bool = False  #: Whether it acts between bonds, not beads: it then needs hybrid, and builds no pair term


@dataclass
class PairSetup:
    """All pair styles of a deck."""

    mode: str = "none"  #: ``none``, ``single``, ``hybrid`` or ``hybrid/overlay``
    styles: list[PairStyle] = field(default_factory=list)  #: The styles, in the order of the pair_style line
    excluded: set[tuple[int, int]] = field(default_factory=set)  #: Type pairs set to ``none``
    where: Line | None = None

    def resolve(self, n_types: int) -> tuple[list[dict[tuple[int, int], Coefficient]], list[tuple[int, int]]]:
        """Coefficients of every style after mixing, and the type pairs that have none at all."""
        tables = [dict(style.coefficients) for style in self.styles]
        missing = []
        for i in range(1, n_types + 1):
            for j in range(i, n_types + 1):
                if (i, j) in self.excluded or any((i, j) in table for table in tables):
                    continue
                if i == j or not self._mix(tables, i, j):
                    missing.append((i, j))
        return tables, missing

    def _mix(self, tables: list[dict[tuple[int, int], Coefficient]], i: int, j: int) -> bool:
        of_i, of_j = ([n for n, table in enumerate(tables) if (k, k) in table] for k in (i, j))
        rules = [self.styles[n].spec.mixed for n in of_i]
        if not of_i or of_i != of_j or None in rules:
            return False
        for n, mixed in zip(of_i, rules, strict=True):
            assert mixed is not None
            tables[n][(i, j)] = mixed(self.styles[n], tables[n][(i, i)], tables[n][(j, j)])
        return True


@dataclass
class BondedSetup:
    """Style of the bonds, the angles or the dihedrals, and the coefficients of each type."""

    style: str = "none"  #: ``none``, the style, or ``hybrid``
    styles: tuple[str, ...] = ()  #: The styles of hybrid, or the one style
    #: By type: the name of its style and the arguments of its class in MD units.
    coefficients: dict[int, tuple[str, dict[str, float]]] = field(default_factory=dict)
    where: Line | None = None
