"""Pair style tdpd: DPD between beads that exchange species."""

import numpy as np

from ...model.tdpd import TDPD
from ...units import UnitSystem
from ..language import arguments as read
from ..state.pair_setup import Coefficient, Find, PairStyle, Spec, Term, Values
from .columns import Columns, seeded
from .writing import Exports, Pair, PairExport, StyleUse, exact

_COLUMNS = Columns({"A": "force", "gamma": "friction", "exponent": "1", "cutoff": "length", "cutoff_c": "length"})


def _tdpd_coefficient(style: PairStyle, words: list[str], _: Find) -> Values:
    n = style.settings["species"]
    each = " ".join(f"kappa_{k} epsilon_{k} power_{k}" for k in range(1, n + 1))
    read.count(words, f"A gamma power_f cutoff cutoff_c {each}", 5 + 3 * n)
    return _COLUMNS.read(words) | {"species": tuple(read.number(word, "a coefficient of a species") for word in words[5:])}, None


def _tdpd_build(style: PairStyle, found: Coefficient, units: UnitSystem) -> Term:
    kappa, epsilon, exponents = (found.values["species"][k::3] for k in range(3))
    term = TDPD(
        **_COLUMNS.to_md(found.values, units),
        kappa=tuple(k / units.time for k in kappa),
        epsilon=tuple(e / units.time**0.5 for e in epsilon),
        exponent_c=exponents,
    )
    remark = "pair tdpd: cutoff_c is longer than the cutoff, where LAMMPS ends the exchange; here it goes on to cutoff_c"
    return term, remark if term.cutoff_c > term.cutoff else None  # type: ignore[operator]


STYLES = {
    "tdpd": Spec(seeded("tdpd", 1), _tdpd_coefficient, _tdpd_build, thermostat=True, atom_style="tdpd", own_cutoffs=True),
}


def _export(export: PairExport, entries: dict[Pair, TDPD]) -> list[StyleUse]:
    export.require_reduced("TDPD")
    words = {}
    for pair, c in entries.items():
        if c.cutoff_c > c.cutoff:  # type: ignore[operator]
            export.differences.add(f"types {pair}: LAMMPS's tdpd ends the exchange of species at the cutoff of the forces, {c.cutoff:g}")
        species = np.column_stack([c.kappa, c.epsilon, c.exponent_c])
        words[pair] = f"{exact(_COLUMNS.of(c, export.units))} {exact(species)}"
    longest = max(c.cutoff for c in entries.values())
    return [StyleUse("tdpd", f"{{start}} {exact(longest)} {{seed}}", words, longest)]


EXPORTS: Exports = {TDPD: _export}
