"""Pair style srp: segmental repulsion between bonds, which LAMMPS organises as pairs of placeholder particles of a type of their own."""

import numpy as np

from ...errors import ParameterError
from ...model.scene import Scene
from ...model.segments import DISTANCES
from ...units import UnitSystem
from ..language import arguments as read
from ..state.pair_setup import Find, PairStyle, Spec, Values
from .columns import cutoff_of, no_force
from .writing import Differences, StyleUse, exact

#: Words of the style that are no numbers.
_WORDS = frozenset(("*", *DISTANCES, "exclude", "bptype", "yes", "no"))


def srp_settings(words: list[str]) -> dict:
    """Settings of ``srp cutoff btype|* mid|min [exclude yes|no] [bptype N]``."""
    read.count(words, "srp cutoff bond-type|* mid|min [exclude yes|no] [bptype N]", 3, None)
    found = {
        "cutoff": read.positive(words[0], "the cutoff of srp"),
        "bond_type": None if words[1] == "*" else read.integer(words[1], "the bond type of srp (or *)", 1),
        "distance": read.choice(words[2], "the distance of srp", DISTANCES),
        "exclude": True,
        "bptype": None,
    }
    for keyword, values in read.options(words[3:], {"exclude": 1, "bptype": 1}, "pair_style srp"):
        if keyword == "exclude":
            found["exclude"] = read.switch(values[0], "exclude")
        else:
            found["bptype"] = read.integer(values[0], "bptype", 1)
    if found["distance"] == "min" and not found["exclude"]:
        raise ParameterError("pair style srp: 'exclude no' goes with the distance mid only; bonds that share a bead are at the distance 0")
    return found


def _srp_coefficient(style: PairStyle, words: list[str], _: Find) -> Values:
    """``A [cutoff]``."""
    read.count(words, "A [cutoff]", 1, 2)
    return {"A": read.non_negative(words[0], "A")}, cutoff_of(words, 1)


STYLES = {"srp": Spec(srp_settings, _srp_coefficient, no_force, words=_WORDS, of_bonds=True)}


def segment_use(scene: Scene, units: UnitSystem, bonds: np.ndarray, n_types: int, differences: Differences) -> StyleUse | None:
    """Pair style srp, or None; ``bonds`` has the type of each bond and its beads.

    Raises
    ------
    ParameterError
        If the segments are no bonds, or some bonds of one type but not all.
    """
    segments = scene.segments
    if segments is None:
        return None
    kind = "*"
    if segments.bonds is not None:
        wanted = {tuple(sorted(pair)) for pair in segments.bonds.tolist()}
        types = {tuple(sorted(row[1:])): row[0] for row in bonds.tolist()}
        lacking = sorted(wanted - set(types))
        if lacking:
            raise ParameterError(f"the segment between beads {lacking[0]} is no bond; LAMMPS's srp acts between bonds, so it must be one")
        used = {types[pair] for pair in wanted}
        members = {pair for pair, number_ in types.items() if number_ in used}
        if wanted != set(types) and (len(used) > 1 or members != wanted):
            raise ParameterError(
                "the segmental repulsion acts on some bonds; LAMMPS's srp takes all bonds or all of one type, so these, and no others, "
                "must have the same coefficients"
            )
        kind = "*" if wanted == set(types) else str(used.pop())
    if segments.distance == "min" and scene.compat != "lammps":
        differences.add("LAMMPS's srp limits the two nearest points one by one, which is not always the least distance (compat='lammps')")
    exclude = "yes" if segments.exclude_adjoining else "no"
    reach = exact(segments.cutoff / units.length)
    settings = f"{reach} {kind} {segments.distance} exclude {exclude} bptype {n_types + 1}"
    words = f"{exact(segments.A / units.force)} {reach}"
    return StyleUse("srp", settings, {("*", "*"): words}, segments.cutoff)
