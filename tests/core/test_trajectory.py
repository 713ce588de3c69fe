"""Topology files and mdtraj: every bead keeps its name, mass, charge and bonds."""

import copy
import pickle
import subprocess
import sys

import mdtraj as md
import numpy as np
import openmm
import pytest
from cases import cases, put, raises
from mdtraj.core.element import Element
from openmm import app, unit

from openmm_dpd.base.errors import ParameterError
from openmm_dpd.trajectory import (
    bead_charges,
    bead_element,
    bead_masses,
    compute_rg,
    load,
    load_topology,
    openmm_topology,
    read_psf,
    short_names,
    write_psf,
)

MASS = {"A": 1.0, "B": 1 / 3, "C": 12.5, "W": 54.0}


def scene(beads: int, seed: int = 11):
    """Names, masses, charges and bonds of chains of four over types that are, or look like, chemical elements."""
    rng = np.random.default_rng(seed)
    names = [str(name) for name in np.array(list(MASS))[rng.integers(0, len(MASS), beads)]]
    masses = np.array([MASS[name] for name in names])
    charges = rng.integers(-2, 3, beads) * 0.25
    first = np.arange(0, beads - 3, 8)
    return names, masses, charges, np.concatenate([np.stack([first + k, first + k + 1], axis=1) for k in range(3)])


@pytest.fixture
def psf(tmp_path):
    names, masses, charges, bonds = scene(48)
    write_psf(tmp_path / "top.psf", names=names, masses=masses, charges=charges, bonds=bonds)
    return tmp_path / "top.psf"


@pytest.fixture
def trajectory(psf):
    xyz = np.random.default_rng(5).uniform(-3, 12, (6, 48, 3)).astype(np.float32)
    return md.Trajectory(xyz, load_topology(psf), unitcell_lengths=np.full((6, 3), 9.0), unitcell_angles=np.full((6, 3), 90.0))


# -- PSF and load_topology -------------------------------------------------------------------------------------------------------
@pytest.mark.parametrize("beads", [48, pytest.param(100_003, marks=pytest.mark.slow)])
def test_everything_comes_back(tmp_path, beads):
    """Names, masses (all digits), charges, molecules and bonds, also where indices have six digits."""
    names, masses, charges, bonds = scene(beads)
    masses = masses + np.arange(beads) % 7 / 7  # also masses of single beads
    write_psf(tmp_path / "top.psf", names=names, masses=masses, charges=charges, bonds=bonds)
    topology = load_topology(tmp_path / "top.psf")
    assert [atom.name for atom in topology.atoms] == names
    assert np.array_equal(bead_masses(topology), masses)
    assert np.array_equal(bead_charges(topology), charges)
    assert [(a.index, b.index) for a, b in topology.bonds] == [tuple(pair) for pair in bonds.tolist()]
    assert [atom.index for atom in topology.atoms] == list(range(beads))
    assert topology.n_residues == beads - len(bonds)  # chains and single beads, no rings
    assert np.array_equal(read_psf(tmp_path / "top.psf").bonds, bonds)


def test_centre_of_mass_and_inertia(trajectory):
    """Against numpy; mdtraj's own elements (hydrogen, nothing, carbon, manganese for these masses) would be off by a lot."""
    _, masses, _, _ = scene(48)
    x = trajectory.xyz.astype(np.float64)
    centre = (masses[:, None] * x).sum(axis=1) / masses.sum()
    assert np.allclose(md.compute_center_of_mass(trajectory), centre, atol=1e-12, rtol=0)
    moved = x - centre[:, None]
    square = (moved**2).sum(axis=2)
    inertia = np.einsum("i,fi,ab->fab", masses, square, np.eye(3)) - np.einsum("i,fia,fib->fab", masses, moved, moved)
    assert np.allclose(md.compute_inertia_tensor(trajectory), inertia, rtol=1e-5)
    assert np.allclose(compute_rg(trajectory), np.sqrt((masses * square).sum(axis=1) / masses.sum()), rtol=1e-12)
    about = ((x - x.mean(axis=1, keepdims=True)) ** 2).sum(axis=2)  # mdtraj's own Rg takes the distances from the geometric centre
    expected = np.sqrt((masses * about).sum(axis=1) / masses.sum())
    assert np.allclose(md.compute_rg(trajectory, masses=bead_masses(trajectory.topology)), expected, rtol=1e-5)


