"""Profiles along two axes and in rings, from trajectories and within runs, against a loop over beads; and planted flows in rings."""

from math import atan2, cos, floor, hypot, pi, sin

import mdtraj
import numpy as np
import pytest
from cases import raises

import openmm_dpd as dpd
from openmm_dpd.analysis import Curve, couette_viscosity, density_profile, pictures, temperature_profile, velocity_profile
from openmm_dpd.measure import ProfileReporter
from openmm_dpd.trajectory import bead_element

EDGES, MASSES = (4.0, 5.0, 6.0), np.repeat([1.0, 3.0], [40, 60])


def trajectory_of(frames: np.ndarray, boxes) -> mdtraj.Trajectory:
    topology = mdtraj.Topology()
    chain = topology.add_chain()
    for mass in MASSES:
        name = "A" if mass == 1 else "B"
        topology.add_atom(name, bead_element(name, mass), topology.add_residue("MOL", chain))
    trajectory = mdtraj.Trajectory(frames, topology)
    trajectory.unitcell_vectors = np.broadcast_to(np.asarray(boxes, np.float32), (len(frames), 3, 3))
    return trajectory


def cell(x, edges, axis: str, bins, centre=None) -> tuple[tuple[int, int] | None, float, float]:
    """The cell of one bead, None outside all rings; its volume; and the angle around the axis."""
    middle = [0.5 * edge for edge in edges] if centre is None else centre
    near = [x[k] - middle[k] - edges[k] * round((x[k] - middle[k]) / edges[k]) for k in range(3)]
    number = "xyz".index(axis[1])
    if axis[0] != "r":
        k, low = "xyz".index(axis[0]), 0.5
        places = ((near[k] / edges[k] + low) * bins[0], (near[number] / edges[number] + low) * bins[1])
        return (floor(places[0]), floor(places[1])), edges[0] * edges[1] * edges[2] / bins[0] / bins[1], 0.0
    a, b = (number + 1) % 3, (number + 2) % 3
    reach, r = 0.5 * min(edges[a], edges[b]), hypot(near[a], near[b])
    ring, floor_of = floor(r / reach * bins[0]), floor(x[number] / edges[number] % 1.0 * bins[1])
    volume = pi * ((ring + 1) ** 2 - ring**2) * (reach / bins[0]) ** 2 * edges[number] / bins[1]
    return ((ring, floor_of) if r < reach else None), volume, atan2(near[b], near[a])


@pytest.mark.parametrize("axis", ["xz", "zy", "rz", "rx"])
def test_profiles_agree_with_a_loop_over_beads(axis):
    """Densities, velocities and temperatures of beads strewn over images in a box that breathes; with a centre, across its faces."""
    rng, bins = np.random.default_rng(3), (3, 2)
    boxes = [np.diag(EDGES) * (1 + 0.03 * k) for k in range(3)]
    x = np.array([(rng.random((100, 3)) * 0.4 + rng.integers(-1, 2, (100, 3)) + 0.9) @ box for box in boxes])
    trajectory, v = trajectory_of(x, boxes), rng.normal(size=x.shape)
    x = trajectory.xyz.astype(float)
    for centre in (None, "A"):
        count, mass, square, own = np.zeros((4, 3, *bins))
        density, momentum = np.zeros((3, *bins)), np.zeros((3, 3, *bins))
        for f, frame in enumerate(x):
            edges = trajectory.unitcell_vectors[f].astype(float).diagonal()
            middle = None
            if centre:
                angle = [np.angle(np.exp(2j * pi * frame[:40, k] / edges[k]).sum()) / 2 / pi * edges[k] for k in range(3)]
                near = [frame[:40, k] - angle[k] - edges[k] * np.round((frame[:40, k] - angle[k]) / edges[k]) for k in range(3)]
                middle = [angle[k] + near[k].mean() for k in range(3)]
            for i in range(100):
                at, volume, turn = cell(frame[i], edges, axis, bins, middle)
                if at is None:
                    continue
                u = v[f, i]
                if axis[0] == "r":
                    k = "xyz".index(axis[1])
                    a, b = u[(k + 1) % 3], u[(k + 2) % 3]
                    u = [a * cos(turn) + b * sin(turn), b * cos(turn) - a * sin(turn), u[k]]
                count[f][at] += 1
                density[f][at] += 1 / volume
                mass[f][at] += MASSES[i]
                square[f][at] += MASSES[i] * np.dot(u, u)
                for k in range(3):
                    momentum[k, f][at] += MASSES[i] * u[k]
            own[f] = np.divide(np.sum(momentum[:, f] ** 2, axis=0), mass[f], out=np.zeros(bins), where=mass[f] > 0)
        options = {"axis": axis, "n_bins": bins, "centre": centre}
        found = density_profile(trajectory, np.arange(100), **options)["selected"]
        np.testing.assert_allclose(found.y, density.mean(axis=0), rtol=1e-6)
        assert found.x.shape == (*bins, 2) and found.sem.shape == bins and count.sum(axis=(1, 2)).min() > 10
        for number, name in enumerate(("r", "phi", axis[1]) if axis[0] == "r" else "xyz"):
            flow = velocity_profile(trajectory, v, component=name, **options)
            empty = np.isnan(flow.y)
            expected = momentum[number].mean(axis=0) / np.where(empty, 1, mass.mean(axis=0))
            np.testing.assert_allclose(flow.y[~empty], expected[~empty], rtol=1e-6, atol=1e-9)
            assert np.all(np.count_nonzero(mass[:, empty], axis=0) == 0)
        warm = temperature_profile(trajectory, v, flow=True, **options).y
        freedom = 3 * np.maximum(count - 1, 0).mean(axis=0)
        there = np.isfinite(warm)
        np.testing.assert_allclose(warm[there], ((square - own).mean(axis=0) / np.where(there, freedom, 1))[there], rtol=1e-6)
    corner = density_profile(trajectory[0], axis=axis, n_bins=bins)["A"].x[0, 0]
    extent = [
        EDGES["xyz".index(axis[0])] if axis[0] != "r" else 0.5 * min(np.delete(EDGES, "xyz".index(axis[1]))),
        EDGES["xyz".index(axis[1])],
    ]
    np.testing.assert_allclose(corner, [extent[0] / 6, extent[1] / 4], rtol=1e-6)


