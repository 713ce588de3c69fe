"""Rings and the bonds through them: planted ones are found, all and only these; whoever is beside a ring is left alone."""

from pathlib import Path

import numpy as np
import pytest
from cases import raises
from openmm import app, unit
from scipy.spatial.transform import Rotation

from openmm_dpd.base.errors import ParameterError
from openmm_dpd.molecules import find_piercings
from openmm_dpd.molecules.piercings import bonds_of_topology, crossings, pushed_out, small_rings

SHIPPED = Path(app.__file__).parent / "data"
BOND = 0.15


def polygon(n: int) -> np.ndarray:
    """A flat ring in the xy plane with bonds of 0.15 nm."""
    angle = 2 * np.pi * np.arange(n) / n
    return BOND / (2 * np.sin(np.pi / n)) * np.column_stack([np.cos(angle), np.sin(angle), 0 * angle])


def zigzag(n: int) -> np.ndarray:
    """A chain along z whose middle bond has its middle at the origin."""
    z = (np.arange(n) - (n - 1) / 2) * 0.125
    return np.column_stack([0.04 * (-1.0) ** np.arange(n), 0 * z, z])


def topology_of(molecules: list[tuple[str, np.ndarray, bool]], box) -> tuple[app.Topology, np.ndarray]:
    """Molecules with bonds in a row, closed or not."""
    topology = app.Topology()
    for name, x, closed in molecules:
        residue = topology.addResidue(name, topology.addChain())
        atoms = [topology.addAtom(f"C{k}", app.element.carbon, residue) for k in range(len(x))]
        for one, other in zip(atoms, atoms[1:] + atoms[: int(closed)], strict=False):
            topology.addBond(one, other)
    topology.setPeriodicBoxVectors(None if box is None else box * unit.nanometer)
    return topology, np.concatenate([x for _, x, _ in molecules])


BOXES = {"none": None, "orthorhombic": np.diag([3.0, 3.2, 3.4]), "triclinic": np.array([[3.0, 0, 0], [1.2, 3.0, 0], [-1.1, 1.3, 3.0]])}


