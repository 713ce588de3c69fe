"""Molecules as data, and boxes packed with them."""

from .builders import bead, block_copolymer, branched, linear, lipid, ring, star, surfactant
from .dense_start import DenseStart, PiercingWarning, Stage
from .mixture import Mixture
from .molecule import Molecule, formula, join, sequence
from .pack import Bilayer, Scattered, pack
from .piercings import Piercing, find_piercings
from .published import Model, grafmueller_2009, like_repulsion, unlike_repulsion
from .relax import relax
from .relax_dense import relax_dense
from .terms import Bend, CosineBend, FENESpring, MorseSpring, MultiHarmonicTwist, OPLSTwist, Spring, Twist
from .vesicles import Vesicle

__all__ = [
    "Bend",
    "Bilayer",
    "CosineBend",
    "DenseStart",
    "FENESpring",
    "Mixture",
    "Model",
    "Molecule",
    "MorseSpring",
    "MultiHarmonicTwist",
    "OPLSTwist",
    "Piercing",
    "PiercingWarning",
    "Scattered",
    "Spring",
    "Stage",
    "Twist",
    "Vesicle",
    "bead",
    "block_copolymer",
    "branched",
    "find_piercings",
    "formula",
    "grafmueller_2009",
    "join",
    "like_repulsion",
    "linear",
    "lipid",
    "pack",
    "relax",
    "relax_dense",
    "ring",
    "sequence",
    "star",
    "surfactant",
    "unlike_repulsion",
]
