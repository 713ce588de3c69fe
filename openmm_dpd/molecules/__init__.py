"""Molecules as data, and boxes packed with them."""

from __future__ import annotations

from .builders import bead, block_copolymer, branched, linear, lipid, ring, star, surfactant
from .mixture import Mixture
from .molecule import Molecule, formula, join, sequence
from .pack import Bilayer, Scattered, pack
from .published import Model, grafmueller_2009, like_repulsion, unlike_repulsion
from .relax import relax
from .terms import Bend, CosineBend, FENESpring, MorseSpring, Spring
from .vesicles import Vesicle

__all__ = [
    "Bend",
    "Bilayer",
    "CosineBend",
    "FENESpring",
    "Mixture",
    "Model",
    "Molecule",
    "MorseSpring",
    "Scattered",
    "Spring",
    "Vesicle",
    "bead",
    "block_copolymer",
    "branched",
    "formula",
    "grafmueller_2009",
    "join",
    "like_repulsion",
    "linear",
    "lipid",
    "pack",
    "relax",
    "ring",
    "sequence",
    "star",
    "surfactant",
    "unlike_repulsion",
]
