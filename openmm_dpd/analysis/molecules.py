"""Which beads are a molecule, and molecules made whole."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import scipy

from ..base.neighbours import connected, graph

if TYPE_CHECKING:
    import mdtraj


def bonds_of(topology: mdtraj.Topology) -> np.ndarray:
    """Bonds as (B, 2) indices."""
    return np.array([(bond[0].index, bond[1].index) for bond in topology.bonds], dtype=np.int64).reshape(-1, 2)


def molecule_labels(topology: mdtraj.Topology) -> np.ndarray:
    """Number of the molecule of each bead, (N,), from 0: beads connected by bonds, or residues if the topology has no bonds."""
    bonds = bonds_of(topology)
    if not len(bonds):
        return np.array([atom.residue.index for atom in topology.atoms], dtype=np.int64)
    return connected(bonds, topology.n_atoms).astype(np.int64)


def means_over(units: np.ndarray, weights: np.ndarray | None, x: np.ndarray) -> np.ndarray:
    """Weighted means (M, 3) over the beads of each of M units, whose numbers from 0 to M - 1 are given for every bead."""
    sums = [np.bincount(units, column if weights is None else weights * column) for column in x.T]
    return np.column_stack(sums) / np.bincount(units, weights)[:, None]


def bonds_outwards(topology: mdtraj.Topology) -> np.ndarray:
    """Bonds (parent, child) that reach every bead of a molecule from one of its beads, parents first.
    ``mdtraj.Trajectory.make_molecules_whole`` puts the second bead of each bond beside the first, in the given order; its own order is
    right for chains numbered along the chain only."""
    bonds = bonds_of(topology)
    count = topology.n_atoms
    if not len(bonds):
        return bonds
    # a further vertex joined to one bead of each molecule makes one search out of many
    roots = np.unique(molecule_labels(topology), return_index=True)[1]
    joined = np.concatenate([bonds, np.column_stack([np.full(len(roots), count), roots])])
    order, parents = scipy.sparse.csgraph.breadth_first_order(graph(joined, count + 1).tocsr(), count, directed=False)
    tree = np.column_stack([parents[order[1:]], order[1:]]).astype(np.int64)
    return tree[tree[:, 0] != count]
