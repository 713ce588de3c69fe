"""DPD with conserved energy, and the equations of state of its beads."""

import numpy as np

from ...kernels.energy import EnergyTable
from ...kernels.eos import CONSTANT, RESERVOIR, EOSTable
from ...kernels.fields import ENERGY, FieldSpec
from ...model.energy_dpd import EnergyDPD
from ...model.eos import ConstantHeatCapacity
from ...model.internal import InternalEnergy
from ...model.scene import Scene
from ..forces.expressions import dpd_expression
from .record import BeadData, Kind, Resolved, register, symmetric_arrays


def _terms(table: Resolved, beads: BeadData) -> EnergyTable:
    return EnergyTable(**symmetric_arrays(table, beads.names, "A sigma kappa cutoff"))


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


def _frictions(c: EnergyDPD, kT: float) -> list[tuple[float, float]]:
    return [(c.sigma**2 / (2 * kT), 1.0)]


register(
    Kind(
        coefficient=EnergyDPD,
        terms=_terms,
        potential=dpd_expression,
        fields=_fields,
        field_text="internal energy: conductive, mechanical, what rounding lost of them",
        frictions=_frictions,
    )
)
