"""Slices of a box along an axis, cells along two axes, or rings around an axis: which of them beads are in, and how large they are."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from .errors import ParameterError, what_is
from .geometry import widths
from .units import whole_number

#: Length of the mean of exp(2 pi i s) below which beads are spread too evenly to have a centre.
LEAST_RESULTANT = 0.05


def axis_number(axis: str | int) -> int:
    """Number of an axis given as ``x``, ``y``, ``z`` or 0, 1, 2; ParameterError for anything else."""
    if axis in ("x", "y", "z"):
        return "xyz".index(str(axis))
    if isinstance(axis, (int, np.integer)) and not isinstance(axis, bool) and 0 <= axis <= 2:
        return int(axis)
    raise ParameterError(f"axis must be 'x', 'y', 'z' or 0, 1, 2, not {what_is(axis)}")


def periodic_centre(fractions: np.ndarray, weights: np.ndarray) -> float:
    """Centre of mass of beads in a periodic direction, as a fraction of the box; ParameterError if they are spread too evenly to have one.
    The phase of sum w exp(2 pi i s) is the centre of a symmetric distribution (L. Bai and D. Breen, J. Graphics Tools 13, 53 (2008)); the
    mean of the positions wrapped around it is the centre of mass, unless the beads reach around the box."""
    resultant = np.sum(weights * np.exp(2j * np.pi * fractions)) / weights.sum()
    if abs(resultant) < LEAST_RESULTANT:
        raise ParameterError(
            "the beads to be centred are spread evenly along the axis, or lie at opposite places, and have no centre of mass; choose others"
        )
    guess = np.angle(resultant) / (2 * np.pi)
    around = fractions - guess - np.round(fractions - guess)
    return float(guess + np.sum(weights * around) / weights.sum())


@dataclass(frozen=True, eq=False)
class Slicer:
    """Assigns beads to slices of a box along ``axes``, or (``around``) to rings around an axis, cut along it: rings out to half the
    shorter edge across, whose axis goes through ``centre`` or the middle of the box."""

    axes: tuple[int, ...]  #: Box vectors that slices divide, parallel to the other ones; of rings the one that they are around
    bins: tuple[int, ...]  #: Number of slices along each; of rings along the radius and along the axis
    around: bool
    centre: np.ndarray | None  #: (M,) indices of beads whose centre of mass is moved to the middle, or None
    weights: np.ndarray  #: (N,) masses of all beads

    @property
    def count(self) -> int:
        """Number of cells; beads outside all rings have this number."""
        return int(np.prod(self.bins))

    def cells(self, x: np.ndarray, box: np.ndarray, v: np.ndarray | None = None) -> tuple[np.ndarray, np.ndarray | None]:
        """Number of the cell of each bead, (N,), from 0, those along the last axis next to each other; and vectors (N, 3) as they are, in
        rings along the radius, around the axis and along it."""
        s = x @ np.linalg.inv(box)
        if not self.around:
            return self._flat([self._wrapped(s[:, k], centred=True) for k in self.axes]), v
        if np.abs(box - np.diag(np.diagonal(box))).max() > 1e-5 * box.max():  # files have angles in single precision
            raise ParameterError("rings around an axis need a box with right angles")
        (axis,) = self.axes
        across = [(axis + 1) % 3, (axis + 2) % 3]  # so that turning from the first to the second is right-handed
        d = np.stack([(self._wrapped(s[:, k], centred=True) - 0.5) * box[k, k] for k in across], axis=1)
        r = np.sqrt(np.sum(d**2, axis=1))
        number = self._flat([r / self.extents(box)[0], self._wrapped(s[:, axis])])
        if v is not None:
            e = np.divide(d, r[:, None], out=np.zeros_like(d), where=r[:, None] > 0)
            a, b = v[:, across[0]], v[:, across[1]]
            v = np.stack([a * e[:, 0] + b * e[:, 1], b * e[:, 0] - a * e[:, 1], v[:, axis]], axis=1)
        return number, v

    def _wrapped(self, s: np.ndarray, centred: bool = False) -> np.ndarray:
        if centred and self.centre is not None:
            s = s - periodic_centre(s[self.centre], self.weights[self.centre]) + 0.5
        # a rounding error below 0 gives exactly 1
        return np.mod(s, 1.0) % 1.0

    def _flat(self, parts: list[np.ndarray]) -> np.ndarray:
        numbers = [np.minimum((part * n).astype(np.int64), n - 1) for part, n in zip(parts, self.bins, strict=True)]
        flat = numbers[0] if len(numbers) == 1 else numbers[0] * self.bins[1] + numbers[1]
        return np.where(parts[0] < 1.0, flat, self.count)

    def sums(self, number: np.ndarray, weights: np.ndarray | None = None) -> np.ndarray:
        """Sums over the beads of each cell, (cells,), of their weights (None: 1), given the cell ``number`` of each bead."""
        return np.bincount(number, weights, self.count + 1)[: self.count].astype(np.float64)

    def extents(self, box: np.ndarray) -> np.ndarray:
        """What the bins divide, (1,) or (2,): widths of the box along the axes, or radius of the largest ring and height, nm."""
        if not self.around:
            return widths(box)[list(self.axes)]
        edges, (axis,) = np.diagonal(box), self.axes
        return np.array([0.5 * min(edges[(axis + 1) % 3], edges[(axis + 2) % 3]), edges[axis]])

    def volumes(self, box: np.ndarray) -> np.ndarray:
        """Volume of each cell, (cells,), nm^3."""
        if not self.around:
            return np.full(self.count, np.linalg.det(box) / self.count)
        (reach, height), (rings, slices) = self.extents(box), self.bins
        return np.repeat(np.pi * np.diff((np.arange(rings + 1) * reach / rings) ** 2), slices) * height / slices

    def coordinates(self, extents: np.ndarray) -> np.ndarray:
        """Midpoints of the slices, (n,), or of cells and rings, (n, m, 2); 0 is the lower face or ``centre``, and the axis of rings."""
        low = 0.5 if self.centre is not None and not self.around else 0.0
        lines = [((np.arange(n) + 0.5) / n - low) * extent for n, extent in zip(self.bins, extents, strict=True)]
        return lines[0] if len(lines) == 1 else np.stack(np.meshgrid(*lines, indexing="ij"), axis=-1)

    def component(self, name: str | int) -> int:
        """Number of a component of the vectors of :meth:`cells`; ParameterError if there is none of this name."""
        if not self.around:
            return axis_number(name)
        names = ("r", "phi", "xyz"[self.axes[0]])
        if name not in names:
            raise ParameterError(f"the component in rings around {names[2]} must be 'r', 'phi' or {names[2]!r}, not {what_is(name)}")
        return names.index(name)


def slicer(axis: str | int, n_bins: int | Sequence[int], centre: np.ndarray | None, weights: np.ndarray, what="n_bins") -> Slicer:
    """Slicer along an axis (``"z"`` or 2), two of them (``"xz"``), or of rings (``"rz"``: radius around z, and z); ParameterError for any
    other axis, or numbers of bins that are not as many whole numbers, at least 1."""
    words, around = [axis], isinstance(axis, str) and len(axis) == 2 and axis[0] == "r"
    if isinstance(axis, str) and len(axis) == 2:
        words = [axis[1]] if around else list(axis)
        if len(set(words)) < 2 - around or not set(words) <= set("xyz"):
            raise ParameterError(f"axis must be one or two of 'x', 'y' and 'z', or 'r' before one of them, not {what_is(axis)}")
    wanted = 2 if around else len(words)
    given = list(n_bins) if isinstance(n_bins, (Sequence, np.ndarray)) and not isinstance(n_bins, str) else [n_bins] * wanted
    if len(given) != wanted:
        raise ParameterError(f"{what} must be a whole number, or one for each of {wanted} axes, not {what_is(n_bins)}")
    bins = tuple(whole_number(n, what, least=1) for n in given)
    return Slicer(tuple(axis_number(word) for word in words), bins, around, centre, weights)
