"""Topology and PDB files of molecules: residues are molecules, bonds, angles and dihedrals are not lost, and all formats name beads alike."""

import mdtraj
import numpy as np
import openmm
import pytest
from cases import cases, raises
from openmm import app, unit
from random_scenes import MASSES, PAIRS, TILTED, random_scene

import openmm_dpd as dpd
from openmm_dpd.molecules import CosineBend, Spring, Twist, bead, linear, pack
from openmm_dpd.outputs import write_pdb
from openmm_dpd.trajectory import load_topology, openmm_topology, read_psf, write_psf

CHAIN = linear("A3B", Spring(50.0, 0.7), CosineBend(2.0), twist=Twist(1.0, -1, 2), name="DIBLOCK", charges=[0.5, 0, 0, -0.5])


@pytest.fixture
def mixture():
    return pack({CHAIN: 3, bead("Na", charge=1): 2}, box=[3.0] * 3, seed=1)


def test_psf_comes_back(mixture, tmp_path):
    """Also in mdtraj, with molecules as residues, and by OpenMM's own reader, in the sections where they belong."""
    mixture.write_psf(tmp_path / "all.psf", masses={"A": 1.0, "B": 2.5, "Na": 1.0, "W": 1 / 3})
    beads = read_psf(tmp_path / "all.psf")
    assert beads.names == mixture.types and beads.residues == mixture.residues
    assert np.array_equal(beads.bonds, mixture.bond_pairs) and np.array_equal(beads.angles, mixture.angle_triples)
    assert np.array_equal(beads.dihedrals, mixture.dihedral_quads) and len(beads.dihedrals)
    assert np.array_equal(beads.charges, mixture.charges) and np.array_equal(beads.molecules, mixture.molecules)
    assert beads.masses[3] == 2.5 and beads.masses[-1] == 1 / 3
    for topology in (load_topology(tmp_path / "all.psf"), mdtraj.load_psf(tmp_path / "all.psf")):
        residues = list(topology.residues)
        assert [residue.name for residue in residues[:6]] == ["DIBLOCK"] * 3 + ["Na"] * 2 + ["W"]
        assert [residue.n_atoms for residue in residues[:6]] == [4, 4, 4, 1, 1, 1] and len(residues) == 5 + mixture.count("W")
        assert [(a.index, b.index) for a, b in topology.bonds] == [tuple(pair) for pair in mixture.bond_pairs.tolist()]
    psf = app.CharmmPsfFile(str(tmp_path / "all.psf"))
    assert [(b.atom1.idx, b.atom2.idx) for b in psf.bond_list] == [tuple(pair) for pair in mixture.bond_pairs.tolist()]
    found = [(a.atom1.idx, a.atom2.idx, a.atom3.idx) for a in psf.angle_list]
    assert found == [tuple(triple) for triple in mixture.angle_triples.tolist()]
    found = [(d.atom1.idx, d.atom2.idx, d.atom3.idx, d.atom4.idx) for d in psf.dihedral_list]
    assert found == [tuple(quad) for quad in mixture.dihedral_quads.tolist()]


def test_pdb_of_a_scene(mixture, tmp_path):
    """OpenMM's topology carries the names of molecules, and a PDB file of it opens in mdtraj with bonds."""
    with pytest.warns(UserWarning, match="8 charged beads, but the scene has no `electrostatics`"):
        scene = mixture.scene(pairs={("*", "*"): dpd.DPD(A=25.0, gamma=4.5)}, kT=1.0)
    built = dpd.build(scene, dt=0.02, platform="Reference", seed=1)
    assert [atom.residue.name for atom in built.topology.atoms()] == mixture.residues
    with open(tmp_path / "all.pdb", "w") as file:
        app.PDBFile.writeFile(built.topology, built.positions, file, keepIds=True)
    trajectory = mdtraj.load_pdb(str(tmp_path / "all.pdb"))
    assert trajectory.n_atoms == mixture.n_beads and trajectory.topology.n_bonds == len(mixture.bond_pairs)
    assert np.allclose(trajectory.xyz[0], built.positions.value_in_unit(unit.nanometer), atol=1e-3)


