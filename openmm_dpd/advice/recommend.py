"""Recommended scheme and step size, from measured tables (:mod:`openmm_dpd.advice.stability_table`); no scene or run is changed.

Steps are ``AIM`` times those of the tables, so that the promised error is kept in 95 % of all measurements.
"""

from dataclasses import dataclass

import numpy as np

from ..base.errors import DPDError, ParameterError, in_number, in_units, require, require_one, unit_name, what_is
from ..base.units import checked, to_md
from ..model.scene import Scene
from ..model.schemes import SCHEMES, scheme_of
from ..plan.plan import make_plan
from ..simulation.mixed_system import MixedSystem
from .bonded_modes import Modes, bonded_modes, why_no_step
from .scene_groups import charge_frequency, conserves, fastest_exchange, groups, is_many_body, smallest_capacity, steps_table, surroundings
from .stability_table import LEVELS, MEASURED, SAFE, Groups, MeasuredStep, StabilityTable, shipped_table, shipped_transport

#: Smallest error that may be asked for; smaller ones cannot be measured.
SMALLEST = 1e-4
#: Quantities to bound: both temperatures, positions only, or both temperatures and a transport coefficient.
QUANTITIES = ("temperature", "structure", *MEASURED)
#: Error of diffusion and viscosity above which there is a note if only temperatures were asked for.
_MOTION = 0.03
#: Recommended step over the one at which a table predicts the error: tables are known to a tenth or two, and are interpolated.  With it,
#: 95 % of the errors measured in random scenes were below what was asked for (benchmarks/recommended_steps.py --random).
AIM = 0.87
#: Error from which on the dips of configurational temperatures do not count; in mixtures only that of the species with the softest
#: surroundings does: steps beyond those of others were right.
_DIP = 0.02
#: kappa times the step up to which decays of concentrations are right: with rates, and with pair updates to 1 and to 2 %
#: (docs/measure/heat_steps.py --fast).
_EXCHANGED = (0.8, 2.5, 4.5)
#: Errors at which :func:`advice` compares schemes.
_COMPARED = (0.003, 0.05)


@dataclass(frozen=True)
class Choice:
    """Step and cost of one scheme.

    Attributes
    ----------
    scheme : str
    dt, dt_error : float
        Step size at which the error is reached, ps, and its standard error from the measurement (0 if it is calculated).
    relative_cost : float
        Computing time for the same simulated time and error, relative to ``mvv``, or to the first scheme that has a step.
    limit : str
        Limit of the step: "configurational temperature", "kinetic temperature", "diffusion", "viscosity", "stability", "energy",
        "bonds", "angles", "dihedrals", "charges" or "exchange".
    """

    scheme: str
    dt: float
    dt_error: float
    relative_cost: float
    limit: str

    def __str__(self) -> str:
        known = f" ± {in_number(self.dt_error, 'time', 1)}" if self.dt_error else ""
        return f"{in_number(self.dt, 'time', 2)}{known} {unit_name('time')}".rstrip()


