"""A deck on the device that is interrupted and resumed: every file is, bit for bit, that of a run that was not interrupted."""

import sys
from pathlib import Path

import pytest

sys.path.insert(0, str(Path(__file__).parent.parent.parent / "tests" / "decks"))

from test_resume import TINY, interrupt_again_and_again

from openmm_dpd.plan.forces.device_force import why_no_plugin


@pytest.mark.skipif(why_no_plugin("Reference") is not None, reason="the plugin is not installed")
def test_three_interruptions_change_nothing(tmp_path: Path, monkeypatch):
    monkeypatch.setattr("openmm_dpd.lammps.run.main.thermo_picture", lambda *_, **__: None)  # most of the time
    deck = tmp_path / "in.tiny"
    deck.write_text(TINY)
    interrupt_again_and_again(deck, "Reference", 3, "--checkpoint", "10", "--engine", "device", seed=1)
