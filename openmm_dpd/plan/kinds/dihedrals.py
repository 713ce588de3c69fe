"""Dihedrals: one wave, and several."""

from ...kernels.dihedrals import HarmonicDihedralTerms, MultiHarmonicDihedralTerms, OPLSDihedralTerms
from ...model.dihedrals import HarmonicDihedrals, MultiHarmonicDihedrals, OPLSDihedrals
from ..forces.bonded import Energy
from .bonded import BondedKind, register_bonded

register_bonded(
    BondedKind(
        terms=HarmonicDihedrals,
        kernel=HarmonicDihedralTerms,
        energies=(Energy("harmonic dihedrals", "k*(1+d*cos(n*theta))"),),
        style="harmonic",
        words={"k": ("energy", "K"), "d": ("1", "d"), "n": ("1", "n")},
    )
)

register_bonded(
    BondedKind(
        terms=OPLSDihedrals,
        kernel=OPLSDihedralTerms,
        energies=(Energy("OPLS dihedrals", "0.5*(K1*(1+cos(theta))+K2*(1-cos(2*theta))+K3*(1+cos(3*theta))+K4*(1-cos(4*theta)))"),),
        style="opls",
        words={name: ("energy", name) for name in ("K1", "K2", "K3", "K4")},
    )
)

register_bonded(
    BondedKind(
        terms=MultiHarmonicDihedrals,
        kernel=MultiHarmonicDihedralTerms,
        energies=(Energy("multi-harmonic dihedrals", "A1+c*(A2+c*(A3+c*(A4+c*A5))); c=cos(theta)"),),
        style="multi/harmonic",
        words={name: ("energy", name) for name in ("A1", "A2", "A3", "A4", "A5")},
    )
)
