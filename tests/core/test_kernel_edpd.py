"""eDPD: forces and heat against the oracle, ranges, factors, walls, noise and errors."""

import numpy as np
import oracle_meso as oracle
import pytest
from cases import cases, every_pair, raises
from reference_forces import (
    COUNTER,
    DT,
    PARTS,
    SEED,
    between,
    close,
    matrix,
    noise_matrices,
    prepared,
    same_terms,
    scaled_by,
    uniform_matrix,
)
from scenes import BOX, BOXES, MASSES, chains, fluid, listed_pairs, noise_of
from scipy import stats

import openmm_dpd as dpd
from openmm_dpd.kernels.engine import CONSERVATIVE, DISSIPATIVE, RANDOM
from openmm_dpd.kernels.noise import clamped
from openmm_dpd.model.edpd import EDPD
from openmm_dpd.model.internal import BeadTemperatures
from openmm_dpd.runtime.threads import set_threads

COMPAT = pytest.mark.parametrize("compat", ["consistent", "lammps"])
_POLYNOMIALS = {"exponent_polynomial": (0.5, -0.3, 0.8, 0.2), "kappa_polynomial": (0.5, -0.3, 0.2, 0.1)}
_WIDE = {"cutoff": 1.2, "cutoff_T": 0.8, "exponent": 0.41, "exponent_T": 1.0, "exponent_polynomial": (-3.0, 0, 0, 0)}
#: Conduction reaches further than the forces, less far, and as far; the exponent of AB falls to its smallest value where it is warm.
TABLE = {
    ("A", "A"): EDPD(A=25, gamma=4.5, kappa=0.7, cutoff=1.0, cutoff_T=1.2, **_POLYNOMIALS),
    ("A", "B"): EDPD(A=31, gamma=2, kappa=0.2, **_WIDE),
    ("B", "B"): EDPD(A=18, gamma=9, kappa=1.3, cutoff=0.9, exponent=1.2, exponent_T=3.0, kappa_polynomial=(-0.2, 0.4, 0, 0.3)),
}


def warm_fluid(box=BOXES["ortho"], *, make=fluid, table=TABLE, seed=5, **options) -> dpd.Scene:
    """Temperatures from 0.6 to 1.8 and heat capacities from 2 to 5."""
    rng, n = np.random.default_rng(seed), make(box=box).n_beads
    return make(table=table, box=box, internal=BeadTemperatures(rng.uniform(0.6, 1.8, n), rng.uniform(2.0, 5.0, n)), **options)


def evaluate(scene, which, v=None, counter=COUNTER, engine=None):
    """Energy, forces, virial and heat (N,) into each bead."""
    engine = engine or prepared(scene)
    temperature = scene.internal.values(scene.n_beads)
    energy, force, virial = engine.forces(which, scene.velocities if v is None else v, 1.0, DT, SEED, counter, temperature)
    return energy, force, virial, engine.rates[:, 0] * scene.internal.heat_capacities(scene.n_beads)


def oracle_rates(scene, compat="consistent", masses=None) -> oracle.EdpdRates:
    n, get = scene.n_beads, lambda key: matrix(scene, key)
    motion, heat = noise_matrices(n)
    return oracle.edpd_pair(
        scene.positions, scene.velocities, scene.internal.values(n)[:, 0], scene.internal.heat_capacities(n), scene.type_ids,
        scene.bead_masses if masses is None else masses, get("A"), get("gamma"), get("exponent"), get("cutoff"), get("kappa"),
        get("exponent_T"), get("cutoff_T"), scene.box, DT, xi=motion, xi_T=None if compat == "lammps" else heat,
        power_coeffs=get("exponent_polynomial"), kappa_coeffs=get("kappa_polynomial"), compat=compat,
    )  # fmt: skip


def pair_of_beads(f=1.0, distance=0.5, compat="consistent", **changes) -> dpd.Scene:
    """Two bonded beads of unequal mass, temperature and capacity; ``f`` is their factor."""
    values = {"A": 25, "gamma": 4.5, "kappa": 0.7, "exponent": 1.4} | changes
    x, v = np.array([[0.0, 0, 0], [0.6 * distance, 0, -0.8 * distance]]), np.array([[0.3, 1.0, -0.2], [-0.5, 0.4, 0.9]])
    bonds = [dpd.HarmonicBonds(np.array([[0, 1]]), 0.0, 0.5)]
    internal = BeadTemperatures(np.array([0.8, 1.7]), np.array([2.0, 5.0]))
    options = {"velocities": v, "internal": internal, "bonds": bonds, "bonded_factors": (f, 1, 1), "compat": compat}
    return dpd.Scene(MASSES, ["A", "B"], x, {("*", "*"): EDPD(**values)}, 1.0, **options)


