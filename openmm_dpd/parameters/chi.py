"""Flory-Huggins parameters of two kinds of beads, or of chains of equal length, and the repulsion for a given one.

Reduced units: rc = m = kT = 1.  Like beads repel with A, unlike ones with A + dA.  To first order in dA, chi = x.  For single beads x is
dA times twice the energy per bead over A, from the measured table of :mod:`openmm_dpd.parameters.state`, for all densities and A; for
chains it is from :mod:`openmm_dpd.parameters.chains`.  Beyond first order chi = x f(x), f by docs/measure/demixing.py (A = 75/density)."""

from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from scipy.interpolate import PchipInterpolator
from scipy.optimize import brentq

from ..base.errors import ParameterError, require_one
from ..molecules.builders import like_repulsion, unlike_repulsion
from ..molecules.terms import Spring
from .chains import chain_chi_slope, volume_per_bead
from .estimate import Bounds, Estimate, outside, reduced_number, shipped_rows
from .state import measured_bounds, overlap_energy

_SOURCE = "docs/measure/demixing.py"
_GROOT_WARREN = "Groot and Warren, J. Chem. Phys. 107, 4423 (1997)"
_RELATIONS = ("measured", "groot-warren")
#: Relative errors at A = 75/density, at other repulsions, and of chains: docs/validation.md.
_BETWEEN, _ELSEWHERE, _CHAINS = 0.03, 0.07, 0.04
#: Volume pervaded by a chain per bead, rc^3, at which f deviates from 1 half as much as for single beads.
_HALF = 1.5


@dataclass(frozen=True)
class _Table:
    """f(x) at each density, and the largest x that all of them cover."""

    curves: dict[float, PchipInterpolator]
    largest: float

    def __call__(self, x: float, density: float) -> float:
        densities = sorted(self.curves, reverse=True)
        values = [float(self.curves[rho](min(x, self.largest))) for rho in densities]
        # f tends to 1 in dense fluids, with a deviation proportional to 1/density
        return float(np.interp(1 / density, [1 / rho for rho in densities], values))


@lru_cache(maxsize=1)
def _table() -> _Table:
    """The measured table of f(x)."""
    rows = shipped_rows("chi")
    curves, ends = {}, []
    for density in sorted({row[0] for row in rows}):
        slope = overlap_energy(75.0 / density, density)
        points = sorted((dA * slope, chi / (dA * slope)) for rho, dA, chi, _, kind, *_ in rows if rho == density and kind != "slope")
        x, f = np.array([(0.0, 1.0), *points]).T
        curves[density] = PchipInterpolator(x, f)
        ends.append(float(x[-1]))
    return _Table(curves, min(ends))


@dataclass(frozen=True)
class _Relation:
    """chi as a function of dA at one density and repulsion, with the largest dA and the bounds."""

    slope: float
    density: float
    error: float
    limits: Bounds
    beads: int = 1
    #: Deviation of f from 1, relative to that of single beads.
    deviation: float = 1.0

    def __call__(self, dA: float) -> float:
        x = dA * self.slope
        return x * (1 + self.deviation * (_table()(self.beads * x, self.density) - 1))

    @property
    def largest(self) -> float:
        return _table().largest / (self.slope * self.beads)

    @property
    def bounds(self) -> Bounds:
        return {**self.limits, "dA": (0.0, self.largest), "chi": (0.0, self(self.largest))}


def _relation(density, A, beads: int, bond: Spring | None) -> _Relation:
    """Measured relation for single beads or chains; ParameterError if an argument is outside of what was measured."""
    table, bounds = _table(), measured_bounds()
    rho = reduced_number(density, "density", positive=True)
    limits = {"density": (min(table.curves), max(table.curves)), "A": bounds["A"]}
    outside({"density": rho}, limits, _SOURCE, None)
    slope = chain_chi_slope(beads, bond, rho)
    if bond is not None:
        if A is not None:
            raise ParameterError("chains were measured at A = 75/density; leave A out, or use measured_chi_slope")
        return _Relation(slope.value, rho, _CHAINS, slope.bounds, beads, 1 / (1 + volume_per_bead(beads, bond, rho) / _HALF))
    repulsion = 75.0 / rho if A is None else reduced_number(A, "A", positive=True)
    outside({"A": repulsion}, limits, _SOURCE, None)
    return _Relation(overlap_energy(repulsion, rho), rho, _BETWEEN if A is None else _ELSEWHERE, limits)


def _published(relation: str, A, beads: int, bond: Spring | None) -> bool:
    require_one(relation, _RELATIONS, "relation")
    if relation == "groot-warren" and A is not None:
        raise ParameterError("the relation of Groot and Warren holds for A = 75/density; leave A out")
    if relation == "groot-warren" and (beads != 1 or bond is not None):
        raise ParameterError("the relation of Groot and Warren holds for single beads; leave beads and bond out")
    return relation == "groot-warren"


