"""A file of commands that is being carried out, and the place in it."""

from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path

from ...errors import ParameterError
from ..language.lexer import Line, logical_lines, read_text, split_words


@dataclass
class Script:
    """The logical lines of a file, and which comes next.

    Lines are taken apart as they are reached, so that what is wrong with one comes after what the lines before it do.

    Attributes
    ----------
    path : Path
        The file.
    at : int
        Number of the next line, from 0.
    """

    path: Path
    at: int = 0
    _lines: list[Line] = field(default_factory=list, repr=False)
    _rest: Iterator[Line] | None = field(default=None, repr=False)

    def _line(self, number: int) -> Line | None:
        """A line by its number; None behind the last."""
        if self._rest is None:
            self._rest = logical_lines(read_text(self.path), str(self.path))
        while len(self._lines) <= number:
            line = next(self._rest, None)
            if line is None:
                return None
            self._lines.append(line)
        return self._lines[number]

    def take(self) -> Line | None:
        """The next line, behind which it then goes on; None at the end."""
        line = self._line(self.at)
        self.at += line is not None
        return line

    def seek(self, label: str | None) -> None:
        """Go on at the first ``label`` command of this name, or at the beginning; ParameterError if there is none."""
        self.at = 0
        while label is not None:
            line = self._line(self.at)
            if line is None:
                raise ParameterError(f"there is no 'label {label}' in {self.path.name}")
            if line.text.split()[:1] == ["label"] and split_words(line.text)[1:] == [label]:
                return
            self.at += 1
