"""Segmental repulsion as one of the kinds of force that a loop over time steps adds to the pair terms."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from .segments import SegmentEngine, SegmentSpec


@dataclass(frozen=True, eq=False)
class SegmentTerms:
    """Repulsion between bonds.

    Attributes
    ----------
    spec : SegmentSpec
    """

    term: ClassVar[str] = "conservative"

    spec: SegmentSpec

    def evaluator(self) -> SegmentEvaluator:
        """What computes it."""
        return SegmentEvaluator(self)

    def few(self) -> tuple[SegmentTerms, np.ndarray, np.ndarray]:
        """Two bonds."""
        spec = self.spec
        half = 0.25 * spec.cutoff
        x = np.array([[0.0, 0, 0], [half, 0, 0], [0, half, 0], [half, half, half]]) + spec.cutoff
        small = SegmentSpec(4, np.array([[0, 1], [2, 3]]), spec.A, spec.cutoff, spec.rule, spec.exclude_adjoining)
        return SegmentTerms(small), x, np.diag([8.0 * spec.cutoff] * 3)


class SegmentEvaluator:
    """Computes :class:`SegmentTerms`."""

    def __init__(self, terms: SegmentTerms):
        self._engine = SegmentEngine(terms.spec)

    def add_to(self, x: np.ndarray, box: np.ndarray | None, force: np.ndarray, scale: float) -> float:
        """See :class:`.extras.Evaluator`.

        Raises
        ------
        RunError
            If a position is not finite, or the box too small for the range and the length of the bonds.
        """
        energy, on_beads, _ = self._engine.forces(x, box)
        force += on_beads
        return energy
