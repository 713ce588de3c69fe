"""Pair styles mdpd and mdpd/rhosum: many-body DPD and its densities."""

from ...model.mdpd import MDPD
from ...units import UnitSystem
from ..language import arguments as read
from ..state.pair_setup import Coefficient, Find, PairStyle, Spec, Term, Values
from .columns import Columns, no_force, seeded
from .writing import Exports, Pair, PairExport, StyleUse, exact

_COLUMNS = Columns({"A": "force", "B": "force/density", "gamma": "friction", "cutoff": "length", "cutoff_B": "length"})

#: What pair_tables.py adds to the coefficients, from those of mdpd/rhosum.
_DENSITY = Columns({"cutoff_density": "length"})


def _mdpd_coefficient(style: PairStyle, words: list[str], _: Find) -> Values:
    read.count(words, "A B gamma cutoff_A cutoff_B", 5)
    return _COLUMNS.read(words), None


def _mdpd_build(style: PairStyle, found: Coefficient, units: UnitSystem) -> Term:
    return MDPD(**_COLUMNS.to_md(found.values, units), **_DENSITY.to_md(found.values, units), kernel="lucy"), None


def _rhosum_settings(words: list[str]) -> dict:
    read.count(words, "mdpd/rhosum", 0)
    return {}


def _rhosum_coefficient(style: PairStyle, words: list[str], _: Find) -> Values:
    read.count(words, "cutoff", 1)
    return {}, read.positive(words[0], "the cutoff of the density")


STYLES = {
    "mdpd/rhosum": Spec(_rhosum_settings, _rhosum_coefficient, no_force, atom_style="mdpd"),
    "mdpd": Spec(seeded("mdpd", 1), _mdpd_coefficient, _mdpd_build, thermostat=True, atom_style="mdpd", own_cutoffs=True),
}


def _export(export: PairExport, entries: dict[Pair, MDPD]) -> list[StyleUse]:
    export.require_reduced("MDPD")
    if any(c.kernel == "quadratic" for c in entries.values()):
        export.differences.add(
            "LAMMPS has Lucy's kernel only for the densities of mdpd; the quadratic kernel of this scene is replaced by it, with the same "
            "range (densities count masses, and the force has no potential)"
        )
    forces = {pair: exact(_COLUMNS.of(c, export.units)) for pair, c in entries.items()}
    densities = {pair: exact(c.cutoff_density) for pair, c in entries.items()}
    longest = max(c.cutoff for c in entries.values())
    return [
        StyleUse("mdpd/rhosum", "", densities, max(c.cutoff_density for c in entries.values())),
        StyleUse("mdpd", f"{{start}} {exact(longest)} {{seed}}", forces, longest),
    ]


EXPORTS: Exports = {MDPD: _export}
