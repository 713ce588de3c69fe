"""What this package notes about Systems: what an integrator was made for, whose forces there are, and Systems that were made elsewhere."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from functools import lru_cache
from zlib import crc32

import numpy as np
import openmm
from openmm import app

from ..base import names
from ..base.errors import ParameterError, PlanError, require
from ..base.names import BEGUN, BESIDE, BY_FIELDS, BY_FORCES, BY_KT, BY_SCHEME, BY_SEED, BY_VARIABLES, COUNTER, PAIR_FORCE, SEED
from ..base.openmm_private import masses_of, virtual_sites
from ..base.units import position_array
from ..kernels.fields import ENERGY, FieldSpec
from ..model.box import box_vectors
from ..model.flow import AXES
from .program_options import ProgramOptions

#: Barostats of OpenMM's: they are forces of a System, but exert none.
BAROSTATS = (
    openmm.MonteCarloBarostat,
    openmm.MonteCarloAnisotropicBarostat,
    openmm.MonteCarloFlexibleBarostat,
    openmm.MonteCarloMembraneBarostat,
)

#: Forces that list the particles they act on, and so do not act on particles that are added later.
LISTED = (
    *(openmm.HarmonicBondForce, openmm.HarmonicAngleForce, openmm.PeriodicTorsionForce, openmm.RBTorsionForce, openmm.CMAPTorsionForce),
    *(openmm.CustomBondForce, openmm.CustomAngleForce, openmm.CustomTorsionForce, openmm.CustomCompoundBondForce),
    *(openmm.CustomCentroidBondForce, openmm.CustomExternalForce),
)


def wrong_key(parameters: Mapping[str, float]) -> str | None:
    """What is wrong with seed and counter of the noise in a Context, or None; neither needs to be there."""
    for name in (SEED, COUNTER):
        if name in parameters and not (0.0 <= parameters[name] < 2.0**53 and parameters[name] % 1.0 == 0.0):
            return f"the context parameter {name} must be a whole number >= 0, but is {parameters[name]:g}"
    return None


@lru_cache
def text_number(text: str) -> float:
    """The checksum that stands for a text in context parameters; 0 for an empty one."""
    return float(crc32(text.encode()))


def origin(options: ProgramOptions, integrator: openmm.Integrator) -> dict[str, float]:
    """Context parameters with which a state records which script and integrator wrote it."""
    asked = {BY_SCHEME: text_number(options.scheme.name), BY_KT: _asked(options), BY_SEED: float(options.seed)}
    asked[BY_FORCES] = options.forces
    carried = {BY_FIELDS: text_number(options.field_names)} if options.field_names else {}
    return asked | carried | {BY_VARIABLES: variables_number(integrator), BESIDE: 0.0, BEGUN: 0.0}


def of_fields(fields: FieldSpec | None) -> dict[str, float]:
    """Context parameters beside what beads carry: of volume moves, or whether values were written that programs do not take."""
    if fields is None:
        return {}
    moves = {names.VOLUME_MOVES: 0.0, names.VOLUME_STEP: 0.01, names.VOLUME_ACCEPTED: 0.0}
    return moves if fields.kind == ENERGY else {names.WRITTEN: 0.0}


def variables_number(integrator: openmm.Integrator) -> float:
    """The checksum of the names of an integrator's variables; 0 if it has none."""
    if not isinstance(integrator, openmm.CustomIntegrator):
        return 0.0
    single = map(integrator.getGlobalVariableName, range(integrator.getNumGlobalVariables()))
    return text_number(" ".join([*single, "each", *map(integrator.getPerDofVariableName, range(integrator.getNumPerDofVariables()))]))


def _asked(options: ProgramOptions) -> float:
    """The number that stands for the temperature of a script in states: the thermal energy, or a negative number for a ramp."""
    return options.kT if options.ramp is None else -1.0 - text_number(repr(options.ramp))


def groups_of(force: openmm.Force) -> set[int]:
    """Force groups in which a force acts."""
    groups = {force.getForceGroup()}
    if isinstance(force, openmm.NonbondedForce) and force.getReciprocalSpaceForceGroup() >= 0:
        groups.add(force.getReciprocalSpaceForceGroup())
    return groups


def acting(forces: Iterable[openmm.Force]) -> list[openmm.Force]:
    """Forces that have an energy, even if it is 0 at present: no barostats, Andersen thermostats or CMMotionRemovers."""
    return [force for force in forces if not isinstance(force, (*BAROSTATS, openmm.CMMotionRemover, openmm.AndersenThermostat))]


