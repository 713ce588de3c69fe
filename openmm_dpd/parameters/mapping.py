"""Physical units of a reduced model: what a bead represents."""

from dataclasses import dataclass

from openmm import unit

from ..base.errors import ParameterError, require_one
from ..base.units import BOLTZMANN, DIMENSIONS, keep, md_pressure, to_md, whole_number
from ..model.pairs import DPD, checked
from .estimate import Estimate, reduced_number
from .state import repulsion_from_compressibility

#: Exponents of mass, length and time in each dimension.
_POWERS = {
    **{"length": (0, 1, 0), "mass": (1, 0, 0), "time": (0, 0, 1), "energy": (1, 2, -2), "velocity": (0, 1, -1), "force": (1, 1, -2)},
    **{"friction": (1, 0, -1), "noise": (1, 1, -1.5), "force_constant": (1, 0, -2), "inverse_length": (0, -1, 0), "volume": (0, 3, 0)},
    **{"diffusion": (0, 2, -1), "viscosity": (1, -1, -1), "pressure": (1, -1, -2)},
}

#: Temperature at which the properties of water below were measured, K.
_ROOM = 298.15
#: Water at 298.15 K and 1 bar: molecular mass (Da), density (kg/m^3) and compressibility (1/Pa), diffusion coefficient (m^2/s).
_WATER_MASS = 18.01528
_WATER_DENSITY, _WATER_COMPRESSIBILITY = 997.05, 4.525e-10
_WATER_DIFFUSION = 2.299e-9


def _per_mole(value, dimension: str):
    """A bulk Quantity, such as in kg/m^3 or Pa s, in units of this package, whose masses and energies are per mole."""
    if unit.is_quantity(value) and (value.unit / unit.mole).is_compatible(DIMENSIONS[dimension]):
        return value * unit.AVOGADRO_CONSTANT_NA
    return value


def _per_pressure(value) -> float:
    """A compressibility in nm^3/(kJ/mol); ParameterError if it is not > 0."""
    if not unit.is_quantity(value):
        value = reduced_number(value, "compressibility", positive=True)
    return 1.0 / checked(md_pressure(1.0 / value), "dimensionless", "the inverse of the compressibility", positive=True)


