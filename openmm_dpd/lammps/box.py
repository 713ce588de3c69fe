"""The periodic box of a deck: lower corner, edges and tilts, wrapping with image flags."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..errors import ParameterError


@dataclass(frozen=True)
class Box:
    """A periodic box, orthogonal or tilted, in any unit of length.

    Attributes
    ----------
    low : (3,) array
        Lower corner.
    edges : (3,) array
        ``xhi - xlo`` and so on, all > 0.
    tilt : (3,) array
        ``xy``, ``xz``, ``yz``; zero for an orthogonal box.
    triclinic : bool
        Whether the box was defined with tilts, even if they are 0.
    periodic : three bools
        Axes along which the box repeats; a box with others has no tilts.
    """

    low: np.ndarray
    edges: np.ndarray
    tilt: np.ndarray
    triclinic: bool = False
    periodic: tuple[bool, bool, bool] = (True, True, True)

    def __post_init__(self):
        for name in ("low", "edges", "tilt"):
            object.__setattr__(self, name, np.array(getattr(self, name), dtype=np.float64))
        for axis, edge in zip("xyz", self.edges, strict=True):
            if not edge > 0:
                raise ParameterError(f"the box must have a positive length along {axis}, not {edge:g}")

    @property
    def vectors(self) -> np.ndarray:
        """Box vectors a, b, c as the rows of a (3, 3) array."""
        (x, y, z), (xy, xz, yz) = self.edges, self.tilt
        return np.array([[x, 0.0, 0.0], [xy, y, 0.0], [xz, yz, z]])

    @property
    def reduced_vectors(self) -> np.ndarray:
        """Vectors of the same lattice in OpenMM's reduced form (no tilt above half an edge).

        Along an axis that does not repeat the box is followed by as much empty room, which no cutoff reaches through.
        """
        a, b, c = self.vectors * np.where(self.periodic, 1.0, 2.0)[:, None]
        c = c - b * np.round(c[1] / b[1]) if abs(c[1]) > 0.5 * b[1] * (1 + 1e-9) else c
        c = c - a * np.round(c[0] / a[0]) if abs(c[0]) > 0.5 * a[0] * (1 + 1e-9) else c
        b = b - a * np.round(b[0] / a[0]) if abs(b[0]) > 0.5 * a[0] * (1 + 1e-9) else b
        return np.array([a, b, c])

    @property
    def volume(self) -> float:
        """Volume."""
        return float(np.prod(self.edges))

    @property
    def high(self) -> np.ndarray:
        """Upper corner of the untilted box (xhi, yhi, zhi)."""
        return self.low + self.edges

    @property
    def bounds(self) -> tuple[np.ndarray, np.ndarray]:
        """Corners of the smallest orthogonal box around the tilted one."""
        corners = np.array([[i, j, k] for i in (0, 1) for j in (0, 1) for k in (0, 1)]) @ self.vectors + self.low
        return corners.min(axis=0), corners.max(axis=0)

    def scaled(self, factor: float) -> Box:
        """The box in another unit of length."""
        return Box(self.low * factor, self.edges * factor, self.tilt * factor, self.triclinic, self.periodic)

    def fractions(self, positions: np.ndarray) -> np.ndarray:
        """Positions in units of the box vectors, counted from the lower corner."""
        (xy, xz, yz), (x, y, z) = self.tilt, self.edges
        r = np.asarray(positions, dtype=np.float64) - self.low
        f = np.empty_like(r)
        f[:, 2] = r[:, 2] / z
        f[:, 1] = (r[:, 1] - yz * f[:, 2]) / y
        f[:, 0] = (r[:, 0] - xy * f[:, 1] - xz * f[:, 2]) / x
        return f

    def wrap(self, positions: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Positions moved into the box, and by how many boxes each was moved back ((N, 3) integers to be added to the image flags)."""
        boxes = np.floor(self.fractions(positions)) * self.periodic
        lost = ~(np.abs(boxes) < 2**31).all(axis=1)
        if lost.any():
            raise ParameterError(f"{int(lost.sum())} of {len(lost)} positions are not finite, or more than 2^31 boxes away")
        shifts = boxes.astype(np.int64)
        inside = np.where(shifts.any(axis=1)[:, None], positions - shifts @ self.vectors, positions)
        # a bead a rounding error below the face lands exactly on the opposite one, which belongs to the next box
        over = (np.floor(self.fractions(inside)) * self.periodic).astype(np.int64)
        inside = np.where(over.any(axis=1)[:, None], inside - over @ self.vectors, inside)
        return inside, shifts + over

    def unwrap(self, positions: np.ndarray, images: np.ndarray) -> np.ndarray:
        """Positions in the box carried back to the images that the flags name."""
        return positions + images @ self.vectors
