"""Dimensionless groups of a scene for a table of steps: total friction and repulsion of its layers, and charges; for many-body liquids
friction, and stiffness at their own density."""

import json
import math
from functools import lru_cache
from importlib.resources import files
from itertools import combinations_with_replacement
from typing import Any

import numpy as np

from ..model.internal import InternalEnergy
from ..model.pairs import NONE
from ..model.scene import Scene
from ..plan.kinds import kind_for
from .stability_table import Groups, StabilityTable, drag, shipped_table

#: How to measure a scene that is not in the table.
_SCRIPT = "benchmarks/recommended_steps.py measures the temperatures of scenes at a step"


def groups(scene: Scene) -> tuple[list[Groups], list[str]]:
    """Dimensionless groups of every pair of types that repels, and what the table does not cover.

    Layers add up.  The repulsion of a pair is a = cutoff^2/kT times the sum of its curvatures A/cutoff; with equal cutoffs, that of the
    summed A.  Layers of different cutoffs are replaced by one layer with the full curvature, at each of their cutoffs, and the worst
    counts.  Friction adds up as the drag on a bead, for any cutoffs.

    A mixture is treated as the worst of the fluids that its pairs of types would form at its density, each with its own friction, if any,
    and with the mean friction of all beads, well mixed, which removes the heat of a long step.

    Returns
    -------
    groups : list of Groups
        Empty if the table does not cover the scene.
    notes : list of str
        The reason, and what else is not covered.
    """
    kT = scene.initial_kT
    if kT <= 0:
        return [], ["the temperature is 0"]
    if scene.box is None:
        return [], ["there is no box, hence no density"]
    moves = ~scene.immobile
    if not moves.any():
        return [], ["no bead moves"]
    walls = "walls, which heat beads near them"
    unmeasured: dict[str, object] = {walls: scene.walls, "segmental repulsion": scene.segments, "a shear": scene.shear}
    for what, there in unmeasured.items():
        if there:
            return [], [f"no steps were measured with {what}: halve the step until your results stay the same ({_SCRIPT})"]
    if is_many_body(scene):
        return many_body_groups(scene, moves)
    for table in scene.tables:
        if table.kind is not None and kind_for(table.kind).frictions is None:
            return [], [f"no steps were measured with {table.kind.__name__}: halve the step until your results stay the same ({_SCRIPT})"]
    terms = _terms(scene, moves)
    curvatures = {pair: _curvatures(layers) for pair, layers in terms.items()}
    if any(value < 0 for found in curvatures.values() for value in found.values()):
        return [], ["no steps were measured with an attraction (A < 0)"]
    density, masses = scene.n_beads / float(np.prod(np.diag(scene.box))), scene.bead_masses[moves]
    drags = {pair: sum(drag(g, density * t.cutoff**3, s) for t in layers for g, s in _frictions(t, kT)) for pair, layers in terms.items()}
    if not any(drags.values()):
        return [], ["there is no friction"]
    mean = _mean(scene, moves, drags)
    fluids = {
        (cutoff, sum(found.values()), friction)
        for pair, found in curvatures.items()
        for cutoff in found
        for friction in {drags[pair] or mean, mean}
    }
    if not fluids:
        fluids = {(term.cutoff, 0.0, drags[pair] or mean) for pair, layers in terms.items() for term in layers}
    exponents = {s for layers in terms.values() for term in layers for gamma, s in _frictions(term, kT) if gamma > 0}

    light, ratio, capacity = float(masses.min()), float(masses.max() / masses.min()), _heat_capacity(scene)
    found = []
    for cutoff, curvature, friction in sorted(fluids):
        a, rho, unit = curvature * cutoff**2 / kT, density * cutoff**3, cutoff * (light / kT) ** 0.5
        reduced = friction * cutoff / (light * kT) ** 0.5
        found += [Groups(reduced / drag(1.0, rho, s), a, rho, ratio, s, capacity, unit) for s in sorted(exponents)]
    return found, _notes(scene, drags)


