"""Mean squared displacements, diffusion, velocities, molecules and tensions of planted motion."""

import mdtraj
import numpy as np
import pytest
from cases import raises
from openmm import app, unit
from test_analysis_structure import BOXES, TILTED, chunks, random_trajectory, trajectory_of

import openmm_dpd as dpd
from openmm_dpd import ParameterError
from openmm_dpd.analysis import (
    diffusion_coefficient,
    end_to_end_distance,
    mean_squared_displacement,
    radius_of_gyration,
    read_velocities,
    surface_tension,
    temperature_profile,
    velocity_autocorrelation,
    velocity_profile,
)
from openmm_dpd.measure import VelocityReporter
from openmm_dpd.simulation.field_file import load_fields
from openmm_dpd.trajectory import load, write_psf


def walk(seed: int, beads: int, frames: int, sigma: float) -> np.ndarray:
    """Positions (F, N, 3) of independent random walks."""
    rng = np.random.default_rng(seed)
    return rng.random((beads, 3)) * 5 + np.cumsum(rng.normal(0, sigma, (frames, beads, 3)), axis=0)


def folded(x: np.ndarray, box: np.ndarray) -> np.ndarray:
    s = x @ np.linalg.inv(box)
    return (s - np.floor(s)) @ box


def as_openmm_folds(x: np.ndarray, box: np.ndarray, molecules: np.ndarray) -> np.ndarray:
    """Molecules moved so that their centres are in the brick of the three diagonal elements."""
    x = x.copy()
    for frame in x:
        for number in np.unique(molecules):
            own = molecules == number
            for k in (2, 1, 0):
                frame[own] -= np.floor(frame[own].mean(axis=0)[k] / box[k, k]) * box[k]
    return x


# -- mean squared displacement -------------------------------------------------------------------------------------------------
def test_displacement_equals_naive_loops():
    x = walk(1, 7, 25, 0.2)
    masses = np.arange(1.0, 8.0)
    trajectory = trajectory_of(x, ["A"] * 3 + ["B"] * 4, masses=masses)
    x = trajectory.xyz.astype(float)
    still = x - (masses @ x / masses.sum())[:, None]
    for beads, own, drift, axes in ((None, slice(None), True, "xyz"), ("A", slice(0, 3), False, "xyz"), ("B", slice(3, 7), False, "zx")):
        found = mean_squared_displacement(trajectory, beads, interval=0.5, lags=[0, 1, 4, 11], drift=drift, axes=axes)
        y = (x if drift else still)[:, own][..., ["xyz".index(axis) for axis in axes]]
        expected = [np.mean([np.mean(np.sum((y[t + lag] - y[t]) ** 2, axis=1)) for t in range(25 - lag)]) for lag in (0, 1, 4, 11)]
        np.testing.assert_allclose(found.y, expected, atol=1e-12)
        np.testing.assert_array_equal(found.x, [0, 0.5, 2.0, 5.5])
        assert found.dimensions == len(axes) and found.origins.shape == (25, 4)


def test_displacement_of_molecules():
    """Centres of mass of the chosen beads of each molecule."""
    x = walk(2, 6, 12, 0.1)
    trajectory = trajectory_of(x, ["A", "B"] * 3, bonds=[(0, 1), (2, 3), (4, 5)], masses=[1.0, 3.0] * 3)
    found = mean_squared_displacement(trajectory, interval=1, lags=[2], molecules=True, drift=True)
    y = (x[:, ::2] + 3 * x[:, 1::2]) / 4
    assert found.y[0] == pytest.approx(np.mean(np.sum((y[2:] - y[:-2]) ** 2, axis=2)), rel=1e-5)


@pytest.mark.parametrize("fit", [(1, 1), (2, 10)])
def test_diffusion_of_random_walks(fit):
    """A walk with steps of variance s^2 along each axis has D = s^2/2 per frame; its error is known for one lag."""
    beads, frames, sigma = 40, 2000, 0.1
    trajectory = trajectory_of(walk(3, beads, frames, sigma), ["A"] * beads)
    displacement = mean_squared_displacement(trajectory, interval=0.5, lags=range(11), drift=True)
    found = diffusion_coefficient(displacement, (0.5 * fit[0], 0.5 * fit[1]))
    expected = sigma**2 / 2 / 0.5
    assert abs(found.mean - expected) < 4 * found.sem and found.converged
    if fit == (1, 1):
        assert found.sem == pytest.approx(expected * np.sqrt(2 / (3 * beads * frames)), rel=0.3)
    else:
        assert found.sem < 0.05 * expected
    assert np.all(np.abs(displacement.y[1:] - 3 * sigma**2 * np.arange(1, 11)) < 4 * displacement.sem[1:])


