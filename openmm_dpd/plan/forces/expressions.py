"""Pair potentials as OpenMM expressions, and the forces made from them.

Every radial potential becomes one :class:`PairExpression`; the same text serves the CustomNonbondedForce and the bond force that puts back
scaled or coincident pairs.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field

import numpy as np
import openmm

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
