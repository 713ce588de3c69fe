"""Topology files and trajectories in which every bead keeps its own name, mass, charge and bonds.

A PDB file has no masses: whoever reads one takes them from chemical elements guessed from names, so that a bead ``B`` becomes boron and a
bead ``A`` a massless virtual site.  mdtraj's own PSF reader throws the masses of the file away as well and takes the nearest element.
Hence the two halves of this module: topologies for OpenMM with names that nothing can read as an element, and PSF files with
:func:`load_topology`, which gives each bead an element object of its own.

Lengths are nm here and in mdtraj; DCD files hold float32 angstrom, so one reduced length is 10 in the file and 1 again after loading.
"""

from __future__ import annotations

import functools
import os
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from openmm import app, unit

from .errors import ParameterError
from .model.scene import box_vectors
from .units import to_md

if TYPE_CHECKING:
    import mdtraj

#: Residue and segment name of all beads.  No reader knows "MOL" as an amino acid, nucleotide, water or solvent.
RESIDUE, SEGMENT = "MOL", "DPD"

#: Symbol of the elements made here: mdtraj's own for "no element", so that no file written from them can name a chemical one.
SYMBOL = "VS"


# -- OpenMM --------------------------------------------------------------------------------------------------------------------
def pdb_names(names: Sequence[str]) -> dict[str, str]:
    """Atom names of at most four characters that no reader takes for an element: ``Q`` and the bead's name.

    No symbol of an element begins with Q, while every other scheme of short names meets one (``A1`` is safe, ``AL`` is aluminium).
    Types whose names do not fit, or begin alike, are numbered in the order in which they appear.

    Returns a dictionary from each different one of the names to its PDB name; one to one.
    """
    short: dict[str, str] = {}
    types = list(dict.fromkeys(str(name) for name in names))
    # names that fit keep their letters, whatever else there is
    for name in types:
        if len(name) <= 3 and name.isascii() and name.isalnum():
            short[name] = "Q" + name
    taken = set(short.values())
    for number, name in enumerate(types, start=1):
        if name in short:
            continue
        letters = "".join(letter for letter in name if letter.isascii() and letter.isalnum())
        candidates = (f"Q{letters[:3]}", *(f"Q{count}" for count in range(number, number + len(types))))
        short[name] = next(candidate for candidate in candidates if len(candidate) > 1 and candidate not in taken)
        taken.add(short[name])
    return {name: short[name] for name in types}


def openmm_topology(names: Sequence[str], molecules=None, bonds=(), box=None) -> app.Topology:
    """Topology of beads without elements, for Simulation and all of OpenMM's reporters and file writers.

    Parameters
    ----------
    names : sequence of N str
        Type name of each bead; the atoms are called by :func:`pdb_names` of these.
    molecules : (N,) array of int, optional
        Molecule numbers, in ``residue.id``.  By default beads connected by bonds are a molecule.  A molecule is a residue if its beads
        have different names, else each of its beads is one: OpenMM's mmCIF reader drops atoms whose names repeat within a residue.
    bonds : (B, 2) array of int
        Bead indices from 0.
    box : (3,) or (3, 3) array of lengths, optional
        Edges or box vectors.

    Returns
    -------
    openmm.app.Topology
        One chain; every atom has the element None, which OpenMM writes as ``EP``.
    """
    names = [str(name) for name in names]
    pairs = _checked_bonds(bonds, len(names))
    numbers = _molecule_numbers(molecules, pairs, len(names))
    short = pdb_names(names)
    topology = app.Topology()
    chain = topology.addChain()
    atoms = []
    for number, beads in _runs(numbers):
        unique = len({names[bead] for bead in beads}) == len(beads)
        for residue_beads in [beads] if unique else [[bead] for bead in beads]:
            residue = topology.addResidue(RESIDUE, chain, id=str(number))
            atoms += [topology.addAtom(short[names[bead]], None, residue) for bead in residue_beads]
    for i, j in pairs.tolist():
        topology.addBond(atoms[i], atoms[j])
    vectors = box_vectors(box)
    if vectors is not None:
        topology.setPeriodicBoxVectors(vectors * unit.nanometer)
    return topology


# -- PSF -----------------------------------------------------------------------------------------------------------------------
@dataclass(frozen=True, eq=False)
class Beads:
    """What a PSF file says: the names, masses (Da), charges (e) and molecule numbers of N beads, and their bonds, (B, 2) from 0."""

    names: list[str]
    masses: np.ndarray
    charges: np.ndarray
    molecules: np.ndarray
    bonds: np.ndarray


