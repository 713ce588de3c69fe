"""Sizes of molecules: radii of gyration and end-to-end distances."""

from __future__ import annotations

import reprlib
from collections.abc import Iterator
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from ..base.errors import ParameterError
from ..base.geometry import AXES_OF_TENSOR, minimum_images
from ..base.stats import Average, block_average
from .frames import Beads, Frame, Trajectories, chunks_of, frames_of, selected, weights_of
from .unwrapping import bonds_of, bonds_outwards, means_over, molecule_labels

if TYPE_CHECKING:
    import mdtraj


@dataclass(frozen=True, eq=False)
class MoleculeSizes:
    """Lengths (nm) of M molecules in F frames.

    Attributes
    ----------
    values : (F, M) array
        One value per frame and molecule; molecules are in the order of their first beads.
    """

    values: np.ndarray

    def __repr__(self) -> str:
        frames, molecules = self.values.shape
        return f"<MoleculeSizes of {molecules} molecules in {frames} frames, mean {self.values.mean():.4g} nm>"

    @property
    def mean(self) -> Average:
        """Mean over molecules and frames, with its error from blocks of frames."""
        return block_average(self.values.mean(axis=1))

    @property
    def mean_square(self) -> Average:
        """Mean square (nm^2) over molecules and frames, with its error from blocks of frames."""
        return block_average(np.mean(self.values**2, axis=1))


def radius_of_gyration(trajectory: Trajectories, beads: Beads = None) -> MoleculeSizes:
    r"""Radius of gyration of each molecule about its centre of mass, Rg^2 = sum m |r - r_com|^2/sum m.

    ``mdtraj.compute_rg`` treats all beads of a trajectory as one molecule and measures distances from the geometric centre.

    Parameters
    ----------
    trajectory : mdtraj.Trajectory or iterable of them
        Any box, or none.  Molecules are made whole along their bonds (``mdtraj.Trajectory.make_molecules_whole``).  No bond may be longer
        than half the box, and a molecule bonded to its own periodic image (a network, a ring around the box) has no size.
    beads : str, sequence of str, array of int, or None
        Beads to include; all by default.

    Returns
    -------
    MoleculeSizes
        Radii of the molecules with at least 2 of these beads.

    Raises
    ------
    ParameterError
        If there is no such molecule, the topology has no bonds, or a molecule closes through the periodic box.
    """
    topology, chunks = _bonded(trajectory)
    group, masses = selected(topology, beads), weights_of(topology)
    labels = molecule_labels(topology)[group]
    numbers = np.flatnonzero(np.bincount(labels) > 1)
    if not len(numbers):
        raise ParameterError("no molecule has two or more of these beads; select more beads")
    # molecules are numbered in the order of their first beads
    kept = group[np.isin(labels, numbers)]
    units = np.searchsorted(numbers, molecule_labels(topology)[kept])
    m, frames = masses[kept], whole_frames(topology, chunks, numbers)
    return MoleculeSizes(np.array([np.sqrt(gyration_tensors(frame.positions[kept], m, units)[:, :3].sum(axis=1)) for frame in frames]))


def gyration_tensors(positions: np.ndarray, masses: np.ndarray, units: np.ndarray) -> np.ndarray:
    """Gyration tensors of M molecules, S_ab = sum m (r - r_com)_a (r - r_com)_b/sum m, as (M, 6): xx, yy, zz, xy, xz, yz.  In
    ``positions`` (N, 3) molecules are whole; ``units`` (N,) has the molecule of each bead, from 0 to M - 1.  The trace is the squared
    radius of gyration."""
    total = np.bincount(units, masses)
    d = positions - means_over(units, masses, positions)[units]
    return np.column_stack([np.bincount(units, masses * d[:, a] * d[:, b]) / total for a, b in AXES_OF_TENSOR])


