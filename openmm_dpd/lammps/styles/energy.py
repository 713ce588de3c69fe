"""Pair style dpd/fdt/energy: noise and conduction between beads with internal energies."""

from __future__ import annotations

from ...model.energy_dpd import EnergyDPD
from ..state.pair_setup import Spec
from .columns import Columns, seeded
from .writing import Exports, Pair, PairExport, StyleUse, exact

_COLUMNS = Columns({"A": "force", "sigma": "noise", "kappa": "energy*kT/time"})

STYLES = {
    "dpd/fdt/energy": Spec(
        seeded("dpd/fdt/energy", 0), _COLUMNS.coefficient, _COLUMNS.builder(EnergyDPD), thermostat=True, atom_style="dpd"
    )
}


def _export(export: PairExport, entries: dict[Pair, EnergyDPD]) -> list[StyleUse]:
    units, longest = export.units, max(c.cutoff for c in entries.values())
    words = {pair: exact([*_COLUMNS.of(c, units), c.cutoff / units.length]) for pair, c in entries.items()}
    return [StyleUse("dpd/fdt/energy", f"{exact(longest / units.length)} {{seed}}", words, longest)]


EXPORTS: Exports = {EnergyDPD: _export}
