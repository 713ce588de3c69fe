"""Surface tension of flat interfaces."""

import numpy as np

from ..base.errors import ParameterError, what_is
from ..base.stats import Average, block_average
from .frames import axis_number


def surface_tension(pressure, length, *, axis: str | int = "z", interfaces: int = 2) -> Average:
    r"""Surface tension of flat interfaces normal to an axis, from the anisotropy of the pressure.

    .. math:: \gamma = \frac{L_z}{n} \left\langle P_{zz} - \tfrac12 (P_{xx} + P_{yy}) \right\rangle

    Parameters
    ----------
    pressure : (F, 3), (F, 6) or (F, 3, 3) array
        Pressure tensor of each frame: xx, yy, zz; or these and the off-diagonal components, which are not used; or the full tensor.
        ``pressures`` of a :class:`.StressReporter` is such an array.
    length : float or (F,) array
        Length of the box along the axis (``edges[:, 2]`` of a StressReporter for z).
    axis : {"z", "y", "x"} or int
        Normal of the interfaces.
    interfaces : int, default 2
        Number n of interfaces: 2 for a film or slab in a periodic box; 1 for a bilayer, whose tension includes both of its sides.

    Returns
    -------
    openmm_dpd.base.stats.Average
        Tension, kJ/mol/nm^2 for pressures in kJ/mol/nm^3 and lengths in nm.

    Raises
    ------
    ParameterError
        If a shape or number is wrong, or the lengths of the arrays differ.

    References
    ----------
    J. G. Kirkwood and F. P. Buff, J. Chem. Phys. 17, 338 (1949).
    """
    try:
        tensor, edge = np.asarray(pressure, dtype=np.float64), np.asarray(length, dtype=np.float64)
    except (TypeError, ValueError):
        raise ParameterError("pressure and length must be arrays of numbers") from None
    if tensor.ndim == 3 and tensor.shape[1:] == (3, 3):
        tensor = np.diagonal(tensor, axis1=1, axis2=2)
    if not tensor.size:
        raise ParameterError("pressure has no rows; give one for each frame")
    if tensor.ndim != 2 or tensor.shape[1] not in (3, 6):
        raise ParameterError(f"pressure must have shape (frames, 3), (frames, 6) or (frames, 3, 3), not {tensor.shape}")
    if edge.shape not in ((), (len(tensor),)) or not np.all(edge > 0):
        raise ParameterError(f"length must be one length or one for each of the {len(tensor)} rows, all above 0")
    if isinstance(interfaces, bool) or interfaces not in (1, 2):
        raise ParameterError(f"interfaces must be 1 or 2, not {what_is(interfaces)}")
    k = axis_number(axis)
    across = [other for other in range(3) if other != k]
    return block_average(edge * (tensor[:, k] - tensor[:, across].mean(axis=1)) / interfaces, name="the surface tension")
