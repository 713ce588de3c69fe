"""Two Systems as one: atoms with the forces of a force field, and beads that these forces do not see."""

import copy

import openmm

from ...base.errors import PlanError
from ..made import BAROSTATS, LISTED, groups_of

#: Per-particle parameter that says whether a particle of a CustomNonbondedForce is an atom.
_ATOM = "dpd_atom"
#: Forces that need nothing for further particles.
_LISTED = (*LISTED, openmm.CustomHbondForce, *BAROSTATS)


def merged_systems(atoms: openmm.System, beads: openmm.System, pair_group: int) -> tuple[openmm.System, list[openmm.Force]]:
    """The atoms' System with the beads added, and the forces among its own that are the beads'.  ``beads`` is the System that was built for
    all particles, without the forces of the atoms; its pair force stays in ``pair_group``, where the atoms have none, and its other forces
    go to groups that are free."""
    n, total = atoms.getNumParticles(), beads.getNumParticles()
    merged = copy.deepcopy(atoms)
    for k in range(n, total):
        merged.addParticle(beads.getParticleMass(k))
    merged.setDefaultPeriodicBoxVectors(*beads.getDefaultPeriodicBoxVectors())
    own = [copy.deepcopy(force) for force in beads.getForces()]
    pairs = [force for force in own if isinstance(force, openmm.CustomNonbondedForce)]
    excluded = sorted({pair for force in pairs for pair in _exclusions(force) if max(pair) >= n})
    theirs: set[tuple[int, int]] = set()
    unlisted = False
    for force in merged.getForces():
        theirs |= _take_beads(force, n, total, excluded)
        unlisted |= isinstance(force, (openmm.NonbondedForce, openmm.CustomNonbondedForce)) and force.getNonbondedMethod() == force.NoCutoff
    for force in pairs:
        if unlisted:  # platforms ask that all forces agree about it; ours are 0 beyond their cutoffs in any case
            force.setNonbondedMethod(force.NoCutoff)
        for i, j in sorted(theirs - _exclusions(force)):
            force.addExclusion(i, j)
    free = iter(sorted(set(range(32)) - set().union({0, pair_group}, *map(groups_of, merged.getForces()))))
    moved: dict[int, int] = {pair_group: pair_group}
    for force in own:
        group = force.getForceGroup()
        if group not in moved:
            moved[group] = next(free, -1)
            if moved[group] < 0:
                raise PlanError("the forces of atoms and beads need more than 32 force groups")
        force.setForceGroup(moved[group])
        merged.addForce(force)
    return merged, merged.getForces()[atoms.getNumForces() :]


def _take_beads(force: openmm.Force, n: int, total: int, excluded: list[tuple[int, int]]) -> set[tuple[int, int]]:
    """Make room for beads in a force of the atoms, in which they do nothing; returns the pairs of atoms that it excludes."""
    if isinstance(force, openmm.NonbondedForce):
        theirs = {tuple(sorted(force.getExceptionParameters(k)[:2])) for k in range(force.getNumExceptions())}
        for _ in range(n, total):
            force.addParticle(0.0, 0.0, 0.0)  # sigma 0 as well: (sigma/r)^12 would overflow where beads overlap
        for i, j in excluded:
            force.addException(i, j, 0.0, 1.0, 0.0)
        return theirs
    if isinstance(force, openmm.CustomNonbondedForce):
        theirs = _exclusions(force)
        _mask(force, n, total)
        for i, j in excluded:
            force.addExclusion(i, j)
        return theirs
    if isinstance(force, openmm.CustomCVForce):
        for k in range(force.getNumCollectiveVariables()):
            _take_beads(force.getCollectiveVariable(k), n, total, excluded)
        return set()
    if not isinstance(force, _LISTED):
        raise PlanError(
            f"the System has a {type(force).__name__}, which needs parameters for every particle, "
            "and there are none that would leave beads out"
        )
    return set()


def _mask(force: openmm.CustomNonbondedForce, n: int, total: int) -> None:
    """Add beads to a CustomNonbondedForce of atoms.  select() takes one of its branches, so that an infinite one does no harm."""
    names = [force.getPerParticleParameterName(k) for k in range(force.getNumPerParticleParameters())]
    if _ATOM in names:
        raise PlanError(f"a CustomNonbondedForce has a parameter called {_ATOM} already: are there beads in the System?")
    values = [force.getParticleParameters(k) for k in range(n)]
    if force.getNumInteractionGroups():
        for _ in range(n, total):
            force.addParticle(values[0])  # beads are in none of the groups
        return
    head, *rest = force.getEnergyFunction().split(";")
    force.setEnergyFunction(";".join([f"select({_ATOM}1*{_ATOM}2, {head}, 0)", *rest]))
    force.addPerParticleParameter(_ATOM)
    for k in range(n):
        force.setParticleParameters(k, [*values[k], 1.0])
    for _ in range(n, total):
        force.addParticle([*values[0], 0.0])


def _exclusions(force: openmm.CustomNonbondedForce) -> set[tuple[int, int]]:
    return {tuple(sorted(force.getExclusionParticles(k))) for k in range(force.getNumExclusions())}
