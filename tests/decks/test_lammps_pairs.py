"""Pair, bond and kspace commands: what the coefficients become, and in which units; what is refused."""

import numpy as np
import pytest
from cases import cases, put, raises

from openmm_dpd.base.errors import DeckError
from openmm_dpd.lammps import deck_scene, read_deck
from openmm_dpd.lammps.styles.charges import electrostatics_of
from openmm_dpd.model.pairs import DPD, NONE, LennardJones
from openmm_dpd.units import COULOMB, METAL, REAL

BOX = "region b block 0 {edge} 0 {edge} 0 {edge} units box\ncreate_box {types} b bond/types 2\ncreate_atoms 1 random 5 1 b\nmass * 1.0\n"
BOX += "fix 1 all nve\n"


def state_of(tmp_path, text: str, units: str = "lj", types: int = 3, edge: float = 20.0):
    path = put(tmp_path / "in.deck", f"units {units}\natom_style bond\n" + BOX.format(types=types, edge=edge) + text)
    return read_deck(path, stop_before_first_run=True)


def tables_of(tmp_path, text: str, **options):
    """One {(i, j): term} per pair style."""
    scene = state_of(tmp_path, text, **options).first_run.scene()
    return [table.resolve(scene.type_names) for table in scene.pairs]


def dpd_values(table: dict) -> dict:
    return {int(a + b): (term.A, term.gamma, term.cutoff) if term is not NONE else None for (a, b), term in table.items()}


def test_dpd_with_wildcards_later_lines_win(tmp_path):
    (table,) = tables_of(
        tmp_path,
        "pair_style dpd 1.0 1.0 7\npair_coeff * * 25 4.5\npair_coeff 1 2* 30 5 0.9\npair_coeff *2 3 31 6\npair_coeff 3 1 32 7 1.5\n"
        "pair_coeff 2*3 2*3 33 8\npair_coeff 2 * 34 9\npair_coeff 2 1 none\n",
    )
    # 'pair_coeff 2 *' is about pairs with i <= j only: (2, 2) and (2, 3)
    assert dpd_values(table) == {11: (25, 4.5, 1), 12: None, 13: (32, 7, 1.5), 22: (34, 9, 1), 23: (34, 9, 1), 33: (33, 8, 1)}


@cases(
    "style, coefficients, term",
    ("dpd 2.0 1.5 7", "25 4.5 1.2", DPD(A=25, gamma=4.5, cutoff=1.2)),
    ("dpd/tstat 2.0 2.0 1.5 7", "4.5", DPD(gamma=4.5, cutoff=1.5)),
    ("dpd/ext 2.0 1.5 7", "25 4.5 3.5 0.5 0.25", DPD(A=25, gamma=4.5, gamma_perp=3.5, exponent=0.5, exponent_perp=0.25, cutoff=1.5)),
    ("dpd/ext/tstat 2.0 2.0 1.5 7", "4.5 3.5 0.5 0.25 1", DPD(gamma=4.5, gamma_perp=3.5, exponent=0.5, exponent_perp=0.25, cutoff=1)),
    ("dpd/fdt 2.0 1.5 7", "25 3.0", DPD(A=25, sigma=3.0, cutoff=1.5)),
)
def test_every_style_of_the_family(tmp_path, style, coefficients, term):
    state = state_of(tmp_path, f"pair_style {style}\npair_coeff 1 1 {coefficients}\n", types=1)
    scene = state.first_run.scene()
    assert scene.pairs[0].resolve(["1"]) == {("1", "1"): term}
    assert scene.kT == 2.0
    assert state.first_run.seed == 7


def test_metal_units(tmp_path):
    # eV/A is 964.85 kJ/mol/nm, and eV ps^(1/2)/A as much
    (table,) = tables_of(tmp_path, "pair_style dpd/fdt 300 8.6 1\npair_coeff 1 1 0.075 0.022\n", units="metal", types=1, edge=30)
    term = table["1", "1"]
    assert term.A == pytest.approx(0.075 * 964.853, rel=1e-5)
    assert term.sigma == pytest.approx(0.022 * 964.853, rel=1e-5)
    assert term.cutoff == pytest.approx(0.86)
    assert METAL.force == pytest.approx(964.853, rel=1e-5)


