"""Reading back the data file that LAMMPS's ``write_data`` leaves: the state of the beads, for a scene that is known."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np

from ...errors import DeckError, ParameterError
from ...model.internal import Concentrations
from ...model.scene import Scene
from ...units import UNIT_SYSTEMS, UnitSystem
from ..language.lexer import read_text
from ..state.box import Box
from .export_beads import atom_styles, columns_of
from .frames import LammpsFrames

_HEADER = re.compile(r"^\s*(?P<values>[-+0-9.eE ]+?)\s+(?P<name>[a-z][a-z ]*)$")


def scene_from_data(path: str | Path, scene: Scene, *, units: str | None = None, styles: tuple[str, ...] | None = None) -> Scene:
    """The scene with positions (carried to their images), velocities, box and the fields of the beads from a data file.

    Parameters are those of :func:`read_lammps_data`.
    """
    return read_lammps_data(path, scene, units=units, styles=styles).scene()


def read_lammps_data(path: str | Path, scene: Scene, *, units: str | None = None, styles: tuple[str, ...] | None = None) -> LammpsFrames:
    """State of the beads in a data file, as a single frame.

    Coefficients, bonds and angles of the file are not looked at: they are the scene's.

    Parameters
    ----------
    path : str or Path
        The data file.
    scene : Scene
        The scene it belongs to.
    units : {"lj", "real", "metal"}, optional
        Its units; by default what its first line says (LAMMPS and this package write it there), else ``lj``.
    styles : tuple of str, optional
        Its atom style, as a tuple of one or (behind ``hybrid``) several; by default what the file says, and what
        :func:`openmm_dpd.lammps.export_lammps` takes for the scene.

    Raises
    ------
    DeckError
        With file and line, if a section is missing or has the wrong shape.
    ParameterError
        If it does not fit the scene.
    """
    path = Path(path)
    lines = read_text(path, title=True).splitlines()
    system = _units(path, lines, units)
    header, sections = _sections(path, lines)
    n = int(header.get("atoms", [0])[0])
    if not n or "Atoms" not in sections:
        raise DeckError("this is no data file with atoms: it has no 'Atoms' section", str(path))
    hint, start = sections["Atoms"]
    chosen = styles or _styles(path, scene, hint, start)
    n_species = scene.internal.n_species if isinstance(scene.internal, Concentrations) else 0
    columns = columns_of(chosen, n_species)
    rows, more = _rows(path, lines, start, n, len(columns), f"an atom of atom_style {' '.join(chosen)}: {' '.join(columns)}")
    order = np.argsort(rows[:, 0], kind="stable")
    column = {name: rows[order, k] for k, name in enumerate(columns)}
    ids = column["id"].astype(np.int64)
    if np.any(np.diff(ids) == 0):
        raise DeckError(f"atom id {ids[np.argmax(np.diff(ids) == 0)]} appears twice", str(path), start)
    box = _box(path, header)
    inside = np.column_stack([column[axis] for axis in "xyz"])
    images = None if more is None else more[order].astype(np.int64)
    found = LammpsFrames(
        path=path,
        steps=np.array([_step(lines[0])]),
        ids=ids,
        positions=inside[None] * system.length,
        unwrapped=None if images is None else (inside + images @ box.vectors)[None] * system.length,
        images=None if images is None else images[None],
        velocities=_velocities(path, lines, sections, ids, system),
        forces=None,
        types=column["type"].astype(np.int64),
        boxes=None if scene.box is None else box.reduced_vectors[None] * system.length,
        corners=box.low[None] * system.length,
        fields=_fields(column, system),
        periodic=(scene.box is not None and not scene.walls,) * 3,
        scene_=scene,
    )
    found.check(scene)
    return found


def _units(path: Path, lines: list[str], units: str | None) -> UnitSystem:
    said = re.search(r"units = (\w+)", lines[0] if lines else "")
    if units is None:
        units = said[1] if said else "lj"
    elif said and said[1] != units:
        raise ParameterError(f"{path} says that its units are {said[1]}, not {units}")
    if units not in UNIT_SYSTEMS:
        raise ParameterError(f"unknown units {units!r}; they must be one of {', '.join(UNIT_SYSTEMS)}")
    return UNIT_SYSTEMS[units]


def _step(line: str) -> int:
    said = re.search(r"timestep = (\d+)", line)
    return int(said[1]) if said else 0


def _sections(path: Path, lines: list[str]) -> tuple[dict[str, list[float]], dict[str, tuple[str, int]]]:
    """Header values by name, and for each section its style and the number of its first line (from 1)."""
    header: dict[str, list[float]] = {}
    sections: dict[str, tuple[str, int]] = {}
    for number, raw in enumerate(lines[1:], start=2):
        text, _, comment = raw.partition("#")
        if text[:1].isalpha():
            sections[text.strip()] = (comment.strip(), number + 1)
        elif not sections and (match := _HEADER.match(text.rstrip())):
            try:
                header[match["name"]] = [float(word) for word in match["values"].split()]
            except ValueError:
                raise DeckError(f"expected numbers before '{match['name']}', not '{match['values']}'", str(path), number) from None
    return header, sections


def _styles(path: Path, scene: Scene, hint: str, line: int) -> tuple[str, ...]:
    for vest in (False, True):
        mine = atom_styles(scene, vest)
        if not hint or hint == (mine[0] if len(mine) == 1 else "hybrid"):
            return mine
    if hint != "hybrid":
        return (hint,)
    raise DeckError("the atom style is hybrid, but the scene does not say of what; give styles=(...)", str(path), line - 1)


def _rows(path: Path, lines: list[str], start: int, count: int, width: int, usage: str) -> tuple[np.ndarray, np.ndarray | None]:
    """Numbers of a section, and the three image flags behind them if there are any."""
    found: list[list[float]] = []
    for number in range(start, len(lines) + 1):
        words = lines[number - 1].partition("#")[0].split()
        if not words:
            continue
        if len(found) == count:
            break
        try:
            row = [float(word) for word in words]
        except ValueError:
            raise DeckError(f"expected {usage}, not '{lines[number - 1].strip()[:80]}'", str(path), number) from None
        if len(row) not in (width, width + 3) or (found and len(row) != len(found[0])):
            raise DeckError(f"expected {usage} [ix iy iz], not {len(row)} values", str(path), number)
        found.append(row)
    if len(found) < count:
        raise DeckError(f"the file is cut off: {count} lines should follow, {len(found)} do", str(path), start)
    array = np.array(found)
    return array[:, :width], array[:, width:] if array.shape[1] > width else None


def _box(path: Path, header: dict[str, list[float]]) -> Box:
    try:
        low, high = np.array([header[f"{axis}lo {axis}hi"] for axis in "xyz"]).T
    except (KeyError, ValueError):
        raise DeckError("the header lacks 'xlo xhi', 'ylo yhi' or 'zlo zhi'", str(path)) from None
    tilt = header.get("xy xz yz")
    return Box(low, high, np.array(tilt or [0.0, 0.0, 0.0]), tilt is not None)


def _velocities(path: Path, lines: list[str], sections: dict, ids: np.ndarray, units: UnitSystem) -> np.ndarray | None:
    if "Velocities" not in sections:
        return None
    start = sections["Velocities"][1]
    rows, _ = _rows(path, lines, start, len(ids), 4, "id vx vy vz")
    rows = rows[np.argsort(rows[:, 0], kind="stable")]
    if not np.array_equal(rows[:, 0], ids):
        raise DeckError("the section Velocities names other atoms than the section Atoms", str(path), start)
    return rows[None, :, 1:] * units.velocity


def _fields(column: dict[str, np.ndarray], units: UnitSystem) -> dict[str, np.ndarray]:
    factors = {"theta": units.thermal_energy, "temperature": units.thermal_energy, "capacity": 1.0}
    found = {name: column[name][None] * factor for name, factor in factors.items() if name in column}
    return found | {name: values[None] for name, values in column.items() if re.fullmatch(r"c\d+", name)}
