"""A soft start for molecules of a force field: from overlapping places to positions that can be minimised and run."""

import time
import warnings
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import openmm
from openmm import app, unit

from ..base.errors import ParameterError, RunError, fact_table, what_is
from ..base.geometry import minimum_images, widths
from ..base.platforms import platform_here
from ..base.units import BOLTZMANN, to_md, whole_number
from ..model.pairs import DPD
from ..model.scene import box_vectors
from ..plan.made import LISTED, checked_positions, degrees_of_freedom, masses_of
from ..simulation.thermostat import add_thermostat
from .piercings import Piercing, bonds_of_topology, find_piercings, pushed_out
from .soft_system import STRENGTH, atom_diameters, excluded_pairs, largest_overlap, nonbonded_of, replaced_forces, soft_system


class PiercingWarning(UserWarning):
    """Bonds still pass through rings; the text names them."""


@dataclass(frozen=True)
class Stage:
    """One stage of a soft start.

    Attributes
    ----------
    strength : float
        Energy of two atoms at one place, kJ/mol.
    steps : int
        Steps of the dynamics.
    dt : float
        Their size, ps.
    temperature : float
        Kinetic temperature at the end, K.
    halvings : int
        How often the step was halved because the stage flew apart, or got too hot, with a longer one.
    """

    strength: float
    steps: int
    dt: float
    temperature: float
    halvings: int


