"""From what people have to a Scene: topologies, PSF, data files, frames of mdtraj; what is missing is named."""

import mdtraj
import numpy as np
import openmm
import pytest
from cases import cases, raises
from openmm import app, unit
from random_scenes import MASSES, PAIRS, SEEDS, TILTED, check, psf_of, random_scene, tables, terms

import openmm_dpd as dpd
from openmm_dpd.inputs import BeadArrays, scene_from_beads, scene_from_lammps_data, scene_from_mdtraj, scene_from_psf, scene_from_topology
from openmm_dpd.lammps import export_lammps
from openmm_dpd.molecules import CosineBend, FENESpring, Spring, Twist
from openmm_dpd.outputs import write_pdb
from openmm_dpd.trajectory import load_topology, openmm_topology


# -- and back --------------------------------------------------------------------------------------------------------------------
@pytest.mark.parametrize("seed", SEEDS)
def test_topology_and_back(seed):
    """Masses, velocities and charges are not in a Topology."""
    scene = random_scene(seed)
    built = dpd.build(scene, dt=0.01, platform="Reference", seed=1)
    given = {"masses": MASSES, "velocities": built.velocities, "charges": scene.charges}
    found = scene_from_topology(built.topology, built.positions, pairs=PAIRS, kT=1.0, **given, **tables(scene))
    check(found, scene, atol=1e-15, velocities=True)
    assert found.residues == scene.residues and np.array_equal(found.charges, scene.charges) and dict(found.masses) == dict(scene.masses)


@pytest.mark.parametrize("seed", SEEDS)
@pytest.mark.parametrize("kind", ["array", "pdb", "dcd", "xtc"])
def test_psf_and_back(tmp_path, seed, kind):
    scene = random_scene(seed)
    psf_of(scene, tmp_path / "top.psf")
    trajectory = mdtraj.Trajectory([np.zeros((scene.n_beads, 3)), scene.positions], load_topology(tmp_path / "top.psf"))
    trajectory.unitcell_vectors = np.array([scene.box] * 2)
    positions, more = scene.positions * 10 * unit.angstrom, {"box": scene.box}
    if kind == "pdb":
        write_pdb(tmp_path / "x.pdb", scene)
    elif kind != "array":
        trajectory.save(tmp_path / f"x.{kind}")
    if kind != "array":
        positions, more = tmp_path / f"x.{kind}", {}
    found = scene_from_psf(tmp_path / "top.psf", positions, pairs=PAIRS, kT=1.0, **more, **tables(scene))
    # float32 angstrom, 0.001 angstrom, 0.001 nm; angles of 0.01 degrees in a PDB file
    atol = {"array": 1e-14, "pdb": 6e-5, "dcd": 5e-6, "xtc": 6e-4}[kind]
    check(found, scene, atol=atol, box_atol={"array": 1e-12, "pdb": 2e-3}.get(kind, 1e-5))
    assert np.array_equal(found.charges, scene.charges) and found.residues == scene.residues
    if kind == "dcd":
        bare = {"pairs": PAIRS, "kT": 1.0, "leave_out": ("bonds", "angles", "dihedrals")}
        assert not scene_from_psf(tmp_path / "top.psf", positions, frame=0, **bare).positions.any()


@pytest.mark.parametrize("seed", SEEDS)
def test_mdtraj_and_back(tmp_path, seed):
    """The topology of a PSF file has masses and charges, that of a PDB file has names and bonds."""
    scene = random_scene(seed)
    psf_of(scene, tmp_path / "top.psf")
    write_pdb(tmp_path / "x.pdb", scene)
    trajectory = mdtraj.Trajectory(scene.positions[None], load_topology(tmp_path / "top.psf"))
    trajectory.unitcell_vectors = scene.box[None]
    found = scene_from_mdtraj(trajectory, pairs=PAIRS, kT=1.0, **tables(scene))
    check(found, scene, atol=2e-6, box_atol=2e-6)
    assert np.array_equal(found.charges, scene.charges) and found.residues == scene.residues
    found = scene_from_mdtraj(mdtraj.load(tmp_path / "x.pdb"), pairs=PAIRS, kT=1.0, masses=MASSES, **tables(scene))
    check(found, scene, atol=6e-5, box_atol=2e-3)


