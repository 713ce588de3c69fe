"""Per-bead values: the words of ``compute property/atom`` and ``fix ave/chunk``, and the computes with per-bead values."""

from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np

from ...base.errors import ParameterError
from ...base.geometry import AXES_OF_TENSOR
from ..files.data_file import BONDED_STYLES, CHARGED_STYLES
from ..language import arguments as read
from ..state.atoms import Atoms
from ..state.deck_state import DeckState
from ..state.moment import DeckMoment
from ..state.records import Compute
from .compute_spec import ComputeSpec, no_arguments

#: A per-bead value: (N,) in the deck's units at a moment.
BeadWord = Callable[[DeckMoment], np.ndarray]


def _masses(moment: DeckMoment) -> np.ndarray:
    return moment.state.bead_masses() / moment.units.mass


#: Words that require one of these atom styles.
_OF_STYLES = {"mol": BONDED_STYLES, "q": CHARGED_STYLES, "rho": ("mdpd",)}
_OF_STYLES |= {**dict.fromkeys(("mu", "mux", "muy", "muz"), ("dipole",)), **dict.fromkeys(("radius", "diameter"), ("sphere",))}


def check_carried(state: DeckState, word: str) -> None:
    """Raise ParameterError if the deck's atom style has no such value."""
    if word in _OF_STYLES:
        state.require_atom_style(word, *_OF_STYLES[word])


def _carried(word: str, array: Callable[[Atoms], np.ndarray]) -> BeadWord:
    def value(moment: DeckMoment) -> np.ndarray:
        check_carried(moment.state, word)
        return array(moment.state.atoms).astype(float)

    return value


def axis_of(array: BeadWord, axis: int) -> BeadWord:
    """One column of an array of three."""
    return lambda moment: array(moment)[:, axis]


def _words() -> dict[str, BeadWord]:
    words: dict[str, BeadWord] = {
        "id": lambda c: c.state.atoms.ids.astype(float),
        "mol": _carried("mol", lambda atoms: atoms.molecules),
        "type": lambda c: c.state.atoms.types.astype(float),
        "mass": _masses,
        "q": _carried("q", lambda atoms: atoms.charges),
        "diameter": _carried("diameter", lambda atoms: atoms.diameters),
        "radius": _carried("radius", lambda atoms: 0.5 * atoms.diameters),
    }
    arrays: dict[str, BeadWord] = {
        "{}": lambda c: c.folded[0],
        "{}u": lambda c: c.unwrapped,
        "{}s": lambda c: c.box.fractions(c.folded[0]),
        "i{}": lambda c: (c.images + c.folded[1]).astype(float),
        "v{}": lambda c: c.velocities,
        "f{}": lambda c: np.asarray(c.need("forces")) / c.units.force,
    }
    for name, array in arrays.items():
        for k, axis in enumerate("xyz"):
            words[name.format(axis)] = axis_of(array, k)
    return words


#: Per-bead values by word.
BEAD_WORDS = _words()


def _density(moment: DeckMoment) -> np.ndarray:
    return moment.field("density") * moment.units.length**3 / moment.units.mass


#: Words of compute property/atom: all of these, and the local density of mdpd.
PROPERTIES = BEAD_WORDS | {"rho": _density}


# -- computes -----------------------------------------------------------------------------------------------------------------
def _in_group(moment: DeckMoment, compute: Compute, values: np.ndarray) -> np.ndarray:
    mask = moment.state.group(compute.group)
    return np.where(mask if values.ndim == 1 else mask[:, None], values, 0.0)


def _property(moment: DeckMoment, compute: Compute) -> np.ndarray:
    columns = [PROPERTIES[word](moment) for word in compute.arguments]
    return _in_group(moment, compute, columns[0] if len(columns) == 1 else np.column_stack(columns))


def _check_property(state: DeckState, group: str, words: list[str]) -> None:
    read.count(words, "compute ID group property/atom value value ...", 1, None)
    for word in words:
        check_carried(state, word)
        read.choice(word, "a value of compute property/atom", list(PROPERTIES))


def _kinetic(moment: DeckMoment, compute: Compute) -> np.ndarray:
    return _in_group(moment, compute, 0.5 * _masses(moment) * np.sum(moment.velocities**2, axis=1) * moment.units.mvv2e)


