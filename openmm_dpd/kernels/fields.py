"""Per-bead fields for the kernel: internal energies, temperatures, concentrations."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

import numpy as np

from .eos import EOSTable

#: Kinds of fields.
ENERGY, TEMPERATURE, SPECIES = "energy", "temperature", "species"


class FieldSource(Protocol):
    """What changes the fields besides the pair terms (:class:`openmm_dpd.model.sources.Source`)."""

    def add_to(self, rates: np.ndarray, x: np.ndarray, box: np.ndarray | None) -> None:
        """Add to the rates (N, K) at positions x (N, 3)."""


@dataclass(frozen=True, eq=False)
class FieldSpec:
    """The part of per-bead fields that never changes."""

    kind: str  # ENERGY (columns: conductive, mechanical), TEMPERATURE (one column) or SPECIES (one column each)
    initial: np.ndarray  #: (N, K) values at the start
    immobile: np.ndarray  #: (N,) of bool beads whose values the program does not change
    capacity: np.ndarray | None = None  # (N,) or None; TEMPERATURE: heat capacities
    eos: EOSTable | None = None  # ENERGY: equations of state
    sources: tuple[FieldSource, ...] = ()

    @property
    def n_values(self) -> int:
        """Number of values per bead."""
        return self.initial.shape[1]

    @property
    def acts(self) -> bool:
        """Whether forces depend on them, as the repulsion of eDPD does on temperatures."""
        return self.kind == TEMPERATURE

    @property
    def n_blocks(self) -> int:
        """Number of per-DOF variables it takes: three values fit in each.  Energies have a third component for what rounding lost."""
        return -(-self.n_values // 3)

    def of(self, beads: np.ndarray) -> FieldSpec:
        """The same for a choice of beads (without sources)."""
        eos = None if self.eos is None else self.eos.of(beads)
        capacity = None if self.capacity is None else self.capacity[beads]
        return FieldSpec(self.kind, self.initial[beads], self.immobile[beads], capacity, eos)
