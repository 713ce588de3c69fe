"""The oracle of beads that carry heat and species: hand-worked pairs, balances."""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np
import pytest

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

import oracle
import oracle_energy as oe
import oracle_meso as om
from oracle_cases import BOXES, fluid

BOX_CASES = pytest.mark.parametrize("box", BOXES.values(), ids=BOXES.keys())
EDPD = {
    "A": np.array([[25.0, 31.0], [31.0, 18.0]]),
    "gamma": np.array([[4.5, 2.0], [2.0, 9.0]]),
    "power": np.array([[2.0, 0.41], [0.41, 1.2]]),
    "cutoff": np.array([[1.0, 1.2], [1.2, 0.9]]),
    "kappa": np.array([[0.7, 0.2], [0.2, 1.3]]),
    "power_T": np.array([[2.0, 1.0], [1.0, 3.0]]),
    "cutoff_T": np.array([[1.2, 0.8], [0.8, 0.9]]),
}
MOMENTUM = {name: EDPD[name] for name in ("A", "gamma", "power", "cutoff")}
POLYNOMIAL = np.array([0.5, -0.3, 0.8, 0.2])


def noises(n, seed=5, species=1):
    """A symmetric and some antisymmetric matrices of N(0,1)."""
    upper = np.triu(np.random.default_rng(seed).normal(size=(1 + species, n, n)), 1)
    fluxes = upper[1:] - np.swapaxes(upper[1:], 1, 2)
    return upper[0] + upper[0].T, fluxes[0] if species == 1 else fluxes


def scene(n=14):
    x, v, types, inv_m = fluid(n)
    rng = np.random.default_rng(8)
    return x, v, types, 1.0 / inv_m, rng.uniform(0.6, 2.0, n), rng.uniform(2.0, 5.0, n)


def two_beads(r=0.5, **changes):
    """i to the right of j across a face; e.v = 2, m = 2 and 4, T = 1 and 3, Cv = 2 and 3, w = 1/2 at r = 0.5."""
    x = np.array([[0.25, 1, 1], [3.25 - r, 1, 1]])
    v = np.array([[1.5, 1, -1], [-0.5, 0, 2]])
    options = {"A": 10.0, "gamma": 4.0, "power": 2.0, "cutoff": 1.0, "kappa": 0.5, "power_T": 4.0, "cutoff_T": 1.0} | changes
    arrays = (np.array([1.0, 3.0]), np.array([2.0, 3.0]), np.array([0, 0]), np.array([2.0, 4.0]))
    return om.edpd_pair(x, v, *arrays, **options, box=np.diag([3.0] * 3), dt=0.25)


XI = np.array([[0, 0.6], [0.6, 0]])
XI_T = np.array([[0, -1.5], [1.5, 0]])

# --------------------------------------------------------------------------------------------------- eDPD


def test_edpd_pair_worked_by_hand():
    """Tm = 2; sigma^2 = 4*4*3/4 = 12; wR^2 = 1/4; wT^2 = 1/16; K = 6*0.5*4 = 12, sqrt(2K) = sqrt(24)."""
    got = two_beads(xi=XI, xi_T=XI_T)
    np.testing.assert_allclose(got.terms.conservative[0], [10 * 2 * 0.5, 0, 0])
    np.testing.assert_allclose(got.terms.dissipative[0], [-4 / 4 * 2, 0, 0])
    np.testing.assert_allclose(got.terms.random[0], [np.sqrt(12) * 0.5 * 0.6 / 0.5, 0, 0])
    assert got.terms.energy == pytest.approx(0.5 * 10 * 2 * 0.25)
    np.testing.assert_allclose(got.q_conductive, 12 / 16 * (1 - 1 / 3) * np.array([1, -1]))
    np.testing.assert_allclose(got.q_viscous_deterministic, [0.5 * (4 / 4 * 4 - 0.5 * 12 / 4 * 0.75)] * 2)
    np.testing.assert_allclose(got.q_viscous_random, [-0.5 * np.sqrt(12) * 0.5 * 2 * 0.6 / 0.5] * 2)
    np.testing.assert_allclose(got.q_random, np.sqrt(24) * 0.25 * -1.5 / 0.5 * np.array([1, -1]))
    np.testing.assert_allclose(got.q, got.q_conductive + got.q_viscous + got.q_random)


