"""Bonds: harmonic, finitely extensible, Morse."""

from ...kernels.bonded import WCA_END, FENEBondTerms, HarmonicBondTerms, MorseBondTerms
from ...model.bonds import FENEBonds, HarmonicBonds, MorseBonds
from ..forces.bonded import Energy
from .bonded import BondedKind, register_bonded

register_bonded(
    BondedKind(
        terms=HarmonicBonds,
        kernel=HarmonicBondTerms,
        energies=(Energy("harmonic bonds", None),),
        style="harmonic",
        words={"k": ("energy/length^2", "K"), "r0": ("length", "r0")},
    )
)

register_bonded(
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
    )
)

register_bonded(
    BondedKind(
        terms=MorseBonds,
        kernel=MorseBondTerms,
        energies=(Energy("Morse bonds", "D*(1-exp(-alpha*(r-r0)))^2"),),
        style="morse",
        words={"D": ("energy", "D"), "alpha": ("1/length", "alpha"), "r0": ("length", "r0")},
    )
)
