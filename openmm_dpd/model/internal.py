"""Per-bead fields: internal energies, temperatures, or concentrations.

During a run they are part of the Context's state (per-DOF variables of the integrator, see :mod:`openmm_dpd.simulation.fields`).  The
classes in this file hold the initial values.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from ..base.errors import ParameterError, bead_number, in_number, require, what_is
from ..base.units import keep, thermal_energies, to_md
from .eos import ConstantHeatCapacity, EquationOfState, TabulatedEOS, heat_capacity
from .pairs import NONE
from .sources import OnFields


def _per_bead(values, n: int, name: str) -> np.ndarray:
    array = np.asarray(values, dtype=np.float64)
    if array.ndim == 0:
        array = np.full(n, float(array))
    if array.shape != (n,):
        raise ParameterError(f"{name} must be one number or one per bead, {n}, not an array of shape {array.shape}")
    return array.copy()


def _positive(array: np.ndarray, name: str, dimension: str = "") -> np.ndarray:
    if np.any(array <= 0):
        bad = int(np.argmin(array))
        raise ParameterError(f"{name} of bead {bead_number(bad)} is {in_number(array[bad], dimension)}; it must be > 0")
    return array


@dataclass(frozen=True, eq=False)
class InternalEnergy:
    """Internal energies of beads with an equation of state, for :class:`~openmm_dpd.model.energy_dpd.EnergyDPD`.

    The internal energy u = u_cond + u_mech of a bead has parts from conduction and from friction and noise; theta follows from the sum.

    Parameters
    ----------
    eos : ConstantHeatCapacity, TabulatedEOS, or mapping of bead type to one
        Equation of state of all beads, or of each type.
    thetas : thermal energy, or (N,) array
        Initial internal temperatures theta, kJ/mol (or a Quantity in kelvin), > 0.
    conductive : (N,) array of energies, optional
        Initial u_cond, kJ/mol, 0 by default; u_mech is the rest.

    Raises
    ------
    ParameterError
        If a temperature is not > 0 or outside the range of its equation of state, or a type has no equation of state.
    """

    eos: EquationOfState | Mapping[str, EquationOfState]
    thetas: float | np.ndarray
    conductive: np.ndarray | None = None

    def __post_init__(self):
        keep(self, thetas=thermal_energies(self.thetas, "thetas"))
        if isinstance(self.eos, Mapping):
            keep(self, eos=dict(self.eos))
        if self.conductive is not None:
            keep(self, conductive=to_md(self.conductive, "energy", "conductive"))

    def by_type(self, names: list[str]) -> list[EquationOfState]:
        """Equation of state of each bead type in ``names``; ParameterError if one is missing."""
        if isinstance(self.eos, (ConstantHeatCapacity, TabulatedEOS)):
            return [self.eos] * len(names)
        require(self.eos, Mapping, "eos must be an equation of state or a mapping of bead types to them")
        for name in names:
            if not isinstance(self.eos.get(name), (ConstantHeatCapacity, TabulatedEOS)):
                raise ParameterError(f"no equation of state for bead type {name}")
        return [self.eos[name] for name in names]

    def energies(self, type_ids: np.ndarray, names: list[str]) -> np.ndarray:
        """(N, 2) initial conductive and mechanical energies, kJ/mol."""
        n = len(type_ids)
        theta = _positive(_per_bead(self.thetas, n, "thetas"), "the internal temperature", "thermal_energy")
        eos = self.by_type(names)
        total = np.empty(n)
        for k in range(len(names)):
            members = type_ids == k
            total[members] = eos[k].energy(theta[members])
        bad = np.flatnonzero(~np.isfinite(total))
        if len(bad):
            raise ParameterError(
                f"the internal temperature {in_number(theta[bad[0]], 'thermal_energy')} of bead {bead_number(bad[0])} is outside its "
                f"equation of state ({eos[int(type_ids[bad[0]])]})"
            )
        conductive = 0.0 if self.conductive is None else _per_bead(self.conductive, n, "conductive")
        return np.column_stack([np.broadcast_to(conductive, (n,)), total - conductive])

    def check(self, type_ids: np.ndarray, names: list[str], tables: Sequence) -> int:
        """Number of values that a source can act on, 0; ParameterError if a value does not fit the beads."""
        self.energies(type_ids, names)
        return 0


@dataclass(frozen=True, eq=False)
class BeadTemperatures:
    """Temperatures of beads with constant heat capacities, for :class:`~openmm_dpd.model.edpd.EDPD`.

    Parameters
    ----------
    thetas : thermal energy, or (N,) array
        Initial temperatures, kJ/mol (or a Quantity in kelvin), > 0.  Use reduced units, since eDPD's polynomials are in T - 1.
    capacities : float, or (N,) array
        Heat capacity of each bead in units of k_B, > 0.
    """

    thetas: float | np.ndarray
    capacities: float | np.ndarray

    def __post_init__(self):
        keep(self, thetas=thermal_energies(self.thetas, "thetas"))
        keep(self, capacities=heat_capacity(self.capacities, "capacities"))

    def values(self, n: int) -> np.ndarray:
        """(N, 1) initial temperatures, kJ/mol."""
        return _positive(_per_bead(self.thetas, n, "thetas"), "the temperature", "thermal_energy")[:, None]

    def heat_capacities(self, n: int) -> np.ndarray:
        """(N,) heat capacities in units of k_B."""
        return _positive(_per_bead(self.capacities, n, "capacities"), "the heat capacity")

    def check(self, type_ids: np.ndarray, names: list[str], tables: Sequence) -> int:
        """Number of values that a source can act on, 1; ParameterError if a value does not fit the beads."""
        self.values(len(type_ids))
        self.heat_capacities(len(type_ids))
        return 1


@dataclass(frozen=True, eq=False)
class Concentrations:
    """Concentrations of one or more species in every bead, for :class:`~openmm_dpd.model.tdpd.TDPD`.

    Parameters
    ----------
    values : (N, K) array, or (N,) for one species
        Initial concentrations, in any unit; they may be negative (as in LAMMPS).  Pairs with a negative one have no noise in pair updates.
    """

    values: np.ndarray

    def __post_init__(self):
        array = np.atleast_1d(to_md(self.values, "dimensionless", "concentrations"))
        if array.ndim == 1:
            array = array[:, None]
        if array.ndim != 2 or array.shape[1] < 1:
            raise ParameterError(f"concentrations must have the shape (beads, species), not {array.shape}")
        keep(self, values=array)

    @property
    def n_species(self) -> int:
        """Number of species."""
        return self.values.shape[1]

    def check(self, type_ids: np.ndarray, names: list[str], tables: Sequence) -> int:
        """Number of species, on which a source can act; ParameterError if beads or coefficients have other numbers of values."""
        n, species = len(type_ids), self.n_species
        if len(self.values) != n:
            raise ParameterError(f"concentrations are given for {len(self.values)} beads, but there are {n}")
        for table in tables:
            for pair, term in table.entries.items():
                if term is not NONE and term.internal is Concentrations and term.n_species != species:
                    raise ParameterError(f"for types {pair}: coefficients of {term.n_species} species, but the beads have {species}")
        return species


Internal = InternalEnergy | BeadTemperatures | Concentrations


def check_internal(
    internal: Internal | None,
    sources: Sequence[OnFields],
    tables: Sequence,
    type_ids: np.ndarray,
    type_names: list[str],
    box: np.ndarray | None,
) -> None:
    """Raise ParameterError if the per-bead fields, the pair terms and the sources do not match."""
    kinds = {table.kind for table in tables if table.kind is not None and table.kind.internal is not None}
    if len(kinds) > 1:
        names = " and ".join(sorted(kind.__name__ for kind in kinds))
        raise ParameterError(f"{names} cannot be combined in one scene, whose beads have one kind of per-bead fields")
    if not kinds:
        if internal is not None or sources:
            what = type(internal).__name__ if internal is not None else "sources"
            raise ParameterError(f"{what} given, but no pair term uses it (EnergyDPD, EDPD and TDPD do)")
        return
    kind = kinds.pop()
    needed = kind.internal
    if internal is None or not isinstance(internal, needed):
        raise ParameterError(f"pair terms of kind {kind.__name__} need internal={needed.__name__}(...), not {what_is(internal)}")
    n_values = internal.check(type_ids, type_names, tables)
    if sources and not n_values:
        raise ParameterError("sources act on temperatures (EDPD) or concentrations (TDPD), not on internal energies")
    for source in sources:
        require(source, OnFields, "sources must be a sequence of Source and Buoyancy")
        source.check(box, len(type_ids), n_values)
