"""Pair styles srp and srp/react: segmental repulsion between bonds, which LAMMPS represents by placeholder particles of an extra type."""

from functools import partial

import numpy as np

from ...base.errors import ParameterError
from ...base.units import UnitSystem
from ...model.reactions import ReactiveBonds
from ...model.scene import Scene
from ...model.segments import DISTANCES, SegmentalRepulsion
from ..language import arguments as read
from ..state.deck_state import DeckState
from ..state.pair_setup import Find, PairStyle, Spec, Values
from ..state.records import FORMING
from .words import Differences, StyleUse, cutoff_of, exact, no_force

#: Words of the style that are not numbers.
_WORDS = frozenset(("*", *DISTANCES, "exclude", "bptype", "yes", "no"))


def srp_settings(words: list[str], reacting: bool = False) -> dict:
    """Parse the arguments of ``srp cutoff btype|* mid|min [exclude yes|no] [bptype N]``; after ``mid|min``, ``srp/react`` has the name of a
    fix."""
    read.count(
        words, f"srp{'/react' * reacting} cutoff bond-type|* mid|min {'fix ' * reacting}[exclude yes|no] [bptype N]", 3 + reacting, None
    )
    found: dict = {
        "cutoff": read.positive(words[0], "the cutoff of srp"),
        "bond_type": None if words[1] == "*" else read.integer(words[1], "the bond type of srp (or *)", 1),
        "distance": read.choice(words[2], "the distance of srp", DISTANCES),
        "exclude": True,
        "bptype": None,
        **({"fix": words[3]} if reacting else {}),
    }
    for keyword, values in read.options(words[3 + reacting :], {"exclude": 1, "bptype": 1}, "pair_style srp"):
        if keyword == "exclude":
            found["exclude"] = read.switch(values[0], "exclude")
        else:
            found["bptype"] = read.integer(values[0], "bptype", 1)
    if found["distance"] == "min" and not found["exclude"]:
        raise ParameterError("pair style srp: 'exclude no' requires the distance mid; bonds that share a bead have the distance 0")
    return found


def _srp_coefficient(style: PairStyle, words: list[str], _: Find) -> Values:
    """Parse ``A [cutoff]``."""
    read.count(words, "A [cutoff]", 1, 2)
    return {"A": read.non_negative(words[0], "A")}, cutoff_of(words, 1)


STYLES = {
    name: Spec(partial(srp_settings, reacting=name != "srp"), _srp_coefficient, no_force, words=_WORDS, of_bonds=True)
    for name in ("srp", "srp/react")
}


# -- from a scene -------------------------------------------------------------------------------------------------------------
def segment_use(scene: Scene, units: UnitSystem, bonds: np.ndarray, n_types: int, differences: Differences) -> StyleUse | None:
    """Pair style srp, or None; ``bonds`` has the type and beads of each bond.  ParameterError if a segment is not a bond, or the segments
    are some but not all bonds of one type."""
    segments = scene.segments
    if segments is None:
        return None
    kind = "*"
    if segments.bonds is not None:
        wanted = {tuple(sorted(pair)) for pair in scene.segment_pairs.tolist()}
        types = {tuple(sorted(row[1:])): row[0] for row in bonds.tolist()}
        lacking = sorted(wanted - set(types))
        if lacking:
            raise ParameterError(f"the segment between beads {lacking[0]} is not a bond; LAMMPS's srp acts between bonds only")
        used = {types[pair] for pair in wanted}
        members = {pair for pair, number_ in types.items() if number_ in used}
        if wanted != set(types) and (len(used) > 1 or members != wanted):
            raise ParameterError(
                "the segmental repulsion acts on some bonds only; LAMMPS's srp acts on all bonds or on all of one type, so these bonds, "
                "and no others, must have the same coefficients"
            )
        kind = "*" if wanted == set(types) else str(used.pop())
    if segments.distance == "min" and scene.compat != "lammps":
        differences.add(
            "LAMMPS's srp clamps the two nearest points independently, which is not always the smallest distance (compat='lammps')"
        )
    exclude = "yes" if segments.exclude_adjoining else "no"
    reach = exact(segments.cutoff / units.length)
    settings = f"{reach} {kind} {segments.distance} exclude {exclude} bptype {n_types + 1}"
    return StyleUse("srp", settings, {("*", "*"): f"{exact(segments.A / units.force)} {reach}"}, segments.cutoff)


