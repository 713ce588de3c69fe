"""Bonds and angles as forces of OpenMM."""

from collections.abc import Callable, Sequence

import openmm

from ..model.angles import Angles, CosineAngles, HarmonicAngles
from ..model.bonds import WCA_END, Bonds, FENEBonds, HarmonicBonds, MorseBonds
from ..names import MOLECULE_GROUP


def bonded_forces(bonds: Sequence[Bonds], angles: Sequence[Angles], periodic: bool) -> list[openmm.Force]:
    """Forces of all bonds and angles, those of each kind that there is."""
    makers: dict[type, Callable[[Sequence], list[openmm.Force]]] = {
        **{HarmonicBonds: _harmonic_bonds, FENEBonds: _fene_bonds, MorseBonds: _morse_bonds},
        **{HarmonicAngles: _harmonic_angles, CosineAngles: _cosine_angles},
    }
    made: list[openmm.Force] = []
    for kind, maker in makers.items():
        chosen = [group for group in (*bonds, *angles) if isinstance(group, kind) and len(group.beads)]
        made += maker(chosen) if chosen else []
    for force in made:
        force.setUsesPeriodicBoundaryConditions(periodic)
    return made


#: Name of the force that only says which beads are bonded.
MOLECULES = "molecules"


def molecules(pairs) -> openmm.CustomBondForce:
    """A force without an energy between bonded beads (B, 2), from which OpenMM finds molecules: barostats move each as a whole."""
    force = openmm.CustomBondForce("0")
    force.setName(MOLECULES)
    force.setForceGroup(MOLECULE_GROUP)
    for i, j in pairs.tolist():
        force.addBond(i, j, [])
    return force


def _rows(groups, *columns: str):
    """Beads and coefficients of all terms of some groups."""
    for group in groups:
        beads, *values = (getattr(group, column).tolist() for column in columns)
        yield from zip(beads, *values, strict=True)


def _harmonic_bonds(groups: Sequence[HarmonicBonds]) -> list[openmm.Force]:
    """U = k (r - r0)^2; OpenMM's own constant is 2k."""
    force = openmm.HarmonicBondForce()
    force.setName("harmonic bonds")
    for (i, j), k, r0 in _rows(groups, "pairs", "k", "r0"):
        force.addBond(i, j, r0, 2 * k)
    return [force]


def _custom_bonds(expression: str, names: Sequence[str], name: str) -> openmm.CustomBondForce:
    force = openmm.CustomBondForce(expression)
    force.setName(name)
    for parameter in names:
        force.addPerBondParameter(parameter)
    return force


def _fene_bonds(groups: Sequence[FENEBonds]) -> list[openmm.Force]:
    """The spring, and apart from it the repulsion of the bonds that have one: at r = 0 it would give NaN even with epsilon = 0."""
    spring = _custom_bonds("-0.5*k*R0^2*log(1-(r/R0)^2)", ("k", "R0"), "FENE bonds")
    repulsion = _custom_bonds(
        f"step({WCA_END!r}*sigma-r)*epsilon*(4*s6*(s6-1)+1); s6=(sigma/r)^6", ("epsilon", "sigma"), "repulsion of FENE bonds"
    )
    for (i, j), k, longest, epsilon, sigma in _rows(groups, "pairs", "k", "R0", "epsilon", "sigma"):
        spring.addBond(i, j, [k, longest])
        if epsilon > 0:
            repulsion.addBond(i, j, [epsilon, sigma])
    return [spring, repulsion] if repulsion.getNumBonds() else [spring]


def _morse_bonds(groups: Sequence[MorseBonds]) -> list[openmm.Force]:
    names = "D", "alpha", "r0"
    force = _custom_bonds("D*(1-exp(-alpha*(r-r0)))^2", names, "Morse bonds")
    for (i, j), *values in _rows(groups, "pairs", *names):
        force.addBond(i, j, values)
    return [force]


def _harmonic_angles(groups: Sequence[HarmonicAngles]) -> list[openmm.Force]:
    """U = k (theta - theta0)^2; OpenMM's own constant is 2k."""
    force = openmm.HarmonicAngleForce()
    force.setName("harmonic angles")
    for beads, k, theta0 in _rows(groups, "triples", "k", "theta0"):
        force.addAngle(*beads, theta0, 2 * k)
    return [force]


def _cosine_angles(groups: Sequence[CosineAngles]) -> list[openmm.Force]:
    force = openmm.CustomAngleForce("k*(1+cos(theta))")
    force.setName("cosine angles")
    force.addPerAngleParameter("k")
    for beads, k in _rows(groups, "triples", "k"):
        force.addAngle(*beads, [k])
    return [force]
