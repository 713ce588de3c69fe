"""Random scenes with chains, springs, bends and twists of several kinds, to be written and read back."""

from pathlib import Path

import numpy as np

import openmm_dpd as dpd
from openmm_dpd.inputs import BeadArrays, scene_from_beads
from openmm_dpd.molecules import Bend, CosineBend, FENESpring, MorseSpring, MultiHarmonicTwist, OPLSTwist, Spring, Twist
from openmm_dpd.trajectory import write_psf

PAIRS = {("*", "*"): dpd.DPD(A=25, gamma=4.5)}
SPRINGS = {("*", "*"): Spring(50.0, 0.7), ("B", "A"): FENESpring(30.0, 4.0), ("C", "C"): MorseSpring(5.0, 1.0, 0.6)}
BENDS = {("*", "*", "*"): CosineBend(2.0), ("A", "B", "C"): Bend(3.0, 2.5)}
TWISTS = {
    ("*", "*", "*", "*"): Twist(1.5, -1, 2),
    ("*", "A", "B", "*"): OPLSTwist(1.0, -2.0, 3.0, 0.5),
    ("*", "C", "C", "*"): MultiHarmonicTwist(0.1, 0.2, -0.3, 0.4, 0.5),
}
MASSES = {"A": 1.0, "B": 2.5, "C": 12.0, "W": 1 / 3}
TILTED = np.array([[6.0, 0, 0], [1.5, 5.0, 0], [-2.0, 1.0, 7.0]])
BOXES = (TILTED, np.diag([5.0, 6.0, 7.0]), np.array([[6.0, 0, 0], [-2.9, 6.0, 0], [2.9, -2.9, 7.0]]))


def random_scene(seed: int) -> dpd.Scene:
    """Chains of random types and lengths with bends and twists, solvent, charges; beads up to two boxes away."""
    rng, box = np.random.default_rng(seed), BOXES[seed % 3]
    types, molecules, residues, pairs = [], [], [], []
    for number in range(1, 8):
        length = int(rng.integers(1, 6))
        first = len(types)
        types += rng.choice(["A", "B", "C"], length).tolist() if length > 1 else ["W"]
        pairs += [(first + k, first + k + 1) for k in range(length - 1)]
        molecules += [number] * length
        residues += [f"M{length}"] * length
    types += ["A", "B", "C", "W"]  # every type is there
    molecules += [8, 9, 10, 11]
    residues += ["ONE"] * 4
    n = len(types)
    pairs = np.array(pairs, dtype=np.int64).reshape(-1, 2)
    # bonds are short, so that no FENE bond is too long in any image
    x = np.cumsum(rng.normal(scale=0.3, size=(n, 3)), axis=0) + rng.integers(-2, 3, (1, 3)) @ box
    drawn = {"velocities": rng.normal(size=(n, 3)), "charges": rng.integers(-2, 3, n) * 0.25}
    known = {"molecules": np.array(molecules), "residues": residues, "bonds": pairs}
    arrays = BeadArrays(types=types, positions=x, source="the test", masses=MASSES, box=box, **drawn, **known)
    starts = set(pairs[:, 0].tolist())
    longest = max(next(k for k in range(len(types)) if bead + k not in starts) for bead in range(len(types)))
    tables = (("bonds", SPRINGS, 1), ("angles", BENDS, 2), ("dihedrals", TWISTS, 3))
    return scene_from_beads(arrays, pairs=PAIRS, kT=1.0, **{name: table for name, table, least in tables if longest >= least})


def terms(groups, rows: str) -> dict:
    """Kind and coefficients of each bond, angle or dihedral, by its beads."""
    found = {}
    for group in groups:
        names = [name for name in group.__dataclass_fields__ if name != rows]
        for k, beads in enumerate(getattr(group, rows).tolist()):
            found[tuple(min(beads, beads[::-1]))] = type(group), tuple(getattr(group, name)[k] for name in names)
    return found


def check(found: dpd.Scene, scene: dpd.Scene, *, atol: float, velocities: bool = False, box_atol: float = 1e-12) -> None:
    """A scene that came back is the one that was written."""
    assert found.types == scene.types
    np.testing.assert_allclose(found.positions, scene.positions, atol=atol, rtol=0)
    np.testing.assert_allclose(found.box, scene.box, atol=box_atol, rtol=0)
    np.testing.assert_allclose(found.bead_masses, scene.bead_masses, rtol=1e-6)
    assert terms(found.bonds, "pairs") == terms(scene.bonds, "pairs")
    assert terms(found.angles, "triples") == terms(scene.angles, "triples")
    assert terms(found.dihedrals, "quads") == terms(scene.dihedrals, "quads")
    np.testing.assert_array_equal(found.molecules, scene.molecules)
    if velocities:
        np.testing.assert_allclose(found.velocities, scene.velocities, atol=1e-6, rtol=0)


def tables(scene: dpd.Scene) -> dict:
    """Springs, bends and twists for a scene that has bonds, angles and dihedrals."""
    return {name: table for name, table in (("bonds", SPRINGS), ("angles", BENDS), ("dihedrals", TWISTS)) if getattr(scene, name)}


def psf_of(scene: dpd.Scene, path: Path | str) -> None:
    """Write all of a scene that a PSF file has."""
    angles = np.concatenate([np.zeros((0, 3), int), *(group.triples for group in scene.angles)])
    dihedrals = np.concatenate([np.zeros((0, 4), int), *(group.quads for group in scene.dihedrals)])
    rest = {"residues": scene.residues, "bonds": scene.bond_pairs, "angles": angles, "dihedrals": dihedrals}
    write_psf(path, names=scene.types, masses=scene.bead_masses, charges=scene.charges, molecules=scene.molecules, **rest)


SEEDS = range(6)