@dataclass(frozen=True)
class Recommendation:
    """The scheme with the lowest cost, and all others.

    Attributes
    ----------
    scheme : str or None
        Recommended scheme; None if the table does not cover the scene (``notes`` have the reason).
    dt : float or None
        Step size, ps.
    relative_cost : float or None
        Computing time for the same simulated time and error, relative to ``mvv``.
    error : float
        Requested relative error, which 95 % of all measurements keep.
    quantity : str
        Quantity with this error.
    choices : tuple of Choice
        All schemes, in the order of their cost.
    notes : tuple of str
        What is outside of the table, or not covered by it.
    duration : float or None
        Length of the run, ps, over which the energy has this error, too; None if that does not limit the step.
    """

    scheme: str | None
    dt: float | None
    relative_cost: float | None
    error: float
    quantity: str = "temperature"
    choices: tuple[Choice, ...] = ()
    notes: tuple[str, ...] = ()
    duration: float | None = None

    def __str__(self) -> str:
        lines = [f"note: {note}" for note in self.notes]
        if self.scheme is None or self.dt is None:
            return "\n".join(["no recommendation", *lines])
        what = {"temperature": "temperatures", "structure": "structure"}.get(self.quantity, f"temperatures and {self.quantity}")
        if self.duration is not None:
            what += f", and the energy over {in_units(self.duration, 'time')},"
        head = f"for {what} within {100 * self.error:g} % (95 of 100 times): {self.scheme} at dt = {in_units(self.dt, 'time', 2)}"
        other = "mvv" if any(one.scheme == "mvv" for one in self.choices) else self.scheme
        table = [
            f"  {one.scheme:10s} dt {one}, {one.relative_cost:.2f} times the time of {other}, set by {one.limit}" for one in self.choices
        ]
        return "\n".join([head, *table, *lines])


