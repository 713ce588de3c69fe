"""Geometry in a box of reduced (lower triangular) vectors: minimum images, pairs within a distance and what they connect; and symmetric
tensors as six numbers, xx, yy, zz, xy, xz, yz."""

import numpy as np
import scipy

from .errors import ParameterError

#: The two axes of each component of a symmetric tensor.
AXES_OF_TENSOR = ((0, 0), (1, 1), (2, 2), (0, 1), (0, 2), (1, 2))
_FIRST, _SECOND = map(list, zip(*AXES_OF_TENSOR, strict=True))


def widths(box: np.ndarray) -> np.ndarray:
    """Distances between opposite faces of a box, (3,): its edges unless it is tilted."""
    return 1.0 / np.linalg.norm(np.linalg.inv(box), axis=0)


def most_tilted(box: np.ndarray) -> np.ndarray:
    """Box vectors with the second one tilted along x as far as reduced vectors can be."""
    tilted = box.copy()
    tilted[1, 0] = 0.5 * box[0, 0]
    return tilted


def reduced(vectors) -> np.ndarray:
    """Box vectors of the lattice in OpenMM's reduced form (no tilt above half an edge), from vectors with a along x and b in the xy plane.
    A tilt that exceeds half an edge by a rounding error becomes half an edge."""
    vectors = np.tril(np.asarray(vectors, dtype=np.float64))
    for row, column in ((2, 1), (2, 0), (1, 0)):
        half = 0.5 * vectors[column, column]
        if abs(vectors[row, column]) > half * (1 + 1e-9):
            vectors[row] -= vectors[column] * np.round(vectors[row, column] / (2 * half))
        vectors[row, column] = np.clip(vectors[row, column], -half, half)
    return vectors


def minimum_images(d: np.ndarray, box: np.ndarray | None) -> np.ndarray:
    """Minimum images of distance vectors (K, 3); unchanged without a box."""
    if box is None:
        return d
    d = d.copy()
    for k in (2, 1, 0):
        d -= np.outer(np.rint(d[:, k] / box[k, k]), box[k])
    return d


def folded(x: np.ndarray, box: np.ndarray | None) -> np.ndarray:
    """Positions (N, 3) wrapped into the box whose lower corner is the origin, the parallelepiped of its vectors; unchanged without a box.
    (OpenMM's States wrap into a cuboid as large.)"""
    if box is None:
        return x
    x, part = x.copy(), np.zeros_like(x)
    for k in (2, 1, 0):
        part[:, k] = (x[:, k] - sum(part[:, above] * box[above, k] for above in range(k + 1, 3))) / box[k, k]
        turns = np.floor(part[:, k])
        part[:, k] -= turns
        x -= np.outer(turns, box[k])
    return x


def weighted_sum(weights: np.ndarray, rows: np.ndarray) -> np.ndarray:
    """Weighted sum over rows, one after the other, so that all machines have the same bits (unlike with a matrix product)."""
    return np.sum(weights[:, None] * rows, axis=0)


def symmetric_products(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """(6,) sums over rows of the symmetrised products of two (N, 3) arrays: xx, yy, zz, xy, xz, yz."""
    return 0.5 * (np.sum(a[:, _FIRST] * b[:, _SECOND], axis=0) + np.sum(a[:, _SECOND] * b[:, _FIRST], axis=0))


def pairs_within(
    x: np.ndarray, other: np.ndarray | None, box: np.ndarray | None, distance: float
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Pairs of beads within a distance, by minimum image: indices i and j, and distances, (P,) each.

    i are indices of x (N, 3); j are indices of ``other`` (M, 3), or of x, with i < j and each pair once.  ParameterError if the distance is
    more than half the smallest width of the box.

    scipy's trees are as fast as ``freud``'s here (24,000 beads with 42 neighbours each: 0.2 s on one core for both), in double precision
    and without a further dependency.
    """
    if box is not None and distance > 0.5 * widths(box).min() * (1 + 1e-6):
        raise ParameterError(
            f"a distance of {distance:g} is more than half the smallest width of the box, {widths(box).min():.5g}; take at most half of it"
        )
    i, j, r = _among(x if other is None else np.concatenate([x, other]), box, distance)
    if other is None:
        return i, j, r
    # two trees are an order of magnitude slower than one tree of both sets
    mixed = (i < len(x)) & (j >= len(x))
    return i[mixed], j[mixed] - len(x), r[mixed]


def graph(bonds: np.ndarray, count: int) -> "scipy.sparse.coo_array":
    """Bonds (B, 2) between ``count`` beads as a sparse matrix of scipy."""
    return scipy.sparse.coo_array((np.ones(len(bonds), dtype=np.int8), (bonds[:, 0], bonds[:, 1])), shape=(count, count))


def connected(bonds: np.ndarray, count: int) -> np.ndarray:
    """Number of the connected component that each bead is in, (count,), from 0."""
    return scipy.sparse.csgraph.connected_components(graph(bonds, count), directed=False)[1]


def coincident_pairs(x: np.ndarray, box: np.ndarray | None, distance: float) -> list[tuple[int, int]]:
    """Pairs (i < j) of beads closer than a very short distance, by minimum image."""
    i, j, _ = pairs_within(x, None, box, distance)
    return sorted(zip(i.tolist(), j.tolist(), strict=True))


def _among(x: np.ndarray, box: np.ndarray | None, distance: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Pairs (i < j) of beads of x within a distance, by minimum image: i, j and distances, (P,) each."""
    if box is None:
        return _listed(x, None, distance)
    s = (x @ np.linalg.inv(box)) % 1.0 % 1.0
    if np.count_nonzero(box - np.diag(np.diagonal(box))) == 0:
        edges = np.diagonal(box)
        # a rounding error may move a coordinate to the upper face
        return _listed(np.minimum(s * edges, np.nextafter(edges, 0)), edges, distance)
    # scipy has no tilted boxes, so images near the faces are added to the beads
    images, owner = _images(s, distance / widths(box))
    i, k, r = _listed(images @ box, None, distance)
    j = owner[k]
    # in a pair across a face, each bead finds the image of the other
    kept = (i < len(x)) & ((k < len(x)) | (i < j))
    return i[kept], j[kept], r[kept]


def _listed(x: np.ndarray, edges: np.ndarray | None, distance: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    pairs = scipy.spatial.cKDTree(x, boxsize=edges).query_pairs(distance, output_type="ndarray")
    i, j = pairs[:, 0], pairs[:, 1]
    d = x[i] - x[j]
    if edges is not None:
        d -= edges * np.round(d / edges)
    return i, j, np.sqrt(np.einsum("pk,pk->p", d, d))


def _images(s: np.ndarray, reach: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Fractional positions of beads and of their images within ``reach`` of the box, and the index of the bead of each."""
    points, owner = s, np.arange(len(s))
    for axis in range(3):
        low, high = points[:, axis] < reach[axis], points[:, axis] > 1 - reach[axis]
        step = np.zeros(3)
        step[axis] = 1.0
        points = np.concatenate([points, points[low] + step, points[high] - step])
        owner = np.concatenate([owner, owner[low], owner[high]])
    return points, owner


def sums_in_slices(number: np.ndarray, weights: np.ndarray | None, count: int) -> np.ndarray:
    """Sums over the beads in each of ``count`` slices, (count,), of their weights (None: 1), given the slice ``number`` of each bead."""
    return np.bincount(number, weights, count).astype(np.float64)
