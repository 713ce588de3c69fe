"""LAMMPS data files: atom styles and their columns; reading the header, the box and the supported sections, and writing them."""

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from ...base.errors import ParameterError
from ..language.arguments import near
from ..language.lexer import Row, TextFile
from ..state.box import Box

#: Columns of the Atoms section by atom style; ``tdpd`` has its concentrations after them.
ATOM_STYLES: dict[str, tuple[str, ...]] = {
    style: ("id", *columns.split(), "x", "y", "z")
    for style, columns in {
        **{"atomic": "type", "charge": "type charge", "bond": "molecule type", "angle": "molecule type", "molecular": "molecule type"},
        **{"full": "molecule type charge", "dpd": "type theta", "mdpd": "type rho", "edpd": "type temperature capacity", "tdpd": "type"},
        "sphere": "type diameter solid",
    }.items()
}

#: Atom styles whose beads may be bonded.
BONDED_STYLES = ("bond", "angle", "molecular", "full")

#: What joins beads: how many each, and the atom styles that have it.
JOINED: dict[str, tuple[int, tuple[str, ...]]] = {
    "bond": (2, BONDED_STYLES),
    "angle": (3, ("angle", "molecular", "full")),
    **dict.fromkeys(("dihedral", "improper"), (4, ("molecular", "full"))),
}

#: Atom styles whose beads have charges.
CHARGED_STYLES = ("charge", "full")

#: Arrays of :class:`~openmm_dpd.lammps.state.atoms.Atoms` by their column in data files.
ARRAYS = {
    **{"charge": "charges", "molecule": "molecules", "theta": "thetas", "temperature": "temperatures", "capacity": "capacities"},
    **{"rho": "densities", "diameter": "diameters", "solid": "solids"},
}


def styles_of(atom_style: str) -> tuple[str, ...]:
    """The atom styles that ``atom_style`` names: one, or after ``hybrid`` several, with those of every bead first."""
    first, *others = atom_style.split()
    return (first,) if first != "hybrid" else ("atomic", *others)


def atom_columns(styles: Sequence[str], n_species: int = 0) -> tuple[str, ...]:
    """Columns of the Atoms section, without image flags: of the atom style, or of several that follow ``hybrid``, with the columns ``c1``,
    ``c2``, ... of ``n_species`` concentrations of ``tdpd``."""
    plain = ATOM_STYLES["atomic"]
    columns = list(ATOM_STYLES[styles[0]] if len(styles) == 1 else plain)
    for style in styles:
        columns += [name for name in ATOM_STYLES[style] if len(styles) > 1 and name not in columns]
        columns += [f"c{k}" for k in range(1, n_species + 1)] if style == "tdpd" else []
    return tuple(columns)


SECTIONS = ("Atoms", "Velocities", "Masses", *(f"{what.capitalize()}s" for what in JOINED), "Pair Coeffs", "PairIJ Coeffs")
SECTIONS += tuple(f"{what.capitalize()} Coeffs" for what in JOINED) + tuple(
    f"{what.capitalize()} Type Labels" for what in ("atom", *JOINED)
)

_COUNTS = ("atoms", *(f"{what}s" for what in JOINED))
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

#: Largest id and image flag.
_LARGEST = 2**31 - 1


@dataclass
class DataFile:
    """Content of a data file, in the deck's units, with atoms in the order of the file."""

    #: Number of atom types; those of bonds, angles, ... are below.
    n_types: int
    box: Box
    #: ``id``, ``type``, and by style ``molecule``, ``charge``, ``theta``, ``rho``, ``temperature``, ``capacity``, ``c1``, ``c2``, ...
    columns: dict[str, np.ndarray]
    positions: np.ndarray  #: (N, 3) as in the file, possibly outside the box
    images: np.ndarray  #: (N, 3) image flags, 0 where the file has none
    velocities: np.ndarray  #: (N, 3) in the order of the atoms; 0 where the file has none
    masses: dict[int, float] = field(default_factory=dict)
    n_bond_types: int = 0
    bonds: np.ndarray = field(default_factory=lambda: np.zeros((0, 3), dtype=np.int64))  #: (B, 3) type and two ids
    n_angle_types: int = 0
    angles: np.ndarray = field(default_factory=lambda: np.zeros((0, 4), dtype=np.int64))  #: (A, 4) type and three ids
    n_dihedral_types: int = 0
    dihedrals: np.ndarray = field(default_factory=lambda: np.zeros((0, 5), dtype=np.int64))  #: (D, 5) type and four ids
    n_improper_types: int = 0
    impropers: np.ndarray = field(default_factory=lambda: np.zeros((0, 5), dtype=np.int64))
    coefficients: dict[str, list[Row]] = field(default_factory=dict)  #: Lines of the Coeffs sections by section name
    hints: dict[str, str] = field(default_factory=dict)  #: Comments on section lines, by section
    labels: dict[str, dict[str, int]] = field(default_factory=dict)  #: Types by their labels, for ``atom``, ``bond``, ...


