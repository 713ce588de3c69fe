"""Momentum of a set of beads taken out of their velocities: ``velocity zero`` and ``fix momentum``."""

from dataclasses import dataclass

import numpy as np

from ...geometry import weighted_sum


def without_rotation(positions: np.ndarray, velocities: np.ndarray, masses: np.ndarray) -> np.ndarray:
    """(N, 3) velocities without the rotation about the centre of mass; positions on continuous paths."""
    x = positions - weighted_sum(masses, positions) / masses.sum()
    angular = np.sum(masses[:, None] * np.cross(x, velocities), axis=0)
    inertia = np.sum(masses * np.sum(x * x, axis=1)) * np.eye(3) - (masses[:, None] * x).T @ x
    omega = np.linalg.lstsq(inertia, angular, rcond=None)[0]
    return velocities - np.cross(omega, x)


@dataclass(frozen=True)
class MomentumRemoval:
    """What ``fix momentum`` takes out.

    Attributes
    ----------
    every : int
        Interval in steps.
    linear : (3,) tuple of bool
        Components of the momentum.
    angular : bool
        Whether the rotation about the centre of mass goes as well.
    rescale : bool
        Whether the rest is scaled so that the kinetic energy stays.
    """

    every: int
    linear: tuple[bool, bool, bool]
    angular: bool
    rescale: bool

    def applied(self, positions: np.ndarray, velocities: np.ndarray, masses: np.ndarray) -> np.ndarray:
        """(N, 3) velocities of the beads afterwards; positions on continuous paths."""
        v = velocities - np.where(self.linear, weighted_sum(masses, velocities) / masses.sum(), 0.0)
        if self.angular:
            v = without_rotation(positions, v, masses)
        before, after = (np.sum(masses[:, None] * u * u) for u in (velocities, v))
        return v * np.sqrt(before / after) if self.rescale and after > 0 else v
