"""The oracle's pair updates, sweeps and steps: exact algebraic identities of their linear maps."""

from __future__ import annotations

import itertools
import sys
from pathlib import Path

import numpy as np
import pytest

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

import oracle
from oracle_cases import BOXES, bonded, fluid, table_noise, two_beads, two_types

BOX_CASES = pytest.mark.parametrize("box", BOXES.values(), ids=BOXES.keys())
UPDATES = pytest.mark.parametrize("update", [oracle.ou_update, oracle.shardlow_update])


# ---------------------------------------------------------------------------- the two pair velocity updates


def linear_map(update, e, inv_m, g, kT, dt):
    """The update of one pair as v' = M v + N z, read off basis vectors; v (6) of both beads, z (4)."""

    def apply(v, z):
        return np.concatenate(update(v[:3], v[3:], e, *inv_m, *g, kT, dt, z[0], z[1:]))

    M = np.array([apply(unit, np.zeros(4)) for unit in np.eye(6)]).T
    N = np.array([apply(np.zeros(6), unit) for unit in np.eye(4)]).T
    v, z = np.random.default_rng(0).normal(size=6), np.random.default_rng(1).normal(size=4)
    np.testing.assert_allclose(apply(v, z), M @ v + N @ z, atol=1e-13)  # it is linear
    return M, N


def rounding(update, inv_m, g, dt):
    """Rounding error to expect: the explicit half overshoots by m G before the implicit half undoes it."""
    overshoot = 0.0 if update is oracle.ou_update else 0.5 * sum(inv_m) * max(g) * dt
    return 1e-14 + 2 * np.finfo(float).eps * overshoot


E = np.array([2.0, -1.0, 2.0]) / 3.0
SETTINGS = list(
    itertools.product(
        [(1.0, 1.0), (1.0, 1 / 7.3), (0.4, 0.0), (0.0, 0.0)],
        [(4.5, 0.0), (40.5, 3.0), (0.0, 900.0), (1e-7, 1e-9)],
        [1e-4, 0.02, 0.5, 30.0],
    )
)


@UPDATES
@pytest.mark.parametrize(("inv_m", "g", "dt"), SETTINGS)
def test_pair_update_leaves_the_maxwell_distribution_unchanged(update, inv_m, g, dt):
    """C = diag(kT/m): M C M^T + N N^T = C; M C = C M^T (detailed balance); momentum to rounding."""
    kT = 1.37
    M, N = linear_map(update, E, inv_m, g, kT, dt)
    C, tolerance = np.diag(np.repeat(kT * np.array(inv_m), 3)), rounding(update, inv_m, g, dt)
    np.testing.assert_allclose(M @ C @ M.T + N @ N.T, C, rtol=0, atol=4 * tolerance)
    np.testing.assert_allclose(M @ C, C @ M.T, rtol=0, atol=4 * tolerance)
    if min(inv_m) > 0:
        momentum = np.kron(1 / np.array(inv_m), np.eye(3))
        np.testing.assert_allclose(momentum @ M, momentum, rtol=0, atol=tolerance / min(inv_m))
        np.testing.assert_allclose(momentum @ N, 0.0, atol=tolerance / min(inv_m))


@UPDATES
@pytest.mark.parametrize(("inv_m", "g", "dt"), [s for s in SETTINGS if sum(s[0]) > 0])
def test_radial_and_transverse_variances_separately(update, inv_m, g, dt):
    """Variance kT (1/m_i + 1/m_j) of e.v_ij, and of each transverse direction, in -> the same out."""
    kT, mu = 0.8, sum(inv_m)
    M, N = linear_map(update, E, inv_m, g, kT, dt)
    difference = np.hstack([np.eye(3), -np.eye(3)])
    lift = np.vstack([np.eye(3) * inv_m[0], -np.eye(3) * inv_m[1]]) / mu  # v_ij with no centre-of-mass motion
    m, noise, tolerance = difference @ M @ lift, difference @ N, 4 * rounding(update, inv_m, g, dt)
    perpendicular = np.linalg.svd(E[None, :])[2][1:]  # rows: two directions normal to e
    for direction, friction in ((E, g[0]), (perpendicular[0], g[1]), (perpendicular[1], g[1])):
        c = direction @ m @ direction
        np.testing.assert_allclose(direction @ m, c * direction, rtol=0, atol=tolerance)  # no mixing
        assert c**2 * kT * mu + np.sum((direction @ noise) ** 2) == pytest.approx(kT * mu, abs=tolerance)
        half = 0.5 * friction * dt * mu
        expected = np.exp(-2 * half) if update is oracle.ou_update else (1 - half) / (1 + half)
        assert c == pytest.approx(expected, abs=tolerance)