def steps_table(scene: Scene) -> StabilityTable:
    """The table of steps that comes with the package for this kind of scene, soft or many-body."""
    return shipped_many_body() if is_many_body(scene) else shipped_table()


def _terms(scene: Scene, moves: np.ndarray) -> dict[tuple[str, str], list]:
    """Coefficients of all layers for each pair of types with beads, at least one of which is mobile."""
    names = np.array(scene.type_names)
    present, moving = (set(names[np.unique(ids)].tolist()) for ids in (scene.type_ids, scene.type_ids[moves]))
    layers = [table.resolve(scene.type_names) for table in scene.tables]
    pairs = [pair for pair in combinations_with_replacement(scene.type_names, 2) if present.issuperset(pair) and moving.intersection(pair)]
    return {pair: [layer[pair] for layer in layers if layer.get(pair, NONE) is not NONE] for pair in pairs}  # type: ignore[misc]


def _curvatures(layers: list) -> dict[float, float]:
    """Curvature A/cutoff of the repulsion, kJ/mol/nm^2, by cutoff, nm."""
    found: dict[float, float] = {}
    for layer in layers:
        found[layer.cutoff] = found.get(layer.cutoff, 0.0) + layer.A / layer.cutoff
    return {cutoff: curvature for cutoff, curvature in found.items() if curvature}


def _frictions(layer, kT: float) -> list[tuple[float, float]]:
    """Friction coefficients (Da/ps) of a layer, each with the exponent of its noise."""
    frictions = kind_for(type(layer)).frictions
    return frictions(layer, kT) if frictions else []


def _mean(scene: Scene, moves: np.ndarray, drags: dict[tuple[str, str], float]) -> float:
    """Mean drag on a mobile bead if all beads are well mixed, Da/ps; equal to that of the pairs if all are equal."""
    if len(set(drags.values())) == 1:
        return next(iter(drags.values()))
    names = scene.type_names
    around, moving = (np.bincount(ids, minlength=len(names)) / len(ids) for ids in (scene.type_ids, scene.type_ids[moves]))
    number = {name: k for k, name in enumerate(names)}
    matrix = np.zeros((len(names), len(names)))
    for (first, second), value in drags.items():
        matrix[number[first], number[second]] = matrix[number[second], number[first]] = value
    return float(moving @ matrix @ around)


def _notes(scene: Scene, drags: dict[tuple[str, str], float]) -> list[str]:
    """Notes about properties of a scene that the table does not cover."""
    alone = [first for (first, second), value in drags.items() if first == second and not value]
    notes = [f"beads of type {name} have no friction among themselves; the step is for a mixture with others nearby" for name in alone]
    return notes


def surroundings(pairs: list[Groups]) -> float:
    """omega^2 (1/ps^2) of a bead among its soft neighbours, the largest of all pairs of types; 0 without any.  It is proportional to A and
    density, and scaled from the mean over the stable modes of the standard fluid, weighted by omega^2 as in configurational temperatures
    (117 at A = 25 and density 3, from the Hessian of 400 beads)."""
    return max((4.7 * at.a * at.rho / 3.0 / at.unit_time**2 for at in pairs), default=0.0)


def charge_frequency(scene: Scene) -> float:
    """Largest frequency of two opposite charges at the same point, from the curvature at r = 0, rad/ps; 0 without charges, and for point
    charges, which something else keeps apart."""
    if scene.electrostatics is None or scene.charges is None:
        return 0.0
    q, inverse = scene.charges, 1.0 / scene.bead_masses
    ions = {sign: np.unique(np.stack([q, inverse], axis=1)[sign * q > 0], axis=0) for sign in (1, -1)}
    if not len(ions[1]) or not len(ions[-1]) or scene.electrostatics.steepness == math.inf:
        return 0.0
    ends = [-a[0] * b[0] * (a[1] + b[1]) for a in ions[1] for b in ions[-1]]
    h = 1e-3 / scene.electrostatics.steepness
    centre, beside = scene.electrostatics.potential(np.array([0.0, h]))
    curvature = 2.0 * float(centre - beside) / h**2 * scene.electrostatics.coulomb(scene.initial_kT)
    return float(curvature * max(ends)) ** 0.5


