"""Description of a compute style, and references to values: ``c_id``, ``f_id`` and ``v_name``, possibly with indices."""

import re
from collections.abc import Callable
from dataclasses import dataclass
from functools import lru_cache
from typing import Any, NamedTuple

import numpy as np

from ...base.errors import ParameterError
from ..language import arguments as read
from ..state.deck_state import DeckState
from ..state.moment import DeckMoment
from ..state.records import Compute


@dataclass(frozen=True)
class ComputeSpec:
    """A compute style; its functions take (moment, compute)."""

    #: Makes ``Compute.settings`` from (state, group, words); ParameterError if they are not supported.
    prepare: Callable[[DeckState, str, list[str]], Any]
    scalar: Callable[[DeckMoment, Compute], float] | None = None  #: Single value in deck units, not normalised
    vector: Callable[[DeckMoment, Compute], np.ndarray] | None = None  #: Vector in deck units, not normalised
    #: Per-bead values in deck units, (N,) or (N, columns); 0 for beads outside the group.
    per_bead: Callable[[DeckMoment, Compute], np.ndarray] | None = None
    #: Values (rows, columns) of bonds, angles, dihedrals or impropers, in deck units.
    local: Callable[[DeckMoment, Compute], np.ndarray] | None = None
    #: Table (rows, columns) in deck units, which is never normalised.
    array: Callable[[DeckMoment, Compute], np.ndarray] | None = None
    rows: Callable[[Compute], int] = lambda compute: 0  #: Number of rows of the table; 0 without a table
    #: Number of columns of the table, or of values per bead; 0 for a single value without index.
    columns: Callable[[Compute], int] = lambda compute: 0
    #: Whether thermo output divides the values by the number of beads when it is normalised; may depend on the compute.
    extensive: bool | Callable[[Compute], bool] = False
    extensive_vector: bool = False  #: Whether this is so for the vector even if not for the single value
    size: Callable[[Compute], int] = lambda compute: 0  #: Number of values in the vector

    def tabled(self, compute: Compute) -> bool:
        """Whether this compute has a table."""
        return self.rows(compute) > 0

    def is_extensive(self, compute: Compute, indexed: bool = False) -> bool:
        """Whether the single value of this compute (``indexed``: the values of its vector) is a sum over beads."""
        if indexed and self.extensive_vector and not self.tabled(compute):
            return True
        return self.extensive if isinstance(self.extensive, bool) else self.extensive(compute)


def check_place(compute: Compute, spec: ComputeSpec, row: int | None, column: int | None) -> tuple[int, int]:
    """Indices (from 0) of ``c_id[row][column]``.  ParameterError unless the compute has a table with this entry."""
    rows, columns, name = spec.rows(compute), spec.columns(compute), f"c_{compute.name}"
    if row is None or column is None:
        raise ParameterError(f"compute {compute.name} (style {compute.style}) has a table of values; use {name}[row][column]")
    if not (1 <= row <= rows and 1 <= column <= columns):
        raise ParameterError(f"{name}[{row}][{column}] is out of range: the table has {rows} rows and {columns} columns")
    return row - 1, column - 1


def no_arguments(style: str, atom_style: str | None = None) -> Callable[[DeckState, str, list[str]], None]:
    """``ComputeSpec.prepare`` of a style without arguments that may need an atom style."""

    def check(state: DeckState, group: str, words: list[str]) -> None:
        read.count(words, f"compute ID group {style} (and no more)", 0)
        if atom_style is not None:
            state.require_atom_style(f"compute {style}", atom_style)

    return check


# -- words that name values ----------------------------------------------------------------------------------------------------
_FORM = re.compile(r"([cfv])_(\w+?)((?:\[\d+\]){0,2})", re.ASCII)


class Reference(NamedTuple):
    """The parts of a reference: kind (``c``, ``f`` or ``v``), id, and indices."""

    kind: str
    name: str
    indices: tuple[int, ...]


@lru_cache
def reference(word: str) -> Reference:
    """Parse a word that begins with ``c_``, ``f_`` or ``v_``.  ParameterError if it is malformed."""
    match = _FORM.fullmatch(word)
    if match is None:
        start = word[:2]
        raise ParameterError(f"expected {start}id, {start}id[index] or {start}id[row][column], not '{word}'")
    return Reference(match[1], match[2], tuple(map(int, re.findall(r"\d+", match[3]))))
