"""Reads LAMMPS's text dumps (dump styles custom and atom) with all their columns.

mdtraj also reads such files, but assumes lengths in angstrom, requires x, y, z, and drops velocities, forces, image flags and per-bead
values. For DCD files it is sufficient: :func:`openmm_dpd.io.trajectory.load`.
"""

import re
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from ...base.errors import DeckError, ParameterError
from ...base.units import UnitSystem, unit_system
from ...model.scene import Scene
from ..language.lexer import TextFile, file_content
from ..state.box import Box
from .frames import LammpsFrames

#: Columns of bead fields, as named by exported decks and by this package's runs.
NAMES = {
    **{"c_internal[1]": "u_cond", "c_internal[2]": "u_mech", "c_internal[4]": "theta", "c_temperature": "temperature"},
    **{"uCond": "u_cond", "uMech": "u_mech", "dpdTheta": "theta"},
}


#: Columns that may hold words, which become NaN.
_TEXTS = ("element", "typelabel", "proc")


@dataclass(frozen=True, eq=False)
class _Frame:
    line: int
    step: int
    box: Box
    periodic: tuple[bool, bool, bool]
    columns: tuple[str, ...]
    values: np.ndarray
    units: str | None


def read_lammps_dump(
    path: str | Path, scene: Scene | None = None, *, units: str = "lj", names: Mapping[str, str] | None = None
) -> LammpsFrames:
    """Frames of a text dump.

    Beads are sorted by id, lengths and velocities are converted to nm and nm/ps, and scaled positions to positions; image flags are kept,
    so that ``unwrapped`` positions are available.

    Parameters
    ----------
    path : str or Path
        The dump.
    scene : Scene, optional
        The scene of the run; needed for :meth:`LammpsFrames.scene` and :meth:`LammpsFrames.trajectory`, and checked against the file.
    units : {"lj", "real", "metal", "si", "cgs", "micro", "nano"}
        Units of the run that wrote it.
    names : mapping of str to str, optional
        Additional columns of bead fields, such as {"c_mine[4]": "theta"}; values are those of :data:`NAMES`, and ``c1``, ``c2``, ... for
        concentrations.

    Raises
    ------
    DeckError
        With file and line, if the file is truncated, not a text dump, or its frames hold different beads.
    ParameterError
        If it does not match the scene.
    """
    path, system = Path(path), unit_system(units)
    file = _text(path)
    frames = list(_frames(file))
    if not frames:
        raise file.error("the file contains no frames")
    said = next((frame.units for frame in frames if frame.units), None)
    if said is not None and said != units:
        raise ParameterError(f"{path} states units {said}, not {units}; give units={said!r}")
    system = system.for_box(float(frames[0].box.edges.max()))
    found = _assembled(file, frames, system, {**NAMES, **(names or {})}, scene)
    if scene is not None:
        found.check(scene)
    return found


# -- text to frames -----------------------------------------------------------------------------------------------------------
@dataclass
class _Part:
    """An item of a dump: the number of its line ``ITEM: ...``, the words after the title, and the lines below."""

    line: int
    words: list[str]
    body: list[str]


def _text(path: Path) -> TextFile:
    try:
        return TextFile(path, file_content(path).decode().splitlines())
    except UnicodeDecodeError:
        raise DeckError("not a text dump; binary dumps are not supported", str(path)) from None


def _frames(file: TextFile) -> Iterator[_Frame]:
    lines, at, parts, units = file.lines, 0, dict[str, _Part](), None
    while at < len(lines):
        if not lines[at].strip():
            at += 1
            continue
        if not lines[at].startswith("ITEM: "):
            raise file.error(f"expected a line 'ITEM: ...', not '{lines[at][:60]}'", at + 1)
        title, words = _title(lines[at])
        count = 3 if title == "BOX BOUNDS" else _count(file, parts, at) if title == "ATOMS" else 1
        body = lines[at + 1 : at + 1 + count]
        if len(body) < count:
            raise file.error(f"the file is truncated: expected {count} lines after 'ITEM: {title}', but found {len(body)}", at + 1)
        if title == "UNITS":
            units = body[0].strip()
        parts[title] = _Part(at + 1, words, body)
        at += 1 + count
        if title == "ATOMS":
            yield _frame(file, parts, units)
            parts = {}
    if parts and set(parts) - {"UNITS", "TIME"}:
        raise file.error("the file is truncated: its last frame has no atoms", len(lines))


def _title(line: str) -> tuple[str, list[str]]:
    words = line.split()[1:]
    for title in (["BOX", "BOUNDS"], ["NUMBER", "OF", "ATOMS"]):
        if words[: len(title)] == title:
            return " ".join(title), words[len(title) :]
    return words[0] if words else "", words[1:]


def _count(file: TextFile, parts: dict[str, _Part], at: int) -> int:
    missing = [title for title in ("TIMESTEP", "NUMBER OF ATOMS", "BOX BOUNDS") if title not in parts]
    if missing:
        raise file.error(f"'ITEM: ATOMS' without 'ITEM: {missing[0]}' before it", at + 1)
    return _whole(file, parts["NUMBER OF ATOMS"])


def _whole(file: TextFile, part: _Part) -> int:
    return file.integers((part.line + 1, []), part.body, "a whole number")[0]


