"""Crystal lattices of the ``lattice`` command, in the deck's unit of length."""

import math
from dataclasses import dataclass

import numpy as np

from ...base.errors import ParameterError
from ..language import arguments as read
from .box import Box

_CUBE = np.eye(3)
_HCP = np.diag([1.0, np.sqrt(3.0), np.sqrt(8.0 / 3.0)])
_FCC = [[0, 0, 0], [0.5, 0.5, 0], [0.5, 0, 0.5], [0, 0.5, 0.5]]
# points are in LAMMPS's order, which determines the ids of the beads
_DIAMOND = np.array([[x + s, y + s, z + s] for s in (0.0, 0.25) for x, y, z in ((0, 0, 0), (0, 0.5, 0.5), (0.5, 0, 0.5), (0.5, 0.5, 0))])

#: Lattice styles: vectors of the unit cell (rows) in units of the lattice constant, and the basis in fractions of the cell.
CELLS: dict[str, tuple[np.ndarray, np.ndarray]] = {
    "sc": (_CUBE, np.zeros((1, 3))),
    "bcc": (_CUBE, np.array([[0, 0, 0], [0.5, 0.5, 0.5]])),
    "fcc": (_CUBE, np.array(_FCC)),
    "hcp": (_HCP, np.array([[0, 0, 0], [0.5, 0.5, 0], [0.5, 5 / 6, 0.5], [0, 1 / 3, 0.5]])),
    "diamond": (_CUBE, _DIAMOND),
    "sq": (_CUBE, np.zeros((1, 3))),
    "sq2": (_CUBE, np.array([[0, 0, 0], [0.5, 0.5, 0]])),
    "hex": (np.diag([1.0, np.sqrt(3.0), 1.0]), np.array([[0, 0, 0], [0.5, 0.5, 0]])),
}
#: Those of two dimensions.
_FLAT = ("sq", "sq2", "hex")


@dataclass(frozen=True)
class Lattice:
    """A lattice with the points ``rotation @ (scale * (primitive @ n)) + offset``, where n is a vector of integers plus a basis point."""

    style: str  #: A key of :data:`CELLS`, ``custom`` or ``none``
    primitive: np.ndarray  #: (3, 3) unit cell vectors as columns, in units of the lattice constant
    scale: float  #: The lattice constant, in the deck's unit of length
    rotation: np.ndarray  #: (3, 3) rotation matrix of ``orient``
    basis: np.ndarray  #: (B, 3) fractions of the unit cell; empty for ``none``
    offset: np.ndarray  #: (3,) position of the lattice's origin
    spacing: np.ndarray  #: (3,) the lattice spacing that ``units lattice`` refers to

    def points(self, box: Box) -> tuple[np.ndarray, np.ndarray]:
        """Lattice points inside a box, x fastest, and the index of the basis point of each.  Points on an upper face are left out: they are
        periodic images of points on the lower face."""
        inverse = np.linalg.inv(self.scale * (self.rotation @ self.primitive))
        reached = (_CORNERS @ box.vectors + box.low - self.offset) @ inverse.T
        low = np.floor(reached.min(axis=0)).astype(int) - 1
        high = np.ceil(reached.max(axis=0)).astype(int) + 1
        if np.prod(high - low + 1.0) > 1e9:
            raise ParameterError(
                f"the box holds about {np.prod(high - low - 1.0):.0e} cells of the lattice; is its scale what it should be?"
            )
        axes = [np.arange(a, b + 1) for a, b in zip(low, high, strict=True)]
        k, j, i = np.meshgrid(np.zeros(1, dtype=int) if box.flat else axes[2], axes[1], axes[0], indexing="ij")
        cells = np.stack([i, j, k], axis=-1).reshape(-1, 1, 3)
        points = _placed((cells + self.basis).reshape(-1, 3), self.primitive, self.scale, self.rotation) + self.offset
        numbers = np.tile(np.arange(len(self.basis)), len(cells))
        # as in LAMMPS: a point a rounding error outside a lower face counts, its image at the upper face does not
        inside = box.holds(points, lower=1e-6, upper=2e-6)
        return points[inside], numbers[inside]


_CORNERS = np.array([[i, j, k] for i in (0, 1) for j in (0, 1) for k in (0, 1)])


