"""Regions of space, in the deck's unit of length."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from ...base.errors import ParameterError
from ..language import arguments as read
from .box import Box

#: Value of a variable, by its name.
Value = Callable[[str], float]
Distances = Callable[[np.ndarray], list[tuple[np.ndarray, np.ndarray]]]


@dataclass(frozen=True)
class Region:
    """A region.  Points on its faces are inside; comparisons use the same operations as LAMMPS."""

    style: str  #: Its style, a key of :data:`REGION_STYLES`
    contains: Callable[[np.ndarray], np.ndarray]  #: Mask of the (N, 3) points that are inside
    #: Distances (N,) of points to each face, seen from the points that the region contains, and the directions (N, 3) away from it.
    distances: Distances
    outer: Distances  #: The same of its outside
    bounds: tuple[np.ndarray, np.ndarray] | None = None  #: Corners of an enclosing box, infinite where the region is INF
    box: Box | None = None  #: The box that ``create_box`` makes of it (block and prism only)
    #: Lower and upper corner (perhaps infinite) of a block, or centre and radius of a sphere; None for other regions.
    shape: tuple[np.ndarray, np.ndarray] | tuple[np.ndarray, float] | None = None
    parts: tuple[str, ...] = ()  #: Names of the regions in a union or intersection
    #: The region with the present values of its variables; None if it has none.
    renewed: Callable[[Value | None], Region] | None = None

    @property
    def outside(self) -> Region:
        """All that is outside."""
        return Region(self.style, lambda points: ~self.contains(points), self.outer, self.distances, parts=self.parts)


def _edge(word: str, axis: int, upper: bool, scale: np.ndarray, box: Box | None) -> float:
    what = f"the {'upper' if upper else 'lower'} {'xyz'[axis]} of the region"
    if word in ("INF", "EDGE") and box is None:
        raise ParameterError(f"{what} is {word}, but there is no box yet")
    if word == "INF":
        return np.inf if upper else -np.inf
    if word == "EDGE":
        assert box is not None
        # bounds of the box that encloses a tilted one
        return float(box.bounds[upper][axis])
    return read.number(word, what) * scale[axis]


def _corners(words: list[str], scale: np.ndarray, box: Box | None) -> tuple[np.ndarray, np.ndarray]:
    low = np.array([_edge(words[2 * k], k, False, scale, box) for k in range(3)])
    high = np.array([_edge(words[2 * k + 1], k, True, scale, box) for k in range(3)])
    for k in range(3):
        if low[k] > high[k]:
            raise ParameterError(f"the region's lower {'xyz'[k]}, {words[2 * k]}, is above its upper one, {words[2 * k + 1]}")
    return low, high


def _block(words: list[str], scale: np.ndarray, box: Box | None) -> Region:
    low, high = _corners(words, scale, box)
    solid = np.all(np.isfinite(low)) and np.all(np.isfinite(high)) and np.all(high > low)
    made = Box(low, high, np.zeros(3)) if solid else None
    faces = [(k, side, end) for k in range(3) for side, end in ((1.0, low), (-1.0, high))]
    return Region(
        "block",
        lambda points: np.all((points >= low) & (points <= high), axis=1),
        lambda x: [(side * (x[:, k] - end[k]), np.broadcast_to(side * np.eye(3)[k], x.shape)) for k, side, end in faces],
        lambda x: [_away(x - np.clip(x, low, high))],
        *((low, high), made, (low, high)),
    )


def _away(arms: np.ndarray, radius: float = 0.0, side: float = 1.0) -> tuple[np.ndarray, np.ndarray]:
    """Lengths of arms beyond a radius, and their directions; ``side`` -1: short of it, towards the middle."""
    length = np.linalg.norm(arms, axis=1)
    return side * (length - radius), side * arms / np.where(length > 0, length, 1.0)[:, None]


def _nearest(x: np.ndarray, feet: list[np.ndarray]) -> tuple[np.ndarray, np.ndarray]:
    """Distances from the nearest ones of some feet (N, 3), and directions away from them."""
    best = np.array([np.linalg.norm(x - foot, axis=1) for foot in feet]).argmin(axis=0)
    return _away(x - np.array(feet)[best, np.arange(len(x))])


def _prism(words: list[str], scale: np.ndarray, box: Box | None) -> Region:
    low, high = _corners(words[:6], scale, box)
    if not (np.all(np.isfinite(low)) and np.all(np.isfinite(high))):
        raise ParameterError("a prism must be bounded: INF is not supported")
    # the tilts scale with the axis along which they displace
    tilt = np.array([read.number(word, "a tilt of the prism") for word in words[6:9]]) * scale[[0, 0, 1]]
    prism = Box(low, high, tilt, True)

    def contains(points: np.ndarray) -> np.ndarray:
        fractions = prism.fractions(points)
        return np.all((fractions >= 0) & (fractions <= 1), axis=1)

    edges, inverse = prism.vectors, np.linalg.inv(prism.vectors)
    steep = np.linalg.norm(inverse, axis=0)
    normals = inverse.T / steep[:, None]

    def inner(x: np.ndarray) -> list[tuple[np.ndarray, np.ndarray]]:
        heights = (x - low) @ inverse
        sides = [(k, s, end) for k in range(3) for s, end in ((1.0, 0.0), (-1.0, 1.0))]
        return [(s * (heights[:, k] - end) / steep[k], np.broadcast_to(s * normals[k], x.shape)) for k, s, end in sides]

    def outer(x: np.ndarray) -> list[tuple[np.ndarray, np.ndarray]]:
        feet = []
        for k in range(3):
            a, b = (axis for axis in range(3) if axis != k)
            for corner in (low + m * edges[a] + n * edges[b] for m in (0, 1) for n in (0, 1)):
                feet.append(corner + np.clip((x - corner) @ edges[k] / (edges[k] @ edges[k]), 0.0, 1.0)[:, None] * edges[k])
            for end in (0, 1):
                foot = x - ((x - low - end * edges[k]) @ normals[k])[:, None] * normals[k]
                within = np.abs((foot - low) @ inverse[:, [a, b]] - 0.5).max(axis=1) <= 0.5
                feet.append(np.where(within[:, None], foot, np.inf))
        return [_nearest(x, feet)]

    return Region("prism", contains, inner, outer, prism.bounds, prism)


def _distance(points: np.ndarray, centre: np.ndarray) -> np.ndarray:
    """Distances with LAMMPS's order of operations: whether a point on the surface is inside depends on the last bit."""
    return np.sqrt(sum((x - c) * (x - c) for x, c in zip(points.T, centre, strict=True)))


