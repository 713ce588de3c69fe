"""Parsers of fixes that act within steps: thermostats, friction, and forces that depend on more than fixed positions.

What the parameters do is in ``lammps/run/acting.py``.
"""

from collections.abc import Callable
from functools import partial

import numpy as np

from ...base.errors import ParameterError
from ...model.flow import AXES
from ..language import arguments as read
from ..language.variables import FORMULAS
from ..state.deck_state import DeckState

FACES = tuple(f"{axis}{end}" for axis in AXES for end in ("lo", "hi"))


def component(state: DeckState, word: str, fix: str, styles: tuple[str, ...] = FORMULAS, what: str = "a component") -> str:
    """A number, or a variable with a formula; ``0`` for no force."""
    if word.startswith("v_"):
        variable = state.variables.get(word[2:])
        if variable.style not in styles:
            raise ParameterError(
                f"fix {fix}: variable {word[2:]} is {variable.style}-style; expected an {'- or '.join(styles)}-style variable"
            )
        return word
    number = read.number(word, f"{what} of fix {fix}")
    return repr(number) if number else "0"


def _check_plane(state: DeckState, fix: str, along: object) -> None:
    """Raise ParameterError if what a fix is given along z takes beads out of the plane."""
    if state.dimension == 2 and along not in ("NULL", "0", None, 0.0):
        raise ParameterError(f"fix {fix}: in two dimensions its force along z must be 0")


def _heat(state: DeckState, words: list[str], fix: str) -> tuple[float, float]:
    """Start and stop of a temperature, as thermal energies."""
    start, stop = (read.non_negative(word, f"a temperature of fix {fix}") * state.units.thermal_energy for word in words)
    return start, stop


def nose_hoover(state: DeckState, group: str, words: list[str], fix: str = "nvt") -> dict:
    """``temp Tstart Tstop Tdamp [tchain N] [tloop N] [drag f]``."""
    found = dict(read.options(words, {"temp": 3, "tchain": 1, "tloop": 1, "drag": 1}, f"fix {fix}"))
    if "temp" not in found:
        raise ParameterError(f"expected 'fix ID group {fix} temp Tstart Tstop Tdamp ...', but no temperature is given")
    kT = _heat(state, found["temp"][:2], fix)
    if not min(kT) > 0:
        raise ParameterError(f"fix {fix}: the temperatures must be above 0")
    damp = read.positive(found["temp"][2], "the damping time of the temperature") * state.units.time
    chain, loop = (read.integer(found.get(word, [default])[0], word, 1) for word, default in (("tchain", "3"), ("tloop", "1")))
    drag = read.non_negative(found.get("drag", ["0"])[0], "drag")
    return {"kT": kT, "damp": damp, "loop": loop, "drag": drag, "lambda": 0.5, "numbers": [0.0] * (3 * chain), "chain": 3 * chain}


def _rescale(state: DeckState, group: str, words: list[str]) -> dict:
    read.count(words, "fix ID group temp/rescale N Tstart Tstop window fraction", 5)
    fraction = read.positive(words[4], "the fraction of temp/rescale")
    if fraction > 1:
        raise ParameterError(f"fix temp/rescale: the fraction must be at most 1, but is {words[4]}")
    window = read.non_negative(words[3], "the window of temp/rescale") * state.units.thermal_energy
    every = read.integer(words[0], "the interval of fix temp/rescale", 1)
    return {"kT": _heat(state, words[1:3], "temp/rescale"), "every": every, "window": window, "fraction": fraction, "numbers": [0.0]}


def _berendsen(state: DeckState, group: str, words: list[str]) -> dict:
    read.count(words, "fix ID group temp/berendsen Tstart Tstop Tdamp", 3)
    damp = read.positive(words[2], "the damping time of temp/berendsen") * state.units.time
    return {"kT": _heat(state, words[:2], "temp/berendsen"), "damp": damp, "numbers": [0.0]}


def _scales(state: DeckState, found: list[tuple[str, list[str]]], fix: str) -> np.ndarray:
    """Factors by bead type, from the options ``scale type ratio``."""
    ratios = np.ones(state.n_types)
    for kind, ratio in (values for keyword, values in found if keyword == "scale"):
        ratios[state.type_number(kind) - 1] = read.positive(ratio, f"a ratio of fix {fix}")
    return ratios


