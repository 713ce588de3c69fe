"""The oracles themselves: pairs worked by hand, exact algebra of the pair updates, and convergence of the steps."""

import itertools

import numpy as np
import oracle
import oracle_density
import oracle_energy
import oracle_meso
import pytest
from cases import cases
from scipy.integrate import solve_ivp


# ------------------------------------------------------------------------------------------------- small scenes
def two_types() -> oracle.PairParams:
    """Two types that differ in everything, transverse friction included."""
    A, gamma = np.array([[25.0, 31.0], [31.0, 18.0]]), np.array([[4.5, 2.0], [2.0, 9.0]])
    gamma_perp, cutoff = np.array([[1.5, 3.0], [3.0, 0.7]]), np.array([[1.0, 1.2], [1.2, 0.9]])
    s, s_perp = np.array([[1.0, 0.5], [0.5, 0.8]]), np.array([[0.6, 1.0], [1.0, 1.3]])
    return oracle.PairParams(A=A, gamma=gamma, gamma_perp=gamma_perp, s=s, s_perp=s_perp, cutoff=cutoff)


def two_beads():
    """r = 0.5 along x across a periodic face, i to the right of j; w = 1/2, v_ij = (2, 1, -3)."""
    x = np.array([[0.25, 1.0, 1.0], [2.75, 1.0, 1.0]])
    v = np.array([[1.5, 1.0, -1.0], [-0.5, 0.0, 2.0]])
    params = oracle.PairParams.build(A=25.0, gamma=4.5, gamma_perp=3.0, s=1.0, s_perp=0.5, cutoff=1.0)
    return x, v, np.zeros(2, int), params, np.array([3.0, 3.0, 3.0])


def four_beads():
    """Positions, velocities, types and inverse masses."""
    rng = np.random.default_rng(14)
    x, types = rng.uniform(0.0, 0.7, (4, 3)), np.arange(4) % 2
    return x, rng.normal(size=(4, 3)), types, np.where(types == 0, 1.0, 1 / 2.7)


# -------------------------------------------------------------------------------------------- pairs by hand
# r = 1/2 across a face, so w = 1/2; e = (1, 0, 0), e.v = 2
X2, V2, CUBE = np.array([[0.25, 1, 1], [2.75, 1, 1]]), np.array([[1.5, 1, -1], [-0.5, 0, 2]]), np.diag([3.0] * 3)
XI, XI_T = np.array([[0, 0.6], [0.6, 0]]), np.array([[0, -1.5], [1.5, 0]])


@cases(
    "box",
    np.array([[3.2, 0, 0], [1.5, 3.1, 0], [-1.4, 1.3, 3.4]]),
    np.array([[4.0, 0, 0], [2.0, 4.0, 0], [-2.0, 2.0, 4.0]]),  # as tilted as a reduced cell can be
    np.array([[3.0, 0, 0], [0.2, 5.0, 0], [1.4, -2.4, 7.0]]),
)
def test_triclinic_minimum_image_is_the_nearest_of_all_images(box):
    dr = np.random.default_rng(3).uniform(-1.5, 1.5, (500, 3)) @ box
    images = np.array(list(itertools.product(range(-5, 6), repeat=3))) @ box
    nearest = np.min(np.linalg.norm(dr[:, None, :] + images, axis=2), axis=1)
    found = oracle.minimum_image(dr, box)
    np.testing.assert_allclose(np.linalg.norm(found, axis=1), nearest, rtol=1e-13)
    shifts = (found - dr) @ np.linalg.inv(box)
    np.testing.assert_allclose(shifts, np.round(shifts), atol=1e-12)


def test_pair_list_cutoff_is_strict_and_coincident_beads_are_left_out():
    params = oracle.PairParams.build(cutoff=1.0)
    pairs = oracle.pair_list(np.array([[0.0, 0, 0], [1.0, 0, 0], [0.5, 0, 0], [0.5, 0.5e-10, 0]]), np.zeros(4, int), params, None)
    # not (0, 1) at exactly the cutoff, not (2, 3) at 5e-11
    assert list(zip(pairs.i, pairs.j, strict=True)) == [(0, 2), (0, 3), (1, 2), (1, 3)]
    np.testing.assert_allclose(pairs.e[0], [-1, 0, 0])  # from j to i


