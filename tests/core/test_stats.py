"""Averages with errors, the comparison of a mean temperature with the set one, and how often ``judged.py`` is wrong: on series whose answer is known."""

import inspect
from types import SimpleNamespace

import numpy as np
import pytest
from cases import cases, raises
from judged import LEVEL, SHIFT, any_seed, bounded, judge, ratios
from scenes import beads

import openmm_dpd as dpd
from openmm_dpd.base.errors import ParameterError
from openmm_dpd.measure.temperature import TemperatureWatch, has_set_temperature, temperature_warning
from openmm_dpd.plan.plan import make_plan
from openmm_dpd.stats import Average, block_average, equilibrated, ratio_average


def ar1(phi: float, rows: int, count: int, seed: int) -> np.ndarray:
    """(count, rows) independent stationary series x_k = phi x_(k-1) + e_k with unit noise."""
    noise = np.random.default_rng(seed).standard_normal((rows, count))
    series = np.empty((rows, count))
    series[0] = noise[0] / np.sqrt(1 - phi**2)
    for row in range(1, rows):
        series[row] = phi * series[row - 1] + noise[row]
    return series.T


def ar1_sem(phi: float, rows: int) -> float:
    """Standard error of the mean of such a series, exactly."""
    lag = np.arange(1, rows)
    return float(np.sqrt((1 + 2 * np.sum((1 - lag / rows) * phi**lag)) / (1 - phi**2) / rows))


@pytest.mark.parametrize(("phi", "rows"), [(0.0, 300), (0.0, 5000), (0.5, 1000), (0.9, 5000), (0.97, 20000)])
def test_error_of_ar1_series(phi, rows):
    """The mean reported error is within 12 % of the true one, single ones within a factor 2, and z-scores have unit spread."""
    series = ar1(phi, rows, count=100, seed=17)
    averages = [block_average(row) for row in series]
    ratio = np.array([average.sem for average in averages]) / ar1_sem(phi, rows)
    # the spread of one error is about 0.2 or less, so the mean over 100 has a standard error of 0.02; the rest is the method's bias,
    # which is upwards (the largest of several noisy values counts)
    assert 0.92 < ratio.mean() < 1.12
    assert np.all((ratio > 0.5) & (ratio < 2.0))
    assert all(average.converged for average in averages)
    z = np.array([average.mean for average in averages]) / np.array([average.sem for average in averages])
    assert 0.65 < z.std() < 1.3  # standard error of the spread of 100 unit normals: 0.07


@pytest.mark.parametrize("phi", [0.0, 0.5, 0.9])
def test_correlation_time(phi):
    """Tau = (1 + phi)/(1 - phi)/2 rows, within 15 % on average."""
    tau = np.mean([block_average(row).tau for row in ar1(phi, 10000, count=40, seed=3)])
    assert tau == pytest.approx((1 + phi) / (1 - phi) / 2, rel=0.15)


@pytest.mark.parametrize(("phi", "times"), [(0.0, 60), (0.9, 10), (0.9, 50), (0.9, 100), (0.99, 50)])
def test_too_short_is_said(phi, times):
    """Hardly a series of so few correlation times counts as long enough: by chance one in 30 at 100 times."""
    tau = (1 + phi) / (1 - phi) / 2
    averages = [block_average(row) for row in ar1(phi, round(times * tau), count=200, seed=8)]
    assert np.mean([average.converged for average in averages]) < 0.08


@pytest.mark.parametrize("times", [200, 250, 400])
def test_errors_of_series_that_are_long_enough(times):
    """Those that count as converged have the right error, though some of them do because it came out small: at most 15 % below."""
    rows = round(9.5 * times)
    averages = [block_average(row) for row in ar1(0.9, rows, count=300, seed=12)]
    chosen = [average for average in averages if average.converged]
    assert len(chosen) > (90 if times == 200 else 200)
    # errors scatter by a sixth, so that the mean of 90 squares is known to 4 %
    assert 0.8 < np.sqrt(np.mean([average.sem**2 for average in chosen])) / ar1_sem(0.9, rows) < 1.15
    assert np.mean([abs(average.mean) < 2 * average.sem for average in chosen]) > 0.85


