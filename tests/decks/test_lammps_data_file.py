"""Data files: reading, wrapping, coefficients, writing and reading back; pair table files."""

import bz2
import gzip
import importlib.util
from dataclasses import replace

import numpy as np
import pytest
from cases import cases, put, raises
from scipy.interpolate import CubicSpline

from openmm_dpd import NONE
from openmm_dpd.base.errors import DeckError, ParameterError
from openmm_dpd.inputs import scene_from_lammps_data
from openmm_dpd.lammps import read_deck
from openmm_dpd.lammps.files.data_file import ATOM_STYLES, read_data_file
from openmm_dpd.lammps.files.table_file import read_table, tabulated_pair
from openmm_dpd.lammps.state.box import Box
from openmm_dpd.units import LJ, REAL

HEADER = "a title that could be anything: 5 atoms\n\n3 atoms\n2 atom types\n\n-1 3 xlo xhi\n0.0 5e0 ylo yhi\n2 6 zlo zhi\n"

ATOMS = {
    "atomic": ["7 2 0 1 3", "2 1 1 2 4", "5 1 2 3 5"],
    "charge": ["7 2 -0.5 0 1 3", "2 1 0.5 1 2 4", "5 1 0 2 3 5"],
    "bond": ["7 9 2 0 1 3", "2 8 1 1 2 4", "5 8 1 2 3 5"],
    "angle": ["7 9 2 0 1 3", "2 8 1 1 2 4", "5 8 1 2 3 5"],
    "molecular": ["7 9 2 0 1 3", "2 8 1 1 2 4", "5 8 1 2 3 5"],
    "full": ["7 9 2 -0.5 0 1 3", "2 8 1 0.5 1 2 4", "5 8 1 0 2 3 5"],
    "dpd": ["7 2 310 0 1 3", "2 1 300 1 2 4", "5 1 290 2 3 5"],
    "mdpd": ["7 2 3.1 0 1 3", "2 1 3.0 1 2 4", "5 1 2.9 2 3 5"],
    "edpd": ["7 2 1.0 1e5 0 1 3", "2 1 1.1 2e5 1 2 4", "5 1 1.2 1e5 2 3 5"],
    "sphere": ["7 2 0.5 4.0 0 1 3", "2 1 1.0 2.0 1 2 4", "5 1 0 1.5 2 3 5"],
    "tdpd": ["7 2 0 1 3 0.5 2.5", "2 1 1 2 4 0.1 -2", "5 1 2 3 5 0.2 3e2"],
}


def write(folder, text: str):
    return put(folder / "data", text)


def deck(folder, text: str, **options):
    return read_deck(put(folder / "in.deck", text), stop_before_first_run=True, output=folder, **options)


@pytest.mark.parametrize("style", ATOM_STYLES)
@pytest.mark.parametrize("hint", [True, False])
def test_every_atom_style_with_and_without_a_hint(tmp_path, style, hint):
    section = f"Atoms # {style}" if hint else "Atoms"
    write(tmp_path, HEADER + f"\n{section}\n\n" + "\n".join(ATOMS[style]) + "\n")
    atoms = deck(tmp_path, f"atom_style {style}{' 2' if style == 'tdpd' else ''}\nread_data data").atoms
    assert atoms.ids.tolist() == [2, 5, 7]
    assert atoms.types.tolist() == [1, 1, 2]
    np.testing.assert_allclose(atoms.positions, [[1, 2, 4], [2, 3, 5], [0, 1, 3]])
    assert atoms.molecules.tolist() == ([8, 8, 9] if style in ("bond", "angle", "molecular", "full") else [0, 0, 0])
    assert atoms.charges.tolist() == ([0.5, 0, -0.5] if style in ("charge", "full") else [0, 0, 0])
    assert atoms.thetas.tolist() == ([300, 290, 310] if style == "dpd" else [0, 0, 0])
    assert atoms.densities.tolist() == ([3.0, 2.9, 3.1] if style == "mdpd" else [0, 0, 0])
    assert atoms.temperatures.tolist() == ([1.1, 1.2, 1.0] if style == "edpd" else [1, 1, 1])
    assert atoms.capacities.tolist() == ([2e5, 1e5, 1e5] if style == "edpd" else [1e5] * 3)
    assert (atoms.diameters.tolist(), atoms.solids.tolist()) == (([1, 0, 0.5], [2, 1.5, 4]) if style == "sphere" else ([1] * 3,) * 2)
    assert atoms.concentrations.tolist() == ([[0.1, -2], [0.2, 300], [0.5, 2.5]] if style == "tdpd" else [[], [], []])


