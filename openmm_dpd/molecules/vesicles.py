"""Random and upright conformations of molecules, and vesicles: molecules in two leaflets around a sphere."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from ..base.errors import ParameterError, what_is
from ..base.units import to_md
from ..model.pairs import checked
from .molecule import Molecule

#: Distance between the middle of a bilayer and the innermost beads of its leaflets, in units of the distance between beads.
GAP = 0.5


def random_shapes(molecule: Molecule, count: int, rng: np.random.Generator, *, spacing: float, kT: float) -> np.ndarray:
    """Random walks along the bonds, centred, (count, n, 3), nm.  Every bond has its initial length (:meth:`Spring.length`).  Directions are
    isotropic; angles with a bend have its Boltzmann distribution at kT; dihedrals are uniform even with a twist.  In molecules with rings,
    beads are moved until every bond has its length within 2 per cent; bends are left to the minimiser."""
    lengths, bends = _lengths(molecule, spacing), _bends(molecule)
    if len(molecule.bonds) >= molecule.n_beads:
        return _closed_shapes(molecule, count, rng, lengths)
    x = np.zeros((count, molecule.n_beads, 3))
    before: dict[int, int] = {}
    for bead, parent in molecule.tree()[1:]:
        assert parent is not None
        before[bead] = parent
        direction = _directions(count, rng)
        bend = bends.get((before.get(parent), parent, bead))
        if bend is not None:
            back = x[:, before[parent]] - x[:, parent]
            back /= np.linalg.norm(back, axis=1)[:, None]
            across = direction - np.sum(direction * back, axis=1)[:, None] * back
            across /= np.linalg.norm(across, axis=1)[:, None]
            theta = bend.angles(count, rng, kT)[:, None]
            direction = np.cos(theta) * back + np.sin(theta) * across
        x[:, bead] = x[:, parent] + lengths[frozenset((bead, parent))] * direction
    return x - x.mean(axis=1, keepdims=True)


def upright_shape(molecule: Molecule, spacing: float) -> np.ndarray:
    """The molecule upright on its tails, (n, 3), nm: bead 0 on top, the lowest bead at height 0, all bonds at their initial lengths."""
    if len(molecule.bonds) >= molecule.n_beads:
        raise ParameterError(f"{molecule.name} has a ring; only molecules without rings can be in a bilayer or vesicle")
    lengths, tree = _lengths(molecule, spacing), molecule.tree()
    children: dict[int | None, list[int]] = {}
    for bead, parent in tree:
        children.setdefault(parent, []).append(bead)
    x = np.zeros((molecule.n_beads, 3))
    for bead, parent in tree[1:]:
        siblings = children[parent]
        # branches spread by 40 degrees to either side
        tilt = np.linspace(-0.7, 0.7, len(siblings))[siblings.index(bead)] if len(siblings) > 1 else 0.0
        x[bead] = x[parent] + lengths[frozenset((bead, parent))] * np.array([np.sin(tilt), 0.0, -np.cos(tilt)])
    x[:, :2] -= x[:, :2].mean(axis=0)
    x[:, 2] -= x[:, 2].min()
    return x


def _lengths(molecule: Molecule, spacing: float) -> dict[frozenset, float]:
    return {frozenset((i, j)): spring.length(spacing) for i, j, spring in molecule.bonds}  # type: ignore[attr-defined]


def _bends(molecule: Molecule) -> dict[tuple, Any]:
    """Bends by their three beads, in both directions."""
    return {key: bend for i, j, k, bend in molecule.angles for key in ((i, j, k), (k, j, i))}


def _directions(count: int, rng: np.random.Generator) -> np.ndarray:
    """Random unit vectors with an isotropic distribution, (count, 3)."""
    vectors = rng.normal(size=(count, 3))
    return vectors / np.linalg.norm(vectors, axis=1)[:, None]


def _closed_shapes(molecule: Molecule, count: int, rng: np.random.Generator, lengths: dict[frozenset, float]) -> np.ndarray:
    """Shapes of a molecule with rings, centred, (count, n, 3): a closed walk for a single ring, else a small heap, with bonds corrected."""
    n, pairs = molecule.n_beads, molecule.bond_pairs
    if np.all(np.bincount(pairs.ravel(), minlength=n) == 2):
        steps = _directions(count * n, rng).reshape(count, n, 3) * np.mean(list(lengths.values()))
        walk = np.cumsum(steps - steps.mean(axis=1, keepdims=True), axis=1)
        x = np.zeros((count, n, 3))
        bead, previous = 0, None
        for place in range(n):
            x[:, bead] = walk[:, place]
            around = [int(other) for pair in pairs if bead in pair for other in pair if other != bead]
            bead, previous = next(other for other in around if other != previous), bead
    else:
        x = rng.normal(size=(count, n, 3)) * max(lengths.values())
    _close(x, molecule, lengths)
    return x - x.mean(axis=1, keepdims=True)


def _close(x: np.ndarray, molecule: Molecule, lengths: dict[frozenset, float]) -> None:
    """Move beads of shapes (count, n, 3), in place, until all bonds have their lengths; ParameterError if this fails."""
    pairs = molecule.bond_pairs
    targets = np.array([lengths[frozenset(pair)] for pair in pairs.tolist()])
    # every bead moves by the mean of the corrections of its bonds
    share = 1.0 / np.bincount(pairs.ravel(), minlength=molecule.n_beads)
    for _ in range(200 * molecule.n_beads):
        d = x[:, pairs[:, 0]] - x[:, pairs[:, 1]]
        r = np.linalg.norm(d, axis=2)
        if np.all(np.abs(r - targets) < 0.02 * targets):
            return
        correction = 0.5 * ((targets - r) / np.maximum(r, 1e-9))[..., None] * d
        for side, sign in ((0, 1.0), (1, -1.0)):
            move = sign * correction * share[pairs[:, side]][None, :, None]
            np.add.at(x.swapaxes(0, 1), pairs[:, side], move.swapaxes(0, 1))
    raise ParameterError(f"no shape of {molecule.name} was found in which all bonds have their lengths; check its rings")


#: Rotation from one site of a leaflet to the next (the golden angle), which spreads them evenly.
_GOLDEN_ANGLE = np.pi * (3 - 5**0.5)


@dataclass(frozen=True)
class Vesicle:
    r"""A closed bilayer of one kind of molecule, with bead 0 of each towards the solvent.

    A leaflet has :math:`4 \pi (R \pm D/4)^2/a` molecules of area a at its middle surface.  The solvent begins at :math:`R \pm D/2` and has
    the same density inside and outside, so that the vesicle is neither inflated nor deflated.

    Parameters
    ----------
    radius : length
        Radius R of the middle surface.
    area_per_lipid : area, or two of them
        Area a, or those of the inner and outer leaflet: :func:`openmm_dpd.analysis.area_per_lipid` of a flat bilayer without tension.
    thickness : length
        Thickness D of the membrane, which excludes solvent.  For a flat bilayer with N_w solvent beads in a box L_x x L_y x L_z, and the
        solvent density rho_w far from it, this is L_z - N_w/(rho_w L_x L_y).
    centre : three lengths, optional
        Centre; the middle of the box by default.

    Raises
    ------
    ParameterError
        If a value is not positive, or the vesicle has no inside.
    """

    radius: float
    area_per_lipid: float | tuple[float, float]
    thickness: float
    centre: tuple[float, float, float] | None = None

    def __post_init__(self):
        for name, what in (("radius", "the radius of a vesicle"), ("thickness", "the thickness of its membrane")):
            object.__setattr__(self, name, checked(getattr(self, name), "length", what, positive=True))
        if self.radius <= self.thickness / 2:
            raise ParameterError(f"a vesicle of radius {self.radius:g} with a membrane of {self.thickness:g} has no inside; enlarge it")
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
    """Space of a vesicle's membrane in a periodic box: between two radii around a centre."""

    name: str
    centre: np.ndarray
    inner: float
    outer: float
    vectors: np.ndarray

    @classmethod
    def of(cls, vesicle: Vesicle, name: str, vectors: np.ndarray) -> Shell:
        """Shell of a vesicle; ParameterError if it overlaps its own image."""
        centre = vectors.sum(axis=0) / 2 if vesicle.centre is None else np.array(vesicle.centre)
        inner, outer = vesicle.radius - vesicle.thickness / 2, vesicle.radius + vesicle.thickness / 2
        width = float((1 / np.linalg.norm(np.linalg.inv(vectors), axis=0)).min())
        if 2 * outer > width:
            raise ParameterError(f"a vesicle of diameter {2 * outer:g} nm, with its membrane, does not fit into a box {width:g} nm wide")
        return cls(f"the vesicle of {name}", centre, inner, outer, vectors)

    def distances(self, points: np.ndarray) -> np.ndarray:
        """Distances (N,) from the nearest image of the centre, correct up to the outer radius."""
        fractions = (points - self.centre) @ np.linalg.inv(self.vectors)
        return np.linalg.norm((fractions - np.round(fractions)) @ self.vectors, axis=1)

    def inside(self, points: np.ndarray) -> np.ndarray:
        """Mask of the points enclosed by the membrane."""
        return self.distances(points) < self.inner

    def outside(self, points: np.ndarray) -> np.ndarray:
        """Mask of the points out of it."""
        return self.distances(points) > self.outer

    @property
    def lumen(self) -> float:
        """Volume enclosed by the membrane, nm^3."""
        return 4 / 3 * np.pi * self.inner**3

    @property
    def ball(self) -> float:
        """Volume of membrane and inside, nm^3."""
        return 4 / 3 * np.pi * self.outer**3


