"""Viscosity, normal stresses and moduli from made-up stress series with known answers, and strains and boxes of shears."""

from types import SimpleNamespace

import numpy as np
import pytest
from cases import cases, raises

import openmm_dpd as dpd
from openmm_dpd.analysis import shear_moduli, shear_viscosity
from openmm_dpd.kernels.shear import rate_at, sheared_box, strain_at

VOLUME = 50.0


def series(shear: dpd.LeesEdwards, times, pressure, friction) -> SimpleNamespace:
    """What a StressReporter would have: pressure (n, 6), and friction (n, 6) times the volume."""
    edges = np.tile([5.0, 5.0, 2.0], (len(times), 1))
    rates = np.array([rate_at(shear, t) for t in times])
    all_of = {"regular": pressure * VOLUME, "kinetic": 0.25 * pressure * VOLUME, "pressures": pressure, "friction": friction}
    return SimpleNamespace(shear=shear, sheared=times, rates=rates, edges=edges, **all_of)


def test_viscosity_and_normal_stresses():
    """Means of white noise, 5 standard errors at most; the errors are those of the series."""
    rng, rate, n = np.random.default_rng(1), -0.4, 4000
    means = np.array([23.0, 24.0, 22.5, 0.3, 0.0, 0.0])
    pressure = means + rng.normal(size=(n, 6))
    friction = VOLUME * np.array([0.0, 0.0, 0.5, 0.1, 0.0, 0.0]) * np.ones((n, 6))
    found = shear_viscosity(series(dpd.LeesEdwards(rate=rate), np.arange(n) * 0.1, pressure, friction))
    assert abs(found.viscosity - 1.0) < 5 * found.error and found.error == pytest.approx(1 / 0.4 / n**0.5, rel=0.25)
    assert abs(found.first_normal - 1.0) < 5 * found.first_normal_error and abs(found.second_normal + 1.0) < 5 * found.second_normal_error
    assert found.first_normal_error == pytest.approx((2 / n) ** 0.5, rel=0.25) and found.rate == rate
    of_all = found.viscosity, found.first_normal, found.second_normal
    assert np.allclose(np.sum(list(found.parts.values()), axis=0), of_all, rtol=1e-12) and found.parts["friction"] == pytest.approx(
        (0.25, 0, 0.5)
    )
    assert np.allclose(found.parts["conservative"], 3 * np.array(found.parts["kinetic"]), rtol=1e-12)


def test_viscosity_after_a_ramp():
    """At the rate that a ramp has reached; while it goes on there is none."""
    shear, rows = dpd.LeesEdwards(rate=0.0, end_rate=0.5, ramp_time=10.0), np.zeros((200, 6))
    rows[:, 3] = -0.7
    assert shear_viscosity(series(shear, 10 + np.arange(200.0), rows, 0 * rows)).viscosity == pytest.approx(1.4)
    raises(dpd.ParameterError, "constant rate", lambda: shear_viscosity(series(shear, 9 + np.arange(200.0), rows, 0 * rows)))


def test_moduli_of_a_maxwell_fluid():
    """G' and G'' of one relaxation time, with an offset and noise; a last period that is not whole is left out."""
    tau, g, shear = 0.6, 3.0, dpd.LeesEdwards(amplitude=0.2, frequency=2.0)
    wt, times = 2.0 * tau, np.arange(0.37, 0.37 + 800.3 * np.pi, np.pi / 24)
    storage, loss = g * wt**2 / (1 + wt**2), g * wt / (1 + wt**2)
    rows = np.random.default_rng(3).normal(size=(len(times), 6)) * 0.05
    rows[:, 3] -= 0.2 * (storage * np.sin(2.0 * times) + loss * np.cos(2.0 * times)) - 0.1
    found = shear_moduli(series(shear, times, 0.7 * rows, 0.3 * rows * VOLUME))
    assert abs(found.storage - storage) < 5 * found.storage_error and abs(found.loss - loss) < 5 * found.loss_error
    expected = 0.05 / 0.2 * (2 / len(times)) ** 0.5
    assert found.storage_error == pytest.approx(expected, rel=0.25) and found.loss_error == pytest.approx(expected, rel=0.25)
    assert found.periods == 800 and found.frequency == 2.0 and found.amplitude == 0.2


def test_series_that_say_nothing():
    """Each error has its reason."""
    rows, times = np.zeros((30, 6)), np.arange(30.0)
    steady, swinging = dpd.LeesEdwards(rate=1.0), dpd.LeesEdwards(amplitude=0.1, frequency=1.0)
    for call, given, reason in (
        (shear_viscosity, SimpleNamespace(shear=None), "scene with a LeesEdwards shear"),
        (shear_viscosity, series(swinging, times, rows, rows), "constant rate"),
        (shear_viscosity, series(dpd.LeesEdwards(rate=0.0), times, rows, rows), "other than 0"),
        (shear_viscosity, series(steady, times[:3], rows[:3], rows[:3]), "too few"),
        (shear_viscosity, series(steady, times[:0], rows[:0], rows[:0]), "no sample"),
        (shear_moduli, series(steady, times, rows, rows), "oscillating"),
        (shear_moduli, series(swinging, times, rows, rows), "whole periods"),
    ):
        raises(dpd.ParameterError, reason, call, given)


@cases(
    "shear",
    dpd.LeesEdwards(rate=-0.3),
    dpd.LeesEdwards(rate=0.2, end_rate=-1.0, ramp_time=3.0),
    dpd.LeesEdwards(amplitude=0.7, frequency=1.3),
)
def test_strain_is_the_integral_of_the_rate(shear):
    """By Simpson's rule in pieces of 0.01."""
    times = np.linspace(0, 6, 1201)
    rates = np.array([rate_at(shear, t) for t in times])
    integral = np.cumsum((rates[:-2:2] + 4 * rates[1::2] + rates[2::2]) / 6 * 0.01)
    assert strain_at(shear, 0.0) == 0.0
    assert np.allclose([strain_at(shear, t) for t in times[2::2]], integral, rtol=0, atol=1e-9)


def test_boxes_are_reduced_and_of_the_lattice():
    """No tilt above half an edge, and a whole number of edges from the shift of the images."""
    box = np.diag([3.0, 4.0, 5.0])
    for strain in np.linspace(-3, 3, 241):
        tilt = sheared_box(box, strain)[1, 0]
        turns = (4.0 * strain - tilt) / 3.0
        assert abs(tilt) <= 1.5 and abs(turns - round(turns)) < 1e-12
