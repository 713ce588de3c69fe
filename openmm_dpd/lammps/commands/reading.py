"""The command read_data: a deck's first beads, or more of them."""

from collections.abc import Callable
from dataclasses import replace
from functools import partial
from pathlib import Path

import numpy as np

from ...base.errors import DeckError, ParameterError
from ..files.data_file import ARRAYS, BONDED_STYLES, JOINED, DataFile, read_data_file
from ..language import arguments as read
from ..language.lexer import Line, errors_at
from ..state.atoms import Atoms
from ..state.deck_state import DeckState
from .box import ROOM, set_box
from .setup import COMMANDS, command


@command("read_data file ...", 1, None)
def read_data(state: DeckState, args: list[str]) -> None:
    """``read_data file [add append|merge|ID [MOL]] [shift x y z] [offset T B A D I] [nocoeff] [extra/...] [group ID]``."""
    adds = 0
    if "add" in args:
        at = args.index("add")
        adds = 2 if args[at + 2 : at + 3] and args[at + 2].isdigit() else 1
    more = {"extra/atom/types": "n_types", **{f"extra/{what}/types": f"n_{what}_types" for what in JOINED}}
    sizes = {**dict.fromkeys((*more, *ROOM, "group"), 1), "nocoeff": 0, "add": adds or 1, "shift": 3, "offset": 5, "fix": 3}
    only = {"fix": ("", "fixes store no values of beads here; leave out the section")}
    chosen = dict(read.options(args[1:], sizes, "read_data", only=only))
    if (state.box is None) == ("add" in chosen):
        raise ParameterError(f"read_data {'add must come after' if adds else 'without add must come before'} the box is defined")
    wrong = [name for name in chosen if name in (more if adds else ("shift", "offset"))]
    if wrong:
        raise ParameterError(f"read_data {wrong[0]} cannot be used {'with' if adds else 'without'} add, as in LAMMPS")
    path = state.find_file(args[0])
    data = read_data_file(path, state.atom_style, state.n_species, state.labels)
    for option, name in more.items() if not adds else ():
        setattr(state, name, getattr(data, name) + read.integer(chosen.get(option, ["0"])[0], option, 0))
    if state.n_types < 1:
        raise DeckError("the header announces no atom types", str(path))
    for what, labels in data.labels.items():
        for label, kind in labels.items():
            state.add_label(what, kind, label)
    hint = data.hints.get("Atoms", "")
    if hint and hint.split()[0] != state.atom_style.split()[0]:
        state.note(f"{path.name}: the Atoms section is marked '{hint}', but read as atom_style {state.atom_style}")
    offsets = dict(zip(["atom", *JOINED], (read.integer(word, "offset", 0) for word in chosen.get("offset", ["0"] * 5)), strict=False))
    if adds:
        _move(state, data, chosen["add"], [read.number(word, "shift") for word in chosen.get("shift", ["0"] * 3)], offsets)
    else:
        set_box(state, data.box)
    before = len(state.atoms)
    _take_atoms(state, data, path)
    for name in chosen.get("group", ()):
        state.groups[name] = state.groups.get(name, False) | np.isin(state.atoms.ids, data.columns["id"])
    state.masses.update({state.type_number(str(kind + offsets["atom"])): mass * state.units.mass for kind, mass in data.masses.items()})
    if before and np.any(np.diff(state.atoms.ids) < 1):
        order = np.argsort(state.atoms.ids, kind="stable")
        state.atoms.take(order)
        state.groups = {name: mask[order] for name, mask in state.groups.items()}
        for identity in state.atoms.ids[1:][np.diff(state.atoms.ids) == 0]:
            raise ParameterError(f"read_data add: there already is a bead with the id {identity}; use 'add append'")
    if "nocoeff" not in chosen:
        _take_coefficients(state, data, path, offsets)