class DataReader:
    """The lines of a data file, split into header values and sections; each method parses a part.  Errors are DeckErrors with file and
    line. With ``lenient`` unknown sections and header lines are ignored.  ``sections`` and ``headers`` (words after the values, and their
    number) are those of the kind of file."""

    def __init__(self, path: Path, lenient: bool = False, sections: Sequence[str] = SECTIONS, headers: Mapping = _HEADERS):
        self.file, self._headers = TextFile.read(path, title=True), headers
        self.fail = self.file.error
        self.header: dict[tuple[str, ...], list[float]] = {}
        self.sections: dict[str, tuple[int, list[Row]]] = {}
        self.hints: dict[str, str] = {}  #: Comments on section lines, by section
        body: list[Row] | None = None
        for number, words in self.file.rows():
            if number == 1:
                continue  # the first line is always a title
            name = " ".join(words)
            if name.replace(" ", "").isalpha():
                if name not in sections and not lenient:
                    raise self.fail(
                        f"section or header line '{name}' is not supported; sections are {', '.join(sections)}{near(name, sections)}",
                        number,
                    )
                if name in self.sections:
                    raise self.fail(f"section {name} appears twice", number)
                body = []
                self.sections[name] = (number, body)
                self.hints[name] = self.file.lines[number - 1].partition("#")[2].strip()
            elif body is not None:
                body.append((number, words))
            elif not self._header_line(words, number) and not lenient:
                raise self.fail(f"header line '{' '.join(words)}' is not supported", number)

    def _header_line(self, words: list[str], number: int) -> bool:
        """Store a header value.  Return False if it is unknown."""
        size = next((size for size in (1, 2, 3, 6) if self._headers.get(tuple(words[size:])) == size), None)
        if size is None:
            return False
        key = tuple(words[size:])
        what = f"the header value before '{' '.join(key)}'"
        values = self.file.numbers((number, words), words[:size], size, f"numbers before '{' '.join(key)}'", what)
        if size == 1 and key != ("mass",) and not (values[0].is_integer() and values[0] >= 0):
            raise self.fail(f"expected a whole number >= 0 before '{' '.join(key)}', not '{words[0]}'", number)
        self.header[key] = values
        return True

    def number_types(self, styles: Sequence[str], labels: Mapping[str, Mapping[str, int]]) -> dict[str, dict[str, int]]:
        """Put numbers in the place of labels of types: those of the file, which are returned by what they are types of, and ``labels``."""
        found: dict[str, dict[str, int]] = {}
        for what in ("atom", *JOINED):
            for row in self.rows(f"{what.capitalize()} Type Labels", self.count(what, "types"), 2, "type label"):
                found.setdefault(what, {})[row[1][1]] = self.file.integers(row, row[1][:1], "a type")[0]
            title = "Atoms" if what == "atom" else f"{what.capitalize()}s"
            column = atom_columns(styles).index("type") if what == "atom" else 1
            places: dict[str, tuple[int, ...]] = {title: (column,), f"{what.capitalize()} Coeffs": (0,)}
            places |= {"Masses": (0,), "Pair Coeffs": (0,), "PairIJ Coeffs": (0, 1)} if what == "atom" else {}
            numbers = {**labels.get(what, {}), **found.get(what, {})}
            for name, at in places.items() if numbers else ():
                for _, words in self.sections.get(name, (0, []))[1]:
                    words[:] = [str(numbers.get(word, word)) if k in at else word for k, word in enumerate(words)]
        return found

    def count(self, *key: str) -> int:
        """A number from the header; 0 if it is missing."""
        return int(self.header.get(key, [0])[0])

    def bead(self, row: Row, n: int) -> int:
        """The bead, one of n, that a row begins with."""
        (bead,) = self.file.integers(row, row[1][:1], "an atom")
        if not 1 <= bead <= n:
            raise self.fail(f"atom {bead} is out of range; there are {n}", row[0])
        return bead

    def rows(self, name: str, expected: int, width: int | None = None, usage: str = "") -> list[Row]:
        """The rows of a section; empty if the section is missing.  With ``width`` each row must have this many words."""
        if name not in self.sections:
            return []
        line, body = self.sections[name]
        if len(body) != expected:
            raise self.fail(f"section {name} has {len(body)} lines, but the header announces {expected}", line)
        for number, words in body if width else ():
            if len(words) != width:
                raise self.fail(f"expected '{usage}', not '{' '.join(words)}'", number)
        return body

    # -- sections --------------------------------------------------------------------------------------------------------------
    def box(self) -> Box:
        """The box."""
        edges = []
        for axis in "xyz":
            key = (f"{axis}lo", f"{axis}hi")
            if key not in self.header:
                # LAMMPS silently assumes -1/2 to 1/2
                raise self.fail(f"the header has no line '{key[0]} {key[1]}', so the box has no edges along {axis}")
            edges.append(self.header[key])
        tilt = self.header.get(("xy", "xz", "yz"))
        low, high = np.array(edges).T
        try:
            return Box(low, high, np.array(tilt if tilt else [0.0, 0.0, 0.0]), tilt is not None)
        except ParameterError as error:
            raise self.fail(str(error)) from None

    def atoms(self, styles: Sequence[str], n_species: int = 0) -> tuple[dict[str, np.ndarray], np.ndarray, np.ndarray | None]:
        """Columns of the Atoms section, positions, and image flags (None if the file has none); ``styles`` as for :func:`atom_columns`."""
        names, n = atom_columns(styles, n_species), self.count("atoms")
        x, size = names.index("x"), len(names)
        if n and "Atoms" not in self.sections:
            raise self.fail(f"the header announces {n} atoms, but there is no Atoms section")
        rows = self.rows("Atoms", n)
        usage = f"an atom of atom_style {' '.join(styles)}: {' '.join(names)} [ix iy iz]"
        values = np.empty((n, size))
        images = np.zeros((n, 3), dtype=np.int64)
        for k, (number, words) in enumerate(rows):
            # all atoms have three image flags, or none has
            flagged = len(words) == size + 3
            values[k] = self.file.numbers(rows[k], words[: size if flagged else None], size, usage, f"a value of atom {words[0]}")
            if flagged:
                flags = self.file.integers(rows[k], words[size:], "three image flags")
                if max(map(abs, flags)) > _LARGEST:
                    raise self.fail(f"an image flag of atom {words[0]} is beyond {_LARGEST}: '{' '.join(words[size:])}'", number)
                images[k] = flags
            if len(words) != len(rows[0][1]):
                raise self.fail(f"atom {words[0]} has {'' if flagged else 'no '}image flags, unlike the first atom", number)
        columns: dict[str, np.ndarray] = {}
        for k, name in enumerate(names):
            if name in ("id", "type", "molecule"):
                columns[name] = np.clip(values[:, k], -_LARGEST, _LARGEST).astype(np.int64)
                self._check_whole(values[:, k], columns[name], rows, f"the {name} of an atom")
            elif name not in ("x", "y", "z"):
                columns[name] = values[:, k].copy()
        self._check_atoms(columns, rows)
        return columns, values[:, x : x + 3].copy(), images if n and flagged else None

    def _check_whole(self, values: np.ndarray, whole: np.ndarray, rows: list[Row], what: str) -> None:
        bad = np.flatnonzero(values != whole)
        if len(bad):
            limit = f" up to {_LARGEST}" if abs(values[bad[0]]) > _LARGEST else ""
            raise self.fail(f"{what} must be a whole number{limit}, not {values[bad[0]]:g}", rows[bad[0]][0])

    def _check_atoms(self, columns: dict[str, np.ndarray], rows: list[Row]) -> None:
        ids, types, n_types = columns["id"], columns["type"], self.count("atom", "types")
        ones = np.ones(len(ids))
        for mask, message in (
            (ids < 1, "atom ids start at 1"),
            ((types < 1) | (types > n_types), f"the atom type is out of range; there are {n_types}"),
            (columns.get("theta", ones) <= 0, "the internal temperature (theta) must be > 0"),
            (columns.get("temperature", ones) <= 0, "the temperature of a bead must be > 0"),
            (columns.get("diameter", ones) < 0, "no diameter may be negative"),
            (columns.get("solid", ones) <= 0, "the density of a bead must be > 0"),
            (columns.get("capacity", ones) <= 0, "the heat capacity of a bead must be > 0"),
        ):
            if mask.any():
                number, words = rows[int(np.argmax(mask))]
                raise self.fail(f"{message}: '{' '.join(words)}'", number)
        order = np.argsort(ids, kind="stable")
        twice = np.flatnonzero(np.diff(ids[order]) == 0)
        if len(twice):
            raise self.fail(f"atom id {ids[order][twice[0]]} appears twice", rows[int(order[twice[0] + 1])][0])

    def velocities(self, ids: np.ndarray, turning: str = "") -> np.ndarray | None:
        """(N, 3) velocities of the atoms with these ids; None without a section.  Angular ones, columns ``turning``, must be 0."""
        if "Velocities" not in self.sections:
            return None
        found = np.zeros((len(ids), 3))
        left = {identity: k for k, identity in enumerate(ids.tolist())}
        for row in self.rows("Velocities", len(ids), 4 + len(turning.split()), f"id vx vy vz{turning}"):
            number, words = row
            (identity,) = self.file.integers(row, words[:1], "an atom id")
            if identity not in left:
                why = " twice" if identity in ids else ", which does not exist"
                raise self.fail(f"section Velocities names atom {identity}{why}", number)
            numbers = self.file.numbers(row, words[1:], len(words) - 1, f"'id vx vy vz{turning}'", f"the velocity of atom {identity}")
            if any(numbers[3:]):
                raise self.fail(f"atom {identity} turns, which beads of atom_style sphere do not do here; set{turning} to 0", number)
            found[left.pop(identity)] = numbers[:3]
        return found

    def masses(self) -> dict[int, float]:
        """Mass of each type; empty without a Masses section."""
        found, n_types = {}, self.count("atom", "types")
        for row in self.rows("Masses", n_types, 2, "type mass"):
            number, words = row
            (kind,) = self.file.integers(row, words[:1], "an atom type")
            (mass,) = self.file.numbers(row, words[1:], 1, "'type mass'", f"the mass of type {kind}")
            if not 1 <= kind <= n_types:
                raise self.fail(f"atom type {kind} is out of range; there are {n_types}", number)
            if mass <= 0:
                raise self.fail(f"the mass of type {kind} must be > 0, but is {mass:g}", number)
            found[kind] = mass
        return found

    def joined(self, what: str, ids: np.ndarray, atom_style: str) -> np.ndarray:
        """Types and ids from the section Bonds, Angles, Dihedrals or Impropers."""
        size, styles = JOINED[what]
        section, announced, n_types = f"{what.capitalize()}s", self.count(f"{what}s"), self.count(what, "types")
        usage = "id type " + " ".join(f"atom{k}" for k in range(1, size + 1))
        rows = self.rows(section, announced, 2 + size, usage)
        if rows and not set(styles_of(atom_style)) & set(styles):
            raise self.fail(f"atom_style {atom_style} has no {what}s; use {' or '.join(styles)}", self.sections[section][0])
        if announced and not rows:
            raise self.fail(f"the header announces {announced} {what}s, but there is no {section} section")
        known = set(ids.tolist())
        found = np.zeros((len(rows), 1 + size), dtype=np.int64)
        for k, row in enumerate(rows):
            _, kind, *atoms = self.file.integers(row, row[1], f"whole numbers '{usage}'")
            if not 1 <= kind <= n_types:
                raise self.fail(f"{what} type {kind} is out of range; there are {n_types}", row[0])
            for at, atom in enumerate(atoms):
                wrong = " twice" if atom in atoms[:at] else ", which does not exist" if atom not in known else ""
                if wrong:
                    raise self.fail(f"a{'n' * (what[0] in 'ai')} {what} names atom {atom}{wrong}", row[0])
            found[k] = kind, *atoms
        return found


