"""Commands that move or copy the beads that are there: displace_atoms, replicate."""

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from ...errors import ParameterError
from ..language import arguments as read
from ..state.deck_state import DeckState
from ..values.resolver import present
from .setup import command


# -- displace_atoms -----------------------------------------------------------------------------------------------------------
@command("displace_atoms group style values ...", 3, None)
def displace_atoms(state: DeckState, args: list[str]) -> None:
    """``displace_atoms group move|ramp|random|rotate values ... [units box|lattice]``."""
    box, mask = state.require_box("displace_atoms"), state.group(args[0])
    style = read.choice(args[1], "the style of displace_atoms", list(_STYLES))
    size, handler = _STYLES[style]
    words, rest = read.taken(args[2:], size, f"displace_atoms {style}")
    options = {name: values[0] for name, values in read.options(rest, {"units": 1}, "displace_atoms")}
    positions = np.array(state.atoms.positions)
    if style == "rotate":
        # on continuous paths: molecules stay whole
        positions[mask] = box.unwrap(positions, state.atoms.images)[mask]
        state.atoms.images = np.where(mask[:, None], 0, state.atoms.images)
    positions[mask] = handler(state, mask, positions[mask], words, state.spacing(options.get("units", "lattice")))
    inside, shifts = box.settle(positions)
    lost = ~box.holds(inside) if not all(box.periodic) else np.zeros(len(inside), dtype=bool)
    if lost.any():
        raise ParameterError(
            f"displace_atoms: bead {state.atoms.ids[np.argmax(lost)]} would lie outside the box, along an axis that does not repeat"
        )
    state.take_inside(inside, shifts)


def _move(state: DeckState, mask: np.ndarray, x: np.ndarray, words: list[str], scale: np.ndarray) -> np.ndarray:
    moved = x.copy()
    for k, word in enumerate(words):
        if word.startswith("v_"):
            # as in LAMMPS a variable sees beads that have moved along the axes before
            state.atoms.positions = np.array(state.atoms.positions)
            state.atoms.positions[mask] = moved
            moved[:, k] += scale[k] * values_of_variable(state, word, "displace_atoms")[mask]
        else:
            moved[:, k] += scale[k] * read.number(word, "a displacement")
    return moved


def values_of_variable(state: DeckState, word: str, command: str) -> np.ndarray:
    """(N,) values of an equal- or atom-style variable (``v_name``) in a command."""
    style = state.variables.get(word[2:]).style
    if style not in ("equal", "atom"):
        raise ParameterError(f"{command}: variable {word[2:]} is {style}-style; an equal- or atom-style one is expected")
    moment = present(state)
    return np.broadcast_to(moment.bead_values(word) if style == "atom" else moment.variable_alone(word[2:]), (len(state.atoms),))


def _ramp(state: DeckState, mask: np.ndarray, x: np.ndarray, words: list[str], scale: np.ndarray) -> np.ndarray:
    axis, values = read.ramp(words, ("x", "y", "z"), x, scale)
    moved = x.copy()
    moved[:, axis] += values
    return moved


def _random(state: DeckState, mask: np.ndarray, x: np.ndarray, words: list[str], scale: np.ndarray) -> np.ndarray:
    most = np.array([read.number(word, "a displacement") for word in words[:3]]) * scale
    generator = np.random.default_rng(read.integer(words[3], "the seed", 1))
    # numbers for all beads, so that those of one bead do not depend on the group
    return x + most * (2.0 * generator.random(state.atoms.positions.shape) - 1.0)[mask]


def _rotate(state: DeckState, mask: np.ndarray, x: np.ndarray, words: list[str], scale: np.ndarray) -> np.ndarray:
    point = np.array([read.number(word, "the point of rotate") for word in words[:3]]) * scale
    axis = np.array([read.number(word, "the axis of rotate") for word in words[3:6]])
    if not axis.any():
        raise ParameterError("displace_atoms rotate: the axis is zero")
    axis /= np.linalg.norm(axis)
    angle = np.radians(read.number(words[6], "the angle of rotate"))
    arms = x - point
    along = (arms @ axis)[:, None] * axis
    across = arms - along
    return point + along + np.cos(angle) * across + np.sin(angle) * np.cross(axis, across)


_STYLES: dict[str, tuple[int, Callable[[DeckState, np.ndarray, np.ndarray, list[str], np.ndarray], np.ndarray]]] = {
    "move": (3, _move),
    "ramp": (6, _ramp),
    "random": (4, _random),
    "rotate": (7, _rotate),
}


# -- replicate ----------------------------------------------------------------------------------------------------------------
@command("replicate nx ny nz", 3)
def replicate(state: DeckState, args: list[str]) -> None:
    """``replicate nx ny nz``: the box and its beads side by side; copies belong to the groups of their beads."""
    counts = np.array([read.integer(word, "a number of copies", 1) for word in args])
    box, atoms = state.require_box("replicate"), state.atoms
    if any(compute.style == "msd" for compute in state.computes.values()):
        raise ParameterError("replicate: a compute msd remembers where the beads were; define it afterwards")
    if any(count > 1 and not periodic for count, periodic in zip(counts, box.periodic, strict=True)):
        raise ParameterError("replicate: the box does not repeat along an axis that is copied")
    nx, ny, nz = counts.tolist()
    # in the order of the ids of the copies, x fastest
    cells = np.array([(i, j, k) for k in range(nz) for j in range(ny) for i in range(nx)])
    n, most, molecules = len(atoms), int(atoms.ids.max(initial=0)), int(atoms.molecules.max(initial=0))
    copy = np.repeat(np.arange(len(cells)), n)
    unwrapped, slots = box.unwrap(atoms.positions, atoms.images), atoms.slots
    atoms.take(np.tile(np.arange(n), len(cells)))
    atoms.ids = atoms.ids + most * copy
    atoms.molecules = np.where(atoms.molecules > 0, atoms.molecules + molecules * copy, 0)
    # beads stand in LAMMPS's memory with z fastest
    i, j, k = cells.T
    atoms.slots = np.tile(slots, len(cells)) + n * np.repeat((i * ny + j) * nz + k, n)
    state.groups = {name: np.tile(mask, len(cells)) for name, mask in state.groups.items()}
    state.bonds, state.angles = (_copied(terms, most, len(cells)) for terms in (state.bonds, state.angles))
    xy, xz, yz = box.tilt
    state.box = replace(box, high=box.low + counts * box.edges, tilt=np.array([xy * ny, xz * nz, yz * nz]))
    atoms.images = np.zeros_like(atoms.images)
    inside, shifts = state.box.settle(np.tile(unwrapped, (len(cells), 1)) + np.repeat(cells @ box.vectors, n, axis=0))
    state.take_inside(inside, shifts)


def _copied(terms: np.ndarray, most: int, copies: int) -> np.ndarray:
    """Bonds or angles of all copies: type and ids."""
    shift = np.repeat(np.arange(copies), len(terms))[:, None] * most
    found = np.tile(terms, (copies, 1))
    found[:, 1:] += shift
    return found
