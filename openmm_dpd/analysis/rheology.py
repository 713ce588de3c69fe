r"""Surface tension, and viscosity, normal stresses and moduli in a Lees-Edwards shear, from the stress.

The flow is :math:`v_x = \dot\gamma y`.  The pressure P has a kinetic part (velocities relative to the flow), a conservative and a
dissipative part."""

from dataclasses import dataclass

import numpy as np

from ..base.errors import ParameterError, what_is
from ..base.slices import axis_number
from ..base.stats import Average, block_average

#: Fewest periods for a standard error.
LEAST_PERIODS = 5


@dataclass(frozen=True)
class ShearViscosity:
    """Viscosity (kJ/mol ps/nm^3) and normal stress differences (kJ/mol/nm^3) in a steady shear, with standard errors.

    Attributes
    ----------
    rate : float
        Shear rate, 1/ps.
    viscosity, error : float
        -P_xy/rate.
    first_normal, first_normal_error : float
        First normal stress difference, P_yy - P_xx.
    second_normal, second_normal_error : float
        Second normal stress difference, P_zz - P_yy.
    converged : bool
        Whether the run was long compared with the correlation time of the stress.
    parts : dict
        Viscosity, first and second normal stress difference of the "kinetic", "conservative" and "friction" parts of the pressure, whose
        sums are the values above.
    """

    rate: float
    viscosity: float
    error: float
    first_normal: float
    first_normal_error: float
    second_normal: float
    second_normal_error: float
    converged: bool
    parts: dict[str, tuple[float, float, float]]


@dataclass(frozen=True)
class ShearModuli:
    r"""Moduli of a fluid in an oscillating shear, kJ/mol/nm^3, with standard errors: the stress is
    :math:`\gamma_0 (G' \sin\omega t + G'' \cos\omega t)`.

    Attributes
    ----------
    frequency, amplitude : float
        Angular frequency (1/ps) and amplitude of the strain.
    storage, storage_error : float
        Storage modulus G', of the stress in phase with the strain.
    loss, loss_error : float
        Loss modulus G'', of the stress in phase with the strain rate; G''/frequency is a viscosity.
    periods : int
        Number of whole periods used.
    """

    frequency: float
    amplitude: float
    storage: float
    storage_error: float
    loss: float
    loss_error: float
    periods: int


def shear_viscosity(stress) -> ShearViscosity:
    r"""Viscosity and normal stress differences in a Lees-Edwards shear of constant rate.

    .. math:: \eta = -\langle P_{xy}\rangle/\dot\gamma,\; N_1 = \langle P_{yy} - P_{xx}\rangle,\; N_2 = \langle P_{zz} - P_{yy}\rangle

    Parameters
    ----------
    stress : :class:`openmm_dpd.measure.StressReporter`
        Samples of the steady state, which is reached after a strain of a few units.

    Raises
    ------
    ParameterError
        If the rate is 0 or not constant, there is no Lees-Edwards shear, or there are too few samples for an error.
    """
    shear, rows = _of(stress)
    rate = shear.end_rate if shear.amplitude is None and not shear.constant else shear.rate
    if shear.amplitude is not None or not rate or np.any(stress.rates != rate):
        raise ParameterError(f"a viscosity needs a constant rate other than 0 in all samples; the shear is: {shear}")

    def measures(xx, yy, zz, xy, *_):
        return -xy / rate, yy - xx, zz - yy

    found = [block_average(series) for series in measures(*rows.T)]
    if any(average.mean is None or average.sem is None for average in found):
        raise ParameterError(f"{len(rows)} samples are too few for a standard error; run longer or sample more often")
    eta, first, second = ((average.mean, average.sem) for average in found)
    volumes = np.prod(stress.edges, axis=1)[:, None]
    tensors = {"kinetic": stress.kinetic, "conservative": stress.regular - stress.kinetic, "friction": stress.friction}
    parts = {name: tuple(float(series.mean()) for series in measures(*(tensor / volumes).T)) for name, tensor in tensors.items()}
    return ShearViscosity(rate, *eta, *first, *second, found[0].converged, parts)  # type: ignore[arg-type]


def shear_moduli(stress) -> ShearModuli:
    r"""Storage and loss modulus from an oscillating Lees-Edwards shear.

    In each whole period, a constant and :math:`\gamma_0(G'\sin\omega t + G''\cos\omega t)` are fitted to -P_xy by least squares; means and
    standard errors are taken over the periods.  Beyond linear response, the moduli are those of the first harmonic.

    Parameters
    ----------
    stress : :class:`openmm_dpd.measure.StressReporter`
        Samples of the periodic steady state, at least eight per period.

    Raises
    ------
    ParameterError
        If the shear does not oscillate, there are fewer than five whole periods, or fewer than eight samples in one.
    """
    shear, rows = _of(stress)
    if shear.amplitude is None or shear.frequency is None:
        raise ParameterError(f"moduli need an oscillating shear; the shear is: {shear}")
    phase = shear.frequency * stress.sheared
    turn = ((phase - phase[0]) / (2 * np.pi) + 1e-9).astype(np.int64)
    periods = int((phase[-1] + phase[1] - 2 * phase[0]) / (2 * np.pi) + 1e-9) if len(phase) > 1 else 0
    if periods < LEAST_PERIODS or np.bincount(turn)[:periods].min() < 8:
        raise ParameterError(
            f"moduli need {LEAST_PERIODS} whole periods and eight samples in each; there are {len(rows)} in {periods} periods"
        )
    fits = []
    for period in range(periods):
        mine = turn == period
        design = shear.amplitude * np.stack([np.sin(phase[mine]), np.cos(phase[mine]), np.ones(mine.sum())], axis=1)
        fits.append(np.linalg.lstsq(design, -rows[mine, 3], rcond=None)[0])
    storage, loss = (block_average(series) for series in np.array(fits).T[:2])
    numbers = storage.mean, storage.sem, loss.mean, loss.sem
    return ShearModuli(shear.frequency, shear.amplitude, *numbers, periods)  # type: ignore[arg-type]


def _of(stress):
    """The shear and the pressure tensors (n, 6) with all parts; ParameterError if there is no shear or no sample."""
    shear = getattr(stress, "shear", None)
    if shear is None:
        raise ParameterError(f"stress must be a StressReporter of a scene with a LeesEdwards shear, not {what_is(stress)}")
    if len(stress.regular) == 0:
        raise ParameterError("the StressReporter has no samples yet; run steps with it first")
    return shear, stress.pressures + stress.friction / np.prod(stress.edges, axis=1)[:, None]


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
