"""Reading LAMMPS data files: header, box and the sections that these scenes use."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from ...errors import DeckError, ParameterError
from ..language import arguments as read
from ..language.lexer import read_text
from ..state.box import Box

#: Columns of the Atoms section by atom style; ``tdpd`` has its concentrations after them.
ATOM_STYLES: dict[str, tuple[str, ...]] = {
    "atomic": ("id", "type", "x", "y", "z"),
    "charge": ("id", "type", "charge", "x", "y", "z"),
    "bond": ("id", "molecule", "type", "x", "y", "z"),
    "angle": ("id", "molecule", "type", "x", "y", "z"),
    "molecular": ("id", "molecule", "type", "x", "y", "z"),
    "full": ("id", "molecule", "type", "charge", "x", "y", "z"),
    "dpd": ("id", "type", "theta", "x", "y", "z"),
    "mdpd": ("id", "type", "rho", "x", "y", "z"),
    "edpd": ("id", "type", "temperature", "capacity", "x", "y", "z"),
    "tdpd": ("id", "type", "x", "y", "z"),
}


def atom_columns(style: str, n_species: int = 0) -> tuple[str, ...]:
    """Columns of the Atoms section; the concentrations of ``tdpd`` are ``c1``, ``c2``, ..."""
    return (*ATOM_STYLES[style], *(f"c{k}" for k in range(1, n_species + 1)))


#: Atom styles whose beads may be bonded.
BONDED_STYLES = ("bond", "angle", "molecular", "full")

#: Atom styles whose bonds may have angles between them.
ANGLE_STYLES = ("angle", "molecular", "full")

SECTIONS = ("Atoms", "Velocities", "Masses", "Bonds", "Angles", "Pair Coeffs", "PairIJ Coeffs", "Bond Coeffs", "Angle Coeffs")

_COUNTS = ("atoms", "bonds", "angles", "dihedrals", "impropers")
_HEADERS: dict[tuple[str, ...], int] = {
    **{(name,): 1 for name in _COUNTS},
    **{(name[:-1], "types"): 1 for name in _COUNTS},
    **{("extra", name[:-1], "per", "atom"): 1 for name in _COUNTS[1:]},
    ("extra", "special", "per", "atom"): 1,
    ("xlo", "xhi"): 2,
    ("ylo", "yhi"): 2,
    ("zlo", "zhi"): 2,
    ("xy", "xz", "yz"): 3,
}

_UNSUPPORTED = ("dihedrals", "impropers")

#: Largest id, and largest image flag.
_LARGEST = 2**31 - 1

Row = tuple[int, list[str]]


@dataclass
class DataFile:
    """Content of a data file, in the deck's units, atoms in the order of the file.

    Attributes
    ----------
    path : Path
        The file.
    n_types, n_bond_types, n_angle_types : int
        Numbers of types.
    box : Box
        The box.
    columns : dict of str to (N,) arrays
        ``id``, ``type``, and by style ``molecule``, ``charge``, ``theta``, ``rho``, ``temperature``, ``capacity``, ``c1``, ``c2``, ...
    positions : (N, 3) array
        As in the file, perhaps outside the box.
    images : (N, 3) array of int
        Image flags, 0 where the file has none.
    velocities : (N, 3) array
        In the order of the atoms; 0 where the file has none.
    masses : dict of int to float
        Masses section.
    bonds : (B, 3) array of int
        Type and two ids.
    angles : (A, 4) array of int
        Type and three ids.
    coefficients : dict of str to list of (line number, words)
        Lines of the Coeffs sections by section name.
    hints : dict of str to str
        What stands behind ``#`` on section lines.
    """

    path: Path
    n_types: int
    n_bond_types: int
    box: Box
    columns: dict[str, np.ndarray]
    positions: np.ndarray
    images: np.ndarray
    velocities: np.ndarray
    masses: dict[int, float] = field(default_factory=dict)
    bonds: np.ndarray = field(default_factory=lambda: np.zeros((0, 3), dtype=np.int64))
    coefficients: dict[str, list[Row]] = field(default_factory=dict)
    hints: dict[str, str] = field(default_factory=dict)
    n_angle_types: int = 0
    angles: np.ndarray = field(default_factory=lambda: np.zeros((0, 4), dtype=np.int64))


class _Reader:
    def __init__(self, path: Path, atom_style: str, n_species: int = 0):
        self.path, self.style = path, atom_style
        self.names = atom_columns(atom_style, n_species)
        self.header: dict[tuple[str, ...], list[float]] = {}
        self.sections: dict[str, tuple[int, list[Row]]] = {}
        self.hints: dict[str, str] = {}

    def fail(self, message: str, line: int | None = None) -> DeckError:
        return DeckError(message, str(self.path), line)

    # -- lines -----------------------------------------------------------------------------------------------------------------
    def split(self) -> None:
        """Sort the lines into header values and sections."""
        body: list[Row] | None = None
        for number, raw in enumerate(read_text(self.path, title=True).splitlines(), start=1):
            if number == 1:
                continue  # the first line is always a title
            text, _, comment = raw.partition("#")
            words = text.split()
            if not words:
                continue
            if words[0][0].isalpha():
                name = " ".join(words)
                if name not in SECTIONS:
                    raise self.fail(f"section or header line '{name}' is not supported; sections are {', '.join(SECTIONS)}", number)
                if name in self.sections:
                    raise self.fail(f"section {name} appears twice", number)
                body = []
                self.sections[name] = (number, body)
                self.hints[name] = comment.strip()
            elif body is None:
                self.header_line(words, number)
            else:
                body.append((number, words))

    def header_line(self, words: list[str], number: int) -> None:
        for size in (1, 2, 3):
            key = tuple(words[size:])
            if _HEADERS.get(key) == size:
                try:
                    self.header[key] = [read.as_float(word) for word in words[:size]]
                except ValueError:
                    raise self.fail(f"expected numbers before '{' '.join(key)}', not '{' '.join(words[:size])}'", number) from None
                if not np.all(np.isfinite(self.header[key])):
                    raise self.fail(f"the header value '{' '.join(words)}' is not finite", number)
                if size == 1 and not (self.header[key][0].is_integer() and self.header[key][0] >= 0):
                    raise self.fail(f"expected a whole number >= 0 before '{' '.join(key)}', not '{words[0]}'", number)
                if key[0] in _UNSUPPORTED and len(key) == 1 and self.header[key][0]:
                    raise self.fail(f"{key[0]} are not supported, but the header announces {words[0]}", number)
                return
        raise self.fail(f"header line '{' '.join(words)}' is not supported", number)

    def count(self, *key: str) -> int:
        return int(self.header.get(key, [0])[0])

    def rows(self, name: str, expected: int) -> list[Row]:
        if name not in self.sections:
            return []
        line, body = self.sections[name]
        if len(body) != expected:
            raise self.fail(f"section {name} has {len(body)} lines, but the header announces {expected}", line)
        return body

    def integers(self, words: list[str], number: int, what: str) -> list[int]:
        try:
            return [read.as_integer(word) for word in words]
        except ValueError:
            raise self.fail(f"expected {what}, not '{' '.join(words)}'", number) from None

    def floats(self, words: list[str], number: int, what: str) -> list[float]:
        try:
            values = [read.as_float(word) for word in words]
        except ValueError:
            raise self.fail(f"expected {what}, not '{' '.join(words)}'", number) from None
        if not all(abs(value) < np.inf for value in values):
            raise self.fail(f"{what}: a value is not finite: '{' '.join(words)}'", number)
        return values

    # -- sections --------------------------------------------------------------------------------------------------------------
    def box(self) -> Box:
        edges = []
        for axis in "xyz":
            key = (f"{axis}lo", f"{axis}hi")
            if key not in self.header:
                # LAMMPS takes -1/2 to 1/2 without a word
                raise self.fail(f"the header has no line '{key[0]} {key[1]}', so the box has no edges along {axis}")
            edges.append(self.header[key])
        tilt = self.header.get(("xy", "xz", "yz"))
        low, high = np.array(edges).T
        try:
            return Box(low, high, np.array(tilt if tilt else [0.0, 0.0, 0.0]), tilt is not None)
        except ParameterError as error:
            raise self.fail(str(error)) from None

    def atoms(self, n_types: int) -> tuple[dict[str, np.ndarray], np.ndarray, np.ndarray]:
        names, x = self.names, self.names.index("x")
        n = self.count("atoms")
        if n and "Atoms" not in self.sections:
            raise self.fail(f"the header announces {n} atoms, but there is no Atoms section")
        rows = self.rows("Atoms", n)
        size = len(names)
        usage = f"an atom of atom_style {self.style}: {' '.join(names)} [ix iy iz]"
        values = np.empty((n, size))
        images = np.zeros((n, 3), dtype=np.int64)
        for k, (number, words) in enumerate(rows):
            if len(words) not in (size, size + 3):
                raise self.fail(f"expected {usage}, not {len(words)} words: '{' '.join(words)}'", number)
            try:
                values[k] = [read.as_float(word) for word in words[:size]]
            except ValueError:
                raise self.fail(f"expected {usage}, not '{' '.join(words)}'", number) from None
            if len(words) > size:
                flags = self.integers(words[size:], number, "three image flags")
                if max(map(abs, flags)) > _LARGEST:
                    raise self.fail(f"an image flag of atom {words[0]} is beyond {_LARGEST}: '{' '.join(words[size:])}'", number)
                images[k] = flags
        self.check_finite(values, rows, x)
        columns: dict[str, np.ndarray] = {}
        for k, name in enumerate(names):
            if name in ("id", "type", "molecule"):
                columns[name] = np.clip(values[:, k], -_LARGEST, _LARGEST).astype(np.int64)
                self.check_whole(values[:, k], columns[name], rows, f"the {name} of an atom")
            elif name not in ("x", "y", "z"):
                columns[name] = values[:, k].copy()
        self.check_atoms(columns, rows, n_types)
        return columns, values[:, x : x + 3].copy(), images

    def check_finite(self, values: np.ndarray, rows: list[Row], x: int) -> None:
        for columns, what in ((slice(x, x + 3), "position"), (slice(None), "value")):
            bad = ~np.isfinite(values[:, columns]).all(axis=1)
            if bad.any():
                number, words = rows[int(np.argmax(bad))]
                raise self.fail(f"atom {words[0]} has a {what} that is not finite: '{' '.join(words)}'", number)

    def check_whole(self, values: np.ndarray, whole: np.ndarray, rows: list[Row], what: str) -> None:
        bad = np.flatnonzero(values != whole)
        if len(bad):
            limit = f" up to {_LARGEST}" if abs(values[bad[0]]) > _LARGEST else ""
            raise self.fail(f"{what} must be a whole number{limit}, not {values[bad[0]]:g}", rows[bad[0]][0])

    def check_atoms(self, columns: dict[str, np.ndarray], rows: list[Row], n_types: int) -> None:
        ids, types = columns["id"], columns["type"]
        for mask, message in (
            (ids < 1, "atom ids start at 1"),
            ((types < 1) | (types > n_types), f"the atom type is out of range; there are {n_types}"),
            (columns.get("theta", np.ones(len(ids))) <= 0, "the internal temperature (theta) must be > 0"),
            (columns.get("temperature", np.ones(len(ids))) <= 0, "the temperature of a bead must be > 0"),
            (columns.get("capacity", np.ones(len(ids))) <= 0, "the heat capacity of a bead must be > 0"),
        ):
            if mask.any():
                number, words = rows[int(np.argmax(mask))]
                raise self.fail(f"{message}: '{' '.join(words)}'", number)
        order = np.argsort(ids, kind="stable")
        twice = np.flatnonzero(np.diff(ids[order]) == 0)
        if len(twice):
            raise self.fail(f"atom id {ids[order][twice[0]]} appears twice", rows[int(order[twice[0] + 1])][0])

    def velocities(self, ids: np.ndarray) -> np.ndarray:
        found = np.zeros((len(ids), 3))
        place = {identity: k for k, identity in enumerate(ids.tolist())}
        for number, words in self.rows("Velocities", len(ids)):
            if len(words) != 4:
                raise self.fail(f"expected 'id vx vy vz', not '{' '.join(words)}'", number)
            identity = self.integers(words[:1], number, "an atom id")[0]
            if identity not in place:
                raise self.fail(f"section Velocities names atom {identity}, which does not exist", number)
            found[place[identity]] = self.floats(words[1:], number, f"the velocity of atom {identity}")
        return found

    def masses(self, n_types: int) -> dict[int, float]:
        found = {}
        for number, words in self.rows("Masses", n_types):
            if len(words) != 2:
                raise self.fail(f"expected 'type mass', not '{' '.join(words)}'", number)
            kind = self.integers(words[:1], number, "an atom type")[0]
            mass = self.floats(words[1:], number, "a mass")[0]
            if not 1 <= kind <= n_types:
                raise self.fail(f"atom type {kind} is out of range; there are {n_types}", number)
            if mass <= 0:
                raise self.fail(f"the mass of type {kind} must be > 0, but is {mass:g}", number)
            found[kind] = mass
        return found

    def joined(self, what: str, size: int, n_types: int, ids: np.ndarray, styles: tuple[str, ...]) -> np.ndarray:
        """Types and ids of the Bonds or Angles section."""
        section, announced = f"{what.capitalize()}s", self.count(f"{what}s")
        rows = self.rows(section, announced)
        if rows and self.style not in styles:
            raise self.fail(f"atom_style {self.style} has no {what}s; use {' or '.join(styles)}", self.sections[section][0])
        if announced and not rows:
            raise self.fail(f"the header announces {announced} {what}s, but there is no {section} section")
        known = set(ids.tolist())
        found = np.zeros((len(rows), 1 + size), dtype=np.int64)
        usage = "id type " + " ".join(f"atom{k}" for k in range(1, size + 1))
        for k, (number, words) in enumerate(rows):
            if len(words) != 2 + size:
                raise self.fail(f"expected '{usage}', not '{' '.join(words)}'", number)
            _, kind, *atoms = self.integers(words, number, f"whole numbers '{usage}'")
            if not 1 <= kind <= n_types:
                raise self.fail(f"{what} type {kind} is out of range; there are {n_types}", number)
            for atom in atoms:
                if atom not in known:
                    raise self.fail(f"a{'n' * (what == 'angle')} {what} names atom {atom}, which does not exist", number)
            found[k] = kind, *atoms
        return found


def read_data_file(path: Path, atom_style: str, n_species: int = 0) -> DataFile:
    """Content of a data file.

    Parameters
    ----------
    path : Path
        The file.
    atom_style : str
        A key of :data:`ATOM_STYLES`; the style hint behind ``Atoms #`` is optional and only reported.
    n_species : int
        Number of concentrations of ``atom_style tdpd``.

    Raises
    ------
    DeckError
        With file and line, for unknown sections, wrong counts, values that are not numbers or not finite, ids that appear
        twice, types out of range.
    """
    reader = _Reader(path, atom_style, n_species)
    reader.split()
    n_types, n_bond_types = reader.count("atom", "types"), reader.count("bond", "types")
    n_angle_types = reader.count("angle", "types")
    columns, positions, images = reader.atoms(n_types)
    return DataFile(
        path=path,
        n_types=n_types,
        n_bond_types=n_bond_types,
        box=reader.box(),
        columns=columns,
        positions=positions,
        images=images,
        velocities=reader.velocities(columns["id"]),
        masses=reader.masses(n_types),
        bonds=reader.joined("bond", 2, n_bond_types, columns["id"], BONDED_STYLES),
        n_angle_types=n_angle_types,
        angles=reader.joined("angle", 3, n_angle_types, columns["id"], ANGLE_STYLES),
        coefficients={name: reader.sections[name][1] for name in SECTIONS if "Coeffs" in name and name in reader.sections},
        hints=reader.hints,
    )
