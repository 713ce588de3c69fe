"""What a soft start did, as data."""

from dataclasses import dataclass

from openmm import unit

from ..base.errors import fact_table
from .piercings import Piercing


class PiercingWarning(UserWarning):
    """Bonds still pass through rings; the text names them."""


@dataclass(frozen=True)
class Stage:
    """One stage of a soft start.

    Attributes
    ----------
    strength : float
        Energy of two atoms at one place, kJ/mol.
    steps : int
        Steps of the dynamics.
    dt : float
        Their size, ps.
    temperature : float
        Kinetic temperature at the end, K.
    halvings : int
        How often the step was halved because the stage flew apart, or got too hot, with a longer one.
    """

    strength: float
    steps: int
    dt: float
    temperature: float
    halvings: int


@dataclass(frozen=True, eq=False)
class DenseStart:
    """Positions after a soft start, and what was done.

    Attributes
    ----------
    positions : (N, 3) Quantity
        Of all particles, virtual sites too; constraints hold, molecules are in one piece.
    stages : tuple of Stage
        Stages of the dynamics in their order; those after a ring was freed follow the ramp.
    overlap_before, overlap_after : float
        Largest overlap 1 - r/sigma_ij of two atoms that the force field lets repel each other, 0 if none are closer than the mean
        sigma_ij of their van der Waals diameters.
    energy_before, energy_after : Quantity
        Potential energy of the force field itself (infinite where it is not a number).
    resolved : tuple of Piercing
        Bonds that went through rings, at the start or on the way, and do no longer.
    unresolved : tuple of Piercing
        Those that still do.
    replaced : tuple of str
        Classes of the forces that soft repulsion replaced.
    seconds : float
        Wall time.
    """

    positions: unit.Quantity
    stages: tuple[Stage, ...]
    overlap_before: float
    overlap_after: float
    energy_before: unit.Quantity
    energy_after: unit.Quantity
    resolved: tuple[Piercing, ...]
    unresolved: tuple[Piercing, ...]
    replaced: tuple[str, ...]
    seconds: float

    def _facts(self) -> dict[str, str]:
        before, after = (energy.value_in_unit(unit.kilojoule_per_mole) for energy in (self.energy_before, self.energy_after))
        return {
            "atoms": str(len(self.positions)),
            "largest overlap": f"{self.overlap_before:.0%} -> {self.overlap_after:.0%}",
            "energy": f"{before:.3g} -> {after:.3g} kJ/mol",
            "pierced rings": f"{len(self.resolved)} freed, {len(self.unresolved)} left",
            "stages": f"{len(self.stages)}, {sum(stage.steps for stage in self.stages)} steps",
            "seconds": f"{self.seconds:.1f}",
        }

    def __repr__(self) -> str:
        return f"<DenseStart: {', '.join(f'{name} {value}' for name, value in self._facts().items())}>"

    def _repr_html_(self) -> str:
        return fact_table("DenseStart", self._facts())
