"""Plan -> System: all forces that the scene needs, each in its group."""

from typing import Any, cast

import numpy as np
import openmm

from ..base.errors import PlanError, bead_names
from ..base.geometry import coincident_pairs
from ..base.names import BONDED_GROUP, COULOMB_GROUP, LAST_POTENTIAL_GROUP, LATTICE_GROUP, PAIR_GROUP, POTENTIAL_GROUP
from ..model.angles import Torsions
from ..model.flow import PositionForce
from ..plan.forces.bonded import molecules
from ..plan.forces.device_force import attributes_of, device_force
from ..plan.forces.electrostatics import electrostatic_forces, needs_list
from ..plan.forces.expressions import PairExpression, exception_force, nonbonded_force
from ..plan.forces.external import external_force
from ..plan.forces.pair_force import PairForceFunction, pair_force
from ..plan.forces.segments import segment_force, segment_spec
from ..plan.kinds import bonded_forces, resolved_kind
from ..plan.pair_spec import Factors
from ..plan.plan import Plan
from .integrators import NativeIntegrator, PairIntegrator
from .programs.native import native_marker
from .programs.walls import planes


def scene_system(plan: Plan, integrator: PairIntegrator | NativeIntegrator, function: PairForceFunction | None) -> openmm.System:
    """The System of a plan; its context parameters identify the integrator."""
    scene, options = plan.scene, plan.options
    periodic = scene.box is not None
    system = openmm.System()
    mobile = ~scene.immobile
    for mass in np.where(mobile, scene.bead_masses, 0.0).tolist():
        system.addParticle(mass)
    if scene.box is not None:
        box = scene.box.copy()
        if scene.shear is not None and plan.execution.on_device and box[1, 0] == 0.0:
            box[1, 0] = 1e-14 * box[0, 0]  # in a Context of a rectangular box GPU platforms take no other
        system.setDefaultPeriodicBoxVectors(*(openmm.Vec3(*row) for row in box.tolist()))
    layers = plan.layers if plan.execution.conservative == "openmm" else ()
    densities = [layer for layer in layers if resolved_kind(layer).density_force is not None]
    held = plan.execution.held
    tables = (*layers, *(() if "overlays" in held else plan.overlays))
    expressions = [resolved_kind(table).potential(table, scene.type_names) for table in tables]  # type: ignore[misc]  # make_plan refuses others
    factors = _excluded_pairs(plan, expressions)
    outside = [group for group in scene.bonded if not plan.holds(group)]
    told = [bonds.pairs for bonds in scene.bonds if plan.holds(bonds) and len(bonds.pairs)]
    told += [np.stack([body.beads[:-1], body.beads[1:]], axis=1) for body in scene.bodies]
    free = _add_pair_expressions(system, plan, expressions, factors)
    _add_charges(system, plan, factors)
    if free - len(densities) + 1 < LAST_POTENTIAL_GROUP:
        raise PlanError(f"the pair potentials and densities need more than {POTENTIAL_GROUP - LAST_POTENTIAL_GROUP + 1} force groups")
    for k, layer in enumerate(densities):
        excluded = sorted(pair for pair, factor in plan.exceptions.items() if factor == 0.0)
        force = resolved_kind(layer).density_force(layer, scene.type_names, scene.type_ids, excluded, periodic)  # type: ignore[misc]
        force.setForceGroup(free - k)
        system.addForce(force)
    if told:
        system.addForce(molecules(np.concatenate(told)))
    for group in (group for group in outside if isinstance(group, Torsions)):
        for flat in group.in_line(scene.positions, scene.box)[:1]:
            which = f"three of {bead_names(*group.quads[flat])} are in line"
            raise PlanError(f"{which}, where OpenMM, which computes their {group._BEADS[2]} here, has no force; move one of them a little")
    for force in bonded_forces(outside, periodic):
        force.setForceGroup(BONDED_GROUP)
        system.addForce(force)
    segments = None if "segments" in held else segment_spec(scene)
    if segments is not None:
        system.addForce(segment_force(segments, periodic))
    for term in scene.body_forces:
        if "body forces" not in held or isinstance(term, PositionForce):
            system.addForce(external_force(term, scene.type_ids, scene.type_names, scene.box))
    if function is not None:
        system.addForce(pair_force(function, options=options, integrator=integrator))
    if plan.execution.on_device:
        whole, tells = plan.execution.steps == "device", [cast(Any, kind.device) for kind in plan.kinds]
        letters = () if not whole else (("V", options.lam),) if options.predicting else options.scheme.steps(options.thermostat)
        walls = planes(scene.gaps) if whole and scene.walls else {}
        slow = _slow_groups(plan, system) if plan.execution.slow and not options.predicting else ()
        own: dict[str, Any] = {"options": options, "integrator": integrator, "periodic": periodic}
        system.addForce(device_force(plan.spec, tells, letters, walls, slow, more=attributes_of(scene, plan.driven), **own))
    if options.scheme.native:
        system.addForce(native_marker(options, integrator, periodic))
    return system


