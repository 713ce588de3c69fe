"""Units: input is converted to OpenMM's MD units (nm, Da, ps, kJ/mol) once, when it enters.

All conversions are here:

- :func:`to_md` takes a bare number (already in MD units, as everywhere in OpenMM) or an ``openmm.unit.Quantity``;
- :func:`thermal_energy` takes an energy or a temperature for kT;
- :class:`UnitSystem` has the LAMMPS unit styles.  The units of a reduced scene are 1 nm, 1 Da, 1 ps and
  1 kJ/mol, so kT = 1 is 1 kJ/mol (a kinetic temperature of 120.27 K in OpenMM's own reporters), and a reduced pressure of 1 is
  16.605 bar.
"""

import math
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from openmm import unit

from .errors import ParameterError, in_number, require_one, what_is

#: Molar gas constant in kJ/mol/K, the value OpenMM uses.
BOLTZMANN = unit.MOLAR_GAS_CONSTANT_R.value_in_unit(unit.kilojoule_per_mole / unit.kelvin)
#: 1 kJ/mol/nm^3 in bar.
BAR_PER_MD_PRESSURE = 1.0e25 / 6.02214076e23
#: 1/(4 pi eps0) in kJ/mol nm/e^2, the value OpenMM uses.
COULOMB = 138.93545764438198
_E, _L, _T, _M = unit.kilojoule_per_mole, unit.nanometer, unit.picosecond, unit.dalton

#: MD unit of each dimension, by name.
DIMENSIONS = {
    "length": _L,
    "area": _L**2,
    "mass": _M,
    "time": _T,
    "energy": _E,
    "temperature": unit.kelvin,
    "velocity": _L / _T,
    "force": _E / _L,
    "friction": _M / _T,  # force/velocity: gamma of the DPD literature
    "noise": _E / _L * _T**0.5,  # force*time^(1/2): sigma of the DPD literature
    "force_constant": _E / _L**2,
    "inverse_length": _L**-1,
    "quartic_constant": _E / _L**4,
    "inverse_area": _L**-2,
    "energy*length": _E * _L,
    "energy*length^6": _E * _L**6,
    "rate": _T**-1,
    "angle": unit.radian,
    "angle_constant": _E / unit.radian**2,
    "conduction": _E**2 / _T,  # kappa of energy-conserving DPD times k_B
    "charge": unit.elementary_charge,
    "volume": _L**3,
    "mass_density": _M / _L**3,
    "number_density": 1 / _L**3,
    "diffusion": _L**2 / _T,
    "viscosity": _M / _L / _T,
    "dimensionless": unit.dimensionless,
}


def to_md(value, dimension: str, name: str):
    """Convert a value to MD units, as a float or a float64 array.

    Parameters
    ----------
    value : number, array_like or openmm.unit.Quantity
        A bare number is in MD units.
    dimension : str
        A key of :data:`DIMENSIONS`.
    name : str
        Name of the value in error messages.

    Raises
    ------
    ParameterError
        If the unit does not fit, the value is not a real number or array of them, Quantities and bare numbers are mixed, or a value is NaN,
        infinite, masked or in units of another library.
    """
    if type(value) is float and math.isfinite(value):
        return value  # the most frequent case, with half a million coefficients
    if unit.is_quantity(value):
        if not value.unit.is_compatible(DIMENSIONS[dimension]):
            raise ParameterError(
                f"{name} has the unit {value.unit}, which is no {dimension}; expected a unit such as {DIMENSIONS[dimension]}"
            )
        value = value.value_in_unit(DIMENSIONS[dimension])
    if np.ma.is_masked(value) or hasattr(value, "units") or hasattr(value, "unit"):  # NumPy ignores masks, and drops units
        raise ParameterError(f"{name} has masked entries or units that are not openmm.unit's; expected numbers or its Quantities")
    result = None if _lists_quantities(value) else _real_numbers(value)
    if result is None:
        result = _entry_by_entry(value, dimension, name)
    bad = np.argwhere(~np.isfinite(result))
    if len(bad):
        where = "" if result.ndim == 0 else f" at index {tuple(int(k) for k in bad[0])}"
        raise ParameterError(f"{name} holds {result[tuple(bad[0])]}{where}; every value must be finite")
    return float(result) if result.ndim == 0 else result


