"""Pictures of beads: what is in front, how large it is, how it is lit; and what of a scene, a run and a frame is drawn."""

import mdtraj
import numpy as np
import pytest
from cases import cases, raises
from matplotlib.image import imread

import openmm_dpd as dpd
from openmm_dpd.io.bead_pictures import bead_picture
from openmm_dpd.io.spheres import camera, drawn

RED, GREEN = [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]
FRONT = np.eye(3)  # x to the right, y to the top, seen along z


def picture(centres, radii, colours):
    return drawn(np.array(centres, float), np.array(radii, float), np.array(colours), FRONT, 200)


def test_a_sphere_is_a_disc():
    seen = picture([[3, 2, 1]], [2.0], [RED])
    assert seen.shape == (200, 200, 4)
    assert seen[..., 3].sum() == pytest.approx(np.pi * 100**2, rel=1e-3)
    assert np.array_equal(seen[..., 3], seen[::-1, :, 3]) and np.array_equal(seen[..., 3], seen[:, ::-1, 3])
    assert seen[60, 60, 0] > seen[150, 150, 0] > 0.3  # the light comes from above


@pytest.mark.parametrize("order", [(0, 1), (1, 0)])
def test_what_is_nearer_hides_what_is_farther(order):
    """Where two spheres overlap, too: their surfaces meet in the plane between them."""
    centres, colours = np.array([[0, 0, 0.0], [0, 0, 5.0]]), np.array([RED, GREEN])
    seen = picture(centres[list(order)], [2.0, 2.0], colours[list(order)])
    shown = seen[..., 3] > 0.99
    assert np.all(seen[shown][:, 1] > seen[shown][:, 0])
    seen = picture(np.array([[0, 0, 0.0], [1, 0, 0.0]])[list(order)], [1.0, 1.0], colours[list(order)])
    assert seen[100 * 2 // 3, 90, 0] > seen[100 * 2 // 3, 90, 1] and seen[100 * 2 // 3, 110, 1] > seen[100 * 2 // 3, 110, 0]


def test_a_sphere_throws_a_shadow():
    light = np.array([-0.45, 0.65, 0.61]) / np.linalg.norm([-0.45, 0.65, 0.61])
    seen = picture([[0, 0, 0], [9, 9, 0], 4.5 * light], [3.0, 3.0, 0.6], [RED, RED, RED])
    assert seen[134, 22, 0] < 0.85 * seen[14, 142, 0]  # where the two large ones face the light
    assert seen[175, 40, 0] == pytest.approx(seen[55, 160, 0], abs=0.02)


def test_the_camera_has_z_to_the_top():
    axes = camera(60.0, 30.0)
    assert np.allclose(axes @ axes.T, np.eye(3)) and np.linalg.det(axes) == pytest.approx(1.0)
    assert axes[0, 2] == 0.0 and axes[1, 2] > 0.0 and axes[2, 2] == pytest.approx(0.5)


@pytest.fixture
def undrawn():
    """Pictures are drawn here."""


@pytest.fixture
def scene():
    pairs = {("A", "A"): dpd.DPD(25, 4.5), ("A", "B"): dpd.DPD(25, 4.5), ("B", "B"): dpd.DPD(25, 4.5)}
    positions = np.random.default_rng(1).random((60, 3)) * 5
    bonds = [dpd.HarmonicBonds([(0, 1), (2, 3)], 10.0, 0.5)]
    return dpd.Scene({"A": 1.0, "B": 1.0}, ["A"] * 20 + ["B"] * 40, positions, pairs, kT=1.0, box=[5.0] * 3, bonds=bonds)


def count(path, bluish):
    """How many pixels of a picture are blue, or orange: the colours of the first and the second type."""
    red, _, blue, _ = np.moveaxis(imread(path), -1, 0)
    return int(np.sum(blue > red + 0.2 if bluish else red > blue + 0.2))


def test_scenes_runs_and_frames(scene, tmp_path):
    """All three are the same beads; types may be hidden, and a slice shows fewer."""

    def draw(name, *given, **how):
        bead_picture(tmp_path / name, *given, **how)
        return count(tmp_path / name, True), count(tmp_path / name, False)

    blue, orange = draw("scene.png", scene)
    assert orange > blue > 1000
    hidden = draw("hidden.png", scene, radii={"A": 0.25, "B": 0.0})
    assert hidden[0] > blue and hidden[1] < 200
    assert sum(draw("slice.png", scene, thickness=1.0)) < 0.5 * (blue + orange)
    built = dpd.build(scene, dt=0.01)
    simulation = built.simulation(platform="Reference")
    assert draw("run.png", built, state=simulation.context) == draw("state.png", built, state=simulation.context.getState(positions=True))
    topology = mdtraj.Topology.from_openmm(built.topology)
    frame = mdtraj.Trajectory(scene.positions[None], topology, unitcell_lengths=[[5.0] * 3], unitcell_angles=[[90.0] * 3])
    raises(dpd.ParameterError, "leave state out", lambda: bead_picture(tmp_path / "none.png", frame, state=simulation.context))
    raises(
        dpd.ParameterError, "C is missing or unknown", lambda: bead_picture(tmp_path / "none.png", frame, radii={"A": 1, "B": 1, "C": 1})
    )
    assert draw("frame.png", frame, radii=0.25) == pytest.approx((blue, orange), rel=0.02)


def test_a_dense_box_is_shown_as_a_slice(tmp_path):
    positions = np.random.default_rng(1).random((500, 3)) * 5
    scene = dpd.Scene({"A": 1.0}, ["A"] * 500, positions, {("A", "A"): dpd.DPD(25, 4.5)}, kT=1.0, box=[5.0] * 3)
    bead_picture(tmp_path / "dense.png", scene, radii=0.5)
    bead_picture(tmp_path / "whole.png", scene, radii=0.5, thickness=5.0)
    assert count(tmp_path / "dense.png", True) < 0.9 * count(tmp_path / "whole.png", True)


def test_beads_without_a_box_and_far_from_the_origin(tmp_path):
    """The array of the shadows is as large as the beads are apart; a type that does not interact with itself has the largest cutoff's radius."""
    pairs = {("A", "A"): dpd.NONE, ("A", "B"): dpd.DPD(25, 4.5), ("B", "B"): dpd.DPD(25, 4.5, cutoff=0.5)}
    scenes = [dpd.Scene({"A": 1.0, "B": 1.0}, ["A", "B"], np.array([[0, 0, 0], [0, 1, 1.0]]) + far, pairs, kT=1.0) for far in (0.0, 1e5)]
    for k, scene in enumerate(scenes):
        bead_picture(tmp_path / f"{k}.png", scene)
    blue, orange = count(tmp_path / "0.png", True), count(tmp_path / "0.png", False)
    assert 3.0 < blue / orange < 5.0
    assert (count(tmp_path / "1.png", True), count(tmp_path / "1.png", False)) == pytest.approx((blue, orange), rel=0.01)
    raises(dpd.ParameterError, "leave thickness out", lambda: bead_picture(tmp_path / "none.png", scenes[0], thickness=1.0))


@cases(
    "how, said",
    ({"thickness": -1.0}, "the thickness of the slice"),
    ({"radii": 0.0}, "no bead is left to draw"),
    ({"radii": {"A": 1.0}}, "B is missing"),
    ({"view": (1.0, float("nan"))}, "two angles in degrees"),
    ({"pixels": 0}, "the number of pixels"),
)
def test_what_cannot_be_drawn_is_named(scene, tmp_path, how, said):
    raises(dpd.ParameterError, said, lambda: bead_picture(tmp_path / "none.png", scene, **how))
    assert not (tmp_path / "none.png").exists()
