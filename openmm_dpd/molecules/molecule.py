"""Molecules as values: types of the beads, and bonds, angles and dihedrals between them."""

import reprlib
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import combinations, groupby, product

import numpy as np

from ..base.errors import ParameterError, fact_table, what_is
from ..base.units import known_under, to_md, whole_number
from .piercings import neighbours_of
from .terms import AnyBend, AnySpring, AnyTwist

#: Types of beads, as a sequence or as text.
Types = Sequence[str] | str
#: A spring for every bond, or springs by the types of the two beads (``"*"`` for any type).
Springs = object | Mapping[tuple[str, str], object]
#: A bend, or bends by the types of the three beads.
Bends = object | Mapping[tuple[str, str, str], object] | None
#: A twist, or twists by the types of the four beads.
Twists = object | Mapping[tuple[str, str, str, str], object] | None


@dataclass(frozen=True)
class Molecule:
    """A kind of molecule.  Molecules are compared by value, and are keys in :func:`openmm_dpd.molecules.pack`.

    Parameters
    ----------
    types : sequence of n str
        Type of each bead.
    bonds : sequence of (int, int, spring)
        Bead indices from 0, and the spring between them (:class:`Spring`, :class:`FENESpring`, :class:`MorseSpring`).
        Bonds must connect every bead to bead 0.
    angles : sequence of (int, int, int, bend)
        Bead indices, with the vertex in the middle, and the bend (:class:`Bend`, :class:`CosineBend`).
    name : str, optional
        Name in topology files, without blanks; by default the formula of the types, such as ``H3T8``.
    charges : sequence of n charges, optional
        In elementary charges.
    dihedrals : sequence of (int, int, int, int, twist)
        Bead indices along three bonds, and the twist (:class:`Twist`, :class:`OPLSTwist`, :class:`MultiHarmonicTwist`); several twists
        of the same beads add up.

    Raises
    ------
    ParameterError
        If a bead does not exist, a bond or angle is listed twice, or the molecule is not connected.
    """

    types: tuple[str, ...]
    bonds: tuple[tuple[int, int, object], ...] = ()
    angles: tuple[tuple[int, int, int, object], ...] = ()
    name: str = ""
    charges: tuple[float, ...] | None = None
    dihedrals: tuple[tuple[int, int, int, int, object], ...] = ()

    def __post_init__(self):
        def put(name, value):
            object.__setattr__(self, name, value)

        put("types", bead_types(self.types))
        put("bonds", self._checked_terms("bonds", 2, AnySpring))
        put("angles", self._checked_terms("angles", 3, AnyBend))
        put("dihedrals", self._checked_terms("dihedrals", 4, AnyTwist))
        name = self.name or formula(self.types)
        if not isinstance(name, str) or not name.isascii() or not name.isprintable() or " " in name:
            raise ParameterError(f"the name of a molecule must be printable ASCII text without blanks, not {what_is(name)}")
        put("name", name)
        if self.charges is not None:
            given = list(self.charges) if isinstance(self.charges, (list, tuple)) else self.charges
            charges = np.asarray(to_md(given, "charge", f"charges of {name}"))
            if charges.shape != (self.n_beads,):
                raise ParameterError(f"{name} has {self.n_beads} beads, but charges of shape {charges.shape}")
            put("charges", tuple(charges.tolist()))
        lost = sorted(set(range(self.n_beads)) - {bead for bead, _ in self.tree()})
        if lost:
            raise ParameterError(f"{name} is not connected: no chain of bonds leads from bead 0 to bead {lost[0]}")

    def __repr__(self) -> str:
        twists = f", {len(self.dihedrals)} dihedrals" if self.dihedrals else ""
        return f"<Molecule {reprlib.repr(self.name)}: {self.n_beads} beads, {len(self.bonds)} bonds, {len(self.angles)} angles{twists}>"

    def _repr_html_(self) -> str:
        counts = Counter(self.types)
        types = ", ".join(f"{name} {count}" for name, count in counts.items()) if len(counts) <= 5 else f"{len(counts)} types"
        facts = {"beads": self.n_beads, "types": types, "bonds": len(self.bonds), "angles": len(self.angles)}
        facts |= {"dihedrals": len(self.dihedrals)} if self.dihedrals else {}
        return fact_table(f"Molecule {reprlib.repr(self.name)}", facts)

    @property
    def n_beads(self) -> int:
        """Number of beads."""
        return len(self.types)

    @property
    def bond_pairs(self) -> np.ndarray:
        """Bead indices of the bonds, (B, 2)."""
        return np.array([bond[:2] for bond in self.bonds], dtype=np.int64).reshape(-1, 2)

    @property
    def angle_triples(self) -> np.ndarray:
        """Bead indices of the angles, (K, 3)."""
        return np.array([angle[:3] for angle in self.angles], dtype=np.int64).reshape(-1, 3)

    @property
    def dihedral_quads(self) -> np.ndarray:
        """Bead indices of the dihedrals, (K, 4)."""
        return np.array([dihedral[:4] for dihedral in self.dihedrals], dtype=np.int64).reshape(-1, 4)

    def beads(self, *types: str) -> list[int]:
        """Indices of the beads of these types."""
        return [bead for bead, name in enumerate(self.types) if name in types]

    def tree(self) -> list[tuple[int, int | None]]:
        """Beads in the order in which bonds reach them from bead 0, each with the neighbour before it (None for bead 0)."""
        neighbours = neighbours_of(self.bond_pairs, self.n_beads)
        order: list[tuple[int, int | None]] = [(0, None)]
        seen = {0}
        for bead, _ in order:
            for other in neighbours[bead]:
                if other not in seen:
                    seen.add(other)
                    order.append((other, bead))
        return order

    def _checked_terms(self, what: str, beads: int, kind: type) -> tuple:
        """Bonds, angles or dihedrals (``what``) as a tuple; ParameterError for wrong beads or terms."""
        terms, seen = [], set()
        for term in getattr(self, what):
            if not isinstance(term, Sequence) or len(term) != beads + 1 or not isinstance(term[-1], kind):
                raise ParameterError(
                    f"{what} of a molecule are {beads} bead indices and one of {', '.join(known_under(kind))}; one is {what_is(term)}"
                )
            indices = tuple(whole_number(index, f"a bead index in {what}") for index in term[:-1])
            if len(set(indices)) < beads or not all(0 <= index < self.n_beads for index in indices):
                raise ParameterError(f"{what} of a molecule must join different beads of 0 to {self.n_beads - 1}, not {indices}")
            key = min(indices, indices[::-1])
            if key in seen and kind is not AnyTwist:
                raise ParameterError(f"{what} of a molecule list beads {indices} twice")
            seen.add(key)
            terms.append((*indices, term[-1]))
        return tuple(terms)


