"""Stress in slabs: beside a loop over pairs, the tensor of the whole box, and mechanical equilibrium of a liquid film."""

from dataclasses import replace

import numpy as np
import oracle
import pytest
from cases import raises
from judged import any_seed, bounded
from scenes import MASSES, PLAIN

import openmm_dpd as dpd
from openmm_dpd.analysis import green_kubo_viscosity, surface_tension
from openmm_dpd.base.geometry import AXES_OF_TENSOR
from openmm_dpd.measure import SlabStressReporter, StressReporter
from openmm_dpd.measure.slabs import along_lines
from openmm_dpd.measure.stress_parts import BondedStress, beside_pairs

LIQUID = dpd.MDPD(A=-40, B=25, gamma=4.5, cutoff=1.0, cutoff_B=0.75, kernel="quadratic")
FORMATION = dpd.BondFormation(dpd.ReactiveBonds(dpd.HarmonicBonds, {"k": 20.0, "r0": 0.5}), ("A", "B"), within=0.8, valences=(1, 1))
#: Tilted so that z, and only z, is an axis along which no other vector points.
TILTED = np.array([[4.1, 0, 0], [1.2, 3.9, 0], [0, 0, 5.0]])


def chains(table, box=TILTED, n=120, **more) -> dpd.Scene:
    """Beads strewn over images, bonded in pairs of which some are longer than a slab."""
    rng = np.random.default_rng(4)
    x = rng.random((n, 3)) @ box
    x[1::2] = x[::2] + rng.normal(0, 0.4, (n // 2, 3))
    x += rng.integers(-1, 2, (n, 3)) @ box
    v = rng.normal(size=(n, 3))
    bonds = [dpd.HarmonicBonds(np.arange(n).reshape(-1, 2), 30.0, 0.6)]
    names = ["A"] * (n // 2) + ["B"] * (n // 2)
    return dpd.Scene(MASSES, names, x, table, kT=1.0, box=box, bonds=bonds, bonded_factors=(1, 1, 1), velocities=v, **more)


def both(scene, scheme="middle", bins=13, axis="z", steps=0, **options) -> tuple[SlabStressReporter, StressReporter]:
    built = dpd.build(scene, dt=0.01, scheme=scheme, seed=1, **options)
    found = SlabStressReporter(5, built, axis=axis, bins=bins), StressReporter(5, built)
    simulation = built.simulation()
    for reporter in found:
        reporter.report(simulation, None)
    simulation.reporters += found
    simulation.step(steps)
    return found


def test_slabs_agree_with_a_loop_over_pairs():
    """Two types, masses and bonds; each line is followed point by point."""
    scene, bins, points = chains(PLAIN), 13, (np.arange(2000) + 0.5) / 2000
    slabs, _ = both(scene, "bababo", bins)
    x, v, m = scene.positions, scene.velocities, scene.bead_masses
    expected = np.zeros((bins, 3, 3))
    for i in range(len(x)):
        expected[int(x[i, 2] / 5.0 % 1.0 * bins)] += m[i] * np.outer(v[i], v[i])

    def share(r, force, at):
        numbers = np.floor((at - points * r[2]) / 5.0 % 1.0 * bins).astype(int)
        expected[:] += np.bincount(numbers, minlength=bins)[:, None, None] / len(points) * np.outer(r, force)

    for i in range(len(x)):
        for j in range(i + 1, len(x)):
            r = oracle.minimum_image(x[i] - x[j], TILTED)
            d = np.linalg.norm(r)
            if d < 1.0:
                a = PLAIN[tuple(sorted((scene.types[i], scene.types[j])))].A
                share(r, a * (1 - d) * r / d, x[i, 2])
            if j == i + 1 and i % 2 == 0:
                share(r, -2 * 30.0 * (d - 0.6) * r / d, x[i, 2])  # U = k (r - r0)^2
    volume = np.linalg.det(TILTED) / bins
    expected = np.stack([expected[:, a, b] for a, b in ((0, 0), (1, 1), (2, 2), (0, 1), (0, 2), (1, 2))], axis=1) / volume
    np.testing.assert_allclose(slabs.pressures[0], expected, atol=2e-3 * np.abs(expected).max())


#: The first one will be straight.
ANGLES = [dpd.HarmonicAngles(np.arange(117).reshape(-1, 3), 5.0, np.pi), dpd.HarmonicAngles([[117, 118, 119], [5, 70, 41]], 9.0, 1.9)]


def straightened(scene: dpd.Scene) -> dpd.Scene:
    x = scene.positions.copy()
    x[1] = 0.5 * (x[0] + x[2])
    return replace(scene, positions=x)


@pytest.mark.parametrize(
    "case", ["middle", "mvv", "aboba", "many-body", "overlay", "bonds that form", "angles", "angles that form", "shear"]
)
def test_slabs_add_up_to_the_tensor_of_the_box(case):
    """To rounding, for every kind of pair term with a tensor, along every axis of a box with right angles, and after steps."""
    table = {("*", "*"): LIQUID} if case == "many-body" else PLAIN
    tables = [table, {("*", "*"): dpd.LennardJones(0.3, 0.4, cutoff=1.1)}] if case == "overlay" else table
    edges = TILTED if case == "middle" else np.diag([4.1, 3.9, 5.0])
    scene = chains(tables, edges)
    if case == "bonds that form":
        scene = replace(scene, reactions=[FORMATION], bonded_factors=(0.0, 0.5, 1.0))
    if "angles" in case:
        scene = straightened(replace(scene, angles=ANGLES))
    if case == "angles that form":
        scene = replace(scene, reactions=[replace(FORMATION, angle=dpd.HarmonicAngles([[0, 1, 2]], 9.0, 1.9))], angles=())
    if case == "shear":
        scene = replace(scene, shear=dpd.LeesEdwards(3.0))
    for axis in "yz" if case == "shear" else "z" if case in ("middle", "bonds that form") else "xyz":
        slabs, whole = both(scene, case if case in ("mvv", "aboba") else "middle", axis=axis, steps=0 if case == "overlay" else 5)
        np.testing.assert_allclose(slabs.pressures.mean(axis=1), whole.pressures, rtol=1e-11, atol=1e-11 * np.abs(whole.pressures).max())
        assert np.isnan(slabs.tensor[1]).all() and slabs.centres[0] == pytest.approx(edges["xyz".index(axis), "xyz".index(axis)] / 26)
        assert slabs.pressures.shape == (1 + (case != "overlay"), 13, 6)


def test_angles_act_by_the_derivatives_of_their_energies_by_distances():
    """Theta by the law of cosines, its derivatives by finite differences."""
    angles = dpd.HarmonicAngles(np.arange(30).reshape(-1, 3), 7.0, 1.7)
    scene, h = chains(PLAIN, np.diag([4.1, 3.9, 5.0]), angles=[angles]), 1e-6
    (extra,) = [extra for extra in beside_pairs(dpd.make_plan(scene, dt=0.01)) if "angle" in getattr(extra, "called", "")]
    found, at, box = BondedStress(extra).lines(scene.positions, scene.box), scene.positions[angles.beads], scene.box
    d = [oracle.minimum_image(at[:, a] - at[:, b], box) for a, b in ((0, 1), (0, 2), (1, 2))]
    d[1] = d[0] + d[2]
    r = np.linalg.norm(d, axis=2)

    def energy(a, c, b):
        return angles.curve(np.arccos((a**2 + b**2 - c**2) / (2 * a * b)))[0]

    for k, pair in enumerate(((0, 1), (0, 2), (1, 2))):
        step = h * np.eye(3)[k][:, None]
        slope = (energy(*(r + step)) - energy(*(r - step))) / (2 * h)
        beads, values = found[k]
        assert np.array_equal(beads, angles.beads[:, pair])
        expected = (-slope / r[k])[:, None] * np.stack([d[k][:, a] * d[k][:, b] for a, b in AXES_OF_TENSOR], axis=1)
        np.testing.assert_allclose(values, expected, rtol=1e-5, atol=1e-5)


def channel(**more) -> dpd.Scene:
    x = np.random.default_rng(2).random((192, 3)) * [4, 4, 4] + [0, 0, 1]
    v = np.random.default_rng(3).normal(size=x.shape)
    return dpd.Scene({"A": 1.0}, ["A"] * 192, x, {("A", "A"): dpd.DPD(A=25, gamma=4.5)}, 1.0, [4.0, 4.0, 6.5], velocities=v, **more)


def test_slabs_between_walls_add_up_to_the_virial_of_the_fluid():
    """Along z no force acts through a face of the box: the sum is that of z F."""
    scene = channel(walls=[dpd.Wall("z", 1.0, "above"), dpd.Wall("z", 5.0, "below")])
    built = dpd.build(scene, dt=0.01, scheme="bababo", seed=1)
    simulation, slabs = built.simulation(), SlabStressReporter(1, built, bins=13)
    slabs.report(simulation, None)
    state = simulation.context.getState(positions=True, velocities=True, forces=True)
    x, v, force = (np.array(each._value)[:, 2] for each in (state.getPositions(), state.getVelocities(), state.getForces()))
    sums = slabs.pressures[0, :, 2] * 4 * 4 * 0.5
    assert (
        sums.sum() == pytest.approx(np.sum(v**2) + np.sum(x * force), rel=1e-9) and not sums[[0, 1, 10, 11, 12]].any() and sums[2:10].all()
    )


@pytest.mark.parametrize("case", ["reflecting", "moving", "a fluid behind", "frozen", "of a shape", "many-body"])
def test_slabs_between_walls_add_up_to_the_tensor_of_the_box(case):
    """After steps, in which plain walls do not end what is measured within a run."""
    walls = {
        "moving": [dpd.Wall("z", 1.0, "above", velocity=(1.0, 0, 0)), dpd.Wall("z", 5.0, "below")],
        "a fluid behind": [dpd.Wall("z", at, side, behind="A", density=3.0) for at, side in ((1.0, "above"), (5.0, "below"))],
        "of a shape": [dpd.SolidWall(dpd.shapes.Ball((2.0, 2.0, 6.0), 0.7))],
    }.get(case, [dpd.Wall("z", 1.0, "above"), dpd.Wall("z", 5.0, "below")])
    scene = channel(walls=() if case == "frozen" else walls)
    if case == "frozen":
        still = np.where((scene.positions[:, 2] > 1.8)[:, None], scene.velocities, 0.0)
        scene = replace(scene, mobile=scene.positions[:, 2] > 1.8, velocities=still)
    scene = replace(scene, pairs={("A", "A"): LIQUID}) if case == "many-body" else scene
    slabs, whole = both(scene, steps=30)
    np.testing.assert_allclose(slabs.pressures.mean(axis=1), whole.pressures, rtol=1e-11, atol=1e-11 * np.abs(whole.pressures).max())
    built = dpd.build(scene, dt=0.01, scheme="middle", seed=1)
    simulation, alone = built.simulation(), StressReporter(5, built)
    simulation.reporters.append(alone)
    simulation.step(30)
    np.testing.assert_allclose(alone.pressures, whole.pressures[1:], rtol=1e-11, atol=1e-11 * np.abs(whole.pressures).max())
    assert len(alone.pressures) == 6
    raises(dpd.ParameterError, "take up momentum", green_kubo_viscosity, whole)


def test_lines_are_shared_by_length():
    """A line over several slabs and around the box; one within a slab; one of no length; along a boundary."""
    values = np.array([[1.0], [2.0], [4.0], [8.0]])
    found = along_lines(np.array([3.5, 1.2, 0.5, 2.0]), np.array([2.0, 0.5, 0.0, -1.0]), values, 4)[0]
    np.testing.assert_allclose(found, [0.5 + 4.0, 0.25 + 2.0 + 8.0, 0.0, 0.25], atol=1e-14)


def film(seed: int, steps: int):
    edges, spacing = np.array([6.0, 6.0, 12.0]), 6.0 ** (-1 / 3)
    axes = [np.arange(spacing / 2, edge, spacing) for edge in (6, 6, 5)]
    x = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, 3) + [0, 0, 3.5]
    scene = dpd.Scene({"L": 1.0}, ["L"] * len(x), x, {("L", "L"): LIQUID}, kT=1.0, box=edges)
    built = dpd.build(scene, dt=0.02, scheme="middle", seed=seed)
    simulation, slabs, whole = built.simulation(), SlabStressReporter(10, built, bins=24), StressReporter(10, built)
    simulation.step(1000)
    simulation.reporters += [slabs, whole]
    simulation.step(steps)
    return slabs, whole


@pytest.mark.slow
@any_seed(3)
def test_a_film_is_in_equilibrium(seed):
    """The normal component is 0, the pressure of the vapour, in every slab; the integral is the tension from the whole box.

    Components in the middle of the liquid are equal; at the surface the tangential one is below -3, so a wrong path would show."""
    slabs, whole = film(seed, 6000)
    tension = 2 * surface_tension(whole.pressures, whole.edges[:, 2]).mean
    assert slabs.tensions.sum(axis=1).mean() == pytest.approx(tension, rel=1e-10)
    rows = slabs.pressures
    for slab in range(24):
        mean, _, bound = bounded(rows[:, slab, 2])
        assert abs(mean) < bound + 1e-12 and bound < 0.6
    middle = slice(10, 14)
    mean, _, bound = bounded((rows[:, middle, 2] - rows[:, middle, :2].mean(axis=2)).mean(axis=1))
    assert abs(mean) < bound < 0.6 and slabs.tensor[0][:, :2].mean(axis=1).min() < -3.0


def test_what_has_no_stress_in_slabs_is_refused():
    box = np.diag([4.1, 3.9, 5.0])
    four = [dpd.HarmonicDihedrals(np.array([[0, 1, 2, 3]]), 5.0, 1, 1)]
    tilted = TILTED + np.array([[0, 0, 0], [0, 0, 0], [0.5, 0, 0]])
    for scene, message, axis in (
        (chains(PLAIN, box, dihedrals=four), "of dihedrals is not known in slabs: .*where all four lie in a plane", "z"),
        (replace(chains(PLAIN, box), reactions=[replace(FORMATION, dihedral=four[0])]), "stress of dihedrals", "z"),
        (chains(PLAIN, tilted), "use z", "x"),
        (chains(PLAIN, box), "axis must be", "r"),
        (chains(PLAIN, box, shear=dpd.LeesEdwards(0.1)), "images slide along x", "x"),
    ):
        built = dpd.build(scene, dt=0.01, scheme="bababo", seed=1)
        raises(dpd.ParameterError, message, SlabStressReporter, 1, built, axis)
    built = dpd.build(chains(PLAIN, box), dt=0.01, seed=1)
    raises(dpd.ParameterError, "no samples yet", lambda: SlabStressReporter(1, built).centres)
