"""Frames of a trajectory, in memory or streamed in chunks, what every analysis asks about them, and curves of averages over them."""

from __future__ import annotations

import os
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from itertools import chain, count
from typing import TYPE_CHECKING, TypeAlias
from zipfile import is_zipfile

import numpy as np

from ..base.errors import ParameterError, what_is
from ..base.stats import Average, block_average, ratio_average
from ..io.trajectory import bead_masses
from ..simulation.field_file import frame_numbers, frame_of

if TYPE_CHECKING:
    import mdtraj

#: A trajectory in memory, or chunks of one, as from ``mdtraj.iterload``.
Trajectories: TypeAlias = "mdtraj.Trajectory | Iterable[mdtraj.Trajectory]"
#: Beads: a type, several types, indices or a mask; None for all.
Beads: TypeAlias = str | Sequence[str] | Sequence[int] | np.ndarray | None


@dataclass(frozen=True, eq=False)
class Frame:
    """One frame in double precision: positions (N, 3) in nm, box vectors (3, 3) as rows or None, time in ps (0 if unknown)."""

    positions: np.ndarray
    box: np.ndarray | None
    time: float = 0.0

    def need_box(self, what: str) -> np.ndarray:
        """The box vectors; ParameterError if there is no box."""
        if self.box is None:
            raise ParameterError(f"{what} needs a periodic box, but the trajectory has none (unitcell_vectors is None)")
        return self.box

    def fractions(self, what: str) -> np.ndarray:
        """Positions in units of the box vectors, (N, 3), not wrapped; ParameterError if there is no box."""
        return self.positions @ np.linalg.inv(self.need_box(what))


def chunks_of(trajectory: Trajectories) -> tuple[mdtraj.Topology, Iterator[mdtraj.Trajectory]]:
    """Topology (of the first chunk) and chunks of a trajectory, one in memory at a time; ParameterError if it has no frames."""
    import mdtraj

    if isinstance(trajectory, (str, bytes)) or not isinstance(trajectory, (mdtraj.Trajectory, Iterable)):
        raise ParameterError(
            f"a trajectory must be an mdtraj.Trajectory or chunks of one, not {type(trajectory).__name__}; trajectory.load reads a file"
        )
    chunks = _checked(iter([trajectory] if isinstance(trajectory, mdtraj.Trajectory) else trajectory))
    first = next(chunks, None)
    if first is None:
        raise ParameterError("the trajectory has no frames; an iterator of chunks can be used once only")
    return first.topology, chain([first], chunks)


def _checked(chunks: Iterator) -> Iterator[mdtraj.Trajectory]:
    """Chunks with frames; ParameterError if one is not a trajectory, has no topology or other beads, or a coordinate is not finite."""
    import mdtraj

    beads, frames = None, 0
    for chunk in chunks:
        if not isinstance(chunk, mdtraj.Trajectory):
            raise ParameterError(f"chunks of a trajectory must be mdtraj.Trajectory objects, not {type(chunk).__name__}")
        if chunk.topology is None:
            raise ParameterError("the trajectory has no topology; load it with one (openmm_dpd.io.trajectory.load_topology)")
        if beads is not None and chunk.n_atoms != beads:
            raise ParameterError(f"chunks of one trajectory must have the same beads; they have {beads} and {chunk.n_atoms}")
        bad = np.flatnonzero(~np.isfinite(chunk.xyz).all(axis=(1, 2)))
        if len(bad):
            raise ParameterError(f"a coordinate in frame {frames + bad[0]} (counted from 0) is not finite")
        beads, frames = chunk.n_atoms, frames + chunk.n_frames
        if chunk.n_frames:
            yield chunk


def frames_of(trajectory: Trajectories) -> tuple[mdtraj.Topology, Iterator[Frame]]:
    """Topology and frames of a trajectory; ParameterError if a box has no volume, or the trajectory is refused by :func:`chunks_of`."""
    topology, chunks = chunks_of(trajectory)
    return topology, _frames(chunks)


def _frames(chunks: Iterator[mdtraj.Trajectory]) -> Iterator[Frame]:
    """Frames of chunks, in double precision; ParameterError if a box has no volume."""
    numbers = count()
    for chunk in chunks:
        boxes = chunk.unitcell_vectors
        for k, number in zip(range(chunk.n_frames), numbers, strict=False):
            box = None if boxes is None else boxes[k].astype(np.float64)
            if box is not None and not np.linalg.det(box) > 0:
                raise ParameterError(f"the box of frame {number} (counted from 0) has no volume")
            yield Frame(chunk.xyz[k].astype(np.float64), box, float(chunk.time[k]))


# -- beads -----------------------------------------------------------------------------------------------------------------------
def type_names(topology: mdtraj.Topology) -> np.ndarray:
    """Type of each bead, (N,): its name in the topology."""
    return np.array([atom.name for atom in topology.atoms])


def selected(topology: mdtraj.Topology, beads: Beads, what: str = "beads") -> np.ndarray:
    """Indices of the selected beads: those of one or more types, indices from 0, a mask, or None for all.  ParameterError, in which
    ``what`` names the argument, if a type has no bead, an index is out of range or appears twice, or nothing is selected."""
    return of_types(type_names(topology), beads, what)


def two_selected(topology: mdtraj.Topology, beads: Beads, other: Beads) -> tuple[np.ndarray, np.ndarray]:
    """Indices of two sets of beads; if ``other`` is None, the second is the first."""
    first = selected(topology, beads, "beads")
    return first, first if other is None else selected(topology, other, "other")


