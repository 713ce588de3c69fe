"""Bonds and angles as forces of OpenMM."""

from collections.abc import Sequence

import openmm

from ..model.angles import Angles, CosineAngles, HarmonicAngles
from ..model.bonds import WCA_END, Bonds, FENEBonds, HarmonicBonds, MorseBonds
from ..names import MOLECULE_GROUP

_REPULSION = f"step({WCA_END!r}*sigma-r)*epsilon*(4*s6*(s6-1)+1); s6=(sigma/r)^6"

#: Kind of bonds or angles, name of the force, its energy, and which coefficients that has.  OpenMM's own forces have no expression.
#: The repulsion of FENE bonds is apart from the spring, for those that have one: at r = 0 it would give NaN even with epsilon = 0.
_FORCES = (
    (HarmonicBonds, "harmonic bonds", None, ("k", "r0")),
    (FENEBonds, "FENE bonds", "-0.5*k*R0^2*log(1-(r/R0)^2)", ("k", "R0")),
    (FENEBonds, "repulsion of FENE bonds", _REPULSION, ("epsilon", "sigma")),
    (MorseBonds, "Morse bonds", "D*(1-exp(-alpha*(r-r0)))^2", ("D", "alpha", "r0")),
    (HarmonicAngles, "harmonic angles", None, ("k", "theta0")),
    (CosineAngles, "cosine angles", "k*(1+cos(theta))", ("k",)),
)


def bonded_forces(bonds: Sequence[Bonds], angles: Sequence[Angles], periodic: bool) -> list[openmm.Force]:
    """Forces of all bonds and angles, those of each kind that there is."""
    made = []
    for kind, name, energy, names in _FORCES:
        groups = [group for group in (*bonds, *angles) if isinstance(group, kind)]
        rows = [row for group in groups for row in zip(group.beads.tolist(), *(getattr(group, c).tolist() for c in names), strict=True)]
        rows = [row for row in rows if names[0] != "epsilon" or row[1] > 0]
        if rows:
            made.append(_harmonic(rows) if energy is None else _custom(rows, energy, names))
            made[-1].setName(name)
            made[-1].setUsesPeriodicBoundaryConditions(periodic)
    return made


def _harmonic(rows: list[tuple]) -> openmm.Force:
    """U = k (x - x0)^2; OpenMM's own constant is 2k."""
    pairs = len(rows[0][0]) == 2
    force = openmm.HarmonicBondForce() if pairs else openmm.HarmonicAngleForce()
    for beads, k, rest in rows:
        (force.addBond if pairs else force.addAngle)(*beads, rest, 2 * k)
    return force


def _custom(rows: list[tuple], energy: str, names: Sequence[str]) -> openmm.Force:
    pairs = len(rows[0][0]) == 2
    force = openmm.CustomBondForce(energy) if pairs else openmm.CustomAngleForce(energy)
    for name in names:
        (force.addPerBondParameter if pairs else force.addPerAngleParameter)(name)
    for beads, *values in rows:
        (force.addBond if pairs else force.addAngle)(*beads, values)
    return force


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
