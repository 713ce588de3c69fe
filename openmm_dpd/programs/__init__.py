"""Integrator programs.  To add a scheme: one file here with a function options -> Program, one entry in PROGRAMS and in plan.SCHEMES."""

from __future__ import annotations

from ..errors import PlanError
from ..plan import ProgramOptions
from . import aboba, bababo, middle, mvv, shardlow
from .program import Program

#: Scheme -> function that writes its program.
PROGRAMS = {
    "mvv": mvv.program,
    "shardlow": shardlow.program,
    "middle": middle.program,
    "aboba": aboba.program,
    "bababo": bababo.program,
}

#: Schemes that keep constraints and virtual sites right: the others evaluate forces at positions that are not constrained yet.
CONSTRAINED = ("middle",)


def make_program(options: ProgramOptions) -> Program:
    """The program of a scheme, checked."""
    if options.constraints and options.scheme not in CONSTRAINED:
        raise PlanError(
            f"the scheme {options.scheme!r} evaluates forces within the step, at positions where constraints and virtual sites "
            "do not hold; "
            f"use scheme={' or '.join(map(repr, CONSTRAINED))} for this System"
        )
    program = PROGRAMS[options.scheme](options)
    program.check()
    return program


__all__ = ["CONSTRAINED", "PROGRAMS", "Program", "make_program"]
