"""Dumps: trajectory files of the deck (styles atom, custom and dcd)."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import partial

import numpy as np

from ...dcd import DCDWriter
from ...errors import ParameterError
from ...files import BlockFile, write_whole
from ..state.deck_state import DeckState
from ..state.moment import DeckMoment
from ..state.records import Dump
from ..state.sample import DeckSample
from ..values.per_bead import BEAD_WORDS, axis_of
from ..values.resolver import Resolver
from .thermo import fields_read

STYLES = ("atom", "custom", "dcd")


def _forces(moment: DeckMoment) -> np.ndarray:
    if moment.sample is None or moment.sample.forces is None:
        raise ParameterError("the dump columns fx, fy and fz need the forces, which were not handed over")
    return moment.sample.forces / moment.units.force


def _images(moment: DeckMoment) -> np.ndarray:
    return moment.state.atoms.images + moment.folded[1]


def _unwrapped(moment: DeckMoment) -> np.ndarray:
    return moment.box.unwrap(moment.folded[0], _images(moment))


def _columns() -> dict[str, tuple[Callable[[DeckMoment], np.ndarray], str]]:
    table: dict[str, tuple[Callable[[DeckMoment], np.ndarray], str]] = {
        "id": (lambda m: m.state.atoms.ids, "%d"),
        "type": (lambda m: m.state.atoms.types, "%d"),
        "mol": (lambda m: m.state.atoms.molecules, "%d"),
        "mass": (BEAD_WORDS["mass"].value, "%g"),
        "q": (BEAD_WORDS["q"].value, "%g"),
        "uCond": (lambda m: m.field("u_cond") / m.units.energy, "%g"),
        "uMech": (lambda m: m.field("u_mech") / m.units.energy, "%g"),
        "dpdTheta": (lambda m: m.field("theta") / m.units.thermal_energy, "%g"),
    }
    arrays: dict[str, tuple[Callable[[DeckMoment], np.ndarray], str]] = {
        "{}": (lambda m: m.folded[0], "%g"),
        "{}u": (_unwrapped, "%g"),
        "{}s": (lambda m: m.box.fractions(m.folded[0]), "%g"),
        "{}su": (lambda m: m.box.fractions(_unwrapped(m)), "%g"),
        "i{}": (_images, "%d"),
        "v{}": (lambda m: m.velocities, "%g"),
        "f{}": (_forces, "%g"),
    }
    for name, (array, form) in arrays.items():
        for k, axis in enumerate("xyz"):
            table[name.format(axis)] = (axis_of(array, k), form)
    return table


#: Columns of ``dump custom``: their values, and their default format.  ``c_id``, ``c_id[2]`` and ``v_name`` come on top.
COLUMNS = _columns()

#: Columns that change during a run without being a position, a velocity or a force.
FIELD_COLUMNS = ("uCond", "uMech", "dpdTheta")


@dataclass(frozen=True)
class DumpWriter:
    """Writes the configurations of one dump; what is written already is remembered in ``dump``."""

    dump: Dump

    @property
    def needs_forces(self) -> bool:
        """Whether a column is a force."""
        return any(column in ("fx", "fy", "fz") for column in self.dump.columns)

    def needs(self, state: DeckState) -> frozenset[str]:
        """Fields of DeckSample that the columns read, beside positions, velocities and forces."""
        found = fields_read(state, [column for column in self.dump.columns if column.startswith(("c_", "v_"))])
        return found | {"fields"} if set(FIELD_COLUMNS) & set(self.dump.columns) else found

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
        moment = moment or Resolver(state)
        sample = replace(moment.sample or DeckSample(step), positions=positions, velocities=velocities, forces=forces, box=box)
        moment = Resolver(state, sample, moment.window)
        if self.dump.style == "dcd":
            self._write_dcd(moment)
        else:
            self._write_text(step, moment)
        self.dump.last_step = step

    def close(self) -> None:
        """Close the file."""
        if self.dump.opened is not None:
            self.dump.opened.close()
            self.dump.opened = None

    @property
    def _what(self) -> str:
        return f"the file of dump {self.dump.name},"

    def _write_text(self, step: int, moment: Resolver) -> None:
        state, text = moment.state, self._text(step, moment)
        if "*" in self.dump.file:
            write_whole(state.output_file(self.dump.file, step), text, self._what)
            return
        if self.dump.opened is None:
            self.dump.opened = BlockFile(state.output_file(self.dump.file, step), self._what, append=self.dump.append)
        assert isinstance(self.dump.opened, BlockFile)
        self.dump.opened.write(text)

    def _text(self, step: int, moment: Resolver) -> str:
        box, dump, mask = moment.box, self.dump, moment.state.group(self.dump.group)
        lines = [f"ITEM: TIMESTEP\n{step}\nITEM: NUMBER OF ATOMS\n{mask.sum()}\n"]
        if box.triclinic:
            low, high = box.bounds
            lines.append("ITEM: BOX BOUNDS xy xz yz pp pp pp\n")
            lines += (f"{low[k]:.16e} {high[k]:.16e} {box.tilt[k]:.16e}\n" for k in range(3))
        else:
            lines.append("ITEM: BOX BOUNDS " + " ".join("pp" if periodic else "ff" for periodic in box.periodic) + "\n")
            lines += (f"{box.low[k]:.16e} {box.high[k]:.16e}\n" for k in range(3))
        lines.append(f"ITEM: ATOMS {' '.join(dump.columns)}\n")
        kinds = {"%g": dump.formats.get("float"), "%d": dump.formats.get("int")}
        forms, values = [], []
        for name in dump.columns:
            value, form = COLUMNS[name] if name in COLUMNS else (partial(Resolver.bead_values, word=name), "%g")
            forms.append(dump.formats.get(name) or kinds[form] or form)
            values.append(value(moment)[mask])
        line = " ".join(forms) + " \n"
        lines += (line % row for row in zip(*values, strict=True))
        return "".join(lines)

    def _write_dcd(self, moment: Resolver) -> None:
        dump, mask = self.dump, moment.state.group(self.dump.group)
        if dump.opened is None:
            dump.opened = DCDWriter(moment.state.output_file(dump.file, 0), int(mask.sum()), self._what)
        assert isinstance(dump.opened, DCDWriter)
        dump.opened.write((_unwrapped(moment) if dump.unwrap else moment.folded[0])[mask], moment.box.vectors)
