"""PSF files: topologies with names, masses, charges, molecules, bonds, angles and dihedrals."""

import os
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np

from ..base.errors import ParameterError, bead_number, what_is
from ..base.files import write_whole
from ..base.geometry import connected
from ..base.units import to_md

#: Residue and segment name of all beads.  No reader takes "MOL" for an amino acid, nucleotide, water or solvent.
RESIDUE, SEGMENT = "MOL", "DPD"
#: Sections that this package has no use for, by their content.
_OTHERS = {"impropers": "!NIMPHI", "cross-terms": "!NCRTERM", "lone pairs": "!NUMLP"}


@dataclass(frozen=True, eq=False)
class Beads:
    """Content of a PSF file for N beads: names, masses (Da), charges (e), molecule numbers, and bead indices from 0 of bonds (B, 2),
    angles (K, 3) and dihedrals (D, 4).

    ``residues`` and ``segments`` are the names of each bead's molecule and segment; ``others`` are the numbers of impropers, cross-terms
    and lone pairs.
    """

    names: list[str]
    masses: np.ndarray
    charges: np.ndarray
    molecules: np.ndarray
    bonds: np.ndarray
    angles: np.ndarray
    dihedrals: np.ndarray
    residues: list[str]
    segments: list[str]
    others: Mapping[str, int] = field(default_factory=dict)


def write_psf(
    path: str | os.PathLike,
    *,
    names: Sequence[str],
    masses,
    charges=None,
    molecules=None,
    bonds=(),
    angles=(),
    dihedrals=(),
    impropers=(),
    residues: Sequence[str] | None = None,
) -> None:
    """Write a topology file with full-precision masses and charges: NAMD's variant of PSF, with columns separated by blanks.

    It is read by :func:`load_topology`, mdtraj (which drops the masses), VMD (names of at most 7 characters), MDAnalysis and others.  Fixed
    columns would cut digits, long names and large indices, and readers of CHARMM's extended columns disagree on their positions.

    Parameters
    ----------
    path : path-like
        File to write; overwritten.
    names : sequence of N str
        Type name of each bead: printable ASCII without blanks.
    masses : (N,) array of masses
        Masses in Da, >= 0; all digits are kept.
    charges : (N,) array of charges, optional
        In elementary charges; 0 by default.
    molecules : (N,) array of int, optional
        Molecule numbers, >= 0, written as residue numbers.  By default beads connected by bonds are a molecule.
    bonds : (B, 2) array of int
        Bead indices from 0.
    angles : (K, 3) array of int
        Bead indices from 0, with the vertex in the middle.  :func:`read_psf`, VMD and MDAnalysis read them; mdtraj has no angles.
    dihedrals : (D, 4) array of int
        Bead indices from 0 along three bonds.  :func:`read_psf`, VMD and MDAnalysis read them; mdtraj has no dihedrals.
    impropers : (D, 4) array of int
        Bead indices from 0.  VMD and MDAnalysis read them; :func:`read_psf` counts them.
    residues : sequence of N str, optional
        Name of the molecule of each bead; ``MOL`` by default.

    Raises
    ------
    ParameterError
        If lengths differ, a name cannot be written, a mass is negative, a value is not finite, or an index is out of range.
    OutputError
        If the file cannot be written.
    """
    names = [str(name) for name in names]
    count = len(names)
    numbers = {name: k for k, name in enumerate(dict.fromkeys(names), start=1)}
    called = residue_names(residues, count)
    for what, given in (("bead type", numbers), ("name of a molecule,", dict.fromkeys(called))):
        for name in given:
            if not name or not name.isascii() or not name.isprintable() or " " in name:
                raise ParameterError(f"the {what} {what_is(name)} cannot be in a PSF file; use printable ASCII characters, no blanks")
    mass = _per_bead(masses, "mass", "masses", count)
    if np.any(mass < 0):
        raise ParameterError(f"bead {int(np.argmin(mass))} has the mass {mass.min():g}; masses must be >= 0")
    charge = np.zeros(count) if charges is None else _per_bead(charges, "charge", "charges", count)
    pairs = checked_bonds(bonds, count)
    triples, quads = checked_bonds(angles, count, 3), checked_bonds(dihedrals, count, 4)
    flat = checked_bonds(impropers, count, 4)
    molecule = molecule_numbers(molecules, pairs, count)
    # VMD needs at least 50 characters per line
    atom_lines = [
        f"{bead:10d} {SEGMENT:<8s} {resid:<8d} {kind:<8s} {name:<8s} {numbers[name]:<4d} {q!r:>13s} {m!r:>13s} {0:7d}"
        for bead, (resid, kind, name, q, m) in enumerate(
            zip(molecule.tolist(), called, names, charge.tolist(), mass.tolist(), strict=True), start=1
        )
    ]
    sections = [
        ("NTITLE", 1, [" REMARKS beads of a DPD simulation; masses in Da, charges in e"]),
        ("NATOM", count, atom_lines),
        ("NBOND: bonds", len(pairs), _index_lines(pairs, 4)),
        ("NTHETA: angles", len(triples), _index_lines(triples, 3)),
        ("NPHI: dihedrals", len(quads), _index_lines(quads, 2)),
        ("NIMPHI: impropers", len(flat), _index_lines(flat, 2)),
        *((name, 0, []) for name in ("NDON: donors", "NACC: acceptors")),
    ]
    text = [line for name, entries, lines in sections for line in ("", f"{entries:10d} !{name}", *lines)]
    write_whole(path, "\n".join(["PSF NAMD", *text, "", ""]), "the topology")


