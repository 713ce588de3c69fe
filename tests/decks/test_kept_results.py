"""Runs of decks that cannot go on, or cannot write: one clear line, and what was computed is kept."""

import json
import os
import signal
import subprocess
import sys
from contextlib import nullcontext
from pathlib import Path

import numpy as np
import openmm
import pytest
from cases import cases, put
from fluid_deck import FLUID
from full_disk import file_limit, small_disk

import openmm_dpd as dpd
from openmm_dpd import trajectory
from openmm_dpd.__main__ import main
from openmm_dpd.lammps import RunOptions, run_deck
from openmm_dpd.simulation.built import DPDSimulation

_LINES = "dump d all atom 10 dump.d\nfix mean all ave/time 5 2 10 c_thermo_temp file mean.txt\nrun 200\n"
WRITING = FLUID.replace("run 50\nrun 30\n", _LINES)  # Rows, a dump and an average every ten steps.


@pytest.fixture
def deck(tmp_path: Path) -> Path:
    return put(tmp_path / "in.fluid", WRITING)


def arguments(deck: Path, out: Path, *more: str) -> list[str]:
    return ["run", str(deck), "--platform", "CPU", "--threads", "1", "--out", str(out), "--json", str(deck.parent / "report.json"), *more]


def no_traces(folder: Path) -> bool:
    return not [path for path in folder.rglob("*") if "tmp" in path.name]


def test_a_trajectory_that_finds_no_space_ends_the_run_and_costs_nothing(deck, capsys, caplog):
    """At 30 kB: topology and averages fit, two dumps and a dozen frames; the final state and the picture do not."""
    out = deck.parent / "out"
    assert main(arguments(deck, deck.parent / "before", "--steps", "20")) == 0  # what has to be compiled is kept now
    capsys.readouterr()
    caplog.clear()
    with file_limit(30_000):
        assert main(arguments(deck, out, "--every", "2")) == 1
    error = capsys.readouterr().err
    said = f"{deck}:23: the run stopped: the trajectory {out}/trajectory.dcd cannot be written (File too large); "
    assert f"openmm-dpd: error: {said}" in error
    assert error.count("\n") == 1
    said = [record.getMessage().split(" ", 2)[1] for record in caplog.records if "cannot be written" in record.getMessage()]
    assert said == ["state", "picture"]
    report = json.loads((deck.parent / "report.json").read_text())
    frames = trajectory.load(out / "trajectory.dcd", out / "topology.psf")
    assert report["steps"] // 2 == len(frames) > 5  # the row of a step comes before its frame
    assert no_traces(deck.parent)


@cases(
    "name, line, steps, what",
    ("dump.d", 23, None, "the run stopped: the file of dump d, {out}/dump.d cannot be written (Is a directory)"),
    ("mean.txt", 22, None, "the file of averages {out}/mean.txt cannot be written (Is a directory)"),
    ("said", 24, 20, "the file of print {out}/said cannot be written (Is a directory)"),
    ("data", 25, 20, "the data file {out}/data cannot be written (Is a directory)"),
    ("trajectory.dcd", 23, None, "the run stopped: the trajectory {out}/trajectory.dcd cannot be written (Is a directory)"),
    ("topology.psf", 23, None, "the run stopped: the topology {out}/topology.psf cannot be written (Is a directory)"),
    ("final_state.xml", 23, 20, "the run stopped: the state {out}/final_state.xml cannot be written (Is a directory)"),
    ("thermo.png", None, 20, "the picture {out}/thermo.png cannot be written (Is a directory)"),
)
def test_each_file_that_cannot_be_written_has_one_line(deck, capsys, name, line, steps, what):
    out = put(deck, WRITING.replace("run 200", "run 20\nprint done file said\nwrite_data data")).parent / "out"
    (out / name).mkdir(parents=True)
    assert main(arguments(deck, out, "--quiet")) == 1
    place = "" if line is None else f"{deck}:{line}: "
    assert f"openmm-dpd: error: {place}{what.format(out=out)}; write elsewhere\n" in capsys.readouterr().err
    assert no_traces(deck.parent)
    # what was measured before is there
    found = json.loads((deck.parent / "report.json").read_text())["steps"] if (deck.parent / "report.json").exists() else None
    assert found == steps


def test_a_full_disk_is_named(deck, capsys):
    """A real one, where a mount is allowed: the pictures find no space, all else is complete."""
    out = deck.parent / "out"
    with small_disk(out, 1000):
        (out / "ballast").write_bytes(bytes(780 * 1024))
        assert main(arguments(deck, out, "--quiet", "--steps", "20")) == 1
        assert (out / "final_state.xml").stat().st_size > 50_000 and no_traces(out)
    error = capsys.readouterr().err
    reason = "cannot be written (No space left on device); free some space there, or write elsewhere"
    assert error == f"openmm-dpd: error: the picture {out}/thermo.png {reason}; the picture {out}/beads.png {reason}\n"
    report = json.loads((deck.parent / "report.json").read_text())
    assert report["stopped"] is None and report["steps"] == 20


def test_results_that_find_no_space_at_the_end_go_to_standard_output(deck, capsys):
    (deck.parent / "report.json").symlink_to("/dev/full")
    out = deck.parent / "out"
    assert main(arguments(deck, out, "--quiet", "--steps", "20")) == 1
    printed = capsys.readouterr()
    assert printed.err.startswith(f"openmm-dpd: error: --json: {deck.parent}/report.json cannot be written (No space left on device)")
    assert "standard output" in printed.err and printed.err.count("\n") == 1
    assert json.loads(printed.out)["steps"] == 20
    assert (out / "thermo.png").exists() and (out / "final_state.xml").exists()