@cases(
    "values, expected",
    ([], Average(None, None, 0, None)),
    ([2.5], Average(2.5, None, 0, None)),
    ([1.0, 2.0], Average(1.5, None, 0, None)),
    ([1.0, 2.0, 3.0, 6.0], Average(3.0, None, 0, None)),
    ([0.1] * 7, Average(0.1, 0.0, 7, None, True)),
)
def test_short_series(values, expected):
    assert block_average(values) == expected
    assert ratio_average(values, np.ones(len(values))) == expected


def test_five_rows_have_an_error():
    average = block_average([1.0, 2.0, 3.0, 4.0, 6.0])
    assert average.sem == pytest.approx(np.std([1, 2, 3, 4, 6], ddof=1) / np.sqrt(5), rel=1e-12)
    assert (average.n_blocks, average.converged) == (5, False)
    assert block_average([1.0, 2.0], min_blocks=2).sem == pytest.approx(0.5, rel=1e-12)


@pytest.mark.parametrize("bad", [np.nan, np.inf])
def test_values_that_are_not_finite_are_named(bad):
    values = np.ones(20)
    values[13] = bad
    raises(ParameterError, rf"the pressure is {bad} in row 13 ", lambda: block_average(values, name="the pressure"))
    raises(ValueError, "row 13 ", lambda: ratio_average(np.ones(20), values))


def test_arguments_are_checked():
    raises(ParameterError, r"shape \(2, 2\)", lambda: block_average(np.ones((2, 2))))
    raises(ParameterError, "min_blocks is 1", lambda: block_average([1.0, 2.0], min_blocks=1))
    raises(ParameterError, "3 and 4 rows", lambda: ratio_average(np.ones(3), np.ones(4)))
    raises(ParameterError, "mean 0", lambda: ratio_average(np.ones(6), [1, -1, 1, -1, 1, -1]))
    raises(ParameterError, "sequence of numbers", lambda: block_average(["a"]))


def test_mean_and_error_of_a_ratio():
    # a = 3 + x + y/2 over b = 2 + x/2 with AR(1) x and y: the spread of R over 300 series is what the jackknife says
    rows, phi = 4000, 0.8
    x, y = ar1(phi, rows, 300, seed=21) * 0.3, ar1(phi, rows, 300, seed=22) * 0.3
    averages = [ratio_average(3 + u + v / 2, 2 + u / 2) for u, v in zip(x, y, strict=True)]
    ratios = np.array([average.mean for average in averages])
    reported = np.mean([average.sem for average in averages])
    assert 0.85 < reported / ratios.std(ddof=1) < 1.2  # the spread over 300 series is known to 4 %; the method's bias is up to 8 %
    assert abs(ratios.mean() - 1.5) < 4 * ratios.std(ddof=1) / np.sqrt(len(ratios))
    # a common factor drops out, however much it fluctuates; a denominator in one block only leaves no error
    assert ratio_average([1.0, 2.0, 3.0, 2.0, 4.0, 6.0], [1.0, 4.0, 1.0, 4.0, 1.0, 1.0]).mean == pytest.approx(18 / 12, rel=1e-14)
    x = np.exp(ar1(0.9, 2000, 1, seed=9)[0])
    assert ratio_average(2 * x, x).sem < 1e-14
    numerator, denominator = np.linspace(1.0, 2.0, 20), np.zeros(20)
    denominator[:3] = 0.5
    assert ratio_average(numerator, denominator) == Average(pytest.approx(30 / 1.5), None, 0, None)