def test_spheres_that_turn_are_refused(tmp_path):
    rows = "\n\nVelocities\n\n7 1 0 0 0 0 0\n2 0 2 0 0 0 0\n5 0 0 3 0 0 0.1\n"
    write(tmp_path, HEADER + "\nAtoms\n\n" + "\n".join(ATOMS["sphere"]) + rows)
    with pytest.raises(DeckError, match="atom 5 turns, which beads of atom_style sphere do not do here; set wx wy wz to 0"):
        deck(tmp_path, "atom_style sphere\nread_data data")
    write(tmp_path, HEADER + "\nAtoms\n\n" + "\n".join(ATOMS["sphere"]) + rows.replace("0.1", "0"))
    bodies = "pair_style dpd 1 1 7\npair_coeff * * 25 4.5\nfix r all rigid single\nrun 0"
    with pytest.raises(DeckError, match="beads of atom_style sphere would turn with their bodies"):
        deck(tmp_path, "atom_style sphere\nread_data data\n" + bodies).first_run.scene()


def test_units_are_converted(tmp_path):
    masses, velocities = "\nMasses\n\n1 18\n2 3 # comment\n", "\n\nVelocities\n\n7 1 0 0\n2 0 2 0\n5 0 0 3\n"
    write(tmp_path, HEADER + masses + "\nAtoms\n\n" + "\n".join(ATOMS["atomic"]) + velocities)
    state = deck(tmp_path, "units real\nread_data data")
    assert state.box.edges.tolist() == [4, 5, 4] and state.atoms.positions[0].tolist() == [1, 2, 4]
    scene = state.first_run.scene()
    np.testing.assert_allclose(np.diag(scene.box), [0.4, 0.5, 0.4])
    np.testing.assert_allclose(scene.positions[0], [0.1, 0.2, 0.4])
    np.testing.assert_allclose(scene.velocities, 100 * np.array([[0, 2, 0], [0, 0, 3], [1, 0, 0]]))
    assert state.masses == {1: 18.0, 2: 3.0}


def test_beads_outside_are_wrapped_and_their_flags_kept(tmp_path):
    write(tmp_path, HEADER + "\nAtoms\n\n1 1 -1 5 2 0 0 0\n2 1 3.5 1 -7 1 -2 3\n3 2 2.9 -0.1 30 0 0 0\n")
    state = deck(tmp_path, "read_data data")
    np.testing.assert_allclose(state.atoms.positions, [[-1, 0, 2], [-0.5, 1, 5], [2.9, 4.9, 2]])
    assert state.atoms.images.tolist() == [[0, 1, 0], [2, -2, 0], [0, -1, 7]]


def test_wrapping_in_a_tilted_box():
    box = Box(np.array([-1.0, 2.0, 0.0]), np.array([4.0, 6.0, 6.0]), np.array([1.5, -2.0, 1.0]), True)
    rng = np.random.default_rng(1)
    inside = rng.random((200, 3)) @ box.vectors + box.low
    flags = rng.integers(-4, 5, (200, 3))
    wrapped, shifts = box.wrap(inside + flags @ box.vectors)
    np.testing.assert_allclose(wrapped, inside, atol=1e-12)
    assert np.array_equal(shifts, flags)
    np.testing.assert_allclose(box.unwrap(wrapped, shifts), inside + flags @ box.vectors, atol=1e-12)


@pytest.mark.parametrize("far", [1e300, np.nan])
def test_positions_that_no_image_flag_can_hold_are_an_error(far):
    box = Box(np.zeros(3), np.ones(3), np.zeros(3), False)
    with pytest.raises(ParameterError, match=r"1 of 2 positions are not finite, or more than 2\^31 boxes away"):
        box.wrap(np.array([[0.5, 0.5, 0.5], [0.5, far, 0.5]]))


def test_a_bead_just_below_a_face_does_not_end_up_outside():
    box = Box(np.zeros(3), np.ones(3), np.zeros(3))
    wrapped, shifts = box.wrap(np.array([[-1e-18, 0.5, 0.5]]))
    assert 0 <= wrapped[0, 0] < 1
    np.testing.assert_allclose(box.unwrap(wrapped, shifts), [[0, 0.5, 0.5]], atol=1e-15)


