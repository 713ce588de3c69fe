"""Statistics of the random forces on isolated pairs, radial and transverse apart.

500 pairs with directions and distances of their own, far from each other, 400 evaluations: M = 200,000 radial and 400,000 transverse
components, in units of sigma w^s/sqrt(dt).  Seeds are fixed; bounds are 4 standard errors.
"""

import numpy as np
import pytest
from scenes import D, ready

import openmm_dpd as dpd
from openmm_dpd.kernels.engine import RANDOM, PairEngine
from openmm_dpd.plan.plan import make_plan

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
    """Fluctuation-dissipation as a matrix: <F F^T> dt = 2 kT Gamma, where F_D = -Gamma v, for 12 beads, 3,000 evaluations.

    Errors of the elements of the covariance are sqrt((C_aa C_bb + C_ab^2)/M).
    """
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
