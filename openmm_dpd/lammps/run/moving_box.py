"""Runs in a box that a ``fix deform`` changes from step to step."""

from typing import Any

import numpy as np
import openmm

from ...base.errors import ParameterError, RunError
from ...base.openmm_private import bare
from ...plan.choices import check_cutoffs
from ...simulation.built import BuiltSystem
from ..state.box import Box
from .request import RunRequest
from .sampling import LiveSample, Sampler


class MovingBox:
    """Changes the box, and moves its beads with it, at the end of steps."""

    def __init__(self, request: RunRequest, built: BuiltSystem, context: openmm.Context):
        self._request, self._built, self._context = request, built, context
        self._found = [fix for fix in request.state.fixes_of("deform") if "deforming" in fix.parameters]
        plan = built.plan
        if self._found and plan.spec.fields is not None and plan.options.scheme.predicts and not plan.execution.looped:
            # only the host's loop keeps the accelerations at the places before; others lose energy in each change
            raise self._found[0].error(
                "beads with internal energies, temperatures or species need the host's loop for this: use engine 'host'"
            )

    def next_due(self, step: int) -> int:
        """The first step after ``step`` at which the box changes; the last step of the run if it never does."""
        return min([(step // every + 1) * every for every in self._every], default=self._request.last_step)

    @property
    def _every(self) -> list[int]:
        return [fix.parameters["deforming"].every for fix in self._found]

    def due(self, step: int) -> bool:
        """Whether the box changes at the end of this step."""
        return any(step % every == 0 for every in self._every)

    def box(self, step: int) -> Box | None:
        """The box at a step; None if it stays as it is."""
        return self._request.state.box_at(step, self._request.window)

    def act(self, step: int, sample: LiveSample | None) -> None:
        """Change the box; ``sample``, taken before, gets the new positions."""
        (fix,) = self._found
        state, length = self._request.state, self._request.state.units.length
        before, after = self.box(step - 1), self.box(step)
        assert before is not None and after is not None
        vectors = after.reduced_vectors * length
        try:
            if after.overtilted:
                raise ParameterError("the box would be tilted by more than half an edge")
            check_cutoffs(vectors, [table.entries for table in self._built.plan.scene.tables])
        except ParameterError as error:
            raise RunError(f"fix {fix.name} (deform), step {step}: {error}") from None
        x = self._positions()
        fractions = before.fractions(x / length)
        # beads that do not follow keep their place in the box, whose images move
        kept = x + np.floor(fractions) @ (after.vectors - before.vectors) * length
        follow = state.group(fix.group) & fix.parameters["deforming"].remaps
        x = np.where(follow[:, None], after.places(fractions) * length, kept)
        self._context.setPeriodicBoxVectors(*vectors)
        self._context.setPositions(x)
        integrator: Any = self._context.getIntegrator()
        if integrator.whole is not None:
            integrator.whole.keep_forces(integrator, self._context)
        if sample is not None:
            vars(sample).update(positions=self._positions(), box=vectors)

    def _positions(self) -> np.ndarray:
        return bare(self._context.getState(positions=True).getPositions(asNumpy=True))


def measured(sampler: Sampler, sample: LiveSample) -> LiveSample:
    """The sample, once all that depends on forces is known."""
    sampler.measure(sample)
    for name in ("virial", "virial_tensor"):
        try:
            getattr(sample, name)
        except ParameterError:
            pass  # there is no stress here, and nobody asks for it
    return sample