@dataclass(frozen=True, eq=False)
class DenseStart:
    """Positions after a soft start, and what was done.

    Attributes
    ----------
    positions : (N, 3) Quantity
        Of all particles, virtual sites too; constraints hold, molecules are in one piece.
    stages : tuple of Stage
        Stages of the dynamics in their order; those after a ring was freed follow the ramp.
    overlap_before, overlap_after : float
        Largest overlap 1 - r/sigma_ij of two atoms that the force field lets repel each other, 0 if none are closer than the mean
        sigma_ij of their van der Waals diameters.
    energy_before, energy_after : Quantity
        Potential energy of the force field itself (infinite where it is not a number).
    resolved : tuple of Piercing
        Bonds that went through rings, at the start or on the way, and do no longer.
    unresolved : tuple of Piercing
        Those that still do.
    replaced : tuple of str
        Classes of the forces that soft repulsion replaced.
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


#: Energies of two atoms at one place, kJ/mol: from a few kT, where molecules pass through each other, to what keeps them apart.
STRENGTHS = tuple(float(e) for e in np.geomspace(10, 1000, 9))
#: Range of the repulsion in van der Waals diameters, about the minimum of a Lennard-Jones potential.
REACH = 1.1
#: Friction, Da/ps: atoms in a liquid lose their heat in some ten femtoseconds, which exact pair updates do at any step.
FRICTION = 500.0
#: The first step size, ps; the stiffest bonds between atoms of 12 Da have periods of 20 fs and more.
STEP = 0.002
#: A stage that ends so many times too hot has flown apart.
HOT = 5.0
#: Halvings of the step, and attempts to free rings.
HALVINGS, ATTEMPTS = 5, 6
#: Piercings that a warning names; all are in the result.
NAMED = 5
#: Random displacement of all atoms at the start, nm: between two at one place no force has a direction.
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
    r"""Positions that can be minimised, from molecules that overlap or were placed at random.

    On a copy of the System, nonbonded forces are replaced by the soft repulsion of DPD,

    .. math:: U(r) = \frac{E}{2} \left(1 - \frac{r}{r_c}\right)^2 \quad (r < r_c = 1.1\,\sigma_{ij}),

    between all pairs that the force field does not exclude, with :math:`\sigma_{ij}` the mean of their van der Waals diameters.
    Bonded forces, external forces, virtual sites and frozen atoms stay.  Molecules move with pairwise friction and noise (exact pair
    updates) while E rises in nine stages from 10 to 1000 kJ/mol; first they pass through each other, in the end they are apart.  A
    stage that flies apart is repeated with half the step.  The repulsion drives bonds out of rings of up to about ten atoms by itself;
    where one is still in a ring afterwards, it is pushed out over an edge of the ring, and the system is relaxed again.

    Parameters
    ----------
    system : openmm.System
        Made by ``openmm.app.ForceField``, say; stays as it is.  Its charges, custom nonbonded forces and implicit solvent do not act
        here; barostats, thermostats and motion removers neither.  Constraints act as stiff bonds and hold exactly in the result.
    topology : openmm.app.Topology
        Its bonds say where rings are.
    positions : (N, 3) array of lengths
        Molecules in one piece, anywhere.  Nothing else is asked of them: atoms may be at one place.
    temperature : temperature
        Of the soft dynamics; bare numbers are kelvin.
    steps : int, default 200
        Steps of each stage, 2 fs long with all atoms as heavy as carbon.  Take more for chains that should come close to a melt of soft
        chains in equilibrium.
    diameters : (N,) array of lengths, optional
        Van der Waals diameters; 0 for particles that repel nothing.  By default sigma of the NonbondedForce where it has a well depth;
        where not, 0 for virtual sites, 0.1 nm for hydrogens, the element's radius for other atoms.
    fixed : sequence of int
        Atoms that stay where they are, beside those of mass 0: a folded protein, say, which loses some of its shape otherwise (no
        charges hold it).  Constraints to other atoms may move them by some picometers in the end.
    max_ring : int, default 8
        Largest rings that are looked at; see :func:`find_piercings`.
    platform : str, optional
        Name of a platform of OpenMM; the fastest by default.
    seed : int
        Of velocities and noise.

    Returns
    -------
    DenseStart
        ``simulation.context.setPositions(result.positions)``, ``simulation.minimizeEnergy()``, and constant pressure can follow.

    Raises
    ------
    ParameterError
        If sizes do not fit, positions are not finite, a molecule is cut by the box, topology and System disagree about the box, the box
        is smaller than two ranges of the repulsion, or the size of an atom is unknown.
    PlanError
        If the System has no NonbondedForce, several of them, or a force that can neither stay nor be replaced.
    RunError
        If a stage flies apart at the shortest step too.

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
    >>> scattered = x - x[:, :1] + 2 * np.random.default_rng(1).random((len(x), 1, 3))  # every molecule somewhere else
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
        warnings.warn(f"rings that bonds still pass through: {len(left)}: {named}", PiercingWarning, stacklevel=2)
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
    """The checked System, its soft copy, and what is done with both."""

    def __init__(self, system, topology, positions, given, fixed, temperature, platform, seed):
        if not isinstance(system, openmm.System):
            raise ParameterError(f"expected an openmm.System, not {what_is(system)}")
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
            raise ParameterError("no atom that moves has a van der Waals diameter, so nothing would repel anything")
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
        """The positions at the start, a tenth of a picometer off."""
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
        """Positions after some iterations downhill in the soft System, with new velocities."""
        self._place(x, strength)
        self.simulation.minimizeEnergy(maxIterations=ITERATIONS)
        self.context.setVelocitiesToTemperature(self.temperature, self.seed)
        return self._places()

    def stage(self, x: np.ndarray, strength: float, steps: int) -> tuple[np.ndarray, Stage]:
        """Positions after a stage, which is repeated with half the step where it fails."""
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
                reason = f"it was {hotness:.3g} K hot at the end"
            except (RunError, openmm.OpenMMException) as error:
                reason = str(error)
            self.integrator.setStepSize(0.5 * dt)
            self.context.setVelocitiesToTemperature(self.temperature, self.seed)
        raise RunError(
            f"the stage with a repulsion of {strength:.3g} kJ/mol flies apart even with a step of {dt:.3g} ps: {reason}; "
            "is a bond or angle far from its place at the start?"
        )

    def piercings(self, x: np.ndarray, max_ring: int) -> list[Piercing]:
        return find_piercings(self.topology, x, self.box, max_ring=max_ring) if len(self.bonds) else []

    def force_field(self, x: np.ndarray, exact: bool = False) -> tuple[float, np.ndarray]:
        """Energy of the force field itself, with the positions; ``exact`` puts constraints right."""
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
