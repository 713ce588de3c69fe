"""The oracle of beads with an internal energy against a live LAMMPS, noise included."""

import lammps_peer
import lammps_steps
import numpy as np
import oracle_energy as oe
import pytest

A = np.array([[25.0, 31.0], [31.0, 18.0]])
SIGMA = np.array([[3.0, 2.0], [2.0, 4.0]])
KAPPA = np.array([[0.7, 0.2], [0.2, 1.3]])
CUTOFF = np.array([[1.0, 1.2], [1.2, 0.9]])


@pytest.fixture(scope="module")
def live_lammps():
    lammps_peer.need(("pair", "dpd/fdt/energy"), ("fix", "shardlow"), ("fix", "eos/cv"), ("fix", "dpd/energy"))


TYPE_MASSES = np.array([1.0, 2.7])
DPD_COLUMNS = {"dpd": "dpd/atom"}


def dpd_commands(theta, seed, scale, fixes, dt, pairs=((0, 0), (0, 1), (1, 1))):
    """``scale`` multiplies sigma^2 and kappa: with temperatures as small, drag and conduction stay and noise goes."""
    beads = [f"set atom {k} dpd/theta {float(t)!r}" for k, t in enumerate(theta, start=1)]
    words = [f"{A[p]} {SIGMA[p] * np.sqrt(scale)} {KAPPA[p] * scale} {CUTOFF[p]}" for p in pairs]
    terms = [f"pair_coeff {a + 1} {b + 1} {values}" for (a, b), values in zip(pairs, words, strict=True)]
    return [*beads, f"pair_style dpd/fdt/energy 1.2 {seed}", *terms, *fixes, f"timestep {dt!r}", "neigh_modify every 1 delay 0 check no"]


@pytest.mark.parametrize("types", [(0, 0), (0, 1), (1, 0)])
def test_two_beads_with_their_noise_equal_lammps_for_three_steps(live_lammps, types):
    seed, dt, cv, steps = 4711, 0.01, 2.5, 3
    x, v = np.array([[5.0, 5, 5], [5.3, 5.2, 4.8]]), np.array([[0.4, -0.3, 1.0], [-0.6, 0.2, 0.3]])
    theta, masses = np.array([0.8, 1.7]), TYPE_MASSES[list(types)]
    fixes = ["fix 1 all nve", f"fix 2 all eos/cv {cv}", "fix 3 all dpd/energy"]
    peer = lammps_steps.run("dpd", x, v, types, TYPE_MASSES, dpd_commands(theta, seed, 1.0, fixes, dt), steps, DPD_COLUMNS)

    noise = iter(lammps_steps.pair_noise(seed, steps + 1, 2))

    def at(x, v, theta):
        xi, xi_q = next(noise)
        return oe.dpde_rates(
            x, v, theta, types, masses, A, SIGMA, KAPPA, CUTOFF, lammps_steps.peer_box(), 1.0, dt,
            lammps_steps.two_bead_noise(xi, True), lammps_steps.two_bead_noise(xi_q, False),
        )  # fmt: skip

    eos = oe.constant_cv(cv)
    state = oe.VerletState(x, v, np.zeros(2), eos.u(theta), theta, at(x, v, theta))
    for _ in range(steps):
        state = oe.dpde_verlet_step(state.x, state.v, state.u_cond, state.u_mech, state.rates, masses, dt, eos, at)
    u_cond, u_mech, _, theta_peer = peer.values["dpd"].T
    np.testing.assert_allclose(peer.x, state.x, rtol=1e-13)
    np.testing.assert_allclose(peer.v, state.v, rtol=1e-11)
    np.testing.assert_allclose(peer.f, state.rates.terms.forces, rtol=1e-10)
    np.testing.assert_allclose(u_mech, state.u_mech, rtol=1e-12)
    np.testing.assert_allclose(u_cond, state.u_cond, rtol=1e-11)
    np.testing.assert_allclose(theta_peer, state.theta, rtol=1e-12)
    assert peer.pe == pytest.approx(state.rates.terms.energy, rel=1e-12)
    assert peer.press == pytest.approx(oe.pressure(masses, state.v, state.rates.terms, lammps_steps.peer_box()), rel=1e-11)


def test_many_beads_without_noise_equal_lammps_for_three_steps(live_lammps):
    """Temperatures and coefficients scaled by 1e-16 leave noise 1e-7 as large as the rest."""
    scale, dt, steps, cv = 1e-16, 0.01, 3, 2.5e16
    rng = np.random.default_rng(12)
    x, v = rng.uniform(4.0, 6.5, (40, 3)), rng.normal(size=(40, 3))
    types, theta = np.arange(40) % 2, scale * rng.uniform(0.7, 1.8, 40)
    masses = TYPE_MASSES[types]
    fixes = ["fix 1 all nve", f"fix 2 all eos/cv {cv}", "fix 3 all dpd/energy"]
    peer = lammps_steps.run("dpd", x, v, types, TYPE_MASSES, dpd_commands(theta, 99, scale, fixes, dt), steps, DPD_COLUMNS)

    def at(x, v, theta):
        return oe.dpde_rates(x, v, theta, types, masses, A, SIGMA * np.sqrt(scale), KAPPA * scale, CUTOFF, lammps_steps.peer_box(), 1.0, dt)

    eos = oe.constant_cv(cv)
    state = oe.VerletState(x, v, np.zeros(40), eos.u(theta), theta, at(x, v, theta))
    for _ in range(steps):
        state = oe.dpde_verlet_step(state.x, state.v, state.u_cond, state.u_mech, state.rates, masses, dt, eos, at)
    u_cond, u_mech, _, theta_peer = peer.values["dpd"].T
    np.testing.assert_allclose(peer.v, state.v, atol=3e-7)
    np.testing.assert_allclose(peer.f, state.rates.terms.forces, atol=3e-5)
    assert np.abs(state.u_cond).max() > 1e-3
    np.testing.assert_allclose(u_cond, state.u_cond, atol=1e-7)
    np.testing.assert_allclose(u_mech - cv * theta, state.u_mech - cv * theta, atol=1e-6)
    np.testing.assert_allclose(theta_peer, state.theta, rtol=1e-6)


