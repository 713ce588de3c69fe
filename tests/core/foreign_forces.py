"""Forces, constraints and barostats of the user's own beside those of this package: every way to add them, and what must come of it.

Every cell has an answer that needs no other run: pair terms conserve momentum, so that a constant force must change the total momentum by
exactly its impulse; a bond with a linear potential drives two particles, to which nothing else happens, apart by exactly its impulse; a
constrained distance stays; a volume moves.
"""

import itertools
import math
from collections.abc import Callable
from dataclasses import astuple, dataclass, fields
from functools import cache

import numpy as np
import openmm
from openmm import app, unit

import openmm_dpd as dpd

#: Levels of every factor.  ``when``: before add_thermostat or create_mixed_system, after it or after build, or after some steps, before
#: ``context.reinitialize(preserveState=True)``.  ``made``: the Simulation comes from this package or from app.Simulation.
LEVELS: dict[str, tuple] = {
    "kind": ("external", "bond", "cv", "metadynamics", "constraint", "barostat"),
    "group": (0, 7, 30, 31),
    "scheme": ("mvv", "shardlow", "middle", "aboba", "bababo", "native"),
    "platform": ("Reference", "CPU", "OpenCL"),
    "conservative": ("auto", "openmm", "kernel"),
    "way": ("build", "add_thermostat", "mixed"),
    "when": ("before", "after", "reinitialized"),
    "made": ("own", "app"),
}
STEPS, WARM = 20, 3
FORCE = 20.0  # kJ/mol/nm


@dataclass(frozen=True)
class Cell:
    """One combination of levels."""

    kind: str
    group: int
    scheme: str
    platform: str
    conservative: str
    way: str
    when: str
    made: str

    def __str__(self) -> str:
        return "-".join(map(str, astuple(self)))

    @property
    def makes_sense(self) -> bool:
        """Whether such a run can be asked for at all."""
        if self.way != "build" and (self.conservative != "auto" or self.scheme == "native"):
            return False
        if self.way == "build" and (self.when == "before" or (self.scheme == "native" and self.conservative == "kernel")):
            return False
        if self.way == "add_thermostat" and self.made != "app":
            return False
        if self.group == 31 and self.when != "before":
            return False  # it belongs to the pair terms by then: test_foreign_forces.py has tests of its own for that
        return self.kind != "constraint" or self.group == 0  # a constraint has no group


NAMES = tuple(field.name for field in fields(Cell))


@cache
def cells() -> tuple[Cell, ...]:
    """All cells, in a fixed order."""
    return tuple(cell for cell in itertools.starmap(Cell, itertools.product(*LEVELS.values())) if cell.makes_sense)


@cache
def covering(strength: int, platforms: tuple[str, ...] = LEVELS["platform"]) -> tuple[Cell, ...]:
    """A selection in which every two (or three: ``strength``) levels that some cell has together are together at least once.

    Next comes always the cell that adds most, of several the one whose levels were taken least so far.
    """
    every = tuple(cell for cell in cells() if cell.platform in platforms)
    numbers: dict[tuple, int] = {}
    single: dict[tuple, int] = {}
    groups, levels = [], []
    for cell in every:
        named = list(zip(NAMES, astuple(cell), strict=True))
        groups.append([numbers.setdefault(some, len(numbers)) for some in itertools.combinations(named, strength)])
        levels.append([single.setdefault(level, len(single)) for level in named])
    table, rows, missing, taken, chosen = np.array(groups), np.array(levels), np.ones(len(numbers), bool), np.zeros(len(single)), []
    while missing.any():
        best = int(np.argmax(missing[table].sum(axis=1) - 1e-6 * taken[rows].sum(axis=1)))
        missing[table[best]] = False
        taken[rows[best]] += 1
        chosen.append(every[best])
    return tuple(chosen)


@cache
def lacking(platform: str) -> str | None:
    """Why there is no Context on a platform, or None."""
    system = openmm.System()
    system.addParticle(1.0)
    try:
        openmm.Context(system, openmm.VerletIntegrator(0.001), openmm.Platform.getPlatformByName(platform))
    except openmm.OpenMMException as error:
        return f"no Context on {platform}: {error}"
    return None


