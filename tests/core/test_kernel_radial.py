"""Kernels of radial overlays, segments and forces on single beads: OpenMM's own on the Reference platform, splines, derivatives, patterns, threads."""

from itertools import combinations

import chains_of_beads as chains
import numpy as np
import pytest
import reference_forces as check
from cases import cases, raises
from reference_forces import BOXES
from scenes import BOXES as MORE_BOXES, MASSES, beads, fluid

import openmm_dpd as dpd
from openmm_dpd.base.names import BODY_FORCE, PAIR_FORCE
from openmm_dpd.kernels.bonded import CosineAngleTerms, FENEBondTerms, HarmonicBondTerms
from openmm_dpd.kernels.external import BodyTerms
from openmm_dpd.kernels.extras import warm_up_extras
from openmm_dpd.kernels.radial import RadialTerms
from openmm_dpd.kernels.segments import SegmentSpec
from openmm_dpd.model.radial import FORMULAS
from openmm_dpd.plan.forces.expressions import energy_spline, exception_force, nonbonded_force
from openmm_dpd.plan.forces.external import external_force
from openmm_dpd.plan.forces.segments import segment_force, segment_spec
from openmm_dpd.plan.kinds import resolved_kind
from openmm_dpd.plan.pair_spec import extras, radial_terms

NAMES = list(MASSES)
LJ = dpd.LennardJones


def smooth_table(depth, end, count=60, forces=True, cutoff=None):
    """A table of a soft well, from 0.15 on."""
    r = np.linspace(0.15, end, count)
    u = depth * np.exp(-3 * r) * np.cos(5 * r)
    slope = -depth * np.exp(-3 * r) * (3 * np.cos(5 * r) + 5 * np.sin(5 * r))
    return dpd.TabulatedPair(r, u, -slope if forces else None, cutoff)


WELL = smooth_table(300.0, 1.1)
TABLES = {
    "one lennard-jones": {("*", "*"): LJ(1.2, 0.45, 1.1)},
    "lennard-jones": {("A", "A"): LJ(1.2, 0.45, 1.1, shift=True), ("A", "B"): LJ(0.7, 0.5, 0.9), ("B", "B"): LJ(1.5, 0.4, 1.2, shift=True)},
    "some lennard-jones": {("A", "A"): dpd.NONE, ("A", "B"): dpd.NONE, ("B", "B"): LJ(1.2, 0.45, 1.1)},
    "formulas": {
        ("A", "A"): dpd.RadialPair("soft", {"A": 9.0}, 1.1),
        ("A", "B"): dpd.RadialPair("morse", {"D": 2.0, "alpha": 3.0, "r0": 0.5}, 0.9, shift=True),
        ("B", "B"): dpd.RadialPair("gauss", {"A": -7.0, "B": 2.5}, 1.2),
    },
    "one table": {("*", "*"): WELL},
    "tables": {("A", "A"): WELL, ("A", "B"): smooth_table(200.0, 1.0, 45, forces=False), ("B", "B"): smooth_table(400.0, 1.2, cutoff=0.8)},
    "some tables": {("A", "A"): WELL, ("A", "B"): WELL, ("B", "B"): dpd.NONE},
}
EVERY_TABLE = pytest.mark.parametrize("name", TABLES)
EVERY_BOX = pytest.mark.parametrize("box", BOXES)


def lattice(vectors, seed=1, spread=2):
    """Beads of both types near the points of a lattice, strewn over images of the box, and factors of some pairs nearby."""
    rng = np.random.default_rng(seed)
    edges = np.diag([4.5] * 3) if vectors is None else vectors
    counts = (np.diag(edges) / 0.7).astype(int)
    points = np.stack(np.meshgrid(*(np.arange(n) / n for n in counts), indexing="ij"), axis=-1).reshape(-1, 3)
    x = points @ edges + rng.uniform(-0.1, 0.1, points.shape)
    factors = {(k, k + 1): (0.0, 0.5, 0.25)[k % 3] for k in range(0, len(x) - 1, 2)}
    if vectors is not None:
        x += rng.integers(-spread, spread + 1, x.shape) @ vectors
    return np.ascontiguousarray(x), rng.integers(0, 2, len(x)).astype(np.int32), factors


