"""Commands on existing beads: mass, group, set."""

from collections.abc import Callable

import numpy as np

from ...base.errors import ParameterError
from ..files.data_file import BONDED_STYLES, CHARGED_STYLES
from ..language import arguments as read
from ..output.averages import DynamicGroup
from ..state.deck_state import DeckState
from .moving import values_of_variable
from .setup import command


@command("mass type value", 2, box=True)
def mass(state: DeckState, args: list[str]) -> None:
    value = read.positive(args[1], "the mass")
    if state.has_atom_style("sphere"):
        if state.atom_style == "sphere":
            raise ParameterError("beads of atom_style sphere have masses by diameter and density, not by type; use set type N mass M")
        state.note("mass has no effect beside atom_style sphere, as in LAMMPS: its beads have masses by diameter and density")
    for kind in read.numeric_range(args[0], state.n_types, "atom type"):
        state.masses[kind] = value * state.units.mass


# -- groups -----------------------------------------------------------------------------------------------------------------
_COMPARE = {"<": np.less, ">": np.greater, "<=": np.less_equal, ">=": np.greater_equal, "==": np.equal, "!=": np.not_equal}


def _matching(values: np.ndarray, words: list[str], what: str) -> np.ndarray:
    """Mask of the values that are in a list of numbers and n:m ranges, or fulfil a comparison such as ``< 5`` or ``<> 3 7``."""
    read.count(words, f"{what} values", 1, None)
    if words[0] == "<>":
        read.count(words, "<> low high", 3)
        low, high = (read.integer(word, what) for word in words[1:])
        return (values >= low) & (values <= high)
    if words[0] in _COMPARE:
        read.count(words, f"{words[0]} value", 2)
        return _COMPARE[words[0]](values, read.integer(words[1], what))
    mask = np.zeros(len(values), dtype=bool)
    for first, last, stride in read.id_ranges(words, what):
        mask |= (values >= first) & (values <= last) & ((values - first) % stride == 0)
    return mask


def _by_region(state: DeckState, words: list[str]) -> np.ndarray:
    read.count(words, "region ID", 1)
    return state.region(words[0]).contains(state.atoms.positions)


def _by_variable(state: DeckState, words: list[str]) -> np.ndarray:
    read.count(words, "variable name", 1)
    return values_of_variable(state, f"v_{words[0].removeprefix('v_')}", "group") != 0


def _combined(state: DeckState, words: list[str], name: str, combine: np.ufunc, least: int) -> np.ndarray:
    read.count(words, f"{name} group group ...", least, None)
    return combine.reduce([state.group(word) for word in words])


#: Group styles: masks of the beads to add, from (state, words).
GROUP_STYLES: dict[str, Callable[[DeckState, list[str]], np.ndarray]] = {
    "type": lambda state, words: _matching(state.atoms.types, words, "an atom type"),
    "id": lambda state, words: _matching(state.atoms.ids, words, "an atom id"),
    "molecule": lambda state, words: _matching(state.atoms.molecules, words, "a molecule id"),
    "region": _by_region,
    "union": lambda state, words: _combined(state, words, "union", np.logical_or, 1),
    "intersect": lambda state, words: _combined(state, words, "intersect", np.logical_and, 2),
    "variable": _by_variable,
    "empty": lambda state, words: np.zeros(len(state.atoms), dtype=bool),
}


@command("group ID style values ...", 2, None, box=True)
def group(state: DeckState, args: list[str]) -> None:
    """``group ID style values ...``: adds beads to a group."""
    name, style, *words = args
    read.identifier(name, "the name of a group")
    if name == "all":
        raise ParameterError("group all always contains all beads and cannot be changed")
    if style == "delete":
        state.group(name)
        users = [fix.name for fix in state.fixes.values() if fix.group == name]
        if users:
            raise ParameterError(f"group {name} is used by fix {', '.join(users)}")
        del state.groups[name]
        state.dynamic.pop(name, None)
        return
    if style == "static":
        state.dynamic.pop(name, None)
        return
    if style == "dynamic":
        for fix in state.fixes.values():
            if fix.group == name and "reader" not in fix.parameters:
                raise ParameterError(f"group {name} is used by fix {fix.name}, whose beads cannot change")
        state.groups.setdefault(name, np.zeros(len(state.atoms), dtype=bool))
        state.dynamic[name] = DynamicGroup(state, name, words)
        return
    if style == "clear":
        state.groups[name] = np.zeros_like(state.group(name))
        return
    if style != "subtract":
        read.style(GROUP_STYLES, "group", style, "subtract", "clear", "delete", "dynamic", "static")
    # the group exists from here on, so that it may name itself
    present = state.groups.setdefault(name, np.zeros(len(state.atoms), dtype=bool))
    if style == "subtract":
        read.count(words, "subtract group group ...", 2, None)
        state.groups[name] = present | state.group(words[0])
        for other in words[1:]:
            # beads that were in the group before are removed as well
            state.groups[name] = state.groups[name] & ~state.group(other)
    else:
        state.groups[name] = present | GROUP_STYLES[style](state, words)


