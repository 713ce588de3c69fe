"""One configuration of a scene, to be written to a file."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import openmm
from openmm import unit

from ..base.cadence import Cadence
from ..base.errors import ParameterError, what_is
from ..model.scene import Scene


@dataclass(frozen=True, eq=False)
class Snapshot:
    """One configuration of N beads; nm, ps."""

    scene: Scene  #: Constant properties of the beads
    positions: np.ndarray  #: (N, 3)
    velocities: np.ndarray | None  #: (N, 3) or None
    box: np.ndarray | None  #: (3, 3) or None
    step: int = 0
    time: float = 0.0

    @classmethod
    def of(cls, source, state: openmm.State | None = None) -> Snapshot:
        """Snapshot of a Scene or of a result of :func:`openmm_dpd.build`, at its start or in the state of a run.  ParameterError if the
        state has no positions or another number of particles, or the source is anything else."""
        scene = scene_of(source)
        if state is None:
            if source is scene:
                return cls(scene, scene.positions, scene.velocities, scene.box)
            velocities = source.velocities.value_in_unit(unit.nanometer / unit.picosecond)
            return cls(scene, source.positions.value_in_unit(unit.nanometer), velocities, scene.box)
        if not isinstance(state, openmm.State):
            raise ParameterError(f"state must be an openmm.State, from context.getState(positions=True), not {what_is(state)}")
        try:
            positions = state.getPositions(asNumpy=True).value_in_unit(unit.nanometer)
        except openmm.OpenMMException:
            raise ParameterError("the state has no positions; ask for them: context.getState(positions=True, velocities=True)") from None
        if len(positions) != scene.n_beads:
            raise ParameterError(f"the state has {len(positions)} particles, but the scene has {scene.n_beads} beads")
        try:
            velocities = state.getVelocities(asNumpy=True).value_in_unit(unit.nanometer / unit.picosecond)
        except openmm.OpenMMException:
            velocities = None
        box = None if scene.box is None else np.array(state.getPeriodicBoxVectors(asNumpy=True).value_in_unit(unit.nanometer))
        bad = np.argwhere(~np.isfinite(positions))
        if len(bad):
            raise ParameterError(f"bead {bad[0, 0]} is at {positions[bad[0, 0]].tolist()}; every coordinate must be finite")
        return cls(scene, positions, velocities, box, state.getStepCount(), state.getTime().value_in_unit(unit.picosecond))


def scene_of(source) -> Scene:
    """The scene itself, or that of a result of :func:`openmm_dpd.build`; ParameterError for anything else."""
    scene = source if isinstance(source, Scene) else getattr(getattr(source, "plan", None), "scene", None)
    if not isinstance(scene, Scene):
        raise ParameterError(f"expected a Scene or what openmm_dpd.build() returned, not {what_is(source)}")
    if scene is not source and source.plan.host is not None:
        raise ParameterError("a System made elsewhere has particles that are not beads; use OpenMM's reporters to write it")
    return scene


class FrameReporter(Cadence):
    """Base of reporters that write unwrapped positions and velocities."""

    _INCLUDE, _FOLDED = ("positions", "velocities"), False
