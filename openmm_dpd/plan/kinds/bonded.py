"""Kinds of bonds, angles, dihedrals and impropers: their record, the register, and those that there are."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np
import openmm

from ...base.errors import ParameterError
from ...base.serialized import trust
from ...kernels import bonded as compiled, impropers
from ...kernels.extras import BondedKernel
from ...model.angles import (
    CosineAngles,
    CosineDeltaAngles,
    CosineSquaredAngles,
    HarmonicAngles,
    HarmonicDihedrals,
    MultiHarmonicDihedrals,
    OPLSDihedrals,
    PeriodicAngles,
)
from ...model.bonds import WCA_END, BondedTerms, FENEBonds, HarmonicBonds, MorseBonds
from ...model.impropers import CosineImpropers, HarmonicImpropers, UmbrellaImpropers
from ...model.limited_bonds import NonlinearBonds, QuarticBonds
from ..forces.bonded import Energy, bonded_force


@dataclass(frozen=True, eq=False, kw_only=True)
class BondedKind:
    """One kind of bonds, angles, dihedrals or impropers."""

    #: A frozen dataclass, a :class:`~openmm_dpd.model.bonds.Bonds`, :class:`~openmm_dpd.model.angles.Angles`,
    #: :class:`~openmm_dpd.model.angles.Dihedrals` or :class:`~openmm_dpd.model.impropers.Impropers`: coefficients with bounds, energy and
    #: two derivatives.
    terms: type[BondedTerms]
    #: The same terms for compiled loops: a :class:`~openmm_dpd.kernels.bonded.BondTerms`, :class:`~openmm_dpd.kernels.bonded.AngleTerms` or
    #: :class:`~openmm_dpd.kernels.bonded.DihedralTerms` with a formula.
    kernel: type[BondedKernel]
    #: The same terms as forces of OpenMM's.  The first one has the name of the kind, such as "harmonic bonds".
    energies: tuple[Energy, ...]
    style: str | None = None  #: Name in LAMMPS; without one the kind is neither read nor exported
    #: Coefficients in the order of LAMMPS's: their dimension (:data:`openmm_dpd.lammps.styles.words.FACTORS`) and their name there.
    words: Mapping[str, tuple[str, str]] = field(default_factory=dict)

    def __post_init__(self):
        if len(self.kernel.sample) != self.width:
            raise ParameterError(f"the kernel of the kind {self.terms.__name__} is for {len(self.kernel.sample)} beads, not {self.width}")

    @property
    def width(self) -> int:
        """Beads of each term."""
        return self.terms._BEADS[1]

    @property
    def what(self) -> str:
        """What one term is: ``bond``, ``angle``, ``dihedral`` or ``improper``."""
        return self.terms._BEADS[2]

    @property
    def name(self) -> str:
        """What its terms are called."""
        return self.energies[0].name


#: All kinds, by their classes.
BONDED_KINDS: dict[type[BondedTerms], BondedKind] = {}


def register_bonded(kind: BondedKind) -> BondedKind:
    """Make a kind known to the package; ParameterError if there is another one for its class, or of its name."""
    if BONDED_KINDS.get(kind.terms, kind) is not kind:
        raise ParameterError(f"there is a kind for {kind.terms.__name__} already")
    if any(known.name == kind.name for known in BONDED_KINDS.values() if known is not kind):
        raise ParameterError(f"there are {kind.name} already; give the energy of {kind.terms.__name__} another name")
    BONDED_KINDS[kind.terms] = kind
    trust(kind.terms.__module__, kind.kernel.__module__)
    return kind


def bonded_kind(terms: type[BondedTerms]) -> BondedKind:
    """The kind of a class of bonds, angles, dihedrals or impropers; ParameterError if none was registered."""
    if terms not in BONDED_KINDS:
        raise ParameterError(f"nothing is known of {terms.__name__}; register their kind (openmm_dpd.plan.kinds.register_bonded)")
    return BONDED_KINDS[terms]


def bonded_forces(groups: Sequence[BondedTerms], periodic: bool) -> list[openmm.Force]:
    """Forces of OpenMM's for bonds, angles, dihedrals and impropers, those of each kind that there is."""
    made = []
    for kind in sorted(BONDED_KINDS.values(), key=lambda kind: kind.width):
        found = [group for group in groups if type(group) is kind.terms]
        made += [bonded_force(energy, found, periodic) for energy in kind.energies if found]
    return [force for force in made if force is not None]


