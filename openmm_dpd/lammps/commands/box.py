"""Commands that create or delete the box and beads: lattice, region, create_box, create_atoms, delete_atoms, reset_atoms."""

from collections.abc import Callable
from dataclasses import replace
from itertools import islice, product

import numpy as np

from ...base.errors import ParameterError
from ...base.geometry import pairs_within
from ..files.data_file import BONDED_STYLES, JOINED
from ..files.molecule_file import ParkMiller, Ranmar
from ..language import arguments as read
from ..state.atoms import Atoms
from ..state.box import Box
from ..state.deck_state import DeckState
from ..state.lattice import parse_lattice
from ..state.regions import Region, parse_region
from ..values.resolver import present
from ..values.structure_computes import hidden
from .beads import subset
from .joining import Placement, check_special
from .moving import values_of_variable
from .setup import COMMANDS, command

#: Steps from a cell to itself and to those around it.
_AROUND = np.array(list(product((-1, 0, 1), repeat=3)))


@command("lattice", 0, None)
def lattice(state: DeckState, args: list[str]) -> None:
    """``lattice style scale ...``."""
    state.lattice = parse_lattice(args, state.units.name == "lj", state.dimension)


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
    state.regions[name] = parse_region(
        args[1:], state.lattice.spacing, state.box, state.regions, lambda name: present(state).variable_alone(name)
    )


#: Options for memory that LAMMPS reserves; ignored.
ROOM = tuple(f"extra/{what}/per/atom" for what in (*JOINED, "special"))


@command("create_box N region ...", 2, None, box=False)
def create_box(state: DeckState, args: list[str]) -> None:
    """``create_box N region [bond/types N] [angle/types N] [dihedral/types N] [improper/types N] [extra/...]``."""
    found = state.region(args[1])
    if found.box is None:
        raise ParameterError(f"create_box needs a bounded block or prism with positive lengths; region '{args[1]}' is a {found.style}")
    state.n_types = read.integer(args[0], "the number of atom types", 1)
    counted = {f"{what}/types": what for what in JOINED}
    for keyword, values in read.options(args[2:], dict.fromkeys((*counted, *ROOM), 1), "create_box"):
        if keyword in counted:
            what = counted[keyword]
            if values[0] != "0":
                state.require_atom_style(f"create_box {keyword}", *JOINED[what][1])
            setattr(state, f"n_{what}_types", read.integer(values[0], f"the number of {what} types", 0))
    set_box(state, found.box)


def set_box(state: DeckState, box: Box) -> None:
    """Give the deck its box, or another one."""
    if box.overtilted:
        state.note("the box is tilted by more than half an edge; OpenMM uses the equivalent box with smaller tilts")
    if not all(state.periodic):
        if np.any(box.tilt):
            raise ParameterError("a tilted box must be periodic along all axes (boundary p p p)")
        box = replace(box, periodic=state.periodic)
    if state.dimension == 2:
        if not (box.low[2] < 0 < box.high[2] and state.periodic[2]) or box.tilt[1:].any():
            raise ParameterError("in two dimensions the box must be periodic along z, contain z = 0 inside, and have no tilts xz and yz")
        box = replace(box, flat=True)
    before = state.units
    if state.box is None:
        state.units = before.for_box(float(box.edges.max()))
    if state.units != before:
        # all that is in other units than the deck's so far
        state.timestep *= state.units.time / before.time
        state.note(f"units {before.name}: the box is over 1 mm, so these are reduced numbers; OpenMM takes them as nm, Da and ps")
    state.box = box


