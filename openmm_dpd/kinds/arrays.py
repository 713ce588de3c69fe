"""Coefficients of type pairs as symmetric arrays."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np

from ..model.pairs import NONE
from .record import Resolved


def symmetric_arrays(table: Resolved, names: list[str], values: Callable[[Any], dict]) -> dict[str, Any]:
    """(T, T, ...) symmetric arrays by name; zeros for pairs without a coefficient."""
    place = {name: k for k, name in enumerate(names)}
    found = [(place[a], place[b], values(c)) for (a, b), c in table.items() if c is not NONE]
    arrays: dict[str, np.ndarray] = {}
    if found:
        first, second, rows = zip(*found, strict=True)
        for key in rows[0]:
            given = np.array([row[key] for row in rows], dtype=float)
            array = np.zeros((len(names), len(names), *given.shape[1:]))
            array[first, second] = array[second, first] = given
            arrays[key] = array
    return arrays
