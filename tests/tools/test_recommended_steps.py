"""Recommended steps of scenes that lie between the points of the table, run; benchmarks/recommended_steps.py has more of them."""

import pytest
from atlas_parts.scenes import SCENES, averages, fluid
from cases import cases
from judged import any_seed

import openmm_dpd as dpd
from openmm_dpd.advice.recommend import AIM

#: Density, friction, repulsion, exponent; nothing here is a point of the table.
FLUIDS = {"stiffer": (3.0, 20.0, 40.0, 1.0), "denser": (5.0, 2.5, 15.0, 1.0), "softer noise": (3.5, 80.0, 30.0, 0.7)}

#: Scenes with the simulated times of their runs: what is in more than one entry, which would give steps that are far too long one by one, and a
#: many-body liquid between the points of its table.
SUMS = {
    "many-body liquid, A -40, B 25, friction 18": 130.0,
    "two components, A 25, 35, 60, masses 1:2": 450.0,
    "repulsion and friction in two layers": 350.0,
    "two layers, A 25 and friction 4.5 each": 330.0,
    "stiff pairs without friction": 700.0,
}


@pytest.fixture(autouse=True)
def one_thread():
    dpd.set_threads(1)
    yield
    dpd.set_threads(None)


@pytest.mark.slow
@any_seed(4)
@cases("density, gamma, repulsion, exponent", FLUIDS)
def test_recommended_step_has_the_error_it_promises(density, gamma, repulsion, exponent, seed):
    """Asked for 2 %: both temperatures within 4 % and four standard errors (steps of the table are known to a tenth or two, and errors go with
    their square); and it is no over-careful step either, since with three times that of the table they are off by more than 2 %.
    """
    scene = fluid(500, {("A", "A"): dpd.DPD(A=repulsion, gamma=gamma, exponent=exponent)}, rho=density)
    found = dpd.recommend(scene, error=0.02)
    for value, sem in averages(scene, found.scheme, found.dt, longest=60.0, seed=seed).temperatures:
        assert sem < 0.01
        assert abs(value) < 0.04 + 4 * sem
    beyond = averages(scene, found.scheme, 3 * found.dt / AIM, longest=20.0, seed=seed)
    assert beyond is None or max(abs(value) - 4 * sem for value, sem in beyond.temperatures) > 0.02


@pytest.mark.slow
@any_seed(4)
@pytest.mark.parametrize("name", SUMS)
def test_recommended_step_of_a_scene_is_right(name, seed):
    """Asked for 1 %: both temperatures within 1.5 % and four standard errors."""
    scene = SCENES[name](600)
    found = dpd.recommend(scene)
    result = averages(scene, found.scheme, found.dt, longest=SUMS[name], seed=seed)
    assert result is not None, "the run stops"
    for value, sem in result.temperatures:
        assert sem < 0.003
        assert abs(value) < 0.015 + 4 * sem


@pytest.mark.slow
@any_seed(4)
@cases(
    "name",
    "chains, k 100",
    "FENE chains, k 30, R0 1.5",
    "FENE chains with repulsion 1 of range 0.5",
    "chains, k 100, angles k 50",
    "chains, k 100, angles k 50, dihedrals k 20",
)
def test_recommended_step_of_chains_is_neither_too_long_nor_too_short(name, seed):
    """Asked for 1 %: within 1.5 % and four standard errors; at 2.2 times the step of the table the run stops or is off by more than 1.5 %
    (k = 100 takes 0.07, where velocity Verlet's limit would give 0.008).
    """
    scene = SCENES[name](300)
    found = dpd.recommend(scene)
    result = averages(scene, found.scheme, found.dt, longest=150.0, seed=seed)
    assert result is not None, "the run stops"
    for value, sem in result.temperatures:
        assert sem < 0.008
        assert abs(value) < 0.015 + 4 * sem
    beyond = averages(scene, found.scheme, 2.2 * found.dt / AIM, longest=40.0, seed=seed)
    assert beyond is None or max(abs(value) - 4 * sem for value, sem in beyond.temperatures) > 0.015