def test_centre_of_mass_of_100003_beads(tmp_path):
    names, masses, _, _ = scene(100_003)
    write_psf(tmp_path / "top.psf", names=names, masses=masses)
    xyz = np.random.default_rng(6).uniform(0, 30, (1, 100_003, 3)).astype(np.float32)
    md.Trajectory(xyz, None).save_dcd(tmp_path / "run.dcd")
    loaded = load(tmp_path / "run.dcd", tmp_path / "top.psf")
    expected = (masses[:, None] * xyz[0].astype(np.float64)).sum(axis=0) / masses.sum()
    # DCD holds float32 angstrom: 30 nm * 1e-7, averaged
    assert np.allclose(md.compute_center_of_mass(loaded)[0], expected, atol=1e-6, rtol=0)
    centred = xyz[0] - expected
    assert compute_rg(loaded)[0] == pytest.approx(np.sqrt((masses * (centred**2).sum(axis=1)).sum() / masses.sum()), rel=1e-6)


def test_registry_is_untouched(psf):
    """mdtraj's own reader replaces masses by those of the nearest elements; ours adds none to its table."""
    symbols, numbers = dict(Element._elements_by_symbol), dict(Element._elements_by_atomic_number)
    load_topology(psf)
    assert Element._elements_by_symbol == symbols
    assert Element._elements_by_atomic_number == numbers
    assert md.element.boron.mass == pytest.approx(10.81, abs=0.01)
    found = {atom.name: atom.element.mass for atom in md.load_psf(psf).atoms}
    assert found["B"] == 0.0
    assert found["W"] == pytest.approx(54.938, abs=1e-3)


def test_equality_hash_copy_pickle(psf):
    topology = load_topology(psf)
    for other in (load_topology(psf), topology.copy(), copy.deepcopy(topology), pickle.loads(pickle.dumps(topology))):
        assert other == topology
        assert hash(other) == hash(topology)
        assert np.array_equal(bead_masses(other), bead_masses(topology))
    element = topology.atom(0).element
    for again in (pickle.loads(pickle.dumps(element)), copy.copy(element), copy.deepcopy(element)):
        assert again is element
    assert bead_element("A", 1.0) == bead_element("A", 1)
    assert bead_element("A", 1.0) != bead_element("A", 2.0) != bead_element("B", 2.0)
    assert bead_element("A", 1.0, 0.5).charge == 0.5


def test_subset_join_stack_and_slices(trajectory):
    _, masses, charges, _ = scene(48)
    part = trajectory.atom_slice([3, 10, 11, 40])
    assert np.array_equal(bead_masses(part.topology), masses[[3, 10, 11, 40]])
    assert np.array_equal(bead_charges(part.topology), charges[[3, 10, 11, 40]])
    assert md.join([trajectory[:2], trajectory[2:]]).n_frames == 6
    assert np.array_equal(bead_masses(trajectory.stack(trajectory).topology), np.tile(masses, 2))
    names = [atom.name for atom in trajectory.topology.atoms]
    assert trajectory.topology.select("name B").tolist() == [k for k, name in enumerate(names) if name == "B"]
    assert trajectory.topology.select("mass > 10").tolist() == np.flatnonzero(masses > 10).tolist()


@pytest.mark.parametrize("suffix", [".dcd", ".xtc"])
def test_load(trajectory, psf, tmp_path, suffix):
    """Lengths in nm after a round trip (XTC keeps 0.001 nm), box included; stride, atoms and frame."""
    path = tmp_path / f"run{suffix}"
    trajectory.save(path)
    loaded = load(path, psf)
    assert loaded.topology == trajectory.topology
    assert np.allclose(loaded.xyz, trajectory.xyz, atol=1e-5 if suffix == ".dcd" else 6e-4, rtol=0)
    assert np.allclose(loaded.unitcell_lengths, 9.0)
    assert load(path, trajectory.topology, stride=2).n_frames == 3
    assert load(path, psf, frame=4).n_frames == 1
    raises(ParameterError, r"has no frame 17|, frame 17, cannot be read", lambda: load(path, psf, frame=17))
    raises(ParameterError, "the number of a frame must be at least 0", lambda: load(path, psf, frame=-1))
    raises(ParameterError, "stride must be at least 1", lambda: load(path, psf, stride=0))
    assert np.array_equal(bead_masses(load(path, psf, atom_indices=[2, 5]).topology), scene(48)[1][[2, 5]])


