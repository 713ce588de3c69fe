"""The PythonForce between OpenMM and the pair kernel."""

import logging
import threading

import numpy as np
import openmm

from ...base import names
from ...base.errors import RunError, bead_number, in_length, in_units
from ...base.names import Phase
from ...base.openmm_private import bare, vectors
from ...base.signals import CTRL_C
from ...kernels import motion
from ...kernels.engines import engine_kind
from ...kernels.layer import CONSERVATIVE, DISSIPATIVE, RANDOM, PairSpec
from ...kernels.moment import FASTEST, Moment, StepSpec
from ...kernels.shear import flow_at
from ..made import of_fields, origin, wrong_key
from ..program_options import ProgramOptions
from .thread_state import SHOWN_NOW, Fields, ThreadState

#: Phases that store the positions.
KEEPING = (Phase.STORE, Phase.FINGERPRINT, Phase.CONSERVE)
#: Phases that look at the kept positions.
AT_KEPT = (Phase.FORCE_KEPT, Phase.SWEEP_KEPT)
#: Why OpenMM cannot carry out a program.
ONE_BY_ONE = "in the pair kernel's whole steps alone, not in programs that OpenMM executes line by line"
#: Thermal energy, step size, seed and counter of the noise, values of the fields.
Conditions = tuple[float, float, int, int, np.ndarray | None]


