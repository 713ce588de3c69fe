"""Vesicles: numbers, places, bonds, and the solvent inside and outside."""

import numpy as np
import pytest
from cases import refused
from openmm import unit
from scipy.ndimage import label
from scipy.spatial import cKDTree

import openmm_dpd as dpd
from openmm_dpd.analysis import cluster_labels
from openmm_dpd.molecules import Bilayer, Mixture, Scattered, Spring, Vesicle, bead, grafmueller_2009, linear, pack, relax
from openmm_dpd.molecules.vesicles import even_directions

MODEL = grafmueller_2009()
LIPID = MODEL.molecule
BOX, RADIUS, AREA, THICKNESS = 14.0, 4.0, 1.4, 4.57
VESICLE = Vesicle(RADIUS, AREA, THICKNESS)


def packed(arrangement=VESICLE, box=BOX, more=None, **options) -> Mixture:
    return pack({LIPID: arrangement, **(more or {})}, solvent="W", density=3.0, box=[box] * 3, seed=1, **options)


def radii(mixture: Mixture, beads: np.ndarray, centre=(BOX / 2,) * 3, box=BOX) -> np.ndarray:
    d = mixture.positions[beads] - centre
    return np.linalg.norm(d - box * np.round(d / box), axis=-1)


def test_numbers_follow_from_the_areas():
    assert VESICLE.leaflets == (round(4 * np.pi * (4 - 4.57 / 4) ** 2 / 1.4), round(4 * np.pi * (4 + 4.57 / 4) ** 2 / 1.4)) == (73, 237)
    uneven = Vesicle(40 * unit.angstrom, [100 * unit.angstrom**2, 1.4 * unit.nanometer**2], 4.57)
    assert uneven.leaflets == (103, 237) and uneven.count == 340
    assert packed().count(LIPID) == 310
    assert packed().n_beads == round(3 * BOX**3)


def test_leaflets_and_bonds():
    """Heads at the solvent, ends of the tails near the middle, each leaflet spread evenly, all bonds at their lengths."""
    mixture = packed()
    assert np.allclose(mixture.bonds[0].lengths(mixture.positions, None), 0.5)
    r = radii(mixture, mixture.beads(LIPID))
    inner, outer = r[:73], r[73:]
    assert np.all(inner[:, 0] < RADIUS) and np.all(outer[:, 0] > RADIUS)
    ends = [6, 10]
    assert np.all(inner[:, ends] > inner[:, :1]) and np.all(outer[:, ends] < outer[:, :1])
    # tilted molecules lie in planes that touch the sphere, so what is to their side is farther out
    assert np.abs(outer[:, 0] - (RADIUS + THICKNESS / 2)).max() < 0.3
    assert (RADIUS - THICKNESS / 2) < inner[:, 0].min() + 1e-9 and inner[:, 0].max() < RADIUS - THICKNESS / 2 + 0.8
    for leaflet in (mixture.beads(LIPID)[:73], mixture.beads(LIPID)[73:]):
        directions = mixture.positions[leaflet].mean(axis=1) - BOX / 2
        directions /= np.linalg.norm(directions, axis=1)[:, None]
        # as many on either side of any plane through the centre, to the width of a lipid around the rim
        normals = np.random.default_rng(2).normal(size=(20, 3))
        sides = np.mean(directions @ normals.T > 0, axis=0)
        assert np.abs(sides - 0.5).max() < 0.1
    # sites do not overlap: an area per lipid of 1.4 has neighbours 1.27 apart in a hexagonal lattice
    for count, radius in zip(VESICLE.leaflets, (RADIUS - THICKNESS / 4, RADIUS + THICKNESS / 4), strict=True):
        sites = radius * even_directions(count)
        nearest = cKDTree(sites).query(sites, k=2)[0][:, 1]
        assert nearest.min() > 0.7 * np.sqrt(AREA) and nearest.max() < 1.2 * np.sqrt(AREA)


@pytest.mark.parametrize("centre", [None, (1.0, 13.0, 7.0)])
def test_solvent_inside_and_outside_is_equally_dense(centre):
    """None within the membrane, also where the boundary cuts the vesicle."""
    mixture = packed(Vesicle(RADIUS, AREA, THICKNESS, centre))
    r = radii(mixture, mixture.beads("W")[:, 0], centre or (BOX / 2,) * 3)
    low, high = RADIUS - THICKNESS / 2, RADIUS + THICKNESS / 2
    assert not np.any((r > low) & (r < high))
    lumen, shell = 4 / 3 * np.pi * low**3, 4 / 3 * np.pi * (high**3 - low**3)
    density = len(r) / (BOX**3 - shell)
    assert np.sum(r <= low) == round(density * lumen) > 40