def test_load_says_what_does_not_fit(trajectory, psf, tmp_path):
    """mdtraj's own PDB file of such a trajectory reads back without masses rather than with wrong ones."""
    trajectory.atom_slice(range(40)).save_dcd(tmp_path / "run.dcd")
    raises(ParameterError, r"run\.dcd cannot be read with a topology of 48 beads", lambda: load(tmp_path / "run.dcd", psf))
    raises(ParameterError, r"must be a \.dcd or \.xtc file", lambda: load(tmp_path / "run.trr", psf))
    trajectory[0].save_pdb(tmp_path / "out.pdb")
    assert {atom.element.mass for atom in md.load_pdb(tmp_path / "out.pdb").topology.atoms} == {0.0}


def test_molecules(tmp_path):
    """Given molecules are residues; beads of one molecule that are apart make two, since atoms stay in order."""
    write_psf(tmp_path / "top.psf", names=["A"] * 6, masses=np.ones(6), molecules=[7, 7, 0, 0, 7, 9])
    topology = load_topology(tmp_path / "top.psf")
    assert [(residue.resSeq, residue.n_atoms) for residue in topology.residues] == [(7, 2), (0, 2), (7, 1), (9, 1)]
    # bonded beads are a molecule if nothing is given
    write_psf(tmp_path / "top.psf", names=["A"] * 6, masses=np.ones(6), bonds=[(4, 3), (3, 2)])
    assert read_psf(tmp_path / "top.psf").molecules.tolist() == [1, 2, 3, 3, 3, 4]


def test_names_of_elements_ions_and_any_length(tmp_path):
    names = ["CLA", "SOD", "1", "solvent_bead_of_type_3", "O", "Na+", "!x"]
    write_psf(tmp_path / "top.psf", names=names, masses=np.arange(7) + 0.5, charges=np.full(7, -1.2345678901234567e-5))
    topology = load_topology(tmp_path / "top.psf")
    assert [atom.name for atom in topology.atoms] == names
    assert np.array_equal(bead_masses(topology), np.arange(7) + 0.5)
    assert set(bead_charges(topology)) == {-1.2345678901234567e-5}
    assert [atom.name for atom in md.load_psf(tmp_path / "top.psf").atoms] == names
    write_psf(tmp_path / "top.psf", names=["A"], masses=[2.0] * unit.dalton, charges=[1.0] * unit.elementary_charge)
    assert bead_masses(load_topology(tmp_path / "top.psf")).tolist() == [2.0]


@cases(
    "change, message",
    ({"names": ["A", "B C"]}, "'B C' cannot be in a PSF file"),
    ({"names": ["A", ""]}, "'' cannot be"),
    ({"masses": [1.0]}, "masses must have one entry for each of the 2 names"),
    ({"masses": [1.0, -2.0]}, "bead 1 has the mass -2"),
    ({"masses": [1.0, np.nan]}, "masses holds nan"),
    ({"charges": [1.0, 2.0, 3.0]}, "charges must have one entry"),
    ({"bonds": [(0, 2)]}, r"bond 0 is \[0, 2\]"),
    ({"bonds": [(0, 1), (1, 1)]}, r"bond 1 is \[1, 1\]"),
    ({"bonds": [0, 1]}, "pairs of bead indices"),
    ({"bonds": [(0, 1), (1,)]}, "differ in length"),
    ({"molecules": [1, -1]}, "bead 1 has the molecule number -1"),
    ({"molecules": [0.5, 1.0]}, "one integer"),
)
def test_what_cannot_be_written(tmp_path, change, message):
    raises(ParameterError, message, lambda: write_psf(tmp_path / "top.psf", **({"names": ["A", "B"], "masses": [1.0, 1.0]} | change)))
    assert not (tmp_path / "top.psf").exists()


def test_broken_files_name_the_line(psf):
    lines = psf.read_text().splitlines()
    raises(ParameterError, "not a PSF file", lambda: load_topology(put(psf, "CRYST1\n")))
    number = next(k for k, line in enumerate(lines) if "!NATOM" in line)
    broken = [*lines]
    broken[number + 3] = broken[number + 3][:40]
    psf.write_text("\n".join(broken))
    raises(ParameterError, rf"top\.psf:{number + 4}: cannot read bead 3 of 48", lambda: load_topology(psf))
    raises(ParameterError, "no readable !NBOND section", lambda: load_topology(put(psf, "\n".join(lines[: number + 50]))))


