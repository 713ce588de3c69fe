"""The oracle's geometry, pair forces and measurements: closed forms, finite differences, live LAMMPS."""

from __future__ import annotations

import itertools
import sys
from pathlib import Path

import numpy as np
import pytest

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

import lammps_peer
import oracle
from oracle_cases import BOXES, TILTED, bonded, fluid, table_noise, two_beads, two_types

BOX_CASES = pytest.mark.parametrize("box", BOXES.values(), ids=BOXES.keys())


# ------------------------------------------------------------------------------------------------- geometry


@pytest.mark.parametrize(
    "box",
    [
        TILTED,
        np.array([[4.0, 0, 0], [2.0, 4.0, 0], [-2.0, 2.0, 4.0]]),  # as tilted as a reduced cell can be
        np.array([[3.0, 0, 0], [0.2, 5.0, 0], [1.4, -2.4, 7.0]]),
    ],
)
def test_triclinic_minimum_image_is_the_nearest_of_all_images(box):
    rng = np.random.default_rng(3)
    dr = rng.uniform(-1.5, 1.5, (500, 3)) @ box
    images = np.array(list(itertools.product(range(-5, 6), repeat=3))) @ box
    nearest = np.min(np.linalg.norm(dr[:, None, :] + images, axis=2), axis=1)
    found = oracle.minimum_image(dr, box)
    np.testing.assert_allclose(np.linalg.norm(found, axis=1), nearest, rtol=1e-13)
    shifts = (found - dr) @ np.linalg.inv(box)
    np.testing.assert_allclose(shifts, np.round(shifts), atol=1e-12)


def test_minimum_image_without_tilt_agrees_with_edges():
    edges = np.array([2.0, 3.0, 4.0])
    dr = np.random.default_rng(4).uniform(-9, 9, (200, 3))
    found = oracle.minimum_image(dr, edges)
    assert np.all(np.abs(found) <= edges / 2)
    np.testing.assert_allclose(found, oracle.minimum_image(dr, np.diag(edges)), atol=1e-13)
    np.testing.assert_array_equal(oracle.minimum_image(dr, None), dr)
    np.testing.assert_allclose(oracle.minimum_image([1.9, 0.0, -3.9], edges), [-0.1, 0.0, 0.1], atol=1e-15)


def test_minimum_image_refuses_an_upper_triangular_cell():
    with pytest.raises(ValueError, match="lower-triangular"):
        oracle.minimum_image(np.zeros(3), TILTED.T)


def test_pair_list_cutoff_is_strict_and_coincident_beads_are_left_out():
    params = oracle.PairParams.build(cutoff=1.0)
    x = np.array([[0.0, 0, 0], [1.0, 0, 0], [0.5, 0, 0], [0.5, 0.5e-10, 0]])
    pairs = oracle.pair_list(x, np.zeros(4, int), params, None)
    # not (0, 1) at exactly the cutoff, not (2, 3) at 5e-11
    assert list(zip(pairs.i, pairs.j, strict=True)) == [(0, 2), (0, 3), (1, 2), (1, 3)]
    np.testing.assert_allclose(pairs.e[0], [-1, 0, 0])  # from j to i


def test_pair_list_refuses_a_box_under_two_cutoffs():
    with pytest.raises(ValueError, match="half of the box"):
        oracle.pair_list(np.zeros((2, 3)), [0, 0], oracle.PairParams.build(cutoff=1.0), np.array([3, 3, 1.9]))


def test_asymmetric_coefficients_are_refused():
    with pytest.raises(ValueError, match="gamma must be a symmetric"):
        oracle.PairParams.build(2, gamma=np.array([[1.0, 2.0], [3.0, 1.0]]))


# --------------------------------------------------------------------------------------- two beads, by hand


