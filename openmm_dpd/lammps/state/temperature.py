"""Temperatures: what computes of style temp, temp/partial and temp/profile count of the velocities."""

import math
from dataclasses import dataclass

import numpy as np

from .box import Box


@dataclass(frozen=True)
class Temperature:
    """Settings of a compute of temperature.

    Attributes
    ----------
    counted : three bools
        Components of the velocities that count.
    streaming : three bools
        Components from which the mean of the bin, weighted by mass, is taken off.
    bins : three ints
        Numbers of bins along x, y and z.
    table : bool
        Whether the compute has a table of the bins (``out bin``) instead of a vector.
    extra : float
        Degrees of freedom of all beads together that do not count (``compute_modify extra/dof``).
    """

    counted: tuple[bool, bool, bool] = (True, True, True)
    streaming: tuple[bool, bool, bool] = (False, False, False)
    bins: tuple[int, int, int] = (1, 1, 1)
    table: bool = False
    extra: float = 3.0

    @property
    def count(self) -> int:
        """Number of bins."""
        return math.prod(self.bins)

    def freedom(self, n: int) -> float:
        """Degrees of freedom of n beads."""
        counted = sum(self.counted)
        return counted * n - counted / 3 * self.extra - sum(self.streaming) * self.count

    def numbers(self, box: Box, positions: np.ndarray) -> np.ndarray:
        """(N,) bin of each bead, those along x one after the other; positions in the box."""
        low, edges = (0.0, 1.0) if box.triclinic else (box.low, box.edges)
        x = box.fractions(positions) if box.triclinic else positions
        cells = ((x - low) * (np.array(self.bins) / edges)).astype(np.int64)
        return np.clip(cells, 0, np.array(self.bins) - 1) @ np.array([1, self.bins[0], self.bins[0] * self.bins[1]])

    def thermal(self, velocities: np.ndarray, masses: np.ndarray, numbers: np.ndarray | None) -> np.ndarray:
        """(N, 3) what counts of velocities; ``numbers`` are the bins, needed where something streams."""
        if numbers is not None and any(self.streaming):
            momentum = np.zeros((self.count, 3))
            np.add.at(momentum, numbers, masses[:, None] * velocities)
            mean = momentum[numbers] / np.bincount(numbers, masses, self.count)[numbers, None]
            velocities = velocities - np.where(self.streaming, mean, 0.0)
        return velocities if all(self.counted) else np.where(self.counted, velocities, 0.0)