def refuse_thermostat(force: openmm.Force) -> None:
    """Raise PlanError for a force that has or needs a thermostat of its own, which pairwise friction cannot be combined with."""
    if isinstance(force, openmm.DrudeForce):
        raise PlanError(
            "the System has a DrudeForce, whose particles must be kept at about 1 K against their atoms, and pairwise friction would heat "
            "them to the temperature of everything; take OpenMM's DrudeLangevinIntegrator, or a force field that is not polarizable"
        )
    if isinstance(force, openmm.AndersenThermostat):
        raise PlanError("the System has an AndersenThermostat beside the DPD thermostat; remove it")
    if isinstance(force, openmm.CMMotionRemover):
        raise PlanError(
            "the System has a CMMotionRemover, which DPD does not need (it conserves momentum) and which takes energy out of the flow; "
            "make the System with removeCMMotion=False"
        )


@dataclass(frozen=True, eq=False)
class Made:
    """What an integrator was made for."""

    maker: str  #: Function of this package that made the System, or added to it
    masses: np.ndarray  #: (N,) masses of the particles, Da
    constrained: bool  #: Whether the integrator keeps constraints
    virtual: np.ndarray  #: (N,) bool which particles are virtual sites
    own: tuple[tuple[str, int], ...]  #: Names and force groups of the forces that the package made
    used: int  #: The integration force groups, a bit for each
    lines: int  #: Number of lines of the integrator's program; 0 where it has none
    scheme: str
    carries: str  #: What beads carry, in words
    kT: float  #: Thermal energy the script asked for, kJ/mol (that at the beginning of a ramp)
    asked: float  #: The number that stands for this temperature in states, negative for a ramp
    seed: int | None  #: The seed the script chose; None if it left the choice to the package
    no_barostat: Callable[[str], str | None]  #: Why none of OpenMM's barostats can change the box along some axes, or None
    forces: float  #: The number that stands for what forces are computed with
    edges: Mapping[int, float]  #: Edges of the box, nm, that walls keep, by their axes

    @classmethod
    def of(
        cls,
        maker: str,
        system: openmm.System,
        own: Sequence[openmm.Force],
        options: ProgramOptions,
        integrator: openmm.Integrator,
        no_barostat: Callable[[str], str | None],
        edges: Mapping[int, float],
    ) -> Made:
        """Note what a System has now, and what the script asked for."""
        forces = tuple((force.getName(), force.getForceGroup()) for force in own)
        seed = options.seed if options.seeded else None
        there = masses_of(system), options.constraints, virtual_sites(system), forces
        used, lines = integrator.getIntegrationForceGroups(), lines_of(integrator)
        scheme, carries, asked = options.scheme.name, options.field_names, _asked(options)
        return cls(maker, *there, used, lines, scheme, carries, options.kT, asked, seed, no_barostat, options.forces, edges)

    def check(self, system: openmm.System) -> list[openmm.Force]:
        """The forces in a System that this package did not make.  PlanError if the integrator was made for another System, or something in
        this one would not act, or would act twice."""
        count, maker = len(self.masses), self.maker
        if system.getNumParticles() != count:
            raise PlanError(f"the System has {system.getNumParticles()} particles, but {maker} made the integrator for {count}")
        if system.getNumConstraints() and not self.constrained:
            raise PlanError(
                f"the System has {system.getNumConstraints()} constraints, and it had none when {maker} made the integrator, "
                f"which would ignore them; {self._remedy('hold distances by stiff bonds of the scene', 'add them')}"
            )
        changed = np.flatnonzero(virtual_sites(system) != self.virtual)
        if len(changed):
            what = f"particle {changed[0]} has become a virtual site, or is none any more, since {maker} made the integrator"
            raise PlanError(f"{what}; {self._remedy('a scene has none', 'do that')}")
        changed = np.flatnonzero(masses_of(system) != self.masses)
        if len(changed):
            what = f"the mass of particle {changed[0]} is not what it was when {maker} made the integrator"
            raise PlanError(f"{what}; {self._remedy('give the scene its masses, and mobile= to hold beads', 'change it')}")
        return self._foreign(system)

    def check_box(self, box: np.ndarray) -> None:
        """Raise OpenMMException if these box vectors, nm, are not those that walls are in."""
        for axis, edge in self.edges.items():
            if np.abs(np.array([box[axis], box[:, axis]]) - edge * np.eye(3)[axis]).max() > 1e-6 * edge:
                keep = f"walls keep its edge along {AXES[axis]}, of {edge:g} nm, perpendicular to the others"
                raise openmm.OpenMMException(f"the box is {box.tolist()} nm now, but {keep}")

    def check_groups(self, groups: int) -> None:
        """Raise PlanError if integration force groups leave out a force of the package that acted, or have one that did not."""
        for name, group in self.own:
            if (groups ^ self.used) >> group & 1:
                was = "in" if self.used >> group & 1 else "not in"
                raise PlanError(
                    f"force group {group} with {name!r} was {was} the integration force groups when {self.maker} made the integrator; "
                    "let setIntegrationForceGroups change the groups of your own forces only"
                )

    def check_writer(self, parameters: Mapping[str, float]) -> None:
        """Raise PlanError if the parameters of a state say that another scheme wrote it, or its beads carried something else."""
        if self.carries and BY_FIELDS in parameters and parameters[BY_FIELDS] != text_number(self.carries):
            raise PlanError(f"the state is of beads that carry something else than those of this scene ({self.carries})")
        if BY_SCHEME in parameters and parameters[BY_SCHEME] != text_number(self.scheme):
            raise PlanError(
                f"the state was written by another scheme than {self.scheme!r}, and schemes keep velocities at different times; take "
                "positions, velocities and box vectors from it (context.setPositions(state.getPositions()), ...) into a new Context"
            )

    def others(self, forces: Iterable[openmm.Force]) -> list[openmm.Force]:
        """Forces of a System that have an energy and that the package did not make."""
        return acting(self._told_apart(forces)[1])

    def _told_apart(self, forces: Iterable[openmm.Force]) -> tuple[Counter, list[openmm.Force]]:
        """Forces of this package that are missing from a System, or not in their group, with their number; and forces of others in it."""
        missing, foreign = Counter(self.own), []
        for force in forces:
            place = (force.getName(), force.getForceGroup())
            if missing[place]:
                missing[place] -= 1
            else:
                foreign.append(force)
        return missing, foreign

    def _remedy(self, scene: str, before: str) -> str:
        return scene if self.maker == "build()" else f"{before} before {self.maker}"

    def _foreign(self, system: openmm.System) -> list[openmm.Force]:
        missing, foreign = self._told_apart(system.getForces())
        lost = next(missing.elements(), None)
        if lost is not None:
            name, group = lost
            now = [force.getForceGroup() for force in foreign if force.getName() == name]
            what = f"is in group {now[0]} now" if now else "is gone"
            raise PlanError(
                f"the force {name!r}, which {self.maker} put into force group {group}, {what}; leave the package's own forces as they are, "
                "and give other forces any groups that are free"
            )
        taken = {group: name for name, group in self.own}
        for force in foreign:
            for group in groups_of(force) & set(taken):
                free = ", ".join(str(g) for g in range(32) if g not in taken)
                raise PlanError(
                    f"the {force.getName()} is in force group {group}, which {taken[group]!r} of this package needs for itself; "
                    f"free groups are {free}"
                )
            refuse_thermostat(force)
        return foreign


