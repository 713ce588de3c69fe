"""Topology files and trajectories in which every bead keeps its own name, mass, charge and bonds.

A PDB file has no masses: readers take them from chemical elements guessed from names, so that a bead ``B`` becomes boron and a bead ``A``
a massless virtual site.  mdtraj's own PSF reader also drops the masses of the file, and takes the nearest element.  Hence PSF files with
:func:`load_topology`, which gives each bead its own element object.  Names agree in OpenMM's Topology, in PSF files and in mdtraj: atoms
are named after their types, residues are molecules, and there is one chain.

Lengths are in nm here and in mdtraj; DCD files hold float32 angstrom, so one reduced length is 10 in the file and 1 again after loading.
"""

from __future__ import annotations

import functools
import os
from collections.abc import Sequence
from itertools import count
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from openmm import app, unit

from ..base.errors import ParameterError
from ..base.garbage import nothing_collected
from ..base.units import whole_number
from ..model.box import box_vectors
from .psf import SEGMENT, Beads, checked_bonds, molecule_numbers, read_psf, residue_names, runs, write_psf as write_psf

if TYPE_CHECKING:
    import mdtraj

#: Symbol of the elements made here: mdtraj's symbol for "no element", so that no file written from them names a chemical element.
SYMBOL = "VS"
#: Name of the single chain in all topologies made here.
CHAIN = "A"


# -- OpenMM --------------------------------------------------------------------------------------------------------------------
def short_names(names: Sequence[str], width: int) -> dict[str, str]:
    """Unique short names of at most ``width`` characters, for files with columns.

    Names that fit stay as they are, if they are printable ASCII without blanks.  Others are truncated, and numbered in order of appearance
    if the truncated name is taken.

    Returns a dictionary from each distinct name to its short name.

    Examples
    --------
    >>> short_names(["W", "solvent", "solvate", "Na+"], 4)
    {'W': 'W', 'solvent': 'solv', 'solvate': 'sol1', 'Na+': 'Na+'}
    """
    different = list(dict.fromkeys(str(name) for name in names))
    fits = {name: name for name in different if len(name) <= width and name.isascii() and name.isprintable() and name and " " not in name}
    short, taken, numbers = dict(fits), set(fits), count(1)
    for name in different:
        if name in short:
            continue
        letters = "".join(letter for letter in name if letter.isascii() and letter.isalnum())
        called = letters[:width]
        while not called or called in taken:
            number = str(next(numbers))
            called = letters[: width - len(number)] + number
        short[name] = called
        taken.add(called)
    return {name: short[name] for name in different}


def openmm_topology(names: Sequence[str], molecules=None, bonds=(), box=None, residues: Sequence[str] | None = None) -> app.Topology:
    """OpenMM Topology of beads without elements, for Simulation and all of OpenMM's reporters and file writers.

    Atoms are named after the bead types and residues are molecules, as in PSF files (:func:`write_psf`).  A molecule whose beads are not
    consecutive is several residues with one id.  OpenMM's readers of PDB and mmCIF files merge atoms of equal names in a residue; mdtraj
    reads all of them.  Use :func:`openmm_dpd.outputs.write_pdb` for PDB files: OpenMM's writer truncates names, and mdtraj replaces what
    it writes for no element by a guess from the name.

    Parameters
    ----------
    names : sequence of N str
        Type name of each bead.
    molecules : (N,) array of int, optional
        Molecule numbers, in ``residue.id``.  By default beads connected by bonds are a molecule.
    bonds : (B, 2) array of int
        Bead indices from 0.
    box : (3,) or (3, 3) array of lengths, optional
        Edges or box vectors, nm.
    residues : sequence of N str, optional
        Name of the molecule of each bead; ``MOL`` by default.

    Returns
    -------
    openmm.app.Topology
        One chain; every atom has the element None, which OpenMM writes as ``EP``.
    """
    names = [str(name) for name in names]
    pairs = checked_bonds(bonds, len(names))
    numbers = molecule_numbers(molecules, pairs, len(names))
    called = residue_names(residues, len(names))
    topology = app.Topology()
    chain = topology.addChain(CHAIN)
    atoms = []
    with nothing_collected():  # garbage collection among a million atoms takes longer than making them
        for number, beads in runs(numbers):
            residue = topology.addResidue(called[beads[0]], chain, id=str(number))
            atoms += [topology.addAtom(names[bead], None, residue) for bead in beads]
    for i, j in pairs.tolist():
        topology.addBond(atoms[i], atoms[j])
    vectors = box_vectors(box)
    if vectors is not None:
        topology.setPeriodicBoxVectors(vectors * unit.nanometer)
    return topology


# -- mdtraj --------------------------------------------------------------------------------------------------------------------
#: Elements made so far, by name, mass and charge.
_ELEMENTS: dict[tuple[str, float, float], Any] = {}


