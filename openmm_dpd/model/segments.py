"""Segmental repulsion, which keeps bonds from passing through each other."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from ..base.errors import ParameterError, bead_names, in_length, require, require_one
from ..base.geometry import minimum_images
from ..base.units import keep
from .bonds import bead_indices
from .pairs import checked
from .reactions import ReactiveBonds, bond_sorts

#: Definitions of the distance between two segments.
DISTANCES = ("mid", "min")


@dataclass(frozen=True, eq=False)
class SegmentalRepulsion:
    r"""Repulsion between bonds, which keeps soft chains from crossing (LAMMPS: ``pair_style srp``).

    F = A (1 - d/cutoff) along d, and U = 1/2 A cutoff (1 - d/cutoff)^2, with d the distance between the midpoints of two bonds
    (``"mid"``) or between their nearest points (``"min"``).  The lever rule distributes the force to the ends of each bond.
    Sirk, Slizoberg, Brennan, Lisal and Andzelm, J. Chem. Phys. 136, 134903 (2012), doi:10.1063/1.3698476.

    Parameters
    ----------
    A : force
        Repulsion at d = 0, kJ/mol/nm, >= 0.
    cutoff : length, default 1
        Range, nm, > 0.
    distance : {"mid", "min"}
        Points of two bonds that repel each other: midpoints or nearest points.
    bonds : (S, 2) array of int, or list of ReactiveBonds, optional
        Bead pairs of the segments, or bonds that form and break; by default all bonds of the scene, these included.
    exclude_adjoining : bool, default True
        Exclude pairs of bonds that share a bead; ``False`` is possible only with ``"mid"``.

    Raises
    ------
    ParameterError
        If a value is out of bounds, or the choices contradict each other.
    """

    A: float
    cutoff: float = 1.0
    distance: str = "mid"
    bonds: np.ndarray | Sequence[ReactiveBonds] | None = None
    exclude_adjoining: bool = True

    def __post_init__(self):
        keep(self, A=checked(self.A, "force", "A of the segmental repulsion"))
        keep(self, cutoff=checked(self.cutoff, "length", "cutoff of the segmental repulsion", positive=True))
        require_one(self.distance, DISTANCES, "distance of the segmental repulsion")
        require(self.exclude_adjoining, (bool, np.bool_), "exclude_adjoining must be True or False")
        if self.distance == "min" and not self.exclude_adjoining:
            raise ParameterError("bonds that share a bead have the distance 0 with distance='min'; they must be left out")
        if self.reactive:
            keep(self, bonds=tuple(self.bonds))  # type: ignore[arg-type]  # there are some
        elif self.bonds is not None:
            pairs = bead_indices(self.bonds, 2, "segments")
            different, counts = np.unique(np.sort(pairs, axis=1), axis=0, return_counts=True)
            if np.any(counts > 1):
                raise ParameterError(f"the segment between {bead_names(*different[counts > 1][0])} is listed twice")
            keep(self, bonds=pairs)

    @property
    def reactive(self) -> bool:
        """Whether ``bonds`` are those that form and break."""
        return isinstance(self.bonds, (list, tuple)) and bool(self.bonds) and all(isinstance(each, ReactiveBonds) for each in self.bonds)

    def reach(self, longest: float) -> float:
        """Largest distance of midpoints, nm, at which two bonds of at most this length can interact."""
        return self.cutoff + (longest if self.distance == "min" else 0.0)


def segment_parts(scene: Any) -> tuple[np.ndarray, list[ReactiveBonds]]:
    """Of the bonds of a scene that repel each other those that stay, (S, 2), and those that form and break."""
    its, none = scene.segments, np.zeros((0, 2), dtype=np.int64)
    if its is None or its.bonds is None:
        return (none, []) if its is None else (scene.bond_pairs, bond_sorts(scene.reactions))
    return (none, list(its.bonds)) if its.reactive else (its.bonds, [])


def check_segments(scene: Any) -> None:
    """Raise ParameterError if there are no segments, or bonds cannot be some, or if two of them could interact with more than one image."""
    segments, x, box = scene.segments, scene.positions, scene.box
    if segments is None:
        return
    require(segments, SegmentalRepulsion, "segments must be a SegmentalRepulsion")
    pairs = scene.segment_pairs
    sorts = {*map(id, segment_parts(scene)[1])}
    if not sorts <= {*map(id, bond_sorts(scene.reactions))}:
        raise ParameterError("`segments` name bonds that none of the `reactions` makes or breaks")
    if any(each.forms and each.energy is not None and id(each.bonds) in sorts for each in scene.reactions):
        raise ParameterError("bonds in equilibrium have the odds of their own energy, so they cannot be among the `segments`")
    if not len(pairs):
        if sorts:
            return
        raise ParameterError("the segmental repulsion acts between bonds, but there are none; list them in `bonds`")
    if pairs.max() >= len(x):
        raise ParameterError(f"a segment names bead {pairs.max()}, but there are only {len(x)} beads, counted from 0")
    if box is None:
        return
    longest = float(np.linalg.norm(minimum_images(x[pairs[:, 1]] - x[pairs[:, 0]], box), axis=1).max())
    half = 0.5 * float(np.diag(box).min())
    if segments.reach(longest) > half * (1 + 1e-12):
        bonds = f", with bonds of up to {in_length(longest)}," if segments.distance == "min" else ""
        raise ParameterError(
            f"the segmental repulsion reaches {in_length(segments.cutoff)}{bonds} which is over half the box, whose smallest width is "
            f"{in_length(2 * half)}; use a larger box or a smaller cutoff"
        )
