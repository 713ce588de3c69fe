"""Charges in decks: what the commands read, and what they refuse."""

import pytest
from cases import put

from openmm_dpd.base.errors import DeckError
from openmm_dpd.lammps import deck_scene
from openmm_dpd.units import COULOMB

DECK = "units {units}\natom_style charge\nregion box block 0 {edge} 0 {edge} 0 {edge}\ncreate_box 2 box\ncreate_atoms 1 random 20 7 NULL\n"
DECK += "create_atoms 2 random 20 8 NULL\nmass * 1.0\nset type 2 charge {charge}\n{styles}\nfix move all nve\nrun 0\n"
STYLES = "pair_style dpd/coul/slater/long 1.0 {one} 5 {lamda} {cutoff}\npair_coeff 1 * 25 4.5\npair_coeff 2 2 25 4.5 yes\n"
STYLES += "kspace_style pppm 1.0e-5\n"
LJ = {"units": "lj", "edge": 6, "charge": 0.0}


def scene(tmp_path, styles, **settings):
    text = DECK.format(styles=styles, **{**LJ, **settings})
    # half of the second kind is positive, half negative
    text = text.replace("set type 2 charge 0.0", "set atom 21*30 charge 1.0\nset atom 31*40 charge -1.0")
    return deck_scene(put(tmp_path / "in.deck", text))


@pytest.mark.parametrize(("units", "length", "constant"), [("lj", 1.0, 1.0), ("real", 0.1, COULOMB), ("metal", 0.1, COULOMB)])
def test_what_a_deck_says(units, length, constant, tmp_path):
    """Lengths and the Coulomb constant in each unit style; dielectric divides it; gewald and mesh are taken over."""
    one, edge = 1 / length, 6 / length
    more = f"dielectric 2.0\nkspace_modify gewald {1.5 * length} mesh 24 24 32 order 5\n"
    styles = STYLES.format(one=one, lamda=0.25 * one, cutoff=2 * one) + more
    charges = scene(tmp_path, styles, units=units, edge=edge).electrostatics
    assert (charges.lamda, charges.cutoff, charges.tolerance, charges.alpha) == pytest.approx((0.25, 2.0, 1e-5, 1.5))
    assert charges.grid == (24, 24, 32)
    assert charges.coulomb(1.0) == pytest.approx(constant / 2, rel=1e-6)  # the constants of real and metal are older than OpenMM's


SLATER = STYLES.format(one=1.0, lamda=0.25, cutoff=2.0)
OVERLAY = "pair_style hybrid/overlay dpd 1.0 1.0 5 coul/slater/long 0.25 2.0\npair_coeff * * dpd 25 4.5\n"
BAD = [
    ("types 2 2 both have charges", SLATER.replace(" yes", "")),
    ("types 2 2 both have charges", SLATER.replace(" yes", " no")),
    ("types 2 2 both have charges", OVERLAY + "pair_coeff 1 1 coul/slater/long\nkspace_style ewald 1e-5\n"),
    ("needs a kspace_style", SLATER.replace("kspace_style pppm 1.0e-5", "")),
    ("needs a kspace_style", SLATER + "kspace_style none\n"),
    ("kspace_style needs a pair style with charges", "pair_style dpd 1 1 5\npair_coeff * * 25 4.5\nkspace_style ewald 1e-4\n"),
    ("the style of kspace_style must be one of none, ewald, pppm, pppm/cg, not 'msm'", SLATER + "kspace_style msm 1e-4\n"),
    ("the accuracy of kspace_style must be between", SLATER + "kspace_style ewald 2.0\n"),
    ("slab is not supported", SLATER + "kspace_modify slab 3.0\n"),
    ("force is not supported", SLATER + "kspace_modify force 1e-5\n"),
    ("compute no is not supported", SLATER + "kspace_modify compute no\n"),
    ("at least 6 points", SLATER + "kspace_modify mesh 4 8 8\n"),
    ("kspace_modify needs a kspace_style", "kspace_modify mesh 8 8 8\n"),
    ("lambda of dpd/coul/slater/long", STYLES.format(one=1.0, lamda=0.0, cutoff=2.0)),
    ("over half the box", STYLES.format(one=1.0, lamda=0.25, cutoff=3.1)),
    ("the dielectric constant", SLATER + "dielectric 0\n"),
    ("no coefficients", OVERLAY + "pair_coeff * * coul/slater/long 1.0\n"),
]


@pytest.mark.parametrize(("message", "styles"), BAD)
def test_what_is_refused(message, styles, tmp_path):
    """With file and line."""
    with pytest.raises(DeckError, match=message) as error:
        scene(tmp_path, styles)
    assert error.value.line is not None


def test_overlay_and_flags(tmp_path):
    overlay = scene(tmp_path, OVERLAY + "pair_coeff 2 2 coul/slater/long\nkspace_style ewald 1e-5\n")
    assert overlay.electrostatics == scene(tmp_path, SLATER).electrostatics


def test_decks_without_charged_beads(tmp_path):
    text = SLATER
    with pytest.raises(DeckError, match="no bead has a charge"):
        deck_scene(put(tmp_path / "in.deck", DECK.format(styles=text, units="lj", edge=6, charge="0")))
