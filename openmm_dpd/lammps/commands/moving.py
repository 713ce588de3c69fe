"""Commands that move or copy existing beads or set their velocities: displace_atoms, replicate, velocity."""

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from ...base.errors import ParameterError
from ...kernels.elementary import without_last_bits
from ...kernels.noise import mix
from ..files.data_file import JOINED
from ..language import arguments as read
from ..state.deck_state import DeckState
from ..state.records import Compute, without_rotation
from ..values.resolver import Resolver, present
from .setup import command


# -- displace_atoms -----------------------------------------------------------------------------------------------------------
@command("displace_atoms group style values ...", 3, None)
def displace_atoms(state: DeckState, args: list[str]) -> None:
    """``displace_atoms group move|ramp|random|rotate values ... [units box|lattice]``."""
    box, mask = state.require_box("displace_atoms"), state.group(args[0])
    style = read.choice(args[1], "the style of displace_atoms", list(_STYLES))
    size, handler = _STYLES[style]
    words, rest = read.taken(args[2:], size, f"displace_atoms {style}")
    options = read.single(rest, "displace_atoms", units="lattice")
    positions = np.array(state.atoms.positions)
    if style == "rotate":
        # unwrapped, so that molecules stay whole
        positions[mask] = box.unwrap(positions, state.atoms.images)[mask]
        state.atoms.images = np.where(mask[:, None], 0, state.atoms.images)
    positions[mask] = handler(state, mask, positions[mask], words, state.spacing(options["units"]))
    inside, shifts = box.settle(positions)
    lost = ~box.holds(inside) if not all(box.periodic) else np.zeros(len(inside), dtype=bool)
    if lost.any():
        raise ParameterError(f"displace_atoms: bead {state.atoms.ids[np.argmax(lost)]} would lie outside the box along a non-periodic axis")
    state.take_inside(inside, shifts)


def _move(state: DeckState, mask: np.ndarray, x: np.ndarray, words: list[str], scale: np.ndarray) -> np.ndarray:
    moved = x.copy()
    for k, word in enumerate(words):
        if word.startswith("v_"):
            # as in LAMMPS, a variable sees beads already moved along the previous axes
            state.atoms.positions = np.array(state.atoms.positions)
            state.atoms.positions[mask] = moved
            moved[:, k] += scale[k] * values_of_variable(state, word, "displace_atoms")[mask]
        else:
            moved[:, k] += scale[k] * read.number(word, "a displacement")
    return moved


def values_of_variable(state: DeckState, word: str, command: str) -> np.ndarray:
    """(N,) values of an equal- or atom-style variable (``v_name``) in a command."""
    style = state.variables.get(word[2:]).style
    if style not in ("equal", "atom", "atomfile"):
        raise ParameterError(f"{command}: variable {word[2:]} is {style}-style; expected an equal- or atom-style variable")
    moment = present(state)
    return np.broadcast_to(moment.bead_values(word) if style != "equal" else moment.variable_alone(word[2:]), (len(state.atoms),))


def _ramp(state: DeckState, mask: np.ndarray, x: np.ndarray, words: list[str], scale: np.ndarray) -> np.ndarray:
    axis, values = read.ramp(words, ("x", "y", "z"), x, scale)
    moved = x.copy()
    moved[:, axis] += values
    return moved


