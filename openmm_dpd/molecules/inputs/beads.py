"""Beads of any source as arrays, their bonded terms, and their conversion to a Scene."""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from ...base.errors import ParameterError, require, what_is
from ...base.units import known_under, to_md
from ...io.psf import checked_bonds
from ...model.scene import Scene
from ..molecule import bends_between, by_types, twists_between
from ..terms import AnyBend, AnySpring, AnyTwist, many_terms


@dataclass(frozen=True, eq=False)
class BeadArrays:
    """N beads from a file or another program; nm, Da, ps, elementary charges.

    Attributes
    ----------
    types : list of N str
        Type of each bead.
    positions : (N, 3) array or None
    source : str
        Name of the source in errors.
    masses : (N,) array, mapping of types to masses, or None
        Masses of the beads or of the types.
    box : (3, 3) array or None
        Box vectors.
    velocities : (N, 3) array or None
    charges : (N,) array or None
    molecules : (N,) array of int or None
        Molecule numbers.
    residues : list of N str or None
        Name of the molecule of each bead.
    bonds : (B, 2) array of int
        Bead indices from 0.
    bond_names : list of B str or None
        Type name of each bond, if the source has such names.
    angles : (K, 3) array of int
        Bead indices from 0, with the vertex in the middle.
    angle_names : list of K str or None
        Type name of each angle, if the source has such names.
    dihedrals : (D, 4) array of int
        Bead indices from 0, along three bonds.
    dihedral_names : list of D str or None
        Type name of each dihedral, if the source has such names.
    type_names : list of str or None
        All types in order, including those without beads; by default in the order of the beads.
    beyond : mapping of str to int
        Features of the source that are not taken over (impropers without coefficients, rigid bodies, ...), and their numbers.
    """

    types: list[str]
    positions: np.ndarray | None
    source: str
    masses: np.ndarray | Mapping[str, float] | None = None
    box: np.ndarray | None = None
    velocities: np.ndarray | None = None
    charges: np.ndarray | None = None
    molecules: np.ndarray | None = None
    residues: list[str] | None = None
    bonds: np.ndarray = field(default_factory=lambda: np.zeros((0, 2), dtype=np.int64))
    bond_names: list[str] | None = None
    angles: np.ndarray = field(default_factory=lambda: np.zeros((0, 3), dtype=np.int64))
    angle_names: list[str] | None = None
    dihedrals: np.ndarray = field(default_factory=lambda: np.zeros((0, 4), dtype=np.int64))
    dihedral_names: list[str] | None = None
    type_names: list[str] | None = None
    beyond: Mapping[str, int] = field(default_factory=dict)


def named_types(atoms: Iterable, typing, source: str) -> list[str]:
    """Bead type of each atom of a topology: its name (``typing`` None), a function of the atom, or a mapping from atom names, residue names
    or, with precedence, pairs ``(residue, atom)``.  ParameterError if an atom gets no type, two different ones, or no string."""
    if typing is not None and not isinstance(typing, Mapping) and not callable(typing):
        raise ParameterError(
            f"typing must be a function from an atom to a bead type, or a mapping from names to types, not {what_is(typing)}"
        )
    found, known = [], {}
    for atom in atoms:
        if typing is None:
            name = atom.name
        elif isinstance(typing, Mapping):
            key = (atom.residue.name, atom.name)
            if key not in known:
                known[key] = _mapped(typing, *key, source)
            name = known[key]
        else:
            name = typing(atom)
        if not isinstance(name, str) or not name:
            where = f"atom {atom.name!r} (index {atom.index}) of residue {atom.residue.name!r}"
            raise ParameterError(f"{source}: typing gives {what_is(name)} for {where}; it must be the name of a bead type")
        found.append(name)
    return found


def _mapped(typing: Mapping, residue: str, atom: str, source: str) -> object:
    """Type of an atom in a mapping; ParameterError if there is none, or atom and residue have different ones."""
    if (residue, atom) in typing:
        return typing[residue, atom]
    found = {typing[name] for name in (atom, residue) if name in typing}
    if len(found) > 1:
        raise ParameterError(
            f"{source}: typing has {typing[atom]!r} for atoms {atom!r} and {typing[residue]!r} for residues {residue!r}; "
            f"add the key {(residue, atom)!r} to choose"
        )
    if not found:
        raise ParameterError(f"{source}: typing has no bead type for atom {atom!r} of residue {residue!r}")
    return found.pop()