def write_psf(path: str | os.PathLike, *, names: Sequence[str], masses, charges=None, molecules=None, bonds=()) -> None:
    """Write a topology file with real masses and charges: PSF in NAMD's variant, whose columns are separated by blanks.

    Read by :func:`load_topology`, mdtraj (which drops the masses), VMD (names of at most 7 characters), MDAnalysis and others.  Fixed
    columns would cut digits, long names and large indices, and readers of CHARMM's extended columns disagree on where they stand.

    Parameters
    ----------
    path : path-like
        File to write; overwritten.
    names : sequence of N str
        Type name of each bead: printable ASCII without blanks.
    masses : (N,) array of masses
        Da, >= 0; all digits are kept.
    charges : (N,) array of charges, optional
        Elementary charges; 0 by default.
    molecules : (N,) array of int, optional
        Molecule numbers, >= 0, become residue numbers.  By default beads connected by bonds are a molecule.
    bonds : (B, 2) array of int
        Bead indices from 0.

    Raises
    ------
    ParameterError
        If the lengths differ, a name cannot be written, a mass is negative, a value is not finite, or a bond names no bead.
    """
    names = [str(name) for name in names]
    count = len(names)
    numbers = {name: k for k, name in enumerate(dict.fromkeys(names), start=1)}
    for name in numbers:
        if not name or not name.isascii() or not name.isprintable() or " " in name:
            raise ParameterError(f"the bead type {name!r} cannot stand in a PSF file; use printable ASCII characters without blanks")
    mass = _per_bead(masses, "mass", "masses", count)
    if np.any(mass < 0):
        raise ParameterError(f"bead {int(np.argmin(mass))} has the mass {mass.min():g}; masses must be >= 0")
    charge = np.zeros(count) if charges is None else _per_bead(charges, "charge", "charges", count)
    pairs = _checked_bonds(bonds, count)
    molecule = _molecule_numbers(molecules, pairs, count)
    # VMD wants at least 50 characters a line
    atom_lines = [
        f"{bead:10d} {SEGMENT:<8s} {resid:<8d} {RESIDUE:<8s} {name:<8s} {numbers[name]:<4d} {q!r:>13s} {m!r:>13s} {0:7d}"
        for bead, (resid, name, q, m) in enumerate(zip(molecule.tolist(), names, charge.tolist(), mass.tolist(), strict=True), start=1)
    ]
    flat = [f" {index:9d}" for index in (pairs + 1).ravel().tolist()]
    bond_lines = ["".join(flat[start : start + 8]) for start in range(0, len(flat), 8)]
    sections = [
        ("NTITLE", 1, [" REMARKS beads of a DPD simulation; masses in Da, charges in e"]),
        ("NATOM", count, atom_lines),
        ("NBOND: bonds", len(pairs), bond_lines),
        *((name, 0, []) for name in ("NTHETA: angles", "NPHI: dihedrals", "NIMPHI: impropers", "NDON: donors", "NACC: acceptors")),
    ]
    with open(path, "w", encoding="ascii", newline="\n") as file:
        file.write("PSF NAMD\n")
        for name, entries, lines in sections:
            file.writelines(f"{line}\n" for line in ("", f"{entries:10d} !{name}", *lines))
        file.write("\n")


def read_psf(path: str | os.PathLike) -> Beads:
    """Read what :func:`write_psf` wrote, or any other PSF file whose columns are separated by blanks.

    Raises
    ------
    ParameterError
        If it is no PSF file or cannot be parsed; the message names file and line.
    """
    with open(path, encoding="ascii", errors="replace") as file:
        lines = file.read().splitlines()
    if not lines or not lines[0].startswith("PSF"):
        raise ParameterError(f"{path} is no PSF file: its first line must begin with PSF")
    start, count = _section(lines, "!NATOM", path)
    names: list[str] = []
    columns = np.zeros((2, count))
    molecules = np.zeros(count, dtype=np.int64)
    for k in range(count):
        try:
            # index, segment, residue number, residue, name, type, charge, mass
            words = lines[start + k].split()
            names.append(words[4])
            molecules[k], columns[0, k], columns[1, k] = int(words[2]), float(words[6]), float(words[7])
        except (IndexError, ValueError):
            raise ParameterError(f"{path}:{start + k + 1}: cannot read bead {k + 1} of {count} from this line") from None
    start, number = _section(lines, "!NBOND", path)
    words = []
    while len(words) < 2 * number and start < len(lines) and lines[start].strip():
        words += lines[start].split()
        start += 1
    try:
        bonds = np.array([int(word) for word in words], dtype=np.int64).reshape(number, 2) - 1
    except ValueError:
        raise ParameterError(f"{path}:{start}: cannot read {number} bonds up to this line") from None
    return Beads(names, columns[1], columns[0], molecules, _checked_bonds(bonds, count))


