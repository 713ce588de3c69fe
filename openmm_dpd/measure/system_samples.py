"""Samples of a System made elsewhere, alone or with beads in it."""

import numpy as np
import openmm
from openmm import unit

from ..base.errors import RunError
from ..base.names import KT
from ..plan.host import Freedom
from ..simulation.built import BuiltSystem
from .sample import SystemSample


class SystemSampler:
    """Temperatures, energies and momentum of all particles of a System."""

    no_laplacian = "the forces of a System made elsewhere have no Laplacian here"
    uncounted = None

    def __init__(self, built: BuiltSystem):
        self.built, self.plan = built, built.plan
        self._freedom = Freedom(built.system, built.plan.n_atoms)

    def sample(self, context: openmm.Context) -> SystemSample:
        """Measure the present state of a Context."""
        plan, mass = self.plan, self._freedom.mass
        state = context.getState(velocities=True, energy=True, groups=self.built.integrator.getIntegrationForceGroups())
        v = state.getVelocities(asNumpy=True).value_in_unit(unit.nanometer / unit.picosecond)
        potential = state.getPotentialEnergy().value_in_unit(unit.kilojoule_per_mole)
        if not (np.isfinite(potential) and np.all(np.isfinite(v))):
            raise RunError(f"the energy or a velocity is not finite at step {state.getStepCount()}; the step size may be too large")
        kT = self._freedom.kinetic_kT(v)
        box = None if plan.scene.box is None else state.getPeriodicBoxVectors(asNumpy=True).value_in_unit(unit.nanometer)
        return SystemSample(
            step=state.getStepCount(),
            time=state.getTime().value_in_unit(unit.picosecond),
            n_mobile=int(np.sum(mass > 0)),
            dof=int(self._freedom.shares["all"]),
            kinetic=0.5 * float(mass @ np.sum(v**2, axis=1)),
            potential=potential,
            volume=None if box is None else float(np.prod(np.diag(box))),
            box=box,
            momentum=mass @ v,
            target_kT=context.getParameter(KT) if KT in context.getParameters() else plan.options.kT,
            kT_atoms=kT["atoms"],
            kT_beads=kT["beads"] if len(mass) > plan.n_atoms else None,
        )
