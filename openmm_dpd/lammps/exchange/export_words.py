"""Seeds and groups as an exported deck writes them."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

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


def in_lines(words: Sequence[str]) -> str:
    """Words of one command, on several lines if there are many."""
    lines = [" ".join(words[k : k + _LINE]) for k in range(0, len(words), _LINE)]
    return " &\n  ".join(lines)


def group_lines(name: str, mask: np.ndarray) -> Iterator[str]:
    """Commands that put beads into a group."""
    words = id_words(mask)
    for k in range(0, len(words), _GROUP):
        yield in_lines(["group", name, "id", *words[k : k + _GROUP]])
