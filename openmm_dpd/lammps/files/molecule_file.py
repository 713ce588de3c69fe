"""Molecule files: the template that ``create_atoms ... mol`` and other commands place, and its random orientations."""

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from ...base.errors import ParameterError
from ...model.bonds import bonded_neighbours
from .data_file import JOINED, DataReader

#: Sections with a value or several per bead: names of the words of a row.
_PER_BEAD = {"Coords": "x y z", "Types": "type", "Molecules": "molecule", "Charges": "charge"}
_TERMS = tuple(f"{what.capitalize()}s" for what in JOINED)
_SPECIAL = ("Special Bond Counts", "Special Bonds")
#: Sections without a meaning for the beads that are made: for ``fix shake``, ``fix rigid`` and atom styles with sizes.
_UNUSED = ("Fragments", "Masses", "Diameters", "Dipoles", "Shake Flags", "Shake Atoms", "Shake Bond Types")
SECTIONS = (*_PER_BEAD, *_TERMS, *_SPECIAL, *_UNUSED)
_HEADERS = {(name,): 1 for name in ("atoms", *(f"{what}s" for what in JOINED), "fragments", "mass")}
_HEADERS |= {("com",): 3, ("inertia",): 6}


@dataclass(frozen=True)
class MoleculeTemplate:
    """A template: beads 1 to n and what joins them."""

    types: np.ndarray
    positions: np.ndarray  #: (n, 3) relative to their mean
    molecules: np.ndarray | None  #: Numbers of molecules within the template; None means one
    charges: np.ndarray
    terms: Mapping[str, np.ndarray]  #: By ``bond``, ``angle``, ...: type and beads
    unused: tuple[str, ...]  #: Sections of the file that have no effect

    def turned(self, axis: np.ndarray, angle: float) -> np.ndarray:
        """(n, 3) positions after a rotation by an angle (radians) about an axis through their mean."""
        axis = axis / np.linalg.norm(axis)
        along = np.outer(self.positions @ axis, axis)
        return along + np.cos(angle) * (self.positions - along) + np.sin(angle) * np.cross(axis, self.positions)


def read_molecule(path: Path, atom_style: str, types: Mapping[str, int], offsets: Mapping[str, int], scale: float) -> MoleculeTemplate:
    """The template of a file.  ``types`` has the numbers of types by ``bond``, ``angle``, ..., ``offsets`` what is added to the types of
    these and of the beads (``atom``).  DeckError, with file and line, for what is missing, unknown, or needs another atom style."""
    reader = DataReader(path, sections=SECTIONS, headers=_HEADERS)
    n = reader.count("atoms")
    if not n or "Coords" not in reader.sections:
        raise reader.fail("a molecule needs a header line 'N atoms' with N > 0 and a section Coords")
    values = {name: _per_bead(reader, name, words.split(), n) for name, words in _PER_BEAD.items() if name in reader.sections}
    positions = values["Coords"] * scale
    terms = {}
    for what in JOINED:
        reader.header[(what, "types")] = [types[what] - offsets[what]]
        terms[what] = reader.joined(what, np.arange(1, n + 1), atom_style)
        terms[what][:, 0] += offsets[what]
    _check_special(reader, terms["bond"], n)
    whole = {}
    for name in ("Types", "Molecules"):
        column = values.get(name, np.full((n, 1), 0.0 if name == "Types" else 1.0))[:, 0]
        if np.any((column != np.floor(column)) | (column < (name == "Types" and name in values))):
            raise reader.fail(f"section {name}: expected whole numbers > 0", reader.sections[name][0])
        whole[name] = column.astype(np.int64)
    return MoleculeTemplate(
        types=whole["Types"] + offsets["atom"],
        positions=positions - positions.mean(axis=0),
        molecules=whole["Molecules"] if "Molecules" in values else None,
        charges=values.get("Charges", np.zeros((n, 1)))[:, 0],
        terms=terms,
        unused=tuple(name for name in _UNUSED if name in reader.sections),
    )


def _per_bead(reader: DataReader, name: str, words: list[str], n: int) -> np.ndarray:
    """(n, values) values of a section, in the order of the beads."""
    found, usage = np.full((n, len(words)), np.nan), f"id {' '.join(words)}"
    for row in reader.rows(name, n, 1 + len(words), usage):
        bead = reader.bead(row, n)
        found[bead - 1] = reader.file.numbers(row, row[1][1:], len(words), usage, f"a value of atom {bead}")
    if np.isnan(found).any():
        raise reader.fail(f"section {name} has no line for atom {int(np.argmax(np.isnan(found).any(axis=1))) + 1}")
    return found


def _check_special(reader: DataReader, bonds: np.ndarray, n: int) -> None:
    """Raise DeckError unless the file's lists of bonded neighbours are those that follow from its bonds."""
    if not all(name in reader.sections for name in _SPECIAL):
        return
    counts = {row[1][0]: reader.file.integers(row, row[1][1:], "three counts") for row in reader.rows(_SPECIAL[0], n)}
    shells = bonded_neighbours(bonds[:, 1:], n + 1)
    for row in reader.rows(_SPECIAL[1], n):
        bead, *others = reader.file.integers(row, row[1], "an atom and its neighbours")
        for k, count in enumerate(counts.get(row[1][0], ()), start=1):
            given, others = set(others[:count]), others[count:]
            if given != {i + j - bead for i, j in shells.get(k, ()) if bead in (i, j)}:
                raise reader.fail(f"atom {bead}: neighbours other than those that follow from the bonds are not supported", row[0])


class ParkMiller:
    """The generator of Park and Miller (1988), as LAMMPS uses it for random positions."""

    def __init__(self, seed: int):
        self._at = seed % (2**31 - 1)
        self.random((30,))  # thrown away, as in LAMMPS

    def random(self, shape: tuple[int, ...]) -> np.ndarray:
        """Numbers between 0 and 1."""
        count, prime = int(np.prod(shape)), 2**31 - 1
        powers = np.full(min(count, 1), 16807)  # 16807**1, 16807**2, ...
        while len(powers) < count:
            powers = np.concatenate([powers, powers * powers[-1] % prime])[:count]
        found = powers * self._at % prime
        self._at = int(found[-1]) if count else self._at
        return (found * (1.0 / prime)).reshape(shape)


class Ranmar:
    """The generator of Marsaglia, Zaman and Tsang (1990), as LAMMPS uses it for random orientations."""

    def __init__(self, seed: int):
        if not 1 <= seed <= 900_000_000:
            raise ParameterError(f"the seed of the orientations must be between 1 and 900000000, but is {seed}")
        ij, kl = divmod(seed - 1, 30082)
        i, j, k, m = ij // 177 % 177 + 2, ij % 177 + 2, kl // 169 % 178 + 1, kl % 169
        self._table, self._shift, self._at = [0] * 97, 362436, 0
        for n in range(97):
            for _ in range(24):
                i, j, k = j, k, i * j % 179 * k % 179
                m = (53 * m + 1) % 169
                self._table[n] = 2 * self._table[n] + (m * k % 64 >= 32)
        self.uniform()

    def uniform(self) -> float:
        """A number between 0 and 1."""
        at, self._at = self._at, (self._at + 1) % 97
        self._table[(96 - at) % 97] = (self._table[(96 - at) % 97] - self._table[(32 - at) % 97]) % 2**24
        self._shift = (self._shift - 7654321) % 16777213
        return (self._table[(96 - at) % 97] - self._shift) % 2**24 / 2**24
