"""LAMMPS decks: run them, take their scenes, write scenes as decks, and read what LAMMPS wrote."""

from .exchange.dump_reader import read_lammps_dump as read_lammps_dump
from .exchange.export import LammpsExport as LammpsExport, export_deck as export_deck, export_lammps as export_lammps
from .exchange.frames import LammpsFrames as LammpsFrames, read_lammps_data as read_lammps_data, scene_from_data as scene_from_data
from .run.check import Finding as Finding, check_deck as check_deck
from .run.deck import read_deck as read_deck
from .run.main import (
    deck_forces as deck_forces,
    deck_scene as deck_scene,
    explain_deck as explain_deck,
    recommend_deck as recommend_deck,
    run_deck as run_deck,
)
from .run.options import RunOptions as RunOptions
from .run.request import RunRequest as RunRequest
from .styles.words import ExportWarning as ExportWarning
