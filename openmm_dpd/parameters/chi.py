"""Flory-Huggins parameters of two kinds of beads or of equal chains of them, and the repulsion for a wanted one.

Reduced: rc = m = kT = 1.  Both kinds repel themselves with A, each other with A + dA.  To first order in dA the free energy of mixing is
chi = x.  For single beads x is dA times twice the energy of a bead over A, which the measured table of
:mod:`openmm_dpd.parameters.state` has for all densities and A; for chains see :mod:`openmm_dpd.parameters.chains`.  Beyond that
chi = x f(x), with f measured at A = 75/density (docs/measure/demixing.py).
"""

from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from scipy.interpolate import PchipInterpolator
from scipy.optimize import brentq

from ..base.errors import ParameterError, what_is
from ..molecules.builders import like_repulsion, unlike_repulsion
from ..molecules.terms import Spring
from .chains import chain_chi_slope, volume_per_bead
from .estimate import Bounds, Estimate, outside, reduced_number, shipped_rows
from .state import measured_bounds, overlap_energy

_SOURCE = "docs/measure/demixing.py"
_GROOT_WARREN = "Groot and Warren, J. Chem. Phys. 107, 4423 (1997)"
_RELATIONS = ("measured", "groot-warren")
#: Relative errors at A = 75/density and at other repulsions, and those of chains: docs/validation.md.
_BETWEEN, _ELSEWHERE, _CHAINS = 0.03, 0.07, 0.04
#: Volume over which a chain spreads, per bead in rc^3, where f deviates from 1 half as much as for single beads.
_HALF = 1.5


@dataclass(frozen=True)
class _Table:
    """f(x) at each density, and the range of x that all of them cover."""

    curves: dict[float, PchipInterpolator]
    largest: float

    def __call__(self, x: float, density: float) -> float:
        densities = sorted(self.curves, reverse=True)
        values = [float(self.curves[rho](min(x, self.largest))) for rho in densities]
        # f is 1 where beads are dense, and deviates from it as 1/density
        return float(np.interp(1 / density, [1 / rho for rho in densities], values))


@lru_cache(maxsize=1)
def _table() -> _Table:
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
    """chi of dA at a density and a repulsion, with the largest dA and the bounds it has there."""

    slope: float
    density: float
    error: float
    limits: Bounds
    beads: int = 1
    #: How far f deviates from 1, over that of single beads.
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
    table, bounds = _table(), measured_bounds()
    rho = reduced_number(density, "density", positive=True)
    limits = {"density": (min(table.curves), max(table.curves)), "A": bounds["A"]}
    outside({"density": rho}, limits, _SOURCE, None)
    slope = chain_chi_slope(beads, bond, rho)
    if bond is not None:
        if A is not None:
            raise ParameterError("chains were measured at A = 75/density; leave A out, or take measured_chi_slope")
        return _Relation(slope.value, rho, _CHAINS, slope.bounds, beads, 1 / (1 + volume_per_bead(beads, bond, rho) / _HALF))
    repulsion = 75.0 / rho if A is None else reduced_number(A, "A", positive=True)
    outside({"A": repulsion}, limits, _SOURCE, None)
    return _Relation(overlap_energy(repulsion, rho), rho, _BETWEEN if A is None else _ELSEWHERE, limits)


def _published(relation: str, A, beads: int, bond: Spring | None) -> bool:
    if not isinstance(relation, str) or relation not in _RELATIONS:
        raise ParameterError(f"the relation must be one of {', '.join(_RELATIONS)}, not {what_is(relation)}")
    if relation == "groot-warren" and A is not None:
        raise ParameterError("the relation of Groot and Warren holds for A = 75/density; leave A out")
    if relation == "groot-warren" and (beads != 1 or bond is not None):
        raise ParameterError("the relation of Groot and Warren is here for single beads; leave beads and bond out")
    return relation == "groot-warren"


def repulsion_from_chi(
    chi, density=3.0, *, beads: int = 1, bond: Spring | None = None, A=None, relation: str = "measured", extrapolate: bool = False
) -> Estimate:
    r"""How much more unlike beads repel each other, dA = A_ij - A_ii, for a Flory-Huggins parameter.

    Parameters
    ----------
    chi : float
        >= 0, for a pair of beads.  Two fluids of equal molecules demix above 2/beads.
    density : float, default 3
        Beads in rc^3.
    beads : int, default 1
        Beads in a chain of either kind; both kinds have the same bonds.
    bond : openmm_dpd.molecules.Spring, optional
        Of chains: one that :func:`chain_chi_slope` covers.
    A : float, optional
        A_ii of both kinds, for single beads; 75/density by default.
    relation : {"measured", "groot-warren"}
        ``groot-warren`` is chi = 0.286 dA at density 3 and 0.689 dA at density 5 (:func:`openmm_dpd.molecules.unlike_repulsion`).
        ``measured`` is chi = x f(x), see Notes.
    extrapolate : bool
        Go on beyond the largest chi that was measured, with the ratio chi/dA it has there.

    Returns
    -------
    Estimate
        dA rc/kT.

    Raises
    ------
    ParameterError
        If a value is outside of what the relation covers.

    Notes
    -----
    x = 2 u dA/A, with u the energy of a bead in the fluid of one kind, is chi to first order in dA.  f(x) is measured: below chi = 1.9 from
    the free energy of mixing equal parts, above 2.3 from the bulk compositions of demixed slabs.  Near 2 there is a critical point, where
    Flory-Huggins theory holds for no fluid.

    For chains of n beads x is dA times :func:`chain_chi_slope`, and chi = x (1 - (1 - f(n x))/(1 + v/1.5)): what brings f below 1 are
    fluctuations of the composition, which set in as the fluids come near to demixing, and are the weaker the more chains meet.  v is the
    cube of the distance of the ends of a chain over n.  The form and the 1.5 are fitted to chains of 2 to 10 beads.

    chi depends on the composition: of a few molecules in a fluid of the other kind it is larger, by 3 to 6 % where equal parts mix and by
    10 to 13 % where they demix (docs/validation.md).

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
    """The Flory-Huggins parameter of beads that repel each other dA = A_ij - A_ii more than themselves.

    The inverse of :func:`repulsion_from_chi`, with its parameters, bounds and sources.

    Parameters
    ----------
    dA : float
        dA rc/kT, >= 0.
    density, beads, bond, A, relation, extrapolate
        As for :func:`repulsion_from_chi`.

    Raises
    ------
    ParameterError
        If a value is outside of what the relation covers.

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