#: A longer molecule is a typing error.
MOST_BEADS = 10_000_000


def formula(types: Sequence[str]) -> str:
    """Types in order with the lengths of their runs, such as ``H3T8``."""
    runs = [(name, len(list(run))) for name, run in groupby(types)]
    return "".join(name if count == 1 else f"{name}{count}" for name, count in runs)


def bead_types(types: Types) -> tuple[str, ...]:
    """Types of beads as a tuple, from a sequence of names, or from text such as ``"A6B4"`` or ``"(A2B)3"`` (:func:`sequence`)."""
    if isinstance(types, str):
        return sequence(types)
    try:
        names = tuple(types)
    except TypeError:
        names = ()
    bad = [name for name in names if not isinstance(name, str) or name in ("", "*")]
    if not names or bad:
        raise ParameterError(f"types must have the type of each bead, such as ['A', 'A', 'B'] or 'A2B', not {what_is(types)}")
    return names


def sequence(text: str) -> tuple[str, ...]:
    """Bead types from text: names, parentheses, and numbers that repeat the name or parenthesis before them.

    A name is an upper-case letter and the lower-case letters after it.

    Examples
    --------
    >>> sequence("A2B3")
    ('A', 'A', 'B', 'B', 'B')
    >>> sequence("Na(AB)2")
    ('Na', 'A', 'B', 'A', 'B')

    Raises
    ------
    ParameterError
        If the text cannot be read; the message says where.
    """
    text, at = str(text), 0
    open_groups: list[list[str]] = [[]]
    while at < len(text):
        start, letter = at, text[at]
        at += 1
        if letter == "(":
            open_groups.append([])
            continue
        if letter == ")" and len(open_groups) > 1:
            unit = open_groups.pop()
        elif letter.isascii() and letter.isupper():
            while at < len(text) and text[at].isascii() and text[at].islower():
                at += 1
            unit = [text[start:at]]
        else:
            raise ParameterError(f"cannot read the bead types {text!r} at {text[start:]!r}; write names like A or Na, numbers, parentheses")
        digits = at
        while at < len(text) and text[at] in "0123456789":
            at += 1
        if text[digits:at] and int(text[digits:at]) == 0:
            raise ParameterError(f"the bead types {text!r} repeat something 0 times")
        repeats = int(text[digits:at] or 1)
        if len(open_groups[-1]) + repeats * len(unit) > MOST_BEADS:
            raise ParameterError(f"the bead types {text!r} are more than {MOST_BEADS} beads; pack many molecules instead of a large one")
        open_groups[-1] += unit * repeats
    if len(open_groups) > 1 or not open_groups[0]:
        reason = "a parenthesis is not closed" if open_groups[1:] else "there is none"
        raise ParameterError(f"cannot read the bead types {text!r}: {reason}")
    return tuple(open_groups[0])


