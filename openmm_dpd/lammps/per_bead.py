"""Values of single beads: the words of ``compute property/atom`` and ``fix ave/chunk``, and the computes that have one value per bead."""

from __future__ import annotations

import re
from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from ..errors import ParameterError
from . import arguments as read
from .compute_spec import Compute, ComputeSpec

if TYPE_CHECKING:
    from .context import Context
    from .state import DeckState

_REFERENCE = re.compile(r"c_(\w+)(?:\[(\d+)\])?")


@dataclass(frozen=True)
class BeadWord:
    """A value that every bead has: from a context to (N,) in the deck's units, and the fields of Sample that it reads."""

    value: Callable[[Context], np.ndarray]
    needs: tuple[str, ...] = ()


def folded(context: Context) -> tuple[np.ndarray, np.ndarray]:
    """Positions in the deck's box (deck units), and by how many boxes each bead was moved back."""
    return context.state.folded(context.positions, context.box)


def unwrapped(context: Context) -> np.ndarray:
    """Positions on continuous paths (deck units)."""
    return context.box.unwrap(context.positions, context.state.atoms.images)


def _masses(context: Context) -> np.ndarray:
    return context.state.bead_masses() / context.units.mass


def _axis(array: Callable[[Context], np.ndarray], axis: int) -> Callable[[Context], np.ndarray]:
    return lambda context: array(context)[:, axis]


def _words() -> dict[str, BeadWord]:
    words = {
        "id": BeadWord(lambda c: c.state.atoms.ids.astype(float)),
        "mol": BeadWord(lambda c: c.state.atoms.molecules.astype(float)),
        "type": BeadWord(lambda c: c.state.atoms.types.astype(float)),
        "mass": BeadWord(_masses),
        "q": BeadWord(lambda c: c.state.atoms.charges),
    }
    arrays: dict[str, tuple[Callable[[Context], np.ndarray], str]] = {
        "{}": (lambda c: folded(c)[0], "positions"),
        "{}u": (unwrapped, "positions"),
        "{}s": (lambda c: c.box.fractions(folded(c)[0]), "positions"),
        "i{}": (lambda c: (c.state.atoms.images + folded(c)[1]).astype(float), "positions"),
        "v{}": (lambda c: c.velocities, "velocities"),
        "f{}": (lambda c: np.asarray(c.need("forces")) / c.units.force, "forces"),
    }
    for name, (array, needed) in arrays.items():
        for k, axis in enumerate("xyz"):
            words[name.format(axis)] = BeadWord(_axis(array, k), (needed,))
    return words


#: Values that every bead has.
BEAD_WORDS = _words()


def _density(context: Context) -> np.ndarray:
    return context.carried("density") * context.units.length**3 / context.units.mass


#: What compute property/atom knows: on top of these the local density of mdpd.
PROPERTIES = BEAD_WORDS | {"rho": BeadWord(_density, ("fields",))}


def bead_values(context: Context, word: str) -> np.ndarray:
    """(N,) values of a word: one of :data:`BEAD_WORDS`, ``c_id``, ``c_id[column]``, or ``v_name`` of an atom-style variable."""
    if word.startswith("v_"):
        return np.asarray(context.bead_variable(word[2:]))
    if word.startswith("c_"):
        return context.bead_compute(*bead_reference(word))
    return BEAD_WORDS[word].value(context)


def bead_reference(word: str) -> tuple[str, int | None]:
    """Id and column of ``c_id`` or ``c_id[column]``."""
    match = _REFERENCE.fullmatch(word)
    if match is None:
        raise ParameterError(f"expected c_id or c_id[column], not '{word}'")
    return match[1], None if match[2] is None else int(match[2])


def check_bead_word(state: DeckState, word: str, allowed: tuple[str, ...] = tuple(BEAD_WORDS), what: str = "a value of the beads") -> None:
    """Raise ParameterError unless a word names a value that every bead has."""
    from .computes import COMPUTES

    if word.startswith("v_"):
        style = state.variables.get(word[2:]).style
        if style != "atom":
            raise ParameterError(f"{word}: variable {word[2:]} is {style}-style; only atom-style ones have values of single beads")
        return
    if not word.startswith("c_"):
        read.choice(word, what, [*allowed, "c_id", "c_id[column]", "v_name"])
        return
    name, column = bead_reference(word)
    if name not in state.computes:
        raise ParameterError(f"{word}: there is no compute '{name}'; defined are {', '.join(state.computes) or 'none'}")
    compute = state.computes[name]
    spec = COMPUTES[compute.style]
    if spec.per_bead is None:
        raise ParameterError(f"{word}: compute style {compute.style} has no values of single beads")
    columns = spec.columns(compute)
    if columns == 0 and column is not None:
        raise ParameterError(f"{word}: compute {name} (style {compute.style}) has one value per bead; use c_{name}")
    if columns and (column is None or not 1 <= column <= columns):
        raise ParameterError(f"{word}: compute {name} (style {compute.style}) has {columns} values per bead; use c_{name}[1] and so on")


# -- computes -----------------------------------------------------------------------------------------------------------------
def _in_group(context: Context, compute: Compute, values: np.ndarray) -> np.ndarray:
    mask = context.state.group(compute.group)
    return np.where(mask if values.ndim == 1 else mask[:, None], values, 0.0)


