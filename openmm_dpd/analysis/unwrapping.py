"""Molecules of a topology, and continuous paths of beads from positions that were wrapped into the box."""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING

import numpy as np
import scipy

from ..base.errors import ParameterError, what_is
from ..base.geometry import connected, graph
from .frames import Frame

if TYPE_CHECKING:
    import mdtraj


def bonds_of(topology: mdtraj.Topology) -> np.ndarray:
    """Bonds of a topology as bead indices, (B, 2)."""
    return np.array([(bond[0].index, bond[1].index) for bond in topology.bonds], dtype=np.int64).reshape(-1, 2)


def molecule_labels(topology: mdtraj.Topology) -> np.ndarray:
    """Number of the molecule that each bead is in, (N,), from 0.  Bonds connect molecules; without any bonds, residues are molecules."""
    bonds = bonds_of(topology)
    if not len(bonds):
        return np.array([atom.residue.index for atom in topology.atoms], dtype=np.int64)
    return connected(bonds, topology.n_atoms).astype(np.int64)


def means_over(units: np.ndarray, weights: np.ndarray | None, x: np.ndarray) -> np.ndarray:
    """Weighted means of x (N, 3) over the beads of each of M units, (M, 3); ``units`` (N,) has the number of each bead's unit, from 0."""
    sums = [np.bincount(units, column if weights is None else weights * column) for column in x.T]
    return np.column_stack(sums) / np.bincount(units, weights)[:, None]


def bonds_outwards(topology: mdtraj.Topology) -> np.ndarray:
    """Bonds (parent, child) that reach every bead of a molecule from one of its beads, parents first, for
    ``mdtraj.Trajectory.make_molecules_whole``: its default order is right only for chains numbered along the chain."""
    bonds = bonds_of(topology)
    count = topology.n_atoms
    if not len(bonds):
        return bonds
    # one extra vertex, joined to one bead of each molecule, makes one search of many
    roots = np.unique(molecule_labels(topology), return_index=True)[1]
    joined = np.concatenate([bonds, np.column_stack([np.full(len(roots), count), roots])])
    order, parents = scipy.sparse.csgraph.breadth_first_order(graph(joined, count + 1).tocsr(), count, directed=False)
    tree = np.column_stack([parents[order[1:]], order[1:]]).astype(np.int64)
    return tree[tree[:, 0] != count]


if TYPE_CHECKING:
    import mdtraj

#: Largest root mean square displacement between frames, in box edges along an axis, at which wrapped positions can be unwrapped: half an
#: edge is four standard deviations.
MOST_STEP = 0.125


def unwrapped(topology: mdtraj.Topology, frames: Iterator[Frame], unwrap: bool | str = "auto") -> Iterator[np.ndarray]:
    r"""Unwrapped positions (N, 3) of each frame, on continuous paths.

    Between frames each bead moves by the shortest image of its displacement, d - round(d h^-1) h with the new box h, so paths are right
    even if the box changes (S. von Buelow, J. T. Bullerjahn, G. Hummer, J. Chem. Phys. 153, 021101 (2020)).  Single beads or whole
    molecules (as by OpenMM's reporters) may be wrapped.

    Parameters
    ----------
    topology : mdtraj.Topology
    frames : iterator of Frame
    unwrap : {"auto", True, False}
        True: unwrap.  False: positions are on continuous paths already.  ``auto``: unwrap from where a bead first moves by more than half
        a box edge; positions must be wrapped there.

    Raises
    ------
    ParameterError
        If beads move too far between frames to be followed, time goes back, or (``auto``) positions are neither wrapped nor continuous.
    """
    if unwrap not in (True, False, "auto"):
        raise ParameterError(f"unwrap must be True, False or 'auto', not {what_is(unwrap)}")
    labels = molecule_labels(topology)
    before: np.ndarray | None = None
    path, time = np.zeros(0), 0.0
    for number, frame in enumerate(frames):
        x = frame.positions
        if 0 < frame.time <= time:  # chunks without times begin at 0
            raise ParameterError(
                f"frame {number}: time goes back from {time:g} to {frame.time:g} ps; of frames that a restart wrote twice, keep the last"
            )
        if before is None or frame.box is None or unwrap is False:
            path = x if before is None else path + (x - before)
        else:
            step = (x - before) @ np.linalg.inv(frame.box)
            turns = np.round(step)
            if turns.any():
                _check(frame, number, step - turns, labels if unwrap == "auto" else None)
            path = path + (x - before - turns @ frame.box)
        before, time = x, frame.time
        yield path


def _check(frame: Frame, number: int, step: np.ndarray, labels: np.ndarray | None) -> None:
    """ParameterError if a frame cannot be unwrapped: steps (in box edges) are too large, or, given labels, molecules are not wrapped."""
    if labels is not None and not is_folded(frame, labels):
        raise ParameterError(
            f"frame {number}: a bead moves by more than half the box, but positions are not wrapped into the box; "
            "use unwrap=False if they are on continuous paths, unwrap=True if not"
        )
    most = float(np.sqrt(np.mean(step**2, axis=0)).max())
    if most > MOST_STEP:
        raise ParameterError(
            f"frame {number}: positions are wrapped, and beads move by {most:.2g} box edges (root mean square) between frames; above "
            f"{MOST_STEP:g} their paths are ambiguous. Write frames more often, or unwrapped positions"
        )


def is_folded(frame: Frame, labels: np.ndarray) -> bool:
    """Whether the centres of all molecules lie in one cell: the parallelepiped, or the brick that OpenMM uses for tilted boxes."""
    assert frame.box is not None
    centres = means_over(labels, None, frame.positions)
    spans = (np.ptp(centres @ np.linalg.inv(frame.box), axis=0), np.ptp(centres, axis=0) / np.diagonal(frame.box))
    return any(bool(np.all(span <= 1 + 1e-4)) for span in spans)
