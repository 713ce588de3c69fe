"""From measured numbers to coefficients: units of a model, repulsion, friction.

Every result is an :class:`Estimate`, with its source and range of validity; outside of this range there is an error.
"""

from .chains import chain_chi_slope as chain_chi_slope
from .chi import chi_from_repulsion as chi_from_repulsion, repulsion_from_chi as repulsion_from_chi
from .contacts import chi_slope as chi_slope, measured_chi_slope as measured_chi_slope
from .dynamics import Friction as Friction, Transport as Transport, friction_for as friction_for, transport as transport
from .estimate import Estimate as Estimate
from .flory_huggins import (
    chi_from_composition as chi_from_composition,
    chi_from_solubility as chi_from_solubility,
    composition_from_chi as composition_from_chi,
)
from .insertion import ExcessChemicalPotential as ExcessChemicalPotential, excess_chemical_potential as excess_chemical_potential
from .mapping import BeadMapping as BeadMapping, water_mapping as water_mapping
from .measured import MeasuredPressure as MeasuredPressure, measured_pressure as measured_pressure
from .partition import chi_from_log_p as chi_from_log_p, log_p as log_p, repulsion_from_log_p as repulsion_from_log_p
from .state import (
    inverse_compressibility as inverse_compressibility,
    pressure as pressure,
    repulsion_from_compressibility as repulsion_from_compressibility,
)