def _langevin(state: DeckState, group: str, words: list[str]) -> dict:
    read.count(words, "fix ID group langevin Tstart Tstop damp seed ...", 4, None)
    only = {"gjf": (read.NO, "use the plain form, as by default"), **dict.fromkeys(("angmom", "omega"), ("no", "beads are points here"))}
    found = read.options(words[4:], {**dict.fromkeys((*only, "tally", "zero"), 1), "scale": 2}, "fix langevin", only=only)
    flags = {word: any(key == word and read.switch(values[0], word) for key, values in found) for word in ("tally", "zero")}
    damp = read.positive(words[2], "the damping time of fix langevin") * state.units.time
    seed, ratios = read.integer(words[3], "the seed of fix langevin", 1), _scales(state, found, "langevin")
    return {"kT": _heat(state, words[:2], "langevin"), "damp": damp, "seed": seed, "ratios": ratios, "numbers": [0.0, 0.0], **flags}


def _viscous(state: DeckState, group: str, words: list[str]) -> dict:
    read.count(words, "fix ID group viscous gamma [scale type ratio ...]", 1, None)
    gamma = read.non_negative(words[0], "the friction of fix viscous")
    return {"gammas": gamma * _scales(state, read.options(words[1:], {"scale": 2}, "fix viscous"), "viscous")}


def _limit(state: DeckState, group: str, words: list[str]) -> dict:
    read.count(words, "fix ID group nve/limit xmax", 1)
    return {"lambda": 0.5, "most": read.positive(words[0], "the largest displacement") * state.units.length, "numbers": [0.0]}


#: Options of fixes that add or set forces; those of setforce and aveforce may be NULL.
_FORCE_OPTIONS = {
    "addforce": ("region", "every", "energy"),
    "efield": ("region", "energy"),
    **dict.fromkeys(("setforce", "aveforce"), ("region",)),
}


def _force(state: DeckState, group: str, words: list[str], fix: str) -> dict:
    read.count(words, f"fix ID group {fix} fx fy fz", 3, None)
    if fix == "efield":
        state.require_atom_style("fix efield", "charge", "full")
    keeps, styles = "energy" not in _FORCE_OPTIONS[fix], ("equal",) if fix == "aveforce" else FORMULAS
    found: dict = {"force": [word if keeps and word == "NULL" else component(state, word, fix, styles) for word in words[:3]]}
    _check_plane(state, fix, found["force"][2])
    for key, (word,) in read.options(words[3:], dict.fromkeys(_FORCE_OPTIONS[fix], 1), f"fix {fix}"):
        if key == "region":
            state.region(word)
        elif key == "energy":
            component(state, word, fix, ("atom",), "the energy")
        found[key] = read.integer(word, f"the interval of fix {fix}", 1) if key == "every" else word
    return {key: value for key, value in found.items() if key != "every" or value > 1}


def _spring(state: DeckState, group: str, words: list[str]) -> dict:
    read.count(words, "fix ID group spring tether K x y z R0 | couple group2 K x y z R0", 6, None)
    couple = read.choice(words[0], "the style of fix spring", ("tether", "couple")) == "couple"
    other, values = words[1] if couple else None, words[1 + couple :]
    read.count(values, f"fix ID group spring {words[0]} ... K x y z R0", 5)
    if other is not None:
        state.group(other)
    place = [None if word == "NULL" else read.number(word, "a coordinate of fix spring") for word in values[1:4]]
    _check_plane(state, "spring", place[2])
    k, length = read.number(values[0], "the spring constant"), read.non_negative(values[4], "the length of the spring")
    return {"other": other, "k": k, "place": place, "length": length}


def _spring_self(state: DeckState, group: str, words: list[str]) -> dict:
    read.count(words, "fix ID group spring/self K [xyz|xy|xz|yz|x|y|z]", 1, 2)
    axes = read.choice(words[1], "the axes of fix spring/self", ("xyz", "xy", "xz", "yz", *AXES)) if len(words) > 1 else "xyz"
    k = read.positive(words[0], "the spring constant")
    return {"k": k, "axes": [axis in axes for axis in AXES], **_starts(state)}


