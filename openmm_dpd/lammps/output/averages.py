"""What ``fix ave/time`` and ``fix ave/chunk`` have in common: LAMMPS's windows of steps, how they combine, and the files."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections import deque
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from ...errors import ParameterError
from ...files import append_block, write_whole
from ..language import arguments as read
from ..state.deck_state import DeckState
from ..values.resolver import Resolver
from .thermo import check_format, fields_read


class Schedule:
    """Steps at which a value is taken: the last ``repeat`` multiples of ``every`` up to each multiple of ``freq``, that step included.

    Parameters
    ----------
    every, repeat, freq : int
        LAMMPS's Nevery, Nrepeat and Nfreq.
    step : int
        Present step; a window that has begun already is left out.
    start : int
        No window ends before this step; but a single sample that is due at the present step is taken.
    """

    def __init__(self, every: int, repeat: int, freq: int, step: int, start: int = 0):
        self.every, self.repeat, self.freq, self.start = every, repeat, freq, start
        self.taken, self.next = 0, self._first(step)

    def _first(self, step: int) -> int:
        end = (max(step, self.start - 1) // self.freq + 1) * self.freq
        if self.repeat == 1 and end - self.freq == step:
            return step
        first = end - (self.repeat - 1) * self.every
        return first if first >= step else first + self.freq

    def begin(self, step: int) -> bool:
        """Prepare for a run from ``step`` on; True if a window that was open is lost, since steps of it were passed over."""
        if self.next >= step:
            return False
        lost = self.taken > 0
        self.taken, self.next = 0, self._first(step)
        return lost

    def advance(self) -> bool:
        """Count one sample; True if it was the last of its window."""
        self.taken += 1
        if self.taken < self.repeat:
            self.next += self.every
            return False
        self.taken = 0
        self.next += self.freq - (self.repeat - 1) * self.every
        return True


def parse_schedule(state: DeckState, style: str, words: Sequence[str], start: int = 0) -> Schedule:
    """Schedule from ``Nevery Nrepeat Nfreq``."""
    names = ("Nevery", "Nrepeat", "Nfreq")
    every, repeat, freq = (read.integer(word, f"{name} of fix {style}", 1) for name, word in zip(names, words, strict=True))
    if freq % every or repeat * every > freq:
        raise ParameterError(
            f"fix {style}: Nfreq must be a multiple of Nevery, at least Nrepeat*Nevery, but {' '.join(names)} are {every} {repeat} {freq}"
        )
    return Schedule(every, repeat, freq, state.step, start)


class Windows:
    """Combines the averages of single windows: ``ave one``, ``ave running`` or ``ave window M``."""

    def __init__(self, words: Sequence[str] = ("one",)):
        mode = read.choice(words[0], "ave", ("one", "running", "window"))
        length = read.integer(words[1], "the number of windows", 1) if mode == "window" else 1
        self._kept: deque[np.ndarray] = deque(maxlen=length)
        self._running, self._sum, self._count = mode == "running", np.zeros(0), 0

    @property
    def count(self) -> int:
        """Number of windows in the present average."""
        return self._count if self._running else len(self._kept)

    def add(self, values: np.ndarray) -> np.ndarray:
        """The average with one more window."""
        if self._running:
            self._sum = values.copy() if not self._count else self._sum + values
            self._count += 1
            return self._sum / self._count
        if self._kept and self._kept[0].shape != values.shape:
            self._kept.clear()  # the box has changed, and with it the number of slices
        self._kept.append(values)
        return np.mean(self._kept, axis=0)


_WHAT = "the file of averages"


class AverageFile:
    """Text file of a fix: its header, then one block after the other.  Nothing is opened before the first block or run."""

    def __init__(self, name: str | None, append: bool, overwrite: bool, header: list[str]):
        self.name, self.overwrite, self.header = name, overwrite, header
        self._append = append
        self._path: Path | None = None

    def start(self, state: DeckState) -> None:
        """Make the file, unless that is done."""
        if self.name is None or self._path is not None:
            return
        self._path = state.output_file(self.name)
        append_block(self._path, _lines(self.header), _WHAT, anew=not self._append)

    def write(self, state: DeckState, lines: list[str]) -> None:
        """Add a block, or put it in the place of the last one; OutputError if it cannot be written, and what is there stays."""
        if self.name is None:
            return
        self.start(state)
        assert self._path is not None
        if self.overwrite:
            write_whole(self._path, _lines([*self.header, *lines]), _WHAT)
        else:
            append_block(self._path, _lines(lines), _WHAT)


def _lines(lines: Sequence[str]) -> str:
    return "".join(f"{line}\n" for line in lines)


class AveragingFix(ABC):
    """A fix that averages.

    Attributes
    ----------
    words : tuple of str
        What it reads.
    name : str
        Id of the fix.
    """

    words: tuple[str, ...]

    def __init__(self, name: str, schedule: Schedule, window: Windows, file: AverageFile, form: str):
        self.name, self._schedule, self._window, self._file, self._form = name, schedule, window, file, form

    def needs(self, state: DeckState) -> frozenset[str]:
        """Fields of DeckSample that it reads."""
        return fields_read(state, self.words)

    @property
    def next_due(self) -> int:
        """The next step at which it takes a sample."""
        return self._schedule.next

    def begin(self, state: DeckState, step: int) -> None:
        """Prepare for a run."""
        self._file.start(state)
        if self._schedule.begin(step):
            self.forget()
            state.note(f"fix {self.name}: an average that was not complete is dropped, since steps of it were passed over")

    def take(self, moment: Resolver) -> None:
        """Take a sample; the moment is that of a step at which it is due."""
        self.sample(moment)
        if self._schedule.advance():
            self.close_window(moment)

    @abstractmethod
    def forget(self) -> None:
        """Drop the samples of the window that is open."""

    @abstractmethod
    def sample(self, moment: Resolver) -> None:
        """Add the present values to the window."""

    @abstractmethod
    def close_window(self, moment: Resolver) -> None:
        """AveragingFix, write, and begin anew."""

    @property
    def size(self) -> int:
        """Number of values that ``f_name[*]`` stands for."""
        return 0

    @abstractmethod
    def check_index(self, *indices: int) -> None:
        """Raise ParameterError unless ``f_name`` (no index), ``f_name[index]`` or ``f_name[row][column]`` has a value."""

    def is_extensive(self, *indices: int) -> bool:
        """Whether thermo output divides such a value by the number of beads when it normalises."""
        return False

    @abstractmethod
    def value(self, *indices: int) -> float:
        """Value of ``f_name``, ``f_name[index]`` or ``f_name[row][column]``: 0 before the first average is complete, as in LAMMPS."""


# -- arguments ------------------------------------------------------------------------------------------------------------------
#: Options that both fixes have.
_SIZES = {"file": 1, "append": 1, "overwrite": 0, "format": 1, "title1": 1, "title2": 1, "title3": 1}


def split_values(args: list[str], starts: tuple[str, ...], own: dict[str, int], style: str) -> tuple[tuple[str, ...], dict[str, list[str]]]:
    """Words at the beginning that are values (by how they start), and the options after them; ``own`` are those of the style."""
    n, sizes = 0, _SIZES | own
    while n < len(args) and args[n].startswith(starts):
        n += 1
    rest = args[n:]
    if n and rest and rest[0] not in {*sizes, "ave"}:
        raise ParameterError(f"fix {style}: '{rest[0]}' is neither a value nor an option that is supported here")
    found: dict[str, list[str]] = {}
    if n:
        at = rest.index("ave") if "ave" in rest else len(rest)
        # ave has one word after it, or two
        size = 2 if rest[at + 1 : at + 2] == ["window"] else 1
        for keyword, values in read.options(rest, {**sizes, "ave": size}, f"fix {style}"):
            found[keyword] = found.get("off", []) + values if keyword == "off" else values
    return tuple(args[:n]), found


def common_parts(
    state: DeckState, name: str, style: str, times: list[str], options: dict[str, list[str]], header: list[str], start: int = 0
) -> tuple[str, Schedule, Windows, AverageFile, str]:
    """Arguments of :class:`AveragingFix`: ``times`` are ``Nevery Nrepeat Nfreq``."""
    if "file" in options and "append" in options:
        raise ParameterError("the options file and append exclude each other")
    titles = [options.get(f"title{k}", [line])[0] for k, line in enumerate(header, start=1)]
    file = options.get("file", options.get("append", [None]))[0]
    if file is not None:
        state.output_path(file)  # what is wrong with it is the mistake of this line
    form = options.get("format", [" %g"])[0]
    check_format(form, of="float")
    written = AverageFile(file, "append" in options, "overwrite" in options, titles)
    schedule = parse_schedule(state, style, times, start)
    return name, schedule, Windows(options.get("ave", ["one"])), written, form if form.startswith(" ") else f" {form}"