@pytest.mark.parametrize("units", ["lj", "real"])
@pytest.mark.parametrize("seed", SEEDS[:3])
def test_data_file_and_back(tmp_path, seed, units):
    """As the package exports it: the data file alone, with springs by type numbers of bonds as the deck has them."""
    scene = random_scene(seed)
    done = export_lammps(scene, tmp_path, "made", dt=0.01, units=units)
    names = dict(enumerate(scene.type_names, start=1))
    joined = {what: list(getattr(scene, what)) for what in ("bonds", "angles", "dihedrals")}
    found = scene_from_lammps_data(done.data, names, pairs=PAIRS, kT=1.0, units=units, **joined)
    check(found, scene, atol=1e-9, velocities=True, box_atol=1e-9)
    assert list(found.masses) == scene.type_names
    for what, groups in joined.items():
        if groups:
            count = sum(len(group.beads) for group in groups)
            with pytest.raises(dpd.ParameterError, match=f"has {count} {what}, the first one between types .*, but no {what} are given"):
                scene_from_lammps_data(done.data, names, pairs=PAIRS, kT=1.0, units=units, **joined | {what: None})


@pytest.mark.parametrize("seed", SEEDS)
def test_springs_bends_and_twists_are_those_of_the_tables(seed):
    """Bond by bond: later entries before earlier ones, types in either order; an angle wherever a chain goes on, and a dihedral."""
    scene = random_scene(seed)
    kinds = {("A", "B"): dpd.FENEBonds, ("C", "C"): dpd.MorseBonds}
    for pair, (kind, values) in terms(scene.bonds, "pairs").items():
        assert kind is kinds.get(tuple(sorted(scene.types[bead] for bead in pair)), dpd.HarmonicBonds)
        assert values == {dpd.HarmonicBonds: (50.0, 0.7), dpd.FENEBonds: (30.0, 4.0, 0.0, 1.0), dpd.MorseBonds: (5.0, 1.0, 0.6)}[kind]
    angles = terms(scene.angles, "triples")
    bonded = {tuple(pair) for pair in scene.bond_pairs.tolist()}
    assert set(angles) == {(k, k + 1, k + 2) for k in range(scene.n_beads - 2) if {(k, k + 1), (k + 1, k + 2)} <= bonded}
    for triple, (kind, values) in angles.items():
        special = tuple(scene.types[bead] for bead in triple) in (("A", "B", "C"), ("C", "B", "A"))
        assert (kind, values) == ((dpd.HarmonicAngles, (3.0, 2.5)) if special else (dpd.CosineAngles, (2.0,)))
    dihedrals = terms(scene.dihedrals, "quads")
    expected = {(*triple, triple[2] + 1) for triple in angles if (triple[1], triple[2], triple[2] + 1) in angles}
    assert set(dihedrals) == expected
    for quad, (kind, _) in dihedrals.items():
        middle = tuple(sorted(scene.types[bead] for bead in quad[1:3]))
        assert kind is {("A", "B"): dpd.OPLSDihedrals, ("C", "C"): dpd.MultiHarmonicDihedrals}.get(middle, dpd.HarmonicDihedrals)


# -- topologies ------------------------------------------------------------------------------------------------------------------
def water_and_oil() -> tuple[app.Topology, np.ndarray]:
    """Two waters and a chain of two residues, with elements."""
    topology = app.Topology()
    for chain_name, residues in (("A", ["HOH", "HOH"]), ("B", ["OIL", "OIL"])):
        chain = topology.addChain(chain_name)
        last = None
        for name in residues:
            residue = topology.addResidue(name, chain)
            element = app.element.oxygen if name == "HOH" else app.element.carbon
            atom = topology.addAtom("O" if name == "HOH" else "C1", element, residue)
            if name == "OIL":
                if last is not None:
                    topology.addBond(last, atom)
                    topology.addBond(atom, last)  # as CONECT records may have it
                last = atom
    topology.setUnitCellDimensions(openmm.Vec3(30, 30, 30) * unit.angstrom)
    return topology, np.random.default_rng(1).random((4, 3))


