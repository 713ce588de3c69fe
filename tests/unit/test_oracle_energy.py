"""The oracle of beads with an internal energy: hand-worked pairs, balances, the isothermal oracle."""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np
import pytest

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

import oracle
import oracle_energy as oe
from oracle_cases import BOXES, fluid

A = np.array([[25.0, 31.0], [31.0, 18.0]])
SIGMA = np.array([[3.0, 2.0], [2.0, 4.0]])
KAPPA = np.array([[0.7, 0.2], [0.2, 1.3]])
CUTOFF = np.array([[1.0, 1.2], [1.2, 0.9]])
K_B = 0.3

BOX_CASES = pytest.mark.parametrize("box", BOXES.values(), ids=BOXES.keys())


def noises(n, seed=5):
    """A symmetric and an antisymmetric matrix of N(0,1)."""
    upper = np.triu(np.random.default_rng(seed).normal(size=(2, n, n)), 1)
    return upper[0] + upper[0].T, upper[1] - upper[1].T


def scene(n=14):
    x, v, types, inv_m = fluid(n)
    return x, v, types, 1.0 / inv_m, np.random.default_rng(8).uniform(0.6, 2.0, n)


def rates(x, v, theta, types, masses, box, dt=0.01, seed=5, **changes):
    options = {"A": A, "sigma": SIGMA, "kappa": KAPPA, "cutoff": CUTOFF} | changes
    return oe.dpde_rates(
        x, v, theta, types, masses, **options, box=box, k_B=K_B, dt=dt, **dict(zip(("xi", "xi_q"), noises(len(x), seed), strict=True))
    )


def kinetic(masses, v):
    return 0.5 * float(np.sum(masses[:, None] * v**2))


# ------------------------------------------------------------------------------------------------- rates


def test_rates_of_two_beads_worked_by_hand():
    """r = 1/2 of rc = 1 across a face, so w = 1/2; e = (1, 0, 0), e.v = 2; theta 1 and 3: harmonic mean 3/2."""
    x = np.array([[0.25, 1, 1], [2.75, 1, 1]])
    v = np.array([[1.5, 1, -1], [-0.5, 0, 2]])
    xi, xi_q = np.array([[0, 0.6], [0.6, 0]]), np.array([[0, -1.5], [1.5, 0]])
    got = oe.dpde_rates(
        x,
        v,
        [1.0, 3.0],
        [0, 0],
        [2.0, 4.0],
        A=20.0,
        sigma=3.0,
        kappa=0.25,
        cutoff=1.0,
        box=np.diag([3.0] * 3),
        k_B=2.0,
        dt=0.25,
        xi=xi,
        xi_q=xi_q,
    )
    # gamma = 9/(2*2*1.5) = 1.5; D = -1.5/4*2 = -0.75; R = 3*0.5*0.6/0.5 = 1.8
    np.testing.assert_allclose(got.terms.conservative, [[10, 0, 0], [-10, 0, 0]])
    np.testing.assert_allclose(got.terms.dissipative, [[-0.75, 0, 0], [0.75, 0, 0]])
    np.testing.assert_allclose(got.terms.random, [[1.8, 0, 0], [-1.8, 0, 0]])
    assert got.terms.energy == pytest.approx(2.5)
    assert got.terms.virial == pytest.approx(0.5 * (10 - 0.75 + 1.8))
    # mech: (0.375*4 - 2.25*0.75/2)/2 = 0.328125 ; -(3*0.5*2*0.6/0.5)/2 = -1.8
    np.testing.assert_allclose(got.mech_deterministic, [0.328125] * 2)
    np.testing.assert_allclose(got.mech_random, [-1.8] * 2)
    # cond: 0.25*(1 - 1/3)/4 = 1/24 ; sqrt(2*2*0.25) = 1, 1*0.5*(-1.5)/0.5 = -1.5
    np.testing.assert_allclose(got.cond_deterministic, [1 / 24, -1 / 24])
    np.testing.assert_allclose(got.cond_random, [-1.5, 1.5])