# -- the oracle ---------------------------------------------------------------------------------------------------------------------------
@COMPAT
@BOX
def test_forces_and_heat_equal_the_oracle(box, compat):
    scene = warm_fluid(box, compat=compat)
    expected = oracle_rates(scene, compat)
    engine, terms = prepared(scene), expected.terms
    got = {which: evaluate(scene, which, engine=engine) for which in PARTS}
    same_terms([got[which] for which in PARTS], terms)
    assert not got[CONSERVATIVE][3].any()
    close(got[DISSIPATIVE][3], expected.q_conductive + expected.q_viscous_deterministic)
    close(got[RANDOM][3], expected.q_random + expected.q_viscous_random)
    _, force, _, heat = evaluate(scene, sum(PARTS), engine=engine)  # all at once
    close(force, terms.forces)
    close(heat, expected.q)


@COMPAT
def test_heat_and_forces_have_ranges_of_their_own(compat):
    """Heat range shorter and longer than the forces', in a fluid of one type; the list reaches as far as the longer."""
    for ranges in ({"cutoff": 1.2, "cutoff_T": 0.7}, {"cutoff": 0.7, "cutoff_T": 1.2}):
        scene = warm_fluid(table={("*", "*"): EDPD(A=25, gamma=4.5, kappa=0.7, **ranges)}, compat=compat)
        expected = oracle_rates(scene, compat)
        close(evaluate(scene, sum(PARTS))[1], expected.terms.forces)
        close(evaluate(scene, sum(PARTS))[3], expected.q)
    # two beads between the ranges
    short, long = (pair_of_beads(compat=compat, **ranges) for ranges in ({"cutoff_T": 0.4}, {"cutoff": 0.4, "cutoff_T": 1.0}))
    _, force, _, heat = evaluate(short, sum(PARTS))
    assert np.abs(force).max() > 1 and heat[0] == heat[1] and (heat[0] == 0) == (compat == "lammps")
    energy, force, virial, heat = evaluate(long, sum(PARTS))
    assert energy == virial == 0 and not force.any() and heat[0] == -heat[1] and (heat[0] == 0) == (compat == "lammps")


def test_conduction_loses_no_heat_and_viscous_heat_is_the_work_of_the_forces():
    """At rest in space the noise only conducts; in motion it heats by what its forces take.  Factors of neighbours included."""
    scene = warm_fluid(make=chains)
    at_rest, moving = (evaluate(scene, RANDOM, v=v) for v in (0 * scene.velocities, scene.velocities))
    assert abs(at_rest[3].sum()) < 1e-12 * np.abs(at_rest[3]).sum()
    assert np.abs(at_rest[3]).max() > 0.1
    assert moving[3].sum() == pytest.approx(-np.sum(scene.velocities * moving[1]), rel=1e-10)
    # deterministic: what friction takes, less what the kicks give on average, which does not depend on the velocities
    at_rest, moving = (evaluate(scene, DISSIPATIVE, v=v) for v in (0 * scene.velocities, scene.velocities))
    assert moving[3].sum() - at_rest[3].sum() == pytest.approx(-np.sum(scene.velocities * moving[1]), rel=1e-10)
    assert at_rest[3].sum() < -1.0
    for part in PARTS:
        force = evaluate(scene, part)[1]
        assert np.abs(force.sum(axis=0)).max() < 1e-12 * np.abs(force).sum()


@pytest.mark.parametrize("f", [0.25, 0.81])
def test_factors(f):
    """Repulsion and friction have f, noise its square root, viscous heat what its forces have, and conduction none."""
    plain, scaled = pair_of_beads(), pair_of_beads(f)
    for which, factor in ((CONSERVATIVE, f), (DISSIPATIVE, f), (RANDOM, np.sqrt(f))):
        one, other = evaluate(plain, which), evaluate(scaled, which)
        scaled_by(factor, one, other)
        assert other[3].sum() == pytest.approx(factor * one[3].sum(), rel=1e-12)
        assert np.diff(other[3]) == pytest.approx(np.diff(one[3]), rel=1e-12)


