"""Structure factors, profiles, bilayers and clusters of planted configurations, beside naive loops."""

import mdtraj
import numpy as np
import pytest
from cases import raises

from openmm_dpd import ParameterError
from openmm_dpd.analysis import (
    area_per_lipid,
    bilayer_thickness,
    cluster_labels,
    cluster_sizes,
    density_profile,
    radial_distribution,
    structure_factor,
)
from openmm_dpd.base.geometry import pairs_within
from openmm_dpd.trajectory import bead_element

TILTED = np.array([[6.0, 0.0, 0.0], [1.7, 5.0, 0.0], [-1.1, 2.0, 7.0]])
BOXES = {"edges": np.diag([6.0, 5.0, 7.0]), "tilted": TILTED}


def trajectory_of(frames, names, boxes=None, bonds=(), masses=None, molecules=None) -> mdtraj.Trajectory:
    """Trajectory from positions (F, N, 3), types, and one box (3, 3) or several."""
    frames = np.asarray(frames, dtype=np.float64)
    frames = frames[None] if frames.ndim == 2 else frames
    topology = mdtraj.Topology()
    chain = topology.add_chain()
    masses = np.ones(len(names)) if masses is None else masses
    molecules = range(len(names)) if molecules is None else molecules
    residues = {number: topology.add_residue("MOL", chain, resSeq=int(number)) for number in dict.fromkeys(molecules)}
    rows = zip(names, masses, molecules, strict=True)
    atoms = [topology.add_atom(name, bead_element(name, mass), residues[number]) for name, mass, number in rows]
    for i, j in bonds:
        topology.add_bond(atoms[i], atoms[j])
    trajectory = mdtraj.Trajectory(frames, topology)
    if boxes is not None:
        trajectory.unitcell_vectors = np.broadcast_to(boxes, (len(frames), 3, 3)).astype(np.float32)
    return trajectory


def random_trajectory(seed: int, beads: int, frames: int, box, names=None, **more) -> mdtraj.Trajectory:
    positions = np.random.default_rng(seed).random((frames, beads, 3)) @ np.asarray(box)
    return trajectory_of(positions, ["A"] * beads if names is None else names, box, **more)


def chunks(trajectory: mdtraj.Trajectory, size: int):
    return (trajectory[k : k + size] for k in range(0, trajectory.n_frames, size))


def shortest(d: np.ndarray, box: np.ndarray) -> np.ndarray:
    """Length of the shortest image of each vector, by trying all of the nearest ones."""
    images = np.array([[i, j, k] for i in range(-2, 3) for j in range(-2, 3) for k in range(-2, 3)]) @ box
    return np.linalg.norm(d[..., None, :] + images, axis=-1).min(axis=-1)


# -- pairs -----------------------------------------------------------------------------------------------------------------------
@pytest.mark.parametrize("box", [None, *BOXES], ids=str)
def test_pairs_equal_naive_loops(box):
    vectors = None if box is None else BOXES[box]
    rng = np.random.default_rng(3)
    x, y = rng.random((60, 3)) * 6, rng.random((41, 3)) * 18 - 6  # unfolded positions
    reach = 2.1
    for other in (None, y):
        i, j, r = pairs_within(x, other, vectors, reach)
        to = x if other is None else y
        d = x[:, None] - to[None]
        distance = np.linalg.norm(d, axis=-1) if vectors is None else shortest(d - np.floor(d @ np.linalg.inv(vectors)) @ vectors, vectors)
        near = distance < reach
        if other is None:
            near = np.triu(near, 1)
        assert {*zip(i.tolist(), j.tolist(), strict=True)} == {*zip(*(k.tolist() for k in np.nonzero(near)), strict=True)}
        assert len(i) == near.sum() > 10
        np.testing.assert_allclose(r, distance[i, j], atol=1e-12)


