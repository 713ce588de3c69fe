"""Commands that create or delete the box and beads: lattice, region, create_box, create_atoms, read_data, delete_atoms, reset_atoms."""

from collections.abc import Callable
from dataclasses import replace
from functools import partial
from pathlib import Path

import numpy as np

from ...base.errors import DeckError, ParameterError
from ...model.bonds import bonded_neighbours
from ..files.data_file import ARRAYS, BONDED_STYLES, JOINED, DataFile, read_data_file
from ..language import arguments as read
from ..language.lexer import Line, errors_at
from ..state.atoms import Atoms
from ..state.box import Box
from ..state.deck_state import DeckState
from ..state.lattice import parse_lattice
from ..state.regions import parse_region
from .beads import subset
from .setup import COMMANDS, command


@command("lattice", 0, None)
def lattice(state: DeckState, args: list[str]) -> None:
    """``lattice style scale ...``."""
    state.lattice = parse_lattice(args, state.units.name == "lj")


@command("region ID style values ...", 2, None)
def region(state: DeckState, args: list[str]) -> None:
    """``region ID style values ...``, or ``region ID delete``."""
    name = args[0]
    if args[1] == "delete":
        state.region(name)
        users = [other for other, found in state.regions.items() if name in found.parts]
        if users:
            raise ParameterError(f"region {name} is part of region {', '.join(users)}; delete that first")
        del state.regions[name]
        return
    if name in state.regions:
        raise ParameterError(f"there already is a region '{name}'; delete it first")
    state.regions[name] = parse_region(args[1:], state.lattice.spacing, state.box, state.regions)


#: Options for memory that LAMMPS reserves; ignored.
_ROOM = (*(f"extra/{what}/per/atom" for what in (*JOINED, "improper", "special")), "extra/improper/types")


@command("create_box N region ...", 2, None, box=False)
def create_box(state: DeckState, args: list[str]) -> None:
    """``create_box N region [bond/types N] [angle/types N] [dihedral/types N] [extra/...]``."""
    found = state.region(args[1])
    if found.box is None:
        raise ParameterError(f"create_box needs a bounded block or prism with positive lengths; region '{args[1]}' is a {found.style}")
    state.n_types = read.integer(args[0], "the number of atom types", 1)
    counted = {f"{what}/types": what for what in JOINED}
    for keyword, values in read.options(args[2:], dict.fromkeys((*counted, "improper/types", *_ROOM), 1), "create_box"):
        if keyword in counted:
            what = counted[keyword]
            if values[0] != "0":
                state.require_atom_style(f"create_box {keyword}", *JOINED[what][1])
            setattr(state, f"n_{what}_types", read.integer(values[0], f"the number of {what} types", 0))
    _set_box(state, found.box)


def _set_box(state: DeckState, box: Box) -> None:
    if np.any(np.abs(box.reduced_vectors - box.vectors) > 1e-9 * box.edges.max()):
        state.note("the box is tilted by more than half an edge; OpenMM uses the equivalent box with smaller tilts")
    if not all(state.periodic):
        if np.any(box.tilt):
            raise ParameterError("a tilted box must be periodic along all axes (boundary p p p)")
        box = replace(box, periodic=state.periodic)
    state.box = box


@command("create_atoms type style ...", 2, None, box=True)
def create_atoms(state: DeckState, args: list[str]) -> None:
    """``create_atoms type box | region ID | random N seed ID|NULL | single x y z``, with options."""
    kind = state.type_number(args[0])
    sizes = {"box": 0, "region": 1, "random": 3, "single": 3}
    style = read.choice(args[1], "the style of create_atoms", list(sizes))
    words, rest = read.taken(args[2:], sizes[style], f"create_atoms {style}")
    options: dict[str, list[str]] = {}
    basis: dict[int, int] = {}
    allowed = {"units": 1, "basis": 2, "overlap": 1, "maxtry": 1, "subset": 2, "ratio": 2}
    for keyword, values in read.options(rest, allowed, f"create_atoms {style}"):
        if keyword == "basis":
            basis[read.integer(values[0], "the number of the basis atom", 1)] = read.integer(values[1], "its type", 1)
        options[keyword] = values
    scale = state.spacing(options.get("units", ["lattice"])[0])
    if style == "random":
        points = _random_points(state, words, options)
        types = np.full(len(points), kind)
    elif style == "single":
        points = np.array([[read.number(word, "a coordinate") for word in words]]) * scale
        types = np.full(1, kind)
        if not state.require_box("create_atoms").holds(points).all():
            state.note(f"create_atoms single: the point {' '.join(words)} is outside the box, so no bead is created")
            points, types = points[:0], types[:0]
    else:
        points, types = _lattice_points(state, kind, basis, words, options)
    start = int(state.atoms.ids.max()) + 1 if len(state.atoms) else 1
    state.add_atoms(Atoms.new(np.arange(start, start + len(points)), types, points, state.n_species))


