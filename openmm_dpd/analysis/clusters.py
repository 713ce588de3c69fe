"""Clusters of beads or molecules: micelles, droplets, domains."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ..base.errors import ParameterError, require_one, what_is
from ..base.geometry import connected, pairs_within
from ..base.stats import Average, ratio_average
from ..base.units import whole_number
from .frames import Beads, Trajectories, frames_of, positive_number, selected
from .unwrapping import molecule_labels


@dataclass(frozen=True, eq=False)
class Clusters:
    """Sizes of clusters, frame by frame.

    Attributes
    ----------
    sizes : tuple of arrays of int
        Sizes of the clusters in each frame, largest first; those below ``least`` are left out.
    number_average : openmm_dpd.base.stats.Average
        Number-averaged size, <sum n>/<number of clusters>, with its error from blocks of frames.
    weight_average : openmm_dpd.base.stats.Average
        Weight-averaged size, <sum n^2>/<sum n>: the mean size of the cluster that a bead or molecule is in.
    """

    sizes: tuple[np.ndarray, ...]
    number_average: Average
    weight_average: Average

    def __repr__(self) -> str:
        mean = self.number_average.mean
        return f"<Clusters in {len(self.sizes)} frames, {'none' if mean is None else f'of {mean:.4g} on average'}>"

    @property
    def largest(self) -> np.ndarray:
        """Size of the largest cluster of each frame, (F,); 0 if the frame has none."""
        return np.array([sizes[0] if len(sizes) else 0 for sizes in self.sizes])

    @property
    def distribution(self) -> tuple[np.ndarray, np.ndarray]:
        """Sizes that occur, (K,), and the mean number of clusters of each size per frame, (K,)."""
        size, count = np.unique(np.concatenate(self.sizes), return_counts=True)
        return size, count / len(self.sizes)


def cluster_labels(
    positions: np.ndarray, cutoff: float, box: np.ndarray | None = None, molecules: Sequence[int] | np.ndarray | None = None
) -> np.ndarray:
    """Number of the cluster that each bead is in, (N,), from 0; cluster 0 is the largest.

    Parameters
    ----------
    positions : (N, 3) array
    cutoff : float
        Beads at most this far apart (nm) are in one cluster.
    box : (3, 3) box vectors as rows, or None
    molecules : (N,) array of int, optional
        Beads of one molecule are in one cluster at any distance; the size of a cluster is then the number of its molecules.
    """
    if box is not None and np.shape(box) != (3, 3):
        raise ParameterError(f"box must be three box vectors, not {what_is(box)}")
    i, j, _ = pairs_within(np.asarray(positions, dtype=np.float64), None, box, positive_number(cutoff, "cutoff"))
    units = np.arange(len(positions)) if molecules is None else np.unique(molecules, return_inverse=True)[1]
    if units.shape != (len(positions),):
        raise ParameterError(f"molecules must have a number for each of the {len(positions)} beads; its shape is {units.shape}")
    count = int(units.max()) + 1 if len(units) else 0
    label = connected(np.column_stack([units[i], units[j]]), count)
    rank = np.empty(int(label.max()) + 1 if count else 0, dtype=np.int64)
    rank[np.argsort(-np.bincount(label), kind="stable")] = np.arange(len(rank))
    return rank[label][units]


def cluster_sizes(trajectory: Trajectories, beads: Beads = None, *, cutoff: float, by: str = "molecule", least: int = 1) -> Clusters:
    """Sizes of clusters of connected beads or molecules: aggregation numbers of micelles, sizes of droplets.

    Parameters
    ----------
    trajectory : mdtraj.Trajectory or iterable of them
        Any box, or none.
    beads : str, sequence of str, array of int, or None
        Beads that connect, such as the tails of surfactants.  All by default.
    cutoff : float
        Beads at most this far apart (nm) are connected.  The usual choice is the first minimum of their g(r), 1 to 1.3 DPD cutoffs.
    by : {"molecule", "bead"}
        What is counted.  Molecules are beads connected by bonds (residues, if the topology has no bonds); two are in one cluster if any of
        their beads connect.
    least : int
        Smallest cluster to count; 2 leaves out free molecules.

    Raises
    ------
    ParameterError
        If the cutoff is more than half the width of the box, or there is no cluster of that size in any frame.
    """
    require_one(by, ("molecule", "bead"), "by")
    least = whole_number(least, "least", least=1)
    topology, frames = frames_of(trajectory)
    group = selected(topology, beads)
    units = np.arange(len(group)) if by == "bead" else np.unique(molecule_labels(topology)[group], return_inverse=True)[1]
    # clusters are counted by one bead of each bead or molecule
    first = np.unique(units, return_index=True)[1]
    found = []
    for frame in frames:
        sizes = np.bincount(cluster_labels(frame.positions[group], cutoff, frame.box, units)[first])
        found.append(sizes[sizes >= least])
    if not any(len(sizes) for sizes in found):
        raise ParameterError(f"no frame has a cluster of {least} or more; take a larger cutoff or a smaller least")
    moments = [np.array([np.sum(sizes.astype(np.float64) ** k) for sizes in found]) for k in range(3)]
    return Clusters(
        tuple(found),
        ratio_average(moments[1], moments[0], name="the mean size of clusters"),
        ratio_average(moments[2], moments[1], name="the weighted mean size of clusters"),
    )