@COMPAT
def test_walls_have_infinite_mass(compat):
    mobile = np.arange(warm_fluid().n_beads) % 3 > 0
    scene = warm_fluid(compat=compat, mobile=mobile)
    expected = oracle_rates(scene, compat, masses=np.where(mobile, scene.bead_masses, np.inf))
    close(evaluate(scene, DISSIPATIVE)[3], expected.q_conductive + expected.q_viscous_deterministic)


# -- noise --------------------------------------------------------------------------------------------------------------------------------
def many_pairs(compat="consistent", n=5000) -> dpd.Scene:
    """Isolated pairs of beads 0.45 apart, all at T = 1.2 with capacities 2 and 3: every pair is one sample."""
    corner = 4.0 * np.array(list(np.ndindex(25, 20, 10)))
    x = np.concatenate([corner, corner + [0.27, 0.0, 0.36]])
    internal = BeadTemperatures(1.2, np.repeat([2.0, 3.0], n))
    table = {("*", "*"): EDPD(A=0, gamma=4.5, kappa=0.7, exponent=1.4, exponent_T=2.0, cutoff_T=0.9)}
    options = {"internal": internal, "velocities": np.zeros((2 * n, 3)), "compat": compat}
    return dpd.Scene(MASSES, ["A"] * n + ["B"] * n, x, table, 1.2, box=[100.0, 80.0, 40.0], **options)


def drawn_noise(scene, calls=20):
    """Force along the axis and heat of the first bead of each pair, (calls, n)."""
    n, engine = scene.n_beads // 2, prepared(scene)
    results = [evaluate(scene, RANDOM, counter=k, engine=engine) for k in range(calls)]
    axis = np.array([-0.6, 0.0, -0.8])
    return np.array([force[:n] @ axis for _, force, _, _ in results]), np.array([heat[:n] for *_, heat in results])


def test_noise_has_the_right_variance_and_heat_is_independent_of_motion():
    """100,000 samples: standard errors sqrt(2/n) of a variance, 1/sqrt(n) of a mean over its sigma and of a correlation; 4 of them fail."""
    force, heat = drawn_noise(many_pairs())
    n = force.size
    w, w_T, strength = 1 - 0.45, 1 - 0.45 / 0.9, 2 * 3 * 0.7 * 1.2**2
    for values, variance in ((force, 2 * 4.5 * 1.2 * w**1.4 / DT), (heat, 2 * strength * w_T**2 / DT)):
        assert abs(values.var() / variance - 1) < 4 * np.sqrt(2 / n)
        assert abs(values.mean()) < 4 * np.sqrt(variance / n)
    for first, second in ((force, heat), (heat[1:], heat[:-1]), (force[1:], heat[:-1]), (heat[:, 1:], heat[:, :-1])):
        assert abs(np.corrcoef(first.ravel(), second.ravel())[0, 1]) < 4 / np.sqrt(first.size)
    assert abs(np.corrcoef(force.ravel() ** 2, heat.ravel() ** 2)[0, 1]) < 4 / np.sqrt(n)  # no hidden dependence of the amplitudes either


def test_lammps_uses_the_noise_of_the_motion_for_the_heat():
    force, heat = drawn_noise(many_pairs("lammps"), calls=2)
    assert np.corrcoef(force.ravel(), heat.ravel())[0, 1] == pytest.approx(1.0, abs=1e-12)
    assert heat.var() == pytest.approx(drawn_noise(many_pairs(), calls=2)[1].var(), rel=4 * np.sqrt(4 / heat.size))


