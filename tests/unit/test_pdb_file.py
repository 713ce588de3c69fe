"""PDB files of beads, and one naming of beads in all formats."""

import mdtraj
import numpy as np
import openmm
import pytest
from openmm import app, unit
from random_scenes import MASSES, PAIRS, TILTED, random_scene

import openmm_dpd as dpd
from openmm_dpd.molecules import CosineBend, Spring, bead, linear, pack
from openmm_dpd.outputs import write_pdb
from openmm_dpd.trajectory import load_topology


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
    [(-100.0, 1, "bead 0 is at x = -100 nm"), (1000.0, 2, "bead 0 is at x = 1000 nm"), (0.0, 100_000, "up to 99999 beads")],
)
def test_what_does_not_fit_into_a_pdb_file(tmp_path, x, count, message):
    scene = dpd.Scene({"B": 1}, ["B"] * count, np.full((count, 3), x), PAIRS, kT=1)
    with pytest.raises(dpd.ParameterError, match=message):
        write_pdb(tmp_path / "x.pdb", scene)


def test_molecule_numbers_wrap(tmp_path):
    n = 10_002
    scene = dpd.Scene({"B": 1}, ["B"] * n, np.random.default_rng(1).random((n, 3)), PAIRS, kT=1)
    write_pdb(tmp_path / "x.pdb", scene)
    topology = mdtraj.load(tmp_path / "x.pdb").topology
    assert topology.n_atoms == topology.n_residues == n and [r.resSeq for r in topology.residues][-4:] == [9999, 0, 1, 2]