@cases(
    "typing",
    {"HOH": "W", "OIL": "T"},
    {"O": "W", "C1": "T"},
    {("HOH", "O"): "W", "OIL": "T"},
    lambda atom: "W" if atom.residue.name == "HOH" else "T",
    ids=["residues", "atoms", "both", "function"],
)
def test_typing(typing):
    topology, x = water_and_oil()
    scene = scene_from_topology(topology, x * unit.nanometer, typing, pairs=PAIRS, kT=1.0, bonds={("T", "T"): Spring(5, 0.5)})
    assert scene.types == ("W", "W", "T", "T") and scene.bond_pairs.tolist() == [[2, 3]]
    assert scene.masses == {"W": app.element.oxygen.mass._value, "T": app.element.carbon.mass._value}
    assert np.array_equal(scene.box, np.diag([3.0] * 3)) and scene.molecules.tolist() == [1, 2, 3, 4]


def test_files_that_openmm_reads(tmp_path):
    """Positions as OpenMM has them, and elements for masses."""
    topology, x = water_and_oil()
    with open(tmp_path / "x.pdb", "w", encoding="utf-8") as file:
        app.PDBFile.writeFile(topology, x * unit.nanometer, file)
    pdb = app.PDBFile(str(tmp_path / "x.pdb"))
    scene = scene_from_topology(pdb.topology, pdb.positions, {"O": "W", "C1": "T"}, pairs=PAIRS, kT=1.0, bonds=Spring(5, 0.5))
    np.testing.assert_allclose(scene.positions, x, atol=6e-5)
    assert scene.bond_pairs.tolist() == [[2, 3]] and scene.bead_masses[0] == pytest.approx(15.999, abs=1e-3) and scene.box[2, 2] == 3.0


@pytest.mark.parametrize(("molecules", "expected"), [("chains", [1, 1, 2, 2]), ("bonds", None), (np.array([4, 4, 5, 6]), [4, 4, 5, 6])])
def test_molecules(molecules, expected):
    topology, x = water_and_oil()
    scene = scene_from_topology(topology, x, {"O": "W", "C1": "T"}, pairs=PAIRS, kT=1.0, leave_out=["bonds"], molecules=molecules)
    assert (scene.molecules if expected is None else scene.molecules.tolist()) == expected and not scene.bonds


def test_masses_of_single_beads_and_masses_by_hand():
    topology, x = water_and_oil()
    one = {"HOH": "X", "OIL": "X"}
    scene = scene_from_topology(topology, x, one, pairs=PAIRS, kT=1.0, leave_out=["bonds"])
    assert scene.bead_masses[0] == pytest.approx(15.999, abs=1e-3) and scene.bead_masses[3] == pytest.approx(12.011, abs=1e-3)
    assert set(scene_from_topology(topology, x, one, pairs=PAIRS, kT=1.0, leave_out=["bonds"], masses=2 * unit.dalton).bead_masses) == {2.0}


@cases(
    "change, message",
    ({"typing": {"HOH": "W"}}, "typing has no bead type for atom 'C1' of residue 'OIL'"),
    ({"typing": {"HOH": "W", "O": "X", "OIL": "T"}}, r"typing has 'X' for atoms 'O' and 'W' for residues 'HOH'.*\('HOH', 'O'\)"),
    ({"typing": lambda atom: None}, "typing gives None for atom 'O' .index 0. of residue 'HOH'"),
    ({"typing": 3}, "typing must be a function from an atom to a bead type"),
    ({"bonds": None}, "the topology has 1 bonds, the first one between types 'T', 'T', but no bonds are given"),
    ({"bonds": {("W", "T"): Spring(1, 1)}}, "no spring is given for the bond between types 'T', 'T'"),
    ({"bonds": {("T", "Q"): Spring(1, 1)}}, r"for bonds \('T', 'Q'\): there is no type 'Q' in the topology; there are T, W"),
    ({"bonds": {"T-T": Spring(1, 1)}}, "the topology has no names of bond types"),
    ({"bonds": {("T", "T"): 5.0}}, "a mapping of springs needs keys of 2 types and springs as values"),
    ({"angles": CosineBend(1)}, "lists no angles, and no two of its bonds meet"),
    ({"leave_out": ["bonds"]}, "bonds are both given and in leave_out"),
    ({"dihedrals": Twist(1, 1, 1)}, "lists no dihedrals, and no three of its bonds meet"),
    ({"dihedrals": {"x": Twist(1, 1, 1)}}, "has no names of dihedral types; the keys of dihedrals must be four bead types"),
    ({"leave_out": ["impropers"]}, "leave_out names impropers; what can be left out of the topology is bonds, angles, dihedrals$"),
    ({"leave_out": "bonds"}, "leave_out must be a sequence of names"),
    ({"positions": np.zeros((3, 3))}, r"positions must have shape \(4, 3\), as the topology has 4 atoms, not \(3, 3\)"),
    ({"positions": np.full((4, 3), np.nan)}, "positions holds nan at index"),
    ({"masses": {"W": 1.0}}, "masses has no mass of the bead type 'T'; it has W"),
    ({"masses": -1.0}, "mass of type 'W' must be a number > 0"),
    ({"pairs": {("W", "W"): dpd.DPD(A=1)}}, r"no pair coefficients for types \(W, T\)"),
    ({"molecules": "atoms"}, "molecules must be 'residues', 'chains', 'bonds'"),
    ({"box": [3, 3, 3], "periodic": False}, "a box is given and periodic=False"),
    ({"topology": "x.pdb"}, "topology must be an openmm.app.Topology, not 'x.pdb'"),
)
def test_what_is_missing_or_wrong_is_named(change, message):
    topology, x = water_and_oil()
    given = {"topology": topology, "positions": x, "typing": {"HOH": "W", "OIL": "T"}, "pairs": PAIRS, "kT": 1.0}
    raises(dpd.ParameterError, message, lambda: scene_from_topology(**given | {"bonds": {("T", "T"): Spring(5, 0.5)}} | change))


