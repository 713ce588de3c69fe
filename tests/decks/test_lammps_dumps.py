"""Dump styles xtc and xyz: what other programs read from them; the fuzzer compares the text of xyz with LAMMPS's."""

from pathlib import Path

import mdtraj
import numpy as np
import pytest
from cases import put, raises
from mdtraj.formats import XTCTrajectoryFile

from openmm_dpd.base.errors import DeckError, RunError
from openmm_dpd.lammps import RunOptions, read_deck, run_deck

BEADS = """units {units}
region b prism 0 20 1 21 0 22 3 0 2 units box
create_box 2 b
create_atoms 1 random 14 5 NULL
create_atoms 2 random 6 6 NULL
mass * 40
group g type 2
pair_style zero 5
pair_coeff * *
velocity all set 0.05 -0.08 0.11 units box
fix 1 all nve
timestep 40
dump t all custom 2 all.txt id type x y z xu yu zu
dump_modify t format float %.10g
"""


def run(folder: Path, units: str, text: str) -> np.ndarray:
    """(frames, beads, 8) columns of the text dump."""
    run_deck(put(folder / "in", BEADS.format(units=units) + text + "run 5\n"), RunOptions(platform="Reference"), out=folder)
    frames = (folder / "all.txt").read_text().split("ITEM: ATOMS")[1:]
    return np.array([[line.split() for line in frame.splitlines()[1:21]] for frame in frames], float)


@pytest.mark.parametrize(("units", "length", "time"), [("real", 0.1, 0.001), ("lj", 1.0, 1.0)])
def test_xtc(tmp_path, units, length, time):
    """In nm and ps but for units lj, of all beads or of a group, wrapped or not, to the precision of the format."""
    rows = run(tmp_path, units, "dump a all xtc 2 a.xtc\ndump_modify a unwrap yes sort id precision 1000\ndump b g xtc 4 b.xtc\n")
    with XTCTrajectoryFile(str(tmp_path / "a.xtc")) as file:
        x, times, steps, box = file.read()
    np.testing.assert_allclose(x, length * rows[:, :, 5:], atol=6e-4)
    np.testing.assert_allclose(times, time * 40 * np.array([0, 2, 4]), rtol=1e-6)
    assert steps.tolist() == [0, 2, 4]
    np.testing.assert_allclose(box[0], length * np.array([[20, 0, 0], [3, 20, 0], [0, 2, 22]]), atol=1e-6)
    with XTCTrajectoryFile(str(tmp_path / "b.xtc")) as file:
        x = file.read()[0]
    np.testing.assert_allclose(x, length * rows[::2, 14:, 2:5], atol=6e-4)


def test_factors_of_xtc(tmp_path):
    rows = run(tmp_path, "real", "dump a all xtc 5 a.xtc\ndump_modify a sfactor 0.5 tfactor 2\n")
    with XTCTrajectoryFile(str(tmp_path / "a.xtc")) as file:
        x, times, _, box = file.read()
    np.testing.assert_allclose(x[0], 0.5 * rows[0, :, 2:5], atol=6e-4)
    assert times.tolist() == [0, 400] and box[0, 2, 2] == 11


@pytest.mark.parametrize("group", ["all", "g"])
@pytest.mark.parametrize("precision", [10, 100, 10000])
def test_precision_of_xtc(tmp_path, precision, group):
    """As far apart as LAMMPS's for mdtraj, which reads it from the frame; of up to nine beads the format holds all digits."""
    rows = run(tmp_path, "lj", f"dump a {group} xtc 5 a.xtc\ndump_modify a precision {precision}\n")
    with XTCTrajectoryFile(str(tmp_path / "a.xtc")) as file:
        x, _, _, box = file.read()
    places = rows[0, :, 2:5] if group == "all" else rows[0, 14:, 2:5]
    slack = 3e-6  # of single precision
    np.testing.assert_allclose(x[0], places, atol=slack + (0.5 / precision if group == "all" else 0))
    if group == "all":
        np.testing.assert_allclose(x[0], np.round(x[0] * precision) / precision, atol=slack)
    assert box[0, 2, 2] == 22


def test_xtc_with_a_position_too_large_for_its_precision(tmp_path):
    with pytest.raises(RunError, match="beyond 2147 nm does not fit into an XTC file of precision 1000000"):
        run(tmp_path, "lj", "dump a all xtc 5 a.xtc\ndump_modify a precision 1000000 sfactor 1000\n")


