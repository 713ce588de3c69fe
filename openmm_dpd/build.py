"""Plan -> OpenMM: the only place that makes a System and an integrator together."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import lru_cache
from pathlib import Path

import numpy as np
import openmm
from openmm import app, unit

from .charge_forces import charge_terms
from .errors import ParameterError, PlanError
from .extra_forces import extras
from .fields import field_variables
from .forces.bonded import MOLECULES, angle_forces, bond_forces, molecules
from .forces.electrostatics import electrostatic_forces, needs_list
from .forces.expressions import VIRIAL, PairExpression, exception_force, nonbonded_force
from .forces.external import external_force
from .forces.pair_force import PairForceFunction, pair_force
from .forces.segments import segment_force, segment_spec
from .html import fact_table
from .integrators import Made, NativeIntegrator, PairIntegrator
from .kernels.cells import coincident_pairs
from .kernels.steps import Ramp, StepSpec, Walls
from .kinds import resolved_kind
from .model.bonds import FENEBonds
from .model.flow import PositionForce, gaps
from .model.scene import Scene
from .names import BONDED_GROUP, LAST_POTENTIAL_GROUP, POTENTIAL_GROUP, VIRIAL_GROUP
from .plan import Plan, make_plan
from .program_options import ProgramOptions
from .programs import make_program, walls
from .programs.native import native_integrator, native_marker
from .programs.program import Program
from .simulation import DPDSimulation, PoclSimulation
from .trajectory import openmm_topology
from .view import view
from .whole_steps import WholeSteps


@dataclass(eq=False)
class Built:
    """What a script hands to ``openmm.app.Simulation``.

    Attributes
    ----------
    system : openmm.System
        Serialized, it holds the pair terms as a pickled Python object: read such a file with :func:`openmm_dpd.load_xml`, which runs no
        other code.
    integrator : PairIntegrator, an openmm.CustomIntegrator (NativeIntegrator, an openmm.DPDIntegrator, for the native scheme)
    topology : openmm.app.Topology
    positions, velocities : (N, 3) Quantity
    plan : Plan
    program : Program or None
        None for the native scheme.
    """

    system: openmm.System
    integrator: PairIntegrator | NativeIntegrator
    topology: app.Topology
    positions: unit.Quantity
    velocities: unit.Quantity
    plan: Plan
    program: Program | None

    def __repr__(self) -> str:
        return f"<Built from {self.plan!r}>"

    def _repr_html_(self) -> str:
        return fact_table("Built", self.plan.facts())

    def simulation(self, platform: openmm.Platform | str | None = None, properties: dict[str, str] | None = None) -> app.Simulation:
        """A Simulation with positions and velocities set, on the plan's platform by default."""
        simulation = new_simulation(self, platform, properties, again="this scene has a Simulation already; build it again for another one")
        simulation.context.setPositions(self.positions)
        simulation.context.setVelocities(self.velocities)
        return simulation

    def view(self, **choices):
        """A widget of nglview for a notebook: :func:`openmm_dpd.view.view`, with its ``state`` and ``radii``."""
        return view(self, **choices)

    def explain(self) -> str:
        """The plan and the listing of the program."""
        listing = self.program.describe() if self.program else "integrator: openmm.DPDIntegrator"
        return f"{self.plan.explain()}\n{listing}"


def new_simulation(made, platform: openmm.Platform | str | None, properties: dict[str, str] | None, *, again: str) -> app.Simulation:
    """A Simulation of what has a topology, a system, an integrator and a plan, on the plan's platform by default.

    It is one that refuses states of other schemes, and that can minimise on OpenCL through PoCL (:mod:`openmm_dpd.simulation`).

    Raises
    ------
    PlanError
        With the words ``again``, if the integrator belongs to another one already.
    ParameterError
        If there is no such platform, or it does not know a property.
    """
    name = platform if platform is not None else made.plan.platform
    try:
        chosen = openmm.Platform.getPlatformByName(name) if isinstance(name, str) else name
        pocl = chosen is not None and chosen.getName() == "OpenCL" and not _opencl_is_a_gpu(chosen)
        simulation = (PoclSimulation if pocl else DPDSimulation)(made.topology, made.system, made.integrator, chosen, properties)
        made.integrator.bind(simulation.context)
        return simulation
    except openmm.OpenMMException as error:
        if "same name as a Context parameter" in str(error):
            name = str(error).rpartition(":")[2].strip()
            raise PlanError(f"a force has a global parameter called {name}, which is a variable of the integrator; rename it") from None
        if "already bound" in str(error):
            raise PlanError(again) from None
        raise ParameterError(f"no Simulation on platform {name!r} with properties {properties!r}: {error}") from None


