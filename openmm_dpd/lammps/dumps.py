"""Dumps: trajectory files of the deck (styles atom, custom and dcd)."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import IO, TYPE_CHECKING, Any

import numpy as np

from ..errors import ParameterError
from .box import Box
from .context import Context
from .per_bead import bead_values
from .thermo import fields_read

if TYPE_CHECKING:
    from .state import DeckState

STYLES = ("atom", "custom", "dcd")


@dataclass(frozen=True)
class Frame:
    """One configuration in the deck's units, ready to be written."""

    ids: np.ndarray
    types: np.ndarray
    molecules: np.ndarray
    masses: np.ndarray
    charges: np.ndarray
    u_cond: np.ndarray
    u_mech: np.ndarray
    thetas: np.ndarray
    wrapped: np.ndarray
    images: np.ndarray
    velocities: np.ndarray
    forces: np.ndarray | None
    box: Box
    computed: Mapping[str, np.ndarray] = field(default_factory=dict)

    @property
    def unwrapped(self) -> np.ndarray:
        """Positions carried to their images."""
        return self.box.unwrap(self.wrapped, self.images)

    def required_forces(self) -> np.ndarray:
        """Forces; ParameterError if they were not handed over."""
        if self.forces is None:
            raise ParameterError("the dump columns fx, fy and fz need the forces, which were not handed over")
        return self.forces


def _columns() -> dict[str, tuple[Callable[[Frame], np.ndarray], str]]:
    table: dict[str, tuple[Callable[[Frame], np.ndarray], str]] = {
        "id": (lambda f: f.ids, "%d"),
        "type": (lambda f: f.types, "%d"),
        "mol": (lambda f: f.molecules, "%d"),
        "mass": (lambda f: f.masses, "%g"),
        "q": (lambda f: f.charges, "%g"),
        "uCond": (lambda f: f.u_cond, "%g"),
        "uMech": (lambda f: f.u_mech, "%g"),
        "dpdTheta": (lambda f: f.thetas, "%g"),
    }
    arrays: dict[str, tuple[Callable[[Frame], np.ndarray], str]] = {
        "{}": (lambda f: f.wrapped, "%g"),
        "{}u": (lambda f: f.unwrapped, "%g"),
        "{}s": (lambda f: f.box.fractions(f.wrapped), "%g"),
        "{}su": (lambda f: f.box.fractions(f.unwrapped), "%g"),
        "i{}": (lambda f: f.images, "%d"),
        "v{}": (lambda f: f.velocities, "%g"),
        "f{}": (Frame.required_forces, "%g"),
    }
    for name, (array, form) in arrays.items():
        for k, axis in enumerate("xyz"):
            table[name.format(axis)] = (_column(array, k), form)
    return table


def _column(array: Callable[[Frame], np.ndarray], axis: int) -> Callable[[Frame], np.ndarray]:
    return lambda frame: array(frame)[:, axis]


#: Columns of ``dump custom``: how to get them from a frame, and their default format.  ``c_id``, ``c_id[2]`` and ``v_name`` come on top.
COLUMNS = _columns()

#: Columns that change during a run without being a position, a velocity or a force.
CARRIED = ("uCond", "uMech", "dpdTheta")


def _of_column(name: str) -> tuple[Callable[[Frame], np.ndarray], str]:
    return COLUMNS[name] if name in COLUMNS else (lambda frame: frame.computed[name], "%g")


