"""Motion of beads and molecules: mean squared displacements, diffusion coefficients, velocity autocorrelation."""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from ..base.errors import ParameterError, require, what_is
from ..base.slices import axis_number
from ..base.stats import Average, block_average
from ..base.units import thermal_energy, to_md
from .frames import Beads, Curve, Trajectories, curve_of_averages, frames_of, indices, positive_number, selected, weights_of
from .profiles import velocity_frames
from .unwrapping import means_over, molecule_labels, unwrapped

#: Number of lags by default.
LAGS = 50
#: -xi of a simple cubic lattice of charges, the finite-size correction of a cubic box.
XI = 2.837297


@dataclass(frozen=True, eq=False)
class MeanSquaredDisplacement(Curve):
    """Mean squared displacement against time: x in ps, y in nm^2.

    Attributes
    ----------
    origins : (F, K) array
        Mean over the beads for each time origin and lag; NaN where origin plus lag is beyond the trajectory.
    dimensions : int
        Number of axes that the displacements are taken along.
    """

    origins: np.ndarray
    dimensions: int


def mean_squared_displacement(
    trajectory: Trajectories,
    beads: Beads = None,
    *,
    interval: float,
    lags: Sequence[int] | None = None,
    molecules: bool = False,
    drift: bool = False,
    axes: str = "xyz",
    unwrap: bool | str = "auto",
) -> MeanSquaredDisplacement:
    r"""Mean squared displacement <|r(t0 + t) - r(t0)|^2> over beads and all time origins t0.

    Parameters
    ----------
    trajectory : mdtraj.Trajectory or iterable of them
        Any box, or none.  Positions may be wrapped into the box, bead by bead or molecule by molecule.  The paths of the chosen beads are
        held in memory: 24 bytes per bead and frame.
    beads : str, sequence of str, array of int, or None
        Beads to average over; all by default.
    interval : float
        Time between frames (ps).  mdtraj does not read the times of DCD files.
    lags : sequence of int, optional
        Time differences in frames; by default 50 of them (or all) up to a quarter of the trajectory.
    molecules : bool
        Take displacements of the molecules' centres of mass (over these beads), not of single beads.
    drift : bool
        Keep the motion of the centre of mass of all beads.  By default it is subtracted, which leaves independent walkers 1 - 1/N of their
        displacement; a system that conserves momentum does not drift.
    axes : str, default "xyz"
        Axes to sum over: ``"xy"`` for motion in the plane of a bilayer.
    unwrap : {"auto", True, False}
        Whether positions are wrapped into the box and have to be unwrapped; by default the positions decide.

    Returns
    -------
    MeanSquaredDisplacement
        With standard errors from blocks of time origins.

    Raises
    ------
    ParameterError
        If there are fewer than 2 frames, a lag is out of range, or wrapped positions cannot be unwrapped.
    """
    interval = positive_number(interval, "interval")
    along = [axis_number(axis) for axis in axes]
    if not along or len(set(along)) < len(along):
        raise ParameterError(f"axes must be some of x, y and z, each once, not {what_is(axes)}")
    topology, frames = frames_of(trajectory)
    group, masses = selected(topology, beads), weights_of(topology)
    units = np.unique(molecule_labels(topology)[group], return_inverse=True)[1] if molecules else None
    kept: list[np.ndarray] = []
    for x in unwrapped(topology, frames, unwrap):
        moved = x if drift else x - masses @ x / masses.sum()
        kept.append((moved[group] if units is None else means_over(units, masses[group], moved[group]))[:, along])
    rows = _lagged(np.array(kept), lags, "a mean squared displacement", lambda a, b: mean_squares(a, b).sum(axis=-1))
    curve = _average_lags(rows, interval)
    return MeanSquaredDisplacement(curve.x, curve.y, curve.sem, curve.n_frames, rows[1], len(along))


def mean_squares(start: np.ndarray, end: np.ndarray) -> np.ndarray:
    """Mean squared displacement along each axis, (..., axes), from positions at both ends, (..., beads, axes)."""
    d = end - start
    return np.einsum("...ik,...ik->...k", d, d) / start.shape[-2]