def test_shardlow_sweep_without_noise_equals_lammps(live_lammps):
    """Separate pairs, so that the order does not matter; one step; noise scaled away as above."""
    scale, dt, cv, n = 1e-16, 0.05, 2.5e16, 16
    rng = np.random.default_rng(3)
    x = np.repeat(2.0 + 3.0 * np.array(np.unravel_index(np.arange(n // 2), (2, 2, 2))).T, 2, axis=0)
    x[1::2] += rng.uniform(0.15, 0.45, (n // 2, 3))
    v, types, theta = rng.normal(size=(n, 3)), rng.integers(0, 2, n), scale * rng.uniform(0.7, 1.8, n)
    masses, box = TYPE_MASSES[types], lammps_steps.peer_box()
    fixes = ["fix 0 all shardlow", "fix 1 all nve", f"fix 2 all eos/cv {cv}"]
    peer = lammps_steps.run("dpd", x, v, types, TYPE_MASSES, dpd_commands(theta, 99, scale, fixes, dt), 1, DPD_COLUMNS)

    order = [(k, k + 1) for k in range(0, n, 2)]
    pairs = (SIGMA * np.sqrt(scale), KAPPA * scale, CUTOFF)
    out = oe.shardlow_energy_sweep(x, v, np.zeros(n), cv * theta, theta, order, types, masses, *pairs, box, 1.0, dt, None, None)

    def force(x):
        return oe.dpde_rates(x, v, theta, types, masses, A, 0.0, 0.0, CUTOFF, box, 1.0, dt).terms.forces

    half = out.v + 0.5 * dt * force(x) / masses[:, None]
    new = half + 0.5 * dt * force(x + dt * half) / masses[:, None]
    np.testing.assert_allclose(peer.x, x + dt * half, atol=1e-8)
    np.testing.assert_allclose(peer.v, new, atol=3e-7)
    u_cond, u_mech, _, theta_peer = peer.values["dpd"].T
    assert np.abs(out.u_cond).max() > 1e-4 and np.abs(out.u_mech - cv * theta).max() > 0.01
    np.testing.assert_allclose(u_cond, out.u_cond, atol=3e-8)
    np.testing.assert_allclose(u_mech - cv * theta, out.u_mech - cv * theta, atol=3e-7)
    np.testing.assert_allclose(theta_peer, (out.u_cond + out.u_mech) / cv, rtol=1e-7)


@pytest.mark.parametrize("types", [(0, 0), (0, 1)])
def test_shardlow_pair_with_noise_equals_lammps(live_lammps, types):
    """LAMMPS's own noise is read off the velocities; the energies and the other component of momentum then follow."""
    dt, cv = 0.05, 2.5
    x, v = np.array([[5.0, 5, 5], [5.3, 5.2, 4.8]]), np.array([[0.4, -0.3, 1.0], [-0.6, 0.2, 0.3]])
    theta, masses, box = np.array([0.8, 1.7]), TYPE_MASSES[list(types)], lammps_steps.peer_box()
    commands = dpd_commands(theta, 4711, 1.0, ["fix 0 all shardlow", "fix 1 all nve", f"fix 2 all eos/cv {cv}"], dt)
    peer = lammps_steps.run("dpd", x, v, types, TYPE_MASSES, commands, 1, DPD_COLUMNS)

    def force(x):
        return oe.dpde_rates(x, v, theta, types, masses, A, 0.0, 0.0, CUTOFF, box, 1.0, dt).terms.forces

    def sweep(xi, xi_q):
        return oe.shardlow_energy_sweep(
            x, v, np.zeros(2), cv * theta, theta, [(0, 1)], types, masses, SIGMA, KAPPA, CUTOFF, box, 1.0, dt,
            lammps_steps.two_bead_noise(xi, True), lammps_steps.two_bead_noise(xi_q, False),
        )  # fmt: skip

    after = peer.v - 0.5 * dt * (force(x) + force(peer.x)) / masses[:, None]
    u_cond, u_mech, _, _ = peer.values["dpd"].T
    none, unit = sweep(0.0, 0.0), sweep(1.0, 1.0)
    direction = unit.v[0] - none.v[0]
    xi = np.dot(after[0] - none.v[0], direction) / np.dot(direction, direction)
    xi_q = (u_cond[0] - none.u_cond[0]) / (unit.u_cond[0] - none.u_cond[0])
    assert 0.01 < abs(xi) < 4.5 and 0.01 < abs(xi_q) < 4.5  # N(0,1) numbers, neither absent nor of another scale
    out = sweep(xi, xi_q)
    np.testing.assert_allclose(after, out.v, rtol=1e-9)
    np.testing.assert_allclose(u_mech, out.u_mech, rtol=1e-10)
    np.testing.assert_allclose(u_cond, out.u_cond, rtol=1e-10)


def test_noise_of_lammps_is_normal():
    numbers = np.array(lammps_steps.lammps_normals(2718, 20000))
    error = 1 / np.sqrt(len(numbers))
    assert abs(numbers.mean()) < 4 * error
    assert abs(np.mean(numbers**2) - 1) < 4 * np.sqrt(2) * error
    assert abs(np.mean(numbers[1:] * numbers[:-1])) < 4 * error
