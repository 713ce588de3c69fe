"""The PythonForce that stands between OpenMM and the pair kernel."""

from __future__ import annotations

import threading

import numpy as np
import openmm
from openmm import unit

from ..errors import RunError
from ..kernels.compiled import compiled
from ..kernels.engine import CONSERVATIVE, DISSIPATIVE, RANDOM, PairEngine, PairSpec
from ..kernels.fields import ENERGY, FieldSpec
from ..names import (
    COUNTER,
    DT,
    KT,
    PAIR_GROUP,
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


@compiled
def fingerprint(x, parameters):
    """A number that depends on every bit of the positions and parameters, too small to show where it is taken for an energy."""
    total = np.uint64(0x9E3779B97F4A7C15)
    for values in (x.ravel(), parameters):
        for bits in values.view(np.uint64):
            total = (total ^ bits) * np.uint64(0xBF58476D1CE4E5B9)
            total ^= total >> np.uint64(29)
    return np.float64(total >> np.uint64(11)) * 2.0**-960


def relative_to(x: np.ndarray, kept: np.ndarray, box: np.ndarray | None) -> np.ndarray:
    """Displacement x - kept by minimum image: a GPU platform may have wrapped either of them."""
    d = x - kept
    if box is not None and np.any(np.abs(d) > 0.5 * np.diag(box)):
        for k in (2, 1, 0):
            d -= np.outer(np.rint(d[:, k] / box[k, k]), box[k])
    return d


def folded(x: np.ndarray, before: np.ndarray, box: np.ndarray) -> bool:
    """Whether x differs from the positions before by box vectors only, to float32 rounding: GPU platforms fold beads back now and then."""
    moved = np.abs(x - before).max(axis=1) > 0.5 * np.diag(box).min()
    return bool(moved.any() and np.abs(relative_to(x, before, box)).max() < 4e-7 * (np.abs(before).max() + np.diag(box).max()))


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
            local.engine, local.kept, local.noted = PairEngine(self.spec), None, None
            local.fields = None if self.spec.fields is None else Fields(self.spec.fields)
            local.failed = None
        here = (phase, parameters[COUNTER])
        if phase > Phase.CONSERVE and here == local.failed:
            # a step died and left its phase behind: what is asked for from outside is what IDLE answers
            phase = int(Phase.IDLE)
        elif phase != Phase.IDLE:
            local.failed = None
        try:
            return self._evaluate(local, phase, state, parameters)
        except BaseException:
            local.failed = here
            raise

    def _evaluate(self, local, phase: int, state, parameters: dict):
        """Energy and forces for a phase."""
        x = state.getPositions(asNumpy=True).value_in_unit(unit.nanometer)
        box = self._box(state) if self.periodic else None
        if phase in (Phase.NOTE, Phase.CONSERVE):
            for bonds in self.guarded:
                wrong = bonds.overstretched(x, box)
                if wrong is not None:
                    raise RunError(f"{wrong}; the step size may be too large")
        if phase == Phase.NOTE:
            local.kept = x
            return self._note(local, x, box, parameters), self._zero
        if phase == Phase.IDLE and not self.conservative:
            return 0.0, self._zero
        if phase in (Phase.IDLE, Phase.CONSERVE):
            if phase == Phase.CONSERVE:
                local.kept = x
            return self._conserve(local.engine, x, box)
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

    def _conserve(self, engine: PairEngine, x: np.ndarray, box: np.ndarray | None):
        if not self.conservative:
            return 0.0, self._zero
        engine.prepare(x, box)
        scalars = None if self._local.fields is None else self._local.fields.values
        energy, force, _ = engine.forces(CONSERVATIVE, None, 0.0, 1.0, 0, 0, scalars)
        return energy, force

    def _in_step(self, local, phase: int, x: np.ndarray, box: np.ndarray | None, parameters: dict) -> np.ndarray:
        engine, kept = local.engine, local.kept
        if kept is None:
            raise RunError(f"the pair force was asked for phase {phase} before it saw any positions; is this one of our programs?")
        fields: Fields | None = local.fields
        if phase >= Phase.CHANGES:
            assert fields is not None
            return fields.changes(phase - Phase.CHANGES) / self.scale
        if phase >= Phase.READ:
            assert fields is not None
            fields.read(phase - Phase.READ, relative_to(x, kept, box) / parameters[TAU])
            return self._zero
        scalars = None if fields is None else fields.values
        dt, tau, kT = parameters[DT], parameters[TAU], parameters[KT]
        key = (int(parameters[SEED]), int(parameters[COUNTER]))
        if not kT >= 0.0:
            raise RunError(f"the context parameter {KT} must be >= 0, but is {kT}")
        v = relative_to(x, kept, box) / tau
        wrong = runaway(v, self.spec.inv_mass, kT, dt, self._cutoff)
        if wrong is not None:
            raise RunError(f"{wrong}; the step size is too large for this scheme, or the start is too far from equilibrium")
        engine.prepare(kept if phase in (Phase.FORCE_KEPT, Phase.SWEEP_KEPT) else x, box)
        if phase in (Phase.FORCE_SEEN, Phase.FORCE_KEPT):
            which = DISSIPATIVE | RANDOM
            if phase == Phase.FORCE_SEEN and self.conservative:
                which |= CONSERVATIVE
            force = engine.forces(which, v, kT, dt, *key, scalars)[1]
            if fields is not None:
                fields.last = engine.rates
            return force
        kick = 0.0
        if phase == Phase.KICK_SWEEP_SEEN:
            kick = engine.forces(CONSERVATIVE, None, kT, dt, *key, scalars)[1]
            v = v + 0.5 * dt * self.spec.inv_mass[:, None] * kick
        change = engine.sweep(v, kT, dt, *key, scalars)
        if fields is not None:
            fields.last = engine.flow
            if self.balanced:
                fields.balance(v, change, self.spec.inv_mass)
        with np.errstate(divide="ignore", invalid="ignore"):
            impulse = np.where(self.spec.inv_mass[:, None] > 0, change / (dt * self.spec.inv_mass[:, None]), 0.0)
        return impulse + kick

    def _box(self, state) -> np.ndarray:
        box = state.getPeriodicBoxVectors(asNumpy=True).value_in_unit(unit.nanometer)
        if self._cutoff > 0.5 * box.diagonal().min() * (1 + 1e-9):
            raise RunError(f"the box has shrunk to {box.diagonal().tolist()} nm, less than twice the cutoff of {self._cutoff:g} nm")
        return box


def pair_force(
    spec: PairSpec,
    *,
    conservative: bool,
    periodic: bool,
    kT: float,
    dt: float,
    seed: int,
    scale: float = 1.0,
    balanced: bool = False,
    guarded: tuple = (),
) -> openmm.PythonForce:
    """PythonForce that evaluates the pair terms, with its context parameters (see :mod:`openmm_dpd.names`)."""
    parameters = {PHASE: float(Phase.IDLE), TAU: dt, DT: dt, KT: kT, COUNTER: 0.0, SEED: float(seed)}
    if spec.fields is not None and spec.fields.kind == ENERGY:
        parameters |= {VOLUME_MOVES: 0.0, VOLUME_STEP: 0.01, VOLUME_ACCEPTED: 0.0}
    force = openmm.PythonForce(PairForceFunction(spec, conservative, periodic, scale, balanced, guarded), parameters)
    force.setName("DPD pair terms")
    force.setForceGroup(PAIR_GROUP)
    # true exactly when the scene is periodic: only then are the positions handed over meaningful on GPU platforms
    force.setUsesPeriodicBoundaryConditions(periodic)
    return force
