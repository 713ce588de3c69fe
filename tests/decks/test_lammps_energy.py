"""Decks of energy-conserving DPD, eDPD, tDPD, mDPD and constant pressure: what they become, in which units, and what is refused."""

import re

import numpy as np
import pytest
from cases import cases, put, raises

from openmm_dpd.base.errors import DeckError
from openmm_dpd.lammps import RunOptions, deck_forces, explain_deck, read_deck
from openmm_dpd.lammps.commands.output import data_file_lines
from openmm_dpd.lammps.files.table_file import read_eos
from openmm_dpd.lammps.run.runner import DeckRunner
from openmm_dpd.lammps.state.records import PressureControl
from openmm_dpd.model.edpd import EDPD
from openmm_dpd.model.eos import ConstantHeatCapacity, TabulatedEOS
from openmm_dpd.model.internal import BeadTemperatures, Concentrations, InternalEnergy
from openmm_dpd.model.mdpd import MDPD
from openmm_dpd.model.sources import Block, Sphere
from openmm_dpd.model.tdpd import TDPD

EV = 1e-2 / 1.0364269e-4  # kJ/mol per eV, from LAMMPS's own factor
KB = 8.617343e-5  # eV/K, LAMMPS's
BOX = "region b block -3 3 -3 3 -3 3 units box\ncreate_box 2 b\ncreate_atoms 1 random 30 5 b\ncreate_atoms 2 random 20 6 b\nmass * 1.0\n"
METAL = "units metal\natom_style dpd\n" + BOX.replace("-3 3", "-15 15") + "set group all dpd/theta 300\n"
EDPD_BOX = "atom_style edpd\n" + BOX
TDPD_BOX = "atom_style tdpd 2\n" + BOX
MDPD_BOX = "atom_style mdpd\n" + BOX
ENERGY = "pair_style dpd/fdt/energy 10.0 7\npair_coeff * * 0.075 0.022 3.2e-5\n"
HEAT = "pair_style edpd 1.5 7\npair_coeff * * 18.75 4.5 0.41 1.5 1e-5 2 1.5\n"
TRANSPORT = "pair_style tdpd 1.0 1.5 7\npair_coeff * * 18.75 4.5 0.41 1.5 1.4 1.0 1e-5 2 3.0 2e-5 2.5\n"
MANY = "pair_style hybrid/overlay mdpd/rhosum mdpd 1.0 1.0 7\npair_coeff * * mdpd/rhosum 0.7\npair_coeff * * mdpd -40 25 18 1.0 0.75\n"


def state_of(tmp_path, text: str):
    return read_deck(put(tmp_path / "in.deck", text), stop_before_first_run=True, output=tmp_path)


def scene_of(tmp_path, text: str):
    return state_of(tmp_path, text).first_run.scene()


# -- what beads carry --------------------------------------------------------------------------------------------------------------
def test_new_beads_and_set(tmp_path):
    text = "variable w equal 2*0.6\nset type 2 edpd/temp v_w\nset atom 1*3 edpd/cv 50\nset group all edpd/cv 2e4\n"
    state = state_of(tmp_path, EDPD_BOX + text)
    assert state.atoms.temperatures.tolist() == [1.0] * 30 + [1.2] * 20
    assert state.atoms.capacities.tolist() == [2e4] * 50
    state = state_of(tmp_path, TDPD_BOX + "set type 1 cc 2 -0.5\nset atom 1 cc 1 3\n")
    assert state.atoms.concentrations.shape == (50, 2)
    assert state.atoms.concentrations[[0, 1, 49]].tolist() == [[3, -0.5], [0, -0.5], [0, 0]]


def test_theta_from_a_variable_and_from_velocities(tmp_path):
    text = METAL + "variable a equal 310\nvariable b equal -1\nset type 1 dpd/theta v_a\nvelocity all set 1 0 0\nset type 2 dpd/theta v_b\n"
    thetas = state_of(tmp_path, text).atoms.thetas
    assert thetas[:30].tolist() == [310] * 30
    np.testing.assert_allclose(thetas[30:], 1.0364269e-4 / (3 * KB))  # m v^2 / (3 k_B) with 1 g/mol and 1 A/ps