def _random(state: DeckState, mask: np.ndarray, x: np.ndarray, words: list[str], scale: np.ndarray) -> np.ndarray:
    most = np.array([read.number(word, "a displacement") for word in words[:3]]) * scale
    generator = np.random.default_rng(read.integer(words[3], "the seed", 1))
    # drawn for all beads, so that the numbers of a bead do not depend on the group
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
    """``replicate nx ny nz``: copies the box and its beads side by side; copies belong to the groups of their originals."""
    counts = np.array([read.integer(word, "a number of copies", 1) for word in args])
    box, atoms = state.require_box("replicate"), state.atoms
    if any(compute.style == "msd" for compute in state.computes.values()):
        raise ParameterError("replicate: a compute msd stores the positions of beads; define it afterwards")
    if any(count > 1 and not periodic for count, periodic in zip(counts, box.periodic, strict=True)):
        raise ParameterError("replicate: the box is not periodic along a replicated axis")
    if box.flat and counts[2] > 1:
        raise ParameterError("replicate: in two dimensions nz must be 1")
    nx, ny, nz = counts.tolist()
    # in the order of the copies' ids, x fastest
    cells = np.array([(i, j, k) for k in range(nz) for j in range(ny) for i in range(nx)])
    n, most, molecules = len(atoms), int(atoms.ids.max(initial=0)), int(atoms.molecules.max(initial=0))
    copy = np.repeat(np.arange(len(cells)), n)
    unwrapped, slots = box.unwrap(atoms.positions, atoms.images), atoms.slots
    atoms.take(np.tile(np.arange(n), len(cells)))
    atoms.ids = atoms.ids + most * copy
    atoms.molecules = np.where(atoms.molecules > 0, atoms.molecules + molecules * copy, 0)
    # in LAMMPS's memory the copies are ordered with z fastest
    i, j, k = cells.T
    atoms.slots = np.tile(slots, len(cells)) + n * np.repeat((i * ny + j) * nz + k, n)
    state.groups = {name: np.tile(mask, len(cells)) for name, mask in state.groups.items()}
    for name in (f"{what}s" for what in JOINED):
        setattr(state, name, _copied(getattr(state, name), most, len(cells)))
    xy, xz, yz = box.tilt
    state.box = replace(box, high=box.low + counts * box.edges, tilt=np.array([xy * ny, xz * nz, yz * nz]))
    atoms.images = np.zeros_like(atoms.images)
    inside, shifts = state.box.settle(np.tile(unwrapped, (len(cells), 1)) + np.repeat(cells @ box.vectors, n, axis=0))
    state.take_inside(inside, shifts)


def _copied(terms: np.ndarray, most: int, copies: int) -> np.ndarray:
    """Type and ids of the bonds, angles, dihedrals or impropers of all copies."""
    shift = np.repeat(np.arange(copies), len(terms))[:, None] * most
    found = np.tile(terms, (copies, 1))
    found[:, 1:] += shift
    return found


@command("velocity group style values ...", 3, None, box=True)
def velocity(state: DeckState, args: list[str]) -> None:
    """``velocity group create|set|scale|ramp|zero values ...``."""
    if not len(state.atoms):
        raise ParameterError("velocity needs beads; create or read them first")
    mask, style = state.group(args[0]), args[1]
    size, handler = read.style(_VELOCITY_STYLES, "velocity", style)
    words, rest = read.taken(args[2:], size, f"velocity {style}")
    defaults = dict(dist="uniform", sum="no", mom="yes", rot="no", loop="all", units="lattice", temp="", bias="no", rigid="NULL")
    options = read.single(rest, f"velocity {style}", **defaults)
    if options["rigid"] != "NULL" or read.switch(options["bias"], "bias"):
        raise ParameterError("the options rigid and bias of velocity are not supported")
    handler(state, args[0], mask, words, options)


def _rescale(state: DeckState, group: str, mask: np.ndarray, target: float, options: dict[str, str]) -> None:
    # the temperature of the group, or of the compute that the option names
    compute = state.temperature_compute(options["temp"]) if options["temp"] else Compute("", group, "temp", settings=state.temperature())
    # of the present velocities, since nothing has been measured
    current = Resolver(state).temperature(replace(compute, name="velocity"))
    if current <= 0:
        raise ParameterError(f"the velocities of group {group} cannot be scaled: its temperature is 0 (too few beads, or all at rest)")
    state.atoms.velocities[mask] *= np.sqrt(target / current)


def _zero_linear(state: DeckState, mask: np.ndarray) -> None:
    if mask.any():
        state.atoms.velocities[mask] -= state.mass_average(state.atoms.velocities, mask)


def _zero_angular(state: DeckState, mask: np.ndarray) -> None:
    """Remove the rotation about the centre of mass, computed from unwrapped positions."""
    if not mask.any():
        return
    atoms = state.atoms
    x = state.require_box("velocity").unwrap(atoms.positions, atoms.images)
    atoms.velocities[mask] = without_rotation(x[mask], atoms.velocities[mask], state.bead_masses()[mask])


