"""How often ``judged.py`` is wrong about series whose correlation is known."""

import inspect

import numpy as np
import pytest
from cases import raises
from judged import LEVEL, SHIFT, any_seed, bounded, judge, ratios


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
