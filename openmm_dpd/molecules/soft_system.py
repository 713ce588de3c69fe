"""A System of a force field with soft repulsion in the place of its nonbonded forces."""

import copy

import numpy as np
import openmm
from openmm import app, unit

from ..base.errors import ParameterError, PlanError
from ..base.geometry import pairs_within
from ..base.units import to_md
from ..plan.made import BAROSTATS, LISTED

#: Context parameter with the energy (kJ/mol) of a pair at distance 0.
STRENGTH = "soft_strength"
#: Forces between all atoms, which soft repulsion replaces.
REPLACED = (openmm.NonbondedForce, openmm.CustomNonbondedForce, openmm.GBSAOBCForce, openmm.CustomGBForce, openmm.CustomHbondForce)
#: What has no place in a relaxation: box and momentum stay, and the temperature is held by friction.
LEFT_OUT = (*BAROSTATS, openmm.CMMotionRemover, openmm.AndersenThermostat)
#: Mass of every atom that moves, Da: light hydrogens would need short steps.
MASS = 12.0
#: Force constant of bonds in the place of constraints, kJ/mol/nm^2: a bit less than force fields give to bonds to hydrogen.
BOND = 2.5e5
#: The van der Waals diameter of hydrogens without one of their own, nm: they keep off the charge of others.
HYDROGEN = 0.1
#: Radius of what repels nothing: negative together with any other one.
NONE = -1e3


def atom_diameters(system: openmm.System, topology: app.Topology, given=None) -> np.ndarray:
    """Van der Waals diameters, (N,) in nm, those that are given or else; 0 for particles that repel nothing.

    They are the sigma of the NonbondedForce where it has a well depth.  Where it has none, virtual sites get 0, hydrogens 0.1 nm, and
    other atoms (CHARMM's, whose Lennard-Jones terms are in a CustomNonbondedForce) twice the van der Waals radius of their element in
    mdtraj's table; ParameterError if there is no element either.
    """
    n = system.getNumParticles()
    if given is not None:
        found = np.asarray(to_md(given, "length", "diameters"))
        if found.shape != (n,) or np.any(found < 0):
            raise ParameterError(f"diameters must be {n} lengths >= 0, one for each particle of the System")
        return found
    from mdtraj.core.element import Element

    force = nonbonded_of(system)
    found = np.zeros(n)
    for k, atom in enumerate(topology.atoms()):
        _, sigma, epsilon = force.getParticleParameters(k)
        if epsilon.value_in_unit(unit.kilojoule_per_mole) > 0:
            found[k] = sigma.value_in_unit(unit.nanometer)
        elif system.isVirtualSite(k):
            continue
        elif atom.element is app.element.hydrogen:
            found[k] = HYDROGEN
        elif atom.element is None:
            raise ParameterError(
                f"nothing says how large atom {atom.name} of {atom.residue.name} {atom.residue.id} is: it has no Lennard-Jones well in "
                "the NonbondedForce and no element; give diameters"
            )
        else:
            found[k] = 2 * Element.getBySymbol(atom.element.symbol).radius
    return found


def nonbonded_of(system: openmm.System) -> openmm.NonbondedForce:
    """The NonbondedForce; PlanError if there is not just one."""
    found = [force for force in system.getForces() if isinstance(force, openmm.NonbondedForce)]
    if len(found) != 1:
        raise PlanError(
            f"the System has {len(found)} NonbondedForces; one is needed, for the pairs that do not repel each other (its exceptions) "
            "and the sizes of the atoms"
        )
    return found[0]


def excluded_pairs(system: openmm.System) -> np.ndarray:
    """Pairs with an exception in the NonbondedForce, (E, 2), sorted: neighbours over up to three bonds, as a rule.  Other forces between
    all atoms exclude the same pairs, which the CPU and GPU platforms ask of them."""
    force = nonbonded_of(system)
    pairs = sorted(tuple(sorted(force.getExceptionParameters(k)[:2])) for k in range(force.getNumExceptions()))
    return np.array(pairs, dtype=np.int64).reshape(-1, 2)


def replaced_forces(system: openmm.System) -> list[str]:
    """Names of the classes of forces that soft repulsion stands for; PlanError if there is one that can neither stay nor be replaced."""
    for force in system.getForces():
        if not isinstance(force, (*LISTED, *REPLACED, *LEFT_OUT)):
            raise PlanError(
                f"the System has a {type(force).__name__}, and a soft start does not know whether that may stay; relax a System without it"
            )
    return sorted({type(force).__name__ for force in system.getForces() if isinstance(force, REPLACED)})


def soft_system(system: openmm.System, sizes: np.ndarray, reach: float, *, mobile: np.ndarray, periodic: bool) -> openmm.System:
    r"""A copy with bonded forces and virtual sites as they were, and soft repulsion

    .. math:: U(r) = \frac{E}{2} \left(1 - \frac{r}{r_c}\right)^2 \quad (r < r_c), \qquad r_c = c\,\frac{\sigma_i + \sigma_j}{2},

    that of DPD with A = E/r_c (R. D. Groot and P. B. Warren, J. Chem. Phys. 107, 4423 (1997)), between all pairs that the force field does
    not exclude, with ``sizes`` sigma (nm; 0 for none) and the factor c = ``reach``.  E is the Context parameter ``soft_strength``.
    Constraints become stiff bonds, and every atom that moves by itself (``mobile``) has the same mass.
    """
    soft = copy.deepcopy(system)
    for k in reversed(range(system.getNumForces())):
        if isinstance(soft.getForce(k), LISTED):
            soft.getForce(k).setForceGroup(0)
        else:
            soft.removeForce(k)
    bonds = openmm.HarmonicBondForce()  # as constraints, without minimum images
    for k in reversed(range(system.getNumConstraints())):
        bonds.addBond(*system.getConstraintParameters(k), BOND)
        soft.removeConstraint(k)
    soft.addForce(bonds)
    for k, moves in enumerate(mobile):
        soft.setParticleMass(k, MASS if moves else 0.0)
    repulsion = openmm.CustomNonbondedForce(f"0.5*{STRENGTH}*step(rc-r)*(1-r/rc)^2; rc=radius1+radius2")
    repulsion.addGlobalParameter(STRENGTH, 0.0)
    repulsion.addPerParticleParameter("radius")
    for size in sizes:
        repulsion.addParticle([0.5 * reach * size if size else NONE])
    for i, j in excluded_pairs(system).tolist():
        repulsion.addExclusion(i, j)
    repulsion.setNonbondedMethod(repulsion.CutoffPeriodic if periodic else repulsion.CutoffNonPeriodic)
    repulsion.setCutoffDistance(reach * float(sizes.max()))
    soft.addForce(repulsion)
    return soft


def largest_overlap(x: np.ndarray, sizes: np.ndarray, excluded: np.ndarray, box: np.ndarray | None) -> float:
    """Largest 1 - r/sigma_ij of the pairs that are not excluded, sigma_ij the mean of their diameters; 0 if none is closer than that."""
    seen = np.flatnonzero(sizes > 0)
    i, j, r = pairs_within(x[seen], None, box, float(sizes.max()))
    i, j = np.minimum(seen[i], seen[j]), np.maximum(seen[i], seen[j])
    free = ~np.isin(i * len(x) + j, excluded @ np.array([len(x), 1]))
    return float(np.max(1 - r[free] / (0.5 * (sizes[i[free]] + sizes[j[free]])), initial=0.0))
