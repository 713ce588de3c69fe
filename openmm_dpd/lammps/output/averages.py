"""What fixes that average have in common: LAMMPS's windows of steps, how they combine, and the files; and ``fix print``."""

from abc import ABC, abstractmethod
from collections import deque
from collections.abc import Mapping, Sequence

import numpy as np

from ...base.errors import ParameterError
from ...base.files import append_block, write_whole
from ..language import arguments as read
from ..state.deck_state import DeckState
from ..state.records import Valued
from ..values.resolver import Resolver
from .thermo import check_format, check_word


class Schedule:
    """Steps at which a value is taken: the last ``repeat`` multiples of ``every`` up to each multiple of ``freq``, that step included.  A
    window that has begun already at the present ``step`` is left out, and none ends before ``start``; but a single sample that is due at
    the present step is taken."""

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


class Every(Schedule):
    """Every multiple of ``every``, each of them a window."""

    def _first(self, step: int) -> int:
        return -(-max(step, self.start) // self.every) * self.every

    def advance(self) -> bool:
        """Count one sample."""
        self.taken += 1
        self.next += self.every
        return True


def intervals(style: str, words: Sequence[str]) -> tuple[int, int, int]:
    """``Nevery Nrepeat Nfreq``."""
    names = ("Nevery", "Nrepeat", "Nfreq")
    every, repeat, freq = (read.integer(word, f"{name} of fix {style}", 1) for name, word in zip(names, words, strict=True))
    if freq % every or repeat * every > freq:
        raise ParameterError(
            f"fix {style}: Nfreq must be a multiple of Nevery, at least Nrepeat*Nevery, but {' '.join(names)} are {every} {repeat} {freq}"
        )
    return every, repeat, freq


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
    """Text file of a fix, of the name that the option ``file`` or ``append`` says, if there is one: its header, and blocks behind it."""

    def __init__(self, state: DeckState, options: Mapping[str, list[str]], header: list[str]):
        if "file" in options and "append" in options:
            raise ParameterError("the options file and append exclude each other")
        self._name, self._header = options.get("file", options.get("append", [None]))[0], header
        self._append, self._overwrite = "append" in options, "overwrite" in options
        self._begun = False
        if self._name is not None:
            state.output_path(self._name, as_it_is=True)  # what is wrong with it is the mistake of this line
            if state.carried_out:
                self._start(state, self._name)

    def _start(self, state: DeckState, name: str) -> None:
        self._begun = True
        append_block(state.output_file(name, as_it_is=True), _lines(self._header), _WHAT, anew=not self._append)

    def write(self, state: DeckState, lines: list[str]) -> None:
        """Add a block, or put it in the place of the last one; OutputError if it cannot be written, and what is there stays."""
        if self._name is None:
            return
        if not self._begun:
            self._start(state, self._name)
        path = state.output_file(self._name, as_it_is=True)  # a run that goes on may have its folder at another place
        if self._overwrite:
            write_whole(path, _lines([*self._header, *lines]), _WHAT)
        else:
            append_block(path, _lines(lines), _WHAT)


def _lines(lines: Sequence[str]) -> str:
    return "".join(f"{line}\n" for line in lines)


class AveragingFix(Valued, ABC):
    """A fix that averages."""

    words: tuple[str, ...]  #: What it averages
    values: np.ndarray  #: The last average that was complete, as its indices go
    report: dict | None = None  #: The last average that was complete, for the file of results: ``step``, and by word a number or a list

    def __init__(self, state: DeckState, name: str, schedule: Schedule, options: dict[str, list[str]], header: list[str]):
        titles = [options.get(f"title{k}", [line])[0] for k, line in enumerate(header, start=1)]
        form = options.get("format", [" %g"])[0]
        check_format(form, of="float")
        self.name, self._schedule, self._form = name, schedule, form if form.startswith(" ") else f" {form}"
        self._file, self._window = AverageFile(state, options, titles), Windows(options.get("ave", ["one"]))

    @property
    def next_due(self) -> int:
        """The next step at which it takes a sample."""
        return self._schedule.next

    def begin(self, state: DeckState, step: int) -> None:
        """Prepare for a run."""
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
        """Average, write, and begin anew."""

    def value(self, *indices: int) -> float:
        """Value of ``f_name``, ``f_name[index]`` or ``f_name[row][column]``: 0 where there is no average yet, as in LAMMPS."""
        self.check_index(*indices)
        there = all(index <= size for index, size in zip(indices, self.values.shape, strict=True))
        return float(self.values[tuple(index - 1 for index in indices)]) if there else 0.0


# -- arguments ------------------------------------------------------------------------------------------------------------------
#: Options that all of these fixes have.
_SIZES = {"file": 1, "overwrite": 0, "title1": 1, "title2": 1, "title3": 1}


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


def check_words(state: DeckState, words: tuple[str, ...], style: str, first: str) -> tuple[str, ...]:
    """The words, if there are some and each names a number; ``first`` is what is in their place."""
    if not words:
        raise ParameterError(f"fix {style}: expected c_id, c_id[i], f_id or v_name, not '{first}'")
    for word in words:
        check_word(state, word)
    return words


class PrintFix:
    """``fix ID group print N text [file|append name] [screen yes|no] [title text]``: prints its text also at the first step of a run."""

    def __init__(self, state: DeckState, name: str, args: list[str]):
        read.count(args, "fix ID group print N text ...", 2, None)
        self.every, self.text, self.next_due = read.integer(args[0], "the interval of fix print", 1), args[1], 0
        options = dict(read.options(args[2:], {"file": 1, "append": 1, "screen": 1, "title": 1}, "fix print"))
        title = options.get("title", [f"# Fix print output for fix {name}"])
        self._show = read.switch(options.get("screen", ["yes"])[0], "screen")
        self._file = AverageFile(state, options, title)

    def begin(self, state: DeckState, step: int) -> None:
        """Prepare for a run from ``step`` on."""
        self.next_due = -(-step // self.every) * self.every

    def take(self, moment: Resolver) -> None:
        """Print; the moment is that of a step at which it is due."""
        text = moment.substituted(self.text)
        if self._show:
            moment.state.log(text)
        self._file.write(moment.state, [text])
        self.next_due += self.every
