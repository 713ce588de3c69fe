"""The oracle of density-dependent beads: hand-worked pairs, kernels, gradients, live LAMMPS."""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np
import pytest

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

import lammps_steps
import oracle
import oracle_density as od
import oracle_energy as oe
from oracle_cases import BOXES, fluid

BOX_CASES = pytest.mark.parametrize("box", BOXES.values(), ids=BOXES.keys())
KERNELS = pytest.mark.parametrize("kernel", [od.LUCY, od.WARREN], ids=["Lucy", "Warren"])
MDPD = {
    "A": np.array([[-40.0, -30.0], [-30.0, -35.0]]),
    "B": np.array([[25.0, 15.0], [15.0, 20.0]]),
    "gamma": np.array([[4.5, 2.0], [2.0, 9.0]]),
    "cut_A": np.array([[1.0, 1.2], [1.2, 0.9]]),
    "cut_B": np.array([[0.75, 0.8], [0.8, 0.9]]),
}


def symmetric(n, seed=5):
    upper = np.triu(np.random.default_rng(seed).normal(size=(n, n)), 1)
    return upper + upper.T


def gradient(energy, x, h=1e-5):
    """Central differences of energy(x)."""
    result = np.zeros_like(x)
    for k in np.ndindex(*x.shape):
        step = np.zeros_like(x)
        step[k] = h
        result[k] = (energy(x + step) - energy(x - step)) / (2 * h)
    return result


def strain_derivative(energy, x, box, h=1e-5):
    """``-dU/d strain`` [a, b] for x -> x (1 + strain), box rows alike; a box row must stay lower triangular: a >= b."""
    result = np.zeros((3, 3))
    for a, b in ((0, 0), (1, 1), (2, 2), (1, 0), (2, 0), (2, 1)):
        strain = np.zeros((3, 3))
        strain[a, b] = h
        up, down = np.eye(3) + strain, np.eye(3) - strain
        result[a, b] = -(energy(x @ up, None if box is None else box @ up) - energy(x @ down, None if box is None else box @ down)) / (
            2 * h
        )
    return result


def scene(n=14):
    x, v, types, inv_m = fluid(n)
    return x, v, types, 1.0 / inv_m


def rows(box):
    return None if box is None else (np.diag(box) if box.ndim == 1 else box)


# ------------------------------------------------------------------------------------------------ kernels


@KERNELS
def test_kernels_integrate_to_one_and_their_slope_is_their_derivative(kernel):
    h = 0.75
    r = (np.arange(100000) + 0.5) * h / 100000
    assert np.sum(4 * np.pi * r**2 * kernel.w(r, h)) * h / 100000 == pytest.approx(1.0, rel=1e-8)
    for at in (0.1, 0.4, 0.7):
        assert kernel.slope(at, h) == pytest.approx((kernel.w(at + 1e-6, h) - kernel.w(at - 1e-6, h)) / 2e-6, rel=1e-7)
    assert kernel.w(h, h) == kernel.slope(h, h) == 0.0


def test_densities_of_two_beads_by_hand():
    """r = h/2 across a face: Lucy 105/(16 pi h^3) 5/16, Warren 15/(2 pi h^3)/4; no self term; isolated beads have none."""
    x = np.array([[0.25, 1, 1], [2.75, 1, 1], [1.5, 2.5, 1.0]])
    box = np.diag([3.0] * 3)
    lucy = 105 / (16 * np.pi) * 5 / 16
    np.testing.assert_allclose(od.lucy_density(x, [0, 0, 0], [2.0, 4.0, 8.0], 1.0, box), [4 * lucy, 2 * lucy, 0.0])
    np.testing.assert_allclose(od.warren_density(x, [0, 0, 0], 1.0, box), [15 / (8 * np.pi)] * 2 + [0.0])
    weighted = od.local_density(x, [0, 1, 1], 1.0, box, od.WARREN, weight=[[1.0, 0.5], [3.0, 1.0]])
    np.testing.assert_allclose(weighted, 15 / (8 * np.pi) * np.array([0.5, 3.0, 0.0]))


# ------------------------------------------------------------------------------------------------- forces


