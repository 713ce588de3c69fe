"""``fix ave/chunk``: averages over steps of values of beads, in slices of the box."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from ..errors import ParameterError
from . import arguments as read
from .averages import Average, Window, file_of, form_of, parse_schedule, split_values
from .chunks import Slices, chunk_numbers
from .context import Context
from .per_bead import BEAD_WORDS, bead_values, check_bead_word

if TYPE_CHECKING:
    from .compute_spec import Compute
    from .state import DeckState

#: Values of ``fix ave/chunk`` that are more than a mean over beads.
_OWN = ("density/number", "density/mass", "temp")
_COMPONENTS = ("vx", "vy", "vz", "mass")


class ChunkAverage(Average):
    """``fix ave/chunk``: values of beads, averaged in the slices of a compute chunk/atom.

    Attributes
    ----------
    profile : dict of lists or None
        The last block that was complete: ``coord``, ``ncount`` and the values by name.
    """

    def __init__(self, group: str, compute: Compute, words: tuple[str, ...], norm: str, dof: tuple[float, float], *parts):
        super().__init__(*parts)
        self._group, self._compute, self._values, self._norm, (self._adof, self._cdof) = group, compute, words, norm, dof
        self.profile: dict[str, list[float]] | None = None
        self.forget()

    @property
    def words(self) -> tuple[str, ...]:
        """What is averaged, and the slices."""
        own = {"temp": ("vx", "mass"), "density/number": (), "density/mass": ("mass",)}
        return (*(part for word in self._values for part in own.get(word, (word,))), "x")

    def forget(self) -> None:
        self._slices: Slices | None = None
        self._counts, self._sums, self._samples = np.zeros(0), np.zeros((0, 0)), 0

    def sample(self, context: Context) -> None:
        if self._slices is None:
            self._slices = self._compute.settings.slices(context.box)
            self._counts = np.zeros(self._slices.count)
            self._sums = np.zeros((len(self._values), self._slices.count))
        slices = self._slices
        number = chunk_numbers(context, self._compute, slices)
        kept = (number >= 0) & context.state.group(self._group)
        number = number[kept]
        counts = np.bincount(number, minlength=slices.count).astype(float)
        for k, word in enumerate(self._values):
            sums = self._of_beads(context, word, number, kept, slices.count)
            self._sums[k] += sums if self._norm == "all" else self._normalised(context, word, sums, counts, 1)
        self._counts += counts
        self._samples += 1

    @staticmethod
    def _of_beads(context: Context, word: str, number: np.ndarray, kept: np.ndarray, count: int) -> np.ndarray:
        """Sum over the beads of each slice; for ``temp`` that of m v^2."""
        if word == "density/number":
            values = np.ones(len(number))
        elif word == "density/mass":
            values = BEAD_WORDS["mass"].value(context)[kept]
        elif word == "temp":
            velocities = np.asarray(context.need("velocities"))[kept]
            values = context.state.bead_masses()[kept] * np.sum(velocities**2, axis=1) / context.units.thermal_energy
        else:
            values = bead_values(context, word)[kept]
        return np.bincount(number, weights=values, minlength=count)

    def _normalised(self, context: Context, word: str, sums: np.ndarray, counts: np.ndarray, samples: int) -> np.ndarray:
        """Sums over the beads of ``samples`` samples, divided by what belongs to the value; 0 for slices without beads."""
        assert self._slices is not None
        if word.startswith("density/"):
            unit = context.units.density if word == "density/mass" else 1.0
            return unit * sums / (self._slices.volume * samples)
        by = counts
        if word == "temp":
            by = np.where(counts > 0, samples * self._cdof + self._adof * counts, 0.0)
        elif self._norm == "none":
            return sums
        return np.divide(sums, by, out=np.zeros_like(sums), where=by != 0)

    def close_window(self, context: Context) -> None:
        slices, samples = self._slices, self._samples
        assert slices is not None
        values = self._sums / samples
        if self._norm == "all":
            pairs = zip(self._values, self._sums, strict=True)
            values = np.array([self._normalised(context, word, sums, self._counts, samples) for word, sums in pairs])
        table = self._window.add(np.vstack([self._counts / samples, values]))
        self.forget()
        self._write(context, slices.centres, table)
        self.profile = {"coord": slices.centres.tolist(), "ncount": table[0].tolist()}
        self.profile |= {word: row.tolist() for word, row in zip(self._values, table[1:], strict=True)}

    def _write(self, context: Context, centres: np.ndarray, table: np.ndarray) -> None:
        # LAMMPS divides everything but this number by the number of windows
        lines = [f"{context.step} {table.shape[1]} {table[0].sum() * self._window.count:.15g}"]
        for k, (centre, column) in enumerate(zip(centres, table.T, strict=True), start=1):
            lines.append(f"  {k} {centre:g} {column[0]:g}" + "".join(self._form % value for value in column[1:]))
        self._file.write(context.state, lines)


_CHUNK_SIZES = {"norm": 1, "file": 1, "append": 1, "overwrite": 0, "format": 1, "adof": 1, "cdof": 1, "title1": 1, "title2": 1, "title3": 1}


def parse_ave_chunk(state: DeckState, name: str, group: str, args: list[str]) -> ChunkAverage:
    """Average of ``fix ID group ave/chunk Nevery Nrepeat Nfreq chunkID value value ... keyword values ...``."""
    read.count(args, "fix ID group ave/chunk Nevery Nrepeat Nfreq chunkID value value ...", 5, None)
    compute = state.computes.get(args[3])
    if compute is None or compute.style != "chunk/atom":
        known = ", ".join(other.name for other in state.computes.values() if other.style == "chunk/atom") or "none"
        raise ParameterError(f"fix ave/chunk: '{args[3]}' is not the id of a compute chunk/atom; defined are {known}")
    words, options = split_values(args[4:], ("c_", *_COMPONENTS, *_OWN), _CHUNK_SIZES, "ave/chunk")
    if not words:
        raise ParameterError(f"fix ave/chunk: expected {', '.join((*_COMPONENTS, *_OWN))}, c_id or c_id[column], not '{args[4]}'")
    for word in words:
        if word not in _OWN:
            check_bead_word(state, word, _COMPONENTS)
    norm = read.choice(options.get("norm", ["all"])[0], "norm", ("all", "sample", "none"))
    dof = (read.number(options.get("adof", ["3"])[0], "adof"), read.number(options.get("cdof", ["0"])[0], "cdof"))
    header = [
        f"# Chunk-averaged data for fix {name} and group {group}",
        "# Timestep Number-of-chunks Total-count",
        f"# Chunk Coord1 Ncount {' '.join(words)}",
    ]
    file, window = file_of(options, header), Window(options.get("ave", ["one"]))
    return ChunkAverage(
        group, compute, words, norm, dof, name, parse_schedule(state, "ave/chunk", args[:3]), window, file, form_of(options)
    )