Setter = Callable[[DeckState, np.ndarray, list[str]], None]


# -- set --------------------------------------------------------------------------------------------------------------------
def _selected(state: DeckState, style: str, word: str) -> np.ndarray:
    if style == "group":
        return state.group(word)
    if style == "region":
        return _by_region(state, [word])
    values = {"atom": state.atoms.ids, "type": state.atoms.types, "mol": state.atoms.molecules}[style]
    low, star, high = word.partition("*")
    first = read.integer(low, f"the {style} of set", 0) if low else 1
    last = (read.integer(high, f"the {style} of set") if high else np.iinfo(np.int64).max) if star else first
    return (values >= first) & (values <= last)


def _numbers(state: DeckState, mask: np.ndarray, word: str, what: str) -> np.ndarray:
    """(n,) values for the beads of a mask, from a number or a variable (``v_name``)."""
    return values_of_variable(state, word, "set")[mask] if word.startswith("v_") else np.full(mask.sum(), read.number(word, what))


def _integers(state: DeckState, mask: np.ndarray, word: str, what: str, minimum: int | None = None) -> np.ndarray:
    """(n,) whole numbers for the beads of a mask, from a number or a variable, whose values are truncated as in LAMMPS."""
    if not word.startswith("v_"):
        read.integer(word, what, minimum)
    values = _numbers(state, mask, word, what).astype(np.int64)
    if minimum is not None and np.any(values < minimum):
        raise ParameterError(f"{what} must be at least {minimum}, but is {values.min()} ({word})")
    return values


def _set_type(state: DeckState, mask: np.ndarray, words: list[str]) -> None:
    kinds = _integers(state, mask, words[0], "the atom type")
    for kind in np.unique(kinds) if words[0].startswith("v_") else words[:1]:
        state.type_number(str(kind))
    state.atoms.types[mask] = kinds


def _set_fraction(state: DeckState, mask: np.ndarray, words: list[str]) -> None:
    fraction, rng = _fraction(words[1]), np.random.default_rng(read.integer(words[2], "the seed", 1))
    state.atoms.types[mask & (rng.random(len(mask)) < fraction)] = state.type_number(words[0])


def _fraction(word: str) -> float:
    fraction = read.non_negative(word, "the fraction")
    if fraction > 1:
        raise ParameterError(f"the fraction must be between 0 and 1, but is {word}")
    return fraction


def _set_subset(state: DeckState, mask: np.ndarray, words: list[str], ratio: bool) -> None:
    chosen = subset(np.flatnonzero(mask), words[1:], ratio)
    state.atoms.types[chosen] = state.type_number(words[0])


def subset(beads: np.ndarray, words: list[str], ratio: bool) -> np.ndarray:
    """Random selection of beads; the words are a fraction (``ratio``) or number of beads, and a seed."""
    amount, seed = words
    wanted = int(_fraction(amount) * len(beads)) if ratio else read.integer(amount, "the number of beads", 0)
    if wanted > len(beads):
        raise ParameterError(f"cannot choose {wanted} of {len(beads)} beads")
    return np.random.default_rng(read.integer(seed, "the seed", 1)).choice(beads, wanted, replace=False)


def _set_theta(state: DeckState, mask: np.ndarray, words: list[str]) -> None:
    state.require_atom_style("set dpd/theta", "dpd")
    values = np.full(mask.sum(), -1.0) if words[0] == "NULL" else _numbers(state, mask, words[0], "dpd/theta")
    # as in LAMMPS, a negative value of a variable means NULL
    own = (values < 0) & (words[0] == "NULL" or words[0].startswith("v_"))
    speed2 = np.sum((state.atoms.velocities[mask] * state.units.velocity) ** 2, axis=1)
    values = np.where(own, state.bead_masses()[mask] * speed2 / (state.dimension * state.units.thermal_energy), values)
    if np.any(own & (values <= 0)):
        bead = int(state.atoms.ids[mask][np.argmin(values)])
        raise ParameterError(f"set dpd/theta NULL uses the velocity of each bead, but bead {bead} is at rest")
    state.atoms.thetas[mask] = _positive(values, "dpd/theta")


