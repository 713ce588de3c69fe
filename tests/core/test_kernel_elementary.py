"""The kernels' own exp, log, powers, sines and error function against mpmath, as compiled code and as Python."""

import mpmath
import numba
import numpy as np
import pytest
from cases import cases

from openmm_dpd.kernels import noise
from openmm_dpd.kernels.elementary import erfc, exp, log, power as compiled_power, sine

power = compiled_power.py_func

_RNG = np.random.default_rng(1)
_WIDE = _RNG.uniform(-700, 700, 3000)
CASES = {  # Function, mpmath's, arguments, and the largest error: in units of the last place, or absolute.
    "exp": (exp, mpmath.exp, np.concatenate([_RNG.uniform(-1, 1, 3000), _WIDE]), 1.0, None),
    "log": (log, mpmath.log, np.concatenate([_RNG.uniform(0.5, 2, 3000), 1 + 1e-3 * _RNG.normal(size=2000), np.exp(_WIDE)]), 1.0, None),
    "sine": (sine, lambda x: mpmath.sin(2 * mpmath.pi * x), np.concatenate([_RNG.uniform(-3, 3, 2000), np.arange(-8, 9) / 8]), None, 6e-16),
    "erfc": (erfc, mpmath.erfc, np.concatenate([_RNG.uniform(0, 7, 1000), _RNG.uniform(2.2, 2.3, 300), [0.0, 30.0]]), None, 6e-16),
}


def compiled(function, x):
    """Values of a loop that numba has compiled."""

    @numba.njit(error_model="numpy")
    def loop(x, y):
        for k in range(len(x)):
            y[k] = function(x[k])

    y = np.empty_like(x)
    loop(x, y)
    return y


@cases("function, exact, x, ulps, absolute", CASES)
def test_errors(function, exact, x, ulps, absolute):
    found = compiled(function, x)
    with mpmath.workprec(160):
        true = [exact(mpmath.mpf(float(a))) for a in x]
        error = np.array([abs(float(mpmath.mpf(float(f)) - t)) for f, t in zip(found, true, strict=True)])
    bound = absolute if ulps is None else ulps * np.spacing(np.abs(np.array(true, dtype=float)))
    assert np.all(error <= bound), (x[np.argmax(error / bound)], np.max(error / bound))
    # in Python too, with arrays where they are taken
    assert np.array_equal(found, [function(a) for a in x] if function is log else function(x))


def test_errors_of_powers():
    rng = np.random.default_rng(2)
    w, s = 1 - rng.random(3000), rng.uniform(0.01, 8, 3000)
    with mpmath.workprec(160):
        for a, b in zip(w, s, strict=True):
            error = abs(float(mpmath.mpf(float(power(a, b))) / mpmath.mpf(a) ** mpmath.mpf(b) - 1))
            assert error < 2.0**-52 * (1 + abs(b * np.log(a)))
    assert [power(0.3, 1.0), power(0.3, 0.5), power(0.3, 0.0)] == [0.3, np.sqrt(0.3), 1.0]
    assert [power(0.0, 2.0), power(0.0, 0.3), power(0.0, 0.0), power(1.0, 7.3)] == [0.0, 0.0, 1.0, 1.0]


@pytest.mark.filterwarnings("ignore:overflow")
def test_special_values():
    """Infinities, numbers too large or too small, those with fewer bits, and what is no number."""
    x = np.array([-np.inf, -745.2, -745.1, -740.3, -0.0, 709.78, 709.79, np.inf, np.nan])
    expected = [0.0, 0.0, 5e-324, 3.1e-322, 1.0, 1.7928227943945155e308, np.inf, np.inf, np.nan]
    assert np.array_equal(compiled(exp, x), expected, equal_nan=True)
    assert np.array_equal(exp(x), expected, equal_nan=True)
    x = np.array([0.0, -1.0, 1.0, np.inf, np.nan])
    assert np.array_equal(compiled(log, x), [-np.inf, np.nan, 0.0, np.inf, np.nan], equal_nan=True)
    tiny = np.array([5e-324, 1e-310, 2.2e-308])
    np.testing.assert_allclose(compiled(log, tiny), [float(mpmath.log(mpmath.mpf(float(a)))) for a in tiny], rtol=3e-16)


def test_no_library_decides_the_numbers_at_the_edges_of_the_cells_of_the_noise():
    """They are rounded, and the true ones are ten times a library's error and more away from where that would go the other way."""
    with mpmath.workprec(160):
        places = [mpmath.mpf(1) / 2 + mpmath.mpf(k) / (2 * noise._CELLS) for k in range(1, noise._SMOOTH + 1)]
        true = [mpmath.sqrt(2) * mpmath.erfinv(2 * p - 1) * 2**noise.ROUNDED for p in places]
        assert all(float(abs(t - mpmath.floor(t) - 0.5)) > 2.0**noise.ROUNDED * 6e-15 for t in true)
        assert list(noise._CUBICS[1:, 0] * 2.0**noise.ROUNDED) == [float(mpmath.nint(t)) for t in true[: noise._SMOOTH - 1]]
