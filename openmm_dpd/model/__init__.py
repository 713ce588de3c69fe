"""What the user means, as frozen data: pair coefficients and tables of them, bonds, charges, walls, fields, the scene, words of schemes.

Everything is checked here and kept as read-only copies.  No OpenMM force, kernel or program.
"""

from .angles import (
    CosineAngles as CosineAngles,
    HarmonicAngles as HarmonicAngles,
    HarmonicDihedrals as HarmonicDihedrals,
    MultiHarmonicDihedrals as MultiHarmonicDihedrals,
    OPLSDihedrals as OPLSDihedrals,
)
from .bonds import FENEBonds as FENEBonds, HarmonicBonds as HarmonicBonds, MorseBonds as MorseBonds
from .edpd import EDPD as EDPD
from .electrostatics import GaussianCharges as GaussianCharges, SlaterCharges as SlaterCharges
from .energy_dpd import EnergyDPD as EnergyDPD
from .eos import ConstantHeatCapacity as ConstantHeatCapacity, TabulatedEOS as TabulatedEOS
from .flow import BodyForce as BodyForce, PositionForce as PositionForce, Wall as Wall
from .internal import BeadTemperatures as BeadTemperatures, Concentrations as Concentrations, InternalEnergy as InternalEnergy
from .mdpd import MDPD as MDPD
from .pairs import DPD as DPD, NONE as NONE, LennardJones as LennardJones, PairTable as PairTable, TabulatedPair as TabulatedPair
from .scene import Scene as Scene
from .segments import SegmentalRepulsion as SegmentalRepulsion
from .shear import LeesEdwards as LeesEdwards
from .sources import Block as Block, Source as Source, Sphere as Sphere
from .tdpd import TDPD as TDPD
from .temperature import TemperatureRamp as TemperatureRamp
