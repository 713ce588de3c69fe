"""The beads of a deck as arrays in the order of their ids."""

from __future__ import annotations

from dataclasses import dataclass, field, fields

import numpy as np


def _empty(*shape: int, dtype: type = np.float64):
    return field(default_factory=lambda: np.zeros(shape, dtype=dtype))


@dataclass
class Atoms:
    """Beads, sorted by id.  Positions and velocities are in the deck's units."""

    ids: np.ndarray = _empty(0, dtype=np.int64)  #: (N,) ids as in the deck, increasing, not necessarily consecutive
    types: np.ndarray = _empty(0, dtype=np.int64)  #: (N,) types, counted from 1
    #: (N, 3) in the deck's unit of length; beads moved by ``set`` may lie outside the box until the next run.
    positions: np.ndarray = _empty(0, 3)
    images: np.ndarray = _empty(0, 3, dtype=np.int64)  #: (N, 3) image flags: number of boxes crossed along each box vector
    velocities: np.ndarray = _empty(0, 3)  #: (N, 3) in the deck's units
    charges: np.ndarray = _empty(0)  #: (N,) elementary charges
    molecules: np.ndarray = _empty(0, dtype=np.int64)  #: (N,) molecule ids; 0 means none
    thetas: np.ndarray = _empty(0)  #: (N,) internal temperatures of ``atom_style dpd``, in the deck's units
    #: (N,) internal energies of ``atom_style dpd``, kJ/mol: from conduction, and from friction and noise.
    u_cond: np.ndarray = _empty(0)
    u_mech: np.ndarray = _empty(0)
    #: (N,) temperatures and heat capacities of ``atom_style edpd``, in the deck's units.
    temperatures: np.ndarray = _empty(0)
    capacities: np.ndarray = _empty(0)
    concentrations: np.ndarray = _empty(0, 0)  #: (N, K) concentrations of ``atom_style tdpd``
    densities: np.ndarray = _empty(0)  #: (N,) local densities of ``atom_style mdpd``, in the deck's units
    #: (N,) of ``atom_style sphere``: diameters, 0 for points, and densities, which are the masses of points; in the deck's units.
    diameters: np.ndarray = _empty(0)
    solids: np.ndarray = _empty(0)
    #: (N,) position of each bead in LAMMPS's memory before the first run, which is the order of new ids after ``delete_atoms``.
    slots: np.ndarray = _empty(0, dtype=np.int64)

    def __len__(self) -> int:
        return len(self.ids)

    @classmethod
    def new(cls, ids: np.ndarray, types: np.ndarray, positions: np.ndarray, n_species: int = 0) -> Atoms:
        """Create beads at rest without images, charges or molecules, with LAMMPS's temperatures (1), sizes and so on."""
        n = len(ids)
        atoms = cls(concentrations=np.zeros((0, n_species)))
        for item in fields(cls):
            empty = getattr(atoms, item.name)
            setattr(atoms, item.name, np.zeros((n, *empty.shape[1:]), dtype=empty.dtype))
        atoms.ids[:], atoms.types[:], atoms.positions[:], atoms.slots[:] = ids, types, positions, np.arange(n)
        atoms.temperatures[:], atoms.capacities[:] = 1.0, 1e5
        atoms.diameters[:] = atoms.solids[:] = 1.0
        return atoms

    @property
    def volumes(self) -> np.ndarray:
        """(N,) volumes of the beads of ``atom_style sphere``, 1 for points."""
        return np.where(self.diameters > 0, np.pi / 6 * self.diameters**3, 1.0)

    def append(self, other: Atoms) -> None:
        """Append beads; their ids must be larger than all present ids."""
        other.slots = other.slots + len(self)
        for item in fields(self):
            setattr(self, item.name, np.concatenate([getattr(self, item.name), getattr(other, item.name)]))

    def take(self, indices: np.ndarray) -> None:
        """Keep only these beads, in this order."""
        for item in fields(self):
            setattr(self, item.name, getattr(self, item.name)[indices])

    def delete(self, doomed: np.ndarray, by_slots: bool = False) -> np.ndarray:
        """Delete beads, and return the indices of the others, in the order of their slots if asked for.  As in LAMMPS the last bead moves
        into the slot of each deleted one."""
        places = np.argsort(self.slots).tolist()
        slot = 0
        while slot < len(places):
            if doomed[places[slot]]:
                last = places.pop()
                if slot < len(places):
                    places[slot] = last
            else:
                slot += 1
        self.slots[places] = np.arange(len(places))
        kept = np.flatnonzero(~doomed)
        kept = kept[np.argsort(self.slots[kept])] if by_slots else kept
        self.take(kept)
        return kept

    def index_of(self, ids: np.ndarray) -> np.ndarray:
        """Indices of beads by id.  KeyError with the first id that does not exist."""
        ids = np.asarray(ids, dtype=np.int64)
        # a value that is not an id is appended, so that every index has something to compare with
        found = np.searchsorted(self.ids, ids)
        missing = np.append(self.ids, np.iinfo(np.int64).min)[found] != ids
        if missing.any():
            raise KeyError(int(ids[np.argmax(missing)]))
        return found
