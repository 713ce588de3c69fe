"""Random numbers as a pure function of (seed, counter, pair, stream).

The same pair gets the same number whatever the order of pairs, the number of threads or the platform, and a restart draws what an
uninterrupted run would have drawn.  The hash is two rounds of the 64-bit finaliser "mix13" (Stafford; the one of SplitMix64,
Steele, Lea and Flood, OOPSLA 2014, doi:10.1145/2660193.2660195); its upper 52 bits are turned into a standard normal number by the
inverse distribution function (Wichura, algorithm AS 241, routine PPND7, Appl. Stat. 37, 477 (1988)): Gaussian to 1e-7.
"""

from __future__ import annotations

import numpy as np
from numba import njit

_GOLDEN = np.uint64(0x9E3779B97F4A7C15)
_M1 = np.uint64(0xBF58476D1CE4E5B9)
_M2 = np.uint64(0x94D049BB133111EB)
_STREAM = np.uint64(0xD1342543DE82EF95)
_S30, _S27, _S31, _S12, _S32 = (np.uint64(k) for k in (30, 27, 31, 12, 32))
_SCALE = 2.0**-52


@njit(inline="always")
def _mix(z):
    z = (z ^ (z >> _S30)) * _M1
    z = (z ^ (z >> _S27)) * _M2
    return z ^ (z >> _S31)


def call_key(seed: int, counter: int, layer: int = 0) -> np.uint64:
    """Key of one evaluation: differs for every seed, every count of the program's own noise counter and every layer of terms."""
    mask = (1 << 64) - 1

    def mix(z: int) -> int:
        z = ((z ^ (z >> 30)) * int(_M1)) & mask
        z = ((z ^ (z >> 27)) * int(_M2)) & mask
        return z ^ (z >> 31)

    key = 0
    # one after the other, each through the finaliser, so that no sum of two of them can stand for another
    for word in (seed, counter, layer):
        key = mix((key + word + int(_GOLDEN)) & mask)
    return np.uint64(key)


@njit(inline="always")
def pair_key(key, low, high):
    """64-bit hash of the pair (low < high, indices of the beads) under the key of this evaluation."""
    pair = (np.uint64(low) << _S32) | np.uint64(high)
    return _mix(_mix(pair * _GOLDEN + key) + key)


@njit(inline="always")
def normal(key, stream):
    """Standard normal number number ``stream`` (0, 1, ...) of a pair."""
    bits = key if stream == 0 else _mix(key + np.uint64(stream) * _STREAM)
    # the middle of the k-th of 2^52 cells, an exact number: never 0, never 1
    return _normal_from_uniform((np.float64(bits >> _S12) + 0.5) * _SCALE)


@njit(inline="always")
def uniform(key, stream):
    """Uniform number between 0 and 1 (neither of them) number ``stream`` of a pair; do not use a stream for two kinds of number."""
    return (np.float64(_mix(key + np.uint64(stream) * _STREAM) >> _S12) + 0.5) * _SCALE


@njit(inline="always")
def _normal_from_uniform(p):
    q = p - 0.5
    if abs(q) <= 0.425:
        r = 0.180625 - q * q
        return (
            q
            * (((59.109374720 * r + 159.29113202) * r + 50.434271938) * r + 3.3871327179)
            / (((67.187563600 * r + 78.757757664) * r + 17.895169469) * r + 1.0)
        )
    return _tail(q, p)


@njit
def _tail(q, p):
    r = np.sqrt(-np.log(p if q < 0.0 else 1.0 - p))
    if r <= 5.0:
        r -= 1.6
        z = (((0.17023821103 * r + 1.3067284816) * r + 2.7568153900) * r + 1.4234372777) / ((0.12021132975 * r + 0.73700164250) * r + 1.0)
    else:
        r -= 5.0
        z = (((0.017337203997 * r + 0.42868294337) * r + 3.0812263860) * r + 6.6579051150) / (
            (0.012258202635 * r + 0.24197894225) * r + 1.0
        )
    return -z if q < 0.0 else z
