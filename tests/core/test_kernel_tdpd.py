"""tDPD: forces and species fluxes against the oracle, ranges, factors, noise and errors."""

import numpy as np
import oracle as plain_oracle
import oracle_meso as oracle
import pytest
from reference_forces import COUNTER, DT, PARTS, SEED, between, close, matrix, noise_matrices, prepared, same_terms, scaled_by
from scenes import BOX, BOXES, MASSES, chains, fluid, listed_pairs
from scipy import stats

import openmm_dpd as dpd
from openmm_dpd.kernels.engine import CONSERVATIVE, DISSIPATIVE, RANDOM
from openmm_dpd.model.internal import Concentrations
from openmm_dpd.model.tdpd import TDPD

SPECIES = pytest.mark.parametrize("n_species", [1, 3, 4])
KT = 0.8


def species_table(n_species: int) -> dict:
    """Fluxes reach further than the forces, less far, and as far; species differ in everything."""
    k = np.arange(n_species)
    mixed = {"exponent": 0.41, "cutoff": 1.2, "cutoff_c": 0.8, "exponent_c": 1.0}
    return {
        ("A", "A"): TDPD(A=25, gamma=4.5, kappa=0.7 + 0.2 * k, epsilon=0.3 + 0.1 * k, cutoff=1.0, cutoff_c=1.2, exponent_c=2.0 + k),
        ("A", "B"): TDPD(A=31, gamma=2, kappa=0.2 * (1 + k), epsilon=0.2 / (1 + k), **mixed),
        ("B", "B"): TDPD(A=18, gamma=9, kappa=1.3 - 0.1 * k, epsilon=0.05 + 0.2 * k, exponent=1.2, cutoff=0.9, exponent_c=3.0 - 0.5 * k),
    }


def solution(box=BOXES["ortho"], n_species=3, *, make=fluid, table=None, seed=5, kT=KT, **options) -> dpd.Scene:
    """Concentrations from -0.5 to 2 (nothing keeps them positive)."""
    values = np.random.default_rng(seed).uniform(-0.5, 2.0, (make(box=box).n_beads, n_species))
    return make(table=table or species_table(n_species), box=box, kT=kT, internal=Concentrations(values), **options)


def evaluate(scene, which, counter=COUNTER, kT=KT, engine=None):
    """Energy, forces, virial and fluxes (N, K) of each bead."""
    engine = engine or prepared(scene)
    return *engine.forces(which, scene.velocities, kT, DT, SEED, counter, scene.internal.values), engine.rates.copy()


def oracle_rates(scene, kT=KT) -> oracle.TdpdRates:
    get = lambda key: matrix(scene, key)  # noqa: E731
    per_species = lambda key: list(np.moveaxis(get(key), -1, 0))  # noqa: E731
    xi, *xi_C = noise_matrices(scene.n_beads, kT, flows=scene.internal.n_species)
    return oracle.tdpd_pair(
        scene.positions, scene.velocities, scene.internal.values, scene.type_ids, get("A"), get("gamma"), get("exponent"), get("cutoff"),
        get("cutoff_c"), per_species("kappa"), per_species("epsilon"), per_species("exponent_c"), kT, scene.box, DT, xi=xi, xi_C=xi_C,
    )  # fmt: skip


def pair_of_beads(f=1.0, n_species=3, compat="consistent", **changes) -> dpd.Scene:
    """Two bonded beads 0.5 apart; ``f`` is their factor."""
    values = {"A": 25, "gamma": 4.5, "kappa": 0.7 + 0.1 * np.arange(n_species), "epsilon": 0.3, "exponent": 1.4} | changes
    x, v = np.array([[0.0, 0, 0], [0.3, 0, -0.4]]), np.array([[0.3, 1.0, -0.2], [-0.5, 0.4, 0.9]])
    bonds = [dpd.HarmonicBonds(np.array([[0, 1]]), 0.0, 0.5)]
    internal = Concentrations(np.array([0.8, 1.7])[:, None] + 0.4 * np.arange(n_species))
    options = {"velocities": v, "internal": internal, "bonds": bonds, "bonded_factors": (f, 1, 1), "compat": compat}
    return dpd.Scene(MASSES, ["A", "B"], x, {("*", "*"): TDPD(**values)}, KT, **options)


