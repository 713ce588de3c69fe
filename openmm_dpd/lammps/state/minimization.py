"""When ``minimize`` stops."""

from dataclasses import dataclass

import numpy as np

#: What a force vector (N, 3) is measured by: its length, the longest force on a bead, the largest component.
NORMS = {
    "two": lambda force: float(np.linalg.norm(force)),
    "max": lambda force: float(np.linalg.norm(force, axis=1).max(initial=0.0)),
    "inf": lambda force: float(np.abs(force).max(initial=0.0)),
}

#: Values of min_style, and those whose motion begins at rest and ends there.
MIN_STYLES = ("cg", "hftn", "sd", "quickmin", "fire", "fire/old")
DAMPED = ("quickmin", "fire", "fire/old")

#: LAMMPS adds it to the energies that a change is compared with.
_LEAST_ENERGY = 1e-8


@dataclass(frozen=True)
class StoppingRule:
    """The four numbers of ``minimize``, in the deck's units, and the norm of ``min_modify``.

    Attributes
    ----------
    energy : float
        Largest change of the energy in an iteration, over its mean size.
    force : float
        Largest norm of the forces.
    iterations, evaluations : int
        At most so many iterations; an iteration counts as one evaluation at least.
    norm : str
        A key of :data:`NORMS`.
    """

    energy: float
    force: float
    iterations: int
    evaluations: int
    norm: str = "two"

    def reached(self, iterations: int, before: float, energy: float, force: np.ndarray) -> str | None:
        """Why it stops after an iteration that led from an energy to another one; None if it goes on."""
        if abs(energy - before) < self.energy * 0.5 * (abs(energy) + abs(before) + _LEAST_ENERGY):
            return "energy tolerance"
        if NORMS[self.norm](force) < self.force:
            return "force tolerance"
        if iterations >= self.iterations:
            return "max iterations"
        return "max force evaluations" if iterations >= self.evaluations else None
