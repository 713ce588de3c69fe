"""``c_id[*]``, ``c_id[2*4]`` and ``f_id[*]``: one word for several values."""

from __future__ import annotations

import re
from collections.abc import Sequence

from ...errors import ParameterError
from ..language import arguments as read
from ..state.deck_state import DeckState
from .computes import COMPUTES

_WILD = re.compile(r"([cf])_(\w+)\[(\d*\*\d*)\]", re.ASCII)


def expanded(state: DeckState, words: Sequence[str], tables: bool = False) -> tuple[str, ...]:
    """The words with every ``*`` in an index written out; with ``tables`` only columns of the tables of computes.

    Raises
    ------
    ParameterError
        If a word with a ``*`` names nothing that has several values, or a range has numbers that are not there.
    """
    found: list[str] = []
    for word in words:
        match = _WILD.fullmatch(word)
        if match is None:
            found.append(word)
            continue
        kind, name, index = match.groups()
        if tables and not (kind == "c" and name in state.computes and COMPUTES[state.computes[name].style].array is not None):
            found.append(word)
            continue
        size = count_of(state, kind, name)
        if size == 0:
            raise ParameterError(f"{word}: {'compute' if kind == 'c' else 'fix'} {name} has not several values")
        found += [f"{kind}_{name}[{k}]" for k in read.numeric_range(index, size, f"value of {kind}_{name}")]
    return tuple(found)


def count_of(state: DeckState, kind: str, name: str) -> int:
    """Number of values of the compute (kind ``c``) or fix (``f``) of this name: columns where every bead has some, 0 for a single one."""
    if kind == "f":
        fix = state.fixes.get(name)
        average = None if fix is None else fix.parameters.get("average")
        return 0 if average is None else average.size
    compute = state.computes.get(name)
    if compute is None:
        raise ParameterError(f"there is no compute '{name}'; defined are {', '.join(state.computes) or 'none'}")
    spec = COMPUTES[compute.style]
    return spec.columns(compute) if spec.per_bead is not None or spec.array is not None else spec.size(compute)
