"""Files of a run that is killed are put back to what they were at its checkpoint."""

from pathlib import Path

import mdtraj
import numpy as np
import pytest
from cases import raises

from openmm_dpd.base.errors import OutputError
from openmm_dpd.base.file_ledger import FileLedger
from openmm_dpd.base.files import BlockFile, append_block, write_whole
from openmm_dpd.io.dcd import DCDWriter
from openmm_dpd.io.xtc import XTCWriter
from openmm_dpd.simulation.field_file import FieldWriter, load_fields

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
    assert found == {
        "grows": "one\n",
        "again": "2\n",  # the run begins it anew once more
        "old": "of before\none\n",
        "other": "of before\n",
        "whole": "two",
    }
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
    raises(OutputError, "grows has 1 bytes, and had 4 at the checkpoint", lambda: ledger_of(tmp_path).put_back(lengths))
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
