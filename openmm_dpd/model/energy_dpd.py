"""Energy-conserving DPD (LAMMPS: dpd/fdt/energy)."""

from dataclasses import dataclass

from .internal import InternalEnergy
from .pairs import SoftRepulsion


@dataclass(frozen=True)
class EnergyDPD(SoftRepulsion):
    r"""Energy-conserving dissipative particle dynamics: friction heats the beads, and beads exchange heat.

    With w = 1 - r/cutoff, theta_i the internal temperature of bead i (as a thermal energy), and the harmonic mean Theta of the two,
    1/Theta = (1/theta_i + 1/theta_j)/2::

        F        = A w - gamma w^2 (e.v_ij) + sigma w xi/sqrt(dt),    gamma = sigma^2/(2 Theta),    U = A cutoff w^2/2
        du_mech  = [gamma w^2 (e.v_ij)^2 - sigma^2 w^2 (1/m_i + 1/m_j)/2 - sigma w (e.v_ij) xi/sqrt(dt)]/2    to i and to j
        du_cond  = kappa (1/theta_i - 1/theta_j) w^2 + alpha w xi_q/sqrt(dt),    alpha^2 = 2 kappa            to i, minus it to j

    (rates; xi in du_mech is that of F).  sigma is constant and gamma follows the temperature, so that exp(S/k_B) is the invariant weight
    without a drift term.  LAMMPS's manual has a wrong sign in the first term of du_mech; its code agrees with the above.

    Parameters
    ----------
    A : force, default 0
        Repulsion at full overlap, kJ/mol/nm.
    sigma : force*time^(1/2), default 0
        Noise amplitude, >= 0.
    kappa : energy^2/time, default 0
        Heat conduction, kJ^2/mol^2/ps, >= 0: LAMMPS's kappa (energy*temperature/time) times k_B.
    cutoff : length
        Range, nm, > 0.

    References
    ----------
    Avalos and Mackie, Europhys. Lett. 40, 141 (1997); Espanol, Europhys. Lett. 40, 631 (1997); Lisal, Brennan and Bonet Avalos, J. Chem.
    Phys. 135, 204105 (2011).
    """

    A: float = 0.0
    sigma: float = 0.0
    kappa: float = 0.0
    cutoff: float = 1.0
    _DIMENSIONS = {"A": ("force", ""), "sigma": ("noise", ">= 0"), "kappa": ("conduction", ">= 0"), "cutoff": ("length", "> 0")}
    has_thermostat = True
    internal = InternalEnergy
