"""Forces on single beads: body forces with a pattern, and formulas of the position.

OpenMM folds positions back into the box when it likes, and a potential -f.x would jump with them.  So where there is a box the
expression is -f.(x - q(x)) with q(x) = floor(S x)/S, whose derivative is 0: the force is f, and the energy stays below f/S.  What only
modulates the force is a function of q as well, so that it adds no derivative.
"""

import re

import numpy as np
import openmm

from ...base.names import BODY_FORCE, EXTERNAL_GROUP
from ...model.flow import AXES, BodyForce, PositionForce

#: Positions are rounded to 1/S nm where they must not be differentiated; a power of two, so that it is exact.
_S = 2.0**20


def _rounded(name: str) -> str:
    return f"floor({name}*{_S!r})/{_S!r}"


def _folding(corner: np.ndarray, box: np.ndarray) -> list[str]:
    """Definitions of folded_x, folded_y, folded_z (rounded), in the order in which they need each other."""
    lines = []
    for k in (2, 1, 0):
        tilts = "".join(f"-({float(box[j, k])!r})*part_{AXES[j]}" for j in range(k + 1, 3) if box[j, k])
        lines.append(f"part_{AXES[k]}=({_rounded(AXES[k])}-({float(corner[k])!r}){tilts})/{float(box[k, k])!r}")
    for k in range(3):
        shifts = "".join(f"-({float(box[j, k])!r})*floor(part_{AXES[j]})" for j in range(k, 3) if box[j, k])
        lines.append(f"folded_{AXES[k]}={_rounded(AXES[k])}{shifts}")
    return lines


def _force(expression: str, name: str) -> openmm.CustomExternalForce:
    force = openmm.CustomExternalForce(expression)
    force.setName(name)
    force.setForceGroup(EXTERNAL_GROUP)
    force.addGlobalParameter(BODY_FORCE, 1.0)
    return force


def body_force(term: BodyForce, vectors: np.ndarray, box: np.ndarray | None) -> openmm.CustomExternalForce:
    """CustomExternalForce of a :class:`BodyForce` with the forces (N, 3) of the beads."""
    used = [k for k in range(3) if np.any(vectors[:, k])] or [0]
    if box is None:
        work = "+".join(f"f{AXES[k]}*{AXES[k]}" for k in used)
    else:
        work = "+".join(f"f{AXES[k]}*({AXES[k]}-{_rounded(AXES[k])})" for k in used)
    text = f"-{BODY_FORCE}*({work})"
    if term.pattern != "uniform":
        assert box is not None and term.axis is not None
        k = AXES.index(term.axis)
        where = f"({_rounded(term.axis)}-({term.origin!r}))/{float(box[k, k])!r}"
        sign = "select(step(part-0.5),-1,1)" if term.pattern == "halves" else f"sin({2 * np.pi!r}*part)"
        text = f"-{BODY_FORCE}*{sign}*({work}); part=turns-floor(turns); turns={where}"
    force = _force(text, "body force")
    for k in used:
        force.addPerParticleParameter(f"f{AXES[k]}")
    for bead in np.flatnonzero(np.any(vectors != 0, axis=1)).tolist():
        force.addParticle(bead, vectors[bead, used].tolist())
    return force


def position_force(term: PositionForce, members: np.ndarray, box: np.ndarray | None) -> openmm.CustomExternalForce:
    """CustomExternalForce of a :class:`PositionForce` for the beads of a mask (N,)."""
    formulas = [re.sub(r"(?<![\w.])([xyz])(?!\w)", r"folded_\1", text) for text in term.formulas]
    used = [k for k in range(3) if formulas[k].strip() not in ("0", "0.0")] or [0]
    text = f"-{BODY_FORCE}*(" + "+".join(f"force_{AXES[k]}*({AXES[k]}-{_rounded(AXES[k])})" for k in used) + ")"
    definitions = [f"force_{AXES[k]}={formulas[k]}" for k in used]
    if box is None:
        places = [f"folded_{name}={_rounded(name)}" for name in AXES]
    else:
        places = _folding(np.asarray(term.corner), box)[::-1]
    force = _force("; ".join([text, *definitions, *places]), "position force")
    for bead in np.flatnonzero(members).tolist():
        force.addParticle(bead)
    return force


def external_force(term, type_ids: np.ndarray, type_names: list[str], box: np.ndarray | None):
    """The CustomExternalForce of a term of ``Scene.body_forces``."""
    if isinstance(term, BodyForce):
        return body_force(term, term.vectors(type_ids, type_names, box), box)
    return position_force(term, term.mask(type_ids, type_names), box)
