"""Per-bead fields over time: a file beside the trajectory."""

import io
import os
import zipfile
from collections.abc import Iterator
from contextlib import contextmanager

import numpy as np
from openmm import unit

from ..base.errors import ParameterError, require
from ..base.file_ledger import ledger_in_use
from ..base.files import writing
from ..io.snapshot import Cadence
from .built import BuiltSystem
from .fields import read_fields

_WHAT = "the file of fields"


class FieldWriter:
    """Appends frames to a zip archive of records, ``frames/number.npy``, which ``numpy.load`` and :func:`load_fields` read.  Every frame
    is complete on disk when :meth:`write` returns, and nothing is held in memory.  An OutputError leaves the frames before readable.  To
    ``append`` to a file with other contents is a ParameterError, also from :meth:`write`; one that is not there is begun."""

    def __init__(self, file: str | os.PathLike, append: bool = False):
        require(file, (str, os.PathLike), "file must be a path")
        require(append, bool, "append must be True or False")
        self.file, self.frames = os.fspath(file), 0
        self._shapes: dict[str, tuple[int, ...]] = {}
        ledger = ledger_in_use()
        if ledger is not None:
            ledger.touch(self.file, grows=True, anew=not append)
        if append and os.path.exists(self.file):
            self._continue()
        else:
            with writing(self.file, _WHAT), zipfile.ZipFile(self.file, "w"):
                pass
            self._report(0)

    def _continue(self) -> None:
        """Count the frames that are there and look at the last one."""
        if not zipfile.is_zipfile(self.file):
            raise ParameterError(f"cannot append to {self.file}: it is no archive of frames, or its writing was cut short")
        with np.load(self.file) as archive:
            numbers = frame_numbers(archive)
            self.frames = len(numbers)
            self._shapes = {name: values.shape for number in numbers[-1:] for name, values in frame_of(archive, number).items()}

    def write(self, time: float, step: int, fields: dict[str, np.ndarray]) -> None:
        """Append one frame."""
        frame = {name: np.asarray(values) for name, values in {"time": np.float64(time), "step": np.int64(step), **fields}.items()}
        shapes = {name: values.shape for name, values in frame.items()}
        if self._shapes and shapes != self._shapes:
            raise ParameterError(f"cannot append to {self.file}: its frames hold {_listed(self._shapes)}, and this one {_listed(shapes)}")
        record, buffer = np.zeros((), [(name, values.dtype, values.shape) for name, values in frame.items()]), io.BytesIO()
        for name, values in frame.items():
            record[name] = values
        np.save(buffer, record)
        with writing(self.file, _WHAT), _or_as_before(self.file):
            with zipfile.ZipFile(self.file, "a") as archive:
                archive.writestr(f"frames/{self.frames:08d}.npy", buffer.getvalue())
        self.frames, self._shapes = self.frames + 1, shapes
        self._report(archive.start_dir)

    def _report(self, directory: int) -> None:
        """Record in a ledger where the archive's directory begins, which the next frame overwrites."""
        ledger = ledger_in_use()
        if ledger is not None:
            ledger.tail(self.file, directory)


@contextmanager
def _or_as_before(file: str) -> Iterator[None]:
    """Put an archive back if something goes wrong: new members are written over its directory, which comes again after them."""
    with zipfile.ZipFile(file) as archive:
        end = archive.start_dir
    with open(file, "rb") as stream:
        stream.seek(end)
        directory = stream.read()
    try:
        yield
    except BaseException:
        with open(file, "r+b") as stream:
            stream.seek(end)
            stream.write(directory)
            stream.truncate()
        raise


def _listed(shapes: dict[str, tuple[int, ...]]) -> str:
    return ", ".join(f"{name} {list(shape)}" if shape else name for name, shape in sorted(shapes.items()))


def load_fields(file: str | os.PathLike) -> dict[str, np.ndarray]:
    """Read what :class:`FieldReporter` or ``openmm-dpd run`` wrote.

    Returns
    -------
    dict of arrays
        ``time`` (ps) and ``step``, each (F,), and the names of :func:`openmm_dpd.simulation.fields.read_fields`, each (F, N) or (F, N, K),
        kJ/mol.
    """
    with np.load(file) as archive:
        frames = [frame_of(archive, number) for number in frame_numbers(archive)]
    return {name: np.array([frame[name] for frame in frames]) for name in frames[0]} if frames else {}


def frame_numbers(archive: np.lib.npyio.NpzFile) -> list[str]:
    """Numbers of the frames in a file of fields, in their order."""
    return sorted({member.split("/")[-1] for member in archive.files})


def frame_of(archive: np.lib.npyio.NpzFile, number: str) -> dict[str, np.ndarray]:
    """One frame; files of earlier versions have a member ``name/number`` for each array."""
    if (member := f"frames/{number}") not in archive.files:
        return {name.split("/")[0]: archive[name] for name in archive.files if name.endswith(f"/{number}")}
    record = archive[member]
    return {name: record[name] for name in record.dtype.fields or ()}


class FieldReporter(Cadence):
    """Writes the per-bead fields to a file, for ``simulation.reporters``; give it the interval of the trajectory, and frames match.

    Parameters
    ----------
    file : str or path
        Usually ``fields.npz`` beside the trajectory.
    interval : int
        Steps between frames.
    built : BuiltSystem
        A scene whose beads have internal energies, temperatures, concentrations, local densities, or bonds that form and break.
    append : bool, default False
        Go on with the frames of a file that is there; one that is not there is begun.

    Raises
    ------
    ParameterError
        If the interval is below 1, the beads have no fields, or a file to go on with holds something else.

    Examples
    --------
    >>> import numpy as np, openmm_dpd as dpd
    >>> pairs = {("W", "W"): dpd.EnergyDPD(A=25, sigma=3, kappa=1)}
    >>> inside = dpd.InternalEnergy(dpd.ConstantHeatCapacity(60.0), 1.0)
    >>> x = np.random.default_rng(1).random((81, 3)) * 3
    >>> scene = dpd.Scene({"W": 1}, ["W"] * 81, x, pairs, kT=1, box=[3, 3, 3], internal=inside)
    >>> built = dpd.build(scene, dt=0.01, platform="Reference", seed=1)
    >>> simulation = built.simulation()
    >>> simulation.reporters.append(FieldReporter("fields.npz", 10, built))
    >>> simulation.step(20)
    >>> load_fields("fields.npz")["theta"].shape
    (2, 81)
    """

    def __init__(self, file: str | os.PathLike, interval: int, built: BuiltSystem, append: bool = False):
        super().__init__(interval)
        require(built, BuiltSystem, "FieldReporter needs what openmm_dpd.build() returned")
        if not has_fields(built) and not built.plan.scene.reactions:
            raise ParameterError("the beads of this scene have no internal energies, temperatures, concentrations, densities or reactions")
        self._writer, self._built = FieldWriter(file, append), built

    def report(self, simulation, state):
        """Write one frame."""
        time = simulation.context.getTime().value_in_unit(unit.picosecond)
        self._writer.write(time, simulation.currentStep, read_fields(simulation.context, self._built.plan))


def has_fields(built: BuiltSystem) -> bool:
    """Whether there is anything to write."""
    plan = built.plan
    return plan.spec.fields is not None or any(kind.has_densities for kind in plan.kinds)
