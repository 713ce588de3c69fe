"""Dumps: trajectory files of the deck (styles atom, custom and dcd)."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field

import numpy as np

from ...dcd import DCDWriter
from ...errors import ParameterError
from ...files import BlockFile, write_whole
from ..state.box import Box
from ..state.deck_state import DeckState
from ..state.records import Dump
from ..values.resolver import Resolver
from .thermo import fields_read

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


@dataclass(frozen=True)
class DumpWriter:
    """Writes the configurations of one dump; what is written already is remembered in ``dump``."""

    dump: Dump

    @property
    def needs_forces(self) -> bool:
        """Whether a column is a force."""
        return any(column in ("fx", "fy", "fz") for column in self.dump.columns)

    def needs(self, state: DeckState) -> frozenset[str]:
        """Fields of Sample that the columns read, beside positions, velocities and forces."""
        found = fields_read(state, [column for column in self.dump.columns if column.startswith(("c_", "v_"))])
        return found | {"fields"} if set(CARRIED) & set(self.dump.columns) else found

    def due(self, step: int) -> bool:
        """Whether a configuration is written at this step (never twice at one step)."""
        return step != self.dump.last_step and (step % self.dump.every == 0 or (self.dump.first and self.dump.last_step is None))

    def next_due(self, step: int) -> int:
        """The first step after ``step`` at which a configuration is written."""
        return (step // self.dump.every + 1) * self.dump.every

    def write(
        self,
        state: DeckState,
        step: int,
        positions: np.ndarray,
        velocities: np.ndarray,
        forces: np.ndarray | None = None,
        box: np.ndarray | None = None,
        moment: Resolver | None = None,
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
        moment : Resolver, optional
            With a sample of this step that has the fields of :meth:`needs`; the deck's state by default.

        Raises
        ------
        OutputError
            If it cannot be written; the configurations before it stay readable.
        """
        frame = _frame(state, self.dump, positions, velocities, forces, box, moment or Resolver(state))
        if self.dump.style == "dcd":
            self._write_dcd(state, frame)
        else:
            self._write_text(state, step, frame)
        self.dump.last_step = step

    def close(self) -> None:
        """Close the file."""
        if self.dump.opened is not None:
            self.dump.opened.close()
            self.dump.opened = None

    @property
    def _what(self) -> str:
        return f"the file of dump {self.dump.name},"

    def _write_text(self, state: DeckState, step: int, frame: Frame) -> None:
        text = self._text(step, frame)
        if "*" in self.dump.file:
            write_whole(state.output_file(self.dump.file, step), text, self._what)
            return
        if self.dump.opened is None:
            self.dump.opened = BlockFile(state.output_file(self.dump.file, step), self._what, append=self.dump.append)
        assert isinstance(self.dump.opened, BlockFile)
        self.dump.opened.write(text)

    def _text(self, step: int, frame: Frame) -> str:
        box, dump = frame.box, self.dump
        lines = [f"ITEM: TIMESTEP\n{step}\nITEM: NUMBER OF ATOMS\n{len(frame.ids)}\n"]
        if box.triclinic:
            low, high = box.bounds
            lines.append("ITEM: BOX BOUNDS xy xz yz pp pp pp\n")
            lines += (f"{low[k]:.16e} {high[k]:.16e} {box.tilt[k]:.16e}\n" for k in range(3))
        else:
            lines.append("ITEM: BOX BOUNDS " + " ".join("pp" if periodic else "ff" for periodic in frame.box.periodic) + "\n")
            lines += (f"{box.low[k]:.16e} {box.high[k]:.16e}\n" for k in range(3))
        lines.append(f"ITEM: ATOMS {' '.join(dump.columns)}\n")
        kinds = {True: dump.formats.get("float"), False: dump.formats.get("int")}
        columns = [_of_column(name) for name in dump.columns]
        forms = [dump.formats.get(name) or kinds[form == "%g"] or form for name, (_, form) in zip(dump.columns, columns, strict=True)]
        values = [value(frame) for value, _ in columns]
        line = " ".join(forms) + " \n"
        lines += (line % row for row in zip(*values, strict=True))
        return "".join(lines)

    def _write_dcd(self, state: DeckState, frame: Frame) -> None:
        if self.dump.opened is None:
            self.dump.opened = DCDWriter(state.output_file(self.dump.file, 0), len(frame.ids), self._what)
        assert isinstance(self.dump.opened, DCDWriter)
        self.dump.opened.write(frame.unwrapped if self.dump.unwrap else frame.wrapped, frame.box.vectors)


def _frame(state: DeckState, dump: Dump, positions, velocities, forces, vectors, moment: Resolver) -> Frame:
    atoms, units, mask = state.atoms, state.units, state.group(dump.group)
    # values that the columns do not show are not asked for
    carried = {
        name: (moment.carried(name) if column in dump.columns else np.zeros(len(atoms)))[mask]
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
        computed={column: moment.bead_values(column)[mask] for column in dump.columns if column.startswith(("c_", "v_"))},
    )
