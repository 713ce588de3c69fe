"""app.Simulation with what OpenMM leaves out: states of other schemes are refused in plain words, and minimising works through PoCL."""

import io
import logging
import os
from collections.abc import Callable
from xml.etree import ElementTree

import openmm
from openmm import app, unit

from .errors import ParameterError
from .files import write_whole
from .made import variables_number
from .names import BY_VARIABLES
from .serialized import checked_xml, deserialized, read_file

_LOGGER = logging.getLogger("openmm_dpd")


class DPDSimulation(app.Simulation):
    """A Simulation that looks at a state before it takes it over, and writes one whole or not; all else is as always."""

    def saveState(self, file):
        """Save the state as XML, to a file by its name or to an open one.

        Raises
        ------
        OutputError
            If a file cannot be written; one that was there stays, and nothing is left behind.
        """
        _save_whole(super().saveState, file, io.StringIO(), "the state")

    def saveCheckpoint(self, file):
        """Save a checkpoint, to a file by its name or to an open one; OutputError as :meth:`saveState`."""
        _save_whole(super().saveCheckpoint, file, io.BytesIO(), "the checkpoint")

    def loadState(self, file):
        """Load a state in XML, from a file's name or an open file.

        Variables that this integrator does not have, such as the steps of a temperature ramp that another script followed, are left out.

        Raises
        ------
        PlanError
            If it was written by another scheme; nothing is changed then.
        ParameterError
            If it is no State.
        """
        root = checked_xml(read_file(file))
        if root.tag != "State":
            raise ParameterError(f"this is no State: the file holds {root.tag!r}")
        state = deserialized(root)
        made = self.integrator.made
        parameters = state.getParameters() if state.getDataTypes() & state.Parameters else {}
        if made is not None:
            made.check_writer(parameters)
            if _take_unknown_out(root, self.integrator):
                state = deserialized(root)
        self.context.setState(state)
        if BY_VARIABLES in parameters:  # they came by name
            self.context.setParameter(BY_VARIABLES, variables_number(self.integrator))
        self.integrator.settle(self.context)

    def loadCheckpoint(self, file):
        """Load a checkpoint, from a file's name or an open file.

        Raises
        ------
        PlanError
            If it was written by another scheme, or an integrator with other variables; positions and velocities are in the Context then.
        """
        super().loadCheckpoint(file)
        self.integrator.settle(self.context)


def _save_whole(save: Callable, file, content: io.StringIO | io.BytesIO, what: str) -> None:
    """Save to an open file, or by way of ``content`` to one by its name."""
    if not isinstance(file, (str, os.PathLike)):
        save(file)
        return
    save(content)
    write_whole(file, content.getvalue(), what)


def _take_unknown_out(root: ElementTree.Element, integrator: openmm.Integrator) -> bool:
    """Take variables out of a state that a CustomIntegrator does not know; whether there are any."""
    if not isinstance(integrator, openmm.CustomIntegrator):
        return False
    known = {integrator.getGlobalVariableName(k) for k in range(integrator.getNumGlobalVariables())}
    known_per_dof = {integrator.getPerDofVariableName(k) for k in range(integrator.getNumPerDofVariables())}
    single = [(node, name) for node in root.iterfind("IntegratorParameters/GlobalVariables") for name in set(node.attrib) - known]
    per_dof = [(node, child) for node in root.iterfind("IntegratorParameters/PerDofVariables") for child in node]
    per_dof = [(node, child) for node, child in per_dof if child.tag not in known_per_dof]
    for node, name in single:
        del node.attrib[name]
    for node, child in per_dof:
        node.remove(child)
    return bool(single or per_dof)


class PoclSimulation(DPDSimulation):
    """One that minimises on the CPU platform, since OpenMM's minimiser dies of a segmentation fault on OpenCL through PoCL."""

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
