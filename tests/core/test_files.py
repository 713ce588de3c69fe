"""Files are written whole, or by whole blocks, or not at all; those of a run that is killed are put back to what they were at its checkpoint."""

import struct
from pathlib import Path

import mdtraj
import numpy as np
import pytest
from cases import cases, raises
from full_disk import file_limit
from scenes import beads

import openmm_dpd as dpd
from openmm_dpd.base.errors import OutputError
from openmm_dpd.base.file_ledger import FileLedger
from openmm_dpd.base.files import BlockFile, append_block, write_whole
from openmm_dpd.io.dcd import DCDWriter
from openmm_dpd.io.xtc import XTCWriter
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


def test_links_stay_links_and_devices_are_written_to(tmp_path):
    (tmp_path / "real").write_text("before")
    (tmp_path / "link").symlink_to(tmp_path / "real")
    write_whole(tmp_path / "link", b"after", "the report")
    assert (tmp_path / "link").is_symlink() and (tmp_path / "real").read_text() == "after"
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


def test_frames_of_fields_of_earlier_versions_are_read_and_go_on(tmp_path):
    """They had a member of the archive for each array of a frame."""
    frames = [{"time": np.float64(k), "step": np.int64(k), "theta": np.full(3, k)} for k in range(3)]
    np.savez(tmp_path / "fields.npz", **{f"{name}/{k:08d}": values for k in (0, 1) for name, values in frames[k].items()})
    FieldWriter(tmp_path / "fields.npz", append=True).write(2.0, 2, {"theta": frames[2]["theta"]})
    for name, values in load_fields(tmp_path / "fields.npz").items():
        np.testing.assert_array_equal(values, [frame[name] for frame in frames])


@pytest.mark.parametrize("kind", ["State", "Checkpoint"])
def test_states_and_checkpoints_before_a_failure_stay(tmp_path, kind):
    scene = beads(100, seed=5, edge=4.0)
    simulation = dpd.build(scene, dt=0.02, platform="Reference", seed=1).simulation()
    save, load = (getattr(simulation, f"{word}{kind}") for word in ("save", "load"))
    save(str(tmp_path / "kept"))
    simulation.step(3)
    with file_limit(1000), pytest.raises(dpd.OutputError, match=f"the {kind.lower()} .*kept cannot be written"):
        save(str(tmp_path / "kept"))
    assert [path.name for path in tmp_path.iterdir()] == ["kept"]
    load(str(tmp_path / "kept"))
    assert simulation.context.getStepCount() == 0


BOX = np.diag([3.0, 4.0, 5.0])


def ledger_of(folder: Path) -> FileLedger:
    return FileLedger(folder, folder / "checkpoint" / "files")


def test_what_came_after_a_checkpoint_is_taken_back(tmp_path):
    """Files that grew, were begun anew, were written whole, are new, and one that was there before the run."""
    for name in ("old", "other"):
        (tmp_path / name).write_text("of before\n", encoding="utf-8")
    ledger = ledger_of(tmp_path)
    with ledger.in_use():
        append_block(tmp_path / "grows", "one\n", "x")
        append_block(tmp_path / "again", "one\n", "x")
        append_block(tmp_path / "old", "one\n", "x")
        write_whole(tmp_path / "whole", "one", "x")
        lengths = ledger.lengths()
        append_block(tmp_path / "grows", "two\n", "x")
        append_block(tmp_path / "again", "2\n", "x", anew=True)
        append_block(tmp_path / "old", "two\n", "x")
        append_block(tmp_path / "other", "two\n", "x")
        append_block(tmp_path / "new", "two\n", "x")
        write_whole(tmp_path / "whole", "two", "x")
    killed = ledger_of(tmp_path)
    killed.put_back(lengths)
    found = {path.name: path.read_text(encoding="utf-8") for path in tmp_path.iterdir() if path.is_file()}
    # "again" is begun anew by the run once more
    assert found == {"grows": "one\n", "again": "2\n", "old": "of before\none\n", "other": "of before\n", "whole": "two"}
    assert killed.lengths().keys() == lengths.keys()
    for again in (lengths, killed.lengths()):  # and once more, with nothing in between
        ledger_of(tmp_path).put_back(again)
    assert (tmp_path / "grows").read_text(encoding="utf-8") == "one\n"