def test_two_beads_conservative():
    x, _, types, params, box = two_beads()
    c = oracle.conservative(x, types, params, box)
    assert c.energy == pytest.approx(3.125)  # 25/2 * 1 * 1/4
    np.testing.assert_allclose(c.forces, [[12.5, 0, 0], [-12.5, 0, 0]], atol=1e-14)  # pushed apart
    assert c.virial == pytest.approx(6.25)
    np.testing.assert_allclose(c.virial_tensor, np.diag([6.25, 0, 0]), atol=1e-14)
    assert c.laplacian == pytest.approx(-50.0)  # 2 (25 - 2 * 12.5/0.5)


def test_two_beads_dissipative():
    x, v, types, params, box = two_beads()
    d = oracle.dissipative(x, v, types, params, box)
    # radial 4.5 * 1/4 * 2 = 2.25; transverse drag goes as w^(2 s_perp) = 1/2: 3 * 1/2 * (1, -3)
    np.testing.assert_allclose(d.forces, [[-2.25, -1.5, 4.5], [2.25, 1.5, -4.5]], atol=1e-14)
    assert d.virial == pytest.approx(-1.125)
    np.testing.assert_allclose(d.virial_tensor, [[-1.125, -0.75, 2.25], [0, 0, 0], [0, 0, 0]], atol=1e-14)


def test_two_beads_random():
    x, _, types, params, box = two_beads()
    z = (1.2, 9.0, -0.4, 0.7)  # the 9.0 is along e and must not show in the transverse force
    r = oracle.random(x, types, params, box, kT=2.0, dt=0.01, noise=lambda i, j, k: z[k])
    radial = np.sqrt(2 * 2.0 * 4.5) * 0.5 * 1.2 / 0.1
    transverse = np.sqrt(2 * 2.0 * 3.0) * np.sqrt(0.5) / 0.1
    np.testing.assert_allclose(r.forces[0], [radial, -0.4 * transverse, 0.7 * transverse], rtol=1e-14)
    np.testing.assert_array_equal(r.forces[1], -r.forces[0])
    assert r.virial == pytest.approx(0.5 * radial)


def test_exponent_zero_means_full_strength_up_to_the_cutoff():
    x, v, types, _, box = two_beads()
    params = oracle.PairParams.build(gamma=4.5, s=0.0, cutoff=0.6)
    forces = oracle.dissipative(x, v, types, params, box).forces
    np.testing.assert_allclose(forces[0], [-9.0, 0, 0], atol=1e-14)


def test_special_factor_scales_c_and_d_linearly_and_r_by_its_root():
    x, v, types, params, box = two_beads()
    noise = table_noise(2)

    def evaluate(factor):
        c = oracle.conservative(x, types, params, box, factor)
        d = oracle.dissipative(x, v, types, params, box, factor)
        return c, d, oracle.random(x, types, params, box, 1.0, 0.02, noise, factor)

    c0, d0, r0 = evaluate(None)
    for f in (0.0, 0.25, 1.0):
        c, d, r = evaluate(lambda i, j, f=f: f)
        scalars, scalars0 = ([y.energy, y.virial, y.laplacian] for y in (c, c0))
        np.testing.assert_allclose(scalars, f * np.array(scalars0))
        np.testing.assert_allclose(c.forces, f * c0.forces)
        np.testing.assert_allclose(d.forces, f * d0.forces)
        np.testing.assert_allclose(r.forces, np.sqrt(f) * r0.forces)


# ----------------------------------------------------------------------------- many beads: exact identities


@BOX_CASES
def test_forces_are_minus_the_gradient_of_the_energy(box):
    x, _, types, _ = fluid()
    params, h = two_types(), 1e-5
    forces = oracle.conservative(x, types, params, box, bonded).forces
    assert np.linalg.norm(forces) > 20.0
    numerical = np.zeros_like(x)
    for index in np.ndindex(x.shape):
        d = np.zeros_like(x)
        d[index] = h
        up = oracle.conservative(x + d, types, params, box, bonded).energy
        down = oracle.conservative(x - d, types, params, box, bonded).energy
        numerical[index] = -(up - down) / (2 * h)
    np.testing.assert_allclose(forces, numerical, atol=2e-8)  # rounding of U / h is about 1e-9