def _heat_capacity(scene: Scene) -> float | None:
    """Smallest heat capacity of a bead near its temperature, in units of k_B, or None."""
    if not isinstance(scene.internal, InternalEnergy):
        return None
    kT = scene.initial_kT
    states = scene.internal.by_type(scene.type_names)
    return min(float((state.energy(1.01 * kT) - state.energy(0.99 * kT)) / (0.02 * kT)) for state in states)


#: Measured range of the repulsion relative to that of the attraction; and how to measure others.
RANGE = 0.75
_LIQUIDS = "benchmarks/many_body.py measures steps of such liquids"


def liquid_density(a: float, b: float, reach: float = RANGE) -> float:
    """Density of a many-body liquid at zero pressure, N rc^3/V; 0 if there is no liquid.

    Warren's equation of state, Phys. Rev. E 68, 066702 (2003): p = rho + alpha a rho^2 + 2 alpha b reach^4 (rho^3 - 4.16 rho^2 + 18),
    alpha = 0.101.

    Parameters
    ----------
    a, b : float
        A rc/kT and B/(kT rc^2), with rc the cutoff of the attraction.
    reach : float
        Cutoff of the repulsion over rc.
    """
    many = 0.202 * b * reach**4
    roots = np.roots([many, 0.101 * a - 4.16 * many, 1.0, 18.0 * many])
    return max(0.0, *(float(root.real) for root in roots if abs(root.imag) < 1e-9))


def stiffness(a: float, b: float, rho: float) -> float:
    """b rho^2, to which the many-body repulsion's part of omega^2 is proportional."""
    return b * rho**2


def is_many_body(scene: Scene) -> bool:
    """Whether beads interact only by many-body coefficients."""
    return bool(scene.tables) and all(table.kind is not None and kind_for(table.kind).has_densities for table in scene.tables)


def many_body_groups(scene: Scene, moves: np.ndarray) -> tuple[list[Groups], list[str]]:
    """Dimensionless groups of a many-body liquid, with the stiffness in place of the repulsion, and notes on what is not covered."""
    present = {scene.type_names[k] for k in np.unique(scene.type_ids)}
    found = {c for pair, c in scene.tables[0].resolve(scene.type_names).items() if present.issuperset(pair)}
    why = None
    if len(scene.tables) > 1 or len(found) > 1:
        why = "several many-body liquids"
    elif scene.bonded or scene.electrostatics is not None:
        why = "many-body beads with bonds or charges"
    if why:
        return [], [f"no steps were measured with {why}: halve the step until your results stay the same ({_LIQUIDS})"]
    assert scene.box is not None
    coefficient: Any = found.pop()
    kT, mass = scene.initial_kT, float(scene.bead_masses[moves].min())
    rc, reach = coefficient.cutoff, coefficient.cutoff_B / coefficient.cutoff
    if coefficient.kernel != "quadratic" or abs(reach - RANGE) > 1e-6:
        return [], [f"many-body steps were measured only with the quadratic kernel and cutoff_B = {RANGE:g} cutoff ({_LIQUIDS})"]
    if coefficient.gamma <= 0:
        return [], ["there is no friction"]
    a, b = coefficient.A * rc / kT, coefficient.B / (kT * rc**2)
    rho = max(liquid_density(a, b), scene.n_beads * rc**3 / float(np.prod(np.diag(scene.box))))
    ratio = float(scene.bead_masses[moves].max()) / mass
    reduced = coefficient.gamma * rc / (mass * kT) ** 0.5
    return [Groups(reduced, stiffness(a, b, rho), mass=ratio, unit_time=rc * (mass / kT) ** 0.5)], []


@lru_cache(maxsize=1)
def shipped_many_body() -> StabilityTable:
    """The table of steps for many-body liquids that comes with the package."""
    return StabilityTable(json.loads(files(__package__).joinpath("many_body.json").read_text()))