def test_pairs_beyond_half_the_box():
    x = np.zeros((2, 3))
    assert len(pairs_within(x, None, TILTED, 2.2)[0]) == 1
    raises(ParameterError, "a distance of 2.6 is more than half the smallest width", lambda: pairs_within(x, None, BOXES["edges"], 2.6))
    raises(ParameterError, "smallest width of the box, 4.8076", pairs_within, x, None, TILTED, 2.45)  # 210 / |a x c|


# -- radial distribution ---------------------------------------------------------------------------------------------------------
@pytest.mark.parametrize("box", BOXES)
def test_radial_distribution_equals_naive_loops(box):
    vectors = BOXES[box].astype(np.float32).astype(np.float64)
    trajectory = random_trajectory(1, 45, 3, vectors, ["A"] * 15 + ["B"] * 30, bonds=[(k, 15 + k) for k in range(15)])
    trajectory.xyz[:, 15:30] = trajectory.xyz[:, :15] + 0.2
    edges = np.linspace(0, 2.2, 12)
    distance = np.array([shortest(x[:, None] - x[None], vectors) for x in trajectory.xyz.astype(float)])
    a, b = np.arange(45) < 15, np.arange(45) >= 15
    apart = ~np.eye(45, dtype=bool)
    labels = np.where(a, np.arange(45), np.where(np.arange(45) < 30, np.arange(45) - 15, np.arange(45)))
    other_molecule = labels[:, None] != labels[None]
    mixed = np.arange(10, 20)
    for first, second, between, chosen in (
        (None, None, False, apart),
        ("A", None, False, apart & a[:, None] & a[None]),
        ("A", "B", False, a[:, None] & b[None]),
        ("A", mixed, False, apart & a[:, None] & np.isin(np.arange(45), mixed)[None]),
        (None, None, True, other_molecule),
        ("B", "A", True, other_molecule & b[:, None] & a[None]),
    ):
        found = radial_distribution(trajectory, first, second, r_max=2.2, n_bins=11, between_molecules=between)
        counts = np.mean([np.histogram(d[chosen], edges)[0] for d in distance], axis=0)
        expected = counts * np.linalg.det(vectors) / chosen.sum() / (4 * np.pi / 3 * np.diff(edges**3))
        np.testing.assert_allclose(found.y, expected, rtol=1e-6)
        assert counts.sum() > 20


@pytest.mark.parametrize("box", BOXES)
def test_radial_distribution_equals_mdtraj(box):
    trajectory = random_trajectory(2, 80, 6, BOXES[box], ["A"] * 30 + ["B"] * 50)
    for first, second in (("A", "A"), ("A", "B")):
        pairs = trajectory.topology.select_pairs(f"name {first}", f"name {second}")
        x, g = mdtraj.compute_rdf(trajectory, pairs, r_range=(0.0, 2.0), n_bins=10)
        found = radial_distribution(chunks(trajectory, 4), first, second, r_max=2.0, n_bins=10)
        np.testing.assert_allclose(found.x, x, rtol=1e-6)
        np.testing.assert_allclose(found.y, g, rtol=0.01)  # distances in single precision may fall into the next bin


def test_an_ideal_gas_has_no_structure():
    """g(r) = 1 for equal and unlike pairs within its errors, in a box that changes; the errors are those of counted pairs."""
    rng = np.random.default_rng(9)
    boxes = BOXES["tilted"] * (1 + 0.03 * np.sin(np.arange(300)))[:, None, None]
    trajectory = trajectory_of([rng.random((60, 3)) @ box for box in boxes], ["A"] * 20 + ["B"] * 40, boxes)
    for first, second, pairs in ((None, None, 60 * 59 / 2), ("A", None, 20 * 19 / 2), ("A", "B", 800)):
        found = radial_distribution(chunks(trajectory, 41), first, second, r_max=2.2, n_bins=5)
        assert np.all(np.abs(found.y - 1) < 4 * found.sem)
        counted = pairs * 300 * 4 * np.pi / 3 * np.diff(np.linspace(0, 2.2, 6) ** 3) / 210
        np.testing.assert_allclose(found.sem, 1 / np.sqrt(counted), rtol=0.6)