def test_mdpd_pair_worked_by_hand():
    """r = 0.5, cut_A 1, cut_B 0.8: wA = 1/2, wB = 3/8; rho 2 + 3; e = (1, 0, 0), e.v = 2; sigma^2 = 2*0.5*4."""
    x = np.array([[0.25, 1, 1], [2.75, 1, 1]])
    v = np.array([[1.5, 1, -1], [-0.5, 0, 2]])
    xi = np.array([[0, 0.6], [0.6, 0]])
    got = od.mdpd_pair(x, v, [2.0, 3.0], [0, 0], -40.0, 25.0, 4.0, 1.0, 0.8, 0.5, np.diag([3.0] * 3), 0.25, xi)
    np.testing.assert_allclose(got.conservative[:, 0], (-20 + 25 * 5 * 3 / 8) * np.array([1, -1]))
    np.testing.assert_allclose(got.dissipative[:, 0], [-2, 2])
    np.testing.assert_allclose(got.random[:, 0], 2 * 0.5 * 0.6 / 0.5 * np.array([1, -1]))
    assert got.energy == pytest.approx(-20 / 4 + 0.5 * 25 * 0.8 * 5 * 9 / 64)
    assert got.virial == pytest.approx(0.5 * got.forces[0, 0])
    with pytest.raises(ValueError, match="cut_A"):
        od.mdpd_pair(x, v, [2.0, 3.0], [0, 0], -40.0, 25.0, 4.0, 0.7, 0.8, 0.5, None, 0.25, xi)


@BOX_CASES
def test_mdpd_conserves_momentum_and_has_the_drag_and_noise_of_plain_dpd(box):
    x, v, types, masses = scene()
    xi = symmetric(len(x))
    rho = od.lucy_density(x, types, masses, MDPD["cut_B"], box)
    got = od.mdpd_pair(x, v, rho, types, **MDPD, kT=1.3, box=box, dt=0.01, xi=xi)
    np.testing.assert_allclose(got.forces.sum(axis=0), 0.0, atol=1e-10)
    params = oracle.PairParams.build(2, A=MDPD["A"], gamma=MDPD["gamma"], cutoff=MDPD["cut_A"])
    D = oracle.dissipative(x, v, types, params, box)
    R = oracle.random(x, types, params, box, 1.3, 0.01, lambda i, j, k: xi[i, j])
    np.testing.assert_allclose(got.dissipative, D.forces, rtol=1e-11, atol=1e-12)
    np.testing.assert_allclose(got.random, R.forces, rtol=1e-11, atol=1e-11)
    np.testing.assert_allclose(got.virial_dissipative + got.virial_random, D.virial_tensor + R.virial_tensor, rtol=1e-10, atol=1e-11)
    plain = od.mdpd_pair(x, v, 0 * rho, types, **MDPD, kT=1.3, box=box, dt=0.01)
    np.testing.assert_allclose(plain.conservative, oracle.conservative(x, types, params, box).forces, rtol=1e-11, atol=1e-11)


@BOX_CASES
def test_warren_force_is_the_gradient_of_its_energy_and_mdpd_with_warrens_density(box):
    x, v, types, _ = scene()
    rd, box = 0.9, rows(box)
    got = od.warren_many_body(x, types, 25.0, rd, box)
    np.testing.assert_allclose(
        got.forces, -gradient(lambda y: od.warren_many_body(y, types, 25.0, rd, box).energy, x), rtol=1e-6, atol=1e-5
    )
    expected = strain_derivative(lambda y, b: od.warren_many_body(y, types, 25.0, rd, b).energy, x, box)
    np.testing.assert_allclose(np.tril(got.virial_tensor), expected, rtol=1e-6, atol=1e-5)
    rho = od.warren_density(x, types, rd, box)
    pair = od.mdpd_pair(x, v, rho, types, 0.0, 25.0, 0.0, 1.2, rd, 0.0, box, 0.01)
    np.testing.assert_allclose(got.forces, pair.conservative, rtol=1e-12, atol=1e-12)
    np.testing.assert_allclose(got.virial_tensor, pair.virial_conservative, rtol=1e-11, atol=1e-11)
    assert got.energy == pytest.approx(0.5 * pair.energy, rel=1e-12)  # the pair energy of mDPD counts it twice
    np.testing.assert_allclose(got.energies, np.pi * rd**4 / 30 * 25.0 * rho**2)


@BOX_CASES
def test_warren_force_with_one_b_per_type_is_the_gradient_of_its_energy(box):
    x, v, types, _ = scene()
    b, rd, box = [25.0, 11.0], 0.9, rows(box)
    got = od.warren_pair(x, v, types, MDPD["A"], b, 0.0, MDPD["cut_A"], rd, 0.0, box, 0.01)

    def energy(y, cell=box):
        return od.warren_pair(y, v, types, MDPD["A"], b, 0.0, MDPD["cut_A"], rd, 0.0, cell, 0.01).energy

    np.testing.assert_allclose(got.conservative, -gradient(energy, x), rtol=1e-6, atol=1e-5)
    np.testing.assert_allclose(np.tril(got.virial_conservative), strain_derivative(energy, x, box), rtol=1e-6, atol=1e-5)