def repulsion_from_chi(
    chi, density=3.0, *, beads: int = 1, bond: Spring | None = None, A=None, relation: str = "measured", extrapolate: bool = False
) -> Estimate:
    r"""Excess repulsion of unlike beads, dA = A_ij - A_ii, for a Flory-Huggins parameter.

    Parameters
    ----------
    chi : float
        Flory-Huggins parameter per bead, >= 0.  Two fluids of molecules of equal length demix above 2/beads.
    density : float, default 3
        Beads per rc^3.
    beads : int, default 1
        Beads per chain of either kind; both kinds have the same bonds.
    bond : openmm_dpd.molecules.Spring, optional
        Bond of the chains, one that :func:`chain_chi_slope` covers.
    A : float, optional
        A_ii of both kinds, for single beads; 75/density by default.
    relation : {"measured", "groot-warren"}
        ``groot-warren`` is chi = 0.286 dA at density 3 and 0.689 dA at density 5 (:func:`openmm_dpd.molecules.unlike_repulsion`).
        ``measured`` is chi = x f(x), see Notes.
    extrapolate : bool
        Extrapolate beyond the largest measured chi, with constant chi/dA.

    Returns
    -------
    Estimate
        dA rc/kT.

    Raises
    ------
    ParameterError
        If a value is outside of the range of the relation.

    Notes
    -----
    x = 2 u dA/A, with u the energy per bead of the one-component fluid, is chi to first order in dA.  f(x) is measured: below chi = 1.9
    from the free energy of mixing at equal fractions, above 2.3 from the bulk compositions of demixed slabs.  In between is a critical
    point, at chi = 2, where Flory-Huggins theory does not hold.

    For chains of n beads, x is dA times :func:`chain_chi_slope`, and chi = x (1 - (1 - f(n x))/(1 + v/1.5)): fluctuations of the
    composition bring f below 1 as the fluids come close to demixing, and are weaker the more chains overlap.  v is the cube of the
    end-to-end distance over n.  The form and the 1.5 are fitted to chains of 2 to 10 beads.

    chi depends on the composition: for a few molecules in the other fluid it is larger, by 3 to 6 % where equal fractions mix and by 10 to
    13 % where they demix (docs/validation.md).

    References
    ----------
    R. D. Groot and P. B. Warren, J. Chem. Phys. 107, 4423 (1997); for the table docs/measure/demixing.py and docs/validation.md.
    """
    target = reduced_number(chi, "chi")
    if _published(relation, A, beads, bond):
        value = unlike_repulsion(target, density) - like_repulsion(density)
        return Estimate(value, 0.007 * value, _GROOT_WARREN, {"density": (density, density)})
    found = _relation(density, A, beads, bond)
    beyond = outside({"chi": target}, found.bounds, _SOURCE, extrapolate)
    largest = found.largest
    if beyond:
        return Estimate(target * largest / found(largest), None, _SOURCE, found.bounds, True)
    value = float(brentq(lambda dA: found(dA) - target, 0.0, largest * (1 + 1e-9)))
    return Estimate(value, found.error * value, _SOURCE, found.bounds)


def chi_from_repulsion(
    dA, density=3.0, *, beads: int = 1, bond: Spring | None = None, A=None, relation: str = "measured", extrapolate: bool = False
) -> Estimate:
    """Flory-Huggins parameter for an excess repulsion of unlike beads, dA = A_ij - A_ii.

    It is the inverse of :func:`repulsion_from_chi`, which has the bounds and sources.

    Parameters
    ----------
    dA : float
        dA rc/kT, >= 0.
    density, beads, bond, A, relation, extrapolate
        Fluid and relation, see :func:`repulsion_from_chi`.

    Raises
    ------
    ParameterError
        If a value is outside of the range of the relation.

    Examples
    --------
    >>> round(chi_from_repulsion(10.0, 3.0, relation="groot-warren").value, 2)
    2.86
    """
    extra = reduced_number(dA, "dA")
    if _published(relation, A, beads, bond):
        per_chi = unlike_repulsion(1.0, density) - like_repulsion(density)
        return Estimate(extra / per_chi, 0.007 * extra / per_chi, _GROOT_WARREN, {"density": (density, density)})
    found = _relation(density, A, beads, bond)
    beyond = outside({"dA": extra}, found.bounds, _SOURCE, extrapolate)
    value = extra / found.largest * found(found.largest) if beyond else found(extra)
    return Estimate(value, None if beyond else found.error * value, _SOURCE, found.bounds, beyond)
