"""Equations of state: the internal energy u of a bead and its internal temperature theta.

theta is k_B times the internal temperature, a thermal energy in kJ/mol.  Heat capacities are in units of k_B, so u = C theta needs no
constants.  The entropy, in units of k_B, is S(u) = integral du/theta(u).
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import scipy
from openmm import unit

from ..base.errors import ParameterError, what_is
from ..base.units import BOLTZMANN, keep, thermal_energies, to_md


def heat_capacity(value, name: str):
    """Heat capacity in units of k_B, from a bare number or a Quantity (energy/temperature)."""
    if unit.is_quantity(value) and not value.unit.is_compatible(unit.dimensionless):
        per_kelvin = unit.kilojoule_per_mole / unit.kelvin
        if not value.unit.is_compatible(per_kelvin):
            raise ParameterError(f"{name} has the unit {value.unit}, which is not a heat capacity; expected a unit such as {per_kelvin}")
        value = value.value_in_unit(per_kelvin) / BOLTZMANN
    return to_md(value, "dimensionless", name)


@dataclass(frozen=True)
class ConstantHeatCapacity:
    r"""Equation of state u = C theta, S(u) = C ln u (LAMMPS: ``fix eos/cv``).

    Parameters
    ----------
    capacity : float
        Heat capacity of a bead in units of k_B (or a Quantity, energy/temperature), > 0.

    Raises
    ------
    ParameterError
        If the heat capacity is not a number > 0.
    """

    capacity: float

    def __post_init__(self):
        capacity = heat_capacity(self.capacity, "capacity")
        if not isinstance(capacity, float) or capacity <= 0:
            raise ParameterError(f"the heat capacity of a bead must be a single number > 0, but is {what_is(self.capacity)}")
        keep(self, capacity=capacity)

    def energy(self, theta):
        """Internal energy at internal temperature theta, kJ/mol."""
        return self.capacity * np.asarray(theta)

    def theta(self, u):
        """Internal temperature theta at internal energy u, kJ/mol."""
        return np.asarray(u) / self.capacity

    def __str__(self) -> str:
        return f"u = {self.capacity:g} theta"


@dataclass(frozen=True, eq=False)
class TabulatedEOS:
    r"""Equation of state through given points (theta_k, u_k) (LAMMPS: ``fix eos/table``).

    1/theta is interpolated as a function of u by a monotone cubic (Fritsch and Carlson, SIAM J. Numer. Anal. 17, 238 (1980); scipy's
    ``PchipInterpolator``).  So theta(u) passes through the points and increases between them, and the entropy S = integral du/theta is
    exactly the integral of the interpolant, as the exact schemes need it.  LAMMPS resamples a table twice (through a spline with end
    slopes of zero) and interpolates linearly; the two agree at the points of the table.

    Parameters
    ----------
    thetas : (K,) array
        Internal temperatures theta, kJ/mol (or a Quantity in kelvin), > 0, increasing; K >= 2.
    energies : (K,) array of energies
        Internal energies of a bead at these thetas, kJ/mol, increasing.

    Raises
    ------
    ParameterError
        If lengths differ, or a column does not increase; the message names the entry.
    """

    thetas: np.ndarray
    energies: np.ndarray

    def __post_init__(self):
        theta = np.atleast_1d(thermal_energies(self.thetas, "thetas of the table"))
        u = np.atleast_1d(to_md(self.energies, "energy", "energies of the table"))
        if theta.ndim != 1 or theta.shape != u.shape or len(u) < 2:
            raise ParameterError(f"an equation of state needs as many energies as thetas, at least 2; got {len(u)} and {len(theta)}")
        if theta[0] <= 0:
            raise ParameterError(f"the thetas of an equation of state must be > 0, but the first is {theta[0]:g}")
        for name, column in (("thetas", theta), ("energies", u)):
            flat = np.flatnonzero(np.diff(column) <= 0)
            if len(flat):
                k = int(flat[0])
                raise ParameterError(
                    f"the {name} of an equation of state must increase; entry {k + 2} ({column[k + 1]:g}) "
                    f"is not above entry {k + 1} ({column[k]:g})"
                )
        keep(self, thetas=theta, energies=u)

    @classmethod
    def from_functions(
        cls, energy: Callable, thetas: tuple[float, float], inverse: Callable | None = None, points: int = 2001
    ) -> TabulatedEOS:
        """Tabulate a function u(theta) between two thetas.

        Parameters
        ----------
        energy : callable
            u(theta) for arrays of thermal energies, in and out in kJ/mol.
        thetas : (low, high)
            Range of theta, > 0, kJ/mol or a Quantity in kelvin; a bead outside of it stops the run.
        inverse : callable, optional
            theta(u), for a check only: it must invert ``energy`` to 1e-6.
        points : int, default 2001
            Number of entries, evenly spaced in 1/theta, the interpolated quantity.
        """
        low, high = (float(np.asarray(thermal_energies(value, "thetas"))) for value in thetas)
        if not 0 < low < high:
            raise ParameterError(f"the range of thetas must be 0 < low < high, not {low:g} to {high:g}")
        theta = 1.0 / np.linspace(1.0 / low, 1.0 / high, points)
        u = np.broadcast_to(np.asarray(energy(theta), dtype=np.float64), theta.shape)
        if inverse is not None:
            back = np.asarray(inverse(u), dtype=np.float64)
            worst = int(np.argmax(np.abs(back / theta - 1)))
            if not np.allclose(back, theta, rtol=1e-6, atol=0):
                raise ParameterError(
                    f"inverse does not invert energy: theta = {theta[worst]:g} has u = {u[worst]:g}, which has theta = {back[worst]:g}"
                )
        return cls(theta, u)

    @property
    def inverse_temperature(self) -> scipy.interpolate.PchipInterpolator:
        """1/theta as a function of u."""
        return scipy.interpolate.PchipInterpolator(self.energies, 1.0 / self.thetas, extrapolate=False)

    def theta(self, u):
        """Internal temperature theta at internal energy u, kJ/mol; NaN out of range."""
        return 1.0 / self.inverse_temperature(u)

    def energy(self, theta):
        """Internal energy at internal temperature theta, kJ/mol; NaN out of range."""
        theta = np.asarray(theta, dtype=np.float64)
        flat = np.atleast_1d(theta)
        curve = self.inverse_temperature
        low, high = np.full(flat.shape, self.energies[0]), np.full(flat.shape, self.energies[-1])
        for _ in range(200):  # bisection to the last bit, once per bead and run
            middle = 0.5 * (low + high)
            below = curve(middle) > 1.0 / flat
            low, high = np.where(below, middle, low), np.where(below, high, middle)
        # points of the table return exactly their energies
        exact = np.searchsorted(self.thetas, flat).clip(0, len(self.thetas) - 1)
        found = np.where(self.thetas[exact] == flat, self.energies[exact], 0.5 * (low + high))
        return np.where((flat < self.thetas[0]) | (flat > self.thetas[-1]), np.nan, found).reshape(theta.shape)

    def __str__(self) -> str:
        return f"table of {len(self.energies)} points, theta = {self.thetas[0]:g} to {self.thetas[-1]:g}"


EquationOfState = ConstantHeatCapacity | TabulatedEOS
