"""Angles between two bonds."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ..base.geometry import minimum_images
from .bonds import BondedTerms, check_members


class Angles(BondedTerms):
    """Angles of any kind."""

    triples: np.ndarray
    _BEADS = ("triples", 3, "angle")

    def arms(self, x: np.ndarray, box: np.ndarray | None) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Angles (radians) at positions x (N, 3), and the lengths (nm) of their arms; (K,) each, by minimum image."""
        i, j, k = self.triples.T
        a, b = minimum_images(x[i] - x[j], box), minimum_images(x[k] - x[j], box)
        theta = np.arctan2(np.linalg.norm(np.cross(a, b), axis=1), np.sum(a * b, axis=1))
        return theta, np.linalg.norm(a, axis=1), np.linalg.norm(b, axis=1)

    def reach(self, kT: float) -> np.ndarray:
        return np.full(len(self.triples), np.pi)

    def density(self, theta: np.ndarray) -> np.ndarray:
        return np.sin(theta)


@dataclass(frozen=True, eq=False)
class HarmonicAngles(Angles):
    """Harmonic angles, U = k (theta - theta0)^2 (LAMMPS's convention: no factor 1/2).

    Parameters
    ----------
    triples : (K, 3) array of int
        Bead indices, counted from 0, the vertex in the middle.
    k : energy/angle^2, or (K,) array
        kJ/mol/rad^2, >= 0.
    theta0 : angle, or (K,) array
        Rest angle; bare numbers are radians.

    Raises
    ------
    ParameterError
        If shapes differ, a value is out of bounds or an angle names a bead twice.
    """

    triples: np.ndarray
    k: np.ndarray
    theta0: np.ndarray
    _DIMENSIONS = {"k": ("angle_constant", ">= 0"), "theta0": ("angle", "from 0 to pi")}

    def curve(self, theta: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        return self.k * (theta - self.theta0) ** 2, 2 * self.k * (theta - self.theta0), 2 * self.k


@dataclass(frozen=True, eq=False)
class CosineAngles(Angles):
    """Bending stiffness, U = k (1 + cos theta): least where the two bonds are in line (LAMMPS: ``angle_style cosine``).

    Parameters
    ----------
    triples : (K, 3) array of int
        Bead indices, counted from 0, the vertex in the middle.
    k : energy, or (K,) array
        kJ/mol, >= 0.

    Raises
    ------
    ParameterError
        If shapes differ, a value is out of bounds or an angle names a bead twice.
    """

    triples: np.ndarray
    k: np.ndarray
    _DIMENSIONS = {"k": ("energy", ">= 0")}

    def curve(self, theta: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        return self.k * (1 + np.cos(theta)), -self.k * np.sin(theta), -self.k * np.cos(theta)


def check_angles(groups: Sequence[Angles], n_beads: int) -> None:
    """Raise ParameterError if an angle names a bead that does not exist, or is listed twice."""
    triples = np.concatenate([angles.triples for angles in groups]) if groups else np.zeros((0, 3), dtype=np.int64)
    triples = np.where((triples[:, 0] > triples[:, 2])[:, None], triples[:, ::-1], triples)
    check_members(triples, n_beads, "an angle", "the angle of")
