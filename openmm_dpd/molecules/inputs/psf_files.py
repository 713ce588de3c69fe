"""Scenes from PSF files."""

import os
from pathlib import Path

import numpy as np

from ...base.errors import ParameterError
from ...base.geometry import reduced
from ...base.units import to_md, whole_number
from ...io.psf import read_psf
from ...io.trajectory import mdtraj_topology
from ...model.scene import Scene
from .beads import BeadArrays, named_types, scene_from_beads


def scene_from_psf(path: str | os.PathLike, positions, typing=None, *, pairs, kT, frame: int = -1, **choices) -> Scene:
    """Scene from a PSF file, with names, masses, charges, molecules, bonds and angles, and positions from another source.

    Parameters
    ----------
    path : path-like
        PSF file whose columns are separated by blanks.
    positions : (N, 3) array of lengths, or path-like
        An array, or a trajectory or structure that mdtraj reads (DCD, XTC, PDB, ...), which also has the box.
    typing : function, mapping, or None
        Bead type of each atom, see :func:`scene_from_topology`; None: the atom names, as in files of :func:`.write_psf`.
    pairs, kT
        Pair coefficients and thermal energy, see :class:`openmm_dpd.Scene`.
    frame : int, default -1
        Number of the frame in the file; the last one by default.
    **choices
        Further arguments of :func:`scene_from_beads`, whose ``leave_out`` accepts ``impropers``, ``cross-terms`` and ``lone pairs``.

    Raises
    ------
    ParameterError
        If a file cannot be read, the numbers of beads differ, or :func:`scene_from_beads` refuses something.
    """
    found = read_psf(path)
    placed, box = _placed(positions, len(found.names), frame, path)
    topology = mdtraj_topology(found) if typing is not None else None
    segments = list(dict.fromkeys(found.segments))
    molecules = found.molecules
    if len(segments) > 1:  # residues are numbered from 1 in every segment
        numbers: dict[tuple[str, int], int] = {}
        keys = zip(found.segments, found.molecules.tolist(), strict=True)
        molecules = np.array([numbers.setdefault(key, len(numbers) + 1) for key in keys], dtype=np.int64)
    beads = BeadArrays(
        types=found.names if topology is None else named_types(topology.atoms, typing, os.fspath(path)),
        positions=placed,
        source=os.fspath(path),
        masses=found.masses,
        box=box,
        charges=found.charges if found.charges.any() else None,
        molecules=molecules,
        residues=found.residues,
        bonds=found.bonds,
        angles=found.angles,
        dihedrals=found.dihedrals,
        beyond=found.others,
    )
    return scene_from_beads(beads, pairs=pairs, kT=kT, **choices)


def _placed(positions, count: int, frame: int, path) -> tuple[np.ndarray, np.ndarray | None]:
    """Positions (N, 3), nm, and the box of their file, or None; ParameterError if they are not for ``count`` beads."""
    at = whole_number(frame, "the number of a frame")
    if not isinstance(positions, (str, os.PathLike)):
        if at != -1:
            raise ParameterError(f"frame={frame} has no effect: positions are not a file; drop it")
        placed, box, what = np.asarray(to_md(positions, "length", "positions")), None, "positions"
    else:
        placed, box = _read_frame(Path(positions), at, count)
        what = os.fspath(positions)
    if placed.shape != (count, 3):
        raise ParameterError(f"{os.fspath(path)} has {count} beads, but {what} is of shape {placed.shape}")
    return placed, box


def _read_frame(path: Path, frame: int, count: int) -> tuple[np.ndarray, np.ndarray | None]:
    """Positions and box of one frame of a file that mdtraj reads; ParameterError if it cannot be read."""
    import mdtraj

    try:
        if path.suffix.lower() in (".pdb", ".gro", ".cif"):
            trajectory = mdtraj.load(os.fspath(path))
        else:
            with mdtraj.open(os.fspath(path)) as file:
                frames = len(file)
            if -frames <= frame < 0:
                frame += frames
            if not 0 <= frame < frames:
                raise ParameterError(f"{path} has {frames} frames; there is no frame {frame}")
            topology = mdtraj.Topology()
            residue = topology.add_residue("MOL", topology.add_chain())
            for _ in range(count):
                topology.add_atom("VS", mdtraj.element.virtual, residue)
            trajectory, frame = mdtraj.load_frame(os.fspath(path), frame, top=topology), 0
        box = trajectory.unitcell_vectors
        return trajectory.xyz[frame].astype(np.float64), None if box is None else reduced(box[frame])
    except ParameterError:
        raise
    except (OSError, ValueError, IndexError, TypeError, KeyError) as error:
        raise ParameterError(f"{path} cannot be read as positions of {count} beads: {error}") from None