def read_data_file(path: Path, atom_style: str, n_species: int = 0, labels: Mapping[str, Mapping[str, int]] | None = None) -> DataFile:
    """Content of a data file.  ``atom_style`` is a key of :data:`ATOM_STYLES`, or several after ``hybrid`` (the comment behind ``Atoms #``
    is only reported), ``n_species`` the number of concentrations of ``atom_style tdpd``, ``labels`` has those of types that are known
    before.  DeckError, with file and line, for unknown sections, wrong counts, values that are not finite numbers, duplicate ids, and types
    out of range."""
    reader = DataReader(path)
    own = reader.number_types(styles_of(atom_style), labels or {})
    columns, positions, images = reader.atoms(styles_of(atom_style), n_species)
    ids = columns["id"]
    own_masses = "sphere" in styles_of(atom_style)
    velocities = reader.velocities(ids, " wx wy wz" * own_masses)
    return DataFile(
        n_types=reader.count("atom", "types"),
        box=reader.box(),
        columns=columns,
        positions=positions,
        images=np.zeros((len(ids), 3), dtype=np.int64) if images is None else images,
        velocities=np.zeros((len(ids), 3)) if velocities is None else velocities,
        masses={} if own_masses else reader.masses(),
        **{f"n_{what}_types": reader.count(what, "types") for what in JOINED},  # type: ignore[arg-type]
        **{f"{what}s": reader.joined(what, ids, atom_style) for what in JOINED},  # type: ignore[arg-type]
        coefficients={name: reader.sections[name][1] for name in SECTIONS if "Coeffs" in name and name in reader.sections},
        hints=reader.hints,
        labels=own,
    )