def recommend(
    scene: Scene, error: float = 0.01, *, quantity: str = "temperature", duration: float | None = None, table: StabilityTable | None = None
) -> Recommendation:
    """Recommend a scheme and step size for a given error, which 95 % of all measurements keep.

    Parameters
    ----------
    scene : Scene
    error : float, default 0.01
        Accepted relative error, from 0.0001 to 0.1.
    quantity : {"temperature", "structure", "diffusion", "viscosity"}
        Quantity with this error: kinetic and configurational temperature; only the latter, if velocities are not used; or both, and the
        diffusion coefficient or viscosity of a fluid with this friction (measured at density 3 and repulsion 25; steps go with their
        product to the power -1/2 above it, which was checked at twice to 2.4 times as much).
    duration : time, optional
        Length of the run.  In scenes that conserve their energy (EnergyDPD, EDPD, or no friction) the total energy drifts by at most
        ``error`` of the heat in the beads, (C + 3/2 k_B) T, over this time; without it, a note says how fast it drifts.  Ignored where
        friction and noise are a thermostat.
    table : StabilityTable, optional
        Table of steps; by default the one that comes with the package.

    Raises
    ------
    ParameterError
        If the error or the duration is out of bounds, the quantity unknown, or ``scene`` is not a Scene.

    Notes
    -----
    The step is 0.87 of the one at which the table predicts the error: 95 % of the errors measured in random scenes were below what was
    asked for then (docs/schemes.md, "Choosing a step").

    The table covers soft repulsion, in a box; :func:`openmm_dpd.advice.scene_groups.groups` combines layers, and takes each species of a
    mixture with the mean friction and repulsion of its surroundings; diffusion and viscosity with its own mass.  Without friction,
    temperatures are those of the least friction that was measured.  Many-body liquids with the quadratic kernel have their own table
    (:func:`openmm_dpd.advice.scene_groups.many_body_groups`).  Bonds, angles and dihedrals limit the step by the errors of their
    vibrations under each scheme (:mod:`openmm_dpd.advice.bonded_modes`), charges by that of two opposite charges at the same point; the
    table of the drift of energy is without them.  There is no recommendation with walls, impropers, segmental repulsion,
    mixtures of many-body beads, other potentials between beads or attraction, or if the beads of a dihedral may become
    collinear; ``notes`` have the reason.  Species act on no force: beads have the steps of the fluid without them, as far as concentrations
    decay right.  The steps of ``native`` were measured on the CPU platform; on GPU platforms OpenMM's
    DPDIntegrator updates all pairs at once, and is too hot at shorter steps.  Beads beside atoms
    (:func:`openmm_dpd.create_mixed_system`) need the step of the atoms and are refused.
    """
    if isinstance(scene, MixedSystem):
        raise ParameterError(
            "atoms and beads in one System need the step and scheme of the atoms (docs/howto/mixed.md), not one of the table"
        )
    require(scene, Scene, "expected a Scene")
    require(table, StabilityTable | None, "table must be a StabilityTable")
    error = to_md(error, "dimensionless", "error")
    if not isinstance(error, float) or not SMALLEST <= error <= LEVELS[-1]:
        raise ParameterError(
            f"error must be a fraction of the temperature from {SMALLEST:g} to {LEVELS[-1]:g} (0.01 is 1 %), not {what_is(error)}"
        )
    require_one(quantity, QUANTITIES, "the quantity")
    duration = None if duration is None else checked(duration, "time", "duration", positive=True)
    table = table or steps_table(scene)
    pairs, notes = groups(scene)
    outside = list(dict.fromkeys(text for at in pairs for text in table.outside(at)))
    unbound = why_no_step(scene)
    motion = shipped_transport() if quantity in MEASURED else None
    if motion and not all(motion.covers(at.moving) for at in pairs):
        outside.append(f"{quantity} was measured only at frictions from {motion.frictions[0]:g} to {motion.frictions[-1]:g}")
    if motion and is_many_body(scene):
        why = "halve the step until it stays the same (benchmarks/transport.py measures it in soft fluids)"
        outside.append(f"{quantity} was not measured in many-body liquids: {why}")
    drift = shipped_table("drift") if pairs and conserves(scene, pairs) else None
    duration = duration if drift is not None else None
    bound_or_charged = drift is not None and bool(scene.bonded or charge_frequency(scene))
    alone = (
        "the total energy grows; how fast was tabulated without bonds and charges only (benchmarks/conservation.py --bonded measures some)"
    )
    if duration is not None and bound_or_charged:
        outside.append(alone)
    if not pairs or outside or unbound:
        return Recommendation(None, None, None, error, quantity, notes=(*notes, *outside, *([unbound] if unbound else [])))
    able = [scheme for scheme in (motion.schemes if motion else table.schemes) if scheme in table.schemes and _runs(scene, scheme)]
    modes, heat = _modes(scene, pairs), 1.5 + (smallest_capacity(scene) or 0.0)
    steps = {scheme: _step(table, scheme, modes, pairs, error, quantity) for scheme in able}
    if drift is not None and duration is not None:
        bound = error * heat / duration
        steps = {scheme: min(step, _drift_step(drift, scheme, pairs, bound)) for scheme, step in steps.items() if scheme in drift.schemes}
    if rate := fastest_exchange(scene):
        most = [(MeasuredStep(most / rate, 0.0), "exchange") for most in _EXCHANGED]
        steps = {scheme: min(step, most[0 if scheme == "mvv" else 1 + (error >= 0.02)]) for scheme, step in steps.items()}
    costs = {scheme: table.cost[scheme] / step.dt for scheme, (step, _) in steps.items()}
    usual = costs.get("mvv", min(costs.values()))
    choices = [Choice(s, steps[s][0].dt, steps[s][0].error, costs[s] / usual, steps[s][1]) for s in sorted(costs, key=lambda s: costs[s])]
    best = choices[0]
    if quantity == "temperature" and not is_many_body(scene):
        notes += _motion_notes(best, pairs)
    if bound_or_charged:
        notes.append(alone)
    elif drift is not None and duration is None and best.scheme in drift.schemes:
        off = max(drift.error(best.scheme, at, best.dt / at.unit_time, "drift") / at.unit_time for at in pairs) / heat
        size = f"{100 * off:.1g} %" if np.isfinite(off) else f"more than {10 / heat / pairs[0].unit_time:.1g} %"
        notes.append(f"the total energy grows by some {size} per {unit_name('time') or 'unit of time'}; duration= bounds that over a run")
    return Recommendation(best.scheme, best.dt, best.relative_cost, error, quantity, tuple(choices), tuple(notes), duration)