def test_two_beads():
    x, v, types, params, box = two_beads()
    c = oracle.conservative(x, types, params, box)
    assert c.energy == pytest.approx(3.125)  # 25/2 * 1 * 1/4
    np.testing.assert_allclose(c.forces, [[12.5, 0, 0], [-12.5, 0, 0]], atol=1e-14)  # pushed apart
    assert c.virial == pytest.approx(6.25)
    np.testing.assert_allclose(c.virial_tensor, np.diag([6.25, 0, 0]), atol=1e-14)
    assert c.laplacian == pytest.approx(-50.0)  # 2 (25 - 2 * 12.5/0.5)
    d = oracle.dissipative(x, v, types, params, box)
    # radial 4.5 * 1/4 * 2 = 2.25; transverse drag goes as w^(2 s_perp) = 1/2: 3 * 1/2 * (1, -3)
    np.testing.assert_allclose(d.forces, [[-2.25, -1.5, 4.5], [2.25, 1.5, -4.5]], atol=1e-14)
    assert d.virial == pytest.approx(-1.125)
    np.testing.assert_allclose(d.virial_tensor, [[-1.125, -0.75, 2.25], [0, 0, 0], [0, 0, 0]], atol=1e-14)
    z = (1.2, 9.0, -0.4, 0.7)  # the 9.0 is along e and must not show in the transverse force
    r = oracle.random(x, types, params, box, kT=2.0, dt=0.01, noise=lambda i, j, k: z[k])
    radial = np.sqrt(2 * 2.0 * 4.5) * 0.5 * 1.2 / 0.1
    transverse = np.sqrt(2 * 2.0 * 3.0) * np.sqrt(0.5) / 0.1
    np.testing.assert_allclose(r.forces[0], [radial, -0.4 * transverse, 0.7 * transverse], rtol=1e-14)
    np.testing.assert_array_equal(r.forces[1], -r.forces[0])
    assert r.virial == pytest.approx(0.5 * radial)


def test_rates_of_two_beads_worked_by_hand():
    """Theta 1 and 3: harmonic mean 3/2."""
    beads, coefficients = (X2, V2, [1.0, 3.0], [0, 0], [2.0, 4.0]), {"A": 20.0, "sigma": 3.0, "kappa": 0.25, "cutoff": 1.0}
    got = oracle_energy.dpde_rates(*beads, **coefficients, box=CUBE, k_B=2.0, dt=0.25, xi=XI, xi_q=XI_T)
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


def test_edpd_pair_worked_by_hand():
    """Tm = 2; sigma^2 = 4*4*3/4 = 12; wR^2 = 1/4; wT^2 = 1/16; K = 6*0.5*4 = 12, sqrt(2K) = sqrt(24)."""
    beads = (X2, V2, [1.0, 3.0], np.array([2.0, 3.0]), [0, 0], [2.0, 4.0])
    got = oracle_meso.edpd_pair(*beads, 10.0, 4.0, 2.0, 1.0, 0.5, 4.0, 1.0, CUBE, 0.25, XI, XI_T)
    np.testing.assert_allclose(got.terms.conservative[0], [10 * 2 * 0.5, 0, 0])
    np.testing.assert_allclose(got.terms.dissipative[0], [-4 / 4 * 2, 0, 0])
    np.testing.assert_allclose(got.terms.random[0], [np.sqrt(12) * 0.5 * 0.6 / 0.5, 0, 0])
    assert got.terms.energy == pytest.approx(0.5 * 10 * 2 * 0.25)
    np.testing.assert_allclose(got.q_conductive, 12 / 16 * (1 - 1 / 3) * np.array([1, -1]))
    np.testing.assert_allclose(got.q_viscous_deterministic, [0.5 * (4 / 4 * 4 - 0.5 * 12 / 4 * 0.75)] * 2)
    np.testing.assert_allclose(got.q_viscous_random, [-0.5 * np.sqrt(12) * 0.5 * 2 * 0.6 / 0.5] * 2)
    np.testing.assert_allclose(got.q_random, np.sqrt(24) * 0.25 * -1.5 / 0.5 * np.array([1, -1]))
    np.testing.assert_allclose(got.q, got.q_conductive + got.q_viscous + got.q_random)


def test_tdpd_pair_worked_by_hand():
    """w = 1/2; species 0: power_C 2, species 1: power_C 4, range 1; xi_1 = 8 is cut to 5."""
    C = np.array([[1.0, 2.0], [0.4, 5.0]])
    xi_C = np.stack([XI_T, 8 / 1.5 * XI_T])
    got = oracle_meso.tdpd_pair(X2, V2, C, [0, 0], 10.0, 4.0, 1.0, 1.0, 1.0, [2.0, 3.0], [0.1, 0.2], [2.0, 4.0], 0.5, CUBE, 0.25, XI, xi_C)
    np.testing.assert_allclose(got.terms.conservative, [[5, 0, 0], [-5, 0, 0]])
    np.testing.assert_allclose(got.terms.dissipative[0], [-4 * 0.5 * 2, 0, 0])
    np.testing.assert_allclose(got.terms.random[0], [2 * np.sqrt(0.5) * 0.6 / 0.5, 0, 0])
    assert got.terms.energy == pytest.approx(1.25)
    np.testing.assert_allclose(got.conductive[0], [-2 / 4 * 0.6, -3 / 16 * -3])
    np.testing.assert_allclose(got.random[0], [0.1 * 0.5 * 1.4 * -1.5 / 0.5, 0.2 * 0.25 * 7 * -5 / 0.5])
    np.testing.assert_allclose(got.Q[1], -got.Q[0])


