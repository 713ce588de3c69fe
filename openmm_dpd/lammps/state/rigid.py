"""The rigid bodies of ``fix rigid`` and its like."""

from functools import partial
from typing import NamedTuple

import numpy as np

from ...base.errors import ParameterError
from ...model.bodies import Body
from ..language import arguments as read
from .deck_state import DeckState, pairs_left_out
from .records import COUPLED, Fix

#: Fixes that move bodies.
RIGID = ("rigid", "rigid/nve", "rigid/small", "rigid/nve/small")


class DeckBody(NamedTuple):
    """One body: its fix, its beads, the axes along which it moves, whether it turns, whether inner pairs count in energies, and the id of
    the bead with which LAMMPS keeps it, the nearest one to the middle of its extents where the fix is defined."""

    fix: Fix
    beads: np.ndarray
    moves: str
    turns: bool
    inner: bool
    owner: int


def parse_rigid(state: DeckState, group: str, words: list[str], fix: str) -> dict:
    """``single|molecule|group N ID ... [force M x y z] [torque M x y z] [reinit yes|no]``."""
    usage = f"fix ID group {fix} single|molecule|group N ID1 ... [force M x y z] [torque M x y z]"
    read.count(words, usage, 1, None)
    known = ("molecule",) if fix.endswith("small") else ("single", "molecule", "group")
    style = read.choice(words[0], f"the bodies of fix {fix}", known)
    groups, rest = [group], words[1:]
    if state.dimension == 2:
        raise ParameterError(f"fix {fix} is not supported in two dimensions")
    if style == "group":
        groups, rest = read.taken(rest[1:], read.integer(rest[0] if rest else "", "the number of groups", 1), usage)
    members = _members(state, group, style, groups)
    free = np.ones((len(members), 2, 3), dtype=bool)
    only = dict.fromkeys(("infile", "langevin", "mol", "temp", "iso"), ("", "set velocities and masses, and add forces, by other commands"))
    sizes = {**dict.fromkeys(("force", "torque"), 4), **dict.fromkeys(("reinit", *only), 1)}
    for keyword, values in read.options(rest, sizes, f"fix {fix}", only=only):
        if keyword != "reinit":
            flags = [read.switch(word, f"a flag of {keyword}") for word in values[1:]]
            for number in read.numeric_range(values[0], len(members), "body"):
                free[number - 1, int(keyword == "torque")] = flags
    if np.any(free[:, 1].any(axis=1) & ~free[:, 1].all(axis=1)):
        raise ParameterError(f"fix {fix}: a body turns about all axes, or about none; the flags of torque must be the same")
    if fix in ("rigid", "rigid/small"):
        state.note(
            f"fix {fix}: bodies turn as in rigid/nve, by a splitting; LAMMPS iterates, which is the same to second order in the step"
        )
    x = state.require_box(f"fix {fix}").unwrap(state.atoms.positions, state.atoms.images)
    middles = [0.5 * (x[its].min(axis=0) + x[its].max(axis=0)) if len(its) else x[:1] for its in members]
    owners = [its[np.argmin(np.sum((x[its] - at) ** 2, axis=1))] if len(its) else 0 for its, at in zip(members, middles, strict=True)]
    return {"lambda": 0.5, "style": style, "groups": groups, "free": free, "owners": state.atoms.ids[owners]}


def _members(state: DeckState, group: str, style: str, groups: list[str]) -> list[np.ndarray]:
    """Indices of the beads of each body."""
    mask = state.group(group)
    if style == "molecule":
        numbers = state.atoms.molecules
        if np.any(numbers[mask] <= 0):
            raise ParameterError("fix rigid: a bead of the group is in no molecule")
        return [np.flatnonzero(mask & (numbers == number)) for number in np.unique(numbers[mask])]
    return [np.flatnonzero(mask & state.group(name)) for name in groups]


def moved_by(state: DeckState, fix: Fix) -> np.ndarray:
    """(N,) which beads an integrating fix moves: its group, or those of its bodies."""
    mask = state.group(fix.group)
    if fix.style in RIGID:
        its = _members(state, fix.group, fix.parameters["style"], fix.parameters["groups"])
        return np.isin(np.arange(len(mask)), np.concatenate(its))
    return mask


