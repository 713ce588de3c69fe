"""Molecules and what joins beads: molecule, the molecules of create_atoms, create_bonds, delete_bonds."""

import numpy as np

from ...base.errors import ParameterError
from ...base.geometry import pairs_within
from ...model.bonds import bonded_neighbours
from ..files.data_file import BONDED_STYLES, JOINED
from ..files.molecule_file import MoleculeTemplate, Ranmar, read_molecule
from ..language import arguments as read
from ..state.atoms import Atoms
from ..state.deck_state import DeckState
from ..values.structure_computes import hidden
from .setup import command

#: Options of molecule with an offset of the types: whose types.
_OFFSETS = {f"{what[0]}off": what for what in JOINED} | {"toff": "atom"}


@command("molecule ID file ...", 2, None)
def molecule(state: DeckState, args: list[str]) -> None:
    """``molecule ID file [offset T B A D I] [toff|boff|aoff|doff|ioff N] [scale S]``: the template of create_atoms."""
    name = read.identifier(args[0], "the id of a molecule")
    if name in state.templates:
        raise ParameterError(f"there already is a molecule '{name}'")
    if state.box is None:  # Which types there may be is known with the box: create_atoms reads the file.
        state.find_file(args[1])
        state.templates[name] = args
        return
    offsets, scale, at = {"atom": 0, **dict.fromkeys(JOINED, 0)}, 1.0, len(args)
    sizes = {"offset": 5, "scale": 1, **dict.fromkeys(_OFFSETS, 1)}
    at = next((k for k, word in enumerate(args) if k > 1 and word in sizes), len(args))
    if at > 2:
        raise ParameterError(f"molecule {name}: several files make a set of templates; define one molecule for each")
    for keyword, values in read.options(args[2:], sizes, "molecule"):
        if keyword == "scale":
            scale = read.positive(values[0], "scale")
            continue
        numbers = [read.integer(word, f"molecule {keyword}", 0) for word in values]
        offsets |= dict(zip(["atom", *JOINED] if keyword == "offset" else [_OFFSETS[keyword]], numbers, strict=False))
    types = {what: getattr(state, f"n_{what}_types") for what in JOINED}
    found = read_molecule(state.find_file(args[1]), state.atom_style, types, offsets, scale)
    for section in found.unused:
        state.note(f"molecule {name}: section {section} has no effect on its beads")
    state.templates[name] = found


class Placement:
    """Beads of molecules at points, for the options ``mol ID seed`` and ``rotate theta Rx Ry Rz`` of create_atoms."""

    def __init__(self, state: DeckState, options: dict[str, list[str]]):
        if isinstance(read.known(state.templates, options["mol"][0], "molecule"), list):
            molecule(state, state.templates.pop(options["mol"][0]))
        self._template: MoleculeTemplate = state.templates[options["mol"][0]]
        self._generator, self._turn = Ranmar(read.integer(options["mol"][1], "the seed of mol", 1)), None
        self._flat = state.require_box("create_atoms").flat
        if "rotate" in options:
            angle, *axis = (read.number(word, "a value of rotate") for word in options["rotate"])
            if not any(axis):
                raise ParameterError("create_atoms rotate: the axis is zero")
            self._turn = np.array(axis), np.radians(angle)

    def __call__(self, point: np.ndarray) -> np.ndarray:
        """(n, 3) positions of the beads of the next molecule around a point."""
        if self._turn is not None:
            return self._template.turned(*self._turn) + point
        draw = self._generator.uniform
        axis = np.array([0.0, 0.0, 1.0]) if self._flat else np.array([draw(), draw(), draw()]) - 0.5
        return self._template.turned(axis, 2 * np.pi * draw()) + point

    def add(self, state: DeckState, kind: int, placed: list[np.ndarray]) -> None:
        """Add molecules with these positions to the deck; ``kind`` is added to their types."""
        template, n, count, box = self._template, len(self._template.types), len(placed), state.require_box("create_atoms")
        for number in (template.types + kind).tolist():
            state.type_number(str(number))
        inside, shifts = box.settle(np.reshape(placed, (-1, 3)))
        if not all(box.periodic) and not box.holds(inside).all():
            raise ParameterError("create_atoms mol: a molecule reaches out of the box along an axis that is not periodic")
        start = int(state.atoms.ids.max(initial=0))
        atoms = Atoms.new(start + np.arange(1, n * count + 1), np.tile(template.types + kind, count), inside, state.n_species)
        atoms.images, atoms.charges = shifts, np.tile(template.charges, count)
        if state.has_atom_style(*BONDED_STYLES):
            own = np.ones(n, dtype=np.int64) if template.molecules is None else template.molecules
            first = max(0, int(state.atoms.molecules.max(initial=0))) + own.max() * np.arange(count)
            atoms.molecules = (first[:, None] + own).ravel()
        state.add_atoms(atoms)
        for what, rows in template.terms.items():
            added = np.tile(rows, (count, 1))
            added[:, 1:] += start + n * np.repeat(np.arange(count), len(rows))[:, None]
            _append(state, what, added)


def _append(state: DeckState, what: str, rows: np.ndarray) -> None:
    setattr(state, f"{what}s", np.concatenate([getattr(state, f"{what}s"), rows]))