# -- mdtraj --------------------------------------------------------------------------------------------------------------------
#: Elements made so far.
_ELEMENTS: dict[tuple[str, float, float], Any] = {}


@functools.cache
def _element_class() -> type:
    """Class of the elements made here; made on first use, because mdtraj is imported lazily."""
    from mdtraj.core.element import Element

    class BeadElement(Element):
        """An element of mdtraj's that is not in its registry, with a charge (e) besides."""

        __slots__ = ()

        def __new__(cls, name: str, mass: float, charge: float):
            # Element's own constructor would enter it into the global tables of elements
            return tuple.__new__(cls, (0, name, SYMBOL, mass, 0.0, charge))

        def __reduce__(self):
            return bead_element, (self.name, self.mass, self.charge)

        @property
        def charge(self) -> float:
            """Charge in elementary charges."""
            return tuple.__getitem__(self, 5)

    return BeadElement


def bead_element(name: str, mass: float, charge: float = 0.0) -> Any:
    """mdtraj element of a bead with mass (Da) and charge (e); one object for equal arguments, as mdtraj compares elements by identity."""
    key = (str(name), float(mass), float(charge))
    # setdefault: one object per key, whichever thread comes first
    return _ELEMENTS.get(key) or _ELEMENTS.setdefault(key, _element_class()(*key))


def load_topology(path: str | os.PathLike) -> mdtraj.Topology:
    """mdtraj topology of a PSF file, with the masses and charges that stand in it.

    ``atom.name`` is the bead's type as it was written, ``atom.element.mass`` its mass (Da), ``atom.element.charge`` its charge (e).  Each
    run of beads of one molecule is a residue, whose ``resSeq`` is the molecule number.  Elements are not in mdtraj's registry and have the
    symbol of a virtual site: formats that store symbols instead of masses (PDB, HDF5) lose the masses but never invent an element.  For
    OpenMM use :func:`openmm_topology`, not mdtraj's ``to_openmm``, which knows chemical elements only.

    Parameters
    ----------
    path : path-like
        PSF file.
    """
    from mdtraj import Topology

    beads = read_psf(path)
    topology = Topology()
    chain = topology.add_chain()
    atoms = []
    masses, charges = beads.masses.tolist(), beads.charges.tolist()
    for number, run in _runs(beads.molecules):
        residue = topology.add_residue(RESIDUE, chain, resSeq=number, segment_id=SEGMENT)
        for bead in run:
            name = beads.names[bead]
            atoms.append(topology.add_atom(name, bead_element(name, masses[bead], charges[bead]), residue))
    for i, j in beads.bonds.tolist():
        topology.add_bond(atoms[i], atoms[j])
    return topology


def load(
    traj_path: str | os.PathLike,
    top_path: str | os.PathLike | mdtraj.Topology,
    *,
    stride: int | None = None,
    atom_indices: Sequence[int] | None = None,
    frame: int | None = None,
) -> mdtraj.Trajectory:
    """Load a DCD or XTC trajectory of beads with mdtraj.

    Parameters
    ----------
    traj_path : path-like
        ``.dcd`` or ``.xtc``.
    top_path : path-like or mdtraj.Topology
        PSF file, or what :func:`load_topology` made of it (saves time with several trajectories).
    stride, atom_indices, frame : optional
        As for ``mdtraj.load``: every so many frames, these beads only, this frame only.

    Returns
    -------
    mdtraj.Trajectory
        Coordinates in nm.

    Raises
    ------
    ParameterError
        If the format is another one, or the numbers of beads differ.
    """
    import mdtraj

    loaders = {".dcd": mdtraj.load_dcd, ".xtc": mdtraj.load_xtc}
    suffix = Path(traj_path).suffix.lower()
    if suffix not in loaders:
        raise ParameterError(f"{traj_path}: a trajectory to load must be a {' or '.join(loaders)} file")
    topology = top_path if isinstance(top_path, mdtraj.Topology) else load_topology(top_path)
    try:
        return loaders[suffix](os.fspath(traj_path), top=topology, stride=stride, atom_indices=atom_indices, frame=frame)
    except ValueError as error:
        raise ParameterError(f"{traj_path} cannot be read with a topology of {topology.n_atoms} beads: {error}") from None


