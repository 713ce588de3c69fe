"""Point charges, with a lattice sum or a cutoff, perhaps softened."""

import math
from dataclasses import dataclass

import numpy as np

from ..base.errors import ParameterError, in_length, in_units, require, what_is
from ..base.units import keep
from .electrostatics import SmearedCharges
from .pairs import checked


@dataclass(frozen=True)
class PointCharges(SmearedCharges):
    r"""Point charges (LAMMPS: ``coul/long``; without a lattice sum ``coul/cut`` and ``coul/debye``; softened ``coul/long/soft``,
    ``coul/cut/soft``).

    .. math:: U = \frac{q_i q_j\, s}{4\pi\epsilon_0\epsilon_r \sqrt{r^2 + a^2}}\, e^{-\kappa r}

    With a lattice sum only what pairs have up to the cutoff, with the factor erfc(alpha r), is softened; the sum over waves is that of
    point charges with s = 1, as in LAMMPS.  Soft beads do not keep opposite point charges apart: these need a repulsion that does
    (:class:`openmm_dpd.LennardJones`), smearing, or softening.

    Parameters
    ----------
    screening : inverse length, default 0
        kappa, 1/nm; only without a lattice sum.
    lattice : bool, default True
        Sum over all images; False: pairs within the ``cutoff`` interact and nothing else does, with a step in the energy there.
    softness : length, default 0
        a, nm; sqrt(alpha_C) (1 - lambda) in LAMMPS.  At r = 0 the energy is finite without a lattice sum.
    strength : float, default 1
        s, from 0 to 1; lambda^n in LAMMPS.
    permittivity, bjerrum_length, cutoff, tolerance, alpha, grid, bonded_factors
        Interaction and settings of the lattice sum, see :class:`SlaterCharges`.

    Raises
    ------
    ParameterError
        If a value is out of bounds or not finite, or permittivity and Bjerrum length are both given or both missing.
    """

    screening: float = 0.0
    lattice: bool = True
    softness: float = 0.0
    strength: float = 1.0

    def __post_init__(self):
        super().__post_init__()
        keep(self, screening=checked(self.screening, "inverse_length", "screening of PointCharges"))
        for name, dimension in (("softness", "length"), ("strength", "dimensionless")):
            keep(self, **{name: checked(getattr(self, name), dimension, f"{name} of PointCharges")})
        if self.strength > 1:
            raise ParameterError(f"strength of PointCharges must be between 0 and 1, not {what_is(self.strength)}")
        if self.soft and self.screening:
            raise ParameterError("PointCharges: screened charges are not softened; leave softness and strength out")
        require(self.lattice, (bool, np.bool_), "lattice of PointCharges must be True or False")
        if self.lattice and self.screening:
            raise ParameterError("PointCharges: screened charges have no lattice sum; give lattice=False and a cutoff")
        if not self.lattice and self.cutoff is None:
            raise ParameterError("PointCharges without a lattice sum need a cutoff")

    @property
    def soft(self) -> bool:
        """Whether the interaction is not that of point charges."""
        return self.softness > 0 or self.strength < 1

    @property
    def steepness(self) -> float:
        return 1.0 / self.softness if self.softness else math.inf

    @property
    def all_images(self) -> bool:
        return bool(self.lattice)

    def potential(self, r):
        r = np.asarray(r, dtype=float)
        return self.strength * np.exp(-self.screening * r) / np.hypot(r, self.softness)

    def tail(self, r: float) -> float:
        return 0.0

    def reach(self, tolerance: float) -> float:
        return 0.0

    def describe(self) -> str:
        found = "point charges" + (f", screened by {in_units(self.screening, 'inverse_length')}" if self.screening else "")
        return found + (f", softened over {in_length(self.softness)}, times {self.strength:g}" if self.soft else "")
