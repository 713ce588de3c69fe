"""Soft start for molecules of a force field: from overlapping positions to positions that can be minimised and run."""

import time
import warnings
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import openmm
from openmm import app, unit

from ..base.errors import ParameterError, RunError, fact_table, require, what_is
from ..base.geometry import minimum_images, widths
from ..base.openmm_private import masses_of
from ..base.platforms import platform_here
from ..base.units import BOLTZMANN, to_md, whole_number
from ..model.box import box_vectors
from ..model.pairs import DPD
from ..plan.made import LISTED, checked_positions, degrees_of_freedom
from ..simulation.thermostat import add_thermostat
from .piercings import Piercing, bonds_of_topology, find_piercings, pushed_out
from .soft_system import STRENGTH, atom_diameters, excluded_pairs, largest_overlap, nonbonded_of, replaced_forces, soft_system


class PiercingWarning(UserWarning):
    """Warning that bonds still pass through rings; its text names them."""


@dataclass(frozen=True)
class Stage:
    """One stage of a soft start.

    Attributes
    ----------
    strength : float
        Energy of two atoms at the same place, kJ/mol.
    steps : int
        Number of steps.
    dt : float
        Step size, ps.
    temperature : float
        Kinetic temperature at the end, K.
    halvings : int
        Number of times that the step size was halved because the stage blew up or got too hot.
    """

    strength: float
    steps: int
    dt: float
    temperature: float
    halvings: int


@dataclass(frozen=True, eq=False)
class DenseStart:
    """Positions after a soft start, and a record of what was done.

    Attributes
    ----------
    positions : (N, 3) Quantity
        Positions of all particles, including virtual sites; constraints hold, and molecules are whole.
    stages : tuple of Stage
        Stages of the dynamics in order; those after a ring was freed follow the ramp.
    overlap_before, overlap_after : float
        Largest overlap 1 - r/sigma_ij of two atoms that repel each other in the force field, with sigma_ij the mean of their van der Waals
        diameters; 0 if none are closer.
    energy_before, energy_after : Quantity
        Potential energy of the force field itself (infinite if it is not a number).
    resolved : tuple of Piercing
        Bonds that passed through rings, at the start or in between, and were freed.
    unresolved : tuple of Piercing
        Bonds that still pass through rings.
    replaced : tuple of str
        Classes of the forces that the soft repulsion replaced.
    seconds : float
        Wall time.
    """

    positions: unit.Quantity
    stages: tuple[Stage, ...]
    overlap_before: float
    overlap_after: float
    energy_before: unit.Quantity
    energy_after: unit.Quantity
    resolved: tuple[Piercing, ...]
    unresolved: tuple[Piercing, ...]
    replaced: tuple[str, ...]
    seconds: float

    def _facts(self) -> dict[str, str]:
        """The result in short, by name, for its representations."""
        before, after = (energy.value_in_unit(unit.kilojoule_per_mole) for energy in (self.energy_before, self.energy_after))
        return {
            "atoms": str(len(self.positions)),
            "largest overlap": f"{self.overlap_before:.0%} -> {self.overlap_after:.0%}",
            "energy": f"{before:.3g} -> {after:.3g} kJ/mol",
            "pierced rings": f"{len(self.resolved)} freed, {len(self.unresolved)} left",
            "stages": f"{len(self.stages)}, {sum(stage.steps for stage in self.stages)} steps",
            "seconds": f"{self.seconds:.1f}",
        }

    def __repr__(self) -> str:
        return f"<DenseStart: {', '.join(f'{name} {value}' for name, value in self._facts().items())}>"

    def _repr_html_(self) -> str:
        return fact_table("DenseStart", self._facts())


#: Energies of two atoms at the same place, kJ/mol, from a few kT, where molecules pass through each other, to enough to separate them.
STRENGTHS = tuple(float(e) for e in np.geomspace(10, 1000, 9))
#: Range of the repulsion in van der Waals diameters, about the minimum of a Lennard-Jones potential.
REACH = 1.1
#: Friction, Da/ps: atoms in a liquid lose excess heat within some ten femtoseconds; exact pair updates allow this at any step size.
FRICTION = 500.0
#: Initial step size, ps; the stiffest bonds between atoms of 12 Da have periods of at least 20 fs.
STEP = 0.002
#: A stage that ends this many times too hot has blown up.
HOT = 5.0
#: Most halvings of the step size, and attempts to free rings.
HALVINGS, ATTEMPTS = 5, 6
#: Most piercings named in the warning; the result has all.
NAMED = 5
#: Random displacement of all atoms at the start, nm: the force between two atoms at the same place has no direction.
SHAKE = 1e-4
#: Iterations of the minimiser before, between and after the dynamics.
ITERATIONS = 100