class PairForceFunction:
    """The callable inside the PythonForce: state -> (energy, forces), as the phase in the context parameters says.

    It is complete and immutable once constructed, because OpenMM pickles it into the System.  What it stores between two calls of one step
    is private to the calling thread, so that several Contexts can step one System, and can always be computed again.

    Parameters
    ----------
    spec : PairSpec
        The pair terms.
    conservative : bool
        Whether this force computes the conservative terms too.
    periodic : bool
        Whether there is a periodic box.
    scale : float
        Changes of the per-bead fields are returned in units of this.
    balanced : bool
        Whether, for internal energies, the change of a bead's kinetic energy counts in (the program takes it off again).
    length_checked : sequence of Bonds
        Bonds whose lengths are checked once in every step: a bond that is too long would make the positions NaN.
    steps : StepSpec or None
        A whole step, if this force can do it.
    engine : str
        Name of the engine (:mod:`openmm_dpd.kernels.engines`).
    """

    def __init__(
        self,
        spec: PairSpec,
        conservative: bool,
        periodic: bool,
        scale: float = 1.0,
        balanced: bool = False,
        length_checked: tuple = (),
        steps: StepSpec | None = None,
        engine: str = "host",
    ):
        self.spec, self.conservative, self.periodic = spec, conservative, periodic
        self.scale, self.balanced, self.length_checked, self.steps = scale, balanced, length_checked, steps
        self.engine = engine
        tables = spec.terms or [extra for extra in spec.extras if hasattr(extra, "cutoff")]  # beside a guide there may be overlays alone
        self._cutoff = max((float(np.max(table.cutoff)) for table in tables), default=1.0)
        fixed = [(getattr(term, "gamma", 0.0), getattr(term, "sigma", 0.0)) for term in spec.terms]
        self._by_sigma = any(np.any(np.isnan(gamma) & (sigma > 0)) for gamma, sigma in fixed)
        self._zero = np.zeros((len(spec.types), 3))
        self._local = threading.local()

    def __reduce__(self):
        known = self.spec, self.conservative, self.periodic, self.scale, self.balanced, self.length_checked, self.steps, self.engine
        return type(self), known

    def __deepcopy__(self, memo) -> "PairForceFunction":
        return self  # it is immutable

    @property
    def hidden(self) -> str:
        """What forces depend on that OpenMM does not hand to them."""
        fields = self.spec.fields
        carried = "" if fields is None or not fields.acts else "the beads' temperatures or concentrations"
        return "bonds that form and break" if self.spec.sorts else carried

    def thread_state(self) -> ThreadState:
        """What the calling thread keeps."""
        found = getattr(self._local, "state", None)
        if found is None:
            kind = engine_kind(self.engine)
            kind.warm_up(self.spec, logging.getLogger("openmm_dpd").warning)
            engine = kind.make(self.spec)
            loop = None if self.steps is None else kind.stepper(self.steps, engine, self._watch, NEAR * self._cutoff)
            found = self._local.state = ThreadState(engine, loop, None if self.spec.fields is None else Fields(self.spec.fields))
        return found

    def __call__(self, state):
        CTRL_C.check()
        parameters = state.getParameters()
        phase = int(parameters[names.PHASE])
        if phase == Phase.IDLE and not self.conservative:
            return 0.0, self._zero
        own = self.thread_state()
        here = (phase, parameters[names.COUNTER])
        if phase != Phase.IDLE and here == own.failed:
            # a step failed and its phase is still set: a call from outside gets what IDLE gives, but a new step may begin so too
            phase = phase if phase in KEEPING else int(Phase.IDLE)
        elif phase != Phase.IDLE:
            own.failed = None
        try:
            return self._evaluate(own, phase, state, parameters)
        except BaseException as error:
            own.failed = here
            if isinstance(error, RunError) and phase != Phase.IDLE:
                raise RunError(f"step {state.getStepCount() + 1}: {error}") from error
            raise

    def _evaluate(self, own: ThreadState, phase: int, state, parameters: dict):
        """Energy and forces for a phase."""
        if phase != Phase.IDLE and (self.spec.sheared or self.spec.bodies is not None or self.spec.sorts):
            what = "bonds form and break" if self.spec.sorts else "Lees-Edwards shear is" if self.spec.sheared else "rigid bodies are"
            raise RunError(f"{what} {ONE_BY_ONE}: step the integrator that build() made, by a Simulation or its own step()")
        if phase != Phase.IDLE and names.WRITTEN in parameters and parameters[names.WRITTEN]:
            what = "immobile beads have other temperatures or concentrations than at the start (write_fields), which act"
            raise RunError(f"{what} {ONE_BY_ONE}: step the integrator that build() made, by a Simulation or its own step()")
        x = self.positions(state)
        box = self.box(state)
        self.take_over(own, parameters)
        if phase != Phase.IDLE and self.steps is not None and self.steps.driven is not None:
            raise RunError(
                "walls that move or have a shape or something behind them need the integrator that build() returned, by itself: its "
                "program, which OpenMM carries out if it was read from XML or is part of a CompoundIntegrator, does not know them"
            )
        if phase in KEEPING:
            for bonds in self.length_checked:
                wrong = bonds.overstretched(x, box)
                if wrong is not None:
                    raise RunError(f"{wrong}; the step size may be too large")
            own.kept = x
        if phase in (Phase.FINGERPRINT, Phase.STORE) and own.failed is None:
            return (own.fingerprints.of(x, box, parameters) if phase == Phase.FINGERPRINT else 0.0), self._zero
        if phase == Phase.IDLE and not self.conservative:
            return 0.0, self._zero
        if phase == Phase.IDLE or phase in KEEPING:
            if not self.conservative:
                return 0.0, self._zero
            if phase == Phase.IDLE and self.hidden:
                self._show(own, parameters[names.SHOWN])
            own.engine.prepare(x, box)
            return own.conservative.now(own.fields)
        return 0.0, self._in_step(own, phase, x, box, parameters)

    def _in_step(self, own: ThreadState, phase: int, x: np.ndarray, box: np.ndarray | None, parameters: dict) -> np.ndarray:
        kept, block = own.kept, phase % 100
        phase -= block if phase >= Phase.SWEEP_SEEN else 0
        if kept is None:
            raise RunError(f"phase {phase} of the pair force came before any positions were stored: no integrator of openmm_dpd does that")
        dt, fields = self.step_size(parameters), own.fields
        if phase == Phase.CHANGE:
            assert fields is not None
            return fields.changes(block) / self.scale
        if phase == Phase.READ:
            assert fields is not None
            fields.read(block, (x - kept) / parameters[names.TAU])
            return self._zero
        tau, kT = parameters[names.TAU], self.thermal_energy(parameters)
        key = self.noise(parameters)
        motion.seen_velocities(x, kept, tau, own.v)
        self._check(own.v, self.spec.inv_mass, kT, dt)
        own.engine.prepare(kept if phase in AT_KEPT else x, box)
        conditions = (kT, dt, *key, None if fields is None else fields.values)
        return self._sweep(own, block, conditions) if phase >= Phase.SWEEP_SEEN else self._force(own, phase, conditions)

    def _show(self, own: ThreadState, number: float) -> None:
        """Take over what forces in a Context depend on; RunError if nobody knows it."""
        shown = SHOWN_NOW.get(number)
        if shown is None:
            raise RunError(
                f"energies and forces depend on {self.hidden}, which only the integrator that build() returned, or a copy of it, hands to "
                "them, by itself: not OpenMM's own integrators, one that was read from XML, or a CompoundIntegrator"
            )
        if shown.values is not None and own.fields is not None:
            own.fields.values = shown.values.copy()
        if shown.bonds is not None:
            own.loop.show(shown.bonds)  # type: ignore[union-attr]  # they form and break in its steps

    def take_over(self, own: ThreadState, parameters) -> None:
        """Take the factor of body forces, and the rate of a shear, over from the Context."""
        if self.spec.sheared:
            assert self.steps is not None
            own.engine.set_flow(flow_at(self.steps.shear, parameters[names.SHEARED]))
        scale = parameters[names.BODY_FORCE] if names.BODY_FORCE in parameters else 1.0
        if scale != own.engine.body_scale:
            own.engine.number += 1  # first: what was computed before is not valid any more
            own.engine.body_scale = scale

    def step_size(self, parameters) -> float:
        """Step size of the integrator, ps; RunError unless it is > 0."""
        dt = parameters[names.DT]
        if not dt > 0.0:
            raise RunError(f"the step size must be > 0, but the integrator's is {in_units(dt, 'time')}")
        return dt

    def thermal_energy(self, parameters) -> float:
        """kT of the Context; RunError if it is none."""
        kT = parameters[names.KT]
        if not 0.0 <= kT < np.inf:
            raise RunError(f"the context parameter {names.KT} must be >= 0 and finite, but is {kT}")
        if kT == 0.0 and self._by_sigma:
            raise RunError(f"the context parameter {names.KT} is 0, where a given sigma asks for infinite friction; give gamma instead")
        return kT

    def noise(self, parameters) -> tuple[int, int]:
        """Seed and counter of the noise in the Context; RunError if one is no whole number >= 0."""
        wrong = wrong_key(parameters)
        if wrong is not None:
            raise RunError(wrong)
        return int(parameters[names.SEED]), int(parameters[names.COUNTER])

    def _watch(self, v: np.ndarray, inv_mass: np.ndarray, moment: Moment) -> None:
        self._check(v, inv_mass, moment.kT, moment.dt)

    def _check(self, v: np.ndarray, inv_mass: np.ndarray, kT: float, dt: float) -> None:
        """RunError if beads run away."""
        wrong = runaway(v, inv_mass, kT, dt, self._cutoff)
        if wrong is not None:
            raise RunError(f"{wrong}; the step size is too large for this scheme, or the start is too far from equilibrium")

    def _force(self, own: ThreadState, phase: int, conditions: Conditions) -> np.ndarray:
        """Force form at the prepared positions."""
        which = DISSIPATIVE | RANDOM
        if phase == Phase.FORCE_SEEN and self.conservative:
            which |= CONSERVATIVE
        force = own.engine.forces(which, own.v, *conditions, own.result)[1]
        if own.fields is not None:
            own.fields.last = own.engine.rates
        return force

    def _sweep(self, own: ThreadState, update: int, conditions: Conditions) -> np.ndarray:
        """Impulses/dt of a sweep at the prepared positions."""
        engine, v, dt = own.engine, own.v, conditions[1]
        change = engine.sweep(v, *conditions, own.result, update)
        if own.fields is not None:
            own.fields.last = engine.increments
            if self.balanced:
                own.fields.balance(v, change, self.spec.inv_mass)
        motion.as_force(change, self.spec.inv_mass, dt)
        return change

    def positions(self, state) -> np.ndarray:
        """Positions of a State, nm."""
        x = vectors(state, openmm.State.Positions)
        if len(x) != len(self.spec.types):
            raise RunError(f"the System has {len(x)} particles, but its DPD pair terms were made for {len(self.spec.types)}")
        return x

    def box(self, state) -> np.ndarray | None:
        """Box vectors of a State, nm, None if the scene has none; RunError if they are too short for the pair terms."""
        if not self.periodic:
            return None
        box = bare(state.getPeriodicBoxVectors(asNumpy=True))
        if self._cutoff > 0.5 * box.diagonal().min() * (1 + 1e-9):
            edges = " x ".join(map(in_length, box.diagonal()))
            raise RunError(f"the box has shrunk to {edges}, less than twice the cutoff of {in_length(self._cutoff)}")
        return box


