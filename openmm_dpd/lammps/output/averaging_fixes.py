"""``fix ave/time`` (averages of computes, variables and other averages), ``fix ave/correlate`` (time correlations) and ``fix ave/chunk``
(averages of per-bead values in bins of the box)."""

from collections import deque
from typing import Any

import numpy as np

from ...base.errors import ParameterError
from ...base.geometry import sums_in_slices
from ..language import arguments as read
from ..state.deck_state import DeckState
from ..state.records import FixValues
from ..values.chunk_computes import known_chunks
from ..values.chunks import chunk_numbers
from ..values.compute_spec import check_place, reference
from ..values.computes import average_of, check_bead_word, compute_of, count_of, expanded, is_extensive
from ..values.per_bead import BEAD_WORDS
from ..values.resolver import Resolver
from .averages import AveragingFix, Every, Schedule, check_words, intervals, split_values
from .thermo import check_word


class TimeAverage(AveragingFix):
    """``fix ID group ave/time Nevery Nrepeat Nfreq value value ... keyword values ...``, of single numbers (mode scalar) or of whole
    vectors side by side (mode vector)."""

    def __init__(self, state: DeckState, name: str, group: str, args: list[str]):
        read.count(args, "fix ID group ave/time Nevery Nrepeat Nfreq value value ...", 4, None)
        words, options = split_values(args[3:], ("c_", "f_", "v_"), {"off": 1, "mode": 1, "start": 1, "append": 1, "format": 1}, "ave/time")
        vector = read.choice(options.get("mode", ["scalar"])[0], "mode", ("scalar", "vector")) == "vector"
        words = expanded(state, words, tables=vector)
        rows = {_rows(state, word) for word in words} - {None} if vector else set()
        if len(rows) > 1:
            raise ParameterError(f"fix ave/time mode vector: {' '.join(words)} have different lengths ({', '.join(map(str, rows))})")
        if not (vector and words):
            check_words(state, words, "ave/time", args[3])
        off = [read.integer(number, "the value after off", 1) - 1 for number in options.get("off", [])]
        if off and max(off) >= len(words):
            raise ParameterError(f"fix ave/time: off {max(off) + 1}, but the fix averages {len(words)}")
        start = read.integer(options["start"][0], "start", 0) if "start" in options else 0
        header = [f"# Time-averaged data for fix {name}", f"# TimeStep {' '.join(words)}"]
        if vector:
            header[1:] = ["# TimeStep Number-of-rows", f"# Row {' '.join(words)}"]
        size = rows.pop() if rows else None
        # by word and row; as in LAMMPS this is decided once, when the fix is defined
        self._extensive = [[is_extensive(state, place) for place in _places(word, size)] for word in words]
        super().__init__(state, name, Schedule(*intervals("ave/time", args[:3]), state.step, start), options, header)
        self.words, self._off, self._vector, n = words, off, vector, len(words)
        self.shape = (*([size] if vector else []), *([n] if n > 1 else []))
        self.what = f"the fix averages {n} {'vector' if vector else 'value'}{'s' * (n > 1)}" + f" of {size or 'some'} values" * vector
        self.values = np.zeros([length or 0 for length in self.shape])
        self.forget()

    def forget(self) -> None:
        self._sum, self._count, self._latest = np.zeros(0), 0, np.zeros(0)

    def _read(self, moment: Resolver, word: str) -> Any:
        return moment.vector(word) if self._vector else moment.number(word)

    def sample(self, moment: Resolver) -> None:
        found = [self._read(moment, word) for word in self.words]
        if len(sizes := {len(each) for each in found} | ({len(self._sum)} if self._count else set()) if self._vector else ()) > 1:
            raise ParameterError(f"fix {self.name} (ave/time mode vector): the lengths of vectors differ or change: {sizes}")
        values = np.stack(found, axis=-1) if self._vector else np.array(found)
        self._sum = values if not self._count else self._sum + values
        self._count += 1
        self._latest = values[..., self._off]

    def close_window(self, moment: Resolver) -> None:
        values = self._window.add(self._sum / self._count)
        # values given by off are not averaged: take those of this step
        values[..., self._off] = self._latest
        self.values = values.reshape([length or -1 for length in self.shape])
        self.report = {"step": moment.step}
        for word, column in zip(self.words, np.moveaxis(values, -1, 0), strict=True):
            self.report[word] = column.tolist()
        self.forget()
        rows = np.atleast_2d(values)
        texts = ["".join(self._form % value for value in row) for row in rows]
        if self._vector:
            lines = [f"{moment.step} {len(texts)}", *(f"{k}{text}" for k, text in enumerate(texts, start=1))]
        else:
            lines = [f"{moment.step}{texts[0]}"]
        self._file.write(moment.state, lines)

    def is_extensive(self, *indices: int) -> bool:
        self.check_index(*indices)
        row = indices[0] - 1 if self._vector else 0
        word = indices[self._vector] - 1 if len(indices) > self._vector else 0
        return self._extensive[word][min(row, len(self._extensive[word]) - 1)]