def _placed(cells: np.ndarray, primitive: np.ndarray, scale: float, rotation: np.ndarray) -> np.ndarray:
    """(N, 3) coordinates relative to the lattice's origin, from fractions of the cell vectors.  The order of operations is LAMMPS's, so
    that points on faces of boxes and regions agree to the last bit."""
    return _times(rotation, _times(primitive, cells) * scale)


def _times(matrix: np.ndarray, vectors: np.ndarray) -> np.ndarray:
    x, y, z = vectors.T
    return np.stack([row[0] * x + row[1] * y + row[2] * z for row in matrix], axis=-1)


def no_lattice(spacing: float = 1.0) -> Lattice:
    """A lattice without points.  Before any lattice command, ``units lattice`` means one unit of length."""
    return Lattice("none", np.eye(3), 1.0, np.eye(3), np.zeros((0, 3)), np.zeros(3), np.full(3, spacing))


def parse_lattice(args: list[str], reduced: bool, dimension: int = 3) -> Lattice:
    """The lattice of ``lattice style scale keyword values ...``.  With ``reduced`` (units lj) the scale is a reduced density, otherwise a
    lattice constant."""
    read.count(args, "lattice style scale ...", 2, None)
    cells = [name for name in CELLS if (name in _FLAT) == (dimension == 2)]
    style = read.choice(args[0], f"the lattice style in {dimension} dimensions", [*cells, "custom", "none"])
    scale = read.positive(args[1], "the scale of the lattice")
    if style == "none":
        return no_lattice(scale)
    cell, basis = (a.copy() for a in CELLS.get(style, (_CUBE, np.zeros((0, 3)))))
    origin, orient = np.zeros(3), np.eye(3)
    spacing: np.ndarray | None = None
    sizes = {"origin": 3, "orient": 4, "spacing": 3} | ({"a1": 3, "a2": 3, "a3": 3, "basis": 3} if style == "custom" else {})
    for keyword, words in read.options(args[2:], sizes, "lattice"):
        values = np.array([read.number(word, f"lattice {keyword}") for word in words[-3:]])
        if keyword == "origin":
            origin = values
        elif keyword == "spacing":
            spacing = values
        elif keyword == "orient":
            orient["xyz".index(read.choice(words[0], "the axis of orient", "xyz"))] = values
        elif keyword == "basis":
            basis = np.vstack([basis, values])
        else:
            cell[int(keyword[1]) - 1] = values
    if dimension == 2 and np.any([*cell[:2, 2], *cell[2, :2], *basis[:, 2], origin[2], *orient[2, :2], *orient[:2, 2]]):
        raise ParameterError("in two dimensions a lattice must have no vector, basis point or origin outside the plane")
    return _assemble(style, scale, cell, basis, origin, orient, spacing, dimension if reduced else None)


def _assemble(style: str, scale: float, cell, basis, origin, orient, spacing: np.ndarray | None, reduced: int | None) -> Lattice:
    if not len(basis):
        raise ParameterError("a custom lattice needs at least one basis point")
    (a, b, c), (u, v, w) = cell[1:]
    volume = float(cell[0, 0] * (b * w - c * v) + cell[0, 1] * (c * u - a * w) + cell[0, 2] * (a * v - b * u))
    if volume <= 0:
        raise ParameterError("the lattice vectors a1, a2, a3 must be right-handed and not coplanar")
    for values, what in ((origin, "origin"), (basis, "basis")):
        if np.any((values < 0) | (values >= 1)):
            raise ParameterError(f"lattice {what}: every value must be at least 0 and below 1")
    x, y, z = orient.T
    rotation = orient / np.sqrt(x * x + y * y + z * z)[:, None]
    if not np.allclose(rotation @ rotation.T, np.eye(3)) or np.linalg.det(rotation) < 0:
        raise ParameterError("the three orient vectors must be perpendicular and right-handed")
    constant = math.pow(len(basis) / volume / scale, 1.0 / reduced) if reduced else scale
    primitive = cell.T.copy()
    # by default the extent of the unit cell along each axis
    spacing = np.ptp(_placed(_CORNERS, primitive, constant, rotation), axis=0) if spacing is None else spacing * constant
    if np.any(spacing <= 0):
        raise ParameterError("lattice spacing: every value must be > 0")
    return Lattice(style, primitive, constant, rotation, basis, spacing * origin, spacing)
