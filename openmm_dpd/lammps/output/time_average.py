"""``fix ave/time``: averages over steps of computes, variables and other averages."""

from __future__ import annotations

import numpy as np

from ...errors import ParameterError
from ..language import arguments as read
from ..state.deck_state import DeckState
from ..state.records import ForceVector
from ..values.compute_spec import check_place, reference
from ..values.computes import average_of, compute_of, count_of, expanded, is_extensive
from ..values.resolver import Resolver
from .averages import AveragingFix, common_parts, split_values
from .thermo import check_word, fields_read


class TimeAverage(AveragingFix):
    """``fix ave/time``: single numbers (mode scalar), or whole vectors side by side (mode vector).

    Attributes
    ----------
    report : dict or None
        The last average that was complete: ``step``, and by word a number or the list of a vector's.
    """

    def __init__(self, words: tuple[str, ...], rows: int | None, off: list[int], extensive: list[list[bool]], *parts):
        super().__init__(*parts)
        # for each word, and for each value of its vector
        self._extensive = extensive
        # the length of the vectors, None in mode scalar
        self.words, self._rows, self._off = words, rows, off
        self._vector = rows is not None
        self.report: dict | None = None
        self._values = np.zeros(0)
        self.forget()

    def needs(self, state: DeckState) -> frozenset[str]:
        vectors = [f"{word}[1]" if self._vector and word[0] == "c" and "[" not in word else word for word in self.words]
        return fields_read(state, vectors)

    def forget(self) -> None:
        self._sum, self._count, self._latest = np.zeros(0), 0, np.zeros(0)

    def _read(self, moment: Resolver, word: str) -> np.ndarray:
        kind, name, indices = found = reference(word)
        if kind == "v":
            return np.array(moment.variable_alone(name))
        if kind == "f":
            return moment.fix_vector(name) if self._vector else np.array(moment.fix(name, *indices))
        return moment.compute_vector(name, found.first) if self._vector else np.array(moment.compute(name, found.first, found.second))

    def sample(self, moment: Resolver) -> None:
        values = np.stack([self._read(moment, word) for word in self.words], axis=-1)
        self._sum = values if not self._count else self._sum + values
        self._count += 1
        self._latest = values[..., self._off]

    def close_window(self, moment: Resolver) -> None:
        self._values = self._window.add(self._sum / self._count)
        # values that are not averaged: those of this step
        self._values[..., self._off] = self._latest
        self.report = {"step": moment.step}
        for word, column in zip(self.words, np.moveaxis(self._values, -1, 0), strict=True):
            self.report[word] = column.tolist()
        self.forget()
        rows = np.atleast_2d(self._values)
        texts = ["".join(self._form % value for value in row) for row in rows]
        if self._vector:
            lines = [f"{moment.step} {len(texts)}", *(f"{k}{text}" for k, text in enumerate(texts, start=1))]
        else:
            lines = [f"{moment.step}{texts[0]}"]
        self._file.write(moment.state, lines)

    @property
    def size(self) -> int:
        if self._rows is None:
            return len(self.words) if len(self.words) > 1 else 0
        return self._rows if len(self.words) == 1 else 0

    def check_index(self, *indices: int) -> None:
        n = len(self.words)
        if self._vector:
            if len(indices) != (1 if n == 1 else 2):
                how = "[1] and so on" if n == 1 else "[row][column]"
                raise ParameterError(f"f_{self.name}: the fix averages {n} vector{'s' * (n > 1)}; use f_{self.name}{how}")
            if not 1 <= indices[0] <= (self._rows or 0):
                raise ParameterError(f"f_{self.name}[{indices[0]}] is out of range: the vector has {self._rows} values")
            indices = indices[1:]
        elif len(indices) != (n > 1):
            raise ParameterError(f"f_{self.name}: the fix averages {n} value{'s' * (n > 1)}; use f_{self.name}{'[1] and so on' * (n > 1)}")
        if any(not 1 <= index <= n for index in indices):
            raise ParameterError(f"f_{self.name}[{indices[0]}] is out of range: the fix averages {n} values")

    def is_extensive(self, *indices: int) -> bool:
        self.check_index(*indices)
        row = indices[0] - 1 if self._vector else 0
        word = indices[self._vector] - 1 if len(indices) > self._vector else 0
        return self._extensive[word][row]

    def value(self, *indices: int) -> float:
        self.check_index(*indices)
        if not self._values.size:
            return 0.0
        if self._vector:
            return float(self._values[indices[0] - 1, indices[1] - 1 if len(indices) > 1 else 0])
        return float(self._values[indices[0] - 1 if indices else 0])

    @property
    def vector(self) -> np.ndarray:
        """The values of ``f_name[*]``; zeros before the first average is complete."""
        return self._values.ravel() if self._values.size else np.zeros(self.size)


