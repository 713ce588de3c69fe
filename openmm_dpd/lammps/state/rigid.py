"""The rigid bodies of ``fix rigid`` and its like."""

from functools import partial
from typing import Any, NamedTuple

import numpy as np

from ...base.errors import ParameterError
from ...model.bodies import Body, GivenBody
from ..language import arguments as read
from ..language.lexer import TextFile, errors_at
from .deck_state import DeckState, pairs_left_out
from .records import COUPLED, Fix

#: Fixes that move bodies.
RIGID = ("rigid", "rigid/nve", "rigid/small", "rigid/nve/small")


class DeckBody(NamedTuple):
    """One body: its fix, its beads, the axes along which it moves, whether it turns, whether inner pairs count in energies, the id of the
    bead with which LAMMPS keeps it, the nearest one to the middle of its extents where the fix is defined, and what ``infile`` says."""

    fix: Fix
    beads: np.ndarray
    moves: str
    turns: bool
    inner: bool
    owner: int
    given: dict[str, Any] | None


#: What a row of an ``infile`` has after the number of the body, and how many values each has.
_GIVEN = {"mass": 1, "centre": 3, "inertia": 6, "velocity": 3, "momentum": 3, "image": 3}


def parse_rigid(state: DeckState, group: str, words: list[str], fix: str) -> dict:
    """``single|molecule|group N ID ... [force M x y z] [torque M x y z] [reinit yes|no] [infile F]``."""
    usage = f"fix ID group {fix} single|molecule|group N ID1 ... [force M x y z] [torque M x y z] [reinit yes|no] [infile F]"
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
    only = dict.fromkeys(("langevin", "mol", "temp", "iso"), ("", "set velocities, and add forces, by other commands"))
    sizes = {**dict.fromkeys(("force", "torque"), 4), **dict.fromkeys(("reinit", "infile", *only), 1)}
    again, given = None, dict[int, dict[str, Any]]()
    for keyword, values in read.options(rest, sizes, f"fix {fix}", only=only):
        if keyword == "reinit":
            again = read.switch(values[0], "reinit")
        elif keyword == "infile":
            numbers = [state.atoms.molecules[its[0]] for its in members] if style == "molecule" else range(1, len(members) + 1)
            given = _given(TextFile.read(state.find_file(values[0])), {int(number): k for k, number in enumerate(numbers)})
        else:
            flags = [read.switch(word, f"a flag of {keyword}") for word in values[1:]]
            for number in read.numeric_range(values[0], len(members), "body"):
                free[number - 1, int(keyword == "torque")] = flags
    if again and given:
        raise ParameterError(f"fix {fix}: with infile, reinit is no")
    if np.any(free[:, 1].any(axis=1) & ~free[:, 1].all(axis=1)):
        raise ParameterError(f"fix {fix}: a body turns about all axes, or about none; the flags of torque must be the same")
    if fix in ("rigid", "rigid/small"):
        state.note(
            f"fix {fix}: bodies turn as in rigid/nve, by a splitting; LAMMPS iterates, which is the same to second order in the step, with "
            "friction to first"
        )
    x = state.require_box(f"fix {fix}").unwrap(state.atoms.positions, state.atoms.images)
    middles = [0.5 * (x[its].min(axis=0) + x[its].max(axis=0)) if len(its) else x[:1] for its in members]
    owners = [its[np.argmin(np.sum((x[its] - at) ** 2, axis=1))] if len(its) else 0 for its, at in zip(members, middles, strict=True)]
    held = {"held": 0} if given or again is False else {}  # what it knows of its bodies holds from the first run on
    parameters = {"lambda": 0.5, "style": style, "groups": groups, "free": free, "owners": state.atoms.ids[owners]}
    return parameters | {"given": given, "begun": False, **held}


def _given(file: TextFile, numbers: dict[int, int]) -> dict[int, dict[str, Any]]:
    """What an ``infile`` says, by place of the body; DeckError with file and line."""
    usage = "'ID mass x y z ixx iyy izz ixy ixz iyz vx vy vz lx ly lz ix iy iz'"
    (first, *rows), found = list(file.rows()) or [(1, ["nothing"])], dict[int, dict[str, Any]]()
    (count,) = file.numbers(first, first[1], 1, "the number of bodies", "it")
    if count != len(rows):
        raise file.error(f"it announces {count:g} bodies, but has {len(rows)}", first[0])
    for row in rows:
        values = np.array(file.numbers(row, row[1], 20, usage, "a value"))
        if (values[[0, -3, -2, -1]] % 1).any():
            raise file.error(f"the number of a body and its images are whole, not {', '.join(row[1][:1] + row[1][-3:])}", row[0])
        if int(values[0]) not in numbers or numbers[int(values[0])] in found:
            again = "it is there twice" if int(values[0]) in numbers else f"there are {len(numbers)}, from {min(numbers)} to {max(numbers)}"
            raise file.error(f"body {row[1][0]}: {again}", row[0])
        parts = np.split(values[1:], np.cumsum(list(_GIVEN.values()))[:-1])
        its: dict[str, Any] = dict(zip(_GIVEN, parts, strict=True))
        xx, yy, zz, xy, xz, yz = its["inertia"]
        found[numbers[int(values[0])]] = its | {
            "mass": float(its["mass"][0]),
            "inertia": np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]]),
        }
    return found


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
        if state.has_atom_style("sphere"):
            raise fix.error("beads of atom_style sphere would turn with their bodies, and here beads are points")
        for other in state.fixes_of("momentum", *(style for style in COUPLED if style != "langevin")):
            if other.style == "npt" or np.any(mask & state.group(other.group)):
                raise other.error(f"{other.style} changes single beads, and not the bodies of fix {fix.name}; take a group without them")
        if given["begun"] and "held" in given and _differ(given["held"], _held(state, members)):
            raise fix.error("its beads have changed since its last run, which LAMMPS ignores with infile or reinit no; give the fix again")
        for k, (beads, owner, (force, torque)) in enumerate(zip(members, given["owners"], given["free"], strict=True)):
            if len(beads) < 2:
                raise fix.error(f"a body has {len(beads)} beads; each needs two at least")
            i, j = np.triu_indices(len(beads), 1)
            out = pairs_left_out(state, state.atoms.types[beads], partial(np.take, indices=beads), i, j)
            moves = "".join(axis for axis, moving in zip("xyz", force, strict=True) if moving)
            found.append(DeckBody(fix, beads, moves, bool(torque.all()), not out.all(), owner, given["given"].get(k)))
    return found