def vesicle_beads(molecule: Molecule, vesicle: Vesicle, shell: Shell, spacing: float, rng: np.random.Generator) -> np.ndarray:
    """Positions of the molecules of a vesicle, inner leaflet first, (count, n, 3), with all bonds at their lengths.  Molecules longer than
    half the membrane's thickness are tilted in random directions, so that their ends are at the solvent and near the middle surface."""
    shape = upright_shape(molecule, spacing)
    length, room = shape[:, 2].max(), vesicle.thickness / 2 - GAP * spacing
    if not 0 < room <= length:
        most = 2 * (length + GAP * spacing)
        raise ParameterError(
            f"two leaflets of {molecule.name} make a membrane of {2 * GAP * spacing:g} to {most:g} nm, not of {vesicle.thickness:g} nm"
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
    """Evenly spread unit vectors, (count, 3): a spiral from pole to pole with steps of equal area."""
    k = np.arange(count)
    z = 1 - (2 * k + 1) / max(count, 1)
    r = np.sqrt(1 - z**2)
    return np.column_stack([r * np.cos(_GOLDEN_ANGLE * k), r * np.sin(_GOLDEN_ANGLE * k), z])


def _random_rotation(rng: np.random.Generator) -> np.ndarray:
    """A random rotation matrix, (3, 3), uniformly distributed."""
    q, r = np.linalg.qr(rng.normal(size=(3, 3)))
    q = q * np.sign(np.diag(r))
    return q * np.linalg.det(q)
