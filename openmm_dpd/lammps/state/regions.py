"""Regions of space, in the deck's unit of length."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from ...base.errors import ParameterError
from ..language import arguments as read
from .box import Box


@dataclass(frozen=True)
class Region:
    """A region.  Points on its faces are inside; comparisons use the same operations as LAMMPS."""

    style: str  #: Its style, a key of :data:`REGION_STYLES`
    contains: Callable[[np.ndarray], np.ndarray]  #: Mask of the (N, 3) points that are inside
    bounds: tuple[np.ndarray, np.ndarray] | None = None  #: Corners of an enclosing box, infinite where the region is INF
    box: Box | None = None  #: The box that ``create_box`` makes of it (block and prism only)
    #: Lower and upper corner (perhaps infinite) of a block, or centre and radius of a sphere; None for other regions.
    shape: tuple[np.ndarray, np.ndarray] | tuple[np.ndarray, float] | None = None
    parts: tuple[str, ...] = ()  #: Names of the regions in a union or intersection


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
    return Region("block", lambda points: np.all((points >= low) & (points <= high), axis=1), (low, high), made, (low, high))


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

    return Region("prism", contains, prism.bounds, prism)


def _distance(points: np.ndarray, centre: np.ndarray) -> np.ndarray:
    """Distances with LAMMPS's order of operations: whether a point on the surface is inside depends on the last bit."""
    return np.sqrt(sum((x - c) * (x - c) for x, c in zip(points.T, centre, strict=True)))


def _sphere(words: list[str], scale: np.ndarray, box: Box | None) -> Region:
    centre = np.array([read.number(word, "the centre of the sphere") for word in words[:3]]) * scale
    radius = read.non_negative(words[3], "the radius of the sphere") * scale[0]
    bounds = (centre - radius, centre + radius)
    return Region("sphere", lambda points: _distance(points, centre) <= radius, bounds, shape=(centre, radius))


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

    return Region("cylinder", contains, (corner, opposite) if np.isfinite(high - low) else None)


#: Region styles given by coordinates: number of coordinates, and builder.
REGION_STYLES: dict[str, tuple[int, Callable[[list[str], np.ndarray, Box | None], Region]]] = {
    "block": (6, _block),
    "prism": (9, _prism),
    "sphere": (4, _sphere),
    "cylinder": (6, _cylinder),
}


def parse_region(args: list[str], spacing: np.ndarray, box: Box | None, known: dict[str, Region]) -> Region:
    """The region of ``region ID style values ... [side in|out] [units lattice|box]``; ``args`` begin with the style.  Coordinates are in
    lattice spacings (``spacing``) unless ``units box`` is given; ``EDGE`` refers to ``box``; ``known`` are the regions that ``union`` and
    ``intersect`` may name."""
    read.count(args, "region ID style values ...", 2, None)
    style = read.choice(args[0], "the region style", [*REGION_STYLES, "union", "intersect"])
    many = style not in REGION_STYLES
    used = 1 + read.integer(args[1], f"the number of regions of {style}", 2) if many else REGION_STYLES[style][0]
    words, rest = read.taken(args[1:], used, f"region style {style}")
    outside, scale = False, spacing
    for keyword, values in read.options(rest, {"side": 1, "units": 1}, "region"):
        if keyword == "side":
            outside = read.choice(values[0], "side", ("in", "out")) == "out"
        elif read.choice(values[0], "units", ("lattice", "box")) == "box":
            scale = np.ones(3)
    region = _combined(style, words[1:], known) if many else REGION_STYLES[style][1](words, scale, box)
    return Region(style, lambda points: ~region.contains(points), parts=region.parts) if outside else region


def _combined(style: str, names: list[str], known: dict[str, Region]) -> Region:
    parts = [read.known(known, name, "region") for name in names]
    combine = np.logical_or if style == "union" else np.logical_and
    corners = [part.bounds for part in parts]
    bounds = None
    if all(pair is not None for pair in corners):
        lows, highs = (np.array([pair[n] for pair in corners if pair is not None]) for n in range(2))
        bounds = (lows.min(axis=0), highs.max(axis=0)) if style == "union" else (lows.max(axis=0), highs.min(axis=0))
    return Region(style, lambda points: combine.reduce([part.contains(points) for part in parts]), bounds, parts=tuple(names))