def ten_rings(box: np.ndarray | None, shift: np.ndarray, seed: int):
    """Rings of three to eight atoms, turned at random far from each other, each with a chain; the bond that is in the middle."""
    rng = np.random.default_rng(seed)
    molecules, planted = [], []
    first = 0
    for k in range(10):
        size, length = 3 + k % 6, 4 + 2 * (k % 3)
        turn, place = Rotation.random(random_state=rng), np.array([k % 2, k // 2 % 2, k // 4]) * 1.4 + 0.05 * rng.random(3)
        molecules.append(("RING", turn.apply(polygon(size)) + place, True))
        molecules.append(("CHAIN", turn.apply(zigzag(length) + shift) + place, False))
        middle = first + size + length // 2 - 1
        planted.append((frozenset(range(first, first + size)), (middle, middle + 1)))
        first += size + length
    topology, x = topology_of(molecules, box)
    return topology, x, planted


@pytest.mark.parametrize("kind", BOXES)
def test_planted_piercings_are_found(kind):
    """In any box, wherever its faces are, and with atoms wrapped one by one."""
    box = BOXES[kind]
    topology, x, planted = ten_rings(box, np.array([0.01, 0.005, 0.02]), seed=3)
    places = [x]
    if box is not None:
        moved = x + np.array([1.3, 2.2, 0.6])
        s = moved @ np.linalg.inv(box)
        places += [moved, (s - np.floor(s)) @ box, (s + np.random.default_rng(1).integers(-2, 3, s.shape)) @ box]
    for positions in places:
        found = find_piercings(topology, positions)
        assert sorted((sorted(one.ring), one.bond) for one in found) == sorted((sorted(ring), bond) for ring, bond in planted)


@pytest.mark.parametrize("kind", BOXES)
def test_chains_beside_rings_are_not(kind):
    """Chains that pass a ring just outside of its edge, and such that end before its plane."""
    topology, x, _ = ten_rings(BOXES[kind], np.array([0.34, 0, 0.02]), seed=3)
    assert find_piercings(topology, x) == []
    topology, x, _ = ten_rings(BOXES[kind], np.array([0, 0, 0.8]), seed=3)
    assert find_piercings(topology, x) == []


def test_none_in_a_good_structure():
    """A protein that OpenMM ships."""
    pdb = app.PDBFile(str(SHIPPED / "test.pdb"))
    modeller = app.Modeller(pdb.topology, pdb.positions)
    modeller.deleteWater()
    rings = small_rings(bonds_of_topology(modeller.topology), modeller.topology.getNumAtoms(), 8)
    per_residue = {"PHE": 1, "TYR": 1, "TRP": 2, "HIS": 1, "PRO": 1}
    assert len(rings) == sum(per_residue.get(residue.name, 0) for residue in modeller.topology.residues()) > 5
    assert find_piercings(modeller.topology, modeller.positions) == []


def test_the_same_as_signed_volumes():
    """Hexagons and chains at random places: another test of segment and triangle, over all images."""
    rng = np.random.default_rng(5)
    box = np.array([[1.5, 0, 0], [0.4, 1.4, 0], [-0.3, 0.5, 1.6]])
    molecules = []
    for k in range(80):
        shape = polygon(6) if k % 2 else zigzag(7)
        molecules.append(("MOL", Rotation.random(random_state=rng).apply(shape) + rng.random(3) @ box, bool(k % 2)))
    topology, x = topology_of(molecules, box)
    bonds = bonds_of_topology(topology)

    def volume(a, b, c, d):
        return np.einsum("...k,...k->...", np.cross(b - a, c - a), d - a)

    shifts = np.array([[i, j, k] for i in range(-2, 3) for j in range(-2, 3) for k in range(-2, 3)]) @ box
    wanted = set()
    for first in range(7, len(x), 13):
        ring = x[first : first + 6]
        c = ring.mean(axis=0)
        p, q = x[bonds[:, 0]][:, None] + shifts, x[bonds[:, 1]][:, None] + shifts
        number, image = np.nonzero(np.linalg.norm(p - c, axis=2) < 0.5)  # a ring and a bond together are 0.3 nm long
        p, q = p[number, image], q[number, image]
        for a, b in zip(ring, np.roll(ring, -1, axis=0), strict=True):
            through = np.sign(volume(p, q, a, b)) + np.sign(volume(p, q, b, c)) + np.sign(volume(p, q, c, a))
            apart = volume(a, b, c, p) * volume(a, b, c, q) < 0
            for k in number[apart & (np.abs(through) == 3)]:
                if not first <= bonds[k, 0] < first + 6:
                    wanted.add((first, tuple(bonds[k].tolist())))
    assert len(wanted) > 10
    assert {(min(one.ring), one.bond) for one in find_piercings(topology, x)} == wanted


def test_rings_of_a_graph():
    """Fused rings, a cage, a macrocycle, and what hangs on them."""
    naphthalene = np.array([*((k, (k + 1) % 6) for k in range(6)), (0, 6), (6, 7), (7, 8), (8, 9), (9, 1), (3, 10)])
    assert sorted(map(sorted, small_rings(naphthalene, 11, 8))) == [[0, 1, 2, 3, 4, 5], [0, 1, 6, 7, 8, 9]]
    cube = np.array([(i, i | b) for i in range(8) for b in (1, 2, 4) if not i & b])
    assert {len(ring) for ring in small_rings(cube, 8, 8)} == {4} and len(small_rings(cube, 8, 8)) == 6
    large = np.array([(k, (k + 1) % 12) for k in range(12)])
    assert small_rings(large, 12, 8) == [] and len(small_rings(large, 12, 12)[0]) == 12
    assert small_rings(np.array([(0, 1), (1, 2), (2, 3)]), 4, 8) == []
    for ring in small_rings(naphthalene, 11, 8):  # in the order of the bonds
        assert all({a, b} in [set(bond) for bond in naphthalene.tolist()] for a, b in zip(ring, ring[1:] + ring[:1], strict=True))


def test_a_large_ring_on_request():
    topology, x = topology_of([("RING", polygon(12), True), ("CHAIN", zigzag(6), False)], None)
    assert find_piercings(topology, x) == []
    (found,) = find_piercings(topology, x, max_ring=12)
    assert found.bond == (14, 15)
    ring = "the ring C0 C11 C10 C9 C8 C7 C6 C5 C4 C3 C2 C1 of RING 1 of chain 1"
    assert str(found) == f"the bond C2-C3 of CHAIN 2 of chain 2 passes through {ring}"


@pytest.mark.parametrize("turn", range(3))
@pytest.mark.parametrize("frozen", ["", "bonds", "rings", "both"])
def test_bonds_are_pushed_out(frozen, turn):
    """All ten at once; frozen atoms stay, and where both are frozen nothing happens."""
    box = BOXES["triclinic"]
    topology, x, planted = ten_rings(box, np.array([0.01, 0.005, 0.02]), seed=4)
    bonds, mobile = bonds_of_topology(topology), np.ones(len(x), dtype=bool)
    for ring, bond in planted:
        if frozen in ("bonds", "both"):
            mobile[list(bond)] = False
        if frozen in ("rings", "both"):
            mobile[list(ring)] = False
    rings = small_rings(bonds, len(x), 8)
    found = crossings(rings, bonds, x, box)
    assert len(found) == 10
    moved = pushed_out(x, found, bonds, box, mobile, turn=turn)
    assert np.array_equal(moved[~mobile], x[~mobile])
    assert len(crossings(rings, bonds, moved, box)) == (10 if frozen == "both" else 0)
    assert np.linalg.norm(moved - x, axis=1).max() < 0.6


def test_bad_input():
    topology, x = topology_of([("RING", polygon(6), True), ("CHAIN", zigzag(6), False)], np.eye(3) * 2.0)
    raises(ParameterError, r"shape \(12, 3\)", lambda: find_piercings(topology, x[:-1]))
    raises(ParameterError, "nan at index", lambda: find_piercings(topology, np.where(np.arange(12)[:, None] == 3, np.nan, x)))
    raises(ParameterError, "half the smallest width of the box", lambda: find_piercings(topology, x, [0.4, 2, 2]))
    raises(ParameterError, "max_ring must be at least 3", lambda: find_piercings(topology, x, max_ring=2))
    raises(ParameterError, r"expected an openmm.app.Topology", lambda: find_piercings(None, x))
    bare = app.Topology()
    bare.addAtom("AR", app.element.argon, bare.addResidue("AR", bare.addChain()))
    raises(ParameterError, "no bonds", lambda: find_piercings(bare, [[0, 0, 0]]))
    assert len(find_piercings(topology, x * 10 * unit.angstrom, [2, 2, 2] * unit.nanometer)) == 1