def deck_bodies(state: DeckState) -> list[DeckBody]:
    """All bodies of the present fixes.  DeckError if another fix moves or changes their beads in another way."""
    found = list[DeckBody]()
    for fix in state.fixes_of(*RIGID):
        given = fix.parameters
        members, mask = _members(state, fix.group, given["style"], given["groups"]), state.group(fix.group)
        if len(members) != len(given["free"]):
            raise fix.error(f"its molecules have changed: there were {len(given['free'])}, and are {len(members)}; give the fix again")
        if state.moving_box:
            raise fix.error("its bodies cannot follow the box of fix deform")
        for other in state.fixes_of("momentum", *(style for style in COUPLED if style != "langevin")):
            if other.style == "npt" or np.any(mask & state.group(other.group)):
                raise other.error(f"{other.style} changes single beads, and not the bodies of fix {fix.name}; take a group without them")
        for beads, owner, (force, torque) in zip(members, given["owners"], given["free"], strict=True):
            if len(beads) < 2:
                raise fix.error(f"a body has {len(beads)} beads; each needs two at least")
            i, j = np.triu_indices(len(beads), 1)
            out = pairs_left_out(state, state.atoms.types[beads], partial(np.take, indices=beads), i, j)
            moves = "".join(axis for axis, moving in zip("xyz", force, strict=True) if moving)
            found.append(DeckBody(fix, beads, moves, bool(torque.all()), not out.all(), owner))
    return found


def bodies_of(state: DeckState) -> list[Body]:
    """The bodies of a scene.  DeckError if one moves or turns where no forces act on it."""
    x, v, mass, made = state.scene_positions, state.atoms.velocities, state.bead_masses(), []
    for fix, beads, moves, turns, inner, _ in deck_bodies(state):
        m = mass[beads, None]
        centre, speed = np.sum(m * x[beads], axis=0) / m.sum(), np.sum(m * v[beads], axis=0) / m.sum()
        spin = np.cross(x[beads] - centre, m * (v[beads] - speed)).sum(axis=0)
        held = [axis not in moves for axis in "xyz"]
        if np.abs(speed[held]).max(initial=0.0) > 1e-9 or (not turns and np.abs(spin).max() > 1e-9):
            raise fix.error(
                f"the body of bead {state.atoms.ids[beads[0]]} moves where force or torque is off; it is held there: set its velocity to 0"
            )
        made.append(Body(beads, moves, turns, inner))
    return made


def make_whole(state: DeckState) -> None:
    """Hand beads of bodies to the scene as neighbours of the first ones, wherever their images are."""
    state.whole, images = None, state.atoms.images
    for body in deck_bodies(state):
        state.whole = np.zeros_like(images) if state.whole is None else state.whole
        state.whole[body.beads] = images[body.beads] - images[body.beads[0]]


def other_exclusions(state: DeckState) -> list[tuple[str, ...]]:
    """What ``neigh_modify exclude`` says about pairs that are not within one body."""
    body = np.full(len(state.atoms), -1)
    for number, its in enumerate(bodies := deck_bodies(state)):
        body[its.beads] = -1 if its.inner else number
    kept = []
    for kind, *words in state.exclusions if bodies else ():
        if kind == "type":
            kept.append((kind, *words))
            continue
        masks = [state.group(word) for word in words]
        together = np.logical_or.reduce(masks)
        split = state.atoms.molecules[together] if kind.startswith("molecule") else np.zeros(int(together.sum()))
        inside = kind != "molecule/inter" and all(
            len(np.unique(its)) == 1 and its[0] >= 0 for its in (body[together][split == k] for k in np.unique(split))
        )
        if not inside:
            kept.append((kind, *words))
    return kept if bodies else state.exclusions


def bound_freedom(state: DeckState, mask: np.ndarray) -> int:
    """Degrees of freedom that beads of a group (N,) lose in bodies of which it has all beads; held bodies count as if they moved."""
    lost = 0
    for fix in state.fixes_of(*RIGID):
        for beads in _members(state, fix.group, fix.parameters["style"], fix.parameters["groups"]):
            if mask[beads].all():
                x = state.require_box("a run").unwrap(state.atoms.positions[beads], state.atoms.images[beads])
                _, spread, _ = np.linalg.svd(x - x.mean(axis=0))
                lost += 3 * len(beads) - (5 if len(beads) == 2 or spread[1] < 1e-6 * spread[0] else 6)
    return lost