def of_types(names: np.ndarray, beads: Beads, what: str) -> np.ndarray:
    """Indices of the selected beads among those with these type names, (N,); arguments and errors of :func:`selected`."""
    if beads is None:
        return np.arange(len(names))
    array = np.asarray([beads] if isinstance(beads, str) else beads)
    if array.ndim == 1 and array.dtype.kind == "U":
        for name in array:
            if name not in names:
                there = ", ".join(map(repr, dict.fromkeys(names.tolist())))
                raise ParameterError(f"{what}: no bead is of type {str(name)!r}; there are {there}")
        return np.flatnonzero(np.isin(names, array))
    return indices(array, len(names), what, "a type, several types, ")


def indices(beads: Sequence[int] | np.ndarray, count: int, what: str = "beads", besides: str = "") -> np.ndarray:
    """Indices from indices or a mask of ``count`` beads; ParameterError for anything else (``besides``: what else is accepted)."""
    array = np.asarray(beads)
    if array.shape == (count,) and array.dtype == bool:
        array = np.flatnonzero(array)
    if array.ndim != 1 or (array.size and array.dtype.kind not in "iu"):
        raise ParameterError(f"{what} must be {besides}indices or a mask of {count}, not {array.dtype} of shape {array.shape}")
    if not array.size:
        raise ParameterError(f"{what}: no beads are selected")
    if array.min() < 0 or array.max() >= count:
        raise ParameterError(f"{what}: indices must be from 0 to {count - 1}; there is {array.min() if array.min() < 0 else array.max()}")
    if len(np.unique(array)) < len(array):
        raise ParameterError(f"{what}: an index appears twice")
    return array.astype(np.int64)


def weights_of(topology: mdtraj.Topology) -> np.ndarray:
    """Masses of all beads, (N,); all equal if the topology has none, as when loaded from a PDB file."""
    masses = bead_masses(topology) if all(atom.element is not None for atom in topology.atoms) else np.zeros(topology.n_atoms)
    return masses if masses.any() else np.ones(topology.n_atoms)


# -- boxes -----------------------------------------------------------------------------------------------------------------------
def positive_number(value, name: str) -> float:
    """The value as a float; ParameterError if it is not a finite number > 0."""
    try:
        number = float(value)
    except (TypeError, ValueError):
        raise ParameterError(f"{name} must be a number, not {what_is(value)}") from None
    if not (np.isfinite(number) and number > 0):
        raise ParameterError(f"{name} must be above 0, not {what_is(value)}")
    return number


def read_velocities(file: str | os.PathLike) -> Iterator[np.ndarray]:
    """Velocities (N, 3), nm/ps, frame by frame, with one frame in memory; ``load_fields(file)["velocities"]`` has all frames at once.

    Raises
    ------
    ParameterError
        If there is no such file, or :class:`VelocityReporter` did not write it.
    """
    try:
        if os.path.isfile(file) and not is_zipfile(file):
            raise ValueError("it is not a zip archive, or is incomplete")
        opened = np.load(file)
    except (OSError, ValueError, TypeError) as error:
        raise ParameterError(f"{file} cannot be read as a file of velocities (written by VelocityReporter): {error}") from None
    numbers = frame_numbers(opened) if isinstance(opened, np.lib.npyio.NpzFile) else []
    if not numbers or "velocities" not in frame_of(opened, numbers[0]):
        raise ParameterError(f"{file} is not a file of velocities written by VelocityReporter")
    with opened as archive:
        for number in numbers:
            yield frame_of(archive, number)["velocities"]


if TYPE_CHECKING:
    import mdtraj


@dataclass(frozen=True, eq=False)
class Curve:
    """A function y(x) averaged over the frames of a trajectory.

    Attributes
    ----------
    x, y : (K,) arrays
        A profile along two axes has y (K, L), and x (K, L, 2): the two coordinates of the middle of each cell.
    sem : array shaped as y
        Standard errors of y from blocks of frames (:func:`openmm_dpd.base.stats.block_average`); NaN with fewer than 5 frames, and too
        small, as a rule, with fewer than about 30.
    n_frames : int
        Number of frames.
    """

    x: np.ndarray
    y: np.ndarray
    sem: np.ndarray
    n_frames: int


def curve_of(x, rows: Sequence[np.ndarray] | np.ndarray, name: str = "the series") -> Curve:
    """Curve of the means over rows (F, K), one row per frame; each column has its error from blocks of frames."""
    table = np.asarray(rows, dtype=np.float64)
    return curve_of_averages(x, [block_average(column, name=name) for column in table.T], len(table))


def ratio_curve(x, above: np.ndarray, below: np.ndarray, name: str = "the ratio") -> Curve:
    """Curve of mean(above)/mean(below) of two series (F, K), with jackknife errors over blocks; NaN where ``below`` is always 0."""
    nothing = Average(np.nan, None, 0, None)
    columns = [ratio_average(a, b, name=name) if _divides(b) else nothing for a, b in zip(above.T, below.T, strict=True)]
    return curve_of_averages(x, columns, len(above))


def _divides(series: np.ndarray) -> bool:
    """Whether a ratio over this denominator has a defined error: most frames, or any of fewer than 5, are not 0."""
    return bool(np.count_nonzero(series) > len(series) // 2) or (0 < len(series) < 5 and bool(series.any()))


def curve_of_averages(x, averages: list[Average], frames: int) -> Curve:
    """Curve of averages, one for each x, over this number of frames."""
    y = np.array([average.mean for average in averages], dtype=np.float64)
    sem = np.array([np.nan if average.sem is None else average.sem for average in averages], dtype=np.float64)
    x = np.asarray(x, dtype=np.float64)
    shape = x.shape[: max(1, x.ndim - 1)]
    return Curve(x, y.reshape(shape), sem.reshape(shape), frames)