# -- structure factor ----------------------------------------------------------------------------------------------------------
@pytest.mark.parametrize("box", BOXES)
def test_structure_factor_equals_naive_sums(box):
    vectors = BOXES[box].astype(np.float32).astype(np.float64)
    trajectory = random_trajectory(1, 30, 3, vectors, ["A"] * 12 + ["B"] * 18)
    q_max, width = 4.0, 0.3
    n = np.array([[i, j, k] for i in range(-6, 7) for j in range(-6, 7) for k in range(-7, 8) if (i, j, k) != (0, 0, 0)])
    q = n @ (2 * np.pi * np.linalg.inv(vectors).T)
    length = np.linalg.norm(q, axis=1)
    assert length[np.abs(n[:, 0]) == 6].min() > q_max and length[np.abs(n[:, 2]) == 7].min() > q_max
    q, length = q[length <= q_max], length[length <= q_max]
    number = np.rint(length / width).astype(int)
    every, of_a, of_b, three = np.arange(30), np.arange(12), np.arange(12, 30), np.arange(3)
    for first, second, *groups in (
        (None, None, every, every),
        ("A", None, of_a, of_a),
        ("A", "B", of_a, of_b),
        (["B"], three, of_b, three),
    ):
        found = structure_factor(trajectory, first, second, q_max=q_max, width=width)
        a, b = (np.exp(-1j * np.einsum("qk,fik->fqi", q, trajectory.xyz[:, g].astype(float))).sum(axis=2) for g in groups)
        expected = (a * b.conj()).real.mean(axis=0) / np.sqrt(len(groups[0]) * len(groups[1]))
        bins = np.unique(number)
        np.testing.assert_allclose(found.x, [length[number == k].mean() for k in bins], rtol=1e-6)
        np.testing.assert_allclose(found.y, [expected[number == k].mean() for k in bins], atol=1e-5)


def test_structure_factor_of_lattices():
    """A body-centred lattice of 4 x 4 x 4 cells scatters with S = N where h + k + l is even, and nowhere else."""
    cells, a = 4, 1.25
    corners = np.array([[i, j, k] for i in range(cells) for j in range(cells) for k in range(cells)]) * a
    lattice = np.concatenate([corners, corners + a / 2])
    trajectory = trajectory_of(lattice, ["A"] * len(lattice), np.diag([cells * a] * 3))
    peak = 2 * np.pi / a
    found = structure_factor(trajectory, q_max=2.05 * peak, width=peak / 500)
    high = {round(q / peak, 3): s for q, s in zip(found.x, found.y, strict=True) if s > 1e-6}
    shells = [h for h in range(1, 5) if h % 2 == 0]
    assert [*high] == [round(np.sqrt(h), 3) for h in shells]
    # the shell of h^2 + k^2 + l^2 = 2 has no vectors but the 12 of (1, 1, 0); that of 4 has (2, 0, 0) and, of the box, (16 = 16 + 0 + 0) only
    assert high[1.414] == pytest.approx(len(lattice), rel=1e-4)
    assert high[2.0] == pytest.approx(len(lattice), rel=1e-4)
    assert np.isnan(found.sem).all()


def test_default_bins_part_the_low_shells():
    """A lamella in a box that breathes: its peak is at the shortest wave, S = N (2/pi)^2/3; in a cube all shells up to five times that are alone."""
    edges = np.linspace(9.0, 11.0, 40)[:, None, None]
    x = np.random.default_rng(0).random((40, 900, 3))
    x[..., 2] /= 2
    found = structure_factor(trajectory_of(x * edges, ["A"] * 900, np.eye(3) * edges), q_max=5.0)
    assert found.n_frames == 40
    peak = np.abs(found.x - 0.63) < 0.08  # one bin of each length of the shortest wave
    assert found.y[peak] == pytest.approx(900 * 4 / np.pi**2 / 3, rel=0.06) and found.y[~peak].max() < 20
    cube = structure_factor(trajectory_of(x[:5] * 10.0, ["A"] * 900, np.eye(3) * 10.0), q_max=3.2)
    shells = np.unique(np.sum(np.square(np.indices((6, 6, 6)).reshape(3, -1)), axis=0))
    np.testing.assert_allclose(cube.x, 0.2 * np.pi * np.sqrt(shells[(shells > 0) & (shells <= 25)]), rtol=1e-5)


