"""The comparison of a mean temperature with the set one, on series whose answer is known."""

from types import SimpleNamespace

import numpy as np
import pytest

import openmm_dpd as dpd
from openmm_dpd.measure.watch import TemperatureWatch, has_set_temperature, temperature_warning
from openmm_dpd.plan.plan import make_plan

DOF = 1122  # of 375 beads: one row is known to 4.2 %


def rows(mean: float, n: int, correlation: float = 0.0, seed: int = 1) -> np.ndarray:
    """Kinetic temperatures as in equilibrium, at some mean; with an exponential correlation from row to row."""
    noise = np.random.default_rng(seed).normal(size=n)
    for k in range(1, n):
        noise[k] = correlation * noise[k - 1] + (1 - correlation**2) ** 0.5 * noise[k]
    return mean * (1 + (2 / DOF) ** 0.5 * noise)


@pytest.mark.parametrize(
    ("mean", "n", "wrong"),
    [(1.0, 20, False), (1.04, 2000, False), (1.30, 20, True), (0.70, 20, True), (1.10, 200, True), (1.10, 6, False), (1.30, 5, False)],
)
def test_what_is_off_is_said(mean, n, wrong):
    """4 % is let pass however well it is known; 10 % is noise of few rows; five rows say nothing."""
    assert (temperature_warning(rows(mean, n), 1.0, DOF) is not None) == wrong


def test_rows_close_in_time_say_no_more_than_one():
    """No false alarm in two hundred runs in equilibrium whose rows are correlated over many rows."""
    for seed in range(100):
        assert temperature_warning(rows(1.0, 20, correlation=0.97, seed=seed), 1.0, DOF) is None
        assert temperature_warning(rows(1.0, 80, correlation=0.9, seed=seed), 1.0, DOF) is None


def test_the_sentence():
    text = temperature_warning([9.0] * 20 + [1.3] * 20, 1.25, 10**9, " kJ/mol")
    assert text is None  # 4 %
    text = temperature_warning([9.0] * 20 + [2.5] * 20, 1.25, 10**9, " kJ/mol")
    hot = "the kinetic temperature of the last 20 rows is 2.5 kJ/mol, 100 % above the set 1.25 kJ/mol"
    assert text.startswith(f"{hot}; the step size may be")


def test_a_quench_on_its_way_is_left_alone():
    assert temperature_warning(1 + 5 * np.exp(-np.arange(20) / 6), 1.0, 10**5) is None
    assert temperature_warning(2 + 5 * np.exp(-np.arange(20) / 2), 1.0, 10**5) is not None


def test_nothing_to_compare_with():
    assert temperature_warning([2.0] * 40, 0.0, DOF) is None
    assert temperature_warning([0.0] * 40, 1.0, 0) is None


# -- scenes ----------------------------------------------------------------------------------------------------------------------
def plan(kT=1.0, pair=None, **options):
    x = np.random.default_rng(1).random((81, 3)) * 3
    pairs = {("W", "W"): pair or dpd.DPD(A=25, gamma=4.5)}
    return make_plan(dpd.Scene({"W": 1.0}, ["W"] * 81, x, pairs, kT=kT, box=[3.0] * 3, **options), dt=0.01, seed=1)


def test_scenes_with_a_set_temperature():
    still, moving = np.zeros((81, 3)), np.zeros((81, 3))
    moving[0, 0] = 1.0
    mobile = np.arange(81) > 0
    assert has_set_temperature(plan()) and has_set_temperature(plan(shear=dpd.LeesEdwards(0.2)))
    assert has_set_temperature(plan(mobile=mobile, velocities=still))
    assert not has_set_temperature(plan(mobile=mobile, velocities=moving))
    assert not has_set_temperature(plan(body_forces=[dpd.BodyForce([0.1, 0, 0])]))
    assert not has_set_temperature(plan(pair=dpd.DPD(A=25)))
    assert not has_set_temperature(plan(kT=dpd.TemperatureRamp(1.0, 2.0, 0, 100)))
    energies = dpd.InternalEnergy({"W": dpd.ConstantHeatCapacity(10.0)}, 1.0)
    assert not has_set_temperature(plan(pair=dpd.EnergyDPD(A=25, sigma=3.0, kappa=1.0), internal=energies))


def test_a_running_simulation_is_looked_at_now_and_then_until_something_was_said():
    def add(watch, kT, n, target=1.0):
        return [watch.add(SimpleNamespace(kT=kT, target_kT=target, dof=DOF)) is not None for _ in range(n)]

    assert add(TemperatureWatch(plan()), 2.0, 100) == [False] * 19 + [True] + [False] * 80
    watch = TemperatureWatch(plan())
    assert not any(add(watch, 1.0, 39))
    assert not any(add(watch, 2.0, 1 + 20))  # the last of 40 rows says nothing yet
    assert add(watch, 2.0, 20) == [False] * 19 + [True]  # 80
    watch = TemperatureWatch(plan())
    assert not any(add(watch, 1.0, 30))
    assert add(watch, 1.0, 20, target=2.0) == [False] * 19 + [True]  # rows count from the change on
