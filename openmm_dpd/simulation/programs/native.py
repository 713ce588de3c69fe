"""OpenMM's own DPDIntegrator.

It relaxes the relative velocity of a pair at the rate 2 f w^2 with w = 1 - r/rc, which is LAMMPS's gamma for f = gamma (1/m_i + 1/m_j)/2.
On GPU platforms it updates all pairs at once from the old velocities, which is not exact: at gamma = 40.5 and dt = 0.04 the temperature is
10 % too high there.
"""

import openmm
from openmm import unit

from ...base.units import BOLTZMANN
from ...model.pairs import NONE
from ...plan.made import origin
from ...plan.plan import Plan
from ...plan.program_options import ProgramOptions
from ..integrators import NativeIntegrator


def native_marker(options: ProgramOptions, integrator: openmm.Integrator, periodic: bool) -> openmm.Force:
    """An empty force that makes a System periodic and marks its states.

    Without a periodic force, the DPDIntegrator ignores the box, and so friction across it.  The parameters of the force identify states of
    this scheme.
    """
    force = openmm.CustomBondForce("0")
    force.setUsesPeriodicBoundaryConditions(periodic)
    force.setName("native scheme")
    force.setForceGroup(options.pair_group)
    for name, value in origin(options, integrator).items():
        force.addGlobalParameter(name, value)
    return force


def native_integrator(plan: Plan) -> NativeIntegrator:
    """OpenMM's DPDIntegrator with the friction of a plan."""
    scene, options = plan.scene, plan.options
    pairs = [(a, b, c) for (a, b), c in plan.layers[0].items() if c is not NONE]
    # pairs without a coefficient have no friction; the default only needs a valid cutoff
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