def _frame(file: TextFile, parts: dict[str, _Part], units: str | None) -> _Frame:
    line, columns, body = (atoms := parts["ATOMS"]).line, atoms.words, atoms.body
    box, periodic = _box(file, parts["BOX BOUNDS"])
    values = np.empty((len(body), len(columns)))
    for k, text in enumerate(body):
        words = text.split()
        if len(words) != len(columns):
            raise file.error(f"expected {len(columns)} values ({' '.join(columns)}), not '{text.strip()[:80]}'", line + 1 + k)
        try:
            values[k] = list(map(_number, words, columns))
        except ValueError as error:
            raise file.error(str(error), line + 1 + k) from None
    return _Frame(line, _whole(file, parts["TIMESTEP"]), box, periodic, tuple(columns), values, units)


def _number(word: str, column: str) -> float:
    try:
        return float(word)
    except ValueError:
        if column in _TEXTS:
            return np.nan
        raise ValueError(f"expected a number in column {column}, not '{word}'") from None


def _box(file: TextFile, part: _Part) -> tuple[Box, tuple[bool, bool, bool]]:
    line, words = part.line, part.words
    if words[:2] == ["abc", "origin"]:
        raise file.error("boxes of general shape (triclinic/general) are not supported; write the dump without it", line)
    tilted = words[:3] == ["xy", "xz", "yz"]
    flags = words[3:] if tilted else words
    try:
        rows = np.array([[float(word) for word in row.split()] for row in part.body])
        if rows.shape != (3, 3 if tilted else 2) or len(flags) not in (0, 3):
            raise ValueError
    except ValueError:
        raise file.error(f"expected three lines 'low high{' tilt' if tilted else ''}' of the box", line + 1) from None
    low, high, tilt = rows[:, 0].copy(), rows[:, 1].copy(), rows[:, 2] if tilted else np.zeros(3)
    if tilted:
        # the bounds belong to the smallest orthogonal box around the tilted one
        xy, xz, yz = tilt
        shifts = [0.0, xy, xz, xy + xz]
        low -= [min(shifts), min(0.0, yz), 0.0]
        high -= [max(shifts), max(0.0, yz), 0.0]
    try:
        x, y, z = (flag == "pp" for flag in flags or ["pp"] * 3)
        return Box(low, high, tilt, tilted), (x, y, z)
    except ParameterError as error:
        raise file.error(str(error), line + 1) from None


# -- frames to arrays ---------------------------------------------------------------------------------------------------------
def _assembled(file: TextFile, frames: list[_Frame], units: UnitSystem, names: dict[str, str], scene: Scene | None) -> LammpsFrames:
    first = frames[0]
    if "id" not in first.columns:
        raise file.error("there is no column id, so the order of the beads is unknown", first.line)
    ids: np.ndarray | None = None
    stacked = np.empty((len(frames), *first.values.shape))
    for k, frame in enumerate(frames):
        if frame.columns != first.columns:
            raise file.error(f"the columns change to {' '.join(frame.columns)}", frame.line)
        order = np.argsort(frame.values[:, first.columns.index("id")], kind="stable")
        mine = frame.values[order, first.columns.index("id")]
        twice = np.flatnonzero(np.diff(mine) == 0)
        if len(twice):
            raise file.error(f"atom id {mine[twice[0]]:g} appears twice in step {frame.step}", frame.line)
        if ids is not None and not np.array_equal(ids, mine):
            raise file.error(f"step {frame.step} contains different beads from step {first.step} (were some lost?)")
        ids, stacked[k] = mine, frame.values[order]
    assert ids is not None
    column = {name: stacked[:, :, k] for k, name in enumerate(first.columns)}

    def three(pattern: str) -> np.ndarray | None:
        wanted = [pattern.format(axis) for axis in "xyz"]
        return np.stack([column.pop(name) for name in wanted], axis=-1) if all(name in column for name in wanted) else None

    images = three("i{}")
    positions, unwrapped = _positions(file, frames, three, images, units.length)
    velocities, forces = three("v{}"), three("f{}")
    kinds = column.pop("type", None)
    column.pop("id")
    fields = _fields(column, names, units)
    return LammpsFrames(
        path=file.path,
        steps=np.array([frame.step for frame in frames]),
        ids=ids.astype(np.int64),
        positions=positions,
        unwrapped=unwrapped,
        images=None if images is None else images.astype(np.int64),
        velocities=None if velocities is None else velocities * units.velocity,
        forces=None if forces is None else forces * units.force,
        types=None if kinds is None else kinds[0].astype(np.int64),
        boxes=np.array([frame.box.reduced_vectors for frame in frames]) * units.length if any(first.periodic) else None,
        corners=np.array([frame.box.low for frame in frames]) * units.length,
        fields=fields,
        columns=column,
        periodic=first.periodic,
        scene_=scene,
    )


def _positions(file: TextFile, frames: list[_Frame], three, images, length: float) -> tuple[np.ndarray, np.ndarray | None]:
    """Positions as in the file, and unwrapped positions if they are known; nm."""
    vectors = np.array([frame.box.vectors for frame in frames])
    corner = np.array([frame.box.low for frame in frames])[:, None, :]
    found = {pattern: three(pattern) for pattern in ("{}", "{}u", "{}s", "{}su")}
    for scaled, plain in (("{}s", "{}"), ("{}su", "{}u")):
        if found[plain] is None and found[scaled] is not None:
            found[plain] = corner + found[scaled] @ vectors
    inside, outside = found["{}"], found["{}u"]
    if inside is None and outside is None:
        columns = " ".join(frames[0].columns)
        raise file.error(f"the file has no positions: its columns are {columns}; have LAMMPS write x y z ix iy iz", frames[0].line)
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
