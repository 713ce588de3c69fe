"""GSD and extended XYZ files: what is in them, and runs that write them."""

import re

import numpy as np
import openmm
import pytest
from cases import cases, raises
from full_disk import file_limit
from openmm import unit
from random_scenes import BENDS, PAIRS, SEEDS, SPRINGS, TILTED, TWISTS, check, random_scene, tables, terms

import openmm_dpd as dpd
from openmm_dpd.base.errors import OutputError, ParameterError
from openmm_dpd.inputs import scene_from_gsd
from openmm_dpd.outputs import GSDReporter, XYZReporter, write_gsd, write_pdb, write_xyz


@pytest.fixture
def hoomd():
    return pytest.importorskip("gsd.hoomd", reason="gsd is not installed: pip install -e '.[gsd]'")


def build(scene, **choices):
    return dpd.build(scene, **{"dt": 0.01, "platform": "Reference", "seed": 3, **choices})


def parsed_xyz(path) -> list[dict]:
    """Frames of an extended XYZ file, read by the letter of its second lines."""
    lines, frames = path.read_text(encoding="utf-8").splitlines(), []
    while lines:
        count = int(lines[0])
        words = {key: quoted or plain for key, quoted, plain in re.findall(r'(\w+)=(?:"([^"]*)"|(\S+))', lines[1])}
        rows, at = [line.split() for line in lines[2 : 2 + count]], 0
        frame = {"words": words}
        kinds = words["Properties"].split(":")
        for name, kind, width in zip(kinds[0::3], kinds[1::3], map(int, kinds[2::3]), strict=True):
            cells = [row[at : at + width] for row in rows]
            frame[name] = [cell[0] for cell in cells] if kind == "S" else np.array(cells, dtype=float)
            at += width
        assert all(len(row) == at for row in rows) and len(rows) == count
        frames.append(frame)
        lines = lines[2 + count :]
    return frames


# -- GSD -------------------------------------------------------------------------------------------------------------------------
@pytest.mark.parametrize("units", ["lj", "real"])
@pytest.mark.parametrize("seed", SEEDS)
def test_gsd_and_back(tmp_path, hoomd, seed, units):
    """float32: 3e-8 of the largest number."""
    scene = random_scene(seed)
    write_gsd(tmp_path / "x.gsd", scene, units=units)
    found = scene_from_gsd(tmp_path / "x.gsd", pairs=PAIRS, kT=1.0, units=units, **tables(scene))
    check(found, scene, atol=2e-6, velocities=True, box_atol=2e-6)
    assert np.array_equal(found.charges, scene.charges) and list(found.masses) == scene.type_names


def test_gsd_as_gsd_reads_it(tmp_path, hoomd):
    """Positions in the box around the origin, with images; names of bonds; the same through a Frame."""
    scene = random_scene(3)
    built = build(scene)
    write_gsd(tmp_path / "x.gsd", built)
    with hoomd.open(str(tmp_path / "x.gsd"), "r") as file:
        (frame,) = list(file)
    beads, box = frame.particles, frame.configuration.box
    assert [beads.types[k] for k in beads.typeid] == list(scene.types) and frame.configuration.dimensions == 3
    lx, ly, lz, xy, xz, yz = box.tolist()
    vectors = np.array([[lx, 0, 0], [xy * ly, ly, 0], [xz * lz, yz * lz, lz]])
    np.testing.assert_allclose(vectors, TILTED, atol=1e-6)
    inside = beads.position @ np.linalg.inv(vectors)
    assert np.abs(inside).max() <= 0.5 + 1e-6 and beads.image.any()
    np.testing.assert_allclose(beads.position + beads.image @ vectors + vectors.sum(axis=0) / 2, scene.positions, atol=2e-6)
    assert frame.bonds.N == len(scene.bond_pairs) and frame.angles.N == sum(len(group.triples) for group in scene.angles)
    assert frame.dihedrals.N == sum(len(group.quads) for group in scene.dihedrals) > 0
    pairs = {frame.bonds.types[t] for t in frame.bonds.typeid}
    assert pairs == {"-".join(sorted(scene.types[bead] for bead in pair)) for pair in scene.bond_pairs}
    np.testing.assert_array_equal(frame.log["particles/molecule"], scene.molecules)
    springs = {name: SPRINGS.get(tuple(name.split("-")[::-1]), SPRINGS["*", "*"]) for name in pairs}
    again = scene_from_gsd(frame, pairs=PAIRS, kT=1.0, bonds=springs, angles=BENDS, dihedrals=TWISTS)
    assert terms(again.bonds, "pairs") == terms(scene.bonds, "pairs")


