"""Angles: harmonic, and the stiffness of chains."""

from ...kernels.angles import CosineAngleTerms, HarmonicAngleTerms
from ...model.angles import CosineAngles, HarmonicAngles
from ..forces.bonded import Energy
from .bonded import BondedKind, register_bonded

register_bonded(
    BondedKind(
        terms=HarmonicAngles,
        kernel=HarmonicAngleTerms,
        energies=(Energy("harmonic angles", None),),
        style="harmonic",
        words={"k": ("energy", "K"), "theta0": ("degrees", "theta0")},
    )
)

register_bonded(
    BondedKind(
        terms=CosineAngles,
        kernel=CosineAngleTerms,
        energies=(Energy("cosine angles", "k*(1+cos(theta))"),),
        style="cosine",
        words={"k": ("energy", "K")},
    )
)
