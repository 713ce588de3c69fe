"""Numbers, seeds, groups and differences as an exported deck writes them."""

from __future__ import annotations

import warnings
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field

import numpy as np

#: Words on one physical line of a deck.
_LINE = 16

#: Words in one group command.
_GROUP = 400


class ExportWarning(UserWarning):
    """LAMMPS will do something else than the scene says; the message names the difference."""


@dataclass
class Differences:
    """What an exported deck does differently, in the order it came up; each becomes a warning and a comment of the deck."""

    found: list[str] = field(default_factory=list)
    remarks: list[str] = field(default_factory=list)

    def add(self, text: str) -> None:
        """Note that LAMMPS's averages may differ from the scene's."""
        if text not in self.found:
            self.found.append(text)

    def remark(self, text: str) -> None:
        """Note something the reader of the deck should know; no warning."""
        if text not in self.remarks:
            self.remarks.append(text)

    def warn(self, stacklevel: int) -> None:
        """Issue the warnings."""
        for text in self.found:
            warnings.warn(text, ExportWarning, stacklevel=stacklevel + 1)


def number(value: float) -> str:
    """The shortest text that reads back as the same double."""
    return repr(float(value))


def numbers(values) -> str:
    """Several numbers with spaces between them."""
    return " ".join(number(value) for value in np.ravel(values))


def lammps_seed(seed: int, offset: int = 0) -> int:
    """A seed that LAMMPS takes, 1 to 900000000."""
    return (int(seed) + offset - 1) % 900_000_000 + 1


def id_ranges(mask: np.ndarray) -> list[str]:
    """Ids (counted from 1) of the True entries as words ``n`` and ``n:m``."""
    padded = np.concatenate([[False], np.asarray(mask, bool), [False]]).astype(np.int8)
    starts, ends = np.flatnonzero(np.diff(padded) == 1) + 1, np.flatnonzero(np.diff(padded) == -1)
    return [f"{first}" if first == last else f"{first}:{last}" for first, last in zip(starts.tolist(), ends.tolist(), strict=True)]


def folded(words: Sequence[str]) -> str:
    """Words of one command, on several lines if there are many."""
    lines = [" ".join(words[k : k + _LINE]) for k in range(0, len(words), _LINE)]
    return " &\n  ".join(lines)


def group_lines(name: str, mask: np.ndarray) -> Iterator[str]:
    """Commands that put beads into a group."""
    words = id_ranges(mask)
    for k in range(0, len(words), _GROUP):
        yield folded(["group", name, "id", *words[k : k + _GROUP]])
