"""Walls of any shape: their distances on a grid, and what cannot be."""

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np
import scipy

from ..base.errors import ParameterError, bead_number, either, in_length
from ..base.names import MOST_SOLIDS
from ..kernels.solids import CENTRE, SPAN, SPIN, Carried, Solids
from ..model.shapes import SolidWall

#: Spacing of the grid, in cutoffs; most points of it; depth at which a bead may start, as single precision rounds positions, in spacings.
SPACING, MOST, SLACK = 0.1, 2**22, 1e-3
#: Part of its speed with which the motion of a wall may seem to go through its surface, whose points a grid does not have exactly.
THROUGH = 0.04
_CORNERS = [(i, j, k) for i in (0, 1) for j in (0, 1) for k in (0, 1)]


def solid_walls(scene: Any, cutoff: float) -> Solids | None:
    """Walls of a scene that have a shape, for the kernel; None without any.  ParameterError if they cannot be those of the scene."""
    walls = [wall for wall in scene.walls if isinstance(wall, SolidWall)]
    if not walls:
        return None
    made = solids_of(walls, scene.box, cutoff, np.where(scene.immobile, 0.0, 1.0 / scene.bead_masses))
    distances = made.distance(scene.positions)
    distance = distances.min(axis=0)
    inside = np.flatnonzero(~scene.immobile & (distance < -made.slack))
    if len(inside):
        raise ParameterError(
            f"bead {bead_number(inside[0])} starts in a wall, {in_length(-distance[inside[0]], 3)} deep ({len(inside)} such beads). "
            "Beads of the wall itself are frozen " + either("with `mobile`", "where no fix moves them")
        )
    wall = np.where(scene.immobile & (distance <= 0), distances.argmin(axis=0), -1)
    wall[~np.array([*(each.moves for each in walls), False])[wall]] = -1
    if not (wall >= 0).any():
        return made
    carried = Carried(wall, made.motion, made.edges)
    check_circles(carried, scene.positions)
    return replace(made, carried=carried)


def check_circles(carried: Carried, x: np.ndarray, remedy: str = "leave out beads that are so far from the axis") -> None:
    """ParameterError if a bead that turns with its wall would come to where the next image of the wall turns it about another axis."""
    beads = np.flatnonzero(carried.wall >= 0)
    motion, edges = carried.motion[carried.wall[beads]], carried.edges
    spin, arms = motion[:, SPIN:CENTRE], x[beads] - motion[:, CENTRE:]
    arms -= edges * np.rint(arms / edges)
    axis = spin / np.maximum(np.linalg.norm(spin, axis=1, keepdims=True), 1e-300)
    along = np.sum(arms * axis, axis=1, keepdims=True) * axis
    across = np.linalg.norm(arms - along, axis=1, keepdims=True) * np.sqrt(np.clip(1.0 - axis**2, 0.0, None))
    far = (across > 0) & (np.abs(along) * (axis**2 < 1) + across > 0.5 * edges) & np.any(spin, axis=1, keepdims=True)
    if far.any():
        bead = beads[np.argmax(far.any(axis=1))]
        raise ParameterError(
            f"bead {bead_number(bead)} would turn with its wall, {carried.wall[bead]}, to where the next image of the wall turns it about "
            f"another axis: {remedy}"
        )


