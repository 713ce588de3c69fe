"""Pair style table: energies and forces of a file."""

from collections.abc import Iterator

import numpy as np
from scipy.interpolate import CubicSpline

from ...errors import ParameterError
from ...model.pairs import TabulatedPair
from ...units import UnitSystem
from ..files.table_file import MODES, read_table, tabulated_pair
from ..language import arguments as read
from ..state.pair_setup import Coefficient, Find, PairStyle, Spec, Term, Values
from .columns import cutoff_of
from .writing import Exports, Pair, PairExport, StyleUse, exact

#: Points of LAMMPS's own tables.
_TABLE_POINTS = 100000


def _table_settings(words: list[str]) -> dict:
    read.count(words, f"table {'|'.join(MODES)} N", 2, None)
    if len(words) > 2:
        raise ParameterError(f"pair_style table: the options {' '.join(words[2:])} are not supported (they are for kspace solvers)")
    return {"mode": read.choice(words[0], "the table style", MODES), "points": read.integer(words[1], "the size of the table", 2)}


def _table_coefficient(style: PairStyle, words: list[str], find: Find) -> Values:
    read.count(words, "file keyword [cutoff]", 2, 3)
    values = {"file": words[0], "keyword": words[1], "data": read_table(find(words[0]), words[1])}
    return values, cutoff_of(words, 2)


def _table_words(style: PairStyle, found: Coefficient) -> list[str]:
    cutoff = [] if found.cutoff is None else [f"{found.cutoff:.15g}"]
    return [found.values["file"], found.values["keyword"], *cutoff]


def _table_build(style: PairStyle, found: Coefficient, units: UnitSystem) -> Term:
    term, remark = tabulated_pair(found.values["data"], found.cutoff, units)
    return term, remark and f"pair table {found.values['keyword']} of {found.values['file']}: {remark}"


STYLES = {"table": Spec(_table_settings, _table_coefficient, _table_build, write=_table_words, keeps_coefficients=False)}


def _export(export: PairExport, entries: dict[Pair, TabulatedPair]) -> list[StyleUse]:
    units, file = export.units, f"table.{export.name}"
    lines = export.tables.setdefault(file, ["# pair tables written by openmm-dpd, units = " + units.name])
    words, written = {}, dict[int, str]()
    for pair, c in entries.items():
        if id(c) not in written:
            keyword = f"TABLE_{1 + sum(line.startswith('TABLE_') for line in lines)}"
            written[id(c)] = keyword
            lines += _table_section(c, keyword, units)
        words[pair] = f"{file} {written[id(c)]} {exact(c.cutoff / units.length)}"  # type: ignore[operator]
        export.differences.remark(
            f"LAMMPS stops where two beads of types {pair} are nearer than {exact(_rows(c)[0][0] / units.length)}, where the table begins"
        )
    longest = max(float(c.cutoff) for c in entries.values())  # type: ignore[arg-type]
    return [StyleUse("table", f"spline {_TABLE_POINTS}", words, longest)]


def _rows(c: TabulatedPair) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Distances (> 0), energies and forces."""
    r = np.array(c.distances)
    if r[0] == 0:
        r[0] = 1e-6 * r[1]  # LAMMPS has no table that begins at 0
    forces = c.forces if c.forces is not None else -CubicSpline(c.distances, c.energies).derivative()(c.distances)
    return r, c.energies, forces


def _table_section(c: TabulatedPair, keyword: str, units: UnitSystem) -> Iterator[str]:
    r, energies, forces = _rows(c)
    yield from ("", keyword, f"N {len(r)}", "")
    rows = np.column_stack([r / units.length, energies / units.energy, forces / units.force]).tolist()
    for k, row in enumerate(rows, start=1):
        yield f"{k} {' '.join(map(repr, row))}"


EXPORTS: Exports = {TabulatedPair: _export}
