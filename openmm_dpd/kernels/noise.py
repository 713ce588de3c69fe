"""Random numbers as a pure function of (seed, counter, layer of terms, thermal energy, pair, stream).

The same pair gets the same number for any order of pairs, number of threads and platform, and a restart draws what an
uninterrupted run would have drawn.  The thermal energy is in the key so that replicas of one run at different temperatures, which share
seed and counter, do not share their noise.  The hash is two rounds of the 64-bit finaliser "mix13" (Stafford; the one of SplitMix64,
Steele, Lea and Flood, OOPSLA 2014, doi:10.1145/2660193.2660195); its bits are turned into a standard normal number by the inverse
distribution function: Gaussian to 1e-6.
"""

from statistics import NormalDist
from struct import Struct

import numpy as np

from ..runtime import Tape, both, helper, inlined, merged
from .elementary import exp, log, without_last_bits
from .pairs import SECOND

_GOLDEN = np.uint64(0x9E3779B97F4A7C15)
_M1 = np.uint64(0xBF58476D1CE4E5B9)
_M2 = np.uint64(0x94D049BB133111EB)
#: These three as integers of Python, and the largest integer of 64 bits.
_KEYS = int(_GOLDEN), int(_M1), int(_M2), (1 << 64) - 1
_STREAM = np.uint64(0xD1342543DE82EF95)
_S30, _S27, _S31, _S12, _S32, _S55, _S63, _S3 = (np.uint64(k) for k in (30, 27, 31, 12, 32, 55, 63, 3))
_BYTE, _LOW55 = np.uint64(0xFF), np.uint64((1 << 55) - 1)
_SCALE = 2.0**-52
#: Of the noise of a flux.
_LARGEST = 5.0
_NUMBER, _BITS = Struct("<d"), Struct("<Q")
#: The upper half of the inverse distribution function lies in this many cells of a cubic polynomial each; the last ones are left to _tail.
_CELLS, _SMOOTH = 256, 248
_LAST = np.uint64(_SMOOTH - 1)
#: Bits after the point that values at the edges of cells have.
ROUNDED = 39


def _cubics() -> np.ndarray:
    """(4, cells) coefficients that meet the values and slopes of the inverse distribution function at the edges of the cells."""
    width = 0.5 / _CELLS
    edges = 0.5 + width * np.arange(_SMOOTH + 1)
    value = without_last_bits(np.array([NormalDist().inv_cdf(edge) for edge in edges]), ROUNDED)
    slope = width * np.sqrt(2 * np.pi) * exp(0.5 * value**2)
    rise = np.diff(value)
    first, last = slope[:-1], slope[1:]
    return np.ascontiguousarray(np.array([value[:-1], first, 3 * rise - 2 * first - last, first + last - 2 * rise]).T)


_CUBICS = _cubics()


@both
def mix(z):
    """A bijection of 64-bit words; of arrays, too."""
    z = (z ^ (z >> _S30)) * _M1
    z = (z ^ (z >> _S27)) * _M2
    return z ^ (z >> _S31)


@inlined
def next_key(key, number):
    """One word more, as :func:`call_key` has it."""
    return mix(key + number + _GOLDEN)


def call_key(*words: int) -> np.uint64:
    """Key of one evaluation from numbers between 0 and 2^64: seed, count of the program's own noise counter, and the like."""
    z = 0
    # one after the other, each through the finaliser (see mix), so that no sum of two of them is another
    for word in words:
        z = (z + word + _KEYS[0]) & _KEYS[3]
        z = ((z ^ (z >> 30)) * _KEYS[1]) & _KEYS[3]
        z = ((z ^ (z >> 27)) * _KEYS[2]) & _KEYS[3]
        z ^= z >> 31
    return np.uint64(z)


def noise_key(seed: int, counter: int, layer: int, kT: float) -> np.uint64:
    """Key of the noise of one layer of terms in one evaluation."""
    return call_key(seed, counter, layer, *_BITS.unpack(_NUMBER.pack(kT)))


@inlined
def key_again(numbers, counter, bits):
    """The :func:`noise_key` of a layer and a seed, a counter and the bits of a thermal energy."""
    return next_key(next_key(next_key(next_key(np.uint64(0), numbers[1]), counter), numbers[0]), bits)


def told_key(seed: int, counter: int, layer: int, kT: float) -> np.uint64:
    """A :func:`noise_key`, of which a tape that is running is told, so that :func:`key_again` makes those of other steps."""
    key = noise_key(seed, counter, layer, kT)
    Tape.tell("key", key, counter, kT, layer, seed)
    return key


@inlined
def pair_key(key, i, j):
    """64-bit hash of a pair of beads, whose indices may come in either order, under the key of this evaluation."""
    low, high = (i, j) if i < j else (j, i)
    pair = (np.uint64(low) << _S32) | np.uint64(high)
    return mix(mix(pair * _GOLDEN + key) + key)


# The bits of a number: a sign, a cell, and the place in it: the middle of the k-th of 2^52 pieces, never on an edge.


