"""Beads at the same point: no force between them, finite forces everywhere, on every platform and precision."""

import numpy as np
import openmm
import oracle
import pytest
from cases import every_pair, raises
from devices import DEVICES
from openmm import unit
from scenes import EXTENDED, D, beads, oracle_params, run_of, state_of, stepped

import openmm_dpd as dpd
from openmm_dpd.base.geometry import coincident_pairs

CONSERVATIVE = pytest.mark.parametrize("conservative", ["kernel", "openmm"])
EDGE = 4.0


def scene_of(distance, *, box=True, kT=1.0, table=EXTENDED, n=60, **options):
    """A fluid with coincident pairs inside, a threesome, one on a corner and one across a face."""
    x = np.random.default_rng(7).random((n, 3)) * EDGE
    types = ["A", "B"] * (n // 2)
    for first, second in ((0, 1), (2, 5), (7, 8), (7, 10), (20, 40)):
        x[second] = x[first] + [0.0, distance, 0.0]
    x[50], x[51] = 0.0, EDGE if box else 0.0  # the corner of the box, from either end
    x[52] = [EDGE, 1.0, 1.0]
    x[53] = [distance, 1.0, 1.0]
    return dpd.Scene({"A": 1.0, "B": 2.7}, types, x, table, kT, box=[EDGE] * 3 if box else None, **options)


PAIRS = [(0, 1), (2, 5), (7, 8), (7, 10), (8, 10), (20, 40), (50, 51), (52, 53)]


@every_pair("device, conservative, distance", DEVICES, ("kernel", "openmm"), (0.0, 1e-12), indirect=["device"])
def test_forces_are_those_of_all_other_pairs(device, conservative, distance):
    scene = scene_of(distance)
    assert coincident_pairs(scene.positions, scene.box, 1e-9) == PAIRS
    built = dpd.build(scene, dt=0.01, platform=device.platform, conservative=conservative, seed=3)
    forces = dpd.force_terms(built, properties=device.properties)
    expected = oracle.conservative(scene.positions, scene.type_ids, oracle_params(scene), scene.box)
    # single precision has no 1e-12 beside a coordinate of 4, and a pair at 0 has no force either
    exact = 1e-9 if conservative == "kernel" or device.platform == "Reference" else 2e-4
    np.testing.assert_allclose(forces["conservative"], expected.forces, rtol=0, atol=device.choose(exact, 2e-4, 2e-4))
    for name in ("dissipative", "random"):
        assert np.all(np.isfinite(forces[name]))
    energy = built.simulation(properties=device.properties).context.getState(energy=True).getPotentialEnergy()
    value = energy.value_in_unit(unit.kilojoule_per_mole)
    assert value == pytest.approx(expected.energy, rel=1e-5 if device.exact and conservative == "kernel" else 1e-4)


@CONSERVATIVE
@pytest.mark.parametrize("scheme", ["mvv", "shardlow", "middle", "aboba", "bababo"])
def test_steps_follow_the_scene_without_coincidence(conservative, scheme):
    """A pair that starts at r = 0 moves as one that starts at r = 2e-10 does until the force between them counts: same noise, same neighbours."""

    def run(distance):
        x = np.array([[1.0, 1.0, 1.0], [1.0 + distance, 1.0, 1.0], [1.6, 1.0, 1.0]])
        v = np.array([[0.0, 1.0, 0.0], [0.0, -1.0, 0.0], [0.0, 0.0, 0.0]])
        scene = dpd.Scene({"W": 1.0}, ["W"] * 3, x, {("W", "W"): D(A=25, gamma=4.5)}, 0.0, box=[4.0] * 3, velocities=v)
        built = dpd.build(scene, dt=0.001, scheme=scheme, conservative=conservative, platform="Reference", seed=1)
        return state_of(stepped(built.simulation(), 3).context)

    (x, v), (_, other) = run(0.0), run(1e-11)
    np.testing.assert_allclose(v, other, atol=1e-9)
    assert abs(x[0, 1] - x[1, 1]) == pytest.approx(0.006, rel=0.2)
    # the third bead is pushed to the right by both, as by one pair of beads at one point
    assert v[2, 0] == pytest.approx(2 * 25 * 0.4 * 0.003, rel=0.25)


@CONSERVATIVE
def test_many_beads_at_one_point(conservative):
    """Thirty of them: 435 pairs without a force, then a cloud that flies apart."""
    x = np.random.default_rng(1).random((60, 3)) * 3
    x[:30] = [1.5, 1.5, 1.5]
    for scheme in ("mvv", "middle"):
        simulation = run_of(beads(60, positions=x), DEVICES[0], dt=0.005, scheme=scheme, conservative=conservative)
        forces = simulation.context.getState(forces=True).getForces(asNumpy=True)
        assert np.all(np.isfinite(forces))
        assert np.allclose(forces[:30], forces[0])  # each feels the thirty others outside, and nothing from its companions
        simulation.step(100)
        assert np.all(np.isfinite(state_of(simulation.context)[0]))


@CONSERVATIVE
def test_bonded_and_scaled_beads_at_one_point(host, conservative):
    """A factor of 1/2 on a pair at r = 0: half of nothing; a bond of rest length 0 between them is legal too."""
    scene = scene_of(0.0, bonds=[dpd.HarmonicBonds(np.array([(0, 1), (2, 5)]), 10.0, 0.0)], bonded_factors=(0.5, 1.0, 1.0))
    simulation = stepped(run_of(scene, host, dt=0.01, scheme="middle", conservative=conservative), 5)
    assert all(np.all(np.isfinite(a)) for a in state_of(simulation.context))


def met(host, conservative):
    """Two beads on top of each other, put there after the start."""
    simulation = run_of(beads(), host, dt=0.02, scheme="middle", conservative=conservative)
    x, _ = state_of(simulation.context)
    x[3] = x[4]
    simulation.context.setPositions(x)
    return simulation


def test_beads_that_meet_later(host):
    """A CustomNonbondedForce gives NaN there for any expression, and only pairs that start at one point can be taken out of it: an error."""
    assert np.all(np.isfinite(state_of(stepped(met(host, "kernel"), 3).context)[0]))
    raises(openmm.OpenMMException, "NaN|not finite", lambda: met(host, "openmm").step(3))


def test_frozen_coincident_pair(host):
    """Two wall beads at one point stay there, and a third bead is pushed by both."""
    scene = scene_of(0.0, mobile=~np.isin(np.arange(60), [0, 1]))
    for conservative in ("kernel", "openmm"):
        x, v = state_of(stepped(run_of(scene, host, dt=0.02, scheme="aboba", conservative=conservative), 10).context)
        assert np.all(np.isfinite(v)) and np.array_equal(x[0], x[1])