@command("create_atoms type style ...", 2, None, box=True)
def create_atoms(state: DeckState, args: list[str]) -> None:
    """``create_atoms type box | region ID | random N seed ID|NULL | single x y z``, with options, ``mol ID seed`` among them."""
    sizes = {"box": 0, "region": 1, "random": 3, "single": 3}
    style = read.choice(args[1], "the style of create_atoms", list(sizes))
    words, rest = read.taken(args[2:], sizes[style], f"create_atoms {style}")
    options: dict[str, list[str]] = {}
    basis: dict[int, int] = {}
    allowed = {"units": 1, "basis": 2, "overlap": 1, "maxtry": 1, "subset": 2, "ratio": 2, "mol": 2, "rotate": 4}
    for keyword, values in read.options(rest, allowed, f"create_atoms {style}"):
        if keyword == "basis":
            basis[read.integer(values[0], "the number of the basis atom", 1)] = read.integer(values[1], "its type", 1)
        options[keyword] = values
    scale = state.spacing(options.get("units", ["lattice"])[0])
    placement = Placement(state, options) if "mol" in options else None
    # with molecules the type is added to theirs
    kind = state.type_number(args[0]) if placement is None else read.integer(args[0], "the atom type")
    if style == "random":
        points = _random_points(state, words, options, scale, placement)
        types = np.full(len(points), kind)
    elif style == "single":
        points = np.array([[read.number(word, "a coordinate") for word in words]]) * scale
        types = np.full(1, kind)
        if not state.require_box("create_atoms").holds(points).all():
            state.note(f"create_atoms single: the point {' '.join(words)} is outside the box, so no bead is created")
            points, types = points[:0], types[:0]
    else:
        points, types = _lattice_points(state, kind, basis, words, options)
    if placement is not None:
        placement.add(state, kind, list(points) if style == "random" else [placement(point) for point in points])
        return
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


def _random_points(
    state: DeckState, words: list[str], options: dict[str, list[str]], scale: np.ndarray, placement: Placement | None
) -> np.ndarray:
    """(N, 3) random positions of beads, or with ``placement`` (N, beads, 3) of molecules: those of LAMMPS."""
    wanted = read.integer(words[0], "the number of beads", 0)
    if wanted > 2**31 - 1:
        raise ParameterError(f"create_atoms random: {wanted} beads are too many")
    seed = read.integer(words[1], "the seed", 1)
    limit = None if words[2] == "NULL" else state.region(words[2])
    box = state.require_box("create_atoms")
    low, high = box.bounds
    if limit is not None and limit.bounds is not None:
        low, high = np.maximum(low, limit.bounds[0]), np.minimum(high, limit.bounds[1])
    if np.any(high <= low):
        raise ParameterError(f"region '{words[2]}' and the box have no volume in common")
    overlap = read.non_negative(options.get("overlap", ["0"])[0], "overlap") * float(scale[0])
    tries = read.integer(options["maxtry"][0], "maxtry", 1) if "maxtry" in options else 1000
    found: list[np.ndarray] = []
    placed = _Placed(state.atoms.positions, box, overlap) if overlap else None
    points = _drawn(ParkMiller(seed), min(wanted, 100_000), low, high, box, limit)
    for _ in range(wanted):
        for point, inside in islice(points, tries):
            beads = point if placement is None or not inside else placement(point)
            if inside and (placed is None or placed.takes(beads.reshape(-1, 3))):
                found.append(beads)
                break
    if len(found) < wanted:
        state.note(f"create_atoms random: only {len(found)} of {wanted} {'beads' if placement is None else 'molecules'} could be placed")
    return np.array(found) if found else np.zeros((0, 3))


def _drawn(generator: ParkMiller, many: int, low: np.ndarray, high: np.ndarray, box: Box, limit: Region | None):
    """Random points between two corners, and whether each is in the box and in a region, without end; so many are drawn at a time."""
    while True:
        points = low + (high - low) * generator.random((many, 3))
        points[:, 2] *= not box.flat
        inside = box.holds(points) if limit is None else box.holds(points) & limit.contains(points)
        yield from zip(points, inside.tolist(), strict=True)


class _Placed:
    """Beads in cells of the box, none of which is closer to a later one than a distance."""

    def __init__(self, points: np.ndarray, box: Box, apart: float):
        self._vectors, self._inverse, self._apart = box.vectors, np.linalg.inv(box.vectors), apart
        self._cells = np.clip(1.0 / (apart * np.linalg.norm(self._inverse, axis=0)), 1, 1000).astype(int)
        self._inside: dict[tuple[int, ...], list[np.ndarray]] = {}
        self._add(points)

    def _add(self, points: np.ndarray) -> None:
        for place, point in zip(self._places(points).tolist(), points, strict=True):
            self._inside.setdefault(tuple(place), []).append(point)

    def _places(self, points: np.ndarray) -> np.ndarray:
        return np.floor(points @ self._inverse * self._cells).astype(int) % self._cells

    def takes(self, beads: np.ndarray) -> bool:
        """Whether no bead is too close to these (B, 3), which are then placed too."""
        around = {tuple(place) for place in ((self._places(beads)[:, None] + _AROUND) % self._cells).reshape(-1, 3).tolist()}
        if near := [point for place in around for point in self._inside.get(place, ())]:
            gap = np.array(near)[:, None] - beads
            gap -= np.round(gap @ self._inverse) @ self._vectors
            if np.sqrt(np.min(np.sum(gap * gap, axis=-1))) < self._apart:
                return False
        self._add(beads)
        return True