def test_exact_update_over_two_steps_is_one_step_of_twice_the_length():
    setting = dict(e=E, inv_m=(1.0, 0.3), g=(4.5, 2.0), kT=1.1)
    M1, N1 = linear_map(oracle.ou_update, dt=0.07, **setting)
    M2, N2 = linear_map(oracle.ou_update, dt=0.14, **setting)
    np.testing.assert_allclose(M1 @ M1, M2, atol=1e-14)
    np.testing.assert_allclose(M1 @ N1 @ N1.T @ M1.T + N1 @ N1.T, N2 @ N2.T, atol=1e-14)


@UPDATES
def test_pair_update_tends_to_the_pair_forces_for_small_dt(update):
    """(v' - v) m -> dt F_D + dt F_R: same friction and same noise amplitude as `dissipative` and `random`."""
    x, v, types, inv_m = fluid(n=2, seed=10, extent=0.6)
    params, kT, noise = two_types(), 1.2, table_noise(2)
    assert len(oracle.pair_list(x, types, params, None).i) == 1
    for dt, tolerance in ((1e-4, 1e-2), (1e-6, 1e-4)):
        new = oracle.sweep(x, v, [(0, 1)], inv_m, types, params, None, 0.0, dt, None, update)
        drag = oracle.dissipative(x, v, types, params).forces
        np.testing.assert_allclose((new - v) / inv_m[:, None] / dt, drag, rtol=tolerance, atol=1e-8)
        new = oracle.sweep(x, 0 * v, [(0, 1)], inv_m, types, params, None, kT, dt, noise, update)
        kick = oracle.random(x, types, params, None, kT, dt, noise).forces
        np.testing.assert_allclose(new / inv_m[:, None] / dt, kick, rtol=tolerance)


def test_shardlow_halves_equal_the_closed_form():
    v_i, v_j, z, kT, dt, g = np.array([1.0, 2, 3]), np.array([-2.0, 0.5, 1]), 0.9, 1.3, 0.11, 6.0
    inv_m = (1.0, 0.25)
    got_i, got_j = oracle.shardlow_update(v_i, v_j, E, *inv_m, g, 0.0, kT, dt, z)
    G, S = g * dt / 2, 0.5 * np.sqrt(2 * kT * g) * np.sqrt(dt) * z
    dp = 2 * (S - G * np.dot(E, v_i - v_j)) / (1 + sum(inv_m) * G)
    np.testing.assert_allclose(got_i, v_i + E * dp * inv_m[0], rtol=1e-14)
    np.testing.assert_allclose(got_j, v_j - E * dp * inv_m[1], rtol=1e-14)


@UPDATES
def test_missing_transverse_noise_is_an_error_only_where_it_is_needed(update):
    v_i, v_j = np.ones(3), np.zeros(3)
    with pytest.raises(ValueError, match="transverse noise"):
        update(v_i, v_j, E, 1.0, 1.0, 4.5, 1.0, 1.0, 0.1, 0.3)
    update(v_i, v_j, E, 1.0, 1.0, 4.5, 1.0, 0.0, 0.1, 0.3)
    update(v_i, v_j, E, 1.0, 1.0, 4.5, 0.0, 1.0, 0.1, 0.3)


# --------------------------------------------------------------------------------------------------- sweeps


@UPDATES
def test_sweep_applies_its_pairs_in_the_given_order(update):
    x, v, types, inv_m = fluid(n=3, seed=11, extent=0.6)
    params, noise, kT, dt = two_types(), table_noise(3), 1.0, 0.05

    def one(v, i, j):
        d = x[i] - x[j]
        r = np.linalg.norm(d)
        a, b = types[i], types[j]
        w = 1 - r / params.cutoff[a, b]
        g = params.gamma[a, b] * w ** (2 * params.s[a, b])
        g_perp = params.gamma_perp[a, b] * w ** (2 * params.s_perp[a, b])
        z = [noise(i, j, k) for k in range(4)]
        v = v.copy()
        v[i], v[j] = update(v[i], v[j], d / r, inv_m[i], inv_m[j], g, g_perp, kT, dt, z[0], z[1:])
        return v

    def swept(order):
        return oracle.sweep(x, v, order, inv_m, types, params, None, kT, dt, noise, update)

    by_hand = one(one(one(v, 0, 2), 0, 1), 1, 2)
    np.testing.assert_allclose(swept([(0, 2), (0, 1), (1, 2)]), by_hand, atol=1e-14)
    np.testing.assert_array_equal(swept([(2, 0), (1, 0), (2, 1)]), swept([(0, 2), (0, 1), (1, 2)]))
    assert np.abs(swept([(1, 2), (0, 1), (0, 2)]) - by_hand).max() > 1e-3  # the order matters