@cases(
    "start, extra",
    (EDPD_BOX, "set type 1 edpd/temp 1.25\nset type 2 edpd/cv 300\n"),
    (TDPD_BOX, "set type 1 cc 1 0.1\nset atom 3 cc 2 -7\n"),
    (MDPD_BOX, ""),
    (METAL, "set type 2 dpd/theta 280.5\n"),
)
def test_written_files_read_back_the_same(tmp_path, start, extra):
    state = state_of(tmp_path, start + extra)
    state.atoms.densities[:] = np.arange(50) if state.atom_style == "mdpd" else 0.0
    (tmp_path / "data.out").write_text("\n".join(data_file_lines(state)) + "\n")
    again = state_of(tmp_path, start.partition("region")[0] + "read_data data.out")
    for name in ("thetas", "temperatures", "capacities", "concentrations", "densities"):
        assert np.array_equal(getattr(again.atoms, name), getattr(state.atoms, name)), name


def test_written_coefficients_read_back_the_same(tmp_path):
    coefficients = "pair_coeff 1 2 20 4 0.4 1.2 2e-5 3 1.2 power 1 2 3 4 kappa -0.5 0 0.25 1\n"
    state = state_of(tmp_path, EDPD_BOX + HEAT + coefficients + "fix 1 all mvv/edpd\n")
    (tmp_path / "data.out").write_text("\n".join(data_file_lines(state, pair="ij")) + "\n")
    again = state_of(tmp_path, "atom_style edpd\npair_style edpd 1.5 7\nread_data data.out\nfix 1 all mvv/edpd\n")
    ours, theirs = (s.first_run.scene().tables[0].resolve(["1", "2"]) for s in (state, again))
    assert ours == theirs and len({str(term) for term in ours.values()}) == 2


# -- pair terms --------------------------------------------------------------------------------------------------------------------
def test_energy_conserving_coefficients_in_metal_units(tmp_path):
    text = "pair_coeff 1 2 0.1 0.03 1e-5 9.5\nfix 1 all nve\nfix 2 all dpd/energy\nfix 3 all eos/cv 0.005\n"
    scene = scene_of(tmp_path, METAL + ENERGY + text)
    term, mixed = (scene.tables[0].entries[key] for key in (("1", "1"), ("1", "2")))
    assert EV == pytest.approx(96.485, rel=1e-4)
    assert (term.A, term.sigma, term.cutoff) == pytest.approx((0.075 * 10 * EV, 0.022 * 10 * EV, 1.0), rel=1e-12)
    assert term.kappa == pytest.approx(3.2e-5 * KB * EV**2, rel=1e-12) == pytest.approx(2.567e-5, rel=1e-3)
    assert (mixed.A, mixed.cutoff) == pytest.approx((EV, 0.95))
    assert isinstance(scene.internal, InternalEnergy)
    assert scene.internal.eos == dict.fromkeys("12", ConstantHeatCapacity(0.005 / KB))
    np.testing.assert_allclose(scene.internal.thetas, 300 * KB * EV, rtol=1e-12)
    # u = cv theta: 1.5 eV
    np.testing.assert_allclose(scene.internal.energies(scene.type_ids, ["1", "2"]), np.tile([0, 1.5 * EV], (50, 1)), rtol=1e-12)


def test_edpd_coefficients_keep_their_polynomials(tmp_path):
    lines = "pair_coeff 1 1 20 4 0.4 1.2 2e-5 3 1.2 kappa -0.5 0 0.25 1 power 1 2 3 4\npair_coeff 2 2 20 4 0.4 1.2 2e-5 3 1.2\n"
    scene = scene_of(tmp_path, EDPD_BOX + HEAT + lines + "fix 1 all mvv/edpd 0.7\nset type 2 edpd/cv 10\n")
    entries = scene.tables[0].entries
    expected = EDPD(A=20, gamma=4, kappa=2e-5, cutoff=1.2, exponent=0.4, exponent_T=3, cutoff_T=1.2)
    assert entries[("2", "2")] == expected
    assert (entries[("1", "1")].exponent_polynomial, entries[("1", "1")].kappa_polynomial) == ((1, 2, 3, 4), (-0.5, 0, 0.25, 1))
    assert isinstance(scene.internal, BeadTemperatures)
    assert scene.internal.capacities.tolist() == [1e5] * 30 + [10] * 20