@lru_cache(maxsize=1)
def fastest_platform() -> str:
    """Name of the fastest platform here."""
    platforms = [openmm.Platform.getPlatform(k) for k in range(openmm.Platform.getNumPlatforms())]
    # OpenCL on a CPU (PoCL) claims the speed of a GPU; the CPU platform is faster there
    speeds = {p.getName(): p.getSpeed() for p in platforms if p.getName() != "OpenCL" or _opencl_is_a_gpu(p)}
    return max(speeds, key=lambda name: speeds[name])


def _opencl_is_a_gpu(platform: openmm.Platform) -> bool:
    drivers = list(Path("/etc/OpenCL/vendors").glob("*.icd"))
    if drivers and all("pocl" in driver.name for driver in drivers):
        return False
    system = openmm.System()
    system.addParticle(1.0)
    try:
        context = openmm.Context(system, openmm.VerletIntegrator(0.001), platform)
        device = platform.getPropertyValue(context, "OpenCLPlatformName")
    except openmm.OpenMMException:
        return False
    return "Portable Computing Language" not in device and "pocl" not in device.lower()


def build(
    scene: Scene,
    *,
    dt,
    scheme: str = "middle",
    lam: float = 0.5,
    conservative: str = "auto",
    platform: str | None = None,
    seed: int | None = None,
    loop: bool = True,
    slow_every: int = 1,
) -> Built:
    """System, Topology, positions, velocities and integrator of a scene.

    Parameters are those of :func:`openmm_dpd.plan.make_plan`; ``platform`` is the fastest one by default.  Velocities that the scene does
    not give are drawn from the Maxwell distribution, with no total momentum and exactly the scene's kinetic temperature.

    Raises
    ------
    ParameterError, PlanError, ProgramError
        If anything is missing, out of bounds, contradictory or cannot be combined, before anything runs.

    Examples
    --------
    >>> import numpy as np, openmm_dpd as dpd
    >>> positions = np.random.default_rng(1).random((81, 3)) * 3
    >>> scene = dpd.Scene({"W": 1}, ["W"] * 81, positions, {("W", "W"): dpd.DPD(A=25, gamma=4.5)}, kT=1, box=[3, 3, 3])
    >>> built = dpd.build(scene, dt=0.04, platform="Reference", seed=7)
    >>> simulation = built.simulation()
    >>> simulation.step(10)
    """
    if isinstance(platform, openmm.Platform):
        platform = platform.getName()
    platform = platform or fastest_platform()
    known = [openmm.Platform.getPlatform(k).getName() for k in range(openmm.Platform.getNumPlatforms())]
    if platform not in known:
        raise ParameterError(f"there is no platform {platform!r} here; it must be one of {', '.join(known)}")
    choices = {"scheme": scheme, "lam": lam, "conservative": conservative, "seed": seed, "loop": loop, "slow_every": slow_every}
    return build_plan(make_plan(scene, dt=dt, platform=platform, **choices))  # type: ignore[arg-type]


def build_plan(plan: Plan) -> Built:
    """What :func:`build` makes, from a plan."""
    scene, options = plan.scene, plan.options
    program = None if options.scheme.native else make_program(options)
    integrator = native_integrator(plan) if program is None else program.lower()
    function = _pair_function(plan) if options.kernel and program is not None else None
    system = _system(plan, integrator, function)
    integrator.setIntegrationForceGroups(integration_groups(system.getForces(), options))
    integrator.made = Made.of("build()", system, system.getForces(), options)
    if isinstance(integrator, PairIntegrator) and function is not None and function.steps is not None:
        integrator.whole = WholeSteps(function, options.pair_group)
    if plan.spec.fields is not None:
        for name, values in field_variables(plan.spec.fields.initial).items():
            integrator.setPerDofVariableByName(name, values)
    if scene.walls and not options.whole_steps:
        for name, values in walls.variables(gaps(scene.walls, scene.box), scene.n_beads).items():
            integrator.setPerDofVariableByName(name, values)
    return Built(
        system=system,
        integrator=integrator,
        topology=openmm_topology(list(scene.types), scene.molecules, scene.bond_pairs, scene.box, scene.residues),
        positions=scene.positions.copy() * unit.nanometer,
        velocities=initial_velocities(scene, options.seed) * (unit.nanometer / unit.picosecond),
        plan=plan,
        program=program,
    )