def test_structure_factor_of_an_ideal_gas():
    trajectory = random_trajectory(5, 200, 400, BOXES["edges"], ["A"] * 80 + ["B"] * 120)
    for first, second, expected in ((None, None, 1.0), ("A", "A", 1.0), ("A", "B", 0.0)):
        found = structure_factor(chunks(trajectory, 37), first, second, q_max=4.0, width=0.5)
        assert len(found.x) >= 6 and found.n_frames == 400
        assert np.all(np.abs(found.y - expected) < 4 * found.sem)
        # |rho|^2/N of one vector is exponential with mean and deviation 1; each bin averages over its vectors
        assert np.all(found.sem < 1.0 / np.sqrt(400) * 1.2)


def test_chunks_are_the_same_as_the_whole():
    trajectory = random_trajectory(8, 50, 23, TILTED, ["A"] * 20 + ["B"] * 30, masses=[1.0] * 20 + [3.0] * 30)
    trajectory.xyz[:, :20] *= 0.4
    for analyse in (lambda t: structure_factor(t, "A", "B", q_max=5.0), lambda t: density_profile(t, centre="A", n_bins=17)["B"]):
        whole, parts = analyse(trajectory), analyse(chunks(trajectory, 5))
        for name in ("x", "y", "sem"):
            np.testing.assert_array_equal(getattr(whole, name), getattr(parts, name))
    assert cluster_sizes(trajectory, "A", cutoff=0.5).number_average == cluster_sizes(chunks(trajectory, 4), "A", cutoff=0.5).number_average


# -- profiles --------------------------------------------------------------------------------------------------------------------
@pytest.mark.parametrize("axis", ["x", "y", "z"])
@pytest.mark.parametrize("box", BOXES)
def test_densities_count_every_bead_once(box, axis):
    trajectory = random_trajectory(2, 300, 4, BOXES[box], ["A"] * 100 + ["B"] * 200, masses=[2.0] * 100 + [5.0] * 200)
    trajectory.xyz += 40.0
    k, volume = "xyz".index(axis), np.linalg.det(BOXES[box])
    profiles = density_profile(trajectory, axis=axis, n_bins=9)
    assert [*profiles] == ["A", "B"]
    assert profiles["A"].y.mean() * volume == pytest.approx(100, rel=1e-5)
    assert profiles["B"].y.mean() * volume == pytest.approx(200, rel=1e-5)
    heavy = density_profile(trajectory, "B", axis=axis, n_bins=9, mass=True)
    np.testing.assert_allclose(heavy["B"].y, 5 * profiles["B"].y, rtol=1e-12)
    width = volume / np.linalg.norm(np.cross(*np.delete(BOXES[box], k, axis=0)))
    np.testing.assert_allclose(profiles["A"].x, (np.arange(9) + 0.5) / 9 * width, rtol=1e-5)
    s = (trajectory.xyz[0].astype(float) @ np.linalg.inv(trajectory.unitcell_vectors[0].astype(float)))[:, k] % 1
    one = density_profile(trajectory[0], np.arange(100), axis=axis, n_bins=9)["selected"].y * volume / 9
    np.testing.assert_allclose(one, np.histogram(s[:100], 9, (0, 1))[0], rtol=1e-5)


