"""Fixes that drive, confine and stop a flow: addforce, gravity, setforce, wall/reflect and momentum."""

from ...errors import ParameterError
from ...model.flow import AXES
from ..language import arguments as read
from ..language.variables import FORMULAS
from ..state.deck_state import DeckState
from ..state.momentum import MomentumRemoval
from .setup import FixReader

_FACES = tuple(f"{axis}{end}" for axis in AXES for end in ("lo", "hi"))


def _component(state: DeckState, word: str, fix: str, styles: tuple[str, ...] = FORMULAS) -> str:
    """A number or a variable that exists as a formula; ``0`` for no force."""
    if word.startswith("v_"):
        variable = state.variables.get(word[2:])
        if variable.style not in styles:
            raise ParameterError(
                f"fix {fix}: variable {word[2:]} is {variable.style}-style; an {'- or '.join(styles)}-style one is expected"
            )
        return word
    number = read.number(word, f"a component of fix {fix}")
    return repr(number) if number else "0"


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


#: Directions of fix gravity as formulas, by style: how many words they have, and what they make of them.
_DIRECTIONS: dict[str, tuple[int, tuple[str, str, str]]] = {
    "vector": (3, ("{0}/sqrt({0}^2+{1}^2+{2}^2)", "{1}/sqrt({0}^2+{1}^2+{2}^2)", "{2}/sqrt({0}^2+{1}^2+{2}^2)")),
    "chute": (1, ("sin(PI*{0}/180)", "0", "-cos(PI*{0}/180)")),
    "spherical": (2, ("sin(PI*{1}/180)*cos(PI*{0}/180)", "sin(PI*{1}/180)*sin(PI*{0}/180)", "cos(PI*{1}/180)")),
}


def _gravity(state: DeckState, group: str, words: list[str]) -> dict:
    read.count(words, "fix ID group gravity magnitude style values ...", 3, None)
    size, formulas = read.style(_DIRECTIONS, "fix gravity", words[1])
    read.count(words[2:], f"fix ID group gravity magnitude {words[1]} values ...", size)
    magnitude, *values = (f"({_component(state, word, 'gravity', ('equal',))})" for word in (words[0], *words[2:]))
    if values == ["(0)"] * 3:
        raise ParameterError("fix gravity vector 0 0 0 has no direction")
    return {"force": ["0" if formula == "0" else f"mass*{magnitude}*({formula.format(*values)})" for formula in formulas]}


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


FLOW_FIXES: dict[str, FixReader] = {
    "addforce": _addforce,
    "gravity": _gravity,
    "setforce": _setforce,
    "wall/reflect": _wall_reflect,
    "momentum": _momentum,
}