@pytest.mark.parametrize(("stream", "counter"), [(1, 3855336), (0, 5166690)])
def test_noise_of_the_heat_is_cut_at_five(stream, counter):
    """At these counts of the noise the number of the pair is beyond 5: it happens once in 1.7 million draws."""
    assert [clamped(value) for value in (-7.0, -5.0, 0.3, 5.0, 9.0)] == [-5.0, -5.0, 0.3, 5.0, 5.0]
    xi = noise_of(2, SEED, counter, 1.0)(0, 1, stream)
    assert abs(xi) > 5.05
    scene = pair_of_beads(compat="lammps" if stream == 0 else "consistent")
    _, force, _, heat = evaluate(scene, RANDOM, v=np.zeros((2, 3)), counter=counter)
    close(heat, np.sqrt(2 * 2 * 5 * 0.7 * 1.25**2 / DT) * 0.5 * np.sign(xi) * 5 * np.array([1, -1]))
    if stream == 0:
        theta = 2 / (1 / 0.8 + 1 / 1.7)
        assert np.linalg.norm(force[0]) == pytest.approx(np.sqrt(2 * 4.5 * theta * 0.5**1.4 / DT) * abs(xi), rel=1e-12)


# -- errors -------------------------------------------------------------------------------------------------------------------------------
@pytest.mark.parametrize("value", [0.0, -0.4, np.nan])
def test_a_temperature_must_stay_positive(value):
    scene = warm_fluid()
    temperature = scene.internal.values(scene.n_beads)
    temperature[[17, 30]] = value
    with pytest.raises(dpd.RunError, match=rf"temperature of bead 17 is {value:g}; it must be > 0"):
        prepared(scene).forces(sum(PARTS), scene.velocities, 1.0, DT, SEED, COUNTER, temperature)


def test_a_negative_conduction_coefficient_names_the_temperature():
    scene = pair_of_beads(kappa_polynomial=(-8.0, 0, 0, 0))
    evaluate(scene, CONSERVATIVE)
    for which in (DISSIPATIVE, RANDOM):
        raises(dpd.RunError, r"conduction coefficient is -0.7 at the temperature 1.25 of beads (0 and 1|1 and 0)", evaluate, scene, which)
    evaluate(pair_of_beads(kappa=0.0, kappa_polynomial=(-8.0, 0, 0, 0)), DISSIPATIVE)
    assert np.isnan(prepared(pair_of_beads()).laplacian())


# -- sweeps -------------------------------------------------------------------------------------------------------------------------------
def swept(scene, scheme="middle", dt=DT, counter=COUNTER):
    """Engine, change of the velocities, and of the temperatures."""
    engine = prepared(scene, scheme, dt)
    change = engine.sweep(scene.velocities, 1.0, dt, SEED, counter, scene.internal.values(scene.n_beads))
    return engine, change, engine.increments[:, 0].copy()


@every_pair("box, dt, scheme", list(BOXES), (DT, 3.0), ("middle", "shardlow"))
def test_a_sweep_equals_the_oracle(box, dt, scheme):
    """Beads that do not move, polynomials, all ranges; at the longer step moves are rejected."""
    mobile = np.arange(fluid(box=BOXES[box]).n_beads) % 4 > 0
    assert np.abs(equals_the_oracle(warm_fluid(BOXES[box], mobile=mobile), mobile, dt, scheme)).max() > 1e-3


@cases("capacity, reach, frozen", (400.0, 1.2, 0), (40.0, 1.2, 5), (40.0, 0.4, 0), (3.0, 1.2, 0))
def test_groups_of_like_beads_equal_one_pair_after_the_other(capacity, reach, frozen):
    """Many pairs of a bead and few; where capacities are small many pairs are done again, one by one."""
    n = fluid(box=BOXES["wide"]).n_beads
    mobile, start = np.arange(n) % 5 >= (frozen > 0), np.random.default_rng(5).uniform(0.9, 1.1, n)
    table = {("*", "*"): EDPD(A=25, gamma=4.5, kappa=6.0 / capacity, cutoff=reach, cutoff_T=0.9 * reach, **_POLYNOMIALS)}
    scene = fluid(table=table, box=BOXES["wide"], internal=BeadTemperatures(start, capacity), mobile=mobile)
    assert np.abs(equals_the_oracle(scene, mobile, DT, "middle")).max() > 0.1 / capacity