# -- at the start of a run ----------------------------------------------------------------------------------------------------
def without_beads_of_bonds(state: DeckState) -> None:
    """Delete beads of the type of bonds (bptype), which LAMMPS wrote there for bonds, unless bonds join them."""
    kinds = [style.settings["bptype"] or state.n_types for style in state.pair.styles if style.spec.of_bonds]
    doomed = np.isin(state.atoms.types, kinds)
    if not doomed.any() or np.isin(state.bonds[:, 1:], state.atoms.ids[doomed]).any():
        return
    state.note(f"{np.count_nonzero(doomed)} beads of the type {kinds[0]} of bonds (bptype) are deleted, as in LAMMPS")
    kept = state.atoms.delete(doomed)
    state.groups = {name: mask[kept] for name, mask in state.groups.items()}


# -- to a scene ---------------------------------------------------------------------------------------------------------------
def segments_of(state: DeckState, compat: str, made: dict[str, ReactiveBonds]) -> SegmentalRepulsion | None:
    """The segmental repulsion of the deck, beside bonds that fixes make and break, by name; None without pair style srp.  DeckError if its
    bond type or bptype is out of range, its coefficient is missing or set for another type, or beads have the type bptype."""
    styles = [style for style in state.pair.styles if style.spec.of_bonds]
    if not styles:
        return None
    style, settings = styles[0], styles[0].settings
    if len(styles) > 1:
        raise style.error("it can be used only once")
    kind = state.n_types if settings["bptype"] is None else settings["bptype"]
    if kind > state.n_types:
        raise style.error(f"bptype {kind} is out of range: there are {state.n_types} atom types")
    wrong = sorted(pair for pair in style.coefficients if pair != (kind, kind))
    if wrong:
        raise style.error(f"it has coefficients for types {wrong[0][0]} {wrong[0][1]}; give them for {kind} {kind}, its bptype")
    if not style.coefficients:
        raise style.error(f"there is no 'pair_coeff {kind} {kind} srp A [cutoff]'")
    for other in state.pair.styles:
        met = sorted(pair for pair in other.coefficients if other is not style and kind in pair)
        if met:
            i, j = met[0]
            raise style.error(
                f"type {kind} is the type of bonds (bptype), but types {i} {j} have {other.name} coefficients; set them to none"
            )
    if np.any(state.atoms.types == kind):
        count = int(np.sum(state.atoms.types == kind))
        raise style.error(f"type {kind} is the type of bonds (bptype), but {count} beads have it, which bonds join")
    coefficient, bonds = style.coefficients[(kind, kind)], _segments(state, style, made)
    if any(str(kind) in (fix.parameters["becomes"] or ()) for fix in state.fixes_of(*FORMING)):
        raise style.error(f"type {kind} is the type of bonds (bptype), but fix bond/create makes beads of it")
    cutoff = style.cutoff(coefficient)
    assert cutoff is not None
    if compat != "lammps" and settings["distance"] == "min":
        state.note(
            "pair srp min: the nearest points of two bonds are used. LAMMPS clamps each point to its bond independently, which gives "
            "other points and smaller energies (--compat lammps does the same)"
        )
    if state.units.normalize if state.thermo.norm is None else state.thermo.norm:
        state.note("pair srp: as in LAMMPS, thermo output is not normalised with this style")
        state.thermo.norm = False
    force, length = state.units.force, state.units.length
    return SegmentalRepulsion(coefficient.values["A"] * force, cutoff * length, settings["distance"], bonds, settings["exclude"])


def _segments(state: DeckState, style: PairStyle, made: dict[str, ReactiveBonds]) -> np.ndarray | list[ReactiveBonds] | None:
    """Bead indices of all bonds, or of those of the style's bond type; or what a fix makes or breaks, alone or with all others (None)."""
    kind, name = style.settings["bond_type"], style.settings.get("fix")
    changing = [fix for fix in made if kind in (None, state.fixes[fix].parameters["bond"])]
    if name is not None and name not in made:
        raise style.error(f"there is no fix bond/create or bond/break with the name {name}")
    if changing not in ([], [name]):
        what = next(fix for fix in changing if fix != name)
        raise style.error(f"in LAMMPS it does not follow the bonds that fix {what} makes or breaks; srp/react follows those of one fix")
    if changing:
        return None if kind is None else [made[changing[0]]]
    if kind is not None and kind > state.n_bond_types:
        raise style.error(f"bond type {kind} is out of range: there are {state.n_bond_types}")
    ids = state.bonds[(state.bonds[:, 0] == kind) if kind is not None else slice(None), 1:]
    if not len(ids):
        raise style.error("there are no bonds" + ("" if kind is None else f" of type {kind}"))
    return state.atoms.index_of(ids.ravel()).reshape(-1, 2)
