"""Pair coefficients, and symmetric tables of them over pairs of types."""

from collections.abc import Mapping
from dataclasses import dataclass, fields
from itertools import combinations_with_replacement
from typing import ClassVar

import numpy as np
import scipy

from ..base.errors import ParameterError, in_length, in_number, in_units, require, thermal, what_is
from ..base.units import checked as checked, keep, to_md


class _NoInteraction:
    """Entry for a type pair that does not interact (LAMMPS: ``pair_coeff i j none``)."""

    cutoff = 0.0

    def __repr__(self) -> str:
        return "NONE"

    def __reduce__(self) -> str:
        return "NONE"


NONE = _NoInteraction()


class PairCoefficient:
    """Base of all kinds of pair coefficients.  A kind is a frozen dataclass with at least a ``cutoff`` (nm).  The pair kernel or an OpenMM
    force evaluates it; its record in :mod:`openmm_dpd.plan.kinds` determines which."""

    #: Class in :mod:`openmm_dpd.model.internal` of the per-bead fields that the kind needs, or None.
    internal: ClassVar[type | None] = None
    #: Scalar coefficients: dimension and bound (``">= 0"``, ``"> 0"`` or ``""``).  None is kept if it is the default.
    _DIMENSIONS: ClassVar[dict[str, tuple[str, str]]] = {}

    def __post_init__(self):
        for name, (dimension, bound) in self._DIMENSIONS.items():
            value = getattr(self, name)
            if value is not None or getattr(type(self), name, 0) is not None:
                keep(self, **{name: checked(value, dimension, name, positive=bound == "> 0", signed=not bound)})

    @property
    def has_conservative(self) -> bool:
        """Whether there is a conservative term."""
        return True

    @property
    def has_thermostat(self) -> bool:
        """Whether there is any friction or noise."""
        return False

    def check_temperature(self, kT: float) -> None:
        """Raise ParameterError if the coefficients contradict the thermal energy kT (kJ/mol)."""


class SoftRepulsion(PairCoefficient):
    """Base of kinds whose conservative term is A w."""

    A: float
    cutoff: float

    @property
    def has_conservative(self) -> bool:
        return self.A != 0.0


@dataclass(frozen=True)
class DPD(SoftRepulsion):
    r"""Dissipative particle dynamics between two bead types: soft repulsion, friction and noise.

    With w = 1 - r/cutoff, w_par = w^exponent, w_perp = w^exponent_perp and P = 1 - e e^T::

        F = A w e                                                              conservative, U = A cutoff w^2 / 2
            - gamma w_par^2 (e.v_ij) e        - gamma_perp w_perp^2 P v_ij      dissipative
            + sigma w_par xi / sqrt(dt) e     + sigma_perp w_perp P xi3 / sqrt(dt)   random

        sigma^2 = 2 kT gamma,  sigma_perp^2 = 2 kT gamma_perp                   fluctuation-dissipation

    This class covers LAMMPS's ``dpd`` (A, gamma), ``dpd/tstat`` (gamma), ``dpd/ext`` and ``dpd/ext/tstat`` (all) and ``dpd/fdt`` (A,
    sigma).  The exponent is that of the *noise* weight, as in ``dpd/ext``; the drag has w^(2 exponent).  For bonded neighbours with a
    factor f (see ``Scene.bonded_factors``) conservative and dissipative forces are multiplied by f and the noise by sqrt(f), which keeps
    the temperature (LAMMPS's ``dpd/fdt`` multiplies the noise by f too, and its fix shardlow ignores the factor).

    Parameters
    ----------
    A : force, default 0
        Repulsion at full overlap, kJ/mol/nm.  May be negative (attraction).
    gamma : mass/time, optional
        Radial friction, Da/ps (force per velocity), >= 0.  It is kept when the temperature changes.
    sigma : force*time^(1/2), optional
        Radial noise amplitude, kJ/mol/nm ps^(1/2), >= 0.  If given alone it is kept, and gamma = sigma^2/(2 kT) follows the temperature
        (``dpd/fdt``).  If both are given they must agree at the scene's temperature.
    gamma_perp : mass/time, default 0
        Transverse friction, Da/ps, >= 0.  If > 0, angular momentum is not conserved.
    exponent, exponent_perp : float, default 1
        Exponents of the noise weights, >= 0.
    cutoff : length
        Range of all terms, nm, > 0.

    Raises
    ------
    ParameterError
        If a value is out of bounds, not finite, or has the wrong unit.

    References
    ----------
    Groot and Warren, J. Chem. Phys. 107, 4423 (1997), eqs 1-9; Espanol and Warren, Europhys. Lett. 30, 191 (1995);
    Junghans, Praprotnik and Kremer, Soft Matter 4, 156 (2008) for the transverse terms.

    Examples
    --------
    >>> DPD(A=25, gamma=4.5, cutoff=1).has_conservative
    True
    """

    A: float = 0.0
    gamma: float | None = None
    sigma: float | None = None
    gamma_perp: float = 0.0
    exponent: float = 1.0
    exponent_perp: float = 1.0
    cutoff: float = 1.0

    _DIMENSIONS = {
        **{"A": ("force", ""), "gamma": ("friction", ">= 0"), "sigma": ("noise", ">= 0"), "gamma_perp": ("friction", ">= 0")},
        **{"exponent": ("dimensionless", ">= 0"), "exponent_perp": ("dimensionless", ">= 0"), "cutoff": ("length", "> 0")},
    }

    @property
    def has_thermostat(self) -> bool:
        return bool(self.gamma or self.sigma or self.gamma_perp)

    def check_temperature(self, kT: float) -> None:
        if self.gamma is not None and self.sigma is not None:
            expected = np.sqrt(2 * kT * self.gamma)
            if not np.isclose(self.sigma, expected, rtol=1e-6, atol=1e-300):
                sigma, needed = in_number(self.sigma, "noise"), in_number(expected, "noise")
                raise ParameterError(
                    f"sigma = {sigma} and gamma = {in_number(self.gamma, 'friction')} contradict the temperature: sigma^2 = 2 kT gamma "
                    f"with {thermal(kT)} needs sigma = {needed}; give only one of them"
                )
        if self.sigma and self.gamma is None and kT == 0.0:
            raise ParameterError(
                f"sigma = {in_number(self.sigma, 'noise')} with a temperature of 0 means infinite friction; give gamma instead"
            )