def test_edpd_pair_as_lammps_worked_by_hand():
    """The same forces and conduction; heat noise is the momentum noise; viscous heat over Cv_i + Cv_j = 5, no 1/sqrt(dt), m_i = 2."""
    got, own = two_beads(xi=XI, compat="lammps"), two_beads(xi=XI, xi_T=XI_T)
    np.testing.assert_array_equal(got.terms.forces, own.terms.forces)
    np.testing.assert_array_equal(got.q_conductive, own.q_conductive)
    np.testing.assert_allclose(got.q_viscous_deterministic, [(4 / 4 * 4 - 12 / 4 / 2) / 5] * 2)
    np.testing.assert_allclose(got.q_viscous_random, [-np.sqrt(12) * 0.5 * 2 * 0.6 / 5] * 2)
    np.testing.assert_allclose(got.q_random, np.sqrt(24) * 0.25 * 0.6 / 0.5 * np.array([1, -1]))
    with pytest.raises(ValueError, match="own"):
        two_beads(xi=XI, xi_T=XI_T, compat="lammps")
    with pytest.raises(ValueError, match="compat"):
        two_beads(compat="other")


def test_edpd_polynomials_and_smallest_power():
    """y = Tm - 1 = 1: both polynomials are 1 + 0.5 - 0.3 + 0.8 + 0.2 = 2.2; a negative power becomes 0.01."""
    plain, got = two_beads(xi=XI, xi_T=XI_T), two_beads(xi=XI, xi_T=XI_T, power_coeffs=POLYNOMIAL, kappa_coeffs=POLYNOMIAL)
    np.testing.assert_allclose(got.terms.dissipative[0], [-4 * 0.5**4.4 * 2, 0, 0])
    np.testing.assert_allclose(got.terms.random[0], [np.sqrt(12) * 0.5**2.2 * 0.6 / 0.5, 0, 0])
    np.testing.assert_allclose(got.q_conductive, 2.2 * plain.q_conductive)
    np.testing.assert_allclose(got.q_random, np.sqrt(2.2) * plain.q_random)
    np.testing.assert_array_equal(got.terms.conservative, plain.terms.conservative)
    floor = two_beads(xi=XI, xi_T=XI_T, power_coeffs=-4 * POLYNOMIAL)
    np.testing.assert_allclose(floor.terms.dissipative[0], [-4 * 0.5**0.01 * 2, 0, 0])
    assert om.temperature_polynomial(POLYNOMIAL, 3.0) == pytest.approx(1 + 1 - 1.2 + 6.4 + 3.2)


def test_edpd_heat_noise_is_cut_at_five_and_momentum_noise_is_not():
    large = 7.0
    got = two_beads(xi=large / 0.6 * XI, xi_T=large / 1.5 * XI_T)
    five = two_beads(xi=XI, xi_T=5.0 / 1.5 * XI_T)
    np.testing.assert_array_equal(got.q_random, five.q_random)
    np.testing.assert_allclose(got.terms.random[0], [np.sqrt(12) * 0.5 * large / 0.5, 0, 0])


def test_edpd_cutoffs_of_forces_and_heat_are_independent_unless_lammps():
    """r = 0.5. Heat range 0.4: no conduction, viscous heat stays. Force range 0.4, heat range 1: conduction alone."""
    options = {"xi": XI, "xi_T": XI_T}
    both = two_beads(**options)
    short = two_beads(cutoff_T=0.4, **options)
    np.testing.assert_array_equal(short.q_viscous, both.q_viscous)
    assert np.all(short.q_conductive == 0) and np.all(short.q_random == 0)
    long = two_beads(cutoff=0.4, **options)
    assert np.all(long.terms.forces == 0) and np.all(long.q_viscous == 0)
    np.testing.assert_array_equal(long.q_conductive, both.q_conductive)
    np.testing.assert_array_equal(long.q_random, both.q_random)
    assert np.all(two_beads(cutoff_T=0.4, xi=XI, compat="lammps").q == 0)
    assert np.all(two_beads(cutoff=0.4, xi=XI, compat="lammps").q == 0)