def _sphere(words: list[str], scale: np.ndarray, box: Box | None) -> Region:
    centre = np.array([read.number(word, "the centre of the sphere") for word in words[:3]]) * scale
    radius = read.non_negative(words[3], "the radius of the sphere") * scale[0]
    bounds, inner = (centre - radius, centre + radius), lambda x: [_away(x - centre, radius, -1.0)]
    return Region(
        "sphere", lambda x: _distance(x, centre) <= radius, inner, lambda x: [_away(x - centre, radius)], bounds, None, (centre, radius)
    )


def _cylinder(words: list[str], scale: np.ndarray, box: Box | None) -> Region:
    axis = "xyz".index(read.choice(words[0], "the axis of the cylinder", "xyz"))
    others = [k for k in range(3) if k != axis]
    centre = np.array([read.number(words[1 + n], "the centre of the cylinder") * scale[others[n]] for n in range(2)])
    radius = read.non_negative(words[3], "the radius of the cylinder") * scale[others[0]]
    low, high = (_edge(words[4 + n], axis, bool(n), scale, box) for n in range(2))
    corner, opposite = np.empty(3), np.empty(3)
    corner[others], opposite[others] = centre - radius, centre + radius
    corner[axis], opposite[axis] = low, high

    def contains(points: np.ndarray) -> np.ndarray:
        along = points[:, axis]
        return (_distance(points[:, others], centre) <= radius) & (along >= low) & (along <= high)

    across = np.array([k != axis for k in range(3)])
    middle, ends = np.where(across, np.insert(centre, axis, 0.0), 0.0), np.eye(3)[axis]

    def inner(x: np.ndarray) -> list[tuple[np.ndarray, np.ndarray]]:
        caps = [(side * (x[:, axis] - end), np.broadcast_to(side * ends, x.shape)) for side, end in ((1.0, low), (-1.0, high))]
        return [_away((x - middle) * across, radius, -1.0), *caps]

    def outer(x: np.ndarray) -> list[tuple[np.ndarray, np.ndarray]]:
        beyond, direction = _away((x - middle) * across, radius)
        return [_away(np.maximum(beyond, 0.0)[:, None] * direction + (x - np.clip(x, low, high)) * ends)]

    return Region("cylinder", contains, inner, outer, (corner, opposite))


