"""Configurations from LAMMPS dumps or data files: arrays in MD units, a Scene, a trajectory for mdtraj."""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import TYPE_CHECKING

import numpy as np

from ...base.errors import ParameterError, require, what_is
from ...base.units import UnitSystem, to_md, unit_system
from ...io.trajectory import load_topology
from ...model.internal import BeadTemperatures, Concentrations, Internal, InternalEnergy
from ...model.scene import Scene
from ..files.data_file import ATOM_STYLES, DataReader
from ..run.trajectory import write_topology
from .export_scene import atom_styles, lammps_types, species_of

if TYPE_CHECKING:
    import mdtraj

#: Maximum ratio of box edges between frames and scene; a larger one indicates wrong units.
_LARGEST_RATIO = 4.0
_SEE = "(see openmm_dpd.lammps.exchange.dump_reader.NAMES)"


@dataclass(frozen=True, eq=False)
class LammpsFrames:
    """F configurations of N beads, in the order of ids; nm, ps, kJ/mol."""

    path: Path  #: The file
    steps: np.ndarray  #: (F,) step numbers
    ids: np.ndarray  #: (N,) ids, ascending: bead k of the scene is entry k
    positions: np.ndarray  #: (F, N, 3) as in the file: wrapped, or unwrapped if the file only has ``xu yu zu``
    #: (F, N, 3) unwrapped positions; None if the file has neither image flags nor unwrapped positions.
    unwrapped: np.ndarray | None
    images: np.ndarray | None  #: (F, N, 3) image flags
    velocities: np.ndarray | None  #: (F, N, 3)
    forces: np.ndarray | None  #: (F, N, 3)
    types: np.ndarray | None  #: (N,) LAMMPS's atom types
    boxes: np.ndarray | None  #: (F, 3, 3) box vectors; None without a periodic box
    corners: np.ndarray  #: (F, 3) lower corners of the box
    #: By name, (F, N): ``theta``, ``u_cond``, ``u_mech``, ``temperature``, ``capacity``, ``c1``, ``c2``, ... if the file has them.
    fields: Mapping[str, np.ndarray] = field(default_factory=dict)
    columns: Mapping[str, np.ndarray] = field(default_factory=dict)  #: All other columns, (F, N), as they are in the file
    periodic: tuple[bool, bool, bool] = (True, True, True)  #: Whether the box is periodic along each axis
    scene_: Scene | None = None  #: The scene given to the reader

    def __len__(self) -> int:
        return len(self.steps)

    def scene(self, frame: int = -1, scene: Scene | None = None) -> Scene:
        """The scene with positions, velocities, box and bead fields of one frame.

        Positions are unwrapped if the file has image flags.

        Parameters
        ----------
        frame : int
            Index of the frame; the last one by default.
        scene : Scene, optional
            Scene with the coefficients, bonds, ...; by default the one given to the reader.

        Raises
        ------
        ParameterError
            If there is no such frame, a column is missing, or the file does not match the scene.
        """
        scene = self._scene(scene)
        if not -len(self) <= frame < len(self):
            raise ParameterError(f"{self.path} has {len(self)} frames; there is no frame {frame}")
        if self.velocities is None:
            raise self.lacking("velocities", "vx vy vz")
        box = scene.box
        if box is not None and self.boxes is not None and all(self.periodic):
            box = self.boxes[frame]
        positions = self.positions if self.unwrapped is None else self.unwrapped
        return replace(scene, positions=positions[frame], velocities=self.velocities[frame], box=box, internal=self._internal(scene, frame))

    def trajectory(self, scene: Scene | None = None, *, dt=None, unwrap: bool = False) -> mdtraj.Trajectory:
        """The frames as an mdtraj trajectory (nm, ps) with the scene's topology.

        Parameters
        ----------
        scene : Scene, optional
            By default the one given to the reader.
        dt : time, optional
            Step size, for the times of the frames; without it times are step numbers.
        unwrap : bool
            Whether to use unwrapped positions.
        """
        import mdtraj

        scene = self._scene(scene)
        if unwrap and self.unwrapped is None:
            raise self.lacking("images", "ix iy iz, or xu yu zu")
        positions = self.unwrapped if unwrap else self.positions
        with TemporaryDirectory() as folder:
            path = Path(folder) / "topology.psf"
            write_topology(path, scene)
            topology = load_topology(path)
        time = self.steps * (1.0 if dt is None else float(to_md(dt, "time", "dt")))
        # mdtraj's boxes start at the origin
        trajectory = mdtraj.Trajectory(positions - self.corners[:, None, :], topology, time=time)
        if self.boxes is not None:
            trajectory.unitcell_vectors = self.boxes
        return trajectory

    def lacking(self, what: str, columns: str) -> ParameterError:
        """The error about a missing column."""
        return ParameterError(f"{self.path} has no {what}; have LAMMPS write the columns {columns}")

    def _scene(self, scene: Scene | None) -> Scene:
        scene = scene if scene is not None else self.scene_
        if scene is None:
            raise ParameterError(f"{self.path} has no coefficients and names; give the scene of the run")
        self.check(scene)
        return scene

    def check(self, scene: Scene) -> None:
        """Raise ParameterError if the frames do not match a scene: number of beads, types, or size of the box."""
        require(scene, Scene, "expected a Scene")
        if len(self.ids) != scene.n_beads:
            raise ParameterError(f"{self.path} has {len(self.ids)} beads, but the scene has {scene.n_beads}")
        if self.types is not None:
            expected = [lammps_types(scene, apart).of_bead for apart in (False, True)]
            if not any(np.array_equal(self.types, types) for types in [*expected, scene.type_ids + 1]):
                bead = int(np.argmax(self.types != expected[0]))
                raise ParameterError(
                    f"{self.path}: the atom with id {self.ids[bead]} has the type {self.types[bead]}, but bead {bead} of the scene is "
                    f"{what_is(scene.types[bead])}, type {expected[0][bead]}; is it the file of another scene?"
                )
        if self.boxes is not None and scene.box is not None and len(self):
            ratio = np.diag(self.boxes[0]) / np.diag(scene.box)
            if ratio.max() > _LARGEST_RATIO or ratio.min() < 1 / _LARGEST_RATIO:
                raise ParameterError(
                    f"the box of {self.path} has the edges {np.diag(self.boxes[0]).tolist()} nm, that of the scene "
                    f"{np.diag(scene.box).tolist()} nm; check the units of the file (such as units='real')"
                )

    def _internal(self, scene: Scene, frame: int) -> Internal | None:
        internal, found = scene.internal, {name: values[frame] for name, values in self.fields.items()}
        if isinstance(internal, InternalEnergy):
            if "theta" not in found:
                raise self.lacking("internal temperatures", f"c_ID[4] of compute dpd/atom {_SEE}")
            return InternalEnergy(internal.eos, found["theta"], found.get("u_cond"))
        if isinstance(internal, BeadTemperatures):
            if "temperature" not in found:
                raise self.lacking("temperatures of beads", f"of compute edpd/temp/atom {_SEE}")
            return BeadTemperatures(found["temperature"], found.get("capacity", internal.capacities))
        if isinstance(internal, Concentrations):
            names = [f"c{k}" for k in range(1, internal.n_species + 1)]
            if not set(names) <= set(found):
                raise self.lacking("concentrations", f"of compute tdpd/cc/atom {_SEE}")
            return Concentrations(np.column_stack([found[name] for name in names]))
        return None