def read_psf(path: str | os.PathLike) -> Beads:
    """Read a PSF file whose columns are separated by blanks, as written by :func:`write_psf` and others.

    Raises
    ------
    ParameterError
        If the file is not a PSF file or cannot be parsed; the message names file and line.
    """
    with open(path, encoding="ascii", errors="replace") as file:
        lines = file.read().splitlines()
    if not lines or not lines[0].startswith("PSF"):
        raise ParameterError(f"{path} is not a PSF file: its first line must begin with PSF")
    start, count = _section(lines, "!NATOM", path)
    names: list[str] = []
    residues: list[str] = []
    segments: list[str] = []
    columns = np.zeros((2, count))
    molecules = np.zeros(count, dtype=np.int64)
    for k in range(count):
        try:
            # index, segment, residue number, residue, name, type, charge, mass
            words = lines[start + k].split()
            names.append(words[4])
            segments.append(words[1])
            residues.append(words[3])
            molecules[k], columns[0, k], columns[1, k] = int(words[2]), float(words[6]), float(words[7])
        except (IndexError, ValueError):
            raise ParameterError(f"{path}:{start + k + 1}: cannot read bead {k + 1} of {count} from this line") from None
    bonds = checked_bonds(_indices(lines, "!NBOND", "bonds", 2, path), count)
    # VMD may leave out empty sections
    angles, dihedrals = (
        checked_bonds(_indices(lines, title, what, width, path) if any(title in line for line in lines) else (), count, width)
        for title, what, width in (("!NTHETA", "angles", 3), ("!NPHI", "dihedrals", 4))
    )
    there = {what: title for what, title in _OTHERS.items() if any(title in line for line in lines)}
    others = {what: number for what, title in there.items() if (number := _section(lines, title, path)[1])}
    return Beads(names, columns[1], columns[0], molecules, bonds, angles, dihedrals, residues, segments, others)


# -- helpers -------------------------------------------------------------------------------------------------------------------
def _per_bead(values, dimension: str, name: str, count: int) -> np.ndarray:
    array = np.asarray(to_md(values, dimension, name))
    if array.shape != (count,):
        raise ParameterError(f"{name} must have one entry for each of the {count} names, not shape {array.shape}")
    return array


def residue_names(residues: Sequence[str] | None, count: int) -> list[str]:
    """Name of the molecule of each bead; ``MOL`` by default."""
    if residues is None:
        return [RESIDUE] * count
    names = [str(name) for name in residues]
    if len(names) != count:
        raise ParameterError(f"residues must have one name for each of the {count} beads, not {len(names)}")
    return names


