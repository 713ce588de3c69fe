"""Pair style dpd/fdt/energy: noise and conduction between beads with internal energies."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

from ...model.energy_dpd import EnergyDPD
from ...units import UnitSystem
from ..state.pair_setup import Coefficient, PairStyle, Spec
from .columns import Columns, seeded
from .writing import Exports, Pair, PairExport, StyleUse, exact

_COLUMNS = Columns({"A": "force", "sigma": "noise", "kappa": "energy*kT/time"})


def _energy_coefficient(style: PairStyle, words: list[str], _: Callable[[str], Path]) -> tuple[dict, float | None]:
    return _COLUMNS.read_with_cutoff(words)


def _energy_build(style: PairStyle, found: Coefficient, units: UnitSystem) -> tuple[object, str | None]:
    values = _COLUMNS.to_md(found.values, units)
    return EnergyDPD(**values, cutoff=style.cutoff(found) * units.length), None  # type: ignore[operator]


STYLES = {"dpd/fdt/energy": Spec(seeded("dpd/fdt/energy", 0), _energy_coefficient, _energy_build, thermostat=True, atom_style="dpd")}


def _export(export: PairExport, entries: dict[Pair, EnergyDPD]) -> list[StyleUse]:
    units, longest = export.units, max(c.cutoff for c in entries.values())
    words = {pair: exact([*_COLUMNS.of(c, units), c.cutoff / units.length]) for pair, c in entries.items()}
    return [StyleUse("dpd/fdt/energy", f"{exact(longest / units.length)} {{seed}}", words, longest)]


EXPORTS: Exports = {EnergyDPD: _export}