def relax_dense(
    system: openmm.System,
    topology: app.Topology,
    positions,
    *,
    temperature=300 * unit.kelvin,
    steps: int = 200,
    diameters=None,
    fixed: Sequence[int] = (),
    max_ring: int = 8,
    platform: str | None = None,
    seed: int = 1,
) -> DenseStart:
    r"""Find positions that can be minimised for molecules that overlap or were placed at random.

    In a copy of the System, the soft repulsion of DPD replaces nonbonded forces,

    .. math:: U(r) = \frac{E}{2} \left(1 - \frac{r}{r_c}\right)^2 \quad (r < r_c = 1.1\,\sigma_{ij}),

    between all pairs that the force field does not exclude, with :math:`\sigma_{ij}` the mean of their van der Waals diameters.
    Bonded forces, external forces, virtual sites and frozen atoms are kept.  Molecules move with pairwise friction and noise (exact pair
    updates) while E rises in nine stages from 10 to 1000 kJ/mol: at first they pass through each other, at the end they are separate.  A
    stage that blows up is repeated with half the step size.  The repulsion itself drives bonds out of rings of up to about ten atoms; a
    bond that is left in a ring is pushed out over an edge of the ring, and the system is relaxed again.

    Parameters
    ----------
    system : openmm.System
        A System such as from ``openmm.app.ForceField``; it is not changed.  Its charges, custom nonbonded forces, implicit solvent,
        barostats, thermostats and motion removers do not act here.  Constraints act as stiff bonds and hold exactly in the result.
    topology : openmm.app.Topology
        Topology whose bonds define the rings.
    positions : (N, 3) array of lengths
        Positions in which molecules are whole.  Molecules may overlap in any way, and atoms may be at the same place.
    temperature : temperature
        Temperature of the soft dynamics; a bare number is in kelvin.
    steps : int, default 200
        Steps of each stage, 2 fs each, with all atoms as heavy as carbon.  Take more for chains that should be nearly equilibrated.
    diameters : (N,) array of lengths, optional
        Van der Waals diameters; 0 for particles without repulsion.  By default sigma of the NonbondedForce if it has a well depth; if not,
        0 for virtual sites, 0.1 nm for hydrogens, and twice the element's radius for other atoms.
    fixed : sequence of int
        Atoms that stay in place, besides those of mass 0, such as a folded protein, which would lose some of its shape without charges.
        Constraints to other atoms may move them by some picometres at the end.
    max_ring : int, default 8
        Number of atoms in the largest rings to consider, see :func:`find_piercings`.
    platform : str, optional
        Name of an OpenMM platform; the fastest by default.
    seed : int
        Seed of velocities and noise.

    Returns
    -------
    DenseStart
        Result; next are ``simulation.context.setPositions(result.positions)``, ``simulation.minimizeEnergy()``, and constant pressure.

    Raises
    ------
    ParameterError
        If sizes do not match, positions are not finite, the box cuts a molecule, topology and System have different boxes, the box is
        smaller than two ranges of the repulsion, or the size of an atom is unknown.
    PlanError
        If the System has no NonbondedForce, several of them, or a force that can neither stay nor be replaced.
    RunError
        If a stage blows up even with the smallest step size.

    Warns
    -----
    PiercingWarning
        If a bond still passes through a ring at the end.

    Examples
    --------
    >>> import numpy as np, openmm
    >>> from openmm import app, unit
    >>> from openmm_dpd.molecules import relax_dense
    >>> field = app.ForceField("amber14/tip3p.xml")
    >>> modeller = app.Modeller(app.Topology(), [] * unit.nanometer)
    >>> modeller.addSolvent(field, boxSize=openmm.Vec3(2, 2, 2) * unit.nanometer)
    >>> system = field.createSystem(modeller.topology, nonbondedMethod=app.PME, nonbondedCutoff=0.9 * unit.nanometer)
    >>> x = np.array(modeller.positions.value_in_unit(unit.nanometer)).reshape(-1, 3, 3)
    >>> scattered = x - x[:, :1] + 2 * np.random.default_rng(1).random((len(x), 1, 3))  # scatters the molecules
    >>> done = relax_dense(system, modeller.topology, scattered.reshape(-1, 3), steps=50)
    >>> done.overlap_before > 0.9, done.overlap_after < 0.3
    (True, True)
    """
    begun = time.perf_counter()
    whole_number(steps, "steps", least=1)
    whole_number(max_ring, "max_ring", least=3)
    work = _Work(system, topology, positions, diameters, fixed, to_md(temperature, "temperature", "temperature"), platform, seed)
    before, _ = work.force_field(work.start)
    met = work.piercings(work.start, max_ring)
    stages = []
    x = work.minimised(work.shaken(), STRENGTHS[0])
    for strength in STRENGTHS:
        x, stage = work.stage(x, strength, steps)
        stages.append(stage)
    x = work.minimised(x, STRENGTHS[-1])
    left = work.piercings(x, max_ring)
    for turn in range(ATTEMPTS):
        met += left
        if not left:
            break
        pushed = pushed_out(x, [(found.ring, found.bond) for found in left], work.bonds, work.box, work.mobile, turn=turn)
        x, stage = work.stage(work.minimised(pushed, STRENGTHS[-1]), STRENGTHS[-1], steps)
        stages.append(stage)
        x = work.minimised(x, STRENGTHS[-1])
        left = work.piercings(x, max_ring)
    if left:
        named = "; ".join([*map(str, left[:NAMED]), *(["..."] if len(left) > NAMED else [])])
        warnings.warn(f"bonds still pass through {len(left)} rings: {named}", PiercingWarning, stacklevel=2)
    after, x = work.force_field(x, exact=True)
    return DenseStart(
        positions=x * unit.nanometer,
        stages=tuple(stages),
        overlap_before=largest_overlap(work.start, work.sizes, work.excluded, work.box),
        overlap_after=largest_overlap(x, work.sizes, work.excluded, work.box),
        energy_before=before * unit.kilojoule_per_mole,
        energy_after=after * unit.kilojoule_per_mole,
        resolved=tuple(found for found in dict.fromkeys(met) if found not in left),
        unresolved=tuple(left),
        replaced=tuple(work.replaced),
        seconds=time.perf_counter() - begun,
    )


