"""Entries from outside of the package: a scheme, and a LAMMPS pair style; both run, are explained or come back, listed, and refused where others are."""

import dataclasses
from pathlib import Path

import pytest
from cases import raises
from devices import Device
from fluid_deck import ONE_TYPE
from scenes import beads, run_of, same_bits, state_of, stepped

import openmm_dpd as dpd
from openmm_dpd.advice.recommend import advice
from openmm_dpd.lammps import RunOptions, deck_scene, export_lammps, run_deck
from openmm_dpd.lammps.state.pair_setup import Spec
from openmm_dpd.lammps.styles.pair_styles import EXPORTS, PAIR_STYLES
from openmm_dpd.lammps.styles.words import Columns, StyleUse, exact, settings
from openmm_dpd.model.schemes import SCHEMES, Scheme, read_word

WORD = "B/2 A/2 O A/2 B/2"
REFERENCE = Device("Reference")


BAOAB = Scheme("baoab", read_word(WORD), "Leimkuhler and Matthews 2013", "half kick, half drift, sweep, half drift, half kick")


@pytest.fixture
def baoab(monkeypatch) -> None:
    monkeypatch.setitem(SCHEMES, "baoab", BAOAB)


def moved(scheme: str):
    """Positions and velocities after five steps."""
    simulation = stepped(run_of(beads(), REFERENCE, scheme=scheme, dt=0.02), 5)
    return state_of(simulation.context)


def test_it_runs_as_its_word(monkeypatch, baoab):
    word = moved(WORD)  # a word without a name as yet
    monkeypatch.setitem(SCHEMES, "baoab", BAOAB)
    assert same_bits(moved("baoab"), word) and not same_bits(moved("middle"), word)
    text = dpd.build(beads(), dt=0.02, scheme="baoab", platform="Reference", seed=1).explain(program=True)
    assert "scheme: baoab (half kick" in text and "program baoab (Leimkuhler" in text
    assert "no scheme 'baoab'" in advice(beads(375, edge=5.0), "baoab", 0.04)


def test_it_is_refused_where_sweeps_are(baoab):
    scene = beads(table={("W", "W"): dpd.EDPD(A=25, gamma=4.5, kappa=1e-3)}, internal=dpd.BeadTemperatures(1.0, 30.0))
    scene = dataclasses.replace(scene, compat="lammps")
    raises(dpd.PlanError, "only scheme='mvv' runs it, not 'baoab'", dpd.build, scene, dt=0.02, scheme="baoab", platform="Reference")
    raises(dpd.ParameterError, "the scheme 'baoab' has none", dpd.build, beads(), dt=0.02, scheme="baoab", lam=0.65, platform="Reference")


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
    spec = Spec(settings("toy/fluid", "T cutoff seed"), COLUMNS.coefficient, COLUMNS.builder(fluid), thermostat=True)
    monkeypatch.setitem(PAIR_STYLES, "toy/fluid", spec)
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


def test_it_runs_as_what_it_stands_for_and_its_words_are_checked(style, tmp_path):
    toy, same, other = (thermo(deck(tmp_path, *of)) for of in (("toy/fluid", "25.0 2.25"), ("dpd", "25.0 4.5"), ("dpd", "25.0 9.0")))
    assert len(toy) == 3 and toy == same and toy != other
    raises(dpd.DeckError, "in.toy:9.*A half", lambda: deck_scene(deck(tmp_path, "toy/fluid", "25.0")))


def test_a_scene_is_written_with_it_and_read_again(style, tmp_path):
    scene = deck_scene(deck(tmp_path, "dpd", "25.0 4.5"))
    with pytest.warns(UserWarning):
        export_lammps(scene, tmp_path / "out", name="toy", dt=0.01, steps=0, scheme="middle", seed=7)
    text = next((tmp_path / "out").glob("in.*")).read_text(encoding="utf-8")
    assert "pair_style toy/fluid" in " ".join(text.split())
    again = deck_scene(next((tmp_path / "out").glob("in.*")))
    assert list(again.tables[0].entries.values()) == list(scene.tables[0].entries.values())