def scene_from_beads(
    beads: BeadArrays,
    *,
    pairs,
    kT,
    masses=None,
    bonds=None,
    angles=None,
    dihedrals=None,
    positions=None,
    box=None,
    periodic: bool = True,
    velocities=None,
    charges=None,
    leave_out: Sequence[str] = (),
    **options,
) -> Scene:
    """Scene from beads of any source; all other functions of this module call it.

    Parameters
    ----------
    beads : BeadArrays
        Beads of the source.
    pairs, kT
        Pair coefficients and thermal energy, see :class:`openmm_dpd.Scene`; files do not have them.
    masses : mass, or mapping of types to masses, optional
        One mass for all types, or the mass of each type; by default those of the source.
    bonds : spring or mapping, optional
        Springs of the source's bonds: one for all, such as :class:`~openmm_dpd.molecules.Spring`; a mapping from the types of two beads,
        ``{("*", "*"): Spring(...), ("A", "B"): Spring(...)}``, in which later entries take precedence; or, if the source names bond types
        (GSD and data files), a mapping from these names, ``{"A-B": Spring(...)}``.  A sequence of :class:`openmm_dpd.HarmonicBonds` and
        the like replaces the bonds of the source.
    angles : bend or mapping, optional
        Bends of the source's angles: one, or a mapping from three types or from names.  If the source lists angles, each needs a bend; if
        not, bends act between bonds as in :func:`openmm_dpd.molecules.join`.
    dihedrals : twist or mapping, optional
        Twists of the source's dihedrals: one, or a mapping from four types or from names.  If it lists none, twists act along bonds.
    positions, velocities, charges : arrays, optional
        Replacements of the source's arrays, with units or in nm, nm/ps and e.
    box : (3,) or (3, 3) array of lengths, optional
        Replacement of the source's box.
    periodic : bool, default True
        False: no periodic box, even if the source has one.
    leave_out : sequence of str, optional
        What to leave out: ``"bonds"``, ``"angles"``, ``"dihedrals"``, and features that are not taken over, by their names in the error
        message; ``impropers`` among the options replaces those.
    **options
        Further arguments of :class:`openmm_dpd.Scene`: ``bonded_factors``, ``electrostatics``, ``mobile``, ``molecules``, ...

    Raises
    ------
    ParameterError
        If something is missing (a mass, the spring of two types, a box, positions), the source has features that are not taken over,
        a mapping has an unknown type, or the Scene refuses a value.
    """
    if not len(beads.types):
        raise ParameterError(f"{beads.source} has no beads")
    left_out = _left_out(beads, leave_out)
    for name, given in (("bonds", bonds), ("angles", angles), ("dihedrals", dihedrals)):
        if name in left_out and given is not None:
            raise ParameterError(f"{name} are both given and in leave_out; drop one of the two")
    types = list(dict.fromkeys(beads.types))
    by_type, single = _masses(beads, types, masses)
    springs: Sequence = () if "bonds" in left_out else scene_terms(beads, bonds, "bond")
    bends: Sequence = () if "angles" in left_out else scene_terms(beads, angles, "angle", springs)
    twists: Sequence = () if "dihedrals" in left_out else scene_terms(beads, dihedrals, "dihedral", springs)
    return Scene(
        masses=by_type,
        types=beads.types,
        positions=_given(positions, beads.positions, "positions", beads.source),
        pairs=pairs,
        kT=kT,
        box=_box(beads, box, periodic),
        velocities=beads.velocities if velocities is None else velocities,
        bead_masses=single,
        charges=beads.charges if charges is None else charges,
        bonds=springs,
        angles=bends,
        dihedrals=twists,
        **{"molecules": beads.molecules, "residues": beads.residues, **options},
    )


def _left_out(beads: BeadArrays, leave_out: Sequence[str]) -> set[str]:
    """Names in ``leave_out``; ParameterError if one is unknown, or a feature that is not taken over is missing there."""
    if isinstance(leave_out, str) or not isinstance(leave_out, Iterable):
        raise ParameterError(f"leave_out must be a sequence of names, such as ('angles',), not {what_is(leave_out)}")
    left = set(leave_out)
    unknown = sorted(map(str, left - {"bonds", "angles", "dihedrals", *beads.beyond}))
    if unknown:
        there = ", ".join(["bonds", "angles", "dihedrals", *beads.beyond])
        raise ParameterError(f"leave_out names {', '.join(unknown)}; what can be left out of {beads.source} is {there}")
    for name, count in beads.beyond.items():
        if name not in left:
            raise ParameterError(f"{beads.source} has {count} {name}, which are not taken over; leave_out=({name!r},) ignores them")
    return left


