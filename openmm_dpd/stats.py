"""Averages of correlated series, with standard errors from blocks whose length is chosen from the data."""

from dataclasses import dataclass

import numpy as np

from .errors import ParameterError

#: Fewest blocks a standard error is taken from; with fewer rows than this there is none.
MIN_BLOCKS = 5


@dataclass(frozen=True)
class Average:
    """Mean of a series and what is known about its uncertainty.

    Attributes
    ----------
    mean : float or None
        Mean over all rows; None if there is no row.
    sem : float or None
        Standard error of the mean; None if there are too few rows to tell.
    n_blocks : int
        Number of blocks the error was taken from (0 if there is none).
    tau : float or None
        Integrated correlation time in rows, 1/2 for independent rows; None if it is not known.
    converged : bool
        Whether the blocks are long against the correlation time.  If False, ``sem`` is a lower bound: the series is too short.
    """

    mean: float | None
    sem: float | None
    n_blocks: int
    tau: float | None
    converged: bool = False


def block_average(values, *, min_blocks: int = MIN_BLOCKS, name: str = "the series") -> Average:
    r"""Mean and standard error of a correlated series, by automatic blocking.

    The series is cut into blocks of B = 1, 2, 4, ... rows.  The variance of the block means gives the statistical inefficiency

    .. math::

        s(B) = B\,\mathrm{var}(\text{block means}) / \mathrm{var}(\text{rows}), \qquad
        \mathrm{sem}^2 = s\,\mathrm{var}(\text{rows})/n,

    which grows with B until the blocks are independent.  B is taken no longer than the first length with B^3 > 2 n s^2, where the
    systematic error (blocks too short) falls below the statistical one (too few blocks), and the largest s up to there counts.  So an
    anticorrelated series gets the error of independent rows, which is on the safe side.

    Parameters
    ----------
    values : (n,) array_like
        One value per row, in order of time.  Rows left over by whole blocks are the first ones; they count in the mean only.
    min_blocks : int, default 5
        Fewest blocks to take an error from, >= 2.
    name : str
        What the series is, for error messages.

    Returns
    -------
    Average
        With no row: mean and sem None.  With fewer than ``min_blocks`` rows: the mean, sem None.  With few rows (below about 30, or about
        100 correlation times): a sem that tends to be too small, and ``converged`` False.  A constant series: sem 0, tau None.

    Raises
    ------
    ParameterError
        If a value is NaN or infinite (the row is named), or ``values`` is not one-dimensional.

    References
    ----------
    H. Flyvbjerg and H. G. Petersen, J. Chem. Phys. 91, 461 (1989); criterion for B: R. M. Lee et al., Phys. Rev. E 83, 066706 (2011).
    """
    array = _checked(values, name, min_blocks)
    n = len(array)
    if n == 0:
        return Average(None, None, 0, None)
    mean = _mean(array)
    if n < min_blocks:
        return Average(mean, None, 0, None)
    # the first row is taken off so that a constant series has exactly no variance
    shifted = array - array[0]
    length, inefficiency, converged = _block_length(shifted, min_blocks)
    variance = shifted.var(ddof=1)
    if variance == 0:
        return Average(mean, 0.0, n, None, True)
    return Average(mean, float(np.sqrt(inefficiency * variance / n)), n // length, inefficiency / 2, converged)


def ratio_average(numerator, denominator, *, min_blocks: int = MIN_BLOCKS, name: str = "the series") -> Average:
    r"""Ratio of two means, R = <a>/<b>, with a jackknife error over blocks.

    The mean of the ratios a/b is something else, and biased.  Block length as in :func:`block_average`, for the series
    (a - R b)/<b> whose mean is the error of R to first order; the error is

    .. math:: \mathrm{sem}^2 = \frac{m-1}{m} \sum_k (R_k - \bar R)^2,

    with R_k the ratio without block k of m.  Used for the configurational temperature, <|grad U|^2>/<laplacian U>.

    Parameters
    ----------
    numerator, denominator : (n,) array_like
        The two series a and b, row by row from the same times.
    min_blocks : int, default 5
        As in :func:`block_average`.
    name : str
        What the ratio is, for error messages.

    Returns
    -------
    Average
        ``mean`` is the ratio; all else as in :func:`block_average`.  ``sem`` is None also if the denominator is zero in all blocks but one:
        the ratio is then not defined without that one.

    Raises
    ------
    ParameterError
        If a value is not finite, the lengths differ, or the mean of the denominator is zero.
    """
    above = _checked(numerator, f"the numerator of {name}", min_blocks)
    below = _checked(denominator, f"the denominator of {name}", min_blocks)
    if len(above) != len(below):
        raise ParameterError(f"numerator and denominator of {name} must be equally long; they have {len(above)} and {len(below)} rows")
    n = len(above)
    if n == 0:
        return Average(None, None, 0, None)
    scale = _mean(below)
    if scale == 0:
        raise ParameterError(f"the denominator of {name} has the mean 0; its ratio is not defined")
    ratio = _mean(above) / scale
    if n < min_blocks:
        return Average(ratio, None, 0, None)
    deviation = (above - ratio * below) / scale
    if np.ptp(deviation) == 0:
        return Average(ratio, 0.0, n, None, True)
    length, inefficiency, converged = _block_length(deviation, min_blocks)
    blocks = n // length
    sums = np.array([_block_means(series, length) for series in (above, below)]) * length
    without = sums.sum(axis=1, keepdims=True) - sums
    if np.any(without[1] == 0):
        return Average(ratio, None, 0, None)
    left_out = without[0] / without[1]
    variance = (blocks - 1) / blocks * np.sum((left_out - left_out.mean()) ** 2)
    # the blocks hold length*blocks rows of the n that the ratio was taken from
    return Average(ratio, float(np.sqrt(variance * length * blocks / n)), blocks, inefficiency / 2, converged)


def _checked(values, name: str, min_blocks: int) -> np.ndarray:
    """Values as a finite float64 vector."""
    if min_blocks < 2:
        raise ParameterError(f"an error needs at least 2 blocks; min_blocks is {min_blocks}")
    try:
        array = np.asarray(values, dtype=np.float64)
    except (TypeError, ValueError):
        raise ParameterError(f"{name} must be a sequence of numbers") from None
    if array.ndim != 1:
        raise ParameterError(f"{name} must be one-dimensional, not of shape {array.shape}")
    bad = np.flatnonzero(~np.isfinite(array))
    if len(bad):
        raise ParameterError(f"{name} is {array[bad[0]]} in row {bad[0]} (counted from 0; {len(bad)} of {len(array)} rows are not finite)")
    return array


def _mean(array: np.ndarray) -> float:
    """Mean relative to the first row, which is exact for a constant series."""
    return float(array[0] + (array - array[0]).mean())


def _block_means(array: np.ndarray, length: int) -> np.ndarray:
    """Means of blocks of ``length`` rows, counted from the end of the series."""
    blocks = len(array) // length
    return array[len(array) - blocks * length :].reshape(blocks, length).mean(axis=1)


def _block_length(array: np.ndarray, min_blocks: int) -> tuple[int, float, bool]:
    """Length of the blocks to take the error from, the statistical inefficiency they give, and whether they are long enough."""
    n, variance = len(array), array.var(ddof=1)
    best, inefficiency, length = 1, 1.0, 1
    while variance > 0 and n // length >= min_blocks:
        here = length * _block_means(array, length).var(ddof=1) / variance
        if here > inefficiency:
            best, inefficiency = length, float(here)
        if length**3 > 2 * n * inefficiency**2:
            return best, inefficiency, True
        length *= 2
    return best, inefficiency, False
