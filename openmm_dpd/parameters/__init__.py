"""From measured numbers to coefficients: units of a model, repulsion, friction.

Every answer is an :class:`Estimate`, with its source and the range it holds for; outside of that range there is an error.
"""

from .chains import chain_chi_slope
from .chi import chi_from_repulsion, repulsion_from_chi
from .contacts import chi_slope, measured_chi_slope
from .dynamics import Friction, Transport, friction_for, transport
from .estimate import Estimate
from .flory_huggins import chi_from_composition, chi_from_solubility, composition_from_chi
from .insertion import ExcessChemicalPotential, excess_chemical_potential
from .mapping import BeadMapping, water_mapping
from .measured import MeasuredPressure, measured_pressure
from .partition import chi_from_log_p, log_p, repulsion_from_log_p
from .state import inverse_compressibility, pressure, repulsion_from_compressibility

__all__ = [
    "BeadMapping",
    "Estimate",
    "ExcessChemicalPotential",
    "Friction",
    "MeasuredPressure",
    "Transport",
    "chain_chi_slope",
    "chi_from_composition",
    "chi_from_log_p",
    "chi_from_repulsion",
    "chi_from_solubility",
    "chi_slope",
    "composition_from_chi",
    "excess_chemical_potential",
    "friction_for",
    "inverse_compressibility",
    "log_p",
    "measured_chi_slope",
    "measured_pressure",
    "pressure",
    "repulsion_from_chi",
    "repulsion_from_compressibility",
    "repulsion_from_log_p",
    "transport",
    "water_mapping",
]