def test_no_box_and_no_masses():
    topology = openmm_topology(["A", "B"])
    given = {"positions": np.zeros((2, 3)), "pairs": PAIRS, "kT": 1.0}
    raises(dpd.ParameterError, "the topology has no masses; give masses", lambda: scene_from_topology(topology, **given, box=[3, 3, 3]))
    raises(dpd.ParameterError, "the topology has no periodic box; give box=", lambda: scene_from_topology(topology, **given, masses=1.0))
    assert scene_from_topology(topology, **given, masses=1.0, periodic=False).box is None
    with pytest.raises(dpd.ParameterError, match="has no bonds for the given bonds to act on; give a sequence of bonds"):
        scene_from_topology(topology, **given, masses=1.0, periodic=False, bonds=Spring(1, 1))
    ready = [dpd.HarmonicBonds([(0, 1)], k=1.0, r0=0.5)]
    assert scene_from_topology(topology, **given, masses=1.0, periodic=False, bonds=ready).bond_pairs.tolist() == [[0, 1]]


# -- PSF -------------------------------------------------------------------------------------------------------------------------
def test_psf_of_another_program(tmp_path):
    """Segments that count their residues from 1, names that are no types, dihedrals, and impropers, which no Scene has."""
    scene = random_scene(1)
    psf_of(scene, tmp_path / "top.psf")
    text, half = (tmp_path / "top.psf").read_text(encoding="utf-8"), scene.n_beads // 2
    lines = text.replace("         0 !NIMPHI: impropers", "         1 !NIMPHI: impropers\n 1 2 3 4\n").splitlines()
    start = next(k for k, line in enumerate(lines) if "!NATOM" in line) + 1
    for k in range(scene.n_beads):
        words = lines[start + k].split()
        words[1:3] = ("FIRST", "1") if k < half else ("SECOND", "1")
        lines[start + k] = " ".join(words)
    (tmp_path / "other.psf").write_text("\n".join(lines), encoding="utf-8")
    given = {"pairs": {("*", "*"): dpd.NONE}, "kT": 1.0, "box": scene.box, "bonds": Spring(1, 1)}
    other = (tmp_path / "other.psf", scene.positions, lambda atom: atom.name + "x")
    unsupported = "has 1 impropers, which are not taken over; leave_out=.'impropers',. ignores"
    raises(dpd.ParameterError, unsupported, scene_from_psf, *other, **given)
    given["leave_out"] = ("impropers", "angles")
    missing = "has 2 dihedrals, the first one .* leave_out=.'dihedrals',. to ignore them"
    raises(dpd.ParameterError, missing, scene_from_psf, *other, **given)
    given["leave_out"] += ("dihedrals",)
    found = scene_from_psf(*other, **given)
    assert found.types == tuple(name + "x" for name in scene.types)
    assert found.molecules.tolist() == [1] * half + [2] * (scene.n_beads - half)
    assert found.bonded_factors == (1.0, 1.0, 1.0) and not found.angles and not found.dihedrals