@pytest.mark.parametrize(("phi", "rows"), [(0.0, 40), (0.0, 1000), (0.9, 1000), (0.97, 10000)])
def test_hardly_anything_is_cut_off_in_equilibrium(phi, rows):
    """A few per cent of the rows, and what is left is not biased by the choice."""
    series = ar1(phi, rows, 400, seed=11)
    starts = [equilibrated(one) for one in series]
    means = np.array([one[start:].mean() for one, start in zip(series, starts, strict=True)])
    assert np.mean(starts) < 0.06 * rows and max(starts) <= rows / 2
    assert abs(means.mean()) < 4 * means.std() / 20 and means.std() < 1.2 * ar1_sem(phi, rows)


@pytest.mark.parametrize(("phi", "rows"), [(0.0, 50), (0.0, 1000), (0.9, 1000), (0.0, 10000)])
@pytest.mark.parametrize(("height", "decay"), [(30.0, 0.02), (10.0, 0.1), (3.0, 0.1)])
def test_the_start_is_left_out_to_within_the_error(phi, rows, height, decay):
    """An exponential start, in units of the spread and of the length of the series: over all rows it is off by many errors."""
    spread = 1 / np.sqrt(1 - phi**2)
    series = ar1(phi, rows, 200, seed=12) + spread * height * np.exp(-np.arange(rows) / (decay * rows))
    starts = [equilibrated(one) for one in series]
    off = np.mean([one[start:].mean() for one, start in zip(series, starts, strict=True)])
    error = np.mean([block_average(one[start:]).sem for one, start in zip(series, starts, strict=True)])
    assert abs(off) < 1.5 * error and abs(off) < 0.5 * series.mean()
    assert max(starts) <= rows / 2


def test_what_cannot_be_cut():
    """Constant and short series are left whole; of what drifts to its end half is left out."""
    assert equilibrated(np.ones(100)) == 0 == equilibrated(np.arange(9.0)) == equilibrated([])
    assert equilibrated(np.arange(1000.0)) == 500
    raises(ParameterError, "is nan in row 1", lambda: equilibrated([1.0, np.nan]))


def series(tau: float, rows: int, count: int = 3000) -> np.ndarray:
    """(count, rows) stationary, with mean 0, variance 1 and correlation exp(-k/tau) (AR(1)); uncorrelated for tau = 0."""
    rng, rho = np.random.default_rng(1), np.exp(-1 / tau) if tau else 0.0
    x = rng.normal(size=(rows, count))
    for k in range(1, rows):
        x[k] = rho * x[k - 1] + np.sqrt(1 - rho**2) * x[k]
    return x.T


@pytest.mark.parametrize("tau", [0.0, 1.0, 3.0, 8.0])
def test_false_alarms_and_the_truth(tau):
    """One seed: in no more than 3 of 1,000 right series, so all three in less than 1 of a million; a shift of six standard errors is nearly always seen."""
    rho = np.exp(-1 / tau) if tau else 0.0
    rows = max(600, round(250 * tau))
    true = np.sqrt((1 + rho) / (1 - rho) / rows)
    mean, sem, bound = np.array([bounded(row) for row in series(tau, rows)]).T
    assert np.mean(np.abs(mean) > bound) < 3.1e-3, np.sum(np.abs(mean) > bound)
    assert np.mean(np.abs(mean + 6 * true) > bound) > 0.95
    assert np.sqrt(np.mean(sem**2)) == pytest.approx(true, rel=0.06)


@pytest.mark.parametrize("wrong", [0, 1, 2, 3])
def test_three_seeds_have_to_fail(wrong):
    seen = []

    @any_seed(5)
    def test(seed, other):
        seen.append(seed - SHIFT)
        assert len(seen) > wrong, other

    assert list(inspect.signature(test).parameters) == ["other"]
    if wrong == 3:
        raises(AssertionError, "of another", lambda: test(other="of another"))
    else:
        test(other="")
    assert seen == [5, 1005, 2005][: wrong + 1] and LEVEL**3 < 1e-8


