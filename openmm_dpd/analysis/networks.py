"""Networks: clusters of bonded beads, how far a reaction has gone, and gels."""

from dataclasses import dataclass

import numpy as np

from ..base.errors import ParameterError
from ..base.geometry import connected


@dataclass(frozen=True)
class Network:
    """What bonds connect."""

    labels: np.ndarray  #: (N,) number of the cluster of each bead, from 0
    sizes: np.ndarray  #: (C,) beads (or units) of each cluster
    gel: float  #: Part of all beads (or units) that are in the largest cluster
    mean_size: float  #: Mean size of the clusters but the largest, weighted by size: it diverges at the gel point


def network(bonds: np.ndarray, count: int, units=None) -> Network:
    """What bonds connect: clusters of beads, and the largest one, the gel if there is one.

    Parameters
    ----------
    bonds : (B, 2) array of int
        Beads of all bonds, those that stay and those of :func:`openmm_dpd.read_bonds` (its first two columns).
    count : int
        Number of beads.
    units : (N,) array, optional
        What each bead counts for the sizes, 1 by default: 1 for one bead of each molecule counts molecules.

    Returns
    -------
    Network
    """
    labels = connected(np.asarray(bonds)[:, :2], count)
    sizes = np.bincount(labels, units)
    smaller = np.delete(sizes, sizes.argmax())
    return Network(labels, sizes, float(sizes.max() / sizes.sum()), float((smaller**2).sum() / max(smaller.sum(), 1e-300)))


def gel_fraction(conversion, functionality: int) -> np.ndarray:
    r"""Gel fraction of molecules with f equal groups that react in pairs, without rings (Flory, J. Am. Chem. Soc. 63, 3083 (1941);
    Stockmayer, J. Chem. Phys. 11, 45 (1943)).

    A group leads to a finite part with the probability v, the smallest root of :math:`v = 1 - p + p v^{f-1}`, and a molecule is in the sol
    with :math:`v^f`.  The gel point is :math:`p = 1/(f - 1)`.

    Parameters
    ----------
    conversion, functionality : float or array, and int
        Part p of all groups that have reacted, and number f of groups of each molecule, at least 3.
    """
    p = np.asarray(conversion, dtype=np.float64)
    if functionality < 3 or np.any((p < 0) | (p > 1)):
        raise ParameterError("a gel needs molecules of three groups or more, and conversions are from 0 to 1")
    v = np.zeros_like(p)
    for _ in range(10_000):
        v = 1 - p + p * v ** (functionality - 1)
    return 1 - v**functionality