@cases(
    "positions, change, message",
    ("no.dcd", {}, "no.dcd cannot be read as positions of 27 beads"),
    ("short.dcd", {"frame": 3}, "short.dcd has 1 frames; there is no frame 3"),
    ("short.dcd", {}, r"short.dcd cannot be read as positions of 27 beads|is of shape \(5, 3\)"),
    (np.zeros((4, 3)), {}, r"top.psf has 27 beads, but positions is of shape \(4, 3\)"),
    (np.zeros((27, 3)), {"box": None}, "top.psf has no periodic box"),
    (np.zeros((27, 3)), {"frame": 3}, "frame=3 has no effect"),
)
def test_positions_that_do_not_fit(tmp_path, monkeypatch, positions, change, message):
    monkeypatch.chdir(tmp_path)
    scene = random_scene(2)
    assert scene.n_beads == 27
    psf_of(scene, "top.psf")
    mdtraj.Trajectory(np.zeros((1, 5, 3)), None).save_dcd("short.dcd")
    given = {"pairs": PAIRS, "kT": 1.0, "box": TILTED, **tables(scene), **change}
    raises(dpd.ParameterError, message, scene_from_psf, "top.psf", positions, **given)


def test_frames_of_mdtraj():
    topology, x = water_and_oil()
    trajectory = mdtraj.Trajectory(np.array([x, x + 1]), mdtraj.Topology.from_openmm(topology))
    given = {"typing": {"HOH": "W", "OIL": "T"}, "pairs": PAIRS, "kT": 1.0, "bonds": Spring(5, 0.5), "box": [3, 3, 3]}
    np.testing.assert_allclose(scene_from_mdtraj(trajectory, **given, frame=0).positions, x, atol=1e-6)
    np.testing.assert_allclose(scene_from_mdtraj(trajectory, **given).positions, x + 1, atol=1e-6)
    raises(dpd.ParameterError, "the trajectory has 2 frames; there is no frame 2", lambda: scene_from_mdtraj(trajectory, **given, frame=2))
    bare = mdtraj.Trajectory(x[None], None)
    raises(dpd.ParameterError, "expected an mdtraj.Trajectory with a topology", scene_from_mdtraj, bare, **given)


# -- data files ------------------------------------------------------------------------------------------------------------------
DATA = """a title

4 atoms
2 atom types
2 bonds
2 bond types
1 angles
1 angle types

-1 4 xlo xhi
0 5 ylo yhi
0 5 zlo zhi

Masses

1 1.0
2 3.0

Bond Coeffs{hint}

1 50 0.7
2 25 0.6

Angle Coeffs # harmonic

1 3.0 120.0

Atoms # molecular

4 1 2 0.1 0.2 0.4 0 0 0
1 1 1 0.1 0.2 0.3 1 0 -1
2 1 1 0.9 0.2 0.3 1 0 -1
3 2 2 1.5 0.2 0.3 0 0 0

Bonds

1 1 1 2
2 2 2 3

Angles

1 1 1 2 3
"""


def data_file(tmp_path, hint=" # harmonic", text=DATA):
    (tmp_path / "data.x").write_text(text.replace("{hint}", hint), encoding="utf-8")
    return tmp_path / "data.x"


def test_coefficients_of_a_data_file(tmp_path):
    scene = scene_from_lammps_data(data_file(tmp_path), pairs=PAIRS, kT=1.0)
    assert scene.types == ("1", "1", "2", "2") and scene.masses == {"1": 1.0, "2": 3.0} and scene.velocities is None
    assert terms(scene.bonds, "pairs") == {(0, 1): (dpd.HarmonicBonds, (50.0, 0.7)), (1, 2): (dpd.HarmonicBonds, (25.0, 0.6))}
    ((kind, (k, theta0)),) = terms(scene.angles, "triples").values()
    assert (kind, k) == (dpd.HarmonicAngles, 3.0) and theta0 == pytest.approx(2 * np.pi / 3)
    np.testing.assert_allclose(scene.positions[0], [5.1, 0.2, -4.7])
    springs = {"1": Spring(1, 2), "2": FENESpring(3, 9)}
    named = scene_from_lammps_data(data_file(tmp_path), {1: "A", 2: "B"}, pairs=PAIRS, kT=1.0, bonds=springs)
    assert named.types == ("A", "A", "B", "B") and [type(group) for group in named.bonds] == [dpd.HarmonicBonds, dpd.FENEBonds]