def test_errors_of_diffusion_are_right():
    """Deviations over standard errors have a variance near 1, in sixty trajectories that are long against the lags of the fit."""
    z = []
    for seed in range(60):
        trajectory = trajectory_of(walk(100 + seed, 5, 600, 0.1), ["A"] * 5)
        found = diffusion_coefficient(mean_squared_displacement(trajectory, interval=1, lags=[2, 4, 6], drift=True), (2, 6))
        z.append((found.mean - 0.005) / found.sem)
    # the variance of 60 squares of normal numbers has a standard error of 0.18; errors from few blocks scatter besides
    assert 0.4 < np.mean(np.square(z)) < 2.0


def test_correction_for_the_size_of_the_box():
    displacement = mean_squared_displacement(trajectory_of(walk(5, 4, 50, 0.1), ["A"] * 4), interval=1.0)
    plain = diffusion_coefficient(displacement, (1, 5))
    found = diffusion_coefficient(displacement, (1, 5), kT=1.3, viscosity=0.85, edge=6.0)
    assert found.mean - plain.mean == pytest.approx(2.837297 * 1.3 / (6 * np.pi * 0.85 * 6.0))
    assert found.sem == plain.sem
    kelvin, angstrom = 1.3 / dpd.units.BOLTZMANN * unit.kelvin, 60 * unit.angstrom
    corrected = diffusion_coefficient(displacement, (1, 5), kT=kelvin, viscosity=0.85, edge=angstrom)
    assert corrected.mean == pytest.approx(found.mean, rel=1e-14)
    raises(ParameterError, "needs kT, viscosity and edge", lambda: diffusion_coefficient(displacement, (1, 5), kT=1.0))
    raises(ParameterError, "fit must be two times", lambda: diffusion_coefficient(displacement, (1, 2, 3)))
    raises(ParameterError, "no lag is between 20 and 30 ps", lambda: diffusion_coefficient(displacement, (20, 30)))
    with pytest.raises(ParameterError, match="mean_squared_displacement"):
        diffusion_coefficient(velocity_autocorrelation(np.zeros((5, 2, 3)), interval=1), (1, 2))


@pytest.mark.parametrize("box", BOXES)
def test_folded_paths_are_unwrapped(box):
    """Folded bead by bead, folded by molecules as OpenMM does it, or not folded: the displacements are the same."""
    vectors = BOXES[box].astype(np.float32).astype(np.float64)
    x = walk(6, 30, 60, 0.2) + np.array([0.0, 0.0, 0.4]) * np.arange(60)[:, None, None]
    x[:, 1::2] = x[:, ::2] + np.random.default_rng(1).normal(0, 0.4, (15, 3)) * np.cos(0.3 * np.arange(60))[:, None, None]
    molecules = np.repeat(np.arange(15), 2)
    bonds = [(2 * k, 2 * k + 1) for k in range(15)]
    assert (np.ptp(x[:, :, 2], axis=0) > 10).all(), "every bead has crossed the box"
    results = []
    for y in (x, folded(x, vectors), as_openmm_folds(x, vectors, molecules)):
        trajectory = trajectory_of(y, ["A", "B"] * 15, vectors, bonds)
        results.append(mean_squared_displacement(chunks(trajectory, 9), interval=1, drift=True))
    for found in results[1:]:
        np.testing.assert_allclose(found.y, results[0].y, rtol=1e-4)
    assert mean_squared_displacement(trajectory, interval=1).y[-1] < 0.5 * results[0].y[-1], "the drift is gone"


def test_unwrapping_in_a_box_that_changes():
    """Beads that do not move in a breathing box, folded: they move by less than the box does."""
    edges = 5 + 0.02 * np.sin(np.arange(40.0))
    x = np.random.default_rng(2).random((20, 3)) * 0.9 + np.array([4.5, 1, 2])
    frames = [x - np.floor(x / edge) * edge for edge in edges]
    trajectory = trajectory_of(frames, ["A"] * 20, np.array([np.eye(3) * edge for edge in edges]))
    assert 0 < mean_squared_displacement(trajectory, interval=1, drift=True).y.max() < 3 * 0.05**2


