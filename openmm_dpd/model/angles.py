"""Angles between two bonds."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ..errors import ParameterError
from .bonds import bead_indices, minimum_images, term_values
from .owned import keep


class _Angles:
    """What all kinds of angles have in common: ``triples`` and coefficients for each of them."""

    triples: np.ndarray
    _DIMENSIONS: dict[str, tuple[str, str]] = {}

    def __post_init__(self):
        keep(self, triples=bead_indices(self.triples, 3, "angle triples"))
        keep(self, **term_values(self, len(self.triples), self._DIMENSIONS, "angle"))

    def arms(self, x: np.ndarray, box: np.ndarray | None) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Angles (radians) at positions x (N, 3), and the lengths (nm) of their arms; (K,) each, by minimum image."""
        i, j, k = self.triples.T
        a, b = minimum_images(x[i] - x[j], box), minimum_images(x[k] - x[j], box)
        theta = np.arctan2(np.linalg.norm(np.cross(a, b), axis=1), np.sum(a * b, axis=1))
        return theta, np.linalg.norm(a, axis=1), np.linalg.norm(b, axis=1)

    def curve(self, theta: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Energy of each angle theta (K,), its first and its second derivative."""
        raise NotImplementedError


@dataclass(frozen=True, eq=False)
class HarmonicAngles(_Angles):
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

    _DIMENSIONS = {"k": ("angle_constant", ">= 0"), "theta0": ("angle", ">= 0")}

    def __post_init__(self):
        super().__post_init__()
        too_wide = np.flatnonzero(self.theta0 > np.pi * (1 + 1e-9))
        if len(too_wide):
            value = self.theta0[too_wide[0]]
            raise ParameterError(
                f"angle theta0 must not be over pi; angle {too_wide[0]} has {value:g} radians (degrees: {value:g} * openmm.unit.degree)"
            )

    def curve(self, theta: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Energy of each angle theta (K,), its first and its second derivative."""
        return self.k * (theta - self.theta0) ** 2, 2 * self.k * (theta - self.theta0), 2 * self.k


@dataclass(frozen=True, eq=False)
class CosineAngles(_Angles):
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
        """Energy of each angle theta (K,), its first and its second derivative."""
        return self.k * (1 + np.cos(theta)), -self.k * np.sin(theta), -self.k * np.cos(theta)


#: Any kind of angles.
Angles = HarmonicAngles | CosineAngles

#: All kinds of angles.
ANGLE_KINDS = (HarmonicAngles, CosineAngles)


def check_angles(groups: Sequence[Angles], n_beads: int) -> None:
    """Raise ParameterError if an angle names a bead that does not exist, or is listed twice."""
    triples = np.concatenate([angles.triples for angles in groups]) if groups else np.zeros((0, 3), dtype=np.int64)
    if triples.size and triples.max() >= n_beads:
        raise ParameterError(f"an angle names bead {triples.max()}, but there are only {n_beads} beads, counted from 0")
    triples = np.where((triples[:, 0] > triples[:, 2])[:, None], triples[:, ::-1], triples)
    different, counts = np.unique(triples, axis=0, return_counts=True)
    if np.any(counts > 1):
        raise ParameterError("the angle of beads {}, {} and {} is listed twice".format(*different[counts > 1][0]))