def test_files_that_lack_what_they_had_are_refused(tmp_path):
    ledger = ledger_of(tmp_path)
    with ledger.in_use():
        append_block(tmp_path / "grows", "one\n", "x")
    lengths = ledger.lengths()
    (tmp_path / "grows").write_text("o", encoding="utf-8")
    raises(OutputError, "grows has 1 bytes, but had 4 at the checkpoint", lambda: ledger_of(tmp_path).put_back(lengths))
    (tmp_path / "grows").unlink()
    raises(OutputError, "has 0 bytes", lambda: ledger_of(tmp_path).put_back(lengths))


def test_nothing_is_written_while_replaying(tmp_path):
    (tmp_path / "file").write_text("kept", encoding="utf-8")
    ledger = ledger_of(tmp_path)
    ledger.replaying = True
    with ledger.in_use():
        write_whole(tmp_path / "file", "else", "x")
        append_block(tmp_path / "file", "else", "x", anew=True)
        with BlockFile(tmp_path / "file", "x") as file:
            file.write("else")
            file.replace(0, b"else")
            ledger.replaying = False
            file.write(" and goes on")
    assert (tmp_path / "file").read_text(encoding="utf-8") == "kept and goes on"


@pytest.mark.parametrize("form", ["dcd", "xtc", "npz"])
def test_trajectories_and_fields_lose_frames_and_get_others(tmp_path, form):
    """The count in the header of a DCD file and the directory at the end of an archive are put back as well."""
    path, frames = tmp_path / f"file.{form}", np.random.default_rng(3).random((5, 20, 3))

    def opened(append: bool):
        if form == "npz":
            return FieldWriter(path, append=append)
        return {"dcd": DCDWriter, "xtc": XTCWriter}[form](path, 20, "the file", append=append)

    def write(writer, number: int) -> None:
        if form == "npz":
            writer.write(float(number), number, {"u": frames[number, :, 0]})
        elif form == "xtc":
            writer.write(frames[number], BOX, float(number), number)
        else:
            writer.write(10 * frames[number], 10 * BOX)

    def close(writer) -> None:
        if form != "npz":
            writer.close()

    ledger = ledger_of(tmp_path)
    with ledger.in_use():
        writer = opened(append=False)
        write(writer, 0)
        write(writer, 1)
        lengths = ledger.lengths()
        write(writer, 4)
        close(writer)
    killed = ledger_of(tmp_path)
    killed.put_back(lengths)
    with killed.in_use():
        writer = opened(append=True)
        for number in (2, 3):
            write(writer, number)
        close(writer)
    if form == "npz":
        assert np.array_equal(load_fields(path)["u"], frames[:4, :, 0])
    else:
        np.testing.assert_allclose(mdtraj.load(path, top=mdtraj.Topology.from_openmm(_topology())).xyz, frames[:4], atol=6e-4)


def _topology():
    from openmm import app

    topology = app.Topology()
    chain = topology.addChain()
    for _ in range(20):
        topology.addAtom("A", app.element.argon, topology.addResidue("A", chain))
    return topology


def test_xtc_files_of_few_beads(tmp_path):
    """Up to nine beads are stored without compression."""
    for n in (1, 9, 10):
        path, positions = tmp_path / f"{n}.xtc", np.random.default_rng(n).random((n, 3))
        writer = XTCWriter(path, n, "the trajectory")
        for step in (0, 5):
            writer.write(positions + step, BOX, 0.1 * step, step)
        writer.close()
        with mdtraj.open(str(path)) as file:
            xyz, time, step, box = file.read()
        np.testing.assert_allclose(xyz, [positions, positions + 5], atol=6e-4)
        assert time.tolist() == [0.0, 0.5] and step.tolist() == [0, 5]
        np.testing.assert_allclose(box, [BOX, BOX], atol=1e-6)
