"""Sources of heat or of a species in a part of the box, and forces that follow what beads carry."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from ..base.errors import ParameterError, require, what_is
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


class OnFields:
    """Base of what acts on or through the per-bead fields, for all beads or those of a mask."""

    species: int
    beads: np.ndarray | None
    pushes: ClassVar[bool] = False  #: Whether it is a force
    _WHAT: ClassVar[str]

    def add_to(self, rates: np.ndarray, x: np.ndarray, box: np.ndarray | None) -> None:
        """Add to ``rates`` (N, K), in place, for beads at positions x (N, 3)."""

    def push(self, force: np.ndarray, values: np.ndarray) -> None:
        """Add to the forces (N, 3), in place, on beads with these values (N, K)."""

    def _keep_beads(self) -> None:
        if isinstance(self.species, bool) or not isinstance(self.species, (int, np.integer)) or self.species < 0:
            raise ParameterError(f"the species of {self._WHAT} must be a whole number >= 0, not {what_is(self.species)}")
        if self.beads is not None:
            keep(self, beads=np.asarray(self.beads, dtype=bool))

    def check(self, box: np.ndarray | None, n_beads: int, n_values: int) -> None:
        """Raise ParameterError if this does not fit a scene."""
        if self.beads is not None and self.beads.shape != (n_beads,):
            raise ParameterError(f"the beads of {self._WHAT} must have one entry per bead, {n_beads}, not shape {self.beads.shape}")
        if self.species >= n_values:
            raise ParameterError(f"{self._WHAT} names species {self.species}, but there are {n_values}, counted from 0")


@dataclass(frozen=True, eq=False)
class Source(OnFields):
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
    _WHAT = "a source"

    def __post_init__(self):
        require(self.region, (Block, Sphere), "the region of a source must be a Block or a Sphere")
        keep(self, rate=to_md(self.rate, "dimensionless", "the rate of a source"), corner=point(self.corner, "corner"))
        self._keep_beads()

    @property
    def row(self) -> list[float] | None:
        """The source in numbers: its corner, whether its region is a sphere, the low corner or the centre of that, the rate, the high
        corner or the square of the radius and two zeros, and the species; None if its class is another one, which may add what it likes."""
        if type(self) is not Source:
            return None
        its = self.region
        low, high = (its.low, its.high) if isinstance(its, Block) else (its.centre, [its.radius**2, 0.0, 0.0])
        return [*self.corner, float(isinstance(its, Sphere)), *low, self.rate, *high, float(self.species)]

    def add_to(self, rates: np.ndarray, x: np.ndarray, box: np.ndarray | None) -> None:
        """Add the rate to ``rates`` (N, K), in place, for beads with positions x (N, 3) in the region."""
        inside = self.region.contains(folded(x - self.corner, box) + self.corner)
        rates[inside if self.beads is None else inside & self.beads, self.species] += self.rate

    def check(self, box: np.ndarray | None, n_beads: int, n_values: int) -> None:
        """Raise ParameterError if the source does not fit a scene."""
        super().check(box, n_beads, n_values)
        if box is not None:
            low = np.asarray(self.corner) + np.minimum(box, 0).sum(axis=0)
            high = np.asarray(self.corner) + np.maximum(box, 0).sum(axis=0)
            if not self.region.meets(low, high):
                raise ParameterError(f"the region of a source, {self.region!r}, lies outside the box {low.tolist()} to {high.tolist()}")


@dataclass(frozen=True, eq=False)
class Buoyancy(OnFields):
    """A force on single beads that follows the temperature (eDPD) or a concentration (tDPD) they have: F_i = force (value_i - reference).

    With ``force`` = -m beta g it is Boussinesq's buoyancy, for gravity g and thermal expansion beta (S. Chandrasekhar, Hydrodynamic and
    Hydromagnetic Stability (1961), section 8).  ``dpd_body_force`` does not scale it, and no potential energy is reported for it.

    Parameters
    ----------
    force : three numbers
        Force per unit of the value, kJ/mol/nm: per kJ/mol of thermal energy (eDPD), or per unit of concentration.
    reference : float
        Value at which there is no force.
    species : int, default 0
        Number of the species (tDPD), from 0.
    beads : (N,) array of bool, optional
        Beads it acts on; all by default.
    """

    force: np.ndarray
    reference: float
    species: int = 0
    beads: np.ndarray | None = None
    pushes = True
    _WHAT = "a buoyancy"

    def __post_init__(self):
        force = np.asarray(to_md(self.force, "dimensionless", "the force of a buoyancy"))
        if force.shape != (3,) or not np.all(np.isfinite(force)):
            raise ParameterError(f"the force of a buoyancy must be three finite numbers, not {what_is(self.force)}")
        keep(self, force=force, reference=checked(self.reference, "dimensionless", "the reference of a buoyancy", signed=True))
        self._keep_beads()

    def push(self, force: np.ndarray, values: np.ndarray) -> None:
        above = values[:, self.species] - self.reference
        force += np.outer(above if self.beads is None else above * self.beads, self.force)
