"""Bonds between beads."""

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any, ClassVar, TypeVar

import numpy as np

from ..base.errors import ParameterError, bead_names, either, in_length, overstretched
from ..base.geometry import minimum_images, widths
from ..base.units import keep, to_md

#: r/sigma at which the repulsion of a FENE bond ends: the minimum of the Lennard-Jones potential.
WCA_END = 2.0 ** (1.0 / 6.0)
#: Bounds of coefficients, by their text in messages.
BOUNDS: dict[str, Callable[[np.ndarray], np.ndarray]] = {
    "": lambda x: np.ones(len(x), bool),
    ">= 0": lambda x: x >= 0,
    "> 0": lambda x: x > 0,
    "from 0 to pi": lambda x: (x >= 0) & (x <= np.pi * (1 + 1e-9)),
    "from 0 to less than pi": lambda x: (x >= 0) & (x < np.pi * (1 - 1e-9)),
    "1 or -1": lambda x: np.abs(x) == 1,
    "a whole number >= 0": lambda x: (x >= 0) & (x == np.round(x)),
    "a whole number > 0": lambda x: (x > 0) & (x == np.round(x)),
}


def bead_indices(value, width: int, what: str) -> np.ndarray:
    """Bead indices as a (K, width) array; ParameterError, in which ``what`` names them, if one is < 0 or repeated within a row."""
    try:
        array = np.asarray(value)
    except ValueError:
        raise ParameterError(f"{what} must be an integer array of shape (K, {width}); its entries differ in length") from None
    if array.size == 0:
        array = np.zeros((0, width), dtype=np.int64)
    if array.ndim != 2 or array.shape[1] != width or not np.issubdtype(array.dtype, np.integer):
        raise ParameterError(f"{what} must be an integer array of shape (K, {width}), not {array.dtype} {array.shape}")
    if array.size and array.min() < 0:
        raise ParameterError(f"bead indices of {what} are counted from 0; one is negative")
    ordered = np.sort(array, axis=1)
    own = np.argwhere(ordered[:, 1:] == ordered[:, :-1])
    if len(own):
        raise ParameterError(f"entry {own[0, 0]} of {what} names bead {ordered[tuple(own[0])]} twice: {array[own[0, 0]].tolist()}")
    return array.astype(np.int64)


def term_values(term, count: int, dimensions: dict[str, tuple[str, str]], what: str) -> dict[str, np.ndarray]:
    """Coefficients of ``count`` bonded terms, attributes of ``term``, as (count,) arrays in MD units.

    ``dimensions`` maps the name of each to its dimension and its bound, one of :data:`BOUNDS`; ``what`` is "bond", "angle", ....
    ParameterError if a shape is wrong or a value out of bounds.
    """
    values = {}
    for name, (dimension, bound) in dimensions.items():
        array = np.asarray(to_md(getattr(term, name), dimension, f"{what} {name}"))
        if array.shape not in ((), (count,)):
            raise ParameterError(f"{what} {name} must be one number, or one for each of the {count} {what}s, not shape {array.shape}")
        values[name] = np.broadcast_to(array, (count,)).copy()
        wrong = np.flatnonzero(~BOUNDS[bound](values[name]))
        if len(wrong):
            which, value = f"; {what} {wrong[0]} has" if array.ndim else ", but is", f"{values[name][wrong[0]]:g}"
            if dimension == "angle":
                value = either(f"{value} (degrees: {value} * openmm.unit.degree)", f"{np.degrees(float(value)):g} degrees")
            raise ParameterError(f"{what} {name} must be {bound}{which} {value}")
    return values


def check_members(beads: np.ndarray, n_beads: int, what: str, which: str | None = None) -> None:
    """Raise ParameterError if a row of beads names one that does not exist, or is listed twice.  ``which`` describes a repeated row; None
    allows several terms of the same beads."""
    if beads.size and beads.max() >= n_beads:
        raise ParameterError(f"{what} names bead {beads.max()}, but there are only {n_beads} beads, counted from 0")
    different, counts = np.unique(beads, axis=0, return_counts=True)
    if which is not None and np.any(counts > 1):
        raise ParameterError(f"{which} {bead_names(*different[counts > 1][0])} is listed twice")


_Terms = TypeVar("_Terms", bound="BondedTerms")


