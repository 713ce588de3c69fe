"""Restart files of decks: a deck that reads one goes on bit for bit as the one that has written it."""

from pathlib import Path

import lammps_peer
import pytest
from cases import cases, put, raises
from test_lammps_moving import chains

from openmm_dpd.base.errors import DeckError
from openmm_dpd.lammps import RunOptions, run_deck

SYSTEMS = {  # How beads are made and what moves them, which a restart file does not hold.
    "dpd": (
        "units real\nregion b prism 0 20 1 21 0 22 3 0 2 units box\ncreate_box 2 b\ncreate_atoms 1 random 60 5 NULL\n"
        "create_atoms 2 random 30 6 NULL\nmass 1 40\nmass 2 60\ngroup ga id 1:20\n"
        "pair_style dpd 300 5 11\npair_coeff * * 2 0.01\npair_coeff 1 2 3 0.02 4.5\nvelocity all create 300 3\ntimestep 20\n",
        "fix 1 all nve\nfix p ga addforce 0.001 0 0\n",
    ),
    "adapted": (
        "lattice sc 3\nregion b block 0 4 0 4 0 4 units box\ncreate_box 1 b\ncreate_atoms 1 random 80 5 NULL\nmass 1 1\n"
        "pair_style hybrid/overlay soft 1.1 dpd 0.5 1 7 soft 1\npair_coeff * * soft 1 1\npair_coeff * * soft 2 1\npair_coeff * * dpd 20 4.5\n"
        "velocity all create 1 3\ntimestep 0.02\n",
        "variable a equal 10/3+step\nfix 1 all nve\nfix a all adapt 2 pair soft:2 a * * v_a pair dpd a0 * * v_a\n",
    ),
    "chains": (
        "atom_style molecular\nspecial_bonds lj 0.5 0.25 1\nbond_style harmonic\nangle_style harmonic\nread_data start.data\n"
        "mass 1 1\nbond_coeff 1 30 0.7\nangle_coeff 1 4 150\npair_style dpd 1.0 1.0 7\npair_coeff 1 1 25 4.5\ntimestep 0.01\n",
        "fix 1 all nve\n",
    ),
    "energy": (
        "atom_style dpd\nregion b block 0 4 0 4 0 4\ncreate_box 1 b\ncreate_atoms 1 random 80 5 NULL\nmass 1 1\nset atom * dpd/theta 1\n"
        "pair_style dpd/fdt/energy 1 9\npair_coeff 1 1 25 3 0.5 1\nvelocity all create 1 3\ntimestep 0.02\n",
        "fix e all eos/cv 10\nfix s all shardlow\nfix 1 all nve\n",
    ),
    "species": (
        "atom_style tdpd 2\nregion b block 0 4 0 4 0 4\ncreate_box 1 b\ncreate_atoms 1 random 80 5 NULL\nmass 1 1\n"
        "set atom 1*40 cc 1 2.0\nset atom 30*70 cc 2 1.0\npair_style tdpd 1 1 7\n"
        "pair_coeff 1 1 25 4.5 0.5 1 1 0.1 0 2 0.2 0 2\nvelocity all create 1 3\ntimestep 0.02\n",
        "fix 1 all mvv/tdpd\n",
    ),
}
BOX = "region b block 0 4 0 4 0 4\ncreate_box 1 b\ncreate_atoms 1 random 80 5 NULL\nmass 1 1\npair_style dpd 1 1 7\npair_coeff 1 1 25 4.5\n"
SYSTEMS |= {  # What these fixes keep is in the file, for fixes of the same id and style.
    "nvt": (SYSTEMS["chains"][0], "fix 1 all nvt temp 0.5 0.5 0.2\n"),
    "npt": (BOX + "velocity all create 1 3\ntimestep 0.02\n", "fix 1 all npt temp 1 1 0.2 iso 20 20 1.0\n"),
    "baths": (SYSTEMS["chains"][0], "fix 1 all nve\nfix 2 all temp/berendsen 1 1 0.3\nfix 3 all temp/rescale 2 1 1 0.02 0.7\n"),
}
ROWS = "thermo 2\nthermo_style custom step time temp pe press vol ecouple\nthermo_modify format float %.17g\n"


