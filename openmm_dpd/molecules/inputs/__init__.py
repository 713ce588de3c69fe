"""Scenes from what people have: topologies, PSF, GSD and data files, frames of trajectories."""

from .arrays import BeadArrays as BeadArrays
from .beads import scene_from_beads as scene_from_beads
from .gsd_files import scene_from_gsd as scene_from_gsd
from .lammps_files import scene_from_lammps_data as scene_from_lammps_data
from .psf_files import scene_from_psf as scene_from_psf
from .topologies import scene_from_mdtraj as scene_from_mdtraj, scene_from_topology as scene_from_topology