@BOX_CASES
def test_laplacian_is_minus_the_divergence_of_the_forces(box):
    x, _, types, _ = fluid(seed=2)
    params, h = two_types(), 1e-5
    result, divergence = oracle.conservative(x, types, params, box, bonded), 0.0
    for index in np.ndindex(x.shape):
        d = np.zeros_like(x)
        d[index] = h
        up = oracle.conservative(x + d, types, params, box, bonded).forces[index]
        down = oracle.conservative(x - d, types, params, box, bonded).forces[index]
        divergence += (up - down) / (2 * h)
    assert abs(divergence) > 10.0
    assert result.laplacian == pytest.approx(-divergence, rel=1e-7)


@pytest.mark.parametrize("name", ["none", "triclinic"])
def test_virial_tensor_is_minus_the_strain_derivative_of_the_energy(name):
    x, _, types, _ = fluid(seed=3)
    box, params, h = BOXES[name], two_types(), 1e-6
    result = oracle.conservative(x, types, params, box)
    for a, b in itertools.product(range(3), repeat=2):
        if name == "triclinic" and b > a:
            continue  # this strain would leave the lower-triangular form
        energies = []
        for sign in (1, -1):
            strain = np.eye(3)
            strain[a, b] += sign * h  # row vectors: x' = x strain, dU/d(strain_ab) = -sum r_a F_b
            new_box = None if box is None else box @ strain
            energies.append(oracle.conservative(x @ strain, types, params, new_box).energy)
        slope = (energies[0] - energies[1]) / (2 * h)
        assert result.virial_tensor[a, b] == pytest.approx(-slope, abs=1e-7)
    np.testing.assert_allclose(result.virial_tensor, result.virial_tensor.T, atol=1e-13)
    assert result.virial == pytest.approx(np.trace(result.virial_tensor))


@BOX_CASES
def test_third_law_and_virials_as_sums_over_beads(box):
    x, v, types, _ = fluid(seed=4)
    params, noise = two_types(), table_noise(len(x))
    results = [
        oracle.conservative(x, types, params, box, bonded),
        oracle.dissipative(x, v, types, params, box, bonded),
        oracle.random(x, types, params, box, 1.3, 0.02, noise, bonded),
    ]
    for result in results:
        assert np.abs(result.forces).max() > 1.0
        np.testing.assert_allclose(result.forces.sum(axis=0), 0.0, atol=1e-12)
        if box is None:  # without images the virial is also sum_i x_i F_i
            np.testing.assert_allclose(result.virial_tensor, x.T @ result.forces, atol=1e-11)
            assert result.virial == pytest.approx(np.sum(x * result.forces), abs=1e-11)


def test_forces_do_not_depend_on_the_image_in_which_a_bead_is_stored():
    x, v, types, _ = fluid(seed=5)
    params, noise = two_types(), table_noise(len(x))
    moved = x + np.random.default_rng(6).integers(-3, 4, x.shape) @ TILTED
    for evaluate in (
        lambda y: oracle.conservative(y, types, params, TILTED),
        lambda y: oracle.dissipative(y, v, types, params, TILTED),
        lambda y: oracle.random(y, types, params, TILTED, 1.0, 0.01, noise),
    ):
        np.testing.assert_allclose(evaluate(moved).forces, evaluate(x).forces, atol=1e-10)
        assert evaluate(moved).virial == pytest.approx(evaluate(x).virial, abs=1e-10)


def test_transverse_noise_and_drag_are_perpendicular_to_the_pair_and_radial_ones_are_along_it():
    x, v, types, _ = fluid(n=2, seed=8, extent=0.5)
    noise, box = table_noise(2), None
    e = (x[0] - x[1]) / np.linalg.norm(x[0] - x[1])
    transverse = oracle.PairParams.build(2, gamma_perp=4.0, s_perp=0.7, cutoff=1.5)
    radial = oracle.PairParams.build(2, gamma=4.0, s=0.7, cutoff=1.5)
    for params, along in ((transverse, False), (radial, True)):
        for force in (
            oracle.random(x, types, params, box, 1.0, 0.01, noise).forces[0],
            oracle.dissipative(x, v, types, params, box).forces[0],
        ):
            size = np.linalg.norm(force)
            assert size > 0.1
            assert abs(np.dot(e, force)) == pytest.approx(size if along else 0.0, abs=1e-13 * size)