def solids_of(walls: Sequence[SolidWall], box: np.ndarray | None, cutoff: float, inv_mass: np.ndarray) -> Solids:
    """Walls with a shape in a box, for beads with these 1/masses; see :func:`solid_walls`."""
    if box is None or np.count_nonzero(box) > 3:
        raise ParameterError("walls of a shape need a periodic box that is not tilted")
    if len(walls) > MOST_SOLIDS:
        raise ParameterError(f"there are {len(walls)} walls with a shape, more than {MOST_SOLIDS}; take a Union of those that move alike")
    edges = np.diag(box).copy()
    spacing = max(SPACING * cutoff, float(np.prod(edges) / MOST) ** (1 / 3))
    counts = np.maximum(2, np.ceil(edges / spacing)).astype(int)
    axes = [edge / count * np.arange(count) for edge, count in zip(edges, counts, strict=True)]
    points = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, 3)
    distances = np.array([wall.shape.distance(points, edges).reshape(counts) for wall in walls], dtype=np.float32)
    motion = np.array([np.concatenate([wall.velocity, wall.spin, wall.centre]) for wall in walls])
    steps = [np.stack([np.roll(each, -1, axis) - each for axis in range(3)]) for each in distances]
    slopes = np.array([np.linalg.norm(np.abs(step).max(axis=(1, 2, 3)) * counts / edges) for step in steps])
    lowest = distances
    for axis, count in enumerate(counts, start=1):
        within = (SPAN * np.arange(-(-count // SPAN))[:, None] + np.arange(SPAN + 1)) % count
        lowest = lowest.take(within, axis=axis).min(axis=axis + 1)
    made = Solids(distances, lowest, edges, slopes * (1 + 1e-6), motion, inv_mass, SLACK * spacing)
    for number, (wall, step) in enumerate(zip(walls, steps, strict=True)):
        _check_surface(wall, made, number, step)
    return made


def _check_surface(wall: SolidWall, made: Solids, number: int, step: np.ndarray) -> None:
    """ParameterError if there is no surface, it is cut by the faces of the box, or the wall moves through it."""
    values, what = made.distances[number], f"wall {number} with a shape, {wall.shape.title},"
    if not (values > 0).any() or not (values < 0).any():
        raise ParameterError(f"{what} has no surface in the box: all of it is {'fluid' if (values > 0).any() else 'solid'}")
    for axis, rises in enumerate(np.abs(step)):
        before, across, after = (rises.take(k, axis) for k in (-2, -1, 0))
        crosses = values.take(-1, axis) * values.take(0, axis) < 0
        if (crosses & (across > 3.0 * np.maximum(before, after) + 1e-6 * made.edges[axis])).any():
            raise ParameterError(f"{what} is cut by the faces of the box across {'xyz'[axis]}: it does not go on in the next image")
    _check_marks(wall, made, number, what)
    if wall.moves:
        there, steep = surface(made, number)
        u = made.velocity(number, there)
        fastest, small = np.linalg.norm(u, axis=1).max(), 0.05 * made.edges / values.shape
        ahead, behind = (wall.shape.distance(there + sign * small.min() * u / fastest, made.edges) for sign in (1.0, -1.0))
        if (np.abs(ahead - behind) > THROUGH * 2.0 * small.min() * steep).any():
            raise ParameterError(f"{what} would not stay where it is as it moves: velocity and spin must be along its surface everywhere")


def _check_marks(wall: SolidWall, made: Solids, number: int, what: str) -> None:
    """ParameterError if parts of a surface are thinner than a grid shows: within two of its spacings, most marks of the surface do not have
    the solid half a spacing to one side, and the fluid to the other."""
    width = float((made.edges / made.distances.shape[1:]).max())
    marks = wall.shape.marks(made.edges, width)
    if not len(marks):
        return
    marks = marks[np.abs(wall.shape.distance(marks[:, 0], made.edges)) < 1e-3 * width]
    ahead, behind = (made.distance(marks[:, 0] + sign * 0.5 * width * marks[:, 1])[number] for sign in (1.0, -1.0))
    trees = [scipy.spatial.cKDTree(its[:, 0]) for its in (marks, marks[ahead * behind < 0])]
    around, shown = (tree.query_ball_point(marks[:, 0], 2.0 * width, return_length=True) for tree in trees)
    lost = marks[2 * shown < around, 0]
    if len(lost):
        raise ParameterError(
            f"{what} has parts, near ({', '.join(f'{value:.3g}' for value in lost[0])}), that are thinner or nearer to each other than the "
            f"spacing of the grid, {in_length(width, 2)}, or cross each other: it would have holes there; thicken them, or leave them out"
        )


def surface(made: Solids, number: int) -> tuple[np.ndarray, np.ndarray]:
    """Points (P, 3) near the surface of a wall, one for each cell of the grid that it goes through, and the gradients there (P,)."""
    values = made.distances[number].astype(float)
    corners = np.array([np.roll(values, tuple(-k for k in corner), (0, 1, 2)) for corner in _CORNERS])
    cut = (corners.min(axis=0) <= 0) & (corners.max(axis=0) > 0)
    its, sides = corners[:, cut], 2.0 * np.array(_CORNERS) - 1.0
    slope = np.einsum("cp,ck->pk", its, sides) / 4.0 * (values.shape / made.edges)
    steep = np.maximum(np.linalg.norm(slope, axis=1), 1e-6 * made.slopes[number])
    points = (np.argwhere(cut) + 0.5) * (made.edges / values.shape) - (its.mean(axis=0) / steep**2)[:, None] * slope
    return points, steep


def solid_text(wall: SolidWall, made: Any, number: int) -> str:
    """A wall in words, with the largest distance found between its surface and that of the grid."""
    points, steep = surface(made, number)
    error = np.abs((wall.shape.distance(points, made.edges) - made.distance(points)[number]) / steep).max()
    motion = {"velocity": wall.velocity, "spin": wall.spin}
    moving = "".join(f", {name} ({', '.join(f'{u:g}' for u in of)})" for name, of in motion.items() if np.any(of))
    along = 0 if made.carried is None else np.count_nonzero(made.carried.wall == number)
    moving += f", which {along} immobile beads go along with" if along else ""
    size = " x ".join(map(str, made.distances.shape[1:]))
    return f"bounce-back wall of a shape: {wall.shape.title} on a grid of {size}, off by up to {in_length(error, 2)}{moving}"
