"""Dumps: trajectory files and pictures of the deck."""

import gzip
import operator
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from ...base.errors import ParameterError
from ...base.files import BlockFile, write_whole
from ...base.units import UnitSystem
from ...io.dcd import DCDWriter
from ...io.xtc import XTCWriter
from ..state.deck_state import DeckState
from ..state.moment import DeckMoment
from ..values.per_bead import BEAD_WORDS, BeadWord, axis_of
from ..values.resolver import Resolver
from .pictures import PictureSettings, draw_frame

STYLES = ("atom", "custom", "dcd", "xtc", "xyz", "local", "image", "movie", "atom/gz", "custom/gz", "xyz/gz", "local/gz")
#: Binary styles, with all frames in one file.
BINARY = ("dcd", "xtc")
#: Styles that draw a picture of each frame.
PICTURES = ("image", "movie")


def _unwrapped(moment: DeckMoment) -> np.ndarray:
    return moment.box.unwrap(moment.folded[0], moment.images + moment.folded[1])


def _field(name: str, unit: str) -> BeadWord:
    return lambda moment: moment.field(name) / getattr(moment.units, unit)


#: Columns of ``dump custom``, besides ``c_id``, ``c_id[2]`` and ``v_name``.
COLUMNS = BEAD_WORDS | {
    **{f"{axis}u": axis_of(_unwrapped, k) for k, axis in enumerate("xyz")},
    **{f"{axis}su": axis_of(lambda m: m.box.fractions(_unwrapped(m)), k) for k, axis in enumerate("xyz")},
    "uCond": _field("u_cond", "energy"),
    "uMech": _field("u_mech", "energy"),
    "dpdTheta": _field("theta", "thermal_energy"),
    "proc": lambda moment: np.zeros(len(moment.state.atoms)),
    "procp1": lambda moment: np.ones(len(moment.state.atoms)),
}

#: Columns of texts, of style custom.
TEXTS = ("element", "typelabel")
#: Columns of whole numbers.
_WHOLE = ("id", "type", "mol", "ix", "iy", "iz", "proc", "procp1")
#: Comparisons of ``dump_modify thresh``.
COMPARED: dict[str, Callable] = {
    **{"<": operator.lt, "<=": operator.le, ">": operator.gt, ">=": operator.ge, "==": operator.eq, "!=": operator.ne},
    "|^": lambda a, b: (a != 0) != (b != 0),
}


