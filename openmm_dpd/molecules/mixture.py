"""Packed molecules: their beads, bonds, angles and dihedrals, ready for a Scene."""

from __future__ import annotations

import os
import warnings
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from ..base.errors import ParameterError, what_is
from ..io.trajectory import write_psf
from ..model.angles import Angles, Dihedrals
from ..model.bonds import Bonds
from ..model.electrostatics import NO_ELECTROSTATICS
from ..model.scene import Scene
from .molecule import Molecule
from .terms import many_terms


@dataclass(frozen=True, eq=False)
class Mixture:
    """Molecules in a box, made by :func:`openmm_dpd.molecules.pack`.

    Attributes
    ----------
    kinds : tuple of (Molecule, int)
        Kinds of molecules and the number of each, in the order of their beads.
    positions : (N, 3) array
        Positions, nm; molecules are whole and may extend beyond the box.
    box : (3, 3) array
        Box vectors.
    seed : int
        Seed of the random numbers.
    """

    kinds: tuple[tuple[Molecule, int], ...]
    positions: np.ndarray
    box: np.ndarray
    seed: int

    def __repr__(self) -> str:
        molecules = sum(count for _, count in self.kinds)
        return f"<Mixture of {molecules} molecules of {len(self.kinds)} kinds, {self.n_beads} beads, seed {self.seed}>"

    @classmethod
    def of(cls, groups: Sequence[tuple[Molecule, np.ndarray]], box: np.ndarray, seed: int) -> Mixture:
        """Mixture from the positions of the molecules of each kind, (count, n, 3)."""
        if not groups:
            raise ParameterError("there is nothing to pack: give molecules or a solvent")
        kinds = tuple((molecule, len(beads)) for molecule, beads in groups)
        positions = np.concatenate([beads.reshape(-1, 3) for _, beads in groups])
        return cls(kinds, positions, box, seed)

    # -- beads -----------------------------------------------------------------------------------------------------------------
    @property
    def n_beads(self) -> int:
        """Number of beads."""
        return len(self.positions)

    @property
    def density(self) -> float:
        """Beads per nm^3."""
        return self.n_beads / float(np.prod(np.diag(self.box)))

    @property
    def types(self) -> list[str]:
        """Type of each bead."""
        return [name for molecule, count in self.kinds for name in molecule.types * count]

    @property
    def charges(self) -> np.ndarray | None:
        """Charge of each bead in elementary charges, (N,); None if no molecule has charges."""
        if all(molecule.charges is None for molecule, _ in self.kinds):
            return None
        return np.concatenate([np.tile(molecule.charges or (0.0,) * molecule.n_beads, count) for molecule, count in self.kinds])

    @property
    def molecules(self) -> np.ndarray:
        """Number of the molecule that each bead is in, from 1, (N,)."""
        sizes = [molecule.n_beads for molecule, count in self.kinds for _ in range(count)]
        return np.repeat(np.arange(1, len(sizes) + 1), sizes)

    @property
    def residues(self) -> list[str]:
        """Name of the molecule of each bead."""
        return [name for molecule, count in self.kinds for name in [molecule.name] * (molecule.n_beads * count)]

    def count(self, molecule: Molecule | str) -> int:
        """Number of molecules of this kind or name."""
        return len(self.beads(molecule))

    def beads(self, molecule: Molecule | str) -> np.ndarray:
        """Bead indices of all molecules of this kind or name, (count, n)."""
        start, found, meant = 0, [], set()
        for kind, count in self.kinds:
            if molecule in (kind, kind.name):
                found.append(start + np.arange(count * kind.n_beads).reshape(count, kind.n_beads))
                meant.add(kind)
            start += count * kind.n_beads
        if len(meant) > 1:
            raise ParameterError(
                f"{len(meant)} kinds of molecules have the name {what_is(molecule)}; give the molecule itself, or rename them"
            )
        if found:
            return np.concatenate(found)
        known = ", ".join(kind.name for kind, _ in self.kinds)
        raise ParameterError(f"there is no molecule {what_is(getattr(molecule, 'name', molecule))} in this mixture; it has {known}")

    # -- bonds, angles and dihedrals -------------------------------------------------------------------------------------------
    @property
    def bonds(self) -> list[Bonds]:
        """Bonds of all molecules for a Scene, one object for each kind of spring."""
        return self._terms("bonds", 2)

    @property
    def angles(self) -> list[Angles]:
        """Angles of all molecules for a Scene, one object for each kind of bend."""
        return self._terms("angles", 3)

    @property
    def dihedrals(self) -> list[Dihedrals]:
        """Dihedrals of all molecules for a Scene, one object for each kind of twist."""
        return self._terms("dihedrals", 4)

    @property
    def bond_pairs(self) -> np.ndarray:
        """Bead indices of all bonds, (B, 2)."""
        return np.concatenate([group.pairs for group in self.bonds] or [np.zeros((0, 2), dtype=np.int64)])

    @property
    def angle_triples(self) -> np.ndarray:
        """Bead indices of all angles, (K, 3)."""
        return np.concatenate([group.triples for group in self.angles] or [np.zeros((0, 3), dtype=np.int64)])

    @property
    def dihedral_quads(self) -> np.ndarray:
        """Bead indices of all dihedrals, (K, 4)."""
        return np.concatenate([group.quads for group in self.dihedrals] or [np.zeros((0, 4), dtype=np.int64)])

    def _terms(self, what: str, width: int) -> list:
        """Bonds, angles or dihedrals (``what``) of all molecules for a Scene."""
        beads, terms, start = [np.zeros((0, width), np.int64)], [], 0
        for molecule, count in self.kinds:
            first = start + molecule.n_beads * np.arange(count)
            start += molecule.n_beads * count
            local = np.array([entry[:-1] for entry in getattr(molecule, what)], np.int64).reshape(-1, width)
            beads.append((first[:, None, None] + local).reshape(-1, width))
            terms += [entry[-1] for entry in getattr(molecule, what)] * count
        return many_terms(np.concatenate(beads), terms)

    # -- out -------------------------------------------------------------------------------------------------------------------
    def scene(self, *, pairs, kT, masses: float | Mapping[str, float] = 1.0, **options) -> Scene:
        """Scene of this mixture.

        Parameters
        ----------
        pairs, kT
            Pair coefficients and thermal energy, see :class:`openmm_dpd.Scene`.
        masses : mass, or mapping of types to masses
            One mass for all types, or the mass of each type.
        **options
            Further arguments of :class:`openmm_dpd.Scene`: ``bonded_factors``, ``electrostatics``, ``mobile``, ...  There is a warning if
            beads are charged and ``electrostatics`` is missing.
        """
        types, charges = self.types, self.charges
        if charges is not None and charges.any() and options.get("electrostatics") is None:
            warnings.warn(NO_ELECTROSTATICS.format(np.count_nonzero(charges)), UserWarning, stacklevel=2)
        if not isinstance(masses, Mapping):
            masses = dict.fromkeys(dict.fromkeys(types), masses)
        return Scene(
            masses=masses,
            types=types,
            positions=self.positions,
            pairs=pairs,
            kT=kT,
            box=self.box,
            charges=charges,
            bonds=self.bonds,
            angles=self.angles,
            dihedrals=self.dihedrals,
            molecules=self.molecules,
            residues=self.residues,
            **options,
        )

    def write_psf(self, path: str | os.PathLike, masses=1.0) -> None:
        """Write a PSF topology file: names, masses, charges, molecules as residues, bonds, angles and dihedrals.

        Parameters
        ----------
        path : path-like
            File to write; overwritten.
        masses : mass, mapping of types to masses, or (N,) array of masses
            Masses of the beads, Da.
        """
        types = self.types
        if isinstance(masses, Mapping):
            missing = [name for name in dict.fromkeys(types) if name not in masses]
            if missing:
                raise ParameterError(f"masses has no mass of the bead type {what_is(missing[0])}; it has {', '.join(map(str, masses))}")
            masses = [masses[name] for name in types]
        write_psf(
            path,
            names=types,
            masses=masses if np.ndim(masses) else [masses] * len(types),
            charges=self.charges,
            molecules=self.molecules,
            residues=self.residues,
            bonds=self.bond_pairs,
            angles=self.angle_triples,
            dihedrals=self.dihedral_quads,
        )
