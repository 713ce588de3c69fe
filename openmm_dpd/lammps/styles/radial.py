"""Pair styles without friction: lj/cut and formulas with their mixing rules, and table, which reads energies and forces from a file."""

from collections.abc import Callable, Iterator
from functools import partial
from types import SimpleNamespace
from typing import NamedTuple

import numpy as np
import scipy

from ...base.errors import ParameterError
from ...base.units import UnitSystem
from ...model.pairs import LennardJones, TabulatedPair
from ...model.radial import RadialPair
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


Mixer = Callable[[PairStyle, Coefficient, Coefficient], Coefficient]
_LENGTHS: dict[str, Callable[[float, float], float]] = {
    "geometric": lambda a, b: (a * b) ** 0.5,
    "arithmetic": lambda a, b: 0.5 * (a + b),
    "sixthpower": lambda a, b: (0.5 * (a**6 + b**6)) ** (1 / 6),
}


def _mixer(energy: str = "epsilon", size: str | None = "sigma", rule: str | None = None, repulsive: float = 1.0) -> Mixer:
    """A rule for coefficients of unlike types: an energy, which is that of a repulsion (its sign is ``repulsive``) if one of them is, with
    ``size`` as the length of a bead where the rule needs one, and lengths; ``rule`` is that of the style, whatever the deck wants."""

    def mixed(style: PairStyle, first: Coefficient, second: Coefficient) -> Coefficient:
        length, cutoff = _LENGTHS[rule or style.mix], _LENGTHS[style.mix](*(style.cutoff(c) or 0.0 for c in (first, second)))
        # the length of a Gaussian exp(-B r^2)
        one, two = ({name: v**-0.5 if name == "B" else v for name, v in c.values.items()} for c in (first, second))
        found = {name: length(one[name], two[name]) for name in one if name != energy}
        found[energy] = abs(one[energy] * two[energy]) ** 0.5
        found[energy] *= repulsive if max(repulsive * one[energy], repulsive * two[energy]) >= 0 else -repulsive
        if size is not None and (rule or style.mix) == "sixthpower":
            found[energy] *= 2 * (one[size] * two[size]) ** 3 / (one[size] ** 6 + two[size] ** 6)
        return Coefficient({name: found[name] ** -2 if name == "B" else found[name] for name in one}, cutoff, None)

    return mixed


def _export_lj(export: PairExport, entries: dict[Pair, LennardJones]) -> list[StyleUse]:
    found = []
    for shifted in (False, True):
        mine = {pair: c for pair, c in entries.items() if bool(c.shift) == shifted}
        if mine:
            found.append(plain_use("lj/cut", "{cutoff}", _LJ, export, mine, "shift yes" if shifted else ""))
    return found


# -- formulas -----------------------------------------------------------------------------------------------------------------
class _Style(NamedTuple):
    """How LAMMPS writes a potential of :data:`~openmm_dpd.model.radial.FORMULAS`."""

    columns: dict[str, str]  #: Coefficients in LAMMPS's order, with their dimensions
    mixed: Mixer | None = None
    settings: str = "cutoff"  #: Words of pair_style
    shifts: bool = True  #: Whether pair_modify shift has an effect


_LJ_WORDS = {"epsilon": "energy", "sigma": "length"}
_MORSE_WORDS = {"D": "energy", "alpha": "1/length", "r0": "length"}
_FORMULAS = {
    "soft": _Style({"A": "energy"}, _mixer("A", None), shifts=False),
    "gauss": _Style({"A": "energy", "B": "1/area"}, _mixer("A", "B", repulsive=-1.0)),
    "gauss/cut": _Style({"H": "energy*length", "r0": "length", "sigma": "length"}, _mixer("H")),
    "morse": _Style(_MORSE_WORDS),
    "morse/smooth/linear": _Style(_MORSE_WORDS, shifts=False),
    "yukawa": _Style({"A": "energy*length"}, _mixer("A", None), "kappa cutoff"),
    "lj/smooth/linear": _Style(_LJ_WORDS, _mixer(), shifts=False),
    "lj/sf": _Style(_LJ_WORDS, _mixer(), shifts=False),
    "mie/cut": _Style({**_LJ_WORDS, "n": "1", "m": "1"}, _mixer()),
    "lj/class2": _Style(_LJ_WORDS, _mixer(rule="sixthpower")),
    "buck": _Style({"A": "energy", "rho": "length", "C": "energy*length^6"}),
}


def _formula_style(name: str, words: _Style) -> Spec:
    columns, form = Columns(words.columns), "lj/smooth/linear" if name == "lj/sf" else name

    def build(style: PairStyle, found: Coefficient, units: UnitSystem) -> Term:
        values = columns.to_md(found.values, units)
        if "kappa" in style.settings:
            values["kappa"] = style.settings["kappa"] / units.length
        cutoff = style.cutoff(found) * units.length  # type: ignore[operator]
        return RadialPair(form, values, cutoff, style.shift and words.shifts), None

    return Spec(settings(name, words.settings), columns.coefficient, build, mixed=words.mixed)


def _export_formulas(export: PairExport, entries: dict[Pair, RadialPair]) -> list[StyleUse]:
    """One style for each potential, shift and kappa that there is."""
    groups: dict[tuple, dict[Pair, RadialPair]] = {}
    for pair, c in entries.items():
        shifted = bool(c.shift) and _FORMULAS[c.form].shifts
        groups.setdefault((c.form, shifted, c.parameters.get("kappa")), {})[pair] = c
    found = []
    for (form, shifted, kappa), mine in groups.items():
        columns, unit = Columns(_FORMULAS[form].columns), export.units.length
        words = {pair: exact([*columns.of(SimpleNamespace(**c.parameters), export.units), c.cutoff / unit]) for pair, c in mine.items()}
        longest = max(c.cutoff for c in mine.values())
        before = "" if kappa is None else f"{exact(kappa * unit)} "
        found.append(StyleUse(form, f"{before}{exact(longest / unit)}", words, longest, "shift yes" if shifted else ""))
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
    forces = c.forces if c.forces is not None else -scipy.interpolate.CubicSpline(c.distances, c.energies).derivative()(c.distances)
    return r, c.energies, forces


def _table_section(c: TabulatedPair, keyword: str, units: UnitSystem) -> Iterator[str]:
    r, energies, forces = _rows(c)
    yield from ("", keyword, f"N {len(r)}", "")
    rows = np.column_stack([r / units.length, energies / units.energy, forces / units.force]).tolist()
    for k, row in enumerate(rows, start=1):
        yield f"{k} {' '.join(map(repr, row))}"


STYLES = {
    "lj/cut": Spec(settings("lj/cut", "cutoff"), _lj_coefficient, _lj_build, mixed=_mixer()),
    **{name: _formula_style(name, words) for name, words in _FORMULAS.items()},
    "table": Spec(_table_settings, _table_coefficient, _table_build, write=_table_words, keeps_coefficients=False),
}

EXPORTS: Exports = {LennardJones: _export_lj, RadialPair: _export_formulas, TabulatedPair: _export_table}
