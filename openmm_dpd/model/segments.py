"""Segmental repulsion, which keeps bonds from passing through each other."""

from dataclasses import dataclass

import numpy as np

from ..base.errors import ParameterError, bead_names, in_length, what_is
from ..base.geometry import minimum_images
from ..base.units import keep
from .bonds import bead_indices
from .pairs import checked

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
    bonds : (S, 2) array of int, optional
        Bead pairs of the segments; by default all bonds of the scene.
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
    bonds: np.ndarray | None = None
    exclude_adjoining: bool = True

    def __post_init__(self):
        keep(self, A=checked(self.A, "force", "A of the segmental repulsion"))
        keep(self, cutoff=checked(self.cutoff, "length", "cutoff of the segmental repulsion", positive=True))
        if self.distance not in DISTANCES:
            raise ParameterError(f"distance of the segmental repulsion must be 'mid' or 'min', not {what_is(self.distance)}")
        if not isinstance(self.exclude_adjoining, (bool, np.bool_)):
            raise ParameterError(f"exclude_adjoining must be True or False, not {what_is(self.exclude_adjoining)}")
        if self.distance == "min" and not self.exclude_adjoining:
            raise ParameterError("bonds that share a bead have the distance 0 with distance='min'; they must be left out")
        if self.bonds is not None:
            pairs = bead_indices(self.bonds, 2, "segments")
            different, counts = np.unique(np.sort(pairs, axis=1), axis=0, return_counts=True)
            if np.any(counts > 1):
                raise ParameterError(f"the segment between {bead_names(*different[counts > 1][0])} is listed twice")
            keep(self, bonds=pairs)

    def reach(self, longest: float) -> float:
        """Largest distance of midpoints, nm, at which two bonds of at most this length can interact."""
        return self.cutoff + (longest if self.distance == "min" else 0.0)


def check_segments(segments: SegmentalRepulsion, pairs: np.ndarray, x: np.ndarray, box: np.ndarray | None) -> None:
    """Raise ParameterError if there are no segments, or if at positions x two of them could interact with more than one image."""
    if not len(pairs):
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
