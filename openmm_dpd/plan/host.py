"""A System that was made elsewhere, by openmm.app.ForceField say, and that pair terms are added to."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import openmm
from openmm import app

from ..base.errors import ParameterError, PlanError
from ..base.names import PAIR_FORCE
from ..base.units import position_array
from ..model.scene import box_vectors
from .made import groups_of, masses_of, refuse_thermostat, virtual_sites


@dataclass(frozen=True, eq=False)
class Host:
    """What a plan has to know of it."""

    masses: np.ndarray  #: (N,) masses of its particles, Da
    left_out: np.ndarray  #: (N,) bool which of them take no part in friction and noise
    constrained: bool  #: Whether it has constraints or virtual sites
    pair_group: int  #: The highest force group that no force of it is in

    @classmethod
    def of(cls, system: openmm.System, left_out: np.ndarray) -> Host:
        """Look at a System; PlanError if all its force groups are taken."""
        constrained = system.getNumConstraints() > 0 or bool(virtual_sites(system).any())
        free = set(range(32)).difference(*map(groups_of, system.getForces()))
        if not free:
            raise PlanError("the forces of the System are in all 32 force groups, and the pair terms need one for themselves")
        return cls(masses_of(system), left_out, constrained, max(free))


def check_system(system: openmm.System) -> None:
    """Raise an error if this is no System, or one that a DPD thermostat cannot be added to."""
    if not isinstance(system, openmm.System):
        raise ParameterError(f"the thermostat is added to an openmm.System, not to a {type(system).__name__}")
    for force in system.getForces():
        if force.getName() == PAIR_FORCE:
            raise PlanError("the System has DPD pair terms already; a table by type names holds several coefficients at once")
        refuse_thermostat(force)


def box_of(system: openmm.System) -> np.ndarray | None:
    """(3, 3) box vectors of a periodic System, nm; None for one that is not periodic."""
    return box_vectors(system.getDefaultPeriodicBoxVectors()) if system.usesPeriodicBoundaryConditions() else None


def degrees_of_freedom(system: openmm.System, *, momentum: bool = True) -> int:
    """Degrees of freedom that share the kinetic energy of a System under a DPD thermostat, for its temperature 2K/(f k_B).

    Three for each particle that moves, less one for each constraint, less three for the total momentum, which pairwise friction
    conserves.  ``openmm.app.StateDataReporter`` takes those three off only if the System has a CMMotionRemover.

    Parameters
    ----------
    system : openmm.System
    momentum : bool, default True
        Take the three of the momentum off.  Nothing is taken off where frozen particles (mass 0, no virtual sites) or a CustomExternalForce
        take up momentum, or if there is not more than one particle.
    """
    moves = masses_of(system) > 0
    frozen = bool(np.any(~moves & ~virtual_sites(system))) or any(isinstance(f, openmm.CustomExternalForce) for f in system.getForces())
    tied = [system.getConstraintParameters(k)[:2] for k in range(system.getNumConstraints())]
    found = 3 * int(moves.sum()) - sum(bool(moves[i] or moves[j]) for i, j in tied)
    return found - 3 if momentum and not frozen and found > 3 else found


class Freedom:
    """Masses and degrees of freedom of a System whose particles from ``n_atoms`` on are beads: they do not change in a run.  The three that
    the conserved momentum takes are shared between atoms and beads in proportion to what each of them has."""

    def __init__(self, system: openmm.System, n_atoms: int):
        self.mass, self.n_atoms, total = masses_of(system), n_atoms, degrees_of_freedom(system)
        part = 3 * int(np.sum(self.mass[n_atoms:] > 0)) / degrees_of_freedom(system, momentum=False)
        self.shares = {"atoms": total * (1 - part), "beads": total * part, "all": total}

    def kinetic_kT(self, v: np.ndarray) -> dict[str, float]:
        """Kinetic temperatures, as energies, of ``atoms``, ``beads`` and of ``all``, for velocities (N, 3), nm/ps."""
        twice = self.mass * np.sum(v**2, axis=1)
        sums = {"atoms": twice[: self.n_atoms].sum(), "beads": twice[self.n_atoms :].sum(), "all": twice.sum()}
        return {name: float(sums[name]) / share if share else 0.0 for name, share in self.shares.items()}


def checked_positions(topology, system: openmm.System, positions) -> np.ndarray:
    """(N, 3) positions, nm, of the particles of a System, which the Topology must have as its atoms."""
    n = system.getNumParticles()
    if not isinstance(topology, app.Topology) or topology.getNumAtoms() != n:
        what = f"has {topology.getNumAtoms()} atoms" if isinstance(topology, app.Topology) else f"is a {type(topology).__name__}"
        raise ParameterError(f"the Topology must have the {n} particles of the System as its atoms, but it {what}")
    return position_array(positions, n, f"the System has {n} particles")
