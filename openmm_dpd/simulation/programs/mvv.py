"""Modified velocity Verlet (Groot and Warren, J. Chem. Phys. 107, 4423 (1997), eqs 9-12).

With a(t) the acceleration by all forces, including friction and noise, which is drawn once per step and used by two half kicks::

    v_half = v + dt/2 a(t)
    x      = x + dt v_half
    v_pred = v + lambda dt a(t)              used by friction
    a(t+dt) from x, v_pred and new noise
    v      = v_half + dt/2 a(t+dt)

lambda = 1/2 is plain velocity Verlet: v_pred = v_half, which the drift itself passes to the pair force.  LAMMPS's fix nve and fix mvv/dpd
are the same.  a(t) depends on history: it is stored per degree of freedom with a fingerprint of what it was computed from, and computed
anew (with the present velocities) whenever positions, velocities, fields, box, dt or a parameter have changed since the last step.  The
noise is always that of the last half kick.
"""

from ...base.names import RATE, Phase
from ...plan.program_options import ProgramOptions
from .program import Program
from .splitting import kick_after, kick_before
from .walls import add_reflection


def mvv_program(options: ProgramOptions) -> Program:
    """Program of ``mvv``; without friction and noise it is velocity Verlet."""
    p = Program("mvv", "Groot and Warren 1997", options)
    p.declare_per_dof("acc", "acceleration at x, with friction and noise")
    p.begin()
    fields = p.fields()
    rates = [f"{RATE}{k}" for k in range(len(fields))]
    for name in rates:
        p.declare_per_dof(name, "change of the field per time, at x")
    left = ["v", *fields] if options.thermostat else fields
    p.store_fingerprint(left)
    with p.if_changed():
        _recompute(p, fields, rates)
    predicted = options.thermostat and options.lam != 0.5
    more = ""
    if predicted:
        p.declare_per_dof("vp", "predicted velocity")
        if options.execution.looped and options.slow_every == 1:  # impulses over several steps are taken as they are
            p.each("vp", "v", "before other forces kick")
            more = f"+{2 * options.lam - 1!r}*(v-vp)"
    kick_before(p)
    if predicted:
        p.each("vp", f"v+{options.lam!r}*dt*acc{more}", "what the friction will see")
    seen = _advance_fields(p, fields, rates)
    p.each("v", "v+0.5*dt*acc", "half kick")
    if fields:
        p.keep_positions()
        p.read(seen)
    p.each("x", "xs+dt*v" if fields else "x+dt*v", "drift")
    add_reflection(p, ("vp",) if predicted else ())
    p.next_temperature()
    if predicted or options.walls or not options.thermostat:
        p.phase(Phase.CONSERVE) if options.execution.pushes else p.store_fingerprint()
        p.each("acc", f"{p.kicking}/m", "conservative acceleration")
        if options.thermostat:
            p.next_noise(options.trial_time)
            _add_friction_and_noise(p, "vp" if predicted else "v")
    else:
        p.next_noise("dt")
        p.phase(Phase.FORCE_SEEN)
        p.each("acc", f"{p.kicking}/m", "the drift passed the half-step velocity")
        if not options.execution.pushes:
            p.each("acc", f"acc+{p.pair_force}/m", "friction and noise")
    p.leave_to_body_forces()
    _take_rates(p, rates)
    p.each("v", "v+0.5*dt*acc", "half kick")
    for name, rate in zip(fields, rates, strict=True):
        p.each(name, f"{name}+0.5*dt*{rate}", "second half")
    kick_after(p)
    p.acceleration_is_kept(left)
    return p


def _recompute(p: Program, fields: list[str], rates: list[str]) -> None:
    """Add the evaluation of accelerations and rates at the present positions, with the noise of the last half kick."""
    options = p.options
    if fields:
        p.read_at_rest()
    if options.execution.pushes:
        p.phase(Phase.CONSERVE)
    p.each("acc", f"{p.kicking}/m", "conservative acceleration")
    if options.thermostat:
        # the two half kicks of a step share the noise; new noise would halve its variance
        p.show_by(options.trial_time)
        _add_friction_and_noise(p, "v", rates)
    p.leave_to_body_forces()


def _advance_fields(p: Program, fields: list[str], rates: list[str]) -> list[str]:
    """Add the first half step of the fields; returns the names of the variables that the pair terms will see."""
    lam = p.options.field_lam
    seen = [f"seen{k}" for k in range(len(fields))] if lam != 0.5 else fields
    for name, rate, shown in zip(fields, rates, seen, strict=True):
        if lam != 0.5:
            p.declare_per_dof(shown, "predicted field")
            p.each(shown, f"{name}+{lam!r}*dt*{rate}", "what the pair terms will see")
        p.each(name, f"{name}+0.5*dt*{rate}", "first half")
    return seen


def _take_rates(p: Program, rates: list[str]) -> None:
    for block, rate in enumerate(rates):
        p.phase(Phase.CHANGE, block)
        p.each(rate, p.field_change)


def _add_friction_and_noise(p: Program, velocity: str, rates: list[str] | tuple = ()) -> None:
    """Add friction and noise at the kept positions to acc."""
    p.keep_positions()
    p.show(velocity)
    p.phase(Phase.FORCE_KEPT)
    p.each("acc", f"acc+{p.pair_force}/m", "friction and noise")
    _take_rates(p, list(rates))
    p.each("x", "xs", "back")
