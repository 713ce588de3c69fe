"""Fix styles: equations of state, sources, pressure, body forces, walls, momentum, shear, and the integrators."""

from collections.abc import Callable
from functools import partial

import numpy as np

from ...base.errors import ParameterError
from ...model.eos import ConstantHeatCapacity, TabulatedEOS
from ...model.flow import AXES
from ...model.sources import Block, Sphere
from ..files.table_file import read_eos
from ..language import arguments as read
from ..state.deck_state import DeckState
from ..state.deforming import Deforming, parse_deforming
from ..state.records import NO_LIMIT, MomentumRemoval, PressureControl
from ..state.rigid import RIGID, parse_rigid
from .motion_styles import ACTING_STYLES, FACES, component, nose_hoover

#: Parser of a fix: its parameters from (state, group, words).
FixReader = Callable[[DeckState, str, list[str]], dict]


# -- internal energies --------------------------------------------------------------------------------------------------------
def _eos_cv(state: DeckState, group: str, words: list[str]) -> dict:
    read.count(words, "fix ID group eos/cv cv", 1)
    state.require_atom_style("fix eos/cv", "dpd")
    # the model's heat capacities are in units of k_B
    capacity = read.positive(words[0], "the heat capacity") / state.units.boltzmann
    return {"eos": ConstantHeatCapacity(capacity), "source": capacity}


def _eos_table(state: DeckState, group: str, words: list[str]) -> dict:
    read.count(words, "fix ID group eos/table linear file N keyword", 4)
    state.require_atom_style("fix eos/table", "dpd")
    read.choice(words[0], "the style of eos/table", ("linear",))
    read.integer(words[2], "the size of the table", 2)
    path = state.find_file(words[1])
    temperatures, energies = read_eos(path, words[3])
    state.note("fix eos/table: a monotone curve through the points of the file is used, regardless of the number of table points")
    table = TabulatedEOS(temperatures * state.units.thermal_energy, energies * state.units.energy)
    return {"eos": table, "source": (path.resolve(), words[3])}


# -- sources ------------------------------------------------------------------------------------------------------------------
_PLACES = {"sphere": "cx cy cz R", "cuboid": "cx cy cz Lx Ly Lz", "region": "ID"}


def _place(state: DeckState, words: list[str], style: str) -> tuple[Block | Sphere, float]:
    """Region and rate from ``sphere|cuboid|region ... value``."""
    usage = " | ".join(f"{name} {values} value" for name, values in _PLACES.items())
    read.count(words, usage, 1, None)
    kind = read.choice(words[0], f"the region of fix {style}", list(_PLACES))
    read.count(words[1:], f"{kind} {_PLACES[kind]} value", len(_PLACES[kind].split()) + 1)
    rate, length = read.number(words[-1], "the rate of the source"), state.units.length
    if kind == "region":
        region = state.region(words[1])
        if region.shape is None or state.regions[words[1]].renewed is not None:
            raise ParameterError(f"fix {style}: region '{words[1]}' must be the inside of a block or sphere without variables")
        first, second = region.shape
        if region.style == "block":
            return Block(first * length, np.asarray(second) * length), rate
        return Sphere(first * length, float(second) * length), rate
    values = np.array([read.number(word, f"a value of {kind}") for word in words[1:-1]])
    if kind == "cuboid":
        return Block.centred(values[:3] * length, values[3:] * length), rate
    if values[3] != 1:
        state.note(
            f"fix {style}: the radius of the sphere is {values[3]:g}; LAMMPS compares r^2 with R^3, so its radius is {values[3] ** 1.5:g}"
        )
    return Sphere(values[:3] * length, float(values[3] * length)), rate


def _edpd_source(state: DeckState, group: str, words: list[str]) -> dict:
    state.require_atom_style("fix edpd/source", "edpd")
    region, rate = _place(state, words, "edpd/source")
    return {"region": region, "rate": rate * state.units.thermal_energy / state.units.time, "species": 0}


