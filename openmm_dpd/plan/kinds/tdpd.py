"""tDPD: species that diffuse between beads."""

from ...kernels.fields import SPECIES, FieldSpec
from ...kernels.tdpd import SpeciesTable
from ...model.internal import Concentrations
from ...model.scene import Scene
from ...model.tdpd import TDPD
from ..forces.expressions import dpd_expression
from .record import BeadData, Kind, Resolved, register, symmetric_arrays


def _terms(table: Resolved, beads: BeadData) -> SpeciesTable:
    ranges = {"cutoff_F": lambda c: c.cutoff, "cutoff": lambda c: max(c.cutoff, c.cutoff_c)}
    return SpeciesTable(**symmetric_arrays(table, beads.names, "A gamma exponent cutoff_c kappa epsilon exponent_c", **ranges))


def _fields(scene: Scene) -> FieldSpec:
    internal = scene.internal
    assert isinstance(internal, Concentrations)
    return FieldSpec(SPECIES, internal.values.copy(), scene.immobile, sources=tuple(scene.sources))


register(
    Kind(
        coefficient=TDPD,
        terms=_terms,
        potential=dpd_expression,
        fields=_fields,
        field_text="concentrations, three species in each variable",
    )
)