def data_lines(
    data: DataFile,
    title: str,
    styles: Sequence[str],
    n_species: int = 0,
    *,
    coefficients: Iterable[str] = (),
    remarks: Mapping[int, str] | None = None,
) -> Iterator[str]:
    """Lines of a data file, beginning with ``title``, with all digits of every number.  All of ``data`` except its ``coefficients`` and
    ``hints`` is written; ``coefficients`` are lines of the Coeffs sections, ``remarks`` comments on types, after their masses; ``styles``
    and ``n_species`` are those of :func:`atom_columns`."""
    terms = [(what, getattr(data, f"n_{what}_types"), getattr(data, f"{what}s")) for what in JOINED]
    yield from (title, "", f"{len(data.positions)} atoms", f"{data.n_types} atom types")
    for what, types, rows in terms:
        if len(rows) or types:
            yield from (f"{len(rows)} {what}s", f"{types} {what} types")
    yield ""
    for axis, low, high in zip("xyz", data.box.low.tolist(), data.box.high.tolist(), strict=True):
        yield f"{low!r} {high!r} {axis}lo {axis}hi"
    if data.box.triclinic:
        yield f"{' '.join(map(repr, data.box.tilt.tolist()))} xy xz yz"
    for what, labels in data.labels.items():
        yield from ("", f"{what.capitalize()} Type Labels", "", *(f"{kind} {label}" for label, kind in labels.items()))
    if data.masses:
        yield from ("", "Masses", "")
        for kind, mass in sorted(data.masses.items()):
            yield f"{kind} {float(mass)!r}" + (f" # {remarks[kind]}" if remarks else "")
    yield from coefficients
    arrays = data.columns | dict(zip("xyz", data.positions.T, strict=True))
    columns = [arrays[name] for name in atom_columns(styles, n_species)] + list(data.images.T)
    yield from ("", f"Atoms # {styles[0] if len(styles) == 1 else 'hybrid'}", "")
    for row in zip(*(column.tolist() for column in columns), strict=True):
        yield " ".join(map(repr, row))
    yield from ("", "Velocities", "")
    for identity, velocity in zip(data.columns["id"].tolist(), data.velocities.tolist(), strict=True):
        yield f"{identity} {' '.join(map(repr, velocity))}" + " 0 0 0" * ("sphere" in styles)
    for what, _, rows in terms:
        if len(rows):
            yield from ("", f"{what.capitalize()}s", "")
            yield from (f"{k} {' '.join(map(str, row))}" for k, row in enumerate(rows.tolist(), start=1))
