"""From the request of a run to its System, integrator and barostat; minimizations."""

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import openmm

from ...base.errors import ParameterError, read_by
from ...measure.present import Present
from ...model.scene import Scene
from ...model.schemes import scheme_of
from ...plan.kinds import kind_for
from ...plan.pair_spec import longest as plan_longest
from ...simulation.barostat import EnthalpyBarostat, add_barostat
from ...simulation.build import BuiltSystem, build
from ...simulation.built import FARTHEST
from ...simulation.downhill import follow
from ..language.lexer import errors_at
from ..state.deck_state import DeckState
from ..state.records import GUIDED, DeckSample, StoppingRule
from ..state.rigid import RIGID
from ..values.resolver import Resolver
from .acting import FORCES, acted_on
from .guide import DeckGuide
from .options import RunOptions
from .request import RunRequest
from .sampling import Sampler, arrays


def build_request(request: RunRequest, scene: Scene, options: RunOptions) -> BuiltSystem:
    """Build the scene of a run.  What cannot be built is a DeckError at the run command."""
    for kind in (kind_for(table.kind) for table in scene.tables if table.kind is not None):
        if scene.compat == "consistent" and kind.unlike_lammps is not None:
            request.state.note(kind.unlike_lammps)
    _note_reduced(request.state)
    guide, predicts = None if request.minimization else DeckGuide.of(request), scheme_of(request.scheme).predicts
    state, acts = request.state, guide is not None
    within = [*state.fixes_of(*("setforce",) * (scene.interacting is not None), *GUIDED * acts), *state.pistons * acts]
    for fix in [] if predicts else within:
        raise fix.error(
            f"it acts on the sum of all forces, friction included, but scheme {request.scheme} does not apply friction as a force; "
            "use the deck's own scheme, mvv"
        )
    with errors_at(request.where), read_by(request.state):
        built = build(
            scene,
            dt=request.dt,
            scheme=request.scheme,
            lam=request.lambda_ if predicts else 0.5,
            conservative=options.conservative,
            engine=options.engine,
            platform=options.platform,
            seed=options.seed if options.seed is not None else request.seed,
            guide=guide,
        )
    if guide is not None:
        guide.built = built
    return built


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
    if control is None or request.state.pistons:
        return None
    pressures = {p for p, used in zip(control.start, control.axes, strict=True) if used}
    with errors_at(request.where):
        if not control.constant or len(pressures) > 1:
            raise ParameterError("fix nph or npt: volume moves need a constant pressure that is the same along all axes")
        if control.plane and not control.isothermal:
            raise ParameterError("couple xy needs a thermostat")
        choices: dict[str, Any] = {"axes": control.axes, "coupled": control.coupled}
        if control.plane:
            choices = {"surface_tension": 0.0, "zmode": "free" if control.axes[2] else "fixed"}
        if not control.isothermal:
            return EnthalpyBarostat(built, pressures.pop(), interval=VOLUME_INTERVAL, **choices)
        add_barostat(built, pressures.pop(), interval=VOLUME_INTERVAL, **choices)
        return None


#: Pair styles whose forces derive from no potential energy, or not from one that OpenMM knows.
_NO_ENERGY = ("edpd", "mdpd")
#: Fixes that act as forces in a minimisation: all but friction and noise.
_PUSHING = tuple(style for style in FORCES if style not in ("viscous", "langevin"))


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


class _Pushed:
    """Energy and forces in a minimisation, as the deck's fixes have changed them."""

    def __init__(self, request: RunRequest, built: BuiltSystem, context: openmm.Context):
        self._request, self._plan, self._context, self._present, self.energy = request, built.plan, context, Present(built), 0.0

    def forces(self, x: np.ndarray | None = None) -> np.ndarray:
        """Forces (N, 3) at positions x, or the present ones, 0 on beads that are held; not finite where a bond is too long."""
        present, request, units = self._present, self._request, self._request.state.units
        if x is not None:
            self._context.setPositions(x)
        present.look(self._context)
        if any(group.overstretched(present.x, present.box) for group in self._plan.scene.bonds):
            return np.full_like(present.x, np.nan)
        found = present.conservative()
        now = DeckSample(request.first_step, positions=present.x, velocities=present.v, box=present.box)
        moment = Resolver(request.state, now, request.window)
        force, values = acted_on(moment, found.force / units.force, _PUSHING)
        counted = (fix.name for fix in request.state.fixes.values() if fix.parameters.get("counted") and fix.name in values)
        self.energy = found.potential + sum(values[name][0] for name in counted) * units.energy
        return np.where(request.mobile[:, None], force * units.force, 0.0)

    def follow(self, watch: _Watch) -> None:
        """Move the beads along their forces until the watch says so."""
        longest, start = FARTHEST * plan_longest((*self._plan.layers, *self._plan.overlays)) or 1.0, np.array(self._present.x)
        end = follow(self.forces, start, longest, lambda _, force: watch.report(0, None, -force, {"system energy": self.energy}))
        self._context.setPositions(end)


def carry_out_minimization(request: RunRequest, rule: StoppingRule, options: RunOptions, log: Callable[[str], None]) -> None:
    """Minimise the potential energy of a deck, with a row of thermo output at the start and at the end; where forces derive from no energy
    that OpenMM knows, follow these forces."""
    state = request.state
    for fix in state.fixes_of(*RIGID):
        raise fix.error("a minimisation would move beads of its bodies one by one; give the fix after it")
    for dump in request.dumps:
        dump.begin(state)
    # box and velocities do not change; forces of fixes are added where they are needed
    built = build_request(request, replace(request.scene(), shear=None, body_forces=(), interacting=None), options)
    simulation = built.simulation(properties=options.properties(built.plan.platform or ""))
    context, mobile = simulation.context, request.mobile
    first = _row(request, Sampler(request, built, context), log, title=True)
    why = next((f"pair style {style.name}" for style in state.pair.styles if style.name in _NO_ENERGY), None)
    why = why or next((f"fix {fix.style}" for fix in state.fixes_of(*_PUSHING) if state.group(fix.group)[mobile].any()), None)
    pushed = _Pushed(request, built, context)
    force = pushed.forces()[mobile]
    watch = _Watch(rule, pushed.energy / state.units.energy, state.units, mobile)
    if not rule.iterations:
        watch.reason = "max iterations"
    elif not force.any():
        watch.iterations, watch.reason = 1, "forces are zero"  # LAMMPS counts the iteration that detects this
    elif why is not None:
        state.note(f"minimize beside {why}: beads follow their forces (FIRE), whatever the min_style is; there is no energy to go down")
        pushed.follow(watch)
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