def _places(word: str, rows: int | None) -> list[str]:
    """References to the single values of a word; the columns of a table all have the same properties."""
    if rows is None or word.startswith("v_"):
        return [word]
    return [word if "[" in word else f"{word}[{k}]" for k in range(1, rows + 1)]


def _rows(state: DeckState, word: str) -> int | None:
    """Length of the vector that a word names; None of a variable, whose length may change.  ParameterError if it names none."""
    kind, name, indices = reference(word)
    if kind == "v" and not indices and state.variables.get(name).style == "vector":
        return None
    if kind == "f":
        average = average_of(state, name)
        if indices or not isinstance(average, (TimeAverage, FixValues)) or not average.size:
            raise ParameterError(f"fix ave/time mode vector: {word} is not a fix with a vector")
        return average.size
    if kind == "c" and len(indices) < 2 and name in state.computes:
        compute, spec = compute_of(state, name)
        if spec.tabled(compute) and indices:
            # a column of its table
            check_place(compute, spec, 1, indices[0])
            return spec.rows(compute)
    if kind == "v" or indices:
        raise ParameterError(f"fix ave/time mode vector: expected c_id, f_id or v_name with a vector, not '{word}'")
    check_word(state, f"c_{name}[1]")
    return count_of(state, "c", name)


#: Pairs (earlier, later) of n values that are correlated, by type.
_PAIRS = {
    "auto": lambda n: [(i, i) for i in range(n)],
    "upper": lambda n: [(i, j) for i in range(n) for j in range(i + 1, n)],
    "lower": lambda n: [(i, j) for i in range(n) for j in range(i)],
    "auto/upper": lambda n: [(i, j) for i in range(n) for j in range(i, n)],
    "auto/lower": lambda n: [(i, j) for i in range(n) for j in range(i + 1)],
    "full": lambda n: [(i, j) for i in range(n) for j in range(n)],
    "first": lambda n: [(0, j) for j in range(n)],
}