class _Work:
    """The checked System and its soft copy, with the operations on both."""

    def __init__(self, system, topology, positions, given, fixed, temperature, platform, seed):
        require(system, openmm.System, "expected an openmm.System")
        self.start, n = checked_positions(topology, system, positions), system.getNumParticles()
        if not isinstance(temperature, float) or temperature <= 0:
            raise ParameterError(f"temperature must be one temperature > 0, not {what_is(temperature)} K")
        self.system, self.topology, self.temperature, self.seed = system, topology, temperature, whole_number(seed, "seed", least=1)
        self.replaced = replaced_forces(system)
        periodic = nonbonded_of(system).usesPeriodicBoundaryConditions()
        self.box = common_box(system, topology, periodic)
        self.bonds = whole_bonds(system, topology, self.start, self.box)
        self.mobile = (masses_of(system) > 0) & ~marked(fixed, n)
        self.sizes, self.excluded = atom_diameters(system, topology, given), excluded_pairs(system)
        if not np.any(self.sizes[self.mobile] > 0):
            raise ParameterError("no mobile atom has a van der Waals diameter, so nothing would repel; give diameters")
        reach = REACH * float(self.sizes.max())
        if self.box is not None and reach > 0.5 * widths(self.box).min():
            raise ParameterError(
                f"the repulsion reaches {reach:.3g} nm, more than half the smallest width of the box, {widths(self.box).min():.3g} nm; "
                "take a larger box"
            )
        soft = soft_system(system, self.sizes, REACH, mobile=self.mobile, periodic=periodic)
        friction = DPD(gamma=FRICTION, cutoff=reach)
        choices = {"platform": platform_here(platform), "seed": self.seed, "topology": topology, "positions": self.start}
        self.simulation = add_thermostat(soft, friction, temperature * unit.kelvin, STEP, **choices).simulation()
        self.integrator = self.simulation.integrator
        self.context = self.simulation.context
        self.freedom = degrees_of_freedom(soft)

    def shaken(self) -> np.ndarray:
        """The initial positions with random displacements of a tenth of a picometre."""
        away = np.random.default_rng(self.seed).normal(0.0, SHAKE, self.start.shape)
        return self.start + np.where(self.mobile[:, None], away, 0.0)

    def _place(self, x: np.ndarray, strength: float) -> None:
        self.context.setParameter(STRENGTH, strength)
        self.context.setPositions(x * unit.nanometer)
        self.context.computeVirtualSites()

    def _places(self) -> np.ndarray:
        found = self.context.getState(positions=True).getPositions(asNumpy=True).value_in_unit(unit.nanometer)
        return np.array(found, dtype=np.float64)

    def minimised(self, x: np.ndarray, strength: float) -> np.ndarray:
        """Positions after a few iterations of the minimiser in the soft System, which gets new velocities."""
        self._place(x, strength)
        self.simulation.minimizeEnergy(maxIterations=ITERATIONS)
        self.context.setVelocitiesToTemperature(self.temperature, self.seed)
        return self._places()

    def stage(self, x: np.ndarray, strength: float, steps: int) -> tuple[np.ndarray, Stage]:
        """Positions after a stage, which is repeated with half the step size if it fails, and its record."""
        reason = ""
        for halvings in range(HALVINGS + 1):
            dt = self.integrator.getStepSize().value_in_unit(unit.picosecond)
            self._place(x, strength)
            try:
                self.simulation.step(steps)
                state = self.context.getState(energy=True)
                kinetic = state.getKineticEnergy().value_in_unit(unit.kilojoule_per_mole)
                hotness = 2 * kinetic / (self.freedom * BOLTZMANN)
                if hotness <= HOT * self.temperature:
                    return self._places(), Stage(strength, steps, dt, hotness, halvings)
                reason = f"its temperature was {hotness:.3g} K at the end"
            except (RunError, openmm.OpenMMException) as error:
                reason = str(error)
            self.integrator.setStepSize(0.5 * dt)
            self.context.setVelocitiesToTemperature(self.temperature, self.seed)
        raise RunError(
            f"the stage with a repulsion of {strength:.3g} kJ/mol blows up even with a step of {dt:.3g} ps: {reason}; "
            "check for bonds and angles that are far from equilibrium at the start"
        )

    def piercings(self, x: np.ndarray, max_ring: int) -> list[Piercing]:
        return find_piercings(self.topology, x, self.box, max_ring=max_ring) if len(self.bonds) else []

    def force_field(self, x: np.ndarray, exact: bool = False) -> tuple[float, np.ndarray]:
        """Energy of the force field itself, and the positions; ``exact`` applies constraints first."""
        context = openmm.Context(self.system, openmm.VerletIntegrator(0.001), self.context.getPlatform())
        context.setPositions(x * unit.nanometer)
        if exact:
            context.applyConstraints(1e-6)
        context.computeVirtualSites()
        state = context.getState(energy=True, positions=True)
        energy = state.getPotentialEnergy().value_in_unit(unit.kilojoule_per_mole)
        found = state.getPositions(asNumpy=True).value_in_unit(unit.nanometer)
        return energy if np.isfinite(energy) else float("inf"), np.array(found, dtype=np.float64)