def _property(context: Context, compute: Compute) -> np.ndarray:
    columns = [PROPERTIES[word].value(context) for word in compute.arguments]
    return _in_group(context, compute, columns[0] if len(columns) == 1 else np.column_stack(columns))


def _check_property(state: DeckState, group: str, words: list[str]) -> None:
    read.count(words, "compute ID group property/atom value value ...", 1, None)
    for word in words:
        read.choice(word, "a value of compute property/atom", list(PROPERTIES))
        if word == "rho":
            require_atom_style(state, "property/atom rho", "mdpd")


def _kinetic(context: Context, compute: Compute) -> np.ndarray:
    energy = 0.5 * _masses(context) * np.sum(context.velocities**2, axis=1) * context.units.mvv2e
    return _in_group(context, compute, energy)


def _internal(context: Context, compute: Compute) -> np.ndarray:
    units = context.units
    conductive, mechanical, theta = (context.carried(name) for name in ("u_cond", "u_mech", "theta"))
    # the third column is LAMMPS's chemical energy: there are no reactions here
    columns = (conductive / units.energy, mechanical / units.energy, np.zeros(len(theta)), theta / units.thermal_energy)
    return _in_group(context, compute, np.column_stack(columns))


def _temperature(context: Context, compute: Compute) -> np.ndarray:
    return _in_group(context, compute, context.carried("temperature") / context.units.thermal_energy)


def _concentration(context: Context, compute: Compute) -> np.ndarray:
    return _in_group(context, compute, context.carried("concentrations")[:, compute.settings])


def _style_only(style: str, atom_style: str) -> Callable[[DeckState, str, list[str]], None]:
    def check(state: DeckState, group: str, words: list[str]) -> None:
        read.count(words, f"compute ID group {style} (and no more)", 0)
        require_atom_style(state, style, atom_style)

    return check


def require_atom_style(state: DeckState, style: str, atom_style: str) -> None:
    """Raise ParameterError unless the deck has the atom style that a compute needs."""
    if state.atom_style != atom_style:
        raise ParameterError(f"compute {style} needs atom_style {atom_style}, but the deck has atom_style {state.atom_style}")


def _check_concentration(state: DeckState, group: str, words: list[str]) -> None:
    read.count(words, "compute ID group tdpd/cc/atom species", 1)
    require_atom_style(state, "tdpd/cc/atom", "tdpd")
    species = read.integer(words[0], "the number of the species", 1)
    if species > state.n_species:
        raise ParameterError(f"compute tdpd/cc/atom: there is no species {species}; atom_style tdpd has {state.n_species}")


#: Computes with values of single beads.
PER_BEAD: dict[str, ComputeSpec] = {
    "property/atom": ComputeSpec(
        _check_property,
        per_bead=_property,
        columns=lambda compute: len(compute.arguments) if len(compute.arguments) > 1 else 0,
        inputs=lambda compute: compute.arguments,
    ),
    "ke/atom": ComputeSpec(
        lambda state, group, words: read.count(words, "compute ID group ke/atom", 0), per_bead=_kinetic, needs=("velocities",)
    ),
    "dpd/atom": ComputeSpec(_style_only("dpd/atom", "dpd"), per_bead=_internal, columns=lambda compute: 4, needs=("fields",)),
    "edpd/temp/atom": ComputeSpec(_style_only("edpd/temp/atom", "edpd"), per_bead=_temperature, needs=("fields",)),
    "tdpd/cc/atom": ComputeSpec(
        _check_concentration, per_bead=_concentration, needs=("fields",), prepare=lambda state, group, words: int(words[0]) - 1
    ),
}


# -- compute reduce -----------------------------------------------------------------------------------------------------------
_MODES: dict[str, Callable[[np.ndarray], float]] = {
    "sum": lambda values: float(values.sum()),
    "min": lambda values: float(values.min()),
    "max": lambda values: float(values.max()),
    "ave": lambda values: float(values.mean()),
    "sumsq": lambda values: float(np.sum(values**2)),
    "avesq": lambda values: float(np.mean(values**2)),
    "sumabs": lambda values: float(np.abs(values).sum()),
    "aveabs": lambda values: float(np.abs(values).mean()),
}


def _check_reduce(state: DeckState, group: str, words: list[str]) -> None:
    read.count(words, "compute ID group reduce mode value value ...", 2, None)
    read.choice(words[0], "the mode of compute reduce", list(_MODES))
    for word in words[1:]:
        check_bead_word(state, word, tuple(f"{kind}{axis}" for kind in ("", "v", "f") for axis in "xyz"))


def _reduced(context: Context, compute: Compute) -> np.ndarray:
    mask = context.state.group(compute.group)
    mode, *words = compute.arguments
    if not mask.any():
        return np.zeros(len(words))
    return np.array([_MODES[mode](bead_values(context, word)[mask]) for word in words])


def _reduced_one(context: Context, compute: Compute) -> float:
    if len(compute.arguments) > 2:
        raise ParameterError(f"compute {compute.name} (style reduce) has {len(compute.arguments) - 1} values; use c_{compute.name}[1]")
    return float(_reduced(context, compute)[0])


REDUCE = ComputeSpec(
    _check_reduce,
    _reduced_one,
    _reduced,
    extensive=lambda compute: compute.arguments[0].startswith("sum"),
    size=lambda compute: len(compute.arguments) - 1,
    inputs=lambda compute: compute.arguments[1:],
)