@pytest.mark.parametrize("kernel", [oracle_density.LUCY, oracle_density.WARREN], ids=["Lucy", "Warren"])
def test_kernels_integrate_to_one_and_their_slope_is_their_derivative(kernel):
    h = 0.75
    r = (np.arange(100000) + 0.5) * h / 100000
    assert np.sum(4 * np.pi * r**2 * kernel.w(r, h)) * h / 100000 == pytest.approx(1.0, rel=1e-8)
    for at in (0.1, 0.4, 0.7):
        assert kernel.slope(at, h) == pytest.approx((kernel.w(at + 1e-6, h) - kernel.w(at - 1e-6, h)) / 2e-6, rel=1e-7)
    assert kernel.w(h, h) == kernel.slope(h, h) == 0.0


# ---------------------------------------------------------------------- pair updates, read off as linear maps
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
_FRICTIONS = [(4.5, 0.0), (40.5, 3.0), (0.0, 900.0), (1e-7, 1e-9)]
SETTINGS = list(itertools.product([(1.0, 1.0), (1.0, 1 / 7.3), (0.4, 0.0), (0.0, 0.0)], _FRICTIONS, [1e-4, 0.02, 0.5, 30.0]))


@pytest.mark.parametrize("update", [oracle.ou_update, oracle.shardlow_update])
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


def test_exact_update_over_two_steps_is_one_step_of_twice_the_length():
    setting = dict(e=E, inv_m=(1.0, 0.3), g=(4.5, 2.0), kT=1.1)
    M1, N1 = linear_map(oracle.ou_update, dt=0.07, **setting)
    M2, N2 = linear_map(oracle.ou_update, dt=0.14, **setting)
    np.testing.assert_allclose(M1 @ M1, M2, atol=1e-14)
    np.testing.assert_allclose(M1 @ N1 @ N1.T @ M1.T + N1 @ N1.T, N2 @ N2.T, atol=1e-14)


def test_shardlow_halves_equal_the_closed_form():
    v_i, v_j, z, kT, dt, g = np.array([1.0, 2, 3]), np.array([-2.0, 0.5, 1]), 0.9, 1.3, 0.11, 6.0
    inv_m = (1.0, 0.25)
    got_i, got_j = oracle.shardlow_update(v_i, v_j, E, *inv_m, g, 0.0, kT, dt, z)
    G, S = g * dt / 2, 0.5 * np.sqrt(2 * kT * g) * np.sqrt(dt) * z
    dp = 2 * (S - G * np.dot(E, v_i - v_j)) / (1 + sum(inv_m) * G)
    np.testing.assert_allclose(got_i, v_i + E * dp * inv_m[0], rtol=1e-14)
    np.testing.assert_allclose(got_j, v_j - E * dp * inv_m[1], rtol=1e-14)


# ---------------------------------------------------------------------------------------------------- steps
def run_scheme(name, n_steps, t=0.2):
    """Four beads with drag and no noise, to time t."""
    x, v, types, inv_m = four_beads()
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
            step = oracle.aboba_step if name == "aboba" else oracle.bababo_step
            x, v = step(x, v, inv_m, dt, force_c, sweep_with(oracle.ou_update))
    return np.concatenate([x, v + half_kick * force_c(x)])


def exact_end(t=0.2):
    """Where the equations of motion take the same four beads."""
    x, v, types, inv_m = four_beads()
    params = two_types()

    def rate(_, y):
        x, v = y.reshape(2, 4, 3)
        f = oracle.conservative(x, types, params).forces + oracle.dissipative(x, v, types, params).forces
        return np.concatenate([v, inv_m[:, None] * f]).ravel()

    return solve_ivp(rate, (0.0, t), np.concatenate([x, v]).ravel(), rtol=1e-8, atol=1e-8).y[:, -1].reshape(8, 3)


def test_every_scheme_converges_to_the_equations_of_motion():
    exact = exact_end()
    for name in ("mvv0.5", "mvv0.65", "shardlow", "middle", "aboba", "bababo"):
        errors = [np.abs(run_scheme(name, n) - exact).max() for n in (50, 100, 200)]
        assert errors[2] < 0.02, (name, errors)
        assert errors[1] < 0.6 * errors[0] and errors[2] < 0.6 * errors[1], (name, errors)  # first order