@BOX_CASES
def test_rates_conserve_momentum_and_energy(box):
    x, v, types, masses, theta = scene()
    got = rates(x, v, theta, types, masses, box)
    for part in (got.terms.conservative, got.terms.dissipative, got.terms.random):
        assert np.abs(part).max() > 0.1
        np.testing.assert_allclose(part.sum(axis=0), 0.0, atol=1e-10)
    for part in (got.cond_deterministic, got.cond_random):
        assert np.abs(part).max() > 0.01
        assert part.sum() == pytest.approx(0.0, abs=1e-11)
    assert got.mech_random.sum() == pytest.approx(-np.sum(v * got.terms.random), abs=1e-9)
    ito = sum(
        0.25 * (SIGMA[a, b] * (1 - r / CUTOFF[a, b])) ** 2 * (1 / masses[i] + 1 / masses[j])
        for i, j, a, b, r, _ in oe.ordered_pairs(x, types, CUTOFF, box)
    )
    assert ito > 1.0
    assert got.mech_deterministic.sum() == pytest.approx(-np.sum(v * got.terms.dissipative) - ito, rel=1e-12)


@BOX_CASES
def test_forces_equal_the_isothermal_ones_at_uniform_temperature(box):
    x, v, types, masses, _ = scene()
    theta, dt = 1.4, 0.02
    got = rates(x, v, np.full(len(x), theta), types, masses, box, dt=dt).terms
    params = oracle.PairParams.build(2, A=A, gamma=SIGMA**2 / (2 * K_B * theta), cutoff=CUTOFF)
    xi, _ = noises(len(x))
    C = oracle.conservative(x, types, params, box)
    D = oracle.dissipative(x, v, types, params, box)
    R = oracle.random(x, types, params, box, K_B * theta, dt, lambda i, j, k: xi[i, j])
    for mine, other in ((got.conservative, C.forces), (got.dissipative, D.forces), (got.random, R.forces)):
        np.testing.assert_allclose(mine, other, rtol=1e-11, atol=1e-11)
    np.testing.assert_allclose(got.virial_tensor, C.virial_tensor + D.virial_tensor + R.virial_tensor, rtol=1e-11, atol=1e-10)
    assert got.energy == pytest.approx(C.energy, rel=1e-13)
    if box is not None:
        assert oe.pressure(masses, v, got, box) == pytest.approx(oracle.pressure(masses, v, C.virial + D.virial + R.virial, box))


def test_kinetic_energy_and_heat_balance_over_a_step_up_to_dt_squared():
    """Averaged over xi = +-1 (mean 0, variance 1), the kick D + R and the heat cancel to first order in dt."""
    x = np.array([[0.0, 0, 0], [0.4, 0.3, 0]])
    v = np.array([[0.3, -1.0, 0.4], [1.0, 0.5, 0.2]])
    masses, theta = np.array([1.0, 3.0]), np.array([0.7, 1.9])

    def imbalance(dt):
        total = 0.0
        for sign in (1.0, -1.0):
            xi = sign * (1 - np.eye(2))
            got = oe.dpde_rates(x, v, theta, [0, 0], masses, 0.0, 3.0, 0.0, 1.0, None, K_B, dt, xi)
            new = v + dt * got.terms.forces / masses[:, None]
            total += 0.5 * (kinetic(masses, new) - kinetic(masses, v) + dt * got.du_mech.sum())
        return total

    assert imbalance(1e-3) / imbalance(1e-4) == pytest.approx(100.0, rel=1e-6)


def test_wrong_noise_is_refused():
    x, v, types, masses, theta = scene(4)
    xi, xi_q = noises(4)
    with pytest.raises(ValueError, match="symmetric"):
        oe.dpde_rates(x, v, theta, types, masses, A, SIGMA, KAPPA, CUTOFF, None, K_B, 0.01, xi_q, xi_q)
    with pytest.raises(ValueError, match="antisymmetric"):
        oe.dpde_rates(x, v, theta, types, masses, A, SIGMA, KAPPA, CUTOFF, None, K_B, 0.01, xi, xi)


# ----------------------------------------------------------------------------------------- velocity Verlet