@pytest.mark.parametrize("tilt", [[3.0, 0, 0], [0, 2.6, 0], [2.4, -3.7, 5.2]])
def test_reduced_vectors_span_the_same_lattice(tilt):
    box = Box(np.zeros(3), np.array([5.0, 4.0, 6.0]), np.array(tilt), True)
    reduced = box.reduced_vectors
    change = reduced @ np.linalg.inv(box.vectors)
    np.testing.assert_allclose(change, np.round(change), atol=1e-12)
    assert np.linalg.det(reduced) == pytest.approx(box.volume)
    assert abs(reduced[1, 0]) <= 2.5 + 1e-12 and abs(reduced[2, 0]) <= 2.5 + 1e-12 and abs(reduced[2, 1]) <= 2 + 1e-12


def test_coefficients_and_bonds_from_the_file(tmp_path):
    head = HEADER.replace("2 atom types", "2 atom types\n2 bonds\n1 bond types\n1 extra bond per atom")
    pairs = "\nPairIJ Coeffs # dpd\n\n1 1 25 4.5 1.0\n1 2 30 4.5 0.9\n2 2 20 9 1.1\n\nBond Coeffs\n\n1 50 0.8\n\nMasses\n\n1 1\n2 1\n"
    write(tmp_path, head + pairs + "\nAtoms\n\n" + "\n".join(ATOMS["bond"]) + "\n\nBonds\n\n1 1 7 2\n2 1 2 5\n")
    styles = "atom_style bond\nbond_style harmonic\npair_style dpd 1 1 1\n"
    scene = deck(tmp_path, styles + "read_data data\nspecial_bonds lj 0.5 1 1\nfix 1 all nve").first_run.scene()
    entries = scene.pairs[0].resolve(["1", "2"])
    expected = {("1", "1"): (25, 4.5, 1.0), ("1", "2"): (30, 4.5, 0.9), ("2", "2"): (20, 9, 1.1)}
    assert {key: (term.A, term.gamma, term.cutoff) for key, term in entries.items()} == expected
    (bonds,) = scene.bonds
    assert bonds.pairs.tolist() == [[2, 0], [0, 1]]  # indices in the order of the ids
    assert bonds.k.tolist() == [50, 50] and bonds.r0.tolist() == [0.8, 0.8]
    assert scene.bonded_factors == (0.5, 1, 1)


def test_nocoeff_leaves_coefficients_out(tmp_path):
    write(tmp_path, HEADER + "\nPair Coeffs\n\n1 25 4.5\n2 25 4.5\n\nAtoms\n\n" + "\n".join(ATOMS["atomic"]) + "\n")
    state = deck(tmp_path, "pair_style dpd 1 1 1\nread_data data nocoeff extra/atom/types 1")
    assert not state.pair.styles[0].coefficients
    assert state.n_types == 3


