"""Viscosity of a fluid from its flow, and from the stress fluctuations at rest (derivations in docs/theory_flow.md)."""

from dataclasses import dataclass

import numpy as np

from ..base.errors import ParameterError, require, what_is
from ..base.stats import block_average
from ..base.units import checked, thermal_energy, to_md, whole_number
from ..measure.flow import VelocityProfile


@dataclass(frozen=True)
class PoiseuilleFit:
    """Viscosity and slip from a parabola fitted to a velocity profile.

    Attributes
    ----------
    viscosity, error : float
        Viscosity, kJ/mol ps/nm^3 (reduced units for a reduced scene), and its standard error.
    curvature : float
        Force density over viscosity, 1/nm/ps.
    slip : two floats, or None
        Velocity at the lower and upper wall of a channel, with ``slip_error``; None for reverse Poiseuille flow.
    slip_error : two floats, or None
    fitted : (B,) array
        The parabola in each slab of the profile; NaN in slabs left out.
    converged : bool
        Whether the run was long compared with the correlation time of the flow.
    """

    viscosity: float
    error: float
    curvature: float
    slip: tuple[float, float] | None
    slip_error: tuple[float, float] | None
    fitted: np.ndarray
    converged: bool


def poiseuille_viscosity(profile: VelocityProfile, force, *, channel: tuple[float, float] | None = None, origin=0.0, skip=0.0):
    r"""Viscosity from the parabolic profile of a driven flow, by linear least squares.

    Reverse Poiseuille flow, with the force density n f below d = L/2 and -n f above, is

    .. math:: v(z) = \frac{n f}{2\eta}\, z (d - z) + v_0, \quad 0 < z < d,

    and the negative (but for the drift v_0 of the box) in the other half.  In a channel, the curvature and the velocities at both walls
    are fitted.  Parabolas are averaged over the slabs.  Each sample is fitted separately, so the error includes correlations between slabs
    and in time.  It is reliable if the result has ``converged``, and too small, as a rule, if the run is shorter.

    Parameters
    ----------
    profile : VelocityProfile
        Profile of the steady state.
    force : force
        Force f per bead, kJ/mol/nm; in reverse Poiseuille flow that in the lower half.
    channel : two lengths, optional
        Positions of the walls; without them the flow is reverse Poiseuille flow.
    origin : length
        Start of the first half (``origin`` of the BodyForce).
    skip : length
        Slabs closer than this to the ends of the channel or of a half are left out.

    Returns
    -------
    PoiseuilleFit

    Raises
    ------
    ParameterError
        If too few slabs or samples are left, or the fluid does not flow along the force.

    References
    ----------
    J. A. Backer et al., J. Chem. Phys. 122, 154503 (2005).
    """
    f, skip = to_md(force, "force", "force"), checked(skip, "length", "skip")
    if not isinstance(f, float) or f == 0:
        raise ParameterError(f"force must be one number other than 0, not {what_is(force)}")
    centres, width, length = _slabs(profile)
    if channel is None:
        low, gap = checked(origin, "length", "origin", signed=True), length / 2
        z = (centres - low) % length
        sign, z = np.where(z < gap, 1.0, -1.0), z % gap
    else:
        low, high = _ends(channel)
        gap, z, sign = high - low, centres - low, np.ones(len(centres))
    half = 0.5 * width
    margin = max(skip, half * (1 - 1e-9))
    # a slab across an end mixes both sides
    used = (z >= margin) & (z <= gap - margin) & np.all(np.isfinite(profile.rows), axis=0)
    if used.sum() < 4:
        raise ParameterError(f"{int(used.sum())} slabs are too few to fit a parabola; take more and thinner ones, or a smaller skip")
    shape = sign * 0.5 * (z * (gap - z) - width**2 / 12)
    columns = [shape, np.ones_like(z)] if channel is None else [shape, 1 - z / gap, z / gap]
    design = np.stack(columns, axis=1)
    amplitudes = profile.rows[:, used] @ np.linalg.pinv(design[used]).T
    found = [block_average(column) for column in amplitudes.T]
    curvature, error = found[0].mean, found[0].sem
    assert curvature is not None
    density = float(profile.density[used].mean()) if channel is not None else float(profile.density.mean())
    if error is None or curvature * f <= 0:
        raise ParameterError("there are too few samples, or the fluid does not flow along the force; run longer or push harder")
    eta = density * f / curvature
    fitted = np.where(used, design @ np.array([a.mean for a in found]), np.nan)
    slip = None if channel is None else (float(found[1].mean or 0.0), float(found[2].mean or 0.0))
    slip_error = None if channel is None else (float(found[1].sem or 0.0), float(found[2].sem or 0.0))
    return PoiseuilleFit(eta, abs(eta * error / curvature), curvature, slip, slip_error, fitted, found[0].converged)


