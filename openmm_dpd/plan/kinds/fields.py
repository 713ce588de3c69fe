"""Kinds whose beads have fields: DPD with conserved energy, and the equations of state of its beads; eDPD, whose coefficients depend on the
temperatures of the beads; tDPD, with species that diffuse between beads."""

import numpy as np

from ...kernels.dpd import TermTable
from ...kernels.edpd import ThermalTable
from ...kernels.energy import EnergyTable
from ...kernels.eos import CONSTANT, RESERVOIR, EOSTable
from ...kernels.fields import ENERGY, SPECIES, TEMPERATURE, FieldSpec
from ...kernels.tdpd import SpeciesTable
from ...model.edpd import EDPD
from ...model.energy_dpd import EnergyDPD
from ...model.eos import ConstantHeatCapacity
from ...model.internal import BeadTemperatures, Concentrations, InternalEnergy
from ...model.scene import Scene
from ...model.tdpd import TDPD
from ..forces.expressions import dpd_expression
from .dpd import on_device
from .record import BeadData, Kind, Resolved, register, symmetric_arrays


def _unit_time(cutoff: np.ndarray, beads: BeadData) -> float:
    """The longest range times (m/kT)^(1/2), which bounds the step of the motion."""
    return float(cutoff.max() * (beads.masses.max() / beads.kT) ** 0.5) if beads.kT > 0.0 else np.inf


def _terms(table: Resolved, beads: BeadData) -> EnergyTable:
    arrays = symmetric_arrays(table, beads.names, "A sigma kappa cutoff")
    return EnergyTable(**arrays, unit_time=_unit_time(arrays["cutoff"], beads))


def _fields(scene: Scene) -> FieldSpec:
    internal = scene.internal
    assert isinstance(internal, InternalEnergy)
    immobile = scene.immobile
    initial = internal.energies(scene.type_ids, scene.type_names)
    eos = eos_table(internal.by_type(scene.type_names), scene.type_ids, immobile, initial.sum(axis=1))
    return FieldSpec(ENERGY, initial, immobile, eos=eos)


def eos_table(by_type: list, type_ids: np.ndarray, immobile: np.ndarray, energies: np.ndarray) -> EOSTable:
    """Equation of state of each bead, from that of its type and its energy at the start (for immobile beads)."""
    capacity, curve = np.zeros(len(type_ids)), np.full(len(type_ids), CONSTANT, np.int32)
    start, nodes, pieces = [0], [np.zeros(0)], [np.zeros((0, 5))]
    numbers: dict[int, int] = {}
    for k, eos in enumerate(by_type):
        members = type_ids == k
        if isinstance(eos, ConstantHeatCapacity):
            capacity[members] = eos.capacity
            continue
        if id(eos) not in numbers:
            numbers[id(eos)] = len(start) - 1
            spline = eos.inverse_temperature
            rows = np.column_stack([spline.c.T, spline.antiderivative()(eos.energies[:-1])])
            nodes.append(eos.energies)
            pieces.append(np.vstack([rows, np.zeros((1, 5))]))
            start.append(start[-1] + len(eos.energies))
        curve[members] = numbers[id(eos)]
    table = EOSTable(capacity, curve, np.array(start, np.int64), np.concatenate(nodes), np.concatenate(pieces))
    capacity[immobile], curve[immobile] = table.thetas(energies)[immobile], RESERVOIR
    return table


def _energies_on_device(table: EnergyTable) -> dict[str, np.ndarray]:
    """Heat whose friction is that at the temperature 1, and whose weights are those of the forces."""
    one = np.ones_like(table.A)
    plain = TermTable(table.A, 0.5 * table.sigma**2, np.nan * one, 0.0 * one, one, one, table.cutoff)
    single = np.stack([table.kappa, 2.0 * one, 1.0 / np.maximum(table.cutoff, 1e-30), 2.0 * one], axis=-1)
    rows = np.stack([single, 0.0 * single, 0.0 * single], axis=-2)
    return on_device(plain) | {"carries": np.array(1), "carrying": rows, "cutoffCarried": table.cutoff}


def _frictions(c: EnergyDPD, kT: float) -> list[tuple[float, float]]:
    return [(c.sigma**2 / (2 * kT), 1.0)]


register(
    Kind(
        coefficient=EnergyDPD,
        terms=_terms,
        potential=dpd_expression,
        fields=_fields,
        device=_energies_on_device,
        field_text="internal energy: conductive, mechanical, what rounding lost of them",
        frictions=_frictions,
    )
)


def _thermal_terms(table: Resolved, beads: BeadData) -> ThermalTable:
    same = "A gamma kappa exponent exponent_T cutoff_T exponent_polynomial kappa_polynomial"
    ranges = {"cutoff_F": lambda c: c.cutoff, "cutoff": lambda c: max(c.cutoff, c.cutoff_T)}
    arrays = symmetric_arrays(table, beads.names, same, **ranges)
    return ThermalTable(**arrays, lammps=beads.compat == "lammps", unit_time=_unit_time(arrays["cutoff_T"], beads))


