"""The PythonForce that stands between OpenMM and the pair kernel."""

from __future__ import annotations

import threading
from typing import TYPE_CHECKING

import numpy as np
import openmm
from openmm import unit

from ..errors import RunError
from ..integrators import interrupts, origin
from ..kernels import motion
from ..kernels.compiled import compiled
from ..kernels.engine import CONSERVATIVE, DISSIPATIVE, RANDOM, PairEngine, PairSpec, warm_up
from ..kernels.fields import ENERGY, TEMPERATURE, FieldSpec
from ..names import (
    COUNTER,
    DT,
    KICKS,
    KT,
    PAIR_FORCE,
    PHASE,
    SEED,
    TAU,
    VOLATILE,
    VOLUME_ACCEPTED,
    VOLUME_MOVES,
    VOLUME_STEP,
    Phase,
)
from .runaway import runaway

if TYPE_CHECKING:
    from ..plan import ProgramOptions

#: Phases that keep the positions.
KEEPING = (Phase.NOTE, Phase.CONSERVE, Phase.KEEP, Phase.TWO_KICKS)

#: Phases that look at the kept positions.
AT_KEPT = (Phase.FORCE_KEPT, Phase.SWEEP_KEPT, Phase.SWEEP_KICK_KEPT)

#: How much of the conservative force comes with a sweep, and how much of it acts before the sweep.
SHARES: dict[int, tuple[float, float]] = {
    Phase.KICK_SWEEP_SEEN: (1.0, 0.5),
    Phase.SWEEP_SEEN_CONSERVED: (1.0, 0.0),
    Phase.SWEEP_KICK_KEPT: (0.5, 0.0),
    Phase.KICK_SWEEP_OUTER: (KICKS[0], KICKS[0]),
}


@compiled
def fingerprint(x, parameters):
    """A number that depends on every bit of the positions and parameters, too small to show where it is taken for an energy."""
    total = np.uint64(0x9E3779B97F4A7C15)
    for values in (x.ravel(), parameters):
        for bits in values.view(np.uint64):
            total = (total ^ bits) * np.uint64(0xBF58476D1CE4E5B9)
            total ^= total >> np.uint64(29)
    return np.float64(total >> np.uint64(11)) * 2.0**-960


def _plain(length: unit.Quantity) -> np.ndarray:
    """Value of a length of a State, which is in nanometers always: to look for a conversion takes longer than some steps' arithmetic."""
    return length._value


def folded(x: np.ndarray, before: np.ndarray, box: np.ndarray) -> bool:
    """Whether x differs from the positions before by box vectors only, to float32 rounding: GPU platforms fold beads back now and then."""
    if not motion.jumped(x, before, 0.5 * np.diag(box).min()):
        return False
    d = x - before
    for axis in (2, 1, 0):
        d -= np.round(d[:, axis] / box[axis, axis])[:, None] * box[axis]
    return bool(np.abs(d).max() < 4e-7 * (np.abs(before).max() + np.diag(box).max()))


