"""Vesicles: molecules in two leaflets around a sphere, and where the solvent is."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..base.errors import ParameterError, what_is
from ..base.units import to_md
from ..model.pairs import checked
from .molecule import Molecule
from .shapes import GAP, upright_shape

#: Turn from one site of a leaflet to the next, which spreads them evenly.
_GOLDEN_ANGLE = np.pi * (3 - 5**0.5)


@dataclass(frozen=True)
class Vesicle:
    r"""A closed bilayer of one kind of molecules, bead 0 of each towards the solvent.

    A leaflet has :math:`4 \pi (R \pm D/4)^2/a` molecules, whose area a counts in the middle of the leaflet.  The solvent begins
    at :math:`R \pm D/2` and is as dense inside as outside, so nothing blows the vesicle up or sucks it empty.

    Parameters
    ----------
    radius : length
        R of the middle surface.
    area_per_lipid : area, or two of them
        a, or that of the inner and of the outer leaflet: :func:`openmm_dpd.analysis.area_per_lipid` of a flat bilayer without tension.
    thickness : length
        D, the room that the solvent leaves to the membrane.  In a flat bilayer of N_w solvent beads in a box L_x x L_y x L_z, where the
        solvent far from it has the density rho_w, that is L_z - N_w/(rho_w L_x L_y).
    centre : three lengths, optional
        The middle of the box by default.

    Raises
    ------
    ParameterError
        If a value is not positive, or the radius leaves no room inside.
    """

    radius: float
    area_per_lipid: float | tuple[float, float]
    thickness: float
    centre: tuple[float, float, float] | None = None

    def __post_init__(self):
        for name, what in (("radius", "the radius of a vesicle"), ("thickness", "the thickness of its membrane")):
            object.__setattr__(self, name, checked(getattr(self, name), "length", what, positive=True))
        if self.radius <= self.thickness / 2:
            raise ParameterError(f"a vesicle of radius {self.radius:g} with a membrane of {self.thickness:g} has no inside")
        areas = np.atleast_1d(to_md(self.area_per_lipid, "area", "the area per lipid"))
        if areas.shape not in ((1,), (2,)) or np.any(areas <= 0):
            raise ParameterError(f"area_per_lipid must be one area > 0, or an inner and an outer one, not {what_is(self.area_per_lipid)}")
        object.__setattr__(self, "area_per_lipid", tuple(np.broadcast_to(areas, 2).tolist()))
        if self.centre is not None:
            centre = np.asarray(to_md(self.centre, "length", "the centre of a vesicle"))
            if centre.shape != (3,):
                raise ParameterError(f"the centre of a vesicle must be three lengths, not {what_is(self.centre)}")
            object.__setattr__(self, "centre", tuple(centre.tolist()))

    @property
    def leaflets(self) -> tuple[int, int]:
        """Number of molecules in the inner and in the outer leaflet."""
        inner, outer = (
            round(4 * np.pi * (self.radius + side * self.thickness / 4) ** 2 / area)
            for side, area in zip((-1, 1), self.area_per_lipid, strict=True)  # type: ignore[arg-type]
        )
        return inner, outer

    @property
    def count(self) -> int:
        """Number of molecules in both leaflets."""
        return sum(self.leaflets)


@dataclass(frozen=True, eq=False)
class Shell:
    """The room of a vesicle's membrane in a periodic box: between two radii around a centre."""

    name: str
    centre: np.ndarray
    inner: float
    outer: float
    vectors: np.ndarray

    @classmethod
    def of(cls, vesicle: Vesicle, name: str, vectors: np.ndarray) -> Shell:
        """ParameterError if the vesicle meets its own image."""
        centre = vectors.sum(axis=0) / 2 if vesicle.centre is None else np.array(vesicle.centre)
        inner, outer = vesicle.radius - vesicle.thickness / 2, vesicle.radius + vesicle.thickness / 2
        width = float((1 / np.linalg.norm(np.linalg.inv(vectors), axis=0)).min())
        if 2 * outer > width:
            raise ParameterError(f"a vesicle of diameter {2 * outer:g} nm, with its membrane, does not fit into a box {width:g} nm wide")
        return cls(f"the vesicle of {name}", centre, inner, outer, vectors)

    def distances(self, points: np.ndarray) -> np.ndarray:
        """From the nearest image of the centre, right up to the outer radius."""
        fractions = (points - self.centre) @ np.linalg.inv(self.vectors)
        return np.linalg.norm((fractions - np.round(fractions)) @ self.vectors, axis=1)

    def inside(self, points: np.ndarray) -> np.ndarray:
        """Mask of the points that the membrane encloses."""
        return self.distances(points) < self.inner

    def outside(self, points: np.ndarray) -> np.ndarray:
        """Mask of the points out of it."""
        return self.distances(points) > self.outer

    @property
    def lumen(self) -> float:
        """Volume inside."""
        return 4 / 3 * np.pi * self.inner**3

    @property
    def ball(self) -> float:
        """Volume of all that is not outside."""
        return 4 / 3 * np.pi * self.outer**3


