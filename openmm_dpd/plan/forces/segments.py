"""The PythonForce of segmental repulsion."""

import threading

import numpy as np
import openmm
from openmm import unit

from ...base.names import SEGMENT_GROUP
from ...kernels.extras import warm_up_extras
from ...kernels.segments import CLAMPED, MID, NEAREST, SegmentEngine, SegmentSpec
from ...model.scene import Scene


def segment_spec(scene: Scene) -> SegmentSpec | None:
    """The input of the kernel, None for a scene without segmental repulsion."""
    segments = scene.segments
    if segments is None:
        return None
    rule = MID if segments.distance == "mid" else CLAMPED if scene.compat == "lammps" else NEAREST
    pairs = np.ascontiguousarray(scene.segment_pairs)
    return SegmentSpec(scene.n_beads, pairs, segments.A, segments.cutoff, rule, segments.exclude_adjoining)


class SegmentFunction:
    """The callable inside the PythonForce: state -> (energy, forces).

    Complete and immutable once constructed, because OpenMM pickles it into the System; its engine belongs to the calling thread.
    GPU platforms fold beads back into the box one by one, so the kernel takes every distance by minimum image.
    """

    def __init__(self, spec: SegmentSpec, periodic: bool):
        self.spec, self.periodic = spec, periodic
        self._local = threading.local()

    def __reduce__(self):
        return type(self), (self.spec, self.periodic)

    def __call__(self, state):
        if not hasattr(self._local, "engine"):
            self._local.engine = SegmentEngine(self.spec)
        x = state.getPositions(asNumpy=True).value_in_unit(unit.nanometer)
        box = state.getPeriodicBoxVectors(asNumpy=True).value_in_unit(unit.nanometer) if self.periodic else None
        energy, force, _ = self._local.engine.forces(x, box)
        return energy, force


def warm_up_segments(scene: Scene) -> None:
    """Compile what a run of the scene needs for its segments (or load it from the cache)."""
    spec = segment_spec(scene)
    warm_up_extras([] if spec is None else [spec])


def segment_force(spec: SegmentSpec, periodic: bool) -> openmm.PythonForce:
    """PythonForce that evaluates the segmental repulsion: an ordinary conservative force in a group of its own."""
    force = openmm.PythonForce(SegmentFunction(spec, periodic), {})
    force.setName("segmental repulsion")
    force.setForceGroup(SEGMENT_GROUP)
    force.setUsesPeriodicBoundaryConditions(periodic)
    return force