def test_what_fails():
    good = np.random.default_rng(1).normal(size=500)
    judge(good, 0.0, error=0.1)
    judge(1 + good, 0.0, error=0.1, beside=0.95)
    for series, error, message in (
        (1 + good, 0.1, r"to be within 0\.1\d of 0"),
        (good, 0.01, r"not below 0\.01"),
        (np.cumsum(good), 1.0, "run longer"),
    ):
        raises(AssertionError, message, judge, series, 0.0, error=error)


def test_a_ratio_of_means():
    """Mean 3/2; the variance of a - R b, 1 + R^2 for independent ones, over that of the mean of b squared."""
    above, below = 3.0 + series(3.0, 4000, 2)[0], 2.0 + series(3.0, 4000, 2)[1]
    found = ratios(above, below)
    assert found.mean() == pytest.approx(above.mean() / below.mean(), rel=1e-12)
    assert found.std() == pytest.approx(np.sqrt(1 + 1.5**2) / 2, rel=0.1)
    judge(found, 1.5, error=0.05)


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
    """No false alarm in two hundred runs in equilibrium whose rows are correlated, nor in a quench on its way."""
    for seed in range(100):
        assert temperature_warning(rows(1.0, 20, correlation=0.97, seed=seed), 1.0, DOF) is None
        assert temperature_warning(rows(1.0, 80, correlation=0.9, seed=seed), 1.0, DOF) is None
    assert temperature_warning(1 + 5 * np.exp(-np.arange(20) / 6), 1.0, 10**5) is None
    assert temperature_warning(2 + 5 * np.exp(-np.arange(20) / 2), 1.0, 10**5) is not None


def test_the_sentence():
    assert temperature_warning([9.0] * 20 + [1.3] * 20, 1.25, 10**9, " kJ/mol") is None  # 4 %
    text = temperature_warning([9.0] * 20 + [2.5] * 20, 1.25, 10**9, " kJ/mol")
    hot = "the kinetic temperature of the last 20 rows is 2.5 kJ/mol, 100 % above the set 1.25 kJ/mol"
    assert text.startswith(f"{hot}; the step size may be")
    hot = [9.0] * 20 + [1.3] * 20
    text = temperature_warning(hot, 1.25, 10**9, sheared=True)
    assert "relative to the flow is 1.3, 4 % above the set 1.25; the shear heats" in text
    assert temperature_warning([9.0] * 20 + [1.26] * 20, 1.25, 10**9, sheared=True) is None
    assert "not equilibrated" in temperature_warning([9.0] * 20 + [1.2] * 20, 1.25, 10**9, sheared=True)
    assert temperature_warning([2.0] * 40, 0.0, DOF) is None
    assert temperature_warning([0.0] * 40, 1.0, 0) is None


# -- scenes ----------------------------------------------------------------------------------------------------------------------
def plan(kT=1.0, pair=None, **options):
    return make_plan(beads(table={("W", "W"): pair or dpd.DPD(A=25, gamma=4.5)}, kT=kT, **options), dt=0.01, seed=1)


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
    def add(watch, kT, n, target=1.0, dof=DOF):
        return [watch.add(SimpleNamespace(kT=kT, target_kT=target, dof=dof)) is not None for _ in range(n)]

    assert add(TemperatureWatch(plan()), 2.0, 100) == [False] * 19 + [True] + [False] * 80
    watch = TemperatureWatch(plan())
    assert not any(add(watch, 1.0, 39))
    assert not any(add(watch, 2.0, 1 + 20))  # the last of 40 rows says nothing yet
    assert add(watch, 2.0, 20) == [False] * 19 + [True]  # 80
    assert not any(add(TemperatureWatch(plan()), 1.03, 40, dof=10**6))
    assert any(add(TemperatureWatch(plan(shear=dpd.LeesEdwards(0.2))), 1.03, 40, dof=10**6))
    watch = TemperatureWatch(plan())
    assert not any(add(watch, 1.0, 30))
    assert add(watch, 1.0, 20, target=2.0) == [False] * 19 + [True]  # rows count from the change on