@dataclass(frozen=True)
class CouetteFit:
    """Viscosity from the shear stress and a straight line fitted to a velocity profile.

    Attributes
    ----------
    viscosity, error : float
        Viscosity, kJ/mol ps/nm^3, and its standard error.
    rate, rate_error : float
        Shear rate, 1/ps: the slope of the line.
    stress, stress_error : float
        Mean shear stress, kJ/mol/nm^3, and its standard error.
    ends : two floats
        Velocity of the line at the lower and upper wall, with ``ends_error``; without slip, the velocities of the walls.
    ends_error : two floats
    converged : bool
        Whether the run was long compared with the correlation times of flow and stress.
    """

    viscosity: float
    error: float
    rate: float
    rate_error: float
    stress: float
    stress_error: float
    ends: tuple[float, float]
    ends_error: tuple[float, float]
    converged: bool


def couette_viscosity(profile: VelocityProfile, stress, *, channel: tuple[float, float], skip=0.0) -> CouetteFit:
    r"""Viscosity from steady Couette flow between walls, :math:`\eta = \langle\sigma\rangle/\dot\gamma`.

    The shear rate is the slope of the velocity in the fluid, so slip at the walls does not matter.
    Each sample is fitted separately, so the errors include correlations between slabs and in time.

    Parameters
    ----------
    profile : VelocityProfile
        Profile of the steady state.
    stress : (n,) array
        Shear stress on the walls: :meth:`openmm_dpd.measure.WallReporter.shear`.
    channel : two lengths
        Positions of the walls.
    skip : length
        Slabs closer than this to the walls are left out.

    Returns
    -------
    CouetteFit

    Raises
    ------
    ParameterError
        If too few slabs or samples are left, or the fluid is not sheared.
    """
    low, high = _ends(channel)
    z, width, _ = _slabs(profile)
    margin = max(checked(skip, "length", "skip"), 0.5 * width * (1 - 1e-9))
    used = (z >= low + margin) & (z <= high - margin) & np.all(np.isfinite(profile.rows), axis=0)
    if used.sum() < 3:
        raise ParameterError(f"{int(used.sum())} slabs are too few to fit a line; take more and thinner ones, or a smaller skip")
    design = np.stack([(high - z) / (high - low), (z - low) / (high - low)], axis=1)
    ends = profile.rows[:, used] @ np.linalg.pinv(design[used]).T
    lower, upper, slope = (block_average(row) for row in (*ends.T, (ends[:, 1] - ends[:, 0]) / (high - low)))
    pushed = block_average(stress, name="the stress")
    if slope.sem is None or pushed.sem is None or not slope.mean or not pushed.mean:
        raise ParameterError("there are too few samples, or the fluid is not sheared; run longer, or move the walls faster")
    eta = pushed.mean / slope.mean
    error = abs(eta) * float(np.hypot(pushed.sem / pushed.mean, slope.sem / slope.mean))
    both, errors = (float(lower.mean or 0.0), float(upper.mean or 0.0)), (float(lower.sem or 0.0), float(upper.sem or 0.0))
    return CouetteFit(eta, error, slope.mean, slope.sem, pushed.mean, pushed.sem, both, errors, slope.converged and pushed.converged)


