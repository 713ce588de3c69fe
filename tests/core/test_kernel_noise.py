"""The hash-based noise: Gaussian, and unrelated for pairs, steps, components and seeds; random forces on isolated pairs, radial and transverse apart."""

import numpy as np
import pytest
from cases import cases
from scenes import D, ready
from scipy import special, stats

import openmm_dpd as dpd
from openmm_dpd.kernels import noise
from openmm_dpd.kernels.engine import RANDOM, PairEngine
from openmm_dpd.kernels.pairs import CHUNK, PairList, Scratch, rows
from openmm_dpd.plan.plan import make_plan
from openmm_dpd.runtime.decorators import compiled

M, ROWS = 1_000_000, rows(3)


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
    """Neighbours in either index, |r| < 4/sqrt(M); sums over the 2000 pairs of a bead are normal, their variance within 4 sqrt(2/500)."""
    values = stream(noise.call_key(9, 3), M, 0).reshape(500, 2000)
    for x, y in ((values[:, 1:], values[:, :-1]), (values[1:], values[:-1]), (values[1:, 1:], values[:-1, :-1])):
        assert abs(np.corrcoef(x.ravel(), y.ravel())[0, 1]) < 4 / np.sqrt(x.size)
        assert abs(np.corrcoef(x.ravel() ** 2, y.ravel() ** 2)[0, 1]) < 4 / np.sqrt(x.size)
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
def _of_a_column(key, arrays, m, scratch, found):
    """As kernels call it: a chunk after the other."""
    for begin in range(np.uint64(0), m, np.uint64(CHUNK)):
        count = min(np.uint64(CHUNK), m - begin)
        noise.draw(key, arrays, begin, count, scratch, ROWS[0])
        noise.draw_directed(2, count, scratch, ROWS[1])
        noise.draw_uniforms(3, count, scratch, ROWS[2])
        for k in range(count):
            for row in range(len(ROWS)):
                found[row, begin + k] = scratch.values[ROWS[row] + k]