@dataclass
class Dump:
    """A dump."""

    #: Id, group and style.
    name: str
    group: str
    style: str
    every: int  #: Interval in steps
    file: str  #: File name; ``*`` stands for the step and makes one file per configuration
    columns: tuple[str, ...] = ()  #: Columns of the text styles
    #: Settings of dump_modify; ``formats`` is by column.
    append: bool = False
    first: bool = False
    unwrap: bool = False
    pbc: bool = False
    formats: dict[str, str] = field(default_factory=dict)
    elements: tuple[str, ...] = ()  #: Names of the types; empty means their numbers, and C in a column
    thresholds: tuple[tuple[str, str, float], ...] = ()  #: Beads are written whose values compare so: word, sign and number
    region: str | None = None  #: Region of the beads that are written
    header: bool = True
    #: Whether the header has the time, and the units.
    time: bool = False
    units: bool = False
    pad: int = 0  #: Digits of the step in file names
    delay: int = 0  #: First step that is written
    label: str = "ENTRIES"  #: What style local calls its rows
    picture: PictureSettings | None = None  #: Settings of the styles image and movie
    #: Factors ``sfactor`` and ``tfactor`` of lengths and times in style xtc.
    factors: dict[str, float] = field(default_factory=dict)
    precision: int = 1000  #: Style xtc rounds to this fraction of a nm (units lj: of the unit of length)
    last_step: int | None = None  #: Step of the last configuration that was written
    opened: BlockFile | DCDWriter | XTCWriter | None = field(default=None, repr=False)  #: The file, once it has content
    folder: str | None = None  #: Where ``shell cd`` had gone at its first run, or with ``*`` at its last; None before
    begun: bool = False  #: Whether a resumed run continues a file with content

    def __getstate__(self) -> dict:
        return vars(self) | {"opened": None, "begun": self.begun or self.opened is not None}

    def due(self, step: int) -> bool:
        """Whether a configuration is due at this step (never twice at the same step)."""
        wanted = step % self.every == 0 or (self.first and self.last_step is None)
        return step != self.last_step and step >= self.delay and wanted

    def next_due(self, step: int) -> int:
        """The first step after ``step`` at which a configuration is due."""
        return (step // self.every + 1) * self.every

    def begin(self, state: DeckState) -> None:
        """Create the empty file: LAMMPS does so at the start of a run, and for binary styles at once."""
        if self.folder is None or "*" in self.file:
            self.folder = state.folder
        if state.carried_out and "*" not in self.file and self.opened is None and not self.begun:
            BlockFile(self._path(state), self._what, append=self.append).close()

    def _path(self, state: DeckState, step: int | None = None) -> Path:
        return state.output_file(state.placed(self.file, self.folder), None if step is None else f"{step:0{self.pad}d}")

    def write(self, moment: Resolver) -> None:
        """Write the configuration of a moment.  OutputError if this fails; earlier configurations stay readable."""
        if self.style in BINARY:
            self._write_frame(moment)
        elif self.picture is not None:
            draw_frame(self.picture, moment, self.chosen(moment), self._path(moment.state, moment.step))
        else:
            self._write_text(moment)
        self.last_step = moment.step

    def close(self) -> None:
        """Close the file."""
        if self.opened is not None:
            self.opened.close()
            self.opened = None

    @property
    def _what(self) -> str:
        return f"the file of dump {self.name},"

    def chosen(self, moment: Resolver) -> np.ndarray:
        """Mask of the beads that are written."""
        mask = moment.state.group(self.group)
        if self.region is not None:
            mask = mask & moment.region(self.region).contains(moment.folded[0])
        for word, sign, number in self.thresholds:
            mask = mask & COMPARED[sign](column(moment, word), number)
        return mask

    def _write_text(self, moment: Resolver) -> None:
        state, step = moment.state, moment.step
        texts = {"xyz": self._xyz_text, "local": self._local_text}.get(self.style, self._text)(moment)
        text = gzip.compress(texts.encode(), mtime=0) if self.file.endswith(".gz") else texts
        if "*" in self.file:
            write_whole(self._path(state, step), text, self._what)
            return
        if self.opened is None:
            self.opened = BlockFile(self._path(state, step), self._what, append=self.append or self.begun)
        assert isinstance(self.opened, BlockFile)
        self.opened.write(text)

    def _head(self, moment: Resolver, count: int, what: str) -> list[str]:
        """Lines before the rows, but for the names of the columns."""
        if not self.header:
            return []
        box, lines = moment.box, []
        if self.units and ("*" in self.file or (self.opened is None and not self.begun)):
            lines.append(f"ITEM: UNITS\n{moment.units.name}\n")
        if self.time:
            lines.append(f"ITEM: TIME\n{moment.state.time_at(moment.step) / moment.units.time:.16g}\n")
        lines.append(f"ITEM: TIMESTEP\n{moment.step}\nITEM: NUMBER OF {what}\n{count}\n")
        if box.triclinic:
            low, high = box.bounds
            lines.append("ITEM: BOX BOUNDS xy xz yz pp pp pp\n")
            lines += (f"{low[k]:.16e} {high[k]:.16e} {box.tilt[k]:.16e}\n" for k in range(3))
        else:
            lines.append("ITEM: BOX BOUNDS " + " ".join("pp" if periodic else "ff" for periodic in box.periodic) + "\n")
            lines += (f"{box.low[k]:.16e} {box.high[k]:.16e}\n" for k in range(3))
        return [*lines, f"ITEM: {what} {' '.join(self.columns)}\n"]

    def _text(self, moment: Resolver) -> str:
        mask = self.chosen(moment)
        types, values = moment.state.atoms.types[mask], []
        labels = sorted(found := moment.state.labels.get("atom", {}), key=found.__getitem__)
        for name in self.columns:
            if name in TEXTS:
                values.append(np.array(self.elements or ["C"] * moment.state.n_types if name == "element" else labels)[types - 1])
            else:
                values.append(column(moment, name)[mask].astype(np.int64 if name in _WHOLE else np.float64))
        return self._rows(self._head(moment, int(mask.sum()), "ATOMS"), values)

    def _local_text(self, moment: Resolver) -> str:
        values = [moment.local_values(name) for name in self.columns if name != "index"]
        count = len(values[0]) if values else 0
        if any(len(each) != count for each in values):
            raise ParameterError(f"dump {self.name} (style local): {' '.join(self.columns)} are of different terms")
        if "index" in self.columns:
            values.insert(self.columns.index("index"), np.arange(1, count + 1))
        return self._rows(self._head(moment, count, self.label), values)

    def _rows(self, head: list[str], values: list[np.ndarray]) -> str:
        kinds, usual = [each.dtype.kind for each in values], {"i": ("int", "%d"), "f": ("float", "%g"), "U": ("", "%s")}
        lines = self.formats["line"].split() if "line" in self.formats else [usual[kind][1] for kind in kinds]
        forms = [self.formats.get(usual[kind][0], form) for kind, form in zip(kinds, lines, strict=True)]
        line = " ".join(self.formats.get(name, form) for name, form in zip(self.columns, forms, strict=True)) + " \n"
        return "".join([*head, *(line % row for row in zip(*values, strict=True))])

    def _xyz_text(self, moment: Resolver) -> str:
        mask = self.chosen(moment)
        types = moment.state.atoms.types[mask].tolist()
        names = [self.elements[kind - 1] for kind in types] if self.elements else map(str, types)
        form = self.formats.get("line", "%s %g %g %g")
        rows = [form % (name, *place) for name, place in zip(names, moment.folded[0][mask].tolist(), strict=True)]
        return "\n".join([str(len(rows)), f" Atoms. Timestep: {moment.step}", *rows]) + "\n"

    def _write_frame(self, moment: Resolver) -> None:
        """Write a frame in a binary style."""
        state, mask = moment.state, moment.state.group(self.group)
        x, box = (_unwrapped(moment) if self.unwrap else moment.folded[0])[mask], moment.box.vectors
        if self.opened is None:
            path = self._path(state, 0)
            if self.style == "dcd":
                dt = state.timestep / state.units.time
                self.opened = DCDWriter(path, len(x), self._what, append=self.begun, first=moment.step, every=self.every, dt=dt)
            else:
                self.opened = XTCWriter(path, len(x), self._what, append=self.begun, precision=self.precision)
        if isinstance(self.opened, XTCWriter):
            factors = xtc_factors(state.units) | self.factors
            time = moment.step * state.timestep / state.units.time * factors["tfactor"]
            self.opened.write(factors["sfactor"] * x, factors["sfactor"] * box, time, moment.step)
        else:
            assert isinstance(self.opened, DCDWriter)
            self.opened.write(x, box, moment.step)


def column(moment: Resolver, word: str) -> np.ndarray:
    """(N,) values of a column of ``dump custom``."""
    return COLUMNS[word](moment) if word in COLUMNS else moment.bead_values(word)


def xtc_factors(units: UnitSystem) -> dict[str, float]:
    """Default factors of lengths and times of dump xtc: conversion to nm and ps, except for units lj."""
    return {"sfactor": 1.0, "tfactor": 1.0} if units.name == "lj" else {"sfactor": units.length, "tfactor": units.time}
