"""Bond and angle commands of decks: what the coefficients become, data files, errors."""

import chains_of_beads as chains
import numpy as np
import pytest
from cases import cases, raises

from openmm_dpd import CosineAngles, DeckError, FENEBonds, HarmonicAngles, HarmonicBonds, MorseBonds
from openmm_dpd.lammps import read_deck
from openmm_dpd.lammps.commands.output import data_file_lines
from openmm_dpd.units import UNIT_SYSTEMS

BOX = np.diag([6.0, 6.0, 6.0])
PAIR = "pair_style dpd 1 1 1\npair_coeff * * 25 4.5\nfix 1 all nve\nrun 0\n"


def state_of(folder, text, *, units="lj", style="angle", bond_types=2, angle_types=2):
    x, bonds, angles = chains.walks(4, 5, BOX, 1)
    data = chains.data_file(x, bonds, angles, BOX, bond_types=bond_types, angle_types=angle_types)
    (folder / "data.chains").write_text(data.replace("Atoms # angle", "Atoms"))
    path = folder / "in.deck"
    path.write_text(f"units {units}\natom_style {style}\nread_data data.chains\n{text}")
    return read_deck(path, stop_before_first_run=True, output=folder)


def test_coefficients_in_three_systems_of_units(tmp_path):
    text = "bond_style hybrid fene morse\nbond_coeff 1 fene 3 1.5 0.5 0.9\nbond_coeff 2 morse 5 2 0.7\nangle_style hybrid harmonic cosine\n"
    text += "angle_coeff 1 harmonic 7 120\nangle_coeff 2 cosine 9\npair_style none\nfix 1 all nve\nrun 0\n"
    for name in ("lj", "real", "metal"):
        scene = state_of(tmp_path, text, units=name).first_run.scene()
        fene, morse = scene.bonds
        harmonic, cosine = scene.angles
        units = UNIT_SYSTEMS[name]
        energy, length = units.energy, units.length
        assert isinstance(fene, FENEBonds) and isinstance(morse, MorseBonds)
        assert isinstance(harmonic, HarmonicAngles) and isinstance(cosine, CosineAngles)
        assert (fene.k[0], fene.R0[0]) == pytest.approx((3 * energy / length**2, 1.5 * length))
        assert (fene.epsilon[0], fene.sigma[0]) == pytest.approx((0.5 * energy, 0.9 * length))
        assert (morse.D[0], morse.alpha[0], morse.r0[0]) == pytest.approx((5 * energy, 2 / length, 0.7 * length))
        assert (harmonic.k[0], harmonic.theta0[0]) == pytest.approx((7 * energy, 2 * np.pi / 3))
        assert cosine.k[0] == pytest.approx(9 * energy)
        assert len(fene.pairs) + len(morse.pairs) == 16 and len(harmonic.triples) + len(cosine.triples) == 12


def test_what_has_no_energy(tmp_path):
    """Bonds without energy still count for special_bonds; angles without are left out."""
    text = "bond_style hybrid harmonic fene\nbond_coeff 1 harmonic 5 0.7\nbond_coeff 2 none\nangle_style zero\nangle_coeff *\n" + PAIR
    scene = state_of(tmp_path, text).first_run.scene()
    assert [bonds.k.any() for bonds in scene.bonds] == [True, False] and scene.angles == ()
    assert all(isinstance(bonds, HarmonicBonds) for bonds in scene.bonds)
    scene = state_of(tmp_path, "bond_style zero nocoeff\n" + PAIR).first_run.scene()
    assert not scene.bonds[0].k.any() and scene.bonded_factors == (0, 0, 0)


def test_a_style_that_is_set_again_keeps_its_coefficients(tmp_path):
    text = "bond_style harmonic\nbond_coeff * 5 0.7\nangle_style cosine\nangle_coeff * 2\nbond_style harmonic\nangle_style cosine\n" + PAIR
    scene = state_of(tmp_path, text).first_run.scene()
    assert scene.bonds[0].k[0] == 5 and scene.angles[0].k[0] == 2


@pytest.mark.parametrize("units", ["lj", "real"])
def test_write_data_and_read_data(tmp_path, units):
    """Bonds, angles and their coefficients come back as they were."""
    text = "bond_style hybrid fene morse\nbond_coeff 1 fene 3 1.5 0.5 0.9\nbond_coeff 2 morse 5 2 0.7\n"
    text += "angle_style harmonic\nangle_coeff * 7 120\n" + PAIR
    state = state_of(tmp_path, text, units=units)
    (tmp_path / "data.again").write_text("\n".join(data_file_lines(state)) + "\n")
    deck = tmp_path / "in.again"
    styles = "atom_style angle\nbond_style hybrid fene morse\nangle_style harmonic\npair_style dpd 1 1 1\n"
    deck.write_text(f"units {units}\n{styles}read_data data.again\nfix 1 all nve\nrun 0\n")
    again = read_deck(deck, stop_before_first_run=True, output=tmp_path)
    assert np.array_equal(again.angles, state.angles) and len(again.angles) == 12
    assert np.array_equal(again.bonds, state.bonds) and again.n_angle_types == 2
    for setup, other in ((state.bond, again.bond), (state.angle, again.angle)):
        assert setup.coefficients.keys() == other.coefficients.keys()
        for kind, (style, values) in setup.coefficients.items():
            assert other.coefficients[kind][0] == style and other.coefficients[kind][1] == pytest.approx(values, rel=1e-14)


