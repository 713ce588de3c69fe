"""Forces of a scene, term by term, at given positions and velocities."""

import numpy as np
import openmm
from openmm import unit

from ..base.errors import ParameterError, require
from ..base.names import BONDED_GROUP, COULOMB_GROUP, EXTERNAL_GROUP, LATTICE_GROUP, SHOWN
from ..base.units import to_md, whole_number
from ..kernels.layer import DISSIPATIVE, RANDOM
from ..kernels.shear import add_flow, rate_at
from ..plan.forces.thread_state import Shown
from ..plan.made import groups_of
from ..simulation.built import BuiltSystem
from .observer import require_built


def force_terms(
    built: BuiltSystem, positions=None, velocities=None, *, counter: int = 1, properties: dict[str, str] | None = None
) -> dict[str, np.ndarray]:
    """Forces of a scene, term by term, at given positions and velocities; in force form for any scheme.

    Parameters
    ----------
    built : BuiltSystem
    positions, velocities : (N, 3) arrays, optional
        Bare numbers are in nm and nm/ps; by default those of the scene.
    counter : int
        Noise counter; another value gives independent random forces.
    properties : dict, optional
        Platform properties.

    Returns
    -------
    dict of (N, 3) arrays, kJ/mol/nm
        ``conservative`` (all pair potentials except charges, from the plan's platform), ``electrostatic`` if there are charges,
        ``bond`` if beads are joined, ``external`` if there are body forces, ``other`` if the System has foreign
        forces, ``dissipative`` and ``random``.  They add up to the total force.  If beads have internal energies, temperatures or
        concentrations, ``rates_dissipative`` and ``rates_random`` (N, K) are their rates of change at the scene's initial values.

    Raises
    ------
    ParameterError
        If a value has the wrong shape, or ``built`` is not a built scene: the terms of atoms beside beads are not separated.
    """
    require_built(built, "force_terms")
    require(properties, dict | None, "properties must be a dict of names and values of the platform")
    if built.plan.host is not None:
        raise ParameterError(
            "force_terms separates the terms of a scene only, not those of a System made elsewhere; for its total forces use "
            "context.getState(forces=True)"
        )
    plan = built.plan
    scene, spec = plan.scene, plan.spec
    x = _vectors(scene.positions if positions is None else positions, "length", "positions", scene.n_beads)
    v = _vectors(built.velocities if velocities is None else velocities, "velocity", "velocities", scene.n_beads)
    counter = whole_number(counter, "counter", least=0)
    function = None if built.integrator.whole is None else built.integrator.whole.function
    held = [*plan.behind] if function is None else [*function.spec.extras]
    if scene.reactions and function is not None:
        function.thread_state().loop.show(function.steps.reactions.initial)
        held += [each.terms for each in function.thread_state().engine.extras[len(held) :]]
    # an integrator belongs to one Context, and this one is discarded
    integrator = openmm.VerletIntegrator(plan.options.dt)
    context = openmm.Context(built.system, integrator, openmm.Platform.getPlatformByName(plan.platform), properties or {})
    context.setPositions(x)
    if SHOWN in context.getParameters():
        bonds = function.steps.reactions.initial if function is not None and scene.reactions else None
        shown = Shown.of(spec, bonds, None if spec.fields is None else spec.fields.initial)
        context.setParameter(SHOWN, shown.number)
    used = built.integrator.getIntegrationForceGroups()
    groups = {g for g in range(32) if used & (1 << g)}
    others = [] if built.integrator.made is None else built.integrator.made.others(built.system.getForces())
    apart = {
        "bond": {BONDED_GROUP} if scene.bonded else set(),
        "external": {EXTERNAL_GROUP} if scene.body_forces else set(),
        "electrostatic": {COULOMB_GROUP, LATTICE_GROUP} if scene.electrostatics is not None else set(),
        "other": set().union(*map(groups_of, others)),
    }
    terms = {name: _forces(context, found) for name, found in apart.items() if found}
    terms["conservative"] = _forces(context, groups.difference(*apart.values()))
    for extra in held:
        if extra.term != "conservative":
            # part of the pair force
            part = np.zeros_like(x)
            extra.evaluator().add_to(x, scene.box, part, 1.0)
            terms[extra.term] = terms.get(extra.term, 0.0) + part
            terms["conservative"] -= part
    engine = plan.new_engine()
    engine.prepare(x, scene.box)
    if scene.shear is not None:
        rate, v = rate_at(scene.shear, 0.0), v.copy()
        engine.set_flow(np.array([rate]))
        add_flow(v, -rate, x)
    values = None if spec.fields is None else spec.fields.initial
    for name, which in (("dissipative", DISSIPATIVE), ("random", RANDOM)):
        terms[name] = engine.forces(which, v, scene.initial_kT, plan.options.dt, plan.options.seed, counter, values)[1]
        if values is not None:
            # rates of conductive and mechanical energy, of temperature, or of each concentration
            terms[f"rates_{name}"] = engine.rates.copy()
    if scene.interacting is not None:
        terms |= {name: np.where(scene.interacting, terms[name], 0.0) for name in terms if name != "external" and "rates" not in name}
    return terms


def _vectors(value, dimension: str, name: str, count: int) -> np.ndarray:
    array = np.ascontiguousarray(to_md(value, dimension, name))
    if array.shape != (count, 3):
        raise ParameterError(f"{name} must have shape {(count, 3)}, not {array.shape}")
    return array


def _forces(context: openmm.Context, groups) -> np.ndarray:
    if not groups:
        return np.zeros((context.getSystem().getNumParticles(), 3))
    return context.getState(forces=True, groups=groups).getForces(asNumpy=True).value_in_unit(unit.kilojoule_per_mole / unit.nanometer)
