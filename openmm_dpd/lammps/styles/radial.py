"""Pair styles without friction: lj/cut with its mixing rules, and table, which reads energies and forces from a file."""

from collections.abc import Callable, Iterator
from functools import partial

import numpy as np
from scipy.interpolate import CubicSpline

from ...base.errors import ParameterError
from ...base.units import UnitSystem
from ...model.pairs import LennardJones, TabulatedPair
from ..files.table_file import MODES, read_table, tabulated_pair
from ..language import arguments as read
from ..state.pair_setup import Coefficient, Find, PairStyle, Spec, Term, Values
from .words import Columns, Exports, Pair, PairExport, StyleUse, cutoff_of, exact, plain_use, settings

MIXING = ("geometric", "arithmetic", "sixthpower")
_LJ = Columns({"epsilon": "energy", "sigma": "length"})


def _lj_coefficient(style: PairStyle, words: list[str], _: Find) -> Values:
    read.count(words, "epsilon sigma [cutoff]", 2, 3)
    return {"epsilon": read.non_negative(words[0], "epsilon"), "sigma": read.positive(words[1], "sigma")}, cutoff_of(words, 2)


def _lj_build(style: PairStyle, found: Coefficient, units: UnitSystem) -> Term:
    return _LJ.builder(partial(LennardJones, shift=style.shift))(style, found, units)


def mixed(style: PairStyle, first: Coefficient, second: Coefficient) -> Coefficient:
    """Lennard-Jones coefficients of unlike types from those of like types, by the style's mixing rule."""
    (e1, s1), (e2, s2) = ((c.values["epsilon"], c.values["sigma"]) for c in (first, second))
    c1, c2 = (style.cutoff(c) or 0.0 for c in (first, second))
    epsilon = (e1 * e2) ** 0.5
    if style.mix == "sixthpower":
        epsilon *= 2 * s1**3 * s2**3 / (s1**6 + s2**6)
    rules: dict[str, Callable[[float, float], float]] = {
        "geometric": lambda a, b: (a * b) ** 0.5,
        "arithmetic": lambda a, b: 0.5 * (a + b),
        "sixthpower": lambda a, b: (0.5 * (a**6 + b**6)) ** (1 / 6),
    }
    length = rules[style.mix]
    return Coefficient({"epsilon": epsilon, "sigma": length(s1, s2)}, length(c1, c2), None)


def _export_lj(export: PairExport, entries: dict[Pair, LennardJones]) -> list[StyleUse]:
    found = []
    for shifted in (False, True):
        mine = {pair: c for pair, c in entries.items() if bool(c.shift) == shifted}
        if mine:
            found.append(plain_use("lj/cut", "{cutoff}", _LJ, export, mine, "shift yes" if shifted else ""))
    return found


# -- table --------------------------------------------------------------------------------------------------------------------
#: Number of points in the tables that LAMMPS interpolates.
_TABLE_POINTS = 100000


def _table_settings(words: list[str]) -> dict:
    read.count(words, f"table {'|'.join(MODES)} N", 2, None)
    if len(words) > 2:
        raise ParameterError(f"pair_style table: the options {' '.join(words[2:])} are not supported (they are for kspace solvers)")
    return {"mode": read.choice(words[0], "the table style", MODES), "points": read.integer(words[1], "the size of the table", 2)}


def _table_coefficient(style: PairStyle, words: list[str], find: Find) -> Values:
    read.count(words, "file keyword [cutoff]", 2, 3)
    return {"file": words[0], "keyword": words[1], "data": read_table(find(words[0]), words[1])}, cutoff_of(words, 2)


def _table_words(style: PairStyle, found: Coefficient) -> list[str]:
    return [found.values["file"], found.values["keyword"], *([] if found.cutoff is None else [f"{found.cutoff:.15g}"])]


def _table_build(style: PairStyle, found: Coefficient, units: UnitSystem) -> Term:
    term, remark = tabulated_pair(found.values["data"], found.cutoff, units)
    return term, remark and f"pair table {found.values['keyword']} of {found.values['file']}: {remark}"


def _export_table(export: PairExport, entries: dict[Pair, TabulatedPair]) -> list[StyleUse]:
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
            f"LAMMPS stops if two beads of types {pair} come closer than {exact(_rows(c)[0][0] / units.length)}, where the table begins"
        )
    longest = max(float(c.cutoff) for c in entries.values())  # type: ignore[arg-type]
    return [StyleUse("table", f"spline {_TABLE_POINTS}", words, longest)]


def _rows(c: TabulatedPair) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Distances (> 0), energies and forces."""
    r = np.array(c.distances)
    if r[0] == 0:
        r[0] = 1e-6 * r[1]  # LAMMPS's tables cannot begin at 0
    forces = c.forces if c.forces is not None else -CubicSpline(c.distances, c.energies).derivative()(c.distances)
    return r, c.energies, forces


def _table_section(c: TabulatedPair, keyword: str, units: UnitSystem) -> Iterator[str]:
    r, energies, forces = _rows(c)
    yield from ("", keyword, f"N {len(r)}", "")
    rows = np.column_stack([r / units.length, energies / units.energy, forces / units.force]).tolist()
    for k, row in enumerate(rows, start=1):
        yield f"{k} {' '.join(map(repr, row))}"


STYLES = {
    "lj/cut": Spec(settings("lj/cut", "cutoff"), _lj_coefficient, _lj_build, mixed=mixed),
    "table": Spec(_table_settings, _table_coefficient, _table_build, write=_table_words, keeps_coefficients=False),
}

EXPORTS: Exports = {LennardJones: _export_lj, TabulatedPair: _export_table}
