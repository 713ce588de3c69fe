"""Steps that were recorded on a :class:`.tape.Tape`, played again in compiled code."""

import time
from collections.abc import Callable
from functools import cache
from struct import Struct
from typing import Any

import numpy as np

from .addresses import call_kernel, copy_words, cycles, put_word
from .compiled import renamed
from .native import Kernel
from .tape import Tape
from .team import be_patient, crowded, meet
from .threads import look

_NUMBER, _BITS = Struct("<d"), Struct("<Q")
#: Ctrl-C is heard between steps that are done at once: at first so many, then as many as take so many seconds.
_AT_FIRST, _ANSWERS = 10, 0.1
#: So many rounds of looking at another thread, for each component of a bead, take less time than any kernel.
_ROUNDS = 1
#: The state is kept before every such step: that takes some hundredths of a step, and to come back to one is rare.
_EVERY = 16


def _play(calls, keys, heats, patched, patches, kept, told, spent, steps, part, parts, team):
    """Do steps until one is not to be done, or threads are in each other's way.  Now and then the state before one is kept.  ``told`` has
    how many are done, or were when the state was kept if another one is not to be done, whether a kernel said anything (at every other
    call in one place, since a thread may be one call ahead), that threads are in each other's way, and how many were complete.  On a ramp
    ``heats`` (steps,) are the bits of kT, and ``patches`` (P, steps) the words that go to the places ``patched``.  ``spent`` (calls,
    threads, 2) has the time of each at work and waiting, if there is room."""
    if part == 0 and parts > 1:
        be_patient(team, _ROUNDS * kept[0, 2])
    for step in range(steps):
        if part == 0 and crowded(team, parts, step):
            told[3] = 1
        keeps = step % _EVERY == 0
        for k in range(len(kept) if keeps else 0):
            first, end = kept[k, 2] * part // parts, kept[k, 2] * (part + 1) // parts
            copy_words(kept[k, 0] + 8 * first, kept[k, 1] + 8 * first, end - first)
        for k in range(part, len(keys), parts):
            count = keys[k, 1] + np.uint64(step) * keys[k, 2]
            heat = heats[step] if len(heats) else keys[k, 3]
            put_word(np.int64(keys[k, 0]), 0, np.int64(_make(keys[k, 4:], count, heat)))
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


#: What :func:`_player` puts in.
_make: Any = None


@cache
def _player(make: Callable) -> Kernel:
    """The kernel that plays steps with words that are made this way."""
    return Kernel(renamed(_play, "play", {"_make": make}))


_UNTIMED = np.zeros((0, 0, 2), np.int64)
_CONSTANT = np.zeros(0, np.uint64), np.zeros(0, np.int64), np.zeros((0, 0), np.int64)


class Recording:
    """A step that can be played again.

    Parameters
    ----------
    tape : Tape
        What it has called.
    counter, counted : int
        The counter of the noise before it, and by how much it has counted that up.
    state : list of ndarray
        Arrays, contiguous, of 64-bit numbers, that a step begins with.
    tables : callable
        (layer, kT (steps,)) -> its coefficients (steps, ...) at these thermal energies, or None where it cannot say.
    """

    def __init__(self, tape: Tape, counter: int, counted: int, state: list[np.ndarray], tables: Callable):
        self.counted, self._tape, self._tables = counted, tape, tables
        self._packed = [np.frombuffer(bytearray(call.packed), np.int64) for call in tape.calls]
        both = list(zip(tape.calls, self._packed, strict=True))
        self._calls = np.array([(call.layout.address, words.ctypes.data, call.parts) for call, words in both], np.int64)
        keys, self._heated = [], []
        for call, words in both:
            place = call.layout.places.get("key")
            made = None if place is None else tape.words.get(int(words.view(np.uint64)[place]))
            if place is not None and made is not None:
                bits = _BITS.unpack(_NUMBER.pack(made.kT))[0]
                keys.append((words[place:].ctypes.data, made.counted - counter, counted, bits, *made.numbers))
                self._heated.append((made.numbers[0], {name: words[at:].ctypes.data for name, at in call.layout.places.items()}))
        self._keys = np.array(keys or np.zeros((0, 4)), np.uint64)
        self._state, self._before = state, [array.copy() for array in state]
        both_states = zip(state, self._before, strict=True)
        self._kept = np.array([(array.ctypes.data, copy.ctypes.data, array.size) for array, copy in both_states], np.int64)
        # as many as each that is shared has room for; extras may have been shared by more than pairs
        self.threads = min((call.parts for call in tape.calls if call.parts > 1), default=1)
        self.names = [call.layout.name for call in tape.calls]
        #: how many are to be done at once
        self.at_once = _AT_FIRST

    def begins_with(self, *arrays: np.ndarray) -> bool:
        """Whether these are the arrays that the step begins with."""
        return len(arrays) == len(self._state) and all(one is other for one, other in zip(arrays, self._state, strict=True))

    def play(self, counter: int, steps: int, heats: np.ndarray | None = None, spent: np.ndarray = _UNTIMED) -> tuple[int, int | None]:
        """Do up to so many steps like it, with this counter before them, and thermal energies ``heats`` (steps,) if these change; returns
        how many were done, and None; or, if one is not to be done, how many before it are to be done again: the state is as before these.
        ``spent`` is for who measures (benchmarks/profile_steps.py)."""
        ramped = _CONSTANT if heats is None else self._ramped(heats)
        if ramped is None:
            return 0, None
        keys, told = self._keys.copy(), np.zeros(5, np.int64)
        keys[:, 1] += np.uint64(counter)
        before = time.monotonic()
        begun = bool(_player(self._tape.make)(self._calls, keys, *ramped[:3], self._kept, told, spent, steps, parts=self.threads))
        self.at_once = int(min(max(1.0, steps * _ANSWERS / max(time.monotonic() - before, 1e-6)), 2 * steps + 2))
        if begun:
            for array, copy in zip(self._state, self._before, strict=True):
                array[...] = copy
        if told[3]:
            look()
        return int(told[0]), int(told[4] - told[0]) if begun else None

    def _ramped(self, heats: np.ndarray) -> tuple | None:
        """What changes with the thermal energy, as :func:`_play` has it (and what has to stay where it is); None where a kernel depends on
        it in another way."""
        if not heats.min() > 0.0:
            return None
        bits, patched, patches, tables = heats.view(np.int64), [], [], {}
        for layer, places in self._heated:
            if layer not in tables:
                tables[layer] = self._tables(layer, heats)
            table = tables[layer]
            if table is None:
                return None
            patched.append(places["coefficients"])
            patches.append(table.ctypes.data + table.strides[0] * np.arange(len(heats)))
            if "kT" in places:
                patched.append(places["kT"])
                patches.append(bits)
        return heats.view(np.uint64), np.array(patched, np.int64), np.array(patches, np.int64).reshape(-1, len(heats)), tables