def _lists_quantities(value) -> bool:
    """Whether a list contains a Quantity; NumPy would silently drop the units of Quantities of arrays."""
    return isinstance(value, (list, tuple)) and any(unit.is_quantity(entry) or _lists_quantities(entry) for entry in value)


def _real_numbers(value) -> np.ndarray | None:
    """Value as float64, or None if it is not real numbers: NumPy would convert text, bools and None to numbers."""
    try:
        array = np.asarray(value)
    except (TypeError, ValueError):
        return None
    return array.astype(np.float64) if array.dtype.kind in "iuf" else None


def _entry_by_entry(value, dimension: str, name: str) -> np.ndarray:
    """Array in MD units from lists of Quantities (such as a list of Vec3 with units); ParameterError for anything else."""
    if not isinstance(value, (list, tuple)) and not (isinstance(value, np.ndarray) and value.ndim):
        raise ParameterError(f"{name} must be a number or an array of numbers, not {what_is(value)}")
    bare = [k for k, entry in enumerate(value) if not unit.is_quantity(entry)]
    if 0 < len(bare) < len(value):
        raise ParameterError(f"{name} mixes Quantities with bare numbers: entry {bare[0]} has no unit")
    entries = [to_md(entry, dimension, name) for entry in value]
    shapes = list(dict.fromkeys(np.shape(entry) for entry in entries))
    if len(shapes) > 1:
        raise ParameterError(f"{name} must be an array of numbers, but its entries have different shapes, {shapes[0]} and {shapes[1]}")
    return np.array(entries, dtype=np.float64)


def position_array(positions, count: int, what: str) -> np.ndarray:
    """Positions as an array (count, 3), nm; ParameterError for another shape, where ``what`` gives the reason for ``count``."""
    x = np.asarray(to_md(positions, "length", "positions"), dtype=np.float64)
    if x.shape != (count, 3):
        raise ParameterError(f"positions must have shape ({count}, 3), as {what}, not {x.shape}")
    return x


def whole_number(value, name: str, least: int | None = None) -> int:
    """The value as an int >= ``least``; ParameterError for anything else, such as a float (1e5 is one), a bool, a Quantity."""
    if isinstance(value, (bool, np.bool_)) or not isinstance(value, (int, np.integer)):
        raise ParameterError(f"{name} must be a whole number, not {what_is(value)}")
    if least is not None and value < least:
        raise ParameterError(f"{name} must be at least {least}, not {value}")
    return int(value)


def whole_steps(steps) -> int:
    """A number of steps as an int; TypeError if it is not a whole number."""
    if int(steps) != steps:
        raise TypeError(f"the number of steps must be a whole one, not {what_is(steps)}")
    return int(steps)


def thermal_energy(value, name: str = "kT") -> float:
    """Thermal energy, kJ/mol, from an energy (a bare number is in kJ/mol) or a temperature as a Quantity; ParameterError if < 0."""
    kT = thermal_energies(value, name)
    if not isinstance(kT, float) or kT < 0:
        raise ParameterError(f"{name} must be a single number >= 0, but is {what_is(value)}")
    return kT


def thermal_energy_of(temperature) -> float:
    """Thermal energy, kJ/mol, from a temperature (a bare number is in kelvin) or an energy as a Quantity."""
    if not unit.is_quantity(temperature):
        temperature = to_md(temperature, "temperature", "temperature") * unit.kelvin
    return thermal_energy(temperature, "temperature")


def thermal_energies(value, name: str):
    """Thermal energies, kJ/mol, from energies (bare numbers are in kJ/mol) or temperatures as a Quantity."""
    if unit.is_quantity(value) and value.unit.is_compatible(unit.kelvin):
        return to_md(value, "temperature", name) * BOLTZMANN
    return to_md(value, "energy", name)


def md_pressure(value) -> float:
    """Pressure, kJ/mol/nm^3, from a bare number or a Quantity (bar, atmosphere, pascal, or energy/volume)."""
    return _molar(value, unit.bar, unit.kilojoule_per_mole / unit.nanometer**3, "the pressure")


