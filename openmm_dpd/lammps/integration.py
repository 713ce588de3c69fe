"""Which beads the deck's fixes move, and by which scheme."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..errors import DeckError
from .state import DeckState, Fix

#: Fixes that move beads.
INTEGRATORS = ("nve", "mvv/dpd")


@dataclass(frozen=True)
class Integration:
    """What the fixes add up to.

    Attributes
    ----------
    scheme : str
        ``mvv`` or ``shardlow``.
    lambda_ : float
        Weight of the predicted velocity in ``mvv``; 1/2 is velocity Verlet.
    mobile : (N,) array of bool
        Beads that some fix moves.
    """

    scheme: str
    lambda_: float
    mobile: np.ndarray


def _complain(fix: Fix, message: str) -> DeckError:
    return DeckError(f"fix {fix.name}: {message}", fix.where.file, fix.where.number)


def integration(state: DeckState) -> Integration:
    """Scheme and mobile beads of the deck's present fixes.

    Raises
    ------
    DeckError
        If two fixes move one bead, two schemes are mixed, or fix shardlow lacks what it needs.
    """
    mobile = np.zeros(len(state.atoms), dtype=bool)
    owners: list[Fix] = []
    for fix in state.fixes.values():
        if fix.style not in INTEGRATORS:
            continue
        group = state.group(fix.group)
        if np.any(mobile & group):
            bead = int(state.atoms.ids[np.argmax(mobile & group)])
            others = ", ".join(other.name for other in owners)
            raise _complain(fix, f"bead {bead} is moved by fix {others} already; a bead can be in one integrating fix only")
        mobile |= group
        owners.append(fix)
    weights = {fix.parameters["lambda"] for fix in owners}
    if len(weights) > 1:
        raise _complain(owners[-1], f"fixes with different lambda ({', '.join(f'{w:g}' for w in sorted(weights))}) cannot be combined")
    if not owners:
        state.note("no fix integrates any bead: nothing will move")
    shardlow = [fix for fix in state.fixes.values() if fix.style == "shardlow"]
    if shardlow:
        _check_shardlow(state, shardlow, owners)
    return Integration("shardlow" if shardlow else "mvv", weights.pop() if weights else 0.5, mobile)


def _check_shardlow(state: DeckState, shardlow: list[Fix], owners: list[Fix]) -> None:
    fix = shardlow[0]
    if len(shardlow) > 1:
        raise _complain(shardlow[1], f"there is a fix shardlow already ({fix.name})")
    names = [style.name for style in state.pair.styles]
    if "dpd/fdt" not in names:
        raise _complain(fix, f"fix shardlow needs pair style dpd/fdt; the deck has {', '.join(names) or 'none'}")
    others = [style.name for style in state.pair.styles if style.spec.thermostat and style.name != "dpd/fdt"]
    if others:
        raise _complain(fix, f"pair style {others[0]} beside fix shardlow is not supported: it would act as a force there")
    order = list(state.fixes)
    late = [owner for owner in owners if order.index(owner.name) < order.index(fix.name)]
    if late:
        raise _complain(fix, f"fix shardlow must come before the fix that moves the beads ({late[0].name}, style {late[0].style})")
    if not owners:
        raise _complain(fix, "fix shardlow needs a fix nve after it")
    for owner in owners:
        if owner.style != "nve":
            raise _complain(owner, "beside fix shardlow beads are moved by fix nve")