def test_runs_before_the_one_that_fails_are_kept(deck, capsys):
    """The second run flies apart: the first one is complete, and of the second the state before it failed."""
    deck.write_text(WRITING.replace("run 200", "run 100\ntimestep 3.0\nrun 100"))
    assert main(arguments(deck, deck.parent / "out", "--quiet")) == 1
    assert "in.fluid:25: the run stopped: " in capsys.readouterr().err
    report = json.loads((deck.parent / "report.json").read_text())
    assert report["runs"][0]["steps"] == 100 and report["runs"][0]["stopped"] is None
    assert report["runs"][1]["steps"] < 100 and "after step 1" in report["runs"][1]["stopped"]
    assert np.all(np.isfinite(dpd.load_xml(deck.parent / "out" / "final_state.xml").getPositions(asNumpy=True)._value))


@cases("after", "", "timestep 3.0\nrun 100\n", "pair_style nonsense\n", ids=["all", "the next one fails", "the deck is wrong"])
def test_among_short_runs_the_state_is_written_rarely_but_always_at_the_end(deck, monkeypatch, after):
    """Of the last step taken, that of the run before the one that failed in its first step, or the last one before a wrong line."""
    monkeypatch.setattr("openmm_dpd.lammps.run.trajectory.SELDOM", 1e9)
    writes, save = list[Path](), DPDSimulation.saveState
    monkeypatch.setattr(DPDSimulation, "saveState", lambda self, path: (writes.append(path), save(self, path)))
    deck.write_text(WRITING.replace("run 200", "run 10\nrun 20\nrun 7\n" + after))
    with pytest.raises(dpd.DPDError) if after else nullcontext():
        run_deck(deck, RunOptions(platform="CPU", threads=1), out=deck.parent / "out")
    state = dpd.load_xml(deck.parent / "out" / "final_state.xml")
    assert len(writes) == 2 and state.getStepCount() == (0 if "3.0" in after else 7)


def test_an_average_that_cannot_be_computed_is_null_with_a_reason(tmp_path):
    """Two beads meet for a moment: the Laplacian is 0 in all blocks of rows but one."""
    pair = "create_atoms 1 single 1 1 1 units box\ncreate_atoms 1 single 1.9 1.1 1.03 units box\nset atom 2 vx 1.5\n"
    text = FLUID.replace("create_atoms 1 random 100 4243 box\ncreate_atoms 2 random 92 4244 box\n", pair)
    text = text.replace("velocity all create 1.0 87287\n", "").replace("thermo 10", "thermo 20").replace("run 50\nrun 30", "run 100")
    report = run_deck(put(tmp_path / "in.dilute", text), RunOptions(platform="Reference", threads=1), out=tmp_path / "out")
    conf = report["thermo"]["temp_conf"]
    assert conf["sem"] is None and conf["mean"] > 0 and "in all blocks of rows but one" in report["temp_conf_reason"]
    assert (tmp_path / "out" / "thermo.png").exists()


@pytest.mark.skipif(os.name == "nt", reason="Windows has no such signals for other processes")
@pytest.mark.parametrize(
    ("number", "status", "scheme", "platform"),
    [pytest.param(signal.SIGINT, 130, "mvv", "Reference", marks=pytest.mark.slow), (signal.SIGTERM, 143, "shardlow", "CPU")],
    ids=["SIGINT", "SIGTERM"],
)
def test_a_run_that_is_asked_to_end_keeps_what_is_there(deck, number, status, scheme, platform):
    out = deck.parent / "out"
    chosen = ["--platform", platform, "--scheme", scheme, "--steps", "100000000"]
    command = [sys.executable, "-m", "openmm_dpd.__main__", *arguments(deck, out, *chosen)]
    with subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True) as process:
        rows = (line for line in process.stdout if line.split()[:1] == ["100"])
        assert next(rows, None) is not None
        process.send_signal(number)
        _, error = process.communicate()
    assert process.returncode == status and "Traceback" not in error
    report = json.loads((deck.parent / "report.json").read_text())
    taken = report["steps"]
    text = f"interrupted by {number.name} after step {taken} of 100000000"
    assert report["stopped"] == text and taken >= 100
    said = f"{text}; results so far are in {out}/; continue with: openmm-dpd run {deck} --restart {out}"
    assert error.splitlines()[-1] == f"openmm-dpd: {said}"
    dump = (out / "dump.d").read_text().split("ITEM: TIMESTEP\n")[1:]
    assert len(dump) == taken // 10 + 1 and all(len(frame.splitlines()) == 8 + 192 for frame in dump)
    rows = np.loadtxt(out / "mean.txt", ndmin=2)
    assert rows[-1, 0] == taken - taken % 10 == report["averages"]["mean"]["step"] == report["thermo"]["step"]["last"]
    assert len(trajectory.load(out / "trajectory.dcd", out / "topology.psf")) == 1
    state = openmm.XmlSerializer.deserialize((out / "final_state.xml").read_text())
    assert state.getStepCount() == taken and (out / "thermo.png").stat().st_size > 0
    assert no_traces(deck.parent)
