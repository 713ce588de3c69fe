"""Coefficients of type pairs as symmetric arrays."""

from collections.abc import Callable
from operator import attrgetter
from typing import Any

import numpy as np

from ..model.pairs import NONE
from .record import Resolved


def symmetric_arrays(table: Resolved, names: list[str], fields: str, **others: Callable[[Any], Any]) -> dict[str, Any]:
    """(T, T, ...) symmetric arrays of these fields of the coefficients, and of what others are; zeros for pairs without a coefficient."""
    place = {name: k for k, name in enumerate(names)}
    found = [(place[a], place[b], c) for (a, b), c in table.items() if c is not NONE]
    arrays: dict[str, np.ndarray] = {}
    if found:
        first, second, coefficients = zip(*found, strict=True)
        for key, value in ({name: attrgetter(name) for name in fields.split()} | others).items():
            given = np.array([value(c) for c in coefficients], dtype=float)
            array = np.zeros((len(names), len(names), *given.shape[1:]))
            array[first, second] = array[second, first] = given
            arrays[key] = array
    return arrays