@pytest.mark.parametrize(("units", "style"), [("lj", "bond"), ("real", "full"), ("metal", "dpd")])
@pytest.mark.parametrize("tilted", [False, True])
def test_written_files_read_back_the_same(tmp_path, units, style, tilted):
    rng = np.random.default_rng(3)
    box = "prism -1 9 0 8 2 11 1.3 -0.7 2.1" if tilted else "block -1 9 0 8 2 11"
    extra = "set group all dpd/theta 300\n" if style == "dpd" else "set atom 3 mol 4\n"
    state = deck(
        tmp_path,
        f"""units {units}
atom_style {style}
region b {box} units box
create_box 2 b{"" if style == "dpd" else " bond/types 1"}
create_atoms 1 random 20 5 NULL
create_atoms 2 random 10 6 NULL
mass 1 1.5
mass 2 18.0154
{extra}pair_style dpd 1.0 3.0 4
pair_coeff * * 25 4.5
pair_coeff 1 2 30 4.5 2.5
velocity all create 1.0 7
set atom 2 image 1 -2 3
fix 1 all nve
""",
    )
    if style != "dpd":
        state.bonds = np.array([[1, 1, 2], [1, 4, 3]])
        state.atoms.charges[:] = rng.choice([-1.0, 1.0], 30) if style == "full" else 0.0
    from openmm_dpd.lammps.commands.output import data_file_lines

    (tmp_path / "data.out").write_text("\n".join(data_file_lines(state, pair="ij")) + "\n")
    again = deck(tmp_path, f"units {units}\natom_style {style}\npair_style dpd 1.0 3.0 4\nread_data data.out\nfix 1 all nve")
    for name in ("ids", "types", "images", "charges", "molecules", "thetas"):
        assert np.array_equal(getattr(again.atoms, name), getattr(state.atoms, name)), name
    np.testing.assert_allclose(again.atoms.positions, state.atoms.positions, rtol=0, atol=1e-14)
    np.testing.assert_allclose(again.atoms.velocities, state.atoms.velocities, rtol=1e-14)
    np.testing.assert_allclose(again.box.vectors, state.box.vectors, rtol=1e-14)
    assert again.box.triclinic == tilted
    assert np.array_equal(again.bonds, state.bonds)
    assert again.masses == pytest.approx(state.masses)
    ours, theirs = (s.first_run.scene().pairs[0].resolve(["1", "2"]) for s in (state, again))
    assert ours.keys() == theirs.keys()
    for key, term in ours.items():
        assert (term.A, term.gamma, term.cutoff) == pytest.approx((theirs[key].A, theirs[key].gamma, theirs[key].cutoff))


GIVEN = {"pairs": {("*", "*"): NONE}, "kT": 1.0, "atom_style": "atomic"}
GOOD = HEADER + "\nMasses\n\n1 1.0\n2 2.0\n\nAtoms\n\n" + "\n".join(ATOMS["atomic"]) + "\n"


@cases(
    "old, new, message",
    ("2 1 1 2 4", "2 1 1 nan 4", r"data:18: a value of atom 2 is not finite: '2 1 1 nan 4'"),
    ("2 1 1 2 4", "2 1 1 inf 4", r"data:18: a value of atom 2 is not finite"),
    ("2 1 1 2 4", "2 1 1 2", r"data:18: expected an atom of atom_style atomic: id type x y z \[ix iy iz\], not '2 1 1 2'"),
    ("2 1 1 2 4", "2 3 1 2 4", r"data:18: the atom type is out of range; there are 2"),
    ("2 1 1 2 4", "7 1 1 2 4", r"data:18: atom id 7 appears twice"),
    ("2 1 1 2 4", "2.5 1 1 2 4", r"data:18: the id of an atom must be a whole number, not 2.5"),
    ("2 1 1 2 4", "0 1 1 2 4", r"data:18: atom ids start at 1"),
    ("2 1 1 2 4", "2 1 1 x 4", r"data:18: expected an atom"),
    ("2 1 1 2 4", "2 1 1 2 4 0 0 0.5", r"data:18: expected three image flags"),
    ("2 1 1 2 4", "99999999999999999999 1 1 2 4", r"data:18: the id of an atom must be a whole number up to 2147483647, not 1e\+20"),
    ("2 1 1 2 4", "2 1 1 2 4 0 0 99999999999999999999", r"data:18: an image flag of atom 2 is beyond 2147483647"),
    ("3 atoms", "3.5 atoms", r"data:3: expected a whole number >= 0 before 'atoms', not '3.5'"),
    ("3 atoms", "3 atoms\n5 impropers", r"data: the header announces 5 impropers, but there is no Impropers section"),
    ("3 atoms", "4 atoms", r"data:15: section Atoms has 3 lines, but the header announces 4"),
    ("Masses", "Whiskers", r"data:10: section or header line 'Whiskers' is not supported"),
    ("2 atom types", "2 atom kinds", r"data:4: header line '2 atom kinds' is not supported"),
    ("-1 3 xlo", "3 -1 xlo", r"the box must have a positive length along x, not -4"),
    ("-1 3 xlo xhi\n", "", r"the header has no line 'xlo xhi'"),
    ("-1 3 xlo", "-1 x xlo", r"data:6: expected numbers before 'xlo xhi'"),
    ("1 1.0", "1 -1.0", r"data:12: the mass of type 1 must be > 0, but is -1"),
    ("1 1.0", "3 1.0", r"data:12: atom type 3 is out of range; there are 2"),
    ("Masses", "Velocities", r"data:10: section Velocities has 2 lines, but the header announces 3"),
)
def test_errors_name_file_and_line(tmp_path, old, new, message):
    assert old in GOOD
    path = write(tmp_path, GOOD.replace(old, new, 1))
    raises(DeckError, message, lambda: read_data_file(path, "atomic"))