@dataclass(frozen=True)
class BeadMapping:
    r"""Physical units of beads that represent molecules of one kind.

    A bead represents ``molecules`` molecules.  With ``density`` beads per rc^3 and the mass density d of the liquid,

    .. math:: m = N_m M, \quad r_c = (\rho\, m/d)^{1/3}, \quad \tau = r_c \sqrt{m/k_BT}.

    Parameters
    ----------
    molecules : int
        Molecules per bead, N_m.
    molecule_mass : mass
        Mass of one molecule, Da.
    mass_density : mass/volume
        Mass density of the liquid, Da/nm^3, or a Quantity such as in kg/m^3.
    temperature : temperature
        In kelvin, or a Quantity.
    compressibility : 1/pressure
        Isothermal compressibility of the liquid, nm^3/(kJ/mol), or a Quantity such as in 1/pascal or 1/bar.
    diffusion : length^2/time, optional
        Self-diffusion coefficient of the molecules, nm^2/ps, or a Quantity such as in m^2/s; for :meth:`diffusion_time`.
    density : float, default 3
        Beads per rc^3.

    Attributes
    ----------
    mass, cutoff, time : float
        m (Da), rc (nm) and tau (ps): the units of the reduced model.

    Raises
    ------
    ParameterError
        If a value is out of bounds, not finite, or has the wrong unit.

    References
    ----------
    R. D. Groot and P. B. Warren, J. Chem. Phys. 107, 4423 (1997); R. D. Groot and K. L. Rabone, Biophys. J. 81, 725 (2001).
    """

    molecules: int
    molecule_mass: float
    mass_density: float
    temperature: float
    compressibility: float
    diffusion: float | None = None
    density: float = 3.0

    def __post_init__(self):
        keep(
            self,
            molecules=whole_number(self.molecules, "molecules", least=1),
            molecule_mass=checked(self.molecule_mass, "mass", "molecule_mass", positive=True),
            mass_density=checked(_per_mole(self.mass_density, "mass_density"), "mass_density", "mass_density", positive=True),
            temperature=checked(self.temperature, "temperature", "temperature", positive=True),
            compressibility=_per_pressure(self.compressibility),
            diffusion=None if self.diffusion is None else checked(self.diffusion, "diffusion", "diffusion", positive=True),
            density=checked(self.density, "dimensionless", "density", positive=True),
        )

    @property
    def thermal_energy(self) -> float:
        """Thermal energy, kJ/mol."""
        return BOLTZMANN * self.temperature

    @property
    def mass(self) -> float:
        """Mass of a bead, Da."""
        return self.molecules * self.molecule_mass

    @property
    def cutoff(self) -> float:
        """Cutoff rc, nm: the unit of length."""
        return float((self.density * self.mass / self.mass_density) ** (1 / 3))

    @property
    def time(self) -> float:
        """tau = rc (m/kT)^(1/2), ps: the unit of time that follows from those of mass, length and energy."""
        return float(self.cutoff * (self.mass / self.thermal_energy) ** 0.5)

    @property
    def inverse_compressibility(self) -> float:
        r"""Dimensionless inverse compressibility to be matched by the model, N_m/(n kT kappa_T), with n molecules per volume.

        It is (1/kT) dp/drho of the beads, and proportional to N_m since fewer beads carry the same pressure.
        """
        molecules = self.mass_density / self.molecule_mass
        return self.molecules / (molecules * self.thermal_energy * self.compressibility)

    def repulsion(self, *, equation: str = "measured") -> Estimate:
        """A rc/kT between these beads, from :func:`openmm_dpd.parameters.repulsion_from_compressibility`."""
        return repulsion_from_compressibility(self.inverse_compressibility, self.density, equation=equation)

    def diffusion_time(self, D) -> unit.Quantity:
        r"""Unit of time that matches the diffusion of the beads to that of the molecules.

        .. math:: \tau_D = \frac{N_m D\, r_c^2}{D_{exp}},

        where D is the reduced diffusion coefficient of a bead.  The centre of N_m molecules diffuses N_m times slower than each of them.
        Soft fluids diffuse fast, so tau_D is many times tau; it applies only to processes that diffusion drives.

        Parameters
        ----------
        D : float or Estimate
            Diffusion coefficient of a bead, rc^2/tau: measured, or from :func:`openmm_dpd.parameters.transport`.

        Returns
        -------
        Quantity
            tau_D in ps.

        Raises
        ------
        ParameterError
            If the mapping has no diffusion coefficient.

        References
        ----------
        R. D. Groot and K. L. Rabone, Biophys. J. 81, 725 (2001).
        """
        if self.diffusion is None:
            raise ParameterError("this mapping has no diffusion coefficient of the molecules; make it with diffusion=...")
        reduced = reduced_number(D, "D", positive=True)
        return self.molecules * reduced * self.cutoff**2 / self.diffusion * unit.picosecond

    def _scale(self, dimension: str) -> float:
        require_one(dimension, _POWERS, "dimension")
        mass, length, time = _POWERS[dimension]
        return float(self.mass**mass * self.cutoff**length * self.time**time)

    def quantity(self, value, dimension: str) -> unit.Quantity:
        """Convert a reduced number to an OpenMM Quantity.

        Parameters
        ----------
        value : float, array or Estimate
            In units of rc, m and kT.
        dimension : str
            ``length``, ``time``, ``force`` (A), ``friction`` (gamma), ``force_constant`` (springs), ``pressure``, ``viscosity``, ...

        Returns
        -------
        Quantity
            In units of nm, Da, ps, kJ/mol.

        Raises
        ------
        ParameterError
            If the dimension is unknown or the value is not a number.
        """
        scale = self._scale(dimension)
        number = to_md(float(value) if isinstance(value, Estimate) else value, "dimensionless", "the reduced value")
        md = DIMENSIONS["energy"] / DIMENSIONS["volume"] if dimension == "pressure" else DIMENSIONS[dimension]
        return number * scale * md

    def reduced(self, value, dimension: str):
        """Convert a Quantity, or a bare number in units of nm, Da, ps, kJ/mol, to a reduced number; the inverse of :meth:`quantity`.

        Bulk units, such as bar for a pressure or Pa s for a viscosity, are accepted.

        Raises
        ------
        ParameterError
            If the dimension is unknown or the unit does not fit it.
        """
        scale = self._scale(dimension)
        number = md_pressure(value) if dimension == "pressure" else to_md(_per_mole(value, dimension), dimension, f"the {dimension}")
        return number / scale

    def coefficient(self, A, gamma, *, gamma_perp=0.0, exponent: float = 1.0) -> DPD:
        """Pair coefficients in OpenMM's units, from reduced A, gamma and gamma_perp; the cutoff is rc.

        Examples
        --------
        >>> water = water_mapping(3)
        >>> pair = water.coefficient(water.repulsion(), gamma=4.5)
        >>> round(pair.cutoff, 4), round(pair.A), round(pair.gamma, 1)
        (0.6464, 299, 80.6)
        """
        return DPD(
            A=self.quantity(A, "force"),
            gamma=self.quantity(gamma, "friction"),
            gamma_perp=self.quantity(gamma_perp, "friction"),
            exponent=exponent,
            exponent_perp=exponent,
            cutoff=self.cutoff,
        )


def water_mapping(
    molecules: int = 3, density: float = 3.0, *, temperature=_ROOM, mass_density=None, compressibility=None, diffusion=None
) -> BeadMapping:
    """Physical units of water beads.

    Parameters
    ----------
    molecules : int, default 3
        Water molecules per bead.
    density : float, default 3
        Beads per rc^3.
    temperature : temperature, default 298.15 K
    mass_density, compressibility, diffusion : optional
        By default those of water at 298.15 K and 1 bar: 997.05 kg/m^3 and 4.525e-10 1/Pa (G. S. Kell, J. Chem. Eng. Data 20, 97 (1975)),
        2.299e-9 m^2/s (M. Holz, S. R. Heil and A. Sacco, Phys. Chem. Chem. Phys. 2, 4740 (2000)).  All three are required at any other
        temperature.

    Raises
    ------
    ParameterError
        If a value is out of bounds, or one is missing at a temperature other than 298.15 K.

    Examples
    --------
    >>> water = water_mapping(3)
    >>> round(water.mass, 3), round(water.cutoff, 4), round(water.time, 3)
    (54.046, 0.6464, 3.018)
    >>> round(water.inverse_compressibility, 1)
    48.3
    """
    kelvin = checked(temperature, "temperature", "temperature", positive=True)
    given = {"mass_density": mass_density, "compressibility": compressibility, "diffusion": diffusion}
    missing = [name for name, value in given.items() if value is None]
    if abs(kelvin - _ROOM) > 0.01 and missing:
        raise ParameterError(f"the properties of water are known at {_ROOM} K only; at {kelvin:g} K, give {', '.join(missing)}")
    return BeadMapping(
        molecules,
        _WATER_MASS,
        _WATER_DENSITY * unit.kilogram / unit.meter**3 if mass_density is None else mass_density,
        kelvin,
        _WATER_COMPRESSIBILITY / unit.pascal if compressibility is None else compressibility,
        _WATER_DIFFUSION * unit.meter**2 / unit.second if diffusion is None else diffusion,
        density,
    )
