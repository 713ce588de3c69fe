"""Body forces and walls of a scene, from ``fix addforce``, ``gravity``, ``setforce`` and ``wall/reflect``.

Formulas of variables become OpenMM expressions of the position.  Their grammar is that of
:mod:`~openmm_dpd.lammps.language.expressions`, with texts in place of numbers.
"""

import re
from dataclasses import dataclass

import numpy as np

from ...base.errors import ParameterError
from ...model.flow import AXES, SPECULAR, BodyForce, PositionForce, Wall
from ..language.expressions import CONSTANTS, FUNCTIONS, Formula, evaluate
from ..language.lexer import errors_at
from ..language.variables import Variables
from ..state.deck_state import DeckState
from ..state.records import ACTING_FIXES, FORCE_FIXES, GUIDING, Fix

#: Words that have one value for all beads of a type.
BEAD_CONSTANTS = ("type", "mass")
#: Words of the box as it is at the start.
BOX_WORDS = (*(f"{axis}{end}" for axis in AXES for end in ("lo", "hi")), *(f"l{axis}" for axis in AXES), "vol")


@dataclass(frozen=True)
class Known:
    """Names that a formula may use besides x, y and z: variables, and words with known values; ``length`` is the deck's unit in nm."""

    variables: Variables
    length: float
    words: dict[str, float]

    def thermo(self, word: str) -> float:
        return self.words[word]

    def variable(self, name: str) -> float:
        return self.variables.operand(name, lambda text: evaluate(text, self))  # type: ignore[arg-type]  # of these names alone


def names_in(text: str, variables: Variables, within: tuple[str, ...] = ()) -> set[str]:
    """Names in a formula, and in the variables that it uses, and ``[`` if that is in one."""
    found = set(re.findall(r"(?<![\w.])[A-Za-z_]\w*|\[", text))
    for name in found - set(within):
        if name.startswith("v_"):
            found = found | names_in(variables.get(name[2:]).text, variables, (*within, name))
    return found


def depends_on(text: str, variables: Variables, words: set[str]) -> bool:
    """Whether a formula, or a variable that it uses, contains one of these words."""
    return not words.isdisjoint(names_in(text, variables))


#: Names in formulas that a force of OpenMM can have.
_FIXED = {*AXES, *BEAD_CONSTANTS, *CONSTANTS, *FUNCTIONS, *BOX_WORDS}


def position_formula(text: str, known: Known) -> str:
    """The formula as an OpenMM expression of x, y and z in nm.  ParameterError if it is malformed, or uses anything but positions, numbers,
    and variables made of these."""
    return str(_PositionFormula(text, known).value())


class _PositionFormula(Formula):
    kind = "text"
    resolver: Known

    def name(self, token: str):
        if token in ("x", "y", "z"):
            return f"({token}/{self.resolver.length!r})"
        if token.startswith("v_"):
            variables, name = self.resolver.variables, token[2:]
            if variables.get(name).style != "atom":
                return _number(self.resolver.variable(name))
            return variables._evaluated(name, variables.get(name), lambda text: position_formula(text, self.resolver))
        if token in CONSTANTS and self.peek()[1] != "(":
            return _number(CONSTANTS[token])
        result = super().name(token)
        return result if isinstance(result, str) else _number(result)


def _number(value: float) -> str:
    return f"({float(value)!r})"


# -- addforce and setforce ----------------------------------------------------------------------------------------------------
@dataclass(frozen=True, eq=False)
class Driving:
    """Combined effect of the fixes addforce, gravity and setforce of a deck."""

    pushes: list[tuple[Fix, np.ndarray]]  #: Fixes, and the (N, 3) components on which their forces act once all fixes are combined
    interacting: np.ndarray  #: (N, 3) components on which other forces act, too

    @property
    def still(self) -> np.ndarray:
        """Mask (N,) of the beads on which no force acts."""
        pushed = [mask & np.array([word not in ("NULL", "0") for word in words(fix)]) for fix, mask in self.pushes]
        return ~np.logical_or.reduce([self.interacting, *pushed]).any(axis=1)


