"""A fluid with walls of any shape, and behind them beads of the fluid itself, which do not move."""

from collections.abc import Mapping, Sequence
from dataclasses import fields, replace
from typing import Any

import numpy as np
import openmm
import scipy

from ..base.errors import ParameterError, in_length, require, what_is
from ..base.geometry import folded
from ..base.openmm_private import vectors
from ..base.units import whole_number
from ..kernels.solids import Carried
from ..model.pairs import NONE
from ..model.planes import AnyWall, as_solids
from ..model.scene import Scene
from ..plan.continuum import other_terms
from ..plan.pair_spec import longest
from ..plan.solids import check_circles, solids_of, surface
from ..simulation.build import build

#: Moments at the end of the run, of which the second half's one is taken where the beads in the solid are nearest to the means of the first
#: half, and steps between two; powers of the nearness to the surface whose sums are compared, for each wall and over all: those on which
#: densities in the first and in the second layer beside it depend.
MOMENTS, BETWEEN, POWERS = 160, 5, (2, 12)
#: In units of kT, the mass and the cutoff: friction with frozen beads times the repulsion, below which fluids of single beads slip; the
#: repulsion below which this friction stays the same; that up to which twice the friction within the fluid is needed, and less beyond it;
#: the density up to which all this holds, the power of it by which denser fluids need less, and the friction that stiff ones need at any
#: density.  Measured: docs/measure/solid_walls.py pipe.
HELD, SOFT, TWICE, THIN, POWER, STIFF = 1250.0, 15.0, 25.0, 3.0, 1.75, 14.0
#: Parts of a scene that may be there.
_PLAIN = {"masses", "types", "positions", "pairs", "kT", "box", "velocities", "bead_masses", "compat", "body_forces", "sources"}


def frozen_layer(
    scene: Scene, walls: Sequence[AnyWall], *, dt, steps: int = 500, seed: int | None = None, types: Mapping[str, str] | None = None
) -> Scene:
    """Put walls of any shape into a fluid, with a layer of the fluid itself behind them, in which beads do not move.

    The fluid, which fills the whole box, runs without walls, up to a moment when it has as many beads outside them, and near their surface,
    as on average.  Then
    beads in the solid are frozen with the velocity of their wall if the surface is within the longest cutoff, and left out if it is farther
    away.  So the fluid has the structure that it has inside up to the wall, on average over places of the surface.

    Frozen beads are of types of their own, ``W_wall`` for those of type ``W``, with so much friction with the fluid that it does not slip
    (:doc:`/theory_flow`).  This needs pairs that interact by one table of :class:`openmm_dpd.DPD`.

    Parameters
    ----------
    scene : Scene
        A fluid of single beads in a periodic box.  Body forces and sources act from the new scene on.
    walls : sequence of SolidWall and Wall
    dt, steps, seed : time, int, int
        The run, with the scheme ``middle``; it takes several hundred steps if beads start from random positions.
    types : mapping of str to str, optional
        Bead types, among the ``masses`` of the scene, that frozen beads get, by their own types, in place of those above.  Others keep
        theirs: ``{}`` freezes beads of the fluid itself, along which it may slip.

    Returns
    -------
    Scene
        Beads of the fluid with the positions and velocities after the run, then those of the walls, for which ``mobile`` is False;
        ParameterError if the scene is not a plain fluid, or the walls do not fit into it.
    """
    require(scene, Scene, "expected a Scene")
    parts = {f.name: (getattr(scene, f.name), f.default) for f in fields(Scene) if f.init and f.name not in _PLAIN}
    others = [name for name, (part, default) in parts.items() if isinstance(part, np.ndarray) or part not in (None, (), default)]
    if others:
        raise ParameterError(f"a frozen layer is made of a fluid of single beads; the scene has {', '.join(others)}")
    if not isinstance(walls, Sequence) or not walls or not all(isinstance(wall, AnyWall) for wall in walls):
        raise ParameterError(f"walls must be a sequence of SolidWall and Wall, not {what_is(walls)}")
    walls = as_solids(walls, scene.box)
    if not isinstance(types or {}, Mapping):
        raise ParameterError(f"types must be a mapping of bead types to others, not {what_is(types)}")
    if set(types or ()) - set(scene.types):
        raise ParameterError(f"no beads are of the type {min(set(types or ()) - set(scene.types))!r}")
    reach = longest([table.resolve(scene.type_names) for table in scene.tables])
    solids = solids_of(walls, scene.box, reach, np.zeros(0))
    if types is None:
        scene, types = _with_held(scene)
    simulation = build(replace(scene, body_forces=(), sources=()), dt=dt, seed=seed, platform="CPU").simulation()
    simulation.step(whole_number(steps, "steps", 0))
    sums, best, least = list[np.ndarray](), (np.zeros((0, 3)),) * 3, np.inf
    for k in range(MOMENTS):
        simulation.step(BETWEEN)
        state = simulation.context.getState(positions=True, velocities=True)
        x, v = folded(vectors(state, openmm.State.Positions), scene.box), vectors(state, openmm.State.Velocities)
        distance = solids.distance(x)
        nearest = distance.min(axis=0)
        near = np.clip(1.0 + nearest / reach, 0.0, 1.0) * (nearest <= 0)
        of_walls = np.bincount(distance.argmin(axis=0), near ** POWERS[0], len(walls))
        its = np.array([np.count_nonzero(nearest > 0), *of_walls, np.sum(near ** POWERS[1])])
        if k < MOMENTS // 2:
            sums.append(its)
            continue
        off = float(np.sum(((its - np.mean(sums, axis=0)) / np.maximum(np.std(sums, axis=0), 1e-9)) ** 2))
        if off < least:
            best, least = (x, v, distance), off
    x, v, distance = best
    points = np.concatenate([surface(solids, number)[0] for number in range(len(walls))])
    tree = scipy.spatial.cKDTree(points - solids.edges * np.floor(points / solids.edges), boxsize=solids.edges * (1 + 1e-12))
    fluid = distance.min(axis=0) > 0
    layer = ~fluid & (tree.query(x)[0] <= reach)
    for number in range(len(walls)):
        its = layer & (distance.argmin(axis=0) == number)
        v[its] = solids.velocity(number, x[its])
    wall = np.where(layer & np.array([each.moves for each in walls])[distance.argmin(axis=0)], distance.argmin(axis=0), -1)
    check_circles(Carried(wall, solids.motion, solids.edges), x, f"leave room for a layer of {in_length(reach)} behind it, in a wider box")
    kept, free = np.concatenate([np.flatnonzero(fluid), np.flatnonzero(layer)]), np.count_nonzero(fluid)
    names = [scene.types[k] if place < free else types.get(scene.types[k], scene.types[k]) for place, k in enumerate(kept)]
    changed = {"types": names, "positions": x[kept], "velocities": v[kept], "bead_masses": scene.bead_masses[kept]}
    return replace(scene, **changed, mobile=np.arange(len(kept)) < free, walls=walls)


