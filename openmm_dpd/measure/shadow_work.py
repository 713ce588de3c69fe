"""The work that the errors of kicks and drifts do in single steps: a meter of the time step that needs no reference."""

import numpy as np
import openmm

from ..base.errors import ParameterError, RunError
from ..base.openmm_private import bare, vectors
from ..base.stats import Average, block_average
from ..kernels.fields import TEMPERATURE
from ..model.schemes import SWEEPS, Letter
from ..plan.plan import Plan
from ..simulation.built import BuiltSystem
from .flow import BuiltReporter
from .present import Present


class ShadowWorkReporter(BuiltReporter):
    r"""Reporter that records the shadow work of single steps: the change of the energy H = U + K by the kicks and drifts of a step.

    With exact kicks and drifts it would be 0 in every step; the sweep of pair updates leaves the Boltzmann distribution unchanged and is
    left out.  The states before and after a step suffice: the letters before the sweep are done again from the first, those after it
    backwards from the second, with a force at each position in between.  Every ``interval`` steps a sample takes about as long as two
    or three steps.

    What it tells (:doc:`/schemes`): while ``variance`` is below 0.01 (``bababo``: 0.005), configurational temperature and potential energy
    are within about 1 % with ``middle``, ``bababo`` and ``bab3``, in every scene that was tried.  ``heating`` is the power at which the
    step heats the fluid: the drift of the energy where that is conserved, and divided by the rate at which friction cools the error of the
    kinetic temperature at the sweep.  The numbers of different words cannot be compared: those in the same cyclic order do the same work,
    and differ by where in this order positions and velocities are read.

    Parameters
    ----------
    interval : int
        Steps between samples, at least 2.
    built : BuiltSystem
        A built scene with a scheme that is a word with one sweep.

    Attributes
    ----------
    work : list of float
        Shadow work of each sample, kJ/mol.

    Raises
    ------
    ParameterError
        If the scheme is no word with one sweep, or something else than pairs and bonded terms changes the energy within a step: walls,
        a shear, charges, forces on single beads, a temperature ramp, repulsion that depends on the beads' temperatures (EDPD), reactions.

    References
    ----------
    D. A. Sivak, J. D. Chodera and G. E. Crooks, Phys. Rev. X 3, 011007 (2013).
    """

    def __init__(self, interval: int, built: BuiltSystem):
        super().__init__(interval, built)
        reason = _why_not(built.plan)
        if reason is not None or self.interval < 2:
            raise ParameterError(f"no shadow work: {reason or 'the interval must be at least 2 steps'}")
        letters = built.plan.options.scheme.steps(built.plan.options.thermostat and not built.plan.options.frictionless)
        at = next((k for k, (letter, _) in enumerate(letters) if letter in SWEEPS), len(letters))
        self._before, self._after = letters[:at], letters[at + 1 :]
        self.work = list[float]()
        self._present = Present(built)
        #: step, positions, velocities and box of the state before a sampled step
        self._first: tuple[int, np.ndarray, np.ndarray, np.ndarray | None] | None = None
        self._probe: openmm.Context | None = None
        self._mass = self._present.mass

    def describeNextReport(self, simulation):
        """Steps until the next state that is needed: the one before a sampled step, or the one after it."""
        if self._first is not None and simulation.currentStep == self._first[0]:
            return {"steps": 1, "periodic": False, "include": []}
        return super().describeNextReport(simulation)

    def report(self, simulation, state):
        """Take the state before a step, or the sample after it."""
        present, step, self._platform = self._present, simulation.currentStep, simulation.context.getPlatform()
        present.look(simulation.context)
        if present.others:
            raise RunError("no shadow work: the System has forces that are not the scene's")
        if self._first is not None and self._first[0] == step - 1:
            _, x, v, box = self._first
            self.work.append(self._of(x, v, box, self._before, 1.0) - self._of(present.x, present.v, present.box, self._after[::-1], -1.0))
        self._first = (step, present.x.copy(), present.v.copy(), present.box) if step % self.interval == 0 else None

    def _of(self, x: np.ndarray, v: np.ndarray, box: np.ndarray | None, letters: tuple[Letter, ...], sign: float) -> float:
        """Change of the energy by letters, backwards in time with the sign -1."""
        dt, inv_mass = sign * self._present.dt, self.built.plan.spec.inv_mass[:, None]
        potential, force = self._forces(x, box)
        scheme = self.built.plan.options.scheme

        def energy(v: np.ndarray) -> float:
            return potential + 0.5 * float(np.sum(self._mass[:, None] * scheme.on_step(v, force, inv_mass[:, 0], self._present.dt) ** 2))

        begin = energy(v)
        for letter, part in letters:
            if letter == "A":
                x = x + float(part) * dt * v
                potential, force = self._forces(x, box)
            else:
                v = v + float(part) * dt * inv_mass * force
        # whole steps end with velocities that may lag; in the middle of one they are what they are
        return potential + 0.5 * float(np.sum(self._mass[:, None] * v**2)) - begin

    def _forces(self, x: np.ndarray, box: np.ndarray | None) -> tuple[float, np.ndarray]:
        """Potential energy and forces (N, 3) at positions, in a Context that takes no steps."""
        if self._probe is None:
            self._probe = openmm.Context(self.built.system, openmm.VerletIntegrator(0.001), self._platform)
        if box is not None:
            self._probe.setPeriodicBoxVectors(*box)
        self._probe.setPositions(x)
        state = self._probe.getState(energy=True, forces=True)
        return bare(state.getPotentialEnergy()), vectors(state, openmm.State.Forces)

    def _per_step(self) -> np.ndarray:
        if not self.work:
            raise ParameterError("ShadowWorkReporter has no samples yet; run steps with it first")
        return np.array(self.work)

    @property
    def heating(self) -> Average:
        """Mean shadow work per mobile bead and time, kJ/mol/ps."""
        return block_average(self._per_step() / (self._present.dt * np.sum(self._mass > 0)), name="the shadow work")

    @property
    def variance(self) -> float:
        """Variance of the shadow work of a step per mobile bead, in units of kT^2: it does not depend on the number of beads."""
        return float(np.var(self._per_step()) / (np.sum(self._mass > 0) * self._present.kT**2))

    @property
    def acceptance(self) -> float:
        """Mean of min(1, exp(-W/kT)): of a Metropolis test of the kicks and drifts of a step of the whole scene."""
        return float(np.mean(np.minimum(1.0, np.exp(-self._per_step() / self._present.kT))))


def _why_not(plan: Plan) -> str | None:
    """Why the shadow work of a plan is not known, or None."""
    scene, scheme = plan.scene, plan.options.scheme
    reasons = {
        f"the scheme {scheme.name!r} is no word": not scheme.letters,
        f"the scheme {scheme.name!r} has more than one sweep": sum(letter in SWEEPS for letter, _ in scheme.letters) > 1,
        "walls reflect beads": bool(scene.walls),
        "rigid bodies turn": bool(scene.bodies),
        "a shear does work": scene.shear is not None,
        "kicks by charges or by forces on single beads are not part of the word": bool(scene.electrostatics or scene.body_forces),
        "the temperature follows a ramp": plan.options.ramp is not None,
        "a repulsion depends on the temperatures of the beads": plan.spec.fields is not None and plan.spec.fields.kind == TEMPERATURE,
        "a force follows concentrations": plan.spec.fields is not None and plan.spec.fields.pushes,
        "forces act on some beads only": scene.interacting is not None,
        "bonds form and break": bool(scene.reactions),
    }
    return next((reason for reason, holds in reasons.items() if holds), None)
