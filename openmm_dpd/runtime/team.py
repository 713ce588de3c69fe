"""Threads that do the work of one kernel together.

The thread that calls is the first of them; the others are made once and wait for work: for some milliseconds they look for it again and
again, since to wake up takes longer than most kernels, then they sleep.  All meet several times in a kernel, so meeting is what has to be
quick: each adds one to a number, and looks at another one until the last has come (0.2 us with a core each).  Who has waited for long lets
others go first; :mod:`.threads` takes care that one thread works alone where there are not enough cores.

A team is an array of words, see the places below: each of those that threads write has a line of the processor's cache to itself.
"""

import atexit
import ctypes
import os
import threading
from collections.abc import Callable
from functools import cache

import numpy as np
from numba import types

from .addresses import ENTRY, add_to_word, call_kernel, call_plain, pause, put_word, share_word, shared_word, word
from .compiled import at_address, helper

# how many have come to the meeting, and how many meetings there were; the job, what it is, what is a long wait in it, and how many have
# done it; whether one is coming, how others are let go first, and how often somebody has waited for long in this job
_HERE, _MEETINGS, _JOB, _KERNEL, _WORDS, _LONG, _DONE, _COMING, _YIELD, _WAITS, _SIZE = 0, 16, 32, 33, 34, 35, 48, 64, 65, 80, 96
#: A job is its number times this, and how many threads share it.
_MOST = 1 << 16
#: So many long waits in one job are too many, if they are half as many as its steps.
_CROWDED = 3
#: Rounds of looking (some 20 to 50 ns each) after which others go first, and after which a thread without work goes to sleep.
_PATIENCE, _AWAKE = 50_000, 100_000
#: A number of rounds, of the type of all.
_NONE = np.int64(0)
#: The job after the last one.
_STOP = -1


@helper
def _let_others(team, rounds):
    """One round of waiting; returns how many there were."""
    pause()
    if rounds % _PATIENCE == _PATIENCE - 1 and word(team, _YIELD) != 0:
        call_plain(word(team, _YIELD))
    return rounds + 1


@helper
def meet(team, parts):
    """Wait for the others; what they did before is seen after it."""
    if parts > 1:
        meeting = shared_word(team, _MEETINGS)
        if add_to_word(team, _HERE, 1) == parts - 1:
            put_word(team, _HERE, 0)
            share_word(team, _MEETINGS, meeting + 1)
        else:
            rounds = _NONE
            while shared_word(team, _MEETINGS) == meeting:
                rounds = _let_others(team, rounds)
                if rounds == word(team, _LONG):
                    add_to_word(team, _WAITS, 1)


@helper
def be_patient(team, rounds):
    """Take waits in this job for long ones after so many rounds of looking, if that is more than usual."""
    put_word(team, _LONG, max(rounds, _PATIENCE))