@functools.cache
def _element_class() -> type:
    """Class of bead elements; defined on first use, because mdtraj is imported lazily."""
    from mdtraj.core.element import Element

    class BeadElement(Element):
        """An mdtraj element that is not in mdtraj's registry, and has a charge (e)."""

        __slots__ = ()

        def __new__(cls, name: str, mass: float, charge: float):
            # Element's own constructor would add it to the global tables of elements
            return tuple.__new__(cls, (0, name, SYMBOL, mass, 0.0, charge))

        def __reduce__(self):
            return bead_element, (self.name, self.mass, self.charge)

        @property
        def charge(self) -> float:
            """Charge of the bead in elementary charges."""
            return tuple.__getitem__(self, 5)

    return BeadElement


def bead_element(name: str, mass: float, charge: float = 0.0) -> Any:
    """mdtraj element of a bead with mass (Da) and charge (e); equal arguments give the same object, as mdtraj compares by identity."""
    key = (str(name), float(mass), float(charge))
    # setdefault: one object per key, whichever thread comes first
    return _ELEMENTS.get(key) or _ELEMENTS.setdefault(key, _element_class()(*key))


def load_topology(path: str | os.PathLike) -> mdtraj.Topology:
    """mdtraj topology of a PSF file, with its masses and charges.

    ``atom.name`` is the bead's type as written, ``atom.element.mass`` its mass (Da), ``atom.element.charge`` its charge (e).  Each run of
    beads of one molecule is a residue with the name and number (``resSeq``) of the molecule.  Elements are not in mdtraj's registry and
    have the symbol of a virtual site: formats that store symbols instead of masses (PDB, HDF5) lose the masses but never invent an
    element.  For OpenMM use :func:`openmm_topology`, not mdtraj's ``to_openmm``, which knows chemical elements only.

    Parameters
    ----------
    path : path-like
        PSF file.
    """
    return mdtraj_topology(read_psf(path))


def mdtraj_topology(beads: Beads) -> mdtraj.Topology:
    """mdtraj topology from the content of a PSF file (:func:`read_psf`), as :func:`load_topology` describes it."""
    from mdtraj import Topology

    topology = Topology()
    chain = topology.add_chain(CHAIN)
    atoms = []
    masses, charges = beads.masses.tolist(), beads.charges.tolist()
    for number, run in runs(beads.molecules):
        residue = topology.add_residue(beads.residues[run[0]], chain, resSeq=number, segment_id=SEGMENT)
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
        PSF file, or its topology from :func:`load_topology` (saves time with several trajectories).
    stride, atom_indices, frame : optional
        Arguments of ``mdtraj.load``: every ``stride``-th frame, these beads only, this frame only.

    Returns
    -------
    mdtraj.Trajectory
        Coordinates in nm.

    Raises
    ------
    ParameterError
        If the format is not supported, or the numbers of beads differ.
    """
    import mdtraj

    loaders = {".dcd": mdtraj.load_dcd, ".xtc": mdtraj.load_xtc}
    suffix = Path(traj_path).suffix.lower()
    if suffix not in loaders:
        raise ParameterError(f"{traj_path}: a trajectory to load must be a {' or '.join(loaders)} file")
    topology = top_path if isinstance(top_path, mdtraj.Topology) else load_topology(top_path)
    stride = None if stride is None else whole_number(stride, "stride", least=1)
    frame = None if frame is None else whole_number(frame, "the number of a frame", least=0)
    try:
        found = loaders[suffix](os.fspath(traj_path), top=topology, stride=stride, atom_indices=atom_indices, frame=frame)
    except (ValueError, OSError, RuntimeError) as error:
        where = "" if frame is None else f", frame {frame},"
        raise ParameterError(f"{traj_path}{where} cannot be read with a topology of {topology.n_atoms} beads: {error}") from None
    if frame is not None and not found.n_frames:
        raise ParameterError(f"{traj_path} has no frame {frame}")
    return found


def compute_rg(trajectory: mdtraj.Trajectory) -> np.ndarray:
    r"""Radius of gyration (nm) of all beads about their centre of mass, Rg^2 = sum m |r - r_com|^2 / sum m, (frames,).

    ``mdtraj.compute_rg(..., masses)`` weights the squares with the masses but measures distances from the geometric centre, so it returns
    a larger number unless all masses are equal.  Molecules must be whole (``trajectory.atom_slice``, ``make_molecules_whole``).
    """
    masses = bead_masses(trajectory.topology)
    weights = masses / masses.sum()
    positions = trajectory.xyz.astype(np.float64)
    centred = positions - np.einsum("i,fik->fk", weights, positions)[:, None, :]
    return np.sqrt(np.einsum("i,fik,fik->f", weights, centred, centred))


def bead_masses(topology: mdtraj.Topology) -> np.ndarray:
    """Masses (Da) of all atoms of an mdtraj topology, (N,)."""
    return np.array([atom.element.mass for atom in topology.atoms])


def bead_charges(topology: mdtraj.Topology) -> np.ndarray:
    """Charges (e) of all beads of a topology from :func:`load_topology`, (N,)."""
    return np.array([atom.element.charge for atom in topology.atoms])