def test_tdpd_coefficients(tmp_path):
    scene = scene_of(tmp_path, TDPD_BOX + TRANSPORT + "set type 1 cc 2 0.5\nfix 1 all mvv/tdpd\n")
    term = scene.tables[0].entries[("1", "2")]
    assert term == TDPD(18.75, 4.5, (1.0, 3.0), (1e-5, 2e-5), exponent=0.41, cutoff=1.5, cutoff_c=1.4, exponent_c=(2, 2.5))
    assert isinstance(scene.internal, Concentrations) and scene.internal.values.sum() == 15
    assert scene.kT == 1


def test_mdpd_and_rhosum_become_one_table(tmp_path):
    (table,) = scene_of(tmp_path, MDPD_BOX + MANY + "pair_coeff 1 2 mdpd/rhosum 0.6\nfix 1 all mvv/dpd\n").tables
    expected = {pair: MDPD(-40, 25, 18, 1.0, 0.75, 0.6 if pair == ("1", "2") else 0.7, kernel="lucy") for pair in table.entries}
    assert table.entries == expected and len(expected) == 3


# -- fixes -------------------------------------------------------------------------------------------------------------------------
SHARDLOW = "fix 1 all shardlow\nfix 2 all nve\nfix 3 all eos/cv 0.005\n"


@cases(
    "text, scheme, weight",
    (METAL + ENERGY + "fix 1 all nve\nfix 2 all dpd/energy\nfix 3 all eos/cv 0.005\n", "mvv", 0.5),
    (METAL + ENERGY + SHARDLOW, "shardlow", 0.5),
    (EDPD_BOX + HEAT + "fix 1 all mvv/edpd 0.7\n", "mvv", 0.7),
    (TDPD_BOX + TRANSPORT + "fix 1 all mvv/tdpd 0.6\n", "mvv", 0.6),
    (MDPD_BOX + MANY + "fix 1 all mvv/dpd\n", "mvv", 0.5),
    (MDPD_BOX + MANY + "fix 1 all nve\n", "mvv", 0.5),
    (MDPD_BOX + "set group all sph/rho 6\n" + MANY + "fix 1 all mvv/dpd\n", "mvv", 0.5),
)
def test_schemes(tmp_path, text, scheme, weight):
    request = state_of(tmp_path, text).first_run
    assert (request.scheme, request.lambda_, request.barostat) == (scheme, weight, None)
    assert request.mobile.all()


TABLE = "a table\n\nFIRST\nN 2\n\n1 10 0.01\n2 20 0.02\n\n# another\nSECOND\nN 3\n\n1 100 0.1\n2 300 0.4\n3 500 0.9\n"


def test_equations_of_state_by_type(tmp_path):
    (tmp_path / "eos").write_text(TABLE.partition("\n")[2])
    text = "group a type 1\ngroup b type 2\nfix 1 all shardlow\nfix 2 all nve\n"
    text += "fix 3 a eos/cv 0.005\nfix 4 b eos/table linear eos 100 SECOND\n"
    scene = scene_of(tmp_path, METAL + ENERGY + text)
    first, second = scene.internal.eos["1"], scene.internal.eos["2"]
    assert isinstance(first, ConstantHeatCapacity) and isinstance(second, TabulatedEOS)
    np.testing.assert_allclose(second.thetas, np.array([100, 300, 500]) * KB * EV)
    np.testing.assert_allclose(second.energies, np.array([0.1, 0.4, 0.9]) * EV)
    np.testing.assert_allclose(scene.internal.energies(scene.type_ids, ["1", "2"])[30:, 1], 0.4 * EV)