def _lattice_points(state: DeckState, kind: int, basis: dict[int, int], words: list[str], options: dict[str, list[str]]):
    if not len(state.lattice.basis):
        raise ParameterError("create_atoms box and region need a lattice; use the lattice command first")
    points, numbers = state.lattice.points(state.require_box("create_atoms"))
    if words:
        inside = state.region(words[0]).contains(points)
        points, numbers = points[inside], numbers[inside]
    types = np.full(len(points), kind)
    for number, other in basis.items():
        if number > len(state.lattice.basis) or other > state.n_types:
            raise ParameterError(
                f"basis {number} {other} is out of range: there are {len(state.lattice.basis)} basis atoms and {state.n_types} types"
            )
        types[numbers == number - 1] = other
    for keyword in ("ratio", "subset"):
        if keyword in options:
            chosen = np.sort(subset(np.arange(len(points)), options[keyword], keyword == "ratio"))
            points, types = points[chosen], types[chosen]
    return points, types


def _random_points(state: DeckState, words: list[str], options: dict[str, list[str]]) -> np.ndarray:
    wanted = read.integer(words[0], "the number of beads", 0)
    if wanted > 2**31 - 1:
        raise ParameterError(f"create_atoms random: {wanted} beads are too many")
    rng = np.random.default_rng(read.integer(words[1], "the seed", 1))
    limit = None if words[2] == "NULL" else state.region(words[2])
    box = state.require_box("create_atoms")
    low, high = box.bounds
    if limit is not None and limit.bounds is not None:
        low, high = np.maximum(low, limit.bounds[0]), np.minimum(high, limit.bounds[1])
    if np.any(high <= low):
        raise ParameterError(f"region '{words[2]}' and the box have no volume in common")
    overlap = read.non_negative(options["overlap"][0], "overlap") if "overlap" in options else 0.0
    tries = read.integer(options["maxtry"][0], "maxtry", 1) if "maxtry" in options else 1000
    present = state.atoms.positions
    found, drawn = np.zeros((0, 3)), 0
    while len(found) < wanted and drawn < wanted * tries:
        points = low + (high - low) * rng.random((wanted - len(found), 3))
        drawn += len(points)
        inside = box.holds(points)
        if limit is not None:
            inside &= limit.contains(points)
        for point in points[inside] if overlap else ():
            if _closest(np.vstack([present, found]), point, box) >= overlap:
                found = np.vstack([found, point])
        if not overlap:
            found = np.vstack([found, points[inside]])
    if len(found) < wanted:
        state.note(f"create_atoms random: only {len(found)} of {wanted} beads could be placed")
    return found


def _closest(points: np.ndarray, point: np.ndarray, box: Box) -> float:
    if not len(points):
        return np.inf
    gap = points - point
    gap -= np.round(gap @ np.linalg.inv(box.vectors)) @ box.vectors
    return float(np.sqrt(np.min(np.sum(gap * gap, axis=1))))


@command("read_data file ...", 1, None)
def read_data(state: DeckState, args: list[str]) -> None:
    """``read_data file [nocoeff] [extra/atom/types N] [extra/bond|angle|dihedral/types N] [group ID]``."""
    if state.box is not None:
        raise ParameterError("read_data must come before the box is defined (read_data add is not supported)")
    path = state.find_file(args[0])
    data = read_data_file(path, state.atom_style, state.n_species)
    more = {"extra/atom/types": "n_types", **{f"extra/{what}/types": f"n_{what}_types" for what in JOINED}}
    chosen = dict(read.options(args[1:], {**dict.fromkeys((*more, *_ROOM, "group"), 1), "nocoeff": 0}, "read_data"))
    for option, name in more.items():
        setattr(state, name, getattr(data, name) + read.integer(chosen.get(option, ["0"])[0], option, 0))
    if state.n_types < 1:
        raise DeckError("the header announces no atom types", str(path))
    hint = data.hints.get("Atoms", "")
    if hint and hint.split()[0] != state.atom_style:
        state.note(f"{path.name}: the Atoms section is marked '{hint}', but read as atom_style {state.atom_style}")
    _set_box(state, data.box)
    _take_atoms(state, data, path)
    if "group" in chosen:
        state.groups[chosen["group"][0]] = np.ones(len(state.atoms), dtype=bool)
    state.masses.update({kind: mass * state.units.mass for kind, mass in data.masses.items()})
    if "nocoeff" not in chosen:
        _take_coefficients(state, data, path)


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
    state.bonds, state.angles, state.dihedrals = data.bonds, data.angles, data.dihedrals


def _take_coefficients(state: DeckState, data: DataFile, path: Path) -> None:
    handlers: dict[str, Callable[[list[str]], object]] = {
        "Pair Coeffs": lambda words: COMMANDS["pair_coeff"](state, [words[0], *words]),
        "PairIJ Coeffs": lambda words: COMMANDS["pair_coeff"](state, words),
        **{f"{what.capitalize()} Coeffs": partial(COMMANDS[f"{what}_coeff"], state) for what in JOINED},
    }
    outer = state.here
    for name, rows in data.coefficients.items():
        for number, words in rows:
            state.here = Line(" ".join(words), str(path), number)
            with errors_at(state.here, f"{name}: "):
                handlers[name](words)
    state.here = outer