def initial_velocities(scene: Scene, seed: int) -> np.ndarray:
    """The scene's velocities, or Maxwell's with no total momentum and exactly the scene's temperature; immobile beads at rest."""
    if scene.velocities is not None:
        return scene.velocities.copy()
    mobile = np.ones(scene.n_beads, bool) if scene.mobile is None else scene.mobile
    mass = scene.bead_masses[mobile]
    v = np.zeros((scene.n_beads, 3))
    drawn = np.random.default_rng([seed, 0xD9D]).normal(size=(len(mass), 3)) * np.sqrt(scene.initial_kT / mass)[:, None]
    if len(mass) > 1:
        drawn -= mass @ drawn / mass.sum()
        kinetic = np.sum(mass[:, None] * drawn**2)
        if kinetic > 0:
            drawn *= np.sqrt(3 * (len(mass) - 1) * scene.initial_kT / kinetic)
    v[mobile] = drawn
    return v


def integration_groups(forces: Sequence[openmm.Force], options: ProgramOptions) -> set[int]:
    """The force groups that an integrator uses: all but those of the forces that only measure or tell of bonds, and of impulses.

    Users put forces of their own into any group, before the Context is made, and all of them have to act.
    """
    silent = {force.getForceGroup() for force in forces if force.getName().endswith(VIRIAL) or force.getName() == MOLECULES}
    return set(range(32)) - silent - (set() if options.kernel_conservative else {options.pair_group})


def _pair_function(plan: Plan) -> PairForceFunction:
    """What evaluates the pair terms."""
    scene, options = plan.scene, plan.options
    held = () if plan.unlooped else extras(scene, plan.partners, plan.exceptions)
    charges = charge_terms(scene, plan.ewald, plan.charge_exceptions) if plan.charges_held else None
    held += () if charges is None else (charges,)
    return PairForceFunction(
        replace(plan.spec, extras=held),
        conservative=options.kernel_conservative,
        periodic=scene.box is not None,
        scale=options.field_scale,
        balanced=options.compensated and plan.spec.sweeps,
        guarded=() if held else tuple(bonds for bonds in scene.bonds if isinstance(bonds, FENEBonds)),
        steps=None if plan.unlooped else _step_spec(plan),
    )


def _step_spec(plan: Plan) -> StepSpec:
    """What a whole step is."""
    scene, options = plan.scene, plan.options
    scheme, ramp = options.scheme, options.ramp
    predicts = options.predicting
    mobile = plan.spec.inv_mass > 0
    found = walls.planes(gaps(scene.walls, scene.box)) if scene.walls else {}
    return StepSpec(
        letters=() if predicts else tuple((letter, float(part)) for letter, part in scheme.steps(options.thermostat)),
        mass=np.where(mobile, scene.bead_masses, 0.0),
        slow_kicks=options.slow_kicks,
        slow_every=options.slow_every,
        thermostat=options.thermostat,
        lam=options.lam,
        field_lam=options.field_lam,
        walls=Walls(*(found[name] for name in walls.CONSTANTS)) if found else None,
        ramp=None if ramp is None else Ramp(ramp.start, ramp.stop, ramp.begin, ramp.end),
        field_shown=options.field_shown,
    )


