"""The PythonForce that stands between OpenMM and the pair kernel."""

import threading

import numpy as np
import openmm

from .. import names
from ..errors import RunError
from ..kernels import motion
from ..kernels.compiled import compiled, inlined
from ..kernels.engine import CONSERVATIVE, DISSIPATIVE, RANDOM, PairEngine, PairSpec, warm_up
from ..kernels.extras import warm_up_extras
from ..kernels.fields import ENERGY, TEMPERATURE, FieldSpec
from ..kernels.steps import Moment, StepLoop, StepSpec
from ..made import origin
from ..names import RATES, Phase
from ..program_options import ProgramOptions
from ..signals import CTRL_C
from ..wording import in_length, in_units
from .runaway import NEAR, runaway

#: Phases that store the positions.
KEEPING = (Phase.STORE, Phase.FINGERPRINT, Phase.CONSERVE)

#: Phases that look at the kept positions.
AT_KEPT = (Phase.FORCE_KEPT, Phase.SWEEP_KEPT)


@inlined
def _stir(total, bits):
    total = (total ^ bits) * np.uint64(0xBF58476D1CE4E5B9)
    return total ^ (total >> np.uint64(29))


@compiled
def fingerprint(x, parameters):
    """A number that depends on every bit of the positions and parameters, too small to matter where it is taken for an energy."""
    # four sums side by side: each multiplication waits for the one before it
    a, b, c, d = np.uint64(0x9E3779B97F4A7C15), np.uint64(1), np.uint64(2), np.uint64(3)
    for values in (x.ravel(), parameters):
        bits = values.view(np.uint64)
        whole = len(bits) - len(bits) % 4
        for k in range(0, whole, 4):
            a, b, c, d = _stir(a, bits[k]), _stir(b, bits[k + 1]), _stir(c, bits[k + 2]), _stir(d, bits[k + 3])
        for k in range(whole, len(bits)):
            a = _stir(a, bits[k])
    for other in (b, c, d):
        a = _stir(a, other)
    return np.float64(a >> np.uint64(11)) * 2.0**-960


def vectors(state: openmm.State, kind: int) -> np.ndarray:
    """(N, 3) positions or velocities of a State, in MD units, as an array that is the caller's.

    What OpenMM has for users, with units, takes longer than some steps' arithmetic.
    """
    found = np.empty((state._getNumParticles(), 3))
    state._getVectorAsNumpy(kind, found)
    return found


def only_folded(x: np.ndarray, before: np.ndarray, box: np.ndarray) -> bool:
    """Whether x differs from the positions before by box vectors only, to float32 rounding: GPU platforms wrap beads now and then."""
    if not motion.jumped(x, before, 0.5 * np.diag(box).min()):
        return False
    d = x - before
    for axis in (2, 1, 0):
        d -= np.round(d[:, axis] / box[axis, axis])[:, None] * box[axis]
    return bool(np.abs(d).max() < 4e-7 * (np.abs(before).max() + np.diag(box).max()))


