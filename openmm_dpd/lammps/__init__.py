"""LAMMPS decks in: from the text of an input script to a :class:`~openmm_dpd.model.scene.Scene`, and back to thermo words."""

from __future__ import annotations

from .deck import read_deck
from .request import RunRequest
from .sample import Sample
from .state import DeckState

__all__ = ["DeckState", "RunRequest", "Sample", "read_deck"]