def _lagged(values: np.ndarray, lags: Sequence[int] | None, what: str, mean_of) -> tuple[np.ndarray, np.ndarray]:
    """Lags (K,), and ``mean_of`` of the values at both ends for each time origin and lag, (F, K); NaN beyond the trajectory."""
    frames = len(values)
    if frames < 2:
        raise ParameterError(f"{what} needs at least 2 frames; there are {frames}")
    if lags is None:
        most = max(1, frames // 4)
        chosen = np.unique(np.round(np.linspace(0, most, min(LAGS, most) + 1)).astype(np.int64))
    else:
        chosen = np.asarray(lags)
        if chosen.ndim != 1 or not chosen.size or chosen.dtype.kind not in "iu":
            raise ParameterError(f"lags must be whole numbers of frames, not {what_is(lags)}")
        if chosen.min() < 0 or chosen.max() >= frames or len(np.unique(chosen)) < len(chosen):
            raise ParameterError(f"lags must be different numbers from 0 to {frames - 1}, the number of frames less 1; not {what_is(lags)}")
        chosen = np.sort(chosen)
    table = np.full((frames, len(chosen)), np.nan)
    for column, lag in enumerate(chosen.tolist()):
        table[: frames - lag, column] = mean_of(values[: frames - lag], values[lag:])
    return chosen, table


def _average_lags(rows: tuple[np.ndarray, np.ndarray], interval: float) -> Curve:
    lags, table = rows
    averages = [block_average(column[: len(table) - lag]) for lag, column in zip(lags.tolist(), table.T, strict=True)]
    return curve_of_averages(lags * interval, averages, len(table))


def diffusion_coefficient(
    displacement: MeanSquaredDisplacement, fit: tuple[float, float], *, kT=None, viscosity: float | None = None, edge=None
) -> Average:
    r"""Diffusion coefficient D from the slope of the mean squared displacement, msd = 2 d D t + c in d dimensions.

    The line is a least-squares fit to the lags within ``fit``.  Its slope is a linear combination of lags, so each time origin has a D;
    their mean is the result, and blocks of them give its error, with the correlations between lags and between beads.

    In a periodic box D is too small, because a bead interacts with its images through the flow that it drives.  Given ``kT``,
    ``viscosity`` and ``edge`` of a cubic box, the result is

    .. math:: D_\infty = D + \frac{2.837297\, kT}{6 \pi \eta L}.

    Parameters
    ----------
    displacement : MeanSquaredDisplacement
    fit : (float, float)
        First and last time (ps) of the range in which the displacement is linear in time.  With a single lag there, D = msd/(2 d t).
    kT : energy or temperature, optional
        A bare number is in kJ/mol; a Quantity may be in kelvin.
    viscosity : float, optional
        Da/nm/ps = kJ/mol ps/nm^3.
    edge : length, optional
        Edge of the cubic box.  Give all three or none.

    Returns
    -------
    openmm_dpd.base.stats.Average
        D in nm^2/ps.  ``converged`` says whether the trajectory is long enough for the error to be reliable.

    Raises
    ------
    ParameterError
        If no lag is within ``fit``, or the correction lacks one of its three values.

    References
    ----------
    I.-C. Yeh and G. Hummer, J. Phys. Chem. B 108, 15873 (2004); B. Duenweg and K. Kremer, J. Chem. Phys. 99, 6983 (1993).
    """
    require(displacement, MeanSquaredDisplacement, "a diffusion coefficient is taken from what mean_squared_displacement(...) returns")
    try:
        low, high = (float(time) for time in fit)
    except (TypeError, ValueError):
        raise ParameterError(f"fit must be two times, not {what_is(fit)}") from None
    slack = 1e-9 * max(1.0, abs(high))
    chosen = np.flatnonzero((displacement.x >= low - slack) & (displacement.x <= high + slack) & (displacement.x > 0))
    if not len(chosen):
        raise ParameterError(f"no lag is between {low:g} and {high:g} ps; they go from {displacement.x[0]:g} to {displacement.x[-1]:g}")
    times = displacement.x[chosen]
    weights = 1.0 / times if len(times) == 1 else (times - times.mean()) / np.sum((times - times.mean()) ** 2)
    series = displacement.origins[:, chosen] @ weights / (2 * displacement.dimensions)
    found = block_average(series[np.isfinite(series)], name="the diffusion coefficient")
    correction = (kT, viscosity, edge)
    if all(value is None for value in correction):
        return found
    if any(value is None for value in correction):
        raise ParameterError("the finite-size correction needs kT, viscosity and edge; give all three or none")
    energy, eta = positive_number(thermal_energy(kT), "kT"), positive_number(viscosity, "viscosity")
    length = positive_number(to_md(edge, "length", "edge"), "edge")
    assert found.mean is not None
    return replace(found, mean=found.mean + XI * energy / (6 * np.pi * eta * length))


def velocity_autocorrelation(
    velocities: Iterable[np.ndarray], beads: Sequence[int] | np.ndarray | None = None, *, interval: float, lags: Sequence[int] | None = None
) -> Curve:
    r"""Velocity autocorrelation function C(t) = <v(t0) . v(t0 + t)> over beads and all time origins t0.

    Its integral is the diffusion coefficient, D = (1/3) int C dt, and C(0) = 3 kT/m.

    Parameters
    ----------
    velocities : (F, N, 3) array, or iterable of (N, 3) or (f, N, 3) arrays
        In nm/ps, from :class:`openmm_dpd.analysis.VelocityReporter` or an HDF5 file.  Velocities of the chosen beads are held in memory.
    beads : array of int or of bool, optional
        Indices; all by default.
    interval : float
        Time between frames (ps).
    lags : sequence of int, optional
        Time differences in frames; by default 50 of them (or all) up to a quarter of the frames.

    Returns
    -------
    Curve
        x: time, ps; y: C, nm^2/ps^2 (divide by y[0] to normalise).

    Raises
    ------
    ParameterError
        If there are fewer than 2 frames, a lag or an index is out of range, or an index appears twice.
    """
    interval = positive_number(interval, "interval")
    kept: list[np.ndarray] = []
    group: np.ndarray | None = None
    for v in velocity_frames(velocities, None):
        if beads is not None and group is None:
            group = indices(beads, len(v))
        kept.append(v if group is None else v[group])
    rows = _lagged(np.array(kept), lags, "a velocity autocorrelation", lambda a, b: np.einsum("fik,fik->f", a, b) / a.shape[1])
    return _average_lags(rows, interval)