def _tdpd_source(state: DeckState, group: str, words: list[str]) -> dict:
    state.require_atom_style("fix tdpd/source", "tdpd")
    read.count(words, "fix ID group tdpd/source species sphere|cuboid|region ... value", 2, None)
    species = state.species(words[0], "fix tdpd/source")
    region, rate = _place(state, words[1:], "tdpd/source")
    return {"region": region, "rate": rate / state.units.time, "species": species}


# -- constant pressure --------------------------------------------------------------------------------------------------------
#: Options of fix nph about LAMMPS's equations of motion of the box: number of values.
_DYNAMICS = {"drag": 1, "pchain": 1, "ploop": 1, "nreset": 1, "mtk": 1, "ptemp": 1, "flip": 1, "update": 1, "fixedpoint": 3}
_DYNAMICS |= {"scalexy": 1, "scalexz": 1, "scaleyz": 1}
_SIZES = {**dict.fromkeys(("iso", "aniso", "x", "y", "z"), 3), "couple": 1, "dilate": 1, **_DYNAMICS}


def _npt(state: DeckState, group: str, words: list[str]) -> dict:
    """The words of fix nvt, and those of fix nph."""
    mine = list[str]()
    for word, size in {"temp": 4, "tchain": 2, "tloop": 2}.items():
        k = words.index(word) if word in words else len(words)
        mine, words = mine + words[k : k + size], words[:k] + words[k + size :]
    drag = dict(read.options(words, _SIZES, "fix npt")).get("drag", ["0"])
    heat, box = nose_hoover(state, group, [*mine, "drag", *drag], "npt"), _nph(state, group, words, "npt")
    return box | heat | {"numbers": heat["numbers"] + box["numbers"]}


def _nph(state: DeckState, group: str, words: list[str], fix: str = "nph") -> dict:
    box, options = state.require_box(f"fix {fix}"), {"pchain": ["3"], "ploop": ["1"], "mtk": ["yes"], "drag": ["0"]}
    start: list[float | None] = [None] * 3
    stop = [0.0] * 3
    coupled, plane, unused, damps = False, False, [], [0.0] * 3
    if state.dimension == 2:
        raise ParameterError(f"fix {fix} is not supported in two dimensions")
    only = {"dilate": ("all", "all beads move with the box")}
    if fix == "npt":
        only |= dict.fromkeys(("nreset", "ptemp"), ("0", "")) | {"update": ("dipole", "beads are points here")}
        if group != "all" or box.tilt.any():
            raise ParameterError("fix npt needs the group all, and a box without tilt")
    for keyword, values in read.options(words, _SIZES, f"fix {fix}", only=only):
        if keyword == "couple":
            coupled, plane = (read.choice(values[0], "couple", ("none", "xyz", "xy")) == word for word in ("xyz", "xy"))
        elif keyword in _DYNAMICS:
            unused.append(keyword)
            options[keyword] = values
        elif keyword != "dilate":
            first, last = (read.number(word, f"the pressure of {keyword}") for word in values[:2])
            damp = read.positive(values[2], "the damping time of the box") * state.units.time
            coupled = keyword == "iso"
            for axis in range(3) if keyword in ("iso", "aniso") else ["xyz".index(keyword)]:
                start[axis], stop[axis], damps[axis] = first, last, damp
    axes = tuple(value is not None for value in start)
    low = tuple(state.units.pressure * (value or 0.0) for value in start)
    high = tuple(state.units.pressure * value for value in stop)
    if not any(axes):
        raise ParameterError(f"expected 'fix ID group {fix} iso|aniso|x|y|z Pstart Pstop Pdamp ...', but no pressure is given")
    if coupled and not (all(axes) and len(set(low)) == len(set(high)) == 1):
        raise ParameterError(f"fix {fix}: coupled edges (couple xyz) need the same pressure along x, y and z")
    if plane and (not all(axes[:2]) or len({p for p, used in zip(low, axes, strict=True) if used}) > 1):
        raise ParameterError(f"fix {fix}: coupled edges (couple xy) need the same pressure along x, y and z, or none along z")
    about = [read.number(word, "fixedpoint") for word in options.get("fixedpoint", map(repr, (0.5 * (box.low + box.high)).tolist()))]
    chain, loop = (read.integer(options[word][0], word, 1) for word in ("pchain", "ploop"))
    piston = {"loop": loop, "drag": float(options["drag"][0]), "mtk": read.switch(options["mtk"][0], "mtk"), "about": about}
    control = PressureControl(axes, coupled, low, high, plane, tuple(damps))  # type: ignore[arg-type]
    found = {"lambda": 0.5, "pressure": control, "piston": piston, "unused": unused}
    return found | {"chain": 0, "numbers": [0.0] * (6 + 3 * chain)}


