"""What one step calls, recorded, so that many more can be done without Python.

A step calls the same kernels with the same arrays as the one before it; what differs is a word of some calls, such as the key of random
numbers.  So one step is recorded while Python does it, and :meth:`Tape.play` repeats it in compiled code until a kernel has something to
say: that a list has too little room, for example.  The step in which that happens is left to Python, from its beginning.
"""

import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from functools import cache
from struct import Struct
from typing import Any, NamedTuple

import numpy as np

from .addresses import call_kernel, copy_words, cycles, put_word
from .native import RUNNING, Kernel, KernelCall
from .team import be_patient, crowded, meet
from .threads import look

_NUMBER, _BITS = Struct("<d"), Struct("<Q")
#: Ctrl-C is heard between steps that are done at once: at first so many, then as many as take so many seconds.
_AT_FIRST, _ANSWERS = 10, 0.1
#: So many rounds of looking at another thread, for each number of the first array of the state, take less time than any kernel.
_ROUNDS = 1
#: The state is kept before every such step: that takes some hundredths of a step, and to come back to one is rare.
_EVERY = 16


class Changing(NamedTuple):
    """What a word was made of that is another one in each step."""

    counted: int  #: Goes up from step to step
    level: float  #: May be another one in each step
    numbers: tuple[int, ...]  #: Stay; the first of them says what else depends on the level


def _player(make: Any) -> Callable:
    """The function that plays steps whose changing words are made in this way."""

    def play(calls, words, levels, patched, patches, kept, told, spent, steps, part, parts, team):
        """Do steps until one is not to be done, or threads are in each other's way.  Now and then the state before one is kept.

        ``told`` has how many are done, or were when the state was kept if another one is not to be done; whether a kernel said anything (at
        every other call in one place, since a thread may be one call ahead); that threads are in each other's way; and how many were
        complete.  ``levels`` (steps,) are the bits of the levels, if these change, and ``patches`` (P, steps) the words that go to the
        places ``patched`` then.  ``spent`` (calls, threads, 2) has the time of each at work and waiting, if there is room."""
        if part == 0 and parts > 1:
            be_patient(team, _ROUNDS * kept[0, 2])
        for step in range(steps):
            if part == 0 and crowded(team, parts, step):
                told[3] = 1
            keeps = step % _EVERY == 0
            for k in range(len(kept) if keeps else 0):
                first, end = kept[k, 2] * part // parts, kept[k, 2] * (part + 1) // parts
                copy_words(kept[k, 0] + 8 * first, kept[k, 1] + 8 * first, end - first)
            for k in range(part, len(words), parts):
                level = levels[step] if len(levels) else words[k, 3]
                word = make(words[k, 4:], words[k, 1] + np.uint64(step) * words[k, 2], level)
                put_word(np.int64(words[k, 0]), 0, np.int64(word))
            for k in range(part, len(patched), parts):
                put_word(patched[k], 0, patches[k, step])
            meet(team, parts)
            if part == 0 and (keeps or told[3] != 0):
                told[0] = step
            if told[3] != 0:
                return 0
            for k in range(len(calls)):
                sharing, turn = parts if calls[k, 2] > 1 else 1, 1 + (step * len(calls) + k) % 2
                begun = cycles() if len(spent) else 0  # not all processors let everybody look at their clock
                if part < sharing and call_kernel(calls[k, 0], calls[k, 1], part, sharing, team) != 0:
                    told[turn] = 1
                worked = cycles() if len(spent) else 0
                meet(team, parts)
                if len(spent):
                    spent[k, part, 0] += worked - begun
                    spent[k, part, 1] += cycles() - worked
                if told[turn] != 0:
                    if part == 0:
                        told[4] = step
                    return 1
        if part == 0:
            told[0] = steps
        return 0

    return play


@cache
def _kernel(make: Any) -> Kernel:
    return Kernel(_player(make))


_UNTIMED = np.zeros((0, 0, 2), np.int64)
_CONSTANT = np.zeros(0, np.uint64), np.zeros(0, np.int64), np.zeros((0, 0), np.int64)