def equals_the_oracle(scene, mobile, dt, scheme):
    n, masses = scene.n_beads, np.where(mobile, scene.bead_masses, np.inf)
    engine, change, gained = swept(scene, scheme, dt)
    motion, heat = noise_matrices(n)
    keys = ("gamma", "exponent", "cutoff", "kappa", "exponent_T", "cutoff_T")
    seen = engine.seen(scene.velocities)
    v, temperature = oracle.edpd_sweep(
        seen, scene.internal.values(n)[:, 0], scene.internal.heat_capacities(n), scene.type_ids, masses, *(matrix(scene, key) for key in keys),
        listed_pairs(engine, 0), between(scene), dt, motion, heat, uniform_matrix(n, SEED, COUNTER, 2), uniform_matrix(n, SEED, COUNTER, 3),
        matrix(scene, "exponent_polynomial"), matrix(scene, "kappa_polynomial"), shardlow=scheme == "shardlow",
    )  # fmt: skip
    close(seen + change, v, 1e-11)
    close(gained, temperature - scene.internal.values(n)[:, 0], 1e-11)
    assert not gained[~mobile].any()
    return gained


@pytest.mark.parametrize("dt", [1e-4, 0.02, 3.0])
def test_a_sweep_keeps_energy_and_momentum_and_temperatures_positive(dt):
    scene = warm_fluid(make=chains)
    capacity, mass, v = scene.internal.heat_capacities(scene.n_beads), scene.bead_masses, scene.velocities
    _, change, gained = swept(scene, dt=dt)
    before = scene.internal.values(scene.n_beads)[:, 0]
    kinetic = [0.5 * mass @ np.sum(w**2, axis=1) for w in (v, v + change)]
    assert abs(kinetic[1] - kinetic[0] + capacity @ gained) < 1e-13 * (kinetic[0] + capacity @ before)
    assert np.abs(mass @ change).max() < 1e-13 * mass @ np.abs(v).sum(axis=1)
    assert (before + gained).min() > 0 and np.abs(gained).max() > 1e-3 * dt


def test_small_steps_of_both_forms_agree():
    """A sweep over a time dt is dt times the rates, noise included, to orders sqrt(dt) and 1/C, where capacities are the same."""
    n = warm_fluid().n_beads
    internal = BeadTemperatures(np.random.default_rng(5).uniform(0.9, 1.1, n), 1e9)
    scene, dt = fluid(table={("*", "*"): EDPD(A=0, gamma=4.5, kappa=1e-9, exponent=0.7)}, box=BOXES["ortho"], internal=internal), 1e-9
    engine, change, gained = swept(scene, dt=dt)
    force = engine.forces(DISSIPATIVE | RANDOM, scene.velocities, 1.0, dt, SEED, COUNTER, internal.values(n))[1]
    np.testing.assert_allclose(change, dt * force / scene.bead_masses[:, None], atol=3e-3 * np.abs(change).max())
    # conduction alone, without the noise of the motion that heats
    np.testing.assert_allclose(gained, dt * engine.rates[:, 0], atol=3e-3 * np.abs(gained).max())


def test_threads_give_the_same_bits():
    scene, results = warm_fluid(BOXES["wide"]), []
    for threads in (1, 2):
        set_threads(threads)
        results.append(swept(scene)[1:])
    for one, two in zip(*results, strict=True):
        np.testing.assert_array_equal(one, two)


