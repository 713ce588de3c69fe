"""Velocities over time: a file beside the trajectory, since DCD and XTC files have none."""

import os

import numpy as np
from openmm import unit

from ..cadence import Cadence
from ..field_file import FieldWriter


class VelocityReporter(Cadence):
    """Writes velocities to a file, for ``simulation.reporters``; give it the interval of the trajectory, and frames match.

    Parameters
    ----------
    file : str or path
        ``velocities.npz``, say: a zip archive with an array for each frame.
    interval : int
        Steps between frames.
    """

    _INCLUDE = ("velocities",)

    def __init__(self, file: str | os.PathLike, interval: int):
        super().__init__(interval)
        self._writer = FieldWriter(file)

    def report(self, simulation, state):
        """Write one frame."""
        velocities = state.getVelocities(asNumpy=True).value_in_unit(unit.nanometer / unit.picosecond)
        time = state.getTime().value_in_unit(unit.picosecond)
        self._writer.write(time, simulation.currentStep, {"velocities": velocities.astype(np.float32)})