#: Parameters of a force that OpenMM can have.
PLAIN = {"force", "energy", "counted"}


def guided(state: DeckState) -> bool:
    """Whether some fix acts within steps in a way that no force of OpenMM can; then all fixes that change forces do."""
    if state.fixes_of(*GUIDING) or state.pistons:
        return True
    fixes = state.fixes_of(*FORCE_FIXES)
    if fixes and state.has_atom_style("sphere"):
        return True  # masses within a type differ
    used = (name for fix in fixes for word in words(fix) if word != "NULL" for name in names_in(word, state.variables))
    return any(set(fix.parameters) - PLAIN for fix in fixes) or any(name not in _FIXED and not name.startswith("v_") for name in used)


def words(fix: Fix) -> list[str]:
    """The three formulas of an addforce, gravity or setforce; ``0`` means no force."""
    return fix.parameters["force"]


def driving(state: DeckState) -> Driving:
    """Combine these fixes in order, as LAMMPS does: a setforce removes what earlier fixes have added."""
    pushes: list[tuple[Fix, np.ndarray]] = []
    interacting = np.ones((len(state.atoms), 3), dtype=bool)
    for fix in state.fixes_of(*FORCE_FIXES):
        acts = np.outer(state.group(fix.group), [word != "NULL" for word in words(fix)])
        acts[:, 2] &= state.dimension == 3
        if fix.style == "setforce":
            interacting &= ~acts
            pushes = [(other, mask & ~acts) for other, mask in pushes]
        pushes.append((fix, acts))
    return Driving(pushes, interacting)


def body_forces_of(state: DeckState) -> list[BodyForce | PositionForce]:
    """Forces of all these fixes; variables are translated into formulas of the position."""
    found: list[BodyForce | PositionForce] = []
    if guided(state):
        return found
    for fix, mask in driving(state).pushes:
        with errors_at(fix.where, f"fix {fix.name}: "):
            for axes in np.unique(mask[mask.any(axis=1)], axis=0):
                components = [word if acts else "0" for word, acts in zip(words(fix), axes, strict=True)]
                found += _added(state, components, np.all(mask == axes, axis=1))
    return found


def _added(state: DeckState, components: list[str], members: np.ndarray) -> list[BodyForce | PositionForce]:
    texts = [state.variables.get(word[2:]).text if word.startswith("v_") else word for word in components]
    box, follows = state.require_box("a force on single beads"), any(depends_on(text, state.variables, set(AXES)) for text in texts)
    if follows and box.overtilted:
        raise ParameterError("a position-dependent force needs a box tilted by at most half an edge")
    # type and mass are constants in a formula, hence one force per type
    by_type = any(depends_on(text, state.variables, set(BEAD_CONSTANTS)) for text in texts)
    result: list[BodyForce | PositionForce] = []
    for kind in range(1, state.n_types + 1) if by_type else [0]:
        beads, known = members & (state.atoms.types == kind) if kind else members, _known(state, kind or 1)
        if follows and beads.any():
            formulas = tuple(f"{state.units.force!r}*({position_formula(text, known)})" for text in texts)
            result.append(PositionForce(formulas, beads=beads, corner=box.low * state.units.length))  # type: ignore[arg-type]
        elif beads.any():
            force = np.array([evaluate(text, known) * state.units.force for text in texts])
            result += [BodyForce(force, beads=beads)] if force.any() else []
    return result


def _known(state: DeckState, kind: int) -> Known:
    box = state.require_box("a force on single beads")
    values = {f"{axis}lo": box.low[k] for k, axis in enumerate(AXES)} | {f"{axis}hi": box.high[k] for k, axis in enumerate(AXES)}
    values |= {f"l{axis}": box.edges[k] for k, axis in enumerate(AXES)} | {"vol": box.volume, "type": float(kind)}
    if kind in state.masses:
        values["mass"] = state.masses[kind] / state.units.mass
    return Known(state.variables, state.units.length, {name: float(value) for name, value in values.items()})


