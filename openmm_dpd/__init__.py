"""Dissipative particle dynamics for OpenMM."""

from __future__ import annotations

from .build import Built, build, build_plan, fastest_platform
from .errors import DeckError, DPDError, ParameterError, PlanError, ProgramError, RunError
from .kernels.engine import get_threads, set_threads
from .measure import Observer, Sample, force_terms, set_temperature
from .model.bonds import HarmonicBonds
from .model.pairs import DPD, NONE, LennardJones, TabulatedPair
from .model.scene import Scene, TemperatureRamp
from .model.table import PairTable
from .plan import Plan, make_plan
from .reporters import DPDReporter
from .thermostat import add_thermostat

__version__ = "0.1.0"

__all__ = [
    "DPD",
    "NONE",
    "Built",
    "DPDError",
    "DPDReporter",
    "DeckError",
    "HarmonicBonds",
    "LennardJones",
    "Observer",
    "PairTable",
    "ParameterError",
    "Plan",
    "PlanError",
    "ProgramError",
    "RunError",
    "Sample",
    "Scene",
    "TabulatedPair",
    "TemperatureRamp",
    "add_thermostat",
    "build",
    "build_plan",
    "fastest_platform",
    "force_terms",
    "get_threads",
    "make_plan",
    "set_temperature",
    "set_threads",
]
