"""Bonds, angles, dihedrals and impropers as forces of OpenMM."""

import re
from collections.abc import Sequence
from functools import partial
from typing import Any, NamedTuple

import openmm

from ...base.names import MOLECULE_GROUP
from ...model.bonds import BondedTerms


class Energy(NamedTuple):
    """One force for a kind of terms: its name, and its energy with the coefficients by name; None for U = k (x - x0)^2 of the first two.
    ``only`` is the coefficient that has to be > 0, or a term has no part in it; ``compound``: whether it is of several angles at once."""

    name: str
    text: str | None
    only: str | None = None
    compound: bool = False


#: OpenMM's forces by the number of beads of a term: the harmonic one, the one with an expression, and what their methods call a term.
_FORCES: dict[int, tuple[Any, Any, str]] = {
    2: (openmm.HarmonicBondForce, openmm.CustomBondForce, "Bond"),
    3: (openmm.HarmonicAngleForce, openmm.CustomAngleForce, "Angle"),
    4: (None, openmm.CustomTorsionForce, "Torsion"),
}
_COMPOUND: tuple[Any, Any, str] = (None, partial(openmm.CustomCompoundBondForce, 4), "Bond")


def bonded_force(energy: Energy, groups: Sequence[BondedTerms], periodic: bool) -> openmm.Force | None:
    """The force with this energy for all terms of several groups of one kind; None if there are none."""
    names = [name for name in groups[0]._DIMENSIONS if energy.text is None or re.search(rf"\b{name}\b", energy.text)]
    rows = [
        (beads, values)
        for group in groups
        for beads, *values in zip(group.beads.tolist(), *(getattr(group, name).tolist() for name in names), strict=True)
        if energy.only is None or values[names.index(energy.only)] > 0
    ]
    if not rows:
        return None
    harmonic, custom, what = _COMPOUND if energy.compound else _FORCES[len(rows[0][0])]
    force = harmonic() if energy.text is None else custom(energy.text)
    add = getattr(force, f"add{what}")
    for name in names if energy.text is not None else ():
        getattr(force, f"addPer{what}Parameter")(name)
    for beads, values in rows:
        if energy.text is None:
            k, rest = values
            add(*beads, rest, 2 * k)  # OpenMM's own constant
        else:
            add(*([beads] if energy.compound else beads), values)
    force.setName(energy.name)
    force.setUsesPeriodicBoundaryConditions(periodic)
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