# -- the oracle ---------------------------------------------------------------------------------------------------------------------------
@SPECIES
@BOX
def test_forces_and_fluxes_equal_the_oracle(box, n_species):
    scene = solution(box, n_species)
    expected = oracle_rates(scene)
    engine, terms = prepared(scene), expected.terms
    got = {which: evaluate(scene, which, engine=engine) for which in PARTS}
    same_terms([got[which] for which in PARTS], terms)
    assert not got[CONSERVATIVE][3].any()
    close(got[DISSIPATIVE][3], expected.conductive)
    close(got[RANDOM][3], expected.random)
    _, force, _, rates = evaluate(scene, sum(PARTS), engine=engine)
    close(force, terms.forces)
    close(rates, expected.Q)
    for part in (got[DISSIPATIVE][3], got[RANDOM][3]):  # nothing is lost
        assert np.abs(part.sum(axis=0)).max() < 1e-12 * np.abs(part).sum()
    for which in PARTS:
        assert np.abs(got[which][1].sum(axis=0)).max() < 1e-12 * np.abs(got[which][1]).sum()


def test_fluxes_and_forces_have_ranges_of_their_own():
    """Also with ``compat="lammps"``: the list reaches as far as the longer of the two."""
    short, long = pair_of_beads(cutoff_c=0.4), pair_of_beads(cutoff=0.4, cutoff_c=1.0)
    _, force, _, rates = evaluate(short, sum(PARTS))
    assert not rates.any() and np.abs(force).max() > 1
    energy, force, virial, rates = evaluate(long, sum(PARTS))
    assert energy == virial == 0 and not force.any()
    np.testing.assert_array_equal(rates[0], -rates[1])
    assert np.abs(rates).min() > 0.001


def test_the_noise_of_species_does_not_depend_on_the_temperature_of_the_forces():
    scene = pair_of_beads(n_species=1)
    cold, warm = evaluate(scene, RANDOM, kT=0.0), evaluate(scene, RANDOM)
    assert not cold[1].any() and np.abs(warm[1]).max() > 1
    numbers = [noise_matrices(2, kT)[1] for kT in (0.0, KT)]  # another temperature draws other numbers, of the same amplitude
    close(cold[3][:, 0] * numbers[1][0, 1], warm[3][:, 0] * numbers[0][0, 1])


@pytest.mark.parametrize("f", [0.25, 0.81])
def test_factors(f):
    """Repulsion and friction have f, noise its square root, fluxes none."""
    plain, scaled = pair_of_beads(), pair_of_beads(f)
    for which, factor in ((CONSERVATIVE, f), (DISSIPATIVE, f), (RANDOM, np.sqrt(f))):
        one, other = evaluate(plain, which), evaluate(scaled, which)
        scaled_by(factor, one, other)
        np.testing.assert_array_equal(other[3], one[3])


def test_laplacian_counts_the_range_of_the_forces_only():
    scene = solution()
    zero = np.zeros((2, 2))
    params = plain_oracle.PairParams(matrix(scene, "A"), zero, zero, zero + 1, zero + 1, matrix(scene, "cutoff"))
    expected = plain_oracle.conservative(scene.positions, scene.type_ids, params, scene.box).laplacian
    assert prepared(scene).laplacian() == pytest.approx(expected, rel=1e-11)
    whole, half = pair_of_beads(), pair_of_beads(0.5)  # immobile beads do not count, a factor does
    assert prepared(half).laplacian() == pytest.approx(0.5 * prepared(whole).laplacian(), rel=1e-12)


def test_walls_and_chains_keep_species():
    """Fluxes of bonded and immobile beads sum to zero as well: what walls get is the program's affair."""
    rates = evaluate(solution(make=chains, mobile=np.arange(100) % 3 > 0), sum(PARTS))[3]
    assert np.abs(rates.sum(axis=0)).max() < 1e-12 * np.abs(rates).sum()
    assert np.abs(rates).max() > 1