def bead_masses(topology: mdtraj.Topology) -> np.ndarray:
    """Masses (Da) of all atoms of an mdtraj topology, (N,)."""
    return np.array([atom.element.mass for atom in topology.atoms])


def bead_charges(topology: mdtraj.Topology) -> np.ndarray:
    """Charges (e) of all beads of a topology from :func:`load_topology`, (N,)."""
    return np.array([atom.element.charge for atom in topology.atoms])


def radius_of_gyration(trajectory: mdtraj.Trajectory) -> np.ndarray:
    r"""Radius of gyration (nm) about the centre of mass, Rg^2 = sum m |r - r_com|^2 / sum m, of all beads of a trajectory, (frames,).

    ``mdtraj.compute_rg(..., masses)`` weighs the squares with the masses but takes the distances from the geometric centre, which gives
    another, larger number unless all masses are equal.  Molecules must be whole (``trajectory.atom_slice``, ``make_molecules_whole``).
    """
    masses = bead_masses(trajectory.topology)
    weights = masses / masses.sum()
    positions = trajectory.xyz.astype(np.float64)
    centred = positions - np.einsum("i,fik->fk", weights, positions)[:, None, :]
    return np.sqrt(np.einsum("i,fik,fik->f", weights, centred, centred))


# -- helpers -------------------------------------------------------------------------------------------------------------------
def _per_bead(values, dimension: str, name: str, count: int) -> np.ndarray:
    array = np.asarray(to_md(values, dimension, name))
    if array.shape != (count,):
        raise ParameterError(f"{name} must have one entry for each of the {count} names, not shape {array.shape}")
    return array


def _checked_bonds(bonds, count: int) -> np.ndarray:
    """Bonds as a (B, 2) array of indices in range."""
    try:
        array = np.asarray(bonds)
    except ValueError:
        raise ParameterError("bonds must be pairs of bead indices; their entries differ in length") from None
    if array.size == 0:
        return np.zeros((0, 2), dtype=np.int64)
    if array.ndim != 2 or array.shape[1] != 2 or not np.issubdtype(array.dtype, np.integer):
        raise ParameterError(f"bonds must be pairs of bead indices, not an array of {array.dtype} of shape {array.shape}")
    bad = np.flatnonzero((array.min(axis=1) < 0) | (array.max(axis=1) >= count) | (array[:, 0] == array[:, 1]))
    if len(bad):
        raise ParameterError(f"bond {bad[0]} is {array[bad[0]].tolist()}; it must join two different beads of 0 to {count - 1}")
    return array.astype(np.int64)


def _molecule_numbers(molecules, bonds: np.ndarray, count: int) -> np.ndarray:
    """Molecule numbers, (N,); where none are given, those of the beads connected by bonds, counted from 1."""
    if molecules is None:
        from scipy.sparse import coo_array
        from scipy.sparse.csgraph import connected_components

        if not len(bonds):
            return np.arange(1, count + 1)
        joined = coo_array((np.ones(len(bonds), dtype=np.int8), (bonds[:, 0], bonds[:, 1])), shape=(count, count))
        label = connected_components(joined, directed=False)[1]
        # numbered in the order of their first beads
        _, first, position = np.unique(label, return_index=True, return_inverse=True)
        return (np.argsort(np.argsort(first)) + 1)[position]
    array = np.asarray(molecules)
    if array.shape != (count,) or not np.issubdtype(array.dtype, np.integer):
        raise ParameterError(f"molecules must be one integer for each of the {count} names, not {array.dtype} of shape {array.shape}")
    if count and array.min() < 0:
        raise ParameterError(f"bead {int(np.argmin(array))} has the molecule number {array.min()}; they must be >= 0")
    return array.astype(np.int64)


def _runs(numbers: np.ndarray) -> Iterator[tuple[int, range]]:
    """Runs of neighbours with the same number: the number and the indices."""
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
