"""Fixes that change velocities at the end of steps."""

from __future__ import annotations

from ...errors import ParameterError
from ..language import arguments as read
from ..state.deck_state import DeckState
from ..state.momentum import MomentumRemoval
from .setup import FixReader


def _momentum(state: DeckState, group: str, words: list[str]) -> dict:
    usage = "fix ID group momentum N [linear x y z] [angular] [rescale]"
    read.count(words, usage, 1, None)
    every = read.integer(words[0], "the interval of fix momentum", 1)
    found = dict(read.options(words[1:], {"linear": 3, "angular": 0, "rescale": 0}, "fix momentum"))
    flags = found.get("linear", ["0", "0", "0"])
    for flag in flags:
        read.choice(flag, "a flag of linear", ("0", "1"))
    x, y, z = (flag == "1" for flag in flags)
    if not (x or y or z or "angular" in found):
        raise ParameterError(f"fix momentum takes nothing out; expected '{usage}' with a flag of linear that is 1, or angular")
    return {"momentum": MomentumRemoval(every, (x, y, z), "angular" in found, "rescale" in found)}


MOTION_FIXES: dict[str, FixReader] = {"momentum": _momentum}