class Correlation(AveragingFix):
    """``fix ID group ave/correlate Nevery Nrepeat Nfreq value value ... keyword values ...``."""

    def __init__(self, state: DeckState, name: str, group: str, args: list[str]):
        read.count(args, "fix ID group ave/correlate Nevery Nrepeat Nfreq value value ...", 4, None)
        every, windows, freq = intervals("ave/correlate", args[:3])
        words, options = split_values(args[3:], ("c_", "f_", "v_"), {"type": 1, "start": 1, "prefactor": 1}, "ave/correlate")
        words = check_words(state, expanded(state, words), "ave/correlate", args[3])
        pairs = _PAIRS[read.choice(options.get("type", ["auto"])[0], "type", tuple(_PAIRS))](len(words))
        if not pairs:
            raise ParameterError(f"fix ave/correlate: type {options['type'][0]} has no pairs for a single value")
        running = read.choice(options.get("ave", ["one"])[0], "ave", ("one", "running")) == "running"
        if "overwrite" in options and not running:
            raise ParameterError("fix ave/correlate: overwrite requires 'ave running', as in LAMMPS")
        prefactor = read.number(options.get("prefactor", ["1"])[0], "prefactor")
        start = read.integer(options.get("start", ["0"])[0], "start", 0)
        titles = [f"{words[i]}*{words[j]}" for i, j in pairs]
        header = [f"# Time-correlated data for fix {name}", "# Timestep Number-of-time-windows"]
        header.append(f"# Index TimeDelta Ncount {' '.join(titles)}")
        super().__init__(state, name, Every(every, 1, every, state.step, start), options, header)
        self.words, self._freq, self._prefactor, self._running = words, freq, prefactor, running
        self._early, self._late = ([pair[k] for pair in pairs] for k in (0, 1))
        self._titles, self._delays = titles, np.arange(windows) * every
        # columns: delay, number of products, means
        self.values = np.column_stack([self._delays, np.zeros((windows, 1 + len(pairs)))])
        self.shape, self.what = self.values.shape, f"the fix has {windows} rows and {2 + len(pairs)} columns"
        self.forget()

    def forget(self) -> None:
        self._kept: deque[np.ndarray] = deque(maxlen=len(self._delays))
        self._counts, self._sums = np.zeros(len(self._delays), dtype=np.int64), np.zeros((len(self._delays), len(self._early)))

    def sample(self, moment: Resolver) -> None:
        self._add(np.array([moment.number(word) for word in self.words]))

    def _add(self, values: np.ndarray) -> None:
        self._kept.append(values)
        before = np.array(self._kept)[::-1]
        self._counts[: len(before)] += 1
        self._sums[: len(before)] += before[:, self._early] * values[self._late]

    def close_window(self, moment: Resolver) -> None:
        if moment.step % self._freq:
            return
        counts = self._counts[:, None]
        means = np.divide(self._prefactor * self._sums, counts, out=np.zeros_like(self._sums), where=counts > 0)
        self.values = np.column_stack([self._delays, counts, means])
        columns = dict(zip(("delay", "count", *self._titles), self.values.T.tolist(), strict=True))
        self.report = {"step": moment.step} | columns
        rows = enumerate(zip(self._delays, self._counts, means, strict=True), start=1)
        lines = [
            f"{k} {delay} {count}" + "".join(self._form % value if count else " 0.0" for value in row) for k, (delay, count, row) in rows
        ]
        self._file.write(moment.state, [f"{moment.step} {len(lines)}", *lines])
        if not self._running:
            latest = self._kept[-1]
            self.forget()
            self._add(latest)


#: Values of ``fix ave/chunk`` that are not plain means over beads.
_OWN = ("density/number", "density/mass", "temp")
_COMPONENTS = ("vx", "vy", "vz", "fx", "fy", "fz", "mass")


