"""A LAMMPS pair style from a test file: one entry to read it and one to write it, and decks with it run, come back and are refused."""

from pathlib import Path

import pytest
from fluid_deck import ONE_TYPE

import openmm_dpd as dpd
from openmm_dpd.lammps import RunOptions, deck_scene, export_lammps, run_deck
from openmm_dpd.lammps.state.pair_setup import Spec
from openmm_dpd.lammps.styles.columns import Columns, settings
from openmm_dpd.lammps.styles.pair_styles import EXPORTS, PAIR_STYLES
from openmm_dpd.lammps.styles.writing import StyleUse, exact

#: pair_style toy/fluid T cutoff seed; pair_coeff 1 1 A half, with half the friction of dpd.
COLUMNS = Columns({"A": "force", "half": "friction"})

DECK = ONE_TYPE.replace("style dpd", "style {style}").replace("25.0 4.5", "{words}") + "timestep 0.01\nthermo 10\nrun 20\n"


def fluid(A: float, half: float, cutoff: float) -> dpd.DPD:
    return dpd.DPD(A=A, gamma=2 * half, cutoff=cutoff)


def written(export, entries) -> list[StyleUse]:
    units, longest = export.units, max(c.cutoff for c in entries.values())
    words = {pair: exact([c.A / units.force, c.gamma / 2 / units.friction, c.cutoff / units.length]) for pair, c in entries.items()}
    return [StyleUse("toy/fluid", f"{{start}} {exact(longest / units.length)} {{seed}}", words, longest)]


@pytest.fixture
def style(monkeypatch):
    monkeypatch.setitem(
        PAIR_STYLES, "toy/fluid", Spec(settings("toy/fluid", "T cutoff seed"), COLUMNS.coefficient, COLUMNS.builder(fluid), thermostat=True)
    )
    monkeypatch.setitem(EXPORTS, dpd.DPD, written)


def deck(folder: Path, style: str, words: str) -> Path:
    path = folder / f"in.{style.partition('/')[0]}"
    path.write_text(DECK.format(style=style, words=words), encoding="utf-8")
    return path


def thermo(path: Path) -> list[str]:
    """The printed rows of a run."""
    lines: list[str] = []
    run_deck(path, RunOptions(platform="Reference"), log=lambda text: lines.extend(text.splitlines()))
    return [line for line in lines if line.split()[:1] in (["0"], ["10"], ["20"])]


def test_it_runs_as_what_it_stands_for(style, tmp_path):
    toy, same, other = (thermo(deck(tmp_path, *of)) for of in (("toy/fluid", "25.0 2.25"), ("dpd", "25.0 4.5"), ("dpd", "25.0 9.0")))
    assert len(toy) == 3 and toy == same and toy != other


def test_a_scene_is_written_with_it_and_read_again(style, tmp_path):
    scene = deck_scene(deck(tmp_path, "dpd", "25.0 4.5"))
    with pytest.warns(UserWarning):
        export_lammps(scene, tmp_path / "out", name="toy", dt=0.01, steps=0, scheme="middle", seed=7)
    text = next((tmp_path / "out").glob("in.*")).read_text(encoding="utf-8")
    assert "pair_style toy/fluid" in " ".join(text.split())
    again = deck_scene(next((tmp_path / "out").glob("in.*")))
    assert list(again.tables[0].entries.values()) == list(scene.tables[0].entries.values())


def test_its_words_are_checked(style, tmp_path):
    with pytest.raises(dpd.DeckError, match="in.toy:9.*A half"):
        deck_scene(deck(tmp_path, "toy/fluid", "25.0"))
