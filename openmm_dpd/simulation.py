"""An app.Simulation for OpenCL through PoCL, where OpenMM's energy minimiser dies of a segmentation fault."""

from __future__ import annotations

import logging

import openmm
from openmm import app, unit

_LOGGER = logging.getLogger("openmm_dpd")


class PoclSimulation(app.Simulation):
    """A Simulation that minimises on the CPU platform; all else is as always."""

    def minimizeEnergy(self, tolerance=10 * unit.kilojoules_per_mole / unit.nanometer, maxIterations=0, reporter=None):
        """As in OpenMM, in a Context of its own that hands the positions back; velocities stay what they are."""
        _LOGGER.warning("minimising on the CPU platform: OpenMM's minimiser crashes on OpenCL through PoCL")
        integrator = openmm.VerletIntegrator(0.001)
        integrator.setIntegrationForceGroups(self.integrator.getIntegrationForceGroups())
        here = openmm.Context(self.system, integrator, openmm.Platform.getPlatformByName("CPU"))
        state = self.context.getState(positions=True, parameters=True)
        here.setPeriodicBoxVectors(*state.getPeriodicBoxVectors())
        for name, value in state.getParameters().items():
            here.setParameter(name, value)
        here.setPositions(state.getPositions(asNumpy=True))
        openmm.LocalEnergyMinimizer.minimize(here, tolerance, maxIterations, reporter)
        self.context.setPositions(here.getState(positions=True).getPositions(asNumpy=True))


__all__ = ["PoclSimulation"]
