"""Analysis of mdtraj trajectories, in memory or streamed in chunks: structure, transport, molecules, interfaces."""

from ..measure.flow import VelocityProfile as VelocityProfile
from .chains import MoleculeSizes as MoleculeSizes, end_to_end_distance as end_to_end_distance, radius_of_gyration as radius_of_gyration
from .clusters import Clusters as Clusters, cluster_labels as cluster_labels, cluster_sizes as cluster_sizes
from .diffusion import (
    MeanSquaredDisplacement as MeanSquaredDisplacement,
    diffusion_coefficient as diffusion_coefficient,
    mean_squared_displacement as mean_squared_displacement,
    velocity_autocorrelation as velocity_autocorrelation,
)
from .frames import Curve as Curve, read_velocities as read_velocities
from .membranes import (
    BendingModulus as BendingModulus,
    HeightSpectrum as HeightSpectrum,
    area_per_lipid as area_per_lipid,
    bending_modulus as bending_modulus,
    bilayer_thickness as bilayer_thickness,
    height_spectrum as height_spectrum,
)
from .networks import Network as Network, gel_fraction as gel_fraction, network as network
from .profiles import density_profile as density_profile, temperature_profile as temperature_profile, velocity_profile as velocity_profile
from .rheology import (
    ShearModuli as ShearModuli,
    ShearViscosity as ShearViscosity,
    shear_moduli as shear_moduli,
    shear_viscosity as shear_viscosity,
    surface_tension as surface_tension,
)
from .structure import radial_distribution as radial_distribution, structure_factor as structure_factor
from .viscosity import (
    CouetteFit as CouetteFit,
    GreenKubo as GreenKubo,
    PoiseuilleFit as PoiseuilleFit,
    couette_viscosity as couette_viscosity,
    green_kubo_viscosity as green_kubo_viscosity,
    poiseuille_viscosity as poiseuille_viscosity,
)
from .wetting import ContactAngle as ContactAngle, contact_angle as contact_angle
