"""Averages of runs against what they should be: a right program fails in less than one of 100,000 runs of the suite, on any machine.

Errors come from blocks that are long against the correlation time (``decks/blocks.py``: twenty or more of them, or the run is
refused as too short), and bounds from Student's distribution for so few: :data:`LEVEL` of right runs are outside.  A test fails if
those of three seeds fail, so it may also judge several averages at once, or by an error that is known less well: what fails once
in a hundred runs fails three times in one of a million.  ``tests/core/test_stats.py`` measures both on series of known correlation.
"""

import functools
import inspect
import os
import re
from collections.abc import Callable

import numpy as np
import pytest
from decks.blocks import block_length, block_statistics, correlation_time
from scipy.special import stdtrit

LEVEL = 1e-3  # Part of right runs that are outside of the bounds.

#: Added to the first seed for the second and the third one, and to all, so that the tests can be run with others:
#: OPENMM_DPD_TEST_SEED=1 pytest -m statistical.
NEXT = 1000
SHIFT = 10 * NEXT * int(os.environ.get("OPENMM_DPD_TEST_SEED", "0"))


def any_seed(first: int) -> Callable:
    """Decorator of a test with an argument ``seed``, which passes if it does for one of three; others are taken only after a failure."""

    def decorate(test):
        @functools.wraps(test)
        def run(**arguments):
            for seed in (first, first + NEXT):
                try:
                    return test(seed=seed + SHIFT, **arguments)
                except AssertionError as failed:
                    print(f"seed {seed + SHIFT}: {failed}")
            test(seed=first + 2 * NEXT + SHIFT, **arguments)

        signature = inspect.signature(test)
        run.__signature__ = signature.replace(parameters=[p for p in signature.parameters.values() if p.name != "seed"])
        return pytest.mark.statistical(run)

    return decorate


def with_seeds(text: str, more: int) -> str:
    """A script with something added to all its seeds."""
    return re.sub(r"\bseed=(\d+)", lambda found: f"seed={int(found[1]) + more}", text)


def quantile(blocks: int) -> float:
    """How many standard errors from so many blocks the mean of a right run may be off."""
    return float(stdtrit(blocks - 1, 1 - LEVEL / 2))


def bounded(series: np.ndarray) -> tuple[float, float, float]:
    """Mean of a series of equally distant samples, its standard error, and how far from the truth the mean may be."""
    series = np.asarray(series, dtype=float)
    try:
        length = block_length(len(series), correlation_time(series))
    except RuntimeError as short:
        raise AssertionError(f"{np.mean(series):.5g}: {short}") from None
    found = block_statistics(series, length, 1)
    return found["mean"], found["sem"], quantile(found["blocks"]) * found["sem"]


def ratios(above: np.ndarray, below: np.ndarray) -> np.ndarray:
    """A series with the mean and, to first order, the error of a ratio of two means."""
    ratio, scale = np.mean(above) / np.mean(below), np.mean(below)
    return ratio + (np.asarray(above) - ratio * np.asarray(below)) / scale


def judge(series: np.ndarray, expected: float, *, error: float, beside: float = 0.0) -> None:
    """Fail unless a series has the expected mean.

    Parameters
    ----------
    series : (n,) array_like
        Equally distant samples.
    expected : float
    error : float
        The standard error is less, so that a wrong program is seen.
    beside : float
        How far from ``expected`` a right program may be: of a finite step, for example.
    """
    mean, sem, bound = bounded(series)
    assert abs(mean - expected) < bound + beside, f"{mean:.5g}, to be within {bound + beside:.2g} of {expected:.5g}"
    assert sem < error, f"the standard error of {mean:.5g} is {sem:.2g}, not below {error:.2g}"