def test_files_without_names_and_with_many_angles(tmp_path):
    write_psf(tmp_path / "plain.psf", names=["A", "B", "A"], masses=[1.0] * 3, bonds=[(0, 1)])
    beads = read_psf(tmp_path / "plain.psf")
    assert beads.residues == ["MOL"] * 3 and beads.angles.shape == (0, 3)
    text = (tmp_path / "plain.psf").read_text().replace("!NTHETA", "!NOTHING")
    (tmp_path / "less.psf").write_text(text)
    assert read_psf(tmp_path / "less.psf").angles.shape == (0, 3) and read_psf(tmp_path / "less.psf").dihedrals.shape == (0, 4)
    angles = [(k, k + 1, k + 2) for k in range(28)]
    write_psf(tmp_path / "long.psf", names=["A"] * 30, masses=[1.0] * 30, angles=angles)
    assert read_psf(tmp_path / "long.psf").angles.tolist() == [list(angle) for angle in angles]
    lines = (tmp_path / "long.psf").read_text().splitlines()
    start = next(k for k, line in enumerate(lines) if "!NTHETA" in line)
    assert len(lines[start + 1].split()) == 9


@cases(
    "given, message",
    ({"angles": [(0, 1, 5)]}, "angle 0 is .0, 1, 5.; it must join three different beads of 0 to 2"),
    ({"angles": [(0, 1, 0)]}, "three different"),
    ({"angles": [(0, 1)]}, "triples"),
    ({"dihedrals": [(0, 1, 2, 5)]}, "dihedral 0 is .0, 1, 2, 5.; it must join four different beads of 0 to 2"),
    ({"residues": ["A"]}, "one name for each of the 3"),
    ({"residues": ["A", "B C", "D"]}, "name of a molecule, 'B C'"),
)
def test_bad_topologies(tmp_path, given, message):
    raises(dpd.ParameterError, message, lambda: write_psf(tmp_path / "bad.psf", names=["A"] * 3, masses=[1.0] * 3, **given))


def test_bad_residues():
    raises(dpd.ParameterError, "one name for each of the 2", lambda: openmm_topology(["A", "A"], residues=["X"]))
    with pytest.raises(dpd.ParameterError, match="name the molecule of each of the 2 beads"):
        dpd.Scene({"A": 1}, ["A"] * 2, np.zeros((2, 3)), {("A", "A"): dpd.DPD(A=1, gamma=1)}, kT=1.0, residues="AA")


def test_one_naming(tmp_path):
    """Topology, PSF, PDB and mdtraj: names of beads and of molecules, molecules as residues, one chain, all bonds."""
    chain = linear("A3B", Spring(50.0, 0.7), CosineBend(2.0), name="OIL")
    mixture = pack({chain: 3, bead("Na"): 2}, box=[3.0] * 3, seed=1)
    built = dpd.build(mixture.scene(pairs=PAIRS, kT=1.0), dt=0.01, platform="Reference", seed=3)
    mixture.write_psf(tmp_path / "x.psf")
    write_pdb(tmp_path / "x.pdb", built)
    ours, psf, pdb = built.topology, load_topology(tmp_path / "x.psf"), mdtraj.load(tmp_path / "x.pdb").topology
    assert [atom.name for atom in ours.atoms()] == [atom.name for atom in psf.atoms] == [atom.name for atom in pdb.atoms] == mixture.types
    named = [(residue.name, len(list(residue.atoms()))) for residue in ours.residues()]
    assert named == [(r.name, r.n_atoms) for r in psf.residues] == [(r.name, r.n_atoms) for r in pdb.residues] and named[0] == ("OIL", 4)
    assert [int(residue.id) for residue in ours.residues()] == [r.resSeq for r in psf.residues] == [r.resSeq for r in pdb.residues]
    assert [c.id for c in ours.chains()] == [c.chain_id for c in psf.chains] == [c.chain_id for c in pdb.chains] == ["A"]
    assert {r.segment_id for r in psf.residues} == {r.segment_id for r in pdb.residues} == {"DPD"}
    bonds = [sorted((a.index, b.index)) for a, b in ours.bonds()]
    for topology in (psf, pdb):
        assert sorted(sorted((a.index, b.index)) for a, b in topology.bonds) == sorted(bonds)
    assert {atom.element.symbol for atom in pdb.atoms} == {"VS"}


