"""LAMMPS decks: run them, take their scenes, write scenes as decks, and read what LAMMPS wrote."""

from __future__ import annotations

from .exchange.data_state import read_lammps_data, scene_from_data
from .exchange.dump_reader import read_lammps_dump
from .exchange.export import LammpsExport, export_deck, export_lammps
from .exchange.frames import LammpsFrames
from .run.deck import read_deck
from .run.main import deck_forces, deck_scene, explain_deck, recommend_deck, run_deck
from .run.options import RunOptions
from .run.request import RunRequest
from .styles.writing import ExportWarning

__all__ = [
    "ExportWarning",
    "LammpsExport",
    "LammpsFrames",
    "RunOptions",
    "RunRequest",
    "deck_forces",
    "deck_scene",
    "explain_deck",
    "export_deck",
    "export_lammps",
    "read_deck",
    "read_lammps_data",
    "read_lammps_dump",
    "recommend_deck",
    "run_deck",
    "scene_from_data",
]
