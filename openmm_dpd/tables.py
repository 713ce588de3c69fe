"""Coefficients of type pairs as the arrays that kernels read, one function per kind of pair term, and what beads carry.

To add a pair style: its coefficients in model/, its layer in kernels/, one function here.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np

from .kernels.dpd import TermTable
from .kernels.edpd import ThermalTable
from .kernels.energy import EnergyTable
from .kernels.eos import eos_table
from .kernels.fields import ENERGY, SPECIES, TEMPERATURE, FieldSource, FieldSpec
from .kernels.layer import Table
from .kernels.manybody import ManyBodyTable
from .kernels.tdpd import SpeciesTable
from .model.edpd import EDPD
from .model.energy_dpd import EnergyDPD
from .model.internal import BeadTemperatures, InternalEnergy
from .model.mdpd import MDPD, check_many_body
from .model.pairs import DPD, NONE
from .model.scene import Scene
from .model.tdpd import TDPD


def _arrays(table: dict, names: list[str], values: Callable[[Any], dict]) -> dict[str, Any]:
    """(T, T, ...) symmetric arrays by name; zeros for pairs without a coefficient."""
    place = {name: k for k, name in enumerate(names)}
    found = [(place[a], place[b], values(c)) for (a, b), c in table.items() if c is not NONE]
    arrays: dict[str, np.ndarray] = {}
    if found:
        first, second, rows = zip(*found, strict=True)
        for key in rows[0]:
            given = np.array([row[key] for row in rows], dtype=float)
            array = np.zeros((len(names), len(names), *given.shape[1:]))
            array[first, second] = array[second, first] = given
            arrays[key] = array
    return arrays


def dpd_table(table: dict, names: list[str]) -> TermTable:
    """Arrays of isothermal DPD coefficients."""

    def values(c) -> dict:
        fixed_sigma = c.sigma is not None and c.gamma is None
        return {
            "A": c.A,
            "gamma": np.nan if fixed_sigma else c.gamma or 0.0,
            "sigma": c.sigma if fixed_sigma else np.nan,
            "gamma_perp": c.gamma_perp,
            "exponent": c.exponent,
            "exponent_perp": c.exponent_perp,
            "cutoff": c.cutoff,
        }

    return TermTable(**_arrays(table, names, values))


def _energy_table(table: dict, scene: Scene) -> EnergyTable:
    return EnergyTable(**_arrays(table, scene.type_names, lambda c: {"A": c.A, "sigma": c.sigma, "kappa": c.kappa, "cutoff": c.cutoff}))


def _thermal_table(table: dict, scene: Scene) -> ThermalTable:
    def values(c) -> dict:
        return {
            "A": c.A,
            "gamma": c.gamma,
            "kappa": c.kappa,
            "exponent": c.exponent,
            "exponent_T": c.exponent_T,
            "cutoff_F": c.cutoff,
            "cutoff_T": c.cutoff_T,
            "cutoff": max(c.cutoff, c.cutoff_T),
            "exponent_polynomial": c.exponent_polynomial,
            "kappa_polynomial": c.kappa_polynomial,
        }

    return ThermalTable(**_arrays(table, scene.type_names, values), lammps=scene.compat == "lammps")


def _species_table(table: dict, scene: Scene) -> SpeciesTable:
    def values(c) -> dict:
        return {
            "A": c.A,
            "gamma": c.gamma,
            "exponent": c.exponent,
            "cutoff_F": c.cutoff,
            "cutoff_c": c.cutoff_c,
            "cutoff": max(c.cutoff, c.cutoff_c),
            "kappa": c.kappa,
            "epsilon": c.epsilon,
            "exponent_c": c.exponent_c,
        }

    return SpeciesTable(**_arrays(table, scene.type_names, values))


def _many_body_table(table: dict, scene: Scene) -> ManyBodyTable:
    def values(c) -> dict:
        return {
            "A": c.A,
            "B": c.B,
            "gamma": c.gamma,
            "cutoff": c.cutoff,
            "cutoff_A": c.cutoff,
            "cutoff_B": c.cutoff_B,
            "cutoff_density": c.cutoff_density,
        }

    lucy = check_many_body(table).kernel == "lucy"
    return ManyBodyTable(**_arrays(table, scene.type_names, values), lucy=lucy, mass=scene.bead_masses.copy())


#: Kind of pair term -> its kernel's arrays.
TABLES: dict[type, Callable[..., Table]] = {
    DPD: lambda table, scene: dpd_table(table, scene.type_names),
    EnergyDPD: _energy_table,
    EDPD: _thermal_table,
    TDPD: _species_table,
    MDPD: _many_body_table,
}


def field_spec(scene: Scene) -> FieldSpec | None:
    """What beads carry, for the kernel."""
    internal = scene.internal
    if internal is None:
        return None
    immobile = np.zeros(scene.n_beads, bool) if scene.mobile is None else ~scene.mobile
    if isinstance(internal, InternalEnergy):
        initial = internal.energies(scene.type_ids, scene.type_names)
        eos = eos_table(internal.by_type(scene.type_names), scene.type_ids, immobile, initial.sum(axis=1))
        return FieldSpec(ENERGY, initial, immobile, eos=eos)
    sources = tuple(FieldSource(s.region, s.rate, s.species, s.beads, np.asarray(s.corner)) for s in scene.sources)
    if isinstance(internal, BeadTemperatures):
        capacity = internal.heat_capacities(scene.n_beads)
        return FieldSpec(TEMPERATURE, internal.values(scene.n_beads), immobile, capacity=capacity, sources=sources)
    return FieldSpec(SPECIES, internal.values.copy(), immobile, sources=sources)


#: What the per-DOF variables hold, by kind of field.
FIELD_NAMES = {
    ENERGY: "internal energy: conductive, mechanical, what rounding lost of them",
    TEMPERATURE: "temperature of the bead",
    SPECIES: "concentrations, three species in each variable",
}
