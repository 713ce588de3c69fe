"""Threads that do the work of one kernel together.

The calling thread is the first of them.  The others are started once and wait for work: they spin for some milliseconds, because waking up
takes longer than most kernels, then they sleep.  All threads meet several times in a kernel, so a meeting must be fast: each adds one to a
counter and spins on another word until the last thread has come (0.2 us with a core each).  A thread that has waited for long yields to
others; :mod:`.threads` lets one thread work alone where there are not enough cores.

A team is an array of words at the places below.  Each word that threads write has a cache line of its own.
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
from .decorators import at_address, helper

# threads that have come to the present meeting, and number of meetings; the job, its kernel and words, rounds of a long wait in it, threads
# that have done it; whether a job is coming, address of the function that yields, and number of long waits in this job
_HERE, _MEETINGS, _JOB, _KERNEL, _WORDS, _LONG, _DONE, _COMING, _YIELD, _WAITS, _SIZE = 0, 16, 32, 33, 34, 35, 48, 64, 65, 80, 96
#: A job is its number times this, plus the number of threads.
_MOST = 1 << 16
#: From so many long waits on, a job may be crowded: if they are also half as many as its steps.
_CROWDED = 3
#: Rounds of spinning (20 to 50 ns each) after which a thread yields, and after which one without work goes to sleep.
_PATIENCE, _AWAKE = 50_000, 100_000
#: A number of rounds of the type that counters have in compiled code.
_NONE = np.int64(0)
#: The job that ends a thread.
_STOP = -1


@helper
def _let_others(team, rounds):
    """Wait for one round; returns the number of rounds so far."""
    pause()
    if rounds % _PATIENCE == _PATIENCE - 1 and word(team, _YIELD) != 0:
        call_plain(word(team, _YIELD))
    return rounds + 1


@helper
def meet(team, parts):
    """Wait for the other threads; whatever they wrote before is visible afterwards."""
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
    """Count a wait in this job as long only after so many rounds, if that is more than usual."""
    put_word(team, _LONG, max(rounds, _PATIENCE))


@helper
def crowded(team, parts, steps):
    """Whether threads have waited for each other for long in so many steps of this job that they cannot have a core each.  An occasional
    interruption does not count."""
    return parts > 1 and word(team, _WAITS) >= max(_CROWDED, steps // 2)


def _lead(team, kernel, words, job):
    """Publish a job, and do the share of the first thread; returns the value of the kernel."""
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
    """Do the shares of another thread, job by job; returns the last job after a long wait, or ``_STOP``."""
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
    """``_lead`` and ``_follow``, compiled; ctypes releases the interpreter's lock during a call."""
    found = []
    for function, arguments in ((_lead, 4), (_follow, 3)):
        made = at_address(function, (types.int64,) * arguments)
        called = ctypes.CFUNCTYPE(ctypes.c_int64, *(ctypes.c_int64,) * arguments)(made.address or 0)
        called.made = made  # type: ignore[attr-defined]  # the code belongs to it
        found.append(called)
    return found[0], found[1]


#: Type of a kernel as Python calls it, with one thread.
CALL = ctypes.CFUNCTYPE(ctypes.c_int64, ctypes.c_char_p, *(ctypes.c_int64,) * (len(ENTRY) - 1))


def _yield_address() -> int:
    """Address of the function of the operating system that yields to other threads; 0 where there is none."""
    try:
        return ctypes.cast(ctypes.CDLL(None).sched_yield, ctypes.c_void_p).value or 0
    except (AttributeError, OSError, TypeError):
        return 0


class _Member:
    """A thread of the team other than the calling one: what wakes it up, and whether it sleeps."""

    def __init__(self, team: "Team", part: int, last: int):
        self.bell, self.asleep = threading.Event(), False
        self.thread = threading.Thread(target=team.work, args=(self, part, last), daemon=True)


class Team:
    """As many threads as were ever asked for; the caller of :meth:`run` is the first."""

    def __init__(self) -> None:
        room = np.zeros(_SIZE + 8, np.int64)
        begin = -(room.ctypes.data // 8) % 8  # whole lines of the cache
        self._words = room[begin : begin + _SIZE]
        self._words[_YIELD] = _yield_address()
        self._address, self._jobs = self._words.ctypes.data, 0
        self._lead, self._follow = _functions()
        self._members: list[_Member] = []

    def work(self, member: _Member, part: int, last: int) -> None:
        """Work of a thread until the team stops."""
        while True:
            last = self._follow(self._address, part, last)
            if last == _STOP:
                return
            # the order matters: run() announces a job first, and then looks for threads that sleep
            member.bell.clear()
            member.asleep = True
            if not self._words[_COMING] and self._words[_JOB] == last:
                member.bell.wait()
            member.asleep = False

    def run(self, kernel: int, words: bytes, parts: int) -> int:
        """Have several threads do a kernel; returns its value for the first thread."""
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
        """End the threads."""
        self._words[_JOB] = _STOP
        for member in self._members:
            member.bell.set()
            member.thread.join()


_TEAMS: list[Team] = []
# a child process has no other threads, and their locks may be held
if hasattr(os, "register_at_fork"):
    os.register_at_fork(after_in_child=_TEAMS.clear)


@atexit.register
def _end() -> None:
    for team in _TEAMS:
        team.stop()


def the_team() -> Team:
    """The team of this process."""
    if not _TEAMS:
        _TEAMS.append(Team())
    return _TEAMS[0]
