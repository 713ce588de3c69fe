"""Scene -> the kernels of all conservative forces but the pair terms themselves.

They are the same forces as those that :mod:`openmm_dpd.plan.forces` makes of OpenMM's own, for a loop over time steps that evaluates
everything itself.
"""

from collections.abc import Container, Sequence
from itertools import groupby

import numpy as np

from ..kernels import external
from ..kernels.external import BodyTerms
from ..kernels.extras import Extra
from ..kernels.pairs import compressed_exceptions
from ..kernels.radial import RadialTerms
from ..model.flow import AXES, BodyForce
from ..model.scene import Scene
from .forces.expressions import type_pairs
from .forces.segments import segment_spec
from .kinds import bonded_kind, resolved_kind

_PATTERNS = {"uniform": external.UNIFORM, "halves": external.HALVES, "sine": external.SINE}


def extras(
    scene: Scene, overlays: Sequence[dict], exceptions: dict[tuple[int, int], float], held: Container[str] | None = None
) -> tuple[Extra, ...]:
    """The conservative forces of a scene beside its pair terms, those that are ``held`` (see ``Execution``), by default all.  ``overlays``
    and factors of bonded neighbours (``exceptions``) are those of a ``Plan``."""
    # PositionForce (formulas given as text) has no kernel: OpenMM evaluates it.  Charges are in charge_forces.py.
    found: list[Extra] = []

    def wanted(name: str) -> bool:
        return held is None or name in held

    for terms, one_kind in groupby((group for group in scene.bonded if wanted(bonded_kind(type(group)).name)), type):
        groups = list(one_kind)
        beads, coefficients = (np.concatenate([getattr(group, name) for group in groups]) for name in ("beads", "coefficients"))
        if len(beads):
            found.append(bonded_kind(terms).kernel(beads.astype(np.uint32), np.ascontiguousarray(coefficients.T)))
    if wanted("overlays"):
        found += [radial_terms(table, scene.type_ids, scene.type_names, exceptions) for table in overlays]
    segments = segment_spec(scene) if wanted("segments") else None
    if segments is not None and len(segments.pairs):
        found.append(segments)
    if wanted("body forces"):
        found += [body_terms(term, scene) for term in scene.body_forces if isinstance(term, BodyForce)]
    return tuple(found)


def radial_terms(table: dict, type_ids: np.ndarray, names: list[str], exceptions: dict[tuple[int, int], float]) -> RadialTerms:
    """The kernel's form of one table of overlays."""
    overlay = resolved_kind(table).overlay
    assert overlay is not None
    cutoff = type_pairs(table, names, lambda c: c.cutoff, 0.0)
    # beads that interact with no other are not even sorted
    types = np.where(np.any(cutoff > 0, axis=1)[type_ids], type_ids, -1).astype(np.int32)
    return RadialTerms(types, cutoff, *overlay(table, names), compressed_exceptions(exceptions, len(type_ids)))


def body_terms(term: BodyForce, scene: Scene) -> BodyTerms:
    """The kernel's form of one force on single beads."""
    vectors = term.vectors(scene.type_ids, scene.type_names, scene.box)
    beads = np.flatnonzero(np.any(vectors != 0, axis=1))
    axis = 0 if term.axis is None else AXES.index(term.axis)
    period = 1.0 if scene.box is None else float(scene.box[axis, axis])
    return BodyTerms(beads.astype(np.uint32), vectors[beads], _PATTERNS[term.pattern], axis, term.origin, period)
