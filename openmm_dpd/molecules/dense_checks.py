"""What a soft start asks of atoms, boxes and bonds."""

import numpy as np
import openmm
from openmm import app

from ..base.errors import ParameterError, what_is
from ..base.geometry import minimum_images
from ..model.scene import box_vectors
from ..plan.made import LISTED
from .piercings import bonds_of_topology


def marked(fixed, n: int) -> np.ndarray:
    """Which of n particles are fixed."""
    atoms = np.asarray(fixed)
    if atoms.size and (atoms.ndim != 1 or atoms.dtype.kind not in "iu" or atoms.min() < 0 or atoms.max() >= n):
        raise ParameterError(f"fixed must hold indices of atoms from 0 to {n - 1}, not {what_is(fixed)}")
    marked = np.zeros(n, dtype=bool)
    marked[atoms.astype(int)] = True
    return marked


def common_box(system: openmm.System, topology: app.Topology, periodic: bool) -> np.ndarray | None:
    """Box vectors of the System, on which the topology has to agree; None without a box."""
    named = topology.getPeriodicBoxVectors()
    if not periodic:
        if named is not None:
            raise ParameterError(
                "the Topology has a periodic box, but the NonbondedForce is not periodic; make the System with nonbondedMethod=PME, or "
                "call topology.setPeriodicBoxVectors(None)"
            )
        return None
    box, named = box_vectors(system.getDefaultPeriodicBoxVectors()), box_vectors(named)
    assert box is not None
    if named is None or not np.allclose(named, box, atol=1e-5):
        has = "no box" if named is None else f"one with the diagonal {np.diag(named).round(5).tolist()}"
        raise ParameterError(f"the System has a box with the diagonal {np.diag(box).round(5).tolist()} nm, but the Topology has {has}")
    return box


def whole_bonds(system: openmm.System, topology: app.Topology, x: np.ndarray, box: np.ndarray | None) -> np.ndarray:
    """Bonds of the topology, which must not be cut by the box where bonded forces do not reach across it."""
    bonds = bonds_of_topology(topology)
    bonded = [force for force in system.getForces() if isinstance(force, LISTED)]
    if not len(bonds) and (system.getNumConstraints() or any(isinstance(f, openmm.HarmonicBondForce) and f.getNumBonds() for f in bonded)):
        raise ParameterError("the System has bonds, but the Topology has none, so that pierced rings could not be found; give it the bonds")
    if box is None or not len(bonds) or any(force.usesPeriodicBoundaryConditions() for force in bonded):
        return bonds
    along = x[bonds[:, 1]] - x[bonds[:, 0]]
    long, short = np.linalg.norm(along, axis=1), np.linalg.norm(minimum_images(along, box), axis=1)
    worst = int(np.argmax(long - short))
    if long[worst] > short[worst] + 1e-6:
        names = " and ".join(f"{a.name} of {a.residue.name} {a.residue.id}" for a in topology.atoms() if a.index in bonds[worst])
        raise ParameterError(
            f"the bond of {names} is {long[worst]:.3g} nm long, and {short[worst]:.3g} nm to the nearest image: the box cuts the molecule; "
            "give molecules in one piece"
        )
    return bonds
