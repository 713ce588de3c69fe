"""Angles between two bonds, and dihedral angles about the middle of three bonds."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ..base.geometry import minimum_images
from .bonds import BondedTerms, check_members


class Angles(BondedTerms):
    """Base of all kinds of angles."""

    triples: np.ndarray
    _BEADS = ("triples", 3, "angle")

    def arms(self, x: np.ndarray, box: np.ndarray | None) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Angles (rad) and lengths (nm) of their two arms at positions x (N, 3), (K,) each, by minimum image."""
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
        Bead indices from 0, with the vertex in the middle.
    k : energy/angle^2, or (K,) array
        Force constant, kJ/mol/rad^2, >= 0.
    theta0 : angle, or (K,) array
        Rest angle; a bare number is in radians.

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
    """Bending stiffness, U = k (1 + cos theta), with its minimum for collinear bonds (LAMMPS: ``angle_style cosine``).

    Parameters
    ----------
    triples : (K, 3) array of int
        Bead indices from 0, with the vertex in the middle.
    k : energy, or (K,) array
        Stiffness, kJ/mol, >= 0.

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


@dataclass(frozen=True, eq=False)
class CosineDeltaAngles(Angles):
    """U = k [1 - cos(theta - theta0)] (LAMMPS: ``angle_style cosine/delta``).

    Parameters
    ----------
    triples : (K, 3) array of int
        Bead indices from 0, with the vertex in the middle.
    k : energy, or (K,) array
        Stiffness, kJ/mol, >= 0.
    theta0 : angle, or (K,) array
        Rest angle; a bare number is in radians.

    Raises
    ------
    ParameterError
        If shapes differ, a value is out of bounds or an angle names a bead twice.
    """

    triples: np.ndarray
    k: np.ndarray
    theta0: np.ndarray
    _DIMENSIONS = {"k": ("energy", ">= 0"), "theta0": ("angle", "from 0 to pi")}

    def curve(self, theta: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        bend = theta - self.theta0
        return self.k * (1 - np.cos(bend)), self.k * np.sin(bend), self.k * np.cos(bend)


@dataclass(frozen=True, eq=False)
class CosineSquaredAngles(Angles):
    """U = k (cos theta - cos theta0)^2 (LAMMPS: ``angle_style cosine/squared``).

    Parameters
    ----------
    triples : (K, 3) array of int
        Bead indices from 0, with the vertex in the middle.
    k : energy, or (K,) array
        Stiffness, kJ/mol, >= 0.
    theta0 : angle, or (K,) array
        Rest angle; a bare number is in radians.

    Raises
    ------
    ParameterError
        If shapes differ, a value is out of bounds or an angle names a bead twice.
    """

    triples: np.ndarray
    k: np.ndarray
    theta0: np.ndarray
    _DIMENSIONS = {"k": ("energy", ">= 0"), "theta0": ("angle", "from 0 to pi")}

    def curve(self, theta: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        off, sine = np.cos(theta) - np.cos(self.theta0), np.sin(theta)
        return self.k * off**2, -2 * self.k * off * sine, 2 * self.k * (sine**2 - off * np.cos(theta))


@dataclass(frozen=True, eq=False)
class PeriodicAngles(Angles):
    """U = 2 C/n^2 [1 - B (-1)^n cos(n theta)] (LAMMPS: ``angle_style cosine/periodic``).

    Parameters
    ----------
    triples : (K, 3) array of int
        Bead indices from 0, with the vertex in the middle.
    C : energy, or (K,) array
        Stiffness, kJ/mol, >= 0.
    B : 1 or -1, or (K,) array
        Sign: with 1 the energy is least at pi, with -1 it is highest there.
    n : whole number, or (K,) array
        Periodicity, > 0.

    Raises
    ------
    ParameterError
        If shapes differ, a value is out of bounds or an angle names a bead twice.
    """

    triples: np.ndarray
    C: np.ndarray
    B: np.ndarray
    n: np.ndarray
    _DIMENSIONS = {"C": ("energy", ">= 0"), "B": ("dimensionless", "1 or -1"), "n": ("dimensionless", "a whole number > 0")}

    def curve(self, theta: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        size, wave = 2 * self.C / self.n**2, self.B * (-1) ** self.n * np.cos(self.n * theta)
        return size * (1 - wave), size * self.n * self.B * (-1) ** self.n * np.sin(self.n * theta), size * self.n**2 * wave


def check_angles(groups: Sequence[Angles], n_beads: int) -> None:
    """Raise ParameterError if an angle names a bead that does not exist, or is listed twice."""
    triples = np.concatenate([angles.triples for angles in groups]) if groups else np.zeros((0, 3), dtype=np.int64)
    triples = np.where((triples[:, 0] > triples[:, 2])[:, None], triples[:, ::-1], triples)
    check_members(triples, n_beads, "an angle", "the angle of")


#: Smallest squared sine between two bonds to divide by in the gradient of a dihedral: collinear bonds define no plane.
LEAST_SINE2 = 1e-12


class Torsions(BondedTerms):
    """Base of all kinds of dihedrals and impropers.  The angle of beads i, j, k, l is pi if i and l are on opposite sides of j-k (trans),
    and positive if l, seen along j-k, is clockwise of i."""

    quads: np.ndarray

    def gradients(self, x: np.ndarray, box: np.ndarray | None, least: float = LEAST_SINE2) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Angles (K,) in (-pi, pi] at positions x (N, 3), their gradients (K, 4, 3), and the vectors from the second bead to all four
        (K, 4, 3), by minimum image; ``least`` is a lower bound of the squared sine between two bonds."""
        i, j, k, m = self.quads.T
        f, g, h = minimum_images(x[i] - x[j], box), minimum_images(x[j] - x[k], box), minimum_images(x[m] - x[k], box)
        a, b, gg = np.cross(f, g), np.cross(h, g), np.sum(g * g, axis=1)
        length = np.sqrt(gg)
        phi = np.arctan2(length * np.sum(h * a, axis=1), np.sum(a * b, axis=1))
        with np.errstate(divide="ignore", invalid="ignore"):
            squares = (np.maximum(np.sum(n * n, axis=1), least * np.sum(arm * arm, axis=1) * gg) for n, arm in ((a, f), (b, h)))
            first, last = (np.where((square > 0)[:, None], n / square[:, None], 0.0) for n, square in zip((a, b), squares, strict=True))
            along = [np.where(gg > 0, np.sum(arm * g, axis=1) / length, 0.0)[:, None] for arm in (f, h)]
        at_i, at_m = -length[:, None] * first, length[:, None] * last
        turn = along[0] * first - along[1] * last
        found = np.stack([at_i, -at_i + turn, -at_m - turn, at_m], axis=1)
        return phi, found, np.stack([f, np.zeros_like(f), -g, h - g], axis=1)

    def laplacians(self, x: np.ndarray, box: np.ndarray | None) -> np.ndarray:
        """(K, 4) Laplacians of the angles with respect to the beads, 1/nm^2."""
        return np.zeros(self.quads.shape)

    def in_line(self, x: np.ndarray, box: np.ndarray | None) -> np.ndarray:
        """Numbers of the terms with three successive beads on a line, which define no plane."""
        arms = self.gradients(x, box)[2]
        f, g, h = arms[:, 0], arms[:, 2], arms[:, 3] - arms[:, 2]
        square = [np.sum(np.cross(arm, g) ** 2, axis=1) - LEAST_SINE2 * np.sum(arm * arm, axis=1) * np.sum(g * g, axis=1) for arm in (f, h)]
        return np.flatnonzero(np.minimum(*square) <= 0.0)

    def reach(self, kT: float) -> np.ndarray:
        return np.full(len(self.quads), 2 * np.pi)

    def density(self, phi: np.ndarray) -> np.ndarray:
        return np.ones_like(phi)


