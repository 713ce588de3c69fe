"""Carrying out ``fix momentum`` while a run goes on."""

import numpy as np
import openmm

from ..state.momentum import MomentumRemoval
from ..state.records import Fix
from ..state.sample import DeckSample
from ..values.resolver import Resolver
from .request import RunRequest
from .sampling import arrays


class MomentumFixes:
    """The ``fix momentum`` of a run, which change velocities at the end of steps that are multiples of their intervals.

    Raises
    ------
    DeckError
        If a fix acts on beads that do not move, or comes after one that reads values at the end of a step: LAMMPS takes those before.
    """

    def __init__(self, request: RunRequest, context: openmm.Context):
        self._request, self._context = request, context
        self._found: list[tuple[MomentumRemoval, np.ndarray]] = []
        readers: list[Fix] = []
        for fix in request.state.fixes.values():
            if "reader" in fix.parameters:
                readers.append(fix)
            if fix.style == "momentum":
                self._found.append((fix.parameters["momentum"], self._members(fix, readers)))

    def _members(self, fix: Fix, readers: list[Fix]) -> np.ndarray:
        members = self._request.state.group(fix.group)
        if np.any(members & ~self._request.mobile):
            raise fix.error(f"group {fix.group} has beads that no fix moves; leave them out of the group")
        if readers:
            which = f"fix {readers[0].name} ({readers[0].style})"
            raise fix.error(f"it comes after {which}, which would see velocities of before; put it in front of that")
        return members

    def next_due(self, step: int) -> int:
        """The first step after ``step`` at which one acts; the last step of the run without any."""
        return min([(step // removal.every + 1) * removal.every for removal, _ in self._found], default=self._request.last_step)

    def act(self, step: int) -> np.ndarray | None:
        """Change the velocities, if it is time: what was added to them (nm/ps), or None."""
        due = [(removal, mask) for removal, mask in self._found if step % removal.every == 0 and mask.any()]
        if not due:
            return None
        x, v, box = arrays(self._context)
        state, before, v = self._request.state, v, np.array(v)
        unwrapped = Resolver(state, DeckSample(step, positions=x, velocities=v, box=box), self._request.window).unwrapped
        for removal, mask in due:
            v[mask] = removal.applied(unwrapped[mask] * state.units.length, v[mask], state.bead_masses()[mask])
        self._context.setVelocities(v)
        return v - before