# -- flow ----------------------------------------------------------------------------------------------------------------------
#: Directions of fix gravity by style: number of words, and formulas of the three components.
_DIRECTIONS: dict[str, tuple[int, tuple[str, str, str]]] = {
    "vector": (3, ("{0}/sqrt({0}^2+{1}^2+{2}^2)", "{1}/sqrt({0}^2+{1}^2+{2}^2)", "{2}/sqrt({0}^2+{1}^2+{2}^2)")),
    "chute": (1, ("sin(PI*{0}/180)", "0", "-cos(PI*{0}/180)")),
    "spherical": (2, ("sin(PI*{1}/180)*cos(PI*{0}/180)", "sin(PI*{1}/180)*sin(PI*{0}/180)", "cos(PI*{1}/180)")),
}
#: Those in two dimensions.
_FLAT_DIRECTIONS: dict[str, tuple[int, tuple[str, str, str]]] = {
    "vector": (3, ("{0}/sqrt({0}^2+{1}^2)", "{1}/sqrt({0}^2+{1}^2)", "0")),
    "chute": (1, ("sin(PI*{0}/180)", "-cos(PI*{0}/180)", "0")),
    "spherical": (2, ("sin(PI*{1}/180)", "cos(PI*{1}/180)", "0")),
}


def _gravity(state: DeckState, group: str, words: list[str]) -> dict:
    read.count(words, "fix ID group gravity magnitude style values ...", 3, None)
    size, formulas = read.style(_DIRECTIONS if state.dimension == 3 else _FLAT_DIRECTIONS, "fix gravity", words[1])
    read.count(words[2:], f"fix ID group gravity magnitude {words[1]} values ...", size)
    magnitude, *values = (f"({component(state, word, 'gravity', ('equal',))})" for word in (words[0], *words[2:]))
    if values == ["(0)"] * 3:
        raise ParameterError("fix gravity vector 0 0 0 has no direction")
    return {"force": ["0" if formula == "0" else f"mass*{magnitude}*({formula.format(*values)})" for formula in formulas]}


def _wall_reflect(state: DeckState, group: str, words: list[str]) -> dict:
    read.count(words, "fix ID group wall/reflect face position ...", 2, None)
    box, scale = state.require_box("fix wall/reflect"), state.lattice.spacing
    faces: dict[str, str] = {}
    for keyword, values in read.options(words, {**dict.fromkeys(FACES, 1), "units": 1}, "fix wall/reflect"):
        if keyword == "units":
            scale = state.spacing(values[0])
        elif keyword in faces:
            raise ParameterError(f"fix wall/reflect gives {keyword} twice")
        else:
            faces[keyword] = values[0]
    found = {}
    for face, word in faces.items():
        k = AXES.index(face[0])
        if box.periodic[k]:
            remedy = f"'boundary {' '.join('f' if axis == k or not box.periodic[axis] else 'p' for axis in range(3))}'"
            raise ParameterError(f"fix wall/reflect {face}: the box is periodic along {face[0]}; use {remedy}")
        if word.startswith("v_"):
            raise ParameterError(f"fix wall/reflect {face} {word}: moving walls are not supported; give EDGE or a number")
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
        raise ParameterError(f"fix momentum removes nothing; expected '{usage}' with a linear flag of 1, or angular")
    return {"momentum": MomentumRemoval(every, (x, y, z), "angular" in found, "rescale" in found)}