class BondedTerms:
    """Base of all kinds of bonds, angles, dihedrals and impropers: beads, and coefficients of each term.  A kind is a frozen dataclass
    with a field for the beads, named as in ``_BEADS``, and one for each of ``_DIMENSIONS``, in this order.  Its record
    (:mod:`openmm_dpd.plan.kinds.bonded`) defines how it is computed."""

    #: Name of the field with the beads, number of beads per term, and name of a term.
    _BEADS: ClassVar[tuple[str, int, str]]
    _DIMENSIONS: ClassVar[dict[str, tuple[str, str]]] = {}

    def __post_init__(self):
        name, width, what = self._BEADS
        beads = bead_indices(getattr(self, name), width, f"{what} {name}")
        keep(self, **{name: beads}, **term_values(self, len(beads), self._DIMENSIONS, what))

    @property
    def beads(self) -> np.ndarray:
        """Bead indices of each term, (K, 2), (K, 3) or (K, 4)."""
        return getattr(self, self._BEADS[0])

    def shifted(self: _Terms, by: int) -> _Terms:
        """A copy of the terms with all bead indices increased by ``by``."""
        terms: Any = self
        return replace(terms, **{self._BEADS[0]: self.beads + by})

    @property
    def coefficients(self) -> np.ndarray:
        """(K, n) coefficients of each term, in the order of the class, MD units."""
        return np.stack([getattr(self, name) for name in self._DIMENSIONS], axis=1)

    def curve(self, x: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Energy, first and second derivative of each term, (K,) each, at these lengths of bonds, or angles of angles and dihedrals."""
        raise NotImplementedError

    def reach(self, kT: float) -> np.ndarray:
        """Largest length of each bond, or angle of each angle or dihedral, (K,), that occurs at equilibrium."""
        raise NotImplementedError

    def density(self, x: np.ndarray) -> np.ndarray:
        """Density of states at these lengths or angles without an energy, (K,), in arbitrary units."""
        raise NotImplementedError


class Bonds(BondedTerms):
    """Base of all kinds of bonds."""

    pairs: np.ndarray
    _BEADS = ("pairs", 2, "bond")
    #: Whether there is a length that a bond cannot exceed.
    limited: ClassVar[bool] = False

    def check_box(self, box: np.ndarray | None) -> None:
        """Raise ParameterError if a rest length is over half the box, which a bond between nearest images cannot have."""
        rest, half = getattr(self, "r0", np.zeros(0)), np.inf if box is None else 0.5 * widths(box).min()
        if np.any(rest > half):
            (i, j), r0 = self.pairs[rest > half][0], rest[rest > half][0]
            raise ParameterError(
                f"the bond between {bead_names(i, j)} has the rest length {in_length(r0)}, over half the box, whose width is "
                f"{in_length(2 * half)}"
            )

    def overstretched(self, x: np.ndarray, box: np.ndarray | None) -> str | None:
        """Error message about the first bond without a finite energy at positions x (N, 3), or None."""
        return None

    def longest(self) -> np.ndarray:
        """(B,) rest length, or largest length, of each bond, nm."""
        return getattr(self, "r0", np.zeros(len(self.pairs)))

    def lengths(self, x: np.ndarray, box: np.ndarray | None) -> np.ndarray:
        """(B,) length of each bond at positions x (N, 3), by minimum image, nm."""
        return np.linalg.norm(minimum_images(x[self.pairs[:, 0]] - x[self.pairs[:, 1]], box), axis=1)

    def density(self, r: np.ndarray) -> np.ndarray:
        return r**2


@dataclass(frozen=True, eq=False)
class HarmonicBonds(Bonds):
    """Harmonic bonds, U = k (r - r0)^2 (LAMMPS's convention: no factor 1/2).

    Parameters
    ----------
    pairs : (B, 2) array of int
        Bead indices from 0.
    k : energy/length^2, or (B,) array
        Force constant, kJ/mol/nm^2, >= 0.
    r0 : length, or (B,) array
        Rest length, nm, >= 0.

    Raises
    ------
    ParameterError
        If shapes differ, a value is out of bounds or a bead is bonded to itself.
    """

    pairs: np.ndarray
    k: np.ndarray
    r0: np.ndarray
    _DIMENSIONS = {"k": ("force_constant", ">= 0"), "r0": ("length", ">= 0")}

    def curve(self, r: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        return self.k * (r - self.r0) ** 2, 2 * self.k * (r - self.r0), 2 * self.k

    def reach(self, kT: float) -> np.ndarray:
        return self.r0 + 4 * np.sqrt(kT / np.where(self.k > 0, self.k, 1.0))


def repulsion_curve(r: np.ndarray, epsilon: Any, sigma: Any) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Energy and derivatives of the Lennard-Jones potential up to its minimum, where it is 0."""
    close, s6 = (r < WCA_END * sigma) & (epsilon > 0), (sigma / r) ** 6
    rows = epsilon * (4 * s6 * (s6 - 1) + 1), -24 * epsilon * s6 * (2 * s6 - 1) / r, 24 * epsilon * s6 * (26 * s6 - 7) / r**2
    return tuple(np.where(close, row, 0.0) for row in rows)  # type: ignore[return-value]


@dataclass(frozen=True, eq=False)
class FENEBonds(Bonds):
    r"""Finitely extensible bonds (LAMMPS: ``bond_style fene``).

    U = -1/2 k R0^2 ln(1 - (r/R0)^2) + 4 epsilon [(sigma/r)^12 - (sigma/r)^6] + epsilon, with the epsilon terms for
    r < 2^(1/6) sigma only (Kremer and Grest, J. Chem. Phys. 92, 5057 (1990)).  A bond is always shorter than R0.

    Parameters
    ----------
    pairs : (B, 2) array of int
        Bead indices from 0.
    k : energy/length^2, or (B,) array
        Force constant, kJ/mol/nm^2, >= 0.
    R0 : length, or (B,) array
        Maximum length, nm, > 0.
    epsilon : energy, or (B,) array, default 0
        Strength of the repulsion between the two beads, kJ/mol, >= 0; 0 if another term keeps them apart.
    sigma : length, or (B,) array, default 1
        Range of the repulsion, nm; > 0 where epsilon is > 0.

    Raises
    ------
    ParameterError
        If shapes differ, a value is out of bounds or a bead is bonded to itself.
    """

    pairs: np.ndarray
    k: np.ndarray
    R0: np.ndarray
    epsilon: np.ndarray = 0.0  # type: ignore[assignment]  # an array once constructed
    sigma: np.ndarray = 1.0  # type: ignore[assignment]
    _DIMENSIONS = {"k": ("force_constant", ">= 0"), "R0": ("length", "> 0"), "epsilon": ("energy", ">= 0"), "sigma": ("length", ">= 0")}
    limited = True

    def __post_init__(self):
        super().__post_init__()
        if np.any((self.sigma == 0) & (self.epsilon > 0)):
            raise ParameterError("bond sigma must be > 0 where epsilon is > 0")

    def overstretched(self, x: np.ndarray, box: np.ndarray | None) -> str | None:
        r = self.lengths(x, box)
        known = ~np.isnan(r)
        return overstretched(*(part[known] for part in (self.pairs, r, self.R0, self.epsilon)))

    def longest(self) -> np.ndarray:
        return self.R0

    def curve(self, r: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        with np.errstate(divide="ignore", invalid="ignore"):
            rest = 1 - (r / self.R0) ** 2
            energy = -0.5 * self.k * self.R0**2 * np.log(rest)
            slope, curvature = self.k * r / rest, self.k / rest * (1 + 2 * (r / self.R0) ** 2 / rest)
            more = repulsion_curve(r, self.epsilon, self.sigma)
        return energy + more[0], slope + more[1], curvature + more[2]

    def reach(self, kT: float) -> np.ndarray:
        return self.R0


@dataclass(frozen=True, eq=False)
class MorseBonds(Bonds):
    """Morse bonds, U = D (1 - exp(-alpha (r - r0)))^2 (LAMMPS: ``bond_style morse``).

    Parameters
    ----------
    pairs : (B, 2) array of int
        Bead indices from 0.
    D : energy, or (B,) array
        Depth of the well, kJ/mol, >= 0.
    alpha : 1/length, or (B,) array
        Inverse width of the well, 1/nm, >= 0.
    r0 : length, or (B,) array
        Rest length, nm, >= 0.

    Raises
    ------
    ParameterError
        If shapes differ, a value is out of bounds or a bead is bonded to itself.
    """

    pairs: np.ndarray
    D: np.ndarray
    alpha: np.ndarray
    r0: np.ndarray
    _DIMENSIONS = {"D": ("energy", ">= 0"), "alpha": ("inverse_length", ">= 0"), "r0": ("length", ">= 0")}

    def curve(self, r: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        e = np.exp(-self.alpha * (r - self.r0))
        return self.D * (1 - e) ** 2, 2 * self.D * self.alpha * e * (1 - e), 2 * self.D * self.alpha**2 * e * (2 * e - 1)

    def reach(self, kT: float) -> np.ndarray:
        return self.r0 + 2 / np.where(self.alpha > 0, self.alpha, 2.0)


def bonded_neighbours(pairs: np.ndarray, n_beads: int) -> dict[int, set[tuple[int, int]]]:
    """Pairs (i < j) that are one, two or three bonds apart: {1: 1-2 pairs, 2: 1-3 pairs, 3: 1-4 pairs}, by the shortest path between the
    beads, which is right for rings too."""
    neighbours: list[set[int]] = [set() for _ in range(n_beads)]
    for i, j in np.asarray(pairs).tolist():
        neighbours[i].add(j)
        neighbours[j].add(i)
    found: dict[int, set[tuple[int, int]]] = {1: set(), 2: set(), 3: set()}
    for i in range(n_beads):
        if not neighbours[i]:
            continue
        seen, shell = {i}, {i}
        for distance in (1, 2, 3):
            shell = {k for j in shell for k in neighbours[j]} - seen
            seen |= shell
            found[distance].update((i, j) for j in shell if j > i)
    return found