def _cone(words: list[str], scale: np.ndarray, box: Box | None) -> Region:
    wide = max(read.non_negative(word, "a radius of the cone") for word in words[3:5])
    hull = _cylinder([*words[:3], repr(wide), *words[5:]], scale, box)
    axis = "xyz".index(words[0])
    others = [k for k in range(3) if k != axis]
    if hull.bounds is None or not 0 < hull.bounds[1][axis] - hull.bounds[0][axis] < np.inf or not wide:
        raise ParameterError("a cone needs finite ends, the lower below the upper, and a radius > 0 at one of them")
    (low, high), centre = (float(end[axis]) for end in hull.bounds), (hull.bounds[0] + hull.bounds[1])[others] / 2
    first, last = (read.number(word, "a radius of the cone") * scale[others[0]] for word in words[3:5])

    def contains(points: np.ndarray) -> np.ndarray:
        along = points[:, axis]
        radius = first + (along - low) * (last - first) / (high - low)
        return (_distance(points[:, others], centre) <= radius) & (along >= low) & (along <= high)

    across, ends = (np.arange(3) != axis).astype(float), np.eye(3)[axis]
    middle = across * sum(hull.bounds) / 2

    def nearest(x: np.ndarray, *segments: tuple[float, float, float, float]) -> list[tuple[np.ndarray, np.ndarray]]:
        """Of the surfaces that lines from (along, radius) to (along, radius) sweep."""
        radius, direction = _away((x - middle) * across)
        feet = []
        for z, r, dz, dr in ((a, b, c - a, d - b) for a, b, c, d in segments):
            part = np.clip(((x[:, axis] - z) * dz + (radius - r) * dr) / (dz * dz + dr * dr), 0.0, 1.0)
            feet.append(middle * across + (z + part * dz)[:, None] * ends + (r + part * dr)[:, None] * direction)
        return [_nearest(x, feet)]

    side, caps = (low, first, high, last), [(low, 0.0, low, first), (high, 0.0, high, last)]
    flat = lambda x: [(s * (x[:, axis] - end), np.broadcast_to(s * ends, x.shape)) for s, end in ((1.0, low), (-1.0, high))]  # noqa: E731
    closed = [side, *(cap for cap in caps if cap[3])]
    return Region("cone", contains, lambda x: nearest(x, side) + flat(x), lambda x: nearest(x, *closed), hull.bounds)


def _ellipsoid(words: list[str], scale: np.ndarray, box: Box | None) -> Region:
    centre = np.array([read.number(word, "the centre of the ellipsoid") for word in words[:3]]) * scale
    half = np.array([read.positive(word, "an axis of the ellipsoid") for word in words[3:]]) * scale
    products = np.prod(half) / half
    parts = half**2 - np.min(half) ** 2

    def outer(x: np.ndarray) -> list[tuple[np.ndarray, np.ndarray]]:
        """The foot is y a^2/(s + a^2 - c^2), with the shortest half axis c; Newton's steps to its s come from below only."""
        y = np.maximum(np.abs(x - centre), 1e-13 * half)
        s = np.max(half * y - parts, axis=1)
        for _ in range(60):
            ratios = half * y / (s[:, None] + parts)
            step = (np.sum(ratios**2, axis=1) - 1) / (2 * np.sum(ratios**2 / (s[:, None] + parts), axis=1))
            s += step
            if np.all(np.abs(step) <= 1e-15 * s):
                break
        foot = half**2 * y / (s[:, None] + parts)
        normal = _away(foot / half**2)[1]
        return [(np.sum((y - foot) * normal, axis=1), np.copysign(normal, x - centre))]

    return Region(
        "ellipsoid",
        lambda points: sum(((points - centre) * products).T ** 2) <= np.prod(half**2),
        lambda x: [(-r, -normal) for r, normal in outer(x)],
        outer,
        (centre - half, centre + half),
    )


def _plane(words: list[str], scale: np.ndarray, box: Box | None) -> Region:
    point = np.array([read.number(word, "the point of the plane") for word in words[:3]]) * scale
    normal = np.array([read.number(word, "the normal of the plane") for word in words[3:]]) * scale
    if not normal.any():
        raise ParameterError("the normal of the plane is zero")
    across = normal / np.linalg.norm(normal)
    sides = [lambda x, s=s: [(s * ((x - point) @ across), np.broadcast_to(s * across, x.shape))] for s in (1.0, -1.0)]
    return Region("plane", lambda points: (points - point) @ normal >= 0, sides[0], sides[1])