def _given(value, found, name: str, source: str):
    if value is None and found is None:
        raise ParameterError(f"{source} has no {name}; give {name}=...")
    return found if value is None else value


def _box(beads: BeadArrays, box, periodic: bool):
    if not periodic:
        if box is not None:
            raise ParameterError("a box is given and periodic=False; give one of them")
        return None
    if box is None and beads.box is None:
        raise ParameterError(f"{beads.source} has no periodic box; give box=[...], or periodic=False for none")
    return beads.box if box is None else box


def _masses(beads: BeadArrays, types: list[str], masses) -> tuple[dict[str, Any], Any]:
    """Masses by type, and the masses of all beads if those of one type differ, else None."""
    order = list(dict.fromkeys([*(beads.type_names or ()), *types]))
    if masses is None and isinstance(beads.masses, Mapping):
        masses = beads.masses
    if isinstance(masses, Mapping):
        missing = [name for name in types if name not in masses]
        if missing:
            raise ParameterError(f"masses has no mass of the bead type {what_is(missing[0])}; it has {', '.join(map(str, masses))}")
        return {name: masses[name] for name in [*(n for n in order if n in masses), *(n for n in masses if n not in order)]}, None
    if masses is not None:
        return dict.fromkeys(order, masses), None
    if beads.masses is None:
        raise ParameterError(f"{beads.source} has no masses; give masses=... (Da), one for all types or {{type: mass}}")
    single = np.asarray(to_md(beads.masses, "mass", f"the masses of {beads.source}"))
    if single.shape != (len(beads.types),):
        raise ParameterError(f"{beads.source} has {len(beads.types)} types of beads, but masses of shape {single.shape}")
    bad = np.flatnonzero(~(single > 0))
    if len(bad):
        raise ParameterError(
            f"{beads.source} has the mass {single[bad[0]]:g} for bead {bad[0]} of type {beads.types[bad[0]]!r}; give masses={{type: mass}}"
        )
    first = {name: k for k, name in reversed(list(enumerate(beads.types)))}
    by_type = {name: float(single[first[name]]) for name in order if name in first}
    same = np.array_equal(single, [by_type[name] for name in beads.types])
    return by_type, None if same else single


def scene_terms(beads: BeadArrays, given, what: str, bonds: Sequence = ()) -> Sequence:
    """Bonds, angles or dihedrals (``what``, in the singular) of a Scene: the given ones; those of the source, with the given springs, bends
    or twists; or, if the source has no angles or dihedrals, those between the bonds of the Scene."""
    if isinstance(given, Sequence) and not isinstance(given, str):
        return given
    rows = getattr(beads, f"{what}s")
    if len(rows) or given is None or what == "bond":
        return _terms(beads, rows, getattr(beads, f"{what}_names"), given, what)
    return _along_bonds(beads, bonds, given, what)


#: Name of a bonded term, base class of its kinds, and number of beads.
_KINDS: dict[str, tuple[str, type, int]] = {
    "bond": ("spring", AnySpring, 2),
    "angle": ("bend", AnyBend, 3),
    "dihedral": ("twist", AnyTwist, 4),
}


def _terms(beads: BeadArrays, rows: np.ndarray, names: list[str] | None, given, what: str) -> list:
    """Bonds, angles or dihedrals of a Scene, one object for each kind of spring, bend or twist."""
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
            f"give {what}s={{...}}, or leave_out=({what + 's'!r},) to ignore them"
        )
    if not len(rows):
        raise ParameterError(f"{beads.source} has no {what}s for the given {what}s to act on; give a sequence of {what}s with their beads")
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
    require(found, kind | None, f"the {term} for {key!r} must be one of {', '.join(known_under(kind))}")
    return found


def _check_keys(given: Mapping, known: set[str], source: str, what: str) -> None:
    """Raise ParameterError if a mapping has an unknown type, since its entry would have no effect."""
    for key in given:
        for name in (key,) if isinstance(key, str) else key if isinstance(key, tuple) else ():
            if name not in known:
                there = ", ".join(sorted(known - {"*"})) or "none"
                raise ParameterError(f"for {what}s {key!r}: there is no type {name!r} in {source}; there are {there}")


def _called(beads: BeadArrays, row, names: list[str] | None, k: int) -> str:
    types = ", ".join(repr(beads.types[bead]) for bead in row)
    return f"types {types}" + (f" ({names[k]!r})" if names is not None else "")


def _along_bonds(beads: BeadArrays, springs: Sequence, given, what: str) -> list:
    """Angles between two bonds that meet, or dihedrals along three, by the rules of :func:`openmm_dpd.molecules.join`."""
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
