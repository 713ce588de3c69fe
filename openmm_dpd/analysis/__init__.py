"""Analysis of mdtraj trajectories, in memory or streamed in chunks: structure, transport, molecules, interfaces."""

from __future__ import annotations

from .chains import MoleculeSizes, end_to_end_distance, radius_of_gyration
from .clusters import Clusters, cluster_labels, cluster_sizes
from .curves import Curve
from .diffusion import MeanSquaredDisplacement, diffusion_coefficient, mean_squared_displacement, velocity_autocorrelation
from .distances import radial_distribution
from .interfaces import surface_tension
from .membranes import BendingModulus, HeightSpectrum, area_per_lipid, bending_modulus, bilayer_thickness, height_spectrum
from .profiles import density_profile, temperature_profile, velocity_profile
from .scattering import structure_factor
from .velocity_file import read_velocities
from .viscosity import GreenKubo, PoiseuilleFit, VelocityProfile, green_kubo_viscosity, poiseuille_viscosity

__all__ = [
    "BendingModulus",
    "Clusters",
    "Curve",
    "GreenKubo",
    "HeightSpectrum",
    "MeanSquaredDisplacement",
    "MoleculeSizes",
    "PoiseuilleFit",
    "VelocityProfile",
    "area_per_lipid",
    "bending_modulus",
    "bilayer_thickness",
    "cluster_labels",
    "cluster_sizes",
    "density_profile",
    "diffusion_coefficient",
    "end_to_end_distance",
    "green_kubo_viscosity",
    "height_spectrum",
    "mean_squared_displacement",
    "poiseuille_viscosity",
    "radial_distribution",
    "radius_of_gyration",
    "read_velocities",
    "structure_factor",
    "surface_tension",
    "temperature_profile",
    "velocity_autocorrelation",
    "velocity_profile",
]
