"""OpenMM's own DPDIntegrator, where it can express the scene.

It relaxes the relative velocity of a pair at the rate 2 f w^2 with w = 1 - r/rc, which is LAMMPS's gamma for f = gamma (1/m_i + 1/m_j)/2.
On GPU platforms it updates all pairs at once from the old velocities, which is not exact: at gamma = 40.5 and dt = 0.04 the temperature is
10 % too high there, on the same script.
"""

import numpy as np
import openmm
from openmm import unit

from ...base.errors import PlanError
from ...base.neighbours import coincident_pairs
from ...base.units import BOLTZMANN
from ...base.wording import bead_names, bead_number
from ...model.pairs import NONE
from ...plan.execution import DOUBLE_PLATFORMS
from ...plan.made import origin
from ...plan.neighbour_list import may_miss_pairs
from ...plan.plan import Plan
from ...plan.program_options import ProgramOptions
from ..integrators import NativeIntegrator


def why_not(plan: Plan) -> str | None:
    """The reason why the DPDIntegrator cannot run this scene, or None."""
    scene = plan.scene
    if scene.walls:
        return "it cannot reflect beads at walls"
    if len(plan.layers) != 1:
        return f"it holds one table of friction coefficients, and the scene has {len(plan.layers)}"
    (kind,) = plan.kinds
    if kind.why_not_native is None:
        return f"it knows isothermal DPD only, not {kind.name}"
    if plan.options.ramp is not None:
        return "its temperature cannot follow a ramp within a run"
    if plan.exceptions:
        return "it cannot scale the friction of bonded neighbours"
    if scene.mobile is not None and not scene.mobile.all():
        return f"bead {bead_number(np.argmin(scene.mobile))} is immobile, and near beads of mass 0 its velocities become NaN"
    together = coincident_pairs(scene.positions, scene.box, 1e-10)
    if together:
        return f"{bead_names(*together[0])} are at the same point, where its friction is NaN unless their velocities differ"
    if plan.platform in DOUBLE_PLATFORMS and may_miss_pairs(scene.box, max((c.cutoff for c in plan.layers[0].values()), default=0.0)):
        return f"in this box, small and tilted, it misses the friction of some pairs on the {plan.platform} platform"
    for (a, b), c in plan.layers[0].items():
        if c is NONE:
            continue
        reason = kind.why_not_native(c)
        if reason is not None:
            return f"for types ({a}, {b}) {reason}"
    for name, mass in scene.masses.items():
        members = scene.type_ids == scene.type_names.index(name)
        if np.any(scene.bead_masses[members] != mass):
            return f"its friction is a rate, so all beads of type {name} must have the same mass"
    return None


def native_marker(options: ProgramOptions, integrator: openmm.Integrator, periodic: bool) -> openmm.Force:
    """An empty force.

    It makes a System periodic: without a force that does, the DPDIntegrator ignores the box, and so friction across it.  And its
    parameters say in every state that this scheme wrote it.
    """
    force = openmm.CustomBondForce("0")
    force.setUsesPeriodicBoundaryConditions(periodic)
    force.setName("native scheme")
    force.setForceGroup(options.pair_group)
    for name, value in origin(options, integrator).items():
        force.addGlobalParameter(name, value)
    return force


def native_integrator(plan: Plan) -> NativeIntegrator:
    """The integrator for a plan; PlanError, with the reason, if it cannot express the scene."""
    reason = why_not(plan)
    if reason is not None:
        raise PlanError(f"OpenMM's DPDIntegrator cannot run this scene: {reason}")
    scene, options = plan.scene, plan.options
    pairs = [(a, b, c) for (a, b), c in plan.layers[0].items() if c is not NONE]
    # pairs without a coefficient have no friction; the default only has to have a legal cutoff
    integrator = NativeIntegrator(
        options.kT / BOLTZMANN * unit.kelvin, 0.0, max((c.cutoff for *_, c in pairs), default=1.0), options.dt * unit.picosecond
    )
    integrator.setRandomNumberSeed(options.openmm_seed)
    for index, kind in enumerate(scene.type_ids.tolist()):
        integrator.setParticleType(index, kind)
    number = {name: k for k, name in enumerate(scene.type_names)}
    for a, b, c in pairs:
        integrator.addTypePair(number[a], number[b], (c.gamma or 0.0) * (1 / scene.masses[a] + 1 / scene.masses[b]) / 2, c.cutoff)
    return integrator