def marked(fixed, n: int) -> np.ndarray:
    """Mask of the fixed particles among n, (n,)."""
    atoms = np.asarray(fixed)
    if atoms.size and (atoms.ndim != 1 or atoms.dtype.kind not in "iu" or atoms.min() < 0 or atoms.max() >= n):
        raise ParameterError(f"fixed must hold indices of atoms from 0 to {n - 1}, not {what_is(fixed)}")
    marked = np.zeros(n, dtype=bool)
    marked[atoms.astype(int)] = True
    return marked


def common_box(system: openmm.System, topology: app.Topology, periodic: bool) -> np.ndarray | None:
    """Box vectors of the System, or None; ParameterError if the topology has another box."""
    named = topology.getPeriodicBoxVectors()
    if not periodic:
        if named is not None:
            raise ParameterError(
                "the Topology has a periodic box, but the NonbondedForce is not periodic; create the System with nonbondedMethod=PME, or "
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
    """Bonds of the topology, (B, 2); ParameterError if the box cuts a bond that does not reach across it by minimum image."""
    bonds = bonds_of_topology(topology)
    bonded = [force for force in system.getForces() if isinstance(force, LISTED)]
    if not len(bonds) and (system.getNumConstraints() or any(isinstance(f, openmm.HarmonicBondForce) and f.getNumBonds() for f in bonded)):
        raise ParameterError("the System has bonds, but the Topology has none, so pierced rings cannot be found; add bonds to the Topology")
    if box is None or not len(bonds) or any(force.usesPeriodicBoundaryConditions() for force in bonded):
        return bonds
    along = x[bonds[:, 1]] - x[bonds[:, 0]]
    long, short = np.linalg.norm(along, axis=1), np.linalg.norm(minimum_images(along, box), axis=1)
    worst = int(np.argmax(long - short))
    if long[worst] > short[worst] + 1e-6:
        names = " and ".join(f"{a.name} of {a.residue.name} {a.residue.id}" for a in topology.atoms() if a.index in bonds[worst])
        raise ParameterError(
            f"the bond of {names} is {long[worst]:.3g} nm long, and {short[worst]:.3g} nm to the nearest image: the box cuts the molecule; "
            "give positions with whole molecules"
        )
    return bonds