class Tape:
    """A step: recorded first, then finished, then played.

    Parameters
    ----------
    make : callable
        Compiled function (numbers (K,), counted, bits of the level), of uint64, -> the word that :meth:`tell` is told of.
    """

    def __init__(self, make: Callable):
        self._make = make
        self.calls: list[KernelCall] = []
        self._told: dict[str, dict[int, Changing]] = {}
        #: whether no kernel had anything to say
        self.smooth = True
        #: how many steps are to be done at once
        self.at_once = _AT_FIRST

    @contextmanager
    def recording(self) -> Iterator[None]:
        """A block in which all that this thread calls is recorded."""
        RUNNING.tape = self
        try:
            yield
        finally:
            RUNNING.tape = None

    @staticmethod
    def tell(name: str, word: Any, counted: int, level: float, *numbers: Any) -> None:
        """Say what a word of this name was made of that calls will get, to the tape that this thread records on, if there is one.  It is
        ``make(numbers, counted, bits of the level)``."""
        if RUNNING.tape is not None:
            RUNNING.tape._told.setdefault(name, {})[int(word)] = Changing(counted, level, numbers)

    def finish(self, counter: int, counted: int, state: list[np.ndarray], at_levels: Callable) -> None:
        """Make the step one that can be played.

        Parameters
        ----------
        counter, counted : int
            What was counted before the step, and by how much it has counted that up.
        state : list of ndarray
            Arrays, contiguous, of 64-bit numbers, that a step begins with.
        at_levels : callable
            (first number of a word, levels (S,)) -> what else its calls get at these levels, by name: numbers (S,), or arrays (S, ...), one
            for each step; or None where it cannot say.
        """
        self.counted, self._at_levels = counted, at_levels
        self._packed = [np.frombuffer(bytearray(call.packed), np.int64) for call in self.calls]
        both = list(zip(self.calls, self._packed, strict=True))
        self._calls = np.array([(call.layout.address, words.ctypes.data, call.parts) for call, words in both], np.int64)
        changing, self._depending = [], []
        for call, words in both:
            places = call.layout.places
            for name, told in self._told.items():
                made = told.get(int(words.view(np.uint64)[places[name]])) if name in places else None
                if made is not None:
                    bits = _BITS.unpack(_NUMBER.pack(made.level))[0]
                    changing.append((words[places[name] :].ctypes.data, made.counted - counter, counted, bits, *made.numbers))
                    self._depending.append((made.numbers[0], {its: words[at:].ctypes.data for its, at in places.items()}))
        self._words = np.array(changing or np.zeros((0, 4)), np.uint64)
        self._state, self._before = state, [array.copy() for array in state]
        both_states = zip(state, self._before, strict=True)
        self._kept = np.array([(array.ctypes.data, copy.ctypes.data, array.size) for array, copy in both_states], np.int64)
        # as many as each that is shared has room for: some calls may have been shared by more than others
        self.threads = min((call.parts for call in self.calls if call.parts > 1), default=1)

    def begins_with(self, *arrays: np.ndarray) -> bool:
        """Whether these are the arrays that the step begins with."""
        return len(arrays) == len(self._state) and all(one is other for one, other in zip(arrays, self._state, strict=True))

    def play(self, counter: int, steps: int, levels: np.ndarray | None = None, spent: np.ndarray = _UNTIMED) -> tuple[int, int | None]:
        """Do up to so many steps like it, with this counter before them, and at these levels (steps,) if they change; returns how many were
        done, and None; or, if one is not to be done, how many before it are to be done again: the state is as before these.  ``spent`` is
        for who measures (benchmarks/profile_steps.py)."""
        ramped = _CONSTANT if levels is None else self._ramped(levels)
        if ramped is None:
            return 0, None
        words, told = self._words.copy(), np.zeros(5, np.int64)
        words[:, 1] += np.uint64(counter)
        before = time.monotonic()
        begun = bool(_kernel(self._make)(self._calls, words, *ramped[:3], self._kept, told, spent, steps, parts=self.threads))
        self.at_once = int(min(max(1.0, steps * _ANSWERS / max(time.monotonic() - before, 1e-6)), 2 * steps + 2))
        if begun:
            for array, copy in zip(self._state, self._before, strict=True):
                array[...] = copy
        if told[3]:
            look()
        return int(told[0]), int(told[4] - told[0]) if begun else None

    def _ramped(self, levels: np.ndarray) -> tuple | None:
        """What changes with the level, as :func:`_player` has it (and what has to stay where it is); None where nobody can say."""
        patched, patches, found = [], [], {}
        for number, places in self._depending:
            if number not in found:
                found[number] = self._at_levels(number, levels)
            if found[number] is None:
                return None
            for name, its in found[number].items():
                if name in places or its.ndim > 1:  # a number may be of no use to a call
                    patched.append(places[name])
                    patches.append(its.view(np.int64) if its.ndim == 1 else its.ctypes.data + its.strides[0] * np.arange(len(levels)))
        return levels.view(np.uint64), np.array(patched, np.int64), np.array(patches, np.int64).reshape(-1, len(levels)), found