def _slow_groups(plan: Plan, system: openmm.System) -> set[int]:
    """Force groups that kick before and after a whole step on the device, as they do beside the host's loop: those of charges, and all that
    are free for forces of the user."""
    letters, ends = plan.options.scheme.steps(plan.options.thermostat), plan.options.slow_kicks
    kicks = {n: part for n, (letter, part) in enumerate(letters) if letter == "B"}
    if kicks == {n: part for n, part in zip((0, len(letters) - 1), ends, strict=True) if part}:
        return set()  # all kicks are at the ends: one evaluation serves both
    fast = {force.getForceGroup() for force in system.getForces()} - {COULOMB_GROUP, LATTICE_GROUP}
    return set(range(PAIR_GROUP)) - fast


def _excluded_pairs(plan: Plan, expressions: list[PairExpression]) -> Factors:
    """Pairs that all nonbonded forces exclude, with their factors: bonded neighbours, and beads at the same point."""
    scene = plan.scene
    reaches = [e.cutoff for e in expressions]
    if scene.electrostatics is not None:
        reaches.append(1.0 / scene.electrostatics.steepness)
    if not reaches:
        return {}
    factors = dict(plan.exceptions)
    # GPU platforms need the same exclusions in all pair forces
    for pair in (*plan.charge_exceptions, *coincident_pairs(scene.positions, scene.box, 1e-4 * max(reaches))):
        factors.setdefault(pair, 1.0)
    return factors


def _add_charges(system: openmm.System, plan: Plan, factors: Factors) -> None:
    """Add the forces of smeared charges."""
    scene = plan.scene
    if scene.electrostatics is None or "charges" in plan.execution.held:
        return
    assert scene.charges is not None
    ewald = scene.ewald
    listed = ewald is not None and needs_list(scene.charges, ewald, scene.box) and plan.listed(ewald.cutoff)
    constant = scene.electrostatics.coulomb(scene.initial_kT)
    factors = {pair: plan.charge_exceptions.get(pair, 1.0) for pair in factors}
    for force in electrostatic_forces(scene.electrostatics, scene.charges, constant, ewald, factors, listed=listed):
        system.addForce(force)


def _add_pair_expressions(system: openmm.System, plan: Plan, expressions: list[PairExpression], factors: Factors) -> int:
    """Add the forces of radial pair potentials; returns the highest force group that is left.  GPU platforms need one cutoff per group, and
    the same exclusions in all forces."""
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
        made: list[openmm.Force] = [
            nonbonded_force(expression, scene.type_ids, exclusions, periodic, listed=plan.listed(expression.cutoff))
        ]
        if restored:
            made.append(exception_force(expression, scene.type_ids, restored, periodic))
        for force in made:
            force.setForceGroup(POTENTIAL_GROUP - number)
            system.addForce(force)
    return POTENTIAL_GROUP - len(groups)
