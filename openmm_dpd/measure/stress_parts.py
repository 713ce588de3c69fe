"""Stress tensors of what stands beside the pair terms: its kernels give them, whoever computes its forces in the run.

OpenMM has no virials of single forces, and on most platforms single precision.
"""

from collections.abc import Callable
from dataclasses import fields, replace
from typing import Any

import numpy as np

from ..base.geometry import minimum_images, symmetric_products
from ..kernels.charges import ChargeEvaluator
from ..kernels.extras import warm_up_extras
from ..plan.charge_forces import charge_terms
from ..plan.extra_forces import extras
from ..plan.plan import Plan

#: (x, box) -> (6,) sums of r F (xx, yy, zz, xy, xz, yz; kJ/mol).
Part = Callable[[np.ndarray, np.ndarray | None], np.ndarray]


def stress_parts(plan: Plan) -> list[Part]:
    """Of bonds and angles, overlays and segments.  Forces on single beads have none."""
    found = [extra for extra in extras(plan.scene, plan.overlays, plan.exceptions) if extra.term != "external"]
    warm_up_extras(found)
    return [BondedStress(extra) if extra.term == "bond" else extra.evaluator().stress for extra in found]  # type: ignore[attr-defined]


def charge_evaluator(plan: Plan) -> ChargeEvaluator | None:
    """What gives energies and stress of the charges; None if there are none."""
    terms = charge_terms(plan.scene, plan.ewald, plan.charge_exceptions)
    warm_up_extras([] if terms is None else [terms])
    return None if terms is None else terms.evaluator()


class BondedStress:
    """Of bonded terms of any kind, from their forces alone: each term acts on copies of its beads that belong to no other.  Each bead of a
    term is next to the one before it by minimum image."""

    def __init__(self, terms: Any):
        name = fields(terms)[0].name
        self._beads = beads = getattr(terms, name)
        self._alone = replace(terms, **{name: np.arange(beads.size, dtype=beads.dtype).reshape(beads.shape)}).evaluator()

    def __call__(self, x: np.ndarray, box: np.ndarray | None) -> np.ndarray:
        """(6,) sums of r F at the positions x."""
        copies, force = x[self._beads], np.zeros((self._beads.size, 3))
        self._alone.add_to(copies.reshape(-1, 3), box, force, 1.0)
        steps = minimum_images(np.diff(copies, axis=1).reshape(-1, 3), box).reshape(len(copies), -1, 3)
        return symmetric_products(np.cumsum(steps, axis=1).reshape(-1, 3), force.reshape(copies.shape)[:, 1:].reshape(-1, 3))