def parse_ave_time(state: DeckState, name: str, group: str, args: list[str]) -> TimeAverage:
    """AveragingFix of ``fix ID group ave/time Nevery Nrepeat Nfreq value value ... keyword values ...``."""
    read.count(args, "fix ID group ave/time Nevery Nrepeat Nfreq value value ...", 4, None)
    words, options = split_values(args[3:], ("c_", "f_", "v_"), {"off": 1, "mode": 1, "start": 1}, "ave/time")
    vector = read.choice(options.get("mode", ["scalar"])[0], "mode", ("scalar", "vector")) == "vector"
    if not words:
        raise ParameterError(f"fix ave/time: expected c_id, c_id[i], f_id or v_name, not '{args[3]}'")
    words = expanded(state, words, tables=vector)
    rows = {_rows(state, word) for word in words} if vector else {None}
    if len(rows) > 1:
        raise ParameterError(f"fix ave/time mode vector: {' '.join(words)} have different lengths ({', '.join(map(str, rows))})")
    for word in () if vector else words:
        check_word(state, word)
    off = [read.integer(number, "the value after off", 1) - 1 for number in options.get("off", [])]
    if off and max(off) >= len(words):
        raise ParameterError(f"fix ave/time: off {max(off) + 1}, but the fix averages {len(words)}")
    start = read.integer(options["start"][0], "start", 0) if "start" in options else 0
    header = [f"# Time-averaged data for fix {name}", f"# TimeStep {' '.join(words)}"]
    if vector:
        header[1:] = ["# TimeStep Number-of-rows", f"# Row {' '.join(words)}"]
    size = rows.pop()
    # as in LAMMPS, what the values are sums over is settled here, once for all
    extensive = [[is_extensive(state, place) for place in _places(word, size)] for word in words]
    return TimeAverage(words, size, off, extensive, *common_parts(state, name, "ave/time", args[:3], options, header, start))


def _places(word: str, rows: int | None) -> list[str]:
    """The single values that a word stands for; columns of tables are all alike."""
    return [word] if rows is None else [word if "[" in word else f"{word}[{k}]" for k in range(1, rows + 1)]


def _rows(state: DeckState, word: str) -> int:
    """Length of the vector that a word names; ParameterError if it is none."""
    kind, name, indices = reference(word)
    if kind == "f":
        average = average_of(state, name)
        if indices or not isinstance(average, (TimeAverage, ForceVector)) or not average.size:
            raise ParameterError(f"fix ave/time mode vector: {word} is not a fix with a vector")
        return average.size
    if kind == "c" and len(indices) < 2 and name in state.computes:
        compute, spec = compute_of(state, name)
        if spec.array is not None and indices:
            # a column of a table
            check_place(compute, spec, 1, indices[0])
            return spec.rows(compute)
    if kind == "v" or indices:
        raise ParameterError(f"fix ave/time mode vector: expected a compute or fix with a vector (c_id, f_id), not '{word}'")
    check_word(state, f"c_{name}[1]")
    return count_of(state, "c", name)
