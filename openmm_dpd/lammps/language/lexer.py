"""Input scripts as lines and words: continuation lines, comments, quotes and ``$`` substitution.

As in LAMMPS, physical lines are joined first (``&`` at the end, or an open triple quote), then the comment is removed, then ``$`` is
substituted outside quotes, and the result is split into words.  Other text files are read as plain lines of words and numbers.
"""

from __future__ import annotations

import gzip
import importlib
import lzma
import math
import re
import zlib
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path

from ...base.errors import DeckError, DPDError, ParameterError
from . import arguments as read

TRIPLE = '"""'
#: Replaces characters of other encodings; it occurs in no text.
UNKNOWN = "\uffff"


@dataclass(frozen=True)
class Line:
    """One logical line of a script."""

    text: str  #: Text without comment and continuation marks
    file: str  #: File that contains it
    number: int  #: Number of its first physical line, counted from 1


def located(where: Line | None, message: str) -> DeckError:
    """A DeckError with the file and number of a line, if the line is known."""
    return DeckError(message) if where is None else DeckError(message, where.file, where.number)


@contextmanager
def errors_at(where: Line | None, prefix: str = "") -> Iterator[None]:
    """Add the file and number of a line, and a prefix, to errors raised in this block, unless they already have a line."""
    try:
        yield
    except DPDError as error:
        if where is None or isinstance(error, DeckError):
            raise
        raise located(where, f"{prefix}{error}") from None


#: Modules that unpack files, by the ending of their names; any of them will do.
UNPACKERS = {
    **{".bz2": ("bz2",), ".xz": ("lzma",), ".lzma": ("lzma",)},
    **{".zst": ("compression.zstd", "zstandard"), ".lz4": ("lz4.frame",)},
}


def _unpacker(path: Path) -> Callable[[bytes], bytes]:
    names = UNPACKERS[path.suffix]
    for name in names:
        try:
            return importlib.import_module(name).decompress
        except ImportError:
            continue
    raise DeckError(f"files {path.suffix} need the Python package {names[-1].partition('.')[0]}; install it, or unpack the file", str(path))


def file_content(path: Path) -> bytes:
    """Content of a file, decompressed if it is gzipped or its name ends as in :data:`UNPACKERS`.  DeckError if it cannot be read, or
    nothing can unpack it."""
    try:
        content = path.read_bytes()
        if path.suffix in UNPACKERS:
            return _unpacker(path)(content)
        return gzip.decompress(content) if content.startswith(b"\x1f\x8b") else content
    except (OSError, EOFError, ValueError, RuntimeError, zlib.error, lzma.LZMAError) as error:
        raise DeckError(f"cannot read the file: {getattr(error, 'strerror', None) or error}", str(path)) from None


def read_text(path: Path, *, title: bool = False) -> str:
    """Text of a deck or data file, with or without a byte-order mark; with ``title`` the first line is a comment.  Characters that are not
    UTF-8 are accepted in comments only, as :data:`UNKNOWN`.  DeckError if the file cannot be read or is not text."""
    content = file_content(path)
    try:
        return _newlines(content.decode("utf-8-sig"))
    except UnicodeDecodeError:
        text = _newlines(content.decode("utf-8-sig", "surrogateescape"))
    for number, line in enumerate(text.split("\n"), start=1):
        if title and number == 1:
            continue
        try:
            meant = strip_comment(line)
        except ParameterError:
            meant = line  # part of a quote that spans several lines
        odd = next((character for character in meant if "\udc80" <= character <= "\udcff"), None)
        if odd is not None:
            message = f"the file is not UTF-8 text (byte 0x{ord(odd) - 0xDC00:02x}); convert it, or remove the character"
            raise DeckError(message, str(path), number)
    return re.sub("[\udc80-\udcff]", UNKNOWN, text)


def _newlines(text: str) -> str:
    return text.replace("\r\n", "\n").replace("\r", "\n")


def logical_lines(text: str, file: str) -> Iterator[Line]:
    """Non-empty logical lines of a script.  DeckError if a quote is not closed, or text outside comments is not UTF-8."""
    # splitlines would also split at form feeds and other separators, which LAMMPS treats as blanks
    physical = _newlines(text).split("\n")
    index = 0
    while index < len(physical):
        number = index + 1
        joined = physical[index]
        index += 1
        while index < len(physical):
            stripped = joined.rstrip()
            if stripped.endswith("&"):
                joined = stripped[:-1] + physical[index]
            elif joined.count(TRIPLE) % 2 == 1:
                joined += "\n" + physical[index]
            else:
                break
            index += 1
        if joined.rstrip().endswith("&"):
            joined = joined.rstrip()[:-1]
        try:
            content = strip_comment(joined).strip()
        except ParameterError as error:
            raise DeckError(str(error), file, number) from None
        if UNKNOWN in content:
            raise DeckError("the multi-line text that begins here is not UTF-8; convert it", file, number)
        if content:
            yield Line(content, file, number)


def _quote_end(text: str, start: int) -> int:
    """Index just after the quoted string that starts at ``start``."""
    mark = TRIPLE if text.startswith(TRIPLE, start) else text[start]
    end = text.find(mark, start + len(mark))
    if end < 0:
        raise ParameterError(f"unbalanced quotes: {mark} is never closed")
    return end + len(mark)


