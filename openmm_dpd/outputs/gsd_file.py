"""GSD files in HOOMD-blue's schema, for OVITO, freud and HOOMD-blue."""

import os
from pathlib import Path

import numpy as np

from ..base.errors import ParameterError, optional_package, require
from ..base.files import writing
from ..base.units import unit_system
from ..io.snapshot import FrameReporter, Snapshot, scene_of
from ..model.reactions import types_in_time
from ..model.scene import Scene

#: Chunk of the molecule numbers: OVITO reads logged values of particles as their properties.
MOLECULES = "particles/molecule"
_WHAT = "the GSD file"


def write_gsd(path: str | os.PathLike, source, *, state=None, units: str = "lj") -> None:
    """Write a GSD file with one frame: types, masses, charges, what joins beads, molecule numbers, box, positions and velocities.

    Numbers are in single precision.  The origin moves to the centre of the box, as in HOOMD-blue; positions are wrapped into the box, with
    image flags.  Bond types are named after the types of their beads, ``A-B``, and ``A-B-2`` and so on if they have further coefficients.
    GSD files have no pair coefficients, kT, names of molecules or immobile beads.

    Parameters
    ----------
    path : path-like
        File to write; overwritten.
    source : Scene, or the result of :func:`openmm_dpd.build`
    state : openmm.State or openmm.Context, optional
        Positions, velocities and box of a run; by default those of the start.  Where reactions change bonds and types, a Context has
        those.
    units : {"lj", "real", "metal", "si", "cgs", "micro", "nano"}
        Units of the file; nm, Da and ps with ``lj``.  Charges are always in elementary charges.

    Raises
    ------
    ParameterError
        If there is no periodic box, or the package gsd is not installed.
    OutputError
        If the file cannot be written; an existing file is kept.
    """
    target = Path(os.path.realpath(path))
    frames = _Frames(scene_of(source), units)
    beside = target.with_name(f".{target.name[:100]}.{os.getpid()}.tmp")
    try:
        with writing(path, _WHAT), frames.opened(beside, "w") as file:
            frames.append(file, Snapshot.of(source, state))
        with writing(path, _WHAT):
            os.replace(beside, target)
    finally:
        beside.unlink(missing_ok=True)


class GSDReporter(FrameReporter):
    """Reporter that writes frames to a GSD file, which is complete after every frame.

    Parameters
    ----------
    file : path-like
    interval : int
        Steps between frames.
    built : BuiltSystem
        The result of :func:`openmm_dpd.build`.
    units : {"lj", "real", "metal", "si", "cgs", "micro", "nano"}
        Units of the file; nm, Da and ps with ``lj``.
    append : bool, default False
        Append to the file; a missing one is started anew.

    Raises
    ------
    ParameterError
        If there is no periodic box, gsd is not installed, the interval is not a whole number >= 1, or the file has other beads.
    OutputError
        If the file cannot be written; earlier frames stay readable.
    """

    def __init__(self, file: str | os.PathLike, interval: int, built, *, units: str = "lj", append: bool = False):
        super().__init__(interval)
        require(append, bool, "append must be True or False")
        self._built, self._path = built, os.fspath(file)
        self._frames = _Frames(scene_of(built), units)
        append = append and os.path.exists(file)
        if append:
            self._frames.check(self._path)
        else:
            with writing(file, _WHAT), self._frames.opened(self._path, "w"):
                pass

    def report(self, simulation, state):
        """Write one frame."""
        with writing(self._path, _WHAT), self._frames.opened(self._path, "r+") as file:
            self._frames.append(file, Snapshot.of(self._built, state, simulation.context))


