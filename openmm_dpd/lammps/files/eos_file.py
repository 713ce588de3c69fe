"""Files of equations of state: a keyword, a line ``N n``, and n rows ``index T U`` (LAMMPS: fix eos/table)."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from ...errors import DeckError
from ..language import arguments as read
from ..language.lexer import read_text

Row = tuple[int, list[str]]


def read_eos(path: Path, keyword: str) -> tuple[np.ndarray, np.ndarray]:
    """Temperatures and internal energies of the section ``keyword``, in the file's units.

    Raises
    ------
    DeckError
        With file and line: if the section is missing, incomplete or not numeric, or a column does not increase.
    """
    text = read_text(path).splitlines()
    lines: list[Row] = [(number, line.partition("#")[0].split()) for number, line in enumerate(text, start=1)]
    lines = [(number, words) for number, words in lines if words]
    found, index = list[str](), 0
    while index < len(lines):
        name, n = lines[index][1][0], _size(lines, index, path)
        rows = lines[index + 2 : index + 2 + n]
        if len(rows) < n:
            raise DeckError(f"equation of state {name} announces {n} rows, but has {len(rows)}", str(path), lines[index + 1][0])
        if name == keyword:
            return _columns(rows, path, keyword)
        found.append(name)
        index += 2 + n
    raise DeckError(f"there is no equation of state {keyword} in it; found {', '.join(found) or 'nothing'}", str(path))


def _size(lines: list[Row], index: int, path: Path) -> int:
    """The number of rows, from the line after the keyword."""
    number, words = lines[index + 1] if index + 1 < len(lines) else (lines[index][0], [])
    try:
        if len(words) != 2 or words[0] != "N" or read.as_integer(words[1]) < 2:
            raise ValueError
    except ValueError:
        keyword = lines[index][1][0]
        raise DeckError(f"expected 'N rows' with at least 2 rows after '{keyword}', not '{' '.join(words)}'", str(path), number) from None
    return int(words[1])


def _columns(rows: list[Row], path: Path, keyword: str) -> tuple[np.ndarray, np.ndarray]:
    values = np.empty((len(rows), 2))
    for k, (number, words) in enumerate(rows):
        try:
            if len(words) != 3:
                raise ValueError
            values[k] = [read.as_float(word) for word in words[1:]]
        except ValueError:
            raise DeckError(f"expected 'index T U', not '{' '.join(words)}'", str(path), number) from None
        if not np.all(np.isfinite(values[k])):
            raise DeckError(f"a value of equation of state {keyword} is not finite: '{' '.join(words)}'", str(path), number)
        if values[k, 0] <= 0:
            raise DeckError(f"the temperatures of equation of state {keyword} must be > 0, but one is {words[1]}", str(path), number)
        for column, name in enumerate(("temperatures", "energies")):
            if k and values[k, column] <= values[k - 1, column]:
                before = rows[k - 1][1][column + 1]
                message = f"the {name} of equation of state {keyword} must increase, but {words[column + 1]} follows {before}"
                raise DeckError(message, str(path), number)
    return values[:, 0], values[:, 1]