def _overlapping(state: DeckState, words: list[str]) -> np.ndarray:
    """Beads of the first group closer to one of the second than the distance, in the order of LAMMPS's memory, unless that one is gone."""
    first, second = state.group(words[1]), state.group(words[2])
    if np.any(first & second):
        _note_order(state, "delete_atoms overlap")
    state.settle("delete_atoms overlap")
    box, distance = state.require_box("delete_atoms"), read.positive(words[0], "the distance of overlap")
    i, j, r = pairs_within(state.atoms.positions - box.low, None, box.reduced_vectors, distance)
    kept = (r < distance) & ~hidden(state, i, j)
    close = set(zip(i[kept].tolist(), j[kept].tolist(), strict=True))
    partners: dict[int, list[int]] = {}
    for a, b in close | {(b, a) for a, b in close}:
        if first[a] and second[b]:
            partners.setdefault(a, []).append(b)
    doomed = np.zeros(len(first), dtype=bool)
    for bead in sorted(partners, key=state.atoms.slots.__getitem__):
        doomed[bead] = not doomed[partners[bead]].all()
    return doomed


def _at_random(state: DeckState, words: list[str]) -> np.ndarray:
    """``fraction|count value exact group region seed``; LAMMPS's numbers unless the count is exact."""
    ratio = read.choice(words[0], "the style of delete_atoms random", ("fraction", "count")) == "fraction"
    mask = state.group(words[3]) & (True if words[4] == "NULL" else state.region(words[4]).contains(state.atoms.positions))
    eligible, doomed = np.flatnonzero(mask), np.zeros(len(mask), dtype=bool)
    if read.switch(words[2], "exact") or not ratio:
        amount = words[1] if ratio or read.switch(words[2], "exact") else str(min(read.integer(words[1], "the count", 0), len(eligible)))
        doomed[subset(eligible, [amount, words[5]], ratio)] = True
        return doomed
    generator, fraction = Ranmar(read.integer(words[5], "the seed", 1)), read.non_negative(words[1], "the fraction")
    for bead in eligible[np.argsort(state.atoms.slots[eligible])]:
        doomed[bead] = generator.uniform() <= fraction
    return doomed


#: Styles of delete_atoms: number of words, and mask of the beads to be deleted.
_DELETED: dict[str, tuple[int, Callable[[DeckState, list[str]], np.ndarray]]] = {
    "group": (1, lambda state, words: state.group(words[0]).copy()),
    "region": (1, lambda state, words: state.region(words[0]).contains(state.atoms.positions)),
    "variable": (1, lambda state, words: values_of_variable(state, f"v_{words[0]}", "delete_atoms") != 0),
    "overlap": (3, _overlapping),
    "random": (6, _at_random),
}