def test_bonds_of_two_types_with_several_springs(tmp_path, hoomd):
    bonds = [dpd.HarmonicBonds([(0, 1), (1, 2), (2, 3)], k=[1.0, 2.0, 1.0], r0=0.5), dpd.MorseBonds([(3, 4)], D=1.0, alpha=1.0, r0=0.5)]
    scene = dpd.Scene({"A": 1}, ["A"] * 5, np.arange(15.0).reshape(5, 3) / 15, PAIRS, kT=1, box=[3, 3, 3], bonds=bonds)
    write_gsd(tmp_path / "x.gsd", scene)
    with hoomd.open(str(tmp_path / "x.gsd"), "r") as file:
        assert [file[0].bonds.types[t] for t in file[0].bonds.typeid] == ["A-A", "A-A-2", "A-A", "A-A-3"]
    found = scene_from_gsd(tmp_path / "x.gsd", pairs=PAIRS, kT=1, leave_out=["bonds"])
    assert found.velocities is None and found.charges is None and found.molecules is None and not found.bonds


def test_names_beyond_ascii(tmp_path, hoomd):
    """In every frame."""
    bonds = [dpd.HarmonicBonds([(0, 1)], k=1.0, r0=0.5)]
    table = {("*", "*"): dpd.DPD(A=25)}
    scene = dpd.Scene({"Ä": 1, "水": 1}, ["Ä", "水"], [[1.0, 2, 3], [1, 2.5, 3]], table, kT=1, box=[4] * 3, bonds=bonds)
    write_gsd(tmp_path / "x.gsd", scene)
    simulation = build(scene).simulation()
    simulation.reporters.append(GSDReporter(tmp_path / "x.gsd", 1, build(scene), append=True))
    simulation.step(2)
    with hoomd.open(str(tmp_path / "x.gsd"), "r") as file:
        assert [(frame.particles.types, frame.bonds.types) for frame in file] == [(["Ä", "水"], ["Ä-水"])] * 3


def test_boxes_tilted_to_the_limit(tmp_path, hoomd):
    """In single precision a tilt of half an edge may be a little more: then it is another form of the same lattice."""
    box = np.array([[3.3, 0, 0], [1.65, 3.1, 0], [-1.65, 1.55, 3.7]])
    write_gsd(tmp_path / "x.gsd", dpd.Scene({"A": 1}, ["A"], [[1.0, 2.0, 3.0]], PAIRS, kT=1, box=box))
    found = scene_from_gsd(tmp_path / "x.gsd", pairs=PAIRS, kT=1)
    for rows in (found.box, found.positions - [1.0, 2.0, 3.0]):
        numbers = rows @ np.linalg.inv(box)
        np.testing.assert_allclose(numbers, np.rint(numbers), atol=1e-6)
    assert abs(np.linalg.det(found.box) / np.linalg.det(box) - 1) < 1e-6


def test_beads_beside_atoms_are_refused(tmp_path):
    system = openmm.System()
    for _ in range(60):
        system.addParticle(40.0)
    built = dpd.add_thermostat(system, dpd.DPD(gamma=1), 300, 0.002)
    raises(ParameterError, "a System made elsewhere has particles that are not beads", lambda: write_xyz(tmp_path / "x.xyz", built))


def bare_frame(hoomd):
    frame = hoomd.Frame()
    frame.particles.N = 3
    frame.particles.types = ["A", "B"]
    frame.particles.typeid = [0, 1, 1]
    frame.particles.position = [[0, 0, 0], [1, 0, 0], [2, 0, 0]]
    frame.configuration.box = [6, 6, 6, 0, 0, 0]
    return frame


