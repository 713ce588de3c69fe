"""Initial positions of molecules in a box."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from itertools import combinations

import numpy as np
from openmm import unit

from ..base.errors import ParameterError, require, require_one, what_is
from ..base.units import thermal_energy, whole_number
from ..model.box import box_vectors
from ..model.pairs import checked
from ..model.sources import Block, Sphere
from .mixture import Mixture
from .molecule import Molecule
from .vesicles import GAP, Shell, Vesicle, random_shapes, upright_shape, vesicle_beads

AXES = {"x": 0, "y": 1, "z": 2}


@dataclass(frozen=True)
class Scattered:
    """A number of molecules at random places.

    Parameters
    ----------
    count : int
        Number of molecules, >= 0.
    region : Block or Sphere, optional
        Region of their centres; the whole box by default.  (Beads of molecules at its border lie outside.)
    """

    count: int
    region: Block | Sphere | None = None

    def __post_init__(self):
        object.__setattr__(self, "count", whole_number(self.count, "the number of molecules", least=0))
        require(self.region, Block | Sphere | None, "region must be a Block or a Sphere")


@dataclass(frozen=True)
class Bilayer:
    """A number of molecules in two leaflets, with bead 0 outwards.  Arrangements with the same normal and centre share the leaflets.

    Parameters
    ----------
    count : int
        Number of molecules in both leaflets, >= 0.
    normal : {"z", "y", "x"}
        Axis normal to the bilayer.
    centre : length, optional
        Position of the midplane along this axis; the middle of the box by default.
    upper : int, optional
        Number of molecules in the leaflet on the positive side; half of them by default.
    """

    count: int
    normal: str = "z"
    centre: float | None = None
    upper: int | None = None

    def __post_init__(self):
        object.__setattr__(self, "count", whole_number(self.count, "the number of molecules", least=0))
        require_one(self.normal, AXES, "normal")
        if self.centre is not None:
            object.__setattr__(self, "centre", checked(self.centre, "length", "the centre of a bilayer", signed=True))
        upper = (self.count + 1) // 2 if self.upper is None else whole_number(self.upper, "the number in the upper leaflet", least=0)
        if upper > self.count:
            raise ParameterError(f"{upper} molecules in the upper leaflet are more than the {self.count} in both")
        object.__setattr__(self, "upper", upper)


def pack(
    molecules: Mapping[Molecule, int | Scattered | Bilayer | Vesicle],
    *,
    box=None,
    density=3.0,
    solvent: str | Molecule | None = "W",
    seed: int | None = None,
    kT=1.0,
) -> Mixture:
    """Place molecules in a periodic box and fill it with solvent.

    Molecules are random walks with every bond at its rest length, at random places; they are whole, so beads may lie beyond the box.  As
    DPD is soft, :func:`openmm_dpd.molecules.relax` removes overlaps.  The solvent fills the box to exactly round(density * volume) beads.

    Parameters
    ----------
    molecules : mapping
        From each kind of molecule to its number, or to an arrangement: :class:`Scattered` in a region, :class:`Bilayer`, :class:`Vesicle`.
    box : (3,) or (3, 3) array of lengths, optional
        Edges or box vectors, nm.  Optional without solvent: the box is then a cube of the given density.
    density : 1/volume, default 3
        Beads per nm^3.  Not used with a box and no solvent.
    solvent : str, Molecule or None
        Type of the solvent beads, or a solvent molecule, of which only whole ones are added.  None: no solvent.
    seed : int, optional
        Seed of the random numbers; the same seed gives the same mixture.  By default it is drawn and recorded in the mixture.
    kT : energy or temperature
        Thermal energy for the distribution of bend angles; with 0 they have the least energy.

    Raises
    ------
    ParameterError
        If the molecules do not fit, a bilayer or vesicle is larger than the box, membranes overlap, a region is empty, or a value is out
        of bounds.

    Examples
    --------
    >>> from openmm_dpd.molecules import Spring, linear, pack
    >>> chain = linear("A6B4", Spring(k=2, r0=0))
    >>> mixture = pack({chain: 20}, solvent="W", density=3, box=[6, 6, 6], seed=1)
    >>> mixture.n_beads, mixture.count(chain)
    (648, 20)
    """
    wanted = _arrangements(molecules)
    rho = _number_density(density)
    if seed is None:
        seed = int(np.random.SeedSequence().entropy % 2**63)  # type: ignore[operator]
    rng = np.random.default_rng(whole_number(seed, "seed", least=0))
    beads = sum(molecule.n_beads * arrangement.count for molecule, arrangement in wanted)
    filler = Molecule((solvent,)) if isinstance(solvent, str) else solvent
    vectors = _box(box, rho, beads, filler)
    filling = _filling(vectors, rho, beads, filler)
    energy, spacing = thermal_energy(kT), float(rho ** (-1 / 3))
    slabs, placed = _leaflets(wanted, vectors, spacing, rng)
    shells = _vesicles(wanted, vectors, spacing, placed, rng)
    free = _Free(vectors, slabs, shells)
    groups: list[tuple[Molecule, np.ndarray]] = []
    for number, (molecule, arrangement) in enumerate(wanted):
        if isinstance(arrangement, Scattered):
            shapes = random_shapes(molecule, arrangement.count, rng, spacing=spacing, kT=energy)
            where = free.anywhere if arrangement.region is None else arrangement.region.contains
            centres = _places(arrangement.count, vectors, where, arrangement.region or "what the membranes leave", rng)
            placed[number] = shapes + centres[:, None]
        groups.append((molecule, placed[number]))
    if filler is not None and filling:
        shapes = random_shapes(filler, filling, rng, spacing=spacing, kT=energy)
        groups.append((filler, shapes + free.solvent(filling, rng)[:, None]))
    return Mixture.of(groups, vectors, seed)


def _arrangements(molecules) -> list[tuple[Molecule, Scattered | Bilayer | Vesicle]]:
    """Kinds of molecules and their arrangements; a number means scattered molecules."""
    require(molecules, Mapping, "molecules must map each kind of molecule to its number, such as {chain: 20}")
    wanted = []
    for molecule, given in molecules.items():
        if not isinstance(molecule, Molecule):
            raise ParameterError(f"molecules must map Molecules to numbers; one key is {what_is(molecule)} (a single bead: `bead('W')`)")
        wanted.append((molecule, given if isinstance(given, (Scattered, Bilayer, Vesicle)) else Scattered(given)))
    return wanted


def _number_density(value) -> float:
    if unit.is_quantity(value):
        if not value.unit.is_compatible(unit.nanometer**-3):
            raise ParameterError(f"density has the unit {value.unit}; expected beads per volume, such as 3 / nanometer**3")
        value = value.value_in_unit(unit.nanometer**-3)
    return checked(value, "dimensionless", "density", positive=True)


def _box(box, rho: float, beads: int, filler: Molecule | None) -> np.ndarray:
    """Box vectors, (3, 3): the given ones, or without solvent those of a cube of density rho."""
    vectors = box_vectors(box)
    if vectors is not None:
        return vectors
    if filler is not None:
        raise ParameterError("a box for solvent must be given, as box=[10, 10, 10]; without solvent the density defines a cube")
    if not beads:
        raise ParameterError("there is nothing to pack: no molecules and no solvent")
    return np.eye(3) * (beads / rho) ** (1 / 3)


def _filling(vectors: np.ndarray, rho: float, beads: int, filler: Molecule | None) -> int:
    """Number of solvent molecules that fill the box; ParameterError if the other molecules are too many."""
    if filler is None:
        return 0
    require(filler, Molecule, "solvent must be a bead type, a Molecule or None")
    volume = float(np.prod(np.diag(vectors)))
    total = round(rho * volume)
    if beads > total:
        raise ParameterError(
            f"the molecules have {beads} beads, but a density of {rho:g} in a volume of {volume:g} nm^3 allows {total}; "
            "take fewer molecules or a larger box (or solvent=None for any density)"
        )
    return (total - beads) // filler.n_beads


@dataclass(frozen=True, eq=False)
class _Slab:
    """Space of a bilayer in a periodic box."""

    name: str
    axis: int
    centre: np.ndarray
    outer: float
    edge: float

    def distances(self, points: np.ndarray) -> np.ndarray:
        """Distances (N,) of points from the nearest image of the midplane."""
        return np.abs(((points - self.centre)[:, self.axis] + self.edge / 2) % self.edge - self.edge / 2)

    def outside(self, points: np.ndarray) -> np.ndarray:
        """Mask of the points out of it."""
        return self.distances(points) > self.outer


@dataclass(frozen=True, eq=False)
class _Free:
    """Space outside of all membranes; ParameterError if membranes overlap."""

    vectors: np.ndarray
    slabs: list[_Slab]
    shells: list[Shell]

    def __post_init__(self):
        membranes: list[_Slab | Shell] = [*self.slabs, *self.shells]
        for one, other in combinations(membranes, 2):
            crossing = isinstance(one, _Slab) and isinstance(other, _Slab) and one.axis != other.axis
            if crossing or one.distances(other.centre[None])[0] < one.outer + other.outer:
                how = "cross" if crossing else "overlap"
                raise ParameterError(f"{one.name} and {other.name} {how}; give them other centres or normals, or a larger box")

    def outside(self, points: np.ndarray) -> np.ndarray:
        """Mask of the points outside of all bilayers and vesicles."""
        masks = [slab.outside(points) for slab in self.slabs] + [shell.outside(points) for shell in self.shells]
        return np.all(masks, axis=0) if masks else np.ones(len(points), bool)

    def anywhere(self, points: np.ndarray) -> np.ndarray:
        """Mask of the points outside of all membranes, including those inside vesicles."""
        return np.any([self.outside(points), *(shell.inside(points) for shell in self.shells)], axis=0)

    def solvent(self, count: int, rng: np.random.Generator) -> np.ndarray:
        """Positions of the solvent, (count, 3): each vesicle contains its share by volume."""
        box = float(np.prod(np.diag(self.vectors)))
        slabs = sum(2 * slab.outer / slab.edge for slab in self.slabs) * box
        volume = box - slabs - sum(shell.ball - shell.lumen for shell in self.shells)
        shares = [round(count * shell.lumen / volume) for shell in self.shells]
        parts = [
            _places(share, self.vectors, shell.inside, "the inside of a vesicle", rng)
            for share, shell in zip(shares, self.shells, strict=True)
        ]
        parts.append(_places(count - sum(shares), self.vectors, self.outside, "what the membranes leave", rng))
        return np.concatenate(parts)


def _places(count: int, vectors: np.ndarray, allowed: Callable[[np.ndarray], np.ndarray], where, rng: np.random.Generator) -> np.ndarray:
    """Random points in the allowed part of the box, (count, 3); ParameterError if this has next to no volume."""
    found: list[np.ndarray] = []
    missing, tries = count, 0
    while missing > 0:
        points = rng.random((max(64, 2 * missing), 3)) @ vectors
        found.append(points[allowed(points)][:missing])
        missing -= len(found[-1])
        tries += len(points)
        if tries > 1000 * (count + 1000):
            raise ParameterError(f"there is no room: {where} has next to no volume in the box")
    return np.concatenate(found) if found else np.zeros((0, 3))


def _vesicles(wanted, vectors: np.ndarray, spacing: float, placed: dict[int, np.ndarray], rng: np.random.Generator) -> list[Shell]:
    """Shells of the vesicles; the positions of their molecules are added to ``placed``."""
    shells = []
    for number, (molecule, arrangement) in enumerate(wanted):
        if isinstance(arrangement, Vesicle):
            shells.append(Shell.of(arrangement, molecule.name, vectors))
            placed[number] = vesicle_beads(molecule, arrangement, shells[-1], spacing, rng)
    return shells


def _leaflets(wanted, vectors: np.ndarray, spacing: float, rng: np.random.Generator) -> tuple[list[_Slab], dict[int, np.ndarray]]:
    """Slab of each bilayer, and the positions of its molecules by the number of their kind."""
    planes: dict[tuple[int, float], list[int]] = {}
    for number, (_, arrangement) in enumerate(wanted):
        if isinstance(arrangement, Bilayer):
            axis = AXES[arrangement.normal]
            centre = vectors[axis, axis] / 2 if arrangement.centre is None else arrangement.centre
            planes.setdefault((axis, centre), []).append(number)
    slabs, placed = [], {}
    if planes and np.any(vectors != np.diag(np.diag(vectors))):
        raise ParameterError("a bilayer needs an orthorhombic box")
    for (axis, centre), numbers in planes.items():
        shapes = {number: upright_shape(wanted[number][0], spacing) + [0, 0, GAP * spacing] for number in numbers}
        half = max(shape[:, 2].max() for shape in shapes.values())
        edge = vectors[axis, axis]
        if 2 * half > edge:
            raise ParameterError(f"a bilayer of {2 * half:g} nm does not fit into an edge of {edge:g} nm")
        beads: dict[int, list[np.ndarray]] = {number: [] for number in numbers}
        for sign in (1, -1):
            counts = [_in_leaflet(wanted[number][1], sign) for number in numbers]
            kinds = rng.permutation(np.repeat(numbers, counts))
            for number, site in zip(kinds.tolist(), _sites(len(kinds), np.delete(np.diag(vectors), axis), rng), strict=True):
                beads[number].append(_stand(shapes[number], site, sign, axis, centre, rng))
        placed.update({number: np.array(found).reshape(-1, wanted[number][0].n_beads, 3) for number, found in beads.items()})
        name = f"the bilayer of {' and '.join(wanted[number][0].name for number in numbers)}"
        slabs.append(_Slab(name, axis, centre * np.eye(3)[axis], half, edge))
    return slabs, placed


def _in_leaflet(arrangement: Bilayer, sign: int) -> int:
    assert arrangement.upper is not None
    return arrangement.upper if sign > 0 else arrangement.count - arrangement.upper


def _sites(count: int, edges: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    """Evenly spread sites in a leaflet, (count, 2)."""
    if not count:
        return np.zeros((0, 2))
    columns = max(1, round(np.sqrt(count * edges[0] / edges[1])))
    # columns hold equal numbers, give or take one
    per_column = np.full(columns, count // columns)
    per_column[: count % columns] += 1
    sites = [((column + 0.5) / columns, (row + rng.random()) / n) for column, n in enumerate(per_column) for row in range(n)]
    return np.array(sites) * edges


def _stand(shape: np.ndarray, site: np.ndarray, sign: int, axis: int, centre: float, rng: np.random.Generator) -> np.ndarray:
    """An upright shape on its site, rotated by a random angle about the normal."""
    phi = 2 * np.pi * rng.random()
    across = shape[:, :2] @ np.array([[np.cos(phi), np.sin(phi)], [-np.sin(phi), np.cos(phi)]]) + site
    return np.insert(across, axis, centre + sign * shape[:, 2], axis=1)