# -- what runs -------------------------------------------------------------------------------------------------------------------------
@dataclass(eq=False)
class Case:
    """A System with its integrator, and two particles in it to which nothing else happens."""

    system: openmm.System
    topology: app.Topology
    positions: np.ndarray
    velocities: np.ndarray
    masses: np.ndarray
    dt: float
    kT: float
    free: tuple[int, int]
    speed: float
    integrator: openmm.Integrator | None = None
    made: object = None

    def simulation(self, platform: str, own: bool) -> app.Simulation:
        """A Simulation with positions and velocities."""
        threads = {"Threads": "1"} if platform == "CPU" else {}
        if own:
            simulation = self.made.simulation(platform, threads)
        else:
            simulation = app.Simulation(self.topology, self.system, self.integrator, openmm.Platform.getPlatformByName(platform), threads)
        simulation.context.setPositions(self.positions)
        simulation.context.setVelocities(self.velocities)
        return simulation


def _maxwell(masses: np.ndarray, kT: float, free, seed: int = 3) -> np.ndarray:
    """Velocities with no total momentum; the free particles rest."""
    v = np.random.default_rng(seed).normal(size=(len(masses), 3)) * np.sqrt(kT / masses)[:, None]
    v[list(free)] = 0.0
    others = np.setdiff1d(np.arange(len(masses)), free)
    v[others] -= masses[others] @ v[others] / masses[others].sum()
    return v


def _pair(edge: float, apart: float) -> np.ndarray:
    """Places of the two free particles."""
    return np.full(3, edge / 2) + 0.5 * apart * np.array([[-1, -2, -2], [1, 2, 2]]) / 3


def _fluid(n: int, edge: float, seed: int = 4) -> np.ndarray:
    """Beads that are not on top of each other: some random points of a fine lattice, shaken a little."""
    m = math.ceil((1.5 * n) ** (1 / 3))
    rng = np.random.default_rng(seed)
    sites = rng.permutation(np.stack(np.meshgrid(*[np.arange(m)] * 3), axis=-1).reshape(-1, 3))[:n]
    return (sites + 0.5 + 0.2 * rng.random((n, 3))) * edge / m


def beads(cell: Cell) -> Case:
    """A DPD fluid with two beads that do not interact."""
    n, edge, dt = 81, 3.0, 0.01
    x = np.concatenate([_pair(edge, 1.0), _fluid(n, edge)])
    table = {("W", "W"): dpd.DPD(A=25, gamma=4.5), ("P", "*"): dpd.NONE}
    scene = dpd.Scene({"W": 1.0, "P": 2.0}, ["P", "P"] + ["W"] * n, x, table, kT=1.0, box=[edge] * 3)
    built = dpd.build(scene, dt=dt, scheme=cell.scheme, conservative=cell.conservative, platform=cell.platform, seed=7)
    masses = scene.bead_masses
    v = _maxwell(masses, 1.0, (0, 1))
    return Case(built.system, built.topology, scene.positions, v, masses, dt, 1.0, (0, 1), 1.0, built.integrator, built)


EPSILON, SIGMA, ARGON = 0.998, 0.34, 39.9


def _argon(n: int, edge: float, cutoff: float) -> tuple[openmm.System, app.Topology, np.ndarray]:
    """Argon on a lattice, and two atoms that do not interact, at the beginning."""
    system, topology, force = openmm.System(), app.Topology(), openmm.NonbondedForce()
    chain = topology.addChain()
    element = app.Element.getBySymbol("Ar")
    system.setDefaultPeriodicBoxVectors(*(openmm.Vec3(*row) for row in np.eye(3) * edge))
    topology.setPeriodicBoxVectors(system.getDefaultPeriodicBoxVectors())
    for k in range(n + 2):
        system.addParticle(ARGON)
        topology.addAtom("AR", element, topology.addResidue("AR", chain))
        force.addParticle(0.0, SIGMA, EPSILON if k >= 2 else 0.0)
    force.setNonbondedMethod(openmm.NonbondedForce.CutoffPeriodic)
    force.setCutoffDistance(cutoff)
    force.setUseDispersionCorrection(False)
    system.addForce(force)
    m = math.ceil(n ** (1 / 3))
    sites = np.stack(np.meshgrid(*[np.arange(m)] * 3), axis=-1).reshape(-1, 3)[:n]
    x = (sites + 0.5 + 0.1 * np.random.default_rng(8).random((n, 3))) * edge / m
    return system, topology, np.concatenate([_pair(edge, 0.5), x])


