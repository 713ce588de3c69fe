"""The command change_box: other faces, tilts and boundaries of an existing box."""

from dataclasses import replace

import numpy as np

from ...base.errors import ParameterError
from ..language import arguments as read
from ..state.box import Box
from ..state.deck_state import DeckState
from ..state.deforming import PARTS
from .box import set_box
from .setup import boundary, command

#: Number of values of what is done to an edge.
_WAYS = {"final": 2, "delta": 2, "scale": 1, "volume": 0}
_OTHERS = {"boundary": 3, "ortho": 0, "triclinic": 0, "set": 0, "remap": 0}

#: What is done: keyword, way (of edges and tilts), values.
Operation = tuple[str, str, list[str]]


@command("change_box group keyword ...", 2, None, box=True)
def change_box(state: DeckState, args: list[str]) -> None:
    """``change_box group x|y|z final|delta|scale|volume ...``, ``xy|xz|yz final|delta value``, ``boundary``, ``ortho``, ``triclinic``,
    ``set``, ``remap``, one after the other, and ``units``."""
    mask = state.group(args[0])
    operations, units = _parsed(args[1:])
    spacing = state.spacing(units)
    saved = state.require_box("change_box")
    for k, (keyword, way, words) in enumerate(operations):
        box = state.require_box("change_box")
        if keyword == "boundary":
            boundary(state, words)
            set_box(state, replace(box, periodic=(True, True, True)))
            state.atoms.images = np.where(state.periodic, state.atoms.images, 0)
        elif keyword in ("ortho", "triclinic"):
            if keyword == "ortho" and box.tilt.any():
                raise ParameterError("change_box ortho: the box is tilted")
            set_box(state, replace(box, triclinic=keyword == "triclinic"))
        elif keyword in ("set", "remap"):
            if keyword == "remap":
                moved = box.places(saved.fractions(state.atoms.positions))
                state.atoms.positions = np.where(mask[:, None], moved, state.atoms.positions)
            saved = box
        else:
            values = [read.number(word, f"a value of change_box {keyword} {way}") for word in words]
            if way == "volume":
                values = [_compensating(box, saved, operations, k)]
            elif way != "scale":
                values = [value * float(spacing[PARTS[keyword]]) for value in values]
            set_box(state, _changed(box, saved, keyword, way, values))
    box = state.require_box("change_box")
    inside, shifts = box.wrap(state.atoms.positions)
    lost = ~box.holds(inside) if not all(box.periodic) else np.zeros(len(inside), dtype=bool)
    if lost.any():
        raise ParameterError(f"change_box: bead {state.atoms.ids[np.argmax(lost)]} lies outside the box along an axis that is not periodic")
    state.take_inside(inside, shifts)


def _parsed(words: list[str]) -> tuple[list[Operation], str]:
    """What is done, and the option ``units``."""
    found: list[Operation] = []
    units = "lattice"
    while words:
        keyword, *words = words
        way = ""
        if keyword == "units":
            (units,), words = read.taken(words, 1, "change_box units")
            continue
        if keyword in PARTS:
            (way,), words = read.taken(words, 1, f"change_box {keyword}")
            read.choice(way, f"the change of {keyword}", list(_WAYS)[: 4 if len(keyword) == 1 else 2])
        else:
            read.choice(keyword, "a keyword of change_box", [*PARTS, *_OTHERS, "units"])
        size = _OTHERS.get(keyword, 1 if len(keyword) == 2 else _WAYS.get(way, 0))
        values, words = read.taken(words, size, f"change_box {keyword} {way}".rstrip())
        found.append((keyword, way, values))
    return found, units


def _changed(box: Box, saved: Box, keyword: str, way: str, values: list[float]) -> Box:
    """The box with another edge or tilt; ``saved`` is what the change refers to."""
    low, high, tilt, k = box.low.copy(), box.high.copy(), box.tilt.copy(), PARTS[keyword]
    if len(keyword) == 2:
        k = ("xy", "xz", "yz").index(keyword)
        if not box.triclinic:
            raise ParameterError(f"change_box {keyword} needs a triclinic box: put 'triclinic' before it")
        tilt[k] = values[0] + (saved.tilt[k] if way == "delta" else 0.0)
    elif way in ("final", "delta"):
        low[k], high[k] = np.array(values) + ((saved.low[k], saved.high[k]) if way == "delta" else 0.0)
    else:
        middle = 0.5 * (saved.low[k] + saved.high[k])
        low[k], high[k] = middle - 0.5 * values[0] * saved.edges[k], middle + 0.5 * values[0] * saved.edges[k]
    return replace(box, low=low, high=high, tilt=tilt)


def _compensating(box: Box, saved: Box, operations: list[Operation], k: int) -> float:
    """Factor of an edge that, with that of another edge that keeps the volume, makes up for what has just been done to one edge."""
    first = last = k
    while first > 0 and operations[first][1] == "volume":
        first -= 1
    while last + 1 < len(operations) and operations[last + 1][1] == "volume":
        last += 1
    edges = [keyword for keyword, _, _ in operations[first : last + 1]]
    if first == k or len(edges[0]) > 1 or edges[0] in edges[1:]:
        raise ParameterError(f"change_box {operations[k][0]} volume must follow a change of another edge")
    return float(box.edges[PARTS[edges[0]]] / saved.edges[PARTS[edges[0]]]) ** (-1.0 / len(edges[1:]))