def mie(r, e, s, n, m, _):
    return n / (n - m) * (n / m) ** (m / (n - m)) * e * ((s / r) ** n - (s / r) ** m)


def smooth(energy):
    """Shifted so that energy and force are 0 at the cutoff."""

    def shifted(r, *values):
        end, h = values[-1], 1e-30j
        return energy(r, *values) - energy(end, *values) - (r - end) * np.imag(energy(end + h, *values)) / 1e-30

    return shifted


def morse(r, depth, alpha, r0, _):
    return depth * (np.exp(-2 * alpha * (r - r0)) - 2 * np.exp(-alpha * (r - r0)))


#: Energies of the formulas, of the distance, the coefficients and the cutoff.
ENERGIES = {
    "soft": lambda r, A, rc: A * (1 + np.cos(np.pi * r / rc)),
    "gauss": lambda r, A, B, _: -A * np.exp(-B * r * r),
    "gauss/cut": lambda r, H, r0, s, _: H / (s * np.sqrt(2 * np.pi)) * np.exp(-((r - r0) ** 2) / (2 * s * s)),
    "morse": morse,
    "morse/smooth/linear": smooth(morse),
    "yukawa": lambda r, A, kappa, _: A * np.exp(-kappa * r) / r,
    "lj/smooth/linear": smooth(lambda r, e, s, rc: mie(r, e, s, 12, 6, rc)),
    "mie/cut": mie,
    "lj/class2": lambda r, e, s, _: e * (2 * (s / r) ** 9 - 3 * (s / r) ** 6),
    "buck": lambda r, A, rho, C, _: A * np.exp(-r / rho) - C / r**6,
}


def slope_of(c, r):
    """The force: minus the derivative of the energy, by a complex step."""
    return -np.imag(ENERGIES[c.form](r + 1e-30j, *c.values, c.cutoff)) / 1e-30


@pytest.mark.parametrize("form", FORMULAS)
def test_energies_and_forces_of_formulas(form):
    """Beside the formulas in plain numpy; OpenMM's expression follows them."""
    values = dict(zip(FORMULAS[form].dimensions, (1.7, 0.6, 0.8) if form != "mie/cut" else (1.7, 0.4, 14.0, 8.0), strict=False))
    for shift in (False, True):
        c = dpd.RadialPair(form, values, 1.3, shift)
        terms = radial_terms({("A", "A"): c}, np.zeros(2, np.int32), ["A"], {})
        expression = resolved_kind({("A", "A"): c}).potential({("A", "A"): c}, ["A"])
        for r in (0.3, 0.61, 1.29, 1.31):
            x = np.array([[1.0, 1, 1], [1.0 + r, 1, 1]])
            energy, force = check.evaluate([terms], x, None)
            expected = ENERGIES[form](r, *c.values, 1.3) - (shift and not FORMULAS[form].smooth) * ENERGIES[form](1.3, *c.values, 1.3)
            assert energy == pytest.approx(expected if r < 1.3 else 0.0, rel=1e-11, abs=1e-12)
            assert force[1, 0] == pytest.approx(slope_of(c, r) if r < 1.3 else 0.0, rel=1e-11, abs=1e-12)
            found = check.reference([nonbonded_force(expression, np.zeros(2, np.int32), [], False)], x, None)
            assert found[0] == pytest.approx(energy, rel=1e-9, abs=1e-9) and found[1][1, 0] == pytest.approx(
                force[1, 0], rel=1e-9, abs=1e-9
            )


@cases(
    "form, values, message",
    ("sofd", {}, "form must be one of soft, gauss, .*, not 'sofd'"),
    ("gauss", {"A": 1.0}, "gauss has the coefficients A, B; got A"),
    ("gauss", {"A": 1.0, "B": -1.0}, "B must be >= 0"),
    ("morse", {"D": 1.0, "alpha": 900.0, "r0": 1.0}, "morse has no finite energy with"),
    ("mie/cut", {"epsilon": 1.0, "sigma": 1.0, "n": 6.0, "m": 6.0}, "mie/cut has no finite energy with"),
)
def test_formulas_that_make_no_sense(form, values, message):
    raises(dpd.ParameterError, message, dpd.RadialPair, form, values, 1.0)