def argon() -> Case:
    """Liquid argon, not yet with a thermostat."""
    edge, dt = 1.86, 0.004
    system, topology, x = _argon(125, edge, 0.9)
    masses = np.full(len(x), ARGON)
    return Case(system, topology, x, _maxwell(masses, EPSILON, (0, 1)), masses, dt, EPSILON, (0, 1), 1.0)


def with_thermostat(case: Case, cell: Cell) -> None:
    """Add the thermostat."""
    friction = {("Ar", "Ar"): dpd.DPD(gamma=20.0, cutoff=0.9)}
    types = [None, None] + ["Ar"] * (len(case.masses) - 2)
    choices = {"types": types, "scheme": cell.scheme, "platform": cell.platform, "seed": 7}
    case.integrator = dpd.add_thermostat(case.system, friction, 120 * unit.kelvin, case.dt, **choices).integrator


MIXED_EDGE, MIXED_KT = 2.4, 300 * dpd.units.BOLTZMANN


def atoms() -> Case:
    """Some argon in a large box, to be put among beads."""
    n, dt = 27, 0.004
    system, topology, x = _argon(n, MIXED_EDGE, 0.9)
    x[2:] = x[:2].mean(axis=0) + 0.6 * (x[2:] - x[2:].mean(axis=0))  # a drop in the middle
    return Case(system, topology, x, np.zeros_like(x), np.full(len(x), ARGON), dt, MIXED_KT, (0, 1), 1.0)


def among_beads(case: Case, cell: Cell) -> None:
    """Put the atoms among beads."""
    x = _fluid(400, MIXED_EDGE)
    x = x[np.linalg.norm(x[:, None] - case.positions[None, 2:], axis=2).min(axis=1) > 0.4][:150]
    table = {("W", "W"): dpd.DPD(A=60, gamma=60, cutoff=0.65)}
    scene = dpd.Scene({"W": 54.0}, ["W"] * len(x), x, table, kT=MIXED_KT, box=[MIXED_EDGE] * 3)
    names = [None, None] + ["Ar"] * (len(case.masses) - 2)
    cross = {("Ar", "W"): dpd.DPD(A=60, gamma=60, cutoff=0.65)}
    choices = {"dt": case.dt, "scheme": cell.scheme, "platform": cell.platform, "seed": 7}
    whole = dpd.create_mixed_system(scene, case.topology, case.system, case.positions, atoms=names, cross=cross, **choices)
    case.made, case.system, case.topology, case.integrator = whole, whole.system, whole.topology, whole.integrator
    case.positions = np.concatenate([case.positions, x])
    case.masses = np.concatenate([case.masses, np.full(len(x), 54.0)])
    case.velocities = _maxwell(case.masses, MIXED_KT, case.free)


# -- what is added, and what must come of it -------------------------------------------------------------------------------------
def _distance(case: Case) -> openmm.CustomBondForce:
    """The distance of the two free particles, as a force."""
    force = openmm.CustomBondForce("r")
    force.addBond(*case.free, [])
    force.setUsesPeriodicBoundaryConditions(True)
    return force


def add_external(case: Case, group: int) -> np.ndarray:
    """FORCE along x on every particle there is."""
    force = openmm.CustomExternalForce(f"-{FORCE}*x")
    for k in range(case.system.getNumParticles()):
        force.addParticle(k)
    force.setForceGroup(group)
    case.system.addForce(force)
    expected = np.zeros((case.system.getNumParticles(), 3))
    expected[:, 0] = FORCE
    return expected


def _apart(case: Case) -> np.ndarray:
    """FORCE on each of the free particles, away from the other."""
    d = np.array([1, 2, 2]) / 3
    expected = np.zeros((case.system.getNumParticles(), 3))
    expected[list(case.free)] = FORCE * np.array([-d, d])
    return expected


def add_bond(case: Case, group: int) -> np.ndarray:
    """A bond that drives the free particles apart with a constant force."""
    force = openmm.CustomBondForce(f"-{FORCE}*r")
    force.addBond(*case.free, [])
    force.setUsesPeriodicBoundaryConditions(True)
    force.setForceGroup(group)
    case.system.addForce(force)
    return _apart(case)