class ChunkAverage(AveragingFix):
    """``fix ID group ave/chunk Nevery Nrepeat Nfreq chunkID value value ... keyword values ...``.  ``profile`` is the last complete block:
    ``coord`` (``coord1``, ``coord2`` and so on if several axes are cut), ``ncount``, and the values by name."""

    def __init__(self, state: DeckState, name: str, group: str, args: list[str]):
        read.count(args, "fix ID group ave/chunk Nevery Nrepeat Nfreq chunkID value value ...", 5, None)
        compute = known_chunks(state, args[3], "fix ave/chunk")
        own = {"norm": 1, "adof": 1, "cdof": 1, "append": 1, "format": 1}
        words, options = split_values(args[4:], ("c_", "v_", *_COMPONENTS, *_OWN), own, "ave/chunk")
        if not words:
            raise ParameterError(
                f"fix ave/chunk: expected {', '.join((*_COMPONENTS, *_OWN))}, c_id, c_id[column] or v_name, not '{args[4]}'"
            )
        words = expanded(state, words)
        for word in words:
            if word not in _OWN:
                check_bead_word(state, word, _COMPONENTS)
        norm = read.choice(options.get("norm", ["all"])[0], "norm", ("all", "sample", "none"))
        self._adof, self._cdof = (
            read.number(options.get(word, [default])[0], word) for word, default in (("adof", str(state.dimension)), ("cdof", "0"))
        )
        places = ["OrigID"] * compute.settings.compress + [f"Coord{k}" for k in range(1, len(compute.settings.axes) + 1)]
        header = [
            f"# Chunk-averaged data for fix {name} and group {group}",
            "# Timestep Number-of-chunks Total-count",
            " ".join(["# Chunk", *places, "Ncount", *words]),
        ]
        super().__init__(state, name, Schedule(*intervals("ave/chunk", args[:3]), state.step), options, header)
        self._group, self._compute, self.words, self._norm = group, compute, words, norm
        self.profile: dict[str, list[float]] | None = None
        columns = len(places) + 1 + len(words)
        self.shape, self.what, self.values = (None, columns), f"the fix has {columns} columns", np.zeros((0, columns))
        self.forget()

    def forget(self) -> None:
        self._bins: Any = None
        self._counts, self._sums, self._samples = np.zeros(0), np.zeros((0, 0)), 0

    def sample(self, moment: Resolver) -> None:
        number, self._bins = chunk_numbers(moment, self._compute, self._bins)
        if not self._samples:
            self._counts = np.zeros(self._bins.count)
            self._sums = np.zeros((len(self.words), self._bins.count))
        bins = self._bins
        kept = (number >= 0) & moment.state.group(self._group)
        number = number[kept]
        counts = sums_in_slices(number, None, bins.count)
        for k, word in enumerate(self.words):
            sums = self._of_beads(moment, word, number, kept, bins.count)
            self._sums[k] += sums if self._norm == "all" else self._normalised(moment, word, sums, counts, 1)
        self._counts += counts
        self._samples += 1

    @staticmethod
    def _of_beads(moment: Resolver, word: str, number: np.ndarray, kept: np.ndarray, count: int) -> np.ndarray:
        """Sum over the beads of each bin; for ``temp`` the sum of m v^2."""
        if word == "density/number":
            values = np.ones(len(number))
        elif word == "density/mass":
            values = BEAD_WORDS["mass"](moment)[kept]
        elif word == "temp":
            velocities = moment.velocities[kept] * moment.units.velocity
            values = moment.state.bead_masses()[kept] * np.sum(velocities**2, axis=1) / moment.units.thermal_energy
        else:
            values = moment.bead_values(word)[kept]
        return sums_in_slices(number, values, count)

    def _normalised(self, moment: Resolver, word: str, sums: np.ndarray, counts: np.ndarray, samples: int) -> np.ndarray:
        """Sums over the beads of ``samples`` samples, divided by the normalisation of the value; 0 for bins without beads."""
        assert self._bins is not None
        if word.startswith("density/"):
            unit = moment.units.density if word == "density/mass" else 1.0
            return unit * sums / (self._bins.volume * samples)
        by = counts
        if word == "temp":
            by = np.where(counts > 0, samples * self._cdof + self._adof * counts, 0.0)
        elif self._norm == "none":
            return sums
        return np.divide(sums, by, out=np.zeros_like(sums), where=by != 0)

    def close_window(self, moment: Resolver) -> None:
        bins, samples = self._bins, self._samples
        assert bins is not None
        values = self._sums / samples
        if self._norm == "all":
            pairs = zip(self.words, self._sums, strict=True)
            values = np.array([self._normalised(moment, word, sums, self._counts, samples) for word, sums in pairs])
        table = self._window.add(np.vstack([self._counts / samples, values]))
        self.forget()
        centres, dims = bins.centres, bins.centres.shape[1]
        names = ["coord"] if dims == 1 else [f"coord{k}" for k in range(1, dims + 1)]
        if bins.ids is not None:
            centres, names = np.column_stack([bins.ids, centres]), ["id", *names]
        self._write(moment, centres, table)
        self.values = np.vstack([centres.T, table]).T
        self.profile = {name: column.tolist() for name, column in zip(names, centres.T, strict=True)} | {"ncount": table[0].tolist()}
        self.profile |= {word: row.tolist() for word, row in zip(self.words, table[1:], strict=True)}

    def _write(self, moment: Resolver, centres: np.ndarray, table: np.ndarray) -> None:
        # LAMMPS divides everything except this number by the number of windows
        lines = [f"{moment.step} {table.shape[1]} {table[0].sum() * self._window.count:.15g}"]
        for k, (centre, column) in enumerate(zip(centres, table.T, strict=True), start=1):
            place = " ".join(f"{coordinate:g}" for coordinate in (k, *centre, column[0]))
            lines.append(f"  {place}" + "".join(self._form % value for value in column[1:]))
        self._file.write(moment.state, lines)
