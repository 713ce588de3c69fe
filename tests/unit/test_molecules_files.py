"""Topology files of packed molecules: residues are molecules with names, bonds, angles and dihedrals are not lost."""

import mdtraj
import numpy as np
import pytest
from cases import cases, raises
from openmm import app, unit

import openmm_dpd as dpd
from openmm_dpd.molecules import CosineBend, Spring, Twist, bead, linear, pack
from openmm_dpd.trajectory import load_topology, openmm_topology, read_psf, write_psf

CHAIN = linear("A3B", Spring(50.0, 0.7), CosineBend(2.0), twist=Twist(1.0, -1, 2), name="DIBLOCK", charges=[0.5, 0, 0, -0.5])


@pytest.fixture
def mixture():
    return pack({CHAIN: 3, bead("Na", charge=1): 2}, box=[3.0] * 3, seed=1)


def test_psf_comes_back(mixture, tmp_path):
    mixture.write_psf(tmp_path / "all.psf", masses={"A": 1.0, "B": 2.5, "Na": 1.0, "W": 1 / 3})
    beads = read_psf(tmp_path / "all.psf")
    assert beads.names == mixture.types and beads.residues == mixture.residues
    assert np.array_equal(beads.bonds, mixture.bond_pairs) and np.array_equal(beads.angles, mixture.angle_triples)
    assert np.array_equal(beads.dihedrals, mixture.dihedral_quads) and len(beads.dihedrals)
    assert np.array_equal(beads.charges, mixture.charges) and np.array_equal(beads.molecules, mixture.molecules)
    assert beads.masses[3] == 2.5 and beads.masses[-1] == 1 / 3


def test_mdtraj_has_molecules_as_residues(mixture, tmp_path):
    mixture.write_psf(tmp_path / "all.psf")
    for topology in (load_topology(tmp_path / "all.psf"), mdtraj.load_psf(tmp_path / "all.psf")):
        residues = list(topology.residues)
        assert [residue.name for residue in residues[:6]] == ["DIBLOCK"] * 3 + ["Na"] * 2 + ["W"]
        assert [residue.n_atoms for residue in residues[:6]] == [4, 4, 4, 1, 1, 1] and len(residues) == 5 + mixture.count("W")
        assert [(a.index, b.index) for a, b in topology.bonds] == [tuple(pair) for pair in mixture.bond_pairs.tolist()]


def test_openmm_reads_bonds_angles_and_dihedrals(mixture, tmp_path):
    """OpenMM's own reader of PSF files finds them in the sections where they belong."""
    mixture.write_psf(tmp_path / "all.psf")
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


def test_files_without_names_are_as_before(tmp_path):
    write_psf(tmp_path / "plain.psf", names=["A", "B", "A"], masses=[1.0] * 3, bonds=[(0, 1)])
    beads = read_psf(tmp_path / "plain.psf")
    assert beads.residues == ["MOL"] * 3 and beads.angles.shape == (0, 3)
    text = (tmp_path / "plain.psf").read_text().replace("!NTHETA", "!NOTHING")
    (tmp_path / "less.psf").write_text(text)
    assert read_psf(tmp_path / "less.psf").angles.shape == (0, 3) and read_psf(tmp_path / "less.psf").dihedrals.shape == (0, 4)


def test_many_angles_fill_lines(tmp_path):
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
