"""Radial distribution functions, and static structure factors on the wave vectors of the box."""

import numpy as np

from ..base.errors import ParameterError
from ..base.geometry import pairs_within
from ..base.stats import block_average
from ..base.units import whole_number
from .frames import Beads, Curve, Frame, Trajectories, curve_of, curve_of_averages, frames_of, positive_number, two_selected
from .unwrapping import molecule_labels


def radial_distribution(
    trajectory: Trajectories, beads: Beads = None, other: Beads = None, *, r_max: float, n_bins: int = 100, between_molecules: bool = False
) -> Curve:
    r"""Radial distribution function g(r) of two sets of beads.

    .. math:: g_{ab}(r) = \frac{V}{P} \left\langle \frac{n_{ab}(r)}{\frac{4\pi}{3}(r_+^3 - r_-^3)} \right\rangle,

    with n(r) the number of pairs (i of a, j of b, i != j) whose distance is in the bin from :math:`r_-` to :math:`r_+`, and P the number of
    all pairs: N_a N_b less the beads in both sets, so N (N - 1) for equal sets.  Hence g = 1 for an ideal gas of any size.

    ``mdtraj.compute_rdf`` gives the same numbers from a list of all pairs, which is not needed here.

    Parameters
    ----------
    trajectory : mdtraj.Trajectory or iterable of them
        Any periodic box, which may change.
    beads, other : str, sequence of str, array of int, or None
        Types (or indices) a and b; by default all beads, and b = a.
    r_max : float
        Largest distance (nm), at most half the smallest width of the box.  All pairs within it are in memory, 60 bytes each, for a frame.
    n_bins : int, default 100
        Number of bins from 0 to r_max.
    between_molecules : bool
        Count only pairs of beads of different molecules.

    Returns
    -------
    Curve
        x: midpoints of the bins (nm); y: g(r).

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
    # labels that have to differ in a pair
    labels = molecule_labels(topology) if between_molecules else np.arange(topology.n_atoms)
    pairs = len(a) * len(b) - np.bincount(labels[a], minlength=len(labels)) @ np.bincount(labels[b], minlength=len(labels))
    if pairs <= 0:
        raise ParameterError("a radial distribution needs pairs of beads; these selections have none")
    edges = np.linspace(0.0, r_max, n_bins + 1)
    rows = []
    for frame in frames:
        volume = np.linalg.det(frame.need_box("a radial distribution"))
        rows.append(distribution_of_counts(_counts(frame, a, b, labels, edges), edges, float(pairs), volume))
    return curve_of(0.5 * (edges[1:] + edges[:-1]), rows, "g(r)")


def distribution_of_counts(counts: np.ndarray, edges: np.ndarray, pairs: float, volume: float, dimension: int = 3) -> np.ndarray:
    """g(r) of one frame, (B,), from the number of pairs in each bin (B,), edges of the bins (B + 1,) and the number of all pairs."""
    shells = 4 * np.pi / 3 * np.diff(edges**3) if dimension == 3 else np.pi * np.diff(edges**2)
    return counts * volume / (pairs * shells)


def _counts(frame: Frame, a: np.ndarray, b: np.ndarray, labels: np.ndarray, edges: np.ndarray) -> np.ndarray:
    """Number of pairs of a bead of a and one of b with different labels in each bin of distances, (B,)."""
    same = a is b
    i, j, r = pairs_within(frame.positions[a], None if same else frame.positions[b], frame.box, edges[-1])
    # within one set, each pair counts as (i, j) and (j, i)
    return (2 if same else 1) * np.histogram(r[labels[a[i]] != labels[b[j]]], len(edges) - 1, (0.0, edges[-1]))[0]


#: More wave vectors than this are a mistake.
MOST_VECTORS = 5_000_000
#: Number of bins per shortest wave vector.
SHORTEST_IN_BINS = 10


def structure_factor(
    trajectory: Trajectories, beads: Beads = None, other: Beads = None, *, q_max: float, width: float | None = None
) -> Curve:
    r"""Isotropic static structure factor S(q), total or partial.

    .. math::

        S_{ab}(q) = \frac{1}{\sqrt{N_a N_b}} \langle \mathrm{Re}\, \rho_a(\mathbf q) \rho_b(\mathbf q)^* \rangle, \qquad
        \rho_a(\mathbf q) = \sum_{i \in a} e^{-i \mathbf q \cdot \mathbf r_i},

    averaged over the wave vectors q = 2 pi h^-1 n (n integers, h the box vectors as rows) whose lengths are in the same bin.  Only at these
    does a periodic box not scatter from its edges.  At large q, S tends to 1 for a = b, else to 0.

    Parameters
    ----------
    trajectory : mdtraj.Trajectory or iterable of them
        Any periodic box, which may change.
    beads, other : str, sequence of str, array of int, or None
        Types (or indices) a and b; by default all beads, and b = a.
    q_max : float
        Largest wave number, 1/nm.
    width : float, optional
        Width of the bins of q, 1/nm.  By default a tenth of the shortest wave vector q_1 of the first frame, which in a cube separates all
        shells of equal q up to 5 q_1.  Wide bins smooth S at large q, but shift and flatten peaks at small q.

    Returns
    -------
    Curve
        x: mean length of the wave vectors in each bin, 1/nm; y: S.  Each is averaged over the frames that have vectors in the bin, as the
        box may change.  Empty bins are left out.

    Raises
    ------
    ParameterError
        If there is no box, q_max is below the shortest wave vector, or there are more than 5 million of them.

    Notes
    -----
    Sums over powers of each bead's three phase factors are matrix products, so all wave vectors cost about as much as a few.
    ``freud`` samples the wave vectors instead.

    References
    ----------
    M. P. Allen and D. J. Tildesley, Computer Simulation of Liquids, 2nd ed., section 2.6; N. W. Ashcroft and D. C. Langreth,
    Phys. Rev. 156, 685 (1967), for the normalisation of partial structure factors.
    """
    q_max = positive_number(q_max, "q_max")
    topology, frames = frames_of(trajectory)
    a, b = two_selected(topology, beads, other)
    means: dict[int, list[tuple[float, float]]] = {}
    count = 0
    for frame in frames:
        q, strength = _strengths(frame, a, b, q_max)
        if width is None:
            width = float(q.min()) / SHORTEST_IN_BINS
        # bins are centred on multiples of the width, so that the shortest vectors stay in their bin when the box changes
        which, place = np.unique(np.rint(q / positive_number(width, "width")).astype(np.int64), return_inverse=True)
        counts = np.bincount(place)
        for k, *mean in zip(which.tolist(), np.bincount(place, q) / counts, np.bincount(place, strength) / counts, strict=True):
            means.setdefault(k, []).append(tuple(mean))
        count += 1
    x, y = zip(*(np.transpose(means[k]) for k in sorted(means)), strict=True)
    return curve_of_averages([q.mean() for q in x], [block_average(series, name="the structure factor") for series in y], count)


def _strengths(frame: Frame, a: np.ndarray, b: np.ndarray, q_max: float) -> tuple[np.ndarray, np.ndarray]:
    """Lengths of the wave vectors up to q_max, (K,), and S at each; of n and -n only one."""
    fractions = frame.fractions("a structure factor")
    reciprocal = 2 * np.pi * np.linalg.inv(frame.need_box("a structure factor")).T
    limits = largest_indices(frame.need_box("a structure factor"), q_max)
    indices = np.stack(np.meshgrid(*(np.arange(-n, n + 1) for n in limits[:2]), np.arange(limits[2] + 1), indexing="ij"), axis=-1)
    q = np.linalg.norm(indices @ reciprocal, axis=-1)
    # half of the space, without the origin
    half = (indices[..., 2] > 0) | ((indices[..., 2] == 0) & ((indices[..., 1] > 0) | ((indices[..., 1] == 0) & (indices[..., 0] > 0))))
    kept = half & (q <= q_max * (1 + 1e-6))
    if not kept.any():
        raise ParameterError(f"q_max = {q_max:g} is below the shortest wave vector of the box, {q[half].min():.4g}/nm; take a larger one")
    density = density_waves(fractions[a], limits)
    partner = density if b is a else density_waves(fractions[b], limits)
    return q[kept], (density * partner.conj()).real[kept] / np.sqrt(len(a) * len(b))


def largest_indices(box: np.ndarray, q_max: float) -> np.ndarray:
    """Largest integers n of wave vectors 2 pi h^-1 n up to q_max, (3,): q . a_k = 2 pi n_k, so n_k <= q_max |a_k| / (2 pi)."""
    limits = np.maximum(1, np.floor(q_max * np.linalg.norm(box, axis=1) / (2 * np.pi) + 1e-6))
    if np.prod(2 * limits + 1) > 2 * MOST_VECTORS:
        raise ParameterError(
            f"q_max = {q_max:g} asks for {np.prod(2 * limits + 1) / 2:.3g} wave vectors, more than {MOST_VECTORS:,}; take a smaller one"
        )
    return limits.astype(np.int64)


def density_waves(fractions: np.ndarray, limits: np.ndarray, block: int = 4096) -> np.ndarray:
    """Sums of exp(-2 pi i n . s) over beads with fractional positions s, (N, 3): complex (2 nx + 1, 2 ny + 1, nz + 1), with n from -limits
    to limits along the first two axes and from 0 along the last."""
    nx, ny, nz = limits.tolist()
    total = np.zeros((2 * nx + 1, (2 * ny + 1) * (nz + 1)), dtype=np.complex128)
    for start in range(0, len(fractions), block):
        # phases of all n are powers of those of n = 1; positions are wrapped first, so that large ones lose no digits
        s = fractions[start : start + block] - np.floor(fractions[start : start + block])
        x, y, z = (
            np.exp(-2j * np.pi * s[:, k, None] * np.arange(low, high + 1)) for k, (low, high) in enumerate(((-nx, nx), (-ny, ny), (0, nz)))
        )
        step = max(1, 1_000_000 // ((2 * ny + 1) * (nz + 1)))
        for part in range(0, len(s), step):
            cut = slice(part, part + step)
            total += x[cut].T @ (y[cut, :, None] * z[cut, None, :]).reshape(len(s[cut]), -1)
    return total.reshape(2 * nx + 1, 2 * ny + 1, nz + 1)
