"""Check that a run has the set temperature, which a too long time step spoils first.

Runaway beads stop a run (``forces/pair_force.py``); at step sizes between these and the right ones, a fluid is steadily too hot.
"""

from collections.abc import Sequence

import numpy as np

from ..base.stats import block_average
from ..kernels.fields import ENERGY, TEMPERATURE
from ..plan.plan import Plan
from .sample import SystemSample

#: Tolerances of a mean temperature: a fraction of the set one, and a number of standard errors.
TOLERANCE, ERRORS = 0.05, 4.0
#: Rows before the first check of a running simulation; the number doubles for each next one.
FIRST_LOOK = 20
#: Fewest rows for a warning: the second half of fewer cannot show whether the temperature still changes.
LEAST_ROWS = 6


def sets_temperature(plan: Plan) -> bool:
    """Whether anything sets a temperature; nothing does without friction, or for beads with internal temperatures."""
    return plan.options.thermostat and (plan.spec.fields is None or plan.spec.fields.kind not in (ENERGY, TEMPERATURE))


def has_set_temperature(plan: Plan) -> bool:
    """Whether the kinetic temperature of a run should always be the set one.

    It should not with a ramp, where forces on beads are removed, or where a body force or moving wall drives a flow, whose energy counts as
    kinetic.  In a shear it is relative to the flow, and too high if friction does not remove the work of the shear.
    """
    scene = plan.scene
    moving_wall = scene.mobile is not None and scene.velocities is not None and bool(np.any(scene.velocities[~scene.mobile]))
    moving_wall = moving_wall or any(np.any(wall.velocity) for wall in scene.walls if wall.velocity is not None)
    return sets_temperature(plan) and plan.options.ramp is None and not (scene.body_forces or moving_wall or scene.interacting is not None)


def temperature_warning(kT: Sequence[float], target: float, dof: int, unit: str = "") -> str | None:
    """Warning if the mean kinetic temperature of the second half of the rows is not the set one, or None.

    The standard error comes from blocks, and from theory: at equilibrium the kinetic energy of ``dof`` degrees of freedom varies by
    sqrt(2/dof) of its mean, and the part of this variance that rows close in time do not show is in their mean.

    Parameters
    ----------
    kT : sequence of float
        Kinetic temperatures, row by row, at one set temperature.
    target : float
        Set temperature in the same unit; if it is 0, there is no warning.
    dof : int
        Degrees of freedom of a row.
    unit : str
        Unit of temperature in the warning.
    """
    rows = np.asarray(kT, dtype=float)[len(kT) // 2 :]
    if len(kT) < LEAST_ROWS or target <= 0 or dof <= 0:
        return None
    average = block_average(rows)
    assert average.mean is not None
    # variance of one row; the part that the rows do not show is in their mean
    variance = average.mean**2 * 2.0 / dof
    error = max(average.sem or 0.0, max(variance - rows.var(), variance / len(rows)) ** 0.5)
    off = average.mean - target
    if abs(off) <= max(TOLERANCE * target, ERRORS * error):
        return None
    earlier, later = (abs(half.mean() - target) for half in np.array_split(rows, 2))
    if earlier - later > max(variance**0.5, 0.1 * earlier):
        return None  # on its way to the set temperature, as after a quench
    return (
        f"the kinetic temperature of the last {len(rows)} rows is {average.mean:.4g}{unit}, {100 * abs(off) / target:.3g} % "
        f"{'above' if off > 0 else 'below'} the set {target:.4g}{unit}; "
        "the step size may be too large, a shear may heat the beads, or they flow or are not equilibrated"
    )


class TemperatureWatch:
    """Compares the temperature of a running simulation with the set one after 20, 40, 80, ... rows, until the first warning.

    Rows count from the last change of the set temperature.

    Parameters
    ----------
    plan : Plan
    """

    def __init__(self, plan: Plan):
        self._quiet = not has_set_temperature(plan)
        self._target, self._rows, self._look = 0.0, list[float](), FIRST_LOOK

    def add(self, sample: SystemSample) -> str | None:
        """Add a row; return a warning, once, or None."""
        if self._quiet:
            return None
        if sample.target_kT != self._target:
            self._target, self._rows, self._look = sample.target_kT, [], FIRST_LOOK
        self._rows.append(sample.kT)
        if len(self._rows) < self._look:
            return None
        self._look *= 2
        wrong = temperature_warning(self._rows, self._target, sample.dof, " kJ/mol")
        self._quiet = wrong is not None
        return wrong
