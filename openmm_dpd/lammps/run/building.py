"""From the request of a run to its System, integrator and barostat; minimizations."""

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
from openmm import unit

from ...base.errors import ParameterError, read_by
from ...model.scene import Scene
from ...model.schemes import scheme_of
from ...plan.kinds import kind_for
from ...simulation.barostat import EnthalpyBarostat, add_barostat
from ...simulation.build import BuiltSystem, build
from ..language.lexer import errors_at
from ..state.deck_state import DeckState
from ..state.records import FORCE_FIXES, StoppingRule
from ..values.resolver import Resolver
from .options import RunOptions
from .request import RunRequest
from .sampling import Sampler, arrays


def build_request(request: RunRequest, scene: Scene, options: RunOptions) -> BuiltSystem:
    """Build the scene of a run.  What cannot be built is a DeckError at the run command."""
    for kind in (kind_for(table.kind) for table in scene.tables if table.kind is not None):
        if scene.compat == "consistent" and kind.unlike_lammps is not None:
            request.state.note(kind.unlike_lammps)
    _note_reduced(request.state)
    if scene.interacting is not None and not scheme_of(request.scheme).predicts:
        raise request.state.fixes_of("setforce")[0].error(
            f"it removes all forces on mobile beads, friction included, but scheme {request.scheme} does not apply friction as a force; "
            "use the deck's own scheme, mvv"
        )
    with errors_at(request.where), read_by(request.state):
        return build(
            scene,
            dt=request.dt,
            scheme=request.scheme,
            lam=request.lambda_ if scheme_of(request.scheme).predicts else 0.5,
            conservative=options.conservative,
            engine=options.engine,
            platform=options.platform,
            seed=options.seed if options.seed is not None else request.seed,
        )


def _note_reduced(state: DeckState) -> None:
    """Add a note if numbers look like reduced units although the units have dimensions: too cold, or denser than atoms."""
    at, given = state.pair.where, [style.settings for style in state.pair.styles if "start" in style.settings]
    cold = 0 < sum(settings["start"] + settings["stop"] for settings in given) < 20 * len(given)
    if state.units.mvv2e != 1 and at is not None and (cold or len(state.atoms) > state.require_box("run").volume):
        found = "the temperature is below 10 K, or there is more than one bead per cubic Angstrom, as in reduced units (units lj)"
        state.note(f"{at.file}:{at.number}: {found}; the deck has units {state.units.name}")


#: Steps between two volume moves.
VOLUME_INTERVAL = 10


def connect_barostat(request: RunRequest, built: BuiltSystem) -> EnthalpyBarostat | None:
    """Set up the barostat of ``request.barostat``: OpenMM's is added to ``built.system`` before there is a Context; this package's is
    returned. DeckError if the pressure is not constant or differs between axes."""
    control = request.barostat
    if control is None:
        return None
    pressures = {p for p, used in zip(control.start, control.axes, strict=True) if used}
    with errors_at(request.where):
        if not control.constant or len(pressures) > 1:
            raise ParameterError("fix nph: volume moves need a constant pressure that is the same along all axes")
        choices: dict[str, Any] = {"interval": VOLUME_INTERVAL, "axes": control.axes, "coupled": control.coupled}
        if control.isothermal:
            add_barostat(built, pressures.pop(), **choices)
            return None
        return EnthalpyBarostat(built, pressures.pop(), **choices)


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


def check_minimization(request: RunRequest) -> None:
    """DeckError if the deck has forces without a potential energy."""
    state = request.state
    with errors_at(request.where):
        for style in state.pair.styles:
            if style.name in _NO_ENERGY:
                raise ParameterError(f"minimize with pair style {style.name} is not supported: {_NO_ENERGY[style.name]}")
        for fix in state.fixes_of(*set(FORCE_FIXES) - {"setforce"}):
            raise ParameterError(f"minimize with fix {fix.style} ({fix.name}) is not supported: the energy of its force is not counted")


def carry_out_minimization(request: RunRequest, rule: StoppingRule, options: RunOptions, log: Callable[[str], None]) -> None:
    """Minimise the potential energy of a deck, with a row of thermo output at the start and at the end.  DeckError if the deck has forces
    without a potential energy."""
    check_minimization(request)
    state = request.state
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