def resolved(name):
    return dpd.PairTable(TABLES[name]).resolve(NAMES)


def openmm_forces(name, types, factors, periodic):
    table = resolved(name)
    expression = resolved_kind(table).potential(table, NAMES)
    kept = {pair: factor for pair, factor in factors.items() if factor}
    return [nonbonded_force(expression, types, sorted(factors), periodic, listed=False), exception_force(expression, types, kept, periodic)]


@EVERY_TABLE
@EVERY_BOX
def test_openmm_gives_the_same_and_forces_are_the_gradient(name, box):
    """Tables as far as OpenMM's, sampled anew, follow them: its forces smooth out where the second derivative jumps."""
    x, types, factors = lattice(BOXES[box])
    terms = radial_terms(resolved(name), types, NAMES, factors)
    rtol, force_rtol = (1e-6, 1e-4) if "table" in name else (1e-9, 1e-9)
    check.check_agreement([terms], openmm_forces(name, types, factors, box != "none"), x, BOXES[box], rtol, force_rtol)
    x, types, factors = lattice(BOXES[box], seed=5)
    terms = [radial_terms(resolved(name), types, NAMES, factors)]
    check.check_gradient(terms, x, BOXES[box], every=31)
    check.check_total_force(terms, x, BOXES[box])
    check.check_pickle(terms, x, BOXES[box])


@EVERY_TABLE
@pytest.mark.parametrize("box", ["none", "narrow", "slab", "tilted_narrow"])
def test_the_sum_over_all_pairs(name, box):
    """Energies of all pairs in plain numpy, with the spline itself; boxes of fewer than three cells among them."""
    vectors = MORE_BOXES[box]
    x, types, factors = lattice(vectors, seed=3)
    table, expected, expected_force = resolved(name), 0.0, np.zeros_like(x)
    pairs = np.array(list(combinations(range(len(x)), 2)))
    apart = chains.nearest_image(x[pairs[:, 0]] - x[pairs[:, 1]], vectors)
    near = np.linalg.norm(apart, axis=1) < max(c.cutoff for c in table.values())
    for (i, j), d in zip(pairs[near].tolist(), apart[near], strict=True):
        c = table[tuple(sorted((NAMES[types[i]], NAMES[types[j]])))]
        r, factor = np.linalg.norm(d), factors.get((i, j), 1.0)
        if not 0 < r < c.cutoff:
            continue
        if isinstance(c, dpd.RadialPair):
            u, f = ENERGIES[c.form](r, *c.values, c.cutoff) - c.shift * ENERGIES[c.form](c.cutoff, *c.values, c.cutoff), slope_of(c, r)
        elif isinstance(c, LJ):
            u, end = (4 * c.epsilon * ((c.sigma / s) ** 12 - (c.sigma / s) ** 6) for s in (r, c.cutoff))
            u -= end if c.shift else 0.0
            f = 24 * c.epsilon * (2 * (c.sigma / r) ** 12 - (c.sigma / r) ** 6) / r
        else:
            spline, low = energy_spline(c), c.distances[0]
            u = spline(r) if r > low else spline(low) + spline(low, 1) * (r - low)
            f = -spline(max(r, low), 1)
        expected += factor * u
        expected_force[i] += factor * f * d / r
        expected_force[j] -= factor * f * d / r
    energy, force = check.evaluate([radial_terms(table, types, NAMES, factors)], x, vectors)
    assert abs(expected) > 1 and energy == pytest.approx(expected, rel=1e-11)
    np.testing.assert_allclose(force, expected_force, rtol=0, atol=1e-11 * np.abs(expected_force).max())


def two(name, distance):
    x = np.array([[1.0, 1, 1], [1.0 + distance, 1, 1]])
    energy, force = check.evaluate([radial_terms(resolved(name), np.zeros(2, np.int32), NAMES, {})], x, None)
    assert force[0, 0] == pytest.approx(-force[1, 0], abs=1e-12) and not force[:, 1:].any()
    return energy, force[1, 0]


