"""What a deck's ``fix addforce``, ``fix setforce`` and ``fix wall/reflect`` mean for the scene."""

from __future__ import annotations

import numpy as np

from ...errors import ParameterError
from ...model.flow import AXES, SPECULAR, BodyForce, PositionForce, Wall
from ..language.expressions import evaluate
from ..language.lexer import errors_at
from ..language.position_formulas import BEAD_CONSTANTS, Known, depends_on, position_formula
from ..state.deck_state import DeckState
from ..state.records import Fix


# -- addforce -----------------------------------------------------------------------------------------------------------------
def body_forces_of(state: DeckState) -> list[BodyForce | PositionForce]:
    """Forces of all ``fix addforce``; those of a variable are translated into formulas of the position."""
    found: list[BodyForce | PositionForce] = []
    for fix in state.fixes.values():
        if fix.style != "addforce" or not state.group(fix.group).any():
            continue
        with errors_at(fix.where, f"fix {fix.name}: "):
            found += _added(state, fix, state.group(fix.group))
    return found


def _added(state: DeckState, fix: Fix, members: np.ndarray) -> list[BodyForce | PositionForce]:
    words: list[str] = fix.parameters["force"]
    texts = [state.variables.get(word[2:]).text if word.startswith("v_") else word for word in words]
    if not any(depends_on(text, state.variables, {*AXES, *BEAD_CONSTANTS}) for text in texts):
        force = [evaluate(text, _known(state, 1)) * state.units.force for text in texts]
        return [BodyForce(np.array(force), beads=members)] if any(force) else []
    box = state.require_box("fix addforce")
    if np.any(np.abs(box.reduced_vectors - box.vectors) > 1e-9 * box.edges.max()) and all(state.periodic):
        raise ParameterError("a force that follows the position needs a box that is tilted by half an edge at most")
    # type and mass are constants of a formula, so there is one force for each type
    by_type = any(depends_on(text, state.variables, set(BEAD_CONSTANTS)) for text in texts)
    result: list[BodyForce | PositionForce] = []
    for kind in range(1, state.n_types + 1) if by_type else [0]:
        beads = members & (state.atoms.types == kind) if kind else members
        if beads.any():
            known = _known(state, kind or 1)
            formulas = tuple(f"{state.units.force!r}*({position_formula(text, known)})" for text in texts)
            result.append(PositionForce(formulas, beads=beads, corner=box.low * state.units.length))  # type: ignore[arg-type]
    return result


def _known(state: DeckState, kind: int) -> Known:
    box = state.require_box("fix addforce")
    values = {f"{axis}lo": box.low[k] for k, axis in enumerate(AXES)} | {f"{axis}hi": box.high[k] for k, axis in enumerate(AXES)}
    values |= {f"l{axis}": box.edges[k] for k, axis in enumerate(AXES)} | {"vol": box.volume, "type": float(kind)}
    if kind in state.masses:
        values["mass"] = state.masses[kind] / state.units.mass
    return Known(state.variables, state.units.length, {name: float(value) for name, value in values.items()})


# -- setforce -----------------------------------------------------------------------------------------------------------------
def held_beads(state: DeckState) -> np.ndarray:
    """Mask of the beads whose forces ``fix setforce 0 0 0`` takes away, whether or not some fix would move them."""
    groups = [state.group(fix.group) for fix in state.fixes.values() if fix.style == "setforce"]
    return np.logical_or.reduce([np.zeros(len(state.atoms), dtype=bool), *groups])


def still_beads(state: DeckState, mobile: np.ndarray) -> np.ndarray:
    """Mask of beads that stay where they are because ``fix setforce 0 0 0`` takes away their forces.

    Raises
    ------
    DeckError
        If such beads have velocities (they would coast), if fix shardlow would change these, or if a later fix addforce acts on them.
    """
    still, held = np.zeros(len(state.atoms), dtype=bool), np.zeros(len(state.atoms), dtype=bool)
    for fix in state.fixes.values():
        if fix.style == "addforce" and np.any(held & state.group(fix.group)):
            raise fix.error("it comes after a fix setforce and acts on beads whose forces this takes; put it before, or on other beads")
        if fix.style != "setforce":
            continue
        held |= state.group(fix.group)
        members = state.group(fix.group) & mobile
        if np.any(state.atoms.velocities[members]):
            raise fix.error(
                f"beads of group {fix.group} have velocities and would coast without forces, which is not supported; "
                f"stop them with 'velocity {fix.group} set 0 0 0', or leave them out of the integrating fix",
            )
        if members.any() and any(other.style == "shardlow" for other in state.fixes.values()):
            raise fix.error("fix shardlow moves beads whatever their force is; leave them out of the integrating fix instead")
        still |= members
    return still


# -- walls --------------------------------------------------------------------------------------------------------------------
def walls_of(state: DeckState, mobile: np.ndarray) -> list[Wall]:
    """Walls of all ``fix wall/reflect``.

    Raises
    ------
    DeckError
        If an axis with ``boundary f`` is not closed by walls at both ends, or beads that move are not in the group.
    """
    walls: list[Wall] = []
    closed: dict[str, str] = {}
    for fix in state.fixes.values():
        if fix.style != "wall/reflect":
            continue
        if np.any(mobile & ~state.group(fix.group)):
            raise fix.error(f"there are beads that move outside group {fix.group}; walls reflect all of them here")
        for face, position in fix.parameters["faces"].items():
            if face in closed:
                raise fix.error(f"there is a wall at {face} already (fix {closed[face]})")
            closed[face] = fix.name
            walls.append(Wall(face[0], position, "above" if face.endswith("lo") else "below", SPECULAR))
    for axis, periodic in zip(AXES, state.periodic, strict=True):
        missing = [face for face in (f"{axis}lo", f"{axis}hi") if face not in closed]
        if missing and not periodic:
            raise ParameterError(
                f"boundary f along {axis}: beads that leave the box are lost in LAMMPS; close it with "
                f"'fix ID all wall/reflect {' '.join(f'{face} EDGE' for face in missing)}'"
            )
    return walls