# -- noise --------------------------------------------------------------------------------------------------------------------------------
def test_noise_has_the_right_variance_and_species_are_independent():
    """100,000 samples: standard errors sqrt(2/n) of a variance, 1/sqrt(n) of a mean over its sigma and of a correlation; 4 of them fail."""
    n = 5000
    corner = 4.0 * np.array(list(np.ndindex(25, 20, 10)))
    x = np.concatenate([corner, corner + [0.27, 0.0, 0.36]])
    c = np.repeat([[0.5, 1.0, 2.0, -0.4], [1.5, 0.5, 0.7, 1.4]], n, axis=0)
    epsilon, p = np.array([0.3, 0.2, 0.7, 0.5]), np.array([2.0, 1.0, 3.0, 0.5])
    table = {("*", "*"): TDPD(A=0, gamma=4.5, kappa=[1.0] * 4, epsilon=epsilon, exponent=1.4, cutoff_c=0.9, exponent_c=p)}
    options = {"box": [100.0, 80.0, 40.0], "internal": Concentrations(c), "velocities": np.zeros((2 * n, 3))}
    scene = dpd.Scene(MASSES, ["A", "B"] * n, x, table, KT, **options)
    engine = prepared(scene)
    results = [evaluate(scene, RANDOM, counter=k, engine=engine) for k in range(20)]
    columns = [np.array([force[:n] @ [-0.6, 0.0, -0.8] for _, force, _, _ in results])]
    columns += [np.array([rates[:n, k] for *_, rates in results]) for k in range(4)]
    variances = [2 * KT * 4.5 * (1 - 0.45) ** 1.4 / DT, *(epsilon**2 * (1 - 0.45 / 0.9) ** p * (c[0] + c[-1]) ** 2 / DT)]
    samples = columns[0].size
    for values, variance in zip(columns, variances, strict=True):
        assert abs(values.var() / variance - 1) < 4 * np.sqrt(2 / samples)
        assert abs(values.mean()) < 4 * np.sqrt(variance / samples)
    assert np.abs(np.corrcoef([values.ravel() for values in columns])[np.triu_indices(5, 1)]).max() < 4 / np.sqrt(samples)


def test_noise_of_species_is_cut_at_five_and_that_of_the_motion_is_not():
    """At these counts of the noise the number of the pair is beyond 5: it happens once in 1.7 million draws."""
    for stream, counter in ((1, 4109626), (0, 93252)):
        drawn = noise_matrices(2, KT, counter)[stream][0, 1]
        assert abs(drawn) > 5.05
        _, force, _, rates = evaluate(pair_of_beads(n_species=1), RANDOM, counter=counter)
        if stream == 0:
            assert np.linalg.norm(force[0]) == pytest.approx(np.sqrt(2 * KT * 4.5 * 0.5**1.4 / DT) * abs(drawn), rel=1e-12)
        else:
            close(rates[:, 0], 0.3 * 0.5 * 2.5 / np.sqrt(DT) * np.sign(drawn) * 5 * np.array([1, -1]))


# -- sweeps -------------------------------------------------------------------------------------------------------------------------------
@pytest.mark.parametrize("scheme", ["middle", "shardlow"])
@pytest.mark.parametrize("dt", [DT, 2.0])
@SPECIES
def test_a_sweep_equals_the_oracle(n_species, dt, scheme):
    """Some concentrations are negative, some beads do not move; at the longer step noise goes beyond 0."""
    mobile = np.arange(solution().n_beads) % 4 > 0
    scene = solution(n_species=n_species, mobile=mobile)
    engine, n, c = prepared(scene, scheme, dt), scene.n_beads, scene.internal.values
    seen = engine.seen(scene.velocities)
    change = engine.sweep(scene.velocities, KT, dt, SEED, COUNTER, c)
    xi, *xi_C = noise_matrices(n, KT, flows=n_species)
    get = lambda key: matrix(scene, key)  # noqa: E731
    per_species = lambda key: list(np.moveaxis(get(key), -1, 0))  # noqa: E731
    v, expected = oracle.tdpd_sweep(
        seen, c, scene.type_ids, np.where(mobile, scene.bead_masses, np.inf), get("gamma"), get("exponent"), get("cutoff"), get("cutoff_c"),
        per_species("kappa"), per_species("epsilon"), per_species("exponent_c"), KT, listed_pairs(engine, 0), between(scene), dt,
        xi, xi_C, shardlow=scheme == "shardlow",
    )  # fmt: skip
    close(seen + change, v)
    close(engine.increments, expected - c)
    assert not engine.increments[~mobile].any()


