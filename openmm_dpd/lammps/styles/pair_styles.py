"""Pair styles: each file says how its styles read and write their words, and which pair term of the model they are.

A style is one entry of the ``STYLES`` of its file; the commands in ``commands/pairs.py`` know none of them by name.
"""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

from ...model.pairs import NONE
from ..language import arguments as read
from ..state.pair_setup import PairStyle, Spec
from . import charges, dpd, edpd, energy, lennard_jones, mdpd, srp, table, tdpd
from .writing import Exports


def _zero_settings(words: list[str]) -> dict:
    read.count(words, "zero cutoff [nocoeff]", 1, 2)
    for word in words[1:]:
        read.choice(word, "the option of pair style zero", ("nocoeff",))
    return {"cutoff": read.positive(words[0], "the cutoff of zero")}


def _zero_coefficient(style: PairStyle, words: list[str], _: Callable[[str], Path]) -> tuple[dict, float | None]:
    return {}, read.positive(words[0], "the cutoff") if words else None


#: Pair styles by name.
PAIR_STYLES: dict[str, Spec] = {
    **dpd.STYLES,
    **energy.STYLES,
    **edpd.STYLES,
    **tdpd.STYLES,
    **mdpd.STYLES,
    **lennard_jones.STYLES,
    **table.STYLES,
    **charges.STYLES,
    **srp.STYLES,
    "zero": Spec(_zero_settings, _zero_coefficient, lambda *_: (NONE, None)),
}

#: From the kind of a table of a scene to the styles that say the same.
EXPORTS: Exports = {
    **dpd.EXPORTS,
    **energy.EXPORTS,
    **edpd.EXPORTS,
    **tdpd.EXPORTS,
    **mdpd.EXPORTS,
    **lennard_jones.EXPORTS,
    **table.EXPORTS,
}