def test_a_turning_fluid_in_rings():
    """u_phi = 0.5 r at kT = 1.5: in rings the flow is found within its errors, and taken off the temperature."""
    rng, frames = np.random.default_rng(5), 300
    x = rng.random((frames, 100, 3)) * EDGES
    v = rng.normal(0, 1, x.shape) * np.sqrt(1.5 / MASSES)[:, None]
    v[..., 0] -= 0.5 * (x[..., 1] - 2.5)
    v[..., 1] += 0.5 * (x[..., 0] - 2.0)
    trajectory = trajectory_of(x, np.diag(EDGES))
    flow = velocity_profile(trajectory, v, component="phi", axis="rz", n_bins=(8, 1))
    r = flow.x[:, 0, 0]
    # the mean over a ring, of r weighted with r
    inner, outer = r - 0.125, r + 0.125
    assert np.all(np.abs(flow.y[:, 0] - 0.5 * 2 / 3 * (outer**3 - inner**3) / (outer**2 - inner**2)) < 4 * flow.sem[:, 0])
    own = temperature_profile(trajectory, v, axis="rz", n_bins=(8, 1), flow=True)
    assert np.all(np.abs(own.y - 1.5)[2:] < 4 * own.sem[2:] + 0.02) and np.all(own.sem[2:] < 0.06)
    density = density_profile(trajectory, "B", axis="rz", n_bins=(8, 1))["B"]
    assert np.all(np.abs(density.y - 0.5) < 4 * density.sem)