def test_reporters_that_fold_and_that_do_not(tmp_path):
    """OpenMM's DCD files of one run, with molecules folded into the box and without: displacements and sizes are the same."""
    rng = np.random.default_rng(3)
    positions = (rng.random((15, 1, 3)) * 3 + np.cumsum(rng.normal(0, 0.3, (15, 4, 3)), axis=1)).reshape(-1, 3)
    bonds = dpd.HarmonicBonds([(4 * c + k, 4 * c + k + 1) for c in range(15) for k in range(3)], k=30.0, r0=0.5)
    pairs = {("P", "P"): dpd.DPD(A=15, gamma=4.5)}
    scene = dpd.Scene({"P": 1.0}, ["P"] * 60, positions, pairs, kT=1.0, box=[3.0] * 3, bonds=[bonds])
    simulation = dpd.build(scene, dt=0.04, seed=1, platform="Reference").simulation()
    simulation.step(50)
    write_psf(tmp_path / "p.psf", names=scene.types, masses=scene.bead_masses, bonds=scene.bond_pairs)
    names = {True: "folded.dcd", False: "free.dcd"}
    for fold, name in names.items():
        simulation.reporters.append(app.DCDReporter(str(tmp_path / name), 4, enforcePeriodicBox=fold))
    simulation.step(1200)
    folded, free = (load(tmp_path / name, tmp_path / "p.psf") for name in names.values())
    assert np.ptp(free.xyz, axis=(0, 1)).min() > 6 > np.ptp(folded.xyz, axis=(0, 1)).max()
    for molecules in (False, True):
        found = [mean_squared_displacement(t, interval=0.16, molecules=molecules, drift=True) for t in (folded, free)]
        np.testing.assert_allclose(found[0].y, found[1].y, rtol=1e-4, atol=1e-6)
        assert found[0].y[-1] > 1
    np.testing.assert_allclose(radius_of_gyration(folded).values, radius_of_gyration(free).values, rtol=1e-4)


def test_paths_that_cannot_be_unwrapped():
    x = walk(7, 20, 40, 1.2)
    box = np.eye(3) * 5
    raises(ParameterError, "Write frames more often", mean_squared_displacement, trajectory_of(folded(x, box), ["A"] * 20, box), interval=1)
    continuous = trajectory_of(x * 2, ["A"] * 20, box)
    raises(ParameterError, "use unwrap=False if they are on continuous paths", lambda: mean_squared_displacement(continuous, interval=1))
    free = mean_squared_displacement(trajectory_of(x * 2, ["A"] * 20), interval=1)
    np.testing.assert_array_equal(mean_squared_displacement(continuous, interval=1, unwrap=False).y, free.y)


def test_time_that_goes_back_is_refused_by_name():
    """Frames that a run has written twice, behind a checkpoint; not chunks whose clocks begin at 0."""
    x = walk(8, 20, 12, 0.2)
    once = trajectory_of(x, ["A"] * 20, np.eye(3) * 5)
    once.time = 0.5 * np.arange(1, 13)
    twice = mdtraj.join([once[:9], once[6:]], check_topology=False)
    for trajectory in (twice, [once[:9], once[6:]]):
        back = "frame 9: time goes back from 4.5 to 3.5 ps; of frames that a restart wrote twice, keep the last"
        raises(ParameterError, back, mean_squared_displacement, trajectory, interval=0.5)
    kept = twice[sorted({time: frame for frame, time in enumerate(twice.time)}.values())]
    expected = mean_squared_displacement(once, interval=0.5).y
    np.testing.assert_array_equal(mean_squared_displacement(kept, interval=0.5).y, expected)
    parts = [trajectory_of(part, ["A"] * 20, np.eye(3) * 5) for part in (x[:5], x[5:])]
    np.testing.assert_array_equal(mean_squared_displacement(parts, interval=0.5).y, expected)


