"""Energy-conserving DPD with temperature-dependent coefficients (LAMMPS: edpd)."""

from dataclasses import dataclass

from ..base.errors import ParameterError, what_is
from ..base.units import keep, to_md
from .internal import BeadTemperatures
from .pairs import PairCoefficient


def four_coefficients(value, name: str) -> tuple[float, float, float, float]:
    """Coefficients of T - 1, (T - 1)^2, (T - 1)^3 and (T - 1)^4 as floats; ParameterError if they are not four numbers."""
    coefficients = tuple(to_md(c, "dimensionless", name) for c in value)
    if len(coefficients) != 4 or not all(isinstance(c, float) for c in coefficients):
        raise ParameterError(f"{name} must be four coefficients, of T-1, (T-1)^2, (T-1)^3 and (T-1)^4, not {what_is(value)}")
    return coefficients


@dataclass(frozen=True)
class EDPD(PairCoefficient):
    r"""eDPD of Li et al.: forces and heat conduction that depend on the local temperature, in reduced units (k_B = 1).

    With T_m = (T_i + T_j)/2, y = T_m - 1, w = 1 - r/cutoff, w_T = 1 - r/cutoff_T and Theta the harmonic mean of T_i and T_j::

        s = exponent (1 + c1 y + c2 y^2 + c3 y^3 + c4 y^4), at least 0.01        drag weight w^s, noise weight w^(s/2)
        k = kappa    (1 + d1 y + d2 y^2 + d3 y^3 + d4 y^4)
        F   = A T_m w - gamma w^s (e.v) + sigma w^(s/2) xi/sqrt(dt),   sigma^2 = 2 gamma Theta,   U = A T_m cutoff w^2/2
        q_C = K w_T^exponent_T (1/T_i - 1/T_j),   K = C_i C_j k T_m^2                             to i, minus it to j
        q_R = sqrt(2 K) w_T^(exponent_T/2) xi_T/sqrt(dt)                                           to i, minus it to j
        q_V = {w^s [gamma (e.v)^2 - sigma^2 (1/m_i + 1/m_j)/2] - sigma w^(s/2) (e.v) xi/sqrt(dt)}/2   to i and to j
        C_i dT_i/dt = q_i

    Schemes with sweeps exchange heat so that energy is conserved to rounding, temperatures stay positive at any step size, and beads have
    the weight T^C (:mod:`openmm_dpd.kernels.edpd`).  ``mvv`` uses the rates above.  The repulsion follows temperatures without heat: with
    A other than 0 beads gain energy at a rate that falls as 1/C, which is small from C = 1000 on.

    xi_T is independent of xi and clamped to [-5, 5], as in LAMMPS's manual.  LAMMPS's code differs: it uses the clamped xi for xi_T,
    divides q_V by C_i + C_j instead of 2, omits 1/sqrt(dt) in its last term and takes sigma^2/m_i, so that it does not conserve energy.
    A scene with ``compat="lammps"`` computes exactly this, with ``mvv``.

    Parameters
    ----------
    A, gamma : float
        Repulsion (kJ/mol/nm per kJ/mol) and friction (Da/ps), gamma >= 0.
    exponent : float
        Exponent s of the drag at T = 1, >= 0 (LAMMPS: power_f).
    cutoff : length
    kappa : float
        Heat conduction coefficient, >= 0.
    exponent_T : float, default 2
        Exponent of the conduction weight (LAMMPS: power_T).
    cutoff_T : length, optional
        Range of the conduction; ``cutoff`` by default.  It may be longer or shorter than ``cutoff`` (LAMMPS truncates a longer one, and
        adds stale values with a shorter one).
    exponent_polynomial, kappa_polynomial : four floats
        c1 to c4 and d1 to d4.

    References
    ----------
    Li, Tang, Lei, Caswell and Karniadakis, J. Comput. Phys. 265, 113 (2014).
    """

    A: float
    gamma: float
    kappa: float
    cutoff: float = 1.0
    exponent: float = 2.0
    exponent_T: float = 2.0
    cutoff_T: float | None = None
    exponent_polynomial: tuple[float, float, float, float] = (0.0, 0.0, 0.0, 0.0)
    kappa_polynomial: tuple[float, float, float, float] = (0.0, 0.0, 0.0, 0.0)

    _DIMENSIONS = {
        **{"A": ("dimensionless", ""), "gamma": ("friction", ">= 0"), "cutoff": ("length", "> 0"), "cutoff_T": ("length", "> 0")},
        **dict.fromkeys(("kappa", "exponent", "exponent_T"), ("dimensionless", ">= 0")),
    }

    def __post_init__(self):
        super().__post_init__()
        if self.cutoff_T is None:
            keep(self, cutoff_T=self.cutoff)
        for name in ("exponent_polynomial", "kappa_polynomial"):
            keep(self, **{name: four_coefficients(getattr(self, name), name)})

    has_thermostat = True
    internal = BeadTemperatures
