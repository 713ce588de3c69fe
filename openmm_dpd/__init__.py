"""Dissipative particle dynamics for OpenMM."""

from __future__ import annotations

from .barostat import EnthalpyBarostat, add_barostat
from .build import build, build_plan
from .built import BuiltSystem
from .errors import DeckError, DPDError, OutputError, ParameterError, PlanError, ProgramError, RunError
from .explain import explain_plan
from .field_file import FieldReporter, load_fields
from .fields import read_fields, write_fields
from .host import degrees_of_freedom
from .kernels.threads import get_threads, set_threads
from .measure import DPDReporter, Observer, Sample, force_terms, set_kT, set_temperature
from .mixed_system import MixedSystem, create_mixed_system
from .model.angles import CosineAngles, HarmonicAngles
from .model.bonds import FENEBonds, HarmonicBonds, MorseBonds
from .model.edpd import EDPD
from .model.electrostatics import GaussianCharges, SlaterCharges
from .model.energy_dpd import EnergyDPD
from .model.eos import ConstantHeatCapacity, TabulatedEOS
from .model.flow import BodyForce, PositionForce, Wall
from .model.internal import BeadTemperatures, Concentrations, InternalEnergy
from .model.mdpd import MDPD
from .model.pairs import DPD, NONE, LennardJones, TabulatedPair
from .model.scene import Scene
from .model.segments import SegmentalRepulsion
from .model.sources import Block, Source, Sphere
from .model.table import PairTable
from .model.tdpd import TDPD
from .model.temperature import TemperatureRamp
from .plan import Plan, make_plan
from .platforms import fastest_platform
from .recommend import Choice, Recommendation, recommend
from .serialized import load_xml
from .thermostat import add_thermostat

__version__ = "0.2.0"

__all__ = [
    "BeadTemperatures",
    "Block",
    "BodyForce",
    "BuiltSystem",
    "Choice",
    "Concentrations",
    "ConstantHeatCapacity",
    "CosineAngles",
    "DPD",
    "DPDError",
    "DPDReporter",
    "DeckError",
    "EDPD",
    "EnergyDPD",
    "EnthalpyBarostat",
    "FENEBonds",
    "FieldReporter",
    "GaussianCharges",
    "HarmonicAngles",
    "HarmonicBonds",
    "InternalEnergy",
    "LennardJones",
    "MDPD",
    "MixedSystem",
    "MorseBonds",
    "NONE",
    "Observer",
    "OutputError",
    "PairTable",
    "ParameterError",
    "Plan",
    "PlanError",
    "PositionForce",
    "ProgramError",
    "Recommendation",
    "RunError",
    "Sample",
    "Scene",
    "SegmentalRepulsion",
    "SlaterCharges",
    "Source",
    "Sphere",
    "TDPD",
    "TabulatedEOS",
    "TabulatedPair",
    "TemperatureRamp",
    "Wall",
    "add_barostat",
    "add_thermostat",
    "build",
    "build_plan",
    "create_mixed_system",
    "degrees_of_freedom",
    "explain_plan",
    "fastest_platform",
    "force_terms",
    "get_threads",
    "load_fields",
    "load_xml",
    "make_plan",
    "read_fields",
    "recommend",
    "set_kT",
    "set_temperature",
    "set_threads",
    "write_fields",
]
