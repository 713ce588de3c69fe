"""Forces on single beads with a pattern: F_i = s(r_i) f_i.

s = 1 (``UNIFORM``), or with the place u = (r - origin)/L along an axis, less its whole turns: s = 1 for u < 1/2 and else -1 (``HALVES``),
s = sin(2 pi u) (``SINE``).
"""

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from ..runtime import Kernel, inlined, meet
from .elementary import sine
from .extras import CHUNK, FEW, Evaluator, Extra, energy_chunks, run_terms

UNIFORM, HALVES, SINE = range(3)


@dataclass(frozen=True, eq=False)
class BodyTerms:
    """A force on single beads.  The period is that of the scene's box, not of the present one: a pattern does not follow a barostat."""

    term: ClassVar[str] = "external"
    beads: np.ndarray  #: (M,) uint32 beads it acts on, each once
    vectors: np.ndarray  #: (M, 3) forces f on them, kJ/mol/nm
    pattern: int = UNIFORM  #: ``UNIFORM``, ``HALVES`` or ``SINE``
    axis: int = 0  #: Axis along which the pattern varies
    origin: float = 0.0  # origin, period: where it begins and how long it is, nm
    period: float = 1.0

    def evaluator(self) -> Evaluator:
        """What computes it."""
        return BodyEvaluator(self)

    def few(self) -> tuple[Extra, np.ndarray, np.ndarray]:
        """One bead."""
        return BodyTerms(np.zeros(1, np.uint32), np.ones((1, 3))), np.zeros((1, 3)), np.diag([1.0] * 3)


@inlined
def _sign(place, pattern, origin, period):
    if pattern == UNIFORM:
        return 1.0
    part = (place - origin) / period
    part -= np.floor(part)
    if pattern == HALVES:
        return -1.0 if part >= 0.5 else 1.0
    return sine(part)


def _body_forces(x, beads, vectors, pattern, axis, origin, period, scale, energies, force, found, part, parts, team):
    """Add the forces; writes down the energy -f.x, which means something only where nothing is periodic."""
    for chunk in range(len(energies) * part // parts, len(energies) * (part + 1) // parts):
        energy = 0.0
        for n in range(chunk * CHUNK, min((chunk + 1) * CHUNK, len(beads))):
            i = beads[n]
            size = scale * _sign(x[i, axis], pattern, origin, period)
            fx, fy, fz = size * vectors[n, 0], size * vectors[n, 1], size * vectors[n, 2]
            energy -= fx * x[i, 0] + fy * x[i, 1] + fz * x[i, 2]
            force[i, 0] += fx
            force[i, 1] += fy
            force[i, 2] += fz
        energies[chunk] = energy
    meet(team, parts)
    if part == 0:
        for chunk in range(len(energies)):
            found[0] += energies[chunk]
    return 0


body_forces = Kernel(_body_forces)


class BodyEvaluator:
    """Computes :class:`BodyTerms`; from so many beads as ``fewest`` on several threads share the work."""

    repeats = True

    def __init__(self, terms: BodyTerms):
        self.terms, self.fewest = terms, FEW
        self._arguments = terms.beads.copy(), terms.vectors, terms.pattern, terms.axis, terms.origin, terms.period
        self._energies = energy_chunks(len(terms.beads))

    def seat(self, names: np.ndarray, places: np.ndarray) -> None:
        """See :meth:`.pairs.PairList.seat`."""
        self._arguments[0][...] = places[self.terms.beads]

    def add_to(self, x: np.ndarray, box: np.ndarray | None, force: np.ndarray, scale: float) -> float:
        """See :class:`.extras.Evaluator`; the energy is 0 in a box, where -f.x would jump with a bead that is folded back."""
        many = len(self.terms.beads) >= self.fewest
        energy = run_terms(body_forces, many, x, *self._arguments, float(scale), self._energies, force)[0]
        return energy if box is None else 0.0
