"""Pair potentials as OpenMM expressions, and the forces made from them.

Every radial potential becomes one :class:`PairExpression`; the same text serves the CustomNonbondedForce and the bond force that puts back
scaled or coincident pairs.  Of many-body DPD, the attraction is such an expression, and the repulsion a CustomGBForce: a value rho_i of
each bead, summed over pairs, and its energy.  With the Lucy kernel there is no potential, and the pair kernel computes the force.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace

import numpy as np
import openmm
import scipy

from ...model.mdpd import check_many_body
from ...model.pairs import LennardJones, TabulatedPair

#: Distance (nm) below which two beads are at the same point.
COINCIDENT = 1e-10


@dataclass(frozen=True)
class PairExpression:
    """A radial pair potential U(r; type1, type2)."""

    name: str  #: Name of the forces made from it
    energy: str  # Expression in r, type1, type2, zero from the cutoff on
    cutoff: float  # Largest cutoff, nm
    functions: dict[str, Callable[[], openmm.TabulatedFunction]] = field(default_factory=dict)
    skips_coincident: bool = False  #: Whether beads at the same point have no energy; else they have that at :data:`COINCIDENT`

    @property
    def typed(self) -> bool:
        """Whether the expression needs the types of the beads."""
        return "type1" in self.energy


def type_table(values: np.ndarray) -> Callable[[], openmm.TabulatedFunction]:
    """Maker of a function of two type numbers."""
    array = np.asarray(values, dtype=float)
    return lambda: openmm.Discrete2DFunction(array.shape[0], array.shape[1], array.ravel(order="F"))


def type_pairs(table: Mapping, names: list[str], value: Callable, default: float) -> np.ndarray:
    """(T, T) symmetric array of value(coefficient); ``default`` where the table has no interaction."""
    array = np.full((len(names), len(names)), float(default))
    place = {name: k for k, name in enumerate(names)}
    for (a, b), coefficient in table.items():
        if coefficient.cutoff > 0:
            i, j = place[a], place[b]
            array[i, j] = array[j, i] = value(coefficient)
    return array


def parameters(arrays: dict[str, np.ndarray]) -> tuple[str, dict]:
    """Definitions that end an expression: constants where all type pairs agree, else functions of the types."""
    text, functions = "", {}
    for name, array in arrays.items():
        if np.all(array == array.flat[0]):
            text += f"; {name}={float(array.flat[0])!r}"
        else:
            text += f"; {name}={name}_of(type1, type2)"
            functions[f"{name}_of"] = type_table(array)
    return text, functions


def radial_expression(
    name: str, table: Mapping, names: list[str], energy: str, columns: dict[str, tuple[Callable, float]], **choices
) -> PairExpression:
    """Expression of one table, which is ``energy`` up to the cutoff ``rc`` and 0 from there on.

    ``columns`` are the names in it, what they are of a coefficient, and where there is no interaction.
    """
    columns = {**columns, "rc": (lambda c: c.cutoff, 1.0)}
    text, functions = parameters({key: type_pairs(table, names, *column) for key, column in columns.items()})
    return PairExpression(name, f"step(rc-r)*{energy}{text}", max(c.cutoff for c in table.values()), functions, **choices)


def dpd_expression(table: Mapping, names: list[str]) -> PairExpression:
    """U = A rc (1 - r/rc)^2/2 for r < rc, of one table of coefficients with A and cutoff; zero at the cutoff."""
    energy, columns = "0.5*A*rc*(1-r/rc)^2", {"A": (lambda c: c.A, 0.0)}
    return radial_expression("DPD conservative", table, names, energy, columns, skips_coincident=True)


def nonbonded_force(
    expression: PairExpression, types: np.ndarray, exclusions: list[tuple[int, int]], periodic: bool, *, listed: bool = True
) -> openmm.CustomNonbondedForce:
    """CustomNonbondedForce of an expression.

    Without a neighbour list (``listed`` False) it goes through all pairs: a platform makes no list for an interaction group.
    """
    force = openmm.CustomNonbondedForce(expression.energy)
    _name(force, expression, "")
    if expression.typed:
        force.addPerParticleParameter("type")
    for kind in types.tolist():
        force.addParticle([kind] if expression.typed else [])
    force.setNonbondedMethod(force.CutoffPeriodic if periodic else force.CutoffNonPeriodic)
    force.setCutoffDistance(expression.cutoff)
    for i, j in exclusions:
        force.addExclusion(i, j)
    if not listed:
        every = range(len(types))
        force.addInteractionGroup(every, every)
    return force


def exception_force(
    expression: PairExpression, types: np.ndarray, factors: dict[tuple[int, int], float], periodic: bool
) -> openmm.CustomCompoundBondForce:
    """Bond force that gives single pairs the same potential times a factor.

    It serves scaled bonded neighbours, and beads that start at the same point: every OpenMM platform divides by r in a
    CustomNonbondedForce and returns NaN at r = 0 for any expression, but not in a bond force.
    """
    head, *definitions = expression.energy.split(";")
    # in OpenMM a definition comes before those that it uses
    gate = f"step(apart-{COINCIDENT!r})*" if expression.skips_coincident else ""
    text = ";".join([f"{gate}factor*({head})", *definitions, f" r=max(apart, {COINCIDENT!r})", " apart=distance(p1, p2)"])
    force = openmm.CustomCompoundBondForce(2, text)
    _name(force, expression, " (exceptions)")
    force.addPerBondParameter("factor")
    if expression.typed:
        force.addPerBondParameter("type1")
        force.addPerBondParameter("type2")
    for (i, j), factor in factors.items():
        force.addBond([i, j], [factor, int(types[i]), int(types[j])] if expression.typed else [factor])
    force.setUsesPeriodicBoundaryConditions(periodic)
    return force


def _name(force: openmm.Force, expression: PairExpression, what: str) -> None:
    """Name and functions of a force made from an expression."""
    force.setName(expression.name + what)
    for name, make in expression.functions.items():
        force.addTabulatedFunction(name, make())


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


def formula_numbers(table: Mapping, names: list[str]) -> np.ndarray:
    """(T, T, K) numbers of the formulas of a table (:meth:`.RadialPair.numbers`); zeros for terms that a formula does not have."""
    rows = {id(c): c.numbers() for c in table.values() if c.cutoff > 0}
    wide = {key: np.append(row, np.zeros(max(map(len, rows.values())) - len(row))) for key, row in rows.items()}
    columns = range(len(next(iter(wide.values()), np.zeros(4))))
    return np.ascontiguousarray(np.stack([type_pairs(table, names, lambda c, k=k: wide[id(c)][k], 0.0) for k in columns], axis=-1))


def formula_expression(table: Mapping, names: list[str]) -> PairExpression:
    """Sum of all that a formula may have, without what none of the table has."""
    numbers, used, parts = formula_numbers(table, names), set[int](), []
    terms = [(0, "n{0}"), (1, "n{1}*r"), (2, f"n{{2}}*cos({2 * np.pi!r}*n{{3}}*r)")]
    terms += [(k, f"n{{{k}}}*r^(-n{{{k + 1}}})*exp(-(n{{{k + 2}}}+n{{{k + 3}}}*r)*r)") for k in range(4, numbers.shape[-1], 4)]
    for first, text in terms:
        if np.any(numbers[..., first]):
            parts.append(text.replace("{", "").replace("}", ""))
            used |= {k for k in range(first, first + 4) if f"{{{k}}}" in text}
    named = {f"n{k}": numbers[..., k] for k in sorted(used)}
    named["rc"] = type_pairs(table, names, lambda c: c.cutoff, 1.0)
    text, functions = parameters(named)
    cutoff = max(c.cutoff for c in table.values())
    return PairExpression("radial formula", f"step(rc-r)*({'+'.join(parts) or '0'}){text}", cutoff, functions)


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


def attraction_expression(table: Mapping, names: list[str]) -> PairExpression:
    """The attraction A cutoff w^2/2 of one table of MDPD coefficients {(type, type): MDPD or NONE}."""
    return replace(dpd_expression(table, names), name="MDPD attraction")


def density_force(
    table: Mapping, names: list[str], types: np.ndarray, exclusions: list[tuple[int, int]], periodic: bool
) -> openmm.CustomGBForce:
    """The energy sum over i of pi B h^4 rho_i^2/30, rho_i = sum over j of 15/(2 pi h^3) (1 - r/h)^2, as a CustomGBForce.  Bonded neighbours
    in ``exclusions`` do not count in each other's density.  ParameterError if the coefficients do not go together."""
    coefficient = check_many_body(table)
    h = coefficient.cutoff_B
    interacts = type_pairs(table, names, lambda c: 1.0, 0.0)
    typed = not np.all(interacts == 1.0)
    force = openmm.CustomGBForce()
    force.setName("MDPD density")
    if typed:
        force.addPerParticleParameter("type")
        force.addTabulatedFunction("interacts", type_table(interacts)())
    factor = "interacts(type1, type2)*" if typed else ""
    force.addComputedValue("rho", f"{factor}step(h-r)*{7.5 / (np.pi * h**3)!r}*(1-r/h)^2; h={h!r}", force.ParticlePair)
    force.addEnergyTerm(f"{np.pi * coefficient.B * h**4 / 30!r}*rho^2", force.SingleParticle)
    for kind in types.tolist():
        force.addParticle([kind] if typed else [])
    for i, j in exclusions:
        force.addExclusion(i, j)
    force.setNonbondedMethod(force.CutoffPeriodic if periodic else force.CutoffNonPeriodic)
    force.setCutoffDistance(h)
    return force
