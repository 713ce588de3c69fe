"""Molecules as data, and boxes packed with molecules."""

from .bodies import body_shape as body_shape, suspension as suspension
from .builders import (
    Model as Model,
    bead as bead,
    block_copolymer as block_copolymer,
    branched as branched,
    grafmueller_2009 as grafmueller_2009,
    like_repulsion as like_repulsion,
    linear as linear,
    lipid as lipid,
    ring as ring,
    star as star,
    surfactant as surfactant,
    unlike_repulsion as unlike_repulsion,
)
from .frozen_layer import frozen_layer as frozen_layer
from .mixture import Mixture as Mixture
from .molecule import Molecule as Molecule, formula as formula, join as join, sequence as sequence
from .pack import Bilayer as Bilayer, Scattered as Scattered, pack as pack
from .piercings import Piercing as Piercing, find_piercings as find_piercings
from .relax import relax as relax
from .relax_dense import DenseStart as DenseStart, PiercingWarning as PiercingWarning, Stage as Stage, relax_dense as relax_dense
from .terms import (
    Bend as Bend,
    CosineBend as CosineBend,
    FENESpring as FENESpring,
    MorseSpring as MorseSpring,
    MultiHarmonicTwist as MultiHarmonicTwist,
    OPLSTwist as OPLSTwist,
    Spring as Spring,
    Twist as Twist,
)
from .vesicles import Vesicle as Vesicle
