"""Bonds, angles and dihedrals that a source lists, and tables of springs, bends and twists, as those of a Scene."""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from ...base.errors import ParameterError, what_is
from ...io.psf import checked_bonds
from ...model.owned import known_under
from ..molecule import bends_between, by_types, twists_between
from ..terms import AnyBend, AnySpring, AnyTwist, many_terms
from .arrays import BeadArrays


def scene_terms(beads: BeadArrays, given, what: str, bonds: Sequence = ()) -> Sequence:
    """Bonds, angles or dihedrals (``what``: one of them) of a Scene: those of the source, with the given springs, bends or twists; the
    given ones; or angles and dihedrals along bonds (of the Scene), where the source has none."""
    if isinstance(given, Sequence) and not isinstance(given, str):
        return given
    rows = getattr(beads, f"{what}s")
    if len(rows) or given is None or what == "bond":
        return _terms(beads, rows, getattr(beads, f"{what}_names"), given, what)
    return _along_bonds(beads, bonds, given, what)


#: What a term is called, the class of all of its kinds, and how many beads it has.
_KINDS: dict[str, tuple[str, type, int]] = {
    "bond": ("spring", AnySpring, 2),
    "angle": ("bend", AnyBend, 3),
    "dihedral": ("twist", AnyTwist, 4),
}


def _terms(beads: BeadArrays, rows: np.ndarray, names: list[str] | None, given, what: str) -> list:
    """Bonds, angles or dihedrals of a Scene: one object for each kind of spring, bend or twist."""
    term, kind, width = _KINDS[what]
    rows = checked_bonds(rows, len(beads.types), width)
    if names is not None and len(names) != len(rows):
        raise ParameterError(f"{beads.source} has {len(rows)} {what}s, but {len(names)} names of their types")
    if given is None:
        if not len(rows):
            return []
        called = _called(beads, rows[0], names, 0)
        raise ParameterError(
            f"{beads.source} has {len(rows)} {what}s, the first one between {called}, but no {what}s are given: "
            f"{what}s={{...}} says what they are, leave_out=({what + 's'!r},) leaves them out"
        )
    if not len(rows):
        raise ParameterError(
            f"{beads.source} has no {what}s that the given {what}s could act on; a sequence of {what}s says where they are"
        )
    by_name = isinstance(given, Mapping) and bool(given) and all(isinstance(key, str) for key in given)
    if by_name and names is None:
        raise ParameterError(f"{beads.source} has no names of {what} types; the keys of {what}s must be bead types, such as ('A', 'B')")
    if isinstance(given, Mapping):
        _check_keys(given, set(names or ()) if by_name else set(beads.types) | {"*"} | set(beads.type_names or ()), beads.source, what)
    chosen, known = [], dict[Any, Any]()
    for k, row in enumerate(rows.tolist()):
        key: Any = names[k] if by_name and names is not None else tuple(beads.types[bead] for bead in row)
        if key not in known:
            known[key] = _named(given, key, kind, term) if by_name else by_types(given, key, kind, term)
        if known[key] is None:
            raise ParameterError(f"{beads.source}: no {term} is given for the {what} between {_called(beads, row, names, k)}")
        chosen.append(known[key])
    return many_terms(rows, chosen)


def _named(given: Mapping, key: str, kind: type, term: str):
    found = given.get(key)
    if found is not None and not isinstance(found, kind):
        raise ParameterError(f"the {term} for {key!r} must be one of {', '.join(known_under(kind))}, not {what_is(found)}")
    return found


def _check_keys(given: Mapping, known: set[str], source: str, what: str) -> None:
    """Raise ParameterError if a table names types that there are not, which would not act."""
    for key in given:
        for name in (key,) if isinstance(key, str) else key if isinstance(key, tuple) else ():
            if name not in known:
                there = ", ".join(sorted(known - {"*"})) or "none"
                raise ParameterError(f"for {what}s {key!r}: there is no type {name!r} in {source}; there are {there}")


def _called(beads: BeadArrays, row, names: list[str] | None, k: int) -> str:
    types = ", ".join(repr(beads.types[bead]) for bead in row)
    return f"types {types}" + (f" ({names[k]!r})" if names is not None else "")


def _along_bonds(beads: BeadArrays, springs: Sequence, given, what: str) -> list:
    """Angles where two bonds meet, or dihedrals along three, as molecules have them."""
    between, width, meet = (bends_between, "three", "two") if what == "angle" else (twists_between, "four", "three")
    bonded = np.concatenate([np.zeros((0, 2), dtype=np.int64), *(bonds.pairs for bonds in springs)])
    if isinstance(given, Mapping):
        if any(isinstance(key, str) for key in given):
            raise ParameterError(f"{beads.source} has no names of {what} types; the keys of {what}s must be {width} bead types")
        _check_keys(given, set(beads.types) | {"*"} | set(beads.type_names or ()), beads.source, what)
    found: Sequence = between(beads.types, bonded, given)  # type: ignore[operator]
    if not found:
        raise ParameterError(f"{beads.source} lists no {what}s, and no {meet} of its bonds meet at types that `{what}s` names")
    return many_terms(np.array([entry[:-1] for entry in found], dtype=np.int64), [entry[-1] for entry in found])
