"""Files of words and numbers: lines without comments, and errors that name file and line."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

from ...base.errors import DeckError
from ..language import arguments as read
from ..language.lexer import read_text

#: Number of a line, counted from 1, and its words.
Row = tuple[int, list[str]]


@dataclass(frozen=True)
class TextFile:
    """The lines of a file."""

    path: Path
    lines: list[str]

    @classmethod
    def read(cls, path: Path, *, title: bool = False) -> TextFile:
        """The file at ``path``; see :func:`~openmm_dpd.lammps.language.lexer.read_text`."""
        return cls(path, read_text(path, title=title).splitlines())

    def error(self, message: str, line: int | None = None) -> DeckError:
        """An error about this file, or one of its lines."""
        return DeckError(message, str(self.path), line)

    def rows(self) -> Iterator[Row]:
        """The lines that are more than a comment."""
        for number, line in enumerate(self.lines, start=1):
            words = line.partition("#")[0].split()
            if words:
                yield number, words

    def numbers(self, row: Row, words: Sequence[str], count: int, usage: str, what: str) -> list[float]:
        """Finite numbers from some words of a row; DeckError unless there are ``count`` of them, which says what was expected."""
        number, line = row
        try:
            values = [read.as_float(word) for word in words]
            if len(values) != count:
                raise ValueError
        except ValueError:
            raise self.error(f"expected {usage}, not '{' '.join(line)}'", number) from None
        if not all(map(math.isfinite, values)):
            raise self.error(f"{what} is not finite: '{' '.join(line)}'", number)
        return values

    def integers(self, row: Row, words: Sequence[str], usage: str) -> list[int]:
        """Whole numbers from some words of a row."""
        try:
            return [read.as_integer(word) for word in words]
        except ValueError:
            raise self.error(f"expected {usage}, not '{' '.join(words)}'", row[0]) from None
