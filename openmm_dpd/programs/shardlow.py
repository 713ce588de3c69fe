"""Shardlow splitting, first order (Shardlow, SIAM J. Sci. Comput. 24, 1267 (2003), S1; Lisal et al., J. Chem. Phys. 135, 204105 (2011)).

One sweep of pair updates over the whole dt at the positions of the step's beginning, then velocity Verlet with the conservative
forces: S(dt), B(dt/2), A(dt), B(dt/2).  This is what LAMMPS's fix shardlow with fix nve does.  The sweep needs the velocities at the
beginning of the step, which only a trial drift can show.
"""

from __future__ import annotations

from ..names import Phase
from ..plan import ProgramOptions
from .mvv import program as velocity_verlet
from .program import Program
from .walls import reflect


def program(options: ProgramOptions) -> Program:
    """Program for the options given; without friction and noise it is velocity Verlet."""
    if not options.thermostat:
        return velocity_verlet(options)
    p = Program("shardlow", "Shardlow 2003, S1", options)
    p.begin()
    if options.sole_force and not options.walls and not options.field_blocks:
        p.when_alone()
        _one_update(p)
        p.otherwise()
        _update_by_update(p)
        p.end()
    else:
        _update_by_update(p)
    return p


def _update_by_update(p: Program) -> None:
    """A step beside any force."""
    options = p.options
    p.keep_acceleration()
    fields = p.show_to_sweep("v")
    if fields:
        p.sweep(fields)
        p.each("v", "v+0.5*dt*acc", "half kick")
    else:
        p.each("v", f"v+dt*{p.pair_force}/m+0.5*dt*acc", "sweep, half kick")
    p.each("x", "xs+dt*v", "drift")
    reflect(p)
    p.phase(Phase.CONSERVE if options.kernel_conservative else Phase.IDLE)
    p.each("acc", "f/m")
    p.each("v", "v+0.5*dt*acc", "half kick")
    p.acceleration_is_kept()


def _one_update(p: Program) -> None:
    """The kernel holds every force: it remembers the first half kick, and v is written once."""
    p.next_temperature()
    p.keep()
    p.each("x", "x+dt*v", "drift: shows the velocities")
    p.next_noise("dt")
    p.phase(Phase.SWEEP_KICK_KEPT)
    p.each("x", f"x+dt*(dt*{p.pair_force}/m)", "what sweep and half kick add to the drift")
    p.phase(Phase.CLOSE)
    p.each("v", f"v+dt*{p.pair_force}/m", "sweep and both half kicks")
    p.phase(Phase.IDLE)