def test_real_units(tmp_path):
    state = state_of(tmp_path, "pair_style dpd 300 9.0 1\npair_coeff 1 1 10 10.0\n", units="real", types=1, edge=30)
    term = state.first_run.scene().pairs[0].resolve(["1"])["1", "1"]
    assert term.A == pytest.approx(418.4, rel=1e-6)
    assert term.gamma == pytest.approx(10.0 * 0.4184, rel=1e-6)  # kcal fs/(mol A^2)
    assert state.first_run.scene().kT == pytest.approx(300 * 0.0019872067 * 4.184, rel=1e-6)
    assert REAL.force == pytest.approx(41.84, rel=1e-6)


def test_repeating_the_style_keeps_coefficients_but_not_cutoffs(tmp_path):
    text = "pair_style dpd 1.0 1.0 7\npair_coeff * * 25 4.5\npair_coeff 1 2 30 4.5 0.8\npair_style dpd 2.0 1.3 8\n"
    state = state_of(tmp_path, text, types=2)
    scene = state.first_run.scene()
    assert dpd_values(scene.pairs[0].resolve(scene.type_names)) == {11: (25, 4.5, 1.3), 12: (30, 4.5, 1.3), 22: (25, 4.5, 1.3)}
    assert (scene.kT, state.first_run.seed) == (2.0, 8)


def test_another_style_forgets_the_coefficients(tmp_path):
    text = "pair_style dpd 1.0 1.0 7\npair_coeff * * 25 4.5\npair_style dpd/ext 1.0 1.0 7\n"
    raises(DeckError, r"in.deck:10: no pair coefficients for type pair 1 1 \(pair style dpd/ext\)", tables_of, tmp_path, text, types=1)


MIXED = {
    "geometric": ((0.5 * 1.2) ** 0.5, (1.0 * 1.4) ** 0.5, (2.0 * 3.0) ** 0.5),
    "arithmetic": ((0.5 * 1.2) ** 0.5, 1.2, 2.5),
    "sixthpower": (2 * (0.5 * 1.2) ** 0.5 * 1.4**3 / (1 + 1.4**6), ((1 + 1.4**6) / 2) ** (1 / 6), ((2.0**6 + 3.0**6) / 2) ** (1 / 6)),
}


@pytest.mark.parametrize("rule", [None, *MIXED])
def test_lennard_jones_mixes(tmp_path, rule):
    modify = "" if rule is None else f"pair_modify mix {rule} shift yes\n"
    text = f"pair_style lj/cut 2.0\n{modify}pair_coeff 1 1 0.5 1.0\npair_coeff 2 2 1.2 1.4 3.0\n"
    (table,) = tables_of(tmp_path, text, types=2)
    term = table["1", "2"]
    assert isinstance(term, LennardJones)
    assert (term.epsilon, term.sigma, term.cutoff) == pytest.approx(MIXED[rule or "geometric"])
    assert term.shift == (rule is not None)


def test_hybrid_overlay(tmp_path):
    text = "pair_style hybrid/overlay lj/cut 2.5 dpd/tstat 1.0 1.0 1.5 7\npair_coeff * * lj/cut 1.0 1.0\npair_coeff * * dpd/tstat 4.5\n"
    text += "pair_coeff 1 2 dpd/tstat 9.0 1.2\npair_coeff 2 2 none\npair_modify pair lj/cut shift yes\n"
    lj, tstat = tables_of(tmp_path, text, types=2)
    assert lj["1", "2"] == LennardJones(1, 1, 2.5, shift=True)
    assert lj["2", "2"] is NONE and ("2", "2") not in tstat
    assert {key: (term.gamma, term.cutoff) for key, term in tstat.items()} == {("1", "1"): (4.5, 1.5), ("1", "2"): (9.0, 1.2)}


