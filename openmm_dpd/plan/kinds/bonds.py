"""Bonds (harmonic, finitely extensible, Morse), angles (harmonic, and the stiffness of chains) and dihedrals (one wave, and several)."""

from ...kernels.angles import CosineAngleTerms, HarmonicAngleTerms
from ...kernels.bonded import WCA_END, FENEBondTerms, HarmonicBondTerms, MorseBondTerms
from ...kernels.dihedrals import HarmonicDihedralTerms, MultiHarmonicDihedralTerms, OPLSDihedralTerms
from ...model.angles import CosineAngles, HarmonicAngles
from ...model.bonds import FENEBonds, HarmonicBonds, MorseBonds
from ...model.dihedrals import HarmonicDihedrals, MultiHarmonicDihedrals, OPLSDihedrals
from ..forces.bonded import Energy
from .bonded import BondedKind, register_bonded

_KINDS = (
    BondedKind(
        terms=HarmonicAngles,
        kernel=HarmonicAngleTerms,
        energies=(Energy("harmonic angles", None),),
        style="harmonic",
        words={"k": ("energy", "K"), "theta0": ("degrees", "theta0")},
    ),
    BondedKind(
        terms=CosineAngles,
        kernel=CosineAngleTerms,
        energies=(Energy("cosine angles", "k*(1+cos(theta))"),),
        style="cosine",
        words={"k": ("energy", "K")},
    ),
    BondedKind(
        terms=HarmonicBonds,
        kernel=HarmonicBondTerms,
        energies=(Energy("harmonic bonds", None),),
        style="harmonic",
        words={"k": ("energy/length^2", "K"), "r0": ("length", "r0")},
    ),
    BondedKind(
        terms=FENEBonds,
        kernel=FENEBondTerms,
        # the repulsion is apart, for those that have one: at r = 0 it would give NaN even with epsilon = 0
        energies=(
            Energy("FENE bonds", "-0.5*k*R0^2*log(1-(r/R0)^2)"),
            Energy("repulsion of FENE bonds", f"step({WCA_END!r}*sigma-r)*epsilon*(4*s6*(s6-1)+1); s6=(sigma/r)^6", only="epsilon"),
        ),
        style="fene",
        words={"k": ("energy/length^2", "K"), "R0": ("length", "R0"), "epsilon": ("energy", "epsilon"), "sigma": ("length", "sigma")},
    ),
    BondedKind(
        terms=MorseBonds,
        kernel=MorseBondTerms,
        energies=(Energy("Morse bonds", "D*(1-exp(-alpha*(r-r0)))^2"),),
        style="morse",
        words={"D": ("energy", "D"), "alpha": ("1/length", "alpha"), "r0": ("length", "r0")},
    ),
    BondedKind(
        terms=HarmonicDihedrals,
        kernel=HarmonicDihedralTerms,
        energies=(Energy("harmonic dihedrals", "k*(1+d*cos(n*theta))"),),
        style="harmonic",
        words={"k": ("energy", "K"), "d": ("1", "d"), "n": ("1", "n")},
    ),
    BondedKind(
        terms=OPLSDihedrals,
        kernel=OPLSDihedralTerms,
        energies=(Energy("OPLS dihedrals", "0.5*(K1*(1+cos(theta))+K2*(1-cos(2*theta))+K3*(1+cos(3*theta))+K4*(1-cos(4*theta)))"),),
        style="opls",
        words={name: ("energy", name) for name in ("K1", "K2", "K3", "K4")},
    ),
    BondedKind(
        terms=MultiHarmonicDihedrals,
        kernel=MultiHarmonicDihedralTerms,
        energies=(Energy("multi-harmonic dihedrals", "A1+c*(A2+c*(A3+c*(A4+c*A5))); c=cos(theta)"),),
        style="multi/harmonic",
        words={name: ("energy", name) for name in ("A1", "A2", "A3", "A4", "A5")},
    ),
)
for _kind in _KINDS:
    register_bonded(_kind)
