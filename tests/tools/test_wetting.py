"""Contact angles of planted drops."""

import mdtraj
import numpy as np
import pytest
from cases import raises

import openmm_dpd as dpd
from openmm_dpd.analysis import contact_angle
from openmm_dpd.trajectory import bead_element

EDGES, RADIUS, LOW = np.array([14.0, 13.0, 12.0]), 4.5, 1.3


def drops(angle: float, frames: int, seed: int, width: float = 0.4, beads: int = 800) -> mdtraj.Trajectory:
    """Independent frames of drops that drift across the faces of the box: a ball cut by a plane, with a surface of some width.

    The density of beads is 1/2 (1 - tanh(2 (d - R)/w)), by rejection, times a number; the wall has beads of its own."""
    rng, centre = np.random.default_rng(seed), -RADIUS * np.cos(np.radians(angle))
    frames_of, wall = [], rng.random((100, 3)) * [*EDGES[:2], LOW]
    for k in range(frames):
        kept = np.zeros((0, 3))
        while len(kept) < beads:
            x = (rng.random((6000, 3)) - 0.5) * (2 * RADIUS + 3)
            inside = rng.random(6000) < 0.5 * (1 - np.tanh(2 * (np.linalg.norm(x, axis=1) - RADIUS) / width))
            kept = np.concatenate([kept, x[inside & (x[:, 2] > -centre)]])
        x = kept[:beads] + [0.9 * k, 0.4 * k, LOW + centre]
        frames_of.append(np.concatenate([x, wall]))
    topology = mdtraj.Topology()
    chain = topology.add_chain()
    for name in ["L"] * beads + ["S"] * 100:
        topology.add_atom(name, bead_element(name, 1.0), topology.add_residue("MOL", chain))
    trajectory = mdtraj.Trajectory(np.array(frames_of), topology)
    trajectory.unitcell_vectors = np.broadcast_to(np.diag(EDGES).astype(np.float32), (frames, 3, 3))
    return trajectory


@pytest.mark.parametrize("angle", [50, 95, 140])
def test_planted_angles_are_found(angle):
    """Within four standard errors and a degree; a quarter of it is what cells of 0.3 blur."""
    trajectory = drops(angle, 60, seed=angle)
    found = contact_angle((trajectory[k : k + 20] for k in (0, 20, 40)), "L", surface=LOW, n_bins=(24, 40), skip=0.3)
    assert abs(found.angle.mean - angle) < 4 * found.angle.sem + 0.25 and found.angle.sem < 1.0
    assert abs(found.radius.mean - RADIUS) < 4 * found.radius.sem + 0.02
    assert abs(found.height.mean + RADIUS * np.cos(np.radians(angle))) < 4 * found.height.sem + 0.02
    assert found.profile.y.shape == (24, 40) and found.surface == LOW and 0.2 < found.width.mean < 0.8
    whole = np.pi * RADIUS**3 / 3 * (2 + np.cos(np.radians(angle))) * (1 - np.cos(np.radians(angle))) ** 2
    assert found.density.mean == pytest.approx(800 / whole, rel=0.03)
    # another place of the wall gives another angle, as geometry has it: cos = (s - z0)/R
    other = contact_angle(trajectory, "L", surface=LOW + 0.2, n_bins=(24, 40), skip=0.1)
    expected = np.degrees(np.arccos(np.cos(np.radians(found.angle.mean)) + 0.2 / found.radius.mean))
    assert other.angle.mean == pytest.approx(expected, abs=0.1)


@pytest.mark.slow
def test_errors_are_those_of_many_runs():
    """The scatter of 24 runs, known to 15 %, is what their errors say."""
    found = [contact_angle(drops(95, 15, seed), "L", surface=LOW, n_bins=(12, 20), skip=0.3).angle for seed in range(24)]
    scatter, errors = np.std([one.mean for one in found], ddof=1), np.sqrt(np.mean([one.sem**2 for one in found]))
    assert 0.6 < scatter / errors < 1.7


def test_what_is_no_drop_is_refused():
    trajectory = drops(95, 6, seed=1)
    empty = mdtraj.Trajectory(trajectory.xyz, trajectory.topology)
    for call, message in (
        (lambda: contact_angle(trajectory, "L", surface=9.5), "no drop with a round surface"),
        (lambda: contact_angle(trajectory, "L", surface=-50.0), "must be a height in the box, from 0 to 12 nm"),
        (lambda: contact_angle(trajectory, "L", surface=LOW, n_bins=(40, 1)), "needs four slices"),
        (lambda: contact_angle(trajectory, "L", surface=LOW, axis="rz"), "axis must be"),
        (lambda: contact_angle(trajectory, "L", surface=LOW, skip=-1.0), "skip at least 0"),
        (lambda: contact_angle(trajectory, "L", surface=[1.0, 2.0]), "must be one number each"),
        (lambda: contact_angle(trajectory, "W", surface=LOW), "no bead is of type 'W'"),
        (lambda: contact_angle(empty, "L", surface=LOW), "needs a periodic box"),
    ):
        raises(dpd.ParameterError, message, call)