#: Region styles given by coordinates: number of coordinates, and builder.
REGION_STYLES: dict[str, tuple[int, Callable[[list[str], np.ndarray, Box | None], Region]]] = {
    "block": (6, _block),
    "prism": (9, _prism),
    "sphere": (4, _sphere),
    "cylinder": (6, _cylinder),
    "cone": (7, _cone),
    "ellipsoid": (6, _ellipsoid),
    "plane": (6, _plane),
}
#: Styles of which no number can be a variable in LAMMPS.
_FIXED = ("prism", "plane")


def parse_region(args: list[str], spacing: np.ndarray, box: Box | None, known: dict[str, Region], value: Value) -> Region:
    """The region of ``region ID style values ... [side in|out] [units lattice|box]``; ``args`` begin with the style.  Coordinates are in
    lattice spacings (``spacing``) unless ``units box`` is given; ``EDGE`` refers to ``box``; ``known`` are the regions that ``union`` and
    ``intersect`` may name; ``value`` is that of a variable (``v_name`` in place of a number) between two commands."""
    read.count(args, "region ID style values ...", 2, None)
    style = read.choice(args[0], "the region style", [*REGION_STYLES, "union", "intersect"])
    many = style not in REGION_STYLES
    used = 1 + read.integer(args[1], f"the number of regions of {style}", 2) if many else REGION_STYLES[style][0]
    words, rest = read.taken(args[1:], used, f"region style {style}")
    outside, scale, reason = False, spacing, "moving regions are not supported; use a variable for the coordinate, as in 'sphere v_x 0 0 5'"
    for keyword, values in read.options(
        rest, {"side": 1, "units": 1, "move": 3, "rotate": 7}, "region", only=dict.fromkeys(("move", "rotate"), ("NULL", reason))
    ):
        if keyword == "side":
            outside = read.choice(values[0], "side", ("in", "out")) == "out"
        elif keyword == "units" and read.choice(values[0], "units", ("lattice", "box")) == "box":
            scale = np.ones(3)
    parts = [read.known(known, name, "region") for name in words[1:]] if many else []
    varies = any(part.renewed for part in parts) or (not many and any(word.startswith("v_") for word in words))
    if varies and style in _FIXED:
        raise ParameterError(f"region style {style} takes no variables, as in LAMMPS; use the value, ${{name}}")

    def made(of: Value | None) -> Region:
        if many:
            found = _combined(style, tuple(words[1:]), [part.renewed(of) if part.renewed else part for part in parts])
        else:
            numbers = [repr((of or value)(word[2:])) if word.startswith("v_") else word for word in words]
            found = REGION_STYLES[style][1](numbers, scale, box)
            found = found if numbers == words else replace(found, bounds=None)  # LAMMPS has none of what may change
        return found.outside if outside else found

    return replace(made(None), renewed=made if varies else None)


def _combined(style: str, names: tuple[str, ...], parts: list[Region]) -> Region:
    combine = np.logical_or if style == "union" else np.logical_and
    corners = [part.bounds for part in parts if part.bounds is not None]
    bounds = None
    if len(corners) == len(parts) or (corners and style == "intersect"):
        lows, highs = (np.array([pair[n] for pair in corners]) for n in range(2))
        bounds = (lows.min(axis=0), highs.max(axis=0)) if style == "union" else (lows.max(axis=0), highs.min(axis=0))

    def distances(x: np.ndarray, parts: list[Region], one: bool) -> list[tuple[np.ndarray, np.ndarray]]:
        """Of faces where no other part goes on: of a union (``one``) those outside all others, of an intersection those inside."""
        found = []
        for k, part in enumerate(parts):
            for r, normal in part.distances(x):
                foot = x - np.where(np.isfinite(r), r, 0.0)[:, None] * normal
                others = [each.contains(foot) != one for each in parts[:k] + parts[k + 1 :]]
                found.append((np.where(np.logical_and.reduce([part.contains(x), *others]), r, np.inf), normal))
        return found

    apart, union = [part.outside for part in parts], style == "union"
    return Region(
        *(style, lambda points: combine.reduce([part.contains(points) for part in parts])),
        *(lambda x: distances(x, parts, union), lambda x: distances(x, apart, not union)),
        bounds,
        parts=names,
    )
