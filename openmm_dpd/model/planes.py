"""Planes beside walls of shapes: blocks of the solid behind them."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from ..base.errors import ParameterError, in_length
from .flow import AXES, BOUNCE_BACK, Wall, gaps
from .shapes import RoundedBox, SolidWall

#: Any wall.
AnyWall = Wall | SolidWall


@dataclass(frozen=True, eq=False)
class _Plane(RoundedBox):
    """Half of the solid behind a plane, in a box that repeats."""

    title: str = ""  # type: ignore[assignment]  # in place of the property


def checked_walls(walls: Sequence[AnyWall], box: np.ndarray | None) -> dict[str, Any]:
    """The walls of a scene, and the ``gaps`` between those that are planes: none beside walls of a shape, where planes have one, too."""
    if isinstance(walls, Sequence) and any(isinstance(wall, SolidWall) for wall in walls):
        return {"walls": as_solids(walls, box), "gaps": {}}
    return {"gaps": gaps(walls, box), "walls": tuple(walls)}  # type: ignore[arg-type]  # gaps() names what is no wall


def held_edges(scene: Any) -> dict[int, float]:
    """Edges of the box of a scene, by their axes, that have to stay as they are, since walls repeat with them."""
    solid = any(isinstance(wall, SolidWall) for wall in scene.walls)
    return {} if scene.box is None else {axis: scene.box[axis, axis] for axis in range(3) if solid or axis in scene.gaps}


def as_solids(walls: Sequence[AnyWall], box: np.ndarray | None) -> tuple[SolidWall, ...]:
    """Walls, of which planes get the shape of the solid behind them; ParameterError if they do more than let beads bounce back."""
    planes = [wall for wall in walls if not isinstance(wall, SolidWall)]
    found, made = gaps(planes, box), list[SolidWall]()
    for wall in walls:
        if isinstance(wall, SolidWall):
            made.append(wall)
            continue
        where = f"plane across {wall.axis} at {in_length(wall.position)}"
        reasons = {
            "is specular": wall.kind != BOUNCE_BACK,
            "oscillates": wall.period is not None,
            "has a fluid behind it": wall.behind is not None,
            "has no periodic box": box is None,
        }
        reason = next((reason for reason, holds in reasons.items() if holds), None)
        if reason is not None or box is None:
            raise ParameterError(f"beside walls of a shape, planes are bounce-back walls with a constant velocity; the {where} {reason}")
        axis = AXES.index(wall.axis)
        low, high = found[axis][:2]
        size, centre = np.diag(box).copy(), np.zeros(3)
        size[axis] = 0.5 * (size[axis] - (high - low))
        centre[axis] = low - 0.5 * size[axis] if wall.side == "above" else high + 0.5 * size[axis]
        made.append(SolidWall(_Plane(centre, size, title=where), velocity=wall.velocity or (0.0, 0.0, 0.0)))
    return tuple(made)