@cases(
    "text, keyword, message",
    (TABLE.partition("\n")[2], "THIRD", r"eos: there is no equation of state THIRD in it; found FIRST, SECOND"),
    ("A\nM 3\n1 1 1\n", "A", r"eos:2: expected 'N rows' with at least 2 rows after 'A', not 'M 3'"),
    ("A\nN 3\n1 1 1\n2 2 2\n", "A", r"eos:2: equation of state A announces 3 rows, but has 2"),
    ("A\nN 2\n1 1 1\n2 2 x\n", "A", r"eos:4: expected 'index T U', not '2 2 x'"),
    ("A\nN 2\n1 0 1\n2 2 2\n", "A", r"eos:3: the temperatures of equation of state A must be > 0"),
    ("A\nN 2\n1 1 1\n2 2 nan\n", "A", r"eos:4: a value of equation of state A is not finite"),
    ("A\nN 3\n1 1 1\n\n2 2 2\n3 2 3\n", "A", r"eos:6: the temperatures of equation of state A must increase, but 2 follows 2"),
    ("A\nN 3\n1 1 1\n2 2 0.5\n3 3 3\n", "A", r"eos:4: the energies of equation of state A must increase, but 0.5 follows 1"),
)
def test_files_of_equations_of_state(tmp_path, text, keyword, message):
    raises(DeckError, message, lambda: read_eos(put(tmp_path / "eos", text), keyword))


def test_sources(tmp_path):
    text = """region up block INF INF 0 INF -1 1 units box
region ball sphere 1 0 0 0.5 units box
group two type 2
fix 1 all mvv/tdpd
fix 2 all tdpd/source 1 region up 0.1
fix 3 two tdpd/source 2 region ball -0.2
fix 4 all tdpd/source 2 cuboid 1 0 0 2 4 6 0.3
fix 5 all tdpd/source 1 sphere 0 0 0 2 0.4
"""
    scene = scene_of(tmp_path, TDPD_BOX + TRANSPORT + text)
    up, ball, cuboid, sphere = scene.sources
    assert [(s.species, s.rate) for s in scene.sources] == [(0, 0.1), (1, -0.2), (1, 0.3), (0, 0.4)]
    assert isinstance(up.region, Block) and up.region.low.tolist() == [-np.inf, 0, -1] and up.region.high.tolist() == [np.inf, np.inf, 1]
    assert isinstance(ball.region, Sphere) and (ball.region.centre.tolist(), ball.region.radius) == ([1, 0, 0], 0.5)
    assert ball.beads is not None and ball.beads.sum() == 20 and up.beads is None
    assert (cuboid.region.low.tolist(), cuboid.region.high.tolist()) == ([0, -2, -3], [2, 2, 3])
    assert sphere.region.radius == 2
    assert all(np.array_equal(source.corner, [-3, -3, -3]) for source in scene.sources)
    notes = state_of(tmp_path, TDPD_BOX + TRANSPORT + text).notes
    assert any("radius of the sphere is 2; LAMMPS compares r^2 with R^3, so its radius is 2.82843" in note for note in notes)


def test_constant_pressure(tmp_path):
    bar = 0.1 * 0.602214  # kJ/mol/nm^3 of 1 bar = 1e5 Pa, over ten
    isothermal = "pair_style dpd/fdt 300 10.0 7\npair_coeff * * 0.075 0.022\nfix 1 all shardlow\n"
    found = state_of(tmp_path, METAL + isothermal + "fix 2 all nph iso 10 1000 500 drag 0.2\n").first_run
    assert found.scheme == "shardlow" and found.mobile.all()
    assert found.barostat.axes == (True, True, True) and found.barostat.coupled and found.barostat.isothermal
    assert found.barostat.start == pytest.approx([10 * bar] * 3, rel=1e-4)
    assert found.barostat.stop == pytest.approx([1000 * bar] * 3, rel=1e-4)
    assert any("Monte Carlo" in note for note in found.state.notes) and any("drag" in note for note in found.state.notes)
    text = METAL + ENERGY + SHARDLOW.replace("nve", "nph x 0 0 1 z 5 5 1")
    control = state_of(tmp_path, text).first_run.barostat
    assert control == PressureControl((True, False, True), False, control.start, control.stop, False, control.damps)
    assert control.start == pytest.approx((0, 0, 5 * bar), rel=1e-4) and control.constant
    assert not state_of(tmp_path, text.replace("x 0 0 1 z 5 5 1", "aniso 1 1 1")).first_run.barostat.coupled