# -- create_bonds, delete_bonds -----------------------------------------------------------------------------------------------
def _term_type(state: DeckState, what: str, word: str) -> int:
    state.require_atom_style(f"{what}s", *JOINED[what][1])
    found, most = read.integer(word, f"the {what} type", 1), getattr(state, f"n_{what}_types")
    if found > most:
        raise ParameterError(f"{what} type {found} is out of range: there are {most}")
    return found


@command("create_bonds style ...", 4, None, box=True)
def create_bonds(state: DeckState, args: list[str]) -> None:
    """``create_bonds many group group type rmin rmax``, or ``single/bond|angle|dihedral|improper type bead ...``; ``[special yes|no]``."""
    singles = {f"single/{what}": (what, size) for what, (size, _) in JOINED.items()}
    style = read.choice(args[0], "the style of create_bonds", ("many", *singles))
    what, size = singles.get(style, ("bond", 4))
    words, rest = read.taken(args[1:], size + 1, f"create_bonds {style}")
    if not read.switch(read.single(rest, "create_bonds", special="yes")["special"], "special"):
        state.note("create_bonds special no: neighbours of special_bonds follow from all bonds at any time")
    if style == "many":
        _append(state, what, _many(state, words))
        return
    ids = [read.integer(word, "the id of a bead", 1) for word in words[1:]]
    if len(set(ids)) < size or not np.isin(ids, state.atoms.ids).all():
        raise ParameterError(f"create_bonds {style}: expected {size} different ids of beads, not {' '.join(words[1:])}")
    _append(state, what, np.array([[_term_type(state, what, words[0]), *ids]]))


def _many(state: DeckState, words: list[str]) -> np.ndarray:
    first, second = (state.group(word) for word in words[:2])
    kind, low, high = _term_type(state, "bond", words[2]), *(read.non_negative(word, "a distance") for word in words[3:])
    if state.special[0] or state.special_charges[0]:
        raise ParameterError("create_bonds many needs special_bonds with factors 0 of bonded beads, as in LAMMPS; set them afterwards")
    state.settle("create_bonds")
    box, ids = state.require_box("create_bonds"), state.atoms.ids
    i, j, r = pairs_within(state.atoms.positions - box.low, None, box.reduced_vectors, high)
    kept = (r >= low) & (first[i] & second[j] | first[j] & second[i]) & ~hidden(state, i, j)
    pairs = sorted(zip(i[kept].tolist(), j[kept].tolist(), strict=True))
    return np.array([(kind, ids[a], ids[b]) for a, b in pairs], dtype=np.int64).reshape(-1, 3)


@command("delete_bonds group style ...", 2, None, box=True)
def delete_bonds(state: DeckState, args: list[str]) -> None:
    """``delete_bonds group multi|stats|atom N|bond N|angle N|... [any] [undo] [remove] [special]``: turns terms off, whose types are
    negative then, or removes them."""
    group, style = state.group(args[0]), read.choice(args[1], "the style of delete_bonds", ("multi", "stats", "atom", *JOINED))
    words, rest = read.taken(args[2:], style in ("atom", *JOINED), f"delete_bonds {style}")
    options = dict(read.options(rest, dict.fromkeys(("any", "undo", "remove", "special"), 0), "delete_bonds"))
    most = state.n_types if style == "atom" else getattr(state, f"n_{style}_types", 0)
    kinds = read.numeric_range(words[0], most, f"{style} type") if words else ()
    before = state.bonds
    for what in JOINED:
        terms = np.array(getattr(state, f"{what}s"))
        beads = state.atoms.index_of(terms[:, 1:].ravel()).reshape(terms[:, 1:].shape)
        member = (np.any if "any" in options else np.all)(group[beads], axis=1)
        chosen = member & (style in ("multi", "atom", what))
        if style == "atom":
            chosen &= np.isin(state.atoms.types[beads], kinds).any(axis=1)
        elif kinds:
            chosen &= np.isin(abs(terms[:, 0]), kinds)
        terms[chosen, 0] = abs(terms[chosen, 0]) * (1 if "undo" in options else -1)
        setattr(state, f"{what}s", terms[~member | (terms[:, 0] > 0)] if "remove" in options else terms)
    if "remove" in options and "special" not in options:
        check_special(state, np.zeros(0), before, "delete_bonds", "add the word special")


def check_special(state: DeckState, gone: np.ndarray, bonds: np.ndarray, command: str, remedy: str) -> None:
    """Raise ParameterError if beads that are left (not in ``gone``) are no longer bonded neighbours as they were with these ``bonds``: in
    LAMMPS they remain so."""
    largest = int(max(bonds[:, 1:].max(initial=0), state.atoms.ids.max(initial=0))) + 1
    before, after = (bonded_neighbours(terms[:, 1:], largest) for terms in (bonds, state.bonds))
    for shell, factor, factor_of_charges in zip((1, 2, 3), state.special, state.special_charges, strict=True):
        cut = [pair for pair in before[shell] - after[shell] if not np.isin(pair, gone).any()]
        if cut and (factor, factor_of_charges) != (1, 1):
            i, j = min(cut)
            raise ParameterError(
                f"{command}: beads {i} and {j} are bonded neighbours through a deleted bond or bead, and remain so in LAMMPS, "
                f"which is not supported; {remedy}, or set the special_bonds factors to 1"
            )