@dataclass(frozen=True)
class GreenKubo:
    """Viscosity from the stress fluctuations at equilibrium (Green-Kubo).

    Attributes
    ----------
    viscosity, error : float
        Viscosity, kJ/mol ps/nm^3, and its standard error.
    instantaneous : float
        Its instantaneous part, from friction alone.
    t_max : float
        Upper limit of the integral, ps.
    times, correlation, integral : arrays
        Times (ps), the correlation function (kJ/mol/nm^3), and the viscosity with each time as the upper limit.
    """

    viscosity: float
    error: float
    instantaneous: float
    t_max: float
    times: np.ndarray
    correlation: np.ndarray
    integral: np.ndarray


def green_kubo_viscosity(
    stress, dt=None, *, volume=None, kT=None, friction=None, instantaneous: float | None = None, t_max=None, blocks: int = 10
) -> GreenKubo:
    r"""Viscosity from a series of stress tensors at equilibrium (Green-Kubo).

    .. math::

        \eta = \eta_\infty + \frac{1}{V k_BT}\int_0^{t_{max}} \langle (A - D)(0)\,(A + D)(t)\rangle\,dt

    with A the kinetic and conservative part of the pressure tensor times the volume, D the dissipative part, and
    :math:`\eta_\infty` the instantaneous viscosity of the friction.  The random stress does not appear: it is uncorrelated with the past,
    and its effect on later friction gives the minus sign of D.  The average is over the five independent components of the traceless
    tensor.

    Parameters
    ----------
    stress : :class:`openmm_dpd.measure.StressReporter`, or (n, 6) array
        A (xx, yy, zz, xy, xz, yz) at equal intervals, kJ/mol.  A StressReporter provides all other arguments that are not given.
    dt : time
        Time between samples.
    volume : float
        Volume of the box, nm^3.
    kT : energy or temperature
        Thermal energy; a bare number is in kJ/mol, a Quantity may be in kelvin.
    friction : (n, 6) array, optional
        D, kJ/mol; zero by default (ordinary molecular dynamics).
    instantaneous : float
        Instantaneous viscosity of the friction, required with ``friction``; 0 without it.
    t_max : time, optional
        Upper limit of the integral; by default twice the first time at which the correlation is below its error.  Compare it with the
        plateau of ``integral``.
    blocks : int, default 10
        Number of blocks of the series for the error.

    Raises
    ------
    ParameterError
        If a number is out of bounds or missing, the series is too short, or the fluid is between walls.

    References
    ----------
    M. H. Ernst and R. Brito, Phys. Rev. E 72, 061102 (2005); G. Jung and F. Schmid, J. Chem. Phys. 144, 204104 (2016).
    """
    if hasattr(stress, "time_step"):
        dt = stress.time_step if dt is None else dt
        volume = stress.volume if volume is None else volume
        kT = stress.kT if kT is None else kT
        friction = stress.friction if friction is None else friction
        instantaneous = stress.instantaneous if instantaneous is None else instantaneous
        if stress.confined:
            raise ParameterError("walls or immobile beads take up momentum, so stresses do not give the viscosity; use couette_viscosity")
        stress = stress.regular
    if dt is None or volume is None or kT is None:
        raise ParameterError("with stresses in an array, green_kubo_viscosity needs dt, volume and kT as well")
    step, energy = checked(dt, "time", "dt", positive=True), thermal_energy(kT)
    volume, blocks = checked(volume, "volume", "volume", positive=True), whole_number(blocks, "the number of blocks")
    if not 0.0 < energy < np.inf:
        raise ParameterError(f"kT must be > 0 and finite, not {what_is(kT)}")
    if friction is not None and instantaneous is None:
        raise ParameterError("with friction, green_kubo_viscosity needs its instantaneous viscosity (instantaneous=...) as well")
    regular = _independent(stress, "stress")
    drag = np.zeros_like(regular) if friction is None else _independent(friction, "friction")
    if drag.shape != regular.shape:
        raise ParameterError(f"friction and stress must have the same number of rows; they have {len(drag)} and {len(regular)}")
    length = len(regular) // max(blocks, 1)
    if blocks < 5 or length < 20:
        raise ParameterError(f"{len(regular)} samples in {blocks} blocks; at least 5 blocks of 20 samples each are needed")
    lags = length // 2 if t_max is None else int(round(to_md(t_max, "time", "t_max") / step)) + 1
    if not 2 <= lags <= length:
        raise ParameterError(f"t_max must lie between dt and the length of a block, {length * step:g} ps")
    parts = np.array(
        [_correlation((regular - drag)[k : k + length], (regular + drag)[k : k + length], lags) for k in range(0, blocks * length, length)]
    ) / (volume * energy)
    mean, sem = parts.mean(axis=0), parts.std(axis=0, ddof=1) / np.sqrt(blocks)
    integrals = np.concatenate([np.zeros((blocks, 1)), np.cumsum(0.5 * step * (parts[:, 1:] + parts[:, :-1]), axis=1)], axis=1)
    last = lags - 1
    if t_max is None:
        last = min(2 * int(np.argmax(mean < sem)) or last, last)
    base = 0.0 if instantaneous is None else _viscosity(instantaneous)
    values = integrals[:, last]
    error, times = float(values.std(ddof=1) / np.sqrt(blocks)), np.arange(lags) * step
    return GreenKubo(base + float(values.mean()), error, base, last * step, times, mean, base + integrals.mean(axis=0))