@BOX_CASES
def test_edpd_conserves_momentum_and_energy(box):
    x, v, types, masses, T, cv = scene()
    xi, xi_T = noises(len(x))
    got = om.edpd_pair(
        x, v, T, cv, types, masses, **EDPD, box=box, dt=0.01, xi=xi, xi_T=xi_T, power_coeffs=POLYNOMIAL, kappa_coeffs=POLYNOMIAL
    )
    for part in (got.terms.conservative, got.terms.dissipative, got.terms.random):
        assert np.abs(part).max() > 0.1
        np.testing.assert_allclose(part.sum(axis=0), 0.0, atol=1e-10)
    for part in (got.q_conductive, got.q_random):
        assert np.abs(part).max() > 0.01
        assert part.sum() == pytest.approx(0.0, abs=1e-9)
    assert got.q_viscous_random.sum() == pytest.approx(-np.sum(v * got.terms.random), abs=1e-8)
    quiet = om.edpd_pair(x, 0 * v, T, cv, types, masses, **EDPD, box=box, dt=0.01, power_coeffs=POLYNOMIAL)
    assert quiet.q_viscous.sum() < -1.0  # what random kicks give to beads at rest
    assert got.q_viscous_deterministic.sum() == pytest.approx(-np.sum(v * got.terms.dissipative) + quiet.q_viscous.sum(), rel=1e-12)


def test_edpd_kinetic_energy_and_heat_balance_over_a_step_up_to_dt_squared_unless_lammps():
    """Averaged over xi = +-1 the kick D + R and the viscous heat cancel to first order in dt."""
    x, v = np.array([[0.0, 0, 0], [0.4, 0.3, 0]]), np.array([[0.3, -1.0, 0.4], [1.0, 0.5, 0.2]])
    T, cv, masses = np.array([0.7, 1.9]), np.array([2.0, 3.0]), np.array([1.0, 3.0])

    def imbalance(dt, compat):
        total = 0.0
        for sign in (1.0, -1.0):
            got = om.edpd_pair(
                x, v, T, cv, [0, 0], masses, 0.0, 4.5, 2.0, 1.0, 0.0, 2.0, 1.0, None, dt, sign * (1 - np.eye(2)), compat=compat
            )
            new = v + dt * got.terms.forces / masses[:, None]
            total += 0.25 * np.sum(masses[:, None] * (new**2 - v**2)) + 0.5 * dt * got.q.sum()
        return total

    assert imbalance(1e-3, "consistent") / imbalance(1e-4, "consistent") == pytest.approx(100.0, rel=1e-6)
    assert imbalance(1e-3, "lammps") / imbalance(1e-4, "lammps") == pytest.approx(10.0, rel=0.1)


@BOX_CASES
def test_edpd_and_dpde_agree_where_their_formulas_do(box):
    """k_B = 1, power 2, A = 0: the same drag, noise and viscous heat with sigma^2 = 2 gamma Theta; one pair at a time."""
    x, v, types, masses, T, cv = scene()
    xi, _ = noises(len(x))
    checked = 0
    for i, j, *_ in list(oe.ordered_pairs(x, types, EDPD["cutoff"], box))[::2]:
        k = [i, j]
        gamma = 4.5
        sigma = np.sqrt(2 * gamma * oe.harmonic_mean(T[i], T[j]))
        sub = xi[np.ix_(k, k)]
        mine = om.edpd_pair(x[k], v[k], T[k], cv[k], types[k], masses[k], 0.0, gamma, 2.0, EDPD["cutoff"], 0.0, 2.0, 1.0, box, 0.01, sub)
        other = oe.dpde_rates(x[k], v[k], T[k], types[k], masses[k], 0.0, sigma, 0.0, EDPD["cutoff"], box, 1.0, 0.01, sub)
        np.testing.assert_allclose(mine.terms.forces, other.terms.forces, rtol=1e-11, atol=1e-12)
        np.testing.assert_allclose(mine.q_viscous, other.du_mech, rtol=1e-11, atol=1e-12)
        np.testing.assert_allclose(mine.terms.virial_tensor, other.terms.virial_tensor, rtol=1e-11, atol=1e-12)
        checked += 1
    assert checked > 5