def test_compat(tmp_path):
    request = state_of(tmp_path, EDPD_BOX + HEAT + "fix 1 all mvv/edpd\n").first_run
    assert request.scene().compat == "consistent"
    assert request.override(compat="lammps").scene().compat == "lammps"


# -- errors ------------------------------------------------------------------------------------------------------------------------
EOS = "fix 8 all eos/cv 0.005\n"
_ALONE = "pair_style mdpd 1 1 7\npair_coeff * * -40 25 18 1.0 0.75\n"
_PARTS = "group a id 1:10\ngroup c subtract all a\n" + SHARDLOW.replace("3 all", "3 a") + "fix 8 c eos/cv 0.006\n"
_TWO = "group a type 1\ngroup b type 2\nfix 1 a nph iso 0 0 1\nfix 2 b nph iso 0 0 1\nfix 3 all dpd/energy\n"
_NO_STYLE = "pair_style none\nfix 1 all dpd/energy\n"
ERRORS = [
    ("units real\natom_style edpd\n", r"in.deck:2: atom_style edpd needs units lj, but the deck's are real"),
    ("atom_style mdpd\nunits metal\n", r"in.deck:2: atom_style mdpd needs units lj"),
    ("atom_style tdpd\n", r"in.deck:1: expected 'atom_style tdpd N'"),
    ("atom_style tdpd 0\n", r"in.deck:1: the number of species must be at least 1"),
    (EDPD_BOX + "set group all edpd/temp 0\n", r"in.deck:7: edpd/temp must be > 0, but is 0"),
    (EDPD_BOX + "set group all edpd/cv -1\n", r"in.deck:7: edpd/cv must be > 0, but is -1"),
    (MDPD_BOX + "set group all edpd/cv 1\n", r"in.deck:7: set edpd/cv needs atom_style edpd, but the deck has atom_style mdpd"),
    (EDPD_BOX + "set group all sph/rho 1\n", r"in.deck:7: set sph/rho needs atom_style mdpd, but the deck has atom_style edpd"),
    (TDPD_BOX + "set group all cc 3 1\n", r"in.deck:7: set cc: there is no species 3; atom_style tdpd has 2"),
    (METAL + "set group all dpd/theta 0\n", r"in.deck:9: dpd/theta must be > 0"),
    (METAL + "set group all dpd/theta NULL\n", r"in.deck:9: set dpd/theta NULL .* bead 1 is at rest"),
    (METAL + "pair_style edpd 1 1\n", r"in.deck:9: pair style edpd needs atom_style edpd, but the deck has atom_style dpd"),
    (METAL + ENERGY.replace(" 3.2e-5", ""), r"in.deck:10: expected 'A sigma kappa \[cutoff\]'"),
    (METAL + ENERGY.replace("0.022", "-1"), r"in.deck:10: pair style dpd/fdt/energy, types \* \*: sigma"),
    (EDPD_BOX + HEAT.replace(" 2 1.5", ""), r"in.deck:8: expected 'A gamma power_f cutoff kappa power_T cutoff_T"),
    (EDPD_BOX + HEAT.strip() + " power 1 2\n", r"in.deck:8: option 'power' of pair_coeff of edpd needs 4 values, but 2 follow"),
    (TDPD_BOX + TRANSPORT.replace(" 2.5\n", "\n"), r"in.deck:8: expected 'A gamma .* epsilon_2 power_2', but found 10"),
    (MDPD_BOX + MANY.replace("1.0 0.75", "0.7 0.75"), r"in.deck:9: pair style mdpd, types \* \*: cutoff_B = 0.75 must not be longer"),
    (MDPD_BOX + MANY.replace("rhosum 0.7", "rhosum 1.2") + "fix 1 all nve\n", r"in.deck:9: .*cutoff_density = 1.2 must not be longer"),
    (MDPD_BOX + _ALONE, r"in.deck:7: pair style mdpd needs one mdpd/rhosum beside it"),
    (MDPD_BOX + "pair_style mdpd/rhosum\npair_coeff * * 0.7\n", r"in.deck:7: pair style mdpd/rhosum needs one mdpd beside it"),
    (MDPD_BOX + MANY.replace("* * mdpd/r", "1 1 mdpd/r"), r"in.deck:9: types 1 2 have no mdpd/rhosum coefficients"),
    (METAL + ENERGY + "fix 1 all nve\n" + EOS, r"in.deck:9: pair style dpd/fdt/energy needs fix dpd/energy .* or fix shardlow"),
    (METAL + ENERGY + SHARDLOW + "fix 4 all dpd/energy\n", r"in.deck:14: fix 4: dpd/energy and shardlow \(fix 1\)"),
    (METAL + _NO_STYLE, r"in.deck:10: fix 1: dpd/energy needs pair style dpd/fdt/energy; the deck has none"),
    (METAL + ENERGY + SHARDLOW.rpartition("fix")[0], r"in.deck:9: .* needs a fix eos/cv or eos/table for every bead; bead 1 has none"),
    (METAL + ENERGY + SHARDLOW + EOS, r"in.deck:14: fix 8: bead 1 already has an equation of state from fix 3"),
    (METAL + ENERGY + _PARTS, r"in.deck:16: fix 8: beads of type 1 have a different equation of state from fix 3"),
    (METAL.rpartition("set")[0] + ENERGY + SHARDLOW, r"in.deck:\d+: the internal temperature of bead 1 is 0; it must be > 0"),
    (METAL + "fix 1 all eos/cv 0\n", r"in.deck:9: the heat capacity must be > 0"),
    (METAL + "fix 1 all eos/table spline f 10 A\n", r"in.deck:9: the style of eos/table must be one of linear"),
    (METAL + "fix 1 all eos/table linear f 10 A\n", r"in.deck:9: there is no file 'f'"),
    (BOX + "fix 1 all eos/cv 1\n", r"in.deck:6: fix eos/cv needs atom_style dpd, but the deck has atom_style atomic"),
    (EDPD_BOX + HEAT + "fix 1 all nve\n", r"in.deck:9: fix 1: with pair style edpd, use fix mvv/edpd to move beads"),
    (TDPD_BOX + TRANSPORT + "fix 1 all mvv/dpd\n", r"in.deck:9: fix 1: with pair style tdpd, use fix mvv/tdpd to move beads"),
    (MDPD_BOX + MANY + "fix 1 all mvv/edpd\n", r"in.deck:10: fix 1: mvv/edpd needs pair style edpd; the deck has mdpd/rhosum, mdpd"),
    (EDPD_BOX + HEAT + "fix 1 all mvv/edpd 1.5\n", r"in.deck:9: lambda must be between 0 and 1"),
    (EDPD_BOX + "fix 1 all edpd/source cube 1\n", r"in.deck:7: the region of fix edpd/source must be one of sphere, cuboid, region"),
    (EDPD_BOX + "fix 1 all edpd/source sphere 0 0 0 1\n", r"in.deck:7: expected 'sphere cx cy cz R value', but found 4"),
    (EDPD_BOX + "fix 1 all edpd/source region b 1\nfix 2 all nve\n", r"in.deck:7: fix 1: edpd/source needs pair style edpd"),
    (EDPD_BOX + HEAT + "fix 1 all edpd/source sphere 9 0 0 1 1\nfix 2 all mvv/edpd\n", r"in.deck:9: fix 1: .* lies outside the box"),
    (TDPD_BOX + "fix 1 all edpd/source region b 1\n", r"in.deck:7: fix edpd/source needs atom_style edpd"),
    (TDPD_BOX + "fix 1 all tdpd/source 3 region b 1\n", r"in.deck:7: fix tdpd/source: there is no species 3; atom_style tdpd has 2"),
    (TDPD_BOX + "fix 1 all tdpd/source 0 region b 1\n", r"in.deck:7: the number of the species must be at least 1"),
    (TDPD_BOX + "region c cylinder x 0 0 1 0 1\nfix 1 all tdpd/source 1 region c 1\n", r"in.deck:8: .* region 'c' must be the inside of"),
    (METAL + "fix 1 all nph\n", r"in.deck:9: expected 'fix ID group nph .* but no pressure is given"),
    (METAL + "fix 1 all nph iso 0 0 0\n", r"in.deck:9: the damping time of the box must be > 0"),
    (METAL + "fix 1 all nph tri 0 0 1\n", r"in.deck:9: fix nph has no option 'tri' here"),
    (METAL + "fix 1 all nph x 0 0 1 y 1 1 1 couple xyz\n", r"in.deck:9: fix nph: coupled edges"),
    (METAL + ENERGY + _TWO + EOS, r"in.deck:14: fix 2: there already is a fix nph \(1\)"),
]