def test_fluctuation_dissipation_matrix_identity():
    """B B^T dt = 2 kT Gamma with drag = -Gamma v, noise force = B z, both read off the functions."""
    x, _, types, _ = fluid(n=5, seed=9, extent=1.0)
    params, kT, dt, n = two_types(), 1.7, 0.013, 5
    gamma = np.zeros((3 * n, 3 * n))
    for column in range(3 * n):
        unit = np.zeros(3 * n)
        unit[column] = 1.0
        drag = oracle.dissipative(x, unit.reshape(n, 3), types, params, None, bonded).forces
        gamma[:, column] = -drag.ravel()
    columns = []
    for i, j in itertools.combinations(range(n), 2):
        for k in range(4):
            only = (i, j, k)
            noise = lambda a, b, c, only=only: float((a, b, c) == only)  # noqa: E731
            columns.append(oracle.random(x, types, params, None, kT, dt, noise, bonded).forces.ravel())
    B = np.array(columns).T
    assert np.abs(gamma).max() > 0.5
    np.testing.assert_allclose(B @ B.T * dt, 2 * kT * gamma, atol=1e-12)


# --------------------------------------------------------------------------------------------- measurements


def test_measurements_of_known_states():
    m, v, box = np.array([1.0, 3.0]), np.array([[1.0, 2, 2], [0, 1, 0]]), np.array([2.0, 2.5, 4.0])
    assert oracle.kinetic_temperature(m, v, 6) == pytest.approx(2.0)
    assert oracle.pressure(m, v, virial=18.0, box=box) == pytest.approx(0.5)
    assert oracle.volume(TILTED) == pytest.approx(3.2 * 3.1 * 3.4)
    frames = np.array([[[1.0, 0, 0]], [[0, 3.0, 0]]])
    assert oracle.configurational_temperature(frames, [2.0, 8.0]) == pytest.approx(1.0)  # ratio of the means


def test_configurational_temperature_of_an_exact_boltzmann_average():
    """<|grad U|^2> = kT <lap U> by quadrature over one soft pair inside the cutoff sphere (F = 0 there)."""
    kT, params = 0.7, oracle.PairParams.build(A=5.0, cutoff=1.0)
    nodes, weights = np.polynomial.legendre.leggauss(40)
    r = 0.5 * (nodes + 1)
    squares, laplacians = 0.0, 0.0
    for radius, weight in zip(r, weights, strict=True):
        c = oracle.conservative(np.array([[radius, 0, 0], [0, 0, 0]]), [0, 0], params)
        boltzmann = weight * radius**2 * np.exp(-c.energy / kT)
        squares, laplacians = squares + boltzmann * np.sum(c.forces**2), laplacians + boltzmann * c.laplacian
    assert oracle.configurational_temperature(np.sqrt(squares), laplacians) == pytest.approx(kT, rel=1e-12)


# ---------------------------------------------------------------------------------------- reference numbers


def fcc_crystal(cells=3, density=3.0):
    a = (4.0 / density) ** (1 / 3)
    basis = np.array([[0, 0, 0], [0, 0.5, 0.5], [0.5, 0, 0.5], [0.5, 0.5, 0]])
    corners = np.array(list(itertools.product(range(cells), repeat=3)))
    return a * (corners[:, None, :] + basis).reshape(-1, 3), np.full(3, cells * a), a


