"""A run that is resumed has every option of the one that was interrupted: all that ``openmm-dpd run --help`` lists."""

import json
import re
import shlex
import signal
from pathlib import Path

import pytest
from interrupted_runs import WITH_SIGNALS, contents, interrupted, signal_at

from openmm_dpd.__main__ import main
from openmm_dpd.lammps import RunOptions, explain_deck, export_deck, recommend_deck, run_deck

pytestmark = WITH_SIGNALS

#: Every option, as the run that is interrupted has it (none of these is the default), and others that --restart must refuse.
OPTIONS: dict[str, tuple[list[str], list[list[str]]]] = {
    "--scheme": (["bababo"], [["middle"]]),
    "--dt": (["0.015"], [["0.01"]]),
    "--steps": (["30"], [["31"]]),
    "--seed": (["5"], [["6"]]),
    "--var": (["density", "2"], [["density", "3"], ["other", "2"]]),
    "--platform": (["Reference"], [["CPU"]]),
    "--precision": (["double"], [["mixed"]]),
    "--conservative": (["kernel"], [["openmm"], ["auto"]]),
    "--engine": (["host"], [["auto"]]),
    "--compat": (["lammps"], [["consistent"]]),
    "--discard": (["6"], [["5"], ["0"]]),
    "--every": (["4"], [["5"]]),
    "--format": (["xtc"], [["dcd"]]),
    "--out": (["OUT"], [["elsewhere"]]),
    "--threads": (["1"], []),  # these may be others
    "--checkpoint": (["5"], []),
    "--json": (["JSON"], []),
    "--quiet": ([], []),
}

DECK = """variable density index 1
region box block 0 3 0 3 0 3 units box
create_box 1 box
create_atoms 1 random $(27*v_density) 4243 box
mass 1 1.0
comm_modify vel yes
pair_style dpd 1.0 1.0 34387
pair_coeff * * 25.0 4.5
fix move all nve
fix mean all ave/time 1 2 4 c_thermo_temp file mean.txt
thermo 3
run 20
"""


def words(folder: Path, name: str) -> list[str]:
    """Arguments of a run that writes to ``name``, and its report to a name that holds in this folder only."""
    places = {"OUT": str(folder / name), "JSON": f"{name}.json"}
    return [str(folder / "in.deck"), *(places.get(word, word) for option, (own, _) in OPTIONS.items() for word in (option, *own))]


@pytest.fixture
def folder(tmp_path, monkeypatch) -> Path:
    (tmp_path / "in.deck").write_text(DECK, encoding="utf-8")
    (tmp_path / "else").mkdir()
    monkeypatch.chdir(tmp_path)
    return tmp_path


def stopped(folder: Path, number: int) -> int:
    """A run to its end, and one that is interrupted in its second half; the exit status of this."""
    with signal_at(0, 0) as calls:
        assert main(["run", *words(folder, "whole")]) == 0
    return interrupted(3 * calls[0] // 4, number, ["run", *words(folder, "out")])


def test_every_option_of_the_help_is_here(capsys):
    with pytest.raises(SystemExit):
        main(["run", "--help"])
    listed = set(re.findall(r"^ +(--[a-z-]+)|, (--[a-z-]+)", capsys.readouterr().out, re.MULTILINE))
    assert {one or other for one, other in listed} == {*OPTIONS, "--help", "--no-quiet", "--restart"}


@pytest.mark.filterwarnings("ignore:LAMMPS has no scheme")
def test_the_command_line_and_python_do_the_same(folder, capsys):
    """All options of a run together, and those that other commands share with it."""
    given = {name[2:]: own[0] for name, (own, _) in OPTIONS.items() if name[2:] in RunOptions.__dataclass_fields__}
    values = {name: value if value.isalpha() else float(value) if "." in value else int(value) for name, value in given.items()}
    assert main(["run", *words(folder, "out")]) == 0
    report = run_deck("in.deck", RunOptions(**values), out="python", variables={"density": "2"})
    written = json.loads((folder / "out.json").read_text(encoding="utf-8"))
    assert contents(folder / "out") == contents(folder / "python") and written["runs"][0]["thermo"] == report["runs"][0]["thermo"]
    for command, own, python in (
        ("explain", "scheme dt seed platform conservative engine compat", lambda **use: explain_deck("in.deck", RunOptions(**use))),
        ("recommend", "scheme dt", lambda **use: recommend_deck("in.deck", RunOptions(**use))),
        ("export", "scheme dt steps seed every", lambda **use: export_deck("in.deck", "python", name="x", **use).deck.read_text()),
    ):
        more = ["out", "--name", "x"] if command == "export" else []
        assert main([command, "in.deck", *more, *(word for name in own.split() for word in (f"--{name}", given[name]))]) == 0
        said = (folder / "out" / "in.x").read_text() if more else capsys.readouterr().out[:-1]
        assert said == python(**{name: values[name] for name in own.split()})


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM, signal.SIGKILL], ids=lambda number: number.name)
def test_every_option_is_kept(folder, capsys, monkeypatch, number):
    assert stopped(folder, number) in (-number, 128 + number)
    (folder / "out.json").unlink(missing_ok=True)  # that of the rows until then
    monkeypatch.chdir(folder / "else")
    capsys.readouterr()
    assert main(["run", str(folder / "in.deck"), "--restart", str(folder / "out")]) == 0
    assert capsys.readouterr().out == ""  # quiet
    assert contents(folder / "out") == contents(folder / "whole")
    reports = [json.loads((folder / f"{name}.json").read_text(encoding="utf-8")) for name in ("out", "whole")]
    for report in reports:
        for part in (report, *report["runs"]):
            part.pop("seconds_per_step")
    assert reports[0] == reports[1] and reports[0]["scheme"] == "bababo" and len(reports[0]["runs"]) == 1
    assert not any((folder / "else").iterdir())


def test_other_options_are_refused_and_free_ones_taken(folder, capsys):
    assert stopped(folder, signal.SIGTERM) == 143
    again = ["run", str(folder / "in.deck"), "--restart", str(folder / "out")]
    for option, (_, others) in OPTIONS.items():
        for values in others:
            assert main([*again, option, *values]) == 1, (option, values)
            assert re.search(rf"error: .*{option}", capsys.readouterr().err), (option, values)
    assert main([*again, "--json", "second.json", "--no-quiet", "--steps", "30", "--threads", "2", "--checkpoint", "100"]) == 0
    assert "files are in" in capsys.readouterr().out and (folder / "second.json").exists()


def test_the_hint_is_a_command_that_goes_on(folder, capsys):
    """With the deck and no more, for names with blanks too, and in a folder that was moved."""
    (folder / "in.deck").rename(folder / "in my.deck")
    begun = ["run", "in my.deck", *words(folder, "my out")[1:]]
    with signal_at(0, 0) as calls:
        assert main([word.replace("my out", "whole") for word in begun]) == 0
    assert interrupted(3 * calls[0] // 4, signal.SIGINT, begun) == 130
    command = shlex.split(capsys.readouterr().err.partition("continue with: ")[2])
    assert command[0] == "openmm-dpd"
    (folder / "my out").rename(folder / "moved")
    assert main([word.replace("my out", "moved") for word in command[1:]]) == 0
    assert contents(folder / "moved") == contents(folder / "whole")