@pytest.mark.parametrize(("text", "message"), ERRORS, ids=[re.sub(r"[^a-z0-9 ]", "", message)[:60] for _, message in ERRORS])
def test_errors_name_file_and_line(tmp_path, text, message):
    raises(DeckError, message, lambda: scene_of(tmp_path, text))


# -- runs --------------------------------------------------------------------------------------------------------------------------
def run(tmp_path, text: str, **options):
    path = put(tmp_path / "in.run", text)
    runner = DeckRunner(RunOptions(platform="Reference", threads=1, **options))
    return read_deck(path, run_callback=runner.carry_out, output=tmp_path), runner


def test_pressures_that_change_are_refused_by_run_and_explain(tmp_path):
    text = METAL + ENERGY + SHARDLOW.replace("nve", "nph iso 0 10 1") + "run 1\n"
    for command in (lambda: run(tmp_path, text), lambda: explain_deck(put(tmp_path / "in.run", text))):
        raises(DeckError, r"in.run:\d+: fix nph or npt: volume moves need a constant pressure", command)


@pytest.mark.parametrize("fixes", [SHARDLOW, "fix 1 all nve\nfix 2 all dpd/energy\nfix 3 all eos/cv 0.005\n"])
def test_a_second_run_goes_on_with_the_energies(tmp_path, fixes):
    start = METAL + ENERGY + fixes + "velocity all create 600 7\nset type 2 dpd/theta 200\n"
    once, _ = run(tmp_path, start + "run 20\n")
    atoms = once.atoms
    assert atoms.u_cond.sum() == pytest.approx(0, abs=1e-9) and np.abs(atoms.u_cond).max() > 1e-3
    np.testing.assert_allclose(atoms.thetas * 0.005 * EV, atoms.u_cond + atoms.u_mech, rtol=1e-12)
    again, runner = run(tmp_path, start + "run 20\nrun 0\n")
    np.testing.assert_array_equal(again.atoms.u_cond, 0)  # everything is booked as mechanical energy then
    np.testing.assert_allclose(again.atoms.u_mech, atoms.u_cond + atoms.u_mech, rtol=1e-12)
    totals = [result.rows["etotal"][-1] for result in runner.results]
    assert totals[0] == pytest.approx(totals[1], rel=1e-9)
    inner = 0.005 * (30 * 300 + 20 * 200)
    first = runner.results[0].rows["etotal"][0] + inner
    last = totals[1] + again.atoms.u_mech.sum() / EV
    # the pair updates keep the energy exactly, forces of velocity Verlet as well as the step size allows
    assert last == pytest.approx(first, rel=1e-6 if fixes == SHARDLOW else 3e-3)


