"""Pair potentials that DPD thermostats are laid over: Lennard-Jones and tabulated.

To add one: a coefficient class in ``model/pairs.py``, an expression here, an entry in :data:`EXPRESSIONS`.
"""

from __future__ import annotations

import numpy as np
import openmm
from scipy.interpolate import CubicHermiteSpline, CubicSpline

from ..model.pairs import LennardJones, TabulatedPair
from .expressions import PairExpression, parameters, type_pairs, type_table

#: Points of a resampled table: the spline through them differs from the original one by less than float32 rounding.
_POINTS = 4000


def lennard_jones_expression(table: dict, names: list[str]) -> PairExpression:
    """U = 4 epsilon ((sigma/r)^12 - (sigma/r)^6) - shift for r < rc."""

    def at_cutoff(c: LennardJones) -> float:
        s6 = (c.sigma / c.cutoff) ** 6
        return 4 * c.epsilon * (s6 * s6 - s6) if c.shift else 0.0

    text, functions = parameters(
        {
            "epsilon": type_pairs(table, names, lambda c: c.epsilon, 0.0),
            "sigma": type_pairs(table, names, lambda c: c.sigma, 1.0),
            "rc": type_pairs(table, names, lambda c: c.cutoff, 1.0),
            "shift": type_pairs(table, names, at_cutoff, 0.0),
        }
    )
    return PairExpression(
        name="Lennard-Jones",
        energy=f"step(rc-r)*(4*epsilon*(s6*s6-s6)-shift); s6=(sigma/r)^6{text}",
        virial=f"step(rc-r)*24*epsilon*(2*s6*s6-s6); s6=(sigma/r)^6{text}",
        cutoff=max(c.cutoff for c in table.values()),
        functions=functions,
    )


def energy_spline(pair: TabulatedPair) -> CubicSpline | CubicHermiteSpline:
    """Energy as a smooth function of the distance: through energies and forces if both are given."""
    if pair.forces is None:
        return CubicSpline(pair.distances, pair.energies)
    return CubicHermiteSpline(pair.distances, pair.energies, -pair.forces)


def tabulated_expression(table: dict, names: list[str]) -> PairExpression:
    """Sum over the distinct tables of (its number = number of the type pair) * table(r); constant force below a table's first distance."""
    pairs = list({id(c): c for c in table.values() if c.cutoff > 0}.values())
    numbers = {id(c): k for k, c in enumerate(pairs)}
    which = type_pairs(table, names, lambda c: numbers[id(c)], -1)
    single = bool(np.all(which == 0))
    functions = {} if single else {"which": type_table(which)}
    energies, virials, definitions = [], [], "" if single else "; number=which(type1, type2)"
    for k, pair in enumerate(pairs):
        low, high = float(pair.distances[0]), float(pair.distances[-1])
        spline = energy_spline(pair)
        grid = np.linspace(low, high, max(_POINTS, 2 * len(pair.distances)))
        energy, force = spline(grid), -spline(grid, 1)
        functions[f"energy{k}"] = _curve(energy, low, high)
        functions[f"force{k}"] = _curve(force, low, high)
        gate = f"step({pair.cutoff!r}-r)" + ("" if single else f"*delta(number-{k})")
        inside = f"step(r-{low!r})"
        # min() keeps the argument inside the table, outside of which OpenMM returns 0
        energies.append(f"{gate}*select({inside}, energy{k}(min(r, {high!r})), ({float(energy[0])!r})-({float(force[0])!r})*(r-{low!r}))")
        virials.append(f"{gate}*r*select({inside}, force{k}(min(r, {high!r})), ({float(force[0])!r}))")
    return PairExpression(
        name="tabulated pair potential",
        energy="+".join(energies) + definitions,
        virial="+".join(virials) + definitions,
        cutoff=max(pair.cutoff for pair in pairs),
        functions=functions,
    )


def _curve(values: np.ndarray, low: float, high: float):
    return lambda: openmm.Continuous1DFunction(values, low, high)


#: Kind of coefficient -> function that makes its expression.
EXPRESSIONS = {LennardJones: lennard_jones_expression, TabulatedPair: tabulated_expression}
