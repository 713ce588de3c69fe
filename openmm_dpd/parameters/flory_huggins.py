"""Flory-Huggins theory of two fluids, and chi from solubility parameters."""

import math

from openmm import unit
from scipy.optimize import brentq

from ..base.errors import ParameterError, what_is
from ..base.units import BOLTZMANN, DIMENSIONS, md_pressure, to_md, whole_number
from ..model.pairs import checked
from .estimate import reduced_number


def chi_from_composition(phi: float, *, beads: int = 1) -> float:
    r"""chi, per bead, of two coexisting fluids of molecules of equal length,

    .. math:: \chi = \frac{1}{n (1 - 2\phi)} \ln\frac{1 - \phi}{\phi},

    where phi is the volume fraction of the minority component in either bulk phase.

    Parameters
    ----------
    phi : float
        Fraction of the minority component, 0 < phi < 1/2.
    beads : int, default 1
        Number n of beads per molecule of either kind.

    Raises
    ------
    ParameterError
        If phi or the number of beads is out of bounds.

    References
    ----------
    P. J. Flory, Principles of Polymer Chemistry (1953); for beads: R. D. Groot and P. B. Warren, J. Chem. Phys. 107, 4423 (1997).

    Examples
    --------
    >>> round(chi_from_composition(0.1), 4)
    2.7465
    """
    phi = to_md(phi, "dimensionless", "phi")
    if not isinstance(phi, float) or not 0 < phi < 0.5:
        raise ParameterError(f"phi, the fraction of the minority component, must be between 0 and 1/2, not {what_is(phi)}")
    return math.log((1 - phi) / phi) / (1 - 2 * phi) / whole_number(beads, "beads", least=1)


def composition_from_chi(chi, *, beads: int = 1) -> float:
    """Volume fraction of the minority component in either bulk phase; the inverse of :func:`chi_from_composition`.

    Parameters
    ----------
    chi : float
        Flory-Huggins parameter per bead, above 2/beads, where there are two phases.
    beads : int, default 1
        Beads per molecule of either kind.

    Raises
    ------
    ParameterError
        If chi times beads is not above 2, so that the fluids mix.

    Examples
    --------
    >>> round(composition_from_chi(2.7465), 4)
    0.1
    """
    count = whole_number(beads, "beads", least=1)
    chi = reduced_number(chi, "chi") * count
    if not 2 < chi < 700:
        which = "chi" if count == 1 else f"chi times {count} beads"
        raise ParameterError(f"two fluids demix at a {which} above 2 (and below 700 here), not {chi:g}")
    # in terms of the log odds L: phi = 1/(1 + e^L), chi tanh(L/2) = L
    odds = brentq(lambda x: x - chi * math.tanh(x / 2), math.sqrt(12 * (1 - 2 / chi)) / 2, chi)
    return 1 / (1 + math.exp(odds))


def _per_bead(value):
    """A volume per bead; a molar volume is divided by Avogadro's number."""
    if unit.is_quantity(value) and (value.unit * unit.mole).is_compatible(DIMENSIONS["volume"]):
        return value / unit.AVOGADRO_CONSTANT_NA
    return value


def _cohesion(value, name: str) -> float:
    """A solubility parameter in (kJ/mol/nm^3)^(1/2)."""
    if unit.is_quantity(value):
        reduced_number(value / value.unit, name)
        return md_pressure(value * value) ** 0.5
    return reduced_number(value, name)


def chi_from_solubility(volume, delta1, delta2, temperature) -> float:
    r"""chi of two liquids from their Hildebrand solubility parameters,

    .. math:: \chi = \frac{V}{k_B T} (\delta_1 - \delta_2)^2.

    Parameters
    ----------
    volume : volume
        Volume of a bead, nm^3; a Quantity may be a molar volume.
    delta1, delta2 : (energy/volume)^(1/2)
        Solubility parameters: a Quantity, such as in MPa^(1/2), or numbers in (kJ/mol/nm^3)^(1/2).
    temperature : temperature
        In kelvin, or a Quantity.

    Returns
    -------
    float
        chi, >= 0: the theory has no attraction between unlike kinds.

    Raises
    ------
    ParameterError
        If a value is out of bounds or has another unit.

    References
    ----------
    J. H. Hildebrand and R. L. Scott, The Solubility of Nonelectrolytes (1950).

    Examples
    --------
    >>> from openmm import unit
    >>> root = unit.megapascal**0.5
    >>> round(chi_from_solubility(100 * unit.centimeter**3 / unit.mole, 20 * root, 16 * root, 298.15), 3)
    0.645
    """
    per_bead = checked(_per_bead(volume), "volume", "volume", positive=True)
    first, second = (_cohesion(value, name) for value, name in ((delta1, "delta1"), (delta2, "delta2")))
    kT = BOLTZMANN * checked(temperature, "temperature", "temperature", positive=True)
    chi = per_bead / kT * (first - second) * (first - second)
    if not math.isfinite(chi):
        raise ParameterError(f"solubility parameters of {delta1} and {delta2} are too far apart: chi is {chi:g}")
    return chi
