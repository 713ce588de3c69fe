"""Beads that run away: the sign of a step that is too long.

The soft repulsion of DPD is bounded, so a scheme that has become unstable never makes a NaN: the beads heat up without limit and the
run goes on as an ideal gas.  What gives it away are beads that cross more than a cutoff in one step.
"""

import numpy as np

from ...base.wording import bead_number, in_length, in_units
from ...kernels import motion
from ...kernels.moment import FASTEST

#: Nobody runs away whose velocity has no component with which it crosses more of a cutoff in a step.
NEAR = 0.5


def runaway(v: np.ndarray, inv_mass: np.ndarray, kT: float, dt: float, cutoff: float) -> str | None:
    """What is wrong with the velocities (N, 3) of a step, in a sentence, or None; beads of ``inv_mass`` 0 are not looked at.  Wrong is a
    velocity that is not finite, and a bead that is faster than ten thermal velocities *and* crosses more than the longest cutoff in one
    step.  Either alone may be meant: a quench from a hot start, or an ideal gas with a long step."""
    if motion.largest(v) * dt <= NEAR * cutoff:  # the usual case, in one pass; NaN falls through
        return None
    moving = inv_mass > 0
    square = np.where(moving, np.einsum("ij,ij->i", v, v), 0.0)
    if not np.all(np.isfinite(square)):
        return "a velocity is not finite"
    limit = np.maximum(cutoff / dt, FASTEST * np.sqrt(kT * inv_mass))
    ratio = np.where(moving, square / limit**2, 0.0)
    bead = int(np.argmax(ratio))
    if ratio[bead] <= 1.0:
        return None
    kinetic = float(np.mean(square[moving] / inv_mass[moving]) / 3.0)
    hot = "" if kT <= 0 else f"; the kinetic temperature is {kinetic / kT:.3g} times what it should be"
    moves = f"bead {bead_number(bead)} moves {in_length(square[bead] ** 0.5 * dt, 3)} in one step of {in_units(dt, 'time')}"
    return f"{moves}, more than the cutoff of {in_length(cutoff)}{hot}"