def test_a_pair_set_to_none_can_be_set_again(tmp_path):
    (table,) = tables_of(tmp_path, "pair_style dpd 1 1 1\npair_coeff * * none\npair_coeff 1 1 25 4.5\n", types=2)
    assert dpd_values(table) == {11: (25, 4.5, 1), 12: None, 22: None}


def test_hybrid_gives_each_pair_one_style(tmp_path):
    text = "pair_style hybrid lj/cut 2.5 dpd 1.0 1.0 7\npair_coeff * * lj/cut 1.0 1.0\npair_coeff 1 2 dpd 25 4.5\n"
    lj, dpd = tables_of(tmp_path, text, types=2)
    assert set(lj) == {("1", "1"), ("2", "2")} and set(dpd) == {("1", "2")}


def test_hybrid_mixes_pairs_of_one_style(tmp_path):
    text = "pair_style hybrid/overlay lj/cut 2.5 zero 1.0\npair_coeff 1 1 lj/cut 1.0 1.0\npair_coeff 2 2 lj/cut 4.0 1.0\n"
    text += "pair_coeff 3 3 zero\npair_coeff 1*2 3 zero\n"
    lj, _ = tables_of(tmp_path, text, types=3)
    assert lj["1", "2"].epsilon == pytest.approx(2.0)


def test_one_style_used_twice_is_numbered(tmp_path):
    text = "pair_style hybrid/overlay dpd 1.0 1.0 7 dpd 1.0 2.0 8\npair_coeff * * dpd 1 25 4.5\npair_coeff * * dpd 2 -5 0.0\n"
    first, second = tables_of(tmp_path, text, types=1)
    assert dpd_values(first) == {11: (25, 4.5, 1)}
    assert dpd_values(second) == {11: (-5, 0, 2)}


def test_tables_are_found_beside_the_deck(tmp_path, monkeypatch):
    r = np.linspace(0.5, 2.5, 41)
    rows = [f"{k + 1} {x} {(2.5 - x) ** 2} {2 * (2.5 - x)}" for k, x in enumerate(r)]
    (tmp_path / "tab").write_text("KEY\nN 41 R 0.5 2.5\n\n" + "\n".join(rows) + "\n")
    monkeypatch.chdir("/")
    text = "pair_style hybrid/overlay table linear 1000 dpd/tstat 1 1 1 3\npair_coeff 1 1 table tab KEY 2.0\npair_coeff 1 1 dpd/tstat 4.5\n"
    table, _ = tables_of(tmp_path, text, types=1)
    assert table["1", "1"].cutoff == 2.0


def test_none_at_all(tmp_path):
    (table,) = tables_of(tmp_path, "pair_style none\n", types=2)
    assert set(table.values()) == {NONE}


@cases(
    "text, factors",
    ("", (0, 0, 0)),
    ("special_bonds lj/coul 0.5 1.0 0.25", (0.5, 1, 0.25)),
    ("special_bonds lj 0.5 1.0 0.25 coul 0 0 0", (0.5, 1, 0.25)),
    ("special_bonds lj 1 1 1\nspecial_bonds coul 0 0 0.5", (0, 0, 0)),  # each command starts from the defaults
    ("special_bonds fene", (0, 1, 1)),
    ("special_bonds amber", (0, 0, 0.5)),
    ("special_bonds dreiding angle no", (0, 0, 1)),
)
def test_special_bonds(tmp_path, text, factors):
    assert state_of(tmp_path, text + "\n").special == factors


def test_bonds(tmp_path):
    text = "pair_style dpd 1 1 1\npair_coeff * * 25 4.5\nbond_style harmonic\nbond_coeff * 50 0.8\nbond_coeff 2 75 0.9\n"
    state = state_of(tmp_path, text, units="real", edge=40)
    state.bonds = np.array([[2, 1, 2], [1, 3, 4]])
    first, second = state.first_run.scene().bonds
    assert first.k[0] == pytest.approx(50 * 418.4, rel=1e-6) and first.r0[0] == pytest.approx(0.08)
    assert second.k[0] == pytest.approx(75 * 418.4, rel=1e-6) and second.pairs.tolist() == [[0, 1]]