def test_warren_pair_force_with_one_b_per_type_by_hand():
    """Three beads, each seeing the next: F_01 = (b_0 rho_0 + b_1 rho_1)(1 - r/rd)."""
    x, b, rd = np.array([[0.0, 0, 0], [0.3, 0, 0], [0.9, 0, 0]]), [25.0, 11.0], 0.7
    scale = 15 / (2 * np.pi * rd**3)
    first, second = scale * (1 - 0.3 / rd) ** 2, scale * (1 - 0.6 / rd) ** 2
    got = od.warren_many_body(x, [0, 1, 1], b, rd, None)
    near = (25.0 * first + 11.0 * (first + second)) * (1 - 0.3 / rd)
    far = 11.0 * (first + 2 * second) * (1 - 0.6 / rd)
    np.testing.assert_allclose(got.forces[:, 0], [-near, near - far, far], rtol=1e-12)
    np.testing.assert_allclose(got.energies, np.pi * rd**4 / 30 * np.array([25 * first**2, 11 * (first + second) ** 2, 11 * second**2]))


@KERNELS
@BOX_CASES
def test_any_many_body_force_is_the_gradient_of_its_energy(kernel, box):
    """Masses, weights that are not symmetric, ranges per pair of types, a cubic psi that differs per type."""
    x, _, types, masses = scene()
    box = rows(box)
    ranges, weight = np.array([[0.9, 1.1], [1.1, 1.2]]), np.array([[1.0, 0.4], [1.7, 0.8]])

    def at(y, cell=box):
        return od.many_body(
            y, types, lambda t, d: (1 + t) * d**3 - d, lambda t, d: 3 * (1 + t) * d**2 - 1, ranges, cell, kernel, masses, weight
        )

    got = at(x)
    np.testing.assert_allclose(got.forces, -gradient(lambda y: at(y).energy, x), rtol=1e-5, atol=1e-5 * np.abs(got.forces).max())
    np.testing.assert_allclose(got.forces.sum(axis=0), 0.0, atol=1e-11 * np.abs(got.forces).max())
    expected = strain_derivative(lambda y, b: at(y, b).energy, x, box)
    np.testing.assert_allclose(np.tril(got.virial_tensor), expected, rtol=1e-5, atol=1e-6 * np.abs(expected).max())


@pytest.mark.parametrize("model", ["Warren", "Lucy", "Warren, B per pair of types"])
def test_which_mdpd_force_has_a_potential(model):
    """A force with a potential has a symmetric Jacobian; three beads within each other's range tell."""
    x, types = np.array([[0.0, 0, 0], [0.4, 0, 0], [0.1, 0.5, 0.2]]), [0, 0, 1] if "types" in model else [0, 0, 0]
    B = np.array([[25.0, 10.0], [10.0, 25.0]]) if "types" in model else 25.0
    kernel = od.LUCY if model == "Lucy" else od.WARREN

    def force(y):
        rho = od.local_density(y, types, 0.9, None, kernel)
        return od.mdpd_pair(y, 0 * y, rho, types, 0.0, B, 0.0, 0.9, 0.9, 0.0, None, 0.01).conservative.ravel()

    h = 1e-5
    steps = np.eye(9).reshape(9, 3, 3) * h
    jacobian = np.array([(force(x + step) - force(x - step)) / (2 * h) for step in steps])
    asymmetry = np.abs(jacobian - jacobian.T).max() / np.abs(jacobian).max()
    assert asymmetry < 1e-8 if model == "Warren" else asymmetry > 1e-2


def test_warren_pressure_of_a_crystal_with_long_range_approaches_the_mean_field():
    """Uniform density: P = (pi B rd^4/15) rho^3 from psi; a fcc crystal with a range of two spacings is near to it."""
    rho, rd, B = 40.0, 1.0, 2.0
    a = (4.0 / rho) ** (1 / 3)
    basis = np.array([[0, 0, 0], [0, 0.5, 0.5], [0.5, 0, 0.5], [0.5, 0.5, 0]])
    corners = np.array([(i, j, k) for i in range(5) for j in range(5) for k in range(5)])
    x = a * (corners[:, None, :] + basis).reshape(-1, 3)
    box = np.full(3, 5 * a)
    got = od.warren_many_body(x, np.zeros(len(x), int), B, rd, box)
    # without the self term the density of a crystal is short of rho by about one bead's own share, w(0)
    short = rho - od.WARREN.w(0.0, rd)
    assert od.warren_density(x, np.zeros(len(x), int), rd, box)[0] == pytest.approx(short, rel=0.01)
    assert np.trace(got.virial_tensor) / (3 * np.prod(box)) == pytest.approx(np.pi * B * rd**4 / 15 * rho**2 * short, rel=0.03)


