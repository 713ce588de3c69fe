"""Carries out ``minimize``."""

from collections.abc import Callable
from dataclasses import replace

import numpy as np
from openmm import unit

from ...base.errors import ParameterError
from ..language.lexer import errors_at
from ..state.records import StoppingRule
from ..values.resolver import Resolver
from .building import build_request
from .options import RunOptions
from .request import RunRequest
from .sampling import Sampler, arrays

_KJ, _F = unit.kilojoule_per_mole, unit.kilojoule_per_mole / unit.nanometer

#: Pair styles whose forces have no potential energy that can be minimised, and why.
_NO_ENERGY = {
    "edpd": "its forces depend on the temperatures of the beads",
    "mdpd": "its density-dependent force has no potential",
}


class _Watch:
    """Stops the minimiser by LAMMPS's rule."""

    def __init__(self, rule: StoppingRule, energy: float, units, mobile: np.ndarray):
        self._rule, self._before, self._units, self._mobile = rule, energy, units, mobile
        self.iterations, self.reason = 0, "linesearch alpha is zero"

    def report(self, iteration, x, grad, args):
        self.iterations += 1
        energy = args["system energy"] / self._units.energy
        force = np.asarray(grad).reshape(-1, 3)[self._mobile] / self._units.force
        reason = self._rule.reached(self.iterations, self._before, energy, force)
        self._before = energy
        if reason is not None:
            self.reason = reason
        return reason is not None


def carry_out_minimization(request: RunRequest, rule: StoppingRule, options: RunOptions, log: Callable[[str], None]) -> None:
    """Minimise the potential energy of a deck, with a row of thermo output at the start and at the end.  DeckError if the deck has forces
    without a potential energy."""
    state = request.state
    with errors_at(request.where):
        for style in state.pair.styles:
            if style.name in _NO_ENERGY:
                raise ParameterError(f"minimize with pair style {style.name} is not supported: {_NO_ENERGY[style.name]}")
        for fix in state.fixes_of("addforce", "gravity"):
            raise ParameterError(f"minimize with fix {fix.style} ({fix.name}) is not supported: the energy of its force is not counted")
    for dump in request.dumps:
        dump.begin(state)
    # box and velocities do not change
    built = build_request(request, replace(request.scene(), shear=None), options)
    simulation = built.simulation(properties=options.properties(built.plan.platform or ""))
    context, mobile = simulation.context, request.mobile
    first = _row(request, Sampler(request, built, context), log, title=True)
    found = context.getState(energy=True, forces=True, groups=built.integrator.getIntegrationForceGroups())
    energy = found.getPotentialEnergy().value_in_unit(_KJ) / state.units.energy
    force = found.getForces(asNumpy=True).value_in_unit(_F)[mobile] / state.units.force
    watch = _Watch(rule, energy, state.units, mobile)
    if not rule.iterations:
        watch.reason = "max iterations"
    elif not force.any():
        watch.iterations, watch.reason = 1, "forces are zero"  # LAMMPS counts the iteration that detects this
    else:
        # stopped by the rule, or by the minimiser when it cannot lower the energy
        simulation.minimizeEnergy(1e-10, 0, watch)
        watch.iterations = max(watch.iterations, 1)
    done = replace(request, steps=watch.iterations)
    sampler = Sampler(done, built, context)
    last = _row(done, sampler, log)
    log(f"minimize: {watch.reason} after {watch.iterations} iterations; potential energy {first:.10g} before and {last:.10g} after")
    x, v, box = arrays(context)
    sample = sampler.sample(done.last_step, 0.0)
    sampler.measure(sample)
    time = state.time_at(request.first_step)
    done.finish(x, v, box=box, sample=sample.kept())
    # as in LAMMPS, a minimisation takes no simulated time
    state.time_origin = (time, done.last_step)


def _row(request: RunRequest, sampler: Sampler, log: Callable[[str], None], title: bool = False) -> float:
    """Log a row at the last step of a request, and return the potential energy as printed by thermo output."""
    thermo = request.thermo
    if title and thermo.header():
        log(thermo.header())
    step = request.last_step
    # as in LAMMPS, the final state is in every dump, whatever its interval
    dumps = [dump for dump in request.dumps if (dump.due(step) if title else dump.last_step != step)]
    sample = sampler.sample(step, 0.0)
    sampler.measure(sample)
    for dump in dumps:
        dump.write(Resolver(request.state, sample, request.window))
    values = thermo.values(sample, tuple(dict.fromkeys((*thermo.words, "pe"))))
    log(thermo.row(values, sample))
    if not title and thermo.footer():
        log(thermo.footer())
    return values["pe"]