class Dihedrals(Torsions):
    """Base of all kinds of dihedrals."""

    _BEADS = ("quads", 4, "dihedral")


@dataclass(frozen=True, eq=False)
class HarmonicDihedrals(Dihedrals):
    """Cosine dihedrals, U = k [1 + d cos(n phi)] (LAMMPS: ``dihedral_style harmonic``).  Several on the same beads add up.

    Parameters
    ----------
    quads : (K, 4) array of int
        Bead indices from 0 along the three bonds.
    k : energy, or (K,) array
        Force constant, kJ/mol.
    d : 1 or -1, or (K,) array
        Sign: with 1 the energy is highest at n phi = 0.
    n : whole number, or (K,) array
        Periodicity, >= 0.

    Raises
    ------
    ParameterError
        If shapes differ, a value is out of bounds or a dihedral names a bead twice.
    """

    quads: np.ndarray
    k: np.ndarray
    d: np.ndarray
    n: np.ndarray
    _DIMENSIONS = {"k": ("energy", ""), "d": ("dimensionless", "1 or -1"), "n": ("dimensionless", "a whole number >= 0")}

    def curve(self, phi: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        size, cosine = self.k * self.d, np.cos(self.n * phi)
        return self.k + size * cosine, -size * self.n * np.sin(self.n * phi), -size * self.n**2 * cosine


@dataclass(frozen=True, eq=False)
class OPLSDihedrals(Dihedrals):
    """U = 1/2 {K1 [1 + cos phi] + K2 [1 - cos 2 phi] + K3 [1 + cos 3 phi] + K4 [1 - cos 4 phi]} (LAMMPS: ``dihedral_style opls``).

    Parameters
    ----------
    quads : (K, 4) array of int
        Bead indices from 0 along the three bonds.
    K1, K2, K3, K4 : energy, or (K,) array
        Coefficients, kJ/mol.

    Raises
    ------
    ParameterError
        If shapes differ or a dihedral names a bead twice.
    """

    quads: np.ndarray
    K1: np.ndarray
    K2: np.ndarray
    K3: np.ndarray
    K4: np.ndarray
    _DIMENSIONS = {name: ("energy", "") for name in ("K1", "K2", "K3", "K4")}

    def curve(self, phi: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        waves = [(n, sign * 0.5 * size) for n, sign, size in ((1, 1, self.K1), (2, -1, self.K2), (3, 1, self.K3), (4, -1, self.K4))]
        energy = 0.5 * (self.K1 + self.K2 + self.K3 + self.K4) + sum(size * np.cos(n * phi) for n, size in waves)
        return energy, -sum(n * size * np.sin(n * phi) for n, size in waves), -sum(n * n * size * np.cos(n * phi) for n, size in waves)


@dataclass(frozen=True, eq=False)
class MultiHarmonicDihedrals(Dihedrals):
    r"""U = A1 + A2 cos phi + A3 cos^2 phi + A4 cos^3 phi + A5 cos^4 phi (LAMMPS: ``dihedral_style multi/harmonic``).

    The Ryckaert-Bellemans function measures its angle from trans: :math:`A_n = (-1)^{n-1} C_{n-1}`.

    Parameters
    ----------
    quads : (K, 4) array of int
        Bead indices from 0 along the three bonds.
    A1, A2, A3, A4, A5 : energy, or (K,) array
        Coefficients, kJ/mol.

    Raises
    ------
    ParameterError
        If shapes differ or a dihedral names a bead twice.
    """

    quads: np.ndarray
    A1: np.ndarray
    A2: np.ndarray
    A3: np.ndarray
    A4: np.ndarray
    A5: np.ndarray
    _DIMENSIONS = {name: ("energy", "") for name in ("A1", "A2", "A3", "A4", "A5")}

    def curve(self, phi: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        c, s = np.cos(phi), np.sin(phi)
        energy = self.A1 + c * (self.A2 + c * (self.A3 + c * (self.A4 + c * self.A5)))
        first = self.A2 + c * (2 * self.A3 + c * (3 * self.A4 + c * 4 * self.A5))
        return energy, -s * first, s * s * (2 * self.A3 + c * (6 * self.A4 + c * 12 * self.A5)) - c * first


def check_torsions(groups: Sequence[Torsions], n_beads: int) -> None:
    """Raise ParameterError if a dihedral or improper names a bead that does not exist.  Several of the same beads add up."""
    for group in groups:
        what = group._BEADS[2]
        check_members(group.quads, n_beads, f"a{'n' * (what == 'improper')} {what}")
