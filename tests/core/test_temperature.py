"""Temperatures of short runs: ramps, factors of bonded neighbours, walls."""

import numpy as np
import pytest
from devices import CPU, REFERENCE
from judged import any_seed, judge
from scenes import BOXES, EXTENDED, SCHEME, SCHEMES, D, beads, fluid, run_of, state_of, stepped

import openmm_dpd as dpd
from openmm_dpd.base.names import KT


def temperatures(scene, device=CPU, *, dt, steps, start, every=5, **choices):
    """Kinetic temperature 2K/(3N-3) of the mobile beads in every fifth step after the start."""
    simulation = stepped(run_of(scene, device, dt=dt, **choices), start)
    mobile = np.ones(scene.n_beads, bool) if scene.mobile is None else scene.mobile
    mass, values = scene.bead_masses[mobile, None], []
    dof = 3 * mobile.sum() - (3 if mobile.all() else 0)
    for _ in range(steps // every):
        simulation.step(every)
        values.append(np.sum(mass * state_of(simulation.context)[1][mobile] ** 2) / dof)
    return np.array(values)


# -- ramps ---------------------------------------------------------------------------------------------------------------------------
@SCHEME
@pytest.mark.parametrize(("begin", "end"), [(0, 10), (3, 8), (-10, 10), (5, 6)])
def test_temperature_of_every_step_of_a_ramp(choices, begin, end):
    """KT(k) = start + (stop - start)(k - begin)/(end - begin) in step k = 1, 2 ..., start before, stop after."""
    simulation = run_of(beads(kT=dpd.TemperatureRamp(1.0, 3.0, begin, end)), REFERENCE, dt=0.02, conservative="kernel", **choices)
    for k in range(1, 15):
        simulation.step(1)
        expected = 1.0 + 2.0 * min(1.0, max(0.0, (k - begin) / (end - begin)))
        assert simulation.context.getParameter(KT) == pytest.approx(expected, rel=1e-14)


def test_ramp_does_not_depend_on_how_the_run_is_cut_up_or_on_the_step_count():
    simulation = stepped(run_of(beads(kT=dpd.TemperatureRamp(1.0, 3.0, 0, 20)), REFERENCE, dt=0.02, scheme="middle"), 7)
    simulation.context.setStepCount(0)
    simulation.step(3)
    assert simulation.context.getParameter(KT) == pytest.approx(2.0)


@SCHEME
def test_a_ramp_step_is_a_step_at_that_temperature(choices):
    """One step of a ramp against a run at the temperature it has reached, from the same state and noise count."""
    warming = fluid(EXTENDED, BOXES["ortho"], n=60, kT=dpd.TemperatureRamp(1.0, 2.0, 0, 2))
    ramp = run_of(warming, REFERENCE, dt=0.02, conservative="kernel", **choices)
    fixed = run_of(fluid(EXTENDED, BOXES["ortho"], n=60, kT=1.0), REFERENCE, dt=0.02, conservative="kernel", **choices)
    ramp.step(1)
    half = state_of(ramp.context)
    if choices["scheme"] != "mvv":  # there the first force belongs to the start's temperature, the second to the ramp's
        fixed.context.setParameter(KT, 1.5)
    fixed.step(1)
    other = state_of(fixed.context)
    if choices["scheme"] == "mvv":
        assert np.abs(half[1] - other[1]).max() > 1e-3
    else:
        assert np.array_equal(half[0], other[0]) and np.array_equal(half[1], other[1])


@pytest.mark.slow
@any_seed(1)
def test_a_ramp_reaches_its_targets(seed):
    """Gamma fixed and sigma fixed: after a slow ramp, and held there, the fluid has the last temperature; 5 % off is seen."""
    start, stop = 0.5, 2.0
    table = {("A", "A"): D(A=25, gamma=20), ("A", "B"): D(A=25, sigma=6.0), ("B", "B"): D(A=25, gamma=20)}
    scene = fluid(table, np.diag([4.0] * 3), 3.0, kT=dpd.TemperatureRamp(start, stop, 0, 500))
    values = temperatures(scene, dt=0.01, start=0, steps=2800, scheme="middle", seed=seed)
    assert min(start, stop) + 0.3 < np.mean(values[40:60]) < max(start, stop) - 0.3  # halfway through the ramp it is on its way
    judge(values[120:], stop, error=0.02 * stop)


# -- what could spoil the temperature ------------------------------------------------------------------------------------------------
@pytest.mark.slow
@any_seed(1)
@pytest.mark.parametrize("choices", [SCHEMES["mvv"], SCHEMES["shardlow"]], ids=["mvv", "shardlow"])
def test_factors_of_bonded_neighbours_keep_the_temperature(choices, seed):
    """Factors 0.5, 0.25 and 0: noise goes as the square root (as f it would be 43 % too cold); a tenth is seen."""
    n = 200
    bonds = dpd.HarmonicBonds(np.array([(4 * c + a, 4 * c + a + 1) for c in range(50) for a in range(3)]), 50.0, 0.5)
    rng = np.random.default_rng(2)
    x = np.repeat(rng.random((50, 3)) * 6, 4, axis=0) + rng.normal(size=(n, 3)) * 0.3
    table = {("W", "W"): D(A=25, gamma=30.0, gamma_perp=15.0)}
    scene = beads(n, edge=6.0, positions=x, table=table, bonds=[bonds], bonded_factors=(0.5, 0.25, 0.0))
    judge(temperatures(scene, dt=0.005, start=600, steps=6000, conservative="kernel", seed=seed, **choices), 1.0, error=0.02)


@pytest.mark.slow
@any_seed(1)
@pytest.mark.parametrize("choices", [SCHEMES["mvv-0.65"], SCHEMES["aboba"]], ids=["mvv-0.65", "aboba"])
def test_unequal_masses_and_transverse_friction(choices, seed):
    """Masses 1 and 2.7, everything different: kT = 1.3 at a small step; 3 % off is seen."""
    scene = fluid(EXTENDED, np.diag([4.0] * 3), 3.0, kT=1.3)
    judge(temperatures(scene, dt=0.01, start=1200, steps=6500, conservative="kernel", seed=seed, **choices), 1.3, error=0.016)


@pytest.mark.slow
@any_seed(1)
def test_walls_at_rest_keep_the_temperature(seed):
    """5 % off is seen."""
    base = fluid(EXTENDED, np.diag([4.0] * 3), 3.0, seed=4)
    mobile = base.positions[:, 2] % 4.0 > 0.8
    scene = dpd.Scene(base.masses, base.types, base.positions, EXTENDED, 1.0, box=base.box, mobile=mobile)
    judge(temperatures(scene, dt=0.01, start=1200, steps=5000, conservative="kernel", seed=seed, scheme="middle"), 1.0, error=0.012)


def test_moving_walls_drag_the_fluid_along():
    """All walls move along x: an ideal gas with friction takes on their velocity."""
    friction = {("*", "*"): D(gamma=20.0, cutoff=1.2)}
    base = fluid(friction, np.diag([4.0] * 3), 3.0, seed=4, kT=0.1)
    mobile = base.positions[:, 2] % 4.0 > 0.8
    velocities = np.where(mobile[:, None], 0.0, [2.0, 0.0, 0.0])
    scene = dpd.Scene(base.masses, base.types, base.positions, friction, 0.1, box=base.box, mobile=mobile, velocities=velocities)
    x, v = state_of(stepped(run_of(scene, CPU, dt=0.05, scheme="middle"), 800).context)
    flow = np.average(v[mobile], axis=0, weights=scene.bead_masses[mobile])
    np.testing.assert_allclose(flow, [2.0, 0.0, 0.0], atol=0.08)  # the mean velocity of 150 beads fluctuates by sqrt(kT/M) = 0.02
    assert np.array_equal(x[~mobile], scene.positions[~mobile])


def test_initial_velocities_have_exactly_the_temperature_and_no_momentum():
    scene = dpd.Scene({"A": 1.0, "B": 2.7}, ["A", "B"] * 50, np.random.default_rng(1).random((100, 3)) * 4, EXTENDED, 1.7, box=[4.0] * 3)
    built = [dpd.build(scene, dt=0.01, platform="Reference", seed=seed) for seed in (1, 1, 2)]
    v = [np.array(b.velocities._value) for b in built]
    assert np.array_equal(v[0], v[1]) and not np.array_equal(v[0], v[2])
    mass = scene.bead_masses[:, None]
    assert np.sum(mass * v[0] ** 2) / (3 * 99) == pytest.approx(1.7, rel=1e-12)
    assert np.abs(np.sum(mass * v[0], axis=0)).max() < 1e-12
