"""Each fix and compute that decks may have does something: a run without it, or from another state, gives other files."""

import re
from pathlib import Path

import pytest
from cases import put
from deck_snippets import FILES, SNIPPETS

from openmm_dpd.base.errors import DPDError
from openmm_dpd.lammps import RunOptions, run_deck

#: Words that change no file, and why.
IDLE = {
    "balance": "beads belong to no processors here; a note says so",
    "wall/reflect": "open ends of the box reflect as well; a note says so",
}
#: Fixes without which a deck does not run; that of bonds is named by the pair style of its deck.
NEEDED = ("shardlow", "dpd/energy", "eos/cv", "eos/table", "enforce2d", "bond/break")
#: Computes whose values are not of positions or velocities.
CONSTANT = {"property/local": "ids and types of bonds", "fragment/atom": "bonds alone", "aggregate/atom": "bonds join all of each chain"}
#: What is in the place of fixes that move beads; others are left out.
MOVING = {**dict.fromkeys(("mvv/dpd", "nvt", "nph", "nve/limit"), "nve"), "npt": "nvt temp 1.0 1.0 0.5 tchain 2"}


def files(folder: Path, text: str) -> dict[str, bytes]:
    """What a deck leaves but for what it says about itself; the error of a deck that does not run."""
    folder.mkdir()
    for name, content in FILES.items():
        put(folder / name, content)
    try:
        run_deck(put(folder / "in.deck", text), RunOptions(platform="Reference", threads=1), out=folder / "out")
    except DPDError as error:
        return {"error": str(error).encode()}
    made = (path for pattern in ("*.txt", "*.gz", "end.data") for path in (folder / "out").glob(pattern) if path.name != "log.txt")
    return {path.name: path.read_bytes() for path in made}


def without(text: str, style: str, instead: str = "") -> str:
    """A deck with another fix, or none, in the place of a style, and without what reads its values."""
    names = set(re.findall(rf"^fix (\w+) \w+ {style}(?: |$)", text, re.MULTILINE))
    gone = {f"f_{name}" for name in names}
    lines = []
    for line in text.splitlines():
        words = [word for word in line.split(" ") if word.partition("[")[0] not in gone]
        if words[:1] == ["variable"] and any(name in line for name in gone):
            gone.add(f"v_{words[1]}")
        elif words[0] in ("fix", "unfix", "fix_modify") and words[1] in names:
            lines += [" ".join([*words[:3], instead])] * (words[0] == "fix" and bool(instead))
        elif words[7:8] != ["file"] and (len(words) > 8 or not any(name in line for name in gone)):
            lines.append(" ".join(words))
    return "\n".join(lines) + "\n"


@pytest.mark.slow
@pytest.mark.parametrize("style", SNIPPETS["fix"])
def test_fixes_act(tmp_path, style):
    text = SNIPPETS["fix"][style]
    if style == "nph":
        text = text.replace("run 7", "run 60")  # Volumes change now and then.
    bare = without(text, style, MOVING.get(style, ""))
    assert bare != text
    one, other = files(tmp_path / "with", text), files(tmp_path / "without", bare)
    assert "error" not in one and ("error" in other) == (style in NEEDED), (one.get("error"), other.get("error"))
    same = {name for name in other if one.get(name) == other[name]}
    assert ("end.data" in same and set(one) == same) == (style in IDLE), (sorted(one), sorted(same), other.get("error"))


@pytest.mark.slow
@pytest.mark.parametrize("style", SNIPPETS["compute"])
def test_computes_depend_on_the_state(tmp_path, style):
    text = SNIPPETS["compute"][style]
    moved = re.sub(r"(?<= create )1\.0 87287", "1.3 87288", text).replace(" 4243 box", " 4253 box")
    moved = re.sub(r"(?m)^(set atom \* (?:cc 2|edpd/temp|dpd/theta)) (\S+)", r"\1 1.7", moved)
    one, other = files(tmp_path / "one", text), files(tmp_path / "other", moved)
    assert "error" not in {**one, **other}
    measured = [name for name in one if name != "end.data"]
    assert measured and (sorted(measured) == sorted(name for name in measured if one[name] == other[name])) == (style in CONSTANT)