def test_frames_that_somebody_made(hoomd):
    """What is not set has HOOMD's defaults; a tilt over half an edge is brought into OpenMM's form."""
    frame = bare_frame(hoomd)
    frame.configuration.box = [6, 6, 6, 0.9, 0, 0]
    scene = scene_from_gsd(frame, pairs=PAIRS, kT=1)
    np.testing.assert_allclose(scene.box, [[6, 0, 0], [-0.6, 6, 0], [0, 0, 6]], atol=1e-6)
    np.testing.assert_allclose(scene.positions[1] - scene.positions[0], [1, 0, 0])
    assert scene.types == ("A", "B", "B") and set(scene.bead_masses) == {1.0}
    assert frame.particles.mass is None  # the caller's own is as it was


FOUR = "dihedral 0 is .0, 1, 2, 3.; it must join four different beads of 0 to 2"


@cases(
    "part, values, message",
    ("particles", {"body": [0, 0, -1]}, "2 particles of rigid bodies"),
    ("particles", {"moment_inertia": [[1, 0, 0], [0, 0, 0], [0, 0, 0]]}, "1 particles that rotate"),
    ("impropers", {"N": 1, "group": [[0, 1, 2, 0]]}, "1 impropers"),
    ("dihedrals", {"N": 1, "types": ["x"], "group": [[0, 1, 2, 3]]}, FOUR),
    ("pairs", {"N": 1, "group": [[0, 1]]}, "1 special pairs"),
    ("constraints", {"N": 1, "group": [[0, 1]]}, "1 constraints"),
    ("configuration", {"dimensions": 2}, "has two dimensions"),
    ("configuration", {"box": [0, 1, 1, 0, 0, 0]}, "they must be > 0"),
    ("particles", {"position": [[0, 0, 0], [0, 0, np.nan], [0, 0, 0]]}, "positions holds nan"),
    ("particles", {"mass": [1, 0, 1]}, "has the mass 0 for bead 1 of type 'B'; give masses"),
    ("bonds", {"N": 1, "types": ["x"], "group": [[0, 1]]}, "no bonds are given"),
)
def test_what_a_scene_cannot_hold(hoomd, part, values, message):
    frame = bare_frame(hoomd)
    for name, value in values.items():
        setattr(getattr(frame, part), name, value)
    raises(ParameterError, message, scene_from_gsd, frame, pairs=PAIRS, kT=1)


def test_what_is_left_out_on_request(hoomd):
    frame = bare_frame(hoomd)
    frame.particles.body = [0, 0, -1]
    assert scene_from_gsd(frame, pairs=PAIRS, kT=1, leave_out=["particles of rigid bodies"]).n_beads == 3
    message = "leave_out names impropers; what can be left out of the GSD frame is bonds, angles, dihedrals, particles of"
    raises(ParameterError, message, scene_from_gsd, frame, pairs=PAIRS, kT=1, leave_out=["particles of rigid bodies", "impropers"])


def test_gsd_files_that_are_none(tmp_path, hoomd):
    (tmp_path / "x.gsd").write_bytes(b"PDB")
    given = {"pairs": PAIRS, "kT": 1}
    raises(ParameterError, "cannot be read as a GSD file", scene_from_gsd, tmp_path / "x.gsd", **given)
    raises(ParameterError, "no.gsd cannot be read", scene_from_gsd, tmp_path / "no.gsd", **given)
    raises(ParameterError, "not 3", scene_from_gsd, 3, **given)
    write_gsd(tmp_path / "x.gsd", random_scene(1))
    raises(ParameterError, "x.gsd has 1 frames; there is no frame 1", scene_from_gsd, tmp_path / "x.gsd", **given, frame=1)
    boundless = dpd.Scene({"A": 1}, ["A"], [[0, 0, 0]], **given)
    raises(ParameterError, "a GSD file needs a periodic box", write_gsd, tmp_path / "y.gsd", boundless)
    assert [path.name for path in tmp_path.iterdir()] == ["x.gsd"]


def test_no_gsd(tmp_path, monkeypatch):
    monkeypatch.setitem(__import__("sys").modules, "gsd.hoomd", None)
    message = r"GSD files need the package gsd, which cannot be imported .*pip install 'openmm-dpd\[gsd\]'"
    raises(ParameterError, message, write_gsd, tmp_path / "x.gsd", random_scene(1))
    raises(ParameterError, message, scene_from_gsd, "x.gsd", pairs=PAIRS, kT=1)


