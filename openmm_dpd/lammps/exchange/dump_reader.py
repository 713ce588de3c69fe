"""Reading LAMMPS's text dumps (dump styles custom and atom) with all that they hold.

mdtraj reads such files as well, but takes lengths as angstrom, wants x, y, z, and drops velocities, forces, image flags and
per-bead values.  For DCD files it is all that is needed: :func:`openmm_dpd.trajectory.load`.
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from ...errors import DeckError, ParameterError
from ...model.scene import Scene
from ...units import UnitSystem, unit_system
from ..state.box import Box
from .frames import LammpsFrames

#: Columns of the fields of beads, as exported decks and this package's own runs name them.
NAMES = {
    "c_internal[1]": "u_cond",
    "c_internal[2]": "u_mech",
    "c_internal[4]": "theta",
    "c_temperature": "temperature",
    "uCond": "u_cond",
    "uMech": "u_mech",
    "dpdTheta": "theta",
}


@dataclass(frozen=True, eq=False)
class _Frame:
    line: int
    step: int
    box: Box | None
    corner: np.ndarray
    vectors: np.ndarray
    periodic: tuple[bool, bool, bool]
    columns: tuple[str, ...]
    values: np.ndarray
    units: str | None


def read_lammps_dump(
    path: str | Path, scene: Scene | None = None, *, units: str = "lj", names: Mapping[str, str] | None = None
) -> LammpsFrames:
    """Frames of a text dump.

    Beads are sorted by id, lengths and velocities are turned into nm and nm/ps, scaled positions into positions, and image flags are
    kept, so that ``unwrapped`` has the periodic images restored.

    Parameters
    ----------
    path : str or Path
        The dump.
    scene : Scene, optional
        The scene it belongs to; needed for :meth:`LammpsFrames.scene` and :meth:`LammpsFrames.trajectory`, and checked against the file.
    units : {"lj", "real", "metal"}
        Units of the run that wrote it.
    names : mapping of str to str, optional
        Columns of your own for fields of beads: {"c_mine[4]": "theta"}; the values are those of :data:`NAMES`, and ``c1``, ``c2``, ...
        for concentrations.

    Raises
    ------
    DeckError
        With file and line, if the file is cut off, not a text dump, or frames hold different beads.
    ParameterError
        If it does not fit the scene.
    """
    path = Path(path)
    system = unit_system(units)
    frames = list(_frames(path))
    if not frames:
        raise DeckError("there is no frame in it", str(path))
    said = next((frame.units for frame in frames if frame.units), None)
    if said is not None and said != units:
        raise ParameterError(f"{path} says that its units are {said}, not {units}; give units={said!r}")
    found = _assembled(path, frames, system, {**NAMES, **(names or {})}, scene)
    if scene is not None:
        found.check(scene)
    return found


# -- text to frames -----------------------------------------------------------------------------------------------------------
def _frames(path: Path) -> Iterator[_Frame]:
    try:
        lines = path.read_text(encoding="utf-8").splitlines()
    except UnicodeDecodeError:
        raise DeckError("this is no text dump; binary and compressed dumps are not read", str(path)) from None
    except OSError as error:
        raise DeckError(f"cannot read the file: {error.strerror}", str(path)) from None
    at, parts, units = 0, dict[str, tuple[int, list[str], list[str]]](), None
    while at < len(lines):
        if not lines[at].strip():
            at += 1
            continue
        if not lines[at].startswith("ITEM: "):
            raise DeckError(f"expected a line 'ITEM: ...', not '{lines[at][:60]}'", str(path), at + 1)
        title, words = _title(lines[at])
        count = 3 if title == "BOX BOUNDS" else _count(parts, path, at) if title == "ATOMS" else 1
        body = lines[at + 1 : at + 1 + count]
        if len(body) < count:
            raise DeckError(f"the file is cut off: {count} lines should follow 'ITEM: {title}', {len(body)} do", str(path), at + 1)
        if title == "UNITS":
            units = body[0].strip()
        parts[title] = (at + 1, words, body)
        at += 1 + count
        if title == "ATOMS":
            yield _frame(path, parts, units)
            parts = {}
    if parts and set(parts) - {"UNITS", "TIME"}:
        raise DeckError("the file is cut off: its last frame has no atoms", str(path), len(lines))


def _title(line: str) -> tuple[str, list[str]]:
    words = line.split()[1:]
    for title in ("BOX BOUNDS", "NUMBER OF ATOMS"):
        if words[:-1] == title.split() or words[: len(title.split())] == title.split():
            return title, words[len(title.split()) :]
    return words[0] if words else "", words[1:]


def _count(parts: dict, path: Path, at: int) -> int:
    missing = [title for title in ("TIMESTEP", "NUMBER OF ATOMS", "BOX BOUNDS") if title not in parts]
    if missing:
        raise DeckError(f"'ITEM: ATOMS' without 'ITEM: {missing[0]}' before it", str(path), at + 1)
    return _whole(parts["NUMBER OF ATOMS"], path)


def _whole(part: tuple[int, list[str], list[str]], path: Path) -> int:
    line, _, body = part
    try:
        return int(body[0])
    except ValueError:
        raise DeckError(f"expected a whole number, not '{body[0]}'", str(path), line + 1) from None


def _frame(path: Path, parts: dict, units: str | None) -> _Frame:
    line, columns, body = parts["ATOMS"]
    box, corner, vectors, periodic = _box(path, parts["BOX BOUNDS"])
    values = np.empty((len(body), len(columns)))
    for k, text in enumerate(body):
        words = text.split()
        if len(words) != len(columns):
            raise DeckError(f"expected {len(columns)} values ({' '.join(columns)}), not '{text.strip()[:80]}'", str(path), line + 1 + k)
        try:
            values[k] = [float(word) for word in words]
        except ValueError:
            values[k] = [_value(word, name, path, line + 1 + k) for word, name in zip(words, columns, strict=True)]
    return _Frame(line, _whole(parts["TIMESTEP"], path), box, corner, vectors, periodic, tuple(columns), values, units)


def _value(word: str, column: str, path: Path, line: int) -> float:
    """A number; names of elements and the like become NaN."""
    try:
        return float(word)
    except ValueError:
        if column in ("element", "typelabel", "proc"):
            return float("nan")
        raise DeckError(f"expected a number in column {column}, not '{word}'", str(path), line) from None


def _box(path: Path, part: tuple[int, list[str], list[str]]) -> tuple[Box | None, np.ndarray, np.ndarray, tuple[bool, bool, bool]]:
    line, words, body = part
    if words[:2] == ["abc", "origin"]:
        raise DeckError("boxes of general shape (triclinic/general) are not read; write the dump without it", str(path), line)
    tilted = words[:3] == ["xy", "xz", "yz"]
    flags = words[3:] if tilted else words
    try:
        rows = np.array([[float(word) for word in row.split()] for row in body])
        if rows.shape != (3, 3 if tilted else 2) or len(flags) not in (0, 3):
            raise ValueError
    except ValueError:
        raise DeckError(f"expected three lines 'low high{' tilt' if tilted else ''}' of the box", str(path), line + 1) from None
    periodic = tuple(flag == "pp" for flag in flags) if flags else (True, True, True)
    low, high = rows[:, 0].copy(), rows[:, 1].copy()
    tilt = rows[:, 2] if tilted else np.zeros(3)
    if tilted:
        # the bounds are those of the smallest orthogonal box around the tilted one
        xy, xz, yz = tilt
        shifts = [0.0, xy, xz, xy + xz]
        low -= [min(shifts), min(0.0, yz), 0.0]
        high -= [max(shifts), max(0.0, yz), 0.0]
    try:
        box = Box(low, high, tilt, tilted)
    except ParameterError as error:
        raise DeckError(str(error), str(path), line + 1) from None
    return box, low, box.vectors, periodic  # type: ignore[return-value]


# -- frames to arrays ---------------------------------------------------------------------------------------------------------
def _assembled(path: Path, frames: list[_Frame], units: UnitSystem, names: dict[str, str], scene: Scene | None) -> LammpsFrames:
    first = frames[0]
    if "id" not in first.columns:
        raise DeckError("there is no column id, so the order of the beads is not known", str(path), first.line)
    ids: np.ndarray | None = None
    stacked = np.empty((len(frames), *first.values.shape))
    for k, frame in enumerate(frames):
        if frame.columns != first.columns:
            raise DeckError(f"the columns change here: {' '.join(frame.columns)}", str(path), frame.line)
        order = np.argsort(frame.values[:, first.columns.index("id")], kind="stable")
        mine = frame.values[order, first.columns.index("id")]
        twice = np.flatnonzero(np.diff(mine) == 0)
        if len(twice):
            raise DeckError(f"atom id {mine[twice[0]]:g} appears twice in step {frame.step}", str(path), frame.line)
        if ids is not None and not np.array_equal(ids, mine):
            raise DeckError(f"step {frame.step} holds other beads than step {first.step} (were some lost?)", str(path))
        ids, stacked[k] = mine, frame.values[order]
    assert ids is not None
    column = {name: stacked[:, :, k] for k, name in enumerate(first.columns)}

    def three(pattern: str) -> np.ndarray | None:
        wanted = [pattern.format(axis) for axis in "xyz"]
        return np.stack([column.pop(name) for name in wanted], axis=-1) if all(name in column for name in wanted) else None

    images = three("i{}")
    positions, unwrapped = _positions(path, frames, three, images, units.length)
    velocities, forces = three("v{}"), three("f{}")
    kinds = column.pop("type", None)
    column.pop("id")
    vectors = np.array([frame.vectors for frame in frames]) * units.length
    fields = _fields(column, names, units)
    return LammpsFrames(
        path=path,
        steps=np.array([frame.step for frame in frames]),
        ids=ids.astype(np.int64),
        positions=positions,
        unwrapped=unwrapped,
        images=None if images is None else images.astype(np.int64),
        velocities=None if velocities is None else velocities * units.velocity,
        forces=None if forces is None else forces * units.force,
        types=None if kinds is None else kinds[0].astype(np.int64),
        boxes=_reduced(vectors, units) if any(first.periodic) else None,
        corners=np.array([frame.corner for frame in frames]) * units.length,
        fields=fields,
        columns=column,
        periodic=first.periodic,
        scene_=scene,
    )


def _reduced(vectors: np.ndarray, units: UnitSystem) -> np.ndarray:
    """The same lattices in OpenMM's reduced form."""
    return np.array([Box(np.zeros(3), np.diag(v), np.array([v[1, 0], v[2, 0], v[2, 1]])).reduced_vectors for v in vectors])