def vesicle_beads(molecule: Molecule, vesicle: Vesicle, shell: Shell, spacing: float, rng: np.random.Generator) -> np.ndarray:
    """Beads of the molecules of a vesicle, inner leaflet first, (count, n, 3).  All bonds have their lengths.  Molecules that are longer
    than half of the membrane is thick are tilted, so that their ends are at the solvent and near the middle surface; each leans in a
    direction of its own."""
    shape = upright_shape(molecule, spacing)
    length, room = shape[:, 2].max(), vesicle.thickness / 2 - GAP * spacing
    if not 0 < room <= length:
        most = 2 * (length + GAP * spacing)
        raise ParameterError(
            f"two layers of {molecule.name} make a membrane of {2 * GAP * spacing:g} to {most:g} nm, not of {vesicle.thickness:g} nm"
        )
    # upright shapes are flat, with y = 0
    lean = np.arccos(room / length)
    shape = np.column_stack([shape[:, 0], shape[:, 2] * np.sin(lean), shape[:, 2] * np.cos(lean)])
    shape[:, 1] -= shape[:, 1].mean()
    placed = []
    for side, count in zip((-1, 1), vesicle.leaflets, strict=True):
        normals = even_directions(count) @ _random_rotation(rng)
        phi = 2 * np.pi * rng.random(count)
        first = np.cross(normals, np.eye(3)[np.abs(normals).argmin(axis=1)])
        first /= np.linalg.norm(first, axis=1)[:, None]
        second = np.cross(normals, first)
        u = np.cos(phi)[:, None] * first + np.sin(phi)[:, None] * second
        v = np.cos(phi)[:, None] * second - np.sin(phi)[:, None] * first
        height = vesicle.radius + side * (GAP * spacing + shape[:, 2])
        beads = height[:, None] * normals[:, None] + shape[:, :1] * u[:, None] + shape[:, 1:2] * v[:, None]
        placed.append(beads)
    return shell.centre + np.concatenate(placed)


def even_directions(count: int) -> np.ndarray:
    """Unit vectors spread evenly, (count, 3): a spiral from pole to pole with steps of equal area."""
    k = np.arange(count)
    z = 1 - (2 * k + 1) / max(count, 1)
    r = np.sqrt(1 - z**2)
    return np.column_stack([r * np.cos(_GOLDEN_ANGLE * k), r * np.sin(_GOLDEN_ANGLE * k), z])


def _random_rotation(rng: np.random.Generator) -> np.ndarray:
    """A rotation matrix, uniform."""
    q, r = np.linalg.qr(rng.normal(size=(3, 3)))
    q = q * np.sign(np.diag(r))
    return q * np.linalg.det(q)
