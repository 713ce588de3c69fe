"""Profiles along an axis of the box: densities, velocities and temperatures in slices."""

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from ..base.errors import ParameterError
from ..base.geometry import sums_in_slices, widths
from ..base.units import whole_number
from .frames import Beads, Curve, Frame, Trajectories, axis_number, curve_of, frames_of, ratio_curve, selected, type_names, weights_of

#: Length of the mean of exp(2 pi i s) below which beads are spread too evenly to have a centre.
LEAST_RESULTANT = 0.05


@dataclass(frozen=True)
class Slicer:
    """Assigns the beads of a frame to slices along an axis."""

    axis: int  #: Box vector that the slices divide; they are parallel to the other two
    n_bins: int
    centre: np.ndarray | None  #: (M,) indices of beads whose centre of mass is moved to the middle, or None
    weights: np.ndarray  #: (N,) masses of all beads

    def heights(self, frame: Frame) -> np.ndarray:
        """Position of each bead along the axis, (N,), as a fraction of the box in [0, 1); ``centre`` is moved to 1/2."""
        s = frame.fractions("a profile")[:, self.axis]
        if self.centre is not None:
            s = s - periodic_centre(s[self.centre], self.weights[self.centre]) + 0.5
        # a rounding error below 0 gives exactly 1
        return np.mod(s, 1.0) % 1.0

    def slices(self, frame: Frame) -> np.ndarray:
        """Number of the slice that each bead is in, (N,), from 0."""
        return np.minimum((self.heights(frame) * self.n_bins).astype(np.int64), self.n_bins - 1)

    def coordinates(self, width: float) -> np.ndarray:
        """Midpoints of the slices in a box of this width, (n_bins,); 0 is the lower face, or ``centre``."""
        return ((np.arange(self.n_bins) + 0.5) / self.n_bins - (0.5 if self.centre is not None else 0.0)) * width


def periodic_centre(fractions: np.ndarray, weights: np.ndarray) -> float:
    """Centre of mass of beads in a periodic direction, as a fraction of the box; ParameterError if they are spread too evenly to have one.
    The phase of sum w exp(2 pi i s) is the centre of a symmetric distribution (L. Bai and D. Breen, J. Graphics Tools 13, 53 (2008)); the
    mean of the positions wrapped around it is the centre of mass, unless the beads reach around the box."""
    resultant = np.sum(weights * np.exp(2j * np.pi * fractions)) / weights.sum()
    if abs(resultant) < LEAST_RESULTANT:
        raise ParameterError(
            "the beads to be centred are spread evenly along the axis, or lie at opposite places, and have no centre of mass; choose others"
        )
    guess = np.angle(resultant) / (2 * np.pi)
    around = fractions - guess - np.round(fractions - guess)
    return float(guess + np.sum(weights * around) / weights.sum())


def _slicer(topology, axis, n_bins, centre) -> Slicer:
    n_bins = whole_number(n_bins, "n_bins", least=1)
    return Slicer(axis_number(axis), n_bins, None if centre is None else selected(topology, centre, "centre"), weights_of(topology))