def test_fcc_crystal_energy_per_bead():
    """rho 3, A 25, rc 1: 3.6872574 per bead, from six bonds of length a/sqrt(2) each; no net force."""
    x, box, a = fcc_crystal()
    c = oracle.conservative(x, np.zeros(len(x), int), oracle.PairParams.build(A=25.0, cutoff=1.0), box)
    assert len(x) == 108
    assert c.energy / len(x) == pytest.approx(3.6872574, abs=5e-8)
    assert c.energy / len(x) == pytest.approx(6 * 12.5 * (1 - a / np.sqrt(2)) ** 2, rel=1e-12)
    assert c.virial / len(x) == pytest.approx(6 * 25.0 * (1 - a / np.sqrt(2)) * a / np.sqrt(2), rel=1e-12)
    np.testing.assert_allclose(c.forces, 0.0, atol=1e-11)


# ---------------------------------------------------------------------------------------------- live LAMMPS


@pytest.fixture(scope="module")
def live_lammps():
    reason = lammps_peer.why_missing()  # absent, or there but without its MPI or a pair style
    if reason:
        pytest.skip(reason)


def coefficient_lines(params, extended):
    lines = []
    for a, b in ((0, 0), (0, 1), (1, 1)):
        names = ["A", "gamma", *(["gamma_perp", "s", "s_perp"] if extended else []), "cutoff"]
        values = " ".join(repr(float(getattr(params, name)[a, b])) for name in names)
        lines.append(f"pair_coeff {a + 1} {b + 1} {values}")
    return lines


LAMMPS_BOXES = {
    "orthorhombic": np.array([4.1, 4.6, 5.0]),
    "triclinic": np.array([[4.5, 0, 0], [1.3, 4.4, 0], [-0.9, 1.7, 4.7]]),
    "none": None,
}


@pytest.mark.parametrize("box", LAMMPS_BOXES.values(), ids=LAMMPS_BOXES.keys())
@pytest.mark.parametrize("extended", [False, True], ids=["dpd", "dpd/ext"])
def test_forces_energy_and_pressure_equal_lammps_at_zero_temperature(live_lammps, extended, box):
    n, masses = 280, np.array([1.0, 2.7])
    rng = np.random.default_rng(20)
    edges = np.array([4.1, 4.6, 5.0]) if box is None else box
    x = rng.uniform(size=(n, 3)) @ (np.diag(edges) if edges.ndim == 1 else edges)
    v, types = rng.normal(size=(n, 3)), np.arange(n) % 2
    params = two_types()
    if not extended:  # pair dpd is s = 1 without a transverse part
        params = oracle.PairParams.build(2, A=params.A, gamma=params.gamma, cutoff=params.cutoff)
    peer = lammps_peer.lammps_forces(
        x, types, masses, v, box,
        [f"pair_style {'dpd/ext' if extended else 'dpd'} 0.0 1.0 4711"],
        coefficient_lines(params, extended),
    )  # fmt: skip

    c, d = oracle.conservative(x, types, params, box), oracle.dissipative(x, v, types, params, box)
    forces = c.forces + d.forces
    assert np.sqrt(np.mean((forces - peer.forces) ** 2) / np.mean(peer.forces**2)) < 1e-9
    assert np.mean(d.forces**2) > 0.01 * np.mean(peer.forces**2)  # the drag is seen, not drowned
    assert peer.pe == pytest.approx(c.energy, rel=1e-11)
    assert peer.ke == pytest.approx(0.5 * np.sum(masses[types][:, None] * v**2), rel=1e-11)
    if box is not None:
        pressure = oracle.pressure(masses[types], v, c.virial + d.virial, box)
        assert peer.press == pytest.approx(pressure, rel=1e-10)


def test_lammps_gives_the_crystal_energy(live_lammps):
    x, box, _ = fcc_crystal()
    style, coefficients = ["pair_style dpd 0.0 1.0 1"], ["pair_coeff 1 1 25 4.5"]
    types = np.zeros(len(x), int)
    peer = lammps_peer.lammps_forces(x, types, [1.0], np.zeros_like(x), box, style, coefficients)
    assert peer.pe / len(x) == pytest.approx(3.6872574, abs=5e-8)
