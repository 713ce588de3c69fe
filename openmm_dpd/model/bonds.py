"""Bonds between beads."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..errors import ParameterError
from ..units import to_md


@dataclass(frozen=True, eq=False)
class HarmonicBonds:
    """Harmonic bonds, U = k (r - r0)^2 (LAMMPS's convention: no factor 1/2).

    Parameters
    ----------
    pairs : (B, 2) array of int
        Bead indices, counted from 0.
    k : energy/length^2, or (B,) array
        kJ/mol/nm^2, >= 0.
    r0 : length, or (B,) array
        Rest length in nm, >= 0.

    Raises
    ------
    ParameterError
        If shapes differ, a value is out of bounds or a bead is bonded to itself.
    """

    pairs: np.ndarray
    k: np.ndarray
    r0: np.ndarray

    def __post_init__(self):
        try:
            pairs = np.asarray(self.pairs)
        except ValueError:
            raise ParameterError("bond pairs must be an integer array of shape (bonds, 2); their entries differ in length") from None
        if pairs.size == 0:
            pairs = np.zeros((0, 2), dtype=np.int64)
        if pairs.ndim != 2 or pairs.shape[1] != 2 or not np.issubdtype(pairs.dtype, np.integer):
            raise ParameterError(f"bond pairs must be an integer array of shape (bonds, 2), not {pairs.dtype} {pairs.shape}")
        if pairs.size and pairs.min() < 0:
            raise ParameterError("bead indices of bonds are counted from 0; one is negative")
        own = np.flatnonzero(pairs[:, 0] == pairs[:, 1])
        if len(own):
            raise ParameterError(f"bond {own[0]} joins bead {pairs[own[0], 0]} to itself")
        values = {"pairs": pairs.astype(np.int64)}
        for name, dimension in (("k", "force_constant"), ("r0", "length")):
            array = np.asarray(to_md(getattr(self, name), dimension, f"bond {name}"))
            if array.shape not in ((), (len(pairs),)):
                raise ParameterError(f"bond {name} must be one number, or one for each of the {len(pairs)} bonds, not shape {array.shape}")
            array = np.broadcast_to(array, (len(pairs),)).copy()
            if np.any(array < 0):
                raise ParameterError(f"bond {name} must be >= 0; bond {int(np.argmin(array))} has {array.min():g}")
            values[name] = array
        for key, value in values.items():
            object.__setattr__(self, key, value)


def bonded_neighbours(pairs: np.ndarray, n_beads: int) -> dict[int, set[tuple[int, int]]]:
    """Pairs (i < j) that are one, two or three bonds apart: {1: 1-2 pairs, 2: 1-3 pairs, 3: 1-4 pairs}.

    A pair counts for the shortest path between its beads, so that rings come out right.
    """
    neighbours: list[set[int]] = [set() for _ in range(n_beads)]
    for i, j in np.asarray(pairs).tolist():
        neighbours[i].add(j)
        neighbours[j].add(i)
    found: dict[int, set[tuple[int, int]]] = {1: set(), 2: set(), 3: set()}
    for i in range(n_beads):
        if not neighbours[i]:
            continue
        seen, shell = {i}, {i}
        for distance in (1, 2, 3):
            shell = {k for j in shell for k in neighbours[j]} - seen
            seen |= shell
            found[distance].update((i, j) for j in shell if j > i)
    return found
