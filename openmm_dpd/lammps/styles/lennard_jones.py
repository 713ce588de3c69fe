"""Pair style lj/cut, and how it mixes coefficients."""

from collections.abc import Callable
from functools import partial

from ...model.pairs import LennardJones
from ...units import UnitSystem
from ..language import arguments as read
from ..state.pair_setup import Coefficient, Find, PairStyle, Spec, Term, Values
from .columns import Columns, cutoff_of
from .writing import Exports, Pair, PairExport, StyleUse, plain_use

MIXING = ("geometric", "arithmetic", "sixthpower")

_COLUMNS = Columns({"epsilon": "energy", "sigma": "length"})


def _lj_settings(words: list[str]) -> dict:
    read.count(words, "lj/cut cutoff", 1)
    return {"cutoff": read.positive(words[0], "the cutoff of lj/cut")}


def _lj_coefficient(style: PairStyle, words: list[str], _: Find) -> Values:
    read.count(words, "epsilon sigma [cutoff]", 2, 3)
    values = {"epsilon": read.non_negative(words[0], "epsilon"), "sigma": read.positive(words[1], "sigma")}
    return values, cutoff_of(words, 2)


def _lj_build(style: PairStyle, found: Coefficient, units: UnitSystem) -> Term:
    return _COLUMNS.builder(partial(LennardJones, shift=style.shift))(style, found, units)


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


STYLES = {"lj/cut": Spec(_lj_settings, _lj_coefficient, _lj_build, mixed=mixed)}


def _export(export: PairExport, entries: dict[Pair, LennardJones]) -> list[StyleUse]:
    found = []
    for shifted in (False, True):
        mine = {pair: c for pair, c in entries.items() if bool(c.shift) == shifted}
        if mine:
            found.append(plain_use("lj/cut", "{cutoff}", _COLUMNS, export, mine, "shift yes" if shifted else ""))
    return found


EXPORTS: Exports = {LennardJones: _export}