def test_films_are_centred_across_the_boundary():
    """A film of two layers of different mass drifts through a box that breathes; its profile stays where it was planted."""
    rng = np.random.default_rng(4)
    frames, boxes = [], []
    for k in range(30):
        edge = 8.0 + 0.1 * np.sin(k)
        light, heavy = rng.uniform(-1.5, 0.0, 400), rng.uniform(0.0, 0.5, 400)
        solvent = rng.uniform(0, edge, 200)
        com = (light.sum() + 3 * heavy.sum()) / 1600
        z = np.concatenate([light - com, heavy - com, solvent]) + 0.7 * k
        frames.append(np.column_stack([rng.uniform(0, 4, 1000), rng.uniform(0, 4, 1000), z % edge]))
        boxes.append(np.diag([4, 4, edge]))
    names, masses = ["A"] * 400 + ["B"] * 400 + ["W"] * 200, [1.0] * 400 + [3.0] * 400 + [1.0] * 200
    trajectory = trajectory_of(frames, names, np.array(boxes), masses=masses)
    profiles = density_profile(trajectory, centre=["A", "B"], n_bins=160)
    # centre of mass: (-0.75 + 3 * 0.25) / 4 = 0; the film reaches from -1.5 to 0.5
    filled_a = (profiles["A"].x > -1.4) & (profiles["A"].x < -0.1)
    filled_b = (profiles["B"].x > 0.1) & (profiles["B"].x < 0.4)
    assert filled_a.sum() > 20 and filled_b.sum() > 4
    np.testing.assert_allclose(profiles["A"].y[filled_a].mean(), 400 / (16 * 1.5), rtol=0.02)
    np.testing.assert_allclose(profiles["B"].y[filled_b].mean(), 400 / (16 * 0.5), rtol=0.02)
    away = (profiles["A"].x < -1.8) | (profiles["A"].x > 0.8)
    assert np.all(profiles["A"].y[away] == 0) and np.all(profiles["B"].y[away] == 0) and profiles["W"].y[away].min() > 0
    assert density_profile(trajectory, "A", n_bins=160)["A"].y.min() > 0, "without centring the drifting film is everywhere"