def md_tension(value) -> float:
    """Surface tension, kJ/mol/nm^2, from a bare number or a Quantity (bar*nm, mN/m, or energy/area)."""
    return _molar(value, unit.bar * unit.nanometer, unit.kilojoule_per_mole / unit.nanometer**2, "the surface tension")


def _molar(value, plain: unit.Unit, molar: unit.Unit, name: str) -> float:
    """A value in ``molar`` units; ``plain`` is the unit in bar and nm, which OpenMM distinguishes from an energy per mole."""
    if unit.is_quantity(value) and value.unit.is_compatible(plain):
        value = value.value_in_unit(plain) / BAR_PER_MD_PRESSURE
    elif unit.is_quantity(value):
        if not value.unit.is_compatible(molar):
            raise ParameterError(f"{name} has the unit {value.unit}; expected a unit such as {plain} or {molar}")
        value = value.value_in_unit(molar)
    return checked(value, "dimensionless", name, signed=True)


@dataclass(frozen=True)
class UnitSystem:
    """A LAMMPS unit style, as factors *to* MD units: a deck's number times the factor is in OpenMM's units.

    The energy factor follows from LAMMPS's own ``mvv2e`` (mass*velocity^2 to energy), so that trajectories agree with LAMMPS's to all
    digits, although its constants are older than today's CODATA values.
    """

    name: str  #: ``lj``, ``real``, ``metal``, ``si``, ``cgs``, ``micro`` or ``nano``
    length: float  # length, mass, time: nm, Da and ps per unit
    mass: float
    time: float
    mvv2e: float  #: LAMMPS's factor from mass*velocity^2 to energy
    boltzmann: float  #: Energy per temperature, in the style's units
    nktv2p: float  #: LAMMPS's factor from energy/volume to pressure
    timestep: float  #: The style's default time step
    skin: float
    normalize: bool  #: Whether thermo output is per bead by default
    density: float  # mass/volume in the style's units to the printed density

    def for_box(self, edge: float) -> "UnitSystem":
        """The units of a deck whose box has this longest edge (in the deck's unit).  A box over 1 mm is one of reduced numbers, with their
        units only in name: 1 then stays 1, as in ``lj``, so that numbers are of order one."""
        if self.mvv2e != 1 or edge * self.length < _LARGEST:
            return self
        return replace(self, length=1.0, mass=1.0, time=1.0)

    @property
    def unit_names(self) -> dict[str, str]:
        """Names of the units by dimension; empty for reduced units."""
        return _UNIT_NAMES[self.name]

    velocity = property(lambda self: self.length / self.time, doc="nm/ps per velocity unit.")
    energy = property(lambda self: self.mass * self.velocity**2 / self.mvv2e, doc="kJ/mol per energy unit.")
    force = property(lambda self: self.energy / self.length, doc="kJ/mol/nm per force unit.")
    friction = property(lambda self: self.force / self.velocity, doc="Da/ps per unit of gamma (force/velocity).")
    noise = property(lambda self: self.force * self.time**0.5, doc="kJ/mol/nm ps^(1/2) per unit of sigma (force*time^(1/2)).")
    inverse_length = property(lambda self: 1 / self.length, doc="1/nm per inverse of the length unit.")
    rate = property(lambda self: 1 / self.time, doc="1/ps per inverse of the time unit.")
    thermal_energy = property(lambda self: self.boltzmann * self.energy, doc="Thermal energy in kJ/mol per unit of temperature.")
    #: (kJ/mol)^2/ps per unit of LAMMPS's conductivity, an energy times a temperature per time.
    conduction = property(lambda self: self.energy * self.thermal_energy / self.time)
    pressure = property(lambda self: self.energy / self.length**3 / self.nktv2p, doc="kJ/mol/nm^3 per unit of pressure.")