def scene_from_data(path: str | Path, scene: Scene, *, units: str | None = None, styles: tuple[str, ...] | None = None) -> Scene:
    """The scene with (unwrapped) positions, velocities, box and bead fields from a data file.

    Parameters are those of :func:`read_lammps_data`.
    """
    return read_lammps_data(path, scene, units=units, styles=styles).scene()


def read_lammps_data(path: str | Path, scene: Scene, *, units: str | None = None, styles: tuple[str, ...] | None = None) -> LammpsFrames:
    """State of the beads in a data file, as a single frame.

    Coefficients, bonds and angles of the file are ignored in favour of the scene's.

    Parameters
    ----------
    path : str or Path
        The data file.
    scene : Scene
        The scene of the run.
    units : {"lj", "real", "metal", "si", "cgs", "micro", "nano"}, optional
        Units of the file; by default those in its first line (as written by LAMMPS and this package), else ``lj``.
    styles : tuple of str, optional
        Atom style, as a tuple of one or (for ``hybrid``) several names; by default that of the file, and that which
        :func:`openmm_dpd.lammps.export_lammps` uses for the scene.

    Raises
    ------
    DeckError
        With file and line, if a section is missing or has the wrong shape.
    ParameterError
        If it does not match the scene.
    """
    path = Path(path)
    reader = DataReader(path, lenient=True)
    title = reader.file.lines[0] if reader.file.lines else ""
    system = _units(path, title, units)
    if not reader.count("atoms") or "Atoms" not in reader.sections:
        raise reader.fail("the file has no atoms: there is no 'Atoms' section")
    column, positions, flags = reader.atoms(styles or _styles(reader, scene), species_of(scene))
    velocities = reader.velocities(column["id"])
    order = np.argsort(column["id"], kind="stable")
    column = {name: values[order] for name, values in column.items()}
    box, inside = reader.box(), positions[order]
    system = system.for_box(float(box.edges.max()))
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
        raise ParameterError(f"{path} states units {said[1]}, not {units}")
    return unit_system(units)


def _styles(reader: DataReader, scene: Scene) -> tuple[str, ...]:
    hint, line = reader.hints["Atoms"], reader.sections["Atoms"][0]
    for mdpd in (False, True):
        mine = atom_styles(scene, mdpd)
        if not hint or hint == (mine[0] if len(mine) == 1 else "hybrid"):
            return mine
    if hint == "hybrid":
        raise reader.fail("the atom style is hybrid, but its parts are unknown; give styles=(...)", line)
    if hint not in ATOM_STYLES:
        raise reader.fail(f"atom_style {hint} is not supported; supported are {', '.join(ATOM_STYLES)}", line)
    return (hint,)


def _fields(column: dict[str, np.ndarray], units: UnitSystem) -> dict[str, np.ndarray]:
    factors = {"theta": units.thermal_energy, "temperature": units.thermal_energy, "capacity": 1.0}
    found = {name: column[name][None] * factor for name, factor in factors.items() if name in column}
    return found | {name: values[None] for name, values in column.items() if re.fullmatch(r"c\d+", name)}
