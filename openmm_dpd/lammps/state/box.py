"""The periodic box of a deck: corners, tilts, and wrapping with image flags.

Whether a bead on a face of the box or of a region counts as inside depends on the last bit, so everything here uses the same floating-point
operations in the same order as LAMMPS.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from ...base.errors import ParameterError
from ...base.geometry import reduced

#: Up to this many boxes are subtracted one at a time, as in LAMMPS; more are subtracted at once.
_ONE_BY_ONE = 100


@dataclass(frozen=True)
class Box:
    """A periodic box, orthogonal or tilted, in any unit of length."""

    #: (3,) corners of the box before it is tilted: ``xlo``, ``ylo``, ``zlo`` and ``xhi``, ``yhi``, ``zhi``.
    low: np.ndarray
    high: np.ndarray
    tilt: np.ndarray  #: (3,) ``xy``, ``xz``, ``yz``; zero for an orthogonal box
    triclinic: bool = False  #: Whether the box was defined with tilts, even if they are 0
    periodic: tuple[bool, bool, bool] = (True, True, True)  #: Axes along which the box is periodic; if any is not, the box has no tilts

    flat: bool = False  #: Whether beads are in the plane z = 0, and the edge along z has no meaning

    def __post_init__(self):
        for name in ("low", "high", "tilt"):
            object.__setattr__(self, name, np.array(getattr(self, name), dtype=np.float64))
        for axis, edge in zip("xyz", self.edges, strict=True):
            if not edge > 0:
                raise ParameterError(f"the box must have a positive length along {axis}, not {edge:g}")

    @property
    def edges(self) -> np.ndarray:
        """``xhi - xlo``, ``yhi - ylo`` and ``zhi - zlo``, all > 0."""
        return self.high - self.low

    @property
    def vectors(self) -> np.ndarray:
        """Box vectors a, b, c as the rows of a (3, 3) array."""
        (x, y, z), (xy, xz, yz) = self.edges, self.tilt
        return np.array([[x, 0.0, 0.0], [xy, y, 0.0], [xz, yz, z]])

    @property
    def reduced_vectors(self) -> np.ndarray:
        """Vectors of the same lattice in OpenMM's reduced form (no tilt above half an edge).  Along a non-periodic axis the vector is twice
        as long; no cutoff reaches across the empty half.  In a flat box z is as long as the shorter other edge, so that no cutoff reaches
        images along z."""
        vectors = self.vectors * np.where(self.periodic, 1.0, 2.0)[:, None]
        if self.flat:
            vectors[2, 2] = min(vectors[0, 0], vectors[1, 1])
        return reduced(vectors) if self.tilt.any() else vectors

    @property
    def overtilted(self) -> bool:
        """Whether a tilt is over half an edge, so that OpenMM has another box of the same lattice."""
        return bool(np.any(np.abs(reduced(self.vectors) - self.vectors) > 1e-9 * self.edges.max()))

    @property
    def volume(self) -> float:
        """Volume, or area of a flat box."""
        x, y, z = self.edges.tolist()
        return x * y * (1.0 if self.flat else z)

    @property
    def bounds(self) -> tuple[np.ndarray, np.ndarray]:
        """Corners of the smallest orthogonal box that contains this one."""
        xy, xz, yz = self.tilt
        low, high = self.low.copy(), self.high.copy()
        for axis, shift in ((0, xy), (0, xz), (1, yz)):
            low[axis] = min(low[axis], low[axis] + shift)
            high[axis] = max(high[axis], high[axis] + shift)
        return low, high

    def scaled(self, factor: float) -> Box:
        """The box in another unit of length."""
        return replace(self, low=self.low * factor, high=self.high * factor, tilt=self.tilt * factor)

    def following(self, vectors: np.ndarray, about: np.ndarray | None = None) -> Box:
        """The box with new vectors (3, 3) from a simulation (reduced form, same unit) and the same lower corner, or scaled ``about`` a
        point.  The box itself is returned if the vectors differ from its own by rounding only."""
        own, rounding = self._own
        if (np.abs(vectors - own) <= rounding).all():
            return self
        low = self.low if about is None else about + (self.low - about) * (np.diag(vectors) / self.edges)
        high, tilt = low + np.diag(vectors), np.array([vectors[1][0], vectors[2][0], vectors[2][1]])
        return replace(self, low=low, high=np.where([True, True, not self.flat], high, self.high), tilt=tilt)

    @cached_property
    def _own(self) -> tuple[np.ndarray, np.ndarray]:
        """The reduced vectors and their rounding errors."""
        own = self.reduced_vectors
        return own, 1e-9 * (self.edges.min() + np.abs(own))

    def turned(self, images: np.ndarray, before: Box, axes: tuple[int, int], distance: float) -> np.ndarray:
        """Image flags (N, 3) that belong to ``before``, converted to this box after its upper images along the second of
        two axes have slid by ``distance`` along the first."""
        flow, gradient = axes
        tilt = flow + gradient - 1
        turns = round((before.tilt[tilt] + distance - self.tilt[tilt]) / self.edges[flow])
        return images + np.outer(images[:, gradient], turns * (np.arange(3) == flow))

    # -- positions -----------------------------------------------------------------------------------------------------------------
    def fractions(self, positions: np.ndarray) -> np.ndarray:
        """Positions in units of the box vectors, counted from the lower corner."""
        (x, y, z), (xy, xz, yz) = self.edges, self.tilt
        dx, dy, dz = (np.asarray(positions, dtype=np.float64) - self.low).T
        return np.stack(
            [1 / x * dx + -xy / (x * y) * dy + (xy * yz - y * xz) / (x * y * z) * dz, 1 / y * dy + -yz / (y * z) * dz, 1 / z * dz], axis=-1
        )

    def places(self, fractions: np.ndarray) -> np.ndarray:
        """Positions from fractions of the box vectors."""
        (x, y, z), (xy, xz, yz) = self.edges, self.tilt
        a, b, c = np.asarray(fractions, dtype=np.float64).T
        return np.stack([x * a + xy * b + xz * c, y * b + yz * c, z * c], axis=-1) + self.low

    def _coordinates(self, positions: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Coordinates in which the faces of the box are planes, and the lower and upper faces: fractions for a tilted box, positions
        otherwise."""
        if self.triclinic:
            return self.fractions(positions), np.zeros(3), np.ones(3)
        return np.array(positions, dtype=np.float64), self.low, self.high

    def holds(self, positions: np.ndarray, lower: float = 0.0, upper: float = 0.0) -> np.ndarray:
        """Mask of the (N, 3) positions inside the box, which includes its lower faces but not its upper ones.  ``lower`` and ``upper``
        shift the faces of periodic axes down, in units of the edges."""
        coordinates, low, high = self._coordinates(positions)
        period = np.where(self.periodic, high - low, 0.0)
        return np.all((coordinates >= low - lower * period) & (coordinates < high - upper * period), axis=-1)

    def settle(self, positions: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Positions wrapped into the box, and the number of boxes each was moved ((N, 3) integers to be added to the image flags).  In a
        tilted box all positions are converted to fractions and back, as in LAMMPS at the beginning of a run.  ParameterError if a position
        is not finite, or too far away for an image flag."""
        x, low, high = self._coordinates(positions)
        period = high - low
        boxes = np.floor((x - low) / period) * self.periodic
        lost = ~(np.abs(boxes) < 2**31).all(axis=1)
        if lost.any():
            raise ParameterError(f"{int(lost.sum())} of {len(lost)} positions are not finite, or more than 2^31 boxes away")
        boxes = np.where(np.abs(boxes) > _ONE_BY_ONE, boxes, 0.0)
        x = x - boxes * period
        shifts = boxes.astype(np.int64)
        while (below := (x < low) & self.periodic).any():
            x, shifts = np.where(below, x + period, x), shifts - below
        while (above := (x >= high) & self.periodic).any():
            x, shifts = np.where(above, np.maximum(x - period, low), x), shifts + above
        return self.places(x) if self.triclinic else x, shifts

    def wrap(self, positions: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Positions wrapped into the box and the number of boxes each was moved, as from :meth:`settle`, except that positions already
        inside keep every bit."""
        inside, shifts = self.settle(positions)
        coordinates, low, high = self._coordinates(positions)
        kept = np.all((coordinates >= low) & (coordinates < high) | ~np.array(self.periodic), axis=1)
        return np.where(kept[:, None], positions, inside), shifts

    def unwrap(self, positions: np.ndarray, images: np.ndarray) -> np.ndarray:
        """Positions moved from the box to the periodic images given by the flags."""
        return positions + images @ self.vectors
