"""Dissipative particle dynamics for OpenMM."""

from __future__ import annotations

from .barostat import EnthalpyBarostat, add_barostat
from .build import Built, build, build_plan, fastest_platform
from .errors import DeckError, DPDError, ParameterError, PlanError, ProgramError, RunError
from .field_file import FieldReporter, load_fields
from .fields import read_fields, write_fields
from .kernels.threads import get_threads, set_threads
from .measure import Observer, Sample, force_terms, set_temperature
from .model.bonds import HarmonicBonds
from .model.edpd import EDPD
from .model.energy_dpd import EnergyDPD
from .model.eos import ConstantHeatCapacity, TabulatedEOS
from .model.internal import BeadTemperatures, Concentrations, InternalEnergy
from .model.mdpd import MDPD
from .model.pairs import DPD, NONE, LennardJones, TabulatedPair
from .model.scene import Scene, TemperatureRamp
from .model.sources import Block, Source, Sphere
from .model.table import PairTable
from .model.tdpd import TDPD
from .plan import Plan, make_plan
from .reporters import DPDReporter
from .thermostat import add_thermostat

__version__ = "0.1.0"

__all__ = [
    "BeadTemperatures",
    "Block",
    "Built",
    "Concentrations",
    "ConstantHeatCapacity",
    "DPD",
    "DPDError",
    "DPDReporter",
    "DeckError",
    "EDPD",
    "EnergyDPD",
    "EnthalpyBarostat",
    "FieldReporter",
    "HarmonicBonds",
    "InternalEnergy",
    "LennardJones",
    "MDPD",
    "NONE",
    "Observer",
    "PairTable",
    "ParameterError",
    "Plan",
    "PlanError",
    "ProgramError",
    "RunError",
    "Sample",
    "Scene",
    "Source",
    "Sphere",
    "TDPD",
    "TabulatedEOS",
    "TabulatedPair",
    "TemperatureRamp",
    "add_barostat",
    "add_thermostat",
    "build",
    "build_plan",
    "fastest_platform",
    "force_terms",
    "get_threads",
    "load_fields",
    "make_plan",
    "read_fields",
    "set_temperature",
    "set_threads",
    "write_fields",
]
