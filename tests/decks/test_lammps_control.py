"""Loops, conditions and jumps of decks: what is printed, beside a live LAMMPS where there is one."""

from pathlib import Path

import lammps_peer
import pytest
from cases import cases, put, raises

from openmm_dpd.base.errors import DeckError, ParameterError
from openmm_dpd.lammps import RunOptions, read_deck, run_deck
from openmm_dpd.lammps.language.expressions import condition_holds

NO_LAMMPS = lammps_peer.why_missing()

SAY = "append said.txt screen no"
SCRIPTS = {
    "padded loop": (f"variable i loop 8 11 pad\nlabel a\nprint $i {SAY}\nnext i\njump SELF a\nprint end {SAY}\n", "08 09 10 11 end"),
    "two variables, the shorter one ends it": (
        f"variable i index a b c\nvariable j index x y\nlabel a\nprint $i$j {SAY}\nnext i j\njump SELF a\nprint $i {SAY}\n",
        "ax by c",
    ),
    "left early": (
        f"variable i loop 5\nlabel a\nprint $i {SAY}\nif '$i == 3' then 'jump SELF out'\nnext i\njump SELF a\nlabel out\nprint d$i {SAY}\n",
        "1 2 3 d3",
    ),
    "a loop in a loop": (
        f"variable i loop 2\nlabel a\nvariable j index p q\nlabel b\nprint $i$j {SAY}\nnext j\njump SELF b\nnext i\njump SELF a\n",
        "1p 1q 2p 2q",
    ),
    "lines that are passed over": (f"jump SELF b\nprint ${{nope}} {SAY}\nnonsense\nlabel b\nprint ok {SAY}\n", "ok"),
    "the next jump, whenever it comes": (
        f"variable i loop 1\nnext i\nprint 1 {SAY}\njump SELF q\njump SELF b\nprint no {SAY}\nlabel b\nprint ok {SAY}\n",
        "1 ok",
    ),
    "variables in quotes": (
        f"if 1>0 then 'variable a equal 5' &\n 'variable b equal v_a*2' 'print \"$a$b\" {SAY}' else 'print no'\n",
        "510",
    ),
    "elif": (
        f"variable x equal 2\nif '$x == 1' then 'print one {SAY}' elif '$x == 2' 'print two {SAY}' elif 1 'print never' else 'print other'\n",
        "two",
    ),
    "an if in an if": (f"if 1 then \"if 0 then 'print a {SAY}' else 'print b {SAY}'\"\n", "b"),
    "format and environment": (
        f"variable x equal 1/3\nvariable s format x %8.4f\nvariable h getenv DECK_WORD\nprint '[$s] $h' {SAY}\nvariable x equal 2\n"
        f"print '[$s]' {SAY}\n",
        "[  0.3333] word [  2.0000]",
    ),
    "the first of two labels": (
        f"variable i loop 2\nlabel a\nprint first {SAY}\nlabel a\nprint $i {SAY}\nnext i\njump SELF a\n",
        "first 1 first 2",
    ),
    "another file in its place": (f"include b\nprint back {SAY}\n", "in_b end_c back"),
}
FILES = {"b": f"print in_b {SAY}\njump c here\nprint not {SAY}\n", "c": f"print top {SAY}\nlabel here\nprint end_c {SAY}\n"}


def said(folder: Path) -> str:
    return " ".join((folder / "said.txt").read_text(encoding="utf-8").splitlines())


@cases("text, expected", SCRIPTS)
def test_what_is_printed(tmp_path, monkeypatch, text, expected):
    monkeypatch.setenv("DECK_WORD", "word")
    for side in ("theirs", "ours"):
        (tmp_path / side).mkdir()
        for file, content in (FILES | {"in": text}).items():
            (tmp_path / side / file).write_text(content, encoding="utf-8")
    raises(DeckError, "has no run command", lambda: read_deck(tmp_path / "ours" / "in", output=tmp_path / "ours"))
    assert said(tmp_path / "ours") == expected
    if NO_LAMMPS is None:
        with lammps_peer.instance() as lmp:
            lmp.command(f"shell cd {tmp_path}/theirs")
            lmp.file("in")
        assert said(tmp_path / "theirs") == expected


