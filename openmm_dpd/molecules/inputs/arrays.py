"""Beads of any source as arrays, and how they are called."""

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field

import numpy as np

from ...base.errors import ParameterError, what_is


@dataclass(frozen=True, eq=False)
class BeadArrays:
    """N beads as a file or another program has them; nm, Da, ps, elementary charges.

    Attributes
    ----------
    types : list of N str
        Type of each bead.
    positions : (N, 3) array or None
    source : str
        What they were read from, for errors.
    masses : (N,) array, mapping of types to masses, or None
        Masses of the beads, or of the types.
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
        Type of each bond, where the source has such names.
    angles : (K, 3) array of int
        Bead indices from 0, the vertex in the middle.
    angle_names : list of K str or None
        Type of each angle, where the source has such names.
    dihedrals : (D, 4) array of int
        Bead indices from 0, along three bonds.
    dihedral_names : list of D str or None
        Type of each dihedral, where the source has such names.
    type_names : list of str or None
        All types in their order, which may be more than there are beads of; by default in the order of the beads.
    beyond : mapping of str to int
        What the source has and a Scene has not (impropers, rigid bodies, ...), and how many.
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
    """Type of each atom (with ``name``, ``index``, ``residue.name``) of an OpenMM or mdtraj topology.  ``typing`` is None: the names of the
    atoms; a mapping that has names of atoms, names of residues, or pairs ``(residue, atom)``, which come first; or a function of the atom.
    ParameterError if an atom gets no type, two different ones, or one that is no text."""
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
    if (residue, atom) in typing:
        return typing[residue, atom]
    found = {typing[name] for name in (atom, residue) if name in typing}
    if len(found) > 1:
        raise ParameterError(
            f"{source}: typing has {typing[atom]!r} for atoms {atom!r} and {typing[residue]!r} for residues {residue!r}; "
            f"say which with the key {(residue, atom)!r}"
        )
    if not found:
        raise ParameterError(f"{source}: typing has no bead type for atom {atom!r} of residue {residue!r}")
    return found.pop()