def test_bonds_without_a_style_only_count_for_special_bonds(tmp_path):
    state = state_of(tmp_path, "pair_style dpd 1 1 1\npair_coeff * * 25 4.5\nbond_style none\n")
    state.bonds = np.array([[1, 1, 2]])
    scene = state.first_run.scene()
    assert scene.bonds[0].k.tolist() == [0] and scene.bonded_factors == (0, 0, 0)
    assert any("no bond_style" in note for note in state.notes)


def test_special_factors_have_no_meaning_without_bonds(tmp_path):
    assert state_of(tmp_path, "pair_style dpd 1 1 1\npair_coeff * * 25 4.5\n").first_run.scene().bonded_factors == (1, 1, 1)


@cases(
    "text, message",
    ("pair_style dpd 1.0 1.0 7\npair_coeff 1 1 25 4.5\n", "no pair coefficients for type pairs 1 2, 2 2"),
    ("pair_style dpd 1.0 1.0 7\npair_coeff * * 25 -4.5\n", r"in.deck:9: pair style dpd, types \* \*: gamma must be >= 0, but is -4.5"),
    ("pair_style dpd -1.0 1.0 7\n", "in.deck:8: the temperature of dpd must be >= 0, but is -1.0"),
    ("pair_style dpd 1.0 0 7\n", "the cutoff of dpd must be > 0"),
    ("pair_style dpd 1.0 1.0 0\n", "the seed of dpd must be at least 1"),
    ("pair_style dpd 1.0 1.0\n", "expected 'dpd T cutoff seed', but found 2 arguments"),
    ("pair_style dpd 1 1 1\npair_coeff 1 1 25\n", r"expected 'A gamma \[cutoff\]', but found 1 argument"),
    ("pair_style dpd 1 1 1\npair_coeff 1 4 25 4.5\n", "atom type 4 is out of range: there are 2"),
    ("pair_style dpd 1 1 1\npair_coeff 1 0 25 4.5\n", "atom type 0 is out of range"),
    ("pair_style dpd 1 1 1\npair_coeff 1 x 25 4.5\n", "expected atom type as a number or a range such as 1\\*3, not 'x'"),
    ("pair_style dpd 1 1 1\npair_coeff 2* 1 25 4.5\n", "contains no pair of types with i <= j"),
    ("pair_style dpd 1 1 1\npair_coeff * * 25 4.5 11\n", "in.deck:9: the cutoff 11 of types 1 1 exceeds half the box, 10"),
    ("pair_style dpd 1 11 1\npair_coeff * * 25 4.5\n", "in.deck:9: the cutoff 11 of types 1 1 exceeds half the box"),
    ("pair_style dpd/fdt 0.0 1.0 1\npair_coeff * * 25 3\n", "means infinite friction"),
    ("pair_style dpd/ext 1 1 1\npair_coeff * * 25 4.5 4.5 -0.5 0.5\n", "exponent must be >= 0"),
    ("pair_style dpd/coul/other 1 1 1\n", "pair style 'dpd/coul/other' is not supported; supported are dpd,"),
    ("pair_style hybrid/overlay dpd 1 1 1 coul/long/cs 10\n", "pair style 'coul/long/cs' is not supported"),
    ("pair_style hybrid/overlay dpd 1 1 1 lj/cut 2\npair_coeff * * dpd 25 4.5\n", "pair style lj/cut is used by no type pair"),
    ("pair_style hybrid/overlay dpd 1 1 1 lj/cut 2\npair_coeff * * 25 4.5\n", "expected one of the styles dpd, lj/cut or none, not '25'"),
    (
        "pair_style hybrid/overlay dpd 1 1 1 dpd 1 1 1\npair_coeff * * dpd 25 4.5\n",
        "expected a whole number for which of the 2 styles|there is no number 25",
    ),
    (
        "pair_style hybrid/overlay dpd 1 1 1 dpd/tstat 1 2 1 3\npair_coeff * * dpd 25 4.5\npair_coeff * * dpd/tstat 4.5\n",
        "pair styles dpd and dpd/tstat have different temperatures",
    ),
    ("pair_coeff 1 1 25 4.5\n", "pair_coeff needs a preceding pair_style"),
    ("pair_modify shift yes\n", "pair_modify needs a preceding pair_style"),
    ("pair_style lj/cut 2\npair_modify tail yes\n", "pair_modify tail yes is not supported"),
    ("pair_style table quick 100\n", "the table style must be one of lookup, linear, spline, bitmap"),
    ("pair_style table linear 100\npair_coeff * * nofile KEY\n", "there is no file 'nofile'"),
    ("special_bonds lj 0.5 2.0 1.0\n", "must be between 0 and 1"),
    ("bond_style gromos\n", "the bond style must be one of none, harmonic, fene, morse, .*, hybrid, not 'gromos'"),
    ("bond_coeff 1 1 1\n", "bond_coeff needs a preceding bond_style, such as 'bond_style harmonic'"),
    ("bond_style harmonic\nbond_coeff 3 1 1\n", "bond type 3 is out of range: there are 2"),
    ("bond_style harmonic\nbond_coeff 1 -1 1\n", "K must be >= 0, but is -1"),
)
def test_errors(tmp_path, text, message):
    with pytest.raises(DeckError, match=message) as caught:
        tables_of(tmp_path, text, types=2)
    assert caught.value.line is not None