@command("delete_atoms style ...", 2, None)
def delete_atoms(state: DeckState, args: list[str]) -> None:
    """``delete_atoms group|region|variable ID | overlap r group group | random ... [compress yes|no] [bond yes|no] [mol yes|no]``."""
    size, find = _DELETED[read.choice(args[0], "the style of delete_atoms", list(_DELETED))]
    words, rest = read.taken(args[1:], size, f"delete_atoms {args[0]}")
    options, doomed = read.single(rest, "delete_atoms", compress="yes", bond="no", mol="no"), find(state, words)
    if read.switch(options["mol"], "mol"):
        state.require_atom_style("delete_atoms mol", *BONDED_STYLES)
        doomed = doomed | np.isin(state.atoms.molecules, np.setdiff1d(state.atoms.molecules[doomed], 0))
    gone = state.atoms.ids[doomed]
    kept_terms = {f"{what}s": getattr(state, f"{what}s") for what in JOINED}
    kept_terms = {name: terms[~np.isin(terms[:, 1:], gone).any(axis=1)] for name, terms in kept_terms.items()}
    lost = {name: len(getattr(state, name)) - len(terms) for name, terms in kept_terms.items()}
    if any(lost.values()) and not read.switch(options["bond"], "bond"):
        broken = " and ".join(f"{count} {name}" for name, count in lost.items() if count)
        raise ParameterError(f"{broken} would lose a bead; add 'bond yes' to delete them, too")
    before = state.bonds
    for name, terms in kept_terms.items():
        setattr(state, name, terms)
    check_special(state, gone, before, "delete_atoms", "delete whole molecules")
    # LAMMPS assigns new ids only in atom styles without molecules, in the order of beads in its memory
    compress = read.switch(options["compress"], "compress") and not state.has_atom_style(*BONDED_STYLES)
    if compress:
        _note_order(state, "delete_atoms")
    kept = state.atoms.delete(doomed, by_slots=compress)
    state.groups = {name: mask[kept] for name, mask in state.groups.items()}
    if compress:
        state.atoms.ids = np.arange(1, len(kept) + 1)


def _note_order(state: DeckState, command: str) -> None:
    """Say so where the order of beads in LAMMPS's memory is not known."""
    if state.reordered:
        state.note(
            f"{command} follows the order in which the beads were made; LAMMPS, which sorts beads by position during a run, has another "
            "order unless 'atom_modify sort 0 0.0' precedes the first run"
        )


def _by_place(state: DeckState) -> np.ndarray:
    """The order of ``reset_atoms id sort yes``: bins of some ten beads in the box around all, x fastest, and x, y and z in them."""
    x, dimension = state.atoms.positions, state.dimension
    low, high = (np.where(np.arange(3) < dimension, end, 0.0) for end in (x.min(axis=0), x.max(axis=0)))
    low, high = np.where(low == high, low - 0.5, low), np.where(low == high, high + 0.5, high)
    low = low - 0.0001 * (high - low)
    high = high + 0.0001 * (high - low)
    edges = high - low
    size = (np.prod(edges[:dimension]) / (len(x) // 10 + 1)) ** (1 / dimension)
    counts = (edges / size).astype(int) + 1
    counts[dimension:] = 1
    k, m, n = ((x - low) * (1 / edges) * counts).astype(int).T
    return np.lexsort((*x.T[::-1], (n * counts[1] + m) * counts[0] + k))


@command("reset_atoms id [sort yes|no]", 1, None)
def reset_atoms(state: DeckState, args: list[str]) -> None:
    """``reset_atoms id [sort yes|no]``: renumbers the ids from 1 without gaps, in the order of beads in LAMMPS's memory, or by place."""
    if args[0] in ("mol", "image"):
        raise ParameterError(f"reset_atoms {args[0]} is not supported; only reset_atoms id is")
    read.choice(args[0], "the property of reset_atoms", ("id",))
    by_place = read.switch(read.single(args[1:], "reset_atoms id", sort="no")["sort"], "sort")
    if not by_place:
        _note_order(state, "reset_atoms id")
    elif not len(state.atoms):
        raise ParameterError("reset_atoms id sort yes needs beads; create or read them first")
    if any(compute.style == "msd" for compute in state.computes.values()):
        raise ParameterError("reset_atoms id: a compute msd stores the positions of beads; define it afterwards")
    state.settle("reset_atoms id")
    order = _by_place(state) if by_place else np.argsort(state.atoms.slots)
    fresh = np.empty(len(order), dtype=np.int64)
    fresh[order] = np.arange(1, len(order) + 1)
    for terms in (getattr(state, f"{what}s") for what in JOINED):
        terms[:, 1:] = fresh[state.atoms.index_of(terms[:, 1:].ravel())].reshape(terms[:, 1:].shape)
    state.atoms.take(order)
    state.atoms.ids = np.arange(1, len(order) + 1)
    state.groups = {name: mask[order] for name, mask in state.groups.items()}


@command("reset_ids", 0, None)
def reset_ids(state: DeckState, args: list[str]) -> None:
    """``reset_ids`` and ``reset_atom_ids``: older names of ``reset_atoms id``."""
    reset_atoms(state, ["id", *args])


COMMANDS["reset_atom_ids"] = COMMANDS["reset_ids"]