def _check_special(state: DeckState, gone: np.ndarray, bonds: np.ndarray) -> None:
    """Raise ParameterError if remaining beads would no longer be bonded neighbours: in LAMMPS they remain so."""
    largest = int(state.atoms.ids.max()) + 1 if len(state.bonds) else 0
    before, after = (bonded_neighbours(terms[:, 1:], largest) for terms in (state.bonds, bonds))
    for shell, factor, factor_of_charges in zip((1, 2, 3), state.special, state.special_charges, strict=True):
        cut = [pair for pair in before[shell] - after[shell] if not np.isin(pair, gone).any()]
        if cut and (factor, factor_of_charges) != (1, 1):
            i, j = min(cut)
            raise ParameterError(
                f"delete_atoms: beads {i} and {j} are bonded neighbours through a deleted bead, and remain so in LAMMPS, "
                "which is not supported; delete whole molecules, or set the special_bonds factors to 1"
            )


@command("delete_atoms group|region ID ...", 2, None)
def delete_atoms(state: DeckState, args: list[str]) -> None:
    """``delete_atoms group ID | region ID [compress yes|no] [bond yes|no]``."""
    kind = read.choice(args[0], "the style of delete_atoms", ("group", "region"))
    doomed = state.group(args[1]).copy() if kind == "group" else state.region(args[1]).contains(state.atoms.positions)
    options = read.single(args[2:], "delete_atoms", compress="yes", bond="no", mol="no")
    if read.switch(options["mol"], "mol"):
        raise ParameterError("delete_atoms mol yes is not supported")
    gone = state.atoms.ids[doomed]
    kept_terms = {f"{what}s": getattr(state, f"{what}s") for what in JOINED}
    kept_terms = {name: terms[~np.isin(terms[:, 1:], gone).any(axis=1)] for name, terms in kept_terms.items()}
    lost = {name: len(getattr(state, name)) - len(terms) for name, terms in kept_terms.items()}
    if any(lost.values()) and not read.switch(options["bond"], "bond"):
        broken = " and ".join(f"{count} {name}" for name, count in lost.items() if count)
        raise ParameterError(f"{broken} would lose a bead; add 'bond yes' to delete them, too")
    _check_special(state, gone, kept_terms["bonds"])
    for name, terms in kept_terms.items():
        setattr(state, name, terms)
    # LAMMPS assigns new ids only in atom styles without molecules, in the order of beads in its memory
    compress = read.switch(options["compress"], "compress") and state.atom_style not in BONDED_STYLES
    if compress:
        _check_standing(state, "delete_atoms", "keep the ids with 'compress no'")
    state.atoms.vacate(doomed)
    kept = np.flatnonzero(~doomed)
    if compress:
        kept = kept[np.argsort(state.atoms.slots[kept])]
    state.atoms.take(kept)
    state.groups = {name: mask[kept] for name, mask in state.groups.items()}
    if compress:
        state.atoms.ids = np.arange(1, len(kept) + 1)


def _check_standing(state: DeckState, command: str, remedy: str) -> None:
    """Raise ParameterError unless the order of beads in LAMMPS's memory is known."""
    if state.reordered:
        raise ParameterError(
            f"{command}: the new ids in LAMMPS depend on how it sorted the beads by position during a run; {remedy}, "
            "or turn sorting off with 'atom_modify sort 0 0.0' before the first run"
        )


@command("reset_atoms id [sort no]", 1, None)
def reset_atoms(state: DeckState, args: list[str]) -> None:
    """``reset_atoms id [sort no]``: renumbers the ids from 1 without gaps, in the order of beads in LAMMPS's memory."""
    if args[0] in ("mol", "image"):
        raise ParameterError(f"reset_atoms {args[0]} is not supported; only reset_atoms id is")
    read.choice(args[0], "the property of reset_atoms", ("id",))
    if read.switch(read.single(args[1:], "reset_atoms id", sort="no")["sort"], "sort"):
        raise ParameterError("reset_atoms id sort yes is not supported: ids would depend on LAMMPS's spatial bins; use sort no")
    _check_standing(state, "reset_atoms id", "leave it out")
    if any(compute.style == "msd" for compute in state.computes.values()):
        raise ParameterError("reset_atoms id: a compute msd stores the positions of beads; define it afterwards")
    state.settle("reset_atoms id")
    order = np.argsort(state.atoms.slots)
    fresh = np.empty(len(order), dtype=np.int64)
    fresh[order] = np.arange(1, len(order) + 1)
    for terms in (state.bonds, state.angles, state.dihedrals):
        terms[:, 1:] = fresh[state.atoms.index_of(terms[:, 1:].ravel())].reshape(terms[:, 1:].shape)
    state.atoms.take(order)
    state.atoms.ids = np.arange(1, len(order) + 1)
    state.groups = {name: mask[order] for name, mask in state.groups.items()}


@command("reset_ids", 0, None)
def reset_ids(state: DeckState, args: list[str]) -> None:
    """``reset_ids`` and ``reset_atom_ids``: older names of ``reset_atoms id``."""
    reset_atoms(state, ["id", *args])


COMMANDS["reset_atom_ids"] = COMMANDS["reset_ids"]