def join(types, pairs, spring: Springs, bend: Bends = None, *, twist: Twists = None, name: str = "", charges=None) -> Molecule:
    """Molecule from its graph of bonds.

    Parameters
    ----------
    types : sequence of str, or text
        Types of the beads; text is read by :func:`sequence`.
    pairs : (B, 2) array of int
        Indices of bonded beads.
    spring : spring, or mapping from two types to one
        Spring of all bonds, or by types: ``{("*", "*"): Spring(...), ("A", "B"): Spring(...)}``; later entries take precedence.
    bend : bend, or mapping from three types to one, optional
        A bend acts at every bead with exactly two neighbours.  A mapping acts wherever two bonds meet and it has the three types (in either
        direction), also at branching points: ``{("H", "T", "T"): CosineBend(15)}``.
    twist : twist, or mapping from four types to one, optional
        A twist acts along three successive bonds if both middle beads have exactly two neighbours.  A mapping acts wherever it has the
        four types (in either direction).
    name, charges : optional
        Name and elementary charges of the :class:`Molecule`.
    """
    names = bead_types(types)
    pairs = _checked_pairs(pairs)
    outside = [pair for pair in pairs if not all(0 <= bead < len(names) for bead in pair)]
    if outside:
        raise ParameterError(f"bond {outside[0]} names no bead; the molecule has beads 0 to {len(names) - 1}")
    bonds = []
    for i, j in pairs:
        found = by_types(spring, (names[i], names[j]), AnySpring, "spring")
        if found is None:
            raise ParameterError(f"no spring is given for a bond between types {what_is(names[i])} and {what_is(names[j])}")
        bonds.append((i, j, found))
    rows = np.array(pairs, dtype=np.int64).reshape(-1, 2)
    angles = () if bend is None else bends_between(names, rows, bend)
    dihedrals = () if twist is None else twists_between(names, rows, twist)
    return Molecule(names, tuple(bonds), tuple(angles), name, charges, tuple(dihedrals))


def bends_between(types: Sequence[str], pairs: np.ndarray, bend: Bends) -> list[tuple[int, int, int, object]]:
    """Angles between bonds (B, 2), by the rules of :func:`join`: three beads, with the vertex in the middle, and the bend."""
    angles: list[tuple[int, int, int, object]] = []
    for vertex, around in enumerate(neighbours_of(pairs, len(types))):
        if isinstance(bend, AnyBend) and len(around) != 2:
            continue
        for i, k in combinations(around, 2):
            found = by_types(bend, (types[i], types[vertex], types[k]), AnyBend, "bend")
            if found is not None:
                angles.append((i, vertex, k, found))
    return angles


def twists_between(types: Sequence[str], pairs: np.ndarray, twist: Twists) -> list[tuple[int, int, int, int, object]]:
    """Dihedrals along three successive bonds (B, 2), by the rules of :func:`join`: four beads and the twist."""
    dihedrals: list[tuple[int, int, int, int, object]] = []
    around = neighbours_of(pairs, len(types))
    for j, k in pairs.tolist():
        if isinstance(twist, AnyTwist) and not len(around[j]) == len(around[k]) == 2:
            continue
        for i, m in product(around[j], around[k]):
            if len({i, j, k, m}) == 4:
                found = by_types(twist, (types[i], types[j], types[k], types[m]), AnyTwist, "twist")
                if found is not None:
                    dihedrals.append((i, j, k, m, found))
    return dihedrals


def _checked_pairs(pairs) -> list[tuple[int, int]]:
    """Bonds as pairs of ints; ParameterError if they are anything else."""
    try:
        rows = [tuple(row) for row in pairs]
    except TypeError:
        raise ParameterError(f"the bonds of a molecule must be pairs of beads, such as [(0, 1), (1, 2)], not {what_is(pairs)}") from None
    wrong = [row for row in rows if len(row) != 2]
    if wrong:
        raise ParameterError(f"a bond joins two beads, as (0, 1); one of the bonds is {what_is(wrong[0])}")
    return [(whole_number(i, "a bead number of a bond"), whole_number(j, "a bead number of a bond")) for i, j in rows]


def by_types(given, types: tuple[str, ...], kind: type, what: str):
    """The spring, bend or twist for these types, or None if a mapping has none."""
    if isinstance(given, kind):
        return given
    if not isinstance(given, Mapping):
        raise ParameterError(
            f"{what} must be one of {', '.join(known_under(kind))}, or a mapping from {len(types)} types to one, not {what_is(given)}"
        )
    found = None
    for key, value in given.items():
        if not isinstance(key, tuple) or len(key) != len(types) or not isinstance(value, kind):
            found_instead = f"{what_is(key)}: {what_is(value)}"
            raise ParameterError(f"a mapping of {what}s needs keys of {len(types)} types and {what}s as values; it has {found_instead}")
        if any(all(k in ("*", t) for k, t in zip(key, order, strict=True)) for order in (types, types[::-1])):
            found = value
    return found