def cluster(capacities, mobile=None, thetas=1.0):
    """Beads of two masses, all within reach of each other and at rest in space: only the sweep acts."""
    n = len(capacities)
    x = np.random.default_rng(3).uniform(0, 0.5, (n, 3))
    # conduction whose rate does not fall with the capacity
    table = {("*", "*"): EDPD(A=0, gamma=2.0, kappa=0.3 / np.mean(capacities), cutoff=1.5, exponent_polynomial=(0.3, 0, 0, 0))}
    internal = BeadTemperatures(np.broadcast_to(thetas, n).copy(), np.asarray(capacities, dtype=float))
    options = {"internal": internal, "velocities": np.zeros((n, 3)), "mobile": mobile}
    return dpd.Scene(MASSES, ["A", "B"] * (n // 2), x, table, 1.0, **options)


def sampled(scene, dt, sweeps=40_000, thin=10):
    """Temperatures (R, N) and kinetic energies (R,) after every ``thin`` sweeps, and the energy after all."""
    engine, n = prepared(scene, "middle", dt), scene.n_beads
    T, v, rows = scene.internal.values(n), scene.velocities.copy(), []
    kinetic = lambda: 0.5 * scene.bead_masses @ np.sum(v**2, axis=1)  # noqa: E731
    for k in range(sweeps):
        v += engine.sweep(v, 1.0, dt, SEED, k, T)
        T = T + engine.increments
        if k % thin == 0 and k > 20 * thin:
            rows.append((*T[:, 0], kinetic()))
    rows = np.array(rows)
    return rows[:, :-1], rows[:, -1], scene.internal.heat_capacities(n) @ T[:, 0] + kinetic()


@pytest.mark.slow
@cases("capacities, dt", ((3,) * 6, 0.1), ((60,) * 6, 5.0), ((2, 9, 2, 30, 2, 30), 0.1), ((2, 9, 2, 30, 2, 30), 5.0))
def test_a_sweep_samples_the_microcanonical_distribution(capacities, dt):
    """C T of a bead and K follow beta distributions: weight T^C of each bead, 3N - 6 velocities (total and angular momentum stay 0).

    Kolmogorov-Smirnov tests of 1,000 nearly independent samples, which fail at about 4 sigma (p < 6e-5).
    """
    T, kinetic, energy = sampled(cluster(capacities), dt)
    shapes, motion = np.array(capacities) + 1.0, (3 * 6 - 6) / 2
    assert energy == pytest.approx(sum(capacities), rel=1e-11)
    for bead in (0, 1, 3):
        expected = stats.beta(shapes[bead], shapes.sum() - shapes[bead] + motion)
        p = stats.kstest(capacities[bead] * T[::4, bead] / energy, expected.cdf).pvalue
        assert p > 6e-5, (bead, p)
        assert stats.kstest(capacities[bead] * T[::4, bead] / energy, stats.beta(*(np.array(expected.args) - [1, 0])).cdf).pvalue < 0.02
    assert stats.kstest(kinetic[::4] / energy, stats.beta(motion, shapes.sum()).cdf).pvalue > 6e-5


@pytest.mark.slow
@pytest.mark.parametrize("dt", [0.3, 5.0])
def test_a_wall_is_a_reservoir(dt):
    """Beads in contact with one that does not move, of T = 2, get that temperature: C T follows the gamma distribution."""
    T, kinetic, _ = sampled(cluster((6,) * 6, np.arange(6) > 0, np.where(np.arange(6) > 0, 1.0, 2.0)), dt)
    assert np.all(T[:, 0] == 2.0)
    assert stats.kstest(6 * T[::4, 3], stats.gamma(7.0, scale=2.0).cdf).pvalue > 6e-5


def test_large_capacities_relax_from_far_away():
    """Temperatures 50 % apart, where noise is 1/100 of that: no move is rejected, and the difference falls as it should, at any step.

    A Gaussian in the energy itself instead of its cube root would reject nearly all where capacities differ.  Bounds are four standard
    errors of the mean of 300 pairs.
    """
    n = 300
    corner = 4.0 * np.array(list(np.ndindex(10, 6, 5)))
    x = np.concatenate([corner, corner + [0.27, 0.0, 0.36]])
    table = {("*", "*"): EDPD(A=0, gamma=0, kappa=1e-5)}
    for capacity, mobile in ((1e5, True), (3e4, True), (1e5, False)):
        internal = BeadTemperatures(np.repeat([1.5, 1.0], n), np.repeat([1e5, capacity], n))
        scene = dpd.Scene(
            MASSES, ["A"] * n + ["B"] * n, x, table, 1.2, box=[40.0, 24.0, 20.0], internal=internal, velocities=np.zeros((2 * n, 3)),
            mobile=np.repeat([True, mobile], n),
        )  # fmt: skip
        gains = capacity + 1e5 if mobile else capacity
        for dt in (0.05, 1.0, 50.0):
            gained = swept(scene, dt=dt)[2]
            left = 1.0 + 2 * (gained[:n] - gained[n:]).mean()
            expected = np.exp(-1e-5 * gains * 0.55**2 * dt)
            noise = 2 * 1.5 * np.sqrt((1e-5 + mobile / capacity) / n)
            # where capacities differ the cube root bends the way by up to a third of the difference
            bent = 0.0 if mobile and capacity == 1e5 else 0.2 * expected * (1 - expected)
            assert left == pytest.approx(expected, abs=4 * noise + bent)
