"""Radial distribution functions."""

import numpy as np

from ..base.errors import ParameterError
from ..base.neighbours import pairs_within
from ..base.units import whole_number
from .curves import Curve, curve_of
from .frames import Beads, Frame, Trajectories, frames_of, positive_number, two_selected
from .molecules import molecule_labels


def radial_distribution(
    trajectory: Trajectories, beads: Beads = None, other: Beads = None, *, r_max: float, n_bins: int = 100, between_molecules: bool = False
) -> Curve:
    r"""Radial distribution function g(r) of two sets of beads.

    .. math:: g_{ab}(r) = \frac{V}{P} \left\langle \frac{n_{ab}(r)}{\frac{4\pi}{3}(r_+^3 - r_-^3)} \right\rangle,

    with n(r) the pairs (i of a, j of b, i != j) whose distance is in the bin from :math:`r_-` to :math:`r_+`, and P the number of all such
    pairs: N_a N_b without the beads that are in both, N (N - 1) for equal sets.  So it is 1 for an ideal gas of any size.

    ``mdtraj.compute_rdf`` gives the same numbers, but needs a list of all pairs; this finds the near ones itself.

    Parameters
    ----------
    trajectory : mdtraj.Trajectory or iterable of them
        Any periodic box, which may change.
    beads, other : str, sequence of str, array of int, or None
        Types (or indices) a and b; all beads by default, and b = a.
    r_max : float
        Largest distance (nm), at most half the smallest width of the box.  All pairs up to there are in memory (60 bytes each) for a frame.
    n_bins : int, default 100
        Bins from 0 to r_max.
    between_molecules : bool
        Count pairs of beads of different molecules only.

    Returns
    -------
    Curve
        x: middles of the bins (nm); y: g(r).

    Raises
    ------
    ParameterError
        If there is no box, r_max is too large for it, or there are no pairs.

    References
    ----------
    M. P. Allen and D. J. Tildesley, Computer Simulation of Liquids, 2nd ed., section 2.6.
    """
    r_max, n_bins = positive_number(r_max, "r_max"), whole_number(n_bins, "n_bins", least=1)
    topology, frames = frames_of(trajectory)
    a, b = two_selected(topology, beads, other)
    # what a pair must differ in
    labels = molecule_labels(topology) if between_molecules else np.arange(topology.n_atoms)
    pairs = len(a) * len(b) - np.bincount(labels[a], minlength=len(labels)) @ np.bincount(labels[b], minlength=len(labels))
    if pairs <= 0:
        raise ParameterError("there are no pairs of beads to take a radial distribution of")
    edges = np.linspace(0.0, r_max, n_bins + 1)
    rows = []
    for frame in frames:
        volume = np.linalg.det(frame.need_box("a radial distribution"))
        rows.append(distribution_of_counts(_counts(frame, a, b, labels, edges), edges, float(pairs), volume))
    return curve_of(0.5 * (edges[1:] + edges[:-1]), rows, "g(r)")


def distribution_of_counts(counts: np.ndarray, edges: np.ndarray, pairs: float, volume: float) -> np.ndarray:
    """g(r) of :func:`radial_distribution` in one frame, from the pairs by distance (B,), edges of the bins (B + 1,), and the number of all
    pairs."""
    return counts * volume / (pairs * (4 * np.pi / 3 * np.diff(edges**3)))


def _counts(frame: Frame, a: np.ndarray, b: np.ndarray, labels: np.ndarray, edges: np.ndarray) -> np.ndarray:
    """Numbers of pairs by distance."""
    same = a is b
    i, j, r = pairs_within(frame.positions[a], None if same else frame.positions[b], frame.box, edges[-1])
    # each pair of equal beads is (i, j) and (j, i)
    return (2 if same else 1) * np.histogram(r[labels[a[i]] != labels[b[j]]], len(edges) - 1, (0.0, edges[-1]))[0]