def _held(state: DeckState, members: list[np.ndarray]) -> tuple[np.ndarray, ...]:
    """Ids, unwrapped positions and velocities of all beads of bodies."""
    beads, atoms = np.concatenate(members), state.atoms
    x = state.require_box("a run").unwrap(atoms.positions[beads], atoms.images[beads])
    return atoms.ids[beads], x, atoms.velocities[beads]


def _differ(before: tuple[np.ndarray, ...], now: tuple[np.ndarray, ...]) -> bool:
    """Whether beads have changed by more than rounding, as when a run begins in a tilted box."""
    return not np.array_equal(before[0], now[0]) or any(
        np.abs(b - a).max() > 1e-9 * np.abs(a).max() for a, b in zip(before[1:], now[1:], strict=True)
    )


def keep_rigid(state: DeckState) -> None:
    """Note at the end of a run where it leaves bodies."""
    for fix in state.fixes_of(*RIGID):
        fix.parameters["begun"] = True
        if "held" in fix.parameters:
            fix.parameters["held"] = _held(state, _members(state, fix.group, fix.parameters["style"], fix.parameters["groups"]))


def given_now(given: dict[str, Any], x: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Centre and tensor of inertia of a body whose beads are at x (n, 3) now, from where they were at the start of its first run."""
    start = given["start"]
    left, _, right = np.linalg.svd((start - start.mean(axis=0)).T @ (x - x.mean(axis=0)))
    turn = (left * [1.0, 1.0, np.linalg.det(left @ right)]) @ right
    return x.mean(axis=0) + (given["middle"] - start.mean(axis=0)) @ turn, turn.T @ given["inertia"] @ turn


def bodies_of(state: DeckState) -> list[Body]:
    """The bodies of a scene.  DeckError if one moves or turns where no forces act on it."""
    x, v, mass, made, units = state.scene_positions, state.atoms.velocities, state.bead_masses(), [], state.units
    for fix, beads, moves, turns, inner, _, given in deck_bodies(state):
        m = mass[beads, None]
        centre, speed = np.sum(m * x[beads], axis=0) / m.sum(), np.sum(m * v[beads], axis=0) / m.sum()
        spin = np.cross(x[beads] - centre, m * (v[beads] - speed)).sum(axis=0)
        held = [axis not in moves for axis in "xyz"]
        if np.abs(speed[held]).max(initial=0.0) > 1e-9 or (not turns and np.abs(spin).max() > 1e-9):
            raise fix.error(
                f"the body of bead {state.atoms.ids[beads[0]]} moves where force or torque is off; it is held there: set its velocity to 0"
            )
        if given is None:
            made.append(Body(beads, moves, turns, inner))
            continue
        at, inertia = given_now(given, x[beads] / units.length)
        inertia *= units.mass * units.length**2
        with errors_at(fix.where, f"fix {fix.name}: "):
            made.append(GivenBody(beads, moves, turns, inner, given["mass"] * units.mass, at * units.length, inertia))
    return made


def make_whole(state: DeckState) -> None:
    """Hand beads of bodies to the scene as neighbours of the first ones, wherever their images are; and give those of an ``infile`` the
    velocities that it says, before their first run."""
    state.whole, images = None, state.atoms.images
    for body in deck_bodies(state):
        state.whole = np.zeros_like(images) if state.whole is None else state.whole
        state.whole[body.beads] = images[body.beads] - images[body.beads[0]]
        if body.given is not None and not body.fix.parameters["begun"]:
            its, box = body.given, state.require_box("a run")
            its["start"] = (state.atoms.positions + state.whole @ box.vectors)[body.beads]
            its["middle"] = its["centre"] + (its["image"] - images[body.beads[0]]) @ box.vectors
            spin = np.linalg.pinv(its["inertia"], rcond=1e-7, hermitian=True) @ its["momentum"]
            state.atoms.velocities[body.beads] = its["velocity"] + np.cross(spin, its["start"] - its["middle"])


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
        for k, beads in enumerate(_members(state, fix.group, fix.parameters["style"], fix.parameters["groups"])):
            if mask[beads].all():
                x = state.require_box("a run").unwrap(state.atoms.positions[beads], state.atoms.images[beads])
                _, spread, _ = np.linalg.svd(x - x.mean(axis=0))
                flat = len(beads) == 2 or spread[1] < 1e-6 * spread[0]
                if k in fix.parameters["given"]:
                    moments = np.linalg.eigvalsh(fix.parameters["given"][k]["inertia"])
                    flat = moments[0] < 1e-7 * moments[2]
                lost += 3 * len(beads) - (5 if flat else 6)
    return lost