def _starts(state: DeckState) -> dict:
    """Where the beads are, unwrapped, by their ids."""
    ids, x = state.atoms.ids, state.require_box("a fix").unwrap(state.atoms.positions, state.atoms.images)
    return {"ids": np.sort(ids), "start": x[np.argsort(ids)]}


#: Words of fix move by style: how many of them are lengths along the axes, or these over a time, how many may be NULL, and which move beads
#: out of a plane.
_MOVES: dict[str, tuple[str, int, int, tuple[int, ...]]] = {
    "linear": ("Vx Vy Vz", 3, 3, (2,)),
    "wiggle": ("Ax Ay Az period", 3, 3, (2,)),
    "rotate": ("Px Py Pz Rx Ry Rz period", 3, 0, (3, 4)),
    "transrot": ("Vx Vy Vz Px Py Pz Rx Ry Rz period", 6, 0, (2, 6, 7)),
    "variable": ("v_dx v_dy v_dz v_vx v_vy v_vz", 0, 6, (2, 5)),
}


def _move(state: DeckState, group: str, words: list[str]) -> dict:
    way = read.choice(words[0] if words else "", "the style of fix move", list(_MOVES))
    names, scaled, optional, across = _MOVES[way]
    mine, rest = read.taken(words[1:], len(names.split()), f"fix move {way} {names}")
    scale = np.resize(state.spacing(read.single(rest, "fix move", units="lattice")["units"]), scaled)
    values: list = [None if word == "NULL" and k < optional else word for k, word in enumerate(mine)]
    if way == "variable":
        for word in filter(None, values):
            component(state, word if word.startswith("v_") else "a number", "move", what="a variable")
        held = [values[k] is not None or values[k + 3] is not None for k in range(3)]
    else:
        values = [np.nan if word is None else read.number(word, f"a value of fix move {way}") for word in values]
        values[:scaled] = [value * unit for value, unit in zip(values, scale.tolist(), strict=False)]
        held = [not np.isnan(value) for value in values[:3]]
        if way != "linear":
            read.positive(mine[-1], "the period of fix move")
        if "R" in names and not any(values[-4:-1]):
            raise ParameterError(f"fix move {way}: the axis of rotation is zero")
    if state.dimension == 2 and any(isinstance(values[k], str) or np.nan_to_num(values[k] or 0) for k in across):
        raise ParameterError("fix move: in two dimensions beads stay in the plane")
    values = [0.0] * 3 + values if way == "rotate" else values
    return {"way": way, "step": state.step, "values": values, "held": held, **_starts(state)}


#: Pair coefficients that fix adapt changes, by pair style and LAMMPS's name, with their names here.
ADAPTED = {
    "soft": {"a": "A"},
    "dpd": {"a0": "A", "gamma": "gamma"},
    "gauss": {"a": "A"},
    "yukawa": {"alpha": "A"},
    "buck": {"a": "A", "c": "C"},
    **dict.fromkeys(("lj/cut", "lj/class2"), {"epsilon": "epsilon", "sigma": "sigma"}),
    **dict.fromkeys(("morse", "morse/smooth/linear"), {"d0": "D", "alpha": "alpha", "r0": "r0"}),
    "mie/cut": {"epsilon": "epsilon", "sigma": "sigma", "gamR": "n", "gamA": "m"},
}


