"""Bonds that have no energy beyond some length, other than FENE bonds."""

from dataclasses import dataclass

import numpy as np

from ..base.errors import NONLINEAR_END, QUARTIC_END, out_of_range
from .bonds import Bonds, repulsion_curve


@dataclass(frozen=True, eq=False)
class NonlinearBonds(Bonds):
    """Finitely extensible and compressible bonds, U = epsilon (r - r0)^2/(lamda^2 - (r - r0)^2) (LAMMPS: ``bond_style nonlinear``).

    Parameters
    ----------
    pairs : (B, 2) array of int
        Bead indices from 0.
    epsilon : energy, or (B,) array
        Strength, kJ/mol, >= 0.
    r0 : length, or (B,) array
        Rest length, nm, >= 0.
    lamda : length, or (B,) array
        Largest stretch or compression, nm, > 0.

    Raises
    ------
    ParameterError
        If shapes differ, a value is out of bounds or a bead is bonded to itself.
    """

    pairs: np.ndarray
    epsilon: np.ndarray
    r0: np.ndarray
    lamda: np.ndarray
    _DIMENSIONS = {"epsilon": ("energy", ">= 0"), "r0": ("length", ">= 0"), "lamda": ("length", "> 0")}
    limited = True

    def overstretched(self, x: np.ndarray, box: np.ndarray | None) -> str | None:
        return out_of_range("nonlinear", self.pairs, self.lengths(x, box), self.r0 - self.lamda, self.r0 + self.lamda, NONLINEAR_END)

    def longest(self) -> np.ndarray:
        return self.r0 + self.lamda

    def curve(self, r: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        with np.errstate(divide="ignore", invalid="ignore"):
            square, all_of_it = (r - self.r0) ** 2, self.lamda**2
            rest = all_of_it - square
            slope = 2 * self.epsilon * all_of_it * (r - self.r0) / rest**2
            return self.epsilon * square / rest, slope, 2 * self.epsilon * all_of_it * (all_of_it + 3 * square) / rest**3

    def reach(self, kT: float) -> np.ndarray:
        return self.r0 + self.lamda


@dataclass(frozen=True, eq=False)
class QuarticBonds(Bonds):
    """Bonds that can break, U = k s^2 (s - B1)(s - B2) + U0 with s = r - Rc, and 4 [(1/r)^12 - (1/r)^6] + 1 for r < 2^(1/6) (nm, kJ/mol)
    on top, as in LAMMPS's ``bond_style quartic``.  A bond that gets as long as Rc ends a run: bonds do not change here.

    Parameters
    ----------
    pairs : (B, 2) array of int
        Bead indices from 0.
    k : energy/length^4, or (B,) array
        Force constant, kJ/mol/nm^4, >= 0.
    B1, B2 : length, or (B,) array
        Zeros of the quartic, relative to Rc, nm.
    Rc : length, or (B,) array
        Length at which the bond breaks, nm, > 0.
    U0 : energy, or (B,) array
        Energy at Rc, kJ/mol.

    Raises
    ------
    ParameterError
        If shapes differ, a value is out of bounds or a bead is bonded to itself.
    """

    pairs: np.ndarray
    k: np.ndarray
    B1: np.ndarray
    B2: np.ndarray
    Rc: np.ndarray
    U0: np.ndarray
    _DIMENSIONS = {
        **{"k": ("quartic_constant", ">= 0"), "B1": ("length", ""), "B2": ("length", "")},
        **{"Rc": ("length", "> 0"), "U0": ("energy", "")},
    }
    limited = True

    def overstretched(self, x: np.ndarray, box: np.ndarray | None) -> str | None:
        return out_of_range("quartic", self.pairs, self.lengths(x, box), -self.Rc, self.Rc, QUARTIC_END)

    def longest(self) -> np.ndarray:
        return self.Rc

    def curve(self, r: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        s, sum_, product = r - self.Rc, self.B1 + self.B2, self.B1 * self.B2
        first = s * (4 * s * s - 3 * sum_ * s + 2 * product)
        rows = (self.k * part for part in (s * s * (s * s - sum_ * s + product), first, 12 * s * s - 6 * sum_ * s + 2 * product))
        with np.errstate(divide="ignore", invalid="ignore"):
            energy, slope, curvature = (part + more for part, more in zip(rows, repulsion_curve(r, 1.0, 1.0), strict=True))
        return energy + self.U0, slope, curvature

    def reach(self, kT: float) -> np.ndarray:
        return self.Rc
