"""Seeds and groups as an exported deck writes them."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

#: Words on one physical line of a deck.
_LINE = 16

#: Words in one group command.
_GROUP = 400


def lammps_seed(seed: int, offset: int = 0) -> int:
    """A seed that LAMMPS takes, 1 to 900000000."""
    return (int(seed) + offset - 1) % 900_000_000 + 1


def id_words(mask: np.ndarray) -> list[str]:
    """Ids (counted from 1) of the True entries as words ``n`` and ``n:m``."""
    padded = np.concatenate([[False], np.asarray(mask, bool), [False]]).astype(np.int8)
    starts, ends = np.flatnonzero(np.diff(padded) == 1) + 1, np.flatnonzero(np.diff(padded) == -1)
    return [f"{first}" if first == last else f"{first}:{last}" for first, last in zip(starts.tolist(), ends.tolist(), strict=True)]


def group_lines(name: str, mask: np.ndarray) -> Iterator[str]:
    """Commands that put beads into a group, each on several lines if it is long."""
    ids = id_words(mask)
    for k in range(0, len(ids), _GROUP):
        words = ["group", name, "id", *ids[k : k + _GROUP]]
        yield " &\n  ".join(" ".join(words[n : n + _LINE]) for n in range(0, len(words), _LINE))