# -- bilayers ------------------------------------------------------------------------------------------------------------------
def bilayer(seed: int, frames: int, thickness: float = 4.0, edge: float = 10.0, drift: float = 0.9) -> mdtraj.Trajectory:
    rng = np.random.default_rng(seed)
    heads, tails = 200, 600
    found = []
    for k in range(frames):
        sheets = [side * thickness / 2 + rng.normal(0, 0.3, heads // 2) for side in (1, -1)]
        z = np.concatenate([*sheets, rng.uniform(-thickness / 2, thickness / 2, tails)])
        x = np.column_stack([rng.uniform(0, 7, heads + tails), rng.uniform(0, 6, heads + tails), (z + drift * k + 1.0) % edge])
        found.append(x)
    names = ["H"] * heads + ["T"] * tails
    bonds = [(i, 200 + 3 * i) for i in range(200)] + [(200 + k, 201 + k) for k in range(600) if k % 3 != 2]
    return trajectory_of(found, names, np.diag([7.0, 6.0, edge]), bonds)


def test_planted_bilayer():
    trajectory = bilayer(1, 400)
    thickness = bilayer_thickness(chunks(trajectory, 7), "H", "T")
    error = 0.3 * np.sqrt(2 / 100 / 400)  # the difference of two means of 100 heads each, 400 times
    assert abs(thickness.mean - 4.0) < 4 * error
    assert thickness.sem == pytest.approx(error, rel=0.5)
    assert bilayer_thickness(trajectory, "H").mean == pytest.approx(thickness.mean, abs=1e-9)
    for lipids in (200, "H", "T"):
        assert area_per_lipid(trajectory, lipids).mean == pytest.approx(2 * 42 / 200, rel=1e-6)
    assert area_per_lipid(trajectory, 200).sem == pytest.approx(0, abs=1e-12)
    assert area_per_lipid(trajectory, 200, axis="x").mean == pytest.approx(2 * 60 / 200, rel=1e-6)


def test_thick_bilayers_need_their_tails():
    """Heads half a box apart do not show which side is inside; with the tails they do, also when the water is thinner than the bilayer."""
    raises(ParameterError, "spread evenly", lambda: bilayer_thickness(bilayer(2, 3, thickness=5.0), "H"))
    assert bilayer_thickness(bilayer(2, 20, thickness=7.0), "H", "T").mean == pytest.approx(7.0, abs=0.1)
    assert bilayer_thickness(bilayer(2, 20, thickness=7.0), "H").mean == pytest.approx(3.0, abs=0.1)


# -- clusters ------------------------------------------------------------------------------------------------------------------
@pytest.mark.parametrize("box", BOXES)
def test_planted_clusters_across_the_boundary(box):
    """Balls of 20, 7 and 1 beads at random places, folded into the box: each is found whole."""
    rng = np.random.default_rng(6)
    frames = []
    for _ in range(8):
        start = rng.random(3) @ BOXES[box]
        centres = np.array([[0, 0, 0], [0.5, 0, 0], [0, 0.5, 0.5]]) @ BOXES[box] + start
        beads = np.concatenate([c + rng.uniform(-0.3, 0.3, (n, 3)) for c, n in zip(centres, (20, 7, 1), strict=True)])
        s = beads @ np.linalg.inv(BOXES[box])
        frames.append((s - np.floor(s)) @ BOXES[box])
    trajectory = trajectory_of(frames, ["A"] * 28, BOXES[box])
    found = cluster_sizes(chunks(trajectory, 3), cutoff=0.6, by="bead")
    assert [sizes.tolist() for sizes in found.sizes] == [[20, 7, 1]] * 8
    assert (found.number_average.mean, found.number_average.sem) == (pytest.approx(28 / 3), pytest.approx(0, abs=1e-12))
    assert found.weight_average.mean == pytest.approx((400 + 49 + 1) / 28)
    assert [column.tolist() for column in found.distribution] == [[1, 7, 20], [1, 1, 1]]
    assert cluster_sizes(trajectory, cutoff=0.6, by="bead", least=5).number_average.mean == pytest.approx(13.5)
    assert cluster_sizes(trajectory, cutoff=0.6, by="bead", least=8).largest.tolist() == [20] * 8


def test_clusters_of_molecules():
    """Three dimers in a row joined by one end each, one dimer away; beads of one molecule need not be near each other."""
    x = np.array([[0.0, 0, 0], [0, 2, 0], [0.5, 0, 0], [0.5, -2, 0], [1.0, 0, 0], [1.0, 2, 2], [3.0, 3, 3], [3.0, 0.5, 3]])
    trajectory = trajectory_of(x, ["T", "H"] * 4, np.diag([8.0] * 3), bonds=[(0, 1), (2, 3), (4, 5), (6, 7)])
    assert cluster_sizes(trajectory, "T", cutoff=0.6).sizes[0].tolist() == [3, 1]
    assert cluster_sizes(trajectory, cutoff=0.6).sizes[0].tolist() == [3, 1]
    assert cluster_sizes(trajectory, cutoff=0.6, by="bead").sizes[0].tolist() == [3, 1, 1, 1, 1, 1]
    # without bonds the residues are the molecules
    apart = trajectory_of(x, ["T", "H"] * 4, np.diag([8.0] * 3), molecules=[5, 5, 2, 2, 1, 1, 7, 7])
    assert cluster_sizes(apart, "T", cutoff=0.6).sizes[0].tolist() == [3, 1]


def test_clusters_equal_a_naive_search():
    x = np.random.default_rng(11).random((150, 3)) @ TILTED
    labels = cluster_labels(x, 0.75, TILTED)
    near = shortest(x[:, None] - x[None], TILTED) < 0.75
    own = np.arange(150)
    for _ in range(150):
        own = np.array([own[row].min() for row in near])
    assert len(np.unique(labels)) == len(np.unique(own)) > 5
    np.testing.assert_array_equal(labels[:, None] == labels[None], own[:, None] == own[None])
    assert np.all(np.diff(np.bincount(labels)) <= 0)
    assert len(np.unique(cluster_labels(x, 0.75))) > len(np.unique(labels))
    raises(ParameterError, "a number for each of the 150 beads", lambda: cluster_labels(x, 0.75, TILTED, np.zeros(3)))
    raises(ParameterError, "must be three box vectors", lambda: cluster_labels(x, 0.75, [5, 5, 5]))


def test_errors():
    box = BOXES["edges"]
    trajectory = random_trajectory(1, 10, 3, box)
    for call, message in (
        (lambda: structure_factor("run.dcd", q_max=3), "chunks of one, not str"),
        (lambda: structure_factor(iter([]), q_max=3), "can be used once only"),
        (lambda: structure_factor([trajectory, trajectory.xyz], q_max=3), "not ndarray"),
        (lambda: structure_factor([trajectory, random_trajectory(1, 9, 1, box)], q_max=3), "they have 10 and 9"),
        (lambda: structure_factor(trajectory, "B", q_max=3), "no bead is of type 'B'; there are 'A'"),
        (lambda: structure_factor(trajectory, [0, 10], q_max=3), "from 0 to 9; there is 10"),
        (lambda: structure_factor(trajectory, [3, 3], q_max=3), "appears twice"),
        (lambda: structure_factor(trajectory, [], q_max=3), "no beads are selected"),
        (lambda: structure_factor(trajectory, q_max=0.5), "below the shortest wave vector of the box, 0.8976"),
        (lambda: structure_factor(trajectory, q_max=2000), "wave vectors"),
        (lambda: structure_factor(trajectory, q_max=0), "q_max must be above 0"),
        (lambda: structure_factor(trajectory_of(trajectory.xyz, ["A"] * 10), q_max=3), "needs a periodic box"),
        (lambda: density_profile(trajectory_of(trajectory.xyz, ["A"] * 10)), "needs a periodic box"),
        (lambda: density_profile(trajectory, axis="w"), "axis must be"),
        (lambda: density_profile(trajectory, n_bins=0), "n_bins must be"),
        (lambda: density_profile(trajectory, ["A", "C"]), "no bead is of type 'C'"),
        (lambda: radial_distribution(trajectory, r_max=2.6), "half the smallest width of the box, 5"),
        (lambda: radial_distribution(trajectory, [3], r_max=2), "needs pairs of beads"),
        (lambda: radial_distribution(trajectory, r_max=2, n_bins=0), "n_bins must be at least 1"),
        (lambda: radial_distribution(trajectory_of(trajectory.xyz, ["A"] * 10), r_max=1), "needs a periodic box"),
        (lambda: cluster_sizes(trajectory, cutoff=3.0), "half the smallest width"),
        (lambda: cluster_sizes(trajectory, cutoff=-1.0), "cutoff must be above 0"),
        (lambda: cluster_sizes(trajectory, cutoff=0.1, least=11), "no frame has a cluster of 11"),
        (lambda: cluster_sizes(trajectory, cutoff=0.1, by="residue"), "by must be"),
        (lambda: cluster_sizes(trajectory, cutoff=0.1, least=0), "least must be at least 1"),
        (lambda: bilayer_thickness(trajectory, "H"), "no bead is of type 'H'"),
        (lambda: density_profile(trajectory, 3.5), "types must be a type"),
        (lambda: density_profile(trajectory, {"A": 1}), "types must be a type"),
        (lambda: area_per_lipid(trajectory, True), "lipids must be their number"),
        (lambda: area_per_lipid(trajectory, 0), "number of lipids must be above 0"),
    ):
        raises(ParameterError, message, call)
    broken = random_trajectory(1, 10, 3, box)
    broken.xyz[2, 4, 1] = np.nan
    raises(ParameterError, "frame 2 .* is not finite", lambda: density_profile(chunks(broken, 1)))
