"""Impropers, which keep a bead in the plane of its three neighbours or at an angle to it."""

from dataclasses import dataclass

import numpy as np

from ..base.geometry import minimum_images
from .angles import LEAST_SINE2, HarmonicDihedrals, Torsions


class Impropers(Torsions):
    """Base of all kinds of impropers.  Their angle is that of a dihedral unless a kind says otherwise."""

    _BEADS = ("quads", 4, "improper")


@dataclass(frozen=True, eq=False)
class HarmonicImpropers(Impropers):
    """Harmonic impropers, U = k (chi - chi0)^2 (LAMMPS: ``improper_style harmonic``, no factor 1/2).

    chi, from 0 to pi, is the angle between the planes of beads i, j, k and of j, k, l: 0 if i and l are on the same side of j-k.

    Parameters
    ----------
    quads : (K, 4) array of int
        Bead indices i, j, k, l from 0.
    k : energy/angle^2, or (K,) array
        Force constant, kJ/mol/rad^2, >= 0.
    chi0 : angle, or (K,) array
        Rest angle; a bare number is in radians.

    Raises
    ------
    ParameterError
        If shapes differ, a value is out of bounds or an improper names a bead twice.
    """

    quads: np.ndarray
    k: np.ndarray
    chi0: np.ndarray
    _DIMENSIONS = {"k": ("angle_constant", ">= 0"), "chi0": ("angle", "from 0 to pi")}

    def curve(self, phi: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        off = np.abs(phi) - self.chi0
        return self.k * off**2, 2 * self.k * off * np.sign(phi), 2 * self.k


@dataclass(frozen=True, eq=False)
class CosineImpropers(Impropers):
    """Cosine impropers, U = k [1 + d cos(n phi)], phi as of :class:`HarmonicDihedrals` (LAMMPS: ``improper_style cvff``).

    Parameters
    ----------
    quads : (K, 4) array of int
        Bead indices from 0.
    k : energy, or (K,) array
        Force constant, kJ/mol.
    d : 1 or -1, or (K,) array
        Sign: with 1 the energy is highest at n phi = 0.
    n : whole number, or (K,) array
        Periodicity, >= 0.

    Raises
    ------
    ParameterError
        If shapes differ, a value is out of bounds or an improper names a bead twice.
    """

    quads: np.ndarray
    k: np.ndarray
    d: np.ndarray
    n: np.ndarray
    _DIMENSIONS = HarmonicDihedrals._DIMENSIONS
    curve = HarmonicDihedrals.curve  # type: ignore[assignment]  # of the same coefficients


@dataclass(frozen=True, eq=False)
class UmbrellaImpropers(Impropers):
    r"""Umbrellas, U = k/(2 sin^2 omega0) (cos omega - cos omega0)^2, or k (1 - cos omega) if omega0 is 0 (LAMMPS: ``improper_style
    umbrella``; Mayo, Olafson, Goddard, J. Phys. Chem. 94, 8897 (1990), eqs 20, 21).

    omega is the angle of the axis from bead i, the vertex, to bead l with the plane of i, j, k.  It is 0 if l is in the plane and opposite
    to j and k, and over pi/2 if l leans to their side: cos omega changes its sign with that of the sum of the cosines of the angles j, i, l
    and k, i, l.  The energy has a step there unless omega is pi/2.

    Parameters
    ----------
    quads : (K, 4) array of int
        Bead indices from 0, with the vertex first.
    k : energy, or (K,) array
        Force constant, kJ/mol, >= 0.
    omega0 : angle, or (K,) array
        Rest angle, from 0 to less than pi; a bare number is in radians.

    Raises
    ------
    ParameterError
        If shapes differ, a value is out of bounds or an improper names a bead twice.
    """

    quads: np.ndarray
    k: np.ndarray
    omega0: np.ndarray
    _DIMENSIONS = {"k": ("energy", ">= 0"), "omega0": ("angle", "from 0 to less than pi")}

    def _arms(self, x: np.ndarray, box: np.ndarray | None) -> list[np.ndarray]:
        """Vectors (K, 3) from the first bead to the others."""
        return [minimum_images(x[row] - x[self.quads[:, 0]], box) for row in self.quads.T[1:]]

    def gradients(self, x: np.ndarray, box: np.ndarray | None, least: float = LEAST_SINE2) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Angles (K,) in (-pi, pi] at positions x (N, 3), their gradients (K, 4, 3), and the vectors from the first bead to all four."""
        a, b, h = self._arms(x, box)
        length = [np.maximum(np.linalg.norm(v, axis=1), 1e-100)[:, None] for v in (a, b, h)]  # at one point there is no direction
        n = np.cross(a, b)
        size = np.maximum(np.linalg.norm(n, axis=1)[:, None], least**0.5 * length[0] * length[1])
        n, u = n / size, h / length[2]
        sine = np.sum(n * u, axis=1)[:, None]
        cosine = np.linalg.norm(np.cross(n, u), axis=1) * np.where(np.sum(u * (a / length[0] + b / length[1]), axis=1) > 0, -1.0, 1.0)
        by_n = (u - sine * n) / size
        rest = [np.cross(b, by_n), np.cross(by_n, a), (n - sine * u) / length[2]]
        with np.errstate(divide="ignore", invalid="ignore"):
            found = np.stack([-sum(rest), *rest], axis=1) / cosine[:, None, None]
        return np.where(cosine == 0, np.pi / 2, np.arctan2(sine[:, 0], cosine)), found, np.stack([np.zeros_like(a), a, b, h], axis=1)

    def laplacians(self, x: np.ndarray, box: np.ndarray | None) -> np.ndarray:
        """(K, 4) Laplacians of the angles with respect to the beads, 1/nm^2."""
        omega, gradients, _ = self.gradients(x, box)
        a, b, h = self._arms(x, box)
        aa, bb, hh, cc = (np.sum(v * v, axis=1) for v in (a, b, h, a - b))
        nn = np.sum(np.cross(a, b) ** 2, axis=1)
        # those of sin(omega), over it: it turns with j and k about a line, with l about a point, with i about a line away from l
        away = np.cross(np.cross(a, b), b - a)  # in the plane, across j-k, with the length of both
        lean = np.sum(away * (h - a), axis=1) * np.sign(np.sum(away * -a, axis=1))
        with np.errstate(divide="ignore", invalid="ignore"):
            over = np.stack([-(cc + 2 * lean / hh) / nn, -bb / nn, -aa / nn, -2 / hh], axis=1)
        return np.where(nn[:, None] > 0, np.tan(omega)[:, None] * (over + np.sum(gradients**2, axis=2)), 0.0)

    def in_line(self, x: np.ndarray, box: np.ndarray | None) -> np.ndarray:
        """Numbers of the terms whose first three beads are on a line."""
        a, b, _ = self._arms(x, box)
        return np.flatnonzero(np.sum(np.cross(a, b) ** 2, axis=1) <= LEAST_SINE2 * np.sum(a * a, axis=1) * np.sum(b * b, axis=1))

    def curve(self, omega: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        c, s, least = np.cos(omega), np.sin(omega), np.cos(self.omega0)
        bent = self.omega0 > 0
        size = self.k / np.where(bent, np.sin(self.omega0) ** 2, 1.0)
        by_c = np.where(bent, size * (c - least), -size)  # dU/dcos
        energy = np.where(bent, 0.5 * size * (c - least) ** 2, size * (1 - c))
        return energy, -by_c * s, np.where(bent, size, 0.0) * s * s - by_c * c