# -- velocities ----------------------------------------------------------------------------------------------------------------
def test_velocity_autocorrelation_of_a_known_process():
    """Velocities that forget a tenth in each frame: C(t) = 3 kT/m 0.9^t; and a naive loop."""
    rng = np.random.default_rng(4)
    v = np.empty((3000, 10, 3))
    v[0] = rng.normal(0, 1.5, (10, 3))
    for k in range(1, 3000):
        v[k] = 0.9 * v[k - 1] + np.sqrt(1 - 0.81) * rng.normal(0, 1.5, (10, 3))
    found = velocity_autocorrelation(iter(v), interval=0.1, lags=range(0, 30, 3))
    assert np.all(np.abs(found.y - 3 * 2.25 * 0.9 ** (found.x * 10)) < 4 * found.sem)
    some = velocity_autocorrelation([v[:20], v[20:40]], [2, 5], interval=1, lags=[3])
    expected = np.mean([[v[t, i] @ v[t + 3, i] for i in (2, 5)] for t in range(37)])
    assert some.y[0] == pytest.approx(expected)


def test_profiles_of_velocity_and_temperature():
    """A shear flow u = 0.2 z at kT = 1.5 with beads of two masses: the flow is found, and taken off the temperature if asked for."""
    frames, n, edge = 200, 400, 6.0
    rng = np.random.default_rng(5)
    x = rng.random((frames, n, 3)) * edge
    masses = np.repeat([1.0, 4.0], n // 2)
    v = rng.normal(0, 1, (frames, n, 3)) * np.sqrt(1.5 / masses)[:, None]
    v[..., 0] += 0.2 * x[..., 2]
    trajectory = trajectory_of(x, ["A"] * (n // 2) + ["B"] * (n // 2), np.eye(3) * edge, masses=masses)
    flow = velocity_profile(chunks(trajectory, 30), iter(v), n_bins=12)
    assert np.all(np.abs(flow.y - 0.2 * flow.x) < 4 * flow.sem)
    across = velocity_profile(trajectory, v, component="y", n_bins=12)
    assert np.all(np.abs(across.y) < 4 * across.sem) and across.sem.max() < 0.02
    assert np.all(across.sem == pytest.approx(np.sqrt(1.5 / (2.5 * n / 12 * frames)), rel=0.6))
    # in a slice the flow varies by 0.2 * 0.5, which adds 2.5 * 0.1^2/12/3 to kT
    swinging = v + 3 * np.cos(np.arange(frames))[:, None, None]
    for bins in (12, 40):  # 33 beads in each slice, or ten
        own = temperature_profile(trajectory, swinging, n_bins=bins, flow=True)
        assert np.all(np.abs(own.y - 1.5 - 2.5 * (1.2 / bins) ** 2 / 36) < 4 * own.sem)
        assert np.all(own.sem == pytest.approx(1.5 * np.sqrt(2 / (3 * (n / bins - 1) * frames)), rel=0.6))
    moving = temperature_profile(trajectory, v, "B", n_bins=12)
    assert np.all(np.abs(moving.y - 1.5 - 4 * (0.2 * moving.x) ** 2 / 3 - 4 * 0.01 / 36) < 4 * moving.sem)
    half = trajectory.atom_slice(np.arange(n))
    half.xyz[..., 2] *= 0.3
    empty = temperature_profile(half, v, n_bins=12)
    assert np.isnan(empty.y[5:]).all() and np.isfinite(empty.y[:3]).all()


def test_velocities_and_frames_must_match():
    trajectory = random_trajectory(1, 5, 4, BOXES["edges"])
    for velocities, message in (
        (np.zeros((3, 5, 3)), "velocities for 3 frames only"),
        (np.zeros((5, 5, 3)), "more frames than the 4"),
        (np.zeros((4, 6, 3)), r"must have shape \(5, 3\), not \(6, 3\)"),
        (np.full((4, 5, 3), np.nan), "velocities must be finite"),
        ("v.npz", "not str"),
    ):
        raises(ParameterError, message, velocity_profile, trajectory, velocities)
    raises(ParameterError, "at least 2 frames", lambda: velocity_autocorrelation(np.zeros((1, 5, 3)), interval=1))
    for beads, message in (
        ([7], "indices must be from 0 to 4; there is 7"),
        ([1, 1], "an index appears twice"),
        ([-1], "indices must be from 0 to 4; there is -1"),
        (["A"], "indices or a mask of 5, not <U1"),
        (np.ones(4, dtype=bool), "indices or a mask of 5, not bool"),
        ([], "no beads are selected"),
    ):
        raises(ParameterError, message, velocity_autocorrelation, np.zeros((4, 5, 3)), beads, interval=1)
    assert velocity_autocorrelation(np.ones((4, 5, 3)), np.arange(5) < 2, interval=1, lags=[1]).y == [3]


def test_velocities_are_written_beside_the_trajectory(tmp_path):
    positions = np.random.default_rng(1).random((60, 3)) * 3
    scene = dpd.Scene({"W": 1.0}, ["W"] * 60, positions, {("W", "W"): dpd.DPD(A=25, gamma=4.5)}, kT=1.0, box=[3.0] * 3)
    simulation = dpd.build(scene, dt=0.02, seed=1, platform="Reference").simulation()
    simulation.reporters.append(VelocityReporter(tmp_path / "velocities.npz", 5))
    simulation.step(20)
    last = simulation.context.getState(velocities=True).getVelocities(asNumpy=True)._value
    found = load_fields(tmp_path / "velocities.npz")
    assert found["step"].tolist() == [5, 10, 15, 20] and found["velocities"].shape == (4, 60, 3)
    np.testing.assert_allclose(found["velocities"][-1], last, rtol=1e-6)
    np.testing.assert_array_equal([*read_velocities(tmp_path / "velocities.npz")], found["velocities"])
    raises(ParameterError, "interval between reports", lambda: VelocityReporter(tmp_path / "v.npz", 0))


# -- molecules -----------------------------------------------------------------------------------------------------------------
@pytest.mark.parametrize("box", [None, *BOXES], ids=str)
def test_straight_chains(box):
    """Rg^2 = b^2 (n^2 - 1)/12 and R = b (n - 1) for a straight chain of n equal beads, broken at the faces of the box."""
    rng = np.random.default_rng(3)
    vectors = None if box is None else BOXES[box]
    chains, n, b = 6, 10, 0.7
    x = []
    for _ in range(5):
        direction = rng.normal(0, 1, (chains, 1, 3))
        direction /= np.linalg.norm(direction, axis=2, keepdims=True)
        x.append((rng.random((chains, 1, 3)) * 5 + b * np.arange(n)[:, None] * direction).reshape(-1, 3))
    place = rng.permutation(chains * n)  # beads of a chain are numbered in any order, and the chains are mixed
    mixed = np.empty((5, chains * n, 3))
    mixed[:, place] = x
    bonds = [(place[n * c + k], place[n * c + k + 1]) for c in range(chains) for k in range(n - 1)]
    trajectory = trajectory_of(mixed if vectors is None else folded(mixed, vectors), ["A"] * (chains * n), vectors, rng.permutation(bonds))
    size, ends = radius_of_gyration(chunks(trajectory, 2)), end_to_end_distance(chunks(trajectory, 2))
    assert size.values.shape == ends.values.shape == (5, chains)
    np.testing.assert_allclose(size.values, b * np.sqrt((n**2 - 1) / 12), rtol=1e-5)
    np.testing.assert_allclose(ends.values, b * (n - 1), rtol=1e-5)
    assert ends.mean_square.mean == pytest.approx((b * (n - 1)) ** 2, rel=1e-5)
    assert size.mean.mean == pytest.approx(b * np.sqrt((n**2 - 1) / 12), rel=1e-5)
    np.testing.assert_allclose(end_to_end_distance(trajectory, [[place[0], place[5]]]).values, 5 * b, rtol=1e-5)


@pytest.mark.parametrize("wound", [False, True])
def test_rings_and_nets_whose_bonds_close_through_the_box(wound):
    """In boxes that change and are tilted they have their size; wound once around the box they have none, whatever their numbers."""
    rng = np.random.default_rng(11)
    for vectors in [*BOXES.values()] * 3:
        boxes = vectors * rng.uniform(0.95, 1.05, (3, 1, 1))
        turn = 2 * np.pi * np.arange(24) / 24
        ring = rng.uniform(0.5, 1.2, 3) * np.column_stack([np.cos(turn), np.sin(turn), np.sin(2 * turn)])
        winding = np.outer(np.arange(24) / 24, rng.permutation([1, 0, rng.integers(-1, 2)])) if wound else np.zeros((24, 3))
        x = np.array([ring + rng.normal(0, 0.03, (24, 3)) + winding @ box for box in boxes])
        place = rng.permutation(30)
        mixed = np.concatenate([x, x[:, :6] + 1], axis=1)[:, np.argsort(place)]  # a chain of six beside it
        bonds = [(k, (k + 1) % 24) for k in range(24)] + [(k, k + 2) for k in range(0, 20, 5)] + [(k, k + 1) for k in range(24, 29)]
        bonds = rng.permutation(place[np.array(bonds)])
        names = np.where(place.argsort() < 24, "R", "C").tolist()
        trajectory = trajectory_of(np.array([folded(*one) for one in zip(mixed, boxes, strict=True)]), names, boxes, bonds)
        size = np.sqrt(np.mean(np.sum((x - x.mean(axis=1, keepdims=True)) ** 2, axis=2), axis=1))
        end = place[[0, 12]][None]
        assert radius_of_gyration(trajectory, "C").values.shape == end_to_end_distance(trajectory).values.shape == (3, 1)
        across = np.linalg.norm(x[:, 12] - x[:, 0], axis=1)
        for analyse, expected in ((lambda t: radius_of_gyration(t, "R"), size), (lambda t, end=end: end_to_end_distance(t, end), across)):
            if wound:
                raises(ParameterError, rf"the molecule of bead {place[:24].min()} .*; 24 beads.* close through", analyse, trajectory)
            else:
                np.testing.assert_allclose(analyse(trajectory).values[:, 0], expected, rtol=1e-5)


def test_sizes_of_unlike_molecules():
    """A branched molecule, a dimer and free beads; masses count, and only chosen beads."""
    x = np.random.default_rng(8).random((3, 9, 3)) * 2
    masses = np.array([1.0, 2, 3, 4, 5, 6, 1, 1, 1])
    names = ["A", "A", "B", "A", "C", "C", "W", "W", "W"]
    trajectory = trajectory_of(x, names, np.eye(3) * 9, bonds=[(3, 1), (1, 0), (1, 2), (5, 4)], masses=masses)

    def naive(beads):
        m, y = masses[beads], trajectory.xyz[:, beads].astype(float)
        centre = np.einsum("i,fik->fk", m, y) / m.sum()
        return np.sqrt(np.einsum("i,fi->f", m, np.sum((y - centre[:, None]) ** 2, axis=2)) / m.sum())

    np.testing.assert_allclose(radius_of_gyration(trajectory).values, np.column_stack([naive([0, 1, 2, 3]), naive([4, 5])]), rtol=1e-5)
    np.testing.assert_allclose(radius_of_gyration(trajectory, "A").values, naive([0, 1, 3])[:, None], rtol=1e-5)
    equal = trajectory.atom_slice([0, 1, 2, 3])
    for atom in equal.topology.atoms:
        atom.element = mdtraj.element.virtual
    np.testing.assert_allclose(radius_of_gyration(equal).values[:, 0], mdtraj.compute_rg(equal), rtol=1e-5)
    np.testing.assert_allclose(end_to_end_distance(trajectory).values[:, 0], np.linalg.norm(x[:, 5] - x[:, 4], axis=1), rtol=1e-5)
    for call, message in (
        (lambda: radius_of_gyration(trajectory, "W"), "no molecule has two"),
        (lambda: radius_of_gyration(random_trajectory(1, 4, 2, TILTED)), "has no bonds"),
        (lambda: end_to_end_distance(trajectory, [[0, 4]]), "are not in one molecule"),
        (lambda: end_to_end_distance(trajectory, "A"), "ends must be pairs of beads, as .* not 'A'"),
        (lambda: end_to_end_distance(trajectory, [[0, 9]]), "from 0 to 8"),
        (lambda: end_to_end_distance(trajectory.atom_slice([0, 1, 2, 3])), "no linear chain"),
    ):
        raises(ParameterError, message, call)


# -- tension -------------------------------------------------------------------------------------------------------------------
def test_surface_tension():
    rng = np.random.default_rng(2)
    diagonal = np.array([3.0, 4.0, 6.0]) + rng.normal(0, 0.2, (500, 3))
    length = 20 + rng.normal(0, 0.01, 500)
    found = surface_tension(diagonal, length)
    assert abs(found.mean - 10 * 2.5) < 4 * found.sem
    assert found.sem == pytest.approx(10 * 0.2 * np.sqrt(1.5 / 500), rel=0.4)
    tensor = np.zeros((500, 3, 3))
    tensor[:, range(3), range(3)] = diagonal
    tensor[:, 0, 1] = 99.0
    assert surface_tension(tensor, length).mean == found.mean
    assert surface_tension(np.column_stack([diagonal, tensor[:, 0]]), length).mean == found.mean
    expected = 20 * (diagonal[:, 0] - diagonal[:, 1:].mean(axis=1)).mean()
    assert surface_tension(diagonal, 20.0, interfaces=1, axis="x").mean == pytest.approx(expected)
    for arguments, message in (
        ((diagonal[:, :2], 20.0), "must have shape"),
        ((np.zeros((0, 3)), 20.0), "no rows"),
        ((5.0, 1.0), "must have shape"),
        ((diagonal, length[:7]), "one for each of the 500 rows"),
        ((diagonal, -1.0), "all above 0"),
        (("a", 1.0), "must be arrays of numbers"),
    ):
        raises(ParameterError, message, surface_tension, *arguments)
    raises(ParameterError, "interfaces must be 1 or 2", lambda: surface_tension(diagonal, 20.0, interfaces=3))


def test_bad_requests_for_displacements():
    trajectory = trajectory_of(walk(1, 5, 6, 0.1), ["A"] * 5, BOXES["edges"])
    for more, message in (
        ({"interval": 0}, "interval must be above 0"),
        ({"interval": 1, "lags": [6]}, "from 0 to 5"),
        ({"interval": 1, "lags": [1, 1]}, "different numbers"),
        ({"interval": 1, "lags": [0.5]}, "whole numbers"),
        ({"interval": 1, "axes": "xx"}, "each once"),
        ({"interval": 1, "axes": "w"}, "axis must be"),
        ({"interval": 1, "unwrap": "yes"}, "unwrap must be"),
    ):
        raises(ParameterError, message, mean_squared_displacement, trajectory, **more)
    raises(ParameterError, "at least 2 frames", lambda: mean_squared_displacement(trajectory[0], interval=1))


# -- pictures ------------------------------------------------------------------------------------------------------------------
def test_every_result_has_a_picture(tmp_path):
    from openmm_dpd.analysis import Curve, cluster_sizes, density_profile, pictures as draw, radial_distribution, structure_factor

    trajectory = random_trajectory(1, 60, 8, BOXES["edges"], ["A"] * 20 + ["B"] * 40)
    displacement = mean_squared_displacement(trajectory_of(walk(1, 5, 60, 0.1), ["A"] * 5), interval=1)
    g = {name: radial_distribution(trajectory, "A", name, r_max=2.0, n_bins=10) for name in "AB"}
    for name, call in {
        "g": lambda path: draw.radial_distribution_picture(path, g, cutoff=1.0, title="g(r)"),
        "s": lambda path: draw.structure_factor_picture(path, structure_factor(trajectory, q_max=3), unit=""),
        "p": lambda path: draw.profile_picture(path, density_profile(trajectory)),
        "m": lambda path: draw.displacement_picture(path, displacement, fit=(2, 8)),
        "c": lambda path: draw.cluster_picture(path, cluster_sizes(trajectory, cutoff=0.6)),
        "few": lambda path: draw.radial_distribution_picture(path, radial_distribution(trajectory[0], r_max=2.0)),
    }.items():
        call(tmp_path / f"{name}.png")
        assert (tmp_path / f"{name}.png").stat().st_size > 10_000
    assert isinstance(g["A"], Curve)
    raises(ParameterError, "must be a Curve", lambda: draw.profile_picture(tmp_path / "x.png", {"A": [1, 2]}))
    for picture in (draw.profile_picture, draw.displacement_picture, draw.cluster_picture):
        raises(ParameterError, "not None", picture, tmp_path / "x.png", None)


@pytest.mark.parametrize("name", ["text.npz", "missing.npz", "cut.npz", "other.npz"])
def test_files_that_hold_no_velocities(tmp_path, name):
    (tmp_path / "text.npz").write_text("hello")
    np.savez(tmp_path / "other.npz", x=np.zeros(5))
    (tmp_path / "cut.npz").write_bytes((tmp_path / "other.npz").read_bytes()[:100])
    message = "is not a file of velocities" if name == "other.npz" else "cannot be read as a file of velocities"
    raises(ParameterError, f"{name} {message}", lambda: next(read_velocities(tmp_path / name)))