@inlined
def _cell(bits):
    return (bits >> _S55) & _BYTE


@inlined
def _place(bits):
    return (np.float64(np.int64((bits & _LOW55) >> _S3)) + 0.5) * _SCALE


@inlined
def _signed(bits, z):
    return z * np.float64(1 - 2 * np.int64(bits >> _S63))


@inlined
def _from_cubic(bits):
    """The number of these bits, if its cell has a cubic; something else otherwise."""
    cell, place = _cell(bits), _place(bits)
    cell = cell if cell < _LAST else _LAST
    z = _CUBICS[cell, 0] + place * (_CUBICS[cell, 1] + place * (_CUBICS[cell, 2] + place * _CUBICS[cell, 3]))
    return _signed(bits, z)


@inlined
def _from_tail(bits):
    """The number of these bits, if its cell has no cubic."""
    p = (_CELLS - 1.0 - np.float64(np.int64(_cell(bits))) + (1.0 - _place(bits))) * (0.5 / _CELLS)  # never rounded to 0
    return _signed(bits, _tail(p))


@merged
def normal(key, stream):
    """Standard normal number number ``stream`` (0, 1, ...) of a pair."""
    bits = key if stream == 0 else mix(key + np.uint64(stream) * _STREAM)
    return _from_cubic(bits) if np.int64(_cell(bits)) < _SMOOTH else _from_tail(bits)


# For many pairs one pass for each kind of work is three times as fast, since most of them can do several at once.


@helper
def draw_normals(stream, m, scratch, row):
    """What :func:`normal` gives for the keys, to a row of the values."""
    values, all_bits, tail = scratch.values, scratch.bits, scratch.indices[SECOND:]
    bits = all_bits[SECOND:] if stream else all_bits
    if stream:
        for k in range(m):
            all_bits[SECOND + k] = mix(all_bits[k] + np.uint64(stream) * _STREAM)
    for k in range(m):
        values[row + k] = _from_cubic(bits[k])
    # those without a cubic are one in thirty
    n = np.uint64(0)
    for k in range(m):
        tail[n] = k
        n += np.uint64(np.int64(_cell(bits[k])) >= _SMOOTH)
    for q in range(n):
        values[row + np.uint64(tail[q])] = _from_tail(bits[tail[q]])


@helper
def directed(m, scratch, row):
    """What belongs to the bead with the lower number as the first bead of each pair has it: minus that where it is the other one.  Pairs
    are those of the last :func:`draw`."""
    values, signs = scratch.values, scratch.bits[SECOND + SECOND :]
    for k in range(m):
        values[row + k] = np.uint64(np.float64(values[row + k]).view(np.uint64) ^ signs[k]).view(np.float64)


@helper
def draw_directed(stream, m, scratch, row):
    """:func:`draw_normals`, and :func:`directed`."""
    draw_normals(stream, m, scratch, row)
    directed(m, scratch, row)


@helper
def draw_uniforms(stream, m, scratch, row):
    """What :func:`uniform` gives for the keys, to a row of the values."""
    for k in range(m):
        scratch.values[row + k] = uniform(scratch.bits[k], stream)


@helper
def draw(key, pairs, begin, m, scratch, row):
    """What :func:`pair_key` gives for the pairs begin:begin + m of a list to the bits, with the signs of their directions, and their stream
    0 to a row of the values."""
    order, pi, pj, bits = pairs.order, pairs.pi, pairs.pj, scratch.bits
    for k in range(m):
        i, j = order[pi[begin + k]], order[pj[begin + k]]
        low, high = (i, j) if i < j else (j, i)
        bits[SECOND + SECOND + k] = np.uint64(i > j) << _S63
        bits[k] = (np.uint64(low) << _S32) | np.uint64(high)
    for k in range(m):
        bits[k] = mix(mix(bits[k] * _GOLDEN + key) + key)
    draw_normals(0, m, scratch, row)


@inlined
def uniform(key, stream):
    """Uniform number between 0 and 1 (neither of them) number ``stream`` of a pair; do not use a stream for two kinds of number."""
    return (np.float64(mix(key + np.uint64(stream) * _STREAM) >> _S12) + 0.5) * _SCALE


@inlined
def clamped(xi):
    """Noise of a flux, limited as in LAMMPS."""
    return min(_LARGEST, max(-_LARGEST, xi))


@helper
def _tail(p):
    """Normal number that is exceeded with the (small) probability p: Wichura, algorithm AS 241, PPND7, Appl. Stat. 37, 477 (1988)."""
    r = np.sqrt(-log(p))
    if r <= 5.0:
        r -= 1.6
        above = ((0.17023821103 * r + 1.3067284816) * r + 2.7568153900) * r + 1.4234372777
        return above / ((0.12021132975 * r + 0.73700164250) * r + 1.0)
    r -= 5.0
    above = ((0.017337203997 * r + 0.42868294337) * r + 3.0812263860) * r + 6.6579051150
    return above / ((0.012258202635 * r + 0.24197894225) * r + 1.0)