def rows(folder: Path, name: str, text: str, platform: str = "Reference") -> list[str]:
    """Rows of thermo output of a deck; its last configuration is in ``NAME.data``."""
    put(folder / "start.data", chains())
    lines = lammps_peer.printed(folder / f"in.{name}", text + f"write_data {name}.data\nrun 0\n", platform=platform)
    return [line for line in lines if line.split()[:1] and line.split()[0].isdigit()]


@pytest.mark.parametrize("platform", ["Reference", "CPU"])
@cases("start, fixes", SYSTEMS)
def test_runs_go_on_bit_for_bit(tmp_path, start, fixes, platform):
    """From write_restart between two runs, and from restart N in the middle of one: as the second of two runs."""
    whole = rows(tmp_path, "whole", f"{start}{fixes}{ROWS}run 6\nwrite_restart between.*\nrun 6\n", platform)
    after = rows(tmp_path, "after", f"read_restart between.6\n{fixes}{ROWS}run 6\n", platform)
    assert after == whole[4:] and len(after) == 5
    rows(tmp_path, "long", f"{start}{fixes}{ROWS}restart 6 point\nrun 10\n", platform)
    assert rows(tmp_path, "middle", f"read_restart point.6\n{fixes}{ROWS}run 6\n", platform) == after
    for other in ("point.5", "point.7x", "point.", "apoint.8"):
        (tmp_path / other).write_text("not the last\n", encoding="utf-8")
    assert rows(tmp_path, "star", f"read_restart point.*\n{fixes}{ROWS}run 6\n", platform) == after
    last = [(tmp_path / f"{name}.data").read_bytes() for name in ("whole", "after", "middle")]
    assert last[0] == last[1] == last[2]


def test_groups_masses_and_types_come_back_and_fixes_do_not(tmp_path):
    start, fixes = SYSTEMS["dpd"]
    rows(tmp_path, "first", f"{start}{fixes}run 2\nwrite_restart r\n")
    path = put(tmp_path / "in.second", "read_restart r\nprint '$(count(ga)) $(mass(all)) $(step) $(dt)'\nfix 1 all nve\nrun 0\n")
    lines: list[str] = []
    state = run_deck(path, RunOptions(platform="Reference"), out=tmp_path, log=lines.append)
    assert "20 4200 2 20" in lines and state["natoms"] == 90


def test_two_files_in_turn_and_no_more(tmp_path):
    start, fixes = SYSTEMS["chains"]
    rows(tmp_path, "turns", f"{start}{fixes}restart 2 a b\nrun 5\nrestart 0\nrun 5\n")
    found = {name: rows(tmp_path, f"from_{name}", f"read_restart {name}\n{fixes}run 0\n") for name in ("a", "b")}
    assert [found[name][0].split()[0] for name in ("a", "b")] == ["2", "4"]
    assert sorted(path.name for path in tmp_path.glob("[ab]")) == ["a", "b"]


def test_files_of_each_step_beside_two_in_turn(tmp_path):
    start, fixes = SYSTEMS["chains"]
    rows(tmp_path, "both", f"{start}{fixes}restart 2 r\nrestart 3 a b\nrun 9\nrestart 0\nrun 5\n")
    assert sorted(path.name for path in [*tmp_path.glob("[ab]"), *tmp_path.glob("r.*")]) == ["a", "b", "r.2", "r.4", "r.6", "r.8"]
    steps = {name: rows(tmp_path, f"from_{name}", f"read_restart {name}\n{fixes}run 0\n")[0].split()[0] for name in ("a", "b", "r.6")}
    assert steps == {"a": "9", "b": "6", "r.6": "6"}


WRONG = {
    "read_restart text\n": "is not a restart file of this package",
    "read_restart r.*\n": "there is no file 'r..' with a number in the place of",
    "read_restart nothing\n": "there is no file 'nothing'",
    "region b block 0 4 0 4 0 4\ncreate_box 1 b\nread_restart text\n": "must come before the simulation box",
    "write_restart r\n": "needs a simulation box",
    "restart 10\n": "expected 'restart N file",
    "restart 10 ../../r\n": "would lie outside the output folder",
}


@pytest.mark.parametrize("text", WRONG)
def test_mistakes(tmp_path, text):
    (tmp_path / "text").write_text("no restart\n", encoding="utf-8")
    raises(DeckError, WRONG[text], lambda: run_deck(put(tmp_path / "in.bad", text), RunOptions(platform="Reference"), out=tmp_path / "out"))