def _thermal_on_device(table: ThermalTable) -> dict[str, np.ndarray]:
    single = np.stack([table.kappa, table.exponent_T, 1.0 / np.maximum(table.cutoff_T, 1e-30), table.exponent], axis=-1)
    rows = np.stack([single, table.exponent_polynomial, table.kappa_polynomial], axis=-2)
    kind = {"carries": np.array(1), "lammps": np.array(int(table.lammps))}
    return _plain(table, 1.0) | kind | {"carrying": rows, "cutoffCarried": table.cutoff_T}


def _plain(table: ThermalTable | SpeciesTable, exponent: np.ndarray | float) -> dict[str, np.ndarray]:
    """The forces of beads that carry something, for the device."""
    zero = np.zeros_like(table.A)
    return on_device(TermTable(table.A, table.gamma, zero + np.nan, zero, zero + exponent, zero + 1.0, table.cutoff_F))


def _temperatures(scene: Scene) -> FieldSpec:
    internal = scene.internal
    assert isinstance(internal, BeadTemperatures)
    capacity = internal.heat_capacities(scene.n_beads)
    return FieldSpec(TEMPERATURE, internal.values(scene.n_beads), scene.immobile, capacity=capacity, sources=tuple(scene.sources))


def _gains_energy(scene: Scene) -> str | None:
    """Why beads of eDPD gain energy at any step, if they do: A T_m w follows temperatures without heat (docs/measure/heat_steps.py)."""
    pairs = [value for table in scene.tables for value in table.resolve(scene.type_names).values()]
    if not any(isinstance(pair, EDPD) and pair.A for pair in pairs):
        return None
    assert isinstance(scene.internal, BeadTemperatures)
    text = (
        "the repulsion A T_m w of EDPD gives energy to beads of small heat capacity (here {:g} k_B) at any step, 0.13 kT per bead and unit "
        "of time at A = 18.75, density 3, range 1 and 10 k_B, 0.005 at 100 k_B; use A = 0, EnergyDPD, or 1000 k_B and more"
    )
    least = scene.internal.heat_capacities(scene.n_beads).min()
    return text.format(least) if least < 1000.0 else None


def _no_sweep(scene: Scene) -> str | None:
    lammps = "EDPD with compat='lammps' has no pair updates: an update keeps the energy of a pair, which LAMMPS's heat does not"
    return lammps if scene.compat == "lammps" else None


register(
    Kind(
        coefficient=EDPD,
        terms=_thermal_terms,
        why_kernel_only=lambda *_: "the repulsion of EDPD depends on the temperatures of the beads, which no OpenMM force sees",
        fields=_temperatures,
        device=_thermal_on_device,
        repulsion=lambda c, kT: c.A * kT,
        frictions=lambda c, _: [(c.gamma, 0.5 * c.exponent)],
        field_text="temperature of the bead",
        no_sweep=_no_sweep,
        caution=_gains_energy,
        why_no_laplacian=lambda _: "the repulsion depends on the temperatures of the beads (EDPD)",
        unlike_lammps="pair edpd: friction, noise and conduction keep the energy here, which LAMMPS's heat does not (--compat lammps "
        "computes it): with --scheme middle to rounding, with mvv to first order in the step (in in.edpd, at a step of 0.01, the mean "
        "temperature rises by 0.05 % per unit of time; with middle by less than 0.001 % in 100)",
    )
)


def _species_terms(table: Resolved, beads: BeadData) -> SpeciesTable:
    ranges = {"cutoff_F": lambda c: c.cutoff, "cutoff": lambda c: max(c.cutoff, c.cutoff_c)}
    arrays = symmetric_arrays(table, beads.names, "A gamma exponent cutoff_c kappa epsilon exponent_c", **ranges)
    return SpeciesTable(**arrays, unit_time=_unit_time(arrays["cutoff_c"], beads))


def _species_on_device(table: SpeciesTable) -> dict[str, np.ndarray]:
    zero, reach = np.zeros_like(table.kappa), np.zeros((*table.A.shape, 1, 4))
    reach[..., 0, 0] = 1.0 / np.maximum(table.cutoff_c, 1e-30)
    rows = np.concatenate([reach, np.stack([table.kappa, table.epsilon, 0.5 * table.exponent_c, zero], axis=-1)], axis=-2)
    return _plain(table, 0.5 * table.exponent) | {"carries": np.array(2), "carrying": rows, "cutoffCarried": table.cutoff_c}


def _exchange(c: TDPD, density: float) -> float:
    around = 8 * np.pi / 3.2 * density * (c.cutoff_c or c.cutoff) ** 3  # of the weights (1 - r/cutoff_c)^p of all neighbours
    return max(kappa * max(1.0, around / ((p + 1) * (p + 2) * (p + 3))) for kappa, p in zip(c.kappa, c.exponent_c, strict=True))


def _concentrations(scene: Scene) -> FieldSpec:
    internal = scene.internal
    assert isinstance(internal, Concentrations)
    return FieldSpec(SPECIES, internal.values.copy(), scene.immobile, sources=tuple(scene.sources))


register(
    Kind(
        coefficient=TDPD,
        terms=_species_terms,
        potential=dpd_expression,
        why_kernel_only=lambda _, scene, *__: "a force follows concentrations" if any(each.pushes for each in scene.sources) else None,
        fields=_concentrations,
        device=_species_on_device,
        frictions=lambda c, _: [(c.gamma, 0.5 * c.exponent)],
        exchange=_exchange,
        field_text="concentrations, three species in each variable",
    )
)
