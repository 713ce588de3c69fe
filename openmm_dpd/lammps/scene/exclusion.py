"""Pairs that ``neigh_modify exclude`` leaves out: beads of one type that leave out different pairs get types of their own."""

from copy import copy
from dataclasses import dataclass

import numpy as np

from ...base.errors import ParameterError
from ...model.pairs import NONE, PairTable
from ..state.deck_state import DeckState, pairs_left_out
from ..state.rigid import other_exclusions

#: More types than this are rejected: the tables of pairs become large.
_MOST = 300


@dataclass(frozen=True)
class ScenePairs:
    """Bead types and pair tables of a scene."""

    types: list[str]  #: Type of each bead
    of_deck: dict[str, int]  #: The deck's type of each
    tables: list[PairTable]


def scene_pairs(state: DeckState, tables: list[PairTable]) -> ScenePairs:
    """The deck's types and ``tables``, without the pairs that the deck excludes.  ParameterError if these need too many types."""
    numbers = [*map(str, range(1, state.n_types + 1))]
    state = copy(state)
    state.exclusions = other_exclusions(state)
    if not state.exclusions:
        return ScenePairs([numbers[k - 1] for k in state.atoms.types.tolist()], {name: k for k, name in enumerate(numbers, 1)}, tables)
    for style in state.pair.styles:
        if style.name == "dpd/fdt/energy" or style.spec.of_bonds or "cutoff_charges" in style.settings:
            raise style.error("neigh_modify exclude is not supported with this style; use pair_coeff none, or special_bonds")
    columns = [state.atoms.types]
    for kind, *words in state.exclusions:
        for word in words if kind != "type" else ():
            if word in state.dynamic:
                raise ParameterError(f"neigh_modify exclude: group {word} is dynamic, but the excluded beads cannot change")
            mask = state.group(word)
            columns.append(mask if kind == "group" else np.where(mask, state.atoms.molecules, np.iinfo(np.int64).min))
    # types without beads come last, in no group
    spare = np.setdiff1d(np.arange(1, state.n_types + 1), state.atoms.types)
    found, first, of_bead = np.unique(np.stack(columns, axis=1).astype(np.int64), axis=0, return_index=True, return_inverse=True)
    if len(found) > _MOST:
        raise ParameterError(
            f"neigh_modify exclude needs {len(found)} kinds of beads that exclude different ones; at most {_MOST} are possible"
        )
    kinds = [*found[:, 0].tolist(), *spare.tolist()]
    of_kinds = lambda values: np.append(values[first], np.zeros(len(spare), dtype=values.dtype))  # noqa: E731
    out = pairs_left_out(state, np.array(kinds), of_kinds, *np.indices((len(kinds), len(kinds))))
    names = [f"{k}.{kinds[:n].count(k)}" if k in kinds[:n] else str(k) for n, k in enumerate(kinds)]
    order = sorted(range(len(names)), key=lambda n: (kinds[n], n))
    made, known = [], {key for table in tables for key in table.entries}
    for at, table in enumerate(tables):
        entries = {}
        for a in range(len(names)):
            for b in range(a, len(names)):
                key = str(min(kinds[a], kinds[b])), str(max(kinds[a], kinds[b]))
                if out[a, b] and key in known and not at:  # whichever table has it
                    entries[(names[a], names[b])] = NONE
                elif not out[a, b] and key in table.entries:
                    entries[(names[a], names[b])] = table.entries[key]
        if entries:  # an overlay may be left with no pair
            made.append(PairTable(entries))
    return ScenePairs([names[k] for k in of_bead.ravel().tolist()], {names[n]: kinds[n] for n in order}, made)
