"""Equations of state of a one-component fluid of soft beads, and the repulsion for a given compressibility.

Reduced units, rc = kT = 1: A stands for A rc/kT, the density for beads per rc^3 and the pressure for p rc^3/kT."""

from collections.abc import Callable
from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from scipy.interpolate import RectBivariateSpline
from scipy.optimize import brentq

from ..base.errors import ParameterError, require_one
from .estimate import Bounds, Estimate, outside, reduced_number, shipped_rows

#: Coefficients of B2/A and of the dense limit: eqs 10 and 14 of Liyana-Arachchi et al.
_B2 = (9.755e-2, -4.912e-3, 1.556e-4, -2.585e-6, 1.705e-8)
_DENSE = (0.0802, 0.7787)
#: Relative error of pressures between points of the measured table above a density, that density, and the error below: docs/validation.md.
_BETWEEN, _SPARSE, _SPARSE_ERROR = 1e-3, 2.5, 3e-3
#: Factor by which the relative error of a slope is larger: points of the table are a factor 1.2 apart in density.
_STEEP = 10.0


@dataclass(frozen=True)
class _Equation:
    """p = rho + alpha A rho^2: alpha and its derivative with respect to density, as functions of density and A."""

    alpha: Callable[[float, float], float]
    slope: Callable[[float, float], float]
    source: str
    bounds: Bounds
    measured: bool

    def relative_error(self, density: float) -> float | None:
        """Relative error of a pressure, or None if unknown."""
        return None if not self.measured else _BETWEEN if density >= _SPARSE else _SPARSE_ERROR


@dataclass(frozen=True)
class _Surface:
    """Spline through a column of the table, over ln(density) and ln(A)."""

    spline: RectBivariateSpline

    def __call__(self, density: float, A: float) -> float:
        return float(self.spline(np.log(density), np.log(A))[0, 0])

    def slope(self, density: float, A: float) -> float:
        """Derivative with respect to density; 0 outside of the table, where the spline is constant."""
        knots = self.spline.get_knots()[0]
        if not knots[0] <= np.log(density) <= knots[-1]:
            return 0.0
        return float(self.spline(np.log(density), np.log(A), dx=1)[0, 0]) / density


@dataclass(frozen=True)
class _Measured:
    alpha: _Surface
    overlap: _Surface
    bounds: Bounds


@lru_cache(maxsize=1)
def _table() -> _Measured:
    """The measured table of pressures and energies."""
    rows = np.array(shipped_rows("pressures"))
    densities, repulsions = np.unique(rows[:, 0]), np.unique(rows[:, 1])
    density, A, p, _, u, _ = rows.T.reshape(6, len(densities), len(repulsions))

    def surface(values: np.ndarray) -> _Surface:
        return _Surface(RectBivariateSpline(np.log(densities), np.log(repulsions), values))

    bounds = {"density": (float(densities[0]), float(densities[-1])), "A": (float(repulsions[0]), float(repulsions[-1]))}
    return _Measured(surface((p - density) / (A * density**2)), surface(2 * u / A), bounds)


def _b2(A: float) -> float:
    return float(np.polynomial.polynomial.polyval(A, _B2))


def _dense_alpha(density: float, A: float) -> float:
    c, d = _DENSE
    return _b2(A) / (1 + density**3) + c * density**2 / (1 + d * density**2)


def _dense_slope(density: float, A: float) -> float:
    c, d = _DENSE
    return -3 * density**2 * _b2(A) / (1 + density**3) ** 2 + 2 * c * density / (1 + d * density**2) ** 2


def _equation(name: str) -> _Equation:
    """The equation of state of this name; ParameterError for an unknown one."""
    table = _table()
    known = {
        "measured": lambda: _Equation(table.alpha, table.alpha.slope, "docs/measure/pressure_table.py", table.bounds, True),
        "groot-warren": lambda: _Equation(
            lambda density, A: 0.101,
            lambda density, A: 0.0,
            "Groot and Warren, J. Chem. Phys. 107, 4423 (1997)",
            {"density": (2.0, 8.0), "A": (5.0, 110.0)},
            False,
        ),
        "liyana-arachchi": lambda: _Equation(
            _dense_alpha,
            _dense_slope,
            "Liyana-Arachchi et al., J. Chem. Phys. 142, 044902 (2015)",
            {"density": (2.0, 8.0), "A": (5.0, 40.0)},
            False,
        ),
    }
    require_one(name, known, "equation")
    return known[name]()


def _arguments(A, density, equation: _Equation, extrapolate: bool) -> tuple[float, float, bool]:
    A = reduced_number(A, "A", positive=True)
    density = reduced_number(density, "density", positive=True)
    return A, density, outside({"density": density, "A": A}, equation.bounds, equation.source, extrapolate)