_KINDS = (
    BondedKind(
        terms=HarmonicAngles,
        kernel=compiled.HarmonicAngleTerms,
        energies=(Energy("harmonic angles", None),),
        style="harmonic",
        words={"k": ("energy", "K"), "theta0": ("degrees", "theta0")},
    ),
    BondedKind(
        terms=CosineAngles,
        kernel=compiled.CosineAngleTerms,
        energies=(Energy("cosine angles", "k*(1+cos(theta))"),),
        style="cosine",
        words={"k": ("energy", "K")},
    ),
    BondedKind(
        terms=CosineDeltaAngles,
        kernel=compiled.CosineDeltaAngleTerms,
        energies=(Energy("cosine delta angles", "k*(1-cos(theta-theta0))"),),
        style="cosine/delta",
        words={"k": ("energy", "K"), "theta0": ("degrees", "theta0")},
    ),
    BondedKind(
        terms=CosineSquaredAngles,
        kernel=compiled.CosineSquaredAngleTerms,
        energies=(Energy("cosine squared angles", "k*(cos(theta)-cos(theta0))^2"),),
        style="cosine/squared",
        words={"k": ("energy", "K"), "theta0": ("degrees", "theta0")},
    ),
    BondedKind(
        terms=PeriodicAngles,
        kernel=compiled.PeriodicAngleTerms,
        # (-1)^n cos(n theta) is cos(n (theta - pi))
        energies=(Energy("periodic angles", f"2*C/n^2*(1-B*cos(n*(theta-{np.pi!r})))"),),
        style="cosine/periodic",
        words={"C": ("energy", "C"), "B": ("1", "B"), "n": ("1", "n")},
    ),
    BondedKind(
        terms=HarmonicBonds,
        kernel=compiled.HarmonicBondTerms,
        energies=(Energy("harmonic bonds", None),),
        style="harmonic",
        words={"k": ("energy/length^2", "K"), "r0": ("length", "r0")},
    ),
    BondedKind(
        terms=FENEBonds,
        kernel=compiled.FENEBondTerms,
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
        kernel=compiled.MorseBondTerms,
        energies=(Energy("Morse bonds", "D*(1-exp(-alpha*(r-r0)))^2"),),
        style="morse",
        words={"D": ("energy", "D"), "alpha": ("1/length", "alpha"), "r0": ("length", "r0")},
    ),
    BondedKind(
        terms=NonlinearBonds,
        kernel=compiled.NonlinearBondTerms,
        energies=(Energy("nonlinear bonds", "epsilon*(r-r0)^2/(lamda^2-(r-r0)^2)"),),
        style="nonlinear",
        words={"epsilon": ("energy", "epsilon"), "r0": ("length", "r0"), "lamda": ("length", "lambda")},
    ),
    BondedKind(
        terms=QuarticBonds,
        kernel=compiled.QuarticBondTerms,
        energies=(
            Energy(
                "quartic bonds",
                f"k*s^2*(s-B1)*(s-B2)+U0+step({WCA_END!r}-r)*(4*s6*(s6-1)+1); s=r-Rc; s6=1/r^6",
            ),
        ),
        style="quartic",
        words={
            **{"k": ("energy/length^4", "K"), "B1": ("length", "B1"), "B2": ("length", "B2")},
            **{"Rc": ("length", "Rc"), "U0": ("energy", "U0")},
        },
    ),
    BondedKind(
        terms=HarmonicDihedrals,
        kernel=compiled.HarmonicDihedralTerms,
        energies=(Energy("harmonic dihedrals", "k*(1+d*cos(n*theta))"),),
        style="harmonic",
        words={"k": ("energy", "K"), "d": ("1", "d"), "n": ("1", "n")},
    ),
    BondedKind(
        terms=OPLSDihedrals,
        kernel=compiled.OPLSDihedralTerms,
        energies=(Energy("OPLS dihedrals", "0.5*(K1*(1+cos(theta))+K2*(1-cos(2*theta))+K3*(1+cos(3*theta))+K4*(1-cos(4*theta)))"),),
        style="opls",
        words={name: ("energy", name) for name in ("K1", "K2", "K3", "K4")},
    ),
    BondedKind(
        terms=MultiHarmonicDihedrals,
        kernel=compiled.MultiHarmonicDihedralTerms,
        energies=(Energy("multi-harmonic dihedrals", "A1+c*(A2+c*(A3+c*(A4+c*A5))); c=cos(theta)"),),
        style="multi/harmonic",
        words={name: ("energy", name) for name in ("A1", "A2", "A3", "A4", "A5")},
    ),
    BondedKind(
        terms=HarmonicImpropers,
        kernel=impropers.HarmonicImproperTerms,
        energies=(Energy("harmonic impropers", "k*(abs(theta)-chi0)^2"),),
        style="harmonic",
        words={"k": ("energy", "K"), "chi0": ("degrees", "chi")},
    ),
    BondedKind(
        terms=CosineImpropers,
        kernel=impropers.CosineImproperTerms,
        energies=(Energy("cosine impropers", "k*(1+d*cos(n*theta))"),),
        style="cvff",
        words={"k": ("energy", "K"), "d": ("1", "d"), "n": ("1", "n")},
    ),
    BondedKind(
        terms=UmbrellaImpropers,
        kernel=impropers.UmbrellaImproperTerms,
        # of the cosines of the three angles at the first bead
        energies=(
            Energy(
                "umbrella impropers",
                "select(omega0,0.5*k/sin(omega0+delta(omega0))^2*(c-cos(omega0))^2,k*(1-c))"
                "; c=(1-2*step(a+b))*sqrt((a^2+b^2-2*a*b*g)/(1-g^2))"
                "; a=cos(angle(p2,p1,p4)); b=cos(angle(p3,p1,p4)); g=cos(angle(p2,p1,p3))",
                compound=True,
            ),
        ),
        style="umbrella",
        words={"k": ("energy", "K"), "omega0": ("degrees", "omega0")},
    ),
)
for _kind in _KINDS:
    register_bonded(_kind)
