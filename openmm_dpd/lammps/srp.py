"""Pair style srp: segmental repulsion between bonds, which LAMMPS organises as pairs of placeholder particles of a type of their own."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from ..errors import DeckError, ParameterError
from ..model.segments import DISTANCES, SegmentalRepulsion
from . import arguments as read

if TYPE_CHECKING:
    from collections.abc import Callable

    from .pair_styles import PairStyle
    from .state import DeckState

#: Words of the style that are no numbers.
WORDS = frozenset(("*", *DISTANCES, "exclude", "bptype", "yes", "no"))


def srp_settings(words: list[str]) -> dict:
    """Settings of ``srp cutoff btype|* mid|min [exclude yes|no] [bptype N]``."""
    read.count(words, "srp cutoff bond-type|* mid|min [exclude yes|no] [bptype N]", 3, None)
    found = {
        "cutoff": read.positive(words[0], "the cutoff of srp"),
        "bond_type": None if words[1] == "*" else read.integer(words[1], "the bond type of srp (or *)", 1),
        "distance": read.choice(words[2], "the distance of srp", DISTANCES),
        "exclude": True,
        "bptype": None,
    }
    for keyword, values in read.options(words[3:], {"exclude": 1, "bptype": 1}, "pair_style srp"):
        if keyword == "exclude":
            found["exclude"] = read.switch(values[0], "exclude")
        else:
            found["bptype"] = read.integer(values[0], "bptype", 1)
    if found["distance"] == "min" and not found["exclude"]:
        raise ParameterError("pair style srp: 'exclude no' goes with the distance mid only; bonds that share a bead are at the distance 0")
    return found


def srp_coefficient(style: PairStyle, words: list[str], _: Callable[[str], Path]) -> tuple[dict, float | None]:
    """``A [cutoff]``."""
    read.count(words, "A [cutoff]", 1, 2)
    return {"A": read.non_negative(words[0], "A")}, read.positive(words[1], "the cutoff") if len(words) > 1 else None


def segments_of(state: DeckState, compat: str) -> SegmentalRepulsion | None:
    """The segmental repulsion of the deck, None if it has none.

    Raises
    ------
    DeckError
        If its bond type or bptype is out of range, its coefficient is missing or is that of another type, or beads have its type.
    """
    styles = [style for style in state.pair.styles if style.name == "srp"]
    if not styles:
        return None
    style, settings = styles[0], styles[0].settings

    def complain(message: str) -> DeckError:
        return DeckError(f"pair style srp: {message}", style.where.file, style.where.number)

    if len(styles) > 1:
        raise complain("it can be used once only")
    placeholder = state.n_types if settings["bptype"] is None else settings["bptype"]
    if placeholder > state.n_types:
        raise complain(f"bptype {placeholder} is out of range: there are {state.n_types} atom types")
    wrong = sorted(pair for pair in style.coefficients if pair != (placeholder, placeholder))
    if wrong:
        raise complain(f"it has coefficients for types {wrong[0][0]} {wrong[0][1]}; they belong to {placeholder} {placeholder}, its bptype")
    if not style.coefficients:
        raise complain(f"there is no 'pair_coeff {placeholder} {placeholder} srp A [cutoff]'")
    for other in state.pair.styles:
        met = sorted(pair for pair in other.coefficients if other is not style and placeholder in pair)
        if met:
            i, j = met[0]
            raise complain(f"type {placeholder} stands for bonds (bptype), but types {i} {j} have coefficients of {other.name}; use none")
    if np.any(state.atoms.types == placeholder):
        count = int(np.sum(state.atoms.types == placeholder))
        raise complain(f"type {placeholder} stands for bonds (bptype), but {count} beads have it (LAMMPS would delete them)")
    coefficient = style.coefficients[(placeholder, placeholder)]
    cutoff = style.cutoff(coefficient)
    assert cutoff is not None
    if compat != "lammps" and settings["distance"] == "min":
        state.note(
            "pair srp min: the nearest points of two bonds are used. LAMMPS moves each point to the end of its bond by itself, which gives "
            "other points and smaller energies (--compat lammps does the same)"
        )
    if _counts_beads(state):
        state.note("pair srp: thermo output is not divided by the number of beads, as in LAMMPS with this style")
        state.thermo.norm = False
    units = state.units
    return SegmentalRepulsion(
        coefficient.values["A"] * units.force,
        cutoff * units.length,
        settings["distance"],
        _segments(state, settings["bond_type"], complain),
        settings["exclude"],
    )


def _counts_beads(state: DeckState) -> bool:
    return state.units.normalize if state.thermo.norm is None else state.thermo.norm


def _segments(state: DeckState, kind: int | None, complain: Callable[[str], DeckError]) -> np.ndarray:
    """Bead indices of the bonds of one type, or of all."""
    if kind is not None and kind > state.n_bond_types:
        raise complain(f"bond type {kind} is out of range: there are {state.n_bond_types}")
    ids = state.bonds[(state.bonds[:, 0] == kind) if kind is not None else slice(None), 1:]
    if not len(ids):
        raise complain("there are no bonds" + ("" if kind is None else f" of type {kind}"))
    return state.atoms.index_of(ids.ravel()).reshape(-1, 2)
