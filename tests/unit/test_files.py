"""Files are written whole, or by whole blocks, or not at all."""

import struct

import mdtraj
import numpy as np
import pytest
from cases import cases, raises
from full_disk import file_limit

import openmm_dpd as dpd
from openmm_dpd.base.files import BlockFile, append_block, write_whole
from openmm_dpd.io.dcd import DCDWriter
from openmm_dpd.simulation.field_file import FieldWriter, load_fields


def test_a_file_that_cannot_be_written_stays_what_it_was(tmp_path):
    path = tmp_path / "report"
    write_whole(path, "before", "the report")
    with file_limit(1000), pytest.raises(dpd.OutputError, match="the report .*report cannot be written .*ulimit"):
        write_whole(path, "x" * 2000, "the report")
    assert path.read_text() == "before"
    raises(dpd.OutputError, "Is a directory.*write elsewhere", lambda: BlockFile(tmp_path, "the report"))
    raises(dpd.OutputError, "Not a directory", lambda: write_whole(path / "below", "after", "the report"))
    assert [entry.name for entry in tmp_path.iterdir()] == ["report"]


def test_links_stay_links(tmp_path):
    (tmp_path / "real").write_text("before")
    (tmp_path / "link").symlink_to(tmp_path / "real")
    write_whole(tmp_path / "link", b"after", "the report")
    assert (tmp_path / "link").is_symlink() and (tmp_path / "real").read_text() == "after"


def test_devices_are_written_to(tmp_path):
    (tmp_path / "full").symlink_to("/dev/full")
    raises(dpd.OutputError, "No space left on device.*free some space", lambda: write_whole(tmp_path / "full", "x", "the report"))
    write_whole("/dev/null", "x", "the report")


def test_blocks_are_whole(tmp_path):
    path = tmp_path / "blocks"
    with BlockFile(path, "the file") as file, file_limit(1000):
        file.write("a" * 900)
        raises(dpd.OutputError, "the file .*blocks cannot be written", lambda: file.write("b" * 900))
        file.write("c" * 50)
    append_block(path, "d", "the file")
    assert path.read_text() == "a" * 900 + "c" * 50 + "d"
    append_block(path, "e", "the file", anew=True)
    assert path.read_text() == "e"


@cases("box", np.diag([3.0, 4.0, 5.0]), np.array([[4.0, 0, 0], [1.5, 4.0, 0], [-1.0, 0.7, 4.5]]), ids=["ortho", "tilted"])
def test_trajectories_are_those_of_mdtraj_and_whole_after_a_failure(tmp_path, box):
    frames = np.random.default_rng(3).random((4, 50, 3)) * 30
    writer = DCDWriter(tmp_path / "ours.dcd", 50, "the trajectory")
    for frame in frames[:3]:
        writer.write(frame, 10 * box)
    with file_limit((tmp_path / "ours.dcd").stat().st_size + 300), pytest.raises(dpd.OutputError, match="the trajectory"):
        writer.write(frames[3], 10 * box)
    writer.close()
    with mdtraj.formats.DCDTrajectoryFile(str(tmp_path / "ours.dcd")) as file:
        positions, lengths, angles = file.read()
    np.testing.assert_array_equal(positions, frames[:3].astype(np.float32))
    trajectory = mdtraj.Trajectory(positions / 10, None, unitcell_lengths=lengths / 10, unitcell_angles=angles)
    np.testing.assert_allclose(trajectory.unitcell_vectors, [box] * 3, atol=2e-6)
    # readers that trust the header find the frames that are there
    assert struct.unpack("<i", (tmp_path / "ours.dcd").read_bytes()[8:12]) == (3,)
    with mdtraj.formats.DCDTrajectoryFile(str(tmp_path / "theirs.dcd"), "w") as file:
        file.write(positions, lengths, angles)
    ours, theirs = ((tmp_path / name).read_bytes() for name in ("ours.dcd", "theirs.dcd"))
    assert len(ours) == len(theirs) and ours[-600:] == theirs[-600:]


def test_frames_of_fields_before_a_failure_stay(tmp_path):
    writer = FieldWriter(tmp_path / "fields.npz")
    values = np.random.default_rng(4).random((3, 400))
    writer.write(0.0, 0, {"theta": values[0]})
    writer.write(0.1, 1, {"theta": values[1]})
    with file_limit((tmp_path / "fields.npz").stat().st_size + 500), pytest.raises(dpd.OutputError, match="the file of fields"):
        writer.write(0.2, 2, {"theta": values[2]})
    np.testing.assert_array_equal(load_fields(tmp_path / "fields.npz")["theta"], values[:2])
    writer.write(0.2, 2, {"theta": values[2]})
    np.testing.assert_array_equal(load_fields(tmp_path / "fields.npz")["theta"], values)


@pytest.mark.parametrize("kind", ["State", "Checkpoint"])
def test_states_and_checkpoints_before_a_failure_stay(tmp_path, kind):
    x = np.random.default_rng(5).random((100, 3)) * 4
    scene = dpd.Scene({"W": 1.0}, ["W"] * 100, x, {("W", "W"): dpd.DPD(A=25, gamma=4.5)}, kT=1.0, box=[4.0] * 3)
    simulation = dpd.build(scene, dt=0.02, platform="Reference", seed=1).simulation()
    save, load = (getattr(simulation, f"{word}{kind}") for word in ("save", "load"))
    save(str(tmp_path / "kept"))
    simulation.step(3)
    with file_limit(1000), pytest.raises(dpd.OutputError, match=f"the {kind.lower()} .*kept cannot be written"):
        save(str(tmp_path / "kept"))
    assert [path.name for path in tmp_path.iterdir()] == ["kept"]
    load(str(tmp_path / "kept"))
    assert simulation.context.getStepCount() == 0
