"""Fixes of the fields of beads (equations of state, sources), and of boxes under constant pressure."""

import numpy as np

from ...errors import ParameterError
from ...model.eos import ConstantHeatCapacity, TabulatedEOS
from ...model.sources import Block, Sphere
from ..files.eos_file import read_eos
from ..language import arguments as read
from ..state.deck_state import DeckState
from ..state.pressure import parse_nph
from .setup import FixReader


# -- internal energies --------------------------------------------------------------------------------------------------------
def _eos_cv(state: DeckState, group: str, words: list[str]) -> dict:
    read.count(words, "fix ID group eos/cv cv", 1)
    state.require_atom_style("dpd", "fix eos/cv")
    # heat capacities of the model are in units of k_B
    capacity = read.positive(words[0], "the heat capacity") / state.units.boltzmann
    return {"eos": ConstantHeatCapacity(capacity), "source": capacity}


def _eos_table(state: DeckState, group: str, words: list[str]) -> dict:
    read.count(words, "fix ID group eos/table linear file N keyword", 4)
    state.require_atom_style("dpd", "fix eos/table")
    read.choice(words[0], "the style of eos/table", ("linear",))
    read.integer(words[2], "the size of the table", 2)
    path = state.find_file(words[1])
    temperatures, energies = read_eos(path, words[3])
    state.note("fix eos/table: a monotone curve through the points of the file is used, however many table points are asked for")
    table = TabulatedEOS(temperatures * state.units.thermal_energy, energies * state.units.energy)
    return {"eos": table, "source": (path.resolve(), words[3])}


def _dpd_energy(state: DeckState, group: str, words: list[str]) -> dict:
    read.count(words, "fix ID group dpd/energy", 0)
    state.require_atom_style("dpd", "fix dpd/energy")
    if group != "all":
        state.note("fix dpd/energy acts on all beads, whatever its group")
    return {}


# -- sources ------------------------------------------------------------------------------------------------------------------
_PLACES = {"sphere": "cx cy cz R", "cuboid": "cx cy cz Lx Ly Lz", "region": "ID"}


def _place(state: DeckState, words: list[str], style: str) -> tuple[Block | Sphere, float]:
    """Region and rate of ``sphere|cuboid|region ... value``."""
    usage = " | ".join(f"{name} {values} value" for name, values in _PLACES.items())
    read.count(words, usage, 1, None)
    kind = read.choice(words[0], f"the region of fix {style}", list(_PLACES))
    read.count(words[1:], f"{kind} {_PLACES[kind]} value", len(_PLACES[kind].split()) + 1)
    rate, length = read.number(words[-1], "the rate of the source"), state.units.length
    if kind == "region":
        region = state.region(words[1])
        if region.shape is None:
            raise ParameterError(f"fix {style}: region '{words[1]}' must be the inside of a block or a sphere")
        first, second = region.shape
        if region.style == "block":
            return Block(first * length, np.asarray(second) * length), rate
        return Sphere(first * length, float(second) * length), rate
    values = np.array([read.number(word, f"a value of {kind}") for word in words[1:-1]])
    if kind == "cuboid":
        return Block.centred(values[:3] * length, values[3:] * length), rate
    if values[3] != 1:
        state.note(
            f"fix {style}: the sphere has the radius {values[3]:g}; LAMMPS compares r^2 with R^3, its radius is {values[3] ** 1.5:g}"
        )
    return Sphere(values[:3] * length, float(values[3] * length)), rate


def _edpd_source(state: DeckState, group: str, words: list[str]) -> dict:
    state.require_atom_style("edpd", "fix edpd/source")
    region, rate = _place(state, words, "edpd/source")
    return {"region": region, "rate": rate * state.units.thermal_energy / state.units.time, "species": 0}


def _tdpd_source(state: DeckState, group: str, words: list[str]) -> dict:
    state.require_atom_style("tdpd", "fix tdpd/source")
    read.count(words, "fix ID group tdpd/source species sphere|cuboid|region ... value", 2, None)
    species = state.species(words[0], "fix tdpd/source")
    region, rate = _place(state, words[1:], "tdpd/source")
    return {"region": region, "rate": rate / state.units.time, "species": species}


# -- constant pressure --------------------------------------------------------------------------------------------------------
def _nph(state: DeckState, group: str, words: list[str]) -> dict:
    control, unused = parse_nph(words, state.units)
    if unused:
        state.note(f"fix nph: {', '.join(unused)} (LAMMPS's motion of the box) has no meaning here and is ignored")
    return {"lambda": 0.5, "pressure": control}


#: Fix styles: from (state, group, words) to the fix's parameters.
ENERGY_FIXES: dict[str, FixReader] = {
    "dpd/energy": _dpd_energy,
    "eos/cv": _eos_cv,
    "eos/table": _eos_table,
    "edpd/source": _edpd_source,
    "tdpd/source": _tdpd_source,
    "nph": _nph,
}
