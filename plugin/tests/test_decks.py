"""A deck on the device that is interrupted and resumed: every file is, bit for bit, that of a run that was not interrupted."""

import sys
from pathlib import Path

import pytest

sys.path.insert(0, str(Path(__file__).parent.parent.parent / "tests" / "decks"))

from test_resume import DECKS, TINY, interrupt_again_and_again

from openmm_dpd.base.errors import DeckError
from openmm_dpd.lammps import RunOptions, run_deck
from openmm_dpd.plan.forces.device_force import why_no_plugin

NEEDED = pytest.mark.skipif(why_no_plugin("Reference") is not None, reason="the plugin is not installed")


@NEEDED
def test_three_interruptions_change_nothing(tmp_path: Path, monkeypatch):
    monkeypatch.setattr("openmm_dpd.lammps.run.main.thermo_picture", lambda *_, **__: None)  # most of the time
    deck = tmp_path / "in.tiny"
    deck.write_text(TINY)
    interrupt_again_and_again(deck, "Reference", 3, "--checkpoint", "10", "--engine", "device", seed=1)


@NEEDED
def test_energies_in_a_box_that_changes_are_the_hosts(tmp_path: Path):
    """An acceleration that is computed anew, where the box has moved the beads, would cost energy in each change."""
    deck = tmp_path / "in.changing"
    deck.write_text(
        (DECKS / "in.dpde-vv")
        .read_text()
        .replace("data.dpd", f"{DECKS}/data.dpd")
        .replace("\nrun ", "\nfix s all deform 1 x scale 1.01 remap x\nrun ", 1)
    )
    options = {"platform": "Reference", "threads": 1, "steps": 2}
    with pytest.raises(DeckError, match=r"in\.changing.*fix s: beads with internal energies.* use engine 'host'"):
        run_deck(deck, RunOptions(engine="device", **options), out=tmp_path / "device")
    run_deck(deck, RunOptions(engine="host", **options), out=tmp_path / "host")
