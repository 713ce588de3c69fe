"""``fix ave/time``: averages over steps of computes, variables and other averages."""

import numpy as np

from ...errors import ParameterError
from ..language import arguments as read
from ..state.deck_state import DeckState
from ..state.records import ForceVector
from ..values.compute_spec import check_place, reference
from ..values.computes import average_of, compute_of, count_of, expanded, is_extensive
from ..values.resolver import Resolver
from .averages import AveragingFix, Schedule, check_words, common_parts, intervals, split_values
from .thermo import check_word, fields_read


class TimeAverage(AveragingFix):
    """``fix ave/time``: single numbers (mode scalar), or whole vectors side by side (mode vector)."""

    def __init__(self, words: tuple[str, ...], rows: int | None, off: list[int], extensive: list[list[bool]], *parts):
        super().__init__(*parts)
        # for each word, and for each value of its vector
        self._extensive = extensive
        # the length of the vectors, None in mode scalar
        self.words, self._off = words, off
        self._vector, n = rows is not None, len(words)
        self.shape = (*([rows] if self._vector else []), *([n] if n > 1 else []))
        self.what = f"the fix averages {n} {'vector' if self._vector else 'value'}{'s' * (n > 1)}" + f" of {rows} values" * self._vector
        self.values = np.zeros([size or 0 for size in self.shape])
        self.forget()

    def needs(self, state: DeckState) -> frozenset[str]:
        vectors = [f"{word}[1]" if self._vector and word[0] == "c" and "[" not in word else word for word in self.words]
        return fields_read(state, vectors)

    def forget(self) -> None:
        self._sum, self._count, self._latest = np.zeros(0), 0, np.zeros(0)

    def _read(self, moment: Resolver, word: str) -> np.ndarray:
        if not self._vector:
            return np.array(moment.number(word))
        kind, name, indices = reference(word)
        return moment.fix_vector(name) if kind == "f" else moment.compute_vector(name, *indices)

    def sample(self, moment: Resolver) -> None:
        values = np.stack([self._read(moment, word) for word in self.words], axis=-1)
        self._sum = values if not self._count else self._sum + values
        self._count += 1
        self._latest = values[..., self._off]

    def close_window(self, moment: Resolver) -> None:
        values = self._window.add(self._sum / self._count)
        # values that are not averaged: those of this step
        values[..., self._off] = self._latest
        self.values = values.reshape(self.values.shape)
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
        return self._extensive[word][row]


def parse_ave_time(state: DeckState, name: str, group: str, args: list[str]) -> TimeAverage:
    """AveragingFix of ``fix ID group ave/time Nevery Nrepeat Nfreq value value ... keyword values ...``."""
    read.count(args, "fix ID group ave/time Nevery Nrepeat Nfreq value value ...", 4, None)
    words, options = split_values(args[3:], ("c_", "f_", "v_"), {"off": 1, "mode": 1, "start": 1, "append": 1, "format": 1}, "ave/time")
    vector = read.choice(options.get("mode", ["scalar"])[0], "mode", ("scalar", "vector")) == "vector"
    words = expanded(state, words, tables=vector)
    rows = {_rows(state, word) for word in words} if vector and words else {None}
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
    size = rows.pop()
    # as in LAMMPS, what the values are sums over is settled here, once for all
    extensive = [[is_extensive(state, place) for place in _places(word, size)] for word in words]
    schedule = Schedule(*intervals("ave/time", args[:3]), state.step, start)
    return TimeAverage(words, size, off, extensive, *common_parts(state, name, schedule, options, header))


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
        if spec.tabled(compute) and indices:
            # a column of a table
            check_place(compute, spec, 1, indices[0])
            return spec.rows(compute)
    if kind == "v" or indices:
        raise ParameterError(f"fix ave/time mode vector: expected a compute or fix with a vector (c_id, f_id), not '{word}'")
    check_word(state, f"c_{name}[1]")
    return count_of(state, "c", name)