_TRUE = "1 < 2; 0.5; -1; a == a; a/b != a_b; 1.5e-3<2; 1 || 0 && 0; 2 < 3 == 1; !(1 > 2); !!2 == 1; 1.0 == 1"
_FALSE = "0; a == A; 1 |^ 1; 1 || 1 |^ 1; 3 > 2 > 1"
#: Each as LAMMPS has it; the fuzzer compares random ones.
CONDITIONS = {text: holds for texts, holds in ((_TRUE, True), (_FALSE, False)) for text in texts.split("; ")}


@pytest.mark.parametrize("text", CONDITIONS)
def test_conditions(text):
    assert condition_holds(text) is CONDITIONS[text]


@cases("text", "", "a", "a < b", "1 == a", "!a", "1 1", "1 = 1", "1 &", "+1", "(1", "1 +1", "1 ! 1", "a.b == a.b", "1 && a")
def test_what_is_no_condition(text):
    raises(ParameterError, "cannot evaluate the condition", lambda: condition_holds(text))


WRONG = {
    "jump SELF nowhere": "there is no 'label nowhere' in in.bad",
    "jump elsewhere": "there is no file 'elsewhere'",
    "if 1 'print a'": "expected 'if condition then",
    "if 0 then 'print a' else": "expected commands after 'else'",
    "if 1 then elif 2 'print a'": "expected a condition and commands after 'elif'",
    "if 1 then 'print a' else 'print b' elif 1 'print c'": "'elif' after else",
    "if 1 then 'nonsense 3'": "unknown or unsupported command 'nonsense'",
    "variable i loop 5 3": "5 is greater than 3",
    "variable i loop 0": "at least 1",
    "variable i loop 1 2 3": "expected 'loop N",
    "variable i index": "expected values, but found 0",
    "variable f format x %d": "expected a format such as %12.6f",
    "variable s string a\nnext s": "variable s is string-style",
    "variable s index a b\nvariable t loop 2\nnext s t": "must all have the same style",
    "next nobody": "there is no variable 'nobody'",
    "shell rm -r x": "cannot run programs",
    "quit 3": "exit status",
    "run 5 every 2": "every M NULL",
}


@pytest.mark.parametrize("text", WRONG)
def test_mistakes_have_their_line(tmp_path, text):
    with pytest.raises(DeckError, match=WRONG[text].replace("(", r"\(")) as raised:
        read_deck(put(tmp_path / "in.bad", text + "\n"))
    assert str(raised.value).startswith(f"{tmp_path}/in.bad:{text.count(chr(10)) + 1}: ")


RUNS = "region b block 0 4 0 4 0 4\ncreate_box 1 b\ncreate_atoms 1 random 20 5 NULL\nmass 1 1\npair_style dpd 1 1 7\n"
RUNS += "pair_coeff 1 1 25 4.5\nfix 1 all nve\n"


def test_quit_inside_of_pieces_ends_the_deck(tmp_path):
    """Pieces of a run count as runs; what a command in between says about the deck holds."""
    path = put(tmp_path / "in.pieces", RUNS + "run 7 every 3 'if \"$(step) >= 6\" then quit' 'print nothing'\nprint never\n")
    lines: list[str] = []
    report = run_deck(path, RunOptions(platform="Reference"), log=lines.append)
    assert [run["steps"] for run in report["runs"]] == [3, 3]
    assert lines.count("nothing") == 1 and "never" not in lines


def test_a_loop_over_runs(tmp_path):
    """One run for each value, which variables of the command line replace."""
    path = put(tmp_path / "in.loop", RUNS + "variable n index 1 2 3\nlabel a\nrun $n\nnext n\njump SELF a\n")
    for given, steps in ({}, [1, 2, 3]), ({"n": "4"}, [4]):
        report = run_deck(path, RunOptions(platform="Reference"), variables=given)
        assert [run["steps"] for run in report["runs"]] == steps