def _move(state: DeckState, data: DataFile, words: list[str], shift: list[float], offsets: dict[str, int]) -> None:
    """Move ids, types, molecules and positions of a file that is added to the beads there are, and enlarge the box."""
    mode, *_ = words
    own, atoms, molecules = state.require_box("read_data add"), state.atoms, 0
    if mode == "append":
        ids, molecules = int(atoms.ids.max(initial=0)), max(0, int(atoms.molecules.max(initial=0)))
    elif mode == "merge":
        ids = 0
    else:
        ids, molecules = (read.integer(word, "an offset of add", 0) for word in (*words, "0")[:2])
        if (len(words) == 2) != state.has_atom_style(*BONDED_STYLES):
            raise ParameterError("read_data add takes an offset of the ids and, if beads have molecules, another one of these")
    if np.any(own.tilt != data.box.tilt):
        raise ParameterError("read_data add: the two boxes have different tilts")
    state.box = replace(own, low=np.minimum(own.low, data.box.low + shift), high=np.maximum(own.high, data.box.high + shift))
    data.positions = data.positions + shift
    data.columns["id"] = data.columns["id"] + ids
    data.columns["type"] = data.columns["type"] + offsets["atom"]
    if "molecule" in data.columns:
        data.columns["molecule"] = data.columns["molecule"] + molecules
    for what in JOINED:
        terms = getattr(data, f"{what}s")
        terms[:, 0] += offsets[what]
        terms[:, 1:] += ids
    for what, kinds in (("atom", data.columns["type"]), *((what, getattr(data, f"{what}s")[:, 0]) for what in JOINED)):
        most = state.n_types if what == "atom" else getattr(state, f"n_{what}_types")
        if np.any(kinds > most):
            raise ParameterError(f"read_data add: {what} type {kinds.max()} is out of range: there are {most}; use extra/{what}/types")


def _take_atoms(state: DeckState, data: DataFile, path: Path) -> None:
    order = np.argsort(data.columns["id"], kind="stable")
    inside, shifts = state.require_box("read_data").settle(data.positions)
    atoms = Atoms.new(data.columns["id"][order], data.columns["type"][order], inside[order], state.n_species)
    if np.any(data.images[:, ~np.array(state.periodic)]):
        state.note(f"{path.name}: image flags along non-periodic axes are set to 0")
    atoms.images = (np.where(state.periodic, data.images, 0) + shifts)[order]
    atoms.velocities = data.velocities[order]
    atoms.slots = order
    for column, name in ARRAYS.items():
        if column in data.columns:
            setattr(atoms, name, data.columns[column][order])
    for k in range(state.n_species):
        atoms.concentrations[:, k] = data.columns[f"c{k + 1}"][order]
    state.add_atoms(atoms)
    for name in (f"{what}s" for what in JOINED):
        setattr(state, name, np.concatenate([getattr(state, name), getattr(data, name)]))


def _take_coefficients(state: DeckState, data: DataFile, path: Path, offsets: dict[str, int]) -> None:
    def moved(word: str, what: str = "atom") -> str:
        return str(read.integer(word, f"the {what} type") + offsets[what]) if offsets[what] else word

    def bonded(words: list[str], what: str) -> None:
        COMMANDS[f"{what}_coeff"](state, [moved(words[0], what), *words[1:]])

    handlers: dict[str, Callable[[list[str]], object]] = {
        "Pair Coeffs": lambda words: COMMANDS["pair_coeff"](state, [moved(words[0]), moved(words[0]), *words[1:]]),
        "PairIJ Coeffs": lambda words: COMMANDS["pair_coeff"](state, [*map(moved, words[:2]), *words[2:]]),
        **{f"{what.capitalize()} Coeffs": partial(bonded, what=what) for what in JOINED},
    }
    outer = state.here
    for name, rows in data.coefficients.items():
        for number, words in rows:
            state.here = Line(" ".join(words), str(path), number)
            with errors_at(state.here, f"{name}: "):
                handlers[name](words)
    state.here = outer
