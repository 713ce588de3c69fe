"""Pair styles: each file says how its styles read and write their words, and which pair term of the model they are.

A style is one entry of the ``STYLES`` of its file; the commands in ``commands/pairs.py`` know none of them by name.
"""

from ..language import arguments as read
from ..state.pair_setup import Spec
from . import charges, dpd, edpd, lennard_jones, mdpd, srp, table, tdpd
from .columns import cutoff_of, no_force
from .writing import Exports


def _zero_settings(words: list[str]) -> dict:
    read.count(words, "zero cutoff [nocoeff]", 1, 2)
    for word in words[1:]:
        read.choice(word, "the option of pair style zero", ("nocoeff",))
    return {"cutoff": read.positive(words[0], "the cutoff of zero")}


#: Files of styles.
_FILES = (dpd, edpd, tdpd, mdpd, lennard_jones, table, charges, srp)

#: Pair styles by name.
PAIR_STYLES: dict[str, Spec] = {name: spec for file in _FILES for name, spec in file.STYLES.items()} | {
    "zero": Spec(_zero_settings, lambda style, words, find: ({}, cutoff_of(words, 0)), no_force)
}

#: From the kind of a table of a scene to the styles that say the same.
EXPORTS: Exports = {kind: export for file in _FILES for kind, export in getattr(file, "EXPORTS", {}).items()}