class Fields:
    """Per-bead fields, as the pair force reads them and returns their changes: blocks of three values per bead.

    Programs skip immobile beads, so these have the values of the start, but in loops of steps.  Internal energies come as
    (conductive, mechanical, what rounding lost of the sum); everything else as one value after the other.
    """

    def __init__(self, spec: FieldSpec):
        self.spec = spec
        self.values = spec.initial.copy()
        self.last = np.zeros_like(self.values)
        self._low: np.ndarray | None = None

    def read(self, block: int, shown: np.ndarray, held: np.ndarray | None = None) -> None:
        """Take over the values of one block, (N, 3); ``held``: those of the immobile beads."""
        if self.spec.kind == ENERGY:
            shown = np.column_stack([shown[:, 0], shown[:, 1] + shown[:, 2]])
        columns = slice(3 * block, 3 * block + 3)
        part, still = self.values[:, columns], self.spec.immobile
        part[...] = shown[:, : part.shape[1]]
        part[still] = self.spec.initial[still, columns] if held is None else held[:, : part.shape[1]]

    def changes(self, block: int) -> np.ndarray:
        """(N, 3) changes of one block."""
        part = self.last[:, 3 * block : 3 * block + 3]
        result = np.zeros((len(part), 3))
        result[:, : part.shape[1]] = part
        if self._low is not None:
            result[:, 2], self._low = self._low, None
        return result

    def balance(self, v: np.ndarray, change: np.ndarray, inv_mass: np.ndarray) -> None:
        """Count what the motion of each bead got with the mechanical energy, in two float32 parts."""
        with np.errstate(divide="ignore", invalid="ignore"):
            motion = np.where(inv_mass > 0, 0.5 * np.sum(change * (2 * v + change), axis=1) / inv_mass, 0.0)
        whole = self.last[:, 1] + motion
        rounded = self.last[:, 0].astype(np.float32).astype(np.float64), whole.astype(np.float32).astype(np.float64)
        self._low = (self.last[:, 0] - rounded[0]) + (whole - rounded[1])
        self.last = np.column_stack(rounded)


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
    ):
        self.spec, self.conservative, self.periodic = spec, conservative, periodic
        self.scale, self.balanced, self.length_checked, self.steps = scale, balanced, length_checked, steps
        self._cutoff = max(float(term.cutoff.max()) for term in spec.terms)
        self._zero = np.zeros((len(spec.types), 3))
        self._local = threading.local()

    def __reduce__(self):
        return type(self), (self.spec, self.conservative, self.periodic, self.scale, self.balanced, self.length_checked, self.steps)

    def thread_state(self):
        """The state of the calling thread."""
        local = self._local
        if not hasattr(local, "engine"):
            warm_up(self.spec)
            warm_up_extras(self.spec.extras)
            engine = PairEngine(self.spec)
            local.kept = local.fingerprinted = local.moment = local.failed = None
            local.fields = None if self.spec.fields is None else Fields(self.spec.fields)
            # written again and again: OpenMM copies what it is given
            local.v, local.result, local.conserved = np.zeros((3, len(self.spec.types), 3))
            local.conserved_energy, local.conserved_at, local.read = 0.0, -1, {}
            local.loop = None if self.steps is None else StepLoop(self.steps, engine, self._watch, NEAR * self._cutoff)
            local.engine = engine  # last: it says that all is there
        return local

    def __call__(self, state):
        CTRL_C.check()
        parameters = state.getParameters()
        phase = int(parameters[names.PHASE])
        if phase == Phase.IDLE and not self.conservative:
            return 0.0, self._zero
        local = self.thread_state()
        here = (phase, parameters[names.COUNTER])
        if phase != Phase.IDLE and here == local.failed:
            # a step failed and its phase is still set: a call from outside gets what IDLE gives, but a new step may begin so too
            phase = phase if phase in KEEPING else int(Phase.IDLE)
        elif phase != Phase.IDLE:
            local.failed = None
        try:
            return self._evaluate(local, phase, state, parameters)
        except BaseException as error:
            local.failed = here
            if isinstance(error, RunError) and phase != Phase.IDLE:
                raise RunError(f"step {state.getStepCount() + 1}: {error}") from error
            raise

    def _evaluate(self, local, phase: int, state, parameters: dict):
        """Energy and forces for a phase."""
        x = self.positions(state)
        box = self.box(state)
        self.scale_body_forces(local, parameters)
        if phase in KEEPING:
            for bonds in self.length_checked:
                wrong = bonds.overstretched(x, box)
                if wrong is not None:
                    raise RunError(f"{wrong}; the step size may be too large")
            local.kept, local.read = x, {}
        if phase in (Phase.FINGERPRINT, Phase.STORE) and local.failed is None:
            return (self.fingerprint(local, x, box, parameters) if phase == Phase.FINGERPRINT else 0.0), self._zero
        if phase == Phase.IDLE and not self.conservative:
            return 0.0, self._zero
        if phase == Phase.IDLE or phase in KEEPING:
            return self._conserve(local, x, box)
        return 0.0, self._in_step(local, phase, x, box, parameters)

    def fingerprint(self, local, x: np.ndarray, box: np.ndarray | None, parameters: dict) -> float:
        """Fingerprint of positions, parameters and box; that of the last call if beads were only wrapped into the box since."""
        stable = np.array([value for name, value in sorted(parameters.items()) if name not in names.VOLATILE])
        if box is not None:
            stable = np.append(stable, box.ravel())
        value = None
        if local.fingerprinted is not None:
            last, last_x, last_stable = local.fingerprinted
            if np.array_equal(stable, last_stable) and (motion.same(x, last_x) or (box is not None and only_folded(x, last_x, box))):
                value = last
        if value is None:
            value = fingerprint(x, stable)
        local.fingerprinted = (value, x, stable)
        return value

    def _conserve(self, local, x: np.ndarray, box: np.ndarray | None):
        """Conservative force in ``local.conserved``, unless it is there already, and its energy."""
        if not self.conservative:
            return 0.0, self._zero
        local.engine.prepare(x, box)
        # a repulsion may depend on the temperatures of the beads
        warm = self.spec.fields is not None and self.spec.fields.kind == TEMPERATURE
        if local.conserved_at != local.engine.number or warm:
            field_values = None if local.fields is None else local.fields.values
            local.conserved_energy = local.engine.forces(CONSERVATIVE, None, 0.0, 1.0, 0, 0, field_values, local.conserved)[0]
            local.conserved_at = local.engine.number
        return local.conserved_energy, local.conserved

    def _in_step(self, local, phase: int, x: np.ndarray, box: np.ndarray | None, parameters: dict) -> np.ndarray:
        kept, block = local.kept, phase % 100
        phase -= block if phase >= Phase.SWEEP_SEEN else 0
        if kept is None:
            raise RunError(f"phase {phase} of the pair force came before any positions were stored: no integrator of openmm_dpd does that")
        if not parameters[names.DT] > 0.0:
            raise RunError(f"the step size must be > 0, but the integrator's is {in_units(parameters[names.DT], 'time')}")
        fields: Fields | None = local.fields
        if phase == Phase.TELL:
            return local.moment.block(block)
        if phase == Phase.CHANGE:
            assert fields is not None
            return fields.changes(block) / self.scale
        if phase == Phase.READ:
            shown = (x - kept) / parameters[names.TAU]
            local.read[block] = shown
            if block < RATES:
                assert fields is not None
                fields.read(block, shown)
            return self._zero
        dt, tau, kT = parameters[names.DT], parameters[names.TAU], self.thermal_energy(parameters)
        key = (int(parameters[names.SEED]), int(parameters[names.COUNTER]))
        motion.seen_velocities(x, kept, tau, local.v)
        if phase == Phase.RUN:
            return self._run(local, Moment(kept.copy(), local.v.copy(), box, dt, kT, *key))
        self._check(local.v, kT, dt)
        local.engine.prepare(kept if phase in AT_KEPT else x, box)
        conditions = (kT, dt, *key, None if fields is None else fields.values)
        return self._sweep(local, block, conditions) if phase >= Phase.SWEEP_SEEN else self._force(local, phase, conditions)

    def scale_body_forces(self, local, parameters) -> None:
        """Take the factor of body forces over from the Context."""
        scale = parameters[names.BODY_FORCE] if names.BODY_FORCE in parameters else 1.0
        if scale != local.engine.body_scale:
            local.engine.number += 1  # first: what was computed before is not valid any more
            local.engine.body_scale = scale

    def thermal_energy(self, parameters) -> float:
        """kT of the Context; RunError if it is none."""
        kT = parameters[names.KT]
        if not 0.0 <= kT < np.inf:
            raise RunError(f"the context parameter {names.KT} must be >= 0 and finite, but is {kT}")
        return kT

    def _run(self, local, moment: Moment) -> np.ndarray:
        """Positions after a whole step."""
        fields, read = self.spec.fields, local.read
        if fields is not None:
            moment.values = local.fields.values.copy()
            if RATES in read:
                moment.rates = unfolded([read[RATES + k] for k in range(fields.n_blocks)], fields)
        moment.acc, moment.unkicked = read.get(names.ACCELERATION), read.get(names.PREDICTED)
        local.moment = moment
        local.loop.run(moment, 1, shown=True)
        return moment.x

    def _watch(self, v: np.ndarray, moment: Moment) -> None:
        self._check(v, moment.kT, moment.dt)

    def _check(self, v: np.ndarray, kT: float, dt: float) -> None:
        """RunError if beads run away."""
        wrong = runaway(v, self.spec.inv_mass, kT, dt, self._cutoff)
        if wrong is not None:
            raise RunError(f"{wrong}; the step size is too large for this scheme, or the start is too far from equilibrium")

    def _force(self, local, phase: int, conditions: tuple) -> np.ndarray:
        """Force form at the prepared positions."""
        which = DISSIPATIVE | RANDOM
        if phase == Phase.FORCE_SEEN and self.conservative:
            which |= CONSERVATIVE
        force = local.engine.forces(which, local.v, *conditions, local.result)[1]
        if local.fields is not None:
            local.fields.last = local.engine.rates
        return force

    def _sweep(self, local, update: int, conditions: tuple) -> np.ndarray:
        """Impulses/dt of a sweep at the prepared positions."""
        engine, v, dt = local.engine, local.v, conditions[1]
        change = engine.sweep(v, *conditions, local.result, update)
        if local.fields is not None:
            local.fields.last = engine.increments
            if self.balanced:
                local.fields.balance(v, change, self.spec.inv_mass)
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
        box = state.getPeriodicBoxVectors(asNumpy=True)._value
        if self._cutoff > 0.5 * box.diagonal().min() * (1 + 1e-9):
            edges = " x ".join(map(in_length, box.diagonal()))
            raise RunError(f"the box has shrunk to {edges}, less than twice the cutoff of {in_length(self._cutoff)}")
        return box