@UPDATES
@BOX_CASES
def test_sweep_conserves_momentum_and_passes_over_pairs_that_do_not_interact(update, box):
    x, v, types, inv_m = fluid(seed=12)
    params, noise, n = two_types(), table_noise(12), 12
    common = (inv_m, types, params, box, 1.0, 0.1, noise, update, bonded)
    everything = list(itertools.combinations(range(n), 2))
    new = oracle.sweep(x, v, everything, *common)
    np.testing.assert_allclose(new.T @ (1 / inv_m), v.T @ (1 / inv_m), atol=1e-12)
    pairs = oracle.pair_list(x, types, params, box)
    interacting = [(i, j) for i, j in zip(pairs.i, pairs.j, strict=True) if bonded(i, j) != 0.0]
    assert 0 < len(interacting) < len(pairs.i) < len(everything)
    np.testing.assert_array_equal(new, oracle.sweep(x, v, interacting, *common))
    assert np.abs(new - v).max() > 0.1


def test_factor_in_a_sweep_scales_the_friction():
    x, v, types, params, box = two_beads()
    noise, inv_m = table_noise(2), np.ones(2)
    halved = oracle.PairParams.build(A=25.0, gamma=2.25, gamma_perp=1.5, s=1.0, s_perp=0.5, cutoff=1.0)
    got = oracle.sweep(x, v, [(0, 1)], inv_m, types, params, box, 1.0, 0.1, noise, factor=lambda i, j: 0.5)
    want = oracle.sweep(x, v, [(0, 1)], inv_m, types, halved, box, 1.0, 0.1, noise)
    np.testing.assert_allclose(got, want, rtol=1e-14)


@UPDATES
def test_immovable_bead_keeps_its_velocity(update):
    x, v, types, params, box = two_beads()
    inv_m, noise = np.array([1.0, 0.0]), table_noise(2)
    new = oracle.sweep(x, v, [(0, 1)], inv_m, types, params, box, 1.0, 0.1, noise, update)
    np.testing.assert_array_equal(new[1], v[1])
    assert np.abs(new[0] - v[0]).max() > 0.1


# ---------------------------------------------------------------------------------------------------- steps


class Spy:
    """Records its arguments and returns fixed arrays in turn."""

    def __init__(self, *answers):
        self.seen, self.answers = [], list(answers)

    def __call__(self, *arguments):
        self.seen.append([np.array(a) for a in arguments])
        return self.answers.pop(0)


def step_inputs():
    rng = np.random.default_rng(13)
    x, v, f0, f1, swept = rng.normal(size=(5, 3, 3))
    inv_m = np.array([1.0, 0.5, 0.0])
    return x, v, f0, f1, swept, inv_m, inv_m[:, None], 0.1


@pytest.mark.parametrize("lam", [0.0, 0.5, 0.65, 1.0])
def test_mvv_evaluates_the_force_at_the_predicted_velocity(lam):
    x, v, f0, f1, _, inv_m, im, dt = step_inputs()
    force = Spy(f1)
    x1, v1, f = oracle.mvv_step(x, v, f0, inv_m, dt, lam, force)
    assert len(force.seen) == 1
    np.testing.assert_allclose(force.seen[0][0], x + dt * v + dt**2 / 2 * im * f0, rtol=1e-14)
    np.testing.assert_allclose(force.seen[0][1], v + lam * dt * im * f0, rtol=1e-14)
    np.testing.assert_allclose(x1, x + dt * v + dt**2 / 2 * im * f0, rtol=1e-14)
    np.testing.assert_allclose(v1, v + dt / 2 * im * (f0 + f1), rtol=1e-14)
    np.testing.assert_array_equal(f, f1)


def test_shardlow_step_sweeps_first():
    x, v, f0, f1, swept, inv_m, im, dt = step_inputs()
    force, sweep_at = Spy(f1), Spy(swept)
    x1, v1, f = oracle.shardlow_step(x, v, f0, inv_m, dt, force, sweep_at)
    np.testing.assert_array_equal(sweep_at.seen[0], [x, v])
    np.testing.assert_allclose(x1, x + dt * swept + dt**2 / 2 * im * f0, rtol=1e-14)
    np.testing.assert_allclose(force.seen[0][0], x1, rtol=1e-14)
    np.testing.assert_allclose(v1, swept + dt / 2 * im * (f0 + f1), rtol=1e-14)
    np.testing.assert_array_equal(f, f1)


