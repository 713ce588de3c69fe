"""Bonds that form and break in a running scene.  They are per-DOF variables of the integrator (``bonds0``, ..., three bonds per bead in
each), so OpenMM's checkpoints and saved states hold them."""

from copy import copy
from dataclasses import replace

import numpy as np
import openmm

from ..base.names import GUIDE
from ..base.units import keep
from ..kernels.exceptions import compressed_exceptions
from ..kernels.formed import bonds_in, both_ways
from ..kernels.reactions import types_in
from ..model.reactions import bond_sorts, terms_like, types_change
from ..plan.pair_spec import neighbour_factors, neighbours_change
from ..plan.plan import Plan
from ..plan.reactions import bonds_at_start, come_and_go, segments_then
from .fields import check_running, raw_bonds


def read_bonds(context: openmm.Context, plan: Plan) -> np.ndarray:
    """(B, 3) bonds that form and break, as they are now, in the plan ``built.plan``: two beads, and the sort, which is the number of its
    :class:`~openmm_dpd.ReactiveBonds` in the order in which ``reactions`` name them."""
    check_running(context, plan)
    found = [np.zeros((0, 3), np.int64)]
    for k in range(len(bond_sorts(plan.scene.reactions))):
        pairs = bonds_in(raw_bonds(context.getIntegrator()), k).astype(np.int64)
        found.append(np.column_stack([pairs, np.full(len(pairs), k)]))
    return np.concatenate(found)


def read_reacted(context: openmm.Context, plan: Plan) -> np.ndarray:
    """(R, 3) for each of the scene's ``reactions``: bonds made and broken since the start, and bonds that its last trial has changed."""
    check_running(context, plan)
    get, end = context.getIntegrator().getGlobalVariableByName, len(plan.options.numbers)
    return np.array([get(f"{GUIDE}{k}") for k in range(end - 3 * len(plan.scene.reactions), end)]).reshape(-1, 3).astype(np.int64)


def read_types(context: openmm.Context, plan: Plan) -> list[str]:
    """Names of the types that beads have now, (N,), in the plan ``built.plan``: reactions may change them."""
    check_running(context, plan)
    scene = plan.scene
    if not scene.reactions:
        return list(scene.types)
    table = raw_bonds(context.getIntegrator())
    return [scene.type_names[k] for k in types_in(table, scene.type_ids, len(bond_sorts(scene.reactions))).tolist()]


def with_bonds(plan: Plan, table: np.ndarray) -> Plan:
    """The plan with a scene whose ``types``, ``bonds``, ``angles``, ``dihedrals`` and ``impropers`` are those that stay and those of a
    table, (N, W): what measuring that moment needs."""
    groups = [bonds.between(bonds_in(table, k).astype(np.int64)) for k, bonds in enumerate(bond_sorts(plan.scene.reactions))]
    now, scene, spec, start = copy(plan), copy(plan.scene), plan.spec, both_ways(bonds_at_start(plan.scene), len(table))
    for term, beads_of in come_and_go(plan.scene):
        what = f"{term._BEADS[2]}s"
        keep(scene, **{what: (*getattr(scene, what), terms_like(term, beads_of(table, start).astype(np.int64)))})
    if scene.segments is not None:
        beads = segments_then(plan.scene)(table, start)
        keep(scene, segments=replace(scene.segments, bonds=beads) if len(beads) else None)
    keep(scene, bonds=(*scene.bonds, *(group for group in groups if len(group.pairs))))
    if types_change(scene.reactions):
        types = types_in(table, scene.type_ids, len(groups))
        keep(scene, type_ids=types, types=tuple(scene.type_names[k] for k in types.tolist()))
        spec = replace(spec, types=types)
    factors = neighbour_factors(scene, scene.bond_pairs)[0]
    if neighbours_change(scene):
        spec = replace(spec, exceptions=compressed_exceptions(factors, len(table), changes=True))
    keep(now, scene=scene, exceptions=factors, spec=spec)
    return now