def pair_force(function: PairForceFunction, *, options: ProgramOptions, integrator: openmm.Integrator) -> openmm.PythonForce:
    """PythonForce that evaluates the pair terms, with its context parameters (see :mod:`openmm_dpd.base.names`)."""
    parameters = {names.PHASE: float(Phase.IDLE), names.TAU: options.dt, names.DT: options.dt, names.KT: options.kT}
    parameters |= {names.COUNTER: 0.0, names.SEED: float(options.seed)} | origin(options, integrator) | of_fields(function.spec.fields)
    if any(extra.term == "external" for extra in function.spec.extras):
        parameters[names.BODY_FORCE] = 1.0
    if function.steps is not None and function.steps.driven is not None:
        parameters |= dict.fromkeys(function.steps.driven.impulses.values(), 0.0)
    if function.spec.sheared:
        parameters[names.SHEARED] = 0.0
    if function.hidden:
        parameters[names.SHOWN] = 0.0
    force = openmm.PythonForce(function, parameters)
    force.setName(names.PAIR_FORCE)
    force.setForceGroup(options.pair_group)
    # true exactly when the scene is periodic: only then are the positions handed over meaningful on GPU platforms
    force.setUsesPeriodicBoundaryConditions(function.periodic)
    return force


# -- beads that run away ---------------------------------------------------------------------------------------------------------
# The soft repulsion of DPD is bounded, so a scheme that has become unstable never makes a NaN: the beads heat up without limit and the run
# goes on as an ideal gas.  What gives it away are beads that cross more than a cutoff in one step.
#: Nobody runs away whose velocity has no component with which it crosses more of a cutoff in a step.
NEAR = 0.5