def test_xyz(tmp_path):
    """Names of the elements, and what mdtraj reads of it (in angstrom)."""
    text = "dump a all xyz 2 a.xyz\ndump_modify a element C O format line '%s %.6f %.6f %.6f'\n"
    rows = run(tmp_path, "real", text + "dump b g xyz 5 b.*.xyz\n")
    np.testing.assert_allclose(mdtraj.formats.XYZTrajectoryFile(str(tmp_path / "a.xyz")).read(), rows[:, :, 2:5], atol=1e-5)
    assert [line.split()[0] for line in (tmp_path / "a.xyz").read_text().splitlines()[2:22]] == 14 * ["C"] + 6 * ["O"]
    assert sorted(path.name for path in tmp_path.glob("b.*")) == ["b.0.xyz", "b.5.xyz"]
    assert (tmp_path / "b.5.xyz").read_text().splitlines()[:3][1] == " Atoms. Timestep: 5"


WRONG = {
    "dump a all custom 2 a.txt id mol\n": "mol needs atom_style bond or angle or molecular or full, but the deck has atom_style atomic",
    "dump a all custom 2 a.txt id q\n": "q needs atom_style charge or full",
    "compute a all property/atom type q\n": "q needs atom_style",
    "variable a atom mol\ndump a all custom 2 a.txt id v_a\n": "mol needs atom_style",
    'variable a equal q[1]\nprint "${a}"\n': "q needs atom_style",
    'variable a equal charge(all)\nprint "${a}"\n': "q needs atom_style",
    "dump a all xtc 2 a.*.xtc\n": "all frames go into one file",
    "dump a all dcd 2 a.*.dcd\n": "all frames go into one file",
    "dump a all xtc 2 a.xtc\ndump_modify a precision 50\n": "must be one of 10, 100, 1000, 10000, 100000, 1000000, not 50",
    "dump a all xtc 2 a.xtc\ndump_modify a append yes\n": "LAMMPS overwrites xtc files",
    "dump a all dcd 2 a.dcd\ndump_modify a append yes\n": "LAMMPS overwrites dcd files",
    "dump a all xtc 2 a.xtc\ndump_modify a sfactor 0\n": "sfactor must be > 0",
    "dump a all xtc 2 a.xtc\ndump_modify a sort off\n": "dump xtc is sorted by id",
    "dump a all xyz 2 a.xyz\ndump_modify a precision 100\n": "precision is for dump style xtc",
    "dump a all xyz 2 a.xyz\ndump_modify a thresh x < 1\n": "thresh",
    "dump a all xyz 2 a.xyz\ndump_modify a element C\n": "needs 2 values",
    "dump a all xyz 2 a.xyz\ndump_modify a unwrap yes\n": "unwrap is for dump style dcd and xtc",
    "dump a all xyz 2 a.xyz\ndump_modify a format line '%s %g %g'\n": "style xyz expects a line such as",
    "dump a all atom 2 a.txt\ndump_modify a element C O\n": "element is for dump style xyz",
    "dump_modify t sfactor 2\n": "sfactor is for dump style xtc",
}


@pytest.mark.parametrize("text", WRONG)
def test_mistakes(tmp_path, text):
    raises(DeckError, WRONG[text], run, tmp_path, "real", text)


def test_a_deck_that_is_only_looked_at_leaves_the_files_of_its_runs_alone(tmp_path):
    """explain and deck_scene read decks as well."""
    text = (
        "region b block 0 3 0 3 0 3\ncreate_box 1 b\nmass 1 1\ncreate_atoms 1 single 1 1 1 units box\npair_style zero 1\npair_coeff * *\n"
    )
    text += "fix 1 all nve\nfix p all print 5 x file p.txt\nfix t all ave/time 1 1 1 c_thermo_temp file t.txt\n"
    text += "fix c all ave/correlate 1 1 1 c_thermo_temp file c.txt\ndump a all xyz 1 a.xyz\ndump b all dcd 1 b.dcd\nrun 1\n"
    (tmp_path / "in.deck").write_text(text)
    for name in ("p.txt", "t.txt", "c.txt", "a.xyz", "b.dcd"):
        (tmp_path / name).write_text("of an earlier run")
    read_deck(tmp_path / "in.deck", stop_before_first_run=True, output=tmp_path)
    assert {path.read_text() for path in tmp_path.iterdir() if path.name != "in.deck"} == {"of an earlier run"}
