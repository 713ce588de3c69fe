"""Leapfrog middle splitting with exact pair updates: B(dt), A(dt/2), sweep(dt), A(dt/2).

The order is that of OpenMM's middle integrators (Zhang et al., J. Phys. Chem. A 123, 6056 (2019)) with the sweep in the
place of their thermostat.  Velocities stand half a step behind the kick, so kinetic and configurational temperature are both right
to second order.  The first half drift shows the velocities to the pair force; no trial drift is needed.
"""

from __future__ import annotations

from ..names import Phase
from ..plan import ProgramOptions
from .program import Program
from .walls import reflect


def program(options: ProgramOptions) -> Program:
    """Program for the options given; without friction and noise it is the leapfrog scheme."""
    p = Program("middle", "Zhang et al. 2019, with exact pair updates", options)
    p.begin()
    p.conserve_or_keep()
    if options.thermostat and options.sole_force and not options.walls and not options.field_blocks:
        p.when_alone()
        _one_update(p)
        p.otherwise()
        _kick_by_kick(p)
        p.end()
    else:
        _kick_by_kick(p)
    if options.kernel:
        p.phase(Phase.IDLE)
    return p


def _kick_by_kick(p: Program) -> None:
    """The rest of a step beside any force."""
    options = p.options
    p.each("v", "v+dt*f/m", "kick")
    p.constrain_velocities()
    if options.walls:
        _beside_walls(p)
        return
    fields = p.fields()
    if fields:
        p.keep_positions()
        p.read(fields)
    p.each("x", "xs+0.5*dt*v" if fields else "x+0.5*dt*v", "half drift")
    if options.thermostat:
        p.next_temperature()
        p.next_noise("0.5*dt")
        p.phase(Phase.SWEEP_SEEN)
        p.sweep(fields, "sweep: the half drift showed the velocities")
        p.constrain_velocities()
    p.each("x", "x+0.5*dt*v", "half drift")
    if options.constraints:
        p.declare_per_dof("xu", "positions before they are constrained")
        p.each("xu", "x")
        p.constrain_positions()
        p.each("v", "v+(x-xu)/dt", "the constraints' impulse")


def _one_update(p: Program) -> None:
    """The rest of a step where the kernel holds every force: it remembers the kick, and v is written once."""
    p.each("x", "x+0.5*dt*(v+dt*f/m)", "kick, half drift")
    p.next_temperature()
    p.next_noise("0.5*dt")
    p.phase(Phase.SWEEP_SEEN_CONSERVED)
    p.each("v", f"v+dt*{p.pair_force}/m", "kick, sweep: the half drift showed the velocities")
    p.each("x", "x+0.5*dt*v", "half drift")


def _beside_walls(p: Program) -> None:
    """The rest of a step where a half drift may end in a reflection, which would spoil what it shows of the velocities."""
    options = p.options
    p.each("x", "x+0.5*dt*v", "half drift")
    reflect(p)
    if options.thermostat:
        p.keep()
        p.sweep(p.show_to_sweep("v"))
    p.each("x", "xs+0.5*dt*v" if options.thermostat else "x+0.5*dt*v", "half drift")
    reflect(p)