def _positions(path: Path, frames: list[_Frame], three, images, length: float) -> tuple[np.ndarray, np.ndarray | None]:
    """Positions as they are, and carried to their images if that is known; nm."""
    vectors = np.array([frame.vectors for frame in frames])
    corner = np.array([frame.corner for frame in frames])[:, None, :]
    found = {pattern: three(pattern) for pattern in ("{}", "{}u", "{}s", "{}su")}
    for scaled, plain in (("{}s", "{}"), ("{}su", "{}u")):
        if found[plain] is None and found[scaled] is not None:
            found[plain] = corner + found[scaled] @ vectors
    inside, outside = found["{}"], found["{}u"]
    if inside is None and outside is None:
        raise DeckError(
            f"there are no positions in it: the columns are {' '.join(frames[0].columns)}; let LAMMPS write x y z ix iy iz",
            str(path),
            frames[0].line,
        )
    if outside is None and images is not None:
        outside = inside + images @ vectors
    if inside is None:
        inside = outside
    return inside * length, None if outside is None else outside * length


def _fields(column: dict[str, np.ndarray], names: dict[str, str], units: UnitSystem) -> dict[str, np.ndarray]:
    factors = {"u_cond": units.energy, "u_mech": units.energy, "theta": units.thermal_energy, "temperature": units.thermal_energy}
    found = {}
    for name in list(column):
        species = re.fullmatch(r"c_species(\d+)", name)
        what = names.get(name) or (f"c{species[1]}" if species else None)
        if what is not None:
            found[what] = column.pop(name) * factors.get(what, 1.0)
    return found
