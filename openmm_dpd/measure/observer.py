"""Measured quantities of a running Context.

Kinetic temperature: 2K over the degrees of freedom of the beads that move, 3N - 3 where momentum is conserved.  Configurational:
<|grad U|^2>/<lap U>, a ratio of averages, which shows errors of the configurations that a thermostat hides from the kinetic one (Rugh,
Phys. Rev. Lett. 78, 772 (1997); Allen, J. Phys. Chem. B 110, 3823 (2006)).  Pressure: (2K + W)/(3V) with the virial W = sum over pairs of
r_ij . F_ij.  OpenMM's own reporters use 3N degrees of freedom, kelvin, and no pair term.
"""

from typing import Any

import numpy as np
import openmm
from openmm import unit

from ..base.errors import ParameterError, RunError, what_is
from ..base.names import KT
from ..plan.host import Freedom
from ..simulation.built import BuiltSystem
from .sample import SystemSample
from .scene_samples import SceneSampler
from .temperature import check_context


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


class Observer:
    """Takes samples from a Context that runs something this package has built.

    Parameters
    ----------
    built : BuiltSystem
        What :func:`openmm_dpd.build`, :func:`openmm_dpd.add_thermostat` or :func:`openmm_dpd.create_mixed_system` returned.  Of a
        scene it gives a :class:`Sample`, with every term; beside the forces of a System made elsewhere a :class:`SystemSample`, with
        what any System has.

    Raises
    ------
    ParameterError
        If it is something else, a Simulation say.
    """

    def __init__(self, built: BuiltSystem):
        require_built(built, "an Observer")
        self.built, self.plan = built, built.plan
        self._sampler = SceneSampler(built) if built.plan.host is None else SystemSampler(built)

    @property
    def no_laplacian(self) -> str | None:
        """Why there is no configurational temperature, or None."""
        return self._sampler.no_laplacian

    @property
    def uncounted(self) -> str | None:
        """Names of forces that do not count in virials and pressures, because somebody else added them to the System; None without any."""
        return self._sampler.uncounted

    def sample(self, context: openmm.Context) -> Any:
        """Measure the present state of a Context: a :class:`Sample` of a scene, a :class:`SystemSample` of a System made elsewhere."""
        check_context(context)
        present, made = context.getSystem().getNumParticles(), self.built.system.getNumParticles()
        if present != made:
            raise ParameterError(f"the Context has {present} particles, but this Observer is for a System of {made}")
        return self._sampler.sample(context)


def require_built(built, what: str) -> None:
    """Raise ParameterError if this is not what the package has built."""
    if not isinstance(built, BuiltSystem):
        raise ParameterError(
            f"{what} wants as built what openmm_dpd.build(), add_thermostat() or create_mixed_system() returned, not {what_is(built)}"
        )
