"""Copy of a force field's System with soft repulsion in place of its nonbonded forces."""

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
#: Forces between all atoms, which the soft repulsion replaces.
REPLACED = (openmm.NonbondedForce, openmm.CustomNonbondedForce, openmm.GBSAOBCForce, openmm.CustomGBForce, openmm.CustomHbondForce)
#: Forces to leave out in a relaxation: box and momentum are kept, and friction controls the temperature.
LEFT_OUT = (*BAROSTATS, openmm.CMMotionRemover, openmm.AndersenThermostat)
#: Mass of every mobile atom, Da: light hydrogens would need short steps.
MASS = 12.0
#: Force constant of bonds in place of constraints, kJ/mol/nm^2: a bit less than that of bonds to hydrogen in force fields.
BOND = 2.5e5
#: Van der Waals diameter of hydrogens that have none in the force field, nm; it keeps them from charges of other atoms.
HYDROGEN = 0.1
#: Radius of particles without repulsion, so negative that its sum with any other radius is, too.
NONE = -1e3


def atom_diameters(system: openmm.System, topology: app.Topology, given=None) -> np.ndarray:
    """Van der Waals diameters, (N,) in nm, as given or by default; 0 for particles without repulsion.

    The default is sigma of the NonbondedForce if it has a well depth.  If not, it is 0 for virtual sites, 0.1 nm for hydrogens, and twice
    the van der Waals radius of the element in mdtraj's table for other atoms (such as CHARMM's, whose Lennard-Jones terms are in a
    CustomNonbondedForce); ParameterError without an element.
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
                f"the size of atom {atom.name} of {atom.residue.name} {atom.residue.id} is unknown: it has no Lennard-Jones well in "
                "the NonbondedForce and no element; give diameters"
            )
        else:
            found[k] = 2 * Element.getBySymbol(atom.element.symbol).radius
    return found


def nonbonded_of(system: openmm.System) -> openmm.NonbondedForce:
    """The System's NonbondedForce; PlanError if there is none or more than one."""
    found = [force for force in system.getForces() if isinstance(force, openmm.NonbondedForce)]
    if len(found) != 1:
        raise PlanError(
            f"the System has {len(found)} NonbondedForces; exactly one is needed, for excluded pairs (its exceptions) and the sizes of the "
            "atoms"
        )
    return found[0]


def excluded_pairs(system: openmm.System) -> np.ndarray:
    """Pairs with an exception in the NonbondedForce, (E, 2), sorted: as a rule, atoms up to three bonds apart.  Other forces between all
    atoms exclude the same pairs, as the CPU and GPU platforms require."""
    force = nonbonded_of(system)
    pairs = sorted(tuple(sorted(force.getExceptionParameters(k)[:2])) for k in range(force.getNumExceptions()))
    return np.array(pairs, dtype=np.int64).reshape(-1, 2)


def replaced_forces(system: openmm.System) -> list[str]:
    """Class names of the forces that the soft repulsion replaces; PlanError for a force that can neither be kept nor replaced."""
    for force in system.getForces():
        if not isinstance(force, (*LISTED, *REPLACED, *LEFT_OUT)):
            raise PlanError(
                f"the System has a {type(force).__name__}, which a soft start can neither keep nor replace; relax a System without it"
            )
    return sorted({type(force).__name__ for force in system.getForces() if isinstance(force, REPLACED)})


def soft_system(system: openmm.System, sizes: np.ndarray, reach: float, *, mobile: np.ndarray, periodic: bool) -> openmm.System:
    r"""Copy of a System with its bonded forces and virtual sites, and the soft repulsion

    .. math:: U(r) = \frac{E}{2} \left(1 - \frac{r}{r_c}\right)^2 \quad (r < r_c), \qquad r_c = c\,\frac{\sigma_i + \sigma_j}{2},

    of DPD with A = E/r_c (R. D. Groot and P. B. Warren, J. Chem. Phys. 107, 4423 (1997)), between all pairs that the force field does not
    exclude, with ``sizes`` sigma (nm; 0 for none) and the factor c = ``reach``.  E is the Context parameter ``soft_strength``.
    Constraints become stiff bonds, and all atoms that move by themselves (``mobile``) have equal masses.
    """
    soft = copy.deepcopy(system)
    for k in reversed(range(system.getNumForces())):
        if isinstance(soft.getForce(k), LISTED):
            soft.getForce(k).setForceGroup(0)
        else:
            soft.removeForce(k)
    bonds = openmm.HarmonicBondForce()  # like constraints, without minimum images
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
    """Largest 1 - r/sigma_ij over pairs that are not excluded, with sigma_ij the mean of their diameters; 0 if none is positive."""
    seen = np.flatnonzero(sizes > 0)
    i, j, r = pairs_within(x[seen], None, box, float(sizes.max()))
    i, j = np.minimum(seen[i], seen[j]), np.maximum(seen[i], seen[j])
    free = ~np.isin(i * len(x) + j, excluded @ np.array([len(x), 1]))
    return float(np.max(1 - r[free] / (0.5 * (sizes[i[free]] + sizes[j[free]])), initial=0.0))
