"""``fix ave/time``: averages over steps of computes, variables and other averages."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from ..errors import ParameterError
from . import arguments as read
from .averages import Average, Window, file_of, form_of, parse_schedule, split_values
from .context import Context
from .thermo import check_word, compute_reference

if TYPE_CHECKING:
    from .state import DeckState


class TimeAverage(Average):
    """``fix ave/time``: single numbers (mode scalar), or whole vectors side by side (mode vector)."""

    def __init__(self, words: tuple[str, ...], vector: bool, *parts):
        super().__init__(*parts)
        self._words, self._vector = words, vector
        self._values = np.zeros(0)
        self.forget()

    @property
    def words(self) -> tuple[str, ...]:
        """What is averaged."""
        return self._words

    def forget(self) -> None:
        self._sum, self._count = np.zeros(0), 0

    def _read(self, context: Context, word: str) -> np.ndarray:
        if word.startswith("v_"):
            return np.array(context.variable(word[2:]))
        name, index = compute_reference(word)
        if word.startswith("f_"):
            return np.array(context.fix(name, index))
        return context.compute_vector(name) if self._vector else np.array(context.compute(name, index))

    def sample(self, context: Context) -> None:
        columns = [self._read(context, word) for word in self.words]
        if len({column.shape for column in columns}) > 1:
            lengths = ", ".join(f"{word}: {len(column)}" for word, column in zip(self.words, columns, strict=True))
            raise ParameterError(f"fix {self.name}: its vectors must be of one length ({lengths})")
        values = np.stack(columns, axis=-1)
        self._sum = values if not self._count else self._sum + values
        self._count += 1

    def close_window(self, context: Context) -> None:
        self._values = self._window.add(self._sum / self._count)
        self.forget()
        rows = np.atleast_2d(self._values)
        texts = ["".join(self._form % value for value in row) for row in rows]
        if self._vector:
            lines = [f"{context.step} {len(texts)}", *(f"{k}{text}" for k, text in enumerate(texts, start=1))]
        else:
            lines = [f"{context.step}{texts[0]}"]
        self._file.write(context.state, lines)

    def check_index(self, index: int | None) -> None:
        n = len(self.words)
        if self._vector and n > 1:
            raise ParameterError(f"f_{self.name}: several vectors side by side cannot be named; average them by fixes of their own")
        if self._vector and index is None:
            raise ParameterError(f"f_{self.name} is a vector; use f_{self.name}[1] and so on")
        if not self._vector and (index is None) != (n == 1):
            raise ParameterError(f"f_{self.name}: the fix averages {n} value{'s' * (n > 1)}; use f_{self.name}{'[1] and so on' * (n > 1)}")
        if not self._vector and index is not None and not 1 <= index <= n:
            raise ParameterError(f"f_{self.name}[{index}] is out of range: the fix averages {n} values")

    def value(self, index: int | None) -> float:
        self.check_index(index)
        if not self._values.size:
            return 0.0
        flat = self._values.ravel()
        if index is not None and not 1 <= index <= len(flat):
            raise ParameterError(f"f_{self.name}[{index}] is out of range: there are {len(flat)} values")
        return float(flat[0 if index is None else index - 1])


_TIME_SIZES = {"mode": 1, "file": 1, "append": 1, "start": 1, "overwrite": 0, "format": 1, "title1": 1, "title2": 1, "title3": 1}


def parse_ave_time(state: DeckState, name: str, group: str, args: list[str]) -> TimeAverage:
    """Average of ``fix ID group ave/time Nevery Nrepeat Nfreq value value ... keyword values ...``."""
    read.count(args, "fix ID group ave/time Nevery Nrepeat Nfreq value value ...", 4, None)
    words, options = split_values(args[3:], ("c_", "f_", "v_"), _TIME_SIZES, "ave/time")
    vector = read.choice(options.get("mode", ["scalar"])[0], "mode", ("scalar", "vector")) == "vector"
    if not words:
        raise ParameterError(f"fix ave/time: expected c_id, c_id[i], f_id or v_name, not '{args[3]}'")
    for word in words:
        if not vector:
            check_word(state, word)
            continue
        reference, index = compute_reference(word) if word.startswith("c_") else ("", 0)
        if index is not None:
            raise ParameterError(f"fix ave/time mode vector: expected the id of a compute with a vector (c_id), not '{word}'")
        check_word(state, f"c_{reference}[1]")
    start = read.integer(options["start"][0], "start", 0) if "start" in options else 0
    header = [f"# Time-averaged data for fix {name}", f"# TimeStep {' '.join(words)}"]
    if vector:
        header[1:] = ["# TimeStep Number-of-rows", f"# Row {' '.join(words)}"]
    file = file_of(options, header)
    window = Window(options.get("ave", ["one"]))
    return TimeAverage(words, vector, name, parse_schedule(state, "ave/time", args[:3], start), window, file, form_of(options))