def test_verlet_step_takes_the_second_rates_at_half_step_temperatures():
    """Two beads worked by hand: conduction only, no motion; theta seen by the second evaluation is at half step."""
    x, v = np.array([[0.0, 0, 0], [0.5, 0, 0]]), np.zeros((2, 3))
    seen = []

    def at(x, v, theta):
        seen.append(theta)
        return oe.dpde_rates(x, v, theta, [0, 0], [1.0, 1.0], 0.0, 0.0, 4.0, 1.0, None, 1.0, 0.1)

    eos = oe.constant_cv([2.0, 4.0])
    theta0 = np.array([1.0, 2.0])
    out = oe.dpde_verlet_step(x, v, np.zeros(2), eos.u(theta0), at(x, v, theta0), [1.0, 1.0], 0.1, eos, at)
    # du_0 = 4*(1 - 1/2)/4 = 1/2: half step u = 2.025, 7.975
    np.testing.assert_allclose(seen[1], [1.0125, 1.99375])
    du = 1 / 1.0125 - 1 / 1.99375
    np.testing.assert_allclose(out.u_cond, 0.05 * np.array([0.5 + du, -0.5 - du]))
    np.testing.assert_allclose(out.u_mech, [2.0, 8.0])
    np.testing.assert_allclose(out.theta, (out.u_cond + out.u_mech) / [2.0, 4.0])
    with pytest.raises(ValueError, match="not positive"):
        eos.theta(np.array([1.0, -1.0]))


def test_verlet_step_conserves_total_energy_to_second_order_without_noise_terms():
    """C, drag and the heat of drag at sigma -> 0 with gamma kept: sigma^2 = 2 k_B Theta gamma with a tiny Theta."""
    x, v, types, masses, theta = scene()
    box, scale = BOXES["triclinic"], 1e-14
    eos = oe.constant_cv(10.0 / scale)

    def drift(dt, steps):
        def at(x, v, theta):
            return oe.dpde_rates(x, v, theta, types, masses, A, SIGMA * np.sqrt(scale), KAPPA * scale, CUTOFF, box, K_B, dt)

        state = oe.VerletState(x, v, np.zeros(len(x)), eos.u(theta * scale), theta * scale, at(x, v, theta * scale))
        start = oe.total_energy(state.rates.terms.energy, masses, v, state.u_cond, state.u_mech)
        for _ in range(steps):
            state = oe.dpde_verlet_step(state.x, state.v, state.u_cond, state.u_mech, state.rates, masses, dt, eos, at)
        return abs(oe.total_energy(state.rates.terms.energy, masses, state.v, state.u_cond, state.u_mech) - start)

    # the heat uses v at the half step, so halving dt over the same time must at least halve the error
    coarse, fine = drift(0.002, 10), drift(0.001, 20)
    assert coarse < 0.05
    assert fine < 0.6 * coarse


# ------------------------------------------------------------------------------------------------- sweeps


def sweep_arguments(x, order, types, masses, box, dt=0.05, **changes):
    xi, xi_q = noises(len(x))
    return {
        "order": order,
        "types": types,
        "masses": masses,
        "sigma": SIGMA,
        "kappa": KAPPA,
        "cutoff": CUTOFF,
        "box": box,
        "k_B": K_B,
        "dt": dt,
        "xi_q": xi_q,
    } | changes, xi


def all_pairs(n, seed=2):
    """Every pair once, in random order and random direction."""
    rng = np.random.default_rng(seed)
    pairs = np.array(np.triu_indices(n, 1)).T
    rng.shuffle(pairs)
    return [tuple(int(k) for k in (p if rng.random() < 0.5 else p[::-1])) for p in pairs]


SCHEMES = pytest.mark.parametrize("scheme", ["shardlow", "exact", "exact frozen"])


def swept(scheme, x, v, u_cond, u_mech, theta, order, types, masses, box, cv, **changes):
    options, xi = sweep_arguments(x, order, types, masses, box, **changes)
    if scheme == "shardlow":
        return oe.shardlow_energy_sweep(x, v, u_cond, u_mech, theta, xi=xi, **options)
    return oe.exact_energy_sweep(x, v, u_cond, u_mech, zeta=xi, eos=oe.constant_cv(cv), frozen="frozen" in scheme, **options)


@SCHEMES
@BOX_CASES
def test_sweeps_conserve_energy_and_momentum_to_rounding(scheme, box):
    x, v, types, masses, theta = scene()
    cv = 40.0
    u_cond, u_mech = np.linspace(-1, 1, len(x)), cv * theta - np.linspace(-1, 1, len(x))
    out = swept(scheme, x, v, u_cond, u_mech, theta, all_pairs(len(x)), types, masses, box, cv)
    assert np.abs(out.v - v).max() > 0.1 and np.abs(out.u_cond - u_cond).max() > 0.01
    np.testing.assert_allclose(masses @ out.v, masses @ v, atol=1e-12)
    assert out.u_cond.sum() == pytest.approx(u_cond.sum(), abs=1e-12)
    assert out.u_mech.sum() + kinetic(masses, out.v) == pytest.approx(u_mech.sum() + kinetic(masses, v), rel=1e-14)


