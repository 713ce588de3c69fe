"""Symmetric splitting with the forces in the middle: A(dt/2), B(dt/2), sweep(dt), B(dt/2), A(dt/2).

Conservative force and sweep are evaluated at the same positions, so that one pass over the geometry serves both (Shang, SIAM J. Sci.
Comput. 43, A1716 (2021), calls this order ABOBA).  Configurations stay right at larger steps than with any other scheme
here; velocities, read at whole steps, look hot.
"""

from __future__ import annotations

from ..names import Phase
from ..plan import ProgramOptions
from .program import Program
from .walls import reflect


def program(options: ProgramOptions) -> Program:
    """Program for the options given; without friction and noise it is the position Verlet scheme."""
    p = Program("aboba", "Shang 2021, ABOBA, with exact pair updates", options)
    p.begin()
    if options.thermostat and options.sole_force and not options.walls and not (options.field_blocks and options.compensated):
        p.when_alone()
        _one_evaluation(p)
        p.otherwise()
        _two_evaluations(p)
        p.end()
    else:
        _two_evaluations(p)
    if options.kernel:
        p.phase(Phase.IDLE)
    return p


def _one_evaluation(p: Program) -> None:
    """The kernel holds every force: it can kick, sweep and kick at once."""
    p.keep()
    fields = p.fields()
    positions = p.show_on_the_way(fields)
    if fields:
        p.hear(Phase.READ, "the pair force reads them")
    p.each("x", f"{positions}+0.5*dt*v", "half drift")
    p.next_temperature()
    p.next_noise("0.5*dt")
    p.phase(Phase.KICK_SWEEP_SEEN)
    p.each("v", f"v+dt*{p.pair_force}/m", "half kick, sweep, half kick: the half drift showed the velocities")
    p.after_sweep(fields)
    p.each("x", "x+0.5*dt*v", "half drift")


def _two_evaluations(p: Program) -> None:
    options = p.options
    p.each("x", "x+0.5*dt*v", "half drift")
    reflect(p)
    p.conserve_or_keep()
    if not options.thermostat:
        p.each("v", "v+dt*f/m", "kick")
        p.each("x", "x+0.5*dt*v", "half drift")
        reflect(p)
        return
    p.declare_per_dof("acc", "conservative acceleration at the middle of the step")
    p.each("acc", "f/m")
    fields = p.show_to_sweep("(v+0.5*dt*acc)")
    if fields:
        p.each("v", "v+0.5*dt*acc", "half kick")
        p.sweep(fields)
        p.each("v", "v+0.5*dt*acc", "half kick")
    else:
        p.each("v", f"v+dt*acc+dt*{p.pair_force}/m", "half kick, sweep, half kick")
    p.each("x", "xs+0.5*dt*v", "half drift")
    reflect(p)