class Fields:
    """What beads carry, as the pair force reads it and gives changes back: blocks of three values per bead.

    Immobile beads cannot show anything (a program skips them), so theirs are the values at the start.  Internal energies come as
    (conductive, mechanical, what rounding lost of the sum); everything else as one value after the other.
    """

    def __init__(self, spec: FieldSpec):
        self.spec = spec
        self.values = spec.initial.copy()
        self.last = np.zeros_like(self.values)
        self._low: np.ndarray | None = None

    def read(self, block: int, shown: np.ndarray) -> None:
        """Take over the values of one block, (N, 3)."""
        if self.spec.kind == ENERGY:
            shown = np.column_stack([shown[:, 0], shown[:, 1] + shown[:, 2]])
        part = self.values[:, 3 * block : 3 * block + 3]
        part[...] = np.where(self.spec.immobile[:, None], part, shown[:, : part.shape[1]])

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

    It is complete and immutable once constructed, because OpenMM pickles it into the System.  What it keeps between two calls of one step
    is private to the calling thread, so that several Contexts can step one System, and holds nothing that could not be recomputed.

    Parameters
    ----------
    spec : PairSpec
        The pair terms.
    conservative : bool
        Whether this force holds the conservative terms too.
    periodic : bool
        Whether there is a periodic box.
    scale : float
        Changes of what beads carry are returned in units of this.
    balanced : bool
        Whether, for internal energies, the change of a bead's kinetic energy counts in (the program takes it off again).
    guarded : sequence of FENEBonds
        Bonds whose lengths are looked at once in every step: a bond that is too long would make the positions NaN.
    """

    def __init__(self, spec: PairSpec, conservative: bool, periodic: bool, scale: float = 1.0, balanced: bool = False, guarded: tuple = ()):
        self.spec, self.conservative, self.periodic = spec, conservative, periodic
        self.scale, self.balanced, self.guarded = scale, balanced, guarded
        self._cutoff = max(float(term.cutoff.max()) for term in spec.terms)
        self._zero = np.zeros((len(spec.types), 3))
        self._local = threading.local()

    def __reduce__(self):
        return type(self), (self.spec, self.conservative, self.periodic, self.scale, self.balanced, self.guarded)

    def __call__(self, state):
        parameters = state.getParameters()
        phase = int(parameters[PHASE])
        if phase == Phase.IDLE and not self.conservative:
            return 0.0, self._zero
        local = self._local
        if not hasattr(local, "engine"):
            warm_up(self.spec)
            local.engine, local.kept, local.noted = PairEngine(self.spec), None, None
            local.fields = None if self.spec.fields is None else Fields(self.spec.fields)
            local.failed = None
            # written again and again: OpenMM copies what it is given
            local.v, local.result, local.conserved, local.kicks = np.zeros((4, len(self.spec.types), 3))
            local.conserved_energy, local.kicked = None, False
        here = (phase, parameters[COUNTER])
        if phase != Phase.IDLE and here == local.failed:
            # a step died and left its phase behind: what is asked for from outside is what IDLE answers; but a new step may begin so too
            phase = phase if phase in KEEPING else int(Phase.IDLE)
        elif phase != Phase.IDLE:
            local.failed = None
        try:
            return self._evaluate(local, phase, state, parameters)
        except BaseException as error:
            local.failed = here
            interrupts.seen = isinstance(error, KeyboardInterrupt)
            raise

    def _evaluate(self, local, phase: int, state, parameters: dict):
        """Energy and forces for a phase."""
        x = _plain(state.getPositions(asNumpy=True))
        if len(x) != len(self.spec.types):
            raise RunError(f"the System has {len(x)} particles, but its DPD pair terms were made for {len(self.spec.types)}")
        box = self._box(state) if self.periodic else None
        if phase in KEEPING:
            for bonds in self.guarded:
                wrong = bonds.overstretched(x, box)
                if wrong is not None:
                    raise RunError(f"{wrong}; the step size may be too large")
            local.kept = x
        if phase in (Phase.NOTE, Phase.KEEP) and local.failed is None:
            return (self._note(local, x, box, parameters) if phase == Phase.NOTE else 0.0), self._zero
        if phase == Phase.IDLE and not self.conservative:
            return 0.0, self._zero
        if phase == Phase.TWO_KICKS and local.failed is None:
            return 0.0, self._two_kicks(local, x, box)
        if phase == Phase.CONSERVE:
            local.kicked = False
        if phase == Phase.IDLE or phase in KEEPING:
            return self._conserve(local, x, box)
        if phase == Phase.CLOSE:
            return 0.0, self._close(local, x, box)
        return 0.0, self._in_step(local, phase, x, box, parameters)

    def _note(self, local, x: np.ndarray, box: np.ndarray | None, parameters: dict) -> float:
        """Fingerprint of positions, parameters and box; that of the last call if the only change is that beads were folded back."""
        stable = np.array([value for name, value in sorted(parameters.items()) if name not in VOLATILE])
        if box is not None:
            stable = np.append(stable, box.ravel())
        value = fingerprint(x, stable)
        if box is not None and local.noted is not None:
            last, last_x, last_stable = local.noted
            if value != last and np.array_equal(stable, last_stable) and folded(x, last_x, box):
                value = last
        local.noted = (value, x, stable)
        return value

    def _conserve(self, local, x: np.ndarray, box: np.ndarray | None):
        if not self.conservative:
            return 0.0, self._zero
        if local.engine.prepare(x, box):
            local.conserved_energy = None
        return self._conserve_prepared(local), local.conserved

    def _conserve_prepared(self, local) -> float:
        """Conservative force in ``local.conserved``, unless it is there already; its energy."""
        if local.conserved_energy is None or (local.fields is not None and local.fields.spec.kind == TEMPERATURE):
            scalars = None if local.fields is None else local.fields.values
            local.conserved_energy = local.engine.forces(CONSERVATIVE, None, 0.0, 1.0, 0, 0, scalars, local.conserved)[0]
        return local.conserved_energy

    def _in_step(self, local, phase: int, x: np.ndarray, box: np.ndarray | None, parameters: dict) -> np.ndarray:
        kept = local.kept
        if kept is None:
            raise RunError(f"the pair force was asked for phase {phase} before it saw any positions; is this one of our programs?")
        if not parameters[DT] > 0.0:
            raise RunError(f"the step size must be > 0, but the integrator's is {parameters[DT]:g} ps")
        fields: Fields | None = local.fields
        if phase >= Phase.CHANGES:
            assert fields is not None
            return fields.changes(phase - Phase.CHANGES) / self.scale
        both = phase == Phase.READ_TWO_KICKS
        if both or phase >= Phase.READ:
            assert fields is not None
            fields.read(0 if both else phase - Phase.READ, (x - kept) / parameters[TAU])
            return self._two_kicks(local, kept, box) if both else self._zero
        scalars = None if fields is None else fields.values
        dt, tau, kT = parameters[DT], parameters[TAU], parameters[KT]
        key = (int(parameters[SEED]), int(parameters[COUNTER]))
        if not 0.0 <= kT < np.inf:
            raise RunError(f"the context parameter {KT} must be >= 0 and finite, but is {kT}")
        motion.seen_velocities(x, kept, tau, local.v)
        wrong = runaway(local.v, self.spec.inv_mass, kT, dt, self._cutoff)
        if wrong is not None:
            raise RunError(f"{wrong}; the step size is too large for this scheme, or the start is too far from equilibrium")
        if local.engine.prepare(kept if phase in AT_KEPT else x, box):
            local.conserved_energy = None
        return (self._force if phase in (Phase.FORCE_SEEN, Phase.FORCE_KEPT) else self._sweep)(local, phase, (kT, dt, *key, scalars))

    def _force(self, local, phase: int, conditions: tuple) -> np.ndarray:
        """Force form at the prepared positions."""
        which = DISSIPATIVE | RANDOM
        if phase == Phase.FORCE_SEEN and self.conservative:
            which |= CONSERVATIVE
        force = local.engine.forces(which, local.v, *conditions, local.result)[1]
        if local.fields is not None:
            local.fields.last = local.engine.rates
        return force

    def _sweep(self, local, phase: int, conditions: tuple) -> np.ndarray:
        """Impulses/dt of a sweep at the prepared positions, and of the kicks that go with it."""
        engine, v, dt = local.engine, local.v, conditions[1]
        share, before = SHARES.get(phase, (0.0, 0.0))
        if share and phase != Phase.SWEEP_SEEN_CONSERVED:  # that one wants the force of the kept positions, which is there
            self._conserve_prepared(local)
        if before:
            motion.kick(v, local.conserved, self.spec.inv_mass, before * dt)
        change = engine.sweep(v, *conditions, local.result)
        if local.fields is not None:
            local.fields.last = engine.flow
            if self.balanced:
                local.fields.balance(v, change, self.spec.inv_mass)
        motion.as_force(change, self.spec.inv_mass, dt, share, local.conserved)
        if phase == Phase.KICK_SWEEP_OUTER:
            change += local.kicks
        return change

    def _two_kicks(self, local, x: np.ndarray, box: np.ndarray | None) -> np.ndarray:
        """Parts of the force of the last CONSERVE and of the force here; the same when asked for twice."""
        if not local.kicked:
            outer, inner = KICKS
            np.multiply(local.conserved, outer, out=local.kicks)
            self._conserve(local, x, box)
            np.multiply(local.conserved, inner, out=local.v)
            local.kicks += local.v
            local.kicked = True
        return local.kicks

    def _close(self, local, x: np.ndarray, box: np.ndarray | None) -> np.ndarray:
        """What the last sweep and half kick gave, and the next half kick."""
        self._conserve(local, x, box)
        # a sum that can be asked for twice
        np.multiply(local.conserved, 0.5, out=local.v)
        local.v += local.result
        return local.v

    def _box(self, state) -> np.ndarray:
        box = _plain(state.getPeriodicBoxVectors(asNumpy=True))
        if self._cutoff > 0.5 * box.diagonal().min() * (1 + 1e-9):
            raise RunError(f"the box has shrunk to {box.diagonal().tolist()} nm, less than twice the cutoff of {self._cutoff:g} nm")
        return box


def pair_force(
    spec: PairSpec,
    *,
    conservative: bool,
    periodic: bool,
    options: ProgramOptions,
    integrator: openmm.Integrator,
    balanced: bool = False,
    guarded: tuple = (),
) -> openmm.PythonForce:
    """PythonForce that evaluates the pair terms, with its context parameters (see :mod:`openmm_dpd.names`)."""
    parameters = {PHASE: float(Phase.IDLE), TAU: options.dt, DT: options.dt, KT: options.kT, COUNTER: 0.0, SEED: float(options.seed)}
    parameters |= origin(options, integrator)
    if spec.fields is not None and spec.fields.kind == ENERGY:
        parameters |= {VOLUME_MOVES: 0.0, VOLUME_STEP: 0.01, VOLUME_ACCEPTED: 0.0}
    force = openmm.PythonForce(PairForceFunction(spec, conservative, periodic, options.field_scale, balanced, guarded), parameters)
    force.setName(PAIR_FORCE)
    force.setForceGroup(options.pair_group)
    # true exactly when the scene is periodic: only then are the positions handed over meaningful on GPU platforms
    force.setUsesPeriodicBoundaryConditions(periodic)
    return force
