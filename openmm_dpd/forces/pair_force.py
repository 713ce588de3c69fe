"""The PythonForce that stands between OpenMM and the pair kernel."""

from __future__ import annotations

import threading

import numpy as np
import openmm
from openmm import unit

from ..errors import RunError
from ..kernels.compiled import compiled
from ..kernels.engine import CONSERVATIVE, DISSIPATIVE, RANDOM, PairEngine, PairSpec
from ..names import COUNTER, DT, KT, PAIR_GROUP, PHASE, SEED, TAU, VOLATILE, Phase


@compiled
def fingerprint(x, parameters):
    """A whole number below 2^53 that depends on every bit of the positions and parameters."""
    total = np.uint64(0x9E3779B97F4A7C15)
    for values in (x.ravel(), parameters):
        for bits in values.view(np.uint64):
            total = (total ^ bits) * np.uint64(0xBF58476D1CE4E5B9)
            total ^= total >> np.uint64(29)
    return np.float64(total >> np.uint64(11))


def relative_to(x: np.ndarray, kept: np.ndarray, box: np.ndarray | None) -> np.ndarray:
    """Displacement x - kept by minimum image: a GPU platform may have wrapped either of them."""
    d = x - kept
    if box is not None and np.any(np.abs(d) > 0.5 * np.diag(box)):
        for k in (2, 1, 0):
            d -= np.outer(np.rint(d[:, k] / box[k, k]), box[k])
    return d


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
    """

    def __init__(self, spec: PairSpec, conservative: bool, periodic: bool):
        self.spec, self.conservative, self.periodic = spec, conservative, periodic
        self._cutoff = max(float(term.cutoff.max()) for term in spec.terms)
        self._zero = np.zeros((len(spec.types), 3))
        self._local = threading.local()

    def __reduce__(self):
        return type(self), (self.spec, self.conservative, self.periodic)

    def __call__(self, state):
        parameters = state.getParameters()
        phase = int(parameters[PHASE])
        if phase == Phase.IDLE and not self.conservative:
            return 0.0, self._zero
        local = self._local
        if not hasattr(local, "engine"):
            local.engine, local.kept = PairEngine(self.spec), None
        x = state.getPositions(asNumpy=True).value_in_unit(unit.nanometer)
        box = self._box(state) if self.periodic else None
        if phase == Phase.NOTE:
            local.kept = x
            stable = np.array([value for name, value in sorted(parameters.items()) if name not in VOLATILE])
            # the box is part of what the forces depend on
            return fingerprint(x, stable if box is None else np.append(stable, box.ravel())), self._zero
        if phase in (Phase.IDLE, Phase.CONSERVE):
            if phase == Phase.CONSERVE:
                local.kept = x
            return self._conserve(local.engine, x, box)
        return 0.0, self._in_step(local, phase, x, box, parameters)

    def _conserve(self, engine: PairEngine, x: np.ndarray, box: np.ndarray | None):
        if not self.conservative:
            return 0.0, self._zero
        engine.prepare(x, box)
        energy, force, _ = engine.forces(CONSERVATIVE, None, 0.0, 1.0, 0, 0)
        return energy, force

    def _in_step(self, local, phase: int, x: np.ndarray, box: np.ndarray | None, parameters: dict) -> np.ndarray:
        engine, kept = local.engine, local.kept
        if kept is None:
            raise RunError(f"the pair force was asked for phase {phase} before it saw any positions; is this one of our programs?")
        dt, tau, kT = parameters[DT], parameters[TAU], parameters[KT]
        key = (int(parameters[SEED]), int(parameters[COUNTER]))
        if not kT >= 0.0:
            raise RunError(f"the context parameter {KT} must be >= 0, but is {kT}")
        v = relative_to(x, kept, box) / tau
        engine.prepare(kept if phase in (Phase.FORCE_KEPT, Phase.SWEEP_KEPT) else x, box)
        if phase in (Phase.FORCE_SEEN, Phase.FORCE_KEPT):
            which = DISSIPATIVE | RANDOM
            if phase == Phase.FORCE_SEEN and self.conservative:
                which |= CONSERVATIVE
            return engine.forces(which, v, kT, dt, *key)[1]
        kick = 0.0
        if phase == Phase.KICK_SWEEP_SEEN:
            kick = engine.forces(CONSERVATIVE, None, kT, dt, *key)[1]
            v = v + 0.5 * dt * self.spec.inv_mass[:, None] * kick
        change = engine.sweep(v, kT, dt, *key)
        with np.errstate(divide="ignore", invalid="ignore"):
            impulse = np.where(self.spec.inv_mass[:, None] > 0, change / (dt * self.spec.inv_mass[:, None]), 0.0)
        return impulse + kick

    def _box(self, state) -> np.ndarray:
        box = state.getPeriodicBoxVectors(asNumpy=True).value_in_unit(unit.nanometer)
        if self._cutoff > 0.5 * box.diagonal().min() * (1 + 1e-9):
            raise RunError(f"the box has shrunk to {box.diagonal().tolist()} nm, less than twice the cutoff of {self._cutoff:g} nm")
        return box


def pair_force(spec: PairSpec, *, conservative: bool, periodic: bool, kT: float, dt: float, seed: int) -> openmm.PythonForce:
    """PythonForce that evaluates the pair terms, with its context parameters (see :mod:`openmm_dpd.names`)."""
    parameters = {PHASE: float(Phase.IDLE), TAU: dt, DT: dt, KT: kT, COUNTER: 0.0, SEED: float(seed)}
    force = openmm.PythonForce(PairForceFunction(spec, conservative, periodic), parameters)
    force.setName("DPD pair terms")
    force.setForceGroup(PAIR_GROUP)
    # true exactly when the scene is periodic: only then are the positions handed over meaningful on GPU platforms
    force.setUsesPeriodicBoundaryConditions(periodic)
    return force