@dataclass
class Dump:
    """One dump.

    Attributes
    ----------
    name, group, style : str
        Its id, group and style.
    every : int
        Interval in steps.
    file : str
        File name; a ``*`` makes one file per configuration, named after the step.
    columns : tuple of str
        Columns of the text styles.
    append, first, unwrap, sort : bool
        Settings of dump_modify.
    """

    name: str
    group: str
    style: str
    every: int
    file: str
    columns: tuple[str, ...] = ()
    append: bool = False
    first: bool = False
    unwrap: bool = False
    formats: dict[str, str] = field(default_factory=dict)
    last_step: int | None = None
    _stream: Any = field(default=None, repr=False)

    @property
    def needs_forces(self) -> bool:
        """Whether a column is a force."""
        return any(column in ("fx", "fy", "fz") for column in self.columns)

    def needs(self, state: DeckState) -> frozenset[str]:
        """Fields of Sample that the columns read, beside positions, velocities and forces."""
        found = fields_read(state, [column for column in self.columns if column.startswith(("c_", "v_"))])
        return found | {"fields"} if set(CARRIED) & set(self.columns) else found

    def due(self, step: int) -> bool:
        """Whether a configuration is written at this step (never twice at one step)."""
        return step != self.last_step and (step % self.every == 0 or (self.first and self.last_step is None))

    def next_due(self, step: int) -> int:
        """The first step after ``step`` at which a configuration is written."""
        return (step // self.every + 1) * self.every

    def write(
        self,
        state: DeckState,
        step: int,
        positions: np.ndarray,
        velocities: np.ndarray,
        forces: np.ndarray | None = None,
        box: np.ndarray | None = None,
        context: Context | None = None,
    ) -> None:
        """Write one configuration.

        Parameters
        ----------
        state : DeckState
            The deck, as it was when the run began.
        step : int
            Number of the step.
        positions, velocities, forces : (N, 3) arrays
            MD units; positions continuous with those of the scene.
        box : (3, 3) array, optional
            Box vectors in nm, if they differ from the deck's.
        context : Context, optional
            With a sample of this step that has the fields of :meth:`needs`; the deck's state by default.
        """
        frame = _frame(state, self, positions, velocities, forces, box, context or Context(state))
        if self.style == "dcd":
            self._write_dcd(state, frame)
        else:
            self._write_text(state, step, frame)
        self.last_step = step

    def close(self) -> None:
        """Close the file."""
        if self._stream is not None:
            self._stream.close()
            self._stream = None

    def _path(self, state: DeckState, step: int) -> Path:
        path = state.output / self.file.replace("*", str(step))
        path.parent.mkdir(parents=True, exist_ok=True)
        return path

    def _write_text(self, state: DeckState, step: int, frame: Frame) -> None:
        if "*" in self.file:
            with open(self._path(state, step), "w") as stream:
                self._text(stream, step, frame)
            return
        if self._stream is None:
            self._stream = open(self._path(state, step), "a" if self.append else "w")
        self._text(self._stream, step, frame)
        self._stream.flush()

    def _text(self, stream: IO[str], step: int, frame: Frame) -> None:
        box = frame.box
        stream.write(f"ITEM: TIMESTEP\n{step}\nITEM: NUMBER OF ATOMS\n{len(frame.ids)}\n")
        if box.triclinic:
            low, high = box.bounds
            stream.write("ITEM: BOX BOUNDS xy xz yz pp pp pp\n")
            stream.writelines(f"{low[k]:.16e} {high[k]:.16e} {box.tilt[k]:.16e}\n" for k in range(3))
        else:
            stream.write("ITEM: BOX BOUNDS " + " ".join("pp" if periodic else "ff" for periodic in frame.box.periodic) + "\n")
            stream.writelines(f"{box.low[k]:.16e} {box.high[k]:.16e}\n" for k in range(3))
        stream.write(f"ITEM: ATOMS {' '.join(self.columns)}\n")
        kinds = {True: self.formats.get("float"), False: self.formats.get("int")}
        columns = [_of_column(name) for name in self.columns]
        forms = [self.formats.get(name) or kinds[form == "%g"] or form for name, (_, form) in zip(self.columns, columns, strict=True)]
        values = [value(frame) for value, _ in columns]
        line = " ".join(forms) + " \n"
        stream.writelines(line % row for row in zip(*values, strict=True))

    def _write_dcd(self, state: DeckState, frame: Frame) -> None:
        from mdtraj.formats import DCDTrajectoryFile

        if self._stream is None:
            self._stream = DCDTrajectoryFile(str(self._path(state, 0)), "w", force_overwrite=True)
        vectors = frame.box.vectors
        lengths = np.linalg.norm(vectors, axis=1)
        cosines = [vectors[a] @ vectors[b] / lengths[a] / lengths[b] for a, b in ((1, 2), (0, 2), (0, 1))]
        angles = np.degrees(np.arccos(cosines))
        positions = frame.unwrapped if self.unwrap else frame.wrapped
        self._stream.write(positions.astype(np.float32), lengths[None].astype(np.float32), angles[None].astype(np.float32))


def _frame(state: DeckState, dump: Dump, positions, velocities, forces, vectors, context: Context) -> Frame:
    atoms, units, mask = state.atoms, state.units, state.group(dump.group)
    # values that the columns do not show are not asked for
    carried = {
        name: (context.carried(name) if column in dump.columns else np.zeros(len(atoms)))[mask]
        for name, column in zip(("u_cond", "u_mech", "theta"), CARRIED, strict=True)
    }
    box = state.require_box("a dump")
    if vectors is not None:
        box = box.following(np.asarray(vectors) / units.length)
    inside, shifts = (array[mask] for array in state.folded(state.in_deck_units(positions), box))
    return Frame(
        ids=atoms.ids[mask],
        types=atoms.types[mask],
        molecules=atoms.molecules[mask],
        masses=state.bead_masses()[mask] / units.mass,
        charges=atoms.charges[mask],
        u_cond=carried["u_cond"] / units.energy,
        u_mech=carried["u_mech"] / units.energy,
        thetas=carried["theta"] / units.thermal_energy,
        wrapped=inside,
        images=atoms.images[mask] + shifts,
        velocities=np.asarray(velocities)[mask] / units.velocity,
        forces=None if forces is None else np.asarray(forces)[mask] / units.force,
        box=box,
        computed={column: bead_values(context, column)[mask] for column in dump.columns if column.startswith(("c_", "v_"))},
    )