@SCHEMES
def test_sweeps_move_velocities_as_the_isothermal_oracle_at_uniform_temperature(scheme):
    x, v, types, masses, _ = scene()
    box, theta, cv, dt = BOXES["orthorhombic"], np.full(len(x), 1.4), 1e9, 0.05  # with this cv theta stays where it is
    order = all_pairs(len(x))
    out = swept(scheme, x, v, np.zeros(len(x)), cv * theta, theta, order, types, masses, box, cv, kappa=0.0, dt=dt)
    params = oracle.PairParams.build(2, gamma=SIGMA**2 / (2 * K_B * 1.4), cutoff=CUTOFF)
    xi, _ = noises(len(x))
    update = oracle.shardlow_update if scheme == "shardlow" else oracle.ou_update
    other = oracle.sweep(x, v, order, 1 / masses, types, params, box, K_B * 1.4, dt, lambda i, j, k: xi[i, j] if k == 0 else 0.0, update)
    np.testing.assert_allclose(out.v, other, rtol=1e-6, atol=1e-8)


def test_frozen_and_current_temperatures_differ_after_the_first_pair():
    x, v, types, masses, theta = scene()
    args = (x, v, np.zeros(len(x)), 2.0 * theta, theta, all_pairs(len(x)), types, masses, None, 2.0)
    frozen, current = swept("exact frozen", *args), swept("exact", *args)
    assert np.abs(frozen.v - current.v).max() > 1e-3


def test_shardlow_pair_worked_by_hand():
    """w = 1/2, m = 2 and 4 (mu = 3/4), gamma = 3/2, dt = 1/4: G = 3/64; S = 3/8 xi; e.v = 2."""
    x = np.array([[0.0, 0, 0], [0.5, 0, 0]])
    v = np.array([[-1.5, 1, -1], [0.5, 0, 2]])  # e = (-1, 0, 0)
    xi, xi_q = np.array([[0, 0.8], [0.8, 0]]), np.array([[0, -1.5], [1.5, 0]])
    for order in ([(0, 1)], [(1, 0)]):
        out = oe.shardlow_energy_sweep(
            x, v, np.zeros(2), np.zeros(2), [1.0, 3.0], order, [0, 0], [2.0, 4.0], 3.0, 0.25, 1.0, None, 2.0, 0.25, xi, xi_q
        )
        dp = 2 * (0.3 - 3 / 32) / (1 + 9 / 256)
        np.testing.assert_allclose(out.v, v + np.array([[-dp / 2, 0, 0], [dp / 4, 0, 0]]), rtol=1e-14)
        heat = 0.25 * (2 / 3) / 4 / 4 - 1.0 * 0.5 * 0.5 * 1.5
        np.testing.assert_allclose(out.u_cond, [heat, -heat], rtol=1e-13)
        lost = -0.5 * (dp * 2 * 2 + dp**2 * 0.75)
        np.testing.assert_allclose(out.u_mech, [lost / 2] * 2, rtol=1e-13)


def test_exact_pair_update_worked_by_hand_and_without_friction():
    """mu = 4/3, g dt/mu = ln 2: the relative velocity is halved, the noise is sqrt(3/4 kT/mu) zeta."""
    v_i, v_j = np.array([2.0, 1.0, 0.0]), np.array([0.0, 0.0, 1.0])
    e, dt = np.array([1.0, 0.0, 0.0]), 0.1
    g = np.log(2.0) * (4 / 3) / dt
    out = oe.exact_pair_update(v_i, v_j, 5.0, 7.0, e, 2.0, 4.0, g, 1.0, dt, 0.4)
    relative = 1.0 + 0.75 * 0.4
    np.testing.assert_allclose(out[0] - out[1], [relative, 1, -1], rtol=1e-14)
    lost = 0.5 * (4 / 3) * (4.0 - relative**2)
    assert out[2:] == pytest.approx((5 + lost / 2, 7 + lost / 2))
    same = oe.exact_pair_update(v_i, v_j, 5.0, 7.0, e, 2.0, 4.0, 0.0, 1.0, dt, 0.4)
    np.testing.assert_array_equal(same[0], v_i)
    assert same[2:] == (5.0, 7.0)


def test_internal_temperature_is_the_harmonic_mean():
    assert oe.internal_temperature([1.0, 3.0]) == pytest.approx(1.5)