# -- charges ------------------------------------------------------------------------------------------------------------------------
CHARGED = (
    "units {units}\natom_style charge\nregion box block 0 {edge} 0 {edge} 0 {edge}\ncreate_box 2 box\ncreate_atoms 1 random 20 7 NULL\n"
)
CHARGED += "create_atoms 2 random 20 8 NULL\nmass * 1.0\nset type 2 charge {charge}\n{styles}\nfix move all nve\nrun 0\n"
STYLES = "pair_style dpd/coul/slater/long 1.0 {one} 5 {lamda} {cutoff}\npair_coeff 1 * 25 4.5\npair_coeff 2 2 25 4.5 yes\n"
STYLES += "kspace_style pppm 1.0e-5\n"
LJ = {"units": "lj", "edge": 6, "charge": 0.0}


def charged(tmp_path, styles, **settings):
    text = CHARGED.format(styles=styles, **{**LJ, **settings})
    # half of the second kind is positive, half negative
    text = text.replace("set type 2 charge 0.0", "set atom 21*30 charge 1.0\nset atom 31*40 charge -1.0")
    return deck_scene(put(tmp_path / "in.deck", text))


@pytest.mark.parametrize(("units", "length", "constant"), [("lj", 1.0, 1.0), ("real", 0.1, COULOMB), ("metal", 0.1, COULOMB)])
def test_what_a_deck_says_of_charges(units, length, constant, tmp_path):
    """Lengths and the Coulomb constant in each unit style; dielectric divides it; gewald and mesh are taken over."""
    one, edge = 1 / length, 6 / length
    more = f"dielectric 2.0\nkspace_modify gewald {1.5 * length} mesh 24 24 32 order 5\n"
    styles = STYLES.format(one=one, lamda=0.25 * one, cutoff=2 * one) + more
    charges = charged(tmp_path, styles, units=units, edge=edge).electrostatics
    assert (charges.lamda, charges.cutoff, charges.tolerance, charges.alpha) == pytest.approx((0.25, 2.0, 1e-5, 1.5))
    assert charges.grid == (24, 24, 32)
    assert charges.coulomb(1.0) == pytest.approx(constant / 2, rel=1e-6)  # the constants of real and metal are older than OpenMM's


