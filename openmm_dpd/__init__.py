"""Dissipative particle dynamics for OpenMM."""

import sys
from importlib import import_module
from importlib.abc import Loader, MetaPathFinder
from importlib.machinery import ModuleSpec

from .advice.recommend import Choice as Choice, Recommendation as Recommendation, recommend as recommend
from .base import (
    DeckError as DeckError,
    DPDError as DPDError,
    OutputError as OutputError,
    ParameterError as ParameterError,
    PlanError as PlanError,
    ProgramError as ProgramError,
    RunError as RunError,
    fastest_platform as fastest_platform,
)
from .kernels.threads import get_threads as get_threads, set_threads as set_threads
from .measure import (
    DPDReporter as DPDReporter,
    Observer as Observer,
    Sample as Sample,
    force_terms as force_terms,
    set_kT as set_kT,
    set_temperature as set_temperature,
)
from .model import (
    DPD as DPD,
    EDPD as EDPD,
    MDPD as MDPD,
    NONE as NONE,
    TDPD as TDPD,
    BeadTemperatures as BeadTemperatures,
    Block as Block,
    BodyForce as BodyForce,
    Concentrations as Concentrations,
    ConstantHeatCapacity as ConstantHeatCapacity,
    CosineAngles as CosineAngles,
    EnergyDPD as EnergyDPD,
    FENEBonds as FENEBonds,
    GaussianCharges as GaussianCharges,
    HarmonicAngles as HarmonicAngles,
    HarmonicBonds as HarmonicBonds,
    HarmonicDihedrals as HarmonicDihedrals,
    InternalEnergy as InternalEnergy,
    LeesEdwards as LeesEdwards,
    LennardJones as LennardJones,
    MorseBonds as MorseBonds,
    MultiHarmonicDihedrals as MultiHarmonicDihedrals,
    OPLSDihedrals as OPLSDihedrals,
    PairTable as PairTable,
    PositionForce as PositionForce,
    Scene as Scene,
    SegmentalRepulsion as SegmentalRepulsion,
    SlaterCharges as SlaterCharges,
    Source as Source,
    Sphere as Sphere,
    TabulatedEOS as TabulatedEOS,
    TabulatedPair as TabulatedPair,
    TemperatureRamp as TemperatureRamp,
    Wall as Wall,
)
from .plan import Plan as Plan, degrees_of_freedom as degrees_of_freedom, explain_plan as explain_plan, make_plan as make_plan
from .simulation import (
    BuiltSystem as BuiltSystem,
    EnthalpyBarostat as EnthalpyBarostat,
    FieldReporter as FieldReporter,
    MixedSystem as MixedSystem,
    add_barostat as add_barostat,
    add_thermostat as add_thermostat,
    build as build,
    build_plan as build_plan,
    create_mixed_system as create_mixed_system,
    load_fields as load_fields,
    load_xml as load_xml,
    read_fields as read_fields,
    write_fields as write_fields,
)

__version__ = "0.2.0"

#: Modules that scripts import by a name of their own, and where they are.
PUBLIC_MODULES = {
    "stats": "base.stats",
    "trajectory": "io.trajectory",
    "units": "base.units",
    "view": "io.view",
}


class _PublicModules(MetaPathFinder, Loader):
    """Finds :data:`PUBLIC_MODULES` by both names, as one module, when they are first imported."""

    def find_spec(self, fullname, path=None, target=None):
        package, _, name = fullname.rpartition(".")
        return ModuleSpec(fullname, self) if package == __name__ and name in PUBLIC_MODULES else None

    def exec_module(self, module):
        name = module.__name__.rpartition(".")[2]
        sys.modules[module.__name__] = import_module(f"{__name__}.{PUBLIC_MODULES[name]}")


sys.meta_path.append(_PublicModules())


def __getattr__(name):
    if name in PUBLIC_MODULES:
        return import_module(f"{__name__}.{name}")
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
