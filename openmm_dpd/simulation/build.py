"""Plan -> OpenMM: the only place that makes a System and an integrator together."""

import logging
from collections.abc import Sequence
from dataclasses import replace
from functools import partial

import numpy as np
import openmm
from openmm import unit

from ..base.errors import require
from ..base.geometry import weighted_sum
from ..base.names import ALONE, BONDS
from ..base.platforms import platform_here
from ..io.trajectory import openmm_topology
from ..kernels.bodies import Bodies, BodySpec
from ..kernels.elementary import without_last_bits
from ..kernels.moment import Guide, StepSpec
from ..kernels.shear import add_flow, rate_at
from ..model.planes import held_edges
from ..model.reactions import with_first_bonds
from ..model.scene import Scene
from ..plan.charge_forces import charge_terms
from ..plan.forces.bonded import MOLECULES
from ..plan.forces.pair_force import PairForceFunction
from ..plan.made import Made
from ..plan.pair_spec import extras
from ..plan.plan import Plan, make_plan
from ..plan.reactions import bonds_spec
from .built import BuiltSystem
from .fields import field_variables
from .integrators import PairIntegrator
from .programs import make_program, walls
from .programs.native import native_integrator
from .scene_system import scene_system
from .whole_steps import WholeSteps


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
    engine: str = "auto",
    guide: Guide | None = None,
) -> BuiltSystem:
    """Make System, Topology, positions, velocities and integrator of a scene.

    Parameters are those of :func:`openmm_dpd.plan.plan.make_plan`; ``platform`` is the fastest one by default; a ``guide``
    (:class:`openmm_dpd.kernels.moment.Guide`) acts within the steps of ``mvv``.  Velocities that the scene does not give are drawn from the
    Maxwell distribution, with no total momentum and exactly the scene's kinetic temperature.

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
    choices = {"scheme": scheme, "lam": lam, "conservative": conservative, "seed": seed, "loop": loop, "slow_every": slow_every}
    choices |= {"engine": engine, "guide": guide}
    return build_plan(make_plan(scene, dt=dt, platform=platform_here(platform), **choices), guide)  # type: ignore[arg-type]


def build_plan(plan: Plan, guide: Guide | None = None) -> BuiltSystem:
    """Make System, Topology, positions, velocities and integrator of a plan."""
    require(plan, Plan, "expected a Plan, such as make_plan() returns")
    require(guide, Guide | None, "guide must be a Guide")
    scene, options = plan.scene, plan.options
    program = None if options.scheme.native else make_program(options)
    integrator = native_integrator(plan) if program is None else program.lower()
    execution = plan.execution
    function = _pair_function(plan) if options.kernel and program is not None and not execution.on_device else None
    system = scene_system(plan, integrator, function)
    if isinstance(integrator, PairIntegrator) and function is not None and function.steps is not None:
        integrator.whole = WholeSteps(function, options.pair_group, guide)
    if isinstance(integrator, PairIntegrator) and function is not None and function.hidden:
        integrator.shown_to = function
    if scene.reactions and function is not None and function.steps is not None:
        for name, values in field_variables(function.steps.reactions.initial, BONDS).items():
            integrator.setPerDofVariableByName(name, values)
    if plan.spec.fields is not None:
        for name, values in field_variables(plan.spec.fields.initial).items():
            integrator.setPerDofVariableByName(name, values)
    if scene.gaps and execution.steps != "device":
        for name, values in walls.variables(scene.gaps, options.walls, scene.n_beads).items():
            integrator.setPerDofVariableByName(name, values)
    if scene.interacting is not None and (program is None or ALONE in program.per_dof):
        integrator.setPerDofVariableByName(ALONE, (~scene.interacting).astype(float))
    if isinstance(integrator, PairIntegrator) and execution.on_device:
        integrator.device_group, integrator.pushed = options.pair_group, bool(options.impulses)
    built = BuiltSystem(
        system=system,
        integrator=integrator,
        topology=partial(
            openmm_topology, list(scene.types), scene.molecules, with_first_bonds(scene).bond_pairs, scene.box, scene.residues
        ),
        positions=scene.positions.copy() * unit.nanometer,
        velocities=initial_velocities(scene, options.seed, plan.spec.bodies) * (unit.nanometer / unit.picosecond),
        plan=plan,
        program=program,
    )
    run_in(built, system, system.getForces(), "build()")
    for caution in filter(None, (kind.caution(scene) for kind in (plan.kinds if plan.spec.fields else ()) if kind.caution)):
        logging.getLogger("openmm_dpd").warning("%s", caution)
    return built


def initial_velocities(scene: Scene, seed: int, bodies: BodySpec | None) -> np.ndarray:
    """(N, 3) velocities: those of the scene, or drawn from the Maxwell distribution with no total momentum and exactly the scene's
    temperature, to which the flow of a shear is added; immobile beads are at rest, and beads of rigid bodies move with them."""
    if scene.velocities is not None:
        return _of_bodies(scene.velocities.copy(), scene, bodies)
    flow = 0.0 if scene.shear is None else rate_at(scene.shear, 0.0)
    mobile = ~scene.immobile
    mass = scene.bead_masses[mobile]
    v = np.zeros((scene.n_beads, 3))
    # a few in a thousand normal numbers depend on the logarithm of the C library
    normal = without_last_bits(np.random.default_rng([seed, 0xD9D]).normal(size=(len(mass), 3)), 32)
    drawn = normal * np.sqrt(scene.initial_kT / mass)[:, None]
    if len(mass) > 1:
        drawn -= weighted_sum(mass, drawn) / mass.sum()
        v[mobile] = drawn
        drawn = _of_bodies(v, scene, bodies)[mobile]
        kinetic = np.sum(mass[:, None] * drawn**2)
        if kinetic > 0:
            drawn *= np.sqrt(max(scene.freedom - 3, 0) * scene.initial_kT / kinetic)
    v[mobile] = drawn
    if flow:
        add_flow(v, flow, scene.positions)
    return v


def _of_bodies(v: np.ndarray, scene: Scene, bodies: BodySpec | None) -> np.ndarray:
    """Change velocities (N, 3) to those of rigid bodies, and return them."""
    if bodies is not None:
        Bodies(bodies, len(v)).carry(scene.positions.copy(), v, 0.0, kicked=False)
    return v


def run_in(built: BuiltSystem, system: openmm.System, own: Sequence[openmm.Force], maker: str) -> None:
    """Let the integrator of something built run a System; ``own`` are the forces in it that this package made, ``maker`` the name of the
    function that was called.  The integrator uses all force groups but those of the force that only lists bonds and of a pair force
    that only gives impulses, so that forces which users add to any other group act."""
    options = built.plan.options
    silent = {force.getForceGroup() for force in own if force.getName() == MOLECULES}
    silent |= set() if options.execution.pushes else {options.pair_group}
    built.integrator.setIntegrationForceGroups(set(range(32)) - silent)
    plan = built.plan
    built.integrator.made = Made.of(maker, system, own, options, built.integrator, plan.no_barostat, held_edges(plan.scene))
    built.system = system


def _pair_function(plan: Plan) -> PairForceFunction:
    """The callable of the PythonForce that evaluates the pair terms."""
    scene, options, execution = plan.scene, plan.options, plan.execution
    held = extras(scene, plan.overlays, plan.exceptions, execution.held - ({"segments"} if scene.reactions else set()))
    charges = charge_terms(scene, scene.ewald, plan.charge_exceptions) if "charges" in execution.held else None
    held += () if charges is None else (charges,)
    steps = _step_spec(plan) if execution.looped else None
    held += () if plan.driven is None or plan.driven.continuum is None else (plan.driven.continuum,)
    return PairForceFunction(
        replace(plan.spec, extras=held, sorts=() if steps is None or steps.reactions is None else steps.reactions.sorts),
        conservative=execution.pushes,
        periodic=scene.box is not None,
        scale=options.field_scale,
        balanced=options.compensated and plan.spec.sweeps,
        length_checked=tuple(bonds for bonds in scene.bonds if bonds.limited and not plan.holds(bonds)),
        steps=steps,
        engine=execution.engine,
    )


def _step_spec(plan: Plan) -> StepSpec:
    """What a whole step is."""
    scene, options = plan.scene, plan.options
    letters = () if options.predicting else tuple((letter, float(part)) for letter, part in options.scheme.steps(options.thermostat))
    found = walls.planes(scene.gaps) if scene.gaps else {}
    planes = tuple(found[name] for name in walls.CONSTANTS) if found else None
    weights = options.thermostat, options.lam, options.field_lam
    tilt = 0.0 if scene.box is None else float(scene.box[1, 0])
    walled = planes, plan.driven, options.ramp
    return StepSpec(letters, options.slow_kicks, options.slow_every, *weights, *walled, scene.shear, tilt, bonds_spec(scene))
