"""Fixes that drive and confine a flow: addforce, setforce and wall/reflect."""

from __future__ import annotations

from ...errors import ParameterError
from ...model.flow import AXES
from ..language import arguments as read
from ..state.deck_state import DeckState
from .setup import FixReader

_FACES = tuple(f"{axis}{end}" for axis in AXES for end in ("lo", "hi"))


def _component(state: DeckState, word: str, fix: str) -> str:
    """A number, or a variable that exists, as it stands in the deck."""
    if word.startswith("v_"):
        variable = state.variables.get(word[2:])
        if variable.style not in ("equal", "atom"):
            raise ParameterError(f"fix {fix}: variable {word[2:]} is {variable.style}-style; an equal- or atom-style one is expected")
    else:
        read.number(word, f"a component of fix {fix}")
    return word


def _addforce(state: DeckState, group: str, words: list[str]) -> dict:
    read.count(words, "fix ID group addforce fx fy fz", 3, None)
    for keyword, values in read.options(words[3:], {"every": 1, "region": 1, "energy": 1}, "fix addforce"):
        if keyword == "every" and read.integer(values[0], "every", 1) == 1:
            continue
        remedy = {"region": "use an atom-style variable such as 0.1*(z<5)", "every": "the force acts at every step"}
        raise ParameterError(f"fix addforce {keyword} is not supported; {remedy.get(keyword, 'the force has no potential energy here')}")
    return {"force": [_component(state, word, "addforce") for word in words[:3]]}


def _setforce(state: DeckState, group: str, words: list[str]) -> dict:
    read.count(words, "fix ID group setforce fx fy fz", 3, None)
    for keyword, _ in read.options(words[3:], {"region": 1}, "fix setforce"):
        raise ParameterError(f"fix setforce {keyword} is not supported; make a group of the region")
    return {"force": [word if word == "NULL" else _component(state, word, "setforce") for word in words[:3]]}


def _wall_reflect(state: DeckState, group: str, words: list[str]) -> dict:
    read.count(words, "fix ID group wall/reflect face position ...", 2, None)
    box, scale = state.require_box("fix wall/reflect"), state.lattice.spacing
    faces: dict[str, str] = {}
    for keyword, values in read.options(words, {**dict.fromkeys(_FACES, 1), "units": 1}, "fix wall/reflect"):
        if keyword == "units":
            scale = state.spacing(values[0])
        elif keyword in faces:
            raise ParameterError(f"fix wall/reflect names {keyword} twice")
        else:
            faces[keyword] = values[0]
    found = {}
    for face, word in faces.items():
        k = AXES.index(face[0])
        if box.periodic[k]:
            remedy = f"'boundary {' '.join('f' if axis == k or not box.periodic[axis] else 'p' for axis in range(3))}'"
            raise ParameterError(f"fix wall/reflect {face}: the box is periodic along {face[0]}; say {remedy}")
        if word.startswith("v_"):
            raise ParameterError(f"fix wall/reflect {face} {word}: walls that move are not supported; give EDGE or a number")
        low, high = float(box.low[k]), float(box.high[k])
        place = (low if face.endswith("lo") else high) if word == "EDGE" else read.number(word, f"the position of {face}") * float(scale[k])
        if not low <= place <= high:
            raise ParameterError(f"fix wall/reflect {face}: the wall lies outside the box")
        found[face] = place * state.units.length
    if not found:
        raise ParameterError("fix wall/reflect needs a face, such as zlo EDGE")
    return {"faces": found}


FLOW_FIXES: dict[str, FixReader] = {"addforce": _addforce, "setforce": _setforce, "wall/reflect": _wall_reflect}