def pressure(A, density=3.0, *, equation: str = "measured", extrapolate: bool = False) -> Estimate:
    r"""Pressure of a one-component fluid,

    .. math:: p = \rho k_BT + \alpha A r_c^4 \rho^2 ,

    where alpha is a constant (``groot-warren``), a function of density and A (``liyana-arachchi``), or a spline through pressures measured
    with this package at 64 states (``measured``).

    Parameters
    ----------
    A : float
        A rc/kT, > 0.
    density : float, default 3
        Beads per rc^3.
    equation : {"measured", "groot-warren", "liyana-arachchi"}
    extrapolate : bool
        Allow values outside of the bounds, where the measured alpha is constant.

    Returns
    -------
    Estimate
        p rc^3/kT.

    Raises
    ------
    ParameterError
        If a value is outside of the range of the equation, or the equation is unknown.

    References
    ----------
    Groot and Warren, J. Chem. Phys. 107, 4423 (1997): alpha = 0.101, up to 21 % too high at density 2, 9 % at density 3 and 1 % at 8.
    Liyana-Arachchi et al., J. Chem. Phys. 142, 044902 (2015), eqs 10 and 14, with coefficients from the programs of Allen and Tildesley's
    Computer Simulation of Liquids (2017): within 2 % of the measured pressures up to A = 40.  Above, its polynomial for the second virial
    coefficient departs from the exact one: by 20 % at 60, and by a factor of 4 at 80.

    Examples
    --------
    >>> round(pressure(25, 3, equation="liyana-arachchi").value, 3)
    23.587
    """
    chosen = _equation(equation)
    A, density, beyond = _arguments(A, density, chosen, extrapolate)
    p = density + chosen.alpha(density, A) * A * density**2
    return Estimate(p, _error(chosen, density, p, beyond), chosen.source, chosen.bounds, beyond)


def inverse_compressibility(A, density=3.0, *, equation: str = "measured", extrapolate: bool = False) -> Estimate:
    r"""Dimensionless inverse compressibility of a one-component fluid,

    .. math:: \kappa^{-1} = \frac{1}{\rho k_BT \kappa_T} = \frac{1}{k_BT} \left(\frac{\partial p}{\partial \rho}\right)_T .

    for A rc/kT, beads per rc^3 and an equation of state (:func:`pressure` has bounds and sources).

    Raises
    ------
    ParameterError
        If a value is outside of the range of the equation, or the equation is unknown.

    Examples
    --------
    >>> round(inverse_compressibility(25, 3, equation="groot-warren").value, 2)
    16.15
    """
    chosen = _equation(equation)
    A, density, beyond = _arguments(A, density, chosen, extrapolate)
    value = _slope(chosen, A, density)
    return Estimate(value, _error(chosen, density, _STEEP * value, beyond), chosen.source, chosen.bounds, beyond)


def _error(equation: _Equation, density: float, value: float, beyond: bool) -> float | None:
    relative = equation.relative_error(density)
    return None if relative is None or beyond else relative * value


def _slope(equation: _Equation, A: float, density: float) -> float:
    return 1 + 2 * equation.alpha(density, A) * A * density + A * density**2 * equation.slope(density, A)


def repulsion_from_compressibility(inverse, density=3.0, *, equation: str = "measured") -> Estimate:
    r"""Repulsion A of a one-component fluid with a given inverse compressibility 1/(rho kT kappa_T).

    Parameters
    ----------
    inverse : float
        Inverse compressibility, > 1 (ideal gas); for beads of N_m molecules, N_m times that of the liquid (:class:`.BeadMapping`).
    density : float, default 3
        Beads per rc^3.
    equation : {"measured", "groot-warren", "liyana-arachchi"}
        Equation of state, see :func:`pressure`.

    Returns
    -------
    Estimate
        A rc/kT.

    Raises
    ------
    ParameterError
        If no A within the bounds of the equation gives this compressibility.

    References
    ----------
    Method: Groot and Warren, J. Chem. Phys. 107, 4423 (1997), eqs 16 to 18; with N_m: Groot and Rabone, Biophys. J. 81, 725 (2001).

    Examples
    --------
    >>> round(repulsion_from_compressibility(16.0, 3.0, equation="groot-warren").value, 2)
    24.75
    """
    chosen = _equation(equation)
    inverse = reduced_number(inverse, "inverse", positive=True)
    density = reduced_number(density, "density", positive=True)
    outside({"density": density}, chosen.bounds, chosen.source, None)
    low, high = chosen.bounds["A"]
    least, most = _slope(chosen, low, density), _slope(chosen, high, density)
    if not least <= inverse <= most:
        raise ParameterError(
            f"an inverse compressibility of {inverse:g} at density {density:g} needs an A outside of {low:g} to {high:g}, the range of "
            f"{chosen.source}, in which it is {least:.4g} to {most:.4g}"
        )
    A = brentq(lambda a: _slope(chosen, a, density) - inverse, low, high)
    return Estimate(float(A), _error(chosen, density, _STEEP * float(A), False), chosen.source, chosen.bounds)


def overlap_energy(A: float, density: float) -> float:
    """Twice the energy per bead over A, from the measured table; bounds are not checked."""
    return _table().overlap(density, A)


def measured_bounds() -> Bounds:
    """Bounds of density and A in the measured table."""
    return _table().bounds
