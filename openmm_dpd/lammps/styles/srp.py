"""Pair style srp: segmental repulsion between bonds, which LAMMPS organises as pairs of placeholder particles of a type of their own."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

from ...errors import ParameterError
from ...model.segments import DISTANCES
from ..language import arguments as read
from ..state.pair_setup import PairStyle

#: Words of the style that are no numbers.
WORDS = frozenset(("*", *DISTANCES, "exclude", "bptype", "yes", "no"))


def srp_settings(words: list[str]) -> dict:
    """Settings of ``srp cutoff btype|* mid|min [exclude yes|no] [bptype N]``."""
    read.count(words, "srp cutoff bond-type|* mid|min [exclude yes|no] [bptype N]", 3, None)
    found = {
        "cutoff": read.positive(words[0], "the cutoff of srp"),
        "bond_type": None if words[1] == "*" else read.integer(words[1], "the bond type of srp (or *)", 1),
        "distance": read.choice(words[2], "the distance of srp", DISTANCES),
        "exclude": True,
        "bptype": None,
    }
    for keyword, values in read.options(words[3:], {"exclude": 1, "bptype": 1}, "pair_style srp"):
        if keyword == "exclude":
            found["exclude"] = read.switch(values[0], "exclude")
        else:
            found["bptype"] = read.integer(values[0], "bptype", 1)
    if found["distance"] == "min" and not found["exclude"]:
        raise ParameterError("pair style srp: 'exclude no' goes with the distance mid only; bonds that share a bead are at the distance 0")
    return found


def srp_coefficient(style: PairStyle, words: list[str], _: Callable[[str], Path]) -> tuple[dict, float | None]:
    """``A [cutoff]``."""
    read.count(words, "A [cutoff]", 1, 2)
    return {"A": read.non_negative(words[0], "A")}, read.positive(words[1], "the cutoff") if len(words) > 1 else None