def runaway(v: np.ndarray, inv_mass: np.ndarray, kT: float, dt: float, cutoff: float) -> str | None:
    """What is wrong with the velocities (N, 3) of a step, in a sentence, or None; beads of ``inv_mass`` 0 are not looked at.  Wrong is a
    velocity that is not finite, and a bead that is faster than ten thermal velocities *and* crosses more than the longest cutoff in one
    step.  Either alone may be meant: a quench from a hot start, or an ideal gas with a long step."""
    if motion.largest(v) * dt <= NEAR * cutoff:  # the usual case, in one pass; NaN falls through
        return None
    moving = inv_mass > 0
    square = np.where(moving, np.einsum("ij,ij->i", v, v), 0.0)
    if not np.all(np.isfinite(square)):
        return "a velocity is not finite"
    limit = np.maximum(cutoff / dt, FASTEST * np.sqrt(kT * inv_mass))
    ratio = np.where(moving, square / limit**2, 0.0)
    bead = int(np.argmax(ratio))
    if ratio[bead] <= 1.0:
        return None
    kinetic = float(np.mean(square[moving] / inv_mass[moving]) / 3.0)
    hot = "" if kT <= 0 else f"; the kinetic temperature is {kinetic / kT:.3g} times what it should be"
    moves = f"bead {bead_number(bead)} moves {in_length(square[bead] ** 0.5 * dt, 3)} in one step of {in_units(dt, 'time')}"
    return f"{moves}, more than the cutoff of {in_length(cutoff)}{hot}"
