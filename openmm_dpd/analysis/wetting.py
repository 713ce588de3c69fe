"""Contact angles of drops on flat walls."""

from dataclasses import dataclass

import numpy as np
import scipy

from ..base.errors import ParameterError, what_is
from ..base.stats import Average, block_average
from ..base.units import to_md
from .frames import Beads, Curve, Trajectories, curve_of
from .profiles import density_rows


@dataclass(frozen=True, eq=False)
class ContactAngle:
    """Contact angle of a drop, and the circle that its surface is in a plane through its axis.

    Attributes
    ----------
    angle : Average
        In degrees, measured through the liquid: below 90 where it wets the wall.
    radius, height : Average
        Of the circle, nm; height of its centre above the surface of the wall, negative below it.
    density, width : Average
        Number density of the liquid, 1/nm^3; width of its surface, nm.
    profile : Curve
        Density in rings around the axis of the drop, all of the box: x (K, L, 2) has radii and heights.
    surface : float
        Height of the surface of the wall, nm.
    """

    angle: Average
    radius: Average
    height: Average
    density: Average
    width: Average
    profile: Curve
    surface: float


def contact_angle(
    trajectory: Trajectories, beads: Beads = None, *, surface, axis: str = "z", n_bins: int | tuple[int, int] = 40, skip=0.0
) -> ContactAngle:
    r"""Contact angle of a drop that lies on a flat wall, from its density in rings around its own axis.

    The axis is normal to the wall and goes through the centre of mass of the beads in each frame.  The circle of half the density of the
    liquid is found together with this density :math:`\rho` and the width w of the surface, by least squares over all rings above the wall,

    .. math:: \rho(r, z) = \frac{\rho}{2} \left[1 - \tanh\frac{2(d - R)}{w}\right], \qquad d^2 = r^2 + (z - z_0)^2,

    weighted with their volumes.  It meets the surface of the wall, at height s, at the angle :math:`\theta`, with
    :math:`\cos\theta = (s - z_0)/R`.  Where the liquid is next to a wall whose potential is soft, or which is rough, s is a matter of
    definition; an error of ds changes the angle by :math:`ds/(R \sin\theta)`.

    Parameters
    ----------
    trajectory : mdtraj.Trajectory or iterable of them
        Box with right angles, whose edges across the axis the drop does not fill.
    beads : str, sequence of str, array of int, or None
        Beads of the drop; all by default.
    surface : length
        Height s of the surface of the wall along the axis, nm, in the box, which begins at 0.  The drop lies above it.
    axis : {"z", "y", "x"}
        Normal of the wall.
    n_bins : int or two of them, default 40
        Number of rings, out to half the shorter edge, and of slices along the axis, in the whole box.
    skip : length
        Slices whose middle is less than this above the surface are left out, where the wall orders the liquid.

    Returns
    -------
    ContactAngle
        Each number with a standard error from blocks of frames, of what each frame adds to it in first order.

    Raises
    ------
    ParameterError
        If there is no box with right angles, the surface is not in it, or no circle is found that meets the surface.

    References
    ----------
    M. J. de Ruijter, T. D. Blake and J. De Coninck, Langmuir 15, 7836 (1999); T. Werder et al., J. Phys. Chem. B 107, 1345 (2003).
    """
    low, above = to_md(surface, "length", "surface"), to_md(skip, "length", "skip")
    if not isinstance(low, float) or not isinstance(above, float) or above < 0:
        raise ParameterError(f"surface and skip must be one number each, skip at least 0, not {what_is(surface)} and {what_is(skip)}")
    x, found_rows, volumes = density_rows(trajectory, beads, f"r{axis}", n_bins, drop=True)
    rows, place, edge = found_rows["drop"], x.reshape(-1, 2), x[0, 0, 1] + x[-1, -1, 1]
    if not 0 <= low < edge:
        raise ParameterError(f"surface must be a height in the box, from 0 to {edge:g} nm, into which beads are wrapped, not {low:g}")
    profile = curve_of(x, rows, "the density of the drop")
    used = place[:, 1] >= low + above
    if np.count_nonzero(used) < 16 or len(np.unique(place[used, 1])) < 4:
        raise ParameterError("a circle needs four slices above the surface and 16 rings in all; take larger n_bins or a smaller skip")
    r, z, weight, rows = place[used, 0], place[used, 1], np.sqrt(volumes[used]), rows[:, used]
    mean = rows.mean(axis=0)
    dense = float(np.sum(weight**2 * mean**2) / max(np.sum(weight**2 * mean), 1e-300))
    start = [low, (1.5 * np.sum(weight**2 * mean) / max(np.pi * dense, 1e-300)) ** (1 / 3), dense, 1.0]

    def off(p: np.ndarray) -> np.ndarray:
        return weight * (0.5 * p[2] * (1 - np.tanh(2 * (np.hypot(r, z - p[0]) - p[1]) / p[3])) - mean)

    found = scipy.optimize.least_squares(off, start, x_scale=np.maximum(np.abs(start), 1.0)) if dense > 0 else None
    if found is None or not found.success or not abs(low - found.x[0]) < found.x[1]:
        raise ParameterError(f"no drop with a round surface meets the wall at {low:g} nm; look at the density in rings (axis='r{axis}')")
    centre, radius, density, width = found.x
    cosine = (low - centre) / radius
    # what each frame adds to the parameters, to first order
    each = found.x + (rows - mean) * weight @ np.linalg.pinv(found.jac).T
    turned = np.arccos(cosine) - (centre - each[:, 0] + cosine * (radius - each[:, 1])) / (radius * np.sqrt(1 - cosine**2))
    series = np.degrees(turned), each[:, 1], each[:, 0] - low, each[:, 2], np.abs(each[:, 3])
    angle, radius, height, density, width = (block_average(one) for one in series)
    return ContactAngle(angle, radius, height, density, width, profile, low)
