"""Scenes from what people have: topologies, PSF, GSD and data files, frames of trajectories."""

from .lammps.scene.data_scene import scene_from_lammps_data as scene_from_lammps_data
from .molecules.inputs.beads import BeadArrays as BeadArrays, scene_from_beads as scene_from_beads
from .molecules.inputs.gsd_files import scene_from_gsd as scene_from_gsd
from .molecules.inputs.psf_files import scene_from_psf as scene_from_psf
from .molecules.inputs.topologies import scene_from_mdtraj as scene_from_mdtraj, scene_from_topology as scene_from_topology