def test_numbers_of_a_column_are_those_of_its_pairs():
    """Drawn together, with tails (one in thirty) and in any order of the beads: the same bits."""
    rng, n, m = np.random.default_rng(8), 2000, 5000
    first, second = rng.integers(0, n // 2, m), rng.integers(n // 2, n, m)
    types, inv_mass = np.zeros(n, np.int32), np.ones(n)
    pairs = PairList(types, inv_mass, np.ones((1, 1)))
    pairs.build(np.zeros((n, 3)) + np.arange(n)[:, None], None)
    pairs.order[:] = rng.permutation(n)
    arrays = pairs.arrays._replace(pi=first.astype(np.uint32), pj=second.astype(np.uint32))
    scratch = Scratch(*(array[0] for array in pairs.scratch))
    key, found, one_by_one = noise.call_key(3, 4), np.zeros((3, m)), np.zeros((3, m))
    _of_a_column(key, arrays, np.uint64(m), scratch, found)
    _of_pairs(key, pairs.order[first], pairs.order[second], one_by_one)
    assert np.array_equal(found, one_by_one)
    assert np.all(np.abs(found[:2]).max(axis=1) > 3)


@compiled
def _of_pairs(key, i, j, values):
    for k in range(len(i)):
        pair = noise.pair_key(key, i[k], j[k])
        directed = noise.normal(pair, 2)
        values[0, k], values[1, k], values[2, k] = noise.normal(pair, 0), directed if i[k] < j[k] else -directed, noise.uniform(pair, 3)


PAIRS, CALLS, KT, DT = 500, 400, 1.7, 0.013
COEFFICIENT = D(gamma=4.5, gamma_perp=2.0, exponent=0.7, exponent_perp=1.6, cutoff=1.2)


def _dimers(seed=3):
    """Beads (2 k, 2 k + 1) at a distance of 0.1 to 1.1; their numbers are shuffled so that either may be the lower one."""
    rng = np.random.default_rng(seed)
    places = np.stack(np.meshgrid(*[np.arange(8) * 4.0] * 3), axis=-1).reshape(-1, 3)[:PAIRS]
    direction = rng.normal(size=(PAIRS, 3))
    direction /= np.linalg.norm(direction, axis=1)[:, None]
    r = rng.uniform(0.1, 1.1, PAIRS)
    shuffled = rng.permutation(2 * PAIRS).reshape(PAIRS, 2)
    x = np.zeros((2 * PAIRS, 3))
    x[shuffled[:, 0]] = places + direction * r[:, None]
    x[shuffled[:, 1]] = places
    return x, shuffled, direction, r


X, INDEX, E, R = _dimers()
NORMALS = np.linalg.svd(E[:, None, :])[2][:, 1:]  # two directions normal to e


def normalised(seeds=(7,) * CALLS, counters=tuple(range(CALLS)), kT=KT, factor=1.0, coefficient=COEFFICIENT):
    """(calls, pairs, 3): radial and two transverse components of the force on the first bead, over what they should be."""
    engine = PairEngine(make_plan(dpd.Scene({"W": 1.0}, ["W"] * len(X), X, {("W", "W"): coefficient}, kT), dt=DT, seed=1).spec)
    engine.prepare(X, None)
    w = 1 - R / coefficient.cutoff
    par = np.sqrt(2 * kT * coefficient.gamma * factor / DT) * w**coefficient.exponent
    perp = np.sqrt(2 * kT * coefficient.gamma_perp * factor / DT) * w**coefficient.exponent_perp
    components = np.empty((len(seeds), PAIRS, 3))
    for k, (seed, counter) in enumerate(zip(seeds, counters, strict=True)):
        force = engine.forces(RANDOM, None, kT, DT, seed, counter)[1]
        # pairwise opposite to the last bit: nothing else acts on these beads
        assert np.array_equal(force[INDEX[:, 0]], -force[INDEX[:, 1]])
        components[k, :, 0] = np.einsum("pk,pk->p", force[INDEX[:, 0]], E) / par
        components[k, :, 1:] = np.einsum("pak,pk->pa", NORMALS, force[INDEX[:, 0]]) / perp[:, None]
    return components


@pytest.fixture(scope="module")
def samples():
    return normalised()


def variance_in_errors(values: np.ndarray) -> float:
    """(<z^2> - 1) in standard errors, which are sqrt(2/M) for normal numbers."""
    return float((np.mean(values**2) - 1) / np.sqrt(2 / values.size))


@pytest.mark.parametrize(("part", "error"), [(slice(0, 1), 0.0032), (slice(1, 3), 0.0022)], ids=["radial", "transverse"])
def test_mean_and_variance(samples, part, error):
    """Variance 1 within 4 standard errors (0.32 % radial, 0.22 % transverse), and sigma 1 % too large or small would be seen."""
    z = samples[..., part]
    assert np.sqrt(2 / z.size) == pytest.approx(error, rel=0.02)
    assert abs(z.mean()) < 4 / np.sqrt(z.size)
    assert abs(variance_in_errors(z)) < 4
    assert abs(variance_in_errors(1.01 * z)) > 4
    assert abs(variance_in_errors(0.99 * z)) > 4
    assert abs(np.mean(z**4) - 3) < 4 * np.sqrt(96 / z.size)


def test_variance_of_near_and_far_pairs_apart(samples):
    """The weight w^s is right at every distance: the tenths of the pairs by distance, 20,000 radial numbers each, error 1 %."""
    for pairs in np.argsort(R).reshape(10, -1):
        assert abs(variance_in_errors(samples[:, pairs, 0])) < 4
        assert abs(variance_in_errors(samples[:, pairs, 1:])) < 4


def correlation_in_errors(a: np.ndarray, b: np.ndarray) -> float:
    """Mean of a*b over its standard error 1/sqrt(M) for independent normal numbers."""
    return float(np.mean(a * b) * np.sqrt(a.size))


def test_no_correlation_between_components_steps_and_pairs(samples):
    """Products of components of one pair, of consecutive steps and of neighbouring pairs average to 0 within 4/sqrt(M); so do those of squares."""
    radial, first, second = (samples[..., k] for k in range(3))
    couples = {
        "radial, transverse": (radial, first),
        "transverse, transverse": (first, second),
        "next step": (radial[1:], radial[:-1]),
        "next step, transverse": (first[1:], first[:-1]),
        "next step, mixed": (radial[1:], first[:-1]),
        "another pair": (radial[:, 1:], radial[:, :-1]),
        "another pair, transverse": (first[:, 1:], first[:, :-1]),
        "another pair, next step": (radial[1:, 1:], radial[:-1, :-1]),
    }
    for name, (a, b) in couples.items():
        assert abs(correlation_in_errors(a, b)) < 4, name
        assert abs(correlation_in_errors(a**2 - 1, b**2 - 1)) < 4 * 2, name
    assert abs(correlation_in_errors(radial, first + 0.02 * radial)) > 4  # the check sees a correlation of 2 %: it is nine standard errors


def test_no_correlation_between_seeds(samples):
    for seeds, counters in (
        ((8,) * CALLS, range(CALLS)),
        ((7,) * CALLS, range(10_000, 10_000 + CALLS)),
        (range(100, 100 + CALLS), (3,) * CALLS),
    ):
        other = normalised(tuple(seeds), tuple(counters))
        for k in range(3):
            assert abs(correlation_in_errors(samples[..., k], other[..., k])) < 4
            assert abs(variance_in_errors(other[..., k])) < 4


def test_covariance_of_all_beads_of_a_fluid_is_that_of_the_friction():
    """<F F^T> dt = 2 kT Gamma, F_D = -Gamma v, for 12 beads; errors of elements C_ab are sqrt((C_aa C_bb + C_ab^2)/M), M = 3,000."""
    from scenes import EXTENDED, fluid

    scene = fluid(EXTENDED, None, density=8.0, n=12, seed=2, kT=KT)
    engine = ready(PairEngine(make_plan(scene, dt=DT, seed=1).spec), scene.positions, None)
    friction = np.array([-engine.forces(2, unit.reshape(12, 3), KT, DT, 0, 0)[1].ravel() for unit in np.eye(36)])
    np.testing.assert_allclose(friction, friction.T, atol=1e-12)
    forces = np.array([engine.forces(RANDOM, None, KT, DT, 3, counter)[1].ravel() for counter in range(3000)])
    expected = 2 * KT * friction / DT
    error = np.sqrt((np.outer(np.diag(expected), np.diag(expected)) + expected**2) / len(forces))
    deviation = (forces.T @ forces / len(forces) - expected) / error
    # 666 different elements: the largest of as many normal numbers stays below 4.5 with probability 0.995
    assert np.abs(deviation).max() < 4.5
    assert abs(np.trace(forces.T @ forces / len(forces)) / np.trace(expected) - 1) < 0.02
