"""The hash-based noise: Gaussian, and unrelated for pairs, steps, components and seeds.

Seeds are fixed, so every statistical check gives the same number each time; bounds are 4 standard errors, or the stated level.
"""

import numpy as np
import pytest
from cases import cases
from scipy import special, stats

from openmm_dpd.kernels import noise
from openmm_dpd.kernels.compiled import compiled
from openmm_dpd.kernels.pairs import PairList, Scratch

M = 1_000_000


@compiled
def stream(key, n, component):
    """Numbers of the pairs (0, 1), (0, 2) ... under one key."""
    values = np.empty(n)
    for k in range(n):
        values[k] = noise.normal(noise.pair_key(key, k // 2000, 2000 + k % 2000), component)
    return values


@compiled
def _from_bits(bits, values):
    for k in range(len(bits)):
        values[k] = noise.normal(bits[k], 0)


def from_bits(bits) -> np.ndarray:
    """Stream 0 of given 64-bit hashes: a sign bit, eight bits for the cell, and the place in it."""
    bits = np.array(bits, dtype=np.uint64)
    values = np.empty(len(bits))
    _from_bits(bits, values)
    return values


def ks(values: np.ndarray) -> float:
    """Level of the Kolmogorov-Smirnov test against the standard normal distribution (its limit for many numbers)."""
    n = len(values)
    cdf = special.ndtr(np.sort(values))
    distance = max(np.max(np.arange(1, n + 1) / n - cdf), np.max(cdf - np.arange(n) / n))
    return float(stats.kstwobign.sf(distance * np.sqrt(n)))


@pytest.mark.parametrize("component", range(4))
def test_distribution_is_standard_normal(component):
    """Kolmogorov-Smirnov at level 1e-4 on 10^6 numbers; that is enough to see 1 % in the width or 0.01 in the mean."""
    values = stream(noise.call_key(12345, 7), M, component)
    assert ks(values) > 1e-4
    assert ks(1.01 * values) < 1e-4
    assert ks(values + 0.01) < 1e-4


@pytest.mark.parametrize("component", range(4))
def test_moments(component):
    """<x^k> of 10^6 numbers, k = 1 ... 6, within 4 standard errors: sqrt((<x^2k> - <x^k>^2)/M)."""

    def moment(k):
        return 0.0 if k % 2 else float(special.factorial2(k - 1))

    values = stream(noise.call_key(1, 1), M, component)
    for k in range(1, 7):
        error = np.sqrt((moment(2 * k) - moment(k) ** 2) / M)
        assert abs(np.mean(values**k) - moment(k)) < 4 * error, k
    # a width of 1.01 moves the second moment by 0.02, 14 standard errors
    assert abs(np.mean((1.01 * values) ** 2) - 1) > 4 * np.sqrt(2 / M)


def bits_of(upper_tail, sign):
    """Hashes whose number is exceeded with the given probabilities (up to 2^-61), with a sign."""
    place = np.clip(np.floor((1 - 2 * np.asarray(upper_tail)) * 256 * 2.0**52), 0, 2**60 - 1).astype(np.uint64)
    cell, rest = place >> np.uint64(52), place & np.uint64(2**52 - 1)
    return (np.uint64(sign) << np.uint64(63)) | (cell << np.uint64(55)) | (rest << np.uint64(3))


@pytest.mark.parametrize("sign", [0, 1])
def test_inverse_distribution_function_to_2e_6(sign):
    """Every sign, cell and place in it becomes its normal quantile, into both tails."""
    rng = np.random.default_rng(2)
    bits = bits_of(np.concatenate([rng.random(100_000) / 2, 10.0 ** rng.uniform(-12, -1, 10_000)]), sign)
    cell, place = (bits >> np.uint64(55)) & np.uint64(255), ((bits >> np.uint64(3)) & np.uint64(2**52 - 1)).astype(float) + 0.5
    tail = (256 - (cell + place * 2.0**-52)) / 512
    np.testing.assert_allclose(from_bits(bits), (2 * sign - 1) * special.ndtri(tail), rtol=0, atol=2e-6)


def test_moments_of_the_cubic_pieces():
    """By quadrature over the pieces and the tail: second, fourth and sixth moment of what is drawn are 1, 3 and 15."""
    nodes, weights = np.polynomial.legendre.leggauss(12)
    nodes, weights = 0.5 * (nodes + 1), 0.5 * weights
    cells = np.arange(248)[:, None]
    bits = (cells.astype(np.uint64) << np.uint64(55)) | ((nodes * 2.0**52).astype(np.uint64) << np.uint64(3))
    drawn = from_bits(bits.ravel()).reshape(248, 12)
    edge = special.ndtri(0.5 + 248 / 512)
    for k, moment in ((2, 1.0), (4, 3.0), (6, 15.0)):
        beyond = moment * special.gammaincc((k + 1) / 2, edge**2 / 2)
        assert np.sum(drawn**k @ weights) / 256 + beyond == pytest.approx(moment, abs=3e-6)


def test_the_outermost_numbers_are_finite():
    """All bits 0 and all bits 1 are legal hashes: about 9.1 standard deviations, not infinity."""
    extremes = from_bits([0, 2**64 - 1, 2**64 - 2048, 2**11, 2**63, 2**63 - 1])
    assert np.all(np.isfinite(extremes))
    assert np.all(np.abs(extremes) < 9.3)
    assert extremes[1] < -8 and extremes[5] > 8


@cases(
    "first, second",
    pytest.param((5, 1, 0), (5, 2, 0), id="steps"),
    pytest.param((5, 1, 0), (5, 2**31, 0), id="steps far apart"),
    pytest.param((5, 1, 0), (6, 1, 0), id="seeds"),
    pytest.param((5, 2, 0), (6, 1, 0), id="seed and step exchanged"),
    pytest.param((0, 1, 0), (1, 0, 0), id="seed 0"),
    pytest.param((5, 1, 0), (5, 1, 1), id="components 0 1"),
    pytest.param((5, 1, 1), (5, 1, 2), id="components 1 2"),
    pytest.param((5, 1, 1), (5, 1, 3), id="components 1 3"),
    pytest.param((5, 1, 2), (5, 1, 3), id="components 2 3"),
)
def test_no_correlation(first, second):
    """Correlations of x, x^2 and |x| with y, of 10^6 numbers of two streams: |r| < 4/sqrt(M) = 0.004."""
    x, y = (stream(noise.call_key(seed, counter), M, component) for seed, counter, component in (first, second))
    assert not np.array_equal(x, y)
    for p, q in ((x, y), (x**2, y**2), (x**2, y), (x, y**2), (np.abs(x), np.abs(y))):
        assert abs(np.corrcoef(p, q)[0, 1]) < 4 / np.sqrt(M)


def test_no_correlation_between_pairs():
    """Neighbours in either index, the lag-1 and lag-2000 autocorrelation of (0..499) x (2000..3999): |r| < 4/sqrt(M)."""
    values = stream(noise.call_key(9, 3), M, 0).reshape(500, 2000)
    for x, y in ((values[:, 1:], values[:, :-1]), (values[1:], values[:-1]), (values[1:, 1:], values[:-1, :-1])):
        assert abs(np.corrcoef(x.ravel(), y.ravel())[0, 1]) < 4 / np.sqrt(x.size)
        assert abs(np.corrcoef(x.ravel() ** 2, y.ravel() ** 2)[0, 1]) < 4 / np.sqrt(x.size)


def test_sums_over_the_pairs_of_a_bead_are_normal():
    """A bead feels a sum over its pairs; 500 sums over 2000 pairs have variance 2000 within 4 sqrt(2/500)."""
    sums = stream(noise.call_key(4, 8), M, 0).reshape(500, 2000).sum(axis=1)
    assert abs(np.var(sums) / 2000 - 1) < 4 * np.sqrt(2 / 500)
    assert ks(sums / np.sqrt(2000)) > 1e-4


def test_keys_do_not_repeat():
    """No two of 10^6 (seed, counter) pairs share a key, nor any two of 10^6 pairs of beads a hash."""
    assert len({int(noise.call_key(seed, counter)) for seed in range(1000) for counter in range(200)}) == 1000 * 200

    @compiled
    def hashes(key, n):
        found = np.empty(n * n, np.uint64)
        for i in range(n):
            for j in range(n):
                found[i * n + j] = noise.pair_key(key, i, n + j)
        return found

    assert len(np.unique(hashes(noise.call_key(0, 0), 1000))) == 10**6


def test_noise_has_not_changed():
    """A restart continues only if the numbers stay what they were: four values, computed from the documented hash in plain integers."""
    mask = 2**64 - 1

    def mix(z):
        z = ((z ^ (z >> 30)) * 0xBF58476D1CE4E5B9) & mask
        z = ((z ^ (z >> 27)) * 0x94D049BB133111EB) & mask
        return z ^ (z >> 31)

    golden, seed, counter, i, j = 0x9E3779B97F4A7C15, 7, 19, 3, 41
    key = 0
    for word in (seed, counter, 0, 0x3FF8000000000000):  # the last one is 1.5 as a double
        key = mix((key + word + golden) & mask)
    assert int(noise.noise_key(seed, counter, 0, 1.5)) == key
    pair = mix((mix((((i << 32) | j) * golden + key) & mask) + key) & mask)

    @compiled
    def numbers(key, i, j):
        return [noise.normal(noise.pair_key(key, i, j), k) for k in range(4)]

    drawn = numbers(noise.noise_key(seed, counter, 0, 1.5), i, j)
    for k in range(4):
        bits = pair if k == 0 else mix((pair + k * 0xD1342543DE82EF95) & mask)
        tail = (256 - ((bits >> 55) % 256) - (((bits >> 3) % 2**52) + 0.5) * 2.0**-52) / 512
        assert drawn[k] == pytest.approx((2 * (bits >> 63) - 1) * special.ndtri(tail), abs=2e-6)


@compiled
def _of_a_column(key, arrays, m, scratch):
    """As kernels call it."""
    noise.draw(key, arrays, np.uint64(0), m, scratch)


def test_numbers_of_a_column_are_those_of_its_pairs():
    """Drawn together, with tails (one in thirty) and in any order of the beads: the same bits."""
    rng, n, m = np.random.default_rng(8), 2000, 5000
    first, second = rng.integers(0, n // 2, m), rng.integers(n // 2, n, m)
    types, inv_mass = np.zeros(n, np.int32), np.ones(n)
    pairs = PairList(types, inv_mass, np.ones((1, 1)))
    pairs.build(np.zeros((n, 3)) + np.arange(n)[:, None], None)
    pairs.order[:] = rng.permutation(n)
    arrays = pairs.arrays._replace(pi=first.astype(np.uint32), pj=second.astype(np.uint32))
    scratch = Scratch(np.zeros((4, m + 1)), np.zeros(m + 1, np.uint64), np.zeros(m + 1, np.uint32))
    key = noise.call_key(3, 4)
    _of_a_column(key, arrays, np.uint64(m), scratch)
    one_by_one = np.empty(m)
    _of_pairs(key, pairs.order[first], pairs.order[second], one_by_one)
    assert np.array_equal(scratch.values[3, :m], one_by_one)
    assert np.abs(one_by_one).max() > 3


@compiled
def _of_pairs(key, i, j, values):
    for k in range(len(i)):
        values[k] = noise.normal(noise.pair_key(key, min(i[k], j[k]), max(i[k], j[k])), 0)
