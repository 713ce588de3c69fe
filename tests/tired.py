"""A force of the user's that fails when it is told to."""

import numpy as np
from openmm import unit


class Tired:
    """It pushes every particle a little along y, or not, and raises when it is called for the k-th time after ``left`` was set to k."""

    def __init__(self, push: float = 0.0):
        self.left, self.push = 0, push

    def __call__(self, state):
        if self.left:
            self.left -= 1
            if not self.left:
                raise RuntimeError("too tired to go on")
        return 0.0 * unit.kilojoule_per_mole, np.tile([0.0, self.push, 0.0], (len(state.getPositions(asNumpy=True)), 1))
