"""What an analysis returns: a curve with its standard errors, or the average of one number."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ..base.stats import Average, block_average, ratio_average


@dataclass(frozen=True, eq=False)
class Curve:
    """A function y(x) averaged over the frames of a trajectory.

    Attributes
    ----------
    x, y : (K,) arrays
    sem : (K,) array
        Standard errors of y from blocks of frames (:func:`openmm_dpd.base.stats.block_average`); NaN with fewer than 5 frames, and too
        small, as a rule, with fewer than about 30.
    n_frames : int
        Number of frames.
    """

    x: np.ndarray
    y: np.ndarray
    sem: np.ndarray
    n_frames: int


def curve_of(x, rows: Sequence[np.ndarray], name: str = "the series") -> Curve:
    """Curve of the means over rows (F, K), one row per frame; each column has its error from blocks of frames."""
    table = np.asarray(rows, dtype=np.float64)
    return curve_of_averages(x, [block_average(column, name=name) for column in table.T], len(table))


def ratio_curve(x, above: np.ndarray, below: np.ndarray, name: str = "the ratio") -> Curve:
    """Curve of mean(above)/mean(below) of two series (F, K), with jackknife errors over blocks; NaN where ``below`` is always 0."""
    nothing = Average(np.nan, None, 0, None)
    columns = [ratio_average(a, b, name=name) if _divides(b) else nothing for a, b in zip(above.T, below.T, strict=True)]
    return curve_of_averages(x, columns, len(above))


def _divides(series: np.ndarray) -> bool:
    """Whether a ratio over this denominator has a defined error: most frames, or any of fewer than 5, are not 0."""
    return bool(np.count_nonzero(series) > len(series) // 2) or (0 < len(series) < 5 and bool(series.any()))


def curve_of_averages(x, averages: list[Average], frames: int) -> Curve:
    """Curve of averages, one for each x, over this number of frames."""
    y = np.array([average.mean for average in averages], dtype=np.float64)
    sem = np.array([np.nan if average.sem is None else average.sem for average in averages], dtype=np.float64)
    return Curve(np.asarray(x, dtype=np.float64), y, sem, frames)