def test_middle_step_order():
    x, v, f0, _, swept, inv_m, im, dt = step_inputs()
    force, sweep_at = Spy(f0), Spy(swept)
    x1, v1 = oracle.middle_step(x, v, inv_m, dt, force, sweep_at)
    np.testing.assert_array_equal(force.seen[0][0], x)
    np.testing.assert_allclose(sweep_at.seen[0][0], x + dt / 2 * (v + dt * im * f0), rtol=1e-14)
    np.testing.assert_allclose(sweep_at.seen[0][1], v + dt * im * f0, rtol=1e-14)
    np.testing.assert_allclose(x1, x + dt / 2 * (v + dt * im * f0) + dt / 2 * swept, rtol=1e-14)
    np.testing.assert_array_equal(v1, swept)


def test_aboba_step_order():
    x, v, f0, _, swept, inv_m, im, dt = step_inputs()
    force, sweep_at = Spy(f0), Spy(swept)
    x1, v1 = oracle.aboba_step(x, v, inv_m, dt, force, sweep_at)
    middle = x + dt / 2 * v
    np.testing.assert_allclose(force.seen[0][0], middle, rtol=1e-14)
    np.testing.assert_allclose(sweep_at.seen[0], [middle, v + dt / 2 * im * f0], rtol=1e-14)
    np.testing.assert_allclose(v1, swept + dt / 2 * im * f0, rtol=1e-14)
    np.testing.assert_allclose(x1, middle + dt / 2 * v1, rtol=1e-14)


def run_scheme(name, n_steps, t=0.2):
    """Four beads with drag and no noise, to time t."""
    x, v, types, inv_m = fluid(n=4, seed=14, extent=0.7)
    params, dt = two_types(), t / n_steps
    order = list(itertools.combinations(range(4), 2))

    def force_c(x):
        return oracle.conservative(x, types, params).forces

    def force(x, v):
        return force_c(x) + oracle.dissipative(x, v, types, params).forces

    def sweep_with(update):
        return lambda x, v: oracle.sweep(x, v, order, inv_m, types, params, None, 0.0, dt, None, update)

    f = force(x, v) if name.startswith("mvv") else force_c(x)
    half_kick = 0.5 * dt * inv_m[:, None] if name == "middle" else 0.0  # its velocities live at t - dt/2
    v = v - half_kick * force_c(x)
    for _ in range(n_steps):
        if name.startswith("mvv"):
            x, v, f = oracle.mvv_step(x, v, f, inv_m, dt, float(name[3:]), force)
        elif name == "shardlow":
            x, v, f = oracle.shardlow_step(x, v, f, inv_m, dt, force_c, sweep_with(oracle.shardlow_update))
        elif name == "middle":
            x, v = oracle.middle_step(x, v, inv_m, dt, force_c, sweep_with(oracle.ou_update))
        else:
            x, v = oracle.aboba_step(x, v, inv_m, dt, force_c, sweep_with(oracle.ou_update))
    return np.concatenate([x, v + half_kick * force_c(x)])


def exact_trajectory(t=0.2):
    """The same four beads by a Runge-Kutta integration of the equations of motion."""
    x, v, types, inv_m = fluid(n=4, seed=14, extent=0.7)
    params, n_steps = two_types(), 400
    dt = t / n_steps

    def rate(y):
        x, v = y[:4], y[4:]
        f = oracle.conservative(x, types, params).forces + oracle.dissipative(x, v, types, params).forces
        return np.concatenate([v, inv_m[:, None] * f])

    y = np.concatenate([x, v])
    for _ in range(n_steps):
        k1 = rate(y)
        k2 = rate(y + dt / 2 * k1)
        k3 = rate(y + dt / 2 * k2)
        k4 = rate(y + dt * k3)
        y = y + dt / 6 * (k1 + 2 * k2 + 2 * k3 + k4)
    return y


def test_every_scheme_converges_to_the_equations_of_motion():
    exact = exact_trajectory()
    for name in ("mvv0.5", "mvv0.65", "shardlow", "middle", "aboba"):
        errors = [np.abs(run_scheme(name, n) - exact).max() for n in (50, 100, 200)]
        assert errors[2] < 0.02, (name, errors)
        assert errors[1] < 0.6 * errors[0] and errors[2] < 0.6 * errors[1], (name, errors)  # first order
