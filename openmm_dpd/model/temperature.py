"""Thermal energies that change during a run."""

from dataclasses import dataclass

from ..base.errors import ParameterError
from ..base.units import keep, thermal_energy, whole_number


@dataclass(frozen=True)
class TemperatureRamp:
    """Thermal energy that changes linearly with the step number k.

    kT(k) = kT_start + (kT_end - kT_start) (k - first_step)/(last_step - first_step) between the two steps, ``kT_start`` before and
    ``kT_end`` after.  LAMMPS: the two temperatures of ``dpd/tstat`` with ``run ... start ... stop``.

    Parameters
    ----------
    kT_start, kT_end : energy
        kT in kJ/mol (or a Quantity in kelvin), >= 0.
    first_step, last_step : int
        Step numbers, from the first step of the integrator; ``first_step`` may be negative.

    Raises
    ------
    ParameterError
        If a kT is not an energy or temperature >= 0, a step is not a whole number, or the last step is not after the first.
    """

    kT_start: float
    kT_end: float
    first_step: int
    last_step: int

    def __post_init__(self):
        keep(self, kT_start=thermal_energy(self.kT_start, "the ramp's kT_start"))
        keep(self, kT_end=thermal_energy(self.kT_end, "the ramp's kT_end"))
        for name in ("first_step", "last_step"):
            keep(self, **{name: whole_number(getattr(self, name), f"the ramp's {name} (a step)")})
        if self.last_step <= self.first_step:
            raise ParameterError(
                f"a temperature ramp must end after it begins; got first_step = {self.first_step}, last_step = {self.last_step}"
            )

    def at(self, step: int) -> float:
        """Thermal energy (kJ/mol) at a step."""
        return self.kT_start + (self.kT_end - self.kT_start) * min(
            1.0, max(0.0, (step - self.first_step) / (self.last_step - self.first_step))
        )