# --------------------------------------------------------------------------------------------------- tDPD


def test_tdpd_pair_worked_by_hand():
    """w = 1/2; species 0: power_C 2, species 1: power_C 4, range 1; xi_1 = 8 is cut to 5."""
    x = np.array([[0.25, 1, 1], [2.75, 1, 1]])
    v = np.array([[1.5, 1, -1], [-0.5, 0, 2]])
    C = np.array([[1.0, 2.0], [0.4, 5.0]])
    xi_C = np.stack([XI_T, 8 / 1.5 * XI_T])
    got = om.tdpd_pair(
        x, v, C, [0, 0], 10.0, 4.0, 1.0, 1.0, 1.0, [2.0, 3.0], [0.1, 0.2], [2.0, 4.0], 0.5, np.diag([3.0] * 3), 0.25, XI, xi_C
    )
    np.testing.assert_allclose(got.terms.conservative, [[5, 0, 0], [-5, 0, 0]])
    np.testing.assert_allclose(got.terms.dissipative[0], [-4 * 0.5 * 2, 0, 0])
    np.testing.assert_allclose(got.terms.random[0], [2 * np.sqrt(0.5) * 0.6 / 0.5, 0, 0])
    assert got.terms.energy == pytest.approx(1.25)
    np.testing.assert_allclose(got.conductive[0], [-2 / 4 * 0.6, -3 / 16 * -3])
    np.testing.assert_allclose(got.random[0], [0.1 * 0.5 * 1.4 * -1.5 / 0.5, 0.2 * 0.25 * 7 * -5 / 0.5])
    np.testing.assert_allclose(got.Q[1], -got.Q[0])


@BOX_CASES
@pytest.mark.parametrize("n_species", [1, 3])
def test_tdpd_conserves_every_species_and_momentum(box, n_species):
    x, v, types, _, _, _ = scene()
    C = np.random.default_rng(4).uniform(size=(len(x), n_species))
    xi, xi_C = noises(len(x), species=n_species)
    xi_C = xi_C[None] if n_species == 1 else xi_C
    kappa = [EDPD["kappa"] * (k + 1) for k in range(n_species)]
    got = om.tdpd_pair(
        x, v, C, types, **MOMENTUM, cutoff_C=1.1, kappa=kappa, epsilon=0.3, power_C=2.0, kT=1.3, box=box, dt=0.01, xi=xi, xi_C=xi_C
    )
    assert got.Q.shape == (len(x), n_species) and np.all(np.abs(got.conductive).max(axis=0) > 0.1)
    np.testing.assert_allclose(got.conductive.sum(axis=0), 0.0, atol=1e-12)
    np.testing.assert_allclose(got.random.sum(axis=0), 0.0, atol=1e-11)
    np.testing.assert_allclose(got.terms.forces.sum(axis=0), 0.0, atol=1e-10)
    params = oracle.PairParams.build(2, A=EDPD["A"], gamma=EDPD["gamma"], s=EDPD["power"] / 2, cutoff=EDPD["cutoff"])
    C_ = oracle.conservative(x, types, params, box)
    D = oracle.dissipative(x, v, types, params, box)
    R = oracle.random(x, types, params, box, 1.3, 0.01, lambda i, j, k: xi[i, j])
    np.testing.assert_allclose(got.terms.forces, C_.forces + D.forces + R.forces, rtol=1e-11, atol=1e-10)
    np.testing.assert_allclose(got.terms.virial_tensor, C_.virial_tensor + D.virial_tensor + R.virial_tensor, rtol=1e-10, atol=1e-10)


def test_tdpd_flux_beyond_the_force_cutoff():
    x, v, C = np.array([[0.0, 0, 0], [1.1, 0, 0]]), np.zeros((2, 3)), np.array([[1.0], [0.0]])
    args = (x, v, C, [0, 0], 10.0, 4.0, 1.0, 1.0, 2.2, 2.0, 0.0, 2.0, 1.0, None, 0.01)
    np.testing.assert_allclose(om.tdpd_pair(*args).Q, [[-0.5], [0.5]])
    assert np.all(om.tdpd_pair(*args, compat="lammps").Q == 0.0)