@dataclass(frozen=True)
class LennardJones(PairCoefficient):
    """Lennard-Jones potential, U = 4 epsilon ((sigma/r)^12 - (sigma/r)^6) for r < cutoff.

    Parameters
    ----------
    epsilon : energy
        Depth of the well, kJ/mol, >= 0.
    sigma : length
        Zero of the potential, nm, > 0.
    cutoff : length
        Range, nm, > 0.
    shift : bool, default False
        Shift the energy to zero at the cutoff (LAMMPS: ``pair_modify shift yes``).  Forces do not change.
    """

    epsilon: float
    sigma: float
    cutoff: float
    shift: bool = False
    _DIMENSIONS = {"epsilon": ("energy", ">= 0"), "sigma": ("length", "> 0"), "cutoff": ("length", "> 0")}

    def __post_init__(self):
        require(self.shift, (bool, np.bool_), "shift must be True or False")
        super().__post_init__()


@dataclass(frozen=True, eq=False)
class TabulatedPair(PairCoefficient):
    """Tabulated radial pair potential: a cubic spline through energies and forces, with a constant force below the first distance.

    Parameters
    ----------
    distances : (K,) array of lengths
        Distances, nm, increasing and evenly spaced.
    energies : (K,) array of energies
        Energies, kJ/mol.
    forces : (K,) array of forces, optional
        -dU/dr, the slopes of the spline, kJ/mol/nm.  Integrated from the end of the table they must give the energies, to 5 % of their
        range beyond the first tenth.
    cutoff : length, optional
        Range, nm, up to the end of the table, which is the default.

    Raises
    ------
    ParameterError
        If distances do not increase evenly, lengths differ, or forces are not minus the derivative of the energies.
    """

    distances: np.ndarray
    energies: np.ndarray
    forces: np.ndarray | None = None
    cutoff: float | None = None

    def __post_init__(self):
        distances = np.atleast_1d(to_md(self.distances, "length", "distances"))
        energies = np.atleast_1d(to_md(self.energies, "energy", "energies"))
        if distances.ndim != 1 or distances.shape != energies.shape or len(distances) < 4:
            raise ParameterError(
                f"a tabulated pair needs as many energies as distances, at least 4; got {len(distances)} and {len(energies)}"
            )
        if distances[0] < 0:
            raise ParameterError(f"the distances of a tabulated pair must be >= 0; the first is {in_length(distances[0])}")
        steps = np.diff(distances)
        if np.any(steps <= 0) or not np.allclose(steps, steps.mean(), rtol=1e-4):
            worst = int(np.argmax(np.abs(steps - steps.mean())))
            raise ParameterError(f"the distances of a tabulated pair must increase evenly; they do not after entry {worst}")
        cutoff = distances[-1] if self.cutoff is None else checked(self.cutoff, "length", "cutoff", positive=True)
        if cutoff > distances[-1] * (1 + 1e-9):
            raise ParameterError(f"the cutoff {in_length(cutoff)} lies beyond the table, which ends at {in_length(distances[-1])}")
        values = {"distances": distances, "energies": energies, "cutoff": float(cutoff)}
        if self.forces is not None:
            values["forces"] = self._checked_forces(distances, energies)
        keep(self, **values)

    def _checked_forces(self, distances: np.ndarray, energies: np.ndarray) -> np.ndarray:
        """The forces in MD units; ParameterError if they are not minus the derivative of the energies."""
        forces = np.atleast_1d(to_md(self.forces, "force", "forces"))
        if forces.shape != energies.shape:
            raise ParameterError(f"a tabulated pair has {len(energies)} energies but {len(forces)} forces")
        # energies are compared, since forces from coarse-graining have kinks; the steep first tenth is left out
        work = scipy.interpolate.CubicSpline(distances, forces).antiderivative()
        expected = energies[-1] + work(distances[-1]) - work(distances)
        tail = slice(len(forces) // 10, None)
        off = np.abs(energies - expected)[tail]
        if off.max() > 0.05 * max(np.ptp(energies[tail]), 1e-300):
            worst = int(np.argmax(off)) + tail.start
            raise ParameterError(
                f"tabulated forces are not minus the slope of the energies: at r = {in_length(distances[worst])} the energy is "
                f"{in_number(energies[worst], 'energy')}, the forces integrated from the table's end give "
                f"{in_units(expected[worst], 'energy')}"
            )
        return forces


def describe(coefficient) -> str:
    """One line with the values of a coefficient, for explain()."""
    if coefficient is NONE:
        return "no interaction"
    parts, dimensions = [], {name: dimension for name, (dimension, _) in coefficient._DIMENSIONS.items()}
    for field in fields(coefficient):
        value, dimension = getattr(coefficient, field.name), dimensions.get(field.name, field.name)
        if value is None or (np.ndim(value) == 0 and value == field.default) or isinstance(value, tuple) and value == field.default:
            continue
        if isinstance(value, tuple):
            text = "(" + ", ".join(f"{v:g}" for v in value) + ")"
        else:
            text = f"{len(value)} points" if np.ndim(value) else value if isinstance(value, str) else in_number(value, dimension)
        parts.append(f"{field.name} = {text}")
    return f"{type(coefficient).__name__}({', '.join(parts)})"


class PairTable:
    """Pair coefficients of one kind for unordered pairs of bead types.  Tables of a scene add up.

    Parameters
    ----------
    entries : mapping of (str, str) to a pair coefficient
        From two bead types in any order, where ``"*"`` is every type.  Later entries overwrite earlier ones, as in LAMMPS, so put
        wildcards first; keys that differ only in the order of their types must have equal values.  The value
        :data:`~openmm_dpd.model.pairs.NONE` is for pairs that do not interact.

    Raises
    ------
    ParameterError
        If this is not a mapping, a key is not a pair of names, a key and its reverse contradict each other, or values are of several kinds.

    Examples
    --------
    >>> from openmm_dpd import DPD, PairTable
    >>> table = PairTable({("*", "*"): DPD(A=25, gamma=4.5), ("A", "B"): DPD(A=35, gamma=4.5)})
    >>> table.resolve(["A", "B"])[("A", "B")].A
    35.0
    """

    def __init__(self, entries: Mapping):
        require(entries, Mapping, "a PairTable is made from a mapping such as {('A', 'B'): DPD(...)}")
        if not entries:
            raise ParameterError("a PairTable needs at least one entry")
        for key in entries:
            if not (isinstance(key, tuple) and len(key) == 2 and all(isinstance(name, str) for name in key)):
                raise ParameterError(f"the keys of a PairTable are pairs of type names such as ('A', 'B'), not {what_is(key)}")
        self.entries = {(str(first), str(second)): value for (first, second), value in entries.items()}
        for key, value in self.entries.items():
            if value is not NONE and not isinstance(value, PairCoefficient):
                raise ParameterError(
                    f"for types {key}: expected a pair coefficient such as DPD(A=25, gamma=4.5), or NONE, not {what_is(value)}"
                )
            reverse = self.entries.get(key[::-1], value)
            if value is not reverse and value != reverse:
                raise ParameterError(
                    f"the coefficients for types {key} and {key[::-1]} differ, but the order of two types has no meaning; give one of them"
                )
        found = {type(value) for value in self.entries.values() if value is not NONE}
        if len(found) > 1:
            names = " and ".join(sorted(kind.__name__ for kind in found))
            raise ParameterError(f"one PairTable holds one kind of coefficient, not {names}; give the scene a list of tables")
        self.kind = found.pop() if found else None

    def __repr__(self) -> str:
        return f"PairTable({self.entries!r})"

    def resolve(self, names: list[str]) -> dict[tuple[str, str], object]:
        """Coefficients of all unordered pairs of ``names`` that have one; keys are in the order of ``names``.

        Raises
        ------
        ParameterError
            If an entry names a type that is not among ``names``.
        """
        place = {name: k for k, name in enumerate(names)}
        for key in self.entries:
            for name in key:
                if name != "*" and name not in place:
                    raise ParameterError(f"for types {key}: there is no bead type {what_is(name)}; the types are {', '.join(names)}")
        found = {}
        for key, value in self.entries.items():
            first, second = ([name] if name != "*" else names for name in key)
            for a in first:
                for b in second:
                    found[(a, b) if place[a] <= place[b] else (b, a)] = value
        return found


def require_complete(tables: list[PairTable], names: list[str]) -> None:
    """Raise ParameterError if a pair of ``names`` is in no table (there are no mixing rules and no silent defaults)."""
    resolved = [table.resolve(names) for table in tables]
    missing = [pair for pair in combinations_with_replacement(names, 2) if not any(pair in table for table in resolved)]
    if missing:
        listing = ", ".join(f"({a}, {b})" for a, b in missing[:6]) + (" ..." if len(missing) > 6 else "")
        raise ParameterError(f"no pair coefficients for types {listing}; set them, or set them to NONE if they do not interact")
