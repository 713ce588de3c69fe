"""Extended XYZ files, for OVITO, ASE and other programs that read text."""

import os
from collections.abc import Mapping

import numpy as np

from ..base.errors import ParameterError, require, what_is
from ..base.files import append_block, write_whole
from ..base.units import UnitSystem, unit_system
from ..io.snapshot import FrameReporter, Snapshot, scene_of
from ..model.reactions import types_in_time
from ..model.scene import Scene

_WHAT = "the XYZ file"


def write_xyz(path: str | os.PathLike, source, *, state=None, units: str = "lj", species: Mapping[str, str] | None = None) -> None:
    """Write an extended XYZ file with one frame: types, unwrapped positions, velocities if any, and the box; no bonds or masses.

    The second line is ``Lattice="..." Properties=species:S:1:pos:R:3:velo:R:3 pbc="T T T" Step=... Time=...``.

    Parameters
    ----------
    path : path-like
        File to write; overwritten.
    source : Scene, or the result of :func:`openmm_dpd.build`
    state : openmm.State or openmm.Context, optional
        Positions, velocities and box of a run; by default those of the start.  Where reactions change types, a Context has those.
    units : {"lj", "real", "metal", "si", "cgs", "micro", "nano"}
        Units of the file: nm and ps with ``lj``, angstrom and fs with ``real``, angstrom and ps with ``metal``.
    species : mapping of types to text, optional
        Text in the first column for each type, by default its name.  ASE accepts chemical symbols only.

    Raises
    ------
    ParameterError
        If the name of a type has blanks, or ``species`` does not have all types.
    OutputError
        If the file cannot be written; an existing file is kept.
    """
    now = Snapshot.of(source, state)
    write_whole(path, _block(now, unit_system(units), _called(now.scene, species)), _WHAT)


class XYZReporter(FrameReporter):
    """Reporter that writes frames to an extended XYZ file.

    Parameters
    ----------
    file : path-like
    interval : int
        Steps between frames.
    built : BuiltSystem
        The result of :func:`openmm_dpd.build`.
    units : {"lj", "real", "metal", "si", "cgs", "micro", "nano"}
        Units of the file: nm and ps with ``lj``, angstrom and fs with ``real``, angstrom and ps with ``metal``.
    species : mapping of types to text, optional
        Text in the first column for each type, by default its name.
    append : bool, default False
        Append to the file; a missing or empty one is started anew.

    Raises
    ------
    ParameterError
        If :func:`write_xyz` refuses ``species``, the interval is not a whole number >= 1, or the file to append to has other beads.
    OutputError
        If the file cannot be written; earlier frames are kept.
    """

    def __init__(self, file: str | os.PathLike, interval: int, built, *, units: str = "lj", species=None, append: bool = False):
        super().__init__(interval)
        require(append, bool, "append must be True or False")
        self._built, self._units = built, unit_system(units)
        self._species, scene = species, scene_of(built)
        called = _called(scene, species)
        if append:
            _check_file(file, [{called[name] for name in names} for names in types_in_time(scene)])
        self._path = os.fspath(file)
        append_block(self._path, "", _WHAT, anew=not append)

    def report(self, simulation, state):
        """Write one frame."""
        now = Snapshot.of(self._built, state, simulation.context)
        append_block(self._path, _block(now, self._units, _called(now.scene, self._species)), _WHAT)


def _block(now: Snapshot, units: UnitSystem, called: Mapping[str, str]) -> str:
    """Text of one frame."""
    words = [] if now.box is None else [f'Lattice="{" ".join(_number(edge) for edge in (now.box / units.length).ravel())}"']
    columns = [now.positions / units.length]
    if now.velocities is not None:
        columns.append(now.velocities / units.velocity)
    words.append("Properties=species:S:1:pos:R:3" + (":velo:R:3" if now.velocities is not None else ""))
    words.append('pbc="F F F"' if now.box is None else 'pbc="T T T"')
    words += [f"Step={now.step}", f"Time={_number(now.time / units.time)}"]
    rows = np.hstack(columns).tolist()
    lines = [f"{called[name]} {' '.join(map(_number, row))}" for name, row in zip(now.scene.types, rows, strict=True)]
    return "\n".join([str(len(rows)), " ".join(words), *lines, ""])


def _number(value: float) -> str:
    return f"{value:.12g}"


def _called(scene: Scene, given: Mapping[str, str] | None) -> Mapping[str, str]:
    """Text in the first column for each type."""
    called = {name: name for name in scene.type_names} if given is None else given
    if not isinstance(called, Mapping) or set(called) != set(scene.type_names):
        raise ParameterError(f"species must map each of the types {', '.join(scene.type_names)} to text, not {what_is(given)}")
    for text in called.values():
        if not isinstance(text, str) or not text.isprintable() or not text or " " in text:
            raise ParameterError(f"the name {text!r} cannot be in an XYZ file; give a printable one without blanks in species={{...}}")
    return called


def _check_file(file: str | os.PathLike, species: list[set[str]]) -> None:
    """Raise ParameterError if the file to append to does not begin with a frame of these beads, each called one of so many words, or ends
    within a frame."""
    if not os.path.exists(file) or os.path.getsize(file) == 0:
        return
    with open(file, encoding="utf-8", errors="replace") as lines:
        count, words = lines.readline().strip(), lines.readline()
        rows = [lines.readline() for _ in species]
    known = all(row.partition(" ")[0] in names for row, names in zip(rows, species, strict=True))
    if count != str(len(species)) or "Properties=species:S:1:pos:R:3:velo:R:3" not in words or not known:
        raise ParameterError(f"cannot append to {os.fspath(file)}: it does not begin with a frame of these {len(species)} beads")
    with open(file, "rb") as content:  # frames are about as long as the first one
        content.seek(-min(os.path.getsize(file), 2 * len(count + words + "".join(rows)) + 1000), os.SEEK_END)
        last = content.read().decode("utf-8", "replace").splitlines(keepends=True)[-len(species) - 2 :]
    if len(last) < len(species) + 2 or last[0].strip() != count or not last[-1].endswith("\n"):
        raise ParameterError(f"cannot append to {os.fspath(file)}: its last frame is incomplete; remove it, or start another file")