def test_temperatures_concentrations_and_densities_come_back(tmp_path):
    heated = HEAT + "fix 1 all mvv/edpd\nfix 2 all edpd/source cuboid 0 0 0 6 6 6 0.1\ntimestep 0.01\n"
    state, _ = run(tmp_path, EDPD_BOX + heated + "run 10\nrun 10\n")
    assert state.atoms.temperatures.mean() == pytest.approx(1 + 0.1 * 0.2, rel=2e-3)
    state, _ = run(tmp_path, TDPD_BOX + TRANSPORT + "set type 1 cc 1 1.0\nfix 1 all mvv/tdpd\ntimestep 0.01\nrun 10\nrun 10\n")
    found = state.atoms.concentrations
    assert found[:, 0].sum() == pytest.approx(30) and np.all(found[:, 1] == 0)
    assert found[:30, 0].mean() < 0.99
    state, _ = run(tmp_path, MDPD_BOX + MANY + "fix 1 all nve\ntimestep 0.01\nrun 1\n")
    x = state.atoms.positions
    gap = x[:, None] - x[None]
    r = np.linalg.norm(gap - 6 * np.round(gap / 6), axis=-1) / 0.7
    kernel = np.where(r < 1, 105 / (16 * np.pi * 0.7**3) * (1 + 3 * r) * (1 - np.minimum(r, 1)) ** 3, 0) * (1 - np.eye(50))
    np.testing.assert_allclose(state.atoms.densities, kernel.sum(axis=1), rtol=1e-9)