def add_cv(case: Case, group: int) -> np.ndarray:
    """The same by way of a collective variable."""
    force = openmm.CustomCVForce("strength*d")
    force.addCollectiveVariable("d", _distance(case))
    force.addGlobalParameter("strength", -FORCE)
    force.setForceGroup(group)
    case.system.addForce(force)
    return _apart(case)


def add_metadynamics(case: Case, group: int) -> np.ndarray:
    """The same by way of app.Metadynamics with a bias that does not change; it chooses the group itself, the highest one that is free."""
    variable = app.BiasVariable(_distance(case), 0.0, 4.0, 0.2, False)
    metadynamics = app.Metadynamics(case.system, [variable], 300 * unit.kelvin, 50, 2.0, 10**9)
    metadynamics._table.setFunctionParameters(-FORCE * np.linspace(0, 4.0, variable.gridWidth), 0.0, 4.0)
    if group < 30:
        metadynamics._force.setForceGroup(group)
    return _apart(case)


def add_constraint(case: Case, group: int) -> None:
    """Keep the free particles at their distance."""
    first, second = case.free
    case.system.addConstraint(first, second, float(np.linalg.norm(case.positions[second] - case.positions[first])))


def add_barostat(case: Case, group: int) -> None:
    """A barostat in OpenMM's units, at a pressure that is not that of the fluid."""
    force = openmm.MonteCarloBarostat(1000 * unit.bar, case.kT / dpd.units.BOLTZMANN * unit.kelvin, 2)
    force.setRandomNumberSeed(5)
    force.setForceGroup(group)
    case.system.addForce(force)


_ADD = (add_external, add_bond, add_cv, add_metadynamics, add_constraint, add_barostat)
ADD: dict[str, Callable] = {one.__name__.removeprefix("add_"): one for one in _ADD}

#: Steps t in which a constant force moves a particle by a dt^2 (t^2/2 + this number t): kicks come before drifts, or around them.
AHEAD = {"middle": 0.5, "native": 0.5}


def refusable(cell: Cell) -> str | None:
    """A word that the reason must have where a refusal is as good as an effect: a copy of a CustomCVForce is out of its maker's reach."""
    if cell.kind == "constraint":
        return "constrain"
    if cell.kind in ("cv", "metadynamics") and (cell.way, cell.when) == ("mixed", "before"):
        return "customcvforce"
    return None


class Wrong(AssertionError):
    """What was added did not act as it must."""


def run(cell: Cell) -> str:
    """Run a cell: 'acts', or the reason for which it was refused; raises Wrong if neither."""
    try:
        return _run(cell)
    except (dpd.DPDError, openmm.OpenMMException) as error:
        word = refusable(cell)
        text = str(error)
        if word is None or word not in text.lower():
            raise Wrong(f"{type(error).__name__}: {text}") from error
        if "\n" in text:
            raise Wrong(f"refused in more than a line: {text}") from error
        return text


def _run(cell: Cell) -> str:
    add = ADD[cell.kind]
    expected = None
    case = {"build": lambda: beads(cell), "add_thermostat": argon, "mixed": atoms}[cell.way]()
    if cell.when == "before":
        expected = add(case, cell.group)
    if cell.way == "add_thermostat":
        with_thermostat(case, cell)
    elif cell.way == "mixed":
        among_beads(case, cell)
    if cell.when == "after":
        expected = add(case, cell.group)
    simulation = case.simulation(cell.platform, cell.made == "own")
    context = simulation.context
    if cell.when == "reinitialized":
        simulation.step(WARM)
        expected = add(case, cell.group)
        context.reinitialize(preserveState=True)
    if cell.kind == "constraint":
        return _check_distance(case, simulation, cell)
    if cell.kind == "barostat":
        return _check_volume(case, simulation, cell)
    full = np.zeros_like(case.positions)
    full[: len(expected)] = expected
    _check_impulse(case, simulation, cell, full)
    return "acts"


def state(context) -> tuple[np.ndarray, np.ndarray]:
    """Positions and velocities."""
    found = context.getState(positions=True, velocities=True)
    velocities = found.getVelocities(asNumpy=True).value_in_unit(unit.nanometer / unit.picosecond)
    return found.getPositions(asNumpy=True).value_in_unit(unit.nanometer), velocities


