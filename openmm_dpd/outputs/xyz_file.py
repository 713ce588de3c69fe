"""Extended XYZ files, for OVITO, ASE and whoever reads text."""

import os
from collections.abc import Mapping

import numpy as np

from ..base.errors import ParameterError, what_is
from ..base.files import append_block, write_whole
from ..base.units import UnitSystem, unit_system
from ..io.snapshot import FrameReporter, Snapshot, scene_of
from ..model.scene import Scene

_WHAT = "the XYZ file"


def write_xyz(path: str | os.PathLike, source, *, state=None, units: str = "lj", species: Mapping[str, str] | None = None) -> None:
    """Write one frame: types, positions, velocities if there are any, and the box.

    The second line is ``Lattice="..." Properties=species:S:1:pos:R:3:velo:R:3 pbc="T T T" Step=... Time=...``.  Positions are not folded
    into the box.  Bonds and masses have no place in this format.

    Parameters
    ----------
    path : path-like
        Overwritten.
    source : Scene, or what :func:`openmm_dpd.build` returned
    state : openmm.State, optional
        Positions, velocities and box of a run; by default those of the start.
    units : {"lj", "real", "metal"}
        Units of the file: nm and ps with ``lj``, angstrom and fs with ``real``, angstrom and ps with ``metal``.
    species : mapping of types to text, optional
        What the first column has for a type; by default its name.  ASE takes chemical symbols only.

    Raises
    ------
    ParameterError
        If the name of a type has blanks, or ``species`` does not name each type.
    OutputError
        If the file cannot be written; one that was there is kept.
    """
    now = Snapshot.of(source, state)
    write_whole(path, _block(now, unit_system(units), _species(now.scene, species)), _WHAT)


class XYZReporter(FrameReporter):
    """Writes frames to an extended XYZ file, for ``simulation.reporters``.

    Parameters
    ----------
    file : path-like
    interval : int
        Steps between frames.
    built : BuiltSystem
        What :func:`openmm_dpd.build` returned.
    units : {"lj", "real", "metal"}
        As for :func:`write_xyz`.
    species : mapping of types to text, optional
        As for :func:`write_xyz`.
    append : bool, default False
        Go on with the frames of a file that is there; one that is not there or empty is begun.

    Raises
    ------
    ParameterError
        As :func:`write_xyz`, if the interval is no whole number of at least 1, or if a file to go on with is one of other beads.
    OutputError
        If the file cannot be written; the frames before stay.
    """

    def __init__(self, file: str | os.PathLike, interval: int, built, *, units: str = "lj", species=None, append: bool = False):
        super().__init__(interval)
        self._built, self._units = built, unit_system(units)
        self._species = _species(scene_of(built), species)
        if append:
            _check_file(file, self._species)
        self._path = os.fspath(file)
        append_block(self._path, "", _WHAT, anew=not append)

    def report(self, simulation, state):
        """Write one frame."""
        append_block(self._path, _block(Snapshot.of(self._built, state), self._units, self._species), _WHAT)


def _block(now: Snapshot, units: UnitSystem, species: list[str]) -> str:
    words = [] if now.box is None else [f'Lattice="{" ".join(_number(edge) for edge in (now.box / units.length).ravel())}"']
    columns = [now.positions / units.length]
    if now.velocities is not None:
        columns.append(now.velocities / units.velocity)
    words.append("Properties=species:S:1:pos:R:3" + (":velo:R:3" if now.velocities is not None else ""))
    words.append('pbc="F F F"' if now.box is None else 'pbc="T T T"')
    words += [f"Step={now.step}", f"Time={_number(now.time / units.time)}"]
    rows = np.hstack(columns).tolist()
    lines = [f"{name} {' '.join(map(_number, row))}" for name, row in zip(species, rows, strict=True)]
    return "\n".join([str(len(rows)), " ".join(words), *lines, ""])


def _number(value: float) -> str:
    return f"{value:.12g}"


def _species(scene: Scene, given: Mapping[str, str] | None) -> list[str]:
    """First column of each bead."""
    called = {name: name for name in scene.type_names} if given is None else given
    if not isinstance(called, Mapping) or set(called) != set(scene.type_names):
        raise ParameterError(f"species must map each of the types {', '.join(scene.type_names)} to text, not {what_is(given)}")
    for text in called.values():
        if not isinstance(text, str) or not text.isprintable() or not text or " " in text:
            raise ParameterError(f"the name {text!r} cannot be in an XYZ file; species={{...}} gives one that is printable without blanks")
    return [called[name] for name in scene.types]


def _check_file(file: str | os.PathLike, species: list[str]) -> None:
    """Raise ParameterError if a file to go on with does not begin with a frame of these beads, or ends within one."""
    if not os.path.exists(file) or os.path.getsize(file) == 0:
        return
    with open(file, encoding="utf-8", errors="replace") as lines:
        count, words = lines.readline().strip(), lines.readline()
        rows = [lines.readline() for _ in species]
        found = [row.partition(" ")[0] for row in rows]
    if count != str(len(species)) or "Properties=species:S:1:pos:R:3:velo:R:3" not in words or found != species:
        raise ParameterError(f"cannot append to {os.fspath(file)}: it does not begin with a frame of these {len(species)} beads")
    with open(file, "rb") as content:  # frames are about as long as the first one
        content.seek(-min(os.path.getsize(file), 2 * len(count + words + "".join(rows)) + 1000), os.SEEK_END)
        last = content.read().decode("utf-8", "replace").splitlines(keepends=True)[-len(species) - 2 :]
    if len(last) < len(species) + 2 or last[0].strip() != count or not last[-1].endswith("\n"):
        raise ParameterError(f"cannot append to {os.fspath(file)}: its last frame was cut; take it out, or begin another file")