@helper
def crowded(team, parts, steps):
    """Whether threads have waited for each other for so long in most of the steps of this job that they cannot have a core each: one that
    is interrupted now and then has one."""
    return parts > 1 and word(team, _WAITS) >= max(_CROWDED, steps // 2)


def _lead(team, kernel, words, job):
    """Publish a job, and do the share of the first thread; returns what the kernel does."""
    put_word(team, _KERNEL, kernel)
    put_word(team, _WORDS, words)
    put_word(team, _DONE, 0)
    put_word(team, _LONG, _PATIENCE)
    put_word(team, _WAITS, 0)
    share_word(team, _JOB, job)
    share_word(team, _COMING, 0)
    parts = job % _MOST
    found = call_kernel(kernel, words, 0, parts, team)
    rounds = _NONE
    while shared_word(team, _DONE) != parts - 1:
        rounds = _let_others(team, rounds)
    return found


def _follow(team, part, last):
    """The shares of another thread, one job after the other; returns the last one, or that it is to stop."""
    rounds = _NONE
    while rounds < _AWAKE:
        job = shared_word(team, _JOB)
        if job == last:
            rounds = _let_others(team, rounds)
            continue
        if job == _STOP:
            return job
        parts = job % _MOST
        if part < parts:
            call_kernel(word(team, _KERNEL), word(team, _WORDS), part, parts, team)
            add_to_word(team, _DONE, 1)
        last, rounds = job, _NONE
    return last


@cache
def _functions() -> tuple[Callable, Callable]:
    """Both, compiled; ctypes lets go of the interpreter's lock in a call."""
    found = []
    for function, arguments in ((_lead, 4), (_follow, 3)):
        made = at_address(function, (types.int64,) * arguments)
        called = ctypes.CFUNCTYPE(ctypes.c_int64, *(ctypes.c_int64,) * arguments)(made.address or 0)
        called.made = made  # type: ignore[attr-defined]  # the code belongs to it
        found.append(called)
    return found[0], found[1]


#: How Python calls a kernel, alone.
CALL = ctypes.CFUNCTYPE(ctypes.c_int64, ctypes.c_char_p, *(ctypes.c_int64,) * (len(ENTRY) - 1))


def _yield_address() -> int:
    """Of the function of the operating system that lets other threads go first; 0 where it is not known."""
    try:
        return ctypes.cast(ctypes.CDLL(None).sched_yield, ctypes.c_void_p).value or 0
    except (AttributeError, OSError, TypeError):
        return 0


class _Member:
    """A thread that follows, what wakes it up, and whether it sleeps."""

    def __init__(self, team: "Team", part: int, last: int):
        self.bell, self.asleep = threading.Event(), False
        self.thread = threading.Thread(target=team.work, args=(self, part, last), daemon=True)


class Team:
    """The threads, as many as were ever asked for; who calls :meth:`run` is the first."""

    def __init__(self) -> None:
        room = np.zeros(_SIZE + 8, np.int64)
        begin = -(room.ctypes.data // 8) % 8  # whole lines of the cache
        self._words = room[begin : begin + _SIZE]
        self._words[_YIELD] = _yield_address()
        self._address, self._jobs = self._words.ctypes.data, 0
        self._lead, self._follow = _functions()
        self._members: list[_Member] = []

    def work(self, member: _Member, part: int, last: int) -> None:
        """What a thread does until it is to stop."""
        while True:
            last = self._follow(self._address, part, last)
            if last == _STOP:
                return
            # the order matters: who has a job says so first, and then looks who sleeps
            member.bell.clear()
            member.asleep = True
            if not self._words[_COMING] and self._words[_JOB] == last:
                member.bell.wait()
            member.asleep = False

    def run(self, kernel: int, words: bytes, parts: int) -> int:
        """Have a kernel done by several threads; returns what it returns to the first."""
        for k in range(parts - 1):
            if k == len(self._members):
                self._members.append(_Member(self, k + 1, int(self._words[_JOB])))
            if self._members[k].thread.ident is None:
                self._members[k].thread.start()
        self._words[_COMING] = 1
        for member in self._members[: parts - 1]:
            if member.asleep:
                member.bell.set()
        self._jobs += 1
        at = ctypes.cast(ctypes.c_char_p(words), ctypes.c_void_p).value
        return self._lead(self._address, kernel, at, self._jobs * _MOST + parts)

    def stop(self) -> None:
        """Let the threads end."""
        self._words[_JOB] = _STOP
        for member in self._members:
            member.bell.set()
            member.thread.join()


_TEAMS: list[Team] = []
# in a child process there are no other threads, and what they wait for may be locked
if hasattr(os, "register_at_fork"):
    os.register_at_fork(after_in_child=_TEAMS.clear)


@atexit.register
def _end() -> None:
    for team in _TEAMS:
        team.stop()


def the_team() -> Team:
    """That of this process."""
    if not _TEAMS:
        _TEAMS.append(Team())
    return _TEAMS[0]