@pytest.mark.parametrize("dt", [1e-4, 0.02, 10.0])
def test_a_sweep_keeps_the_species_and_none_becomes_negative(dt):
    """Beginning with empty beads, with much noise, at any step."""
    scene = solution(make=chains)
    c = np.maximum(scene.internal.values, 0.0)
    c[::3] = 0.0
    engine, total = prepared(scene, "middle", dt), c.sum(axis=0)
    for k in range(5):
        engine.sweep(scene.velocities, KT, dt, SEED, k, c)
        c = c + engine.increments
        assert c.min() >= 0.0 and np.abs(engine.increments).max() > 1e-3 * dt
    assert np.abs(c.sum(axis=0) - total).max() < 1e-13 * total.max()


def test_small_steps_of_both_forms_agree():
    """A sweep over a time dt is dt times the rates, noise included, to order sqrt(dt)."""
    scene = solution(table={("*", "*"): TDPD(A=0, gamma=4.5, kappa=[0.7, 0.3, 0.0], epsilon=[0.0, 0.1, 0.2], exponent=1.4)})
    c, dt = np.abs(scene.internal.values) + 0.3, 1e-9
    engine = prepared(scene, "middle")
    force = engine.forces(DISSIPATIVE | RANDOM, scene.velocities, KT, dt, SEED, COUNTER, c)[1]
    rates = engine.rates.copy()
    change = engine.sweep(scene.velocities, KT, dt, SEED, COUNTER, c)
    np.testing.assert_allclose(change, dt * force / scene.bead_masses[:, None], atol=3e-3 * np.abs(change).max())
    np.testing.assert_allclose(engine.increments, dt * rates, atol=3e-3 * np.abs(engine.increments).max())


@pytest.mark.parametrize("dt", [0.05, 1.0, 20.0])
def test_what_two_beads_share_follows_a_gaussian_that_is_cut_off(dt):
    """C_i/(C_i + C_j) of two beads has the weight exp(-(z - 1/2)^2/2V) between 0 and 1, V = epsilon^2/4 kappa, at any step; without noise it
    relaxes exactly.  5,000 pairs by themselves: a Kolmogorov-Smirnov test of the last of 400 sweeps (p < 6e-5 fails), for three V; the
    Gaussians of 1.2 V fail it."""
    n, kappa, variance = 5000, 0.8, np.array([0.004, 0.04, 0.15])
    corner = 4.0 * np.array(list(np.ndindex(25, 20, 10)))
    x = np.concatenate([corner, corner + [0.27, 0.0, 0.36]])
    epsilon = np.append(np.sqrt(4 * kappa * variance), 0.0)
    table = {("*", "*"): TDPD(A=0, gamma=0.0, kappa=[kappa] * 4, epsilon=epsilon, cutoff=0.9)}
    c = np.repeat([[1.2] * 4, [0.4] * 4], n, axis=0)
    scene = dpd.Scene(MASSES, ["A", "B"] * n, x, table, KT, box=[100.0, 80.0, 40.0], internal=Concentrations(c))
    engine = prepared(scene, "middle", dt)
    for k in range(400):
        engine.sweep(np.zeros_like(x), KT, dt, SEED, k, c)
        c = c + engine.increments
        if k == 0:
            left = np.exp(-2 * kappa * (1 - 0.45 / 0.9) ** 2 * dt)
            np.testing.assert_allclose(c[:n, 3], 0.8 + 0.4 * left, rtol=1e-14)
    share = c[:n] / 1.6
    for s, V in enumerate(variance):
        width = np.sqrt(V)
        law = lambda width: stats.truncnorm(-0.5 / width, 0.5 / width, 0.5, width)  # noqa: E731
        assert stats.kstest(share[:, s], law(width).cdf).pvalue > 6e-5
        assert stats.kstest(share[:, s], law(1.2 * width).cdf).pvalue < 6e-5 or s == 2


def test_the_conservative_force_needs_no_concentrations():
    scene = solution()
    energy, force, _ = prepared(scene).forces(CONSERVATIVE, None, 0.0, 1.0, 0, 0)
    expected = evaluate(scene, CONSERVATIVE)
    assert energy == expected[0] and np.array_equal(force, expected[1])
