"""A step that the pair force carries out by itself, where it holds all fast forces and positions are double precision.

The program shows it positions, velocities and whatever else a step begins with, each by a displacement, and takes over what it answers.
:class:`openmm_dpd.integrators.PairIntegrator` has many such steps done at once, without these lines, and then only lets barostats hear
of them (``ahead``); both give the same bits.  Forces that stay OpenMM's kick before and after.
"""

from __future__ import annotations

from ..names import ACCELERATION, PREDICTED, RATES, SHOWN, SLOW_STEP, VELOCITY, Phase
from ..program_options import ProgramOptions
from .program import Program


def program(options: ProgramOptions) -> Program:
    """Program for the options given."""
    scheme = options.scheme
    p = Program(scheme.name, scheme.reference, options)
    p.begin()
    fields = p.fields()
    shown = [(k, name, options.field_shown) for k, name in enumerate(fields)]
    if options.predicting:
        rates = [f"rate{k}" for k in range(len(fields))]
        p.declare_per_dof("acc", "acceleration at x by all the pair force holds, friction and noise included")
        for name in rates:
            p.declare_per_dof(name, "change of the field per time, at x")
        p.note()
        shown += [(RATES + k, name, options.field_shown) for k, name in enumerate(rates)]
        shown.append((ACCELERATION, "acc", SHOWN))
    before, after = options.slow_kicks
    if options.slow_every > 1:
        p.declare(SLOW_STEP, 0.0, "steps done since forces that stay OpenMM's kicked")
    if options.slow_every > 1 or not before:
        p.keep()
    if before and options.predicting:
        p.declare_per_dof("v0", "velocities before that")
        p.each("v0", "v", "what friction depends on where the acceleration has to be computed")
    if options.slow_every > 1:
        p.when(f"{SLOW_STEP} < 1", "do they kick before this step?")
    if before:
        p.phase(Phase.KEEP)
        p.each("v", f"v+{before!r}*dt*f/m", "kick by forces that stay OpenMM's; the pair force keeps x")
    if options.slow_every > 1:
        p.end()
    p.next_temperature()
    if shown:
        p.keep_positions()
    for entry in shown:
        if entry[0] < RATES:
            _show(p, *entry)
    history = [entry for entry in shown if entry[0] >= RATES]
    if history:
        p.declare("last", -1.0, "fingerprint at which the acceleration is valid")
        p.when("here = last", "is the acceleration still valid? If not the pair force computes it")
        for entry in history:
            _show(p, *entry)
        p.end()
        if before:
            p.when("here != last" if options.lam == 0.5 or options.slow_every > 1 else "1 > 0", "do these velocities matter?")
            _show(p, PREDICTED, "v0", SHOWN)
            p.end()
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
        p.note()
        p.set("last", "here", "acc is valid for this")
    if options.slow_every > 1:
        p.set(SLOW_STEP, f"{SLOW_STEP}+1")
        p.when(f"{SLOW_STEP} > {options.slow_every - 1}", "do they kick after this step?")
        p.set(SLOW_STEP, "0")
    if after:
        p.phase(Phase.KEEP)
        p.each("v", f"v+{after!r}*dt*f/m", "kick by forces that stay OpenMM's")
    if options.slow_every > 1:
        p.end()
    p.phase(Phase.IDLE)
    return p


def _show(p: Program, block: int, name: str, scale: float) -> None:
    p.set("dpd_tau", repr(scale), "scale of the displacement")
    p.each("x", f"xs+{scale!r}*{name}", "shows these values")
    p.hear(Phase.READ, "the pair force reads them", block)
