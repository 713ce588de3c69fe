"""All that is wrong with a deck, said at once: each thing once, without what only follows from it."""

import json

from cases import cases, put, raises
from deck_snippets import FILES, SNIPPETS
from fluid_deck import FLUID

from openmm_dpd.__main__ import main
from openmm_dpd.base.errors import DeckError
from openmm_dpd.lammps import check_deck, explain_deck, run_deck

START = """units lj
region box block 0 6 0 6 0 6 units box
create_box 2 box
create_atoms 1 random 100 1 box
mass * 1
pair_style dpd 1.0 1.0 77
pair_coeff * * 25 4.5
fix 1 all nve
"""


def refused(path, **options) -> list[tuple[int | None, str]]:
    return [(found.line, found.word) for found in check_deck(path, **options) if found.kind == "refused"]


RUN = "run 5\n"

DECKS = {
    "nothing": (START + RUN, []),
    "after what is refused": (START + "nonsense 1\nthermo -1\n" + RUN + "more\n", [(9, "nonsense"), (10, "thermo"), (12, "more")]),
    "a box that moves after a run": (
        f"atom_style mdpd\n{START}".replace("pair_style dpd", "pair_style hybrid/overlay mdpd/rhosum mdpd")
        .replace("* * 25", "* * mdpd -40 25 18 1 0.75")
        .replace(" 4.5\n", "\npair_coeff * * mdpd/rhosum 0.75\n")
        + RUN
        + "unfix 1\nfix 1 all nph iso 0 0 1\n"
        + RUN,
        [],
    ),
    "no run": (START, [(None, "run")]),
    "a box and what fills it": (
        START.replace("create_box 2 box", "lattice fcc 100\ncreate_box 2 nobox\ncreate_atoms 1 box\nreplicate 9 9 9") + RUN,
        [(4, "create_box")],
    ),
    "a fix and what names it": (START + "fix a all foo 1\nfix b all ave/time 1 1 1 f_a\nunfix a\n" + RUN, [(9, "fix foo")]),
    "a compute and what names it": (
        START + "compute a all foo\nthermo_style custom step c_a bar temp v_b\nthermo_modify temp a\nvariable c equal 2*c_a\n"
        'print "${c}"\nuncompute a\n' + RUN,
        [(9, "compute foo"), (10, "thermo bar"), (10, "thermo_style")],
    ),
    "a region, and the box of it": (
        START.replace("region box block", "region box cone") + "group g region box\nfix 2 g foo\n" + RUN,
        [(2, "region"), (10, "fix foo")],
    ),
    "one style of hybrid": (
        START.replace("pair_style dpd", "pair_style hybrid/overlay foo 2.5 lj 3 dpd")
        + "pair_coeff 1 1 foo 1 1\npair_coeff 1 1 dpd 25\npair_coeff 1 1 dpd 25 3\n"
        + RUN,
        [(6, "pair foo"), (6, "pair lj"), (7, "pair_coeff"), (10, "pair_coeff")],
    ),
    "pair and bond style": (
        START.replace("dpd", "foo") + "bond_style bar\nbond_coeff 1 2 3\nminimize 1 1 1 1\n" + RUN,
        [(6, "pair foo"), (9, "bond_style")],
    ),
    "a file that is not there": (
        START.replace("create_atoms", "include nowhere\nread_data nowhere\ncreate_atoms") + "fix 2 some nve\n" + RUN,
        [(4, "include"), (5, "read_data")],
    ),
    "columns of a dump": (START + "dump d all custom 5 d.txt id foo x bar\nundump d\n" + RUN, [(9, "dump"), (9, "dump")]),
    "a loop": (START + "variable k loop 7\nlabel a\nnonsense $k\nrun 5\nnext k\njump SELF a\nmore\n", [(11, "nonsense"), (15, "more")]),
    "values of runs": (
        START + RUN + 'variable r equal 1/(pe-1)\nprint "$(temp) ${r}"\nif "$(press) < 9" then "quit 1" else "nonsense"\nmore\n',
        [(13, "more")],
    ),
    "commands within commands": (
        START + 'if "1 > 0" then nonsense "fix 2 all foo"\nrun 1000000 every 1 "more"\n',
        [(9, "nonsense"), (9, "fix foo"), (10, "more")],
    ),
    "a run": (START.replace("pair_coeff * *", "pair_coeff 1 2") + RUN + RUN, [(6, "run")]),
    "a sweep": (
        START.replace("dpd", "foo") + RUN + "write_data a.data\nclear\nread_data a.data\nclear\n" + START + "pair_coeff 1 1 2\n" + RUN,
        [(6, "pair foo"), (22, "pair_coeff")],
    ),
    "quotes": (START + 'print "a\n' + RUN, [(9, "")]),
}


