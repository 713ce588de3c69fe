"""Mean and standard error of a correlated series, from the means of blocks.

All quantities of one run share one block length: eight times the longest integrated correlation time among
them (a fast quantity with a slow tail, like the pressure, would choose too short a block for itself) or a
32nd of the run, whichever is longer; where that leaves fewer than 20 blocks, a 20th of the run, and an error
if this is less than two correlation times.  What is left of the correlation between blocks is allowed for:
the variance of block means is taken to fall short by the ratio of correlation time to block.
"""

import math

import numpy as np

MIN_BLOCKS, MAX_BLOCKS = 20, 32
TAUS_PER_BLOCK, MIN_TAUS_PER_BLOCK = 8, 2


def correlation_time(series: np.ndarray) -> float:
    """Integrated autocorrelation time in samples, 1/2 + sum of rho, up to a window of six times itself."""
    x = series - series.mean()
    if not np.any(np.abs(x) > 1e-13 * max(1.0, float(np.abs(series).max()))):
        return 0.5
    n = len(x)
    spectrum = np.fft.rfft(x, 2 * n)
    rho = np.fft.irfft(spectrum * np.conj(spectrum))[:n]
    rho /= rho[0]
    tau = 0.5
    for lag in range(1, n // 2):
        tau += rho[lag]
        if lag > 6 * tau:
            break
    return max(tau, 0.5)


def block_length(samples: int, tau: float) -> int:
    """Samples in a block (module docstring) for a correlation time in samples."""
    length = max(math.ceil(TAUS_PER_BLOCK * tau), samples // MAX_BLOCKS, 1)
    length = min(length, samples // MIN_BLOCKS)
    if length < MIN_TAUS_PER_BLOCK * tau:
        raise RuntimeError(f"{samples} samples are too few for a correlation time of {tau:.1f} samples: run longer")
    return length


def block_statistics(series: np.ndarray, length: int, sample_every: int) -> dict[str, float | int]:
    """Mean and standard error from the means of blocks of ``length`` samples (lengths and times in steps)."""
    blocks = len(series) // length
    used = series[len(series) - blocks * length :]  # what does not fill a block goes from the beginning
    means = used.reshape(blocks, length).mean(axis=1)
    deviation = means - means.mean()
    power = float(np.sum(deviation**2))
    tau = float(correlation_time(series))
    shortfall = 1.0 - tau / length  # of the variance of block means, from blocks of finite length
    near = float(np.sum(deviation[1:] * deviation[:-1]) / power) if power > 1e-24 * means.mean() ** 2 else 0.0
    sem, sd = float(means.std(ddof=1) / math.sqrt(blocks * shortfall)), float(used.std(ddof=1))
    found = {"mean": float(means.mean()), "sem": sem, "sd": sd, "block": length * sample_every, "blocks": blocks}
    return {**found, "tau": round(tau * sample_every, 1), "block_correlation": round(near, 3)}