def test_the_good_file_is_good_packed_or_not(tmp_path):
    content = gzip.compress(GOOD.encode())
    (tmp_path / "data.gz").write_bytes(content)
    (tmp_path / "data.bz2").write_bytes(bz2.compress(GOOD.encode()))
    for path in (write(tmp_path, GOOD), tmp_path / "data.gz", tmp_path / "data.bz2"):
        assert read_data_file(path, "atomic").masses == {1: 1.0, 2: 2.0} and len(scene_from_lammps_data(path, **GIVEN).types) == 3
    (tmp_path / "data.gz").write_bytes(content[:-20])
    raises(DeckError, "data.gz: cannot read the file: .*ended", lambda: deck(tmp_path, "read_data data.gz"))
    (tmp_path / "data.lz4").write_bytes(content)
    if importlib.util.find_spec("lz4") is None:
        raises(DeckError, "data.lz4: files .lz4 need the Python package lz4", lambda: deck(tmp_path, "read_data data.lz4"))
    (tmp_path / "data.xz").write_bytes(content)
    raises(DeckError, "data.xz: cannot read the file", lambda: scene_from_lammps_data(tmp_path / "data.xz", **GIVEN))


def test_bonds_need_a_style_that_has_them(tmp_path):
    path = write(tmp_path, GOOD.replace("2 atom types", "2 atom types\n1 bonds\n1 bond types") + "\nBonds\n\n1 1 2 5\n")
    raises(DeckError, r"data:23: atom_style atomic has no bonds", lambda: read_data_file(path, "atomic"))


@cases("style, old, new, message", ("dpd", "300", "0", r"internal temperature \(theta\)"))
def test_what_beads_have_is_in_bounds(tmp_path, style, old, new, message):
    text = HEADER + "\nAtoms\n\n" + "\n".join(ATOMS[style]).replace(old, new) + "\n"
    raises(DeckError, f"data:13: .*{message} must be >", lambda: read_data_file(write(tmp_path, text), style))


def test_a_different_style_hint_is_noted(tmp_path):
    write(tmp_path, GOOD.replace("Atoms", "Atoms # charge"))
    assert any("is marked 'charge'" in note for note in deck(tmp_path, "read_data data").notes)


def energy(r):
    return 3 * np.exp(-r * r) - np.exp(-2 * (r - 1.5) ** 2)


def force(r):
    return 6 * r * np.exp(-r * r) - 4 * (r - 1.5) * np.exp(-2 * (r - 1.5) ** 2)


def section(keyword: str, parameters: str, r: np.ndarray, column: np.ndarray | None = None, noise: float = 0.0) -> str:
    column = r if column is None else column
    wiggle = noise * np.cos(7.3 * np.arange(len(r)))
    rows = [f"{k + 1} {column[k]:.10g} {energy(r[k]):.14g} {force(r[k]) + wiggle[k]:.14g}" for k in range(len(r))]
    return "\n".join([f"# {keyword}", "", keyword, parameters, "", *rows, ""])


@pytest.fixture
def table(tmp_path):
    even = np.linspace(0.1, 3.0, 201)
    square = np.sqrt(np.linspace(0.1**2, 3.0**2, 400))
    path = tmp_path / "table"
    path.write_text(
        section("FIRST", "N 5 R 1 2", np.linspace(1, 2, 5))
        + section("EVEN", "N 201 R 0.1 3.0 FPRIME 0 0", even, column=np.round(even, 2))  # R overrides the rounded column
        + section("COLUMN", "N 201", even)
        + section("BARE", "N 201 R", even)
        + section("SQUARE", "N 400 RSQ 0.1 3.0", square, column=np.zeros(400))
        + section("NOISY", "N 201 R 0.1 3.0", even, noise=1.0)
        + section("BITS", "N 201 BITMAP 0.1 3.0", even)
        + section("SHORT", "N 20 R 1 2", np.linspace(1, 2, 10))
    )
    return path