# -- runs ------------------------------------------------------------------------------------------------------------------------
def fluid(n=60):
    x = np.random.default_rng(1).random((n, 3)) * 3
    types = ["A", "B"] * (n // 2)
    return dpd.Scene({"A": 1.0, "B": 2.0}, types, x, PAIRS, kT=1.0, box=[[3, 0, 0], [0.5, 3, 0], [0, 0, 3.5]])


def state_of(simulation):
    return simulation.context.getState(positions=True, velocities=True)


def test_reporters_write_what_the_run_has(tmp_path, hoomd):
    """Every second step, in both formats; a second run goes on with the files."""
    kept = []
    for append in (False, True):
        built = build(fluid())
        simulation = built.simulation()
        if append:
            simulation.loadState(str(tmp_path / "state.xml"))
        for kind, name in ((GSDReporter, "run.gsd"), (XYZReporter, "run.xyz")):
            simulation.reporters.append(kind(tmp_path / name, 2, built, append=append))
        for _ in range(2):
            simulation.step(2)
            kept.append(state_of(simulation))
        simulation.saveState(str(tmp_path / "state.xml"))
    frames = parsed_xyz(tmp_path / "run.xyz")
    assert [int(frame["words"]["Step"]) for frame in frames] == [2, 4, 6, 8]
    assert [float(frame["words"]["Time"]) for frame in frames] == pytest.approx([0.02, 0.04, 0.06, 0.08])
    with hoomd.open(str(tmp_path / "run.gsd"), "r") as file:
        assert [frame.configuration.step for frame in file] == [2, 4, 6, 8]
    for k, state in enumerate(kept):
        x = state.getPositions(asNumpy=True).value_in_unit(unit.nanometer)
        v = state.getVelocities(asNumpy=True).value_in_unit(unit.nanometer / unit.picosecond)
        np.testing.assert_allclose(frames[k]["pos"], x, atol=1e-10)
        np.testing.assert_allclose(frames[k]["velo"], v, atol=1e-10)
        scene = scene_from_gsd(tmp_path / "run.gsd", pairs=PAIRS, kT=1, frame=k)
        np.testing.assert_allclose(scene.positions, x, atol=2e-6)
        np.testing.assert_allclose(scene.velocities, v, atol=2e-6)
    write_gsd(tmp_path / "last.gsd", built, state=state)
    assert np.array_equal(scene_from_gsd(tmp_path / "last.gsd", pairs=PAIRS, kT=1).positions, scene.positions)


@pytest.mark.parametrize("kind", [GSDReporter, XYZReporter])
def test_files_of_other_beads_are_not_gone_on_with(tmp_path, hoomd, kind):
    for scene in (fluid(), fluid(30)):
        simulation = build(scene).simulation()
        built = build(scene)
        if scene.n_beads == 60:
            simulation.reporters.append(kind(tmp_path / "run", 1, built))
            simulation.step(1)
    before = (tmp_path / "run").read_bytes()
    raises(ParameterError, "cannot append to .*run: it .*beads", lambda: kind(tmp_path / "run", 1, built, append=True))
    raises(ParameterError, "interval between reports", lambda: kind(tmp_path / "run", 0, built))
    raises(ParameterError, "expected a Scene or the result of openmm_dpd.build", lambda: kind(tmp_path / "run", 1, "built"))
    assert (tmp_path / "run").read_bytes() == before


def test_an_xyz_file_that_ends_within_a_frame(tmp_path):
    built = build(fluid())
    simulation, path = built.simulation(), tmp_path / "run.xyz"
    simulation.reporters.append(XYZReporter(path, 1, built))
    simulation.step(3)
    whole = path.read_bytes()
    XYZReporter(path, 1, built, append=True)
    assert path.read_bytes() == whole
    for cut in (1, 30, 300, len(whole) // 3 - 5, len(whole) // 2):
        path.write_bytes(whole[:-cut])
        raises(ParameterError, "its last frame is incomplete", lambda: XYZReporter(path, 1, built, append=True))
        assert path.read_bytes() == whole[:-cut]


@pytest.mark.parametrize("kind", [GSDReporter, XYZReporter])
def test_frames_before_a_failure_stay(tmp_path, hoomd, kind):
    """... and the run goes on once there is space."""
    built = build(fluid(400))
    simulation = built.simulation()
    simulation.reporters.append(kind(tmp_path / "run", 1, built))
    simulation.step(2)
    with file_limit((tmp_path / "run").stat().st_size + 3000):
        raises(OutputError, "the (GSD|XYZ) file .*run cannot be written", simulation.step, 1)
    if kind is XYZReporter:
        assert len(parsed_xyz(tmp_path / "run")) == 2
    else:
        assert scene_from_gsd(tmp_path / "run", pairs=PAIRS, kT=1, frame=1).n_beads == 400
    simulation.step(1)
    last = state_of(simulation).getPositions(asNumpy=True).value_in_unit(unit.nanometer)
    if kind is XYZReporter:
        frames = parsed_xyz(tmp_path / "run")
        assert len(frames) == 3
        np.testing.assert_allclose(frames[2]["pos"], last, atol=1e-10)
    else:
        np.testing.assert_allclose(scene_from_gsd(tmp_path / "run", pairs=PAIRS, kT=1, frame=2).positions, last, atol=2e-6)


@pytest.mark.parametrize("write", [write_gsd, write_xyz, write_pdb])
def test_whole_files_before_a_failure_stay(tmp_path, hoomd, write):
    scene = fluid(400)
    write(tmp_path / "x", scene)
    before = (tmp_path / "x").read_bytes()
    with file_limit(2000), pytest.raises(OutputError, match="file .*x cannot be written"):
        write(tmp_path / "x", scene)
    raises(OutputError, "cannot be written", lambda: write(tmp_path / "no" / "x", scene))
    assert (tmp_path / "x").read_bytes() == before and [path.name for path in tmp_path.iterdir()] == ["x"]


def test_states_that_do_not_fit(tmp_path):
    built = build(fluid())
    simulation = built.simulation()
    path, bare = tmp_path / "x.xyz", simulation.context.getState()
    raises(ParameterError, "the state has no positions; ask for them", write_xyz, path, built, state=bare)
    raises(ParameterError, "has 60 particles, but the scene has 30 beads", write_xyz, path, fluid(30), state=state_of(simulation))
    raises(ParameterError, "state must be an openmm.State", write_xyz, path, built, state=simulation)
    write_xyz(path, built, state=simulation.context.getState(positions=True))
    assert "velo" not in parsed_xyz(path)[0]


# -- extended XYZ ----------------------------------------------------------------------------------------------------------------
@pytest.mark.parametrize("seed", SEEDS)
def test_xyz_says_what_the_scene_says(tmp_path, seed):
    scene = random_scene(seed)
    write_xyz(tmp_path / "x.xyz", scene, units="real")
    (frame,) = parsed_xyz(tmp_path / "x.xyz")
    assert frame["species"] == list(scene.types) and frame["words"]["pbc"] == "T T T"
    np.testing.assert_allclose(np.array(frame["words"]["Lattice"].split(), float).reshape(3, 3), 10 * scene.box, rtol=1e-11)
    np.testing.assert_allclose(frame["pos"], 10 * scene.positions, rtol=1e-11)
    np.testing.assert_allclose(frame["velo"], 0.01 * scene.velocities, rtol=1e-11)


def test_xyz_without_a_box(tmp_path):
    write_xyz(tmp_path / "x.xyz", dpd.Scene({"A": 1}, ["A"], [[0, 0, 1 / 3]], PAIRS, kT=1))
    assert (tmp_path / "x.xyz").read_text() == '1\nProperties=species:S:1:pos:R:3 pbc="F F F" Step=0 Time=0\nA 0 0 0.333333333333\n'


def test_ase_reads_it(tmp_path):
    """With chemical symbols, which are all that it takes."""
    ase = pytest.importorskip("ase.io", reason="ase is not installed")
    scene = random_scene(2)
    write_xyz(tmp_path / "x.xyz", scene, units="metal", species={"A": "C", "B": "N", "C": "O", "W": "H"})
    atoms = ase.read(tmp_path / "x.xyz")
    np.testing.assert_allclose(atoms.positions, 10 * scene.positions, rtol=1e-11)
    np.testing.assert_allclose(atoms.cell.array, 10 * scene.box, rtol=1e-11)
    assert atoms.pbc.all() and atoms.get_chemical_symbols()[-4:] == ["C", "N", "O", "H"]


@cases(
    "species, message",
    ({"A": "C"}, "species must map each of the types A, B to text"),
    ({"A": "C", "B": "a b"}, "the name 'a b' cannot be"),
    ("AB", "must map each"),
)
def test_bad_species(tmp_path, species, message):
    raises(ParameterError, message, lambda: write_xyz(tmp_path / "x.xyz", fluid(), species=species))
    assert not (tmp_path / "x.xyz").exists()


# -- bonds and types that change -------------------------------------------------------------------------------------------------
def test_bonds_and_types_are_those_of_the_moment(tmp_path, hoomd):
    """A bond of the start breaks in step 4; in step 6 another one forms, and makes a bead a B.  A State alone has neither."""
    bonds = dpd.ReactiveBonds(dpd.HarmonicBonds, {"k": 1.0, "r0": 0.5}, pairs=[[0, 1]])
    reactions = [
        dpd.BondBreaking(bonds, beyond=0.8, every=4),
        dpd.BondFormation(bonds, ("A", "C"), within=0.7, valences=(1, 1), probability=1.0, every=6, becomes=("B", None)),
    ]
    x = [[0.1, 1, 1], [1.1, 1, 1], [2.0, 2, 2], [2.5, 2, 2], [3.5, 3, 3]]
    given = {"positions": x, "velocities": np.zeros((5, 3)), "box": [4.0] * 3, "kT": 0.0, "reactions": reactions}
    scene = dpd.Scene(dict.fromkeys("ABC", 1.0), list("CCACC"), pairs={("*", "*"): dpd.DPD(A=1e-6, gamma=1.0)}, **given)
    built = build(scene, dt=0.001, scheme="middle")
    simulation = built.simulation()
    for reporter in (GSDReporter(tmp_path / "a.gsd", 2, built), XYZReporter(tmp_path / "a.xyz", 2, built)):
        simulation.reporters.append(reporter)
    write_gsd(tmp_path / "start.gsd", built)
    simulation.step(6)
    simulation.reporters = [GSDReporter(tmp_path / "a.gsd", 2, built, append=True), XYZReporter(tmp_path / "a.xyz", 2, built, append=True)]
    simulation.step(2)
    other = dpd.Scene(dict.fromkeys("ABC", 1.0), list("CCBCA"), pairs={("*", "*"): dpd.DPD(A=1e-6, gamma=1.0)}, **given)
    for kind, name in ((GSDReporter, "a.gsd"), (XYZReporter, "a.xyz")):  # a C does not become an A
        raises(ParameterError, "cannot append", kind, tmp_path / name, 2, build(other, dt=0.001, scheme="middle"), append=True)
    with hoomd.open(str(tmp_path / "a.gsd")) as file, hoomd.open(str(tmp_path / "start.gsd")) as start:
        frames = [start[0], *file]
    assert [frame.bonds.group.tolist() for frame in frames] == [[[0, 1]], [[0, 1]], [], [[2, 3]], [[2, 3]]]
    assert [[frame.particles.types[k] for k in frame.particles.typeid][2] for frame in frames] == ["A", "A", "A", "B", "B"]
    assert frames[3].bonds.types == ["B-C"]
    assert ["".join(frame["species"]) for frame in parsed_xyz(tmp_path / "a.xyz")] == ["CCACC", "CCACC", "CCBCC", "CCBCC"]
    for source, state, pair in ((scene, None, (1, 2)), (built, None, (1, 2)), (built, simulation.context, (3, 4))):
        write_pdb(tmp_path / "a.pdb", source, state=state)
        assert "CONECT{:5d}{:5d}\n".format(*pair) in (tmp_path / "a.pdb").read_text()
    assert [(a.index, b.index) for a, b in built.topology.bonds()] == [(0, 1)]
    other = openmm.Context(built.system, openmm.VerletIntegrator(0.001), openmm.Platform.getPlatform("Reference"))
    for write in (write_gsd, write_xyz, write_pdb):
        with pytest.raises(ParameterError, match="state=simulation.context"):
            write(tmp_path / "b", built, state=simulation.context.getState(positions=True))
        with pytest.raises(ParameterError, match="has no bonds that form and break"):
            write(tmp_path / "b", built, state=other)
