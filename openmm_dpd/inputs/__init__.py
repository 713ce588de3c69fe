"""Scenes from what people have: topologies, PSF, GSD and data files, frames of trajectories."""

from .arrays import BeadArrays
from .beads import scene_from_beads
from .gsd_files import scene_from_gsd
from .lammps_files import scene_from_lammps_data
from .psf_files import scene_from_psf
from .topologies import scene_from_mdtraj, scene_from_topology

__all__ = [
    "BeadArrays",
    "scene_from_beads",
    "scene_from_gsd",
    "scene_from_lammps_data",
    "scene_from_mdtraj",
    "scene_from_psf",
    "scene_from_topology",
]