def lines_of(integrator: openmm.Integrator) -> int:
    """Number of lines of an integrator's program; 0 if it is no CustomIntegrator."""
    return integrator.getNumComputations() if isinstance(integrator, openmm.CustomIntegrator) else 0


@dataclass(frozen=True, eq=False)
class Host:
    """What a plan needs to know of a System that was made elsewhere, by openmm.app.ForceField for example."""

    masses: np.ndarray  #: (N,) masses of its particles, Da
    left_out: np.ndarray  #: (N,) bool which particles take no part in friction and noise
    constrained: bool  #: Whether it has constraints or virtual sites
    pair_group: int  #: The highest force group that is free

    @classmethod
    def of(cls, system: openmm.System, left_out: np.ndarray) -> Host:
        """Note what a plan needs of a System; PlanError if all its force groups are taken."""
        constrained = system.getNumConstraints() > 0 or bool(virtual_sites(system).any())
        free = set(range(32)).difference(*map(groups_of, system.getForces()))
        if not free:
            raise PlanError("the forces of the System are in all 32 force groups, and the pair terms need one for themselves")
        return cls(masses_of(system), left_out, constrained, max(free))


def check_system(system: openmm.System) -> None:
    """Raise an error if this is no System, or one that a DPD thermostat cannot be added to."""
    require(system, openmm.System, "the thermostat is added to an openmm.System")
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
    require(system, openmm.System, "expected an openmm.System")
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
