"""Sources of heat or of a species in a part of the box."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..base.errors import ParameterError, what_is
from ..base.geometry import folded
from ..base.units import keep, to_md
from .pairs import checked


def point(value, name: str) -> np.ndarray:
    """A point as an array (3,), nm; ParameterError if it is not three lengths."""
    array = np.asarray(to_md(value, "length", name))
    if array.shape != (3,):
        raise ParameterError(f"{name} must be three lengths, not an array of shape {array.shape}")
    return array


@dataclass(frozen=True, eq=False)
class Block:
    """The cuboid low <= x <= high.

    Parameters
    ----------
    low, high : three lengths
        Corners, nm; infinite where the block is unbounded.
    """

    low: np.ndarray
    high: np.ndarray

    def __post_init__(self):
        for name in ("low", "high"):
            # infinite faces are allowed, other values that are not finite are not
            values = np.array(
                [np.sign(v) * np.inf if isinstance(v, float) and np.isinf(v) else to_md(v, "length", name) for v in getattr(self, name)]
            )
            if values.shape != (3,):
                raise ParameterError(f"{name} of a block must be three lengths")
            keep(self, **{name: values})
        if np.any(self.low >= self.high):
            raise ParameterError(f"a block needs low < high, but has {self.low.tolist()} and {self.high.tolist()}")

    @classmethod
    def centred(cls, centre, edges) -> Block:
        """Block with this centre and these edges, nm."""
        centre, edges = point(centre, "centre"), point(edges, "edges")
        return cls(centre - edges / 2, centre + edges / 2)

    def contains(self, x: np.ndarray) -> np.ndarray:
        """Mask of the positions (N, 3) inside."""
        return np.all((x >= self.low) & (x <= self.high), axis=1)

    def meets(self, low: np.ndarray, high: np.ndarray) -> bool:
        """Whether it has anything in common with a box."""
        return bool(np.all(self.low < high) and np.all(self.high > low))


@dataclass(frozen=True, eq=False)
class Sphere:
    """The ball |x - centre| < radius.  (LAMMPS's source fixes compare the squared distance with radius^3.)

    Parameters
    ----------
    centre : three lengths
    radius : length, > 0
    """

    centre: np.ndarray
    radius: float

    def __post_init__(self):
        keep(self, centre=point(self.centre, "centre"), radius=checked(self.radius, "length", "the radius of a sphere", positive=True))

    def contains(self, x: np.ndarray) -> np.ndarray:
        """Mask of the positions (N, 3) inside."""
        return np.sum((x - self.centre) ** 2, axis=1) < self.radius**2

    def meets(self, low: np.ndarray, high: np.ndarray) -> bool:
        """Whether it has anything in common with a box."""
        return bool(np.sum((self.centre - np.clip(self.centre, low, high)) ** 2) < self.radius**2)


@dataclass(frozen=True, eq=False)
class Source:
    """A constant rate added to every bead in a region: dT/dt in eDPD, dC/dt of one species in tDPD.

    Positions are first wrapped into the box whose lower corner is ``corner``.  A region that extends beyond the box acts only within it
    (it is not periodic).

    Parameters
    ----------
    region : Block or Sphere
    rate : float
        Rate of thermal energy, kJ/mol/ps (eDPD; the heat is C times this), or of concentration, per ps.
    species : int, default 0
        Number of the species (tDPD), from 0.
    beads : (N,) array of bool, optional
        Beads it acts on; all by default.
    corner : three lengths, default (0, 0, 0)
        Lower corner of the box.
    """

    region: Block | Sphere
    rate: float
    species: int = 0
    beads: np.ndarray | None = None
    corner: np.ndarray | tuple[float, float, float] = (0.0, 0.0, 0.0)

    def __post_init__(self):
        if not isinstance(self.region, (Block, Sphere)):
            raise ParameterError(f"the region of a source must be a Block or a Sphere, not {what_is(self.region)}")
        keep(self, rate=to_md(self.rate, "dimensionless", "the rate of a source"), corner=point(self.corner, "corner"))
        if isinstance(self.species, bool) or not isinstance(self.species, (int, np.integer)) or self.species < 0:
            raise ParameterError(f"the species of a source must be a whole number >= 0, not {what_is(self.species)}")
        if self.beads is not None:
            keep(self, beads=np.asarray(self.beads, dtype=bool))

    def add_to(self, rates: np.ndarray, x: np.ndarray, box: np.ndarray | None) -> None:
        """Add the rate to ``rates`` (N, K), in place, for beads with positions x (N, 3) in the region."""
        inside = self.region.contains(folded(x - self.corner, box) + self.corner)
        rates[inside if self.beads is None else inside & self.beads, self.species] += self.rate

    def check(self, box: np.ndarray | None, n_beads: int, n_values: int) -> None:
        """Raise ParameterError if the source does not fit a scene."""
        if self.beads is not None and self.beads.shape != (n_beads,):
            raise ParameterError(f"the beads of a source must have one entry per bead, {n_beads}, not shape {self.beads.shape}")
        if self.species >= n_values:
            raise ParameterError(f"a source names species {self.species}, but there are {n_values}, counted from 0")
        if box is not None:
            low = np.asarray(self.corner) + np.minimum(box, 0).sum(axis=0)
            high = np.asarray(self.corner) + np.maximum(box, 0).sum(axis=0)
            if not self.region.meets(low, high):
                raise ParameterError(f"the region of a source, {self.region!r}, lies outside the box {low.tolist()} to {high.tolist()}")
