"""Charges of a deck: what its pair styles and ``kspace_style`` say together."""

import numpy as np

from ...model.electrostatics import SlaterCharges
from ...units import COULOMB
from ..files.atom_styles import CHARGED_STYLES
from ..language.lexer import errors_at, located
from ..state.deck_state import DeckState
from ..state.pair_setup import PairStyle
from ..styles.charges import QQR2E


def electrostatics_of(state: DeckState) -> SlaterCharges | None:
    """Smeared charges of the scene, None if no pair style has them.

    Raises
    ------
    DeckError
        If pair styles, kspace_style, charges and box do not go together.
    """
    styles = [style for style in state.pair.styles if "cutoff_charges" in style.settings]
    if not styles:
        if state.kspace is not None:
            raise located(state.kspace.where, "kspace_style needs a pair style with charges: dpd/coul/slater/long or coul/slater/long")
        return None
    style = styles[0]
    if len(styles) > 1:
        raise located(style.where, f"two pair styles with charges, {style.name} and {styles[1].name}; a scene has one kind of charges")
    if state.kspace is None:
        raise located(style.where, f"pair style {style.name} needs a kspace_style, ewald or pppm")
    if state.atom_style not in CHARGED_STYLES:
        raise located(style.where, f"pair style {style.name} needs charges; atom_style {state.atom_style} has none, charge and full do")
    if not all(state.periodic):
        raise located(style.where, f"pair style {style.name} needs periodic boundaries along all axes: its charges repeat along all three")
    _check_flags(state, style)
    settings, units, kspace = style.settings, state.units, state.kspace
    constant = QQR2E[units.name] * units.energy * units.length / state.dielectric
    with errors_at(style.where, f"pair style {style.name}: "):
        return SlaterCharges(
            lamda=settings["lamda"] * units.length,
            permittivity=COULOMB / constant,
            cutoff=settings["cutoff_charges"] * units.length,
            tolerance=kspace.accuracy,
            alpha=kspace.gewald,
            grid=kspace.mesh,  # type: ignore[arg-type]
            bonded_factors=state.special_charges if len(state.bonds) else None,
        )


def _check_flags(state: DeckState, style: PairStyle) -> None:
    """Every pair of types with charges must be a charged one: the lattice sum holds all charges."""
    charged = sorted(np.unique(state.atoms.types[state.atoms.charges != 0]).tolist())
    counts = {kind: int(np.sum(state.atoms.types == kind)) for kind in charged}
    for k, i in enumerate(charged):
        for j in charged[k:]:
            if i == j and counts[i] == 1:
                continue
            found = style.coefficients.get((i, j))
            if found is not None and found.values.get("charged", "yes") == "yes":
                continue
            where = style.where if found is None else found.where
            remedy = "say 'yes' on its pair_coeff line" if style.name.startswith("dpd") else "add a pair_coeff line of coul/slater/long"
            raise located(
                where,
                f"types {i} {j} both have charges, but pair style {style.name} does not count the pair as charged. The lattice sum "
                f"holds all charges, and without the real-space part their interaction would be wrong; {remedy}",
            )
    if not charged:
        raise style.error("no bead has a charge; read charges from the data file, or use 'set type'")
    for (i, j), found in sorted(style.coefficients.items()):
        if style.name.startswith("dpd") and found.values["charged"] == "yes" and not {i, j} <= set(charged):
            state.note(f"pair_coeff {i} {j} is marked as charged, but beads of these types have no charge: the flag has no effect")