def test_a_table_at_its_ends_and_at_its_points():
    spline = energy_spline(WELL)
    first, steepest = float(spline(0.15)), -float(spline(0.15, 1))
    energy, force = two("one table", 0.05)
    assert force == pytest.approx(steepest) and energy == pytest.approx(first + 0.1 * steepest)
    for r, u, f in zip(WELL.distances[1:-1], WELL.energies[1:-1], WELL.forces[1:-1], strict=True):
        energy, force = two("one table", r)
        assert energy == pytest.approx(u, abs=1e-10) and force == pytest.approx(f, abs=1e-8)
    assert two("one table", WELL.distances[-1] * (1 - 1e-12))[0] == pytest.approx(WELL.energies[-1])
    assert two("one table", WELL.distances[-1] * (1 + 1e-12)) == (0.0, 0.0)


def test_uneven_points_of_a_table():
    """Even to four digits is even enough, and every piece is the right one."""
    r = np.linspace(0.1, 1.1, 400)
    r[1:-1] += np.random.default_rng(1).uniform(-4e-5, 4e-5, 398) * (r[1] - r[0])
    table = {("A", "A"): dpd.TabulatedPair(r, np.cos(9 * r))}
    spline = energy_spline(table["A", "A"])
    for distance in np.concatenate([r[1:-1:9], np.nextafter(r[1:-1:9], 0)]):
        x = np.array([[0.0, 0, 0], [distance, 0, 0]])
        energy, force = check.evaluate([radial_terms(table, np.zeros(2, np.int32), ["A"], {})], x, None)
        assert energy == pytest.approx(float(spline(distance)), rel=1e-12, abs=1e-12)
        assert force[1, 0] == pytest.approx(-float(spline(distance, 1)), rel=1e-9, abs=1e-9)


@EVERY_TABLE
def test_beads_at_the_same_point(name):
    """They exert nothing on each other."""
    types = np.ones(3, np.int32) if name == "some lennard-jones" else np.zeros(3, np.int32)
    x = np.array([[1.0, 1, 1], [1.0, 1, 1], [1.5, 1, 1]])
    energy, force = check.evaluate([radial_terms(resolved(name), types, NAMES, {})], x, np.diag([4.0] * 3))
    assert np.isfinite(energy) and force[0].any()
    np.testing.assert_allclose(force[0], force[1], rtol=1e-12)
    assert two(name, 0.0) == (0.0, 0.0)


def test_beads_that_take_no_part():
    """No bead at all of the types that interact, positions that are not numbers, and a scene without any."""
    assert extras(beads(), (), {}) == ()
    terms = radial_terms(resolved("some lennard-jones"), np.zeros(5, np.int32), NAMES, {})
    energy, force = check.evaluate([terms], np.random.default_rng(1).random((5, 3)), None)
    assert energy == 0.0 and not force.any()
    terms = radial_terms(resolved("lennard-jones"), np.zeros(5, np.int32), NAMES, {})
    raises(dpd.RunError, "position of bead 0 is not finite", lambda: check.evaluate([terms], np.full((5, 3), np.nan), np.diag([4.0] * 3)))


@pytest.mark.parametrize("distance", ["mid", "min"])
@EVERY_BOX
def test_segments(distance, box):
    """What the PythonForce gives."""
    vectors = BOXES[box]
    x, bonds, _ = chains.walks(30, 5, np.diag([4.5] * 3) if vectors is None else vectors, 2, step=0.5, spread=0 if vectors is None else 2)
    repulsion = dpd.SegmentalRepulsion(50.0, 0.7, distance)
    scene = beads(len(x), positions=x, box=vectors, bonds=[dpd.HarmonicBonds(bonds, 0.0, 0.5)], segments=repulsion)
    terms = extras(scene, (), {})[1:]
    check.check_agreement(terms, [segment_force(segment_spec(scene), vectors is not None)], x, vectors, 1e-13)
    check.check_pickle(terms, x, vectors)
    check.check_total_force(terms, x, vectors)


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
def test_openmm_gives_the_same_on_single_beads(name, box):
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
def test_pickled_copies_do_the_same_on_single_beads(name):
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