def rounding(case: Case, context, cell: Cell) -> float:
    """Bound of what rounding adds to the total momentum in the run: every velocity and every impulse is rounded once in every step.

    On the CPU platform OpenMM's own forces are single precision.
    """
    single = 2.0**-23 if cell.platform != "Reference" else 2.0**-48
    forces = context.getState(forces=True).getForces(asNumpy=True)._value
    speed = np.sqrt(np.mean(np.sum(_maxwell(case.masses, case.kT, case.free) ** 2, axis=1)))
    noise = np.sqrt(2 * 60 * case.kT / case.dt) * 5  # impulses of friction and noise are as large as this, with the largest friction here
    size = np.linalg.norm(forces, axis=1).mean() + FORCE + noise
    return 4 * STEPS * single * len(case.masses) * (case.masses.max() * speed + case.dt * size)


def _check_impulse(case: Case, simulation: app.Simulation, cell: Cell, expected: np.ndarray) -> None:
    m = case.masses[:, None]
    x0, v0 = state(simulation.context)
    tolerance = rounding(case, simulation.context, cell)
    simulation.step(STEPS)
    x, v = state(simulation.context)
    t = STEPS * case.dt
    given = expected * t
    impulse = (m * (v - v0) - given).sum(axis=0)
    if np.abs(impulse).max() > tolerance:
        raise Wrong(f"total momentum is off by {impulse} where {given.sum(axis=0)} was to be added (rounding: {tolerance:.1e})")
    free = list(case.free)
    off = (m * (v - v0) - given)[free]
    if np.abs(off).max() > tolerance:
        raise Wrong(f"the momenta of the two free particles are off by {off.tolist()} where {given[free].tolist()} was to be added")
    path = v0 * t + expected / m * case.dt**2 * STEPS * (STEPS / 2 + AHEAD.get(cell.scheme, 0.0))
    moved = (m * (x - x0 - path)).sum(axis=0)
    lost = tolerance * t + 4 * STEPS * (2.0**-24 if cell.platform == "OpenCL" else 2.0**-48) * (m * np.abs(x0)).sum()
    if np.abs(moved).max() > lost:
        raise Wrong(f"the centre of mass is off by {moved / m.sum()} (rounding: {lost / m.sum():.1e})")


def _check_distance(case: Case, simulation: app.Simulation, cell: Cell) -> str:
    """The free particles fly apart sideways, unless the constraint keeps them."""
    first, second = case.free
    x, v = state(simulation.context)
    target = np.linalg.norm(case.positions[second] - case.positions[first])
    sideways = case.speed * np.array([2, -1, 0]) / math.sqrt(5)
    v[[first, second]] = [-sideways, sideways]
    simulation.context.setVelocities(v)
    simulation.step(STEPS)
    x, v = state(simulation.context)
    found = np.linalg.norm(x[second] - x[first])
    unbound = math.hypot(target, 2 * case.speed * STEPS * case.dt)
    if abs(found - target) > 1e-4 * target:
        raise Wrong(f"the constrained distance is {found:.5f}, not {target:.5f} (unconstrained: {unbound:.5f})")
    momentum = case.masses[[first, second]] @ v[[first, second]]
    # single precision of positions, of which the constraints' impulses are made in every step
    size = 4 * STEPS * 2.0**-24 * np.abs(x[first]).max() / case.dt if cell.platform == "OpenCL" else 1e-6 * case.speed
    if np.abs(momentum).max() > case.masses[first] * size:
        raise Wrong(f"the constraint pushed its two particles together: momentum {momentum}")
    return "acts"


def _check_volume(case: Case, simulation: app.Simulation, cell: Cell) -> str:
    context = simulation.context
    before = context.getState().getPeriodicBoxVolume()
    tolerance = rounding(case, context, cell)
    _, v0 = state(context)
    simulation.step(STEPS)
    if before == context.getState().getPeriodicBoxVolume():
        raise Wrong(f"the volume stays at {before}")
    _, v = state(context)
    momentum = case.masses @ (v - v0)
    if not np.abs(momentum).max() < tolerance:
        raise Wrong(f"the momentum changed by {momentum} (rounding: {tolerance:.1e})")
    return "acts"


def outcome(cell: Cell) -> str:
    """'acts', 'refused: ...' or 'WRONG: ...'."""
    try:
        found = run(cell)
    except Wrong as error:
        return f"WRONG: {error}"
    except Exception as error:  # nothing may hide the other cells
        return f"WRONG: {type(error).__name__}: {error}"
    return found if found == "acts" else f"refused: {found}"