def unfolded(blocks: list[np.ndarray], spec: FieldSpec) -> np.ndarray:
    """(N, K) values from blocks of three."""
    return np.concatenate(blocks, axis=1)[:, : spec.n_values].copy()


def pair_force(function: PairForceFunction, *, options: ProgramOptions, integrator: openmm.Integrator) -> openmm.PythonForce:
    """PythonForce that evaluates the pair terms, with its context parameters (see :mod:`openmm_dpd.names`)."""
    parameters = {
        names.PHASE: float(Phase.IDLE),
        names.TAU: options.dt,
        names.DT: options.dt,
        names.KT: options.kT,
        names.COUNTER: 0.0,
        names.SEED: float(options.seed),
    }
    parameters |= origin(options, integrator)
    if function.spec.fields is not None and function.spec.fields.kind == ENERGY:
        parameters |= {names.VOLUME_MOVES: 0.0, names.VOLUME_STEP: 0.01, names.VOLUME_ACCEPTED: 0.0}
    if any(extra.term == "external" for extra in function.spec.extras):
        parameters[names.BODY_FORCE] = 1.0
    force = openmm.PythonForce(function, parameters)
    force.setName(names.PAIR_FORCE)
    force.setForceGroup(options.pair_group)
    # true exactly when the scene is periodic: only then are the positions handed over meaningful on GPU platforms
    force.setUsesPeriodicBoundaryConditions(function.periodic)
    return force
