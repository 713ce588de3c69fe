"""The pair, bond, angle and dihedral styles of a deck and their coefficients, as data; the folder ``styles`` defines the styles."""

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
    """Coefficients from one ``pair_coeff`` line for a pair of types, in the deck's units."""

    values: dict  #: Values by name, in the order of the command, without the cutoff (if the style has several, with all of them)
    cutoff: float | None  #: The cutoff if the line gives one; None means the style's
    where: Line | None
    adapted: bool = False  #: Whether its values are those of a ``fix adapt``


#: Values of a coefficient, and its cutoff or None.
Values = tuple[dict, float | None]
#: A term of the model, and a remark or None.
Term = tuple[Any, str | None]
#: Finds a file by its name in the deck.
Find = Callable[[str], Path]


@dataclass
class PairStyle:
    """A pair style with its settings and coefficients."""

    name: str  #: A key of :data:`~openmm_dpd.lammps.styles.pair_styles.PAIR_STYLES`; ``spec`` is its entry
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
        """Cutoff of a coefficient; the style's if it has none of its own."""
        return coefficient.cutoff if coefficient.cutoff is not None else self.settings.get("cutoff")

    def words(self, coefficient: Coefficient) -> list[str]:
        """Words after the types on a ``pair_coeff`` line, in the deck's units and with the cutoff."""
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
    """How a pair style reads its arguments and what it builds."""

    settings: Callable[[list[str]], dict]  #: Settings from the words after the style's name
    coefficient: Callable[[PairStyle, list[str], Find], Values]  #: Values, and a cutoff or None, from (style, words, find)
    build: Callable[[PairStyle, Coefficient, UnitSystem], Term]  #: Pair term, and a remark or None, from (style, coefficient, units)
    #: Inverse of ``coefficient``: its words from (style, coefficient); None if they are the values and the cutoff.
    write: Callable[[PairStyle, Coefficient], list[str]] | None = None
    thermostat: bool = False  #: Whether the style has friction and noise, hence a temperature and a seed
    #: Mixed coefficient of i, j from (style, coefficient of i, i, coefficient of j, j); None if the style has no mixing.
    mixed: Callable[[PairStyle, Coefficient, Coefficient], Coefficient] | None = None
    #: Whether repeating pair_style with the same style keeps the coefficients (their cutoffs are reset to the global one).
    keeps_coefficients: bool = True
    atom_style: str | None = None  #: The atom style it requires
    own_cutoffs: bool = False  #: Whether cutoffs are ordinary coefficients, among the others
    words: frozenset[str] = frozenset()  #: Words among its settings that are not numbers; hybrid must not take them for the next style
    of_bonds: bool = False  #: Whether it acts between bonds rather than beads: it then needs hybrid and builds no pair term


@dataclass
class PairSetup:
    """All pair styles of a deck."""

    mode: str = "none"  #: ``none``, ``single``, ``hybrid`` or ``hybrid/overlay``
    styles: list[PairStyle] = field(default_factory=list)  #: The styles, in the order of the pair_style line
    excluded: set[tuple[int, int]] = field(default_factory=set)  #: Type pairs that are set to ``none``
    where: Line | None = None

    def resolve(self, n_types: int) -> tuple[list[dict[tuple[int, int], Coefficient]], list[tuple[int, int]]]:
        """Coefficients of every style after mixing, and the type pairs without any."""
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
    """Style of the bonds, angles, dihedrals or impropers, and the coefficients of each type."""

    style: str = "none"  #: ``none``, the style, or ``hybrid``
    styles: tuple[str, ...] = ()  #: The styles of hybrid, or the one style
    #: By type: the name of its style, and the arguments of the model's class in MD units.
    coefficients: dict[int, tuple[str, dict[str, float]]] = field(default_factory=dict)
    where: Line | None = None