def _internal(moment: DeckMoment, compute: Compute) -> np.ndarray:
    units = moment.units
    conductive, mechanical, theta = (moment.field(name) for name in ("u_cond", "u_mech", "theta"))
    # the third column is LAMMPS's chemical energy: there are no reactions here
    columns = (conductive / units.energy, mechanical / units.energy, np.zeros(len(theta)), theta / units.thermal_energy)
    return _in_group(moment, compute, np.column_stack(columns))


#: Keywords of computes pe/atom and stress/atom; the last ones are parts that beads have nothing of.
_PARTS = ("pair", "bond", "angle", "dihedral", "improper", "kspace", "fix")


def _potential_parts(state: DeckState, group: str, words: list[str]) -> tuple[str, ...]:
    return tuple(read.choice(word, "an argument of compute pe/atom", _PARTS) for word in words) or _PARTS


def _potential(moment: DeckMoment, compute: Compute) -> np.ndarray:
    return _in_group(moment, compute, _shares(moment, compute.settings)[:, 0] / moment.units.energy)


def _shares(moment: DeckMoment, parts: Sequence[str]) -> np.ndarray:
    """(N, 7) energies and r F (xx, yy, zz, xy, xz, yz) of the beads, summed over parts, kJ/mol."""
    return sum((values for part, values in moment.need("shares_of_beads").items() if part in parts), np.zeros((len(moment.state.atoms), 7)))


def _stress_parts(state: DeckState, group: str, words: list[str]) -> tuple[str, ...]:
    read.count(words, "compute ID group stress/atom temp-ID|NULL [ke|virial|pair|bond|angle|dihedral|improper|kspace|fix ...]", 1, None)
    if words[0] != "NULL" and (temp := state.temperature_compute(words[0])).group != "all" and any(temp.settings.streaming):
        raise ParameterError("compute stress/atom: a compute temp/profile that it uses must have the group all")
    allowed = ("ke", "virial", *_PARTS)
    found = [read.choice(word, "an argument of compute stress/atom", allowed) for word in words[1:]] or ["ke", "virial"]
    return (*found, *(_PARTS if "virial" in found else ()))


def _stress(moment: DeckMoment, compute: Compute) -> np.ndarray:
    """Minus m v v and r F of each bead, with the velocities that the temperature compute counts."""
    found = _shares(moment, compute.settings)[:, 1:]
    if "ke" in compute.settings:
        velocities, masses, temp = moment.velocities, moment.state.bead_masses(), compute.arguments[0]
        if temp != "NULL":  # what it subtracts, from the velocities of all beads
            velocities = moment.thermal(replace(moment.state.temperature_compute(temp), group="all"))[1]
        v = velocities * moment.units.velocity
        found = found + np.stack([masses * v[:, a] * v[:, b] for a, b in AXES_OF_TENSOR], axis=1)
    return _in_group(moment, compute, -found / (moment.units.length**3 * moment.units.pressure))


def _species(state: DeckState, group: str, words: list[str]) -> int:
    read.count(words, "compute ID group tdpd/cc/atom species", 1)
    state.require_atom_style("compute tdpd/cc/atom", "tdpd")
    return state.species(words[0], "compute tdpd/cc/atom")


#: Computes with per-bead values.
PER_BEAD: dict[str, ComputeSpec] = {
    "property/atom": ComputeSpec(
        _check_property, per_bead=_property, columns=lambda compute: len(compute.arguments) if len(compute.arguments) > 1 else 0
    ),
    "pe/atom": ComputeSpec(_potential_parts, per_bead=_potential),
    "stress/atom": ComputeSpec(_stress_parts, per_bead=_stress, columns=lambda compute: 6),
    "ke/atom": ComputeSpec(no_arguments("ke/atom"), per_bead=_kinetic),
    "dpd/atom": ComputeSpec(no_arguments("dpd/atom", "dpd"), per_bead=_internal, columns=lambda compute: 4),
    "edpd/temp/atom": ComputeSpec(
        no_arguments("edpd/temp/atom", "edpd"), per_bead=lambda m, c: _in_group(m, c, m.field("theta") / m.units.thermal_energy)
    ),
    "tdpd/cc/atom": ComputeSpec(_species, per_bead=lambda m, c: _in_group(m, c, m.field("concentrations")[:, c.settings])),
}
