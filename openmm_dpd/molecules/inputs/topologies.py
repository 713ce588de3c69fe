"""Scenes from OpenMM topologies and mdtraj trajectories."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from openmm import app, unit

from ...base.errors import ParameterError, require, what_is
from ...base.geometry import reduced
from ...base.units import position_array, whole_number
from ...model.scene import Scene
from .beads import BeadArrays, named_types, scene_from_beads

if TYPE_CHECKING:
    import mdtraj


def scene_from_topology(topology: app.Topology, positions, typing=None, *, pairs, kT, molecules="residues", **choices) -> Scene:
    """Scene from an OpenMM topology, such as that of a PDB or mmCIF file, of a builder, or ``built.topology``.

    Masses are those of the elements if all atoms have one; bonds and the periodic box are those of the topology.

    Parameters
    ----------
    topology : openmm.app.Topology
        One bead for each of its N atoms.
    positions : (N, 3) array of lengths
        Positions such as ``pdb.positions``; bare numbers are in nm.
    typing : function, mapping, or None
        Bead type of each atom: a function of the atom, ``lambda atom: atom.name[0]``; a mapping from atom names, residue names, or pairs
        ``(residue, atom)``; or None if the atom names are the bead types.
    pairs, kT
        Pair coefficients and thermal energy, see :class:`openmm_dpd.Scene`.
    molecules : {"residues", "chains", "bonds"} or (N,) array of int
        What a molecule is; ``"bonds"``: beads connected by bonds.  Molecules have the names of their residues.
    **choices
        Further arguments of :func:`scene_from_beads`: ``masses``, ``bonds``, ``angles``, ``dihedrals``, ``box``, ``periodic``,
        ``velocities``, ``charges``, ``leave_out``, and those of :class:`openmm_dpd.Scene`.

    Raises
    ------
    ParameterError
        If an atom gets no type, or :func:`scene_from_beads` refuses something.

    Examples
    --------
    >>> from openmm import app
    >>> import numpy as np, openmm_dpd as dpd
    >>> from openmm_dpd.molecules import Spring
    >>> topology = app.Topology()
    >>> chain = topology.addChain()
    >>> atoms = [topology.addAtom(name, None, topology.addResidue("OIL", chain)) for name in ("H", "T", "T")]
    >>> for first, second in zip(atoms, atoms[1:]):
    ...     topology.addBond(first, second)
    >>> scene = scene_from_topology(
    ...     topology,
    ...     np.random.default_rng(1).random((3, 3)),
    ...     pairs={("*", "*"): dpd.DPD(A=25, gamma=4.5)},
    ...     kT=1,
    ...     masses=1,
    ...     bonds={("H", "T"): Spring(k=50, r0=0.7), ("T", "T"): Spring(k=50, r0=0.5)},
    ...     box=[3, 3, 3],
    ... )
    >>> scene.types, len(scene.bond_pairs)
    (('H', 'T', 'T'), 2)
    """
    require(topology, app.Topology, "topology must be an openmm.app.Topology")
    vectors = topology.getPeriodicBoxVectors()
    atoms = list(topology.atoms())
    masses = [None if atom.element is None else atom.element.mass.value_in_unit(unit.dalton) for atom in atoms]
    beads = BeadArrays(
        types=named_types(atoms, typing, "the topology"),
        positions=position_array(positions, len(atoms), f"the topology has {len(atoms)} atoms"),
        source="the topology",
        masses=None if None in masses or not masses else np.array(masses),
        box=None if vectors is None else reduced(vectors.value_in_unit(unit.nanometer)),
        molecules=_molecules(atoms, molecules),
        residues=[atom.residue.name or "MOL" for atom in atoms],
        bonds=_once(topology.bonds()),
    )
    return scene_from_beads(beads, pairs=pairs, kT=kT, **choices)


def scene_from_mdtraj(trajectory: mdtraj.Trajectory, typing=None, *, pairs, kT, frame: int = -1, molecules="residues", **choices) -> Scene:
    """Scene from a frame of an mdtraj trajectory, and so from any file that mdtraj reads.

    Masses are those of the topology's elements.  These are right with :func:`openmm_dpd.io.trajectory.load_topology`, but guessed from
    names with a PDB or GRO file of beads; give ``masses`` then.

    Parameters
    ----------
    trajectory : mdtraj.Trajectory
        One bead for each atom, nm.
    typing : function, mapping, or None
        Bead type of each atom, see :func:`scene_from_topology`.
    pairs, kT
        Pair coefficients and thermal energy, see :class:`openmm_dpd.Scene`.
    frame : int, default -1
        Number of the frame; the last one by default.
    molecules, **choices
        Further arguments of :func:`scene_from_topology`.

    Raises
    ------
    ParameterError
        If there is no such frame, an atom gets no type, or :func:`scene_from_beads` refuses something.
    """
    import mdtraj

    if not isinstance(trajectory, mdtraj.Trajectory) or trajectory.topology is None:
        raise ParameterError(f"expected an mdtraj.Trajectory with a topology, not {what_is(trajectory)}")
    at = whole_number(frame, "the number of a frame")
    if not -trajectory.n_frames <= at < trajectory.n_frames:
        raise ParameterError(f"the trajectory has {trajectory.n_frames} frames; there is no frame {at}")
    atoms = list(trajectory.topology.atoms)
    masses = np.array([0.0 if atom.element is None else atom.element.mass for atom in atoms])
    charges = np.array([getattr(atom.element, "charge", 0.0) for atom in atoms])
    vectors = trajectory.unitcell_vectors
    beads = BeadArrays(
        types=named_types(atoms, typing, "the trajectory"),
        positions=trajectory.xyz[at].astype(np.float64),
        source="the trajectory",
        masses=masses if masses.any() else None,
        box=None if vectors is None else reduced(vectors[at]),
        charges=charges if charges.any() else None,
        molecules=_molecules(atoms, molecules),
        residues=[atom.residue.name or "MOL" for atom in atoms],
        bonds=_once(trajectory.topology.bonds),
    )
    return scene_from_beads(beads, pairs=pairs, kT=kT, **choices)


def _once(bonds) -> np.ndarray:
    """Bonds in their order, without the duplicates in topologies of files."""
    bonds = [(bond[0].index, bond[1].index) for bond in bonds]
    seen = {tuple(sorted(pair)): pair for pair in reversed(bonds)}
    return np.array(list(seen.values())[::-1], dtype=np.int64).reshape(-1, 2)


def _molecules(atoms: list, molecules) -> np.ndarray | None:
    """Molecule number of each atom from 1, or None if bonds define the molecules."""
    if not isinstance(molecules, str):
        return molecules
    if molecules == "bonds":
        return None
    if molecules not in ("residues", "chains"):
        raise ParameterError(f"molecules must be 'residues', 'chains', 'bonds' or an array of whole numbers, not {what_is(molecules)}")
    return np.array([(atom.residue if molecules == "residues" else atom.residue.chain).index + 1 for atom in atoms], dtype=np.int64)
