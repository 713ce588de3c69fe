"""PDB files of beads: names that are those of the PSF file and the Topology, elements that nobody guesses, all bonds."""

import os

import numpy as np

from ..base.errors import ParameterError
from ..base.files import write_whole
from .psf import SEGMENT, molecule_numbers, residue_names
from .snapshot import Snapshot
from .trajectory import CHAIN, SYMBOL, short_names

#: Serial numbers have five digits.
_MOST_BEADS = 99_999


def write_pdb(path: str | os.PathLike, source, *, state=None) -> None:
    """Write one frame as a PDB file: names, molecules as residues, the box, and CONECT records of all bonds.

    Every bead is a HETATM record with the element ``VS``, a virtual site for mdtraj, so that no reader takes a bead ``B`` for boron
    (OpenMM: ``app.PDBFile(path, extraParticleIdentifier="VS")``).  Names of beads longer than four characters, and of molecules longer
    than three, are shortened (:func:`openmm_dpd.io.trajectory.short_names`), which REMARK records list.  Molecule numbers are counted
    modulo 10,000.  mdtraj reads all of this back; OpenMM's own reader drops beads of equal names within a molecule.  Angles and dihedrals
    have no place in this format.

    Parameters
    ----------
    path : path-like
        Overwritten.
    source : Scene, or what :func:`openmm_dpd.build` returned
    state : openmm.State, optional
        Positions and box of a run; by default those of the start.

    Raises
    ------
    ParameterError
        For more than 99,999 beads, and coordinates that do not fit into the columns (-99.9999 to 999.9999 nm).
    OutputError
        If the file cannot be written; one that was there is kept.
    """
    write_whole(path, pdb_text(Snapshot.of(source, state)), "the PDB file")


def pdb_text(now: Snapshot) -> str:
    """What :func:`write_pdb` writes."""
    scene = now.scene
    if scene.n_beads > _MOST_BEADS:
        raise ParameterError(f"a PDB file holds up to {_MOST_BEADS} beads, and there are {scene.n_beads}; write PSF and DCD, or GSD")
    x = np.round(now.positions * 10, 3) + 0.0
    outside = np.argwhere((x < -999.9994) | (x > 9999.9994))
    if len(outside):
        bead, axis = outside[0].tolist()
        raise ParameterError(f"bead {bead} is at {'xyz'[axis]} = {now.positions[bead, axis]:g} nm, which does not fit into a PDB file")
    names, residues = short_names(scene.types, 4), short_names(residue_names(scene.residues, scene.n_beads), 3)
    lines = ["REMARK   1 BEADS OF A DPD SIMULATION"]
    for what, short in (("BEAD", names), ("MOLECULE", residues)):
        lines += [f"REMARK   2 {what} {name} IS CALLED {called}" for name, called in short.items() if name != called]
    if now.box is not None:
        lines.append(_cell(now.box))
    numbers = (molecule_numbers(scene.molecules, scene.bond_pairs, scene.n_beads) % 10_000).tolist()
    beads = zip(scene.types, residue_names(scene.residues, scene.n_beads), numbers, x.tolist(), strict=True)
    for serial, (kind, residue, number, (a, b, c)) in enumerate(beads, start=1):
        name = names[kind] if len(names[kind]) == 4 else f" {names[kind]}"
        lines.append(
            f"HETATM{serial:5d} {name:<4s} {residues[residue]:>3s} {CHAIN}{number:4d}    {a:8.3f}{b:8.3f}{c:8.3f}"
            f"{1:6.2f}{0:6.2f}      {SEGMENT:<4s}{SYMBOL:>2s}"
        )
    return "\n".join([*lines, *_bonds(scene.bond_pairs), "END", ""])


def _bonds(pairs: np.ndarray) -> list[str]:
    """CONECT records, each bond under both of its beads, four in a line."""
    neighbours: dict[int, list[int]] = {}
    for i, j in (pairs + 1).tolist():
        neighbours.setdefault(i, []).append(j)
        neighbours.setdefault(j, []).append(i)
    return [
        f"CONECT{bead:5d}" + "".join(f"{other:5d}" for other in around[start : start + 4])
        for bead, around in sorted(neighbours.items())
        for start in range(0, len(around), 4)
    ]


def _cell(box: np.ndarray) -> str:
    a, b, c = np.linalg.norm(box, axis=1)
    alpha, beta, gamma = (
        np.degrees(np.arccos(box[i] @ box[j] / (np.linalg.norm(box[i]) * np.linalg.norm(box[j])))) for i, j in ((1, 2), (0, 2), (0, 1))
    )
    return f"CRYST1{10 * a:9.3f}{10 * b:9.3f}{10 * c:9.3f}{alpha:7.2f}{beta:7.2f}{gamma:7.2f} P 1           1 "
