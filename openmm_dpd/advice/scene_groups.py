"""Dimensionless groups of a scene for a table of steps: friction and repulsion of each species in its surroundings, and charges; for
many-body liquids friction, and stiffness at their own density."""

import math
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
#: Smallest heat capacity, k_B, at which beads of eDPD that repel each other keep their energy.
_EDPD = 1000.0


def groups(scene: Scene) -> tuple[list[Groups], list[str]]:
    """Dimensionless groups of every species, and what the table does not cover.

    Layers add up.  The repulsion of a pair is a = cutoff^2/kT times the sum of its curvatures A/cutoff; with equal cutoffs, that of the
    summed A.  Layers of different cutoffs are replaced by one layer with the full curvature, at each of their cutoffs, and the worst
    counts.  Friction adds up as the drag on a bead, for any cutoffs.

    A mixture is treated as the worst of its species: each has the repulsion and friction of its beads with their neighbours, the mean over
    the composition, as if well mixed.  Beads without any friction have the mean of all.

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
    unmeasured |= {"rigid bodies": scene.bodies, "bonds that form and break": scene.reactions}
    for what, there in unmeasured.items():
        if there:
            return [], [f"no steps were measured with {what}: halve the step until your results stay the same ({_SCRIPT})"]
    if is_many_body(scene):
        return many_body_groups(scene, moves)
    for table in scene.tables:
        kind = kind_for(table.kind) if table.kind is not None else None
        if kind is not None and (kind.frictions is None or kind.no_sweep(scene)):
            return [], [
                f"no steps were measured with {kind.coefficient.__name__}: halve the step until your results stay the same ({_SCRIPT})"
            ]
    terms = _terms(scene, moves)
    curvatures = {pair: _curvatures(layers, kT) for pair, layers in terms.items()}
    if any(value < 0 for found in curvatures.values() for value in found.values()):
        return [], ["no steps were measured with an attraction (A < 0)"]
    density, masses = scene.n_beads / float(np.prod(np.diag(scene.box))), scene.bead_masses[moves]
    drags = {pair: sum(drag(g, density * t.cutoff**3, s) for t in layers for g, s in _frictions(t, kT)) for pair, layers in terms.items()}
    light, ratio, capacity = float(masses.min()), float(masses.max() / masses.min()), smallest_capacity(scene)
    if hasattr(scene.internal, "heat_capacities") and any(curvatures.values()) and (capacity or 0.0) < _EDPD:
        gain = "beads of eDPD that repel each other gain energy at any step if their heat capacity is small"
        return [], [f"{gain} (0.009 kT per unit of time at 100 k_B and A 18.75); steps are known from {_EDPD:g} k_B on"]
    frictions = _around(scene, drags)
    frictions = np.where(frictions > 0, frictions, frictions[scene.type_ids[moves]].mean())
    cutoffs = sorted({cutoff for found in curvatures.values() for cutoff in found})
    repulsions = {cutoff: _around(scene, {pair: found.get(cutoff, 0.0) for pair, found in curvatures.items()}) for cutoff in cutoffs}
    exponents = {s for layers in terms.values() for term in layers for gamma, s in _frictions(term, kT) if gamma > 0} or {1.0}
    found = set()
    for k in np.unique(scene.type_ids[moves]):
        curvature = sum(values[k] for values in repulsions.values())
        own = float(scene.bead_masses[moves & (scene.type_ids == k)].min()) / light
        for cutoff in [c for c in cutoffs if repulsions[c][k]] or sorted({t.cutoff for layers in terms.values() for t in layers}):
            a, rho, unit = curvature * cutoff**2 / kT, density * cutoff**3, cutoff * (light / kT) ** 0.5
            reduced = frictions[k] * cutoff / (light * kT) ** 0.5
            found |= {Groups(float(reduced / drag(1.0, rho, s)), float(a), rho, ratio, s, capacity, unit, own) for s in exponents}
    return sorted(found, key=lambda at: (at.unit_time, at.a, at.gamma, at.s, at.own)), _notes(scene, drags)


def steps_table(scene: Scene) -> StabilityTable:
    """The table of steps that comes with the package for this kind of scene, soft or many-body."""
    return shipped_table("many_body" if is_many_body(scene) else "stability")


def _terms(scene: Scene, moves: np.ndarray) -> dict[tuple[str, str], list]:
    """Coefficients of all layers for each pair of types with beads, at least one of which is mobile."""
    names = np.array(scene.type_names)
    present, moving = (set(names[np.unique(ids)].tolist()) for ids in (scene.type_ids, scene.type_ids[moves]))
    layers = [table.resolve(scene.type_names) for table in scene.tables]
    pairs = [pair for pair in combinations_with_replacement(scene.type_names, 2) if present.issuperset(pair) and moving.intersection(pair)]
    return {pair: [layer[pair] for layer in layers if layer.get(pair, NONE) is not NONE] for pair in pairs}  # type: ignore[misc]


def _curvatures(layers: list, kT: float) -> dict[float, float]:
    """Curvature A/cutoff of the repulsion, kJ/mol/nm^2, by cutoff, nm."""
    found: dict[float, float] = {}
    for layer in layers:
        found[layer.cutoff] = found.get(layer.cutoff, 0.0) + kind_for(type(layer)).repulsion(layer, kT) / layer.cutoff
    return {cutoff: curvature for cutoff, curvature in found.items() if curvature}


def _frictions(layer, kT: float) -> list[tuple[float, float]]:
    """Friction coefficients (Da/ps) of a layer, each with the exponent of its noise."""
    frictions = kind_for(type(layer)).frictions
    return frictions(layer, kT) if frictions else []


def _around(scene: Scene, values: dict[tuple[str, str], float]) -> np.ndarray:
    """Mean of a value of pairs over the neighbours of a bead, for each type, if all are well mixed."""
    number = {name: k for k, name in enumerate(scene.type_names)}
    matrix = np.zeros((len(number), len(number)))
    for (first, second), value in values.items():
        matrix[number[first], number[second]] = matrix[number[second], number[first]] = value
    return matrix @ np.bincount(scene.type_ids, minlength=len(number)) / scene.n_beads


def _notes(scene: Scene, drags: dict[tuple[str, str], float]) -> list[str]:
    """Notes about properties of a scene that the table does not cover."""
    alone = [first for (first, second), value in drags.items() if first == second and not value and any(drags.values())]
    return [f"beads of type {name} have no friction among themselves; the step is for a mixture with others nearby" for name in alone]


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


def fastest_exchange(scene: Scene) -> float:
    """Largest rate at which two beads exchange a species, 1/ps, or a bead with all its neighbours, over 3.2; 0 without any."""
    if scene.box is None:
        return 0.0
    density = scene.n_beads / float(np.prod(np.diag(scene.box)))
    terms = _terms(scene, ~scene.immobile).values()
    return max((kind_for(type(term)).exchange(term, density) for layers in terms for term in layers), default=0.0)


def conserves(scene: Scene, pairs: list[Groups]) -> bool:
    """Whether nothing takes energy out of a scene: heat stays in its beads, or there is no friction."""
    return smallest_capacity(scene) is not None or not any(at.gamma for at in pairs)


def smallest_capacity(scene: Scene) -> float | None:
    """Smallest heat capacity of a bead near its temperature, in units of k_B, or None."""
    if capacities := getattr(scene.internal, "heat_capacities", None):
        return float(capacities(scene.n_beads).min())
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
