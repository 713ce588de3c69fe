"""Units, box, lattices and regions: where beads are."""

import numpy as np

from ..deck import UNITS, Deck

_CELLS = {"sc": (1, (1, 1, 1)), "bcc": (2, (1, 1, 1)), "fcc": (4, (1, 1, 1)), "diamond": (8, (1, 1, 1))}
_CELLS["hcp"] = (4, (1, 3**0.5, (8 / 3) ** 0.5))
_ORIENT = (
    ((1, 0, 0), (0, 1, 0), (0, 0, 1)),
    ((0, 1, 0), (0, 0, 1), (1, 0, 0)),
    ((1, 1, 0), (-1, 1, 0), (0, 0, 1)),
    ((0, 1, 0), (-1, 0, 0), (0, 0, 1)),
)


def units(deck: Deck, names: tuple[str, ...] = ("lj", "lj", "real", "metal")) -> None:
    """A unit style; lj may be left to the default."""
    name = deck.draw.pick(names)
    deck.units = next(found for found in UNITS if found.name == name)
    if name != "lj" or deck.draw.chance(0.5):
        deck.add("units", name)


def lattice(deck: Deck) -> np.ndarray:
    """A lattice command; returns what a lattice spacing is."""
    draw = deck.draw
    style = draw.pick([*_CELLS, "sc", "sc", "custom"])
    if style == "custom":
        basis = [[draw.pick([0.0, 0.25, 0.5, 0.75]) for _ in range(3)] for _ in range(draw.whole(1, 3))]
        cell = np.diag([draw.pick([1.0, 1.0, 1.2, 0.75]) for _ in range(3)])
        if draw.chance(0.3):
            cell[1, 0] = draw.pick([0.25, -0.5, 0.1])
    else:
        basis, cell = [[0.0] * 3] * _CELLS[style][0], np.diag(_CELLS[style][1]).astype(float)
    length = float(f"{deck.units.length * draw.pick([1.0, 0.9, 0.66, 1.1, draw.uniform(0.6, 1.3)]):.3g}")
    volume = float(np.linalg.det(cell))
    scale = float(f"{len(basis) / volume / length**3:.4g}") if deck.units.name == "lj" else length
    constant = (len(basis) / volume / scale) ** (1 / 3) if deck.units.name == "lj" else scale
    words: list[object] = []
    if style == "custom":
        words += [word for k in range(3) for word in (f"a{k + 1}", *map(float, cell[k]))]
        words += [word for point in basis for word in ("basis", *point)]
    rotation = np.eye(3)
    if draw.chance(0.2):
        orient = np.array(draw.pick(_ORIENT), dtype=float)
        rotation = orient / np.linalg.norm(orient, axis=1)[:, None]
        words += [word for axis, row in zip("xyz", orient, strict=True) for word in ("orient", axis, *(int(v) for v in row))]
    if np.any(rotation % 1):
        # faces of the box would cut through rows of points whose coordinates are no round numbers: rounding would decide which are inside
        words += ["origin", 0.1234, 0.0789, 0.0567]
    elif draw.chance(0.4):
        words += ["origin", *(draw.pick([0.0, 0.1, 0.25, 0.5]) for _ in range(3))]
    deck.add("lattice", style, scale, *words)
    corners = np.array([[i, j, k] for i in (0, 1) for j in (0, 1) for k in (0, 1)]) @ (constant * cell @ rotation.T)
    return np.ptp(corners, axis=0)


def box(deck: Deck, spacing: np.ndarray, cells: tuple[int, int] = (3, 5), tilted: float = 0.35, name: str = "box") -> None:
    """The region of the box."""
    draw = deck.draw
    in_cells = draw.chance(0.7)
    scale = spacing if in_cells else np.full(3, deck.units.length)
    corner = [draw.pick([0, 0, 0, 1, -2, 0.5]) for _ in range(3)]
    counts = [draw.whole(*cells) if draw.chance(0.8) else draw.real(*map(float, cells)) for _ in range(3)]
    low = np.array(corner) * (scale if in_cells else 1.0)
    edges = np.array(counts) * scale
    numbers = [
        float(f"{value:.12g}")
        for k in range(3)
        for value in ((corner[k], corner[k] + counts[k]) if in_cells else (low[k], low[k] + edges[k]))
    ]
    tilt = np.zeros(3)
    if draw.chance(tilted):
        factors = [draw.pick([0.0, 0.25, -0.5, 0.4, 0.1, draw.uniform(-0.5, 0.5)]) for _ in range(3)]
        tilts = [float(f"{f * counts[k] * (1 if in_cells else scale[k]):.3g}") for f, k in zip(factors, (0, 0, 1), strict=True)]
        tilt = np.array(tilts) * (scale[[0, 0, 1]] if in_cells else 1.0)
        deck.add("region", name, "prism", *numbers, *tilts, *([] if in_cells else ["units", "box"]))
    else:
        deck.add("region", name, "block", *numbers, *([] if in_cells else ["units", "box"]))
    deck.low, deck.edges, deck.tilt = tuple(map(float, low)), tuple(map(float, edges)), tuple(map(float, tilt))  # type: ignore[assignment]
    deck.regions.append(name)


def region(deck: Deck, spacing: np.ndarray) -> str:
    """A region in or about the box."""
    draw, name = deck.draw, deck.name("r")
    in_cells = draw.chance(0.7)
    scale = spacing if in_cells else np.ones(3)

    def coordinate(axis: int) -> float:
        low, edge = deck.low[axis], deck.edges[axis]
        value = (low + draw.uniform(-0.2, 1.2) * edge) / scale[axis]
        nice = 0.5 if in_cells else 0.25 * deck.units.length
        return float(f"{round(value / nice) * nice if draw.chance(0.7) else value:.6g}")

    def ends(axis: int) -> list[object]:
        found = sorted((coordinate(axis), coordinate(axis)))
        return [draw.pick([found[0], found[0], "INF", "EDGE"]), draw.pick([found[1], found[1], "INF", "EDGE"])]

    def radius() -> float:
        return float(f"{draw.uniform(0.2, 0.8) * deck.edges[0] / scale[0]:.2g}")

    style = draw.pick(["block", "block", "block", "sphere", "cylinder", "prism", "union", "intersect"])
    known = [found for found in deck.regions if found != "box"]
    if style in ("union", "intersect") and len(known) >= 2:
        parts = draw.some(known, 2, 3)
        words: list[object] = [len(parts), *parts]
    elif style == "sphere":
        words = [coordinate(0), coordinate(1), coordinate(2), radius()]
    elif style == "cylinder":
        axis = draw.whole(0, 2)
        others = [k for k in range(3) if k != axis]
        words = ["xyz"[axis], *(coordinate(k) for k in others), radius(), *ends(axis)]
    elif style == "prism":
        sides = [sorted((coordinate(k), coordinate(k) + 1.0)) for k in range(3)]
        words = [*(v for side in sides for v in side), *(draw.pick([0.0, 0.5, -0.5, 0.3]) for _ in range(3))]
    else:
        style, words = "block", [word for k in range(3) for word in ends(k)]
    if draw.chance(0.2):
        words += ["side", draw.pick(["in", "out"])]
    if not in_cells or draw.chance(0.1):
        words += ["units", "lattice" if in_cells else "box"]
    deck.add("region", name, style, *words)
    deck.regions.append(name)
    return name