def _system(plan: Plan, integrator: PairIntegrator | NativeIntegrator, function: PairForceFunction | None) -> openmm.System:
    """The System, whose parameters tell of the integrator."""
    scene, options = plan.scene, plan.options
    periodic = scene.box is not None
    system = openmm.System()
    mobile = np.ones(scene.n_beads, bool) if scene.mobile is None else scene.mobile
    for mass in np.where(mobile, scene.bead_masses, 0.0).tolist():
        system.addParticle(mass)
    if scene.box is not None:
        system.setDefaultPeriodicBoxVectors(*(openmm.Vec3(*row) for row in scene.box.tolist()))
    layers = plan.layers if plan.conservative == "openmm" else ()
    densities = [layer for layer in layers if resolved_kind(layer).density_force is not None]
    expressions, partners = (
        [resolved_kind(table).potential(table, scene.type_names) for table in tables]  # type: ignore[misc]  # make_plan has seen to it
        for tables in (layers, plan.partners)
    )
    factors = _excluded_pairs(plan, [*expressions, *partners])
    free = _add_pair_expressions(system, plan, [*expressions, *partners], factors, with_virial=partners)
    _add_charges(system, plan, factors)
    if free - len(densities) + 1 < LAST_POTENTIAL_GROUP:
        raise PlanError(f"the pair potentials and densities need more than {POTENTIAL_GROUP - LAST_POTENTIAL_GROUP + 1} force groups")
    for k, layer in enumerate(densities):
        excluded = sorted(pair for pair, factor in plan.exceptions.items() if factor == 0.0)
        force = resolved_kind(layer).density_force(layer, scene.type_names, scene.type_ids, excluded, periodic)  # type: ignore[misc]
        force.setForceGroup(free - k)
        system.addForce(force)
    if plan.unlooped is None:
        if len(scene.bond_pairs):
            system.addForce(molecules(scene.bond_pairs))
    else:
        for force in (*bond_forces(scene.bonds, periodic), *angle_forces(scene.angles, periodic)):
            force.setForceGroup(BONDED_GROUP)
            system.addForce(force)
        segments = segment_spec(scene)
        if segments is not None:
            system.addForce(segment_force(segments, periodic))
    for term in scene.body_forces:
        if plan.unlooped is not None or isinstance(term, PositionForce):
            system.addForce(external_force(term, scene.type_ids, scene.type_names, scene.box))
    if function is not None:
        system.addForce(pair_force(function, options=options, integrator=integrator))
    if options.scheme.native:
        system.addForce(native_marker(options, integrator, periodic))
    return system


def _excluded_pairs(plan: Plan, expressions: list[PairExpression]) -> dict[tuple[int, int], float]:
    """Pairs that all pair forces leave to bond forces, and their factors: bonded neighbours, and beads at the same point."""
    scene = plan.scene
    reaches = [e.cutoff for e in expressions]
    if scene.electrostatics is not None:
        reaches.append(1.0 / scene.electrostatics.steepness)
    if not reaches:
        return {}
    factors = dict(plan.exceptions)
    # GPU platforms want the same exclusions in all pair forces
    for pair in (*plan.charge_exceptions, *coincident_pairs(scene.positions, scene.box, 1e-4 * max(reaches))):
        factors.setdefault(pair, 1.0)
    return factors


def _add_charges(system: openmm.System, plan: Plan, factors: dict[tuple[int, int], float]) -> None:
    """Add the forces of smeared charges."""
    scene = plan.scene
    if scene.electrostatics is None or plan.charges_held:
        return
    assert scene.charges is not None
    listed = plan.ewald is not None and needs_list(scene.charges, plan.ewald, scene.box) and plan.listed(plan.ewald.cutoff)
    constant = scene.electrostatics.coulomb(scene.initial_kT)
    factors = {pair: plan.charge_exceptions.get(pair, 1.0) for pair in factors}
    for force in electrostatic_forces(scene.electrostatics, scene.charges, constant, plan.ewald, factors, listed=listed):
        system.addForce(force)


def _add_pair_expressions(
    system: openmm.System, plan: Plan, expressions: list[PairExpression], factors: dict[tuple[int, int], float], with_virial
) -> int:
    """Add the forces of radial pair potentials, and return the next group downwards.

    GPU platforms want one cutoff per group and the same exclusions everywhere.
    """
    scene = plan.scene
    periodic = scene.box is not None
    exclusions = sorted(factors)
    restored = {pair: factor for pair, factor in sorted(factors.items()) if factor > 0}
    groups: dict[float, int] = {}
    cutoffs = {expression.cutoff for expression in expressions}
    if len(cutoffs) > 10:
        raise PlanError(f"the pair potentials have {len(cutoffs)} different cutoffs; at most 10 can be built")
    for expression in expressions:
        number = groups.setdefault(expression.cutoff, len(groups))
        # where the kernel holds the potentials only their virials are OpenMM's
        energies = (False,) if plan.unlooped else ()
        for virial in (*energies, True) if expression in with_virial else (False,):
            listed = plan.listed(expression.cutoff)
            made = [nonbonded_force(expression, scene.type_ids, exclusions, periodic, virial=virial, listed=listed)]
            if restored:
                made.append(exception_force(expression, scene.type_ids, restored, periodic, virial=virial))
            for force in made:
                force.setForceGroup((VIRIAL_GROUP if virial else POTENTIAL_GROUP) - number)
                system.addForce(force)
    return POTENTIAL_GROUP - len(groups)
