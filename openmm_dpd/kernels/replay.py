"""Steps that were recorded on a :class:`.tape.Tape`, played again in compiled code."""

from struct import Struct

import numpy as np

from .addresses import call_kernel, cycles, put_word, word
from .native import Kernel
from .noise import call_key, next_key
from .tape import Tape
from .team import crowded, meet

_NUMBER, _BITS = Struct("<d"), Struct("<Q")


def _play(calls, keys, kept, told, spent, steps, part, parts, team):
    """Do steps until one is not to be done, or threads are in each other's way.  Before each its state is kept; ``told`` has how many were
    complete, whether a kernel said anything (at every other call in one place, since a thread may be one call ahead), and that.  ``spent``
    (calls, threads, 2) has the time of each at work and waiting, if there is room."""
    for step in range(steps):
        if part == 0 and crowded(team, parts):
            told[3] = 1
        for k in range(len(kept)):
            for n in range(kept[k, 2] * part // parts, kept[k, 2] * (part + 1) // parts):
                put_word(kept[k, 1], n, word(kept[k, 0], n))
        for k in range(part, len(keys), parts):
            count = keys[k, 2] + np.uint64(step) * keys[k, 3]
            key = next_key(next_key(next_key(keys[k, 1], count), keys[k, 4]), keys[k, 5])
            put_word(np.int64(keys[k, 0]), 0, np.int64(key))
        meet(team, parts)
        if told[3] != 0:
            return 0
        for k in range(len(calls)):
            sharing, turn = parts if calls[k, 2] > 1 else 1, 1 + (step * len(calls) + k) % 2
            begun = cycles()
            if part < sharing and call_kernel(calls[k, 0], calls[k, 1], part, sharing, team) != 0:
                told[turn] = 1
            worked = cycles()
            meet(team, parts)
            if len(spent):
                spent[k, part, 0] += worked - begun
                spent[k, part, 1] += cycles() - worked
            if told[turn] != 0:
                return 1
        if part == 0:
            told[0] = step + 1
    return 0


_play_kernel = Kernel(_play)
_UNTIMED = np.zeros((0, 0, 2), np.int64)


def play(tape: Tape, counted: int, state: list[np.ndarray], steps: int, spent: np.ndarray = _UNTIMED) -> tuple[int, bool]:
    """Do up to so many steps like the recorded one, which has counted up the noise by ``counted``; returns how many were done, and whether
    one more was begun.  ``state`` are the arrays, contiguous, of 64-bit numbers, that a step begins with; they are as after the last step
    that was done.  ``spent`` is for who measures (benchmarks/profile_steps.py)."""
    packed = [np.frombuffer(bytearray(call.packed), np.int64) for call in tape.calls]
    calls = np.array(
        [(call.layout.address, words.ctypes.data, call.parts) for call, words in zip(tape.calls, packed, strict=True)], np.int64
    )
    keys = []
    for call, words in zip(tape.calls, packed, strict=True):
        place = call.layout.places.get("key")
        made = None if place is None else tape.keys.get(int(words.view(np.uint64)[place]))
        if place is not None and made is not None:
            bits = _BITS.unpack(_NUMBER.pack(made.kT))[0]
            keys.append((words[place:].ctypes.data, int(call_key(made.seed)), made.counted + counted, counted, made.layer, bits))
    before = [array.copy() for array in state]
    kept = np.array([(array.ctypes.data, copy.ctypes.data, array.size) for array, copy in zip(state, before, strict=True)], np.int64)
    told = np.zeros(4, np.int64)
    threads = max(call.parts for call in tape.calls)
    begun = bool(_play_kernel(calls, np.array(keys, np.uint64).reshape(-1, 6), kept, told, spent, steps, parts=threads))
    if begun:
        for array, copy in zip(state, before, strict=True):
            array[...] = copy
    return int(told[0]), begun