@cases("text, expected", DECKS)
def test_everything_is_said_once(tmp_path, text, expected):
    assert refused(put(tmp_path / "in.deck", text)) == expected
    assert [path.name for path in tmp_path.iterdir()] == ["in.deck"]


@cases("kind", "command", "fix")
def test_every_word_that_runs_passes(tmp_path, kind):
    for name, text in FILES.items():
        put(tmp_path / name, text)
    found = {name: refused(put(tmp_path / "in.deck", text)) for name, text in SNIPPETS[kind].items() if name != "read_restart"}
    assert not any(found.values()), found


def test_notes_hints_and_variables(tmp_path):
    path = put(tmp_path / "in.deck", START + "comm_modify vel yes\npython foo\nthermo ${n}\n" + RUN)
    note, hint = check_deck(path, variables={"n": "2"})
    assert (note.kind, note.line, note.word) == ("note", 9, "comm_modify") and "no effect here" in str(note)
    assert (hint.line, hint.word) == (10, "python") and hint.instead in hint.message and "read_deck" in hint.instead
    assert refused(path) == [(10, "python"), (11, "thermo")]


@cases(
    "lines, followed",
    ("label a\njump SELF a\n", 1),
    ('label a\nrun 1\nif "$(temp) > 0" then "jump SELF a"\n', 1),
    ("variable k loop 50\nlabel a\nrun 1\nnext k\njump SELF a\n", 0),
)
def test_a_deck_that_never_ends_is_said(tmp_path, lines, followed):
    found = check_deck(put(tmp_path / "in.deck", START + lines + RUN))
    assert sum("100 times and no more" in str(one) for one in found) == followed and refused(tmp_path / "in.deck") == []


def test_nothing_is_written(tmp_path):
    target = tmp_path / "else"
    more = f"write_data {target}\nprint x file {target}\ndump d all xyz 1 {target}\ndump e all dcd 1 {target}2\nwrite_restart {target}3\n"
    assert refused(put(tmp_path / "in.deck", START + more + RUN + more.replace("dump ", "dump x"))) == []
    assert len(list(tmp_path.iterdir())) == 1


def test_run_and_explain_say_it_all_before_the_first_run(tmp_path, capsys):
    path = put(tmp_path / "in.deck", START + "nonsense 1\n" + RUN + "more\n")
    for call in (explain_deck, run_deck):
        raises(DeckError, r"^\S*in.deck:9: unknown .* 'nonsense'.*\n\S*in.deck:11: unknown [^\n]* 'more'$", call, path)
    assert main(["run", str(path), "--out", str(tmp_path / "out")]) == 1
    assert [line[:18] for line in capsys.readouterr().err.splitlines()] == ["openmm-dpd: error:"] * 2
    put(path, FLUID + "more\nmore\n")
    raises(DeckError, r"in.deck:\d+: unknown or unsupported command 'more'[^\n]*$", run_deck, path)  # its runs are done


def test_the_command_line(tmp_path, capsys):
    path, file = put(tmp_path / "in.deck", START + "comm_modify vel yes\nnonsense\n" + RUN), tmp_path / "found.json"
    assert main(["check", str(path)]) == 1
    lines = capsys.readouterr().out.splitlines()
    assert lines[0].startswith(f"{path}:9: note: comm_modify") and lines[1].startswith(f"{path}:10: unknown or")
    assert lines[2:] == [f"{path} does not run: 1 refused, 1 note"]
    assert main(["check", str(path), "--json"]) == main(["check", str(path), "--json", str(file)]) == 1
    data = json.loads(file.read_text())
    assert f"{path} does not run" in (said := capsys.readouterr().out) and json.loads(said.rpartition(f"{path}:9")[0]) == data
    assert (data["runs"], data["refused"][0]["word"], data["notes"][0]["line"]) == (False, "nonsense", 9)
    assert main(["check", str(put(path, START + RUN))]) == 0 and capsys.readouterr().out == f"{path} runs: 0 refused, 0 notes\n"
