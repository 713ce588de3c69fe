"""Symmetric tensors as six numbers: xx, yy, zz, xy, xz, yz."""

from __future__ import annotations

import numpy as np

#: The two axes of each number.
AXES_OF_TENSOR = ((0, 0), (1, 1), (2, 2), (0, 1), (0, 2), (1, 2))

_FIRST, _SECOND = map(list, zip(*AXES_OF_TENSOR, strict=True))


def symmetric_products(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """(6,) sums over rows of the symmetrized products of two (N, 3) arrays: xx, yy, zz, xy, xz, yz."""
    return 0.5 * (np.sum(a[:, _FIRST] * b[:, _SECOND], axis=0) + np.sum(a[:, _SECOND] * b[:, _FIRST], axis=0))