@cases(
    "hint, change, given, message",
    ("", ("", ""), {}, "has 2 bonds, the first one between types '1', '1' ..1.., but no bonds are given"),
    ("", ("", ""), {"bonds": {"1": Spring(1, 1)}}, "no spring is given for the bond between types '1', '2' ..2.."),
    ("", ("", ""), {"bonds": {"7": Spring(1, 1)}}, "there is no type '7' in .*; there are 1, 2"),
    ("", ("# molecular", ""), {}, "does not state its atom style after 'Atoms #'"),
    ("", ("", ""), {"atom_style": "full"}, "the file says atom_style molecular, not full"),
    ("", ("# molecular", "# edpd"), {}, "atom_style edpd cannot be taken .its beads have fields"),
    ("", ("", ""), {"types": {1: "A"}}, "types must name each of the 2 atom types"),
    ("", ("", ""), {"types": {1: "A", 2: "A"}}, "a name of its own"),
    ("", ("", ""), {"units": "electron"}, "units must be one of .*'electron'"),
    (" # harmonic", ("1 50 0.7", "1 50"), {}, r"data.x:\d+: .*K r0"),
    (" # class2", ("", ""), {}, "no bonds are given"),
    ("", ("1 angle types", "1 angle types\n2 impropers"), {}, "the header announces 2 impropers, but there is no Impropers section"),
)
def test_data_files_that_do_not_say_enough(tmp_path, hint, change, given, message):
    path = data_file(tmp_path, hint, DATA.replace(*change) if change[0] else DATA)
    raises((dpd.ParameterError, dpd.DeckError), message, lambda: scene_from_lammps_data(path, **{"pairs": PAIRS, "kT": 1.0, **given}))


# -- arrays ----------------------------------------------------------------------------------------------------------------------
@cases(
    "change, message",
    ({"positions": None}, "my table has no positions; give positions"),
    ({"positions": np.zeros((2, 3))}, r"positions must have shape \(3, 3\)"),
    ({"masses": np.ones(2)}, r"my table has 3 types of beads, but masses of shape \(2,\)"),
    ({"masses": np.array([1, np.nan, 1])}, "the masses of my table holds nan"),
    ({"velocities": np.full((3, 3), np.inf)}, "velocities holds inf"),
    ({"charges": np.ones(4)}, r"charges must have shape \(3,\)"),
    ({"molecules": np.ones(2, int)}, "molecules must have one entry per bead"),
    ({"residues": ["A"]}, "residues must name the molecule of each of the 3 beads"),
    ({"bonds": np.array([(0, 3)])}, r"bond 0 is \[0, 3\]; it must join two different beads of 0 to 2"),
    ({"bonds": np.array([(0, 1), (1, 0)])}, "the bond between beads 0 and 1 .counted from 0. is listed twice"),
    ({"bond_names": ["a", "b"]}, "my table has 1 bonds, but 2 names of their types"),
    ({"angles": np.array([(0, 1, 1)])}, "it must join three different beads"),
    ({"types": []}, "my table has no beads"),
)
def test_arrays_that_do_not_fit(change, message):
    good = {"types": ["A", "A", "B"], "positions": np.eye(3), "source": "my table", "masses": np.ones(3), "bonds": np.array([(0, 1)])}
    given = {"pairs": PAIRS, "kT": 1.0, "box": [4, 4, 4], "bonds": Spring(1, 1)}
    assert scene_from_beads(BeadArrays(**good), **given).bond_pairs.tolist() == [[0, 1]]
    given |= {"angles": CosineBend(1)} if "angles" in change else {}
    raises(dpd.ParameterError, message, lambda: scene_from_beads(BeadArrays(**good | change), **given))


def test_types_without_beads_and_kinds_of_masses():
    """Types of the source keep their order; one without beads has no mass unless somebody gives it."""
    beads = BeadArrays(["B", "A", "B"], np.eye(3), "my table", masses=np.array([2.0, 1.0, 2.0]), type_names=["A", "C", "B"])
    given = {"pairs": PAIRS, "kT": 1.0, "box": [4, 4, 4]}
    assert scene_from_beads(beads, **given).masses == {"A": 1.0, "B": 2.0}
    assert list(scene_from_beads(beads, **given, masses=3.0).masses) == ["A", "C", "B"]
    assert scene_from_beads(beads, **given, masses={"B": 5, "A": 4, "Z": 3}).masses == {"A": 4.0, "B": 5.0, "Z": 3.0}