def _drift_step(drift: StabilityTable, scheme: str, pairs: list[Groups], bound: float) -> tuple[MeasuredStep, str]:
    """Step at which the energy drifts by a bound, kT per bead and ps, in the worst of the fluids."""
    steps = [(at, AIM * at.unit_time * drift.step(scheme, at, bound * at.unit_time, "drift")) for at in pairs]
    at, dt = min(steps, key=lambda one: one[1])
    return MeasuredStep(dt, dt * drift.spread(scheme, at, bound * at.unit_time, "drift")), "energy"


def _motion_notes(choice: Choice, pairs: list[Groups]) -> list[str]:
    """Notes about errors of diffusion and viscosity at a step that is right for temperatures."""
    motion, found = shipped_transport(), []
    for quantity in MEASURED if choice.scheme in motion.schemes else ():
        errors = [
            motion.error(choice.scheme, at, choice.dt / at.unit_time, quantity) for at in (one.moving for one in pairs) if motion.covers(at)
        ]
        worst, beyond = max(errors, key=lambda one: abs(one[0]), default=(0.0, False))
        if abs(worst) > _MOTION:
            size = f"{'more than' if beyond else 'some'} {100 * worst:+.0f} %"
            found.append(f"{quantity} is {size} off at this step; recommend(..., quantity={quantity!r}) bounds that")
    return found


def _modes(scene: Scene, pairs: list[Groups]) -> list[Modes]:
    """Vibrations of bonded terms, and of two opposite charges at the same point."""
    around, frequency = surroundings(pairs), charge_frequency(scene)
    charges = [Modes("charges", np.array([frequency]), np.ones(1), frequency)] if frequency else []
    return [*bonded_modes(scene, around), *charges]


def _runs(scene: Scene, scheme: str) -> bool:
    """Whether a scheme of the table can run a scene; only ``native`` may not."""
    if not SCHEMES[scheme].native:
        return True
    try:
        make_plan(scene, dt=0.01, scheme=scheme, platform="CPU", seed=1)
    except DPDError:  # perhaps no scheme can run it, but the table may cover the fluid
        return False
    return True


def _step(
    table: StabilityTable, scheme: str, modes: list[Modes], pairs: list[Groups], error: float, quantity: str
) -> tuple[MeasuredStep, str]:
    """Smallest of all limits of the step, ps, with its standard error, and the name of this limit."""
    temperatures = {"conf": "configurational temperature"} | ({} if quantity == "structure" else {"kin": "kinetic temperature"})
    limits = []
    for at in pairs:
        unit = at.unit_time
        for kind, name in temperatures.items():
            dt = AIM * unit * table.step(scheme, at, error, kind)
            limits.append((MeasuredStep(dt, dt * table.spread(scheme, at, error, kind)), name))
        if quantity in MEASURED:
            dt, sem = shipped_transport().step(scheme, at.moving, error, quantity)
            limits.append((MeasuredStep(AIM * at.moving.unit_time * dt, AIM * at.moving.unit_time * sem), quantity))
        limits.append((MeasuredStep(unit * SAFE * table.blow(scheme, at), 0.0), "stability"))
        if scheme in table.dips and error < _DIP and at.a < 1.1 * min(one.a for one in pairs):
            dip = AIM * unit * table.dips[scheme] * min(1.0, error / LEVELS[0]) ** 0.25 / max(at.a * at.rho / 3.0, 1e-9) ** 0.5
            limits.append((MeasuredStep(dip, 0.03 * dip), temperatures["conf"]))
    word = scheme_of(scheme)
    limits += [(MeasuredStep(AIM * one.step(word, error, kinetic=quantity != "structure"), 0.0), one.what) for one in modes]
    return min(limits)


