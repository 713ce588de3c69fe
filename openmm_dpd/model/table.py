"""The symmetric table type x type -> pair coefficient."""

from collections.abc import Mapping
from itertools import combinations_with_replacement

from ..base.errors import ParameterError, what_is
from .pairs import NONE, PairCoefficient


class PairTable:
    """Pair coefficients of one kind, for unordered pairs of bead types; tables of different kinds add up.

    Parameters
    ----------
    entries : mapping of (str, str) to a pair coefficient
        Keys name two bead types in any order; ``"*"`` is every type.  Later entries overwrite earlier ones, as in LAMMPS, so put
        wildcards first; but two keys that differ in the order of their types only must agree.  The value
        :data:`~openmm_dpd.model.pairs.NONE` says that a pair does not interact.

    Raises
    ------
    ParameterError
        If it is no mapping, a key is not a pair of names, a key and its reverse contradict each other, or the values are of several kinds.

    Examples
    --------
    >>> from openmm_dpd import DPD, PairTable
    >>> table = PairTable({("*", "*"): DPD(A=25, gamma=4.5), ("A", "B"): DPD(A=35, gamma=4.5)})
    >>> table.resolve(["A", "B"])[("A", "B")].A
    35.0
    """

    def __init__(self, entries: Mapping):
        if not isinstance(entries, Mapping):
            raise ParameterError(f"a PairTable is made from a mapping such as {{('A', 'B'): DPD(...)}}, not from {what_is(entries)}")
        if not entries:
            raise ParameterError("a PairTable needs at least one entry")
        for key in entries:
            if not (isinstance(key, tuple) and len(key) == 2 and all(isinstance(name, str) for name in key)):
                raise ParameterError(f"the keys of a PairTable are pairs of type names such as ('A', 'B'), not {what_is(key)}")
        self.entries = {(str(first), str(second)): value for (first, second), value in entries.items()}
        for key, value in self.entries.items():
            if value is not NONE and not isinstance(value, PairCoefficient):
                raise ParameterError(
                    f"for types {key}: expected a pair coefficient such as DPD(A=25, gamma=4.5), or NONE, not {what_is(value)}"
                )
            reverse = self.entries.get(key[::-1], value)
            if value is not reverse and value != reverse:
                raise ParameterError(
                    f"the coefficients for types {key} and {key[::-1]} differ, but the order of two types has no meaning; give one of them"
                )
        found = {type(value) for value in self.entries.values() if value is not NONE}
        if len(found) > 1:
            names = " and ".join(sorted(kind.__name__ for kind in found))
            raise ParameterError(f"one PairTable holds one kind of coefficient, not {names}; give the scene a list of tables")
        self.kind = found.pop() if found else None

    def __repr__(self) -> str:
        return f"PairTable({self.entries!r})"

    def resolve(self, names: list[str]) -> dict[tuple[str, str], object]:
        """Coefficient of every unordered pair of ``names`` that has one, keyed in the order of ``names``.

        Raises
        ------
        ParameterError
            If an entry names a type that is not among ``names``.
        """
        place = {name: k for k, name in enumerate(names)}
        for key in self.entries:
            for name in key:
                if name != "*" and name not in place:
                    raise ParameterError(f"for types {key}: there is no bead type {what_is(name)}; the types are {', '.join(names)}")
        found = {}
        for key, value in self.entries.items():
            first, second = ([name] if name != "*" else names for name in key)
            for a in first:
                for b in second:
                    found[(a, b) if place[a] <= place[b] else (b, a)] = value
        return found


def require_complete(tables: list[PairTable], names: list[str]) -> None:
    """Raise ParameterError if some pair of ``names`` appears in no table (there is no mixing and no silent default)."""
    resolved = [table.resolve(names) for table in tables]
    missing = [pair for pair in combinations_with_replacement(names, 2) if not any(pair in table for table in resolved)]
    if missing:
        listing = ", ".join(f"({a}, {b})" for a, b in missing[:6]) + (" ..." if len(missing) > 6 else "")
        raise ParameterError(f"no pair coefficients for types {listing}; set them, or set them to NONE if they do not interact")