# ------------------------------------------------------------------------------------------ sources, steps


def test_sources_know_who_is_inside():
    x = np.array([[1.0, 1, 1], [2.0, 1, 1], [3.0, 1, 1], [1.0, 2.9, 1]])
    np.testing.assert_array_equal(om.in_sphere(x, [1, 1, 1], 1.95), [True, True, False, True])
    np.testing.assert_array_equal(om.in_sphere(x, [1, 1, 1], 2.0), [True, True, False, True])
    np.testing.assert_array_equal(om.in_sphere_region(x, [1, 1, 1], 2.0), [True, True, True, True])
    np.testing.assert_array_equal(om.in_cuboid(x, [2, 1, 1], [2, 1, 1]), [True, True, True, False])
    np.testing.assert_array_equal(om.in_block_region(x, [1, 1, 1], [2, np.inf, 1]), [True, True, False, True])
    np.testing.assert_array_equal(om.edpd_source([True, False], 0.1, [2.0, 3.0]), [0.2, 0.0])
    np.testing.assert_array_equal(om.tdpd_source([True, False], 1, 0.1, 3), [[0, 0.1, 0], [0, 0, 0]])


@pytest.mark.parametrize("lam", [0.5, 0.65])
def test_mvv_edpd_step_worked_by_hand(lam):
    x, v, T = np.zeros((1, 3)), np.array([[1.0, 0, 0]]), np.array([2.0])
    seen = []

    def at(x, v, T):
        seen.append((x.copy(), v.copy(), T.copy()))
        return np.array([[6.0, 0, 0]]), np.array([20.0])

    out = om.mvv_edpd_step(x, v, T, np.array([[4.0, 0, 0]]), np.array([10.0]), [2.0], [5.0], 0.1, lam, at)
    np.testing.assert_allclose(seen[0][0][0, 0], 0.11)
    np.testing.assert_allclose(seen[0][1][0, 0], 1 + lam * 0.2)
    np.testing.assert_allclose(seen[0][2], [2 + lam * 0.2])
    np.testing.assert_allclose([out.v[0, 0], out.T[0]], [1.1 + 0.15, 2.1 + 0.2])


def test_mvv_tdpd_step_worked_by_hand():
    seen = []

    def at(x, v, C):
        seen.append((v.copy(), C.copy()))
        return np.array([[6.0, 0, 0]]), np.array([[20.0, -2.0]])

    out = om.mvv_tdpd_step(
        np.zeros((1, 3)),
        np.array([[1.0, 0, 0]]),
        np.array([[2.0, 3.0]]),
        np.array([[4.0, 0, 0]]),
        np.array([[10.0, 4.0]]),
        [2.0],
        0.1,
        0.65,
        at,
    )
    np.testing.assert_allclose(seen[0][0][0, 0], 1.13)
    np.testing.assert_allclose(seen[0][1], [[2.5, 3.2]])
    np.testing.assert_allclose(out.C, [[3.5, 3.1]])
    np.testing.assert_allclose(out.v[0, 0], 1.25)


def test_mean_diffusivity_is_the_second_moment_of_the_flux():
    """D = (rho kappa/6) * integral of 4 pi r^4 wk^2, by quadrature; power 2: 2 pi rho kappa rc^5/315."""
    rho, kappa, rc = 4.0, 1.3, 1.58
    r = (np.arange(200000) + 0.5) * rc / 200000
    for n in (2.0, 1.0, 0.5):
        integral = np.sum(4 * np.pi * r**4 * (1 - r / rc) ** n) * rc / 200000
        assert om.mean_diffusivity(rho, kappa, rc, n) == pytest.approx(rho * kappa / 6 * integral, rel=1e-7)
    assert om.mean_diffusivity(rho, kappa, rc, 2.0) == pytest.approx(2 * np.pi * rho * kappa * rc**5 / 315)