def predicted_error(scene: Scene, scheme: str, dt: float, *, table: StabilityTable | None = None) -> tuple[float, str] | None:
    """Signed relative error of the worst temperature at a step size (ps), and which one it is; infinite above 10 %, None outside of the
    table.  Bonds, angles and dihedrals are included (:mod:`openmm_dpd.advice.bonded_modes`)."""
    word = scheme_of(scheme)
    scheme, table = word.name, table or steps_table(scene)
    pairs, _ = groups(scene)
    if scheme not in table.schemes or not pairs or any(table.outside(at) for at in pairs) or why_no_step(scene):
        return None
    worst = (0.0, 1, "conf")
    for at in pairs:
        for kind in ("conf", "kin"):
            worst = max(worst, (table.error(scheme, at, dt / at.unit_time, kind), table.sign(scheme, at, kind), kind))
    for modes in _modes(scene, pairs):
        for off in modes.errors(word, np.array([dt])):
            size = abs(float(off[0]))
            worst = max(worst, (size if size <= LEVELS[-1] else np.inf, -1 if off[0] < 0 else 1, modes.what))
    names = {"conf": "configurational", "kin": "kinetic", "bonds": "bond", "angles": "angle", "dihedrals": "dihedral", "charges": "charge"}
    return worst[0] * (worst[1] or 1), names[worst[2]]


def advice(scene: Scene, scheme: str, dt: float, *, table: StabilityTable | None = None) -> str:
    """Advice from the table about a scheme and step size (ps), as a sentence, with what the table does not cover."""
    table = table or steps_table(scene)
    scheme = scheme_of(scheme).name
    found = predicted_error(scene, scheme, dt, table=table)
    if found is None:
        if not scheme_of(scheme).measured:
            return f"nothing was measured for the scheme {scheme!r}; benchmarks/orders.py measures what a word does to the temperatures"
        notes = recommend(scene, table=table).notes or (f"the table of steps has no scheme {scheme!r}",)
        return "no advice about the step: " + "; ".join(notes)
    return "; ".join([_sentence(scene, scheme, dt, table, found), *groups(scene)[1]])


def _sentence(scene: Scene, scheme: str, dt: float, table: StabilityTable, found: tuple[float, str]) -> str:
    """The predicted error ``found`` of a scheme at a step (ps) in words, compared with the best scheme for this error."""
    pairs, _ = groups(scene)
    blow = min(at.unit_time * table.blow(scheme, at) for at in pairs)
    size, kind = abs(found[0]), found[1]
    compared = float(np.clip(size, *_COMPARED)) if np.isfinite(size) else 0.01
    best = recommend(scene, compared, table=table)
    assert best.scheme is not None and best.dt is not None
    head = f"{scheme} at dt = {in_units(dt, 'time', 3)}: "
    other = f"{best.scheme} at {in_units(best.dt, 'time', 2)}"
    if dt > SAFE * blow:
        return head + f"unstable or close to it (it blows up near {in_units(blow, 'time', 2)}); {other} keeps within {100 * compared:.2g} %"
    if not np.isfinite(size):
        return head + f"more than {100 * LEVELS[-1]:g} % off ({kind} temperature); {other} keeps within {100 * compared:.2g} %"
    text = head + f"{100 * size:.1g} % {'hot' if found[0] > 0 else 'cold'} ({kind} temperature)"
    fraction = table.cost[best.scheme] / best.dt / (table.cost[scheme] / dt)
    if fraction > 0.9:
        return text + "; nothing here is faster by more than a tenth"
    same = "that" if np.isclose(compared, size) else f"{100 * compared:.2g} %"
    return text + f"; {other} keeps within {same} for {_part(fraction)} of the time"


def _part(fraction: float) -> str:
    """A fraction in words, if it is close to one that has a name."""
    names = {"three quarters": 0.75, "two thirds": 2 / 3, "half": 0.5, "a third": 1 / 3, "a quarter": 0.25, "a fifth": 0.2, "a tenth": 0.1}
    near = min(names, key=lambda name: abs(np.log(fraction / names[name])))
    return near if abs(fraction / names[near] - 1) < 0.1 else f"{100 * fraction:.0f} %"