def checked_bonds(bonds, count: int, width: int = 2) -> np.ndarray:
    """Bonds (width 2), angles (3) or dihedrals (4) as an array (number, width); ParameterError if an index is out of range or repeated."""
    what, beads, number = {2: ("bonds", "pairs", "two"), 3: ("angles", "triples", "three"), 4: ("dihedrals", "quads", "four")}[width]
    try:
        array = np.asarray(bonds)
    except ValueError:
        raise ParameterError(f"{what} must be {beads} of bead indices; their entries differ in length") from None
    if array.size == 0:
        return np.zeros((0, width), dtype=np.int64)
    if array.ndim != 2 or array.shape[1] != width or not np.issubdtype(array.dtype, np.integer):
        raise ParameterError(f"{what} must be {beads} of bead indices, not an array of {array.dtype} of shape {array.shape}")
    same = np.any(np.diff(np.sort(array, axis=1), axis=1) == 0, axis=1)
    bad = np.flatnonzero((array.min(axis=1) < 0) | (array.max(axis=1) >= count) | same)
    if len(bad):
        raise ParameterError(f"{what[:-1]} {bad[0]} is {array[bad[0]].tolist()}; it must join {number} different beads of 0 to {count - 1}")
    return array.astype(np.int64)


def _index_lines(rows: np.ndarray, per_line: int) -> list[str]:
    """Lines of bead indices from 1, with this many bonds, angles or dihedrals per line."""
    flat = [f" {index:9d}" for index in (rows + 1).ravel().tolist()]
    step = per_line * rows.shape[1]
    return ["".join(flat[start : start + step]) for start in range(0, len(flat), step)]


def _indices(lines: list[str], title: str, what: str, width: int, path) -> np.ndarray:
    """Bead indices from 0 in a section, (number, width)."""
    start, number = _section(lines, title, path)
    words: list[str] = []
    while len(words) < width * number and start < len(lines) and lines[start].strip():
        words += lines[start].split()
        start += 1
    try:
        return np.array([int(word) for word in words], dtype=np.int64).reshape(number, width) - 1
    except ValueError:
        raise ParameterError(f"{path}:{start}: cannot read {number} {what} up to this line") from None


def molecule_numbers(molecules, bonds: np.ndarray, count: int) -> np.ndarray:
    """Molecule numbers, (N,), >= 0; by default, beads connected by bonds have the same number, from 1."""
    if molecules is None:
        if not len(bonds):
            return np.arange(1, count + 1)
        label = connected(bonds, count)
        # numbered in the order of their first beads
        _, first, position = np.unique(label, return_index=True, return_inverse=True)
        return (np.argsort(np.argsort(first)) + 1)[position]
    array = np.asarray(molecules)
    if array.shape != (count,) or not np.issubdtype(array.dtype, np.integer):
        raise ParameterError(f"molecules must be one integer for each of the {count} names, not {array.dtype} of shape {array.shape}")
    if count and array.min() < 0:
        raise ParameterError(f"bead {bead_number(np.argmin(array))} has the molecule number {array.min()}; they must be >= 0")
    return array.astype(np.int64)


def runs(numbers: np.ndarray) -> Iterator[tuple[int, range]]:
    """Runs of successive equal numbers: the number and the range of its indices."""
    edges = np.concatenate([[0], np.flatnonzero(np.diff(numbers)) + 1, [len(numbers)]]).tolist()
    for start, stop in zip(edges[:-1], edges[1:], strict=True):
        if stop > start:
            yield int(numbers[start]), range(start, stop)


def _section(lines: list[str], title: str, path) -> tuple[int, int]:
    """Index of the first line of a section and the number of its entries."""
    for index, line in enumerate(lines):
        if title in line:
            try:
                return index + 1, int(line.split()[0])
            except ValueError:
                break
    raise ParameterError(f"{path} has no readable {title} section")