def test_a_deck_with_heat_or_species_runs_words(tmp_path):
    """In two runs, with its source; LAMMPS's heat is refused at the run command."""
    heated = EDPD_BOX + HEAT + "fix 1 all mvv/edpd\nfix 2 all edpd/source cuboid 0 0 0 6 6 6 0.1\ntimestep 0.01\n"
    state, _ = run(tmp_path, heated + "run 10\nrun 10\n", scheme="bababo")
    assert state.atoms.temperatures.mean() == pytest.approx(1 + 0.1 * 0.2, rel=1e-4)
    raises(DeckError, "in.run:12: .*keeps the energy of a pair", run, tmp_path, heated + "run 1\n", scheme="middle", compat="lammps")
    text = TDPD_BOX + TRANSPORT + "set type 1 cc 1 1.0\nfix 1 all mvv/tdpd\ntimestep 0.04\nrun 10\nrun 10\n"
    found = run(tmp_path, text, scheme="middle")[0].atoms.concentrations
    assert found[:, 0].sum() == pytest.approx(30, rel=1e-13) and found[:, 0].min() >= 0 and found[:30, 0].mean() < 0.99


def test_heat_between_two_beads_in_metal_units(tmp_path):
    """kappa (1/theta_i - 1/theta_j) w^2 in eV/ps, with w = 1/2."""
    box = "units metal\natom_style dpd\nregion b block 0 30 0 30 0 30 units box\ncreate_box 1 b\n"
    beads = "create_atoms 1 single 1 1 1\ncreate_atoms 1 single 1 6 1\nmass * 1.0\nset atom 1 dpd/theta 300\nset atom 2 dpd/theta 200\n"
    path = put(tmp_path / "in.two", box + beads + ENERGY + SHARDLOW + "run 0\n")
    heat = deck_forces(path, RunOptions(platform="Reference", threads=1))["rates_dissipative"][:, 0]
    expected = 3.2e-5 * (1 / 300 - 1 / 200) * 0.25
    np.testing.assert_allclose(heat, [expected, -expected], rtol=1e-12)


def test_a_deck_that_runs_consistently_says_so(tmp_path):
    text = EDPD_BOX + HEAT + "fix 1 all mvv/edpd\nrun 0\n"
    assert any("--compat lammps" in note for note in run(tmp_path, text)[0].notes)
    assert not any("compat" in note for note in run(tmp_path, text, compat="lammps")[0].notes)
