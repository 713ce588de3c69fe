"""Reading back the data file that LAMMPS's ``write_data`` leaves: the state of the beads, for a scene that is known."""

import re
from pathlib import Path

import numpy as np

from ...errors import ParameterError
from ...model.scene import Scene
from ...units import UnitSystem, unit_system
from ..files.atom_styles import ATOM_STYLES
from ..files.data_file import DataReader
from .export_beads import atom_styles, species_of
from .frames import LammpsFrames


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
    reader = DataReader(path, lenient=True)
    title = reader.file.lines[0] if reader.file.lines else ""
    system = _units(path, title, units)
    if not reader.count("atoms") or "Atoms" not in reader.sections:
        raise reader.fail("this is no data file with atoms: it has no 'Atoms' section")
    column, positions, flags = reader.atoms(styles or _styles(reader, scene), species_of(scene))
    velocities = reader.velocities(column["id"])
    order = np.argsort(column["id"], kind="stable")
    column = {name: values[order] for name, values in column.items()}
    box, inside = reader.box(), positions[order]
    images = None if flags is None else flags[order]
    said = re.search(r"timestep = (\d+)", title)
    found = LammpsFrames(
        path=path,
        steps=np.array([int(said[1]) if said else 0]),
        ids=column["id"],
        positions=inside[None] * system.length,
        unwrapped=None if images is None else box.unwrap(inside, images)[None] * system.length,
        images=None if images is None else images[None],
        velocities=None if velocities is None else velocities[order][None] * system.velocity,
        forces=None,
        types=column["type"],
        boxes=None if scene.box is None else box.reduced_vectors[None] * system.length,
        corners=box.low[None] * system.length,
        fields=_fields(column, system),
        periodic=(scene.box is not None and not scene.walls,) * 3,
        scene_=scene,
    )
    found.check(scene)
    return found


def _units(path: Path, title: str, units: str | None) -> UnitSystem:
    said = re.search(r"units = (\w+)", title)
    if units is None:
        units = said[1] if said else "lj"
    elif said and said[1] != units:
        raise ParameterError(f"{path} says that its units are {said[1]}, not {units}")
    return unit_system(units)


def _styles(reader: DataReader, scene: Scene) -> tuple[str, ...]:
    hint, line = reader.hints["Atoms"], reader.sections["Atoms"][0]
    for mdpd in (False, True):
        mine = atom_styles(scene, mdpd)
        if not hint or hint == (mine[0] if len(mine) == 1 else "hybrid"):
            return mine
    if hint == "hybrid":
        raise reader.fail("the atom style is hybrid, but the scene does not say of what; give styles=(...)", line)
    if hint not in ATOM_STYLES:
        raise reader.fail(f"atom_style {hint} is not supported; supported are {', '.join(ATOM_STYLES)}", line)
    return (hint,)


def _fields(column: dict[str, np.ndarray], units: UnitSystem) -> dict[str, np.ndarray]:
    factors = {"theta": units.thermal_energy, "temperature": units.thermal_energy, "capacity": 1.0}
    found = {name: column[name][None] * factor for name, factor in factors.items() if name in column}
    return found | {name: values[None] for name, values in column.items() if re.fullmatch(r"c\d+", name)}