@pytest.mark.parametrize(("mesh", "grid", "noted"), [("24 24 24", (24, 24, 24), 0), ("6 24 24", None, 1)])
def test_meshes_too_coarse_for_a_sum_are_replaced_with_a_note(mesh, grid, noted, tmp_path):
    """At alpha = 1.5 six points along an edge of 6 are refused in a script; a deck gets the mesh of the accuracy."""
    styles = STYLES.format(one=1.0, lamda=0.25, cutoff=2.0) + f"kspace_modify gewald 1.5{'1' * noted} mesh {mesh}\n"
    assert charged(tmp_path, styles).electrostatics.grid != (6, 24, 24)
    state = read_deck(tmp_path / "in.deck", stop_before_first_run=True)
    assert electrostatics_of(state).grid == grid
    assert sum("points are too few" in note for note in state.notes) == noted


def test_cutoffs_of_zero_leave_charges_out(tmp_path):
    """As in LAMMPS; where some pairs of charges interact, all have to."""
    styles = "pair_style hybrid/overlay dpd 1.0 1.0 5 coul/cut 2.0\npair_coeff * * dpd 25 4.5\npair_coeff * * coul/cut 0\n"
    assert charged(tmp_path, styles).electrostatics is None
    raises(DeckError, "types 2 2 both have charges", charged, tmp_path, styles + "pair_coeff 1 1 coul/cut\n")


SLATER = STYLES.format(one=1.0, lamda=0.25, cutoff=2.0)
OVERLAY = "pair_style hybrid/overlay dpd 1.0 1.0 5 coul/slater/long 0.25 2.0\npair_coeff * * dpd 25 4.5\n"
BAD_CHARGES = [
    ("types 2 2 both have charges", SLATER.replace(" yes", "")),
    ("types 2 2 both have charges", SLATER.replace(" yes", " no")),
    ("types 2 2 both have charges", OVERLAY + "pair_coeff 1 1 coul/slater/long\nkspace_style ewald 1e-5\n"),
    ("needs a kspace_style", SLATER.replace("kspace_style pppm 1.0e-5", "")),
    ("needs a kspace_style", SLATER + "kspace_style none\n"),
    ("kspace_style needs a pair style with charges", "pair_style dpd 1 1 5\npair_coeff * * 25 4.5\nkspace_style ewald 1e-4\n"),
    ("the style of kspace_style must be one of none, ewald, pppm, pppm/cg, not 'msm'", SLATER + "kspace_style msm 1e-4\n"),
    ("the accuracy of kspace_style must be between", SLATER + "kspace_style ewald 2.0\n"),
    ("slab 3.0 is not supported", SLATER + "kspace_modify slab 3.0\n"),
    ("force 1e-5 is not supported", SLATER + "kspace_modify force 1e-5\n"),
    ("compute no is not supported", SLATER + "kspace_modify compute no\n"),
    ("at least 6 points", SLATER + "kspace_modify mesh 4 8 8\n"),
    ("kspace_modify needs a preceding kspace_style", "kspace_modify mesh 8 8 8\n"),
    ("lambda of dpd/coul/slater/long", STYLES.format(one=1.0, lamda=0.0, cutoff=2.0)),
    ("over half the box", STYLES.format(one=1.0, lamda=0.25, cutoff=3.1)),
    ("the dielectric constant", SLATER + "dielectric 0\n"),
    ("no coefficients", OVERLAY + "pair_coeff * * coul/slater/long 1.0\n"),
]


@pytest.mark.parametrize(("message", "styles"), BAD_CHARGES)
def test_what_is_refused_of_charges(message, styles, tmp_path):
    """With file and line."""
    with pytest.raises(DeckError, match=message) as error:
        charged(tmp_path, styles)
    assert error.value.line is not None


def test_overlay_and_flags(tmp_path):
    overlay = charged(tmp_path, OVERLAY + "pair_coeff 2 2 coul/slater/long\nkspace_style ewald 1e-5\n")
    assert overlay.electrostatics == charged(tmp_path, SLATER).electrostatics


def test_decks_without_charged_beads(tmp_path):
    path = put(tmp_path / "in.deck", CHARGED.format(styles=SLATER, units="lj", edge=6, charge="0"))
    raises(DeckError, "no bead has a charge", deck_scene, path)
