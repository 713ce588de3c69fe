"""Overlays, radial pair potentials beside the DPD terms: Lennard-Jones and tabulated.

To add one: a coefficient class in ``model/pairs.py``, an expression here, a record in ``kinds/overlays.py``.
"""

from collections.abc import Mapping

import numpy as np
import openmm
import scipy

from ...model.pairs import LennardJones, TabulatedPair
from .expressions import PairExpression, radial_expression, type_pairs, type_table

#: Points of a resampled table: the spline through them differs from the original one by less than float32 rounding.
_POINTS = 4000


def lennard_jones_shift(c: LennardJones) -> float:
    """What is taken off the energy: that at the cutoff, if it is to be 0 there."""
    s6 = (c.sigma / c.cutoff) ** 6
    return 4 * c.epsilon * (s6 * s6 - s6) if c.shift else 0.0


def lennard_jones_expression(table: Mapping, names: list[str]) -> PairExpression:
    """U = 4 epsilon ((sigma/r)^12 - (sigma/r)^6) - shift for r < rc."""
    energy = "(4*epsilon*(s6*s6-s6)-shift); s6=(sigma/r)^6"
    # sigma is 0 where there is no interaction: (1/r)^12 would overflow where soft beads overlap
    columns = {"epsilon": (lambda c: c.epsilon, 0.0), "sigma": (lambda c: c.sigma, 0.0), "shift": (lennard_jones_shift, 0.0)}
    return radial_expression("Lennard-Jones", table, names, energy, columns)


def energy_spline(pair: TabulatedPair) -> "scipy.interpolate.PPoly":
    """Energy as a smooth function of the distance: through energies and forces if both are given."""
    if pair.forces is None:
        return scipy.interpolate.CubicSpline(pair.distances, pair.energies)
    return scipy.interpolate.CubicHermiteSpline(pair.distances, pair.energies, -pair.forces)


def tabulated_expression(table: Mapping, names: list[str]) -> PairExpression:
    """Sum over the distinct tables of (its number = number of the type pair) * table(r); constant force below a table's first distance."""
    pairs = list({id(c): c for c in table.values() if c.cutoff > 0}.values())
    numbers = {id(c): k for k, c in enumerate(pairs)}
    which = type_pairs(table, names, lambda c: numbers[id(c)], -1)
    single = bool(np.all(which == 0))
    functions = {} if single else {"which": type_table(which)}
    energies, definitions = [], "" if single else "; number=which(type1, type2)"
    cutoff = max(pair.cutoff for pair in pairs)
    for k, pair in enumerate(pairs):
        high = float(pair.distances[-1])
        functions[f"energy{k}"] = _curve(_resampled(pair), high)
        # OpenMM's tables are 0 beyond their end, and the force ends at its cutoff: a gate is needed only in between
        gate = f"step({pair.cutoff!r}-r)*" if pair.cutoff < min(high, cutoff) or high > cutoff else ""
        gate += "" if single else f"delta(number-{k})*"
        energies.append(f"{gate}energy{k}(r)")
    return PairExpression(name="tabulated pair potential", energy="+".join(energies) + definitions, cutoff=cutoff, functions=functions)


def _resampled(pair: TabulatedPair) -> np.ndarray:
    """Energy on an even grid from 0 to the table's end; constant force below the table's first distance."""
    low, high = pair.distances[0], pair.distances[-1]
    spline = energy_spline(pair)
    grid = np.linspace(0.0, high, max(_POINTS, 2 * len(pair.distances)))
    inside = np.maximum(grid, low)
    return spline(inside) - spline(inside, 1) * (inside - grid)


def _curve(values: np.ndarray, high: float):
    return lambda: openmm.Continuous1DFunction(values, 0.0, high)
