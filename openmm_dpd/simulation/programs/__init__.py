"""Integrator programs of schemes (:mod:`openmm_dpd.model.schemes`)."""

from ...base.errors import PlanError
from ...model.schemes import SCHEMES
from ...plan.program_options import ProgramOptions
from . import device, mvv, splitting
from .program import Program


def make_program(options: ProgramOptions) -> Program:
    """Checked program of a scheme; PlanError if it cannot run with constraints or virtual sites of the System."""
    scheme = options.scheme
    if options.constraints and not scheme.constraints:
        able = " or ".join(repr(name) for name, known in SCHEMES.items() if known.constraints)
        raise PlanError(
            f"the scheme {scheme.name!r} evaluates forces within the step, at positions where constraints and virtual sites do not hold; "
            f"use scheme={able} for this System"
        )
    if options.execution.on_device:
        program = device.device_program(options)
    else:
        program = mvv.mvv_program(options) if options.predicting else splitting.splitting_program(options)
    program.finish()
    program.check()
    return program