# -- OpenMM ------------------------------------------------------------------------------------------------------------------------
def test_short_names_stay_different():
    names = short_names(["solvent", "sol", "solute", "a-b", "ab", "\u03b1", "s2", "Na+", "a b", "solv"], 4)
    assert names["sol"] == "sol" and names["Na+"] == "Na+" and names["solv"] == "solv" and names["a-b"] == "a-b"
    assert len(set(names.values())) == 10
    assert all(1 <= len(short) <= 4 and short.isascii() and short.isprintable() and " " not in short for short in names.values())
    many = short_names([f"bead{k}" for k in range(2000)], 4)
    assert len(set(many.values())) == 2000 and max(map(len, many.values())) == 4


def test_openmm_topology():
    topology = openmm_topology(["A", "B", "B", "W"], [3, 3, 4, 4], [(1, 0), (2, 3)], [5.0, 6.0, 7.0])
    expected = [("A", None, "3"), ("B", None, "3"), ("B", None, "4"), ("W", None, "4")]
    assert [(atom.name, atom.element, atom.residue.id) for atom in topology.atoms()] == expected
    assert [residue.id for residue in topology.residues()] == ["3", "4"]
    assert [(a.index, b.index) for a, b in topology.bonds()] == [(1, 0), (2, 3)]
    assert topology.getUnitCellDimensions().value_in_unit(unit.nanometer) == openmm.Vec3(5, 6, 7)
    assert openmm_topology(["A"]).getPeriodicBoxVectors() is None
    # molecules are residues, as in PSF files
    assert [residue.id for residue in openmm_topology(["A", "B", "A", "W", "A"], [1, 1, 1, 2, 2]).residues()] == ["1", "2"]
    raises(ParameterError, r"bond 0 is \[0, 1\]", lambda: openmm_topology(["A"], bonds=[(0, 1)]))


def test_reporters_and_pdb(tmp_path):
    """DCD, XTC and PDB from a Simulation: mdtraj finds names and bonds, and all masses through load."""
    names, masses, _, bonds = scene(24)
    topology = openmm_topology(names, None, bonds, np.diag([6.0, 6.0, 6.0]))
    system = openmm.System()
    for mass in masses:
        system.addParticle(mass)
    system.setDefaultPeriodicBoxVectors(*topology.getPeriodicBoxVectors())
    simulation = app.Simulation(topology, system, openmm.VerletIntegrator(0.001), openmm.Platform.getPlatform("Reference"))
    positions = np.random.default_rng(2).uniform(0, 6, (24, 3))
    simulation.context.setPositions(positions)
    write_psf(tmp_path / "top.psf", names=names, masses=masses, bonds=bonds)
    files = {suffix: tmp_path / f"run.{suffix}" for suffix in ("dcd", "xtc", "pdb")}
    kinds = {"dcd": app.DCDReporter, "xtc": app.XTCReporter, "pdb": app.PDBReporter}
    simulation.reporters = [kinds[suffix](str(path), 1, enforcePeriodicBox=False) for suffix, path in files.items()]
    simulation.step(2)
    simulation.reporters.clear()  # closes the files
    for suffix in ("dcd", "xtc"):
        loaded = load(files[suffix], tmp_path / "top.psf")
        assert np.allclose(loaded.xyz[1], positions, atol=1e-3)
        assert np.array_equal(bead_masses(loaded.topology), masses)
    pdb = md.load_pdb(files["pdb"])
    assert [atom.name for atom in pdb.topology.atoms] == names
    assert {tuple(sorted((a.index, b.index))) for a, b in pdb.topology.bonds} == {tuple(pair) for pair in bonds.tolist()}
    assert pdb.n_frames == 2


def test_openmm_reads_molecules_of_different_beads(tmp_path):
    """Its readers distinguish the atoms of a residue by their names."""
    names, bonds = ["A", "B", "C", "W", "W"], [(0, 1), (1, 2)]
    topology = openmm_topology(names, None, bonds, np.diag([6.0, 6.0, 6.0]))
    positions = np.random.default_rng(2).uniform(0, 6, (5, 3)) * unit.nanometer
    for writer, name in ((app.PDBFile, "run.pdb"), (app.PDBxFile, "run.cif")):
        with open(tmp_path / name, "w", encoding="utf-8") as file:
            writer.writeFile(topology, positions, file)
        read = writer(str(tmp_path / name)).topology
        assert [atom.name for atom in read.atoms()] == names and {atom.element for atom in read.atoms()} == {None}
        assert [(a.index, b.index) for a, b in read.bonds()] == bonds and read.getNumResidues() == 3


def test_import_does_not_load_mdtraj():
    code = "import sys, openmm_dpd.trajectory; sys.exit('mdtraj' in sys.modules)"
    assert subprocess.run([sys.executable, "-c", code], check=False).returncode == 0
