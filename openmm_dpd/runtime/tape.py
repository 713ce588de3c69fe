"""What one step calls, recorded, so that many more can be done without Python.

A step calls the same kernels with the same arrays as the step before; only a word of some calls changes, such as the key of random
numbers.  So one step is recorded while Python does it, and :meth:`Tape.play` repeats it in compiled code until a kernel does not return 0:
a list has too little room, for example.  That step is left to Python, from its beginning.
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
#: Ctrl-C acts between groups of played steps: at first so many, then as many as take so many seconds.
_AT_FIRST, _ANSWERS = 10, 0.1
#: A wait is long after so many rounds of spinning for each number of the first array of the state: more than the work of any kernel takes.
_ROUNDS = 1
#: The state is kept before every step of this number: that takes some hundredths of a step, and going back is rare.
_EVERY = 16


class Changing(NamedTuple):
    """What a changing word was made of."""

    counted: int  #: Counts up from step to step
    level: float  #: Constant, or another number in each step of a ramp
    numbers: tuple[int, ...]  #: Constant; the first tells what else depends on the level


def _player(make: Any) -> Callable:
    """The function that plays steps, whose changing words ``make`` makes."""

    def play(calls, words, levels, patched, patches, kept, noted, told, spent, steps, until, every, part, parts, team):
        """Do steps until a kernel does not return 0, or threads do not have a core each; returns 1 in the first case.

        ``told[0]``: steps done, or done when the state was last kept if a kernel did not return 0; ``told[1:3]``: whether one did not
        (calls use these in turn, since a thread may be one call ahead); ``told[3]``: whether threads lack cores; ``told[4]``: whole steps.
        ``calls[:, 3]``: 0 for calls of ordinary steps, 1 for those of every step of number ``every`` from ``until`` on, after which arrays
        are ``noted``: address, where it goes to the first time, length, and bytes from there to the next time.  ``kept``: addresses of each
        array of the state and of its copy, and its length.  On a ramp ``levels`` (steps,) has the bits of the
        levels, and ``patches`` (P, steps) the words for the addresses ``patched``.  ``spent`` (calls, threads, 2), unless empty, gets the
        cycles of each thread at work and waiting."""
        if part == 0 and parts > 1:
            be_patient(team, _ROUNDS * kept[0, 2])
        turn = 1
        for step in range(steps):
            times = (step - until) // every if step >= until and (step - until) % every == 0 else -1
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
                if (times >= 0) != (calls[k, 3] != 0):
                    continue
                sharing, turn = parts if calls[k, 2] > 1 else 1, 3 - turn
                begun = cycles() if len(spent) else 0  # some processors forbid reading the counter
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
            for k in range(len(noted) if part == 0 and times >= 0 else 0):
                copy_words(noted[k, 0], noted[k, 1] + times * noted[k, 3], noted[k, 2])
        if part == 0:
            told[0] = steps
        return 0

    return play


@cache
def _kernel(make: Any) -> Kernel:
    return Kernel(_player(make))


_UNTIMED, _NO_NOTES = np.zeros((0, 0, 2), np.int64), np.zeros((0, 4), np.int64)
_CONSTANT = np.zeros(0, np.uint64), np.zeros(0, np.int64), np.zeros((0, 0), np.int64)


class Tape:
    """A step that is recorded, then finished, then played.

    Parameters
    ----------
    make : callable
        Compiled function (numbers (K,), counted, bits of the level), of uint64, -> the word that :meth:`tell` is told of.
    """

    def __init__(self, make: Callable):
        self._make = make
        self.calls: list[KernelCall] = []
        self.told: dict[str, dict[int, Changing]] = {}
        #: results of its calls
        self.noted: list[np.ndarray] = []
        #: whether all kernels returned 0
        self.smooth = True
        #: number of steps to play before Ctrl-C may act
        self.at_once = _AT_FIRST

    @contextmanager
    def recording(self) -> Iterator[None]:
        """Context in which all kernels that this thread calls are recorded."""
        RUNNING.tape = self
        try:
            yield
        finally:
            RUNNING.tape = None

    @staticmethod
    def tell(name: str, word: Any, counted: int, level: float, *numbers: Any) -> None:
        """Tell the tape of this thread, if it records, how a word was made that calls get under a name: it is ``make(numbers, counted, bits
        of the level)``."""
        if RUNNING.tape is not None:
            RUNNING.tape.told.setdefault(name, {})[int(word)] = Changing(counted, level, numbers)

    @staticmethod
    def note(*found: np.ndarray) -> None:
        """Tell the tape of this thread, if it records, about results of calls: contiguous arrays of 64-bit numbers."""
        if RUNNING.tape is not None:
            RUNNING.tape.noted += found

    def finish(self, counter: int, counted: int, state: list[np.ndarray], at_levels: Callable) -> None:
        """Prepare the recorded step for :meth:`play`.

        Parameters
        ----------
        counter, counted : int
            Counter before the step, and by how much the step increases it.
        state : list of ndarray
            Contiguous arrays of 64-bit numbers with which a step begins.
        at_levels : callable
            (first number of a changing word, levels (S,)) -> other arguments of its calls at these levels, by name: numbers (S,), or arrays
            (S, ...), one for each step; None if they are unknown.
        """
        self.counted, self._at_levels = counted, at_levels
        self._packed = [np.frombuffer(bytearray(call.packed), np.int64) for call in self.calls]
        both = list(zip(self.calls, self._packed, strict=True))
        self.packed_calls = np.array([(call.layout.address, words.ctypes.data, call.parts, 0) for call, words in both], np.int64)
        changing, self._depending = [], []
        for call, words in both:
            places = call.layout.places
            for name, told in self.told.items():
                made = told.get(int(words.view(np.uint64)[places[name]])) if name in places else None
                if made is not None:
                    bits = _BITS.unpack(_NUMBER.pack(made.level))[0]
                    changing.append((words[places[name] :].ctypes.data, made.counted - counter, counted, bits, *made.numbers))
                    self._depending.append((made.numbers[0], {its: words[at:].ctypes.data for its, at in places.items()}))
        self.changing_words = np.array(changing or np.zeros((0, 4)), np.uint64)
        self._state, self._before = state, [array.copy() for array in state]
        both_states = zip(state, self._before, strict=True)
        self._kept = np.array([(array.ctypes.data, copy.ctypes.data, array.size) for array, copy in both_states], np.int64)
        # each kernel has room for as many threads as it was recorded with
        self.threads = min((call.parts for call in self.calls if call.parts > 1), default=1)

    def begins_with(self, *arrays: np.ndarray) -> bool:
        """Whether the step begins with these arrays."""
        return len(arrays) == len(self._state) and all(one is other for one, other in zip(arrays, self._state, strict=True))

    def play(
        self, counter: int, steps: int, levels: np.ndarray | None = None, seldom: tuple | None = None, spent: np.ndarray = _UNTIMED
    ) -> tuple[int, int | None]:
        """Repeat the step up to ``steps`` times, from this counter on, and on a ramp at these levels (steps,).

        Returns the number of steps done, and None if all went well.  If a kernel did not return 0 in a step, the state is that after the
        steps done, and the second number is how many steps follow before that one.  ``seldom``: another tape, how many steps come before
        the first of it, then from one to the next, and room (S, ...) for what is noted in each, for each array of its ``noted``; levels
        must be constant then.  ``spent`` is for benchmarks/profile_steps.py.
        """
        ramped = _CONSTANT if levels is None else self._ramped(levels)
        if ramped is None:
            return 0, None
        calls, words, told, noted, until, every = self.packed_calls, self.changing_words.copy(), np.zeros(5, np.int64), _NO_NOTES, steps, 1
        threads = self.threads
        if seldom is not None:
            its, until, every, room = seldom
            calls, words = np.vstack([calls, its.packed_calls + [0, 0, 0, 1]]), np.vstack([words, its.changing_words])
            pairs = zip(its.noted, room, strict=True)
            noted = np.array([(one.ctypes.data, rows.ctypes.data, one.size, rows.strides[0]) for one, rows in pairs], np.int64)
            threads = min(threads, its.threads)
        words[:, 1] += np.uint64(counter)
        before = time.monotonic()
        given = calls, words, *ramped[:3], self._kept, noted, told, spent, steps, until, every
        begun = bool(_kernel(self._make)(*given, parts=threads))
        self.at_once = int(min(max(1.0, steps * _ANSWERS / max(time.monotonic() - before, 1e-6)), 2 * steps + 2))
        if begun:
            for array, copy in zip(self._state, self._before, strict=True):
                array[...] = copy
        if told[3]:
            look()
        return int(told[0]), int(told[4] - told[0]) if begun else None

    def _ramped(self, levels: np.ndarray) -> tuple | None:
        """Arguments of the player that change with the level, and what must stay alive; None if they are unknown."""
        patched, patches, found = [], [], {}
        for number, places in self._depending:
            if number not in found:
                found[number] = self._at_levels(number, levels)
            if found[number] is None:
                return None
            for name, its in found[number].items():
                if name in places or its.ndim > 1:  # not every call needs a number
                    patched.append(places[name])
                    patches.append(its.view(np.int64) if its.ndim == 1 else its.ctypes.data + its.strides[0] * np.arange(len(levels)))
        return levels.view(np.uint64), np.array(patched, np.int64), np.array(patches, np.int64).reshape(-1, len(levels)), found