def density_profile(
    trajectory: Trajectories, types: Beads = None, *, axis: str | int = "z", n_bins: int = 100, centre: Beads = None, mass: bool = False
) -> dict[str, Curve]:
    r"""Density profile of each bead type along an axis, rho(z) = n(z)/(A dz).

    Parameters
    ----------
    trajectory : mdtraj.Trajectory or iterable of them
        Any periodic box, which may change.
    types : str, sequence of str, array of int, or None
        Types, each with its own profile; by default all types of the topology.  Indices give one profile, named ``selected``.
    axis : {"z", "y", "x"} or int
        Axis of the profile: slices are parallel to the box face spanned by the other two box vectors; z is the distance from that face.
    n_bins : int, default 100
        Number of slices.  Their thickness scales with the box.
    centre : str, sequence of str, array of int, or None
        Beads (a film, the tails of a bilayer) whose centre of mass is moved to z = 0, the middle, in every frame.  They may cross the
        periodic boundary.
    mass : bool
        Mass densities (Da/nm^3) instead of number densities (1/nm^3).

    Returns
    -------
    dict of str to Curve
        For each type, x: z (nm) in a box of the mean width; y: density.

    Raises
    ------
    ParameterError
        If there is no box, a type is unknown, or ``centre`` is spread evenly.

    Examples
    --------
    >>> import mdtraj, numpy as np
    >>> from openmm_dpd.io.trajectory import load_topology, write_psf
    >>> write_psf("film.psf", names=["A", "B"] * 50, masses=np.ones(100))
    >>> x = np.random.default_rng(1).random((10, 100, 3)) * 5.0  # usually mdtraj.iterload("film.dcd", top=topology)
    >>> box = {"unitcell_lengths": np.full((10, 3), 5.0), "unitcell_angles": np.full((10, 3), 90.0)}
    >>> profiles = density_profile(mdtraj.Trajectory(x, load_topology("film.psf"), **box), n_bins=10)
    >>> len(profiles["B"].x), round(float(profiles["B"].y.mean()), 3)
    (10, 0.4)
    """
    topology, frames = frames_of(trajectory)
    groups = _groups(topology, types)
    slicer = _slicer(topology, axis, n_bins, centre)
    weights = slicer.weights if mass else np.ones(topology.n_atoms)
    rows: dict[str, list[np.ndarray]] = {name: [] for name in groups}
    width = []
    for frame in frames:
        box = frame.need_box("a density profile")
        width.append(widths(box)[slicer.axis])
        number, volume = slicer.slices(frame), np.linalg.det(box) / slicer.n_bins
        for name, group in groups.items():
            rows[name].append(sums_in_slices(number[group], weights[group], slicer.n_bins) / volume)
    x = slicer.coordinates(float(np.mean(width)))
    return {name: curve_of(x, found, f"the density of {name}") for name, found in rows.items()}


def _groups(topology, types: Beads) -> dict[str, np.ndarray]:
    if types is None:
        names = list(dict.fromkeys(type_names(topology).tolist()))
    else:
        names = [types] if isinstance(types, str) else list(types) if isinstance(types, (Sequence, np.ndarray)) else []
    if names and all(isinstance(name, str) for name in names):
        return {str(name): selected(topology, name, "types") for name in names}
    return {"selected": selected(topology, types, "types")}


# -- velocities ------------------------------------------------------------------------------------------------------------------
def velocity_profile(
    trajectory: Trajectories,
    velocities: Iterable[np.ndarray],
    beads: Beads = None,
    *,
    component: str | int = "x",
    axis: str | int = "z",
    n_bins: int = 50,
    centre: Beads = None,
) -> Curve:
    r"""Profile of the flow velocity along an axis: the centre-of-mass velocity of the beads in each slice, u(z) = <sum m v>/<sum m>.

    Parameters
    ----------
    trajectory : mdtraj.Trajectory or iterable of them
    velocities : (F, N, 3) array, or iterable of (N, 3) or (f, N, 3) arrays
        Velocities (nm/ps) of the same frames, which files that mdtraj streams do not have: from
        :class:`openmm_dpd.analysis.VelocityReporter`, or ``mdtraj.formats.HDF5TrajectoryFile(...).read().velocities``.
    beads : str, sequence of str, array of int, or None
        Beads to average over; all by default.
    component, axis : {"x", "y", "z"} or int
        Component of the velocity; axis along which the box is sliced.
    n_bins, centre
        Number of slices; beads whose centre of mass is moved to z = 0 in every frame.

    Returns
    -------
    Curve
        x: z (nm); y: u (nm/ps), NaN in slices that are mostly empty.
    """
    k = axis_number(component)
    x, sums = _velocity_sums(trajectory, velocities, beads, axis, n_bins, centre)
    return ratio_curve(x, sums["momentum"][:, :, k], sums["mass"], "the velocity profile")


