"""Files of equations of state: a keyword, a line ``N n``, and n rows ``index T U`` (LAMMPS: fix eos/table)."""

from pathlib import Path

import numpy as np

from ..language import arguments as read
from .text_file import Row, TextFile


def read_eos(path: Path, keyword: str) -> tuple[np.ndarray, np.ndarray]:
    """Temperatures and internal energies of the section ``keyword``, in the file's units.

    Raises
    ------
    DeckError
        With file and line: if the section is missing, incomplete or not numeric, or a column does not increase.
    """
    file = TextFile.read(path)
    lines, found, index = list(file.rows()), list[str](), 0
    while index < len(lines):
        name, n = lines[index][1][0], _size(file, lines, index)
        rows = lines[index + 2 : index + 2 + n]
        if len(rows) < n:
            raise file.error(f"equation of state {name} announces {n} rows, but has {len(rows)}", lines[index + 1][0])
        if name == keyword:
            return _columns(file, rows, keyword)
        found.append(name)
        index += 2 + n
    raise file.error(f"there is no equation of state {keyword} in it; found {', '.join(found) or 'nothing'}")


def _size(file: TextFile, lines: list[Row], index: int) -> int:
    """The number of rows, from the line after the keyword."""
    number, words = lines[index + 1] if index + 1 < len(lines) else (lines[index][0], [])
    try:
        if len(words) != 2 or words[0] != "N" or read.as_integer(words[1]) < 2:
            raise ValueError
    except ValueError:
        keyword = lines[index][1][0]
        raise file.error(f"expected 'N rows' with at least 2 rows after '{keyword}', not '{' '.join(words)}'", number) from None
    return int(words[1])


def _columns(file: TextFile, rows: list[Row], keyword: str) -> tuple[np.ndarray, np.ndarray]:
    what = f"equation of state {keyword}"
    values = np.array([file.numbers(row, row[1][1:], 2, "'index T U'", f"a value of {what}") for row in rows])
    for k, (number, words) in enumerate(rows):
        if values[k, 0] <= 0:
            raise file.error(f"the temperatures of {what} must be > 0, but one is {words[1]}", number)
        for column, name in enumerate(("temperatures", "energies")):
            if k and values[k, column] <= values[k - 1, column]:
                before = rows[k - 1][1][column + 1]
                raise file.error(f"the {name} of {what} must increase, but {words[column + 1]} follows {before}", number)
    return values[:, 0], values[:, 1]