@pytest.mark.parametrize("keyword", ["EVEN", "COLUMN", "BARE", "SQUARE"])
def test_every_form_gives_the_same_potential(table, keyword):
    pair, remark = tabulated_pair(read_table(table, keyword), None, LJ)
    assert remark is None if keyword != "EVEN" else "FPRIME has no effect" in remark
    assert pair.cutoff == pytest.approx(3.0)
    r = np.linspace(0.3, 2.9, 77)
    spline = CubicSpline(pair.distances, pair.energies)
    np.testing.assert_allclose(spline(r), energy(r), atol=2e-5)
    np.testing.assert_allclose(-spline(r, 1), force(r), atol=1e-3)


@pytest.mark.parametrize("slopes", ["", " FPRIME {:.12g} {:.12g}"])
def test_few_uneven_rows(tmp_path, slopes):
    """A spline goes through forces too: between 40 points they are right to 1e-3, near the ends where their slopes are given."""
    r, h = np.sqrt(np.linspace(0.5**2, 3.0**2, 40)), 1e-6
    ends = [(force(end + h) - force(end - h)) / (2 * h) for end in (r[0], r[-1])]
    path = put(tmp_path / "few", section("FEW", f"N 40{slopes.format(*ends)}", r))
    pair, remark = tabulated_pair(read_table(path, "FEW"), None, LJ)
    inner = pair.distances > (0.0 if slopes else 1.0)
    assert remark is None and len(pair.distances) > 60
    np.testing.assert_allclose(pair.forces[inner], force(pair.distances[inner]), atol=1e-3)


def test_units_and_cutoff(table):
    pair, _ = tabulated_pair(read_table(table, "EVEN"), 2.0, REAL)
    assert pair.cutoff == pytest.approx(0.2)
    assert pair.distances[0] == pytest.approx(0.01)
    assert pair.energies[0] == pytest.approx(energy(0.1) * 4.184, rel=1e-6)
    assert pair.forces[0] == pytest.approx(force(0.1) * 41.84, rel=1e-6)


def test_forces_that_are_not_the_slope_define_the_potential(table):
    """LAMMPS moves the beads by the forces of the file, not by its energies."""
    even = read_table(table, "EVEN")
    data = replace(even, forces=1.5 * even.forces)
    pair, remark = tabulated_pair(data, None, LJ)
    assert "energies are replaced" in remark
    np.testing.assert_allclose(pair.forces, data.forces)
    inner = slice(2, -2)
    np.testing.assert_allclose(-np.gradient(pair.energies, pair.distances)[inner], data.forces[inner], atol=0.05 * np.ptp(data.forces))


def test_forces_with_kinks_are_kept(table):
    """Coarse-grained tables have forces that jump about the slope of the energies; their integral is what counts."""
    pair, remark = tabulated_pair(read_table(table, "NOISY"), None, LJ)
    assert remark is None
    np.testing.assert_allclose(pair.forces, read_table(table, "NOISY").forces)


@cases(
    "keyword, message",
    ("NONE", r"there is no table NONE in it; found FIRST, EVEN, COLUMN, BARE, SQUARE, NOISY, BITS, SHORT"),
    ("BITS", r"table BITS is stored as BITMAP, which is not supported"),
)
def test_missing_and_unsupported(table, keyword, message):
    raises(DeckError, message, lambda: read_table(table, keyword))


def test_rows_that_are_missing_or_not_numbers(tmp_path):
    path = put(tmp_path / "table", "A\nN 3 R 1 2\n\n1 1 0 0\n2 1.5 x 0\n3 2 0 0\n")
    raises(DeckError, r"table:5: expected 'index r energy force'", lambda: read_table(path, "A"))
    raises(DeckError, r"table A announces 3 rows, but has 2", lambda: read_table(put(path, "A\nN 3 R 1 2\n\n1 1 0 0\n2 1.5 0 0\n"), "A"))
    path.write_text("A\nN 3\n\n1 1 0 0\n2 1.5 0 0\n3 1.2 0 0\n")
    raises(DeckError, r"table:5: the distances of table A must be > 0 and increase", lambda: read_table(path, "A"))
    raises(DeckError, r"table:2: expected the parameters 'N points", lambda: read_table(put(path, "A\nM 3\n\n1 1 0 0\n"), "A"))


def test_a_cutoff_beyond_the_table(table):
    raises(ValueError, "lies beyond the table", lambda: tabulated_pair(read_table(table, "EVEN"), 3.5, LJ))