def _adapt(state: DeckState, group: str, words: list[str]) -> dict:
    usage = "fix ID group adapt N pair style coefficient I J v_name ... [scale yes|no] [reset yes|no]"
    read.count(words, usage, 1, None)
    only = {word: ("", "only pair coefficients can change during a run") for word in ("kspace", "atom", "bond", "angle", "improper")}
    sizes = {"pair": 5, "scale": 1, "reset": 1, **dict.fromkeys(only, 1)}
    found, pairs = read.options(words[1:], sizes, "fix adapt", only=only), []
    for style, name, first, second, word in (values for keyword, values in found if keyword == "pair"):
        base, _, which = style.partition(":")
        known = ADAPTED[read.choice(base, "a pair style of fix adapt", list(ADAPTED))]
        read.choice(name, f"a coefficient of {base}", list(known))
        ranges = [read.numeric_range(kinds, state.n_types, "atom type") for kinds in (first, second)]
        component(state, word if word.startswith("v_") else "v_" + word, "adapt", ("equal",))
        pairs.append((word, f"{base}:{read.integer(which, 'the number of a pair style', 1)}" if which else base, known[name], *ranges))
    if not pairs:
        raise ParameterError(f"expected '{usage}'")
    flags = {key: any(keyword == key and read.switch(values[0], key) for keyword, values in found) for key in ("scale", "reset")}
    return {"every": read.integer(words[0], "the interval of fix adapt", 0), "pairs": pairs, **flags}


#: Coefficients of the walls with a potential, before the cutoff.
WALL_WORDS = {
    **dict.fromkeys(("lj93", "lj126", "lj1043", "harmonic"), ("epsilon", "sigma")),
    "morse": ("D_0", "alpha", "r_0"),
}


def _wall(state: DeckState, group: str, words: list[str], style: str) -> dict:
    names, fix = WALL_WORDS[style], f"wall/{style}"
    read.count(words, f"fix ID group {fix} face coord {' '.join(names)} cutoff ...", 3 + len(names), None)
    sizes = {**dict.fromkeys(FACES, 2 + len(names)), "units": 1, "fld": 1, "pbc": 1}
    only = {"fld": (read.NO, "walls act on all forces here"), "pbc": (read.NO, "make the axis one with boundary f")}
    found = read.options(words, sizes, f"fix {fix}", only=only)
    given = [(face, values) for face, values in found if face in FACES]
    if len(dict(given)) < len(given):
        raise ParameterError(f"fix {fix} gives a face twice")
    box, scale = state.require_box(f"fix {fix}"), state.spacing(dict(found).get("units", ["lattice"])[0])
    faces = {}
    for face, (place, *rest) in given:
        k = AXES.index(face[0])
        if box.periodic[k]:
            raise ParameterError(f"fix {fix} {face}: the box is periodic along {face[0]}; use boundary f along {face[0]}")
        coefficients = [component(state, word, fix, ("equal",), name) for word, name in zip(rest[:-1], names, strict=True)]
        unit = 1.0 if place == "EDGE" else float(scale[k])
        edge = repr(float((box.low if face.endswith("lo") else box.high)[k]))
        where = edge if place == "EDGE" else component(state, place, fix, ("equal",), "the position")
        faces[face] = (where, unit, coefficients, read.positive(rest[-1], "the cutoff of the wall"))
    return {"faces": faces, "potential": style}


def _wall_region(state: DeckState, group: str, words: list[str]) -> dict:
    read.count(words, "fix ID group wall/region region-ID style coefficients cutoff", 4, None)
    state.region(words[0])
    style = read.choice(words[1], "the style of fix wall/region", list(WALL_WORDS))
    names = WALL_WORDS[style]
    read.count(words[2:], f"fix ID group wall/region region-ID {style} {' '.join(names)} cutoff", len(names) + 1)
    coefficients = [repr(read.number(word, f"{name} of fix wall/region")) for word, name in zip(words[2:-1], names, strict=True)]
    cutoff = read.positive(words[-1], "the cutoff of the wall")
    return {"region": words[0], "potential": style, "coefficients": coefficients, "cutoff": cutoff}


#: Parsers of fixes, by style.
ACTING_STYLES: dict[str, Callable[..., dict]] = {
    "nvt": nose_hoover,
    "nve/limit": _limit,
    "move": _move,
    "adapt": _adapt,
    **{"temp/rescale": _rescale, "temp/berendsen": _berendsen, "langevin": _langevin, "viscous": _viscous},
    **{style: partial(_force, fix=style) for style in _FORCE_OPTIONS},
    **{"spring": _spring, "spring/self": _spring_self, "wall/region": _wall_region},
    **{f"wall/{style}": partial(_wall, style=style) for style in WALL_WORDS},
}