def temperature_profile(
    trajectory: Trajectories,
    velocities: Iterable[np.ndarray],
    beads: Beads = None,
    *,
    axis: str | int = "z",
    n_bins: int = 50,
    centre: Beads = None,
    flow: bool = False,
) -> Curve:
    r"""Profile of the kinetic temperature kT (kJ/mol) along an axis.

    .. math:: kT(z) = \frac{\langle \sum m\,(\mathbf v - \mathbf u)^2 \rangle}{3 \langle n \rangle},

    with u = 0; or, with ``flow``, the mean velocity of the slice in each frame (so flows may change in time) and n - 1 in place of n.
    Without ``flow``, the three degrees of freedom of 3N lost when the system's centre of mass is at rest are neglected.

    Parameters
    ----------
    trajectory, velocities, beads, axis, n_bins, centre
        Frames, their velocities (nm/ps), and how beads are sliced, see :func:`velocity_profile`.
    flow : bool
        Subtract the flow velocity.

    Returns
    -------
    Curve
        x: z (nm); y: kT (kJ/mol), NaN in slices that are mostly empty.
    """
    x, sums = _velocity_sums(trajectory, velocities, beads, axis, n_bins, centre)
    square, mass, count = sums["square"], sums["mass"], sums["count"]
    if flow:
        own = np.sum(sums["momentum"] ** 2, axis=2)
        square, count = square - np.divide(own, mass, out=np.zeros_like(own), where=mass > 0), np.maximum(count - 1, 0)
    return ratio_curve(x, square, 3 * count, "the temperature profile")


def _velocity_sums(trajectory, velocities, beads, axis, n_bins, centre) -> tuple[np.ndarray, dict[str, np.ndarray]]:
    """Midpoints of the slices, and sums over the beads of each slice and frame, (F, n_bins): mass, m v (with 3 columns), m v^2, number."""
    topology, frames = frames_of(trajectory)
    group, slicer = selected(topology, beads), _slicer(topology, axis, n_bins, centre)
    m, width = slicer.weights[group], list[float]()
    rows: dict[str, list[np.ndarray]] = {"mass": [], "momentum": [], "square": [], "count": []}
    streamed = velocity_frames(velocities, topology.n_atoms)
    for frame in frames:
        v = next(streamed, None)
        if v is None:
            raise ParameterError(f"there are velocities for {len(width)} frames only; the trajectory has more")
        v, number = v[group], slicer.slices(frame)[group]
        width.append(widths(frame.need_box("a profile"))[slicer.axis])
        of_slice = [sums_in_slices(number, w, slicer.n_bins) for w in (m, *(m * v.T), m * np.sum(v**2, axis=1))]
        rows["mass"].append(of_slice[0])
        rows["momentum"].append(np.column_stack(of_slice[1:4]))
        rows["square"].append(of_slice[4])
        rows["count"].append(sums_in_slices(number, None, slicer.n_bins))
    if next(streamed, None) is not None:
        raise ParameterError(f"there are velocities for more frames than the {len(width)} of the trajectory")
    return slicer.coordinates(float(np.mean(width))), {name: np.array(found, dtype=np.float64) for name, found in rows.items()}


def velocity_frames(velocities: Iterable[np.ndarray], beads: int | None) -> Iterator[np.ndarray]:
    """Velocities frame by frame, (N, 3) each, from one array or an iterable of arrays; ParameterError for a wrong shape or value."""
    if isinstance(velocities, (str, bytes)) or not isinstance(velocities, Iterable):
        raise ParameterError(f"velocities must be an array (frames, beads, 3) or an iterable of such, not {type(velocities).__name__}")
    for piece in velocities:
        array = np.asarray(piece, dtype=np.float64)
        if array.ndim == 2:
            array = array[None]
        beads = array.shape[1] if beads is None and array.ndim == 3 else beads
        if array.ndim != 3 or array.shape[1:] != (beads, 3):
            raise ParameterError(f"velocities of a frame must have shape ({beads}, 3), not {np.shape(piece)}")
        if not np.all(np.isfinite(array)):
            raise ParameterError("velocities must be finite; there is a NaN or infinite one")
        yield from array