def held_beads(state: DeckState) -> np.ndarray:
    """Mask (N,) of the beads that ``fix setforce 0 0 0`` holds during a minimisation, unless a later fix acts on them."""
    held = np.zeros(len(state.atoms), dtype=bool)
    for fix in state.fixes_of(*FORCE_FIXES, *ACTING_FIXES):
        holds = fix.style == "setforce" and set(words(fix)) == {"0"} and "region" not in fix.parameters
        held = np.where(state.group(fix.group), holds, held)
    return held


def still_beads(state: DeckState, mobile: np.ndarray) -> np.ndarray:
    """Mask of the beads at rest on which no force acts: they stay in place.  DeckError if fix shardlow would change velocities of beads
    whose forces a setforce removes."""
    if guided(state):
        return np.zeros_like(mobile)
    found = driving(state)
    taken = mobile & ~found.interacting.all(axis=1)
    for fix in state.fixes_of("setforce"):
        for other in state.fixes_of("shardlow", "nph") if np.any(taken & state.group(fix.group)) else ():
            if other.style == "shardlow":
                raise fix.error("fix shardlow moves beads regardless of their force; leave them out of the integrating fix instead")
            raise fix.error("with fix nph, setforce cannot act on beads that move: they would have no ensemble")
    return mobile & found.still & ~state.atoms.velocities.any(axis=1)


def interacting_beads(state: DeckState, mobile: np.ndarray) -> np.ndarray | None:
    """Mask (N, 3) of the components on which not only body forces act; immobile beads count as interacting.  None if all do."""
    if guided(state):
        return None
    found = driving(state).interacting | ~mobile[:, None]
    return None if found.all() else found


# -- walls --------------------------------------------------------------------------------------------------------------------
def walls_of(state: DeckState, mobile: np.ndarray) -> list[Wall]:
    """Walls of all ``fix wall/reflect``, and at open ends of axes with ``boundary f``, where LAMMPS would lose beads.  DeckError if mobile
    beads are not in the group."""
    walls: list[Wall] = []
    closed: dict[str, str] = {}
    for fix in state.fixes_of(*ACTING_FIXES):
        if fix.style == "wall/region":
            closed |= {f"{axis}{end}": fix.name for axis in AXES for end in ("lo", "hi")}
        closed |= dict.fromkeys(fix.parameters.get("faces", ()), fix.name)
    soft = set(closed)
    moved = np.zeros_like(mobile)  # whatever walls there are
    for fix in state.fixes_of("move"):
        moved |= state.group(fix.group) & all(fix.parameters["held"])
    for fix in state.fixes_of("wall/reflect"):
        if np.any(mobile & ~moved & ~state.group(fix.group)):
            raise fix.error(f"some mobile beads are not in group {fix.group}; here, walls reflect all of them")
        for face, position in fix.parameters["faces"].items():
            if face in closed and face not in soft:
                raise fix.error(f"there already is a wall at {face} (fix {closed[face]})")
            closed[face] = fix.name
            soft.discard(face)
            walls.append(Wall(face[0], position, "above" if face.endswith("lo") else "below", SPECULAR))
    box = state.require_box("a run")
    edges = dict(zip(AXES, (np.array([box.low, box.high]) * state.units.length).T.tolist(), strict=True))
    for axis, periodic in zip(AXES, state.periodic, strict=True):
        faces = [f"{axis}lo", f"{axis}hi"]
        missing = [face for face in faces if face not in closed]
        if missing and not periodic:
            if state.thermo.lost != "error":
                close = f"'fix ID all wall/reflect {' '.join(f'{face} EDGE' for face in missing)}'"
                raise ParameterError(
                    f"boundary f along {axis} with thermo_modify lost {state.thermo.lost}: beads cannot be lost; add {close}"
                )
            state.note(f"boundary f along {axis}: beads that reach {' or '.join(missing)} are reflected; LAMMPS loses them, and stops")
        # a wall with a potential has one behind it where there is one at the other end: a scene has both or none
        both = any(wall.axis == axis for wall in walls) or bool(missing)
        for end, face in enumerate(faces):
            if not periodic and both and (face in missing or face in soft):
                walls.append(Wall(axis, edges[axis][end], ("above", "below")[end], SPECULAR))
    return walls