def end_to_end_distance(trajectory: Trajectories, ends: np.ndarray | None = None) -> MoleculeSizes:
    r"""End-to-end distance of each chain.

    Parameters
    ----------
    trajectory : mdtraj.Trajectory or iterable of them
        Any box, or none.  Molecules are made whole along their bonds, none of which may be longer than half the box.
    ends : (M, 2) array of int, optional
        Indices of the two end beads of each chain.  By default those of all linear chains: the two beads with a single bond.

    Raises
    ------
    ParameterError
        If there is no linear chain, two ends are in different molecules, or a molecule closes through the periodic box.
    """
    topology, chunks = _bonded(trajectory)
    pairs = _chain_ends(topology) if ends is None else np.asarray(ends)
    if pairs.ndim != 2 or pairs.shape[1] != 2 or pairs.dtype.kind not in "iu" or not len(pairs):
        raise ParameterError(f"ends must be pairs of beads, as [[0, 9], [10, 19]] (or None: all linear chains), not {reprlib.repr(ends)}")
    if pairs.min() < 0 or pairs.max() >= topology.n_atoms:
        raise ParameterError(f"ends must be indices from 0 to {topology.n_atoms - 1}; they go from {pairs.min()} to {pairs.max()}")
    labels = molecule_labels(topology)[pairs]
    apart = np.flatnonzero(labels[:, 0] != labels[:, 1])
    if len(apart):
        raise ParameterError(f"the ends {pairs[apart[0]].tolist()} are not in one molecule")
    frames = whole_frames(topology, chunks, labels[:, 0])
    return MoleculeSizes(np.array([np.linalg.norm(x[pairs[:, 1]] - x[pairs[:, 0]], axis=1) for x in (frame.positions for frame in frames)]))


def _chain_ends(topology: mdtraj.Topology) -> np.ndarray:
    """The two ends of each linear chain, (M, 2): of molecules with n beads and n - 1 bonds, in which no bead has more than two bonds."""
    bonds, labels = bonds_of(topology), molecule_labels(topology)
    degree = np.bincount(bonds.ravel(), minlength=topology.n_atoms)
    branched = np.zeros(labels.max() + 1, dtype=bool)
    branched[labels[degree > 2]] = True
    single = np.flatnonzero((degree == 1) & ~branched[labels])
    order = single[np.argsort(labels[single], kind="stable")]
    if not len(order):
        raise ParameterError("there is no linear chain; give the ends of the molecules")
    return order.reshape(-1, 2)


def _bonded(trajectory: Trajectories) -> tuple[mdtraj.Topology, Iterator[mdtraj.Trajectory]]:
    """Topology and chunks of a trajectory; ParameterError if its topology has no bonds."""
    topology, chunks = chunks_of(trajectory)
    if not len(bonds_of(topology)):
        raise ParameterError("the topology has no bonds, so there are no molecules; write_psf(..., bonds=...) writes them")
    return topology, chunks


def whole_frames(topology: mdtraj.Topology, chunks: Iterator[mdtraj.Trajectory], molecules: np.ndarray) -> Iterator[Frame]:
    """Frames in which no molecule is broken at the faces of the box; ParameterError if one of the ``molecules`` (numbers) is bonded to its
    own periodic image, so that no image of it is whole."""
    bonds, labels = bonds_of(topology), molecule_labels(topology)
    tree, bonds = bonds_outwards(topology).astype(np.int32), bonds[np.isin(labels[bonds[:, 0]], molecules)]
    whole = (chunk if chunk.unitcell_vectors is None else chunk.make_molecules_whole(sorted_bonds=tree) for chunk in chunks)
    for number, frame in enumerate(frames_of(whole)[1]):
        d = frame.positions[bonds[:, 1]] - frame.positions[bonds[:, 0]]
        shorter = np.linalg.norm(minimum_images(d, frame.box), axis=1) < (1 - 1e-4) * np.linalg.norm(d, axis=1)
        if shorter.any():
            i, j = bonds[np.argmax(shorter)].tolist()
            beads = np.flatnonzero(labels == labels[i])
            raise ParameterError(
                f"frame {number}: the molecule of bead {beads[0]} (counted from 0; {len(beads)} beads) has no size, since its bonds close "
                f"through the periodic box, at the bond of {i} and {j} (or a bond is longer than half the box); leave its beads out"
            )
        yield frame