LJ = UnitSystem("lj", 1.0, 1.0, 1.0, 1.0, 1.0, 1.0, 0.005, 0.3, True, 1.0)
REAL = UnitSystem("real", 0.1, 1.0, 1e-3, 48.88821291**2, 0.0019872067, 68568.415, 1.0, 2.0, False, 1.0 / 0.602214129)
METAL = UnitSystem("metal", 0.1, 1.0, 1.0, 1.0364269e-4, 8.617343e-5, 1.6021765e6, 0.001, 2.0, False, 1.0 / 0.602214129)
#: Kilogram and gram in Da.
_KG, _G = 6.02214076e26, 6.02214076e23
SI = UnitSystem("si", 1e9, _KG, 1e12, 1.0, 1.3806504e-23, 1.0, 1e-8, 0.001, False, 1.0)
CGS = UnitSystem("cgs", 1e7, _G, 1e12, 1.0, 1.3806504e-16, 1.0, 1e-8, 0.1, False, 1.0)
MICRO = UnitSystem("micro", 1e3, 1e-12 * _G, 1e6, 1.0, 1.3806504e-8, 1.0, 2.0, 0.1, False, 1.0)
NANO = UnitSystem("nano", 1.0, 1e-18 * _G, 1e3, 1.0, 0.013806504, 1.0, 0.00045, 0.1, False, 1.0)
#: Longest edge (nm) of a box in which the units are meant.
_LARGEST = 1e6

_UNIT_NAMES: dict[str, dict[str, str]] = {
    "lj": {},
    "real": {
        **{"length": "Angstrom", "time": "fs", "energy": "kcal/mol", "thermal_energy": "K", "pressure": "atm"},
        **{"force": "kcal/mol/Angstrom", "inverse_length": "/Angstrom"},
    },
    "metal": {
        **{"length": "Angstrom", "time": "ps", "energy": "eV", "thermal_energy": "K", "pressure": "bar"},
        **{"force": "eV/Angstrom", "inverse_length": "/Angstrom"},
    },
    **{
        name: {
            **{"length": length, "time": time, "energy": energy, "thermal_energy": "K", "pressure": pressure},
            **{"force": force, "inverse_length": f"/{length}"},
        }
        for name, length, time, energy, pressure, force in (
            ("si", "m", "s", "J", "Pa", "N"),
            ("cgs", "cm", "s", "erg", "dyn/cm^2", "dyn"),
            ("micro", "um", "us", "pg um^2/us^2", "pg/um/us^2", "pg um/us^2"),
            ("nano", "nm", "ns", "ag nm^2/ns^2", "ag/nm/ns^2", "ag nm/ns^2"),
        )
    },
}

#: LAMMPS unit styles by name.
UNIT_SYSTEMS = {system.name: system for system in (LJ, REAL, METAL, SI, CGS, MICRO, NANO)}


def unit_system(name: str | UnitSystem) -> UnitSystem:
    """LAMMPS unit style of this name; ParameterError if there is none."""
    if isinstance(name, UnitSystem):
        return name
    require_one(name, UNIT_SYSTEMS, "units")
    return UNIT_SYSTEMS[name]


def checked(value, dimension: str, name: str, *, positive: bool = False, signed: bool = False) -> float:
    """A finite number >= 0 (or > 0, or of either sign) in MD units; ParameterError for anything else."""
    number = to_md(value, dimension, name)
    if not isinstance(number, float):
        raise ParameterError(f"{name} must be a single number, not an array of shape {number.shape}")
    if not signed and (number < 0 or (positive and number == 0)):
        raise ParameterError(f"{name} must be {'> 0' if positive else '>= 0'}, but is {in_number(number, dimension)}")
    return number


def owned(array, dtype=None) -> np.ndarray:
    """A read-only copy of an array, which changes of the original do not affect."""
    copy = np.array(array, dtype=dtype, order="C")
    copy.flags.writeable = False
    return copy


def keep(instance, **values) -> None:
    """Set attributes of a frozen instance.  Arrays are kept as read-only copies, since callers may change their arrays later, and what was
    checked must not change."""
    for name, value in values.items():
        object.__setattr__(instance, name, owned(value) if isinstance(value, np.ndarray) else value)


def known_under(kind: Any) -> list[str]:
    """Names of the subclasses of a class that are in its own room, since others may have been added elsewhere."""
    room = kind.__module__.rpartition(".")[0]
    return [under.__name__ for under in kind.__subclasses__() if under.__module__.startswith(f"{room}.")]