def _deform(state: DeckState, group: str, words: list[str]) -> dict:
    usage = "fix ID all deform 1 xy erate R remap v"
    read.count(words, f"{usage}, or edges and tilts with remap x", 1, None)
    every, box = read.integer(words[0], "the interval of fix deform", 1), state.require_box("fix deform")
    changes, options = parse_deforming(words[1:], state.spacing)
    if not all(box.periodic):
        raise ParameterError("fix deform needs a box that is periodic along all axes")
    tilts = [part for part in changes if len(part) == 2]
    if tilts and not box.triclinic:
        raise ParameterError(
            f"fix deform {tilts[0]} needs a triclinic box: change_box all triclinic, a region prism, or a data file with a line xy xz yz"
        )
    if state.dimension == 2 and {"z", "xz", "yz"} & set(changes):
        raise ParameterError("fix deform: in two dimensions z does not change")
    if options["flip"] != "yes":
        raise ParameterError("fix deform flip no is not supported: the box is tilted by at most half an edge; remove it")
    if options["remap"] != "v":
        return {"deforming": Deforming(every, changes, options["remap"] == "x", box)}
    plane = next(iter(changes))
    if list(changes) != tilts or len(tilts) > 1 or changes[plane][0] != "erate":
        raise ParameterError(
            f"fix deform {' '.join(changes)} with remap v is not supported: friction between beads and images that move is there for a "
            f"constant rate of shear in one plane, '{usage}' (or xz, yz); move the beads with the box by remap x"
        )
    if group != "all":
        raise ParameterError("fix deform shears all beads; its group must be all")
    others = [tilt for tilt in ("xy", "xz", "yz") if tilt != plane]
    if box.tilt[[("xy", "xz", "yz").index(tilt) for tilt in others]].any():
        raise ParameterError(f"fix deform {plane} with remap v needs a box without tilts {' and '.join(others)}")
    if plane != "xy":
        axes = "x, z and -y" if plane == "xz" else "y, z and x"
        state.note(f"fix deform {plane}: the axes of the scene, and of its final state, are {axes} of the deck")
    if every > 1:
        state.note(f"fix deform: the images move at every step, not only every {every} steps")
    return {"rate": changes[plane][1][0] / state.units.time, "plane": plane}


def _enforce2d(state: DeckState, group: str, words: list[str]) -> dict:
    read.count(words, "fix ID group enforce2d", 0)
    if state.dimension == 3:
        raise ParameterError("fix enforce2d needs dimension 2")
    return {}


# -- motion --------------------------------------------------------------------------------------------------------------------
def _moving(style: str, most: int) -> FixReader:
    """Parser of a fix that moves beads, with an optional lambda if ``most`` is 1."""

    def reader(state: DeckState, group: str, words: list[str]) -> dict:
        read.count(words, f"fix ID group {style}{' [lambda]' * most}", 0, most)
        value = read.number(words[0], "lambda") if words else 0.5
        if not 0 <= value <= 1:
            raise ParameterError(f"lambda must be between 0 and 1, but is {value:g}")
        return {"lambda": value}

    return reader


def _of_all(style: str, atom_style: str | None = None) -> FixReader:
    """Parser of a fix without arguments that acts on all beads."""

    def reader(state: DeckState, group: str, words: list[str]) -> dict:
        read.count(words, f"fix ID group {style}", 0)
        if atom_style is not None:
            state.require_atom_style(f"fix {style}", atom_style)
        if group != "all":
            state.note(f"fix {style} acts on all beads, not only on its group")
        return {}

    return reader


# -- bonds -----------------------------------------------------------------------------------------------------------------------
def _bond_type(state: DeckState, word: str) -> int:
    kind = read.integer(state.numbered("bond", word), "the bond type", 1)
    if kind > state.n_bond_types:
        raise ParameterError(f"bond type {kind} is out of range: there are {state.n_bond_types}")
    return kind


def _chance(words: list[str]) -> float:
    value = read.number(words[0], "the probability")
    if not 0 <= value <= 1:
        raise ParameterError(f"the probability must be between 0 and 1, but is {value:g}")
    read.integer(words[1], "the seed", 1)
    return value


#: Terms that come with bonds, by the words of fix bond/create for their types.
_COME = {"atype": "angle", "dtype": "dihedral", "itype": "improper"}


