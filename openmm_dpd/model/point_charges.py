"""Point charges, with a lattice sum or a cutoff."""

import math
from dataclasses import dataclass

import numpy as np

from ..base.errors import ParameterError, in_units, what_is
from ..base.units import keep
from .electrostatics import SmearedCharges
from .pairs import checked


@dataclass(frozen=True)
class PointCharges(SmearedCharges):
    r"""Point charges (LAMMPS: ``coul/long``; without a lattice sum ``coul/cut`` and ``coul/debye``).

    .. math:: U = \frac{q_i q_j}{4\pi\epsilon_0\epsilon_r r}\, e^{-\kappa r}

    Soft beads do not keep opposite point charges apart: these need a repulsion that does (:class:`openmm_dpd.LennardJones`), or smearing.

    Parameters
    ----------
    screening : inverse length, default 0
        kappa, 1/nm; only without a lattice sum.
    lattice : bool, default True
        Sum over all images; False: pairs within the ``cutoff`` interact and nothing else does, with a step in the energy there.
    permittivity, bjerrum_length, cutoff, tolerance, alpha, grid, bonded_factors
        Interaction and settings of the lattice sum, see :class:`SlaterCharges`.

    Raises
    ------
    ParameterError
        If a value is out of bounds or not finite, or permittivity and Bjerrum length are both given or both missing.
    """

    screening: float = 0.0
    lattice: bool = True

    def __post_init__(self):
        super().__post_init__()
        keep(self, screening=checked(self.screening, "inverse_length", "screening of PointCharges"))
        if not isinstance(self.lattice, (bool, np.bool_)):
            raise ParameterError(f"lattice of PointCharges must be True or False, not {what_is(self.lattice)}")
        if self.lattice and self.screening:
            raise ParameterError("PointCharges: screened charges have no lattice sum; give lattice=False and a cutoff")
        if not self.lattice and self.cutoff is None:
            raise ParameterError("PointCharges without a lattice sum need a cutoff")

    @property
    def steepness(self) -> float:
        return math.inf

    @property
    def all_images(self) -> bool:
        return bool(self.lattice)

    def potential(self, r):
        return np.exp(-self.screening * np.asarray(r, dtype=float)) / r

    def tail(self, r: float) -> float:
        return 0.0

    def reach(self, tolerance: float) -> float:
        return 0.0

    def describe(self) -> str:
        return "point charges" + (f", screened by {in_units(self.screening, 'inverse_length')}" if self.screening else "")
