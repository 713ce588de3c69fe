"""A scheme from outside of the package: one entry of the table, and it builds, runs, is explained, listed and refused where others are."""

import dataclasses

import pytest
from devices import Device
from scenes import beads, run_of, same_bits, state_of, stepped

import openmm_dpd as dpd
from openmm_dpd.model.schemes import SCHEMES, Scheme, read_word
from openmm_dpd.simulation.advice.recommend import advice

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


def test_it_runs_as_its_word(monkeypatch):
    word = moved(WORD)  # a word without a name as yet
    monkeypatch.setitem(SCHEMES, "baoab", BAOAB)
    assert same_bits(moved("baoab"), word) and not same_bits(moved("middle"), word)


def test_it_is_explained_by_its_name(baoab):
    text = dpd.build(beads(), dt=0.02, scheme="baoab", platform="Reference", seed=1).explain(program=True)
    assert "scheme: baoab (half kick" in text and "program baoab (Leimkuhler" in text


def test_it_is_refused_where_sweeps_are(baoab):
    scene = beads(table={("W", "W"): dpd.EDPD(A=25, gamma=4.5, kappa=1e-3)}, internal=dpd.BeadTemperatures(1.0, 30.0))
    scene = dataclasses.replace(scene, compat="lammps")
    with pytest.raises(dpd.PlanError, match="only scheme='mvv' runs it, not 'baoab'"):
        dpd.build(scene, dt=0.02, scheme="baoab", platform="Reference")
    with pytest.raises(dpd.ParameterError, match="the scheme 'baoab' has none"):
        dpd.build(beads(), dt=0.02, scheme="baoab", lam=0.65, platform="Reference")


def test_nothing_is_advised_about_it_until_it_is_measured(baoab):
    assert "no scheme 'baoab'" in advice(beads(375, edge=5.0), "baoab", 0.04)
