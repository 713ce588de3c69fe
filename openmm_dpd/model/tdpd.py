"""DPD with diffusing species (LAMMPS: tdpd)."""

from dataclasses import dataclass

import numpy as np

from ..base.errors import ParameterError, what_is
from ..base.units import keep, to_md
from .internal import Concentrations
from .pairs import SoftRepulsion


def _per_species(value, name: str) -> tuple[float, ...]:
    array = np.atleast_1d(to_md(value, "dimensionless", name))
    if array.ndim != 1 or np.any(array < 0):
        raise ParameterError(f"{name} must be one number >= 0 per species, not {what_is(value)}")
    return tuple(array.tolist())


@dataclass(frozen=True)
class TDPD(SoftRepulsion):
    r"""tDPD of Li et al.: an isothermal DPD fluid whose beads have diffusing concentrations.

    With w = 1 - r/cutoff, w_c = 1 - r/cutoff_c, and for every species k::

        F    = A w - gamma w^exponent (e.v) + sigma w^(exponent/2) xi/sqrt(dt),   sigma^2 = 2 kT gamma,   U = A cutoff w^2/2
        dC_i = -kappa_k w_c^p_k (C_i - C_j) + epsilon_k w_c^(p_k/2) (C_i + C_j) xi_k/sqrt(dt),   dC_j = -dC_i     (rates; p = exponent_c)

    Schemes with sweeps exchange species pair by pair: concentrations stay >= 0 at any step size (:mod:`openmm_dpd.kernels.tdpd`).  ``mvv``
    uses the rates above, with xi_k clamped to [-5, 5].  As in LAMMPS's ``tdpd``, ``exponent`` is that of the *drag*.

    Noise so strong that it would make concentrations negative is cut off there by sweeps: the share C_i/(C_i + C_j) of a pair has the
    variance epsilon^2/(4 kappa) of the equation up to epsilon^2/kappa = 0.08 (0.5 % less), but 1.7 % less at 0.1 and 15 % less at 0.2.

    Parameters
    ----------
    A : force
    gamma : mass/time
    kappa : float or sequence of K
        Exchange rate of each species, 1/ps, >= 0.
    epsilon : float or sequence of K, default 0
        Noise amplitude of each species, >= 0; in sweeps right up to epsilon^2/kappa = 0.1.
    exponent : float, default 2
    cutoff, cutoff_c : length
        Ranges of the forces and of the exchange (``cutoff`` by default).
    exponent_c : float or sequence of K, default 2

    References
    ----------
    Li, Yazdani, Tartakovsky and Karniadakis, J. Chem. Phys. 143, 014101 (2015).
    """

    A: float
    gamma: float
    kappa: tuple[float, ...]
    epsilon: tuple[float, ...] = (0.0,)
    exponent: float = 2.0
    cutoff: float = 1.0
    cutoff_c: float | None = None
    exponent_c: tuple[float, ...] = (2.0,)

    _DIMENSIONS = {
        **{"A": ("force", ""), "gamma": ("friction", ">= 0"), "exponent": ("dimensionless", ">= 0")},
        **dict.fromkeys(("cutoff", "cutoff_c"), ("length", "> 0")),
    }

    def __post_init__(self):
        super().__post_init__()
        kappa = _per_species(self.kappa, "kappa")
        keep(self, kappa=kappa, cutoff_c=self.cutoff if self.cutoff_c is None else self.cutoff_c)
        for name in ("epsilon", "exponent_c"):
            given = _per_species(getattr(self, name), name)
            if len(given) == 1:
                given = given * len(kappa)
            if len(given) != len(kappa):
                raise ParameterError(f"{name} names {len(given)} species, but kappa names {len(kappa)}")
            keep(self, **{name: given})

    @property
    def n_species(self) -> int:
        """Number of species."""
        return len(self.kappa)

    has_thermostat = True
    internal = Concentrations
