"""Profiles along an axis of the box, two axes, or the radius around one: densities, velocities and temperatures."""

from collections.abc import Iterable, Iterator, Sequence

import numpy as np

from ..base.errors import ParameterError
from ..base.slices import Slicer, slicer
from .frames import Beads, Curve, Trajectories, curve_of, frames_of, ratio_curve, selected, type_names, weights_of


def density_profile(
    trajectory: Trajectories,
    types: Beads = None,
    *,
    axis: str | int = "z",
    n_bins: int | Sequence[int] = 100,
    centre: Beads = None,
    mass: bool = False,
) -> dict[str, Curve]:
    r"""Density profile of each bead type along an axis, rho(z) = n(z)/(A dz), along two, or around an axis.

    Parameters
    ----------
    trajectory : mdtraj.Trajectory or iterable of them
        Any periodic box, which may change.
    types : str, sequence of str, array of int, or None
        Types, each with its own profile; by default all types of the topology.  Indices give one profile, named ``selected``.
    axis : {"z", "y", "x", "xy", "xz", "yz", "rz", "ry", "rx"} or int
        Axis of the profile: slices are parallel to the box face spanned by the other two box vectors; z is the distance from that face.
        Two axes divide the box into cells.  ``"rz"`` means rings: radius around an axis along z, out to half the shorter edge across it
        (beads farther away are left out), and height z.  Rings need a box with right angles.
    n_bins : int or two of them, default 100
        Number of slices, along each of two axes; ``axis="rz", n_bins=(40, 1)`` is a function of the radius alone.  Their thickness scales
        with the box.
    centre : str, sequence of str, array of int, or None
        Beads (a film, a drop, the tails of a bilayer) whose centre of mass is moved to 0, the middle, in every frame.  They may cross the
        periodic boundary.  The axis of rings goes through it, or through the middle of the box; heights along it remain those in the box.
    mass : bool
        Mass densities (Da/nm^3) instead of number densities (1/nm^3).

    Returns
    -------
    dict of str to Curve
        For each type, x: z (nm) in a box of the mean width; y: density.  With two axes x is (K, L, 2) and y (K, L).

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
    x, found, _ = density_rows(trajectory, types, axis, n_bins, centre, mass=mass)
    return {name: curve_of(x, rows, f"the density of {name}") for name, rows in found.items()}


def density_rows(
    trajectory: Trajectories, types: Beads, axis: str | int, n_bins: int | Sequence[int], centre: Beads = None, *, mass=False, drop=False
) -> tuple[np.ndarray, dict[str, np.ndarray], np.ndarray]:
    """Midpoints of the cells; density in them, (F, cells), of each type in each frame; mean volumes (cells,).  With ``drop``, the density
    of all these beads together, centred on themselves."""
    topology, frames = frames_of(trajectory)
    groups = {"drop": selected(topology, types)} if drop else _groups(topology, types)
    cut = _slicer(topology, axis, n_bins, groups["drop"] if drop else centre)
    weights = cut.weights if mass else np.ones(topology.n_atoms)
    rows: dict[str, list[np.ndarray]] = {name: [] for name in groups}
    extents, volumes = [], []
    for frame in frames:
        box = frame.need_box("a density profile")
        extents.append(cut.extents(box))
        volumes.append(cut.volumes(box))
        number, _ = cut.cells(frame.positions, box)
        for name, group in groups.items():
            rows[name].append(cut.sums(number[group], weights[group]) / volumes[-1])
    found = {name: np.array(of_type) for name, of_type in rows.items()}
    return cut.coordinates(np.mean(extents, axis=0)), found, np.mean(volumes, axis=0)


def _slicer(topology, axis, n_bins, centre) -> Slicer:
    return slicer(axis, n_bins, None if centre is None else selected(topology, centre, "centre"), weights_of(topology))


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
    n_bins: int | Sequence[int] = 50,
    centre: Beads = None,
) -> Curve:
    r"""Profile of the flow velocity along an axis, along two, or around an axis: the centre-of-mass velocity of the beads in each slice,
    u(z) = <sum m v>/<sum m>.

    Parameters
    ----------
    trajectory : mdtraj.Trajectory or iterable of them
    velocities : (F, N, 3) array, or iterable of (N, 3) or (f, N, 3) arrays
        Velocities (nm/ps) of the same frames, which files that mdtraj streams do not have: from
        :class:`openmm_dpd.analysis.VelocityReporter`, or ``mdtraj.formats.HDF5TrajectoryFile(...).read().velocities``.
    beads : str, sequence of str, array of int, or None
        Beads to average over; all by default.
    component : {"x", "y", "z"} or int
        Component of the velocity; in rings around z ``"r"`` (away from the axis), ``"phi"`` (around it, right-handed) or ``"z"``.
    axis, n_bins, centre
        Axis or axes along which the box is sliced, or rings; number of slices; beads that are moved to 0 (:func:`density_profile`).

    Returns
    -------
    Curve
        x: z (nm); y: u (nm/ps), NaN in slices that are mostly empty.
    """
    x, sums = _velocity_sums(trajectory, velocities, beads, axis, n_bins, centre, component)
    return ratio_curve(x, sums["along"], sums["mass"], "the velocity profile")


def temperature_profile(
    trajectory: Trajectories,
    velocities: Iterable[np.ndarray],
    beads: Beads = None,
    *,
    axis: str | int = "z",
    n_bins: int | Sequence[int] = 50,
    centre: Beads = None,
    flow: bool = False,
) -> Curve:
    r"""Profile of the kinetic temperature kT (kJ/mol) along an axis, along two, or around an axis.

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


def _velocity_sums(trajectory, velocities, beads, axis, n_bins, centre, component=None) -> tuple[np.ndarray, dict[str, np.ndarray]]:
    """Midpoints of the cells; sums over the beads of each cell and frame, (F, cells): mass, number, m v^2, m v (3 columns), or a component
    of it (``along``)."""
    topology, frames = frames_of(trajectory)
    group, cut = selected(topology, beads), _slicer(topology, axis, n_bins, centre)
    m, extents = cut.weights[group], list[np.ndarray]()
    rows: dict[str, list[np.ndarray]] = {"mass": [], "momentum": [], "square": [], "count": []}
    number_along = None if component is None else cut.component(component)
    streamed = velocity_frames(velocities, topology.n_atoms)
    for frame in frames:
        v = next(streamed, None)
        if v is None:
            raise ParameterError(f"there are velocities for {len(extents)} frames only; the trajectory has more")
        box = frame.need_box("a profile")
        number, v = (of_all[group] for of_all in cut.cells(frame.positions, box, v))  # type: ignore[index]
        extents.append(cut.extents(box))
        of_slice = [cut.sums(number, w) for w in (m, *(m * v.T), m * np.sum(v**2, axis=1))]
        rows["mass"].append(of_slice[0])
        rows["momentum"].append(np.column_stack(of_slice[1:4]))
        rows["square"].append(of_slice[4])
        rows["count"].append(cut.sums(number))
    if next(streamed, None) is not None:
        raise ParameterError(f"there are velocities for more frames than the {len(extents)} of the trajectory")
    sums = {name: np.array(found, dtype=np.float64) for name, found in rows.items()}
    if number_along is not None:
        sums["along"] = sums["momentum"][:, :, number_along]
    return cut.coordinates(np.mean(extents, axis=0)), sums


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
