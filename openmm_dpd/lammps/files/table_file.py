"""Table files: pair tables (keyword, a line with ``N``, rows ``index r energy force``) and equations of state (rows ``index T U``).

A pair table becomes a cubic spline through energies and forces at the file's own distances.  The number of points after ``pair_style table
linear|spline|lookup|bitmap``, the resolution of LAMMPS's internal table in r^2, is not used.
"""

from dataclasses import dataclass
from pathlib import Path

import numpy as np
import scipy

from ...base.errors import ParameterError
from ...base.units import UnitSystem
from ...model.pairs import TabulatedPair
from ..language import arguments as read
from ..language.lexer import Row, TextFile

MODES = ("lookup", "linear", "spline", "bitmap")


@dataclass(frozen=True, eq=False)
class TableData:
    """One section of a table file, in the file's units: distances, energies, forces."""

    distances: np.ndarray
    energies: np.ndarray
    forces: np.ndarray
    end_slopes: tuple[float, ...] = ()  #: Slopes of the forces at both ends, if given


def read_table(path: Path, keyword: str) -> TableData:
    """Section ``keyword`` of a pair table file.  DeckError if the section is missing, incomplete or not numeric."""
    file = TextFile.read(path)
    lines, found, index = list(file.rows()), list[str](), 0
    while index < len(lines):
        number, (name, *_) = lines[index]
        parameters = _parameters(file, lines[index + 1] if index + 1 < len(lines) else (len(file.lines) + 1, []), name)
        rows = lines[index + 2 : index + 2 + parameters["N"]]
        if name == keyword:
            return _assemble(file, rows, parameters, number, keyword)
        found.append(name)
        index += 2 + len(rows)
    raise file.error(f"there is no table {keyword} in it; found {', '.join(found) or 'nothing'}")


def _parameters(file: TextFile, row: Row, keyword: str) -> dict:
    line, words = row
    found: dict = {}
    sizes = {"N": 1, "R": 2, "RSQ": 2, "FPRIME": 2, "BITMAP": 2}
    index = 0
    try:
        while index < len(words):
            name = words[index]
            values: list[float] = []
            while len(values) < sizes[name] and index + 1 < len(words) and words[index + 1] not in sizes:
                index += 1
                values.append(read.as_float(words[index]))
            found[name] = values
            index += 1
        found["N"] = int(found["N"][0])
        if found["N"] < 1:
            raise ValueError
    except (KeyError, ValueError, IndexError):
        usage = f"the parameters 'N points [R|RSQ low high] [FPRIME low high]' of table {keyword}"
        raise file.error(f"expected {usage}, not '{' '.join(words)}'", line) from None
    return found


def _assemble(file: TextFile, rows: list[Row], parameters: dict, line: int, keyword: str) -> TableData:
    n = parameters["N"]
    if "BITMAP" in parameters:
        raise file.error(f"table {keyword} is stored as BITMAP, which is not supported; store it with R", line)
    if len(rows) < n:
        raise file.error(f"table {keyword} announces {n} rows, but has {len(rows)}", line)
    usage, what = "'index r energy force'", f"a value of table {keyword}"
    values = np.array([file.numbers(row, row[1][1:4], 3, usage, what) for row in rows])
    distances = values[:, 0]
    for name in ("R", "RSQ"):
        # if both limits are given, LAMMPS computes the distances and ignores the column
        if len(parameters.get(name, ())) == 2:
            low, high = parameters[name]
            distances = np.linspace(low, high, n) if name == "R" else np.sqrt(np.linspace(low**2, high**2, n))
    if np.any(np.diff(distances) <= 0) or distances[0] <= 0:
        worst = int(np.argmin(np.diff(distances))) if distances[0] > 0 else 0
        raise file.error(f"the distances of table {keyword} must be > 0 and increase", rows[worst][0])
    return TableData(distances, values[:, 1], values[:, 2], tuple(parameters.get("FPRIME", ())))


def tabulated_pair(data: TableData, cutoff: float | None, units: UnitSystem) -> tuple[TabulatedPair, str | None]:
    """The table as a pair term in MD units, and a remark if the energies were replaced (they do not match the forces) or the end slopes
    have no effect.  ``cutoff`` is in the deck's unit of length; None means the range of the table.  The term is evenly spaced: an uneven
    table (``RSQ``) is resampled with cubic splines through energies and forces."""
    r, energies, forces, remarks = data.distances, data.energies, data.forces, list[str]()
    steps = np.diff(r)
    if not np.allclose(steps, steps.mean(), rtol=1e-4):
        # as fine as the finest part of the file, within limits
        even = np.linspace(r[0], r[-1], int(np.clip(np.ceil((r[-1] - r[0]) / steps.min()) + 1, len(r), max(20000, len(r)))))
        ends = data.end_slopes if len(data.end_slopes) == 2 else np.diff(forces)[[0, -1]] / steps[[0, -1]]
        spline = scipy.interpolate.CubicSpline(r, energies, bc_type=((1, -forces[0]), (1, -forces[-1])))
        r, energies, forces = even, spline(even), scipy.interpolate.CubicSpline(r, forces, bc_type=((1, ends[0]), (1, ends[1])))(even)
    elif data.end_slopes:
        remarks.append("FPRIME has no effect: the slope of the energies is the force, and has no slope of its own at the ends")
    limit = None if cutoff is None else cutoff * units.length
    try:
        pair = TabulatedPair(r * units.length, energies * units.energy, forces=forces * units.force, cutoff=limit)
    except ParameterError as error:
        if "minus the slope" not in str(error):
            raise
        # in LAMMPS the forces move the beads, so they define the potential
        work = scipy.interpolate.CubicSpline(r, forces).antiderivative()
        energies = energies[-1] + work(r[-1]) - work(r)
        pair = TabulatedPair(r * units.length, energies * units.energy, forces=forces * units.force, cutoff=limit)
        remarks.append(f"its energies are replaced by the integral of its forces, which move the beads ({error})")
    return pair, "; ".join(remarks) or None


def read_eos(path: Path, keyword: str) -> tuple[np.ndarray, np.ndarray]:
    """Temperatures and internal energies of the section ``keyword``, in the file's units.  DeckError, with file and line, if the section is
    missing, incomplete or not numeric, or a column does not increase."""
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