def _viscosity(value) -> float:
    """A viscosity as a float, kJ/mol ps/nm^3; ParameterError if it is not finite and >= 0."""
    if not isinstance(value, (int, float, np.number)) or not 0.0 <= value < np.inf:
        raise ParameterError(f"the instantaneous viscosity must be a number >= 0, not {what_is(value)}")
    return float(value)


def _slabs(profile: VelocityProfile) -> tuple[np.ndarray, float, float]:
    """Middles, width and length of the slabs of a profile; ParameterError for one along two axes."""
    require(profile, VelocityProfile, "profile must be a VelocityProfile")
    if profile.centres.ndim != 1:
        raise ParameterError("a viscosity is fitted to a profile along one axis, not to one in cells or rings")
    return profile.centres, float(profile.width), float(profile.length)


def _ends(channel) -> tuple[float, float]:
    """Lower and upper end of a channel, nm; ParameterError if it is not two lengths."""
    if not isinstance(channel, (tuple, list, np.ndarray)) or len(channel) != 2:
        raise ParameterError(f"channel must be two lengths, not {what_is(channel)}")
    low, high = (checked(end, "length", "an end of the channel", signed=True) for end in channel)
    return low, high


def _independent(tensors, name: str) -> np.ndarray:
    """The five independent components of the traceless part of tensors (n, 6), scaled to the variance of xy, (n, 5)."""
    t = np.asarray(tensors, dtype=np.float64)
    if t.ndim != 2 or t.shape[1] != 6 or not np.all(np.isfinite(t)):
        raise ParameterError(f"{name} must be an (n, 6) array of finite components xx, yy, zz, xy, xz, yz")
    xx, yy, zz, xy, xz, yz = t.T
    return np.stack([xy, xz, yz, 0.5 * (xx - yy), (2 * zz - xx - yy) / (2 * np.sqrt(3))], axis=1)


def _correlation(first: np.ndarray, second: np.ndarray, lags: int) -> np.ndarray:
    """Correlation function first(t0) second(t0 + t) for t < lags, (lags,), averaged over the components and time origins t0."""
    n = len(first)
    size = 1 << int(np.ceil(np.log2(2 * n)))
    spectrum = np.conj(np.fft.rfft(first, size, axis=0)) * np.fft.rfft(second, size, axis=0)
    return np.fft.irfft(spectrum, size, axis=0)[:lags].mean(axis=1) / (n - np.arange(lags))
