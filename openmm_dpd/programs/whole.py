"""Whole steps by the pair force, where it computes all fast forces and positions are double precision.

The program passes positions, velocities and stored values to the pair force, each as a displacement, and takes the results from it.
:class:`openmm_dpd.integrators.PairIntegrator` usually has many such steps done at once, without these lines.  Then the program only counts
them (``ahead``), so that barostats act.  Both ways give the same bits.  Forces that OpenMM computes kick before and after each step.
"""

from contextlib import nullcontext

from ..names import ACCELERATION, PREDICTED, RATES, SHOWN, SLOW_STEP, VELOCITY, Phase
from ..program_options import ProgramOptions
from .program import Program


def whole_step_program(options: ProgramOptions) -> Program:
    """Program for the options given."""
    p = Program(options.scheme.name, options.scheme.reference, options)
    p.begin()
    fields = p.fields()
    shown = [(k, name, repr(options.field_shown)) for k, name in enumerate(fields)]
    if options.predicting:
        rates = [f"rate{k}" for k in range(len(fields))]
        p.declare_per_dof("acc", "acceleration at x by all the pair force holds, friction and noise included")
        for name in rates:
            p.declare_per_dof(name, "change of the field per time, at x")
        p.store_fingerprint()
        shown += [(RATES + k, name, repr(options.field_shown)) for k, name in enumerate(rates)]
        shown.append((ACCELERATION, "acc", repr(SHOWN)))
    before, after = options.slow_kicks
    if options.slow_every > 1:
        p.declare(SLOW_STEP, 0.0, "steps done since OpenMM's forces kicked")
    if options.slow_every > 1 or not before:
        p.store()
    if before and options.predicting:
        p.declare_per_dof("v0", "velocities before that")
        p.each("v0", "v", "what friction depends on where the acceleration has to be computed")
    each_step = options.slow_every == 1
    with nullcontext() if each_step else p.when(f"{SLOW_STEP} < 1", "do they kick before this step?"):
        _slow_kick(p, before)
    p.next_temperature()
    if shown:
        p.keep_positions()
    for entry in shown[: len(fields)]:
        p.show_values(*entry)
    history = shown[len(fields) :]
    if history:
        p.declare("valid_for", -1.0, "fingerprint at which the acceleration is valid")
        with p.when("fingerprint = valid_for", "is the acceleration still valid? If not the pair force computes it"):
            for entry in history:
                p.show_values(*entry)
        if before:
            with (
                nullcontext()
                if options.lam != 0.5 and each_step
                else p.when("fingerprint != valid_for", "do the velocities before that kick matter?")
            ):
                p.show_values(PREDICTED, "v0", repr(SHOWN))
    p.show_by(repr(SHOWN))
    p.each("x", f"{'xs' if shown else 'x'}+dpd_tau*v", "trial drift: shows the velocities")
    p.phase(Phase.RUN)
    p.each("x", p.pair_force, "positions after the step")
    told = [(VELOCITY, "v"), *((block, name) for block, name, _ in shown)]
    if options.predicting and options.lam != 0.5:
        p.declare_per_dof("vp", "velocities that friction saw")
        told.append((PREDICTED, "vp"))
    for block, name in told:
        p.phase(Phase.TELL, block)
        p.each(name, p.pair_force)
    if options.noises:
        p.set("dpd_counter", f"dpd_counter+{options.noises}", "noise that was used")
    if history:
        p.store_fingerprint()
        p.set("valid_for", "fingerprint", "acc is valid for this")
    if each_step:
        _slow_kick(p, after)
    else:
        p.set(SLOW_STEP, f"{SLOW_STEP}+1")
        with p.when(f"{SLOW_STEP} > {options.slow_every - 1}", "do they kick after this step?"):
            p.set(SLOW_STEP, "0")
            _slow_kick(p, after)
    p.phase(Phase.IDLE)
    return p


def _slow_kick(p: Program, steps: float) -> None:
    if steps:
        p.phase(Phase.STORE)
        p.each("v", f"v+{steps!r}*dt*f/m", "kick by OpenMM's forces; the pair force stores x")