def test_delete_atoms_takes_angles_along(tmp_path):
    text = "bond_style zero\ngroup first id 1:5\ndelete_atoms group first bond yes compress no\n" + PAIR
    state = state_of(tmp_path, text)
    assert len(state.bonds) == 12 and len(state.angles) == 9
    with pytest.raises(DeckError, match="4 bonds and 3 angles would lose a bead; add 'bond yes' to delete them"):
        state_of(tmp_path, text.replace("bond yes", ""))


ERRORS = {
    "style": (
        "angle_style charmm\n",
        "in.deck:4: the angle style must be one of none, harmonic, cosine, cosine/delta, cosine/squared, cosine/periodic, zero, hybrid, not 'charmm'",
    ),
    "style arguments": ("bond_style fene 3\n", "the argument of bond_style fene"),
    "hybrid of nothing": ("bond_style hybrid\n", "expected 'bond_style hybrid style style ...'"),
    "hybrid of unknown": ("bond_style hybrid harmonic class2\n", "a style of bond_style hybrid must be one of"),
    "hybrid twice": ("bond_style hybrid morse morse\n", "bond_style hybrid gives morse twice"),
    "no style": ("angle_coeff 1 2\n", "angle_coeff needs a preceding angle_style, such as 'angle_style cosine'"),
    "few": ("bond_style fene\nbond_coeff 1 30 1.5\n", "expected 'bond_coeff type K R0 epsilon sigma', but found 2 arguments"),
    "few in hybrid": ("bond_style hybrid fene\nbond_coeff 1 fene 30\n", "expected 'bond_coeff type fene K R0 epsilon sigma'"),
    "no style in hybrid": (
        "bond_style hybrid fene morse\nbond_coeff 1 30 1.5 1 1\n",
        "one of the styles fene, morse, none after the type, not '30'",
    ),
    "R0": ("bond_style fene\nbond_coeff 1 30 0 1 1\n", "in.deck:5: R0 must be > 0, but is 0"),
    "sigma": ("bond_style fene\nbond_coeff 1 30 1 1 0\n", "sigma must be > 0 where epsilon is"),
    "negative": ("bond_style morse\nbond_coeff 1 -3 1 1\n", "D must be >= 0, but is -3"),
    "angle": ("angle_style harmonic\nangle_coeff 1 3 200\n", "in.deck:5: angle theta0 must be from 0 to pi, but is 200 degrees"),
    "no number": ("angle_style cosine\nangle_coeff 1 x\n", "expected a number for K, not 'x'"),
    "type": ("angle_style cosine\nangle_coeff 3 1\n", "angle type 3 is out of range: there are 2"),
    "missing": (
        "bond_style zero\nangle_style cosine\nangle_coeff 1 2\n" + PAIR,
        "in.deck:5: no angle_coeff for angle type 2 (angle_style cosine)",
    ),
}


@cases("text, message", ERRORS)
def test_errors(tmp_path, text, message):
    with pytest.raises(DeckError) as caught:
        state_of(tmp_path, text).first_run.scene()
    assert message in str(caught.value)


DATA_ERRORS = {
    "bead": ("\n1 1 1 2 3\n", "\n1 1 1 2 99\n", "an angle names atom 99, which does not exist"),
    "bead twice": ("\n1 1 1 2 3\n", "\n1 1 1 2 1\n", "data.chains:62: an angle names atom 1 twice"),
    "bead bonded to itself": ("\n1 1 1 2\n", "\n1 1 2 2\n", "data.chains:43: a bond names atom 2 twice"),
    "type": ("\n1 1 1 2 3\n", "\n1 4 1 2 3\n", "angle type 4 is out of range; there are 2"),
    "words": ("\n1 1 1 2 3\n", "\n1 1 1 2\n", "expected 'id type atom1 atom2 atom3', not '1 1 1 2'"),
    "count": ("12 angles", "11 angles", "section Angles has 12 lines, but the header announces 11"),
}


@pytest.mark.parametrize("name", DATA_ERRORS)
def test_errors_of_data_files(tmp_path, name):
    state_of(tmp_path, "pair_style none\nfix 1 all nve\nrun 0\n")
    old, new, message = DATA_ERRORS[name]
    text = (tmp_path / "data.chains").read_text()
    head, _, tail = text.partition("Angles\n")
    changed = head.replace(old, new) + "Angles\n" + tail.replace(old, new)
    assert changed != text
    (tmp_path / "data.chains").write_text(changed)
    raises(DeckError, message, lambda: read_deck(tmp_path / "in.deck", stop_before_first_run=True, output=tmp_path))


def test_angles_need_a_style_that_has_them(tmp_path):
    with pytest.raises(DeckError, match="atom_style bond has no angles; use angle or molecular or full"):
        state_of(tmp_path, "pair_style none\nfix 1 all nve\nrun 0\n", style="bond")
