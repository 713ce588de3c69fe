"""Dissipative particle dynamics for OpenMM."""

import sys
from importlib import import_module

from .base.garbage import nothing_collected

with nothing_collected():  # a seventh of the time: there are many objects, and all of them stay
    from .advice.recommend import Choice as Choice, Recommendation as Recommendation, recommend as recommend
    from .base import stats as stats, units as units
    from .base.errors import (
        DeckError as DeckError,
        DPDError as DPDError,
        OutputError as OutputError,
        ParameterError as ParameterError,
        PlanError as PlanError,
        ProgramError as ProgramError,
        RunError as RunError,
    )
    from .base.platforms import fastest_platform as fastest_platform
    from .base.serialized import load_xml as load_xml
    from .io import bead_pictures as pictures, trajectory as trajectory, view as view
    from .measure import (
        DPDReporter as DPDReporter,
        Observer as Observer,
        ReactionReporter as ReactionReporter,
        Sample as Sample,
        force_terms as force_terms,
        set_kT as set_kT,
        set_temperature as set_temperature,
    )
    from .model import shapes as shapes
    from .model.angles import (
        CosineAngles as CosineAngles,
        CosineDeltaAngles as CosineDeltaAngles,
        CosineSquaredAngles as CosineSquaredAngles,
        HarmonicAngles as HarmonicAngles,
        HarmonicDihedrals as HarmonicDihedrals,
        MultiHarmonicDihedrals as MultiHarmonicDihedrals,
        OPLSDihedrals as OPLSDihedrals,
        PeriodicAngles as PeriodicAngles,
    )
    from .model.bodies import Body as Body
    from .model.bonds import FENEBonds as FENEBonds, HarmonicBonds as HarmonicBonds, MorseBonds as MorseBonds
    from .model.edpd import EDPD as EDPD
    from .model.electrostatics import GaussianCharges as GaussianCharges, SlaterCharges as SlaterCharges
    from .model.energy_dpd import EnergyDPD as EnergyDPD
    from .model.eos import ConstantHeatCapacity as ConstantHeatCapacity, TabulatedEOS as TabulatedEOS
    from .model.flow import BodyForce as BodyForce, PositionForce as PositionForce, Wall as Wall
    from .model.impropers import (
        CosineImpropers as CosineImpropers,
        HarmonicImpropers as HarmonicImpropers,
        UmbrellaImpropers as UmbrellaImpropers,
    )
    from .model.internal import BeadTemperatures as BeadTemperatures, Concentrations as Concentrations, InternalEnergy as InternalEnergy
    from .model.limited_bonds import NonlinearBonds as NonlinearBonds, QuarticBonds as QuarticBonds
    from .model.mdpd import MDPD as MDPD
    from .model.pairs import DPD as DPD, NONE as NONE, LennardJones as LennardJones, PairTable as PairTable, TabulatedPair as TabulatedPair
    from .model.point_charges import PointCharges as PointCharges
    from .model.radial import RadialPair as RadialPair
    from .model.reactions import (
        BondBreaking as BondBreaking,
        BondFormation as BondFormation,
        ReactiveBonds as ReactiveBonds,
    )
    from .model.scene import Scene as Scene
    from .model.segments import SegmentalRepulsion as SegmentalRepulsion
    from .model.shapes import SolidWall as SolidWall
    from .model.shear import LeesEdwards as LeesEdwards
    from .model.sources import Block as Block, Buoyancy as Buoyancy, Source as Source, Sphere as Sphere
    from .model.tdpd import TDPD as TDPD
    from .model.temperature import TemperatureRamp as TemperatureRamp
    from .plan.explain import explain_plan as explain_plan
    from .plan.made import degrees_of_freedom as degrees_of_freedom
    from .plan.plan import Plan as Plan, make_plan as make_plan
    from .runtime import get_threads as get_threads, set_threads as set_threads
    from .simulation.barostat import EnthalpyBarostat as EnthalpyBarostat, add_barostat as add_barostat
    from .simulation.bonds import read_bonds as read_bonds, read_reacted as read_reacted, read_types as read_types
    from .simulation.build import build as build, build_plan as build_plan
    from .simulation.built import BuiltSystem as BuiltSystem
    from .simulation.field_file import FieldReporter as FieldReporter, load_fields as load_fields
    from .simulation.fields import read_fields as read_fields, write_fields as write_fields
    from .simulation.mixed_system import MixedSystem as MixedSystem, create_mixed_system as create_mixed_system
    from .simulation.thermostat import add_thermostat as add_thermostat

__version__ = "0.2.0"

#: Modules that scripts import by a name of their own, and where they are.
PUBLIC_MODULES = {"pictures": pictures, "shapes": shapes, "stats": stats, "trajectory": trajectory, "units": units, "view": view}
sys.modules.update({f"{__name__}.{name}": module for name, module in PUBLIC_MODULES.items()})


def __getattr__(name):
    if name in ("inputs", "outputs"):
        return import_module(f"{__name__}.{name}")
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
