"""chi of linear chains per excess repulsion, to first order, from a table measured over bonds, lengths and densities.

Reduced units: rc = m = kT = 1.  The table has A = 75/density (docs/measure/chain_slopes.py)."""

from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from scipy.interpolate import CubicSpline, RectBivariateSpline

from ..base.errors import ParameterError, what_is
from ..base.units import whole_number
from ..molecules.terms import Spring
from .estimate import Bounds, Estimate, outside, reduced_number, shipped_rows
from .state import overlap_energy

_SOURCE = "docs/measure/chain_slopes.py"
#: Relative errors at points of the table and between them: docs/validation.md.
_AT, _BETWEEN = 0.002, 0.01


class _Column:
    """Interpolates a property of chains at one density, of (spring, beads), from rows (k, r0, beads) of soft springs and stiff ones."""

    def __init__(self, rows: dict[tuple[float, float, int], float]):
        self.lengths = np.array(sorted({n for *_, n in rows}))
        springs = {(k, r0) for k, r0, _ in rows}
        #: Springs without a rest length are not interpolated; the others are a grid of stiffness and rest length.
        self.alone = {spring: np.array([rows[(*spring, n)] for n in self.lengths]) for spring in springs if spring[1] == 0}
        self.k, self.r0 = (sorted({spring[axis] for spring in springs if spring not in self.alone}) for axis in (0, 1))
        self.grid = [
            RectBivariateSpline(np.log(self.k), self.r0, np.array([[rows[(k, r0, n)] for r0 in self.r0] for k in self.k]), kx=2)
            for n in self.lengths
        ]

    def __call__(self, spring: Spring, beads: int) -> float:
        values = self.alone.get((spring.k, spring.r0))
        if values is None:
            values = np.array([float(surface(np.log(spring.k), spring.r0)[0, 0]) for surface in self.grid])
        # corrections to the limit of long chains scale with length^(-1/2)
        return float(CubicSpline(-(self.lengths**-0.5), values)(-(beads**-0.5)))


@dataclass(frozen=True)
class _Table:
    """By density: chi/dA relative to that of single beads, and the mean square end-to-end distance per bond."""

    ratios: dict[float, _Column]
    bonds: dict[float, _Column]

    @property
    def bounds(self) -> Bounds:
        column = next(iter(self.ratios.values()))
        ends = {"density": sorted(self.ratios), "k": column.k, "r0": column.r0}
        return {"beads": (1.0, float(column.lengths[-1])), **{name: (values[0], values[-1]) for name, values in ends.items()}}


@lru_cache(maxsize=1)
def _table() -> _Table:
    """The measured table of chains."""
    rows = shipped_rows("chi_chains")
    single = {rho: slope for rho, _, _, n, slope, *_ in rows if n == 1}
    ratios: dict[float, dict] = {rho: {} for rho in sorted(single)}
    bonds: dict[float, dict] = {rho: {} for rho in sorted(single)}
    for rho, k, r0, n, slope, _, ends, *_ in rows:
        if n > 1:
            ratios[rho][k, r0, n], bonds[rho][k, r0, n] = slope / single[rho], ends / (n - 1)
    return _Table({rho: _Column(found) for rho, found in ratios.items()}, {rho: _Column(found) for rho, found in bonds.items()})


def _between(columns: dict[float, _Column], spring: Spring, beads: int, density: float) -> float:
    """Value at a density: its logarithm is interpolated in 1/density, as deviations from a dense fluid scale with this."""
    rhos = sorted(columns, reverse=True)
    return float(np.exp(np.interp(1 / density, [1 / rho for rho in rhos], [np.log(columns[rho](spring, beads)) for rho in rhos])))


def volume_per_bead(beads: int, bond: Spring | None, density: float) -> float:
    """Cube of the root mean square end-to-end distance of a chain over its number of beads, rc^3; 0 for single beads.  Not checked."""
    return 0.0 if bond is None else ((beads - 1) * _between(_table().bonds, bond, beads, density)) ** 1.5 / beads


def chain_chi_slope(beads: int, bond: Spring | None = None, density=3.0) -> Estimate:
    """chi per excess repulsion dA of two kinds of linear chains of equal length, per bead and to first order, at A = 75/density.

    Beads of a chain meet beads of their own chain, so that it has fewer contacts with others, and the fewer the shorter its bonds.  The
    measured table has chains of 2 to 20 beads at densities 3 and 5; :func:`measured_chi_slope` takes any molecule, in a run of seconds.

    Parameters
    ----------
    beads : int
        Beads per chain; 1 for single beads.
    bond : openmm_dpd.molecules.Spring, optional
        U = k (r - r0)^2 in units of rc and kT: k = 2, r0 = 0 (F = -4 r), or k = 25 to 100 with r0 = 0.3 to 0.9.  None for single beads.
    density : float, default 3
        Beads per rc^3, 3 to 5.

    Returns
    -------
    Estimate
        chi kT/(dA rc).

    Raises
    ------
    ParameterError
        If a chain has no bond or a single bead has one, or a value is outside of the measured range.

    Examples
    --------
    >>> from openmm_dpd.molecules import Spring
    >>> round(chain_chi_slope(10, Spring(k=2, r0=0)).value / chain_chi_slope(1).value, 2)
    0.75
    """
    table, count = _table(), whole_number(beads, "beads", least=1)
    rho = reduced_number(density, "density", positive=True)
    if (count > 1) != (bond is not None):
        raise ParameterError(f"chains need a bond and single beads have none, but beads is {count} and bond is {what_is(bond)}")
    outside({"density": rho, "beads": count}, table.bounds, _SOURCE, None)
    first = overlap_energy(75.0 / rho, rho)
    if bond is None:
        return Estimate(first, _AT * first, _SOURCE, table.bounds)
    if not isinstance(bond, Spring):
        raise ParameterError(f"bond must be a Spring, as in {_SOURCE}, not {what_is(bond)}; measured_chi_slope measures any chain")
    column = next(iter(table.ratios.values()))
    alone = (bond.k, bond.r0) in column.alone
    if not alone:
        outside({"k": bond.k, "r0": bond.r0}, table.bounds, _SOURCE, None)
    value = first * _between(table.ratios, bond, count, rho)
    there = rho in table.ratios and (alone or (bond.k in column.k and bond.r0 in column.r0))
    return Estimate(value, (_AT if there else _BETWEEN) * value, _SOURCE, table.bounds)
