"""Kernels of forces on single beads: OpenMM's own on the Reference platform, patterns, and everything of a scene together."""

import chains_of_beads as chains
import numpy as np
import pytest
import reference_forces as check
from reference_forces import BOXES
from scenes import MASSES, beads, fluid

import openmm_dpd as dpd
from openmm_dpd.base.names import BODY_FORCE, PAIR_FORCE
from openmm_dpd.kernels.angles import CosineAngleTerms
from openmm_dpd.kernels.bonded import FENEBondTerms, HarmonicBondTerms
from openmm_dpd.kernels.external import BodyTerms
from openmm_dpd.kernels.extras import warm_up_extras
from openmm_dpd.kernels.radial import RadialTerms
from openmm_dpd.kernels.segments import SegmentSpec
from openmm_dpd.plan.extra_forces import extras
from openmm_dpd.plan.forces.external import external_force

PUSH = (0.7, -1.3, 2.1)


def each(n):
    return np.random.default_rng(4).normal(size=(n, 3))


FORCES = {
    "uniform": lambda n: dpd.BodyForce(PUSH),
    "one component": lambda n: dpd.BodyForce((0, 0, 2.0), types="B"),
    "per bead": lambda n: dpd.BodyForce(each(n), beads=np.arange(n) % 3 > 0),
    "halves": lambda n: dpd.BodyForce(PUSH, pattern="halves", axis="z", origin=0.3),
    "halves per bead": lambda n: dpd.BodyForce(each(n), types=["A"], pattern="halves", axis="z"),
    "sine": lambda n: dpd.BodyForce(PUSH, pattern="sine", axis="z", origin=-1.7),
}
EVERY_FORCE = pytest.mark.parametrize("name", FORCES)


def grid_scene(name, box, n=200):
    """Positions that OpenMM's expressions, which round the place of a pattern to 2^-20 nm, take as they are."""
    x = np.round(fluid(box=BOXES[box], n=n, positions=None).positions * 2.0**20) / 2.0**20
    return fluid(box=BOXES[box], n=n, positions=x, body_forces=[FORCES[name](n)]), x


def in_box(name, box):
    if box == "none" and ("halves" in name or "sine" in name):
        pytest.skip("a pattern needs a box")


@EVERY_FORCE
@pytest.mark.parametrize("box", BOXES)
def test_openmm_gives_the_same(name, box):
    in_box(name, box)
    scene, x = grid_scene(name, box)
    terms = extras(scene, (), {})
    openmm_force = external_force(scene.body_forces[0], scene.type_ids, scene.type_names, scene.box)
    for scale in (1.0, 0.4, 0.0):
        energy, force = check.evaluate(terms, x, scene.box, scale)
        expected, expected_force = check.reference([openmm_force], x, scene.box, **{BODY_FORCE: scale})
        np.testing.assert_allclose(force, expected_force, rtol=0, atol=1e-9)
        assert energy == (0.0 if scene.box is not None else pytest.approx(expected, rel=1e-9))


def test_the_energy_without_a_box_has_the_force_as_its_slope():
    scene, x = grid_scene("per bead", "none")
    check.check_gradient(extras(scene, (), {}), x, None)


@pytest.mark.parametrize("name", ["uniform", "halves", "sine"])
def test_patterns(name):
    """Against the formula, at places through several periods; a changed box does not change the pattern."""
    z = np.linspace(-9.0, 13.0, 441) + 0.003
    x = np.zeros((len(z), 3))
    x[:, 2] = z
    options = {} if name == "uniform" else {"pattern": name, "axis": "z", "origin": 0.4}
    scene = beads(len(z), positions=x, edge=3.0, body_forces=[dpd.BodyForce(PUSH, **options)])
    part = (z - 0.4) / 3.0 % 1.0
    sign = {"uniform": np.ones(len(z)), "halves": np.where(part < 0.5, 1.0, -1.0), "sine": np.sin(2 * np.pi * part)}[name]
    for box in (scene.box, 1.1 * scene.box):
        _, force = check.evaluate(extras(scene, (), {}), x, box, 0.5)
        np.testing.assert_allclose(force, 0.5 * sign[:, None] * np.array(PUSH), atol=1e-13)


@EVERY_FORCE
def test_pickled_copies_do_the_same(name):
    for box in ("tilted", "none"):
        if box == "tilted" or "halves" not in name and "sine" not in name:
            scene, x = grid_scene(name, box, n=4100)
            check.check_pickle(extras(scene, (), {}), x, scene.box)


def everything(box):
    """Bonds, angles, both overlays, segments and two body forces at once, with factors of bonded neighbours."""
    vectors = BOXES[box]
    edges = np.diag([4.5] * 3) if vectors is None else vectors
    x, bonds, angles = chains.walks(25, 6, edges, 8, step=0.6, spread=0 if vectors is None else 1)
    r = np.linspace(0.05, 1.0, 80)
    x = np.round(x * 2.0**20) / 2.0**20
    lj = {("A", "A"): dpd.LennardJones(0.4, 0.05, 0.9, shift=True), ("A", "B"): dpd.NONE, ("B", "B"): dpd.NONE}
    tables = [{("*", "*"): dpd.DPD(A=25, gamma=4.5)}, lj, {("A", "B"): dpd.TabulatedPair(r, 30 * np.exp(-3 * r)), ("B", "B"): dpd.NONE}]
    bonded = {"bonds": [dpd.HarmonicBonds(bonds[::2], 30.0, 0.6), dpd.FENEBonds(bonds[1::2], 20.0, 1.2)]}
    bonded |= {"angles": [dpd.CosineAngles(angles, 3.0)], "bonded_factors": (0.0, 0.5, 0.25), "segments": dpd.SegmentalRepulsion(20.0, 0.6)}
    pushes = [dpd.BodyForce((0.1, 0, 0), types="A"), dpd.PositionForce(("sin(z)", "0", "0")), dpd.BodyForce((0, 0, -0.2))]
    layers, types = [dpd.PairTable(table) for table in tables], ["A", "B", "B"] * (len(x) // 3)
    return dpd.Scene(MASSES, types, x, layers, 1.0, box=vectors, **bonded, body_forces=pushes)


@pytest.mark.parametrize("box", BOXES)
def test_everything_of_a_scene(box, two_threads):
    """Together they are all forces of the System but the pair terms, and the one force that has no kernel."""
    scene = everything(box)
    built = dpd.build(scene, dt=0.01, platform="Reference", conservative="kernel", seed=1, loop=False)
    terms = extras(scene, built.plan.overlays, built.plan.exceptions)
    bonded = [HarmonicBondTerms, FENEBondTerms, CosineAngleTerms]
    assert [type(term) for term in terms] == [*bonded, RadialTerms, RadialTerms, SegmentSpec, BodyTerms, BodyTerms]
    forces = [force for force in built.system.getForces() if force.getName() not in (PAIR_FORCE, "position force")]
    x = scene.positions.copy()
    energy, force = check.evaluate(terms, x, scene.box)
    expected, expected_force = check.reference(forces, x, scene.box)
    # the table is sampled anew for OpenMM, and in a box OpenMM has a small energy for what rounding the positions leaves
    assert energy == pytest.approx(expected, rel=1e-6)
    np.testing.assert_allclose(force, expected_force, rtol=0, atol=1e-5 * np.abs(expected_force).max())
    warm_up_extras(terms)
    check.check_threads(terms, x, scene.box)
    check.check_pickle(terms, x, scene.box)


def test_a_scene_without_any():
    assert extras(beads(), (), {}) == ()