# --------------------------------------------------------------------------------------------- live LAMMPS


@pytest.fixture(scope="module")
def live_lammps():
    reason = lammps_steps.why_missing([("pair", "mdpd"), ("pair", "mdpd/rhosum")])
    if reason:
        pytest.skip(reason)


TYPE_MASSES = np.array([1.0, 2.7])
RANGES = np.array([[0.75, 0.8], [0.8, 0.6]])


def mdpd_commands(kT, seed, dt, lam):
    pairs = ((0, 0), (0, 1), (1, 1))
    return [
        f"pair_style hybrid/overlay mdpd/rhosum mdpd {kT} 1.2 {seed}",
        *(f"pair_coeff {a + 1} {b + 1} mdpd/rhosum {RANGES[a, b]}" for a, b in pairs),
        *(
            f"pair_coeff {a + 1} {b + 1} mdpd {' '.join(str(MDPD[k][a, b]) for k in ('A', 'B', 'gamma', 'cut_A', 'cut_B'))}"
            for a, b in pairs
        ),
        f"fix 1 all mvv/dpd {lam}",
        f"timestep {dt}",
        "neigh_modify every 1 delay 0 check no",
    ]


def test_many_beads_without_noise_equal_lammps_for_three_steps(live_lammps):
    n, dt, lam, steps = 60, 0.01, 0.65, 3
    rng = np.random.default_rng(12)
    x, v, types = rng.uniform(4.0, 6.5, (n, 3)), rng.normal(size=(n, 3)), np.arange(n) % 2
    masses, box = TYPE_MASSES[types], lammps_steps.peer_box()
    peer = lammps_steps.run("mdpd", x, v, types, TYPE_MASSES, mdpd_commands(0.0, 99, dt, lam), steps, {"rho": "atom:rho"})

    def at(x, v):
        at.rho = od.lucy_density(x, types, masses, RANGES, box)
        at.terms = od.mdpd_pair(x, v, at.rho, types, **MDPD, kT=0.0, box=box, dt=dt)
        return at.terms.forces

    f = at(x, v)
    for _ in range(steps):
        x, v, f = oracle.mvv_step(x, v, f, 1 / masses, dt, lam, at)
    np.testing.assert_allclose(peer.values["rho"], at.rho, rtol=1e-9)
    np.testing.assert_allclose(peer.v, v, atol=1e-9)
    np.testing.assert_allclose(peer.f, f, atol=1e-8)
    assert peer.pe == pytest.approx(at.terms.energy, rel=1e-10)
    assert peer.press == pytest.approx(oe.pressure(masses, v, at.terms, box), rel=1e-9)


@pytest.mark.parametrize("types", [(0, 0), (0, 1), (1, 1)])
def test_two_beads_with_their_noise_equal_lammps_for_three_steps(live_lammps, types):
    seed, dt, lam, steps, kT = 4711, 0.01, 0.5, 3, 1.4
    x, v = np.array([[5.0, 5, 5], [5.3, 5.2, 4.8]]), np.array([[0.4, -0.3, 1.0], [-0.6, 0.2, 0.3]])
    masses, box = TYPE_MASSES[list(types)], lammps_steps.peer_box()
    peer = lammps_steps.run("mdpd", x, v, types, TYPE_MASSES, mdpd_commands(kT, seed, dt, lam), steps)
    noise = iter(lammps_steps.lammps_normals(seed, steps + 1))

    def at(x, v):
        rho = od.lucy_density(x, types, masses, RANGES, box)
        return od.mdpd_pair(x, v, rho, types, **MDPD, kT=kT, box=box, dt=dt, xi=lammps_steps.two_bead_noise(next(noise), True)).forces

    f = at(x, v)
    for _ in range(steps):
        x, v, f = oracle.mvv_step(x, v, f, 1 / masses, dt, lam, at)
    np.testing.assert_allclose(peer.v, v, rtol=1e-10)
    np.testing.assert_allclose(peer.f, f, rtol=1e-9)
