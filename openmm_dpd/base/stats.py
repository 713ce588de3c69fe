"""Averages of correlated series, with standard errors from blocks whose length follows from the data; and the end of equilibration."""

from dataclasses import dataclass

import numpy as np

from .errors import ParameterError

#: Fewest blocks for a standard error; with fewer rows there is none.
MIN_BLOCKS = 5
#: Correlation times after which a series is long enough.
LONG = 200
#: Approximate number of batches, from whose means the end of equilibration is found.
BATCHES = 50


@dataclass(frozen=True)
class Average:
    """Mean of a series, and its uncertainty.

    Attributes
    ----------
    mean : float or None
        Mean over all rows; None without rows.
    sem : float or None
        Standard error of the mean; None with too few rows.
    n_blocks : int
        Number of blocks used for the error (0 without an error).
    tau : float or None
        Integrated correlation time in rows, 1/2 for independent rows; None if unknown.
    converged : bool
        Whether the series is at least 200 correlation times long.  If not, ``sem`` tends to be too small, and scatters.
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

    which grows with B until the blocks are independent.  The largest s up to the first length with B^3 > 2 n s^2 is used, where the
    systematic error (blocks too short) falls below the statistical one (too few blocks).  So an anticorrelated series gets the larger
    error of independent rows.

    The required length of a series is measured in correlation times, as for Markov chains (Sokal; Foreman-Mackey et al.).  In a series of
    50 times, the time found is too short by half in one case of 15, so ``converged`` asks for 200 of the times found.  For AR(1) series,
    errors are 6 to 20 % too small on average at 25 to 50 times, and right within 5 % from 100 on; at 200 times half of the series are
    converged, with errors 11 % too small, at 400 all.  A slow part that is small compared with fast noise escapes any such criterion.

    Parameters
    ----------
    values : (n,) array_like
        One value per row, in order of time.  The first rows, if not part of a whole block, count in the mean only.
    min_blocks : int, default 5
        Fewest blocks for an error, >= 2.
    name : str
        Name of the series in error messages.

    Returns
    -------
    Average
        Without rows, mean and sem are None; with fewer than ``min_blocks`` rows, sem is None; for a constant series, sem is 0, tau None.

    Raises
    ------
    ParameterError
        If a value is NaN or infinite (the message names the row), or ``values`` is not one-dimensional.

    References
    ----------
    H. Flyvbjerg and H. G. Petersen, J. Chem. Phys. 91, 461 (1989); criterion for B: R. M. Lee et al., Phys. Rev. E 83, 066706 (2011);
    length in correlation times: A. D. Sokal in Functional Integration (Plenum, 1997), p. 131, and D. Foreman-Mackey et al., Publ. Astron.
    Soc. Pac. 125, 306 (2013), who take 100 of these times.
    """
    array = _checked(values, name, min_blocks)
    n = len(array)
    if n == 0:
        return Average(None, None, 0, None)
    mean = _mean(array)
    if n < min_blocks:
        return Average(mean, None, 0, None)
    # the first row is subtracted, so that a constant series has exactly no variance
    shifted = array - array[0]
    length, inefficiency = _block_length(shifted, min_blocks)
    variance = shifted.var(ddof=1)
    if variance == 0:
        return Average(mean, 0.0, n, None, True)
    tau = inefficiency / 2
    return Average(mean, float(np.sqrt(inefficiency * variance / n)), n // length, tau, long_enough(n, tau))


def long_enough(rows: int, tau: float) -> bool:
    """Whether the error of an average over this number of rows is reliable, given their correlation time in rows."""
    return rows >= LONG * tau


def ratio_average(numerator, denominator, *, min_blocks: int = MIN_BLOCKS, name: str = "the series") -> Average:
    r"""Ratio of two means, R = <a>/<b>, with a jackknife error over blocks.

    The mean of the ratios a/b is another, biased quantity.  The block length is that of :func:`block_average` for the series
    (a - R b)/<b>, whose mean is the error of R to first order; the error is

    .. math:: \mathrm{sem}^2 = \frac{m-1}{m} \sum_k (R_k - \bar R)^2,

    with R_k the ratio without block k of m.  Used for the configurational temperature, <|grad U|^2>/<laplacian U>.

    Parameters
    ----------
    numerator, denominator : (n,) array_like
        The two series a and b, with rows of the same times.
    min_blocks : int, default 5
        Fewest blocks for an error, >= 2.
    name : str
        Name of the ratio in error messages.

    Returns
    -------
    Average
        ``mean`` is the ratio.  ``sem`` is None with fewer than ``min_blocks`` rows, or if the denominator is zero in all blocks but one, so
        that the ratio is not defined without it.

    Raises
    ------
    ParameterError
        If a value is not finite, the lengths differ, or the mean of the denominator is zero.
    """
    above = _checked(numerator, f"the numerator of {name}", min_blocks)
    below = _checked(denominator, f"the denominator of {name}", min_blocks)
    if len(above) != len(below):
        raise ParameterError(f"numerator and denominator of {name} must have equal lengths; they have {len(above)} and {len(below)} rows")
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
    length, inefficiency = _block_length(deviation, min_blocks)
    blocks = n // length
    sums = np.array([_block_means(series, length) for series in (above, below)]) * length
    without = sums.sum(axis=1, keepdims=True) - sums
    if np.any(without[1] == 0):
        return Average(ratio, None, 0, None)
    left_out = without[0] / without[1]
    variance = (blocks - 1) / blocks * np.sum((left_out - left_out.mean()) ** 2)
    # the blocks hold length*blocks of the n rows of the ratio
    return Average(ratio, float(np.sqrt(variance * length * blocks / n)), blocks, inefficiency / 2, long_enough(n, inefficiency / 2))


def equilibrated(values, *, name: str = "the series") -> int:
    r"""First row from which a series counts as equilibrated, by the marginal standard error rule (MSER).

    The number d of rows to leave out is the one for which the mean of the others would have the smallest error if rows were independent,

    .. math:: z(d) = \frac{1}{(n-d)^2} \sum_{k \ge d} (y_k - \bar y_d)^2,

    where y are the n means of batches of a fiftieth of the rows (of single rows, if there are fewer than 100).  At most half of the rows
    are left out.  With batches of fixed length, such as the five rows of MSER-5, the error of a long series would be smaller than the
    remaining effect of the start.

    Parameters
    ----------
    values : (n,) array_like
        One value per row, in order of time.
    name : str
        Name of the series in error messages.

    Returns
    -------
    int
        Number of rows to leave out: 0 with fewer than ten rows, and about 3 % of the rows of an equilibrated series.  If it is half of the
        rows, the series is too short, or does not equilibrate.

    Raises
    ------
    ParameterError
        If a value is NaN or infinite, or ``values`` is not one-dimensional.

    References
    ----------
    K. P. White, Simulation 69, 323 (1997); batches: K. P. White, M. J. Cobb and S. C. Spratt, Proc. Winter Simulation Conf. 2000, 755.

    Examples
    --------
    >>> from openmm_dpd.base.stats import equilibrated
    >>> equilibrated([9.0, 5.0, 2.0, 1.1, 0.9, 1.0, 1.1, 0.9, 1.0, 1.1, 0.9, 1.0])
    3
    """
    rows = _checked(values, name, MIN_BLOCKS)
    size = max(1, len(rows) // BATCHES)
    batches = len(rows) // size
    if len(rows) < 2 * MIN_BLOCKS:
        return 0
    # from the end, so that sums for all d are running sums; relative to the last batch, so that a constant series is exactly constant
    means = rows[len(rows) - batches * size :].reshape(batches, size).mean(axis=1)[::-1]
    shifted, count = means - means[0], np.arange(1, batches + 1)
    spread = (np.cumsum(shifted**2) - np.cumsum(shifted) ** 2 / count) / count**2
    fewest = -(-len(rows) // (2 * size))
    # of equal errors, the longest series
    kept = batches - int(np.argmin(spread[fewest - 1 :][::-1]))
    return 0 if kept == batches else len(rows) - kept * size


def _checked(values, name: str, min_blocks: int) -> np.ndarray:
    """Values as a float64 vector; ParameterError if it is not one-dimensional and finite, or ``min_blocks`` is < 2."""
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
    """Mean, computed relative to the first row, which is exact for a constant series."""
    return float(array[0] + (array - array[0]).mean())


def _block_means(array: np.ndarray, length: int) -> np.ndarray:
    """Means of blocks of ``length`` rows, counted from the end of the series."""
    blocks = len(array) // length
    return array[len(array) - blocks * length :].reshape(blocks, length).mean(axis=1)


def _block_length(array: np.ndarray, min_blocks: int) -> tuple[int, float]:
    """Length of the blocks for the error, and their statistical inefficiency."""
    n, variance = len(array), array.var(ddof=1)
    best, inefficiency, length = 1, 1.0, 1
    while variance > 0 and n // length >= min_blocks:
        here = length * _block_means(array, length).var(ddof=1) / variance
        if here > inefficiency:
            best, inefficiency = length, float(here)
        if length**3 > 2 * n * inefficiency**2:
            break
        length *= 2
    return best, inefficiency
