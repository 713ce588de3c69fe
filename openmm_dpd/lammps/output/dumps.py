"""Dumps: trajectory files of the deck (styles atom, custom and dcd)."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ...dcd import DCDWriter
from ...files import BlockFile, write_whole
from ..state.deck_state import DeckState
from ..state.moment import DeckMoment
from ..state.records import Dump
from ..values.per_bead import BEAD_WORDS, BeadWord, axis_of
from ..values.resolver import Resolver
from .thermo import fields_read

STYLES = ("atom", "custom", "dcd")


def _unwrapped(moment: DeckMoment) -> np.ndarray:
    return moment.box.unwrap(moment.folded[0], moment.state.atoms.images + moment.folded[1])


def _field(name: str, unit: str) -> BeadWord:
    return BeadWord(lambda moment: moment.field(name) / getattr(moment.units, unit), ("fields",))


#: Columns of ``dump custom``.  ``c_id``, ``c_id[2]`` and ``v_name`` come on top.
COLUMNS = BEAD_WORDS | {
    **{f"{axis}u": BeadWord(axis_of(_unwrapped, k), ("positions",)) for k, axis in enumerate("xyz")},
    **{f"{axis}su": BeadWord(axis_of(lambda m: m.box.fractions(_unwrapped(m)), k), ("positions",)) for k, axis in enumerate("xyz")},
    "uCond": _field("u_cond", "energy"),
    "uMech": _field("u_mech", "energy"),
    "dpdTheta": _field("theta", "thermal_energy"),
}

#: Those that are whole numbers.
_WHOLE = ("id", "type", "mol", "ix", "iy", "iz")


@dataclass(frozen=True)
class DumpWriter:
    """Writes the configurations of one dump; what is written already is remembered in ``dump``."""

    dump: Dump

    def needs(self, state: DeckState) -> frozenset[str]:
        """Fields of DeckSample that a configuration is written from."""
        named = fields_read(state, [column for column in self.dump.columns if column not in COLUMNS])
        return named.union(("positions",), *(COLUMNS[column].needs for column in self.dump.columns if column in COLUMNS))

    def due(self, step: int) -> bool:
        """Whether a configuration is written at this step (never twice at one step)."""
        return step != self.dump.last_step and (step % self.dump.every == 0 or (self.dump.first and self.dump.last_step is None))

    def next_due(self, step: int) -> int:
        """The first step after ``step`` at which a configuration is written."""
        return (step // self.dump.every + 1) * self.dump.every

    def write(self, moment: Resolver) -> None:
        """Write the configuration of a moment, whose sample has the fields of :meth:`needs`.

        Raises
        ------
        OutputError
            If it cannot be written; the configurations before it stay readable.
        """
        if self.dump.style == "dcd":
            self._write_dcd(moment)
        else:
            self._write_text(moment)
        self.dump.last_step = moment.step

    def close(self) -> None:
        """Close the file."""
        if self.dump.opened is not None:
            self.dump.opened.close()
            self.dump.opened = None

    @property
    def _what(self) -> str:
        return f"the file of dump {self.dump.name},"

    def _write_text(self, moment: Resolver) -> None:
        state, step, text = moment.state, moment.step, self._text(moment)
        if "*" in self.dump.file:
            write_whole(state.output_file(self.dump.file, step), text, self._what)
            return
        if self.dump.opened is None:
            self.dump.opened = BlockFile(state.output_file(self.dump.file, step), self._what, append=self.dump.append)
        assert isinstance(self.dump.opened, BlockFile)
        self.dump.opened.write(text)

    def _text(self, moment: Resolver) -> str:
        box, dump, mask = moment.box, self.dump, moment.state.group(self.dump.group)
        lines = [f"ITEM: TIMESTEP\n{moment.step}\nITEM: NUMBER OF ATOMS\n{mask.sum()}\n"]
        if box.triclinic:
            low, high = box.bounds
            lines.append("ITEM: BOX BOUNDS xy xz yz pp pp pp\n")
            lines += (f"{low[k]:.16e} {high[k]:.16e} {box.tilt[k]:.16e}\n" for k in range(3))
        else:
            lines.append("ITEM: BOX BOUNDS " + " ".join("pp" if periodic else "ff" for periodic in box.periodic) + "\n")
            lines += (f"{box.low[k]:.16e} {box.high[k]:.16e}\n" for k in range(3))
        lines.append(f"ITEM: ATOMS {' '.join(dump.columns)}\n")
        forms, values = [], []
        for name in dump.columns:
            whole = name in _WHOLE
            forms.append(dump.formats.get(name) or dump.formats.get("int" if whole else "float") or ("%d" if whole else "%g"))
            found = (COLUMNS[name].value(moment) if name in COLUMNS else moment.bead_values(name))[mask]
            values.append(found.astype(np.int64) if whole else found)
        line = " ".join(forms) + " \n"
        lines += (line % row for row in zip(*values, strict=True))
        return "".join(lines)

    def _write_dcd(self, moment: Resolver) -> None:
        dump, mask = self.dump, moment.state.group(self.dump.group)
        if dump.opened is None:
            dump.opened = DCDWriter(moment.state.output_file(dump.file, 0), int(mask.sum()), self._what)
        assert isinstance(dump.opened, DCDWriter)
        dump.opened.write((_unwrapped(moment) if dump.unwrap else moment.folded[0])[mask], moment.box.vectors)
