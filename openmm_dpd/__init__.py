"""Dissipative particle dynamics for OpenMM."""

from __future__ import annotations

from .errors import DeckError, DPDError, ParameterError, PlanError, ProgramError, RunError
from .model.bonds import HarmonicBonds
from .model.pairs import DPD, NONE, LennardJones, TabulatedPair
from .model.scene import Scene, TemperatureRamp
from .model.table import PairTable

__version__ = "0.1.0"

__all__ = [
    "DPD",
    "NONE",
    "DPDError",
    "DeckError",
    "HarmonicBonds",
    "LennardJones",
    "PairTable",
    "ParameterError",
    "PlanError",
    "ProgramError",
    "RunError",
    "Scene",
    "TabulatedPair",
    "TemperatureRamp",
]
