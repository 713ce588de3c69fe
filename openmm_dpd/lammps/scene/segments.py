"""Pair style srp in the scene: segmental repulsion between bonds."""

import numpy as np

from ...model.segments import SegmentalRepulsion
from ..state.deck_state import DeckState
from ..state.pair_setup import PairStyle


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
    if len(styles) > 1:
        raise style.error("it can be used once only")
    kind = state.n_types if settings["bptype"] is None else settings["bptype"]
    if kind > state.n_types:
        raise style.error(f"bptype {kind} is out of range: there are {state.n_types} atom types")
    wrong = sorted(pair for pair in style.coefficients if pair != (kind, kind))
    if wrong:
        raise style.error(f"it has coefficients for types {wrong[0][0]} {wrong[0][1]}; they belong to {kind} {kind}, its bptype")
    if not style.coefficients:
        raise style.error(f"there is no 'pair_coeff {kind} {kind} srp A [cutoff]'")
    for other in state.pair.styles:
        met = sorted(pair for pair in other.coefficients if other is not style and kind in pair)
        if met:
            i, j = met[0]
            raise style.error(f"type {kind} stands for bonds (bptype), but types {i} {j} have coefficients of {other.name}; use none")
    if np.any(state.atoms.types == kind):
        count = int(np.sum(state.atoms.types == kind))
        raise style.error(f"type {kind} stands for bonds (bptype), but {count} beads have it (LAMMPS would delete them)")
    coefficient = style.coefficients[(kind, kind)]
    cutoff = style.cutoff(coefficient)
    assert cutoff is not None
    if compat != "lammps" and settings["distance"] == "min":
        state.note(
            "pair srp min: the nearest points of two bonds are used. LAMMPS moves each point to the end of its bond by itself, which gives "
            "other points and smaller energies (--compat lammps does the same)"
        )
    if state.units.normalize if state.thermo.norm is None else state.thermo.norm:
        state.note("pair srp: thermo output is not divided by the number of beads, as in LAMMPS with this style")
        state.thermo.norm = False
    units = state.units
    return SegmentalRepulsion(
        coefficient.values["A"] * units.force,
        cutoff * units.length,
        settings["distance"],
        _segments(state, style),
        settings["exclude"],
    )


def _segments(state: DeckState, style: PairStyle) -> np.ndarray:
    """Bead indices of the bonds of one type, or of all."""
    kind = style.settings["bond_type"]
    if kind is not None and kind > state.n_bond_types:
        raise style.error(f"bond type {kind} is out of range: there are {state.n_bond_types}")
    ids = state.bonds[(state.bonds[:, 0] == kind) if kind is not None else slice(None), 1:]
    if not len(ids):
        raise style.error("there are no bonds" + ("" if kind is None else f" of type {kind}"))
    return state.atoms.index_of(ids.ravel()).reshape(-1, 2)
