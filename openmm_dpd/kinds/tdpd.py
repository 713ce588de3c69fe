"""tDPD: species that diffuse between beads."""

from __future__ import annotations

from ..forces.conservative import dpd_expression
from ..kernels.fields import SPECIES, FieldSpec
from ..kernels.tdpd import SpeciesTable
from ..model.internal import Concentrations
from ..model.scene import Scene
from ..model.tdpd import TDPD
from .arrays import symmetric_arrays
from .record import BeadData, Kind, Resolved, register


def _terms(table: Resolved, beads: BeadData) -> SpeciesTable:
    def values(c: TDPD) -> dict:
        assert c.cutoff_c is not None
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

    return SpeciesTable(**symmetric_arrays(table, beads.names, values))


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
        no_sweep="has no pair-by-pair update",
    )
)