def _create(state: DeckState, group: str, mask: np.ndarray, words: list[str], options: dict[str, str]) -> None:
    target = read.non_negative(words[0], "the temperature")
    seed = read.integer(words[1], "the seed", 1)
    dist = read.choice(options["dist"], "dist", ("uniform", "gaussian"))
    loop = read.choice(options["loop"], "loop", ("all", "local", "geom"))
    atoms, masses = state.atoms, state.bead_masses()
    before = atoms.velocities.copy()
    drawn = _by_position(atoms.positions, seed) if loop == "geom" else _by_id(atoms.ids, seed)
    if dist == "gaussian":
        # Box-Muller transform of two uniform numbers each
        drawn = without_last_bits(np.sqrt(-2 * np.log(1 - drawn[:, :3])) * np.cos(2 * np.pi * drawn[:, 3:]), 32)
    else:
        drawn = drawn[:, :3] - 0.5
    drawn[:, state.dimension :] = 0.0
    atoms.velocities = np.where(mask[:, None], drawn / np.sqrt(masses)[:, None], before)
    if read.switch(options["mom"], "mom"):
        _zero_linear(state, mask)
    if read.switch(options["rot"], "rot"):
        _zero_angular(state, mask)
    if target == 0:
        atoms.velocities[mask] = 0.0
    else:
        _rescale(state, group, mask, target, options)
    if read.switch(options["sum"], "sum"):
        atoms.velocities[mask] += before[mask]


def _by_id(ids: np.ndarray, seed: int) -> np.ndarray:
    """(N, 6) uniform numbers that depend only on the ids and the seed."""
    if ids.max() > 100 * len(ids) + 1_000_000:
        raise ParameterError(
            f"velocity create: {len(ids)} beads have ids up to {ids.max()}, and numbers are drawn for each id; use 'loop geom'"
        )
    return np.random.default_rng(seed).random((int(ids.max()), 6))[ids - 1]


def _by_position(positions: np.ndarray, seed: int) -> np.ndarray:
    """(N, 6) uniform numbers that depend only on the coordinates and the seed."""
    word = np.full(len(positions), np.uint64(seed))
    for axis in range(3):
        # adding 0.0 turns -0.0 into 0.0
        word = mix(word ^ (positions[:, axis] + 0.0).view(np.uint64))
    steps = np.arange(1, 7, dtype=np.uint64) * np.uint64(0x9E3779B97F4A7C15)
    # 53 bits, so that the result is below 1
    return (mix(word[:, None] + steps) >> np.uint64(11)).astype(np.float64) / 2.0**53


def _set(state: DeckState, group: str, mask: np.ndarray, words: list[str], options: dict[str, str]) -> None:
    scale, add = state.spacing(options["units"]), read.switch(options["sum"], "sum")
    velocities = state.atoms.velocities.copy()
    for axis, word in enumerate(words):
        if word == "NULL":
            continue
        if word.startswith("v_"):
            # as in LAMMPS, it sees the old velocities of all axes, and its values are not in lattice units
            value = values_of_variable(state, word, "velocity set")[mask]
        else:
            value = read.number(word, f"the velocity along {'xyz'[axis]}") * scale[axis]
        velocities[mask, axis] = value + (velocities[mask, axis] if add else 0.0)
    state.atoms.velocities = velocities


def _scale(state: DeckState, group: str, mask: np.ndarray, words: list[str], options: dict[str, str]) -> None:
    _rescale(state, group, mask, read.non_negative(words[0], "the temperature"), options)


def _velocity_ramp(state: DeckState, group: str, mask: np.ndarray, words: list[str], options: dict[str, str]) -> None:
    axis, values = read.ramp(words, ("vx", "vy", "vz"), state.atoms.positions[mask], state.spacing(options["units"]))
    state.atoms.velocities[mask, axis] = values + (state.atoms.velocities[mask, axis] if read.switch(options["sum"], "sum") else 0.0)


def _zero(state: DeckState, group: str, mask: np.ndarray, words: list[str], options: dict[str, str]) -> None:
    read.choice(words[0], "what velocity zero removes", ("linear", "angular"))
    if not mask.any():
        raise ParameterError(f"velocity zero: group {group} has no beads")
    (_zero_linear if words[0] == "linear" else _zero_angular)(state, mask)


_VELOCITY_STYLES: dict[str, tuple[int, Callable[[DeckState, str, np.ndarray, list[str], dict[str, str]], None]]] = {
    "create": (2, _create),
    "set": (3, _set),
    "scale": (1, _scale),
    "ramp": (6, _velocity_ramp),
    "zero": (1, _zero),
}