def test_residues_with_names_of_amino_acids_keep_their_bonds(tmp_path):
    bonds = [dpd.HarmonicBonds([(0, k) for k in range(1, 8)], k=1.0, r0=0.5)]
    scene = dpd.Scene(MASSES, ["C"] * 8, np.random.default_rng(1).random((8, 3)), PAIRS, kT=1, bonds=bonds, residues=["ALA"] * 8)
    write_pdb(tmp_path / "x.pdb", scene)
    found = mdtraj.load(tmp_path / "x.pdb")
    assert {tuple(sorted((a.index, b.index))) for a, b in found.topology.bonds} == {(0, k) for k in range(1, 8)}
    assert found.unitcell_vectors is None and {atom.element.mass for atom in found.topology.atoms} == {0.0}


def test_long_names_are_listed(tmp_path):
    names = ["solvent", "solvate", "Na+"]
    scene = dpd.Scene(dict.fromkeys(names, 1), names, np.zeros((3, 3)), PAIRS, kT=1, residues=["DIBLOCK", "DIBLOCKS", "W"])
    write_pdb(tmp_path / "x.pdb", scene)
    text = (tmp_path / "x.pdb").read_text(encoding="utf-8")
    for words in ("BEAD solvate IS CALLED sol1", "MOLECULE DIBLOCKS IS CALLED DI1"):
        assert f"REMARK   2 {words}\n" in text
    atoms = list(mdtraj.load(tmp_path / "x.pdb").topology.atoms)
    assert [(atom.name, atom.residue.name) for atom in atoms] == [("solv", "DIB"), ("sol1", "DI1"), ("Na+", "W")]


def test_tilted_boxes_and_openmm(tmp_path):
    write_pdb(tmp_path / "x.pdb", random_scene(3))
    np.testing.assert_allclose(mdtraj.load(tmp_path / "x.pdb").unitcell_vectors[0], TILTED, atol=2e-3)
    single = dpd.Scene({"B": 1}, ["B"] * 3, np.eye(3), {("B", "B"): dpd.NONE}, kT=1, box=[4, 5, 6])
    write_pdb(tmp_path / "y.pdb", single)
    pdb = app.PDBFile(str(tmp_path / "y.pdb"), extraParticleIdentifier="VS")
    assert {atom.element for atom in pdb.topology.atoms()} == {None}
    assert pdb.topology.getUnitCellDimensions() == openmm.Vec3(4, 5, 6) * unit.nanometer


@pytest.mark.parametrize(
    ("x", "count", "message"),
    [(-100.0, 1, "bead 0 is at x = -100 nm"), (1000.0, 2, "bead 0 is at x = 1000 nm"), (0.0, 100_000, "at most 99999 beads")],
)
def test_what_does_not_fit_into_a_pdb_file(tmp_path, x, count, message):
    scene = dpd.Scene({"B": 1}, ["B"] * count, np.full((count, 3), x), PAIRS, kT=1)
    raises(dpd.ParameterError, message, lambda: write_pdb(tmp_path / "x.pdb", scene))


def test_molecule_numbers_wrap(tmp_path):
    n = 10_002
    scene = dpd.Scene({"B": 1}, ["B"] * n, np.random.default_rng(1).random((n, 3)), PAIRS, kT=1)
    write_pdb(tmp_path / "x.pdb", scene)
    topology = mdtraj.load(tmp_path / "x.pdb").topology
    assert topology.n_atoms == topology.n_residues == n and [r.resSeq for r in topology.residues][-4:] == [9999, 0, 1, 2]