def _bond_create(state: DeckState, group: str, words: list[str], bent: bool = False) -> dict:
    usage = "fix ID all bond/create N itype jtype Rmin bondtype [iparam maxbond itype] [jparam maxbond jtype] [prob fraction seed]"
    read.count(words, usage, 5, None)
    types = tuple(state.type_number(state.numbered("atom", word)) for word in words[1:3])
    most, later, probability, terms, where = {"iparam": 0, "jparam": 0}, list(types), 1.0, dict.fromkeys(_COME.values(), 0), "off"
    sizes = {"iparam": 2, "jparam": 2, "prob": 2} | dict.fromkeys((*_COME, "molecule"), 1) | ({"aconstrain": 2} if bent else {})
    between: tuple[float, ...] | None = None
    for keyword, values in read.options(words[5:], sizes, "fix bond/create"):
        if keyword == "molecule":
            where = read.choice(values[0], "molecule", ("off", "inter", "intra"))
        elif keyword == "prob":
            probability = _chance(values)
        elif keyword in _COME:
            what = _COME[keyword]
            terms[what] = read.integer(state.numbered(what, values[0]), f"the {what} type", 0)
            if terms[what] > (there := getattr(state, f"n_{what}_types")):
                raise ParameterError(f"{what} type {terms[what]} is out of range: there are {there}")
        elif keyword == "aconstrain":
            between = tuple(np.radians(read.number(word, "an angle of aconstrain")) for word in values)
        else:
            most[keyword] = read.integer(values[0], "maxbond", 0)
            later[keyword == "jparam"] = state.type_number(state.numbered("atom", values[1]))
    if types[0] == types[1] and (most["iparam"] != most["jparam"] or later[0] != later[1]):
        raise ParameterError("fix bond/create: iparam and jparam of one atom type must be the same")
    every, length = read.integer(words[0], "the interval", 1), read.positive(words[3], "Rmin")
    given: dict = {"bond": _bond_type(state, words[4]), "probability": probability, "counts": [0.0, 0.0], "between": between, **terms}
    later = [new if limit else old for new, old, limit in zip(later, types, most.values(), strict=True)]
    given["becomes"] = None if tuple(later) == types else tuple(map(str, later))
    limits = tuple(limit or NO_LIMIT for limit in most.values())
    return {"every": every, "types": types, "length": length, "most": limits, "molecule": where, "unlimited": 0 in most.values(), **given}


def _bond_break(state: DeckState, group: str, words: list[str]) -> dict:
    read.count(words, "fix ID all bond/break N bondtype Rmax [prob fraction seed]", 3, None)
    options = dict(read.options(words[3:], {"prob": 2}, "fix bond/break"))
    every, length = read.integer(words[0], "the interval", 1), read.non_negative(words[2], "Rmax")
    rest = {"probability": _chance(options["prob"]) if options else 1.0, "counts": [0.0, 0.0]}
    return {"every": every, "bond": _bond_type(state, words[1]), "length": length, **rest}


def _balance(state: DeckState, group: str, words: list[str]) -> dict:
    state.note("fix balance has no effect here; keep it for LAMMPS")
    return {}


#: Parsers of fixes, by style.  What the parameters do is in ``lammps/scene/`` and ``lammps/run/``.
FIX_STYLES: dict[str, FixReader] = {
    **{"nve": _moving("nve", 0), "nve/sphere": _moving("nve/sphere", 0)},
    **{style: _moving(style, 1) for style in ("mvv/dpd", "mvv/edpd", "mvv/tdpd")},
    **{"shardlow": _of_all("shardlow"), "dpd/energy": _of_all("dpd/energy", "dpd"), "eos/cv": _eos_cv, "eos/table": _eos_table},
    **{"edpd/source": _edpd_source, "tdpd/source": _tdpd_source, "nph": _nph, "npt": _npt, "gravity": _gravity},
    **{"wall/reflect": _wall_reflect, "momentum": _momentum, "deform": _deform, "enforce2d": _enforce2d, **ACTING_STYLES},
    **{"balance": _balance, "bond/create": _bond_create, "bond/create/angle": partial(_bond_create, bent=True), "bond/break": _bond_break},
    **{style: partial(parse_rigid, fix=style) for style in RIGID},
}
