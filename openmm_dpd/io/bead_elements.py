"""Masses and charges of beads in the topologies of mdtraj, whose elements they are."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    import mdtraj


def bead_masses(topology: mdtraj.Topology) -> np.ndarray:
    """Masses (Da) of all atoms of an mdtraj topology, (N,)."""
    return np.array([atom.element.mass for atom in topology.atoms])


def bead_charges(topology: mdtraj.Topology) -> np.ndarray:
    """Charges (e) of all beads of a topology from :func:`load_topology`, (N,)."""
    return np.array([atom.element.charge for atom in topology.atoms])