def _with_held(scene: Scene) -> tuple[Scene, dict[str, str]]:
    """A scene with types of frozen beads that do not let the fluid slip, and their names by type."""
    tables, kT = [table.resolve(scene.type_names) for table in scene.tables], scene.initial_kT
    other = other_terms(tables)
    if other is not None:
        raise ParameterError(f"the friction of frozen beads against slip is not known, as {other}; give them a type with `types`")
    table: dict[tuple[str, str], Any] = tables[0]
    volume = float(np.prod(np.diagonal(np.asarray(scene.box))))
    masses, pairs, names = dict(scene.masses), dict(table), dict[str, str]()
    for kind in sorted(set(scene.types)):
        names[kind] = f"{kind}_wall" + "_" * sum(name.startswith(f"{kind}_wall") for name in masses)
        masses[names[kind]] = scene.masses[kind]
        for (one, two), pair in table.items():
            if kind not in (one, two) or pair is NONE:
                continue
            free = two if one == kind else one
            repulsion = max(pair.A * pair.cutoff, SOFT * kT) or 1.0
            dense = max(1.0, scene.n_beads / volume * pair.cutoff**3 / THIN) ** POWER
            held = HELD * kT / repulsion
            least = max(held / dense, min(held, STIFF)) * (scene.masses[free] * kT) ** 0.5 / pair.cutoff
            more = min(2.0, 1.0 + TWICE * kT / repulsion)
            gamma = max(more * pair.gamma, least) if pair.gamma else 0.0
            pairs[free, names[kind]] = replace(pair, gamma=gamma, gamma_perp=more * pair.gamma_perp, sigma=None)
    missing = {(a, b): NONE for a in masses for b in names.values() if (a, b) not in pairs}
    return replace(scene, masses=masses, pairs=missing | pairs), names