def _positive(values: np.ndarray, what: str) -> np.ndarray:
    for value in values[~((values > 0) & (values < np.inf))]:
        raise ParameterError(f"{what} must be > 0, but is {value:g}")
    return values


def _set_concentration(state: DeckState, mask: np.ndarray, words: list[str]) -> None:
    state.require_atom_style("set cc", "tdpd")
    species = state.species(words[0], "set cc")
    state.atoms.concentrations[mask, species] = _numbers(state, mask, words[1], "cc")


def _setter(array: str, what: str, *styles: str, axis: int | None = None, positive: bool = False, whole: bool = False) -> Setter:
    """Handler of a property that is an array of Atoms, or a column of one; it may need one of these atom styles."""

    def handler(state: DeckState, mask: np.ndarray, words: list[str]) -> None:
        if styles:
            state.require_atom_style(f"set {what}", *styles)
        values = _integers(state, mask, words[0], what, 0) if whole else _numbers(state, mask, words[0], what)
        # a position outside the box stays there until the next run, also for regions and ramps
        getattr(state.atoms, array)[mask if axis is None else (mask, axis)] = _positive(values, what) if positive else values

    return handler


def _set_image(state: DeckState, mask: np.ndarray, words: list[str]) -> None:
    for axis, word in enumerate(words):
        if word != "NULL":
            flags = _integers(state, mask, word, "the image flag")
            if np.any(flags) and not state.periodic[axis]:
                raise ParameterError(f"set image: the box is not periodic along {'xyz'[axis]}, so its image flag must be 0, not {word}")
            state.atoms.images[mask, axis] = flags


def _set_mass(state: DeckState, mask: np.ndarray, words: list[str]) -> None:
    if not state.has_atom_style("sphere"):
        raise ParameterError(f"atom_style {state.atom_style} has one mass per type; use the mass command, or another type")
    state.atoms.solids[mask] = _positive(_numbers(state, mask, words[0], "mass"), "mass") / state.atoms.volumes[mask]


def _set_diameter(state: DeckState, mask: np.ndarray, words: list[str]) -> None:
    """As in LAMMPS masses stay as they are."""
    state.require_atom_style("set diameter", "sphere")
    values, before = _numbers(state, mask, words[0], "diameter"), state.atoms.volumes
    if np.any(values < 0):
        raise ParameterError("set diameter: no diameter may be negative")
    state.atoms.diameters[mask] = values
    state.atoms.solids[mask] *= (before / state.atoms.volumes)[mask]


def _set_density(state: DeckState, mask: np.ndarray, words: list[str]) -> None:
    state.require_atom_style("set sph/rho", "mdpd")
    _numbers(state, mask, words[0], "sph/rho")
    state.note("set sph/rho has no effect: densities follow from positions in each step")


#: Properties that ``set`` changes: number of values, and handler.
SETTERS: dict[str, tuple[int, Setter]] = {
    "type": (1, _set_type),
    "type/fraction": (3, _set_fraction),
    "type/ratio": (3, lambda state, mask, words: _set_subset(state, mask, words, True)),
    "type/subset": (3, lambda state, mask, words: _set_subset(state, mask, words, False)),
    "mol": (1, _setter("molecules", "mol", *BONDED_STYLES, whole=True)),
    "charge": (1, _setter("charges", "charge", *CHARGED_STYLES)),
    **{"mass": (1, _set_mass), "dpd/theta": (1, _set_theta), "cc": (2, _set_concentration), "image": (3, _set_image)},
    "edpd/temp": (1, _setter("temperatures", "edpd/temp", "edpd", positive=True)),
    "edpd/cv": (1, _setter("capacities", "edpd/cv", "edpd", positive=True)),
    **{"sph/rho": (1, _set_density), "diameter": (1, _set_diameter)},
    "density": (1, _setter("solids", "density", "sphere", positive=True)),
    **{axis: (1, _setter("positions", axis, axis=k)) for k, axis in enumerate("xyz")},
    **{f"v{axis}": (1, _setter("velocities", f"v{axis}", axis=k)) for k, axis in enumerate("xyz")},
}


@command("set style ID property value ...", 3, None, box=True)
def set_(state: DeckState, args: list[str]) -> None:
    """``set atom|type|mol|group|region ID property values ...``."""
    if not len(state.atoms):
        raise ParameterError("set needs beads; create or read them first")
    mask = _selected(state, read.choice(args[0], "the style of set", ("atom", "type", "mol", "group", "region")), args[1]).copy()
    for name, words in read.options(args[2:], {name: size for name, (size, _) in SETTERS.items()}, "set"):
        SETTERS[name][1](state, mask, words)