def strip_comment(text: str) -> str:
    """Text up to the first ``#`` outside quotes; ParameterError if a quote before it is not closed."""
    index = 0
    while index < len(text):
        if text[index] == "#":
            return text[:index]
        index = _quote_end(text, index) if text[index] in "\"'" else index + 1
    return text


def split_words(text: str) -> list[str]:
    """Words of a line, separated by blanks or quoted (the outermost quotes are removed).  ParameterError if a quote is not closed."""
    words: list[str] = []
    index = 0
    while index < len(text):
        if text[index].isspace():
            index += 1
        elif text[index] in "\"'":
            end = _quote_end(text, index)
            width = 3 if text.startswith(TRIPLE, index) else 1
            words.append(text[index + width : end - width])
            index = end
        else:
            words.append(text[index:].split(None, 1)[0])
            index += len(words[-1])
    return words


def substitute(text: str, variable: Callable[[str], str], formula: Callable[[str], float]) -> str:
    """Text with every ``${name}``, ``$x`` and ``$(formula)`` outside quotes replaced by what ``variable`` and ``formula`` return.
    ParameterError if a brace or parenthesis is not closed."""
    out: list[str] = []
    index = 0
    while index < len(text):
        char = text[index]
        if char in "\"'":
            end = _quote_end(text, index)
            out.append(text[index:end])
        elif char == "$":
            value, end = _substitution(text, index, variable, formula)
            out.append(value)
        else:
            end = index + 1
            out.append(char)
        index = end
    return "".join(out)


def _substitution(text: str, start: int, variable: Callable[[str], str], formula: Callable[[str], float]) -> tuple[str, int]:
    """Value of the substitution whose ``$`` is at ``start``, and the index just after it."""
    following = text[start + 1 : start + 2]
    if following == "{":
        end = text.find("}", start)
        if end < 0:
            raise ParameterError("'${' is never closed")
        return variable(text[start + 2 : end]), end + 1
    if following == "(":
        end = closing_parenthesis(text, start + 1)
        content = text[start + 2 : end - 1]
        body, colon, form = content.rpartition(":%")
        if not colon:
            return f"{formula(content):.20g}", end
        value = formula(body)
        try:
            return ("%" + form) % value, end
        except (TypeError, KeyError, ValueError) as error:
            raise ParameterError(f"bad format '%{form}' in '$({content})': {error}") from None
    if not following or not (following.isascii() and (following.isalnum() or following == "_")):
        raise ParameterError("'$' must be followed by the name of a variable, '{name}' or '(formula)'")
    return variable(following), start + 2


def closing_parenthesis(text: str, start: int) -> int:
    """Index just after the parenthesis that closes the one at ``start``.  ParameterError if it is never closed."""
    depth = 0
    for index in range(start, len(text)):
        depth += {"(": 1, ")": -1}.get(text[index], 0)
        if depth == 0:
            return index + 1
    raise ParameterError("'$(' is never closed")


@dataclass
class Script:
    """The logical lines of a file and the position in it.  Lines are parsed only when they are reached, so that an error in a line is
    reported after the lines before it have been carried out."""

    path: Path
    at: int = 0  #: Index of the next line
    _lines: list[Line] = field(default_factory=list, repr=False)
    _rest: Iterator[Line] | None = field(default=None, repr=False)

    def _line(self, number: int) -> Line | None:
        """The line with this index; None after the last."""
        if self._rest is None:
            self._rest = logical_lines(read_text(self.path), str(self.path))
        while len(self._lines) <= number:
            line = next(self._rest, None)
            if line is None:
                return None
            self._lines.append(line)
        return self._lines[number]

    def take(self) -> Line | None:
        """Return the next line and move past it; None at the end."""
        line = self._line(self.at)
        self.at += line is not None
        return line

    def seek(self, label: str | None) -> None:
        """Continue at the first ``label`` command with this name, or at the beginning of the file.  ParameterError if there is no such
        label."""
        self.at = 0
        while label is not None:
            line = self._line(self.at)
            if line is None:
                raise ParameterError(f"there is no 'label {label}' in {self.path.name}")
            if line.text.split()[:1] == ["label"] and split_words(line.text)[1:] == [label]:
                return
            self.at += 1


#: Number of a line (from 1) and its words.
Row = tuple[int, list[str]]


@dataclass(frozen=True)
class TextFile:
    """The lines of a text file."""

    path: Path
    lines: list[str]

    @classmethod
    def read(cls, path: Path, *, title: bool = False) -> TextFile:
        """Read the file at ``path`` with :func:`~openmm_dpd.lammps.language.lexer.read_text`."""
        return cls(path, read_text(path, title=title).splitlines())

    def error(self, message: str, line: int | None = None) -> DeckError:
        """A DeckError about this file, or about one of its lines."""
        return DeckError(message, str(self.path), line)

    def rows(self) -> Iterator[Row]:
        """The lines that contain more than a comment."""
        for number, line in enumerate(self.lines, start=1):
            words = line.partition("#")[0].split()
            if words:
                yield number, words

    def numbers(self, row: Row, words: Sequence[str], count: int, usage: str, what: str) -> list[float]:
        """Convert words of a row to finite numbers.  DeckError, with the expected ``usage``, unless there are ``count`` of them."""
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
        """Convert words of a row to whole numbers.  DeckError, with the expected ``usage``, if a word is not one."""
        try:
            return [read.as_integer(word) for word in words]
        except ValueError:
            raise self.error(f"expected {usage}, not '{' '.join(words)}'", row[0]) from None