@pytest.mark.parametrize("axis", ["yz", "rz"])
def test_runs_have_the_same_profiles(axis, tmp_path):
    """ProfileReporter beside the functions for trajectories, in double precision and with the run's own velocities."""
    rng = np.random.default_rng(2)
    table = {("*", "*"): dpd.DPD(A=25, gamma=4.5)}
    scene = dpd.Scene({"A": 1.0, "B": 3.0}, ["A"] * 40 + ["B"] * 60, rng.random((100, 3)) * EDGES, table, kT=1.0, box=EDGES)
    built = dpd.build(scene, dt=0.02, seed=1, scheme="bababo")
    simulation, component = built.simulation(), "phi" if axis == "rz" else "x"
    reporter = ProfileReporter(2, built, axis=axis, component=component, bins=(2, 3))
    raises(dpd.ParameterError, "no samples", lambda: reporter.profile)
    simulation.reporters.append(reporter)
    x, v = [], []
    for _ in range(6):
        simulation.step(2)
        state = simulation.context.getState(positions=True, velocities=True)
        x.append(state.getPositions(asNumpy=True)._value)
        v.append(state.getVelocities(asNumpy=True)._value)
    trajectory, found, options = trajectory_of(np.array(x), np.diag(EDGES)), reporter.profile, {"axis": axis, "n_bins": (2, 3)}
    flow = velocity_profile(trajectory, v, component=component, **options)
    np.testing.assert_allclose(found.velocity, flow.y, rtol=1e-5, atol=1e-6)
    np.testing.assert_allclose(found.density, density_profile(trajectory, np.arange(100), **options)["selected"].y, rtol=1e-5)
    np.testing.assert_allclose(found.kT, temperature_profile(trajectory, v, flow=True, **options).y, rtol=1e-5)
    np.testing.assert_allclose(found.centres, flow.x, rtol=1e-6)
    assert found.rows.shape == (6, 2, 3) and found.error.shape == (2, 3) and "2 x 3 slabs" in repr(found)
    raises(dpd.ParameterError, "along one axis", lambda: couette_viscosity(found, np.ones(6), channel=(0, 1)))
    pictures.profile_picture(tmp_path / "map.png", flow, axis_name=axis)
    for wrong in ("z", None):
        raises(dpd.ParameterError, "two letters", lambda wrong=wrong: pictures.profile_picture(tmp_path / "x.png", flow, axis_name=wrong))
    raises(dpd.ParameterError, "along one axis", lambda: pictures.profile_picture(tmp_path / "x.png", {"A": flow}))
    assert (tmp_path / "map.png").stat().st_size > 10_000 and isinstance(flow, Curve)


def test_cells_of_a_shear_are_parts_of_its_slabs():
    """The flow is part of the velocity, whichever of the two axes it changes along."""
    x = np.random.default_rng(3).random((100, 3)) * EDGES
    table, shear = {("*", "*"): dpd.DPD(A=25, gamma=4.5)}, dpd.LeesEdwards(0.5)
    scene = dpd.Scene({"A": 1.0}, ["A"] * 100, x, table, kT=1.0, box=EDGES, shear=shear)
    built = dpd.build(scene, dt=0.02, seed=1, scheme="bababo")
    simulation = built.simulation()
    slabs, first, second = (ProfileReporter(1, built, axis=axis, bins=4) for axis in ("y", "yz", "zy"))
    simulation.reporters += [slabs, first, second]
    simulation.step(3)
    for cells, across in ((first.profile, 1), (second.profile, 0)):
        flow = np.nansum(cells.velocity * cells.density, axis=across) / cells.density.sum(axis=across)
        np.testing.assert_allclose(flow, slabs.profile.velocity, rtol=1e-10)
    for axis in ("xy", "rz"):
        raises(dpd.ParameterError, "in a Lees-Edwards shear", ProfileReporter, 1, built, axis, "z")


def test_what_cannot_be_cut_is_refused():
    tilted = np.array([[4, 0, 0], [1, 5, 0], [0, 0, 6.0]])
    x = np.random.default_rng(1).random((2, 100, 3)) @ tilted
    trajectory, v = trajectory_of(x, tilted), np.ones((2, 100, 3))
    for call, message in (
        (lambda: density_profile(trajectory, axis="rz"), "right angles"),
        (lambda: density_profile(trajectory, axis="zz"), "axis must be one or two"),
        (lambda: density_profile(trajectory, axis="zr"), "axis must be one or two"),
        (lambda: density_profile(trajectory, axis="r"), "axis must be"),
        (lambda: density_profile(trajectory, axis="xz", n_bins=(3, 4, 5)), "one for each of 2 axes"),
        (lambda: density_profile(trajectory, axis="xz", n_bins=(3, 0)), "n_bins must be"),
        (lambda: velocity_profile(trajectory, v, axis="rz", component="x"), "'r', 'phi' or 'z'"),
        (lambda: velocity_profile(trajectory, v, axis="xz", component="phi"), "axis must be"),
    ):
        raises(dpd.ParameterError, message, call)
    nearly = trajectory_of(x, np.diag(EDGES) + 3e-6 * np.tri(3, k=-1))  # right angles, as files have them
    assert density_profile(nearly, axis="rz", n_bins=2)["A"].y.max() > 0
    whole = density_profile(trajectory, np.arange(100), axis="yx", n_bins=(4, 3))["selected"]
    assert whole.y.mean() * 120 == pytest.approx(100, rel=1e-5)  # cells of a tilted box are tilted
