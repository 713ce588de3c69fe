"""Pair styles with charges: their arguments, the charges of a scene, and their export."""

import math
from itertools import combinations_with_replacement

import numpy as np

from ...base.errors import ParameterError
from ...base.units import COULOMB, UnitSystem
from ...model.electrostatics import GaussianCharges, SlaterCharges, ewald_sum
from ...model.scene import Scene
from ..files.data_file import CHARGED_STYLES
from ..language import arguments as read
from ..language.lexer import errors_at, located
from ..state.deck_state import DeckState
from ..state.pair_setup import Find, PairStyle, Spec, Values
from .dpd import STYLES as DPD_STYLES
from .words import Differences, StyleUse, cutoff_of, exact, no_force, settings

#: Coulomb constant of LAMMPS's unit styles, energy times length per squared charge.
QQR2E = {"lj": 1.0, "real": 332.06371, "metal": 14.399645, "si": 8.9876e9, "cgs": 1.0, "micro": 8.987556e6, "nano": 230.7078669}


def _dpd_slater_coefficient(style: PairStyle, words: list[str], _: Find) -> Values:
    """Parse ``A gamma [yes|no] [cutoff]``."""
    read.count(words, "A gamma [yes|no] [cutoff]", 2, 4)
    values: dict = {key: read.number(word, key) for key, word in zip(("A", "gamma"), words, strict=False)}
    values["charged"] = "yes" if len(words) > 2 and read.switch(words[2], "whether the pair is charged") else "no"
    return values, cutoff_of(words, 3)


def _slater_settings(words: list[str]) -> dict:
    found = settings("coul/slater/long", "lambda cutoff")(words)
    return {"lamda": found["lamda"], "cutoff_charges": found["cutoff"]}


def _slater_coefficient(style: PairStyle, words: list[str], _: Find) -> Values:
    """Check that ``pair_coeff * *`` has no coefficients."""
    read.count(words, "pair_coeff i j (coul/slater/long has no coefficients)", 0)
    return {}, None


_DPD_SLATER = settings("dpd/coul/slater/long", "T cut_dpd seed lambda cut_coul")

STYLES = {
    # build makes the DPD part; charges belong to the beads
    "dpd/coul/slater/long": Spec(_DPD_SLATER, _dpd_slater_coefficient, DPD_STYLES["dpd"].build, thermostat=True),
    "coul/slater/long": Spec(_slater_settings, _slater_coefficient, no_force, own_cutoffs=True),
}


# -- from a scene -------------------------------------------------------------------------------------------------------------
def charge_use(scene: Scene, units: UnitSystem, types: list[str], differences: Differences) -> StyleUse | None:
    """Pair style for the charges, or None.  ParameterError for charges between walls, since LAMMPS's lattice sums need a periodic box."""
    charges = scene.electrostatics
    if charges is None:
        return None
    if scene.walls:
        raise ParameterError("charges between walls cannot be exported: LAMMPS's lattice sums need a periodic box")
    width = _width(charges, differences)
    words = dict.fromkeys(combinations_with_replacement(types, 2), "")
    if scene.box is None:
        # the scene has no cutoff: take one that no pair reaches
        reach = 2.0 * float(np.linalg.norm(np.ptp(scene.positions, axis=0))) + 10 * width
        differences.remark(f"charges interact up to a distance of {exact(reach / units.length)}, which should exceed all distances")
        return StyleUse("coul/slater/cut", f"{exact(width / units.length)} {exact(reach / units.length)}", words, reach)
    assert scene.charges is not None
    reach = ewald_sum(charges, scene.box, int(np.count_nonzero(scene.charges))).cutoff
    return StyleUse("coul/slater/long", f"{exact(width / units.length)} {exact(reach / units.length)}", words, reach)


def _width(charges, differences: Differences) -> float:
    """The lambda (nm) of LAMMPS's Slater charges."""
    if isinstance(charges, SlaterCharges):
        return charges.lamda
    assert isinstance(charges, GaussianCharges)
    width = math.sqrt(math.pi) * charges.width
    differences.add(
        f"the Gaussian charges (width {charges.width:g}) are replaced by Slater charges with lambda = {width:g}, with the same energy "
        "at contact but a longer range"
    )
    return width


# -- to a scene ---------------------------------------------------------------------------------------------------------------
def electrostatics_of(state: DeckState) -> SlaterCharges | None:
    """The smeared charges of the scene; None if no pair style has charges.  DeckError if styles, charges and box are inconsistent."""
    styles = [style for style in state.pair.styles if "cutoff_charges" in style.settings]
    if not styles:
        if state.kspace is not None:
            raise located(state.kspace.where, "kspace_style needs a pair style with charges: dpd/coul/slater/long or coul/slater/long")
        return None
    style = styles[0]
    if len(styles) > 1:
        raise located(style.where, f"there are two pair styles with charges, {style.name} and {styles[1].name}; use one")
    if state.kspace is None:
        raise located(style.where, f"pair style {style.name} needs a kspace_style, ewald or pppm")
    if not state.has_atom_style(*CHARGED_STYLES):
        raise located(style.where, f"pair style {style.name} needs charges; atom_style {state.atom_style} has none; use charge or full")
    if not all(state.periodic):
        raise located(style.where, f"pair style {style.name} needs periodic boundaries along all axes")
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
    """Check that every pair of types with charges is a charged pair, since the lattice sum includes all charges."""
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
                f"types {i} {j} both have charges, but pair style {style.name} does not treat the pair as charged. The lattice sum "
                f"includes all charges, so their interaction would be wrong without the real-space part; {remedy}",
            )
    if not charged:
        raise style.error("no bead has a charge; read charges from the data file, or use 'set type'")
    for (i, j), found in sorted(style.coefficients.items()):
        if style.name.startswith("dpd") and found.values["charged"] == "yes" and not {i, j} <= set(charged):
            state.note(f"pair_coeff {i} {j} is marked as charged, but beads of these types have no charge: the flag has no effect")