def test_two_vesicles_a_bilayer_and_what_floats_around():
    box, chain = [16.0, 16.0, 32.0], linear("A3", Spring(50, 0.5))
    small = grafmueller_2009(3).molecule
    membranes = {LIPID: Vesicle(4.0, 1.4, 4.57, (8, 8, 9)), small: Vesicle(3.5, 1.4, 4.0, (8, 8, 22))}
    membranes[linear("H2T3", Spring(50, 0.5))] = Bilayer(30, centre=31.0)
    floating = {bead("Na"): Scattered(50), chain: Scattered(4, dpd.Sphere([8, 8, 9], 1.0))}
    mixture = pack(membranes | floating, box=box, seed=1)
    assert mixture.count(LIPID) == 310 and mixture.n_beads == 3 * 16 * 16 * 32
    ions = mixture.positions[mixture.beads("Na")[:, 0]]
    for centre, low, high in (((8, 8, 9), 1.715, 6.285), ((8, 8, 22), 1.5, 5.5)):
        d = ions - centre
        r = np.linalg.norm(d - np.array(box) * np.round(d / box), axis=1)
        assert not np.any((r > low) & (r < high))
    assert np.all(np.linalg.norm(mixture.positions[mixture.beads(chain)].mean(axis=1) - [8, 8, 9], axis=1) < 1.0)


test_bad_vesicles = refused(
    dpd.ParameterError,
    (lambda: Vesicle(0, 1.4, 4.0), "radius of a vesicle must be > 0, but is 0"),
    (lambda: Vesicle(2.0, 1.4, 4.0), "radius 2 with a membrane of 4 has no inside"),
    (lambda: Vesicle(4.0, -1.4, 4.0), "one area > 0"),
    (lambda: Vesicle(4.0, (1.4, 1.4, 1.4), 4.0), "one area > 0"),
    (lambda: Vesicle(4.0, 1.4 * unit.nanometer, 4.0), "area per lipid has the unit nanometer"),
    (lambda: Vesicle(4.0, 1.4, 4.0, (1, 2)), "three lengths"),
    (lambda: packed(box=12.5), "diameter 12.57 nm.*box 12.5 nm wide"),
    (lambda: packed(Vesicle(4.0, 1.4, 7.0), box=16.0), "make a membrane of 0.69.* to 6.45.* nm, not of 7 nm"),
    (lambda: packed(Vesicle(4.0, 1.4, 0.5)), "make a membrane of .* not of 0.5 nm"),
    (lambda: packed(more={grafmueller_2009(3).molecule: VESICLE}), "the vesicle of \\S+ and the vesicle of \\S+ overlap"),
    (lambda: packed(more={linear("A3", Spring(50, 0.5)): Bilayer(10)}), "the bilayer of A3 and the vesicle of \\S+ overlap"),
    (lambda: packed(Vesicle(4.0, 0.5, 4.57), box=13.0), "the molecules have .* beads"),
)


def encloses(tails: np.ndarray, box: float, cells: int) -> bool:
    """Whether no way leads from the middle of a box to its corner past the cells that hold tails."""
    taken = np.zeros((cells,) * 3, dtype=bool)
    taken[tuple((np.mod(tails, box) / box * cells).astype(int).T % cells)] = True
    rooms, _ = label(~taken)
    middle = rooms[(cells // 2,) * 3]
    return middle != 0 and middle != rooms[0, 0, 0]


@pytest.mark.slow
def test_a_vesicle_stays_closed():
    """51 units of time, in which a bead of water moves by almost ten of its diameters: one closed shell, no water goes in or out."""
    mixture = packed(box=13.5)
    built = dpd.build(relax(mixture.scene(pairs=MODEL.pairs(), kT=1.0)), dt=0.03, scheme="middle", seed=1, platform="CPU")
    simulation = built.simulation()
    tails = np.flatnonzero(np.array(mixture.types) == "T")
    water, lipids = mixture.beads("W")[:, 0], mixture.beads(LIPID)
    inside = water[radii(mixture, water, (6.75,) * 3, 13.5) < RADIUS - THICKNESS / 2]
    assert encloses(mixture.positions[tails], 13.5, 13)
    simulation.step(1700)
    x = simulation.context.getState(positions=True).getPositions(asNumpy=True)._value
    # the vesicle moves as a whole, and is whole: molecules are not folded one by one
    middle = x[lipids].reshape(-1, 3).mean(axis=0)
    assert np.linalg.norm(middle - 6.75) < 1.0
    assert encloses(x[tails] - middle + 6.75, 13.5, 13)
    assert np.all(cluster_labels(x[tails], 1.2, np.eye(3) * 13.5) == 0)
    d = x[water] - middle
    r = np.linalg.norm(d - 13.5 * np.round(d / 13.5), axis=1)
    now = set(water[r < RADIUS - 0.5].tolist())
    assert now == set(inside.tolist())