class _Frames:
    """Writes frames of one scene."""

    def __init__(self, scene: Scene, units: str):
        if scene.box is None:
            raise ParameterError("a GSD file needs a periodic box, and the scene has none; extended XYZ files do not")
        self._hoomd = optional_package("gsd.hoomd", "gsd", "GSD files need")
        self.scene, self._units = scene, unit_system(units)
        self._joined = {} if scene.reactions else _joined(scene)

    def opened(self, path, mode: str):
        """The open GSD file, which the caller has to close."""
        return self._hoomd.open(os.fspath(path), mode)

    def check(self, path: str) -> None:
        """Raise ParameterError if the file to append to does not have these beads."""
        try:
            with self.opened(path, "r") as file:
                first = file[0] if len(file) else None
        except (OSError, RuntimeError) as error:
            raise ParameterError(f"cannot append to {path}: it cannot be read as a GSD file ({error})") from None
        if first is None:
            return
        types = [first.particles.types[k] for k in first.particles.typeid]
        known = types_in_time(self.scene)
        if len(types) != len(known) or any(name not in names for name, names in zip(types, known, strict=True)):
            raise ParameterError(f"cannot append to {path}: it holds {len(types)} beads, which are not those of this scene")

    def append(self, file, now: Snapshot) -> None:
        """Append a frame and flush it to the file."""
        scene, units = now.scene, self._units
        assert now.box is not None
        frame = self._hoomd.Frame()
        frame.configuration.step = now.step
        x, y, z = np.diag(now.box)
        tilts = now.box[1, 0] / y, now.box[2, 0] / z, now.box[2, 1] / z
        frame.configuration.box = np.array([x / units.length, y / units.length, z / units.length, *tilts])
        images = np.floor(now.positions @ np.linalg.inv(now.box))
        beads = frame.particles
        beads.N, beads.types, beads.typeid = scene.n_beads, _coded(scene.type_names), scene.type_ids
        beads.position = (now.positions - images @ now.box - 0.5 * now.box.sum(axis=0)) / units.length
        beads.image = images.astype(np.int32)
        beads.mass = scene.bead_masses / units.mass
        if now.velocities is not None:
            beads.velocity = now.velocities / units.velocity
        if scene.charges is not None:
            beads.charge = scene.charges
        for name, (names, typeid, group) in (self._joined or _joined(scene)).items():
            part = getattr(frame, name)
            if len(group):
                part.N, part.types, part.typeid, part.group = len(group), _coded(names), typeid, group
        if scene.molecules is not None:
            frame.log[MOLECULES] = scene.molecules.astype(np.int32)
        file.append(frame)
        file.flush()


def _joined(scene: Scene) -> dict[str, tuple[list[str], np.ndarray, np.ndarray]]:
    """Names, types and beads of all terms, by the kind of what joins beads."""
    return {
        part: _named_groups(scene.types, [(group.beads, _coefficients(group)) for group in getattr(scene, part)])
        for part in ("bonds", "angles", "dihedrals", "impropers")
    }


def _coded(names: list[str]) -> list:
    """Names encoded in UTF-8, since the package gsd encodes text in ASCII only."""
    return [name if name.isascii() else name.encode() for name in names]


def _coefficients(group) -> np.ndarray:
    """Kind and coefficients of each bond, angle or dihedral as text, (K,), to tell types apart."""
    return np.array([f"{type(group).__name__} {row}" for row in group.coefficients.tolist()], dtype=object)


def _named_groups(types, groups: list) -> tuple[list[str], np.ndarray, np.ndarray]:
    """Names of the types of bonds, angles or dihedrals, and the type and beads of each term."""
    if not groups:
        return [], np.zeros(0, np.uint32), np.zeros((0, 2), np.int64)
    rows = np.concatenate([rows for rows, _ in groups])
    names: list[str] = []
    numbers: dict[tuple[str, str], int] = {}
    seen: dict[str, int] = {}
    typeid = []
    for row, coefficients in zip(rows.tolist(), np.concatenate([text for _, text in groups]), strict=True):
        called = [types[bead] for bead in row]
        pair = "-".join(min(called, called[::-1]))
        key = (pair, coefficients)
        if key not in numbers:
            seen[pair] = seen.get(pair, 0) + 1
            numbers[key] = len(names)
            names.append(pair if seen[pair] == 1 else f"{pair}-{seen[pair]}")
        typeid.append(numbers[key])
    return names, np.array(typeid, dtype=np.uint32), rows
