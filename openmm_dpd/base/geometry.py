"""Vectors in a box of reduced (lower triangular) vectors, and symmetric tensors as six numbers: xx, yy, zz, xy, xz, yz."""

import numpy as np

#: The two axes of each number of a tensor.
AXES_OF_TENSOR = ((0, 0), (1, 1), (2, 2), (0, 1), (0, 2), (1, 2))
_FIRST, _SECOND = map(list, zip(*AXES_OF_TENSOR, strict=True))


def widths(box: np.ndarray) -> np.ndarray:
    """Distances between opposite faces of a box, (3,): its edges unless it is tilted."""
    return 1.0 / np.linalg.norm(np.linalg.inv(box), axis=0)


def most_tilted(box: np.ndarray) -> np.ndarray:
    """Box vectors of which the second one is tilted along x as far as any that are reduced."""
    tilted = box.copy()
    tilted[1, 0] = 0.5 * box[0, 0]
    return tilted


def reduced(vectors) -> np.ndarray:
    """Vectors of the same lattice in OpenMM's reduced form (no tilt above half an edge), from vectors with a along x and b in the xy
    plane.  A tilt a rounding error above half an edge becomes that half."""
    vectors = np.tril(np.asarray(vectors, dtype=np.float64))
    for row, column in ((2, 1), (2, 0), (1, 0)):
        half = 0.5 * vectors[column, column]
        if abs(vectors[row, column]) > half * (1 + 1e-9):
            vectors[row] -= vectors[column] * np.round(vectors[row, column] / (2 * half))
        vectors[row, column] = np.clip(vectors[row, column], -half, half)
    return vectors


def minimum_images(d: np.ndarray, box: np.ndarray | None) -> np.ndarray:
    """Distance vectors (K, 3) by minimum image; as they are without a box."""
    return _shifted(d, box, np.rint)


def folded(x: np.ndarray, box: np.ndarray | None) -> np.ndarray:
    """Positions (N, 3) folded into the box whose lower corner is the origin; as they are without a box."""
    return _shifted(x, box, np.floor)


def _shifted(d: np.ndarray, box: np.ndarray | None, turns) -> np.ndarray:
    if box is None:
        return d
    d = d.copy()
    for k in (2, 1, 0):
        d -= np.outer(turns(d[:, k] / box[k, k]), box[k])
    return d


def weighted_sum(weights: np.ndarray, rows: np.ndarray) -> np.ndarray:
    """Sum over rows, each times its weight; one after the other on every machine, which a product of matrices is not."""
    return np.sum(weights[:, None] * rows, axis=0)


def symmetric_products(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """(6,) sums over rows of the symmetrized products of two (N, 3) arrays: xx, yy, zz, xy, xz, yz."""
    return 0.5 * (np.sum(a[:, _FIRST] * b[:, _SECOND], axis=0) + np.sum(a[:, _SECOND] * b[:, _FIRST], axis=0))
