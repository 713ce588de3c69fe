"""Two drifts and three kicks to a sweep: B(dt/5), A(dt/2), B(3dt/5), A(dt/2), B(dt/5), sweep(dt).

Between two sweeps stands a symmetric splitting with two new forces, whose weights (McLachlan, SIAM J. Sci. Comput. 16, 151 (1995), keeps
the first one free) are chosen for sampling: with a fifth the errors that kicks and drifts make in the distribution of positions cancel
nearly (see docs/theory.md), where two leapfrog steps (a quarter) are far too hot and the sixth of Simpson's rule too cold.  Velocities are
read right after the sweep, where they are Maxwell's.  The force at the end of a step serves the next one too.  Positions and velocities
both stay right at steps more than twice as long as those of any other scheme here.
"""

from __future__ import annotations

from ..names import KICKS, Phase
from ..plan import ProgramOptions
from .program import Program
from .walls import reflect

OUTER, INNER = KICKS


def program(options: ProgramOptions) -> Program:
    """Program for the options given; without friction and noise it is the splitting alone."""
    p = Program("bababo", "McLachlan 1995 with weights for sampling, and exact pair updates", options)
    p.begin()
    if options.thermostat and options.sole_force and not options.walls and not options.compensated:
        p.when_alone()
        _one_update(p)
        p.otherwise()
        _beside_others(p)
        p.end()
    elif options.thermostat:
        _beside_others(p)
    else:
        _plain(p)
    return p


def _one_update(p: Program) -> None:
    """The kernel holds every force: it adds the kicks up, and v is written once."""
    p.phase(Phase.CONSERVE)
    p.each("x", f"x+0.5*dt*(v+{OUTER!r}*dt*f/m)", "outer kick, half drift")
    fields = p.fields()
    if fields:
        p.keep()
    positions = p.show_on_the_way(fields)
    p.phase(Phase.READ_TWO_KICKS if fields else Phase.TWO_KICKS)
    p.each("x", f"{positions}+0.5*dt*(v+dt*f/m)", "both kicks, half drift")
    p.next_temperature()
    p.next_noise("0.5*dt")
    p.phase(Phase.KICK_SWEEP_OUTER)
    p.each("v", f"v+dt*{p.pair_force}/m", "three kicks, sweep: the half drift showed the velocities")
    p.after_sweep(fields)
    p.phase(Phase.IDLE)


def _beside_others(p: Program) -> None:
    """With forces of OpenMM's, the one at the end of a step is kept for the next: a trial drift shows the velocities to the sweep."""
    p.keep_acceleration()
    _two_drifts(p, "acc")
    p.conserve_or_keep()
    p.each("acc", "f/m")
    fields = p.show_to_sweep(f"(v+{OUTER!r}*dt*acc)")
    if fields:
        p.each("v", f"v+{OUTER!r}*dt*acc", "outer kick")
        p.sweep(fields)
    else:
        p.each("v", f"v+{OUTER!r}*dt*acc+dt*{p.pair_force}/m", "outer kick, sweep")
    p.each("x", "xs", "back")
    p.acceleration_is_kept()


def _plain(p: Program) -> None:
    _conserve(p)
    _two_drifts(p, "f/m")
    _conserve(p)
    p.each("v", f"v+{OUTER!r}*dt*f/m", "outer kick")
    if p.options.kernel:
        p.phase(Phase.IDLE)


def _two_drifts(p: Program, acceleration: str) -> None:
    """Outer kick, half drift, inner kick, half drift."""
    p.each("v", f"v+{OUTER!r}*dt*{acceleration}", "outer kick")
    p.each("x", "x+0.5*dt*v", "half drift")
    reflect(p)
    _conserve(p)
    p.each("v", f"v+{INNER!r}*dt*f/m", "inner kick")
    p.each("x", "x+0.5*dt*v", "half drift")
    reflect(p)


def _conserve(p: Program) -> None:
    if p.options.kernel_conservative:
        p.phase(Phase.CONSERVE)
