"""Shared parts of averaging fixes: schedules, windows, files; and ``fix print``."""

import math
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
    """Steps at which samples are taken: the last ``repeat`` multiples of ``every`` up to each multiple of ``freq``, inclusive.  A window
    that would have begun before the present ``step`` is skipped, and none ends before ``start``; but a single sample due at the present
    step is taken."""

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
        """Prepare for a run that starts at ``step``.  Return True if an open window is dropped because some of its steps were skipped."""
        if self.next >= step:
            return False
        lost = self.taken > 0
        self.taken, self.next = 0, self._first(step)
        return lost

    def advance(self) -> bool:
        """Count one sample.  Return True if it completes a window."""
        self.taken += 1
        if self.taken < self.repeat:
            self.next += self.every
            return False
        self.taken = 0
        self.next += self.freq - (self.repeat - 1) * self.every
        return True


class Every(Schedule):
    """Steps at every multiple of ``every``; each sample is a window."""

    def _first(self, step: int) -> int:
        return -(-max(step, self.start) // self.every) * self.every

    def advance(self) -> bool:
        """Count one sample, which is a complete window."""
        self.taken += 1
        self.next += self.every
        return True


def intervals(style: str, words: Sequence[str]) -> tuple[int, int, int]:
    """Parse ``Nevery Nrepeat Nfreq``."""
    names = ("Nevery", "Nrepeat", "Nfreq")
    every, repeat, freq = (read.integer(word, f"{name} of fix {style}", 1) for name, word in zip(names, words, strict=True))
    if freq % every or repeat * every > freq:
        raise ParameterError(
            f"fix {style}: Nfreq must be a multiple of Nevery, at least Nrepeat*Nevery, but {' '.join(names)} are {every} {repeat} {freq}"
        )
    return every, repeat, freq


class Windows:
    """Combines the averages of windows: ``ave one``, ``ave running`` or ``ave window M``."""

    def __init__(self, words: Sequence[str] = ("one",)):
        mode = read.choice(words[0], "ave", ("one", "running", "window"))
        length = read.integer(words[1], "the number of windows", 1) if mode == "window" else 1
        self._kept: deque[np.ndarray] = deque(maxlen=length)
        self._running, self._sum, self._count = mode == "running", np.zeros(0), 0

    @property
    def count(self) -> int:
        """Number of windows in the current average."""
        return self._count if self._running else len(self._kept)

    def add(self, values: np.ndarray) -> np.ndarray:
        """Add a window and return the new average."""
        if self._running:
            self._sum = values.copy() if not self._count else self._sum + values
            self._count += 1
            return self._sum / self._count
        if self._kept and self._kept[0].shape != values.shape:
            self._kept.clear()  # the number of slices has changed with the box
        self._kept.append(values)
        return np.mean(self._kept, axis=0)


_WHAT = "the file of averages"


class AverageFile:
    """Output file of a fix, if the option ``file`` or ``append`` names one: a header followed by blocks."""

    def __init__(self, state: DeckState, options: Mapping[str, list[str]], header: list[str]):
        if "file" in options and "append" in options:
            raise ParameterError("the options file and append cannot be combined")
        self._name, self._header = options.get("file", options.get("append", [None]))[0], header
        self._append, self._overwrite = "append" in options, "overwrite" in options
        self._begun = False
        if self._name is not None:
            self._name = state.placed(self._name)
            if state.carried_out:
                self._start(state, self._name)

    def _start(self, state: DeckState, name: str) -> None:
        self._begun = True
        append_block(state.output_file(name, as_it_is=True), _lines(self._header), _WHAT, anew=not self._append)

    def write(self, state: DeckState, lines: list[str]) -> None:
        """Append a block, or replace the last one (``overwrite``).  OutputError if this fails; the file is then unchanged."""
        if self._name is None:
            return
        if not self._begun:
            self._start(state, self._name)
        path = state.output_file(self._name, as_it_is=True)  # a resumed run may have been moved to another folder
        if self._overwrite:
            write_whole(path, _lines([*self._header, *lines]), _WHAT)
        else:
            append_block(path, _lines(lines), _WHAT)


def _lines(lines: Sequence[str]) -> str:
    return "".join(f"{line}\n" for line in lines)


class AveragingFix(Valued, ABC):
    """A fix that computes averages."""

    words: tuple[str, ...]  #: What it averages
    values: np.ndarray  #: The last complete average, with the shape of the fix's values
    report: dict | None = None  #: The last complete average for the JSON results: ``step``, and a number or list by word

    def __init__(self, state: DeckState, name: str, schedule: Schedule, options: dict[str, list[str]], header: list[str]):
        titles = [options.get(f"title{k}", [line])[0] for k, line in enumerate(header, start=1)]
        form = options.get("format", [" %g"])[0]
        check_format(form, of="float")
        self.name, self._schedule, self._form = name, schedule, form if form.startswith(" ") else f" {form}"
        self._file, self._window = AverageFile(state, options, titles), Windows(options.get("ave", ["one"]))

    @property
    def next_due(self) -> int:
        """The next step at which a sample is due."""
        return self._schedule.next

    @property
    def even(self) -> tuple[int, float]:
        """Steps from one sample to the next, and the step up to which this holds."""
        its, steady = self._schedule, self._schedule.every * self._schedule.repeat == self._schedule.freq
        return its.every, math.inf if steady else its.next + (its.repeat - its.taken - 1) * its.every

    def begin(self, state: DeckState, step: int) -> None:
        """Prepare for a run."""
        if self._schedule.begin(step):
            self.forget()
            state.note(f"fix {self.name}: an incomplete average is dropped, since some of its steps were skipped")

    def take(self, moment: Resolver) -> None:
        """Take a sample at a step at which it is due."""
        self.sample(moment)
        if self._schedule.advance():
            self.close_window(moment)

    @abstractmethod
    def forget(self) -> None:
        """Drop the samples of the open window."""

    @abstractmethod
    def sample(self, moment: Resolver) -> None:
        """Add the present values to the open window."""

    @abstractmethod
    def close_window(self, moment: Resolver) -> None:
        """Compute and write the average, and start a new window."""

    def value(self, *indices: int) -> float:
        """Value of ``f_name``, ``f_name[index]`` or ``f_name[row][column]``; as in LAMMPS, 0 before the first average."""
        self.check_index(*indices)
        there = all(index <= size for index, size in zip(indices, self.values.shape, strict=True))
        return float(self.values[tuple(index - 1 for index in indices)]) if there else 0.0


# -- arguments ------------------------------------------------------------------------------------------------------------------
#: Options of all averaging fixes.
_SIZES = {"file": 1, "overwrite": 0, "title1": 1, "title2": 1, "title3": 1}


def split_values(args: list[str], starts: tuple[str, ...], own: dict[str, int], style: str) -> tuple[tuple[str, ...], dict[str, list[str]]]:
    """Split arguments into the leading values, recognised by how they start, and the options; ``own`` has the options of the style."""
    n, sizes = 0, _SIZES | own
    while n < len(args) and args[n].startswith(starts):
        n += 1
    rest = args[n:]
    if n and rest and rest[0] not in {*sizes, "ave"}:
        raise ParameterError(f"fix {style}: '{rest[0]}' is neither a value nor a supported option")
    found: dict[str, list[str]] = {}
    if n:
        at = rest.index("ave") if "ave" in rest else len(rest)
        # ave takes one value or, with window, two
        size = 2 if rest[at + 1 : at + 2] == ["window"] else 1
        for keyword, values in read.options(rest, {**sizes, "ave": size}, f"fix {style}"):
            found[keyword] = found.get("off", []) + values if keyword == "off" else values
    return tuple(args[:n]), found


def check_words(state: DeckState, words: tuple[str, ...], style: str, first: str) -> tuple[str, ...]:
    """The words.  ParameterError if there are none (``first`` is what stands in their place), or one is not a number."""
    if not words:
        raise ParameterError(f"fix {style}: expected c_id, c_id[i], f_id or v_name, not '{first}'")
    for word in words:
        check_word(state, word)
    return words


class PrintFix:
    """``fix ID group print N text [file|append name] [screen yes|no] [title text]``: prints at multiples of N, including the first step of
    a run."""

    def __init__(self, state: DeckState, name: str, group: str, args: list[str]):
        read.count(args, "fix ID group print N text ...", 2, None)
        self.every, self.text, self.next_due = read.integer(args[0], "the interval of fix print", 1), args[1], 0
        options = dict(read.options(args[2:], {"file": 1, "append": 1, "screen": 1, "title": 1}, "fix print"))
        title = options.get("title", [f"# Fix print output for fix {name}"])
        self._show = read.switch(options.get("screen", ["yes"])[0], "screen")
        self._file = AverageFile(state, options, title)

    def begin(self, state: DeckState, step: int) -> None:
        """Prepare for a run that starts at ``step``."""
        self.next_due = -(-step // self.every) * self.every

    def take(self, moment: Resolver) -> None:
        """Print the text at a step at which it is due."""
        text = moment.substituted(self.text)
        if self._show:
            moment.state.log(text)
        self._file.write(moment.state, [text])
        self.next_due += self.every


class DynamicGroup:
    """``group ID dynamic parent [region R] [var V] [every N]``: at the first step of a run and at multiples of N, the beads of the parent
    that are in a region and for which an atom-style variable is not 0."""

    def __init__(self, state: DeckState, name: str, args: list[str]):
        read.count(args, "group ID dynamic parent region|var|every value ...", 3, None)
        self.name, self.parent, self.next_due = name, args[0], 0
        if "property" in args:
            raise ParameterError("group dynamic property is not supported; use var with an atom-style variable")
        found = read.single(args[1:], "group dynamic", region="", var="", every="1")
        self.region, self.variable, self.every = found["region"], found["var"], read.integer(found["every"], "every", 1)
        if self.parent in (*state.dynamic, name):
            raise ParameterError(f"group {name} dynamic: the parent group {self.parent} cannot be dynamic, too")
        state.group(self.parent)
        if self.region:
            state.region(self.region)
        if self.variable and not state.variables.get(self.variable).style.startswith("atom"):
            raise ParameterError(f"group {name} dynamic: variable {self.variable} must be atom-style")

    def begin(self, state: DeckState, step: int) -> None:
        """Prepare for a run that starts at ``step``."""
        self.next_due = step

    def take(self, moment: Resolver) -> None:
        """Choose the members at a step at which this is due."""
        state = moment.state
        mask = state.group(self.parent).copy()
        if self.region:
            mask &= moment.region(self.region).contains(moment.folded[0])
        if self.variable:
            mask &= moment.bead_values(f"v_{self.variable}") != 0
        state.groups = state.groups | {self.name: mask}
        self.next_due = (moment.step // self.every + 1) * self.every
