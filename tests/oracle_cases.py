"""Small scenes shared by the tests that use the oracle."""

from __future__ import annotations

import numpy as np
import oracle

TILTED = np.array([[3.2, 0.0, 0.0], [1.5, 3.1, 0.0], [-1.4, 1.3, 3.4]])
BOXES = {"none": None, "orthorhombic": np.array([2.6, 3.0, 2.9]), "triclinic": TILTED}


def two_types() -> oracle.PairParams:
    """Two types that differ in everything, transverse friction included."""
    return oracle.PairParams(
        A=np.array([[25.0, 31.0], [31.0, 18.0]]),
        gamma=np.array([[4.5, 2.0], [2.0, 9.0]]),
        gamma_perp=np.array([[1.5, 3.0], [3.0, 0.7]]),
        s=np.array([[1.0, 0.5], [0.5, 0.8]]),
        s_perp=np.array([[0.6, 1.0], [1.0, 1.3]]),
        cutoff=np.array([[1.0, 1.2], [1.2, 0.9]]),
    )


def fluid(n=12, seed=1, extent=2.0):
    """Random positions, velocities, types and inverse masses; in BOXES some pairs meet across faces."""
    rng = np.random.default_rng(seed)
    x = rng.uniform(0.0, extent, (n, 3))
    types = np.arange(n) % 2
    return x, rng.normal(size=(n, 3)), types, np.where(types == 0, 1.0, 1 / 2.7)


def table_noise(n, seed=7):
    """A noise callable backed by a table, so that asking twice gives the same number."""
    table = np.random.default_rng(seed).normal(size=(n, n, 4))
    return lambda i, j, k: table[i, j, k]


def bonded(i, j):
    """Special factors: some pairs absent, some at half strength."""
    return {0: 0.0, 1: 0.5}.get((i + 2 * j) % 5, 1.0)


def two_beads():
    """r = 0.5 along x across a periodic face, i to the right of j; w = 1/2, v_ij = (2, 1, -3)."""
    x = np.array([[0.25, 1.0, 1.0], [2.75, 1.0, 1.0]])
    v = np.array([[1.5, 1.0, -1.0], [-0.5, 0.0, 2.0]])
    params = oracle.PairParams.build(A=25.0, gamma=4.5, gamma_perp=3.0, s=1.0, s_perp=0.5, cutoff=1.0)
    return x, v, np.zeros(2, int), params, np.array([3.0, 3.0, 3.0])
