"""Threads: what waits how, and when one of them does the work alone."""

import gc
import os
import signal
import threading
import time

import numpy as np
import pytest

from openmm_dpd.base.signals import unbroken
from openmm_dpd.io.pictures import new_figure, write_picture
from openmm_dpd.runtime import threads
from openmm_dpd.runtime.native import Kernel
from openmm_dpd.runtime.team import _TEAMS, meet


@pytest.fixture
def watch(monkeypatch, two_threads):
    """A fresh watch, two threads, and clocks that stop."""
    monkeypatch.setattr(threads, "_WATCH", threads._Watch())
    threads.set_threads(2)
    clocks = {"passed": 100.0, "spent": 50.0}
    monkeypatch.setattr(time, "perf_counter", lambda: clocks["passed"])
    monkeypatch.setattr(time, "process_time", lambda: clocks["spent"])
    return clocks


def called(clocks, passed, spent) -> str:
    """Which of the two versions a call of the given duration used."""

    return {1: "serial", 2: "parallel"}[shared(clocks, 2, passed, spent)]


def shared(clocks, count, passed, spent) -> int:
    """How many of so many threads shared a call."""

    def work(threads):
        if threads > 1:
            clocks["passed"] += passed
            clocks["spent"] += spent
        return threads

    return threads.dispatch(work, count)


def test_threads_with_a_core_each_go_on(watch):
    assert [called(watch, 0.004, 0.0075) for _ in range(20)] == ["parallel"] * 20


def test_threads_that_share_a_core_leave_the_work_to_one_for_a_while(watch):
    judged = int(threads._Watch.SPAN / 0.004) + 1
    assert [called(watch, 0.004, 0.004) for _ in range(judged + 2)] == ["parallel"] * judged + ["serial"] * 2
    watch["passed"] += threads._Watch.REST - 0.01
    assert called(watch, 0.004, 0.004) == "serial"
    watch["passed"] += 0.02
    assert [called(watch, 0.004, 0.004) for _ in range(judged + 1)] == ["parallel"] * judged + ["serial"]


def test_of_many_threads_half_go_on(watch):
    judged = int(threads._Watch.SPAN / 0.004) + 1
    assert [shared(watch, 16, 0.004, 0.03) for _ in range(judged)] == [16] * judged
    assert [shared(watch, 16, 0.004, 0.03) for _ in range(20)] == [8] * 20  # 7.5 cores are enough for those
    watch["passed"] += threads._Watch.REST
    assert shared(watch, 16, 0.004, 0.03) == 16


def test_another_number_of_threads_is_judged_by_itself(watch):
    """With two, each had a core; as four they would have had too little."""
    assert [shared(watch, 2, 0.004, 0.0075) for _ in range(12)] == [2] * 12
    assert [shared(watch, 4, 0.004, 0.0155) for _ in range(20)] == [4] * 20


def test_threads_that_have_waited_for_long_are_looked_at_at_once(watch):
    """They go on where each had a core nevertheless."""
    assert shared(watch, 16, 0.004, 0.06) == 16
    threads.look()
    assert shared(watch, 16, 0.004, 0.03) == 16
    threads.look()
    assert shared(watch, 16, 0.004, 0.01) == 8
    threads.look()
    assert shared(watch, 16, 0.004, 0.03) == 4 and shared(watch, 3, 0.004, 0.03) == 3


@pytest.fixture
def together(monkeypatch, two_threads):
    """Two threads, whatever the clock says about the cores."""
    monkeypatch.setattr(threads, "_WATCH", threads._Watch())
    monkeypatch.setattr(threads._Watch, "REST", -1.0)


def test_threads_share_a_kernel(together):
    """Each its part, and all meet; one alone does all of it."""

    def shared(numbers, meetings, part, parts, team):
        for k in range(meetings):
            for n in range(part, len(numbers), parts):
                numbers[n] += 1 if k == 0 else numbers[n - 1] - numbers[n] + 1 if n > k - 1 and n == k else 0
            meet(team, parts)
        return 7

    kernel = Kernel(shared, kept=False)
    for parts in (1, 2, 3):
        numbers = np.zeros(100, np.int64)
        assert kernel(numbers, 100, parts=parts) == 7
        assert np.array_equal(numbers, np.arange(1, 101))  # each from the one before it, which another thread wrote


def _called(numbers, part, parts, team):
    numbers[part] += 1
    return 0


def test_threads_wake_up_again(together):
    """After they went to sleep."""
    kernel, numbers = Kernel(_called, kept=False), np.zeros(2, np.int64)
    for _ in range(3):
        kernel(numbers, parts=2)
        time.sleep(0.1)
    assert numbers.tolist() == [3, 3]


@pytest.mark.skipif(not hasattr(os, "fork"), reason="there is no fork")
def test_a_child_process_works_whatever_its_parents_threads_do(together, tmp_path):
    """They are not there: not those of the team, not the one that has it work, and not those that compile, draw or keep signals waiting."""

    def shared(numbers, part, parts, team):
        for _ in range(50):
            numbers[part] += 1
            meet(team, parts)
        return 0

    def small(numbers, part, parts, team):
        return 0

    def draw():
        write_picture(tmp_path / "picture.png", new_figure(3, 2))

    def begun(work) -> threading.Thread:
        thread = threading.Thread(target=lambda: [work() for _ in iter(done.is_set, True)])
        thread.start()
        return thread

    def fork() -> None:
        child = os.fork()
        if child == 0:
            signal.alarm(60)  # which ends it, if it waits
            try:
                numbers = np.zeros(2, np.int64)
                kernel(numbers, parts=2)
                Kernel(small, kept=False)(numbers)
                write_picture(tmp_path / "child.png", new_figure(3, 2))
                _TEAMS[0].stop()
                worked = numbers.tolist() == [50, 50] and gc.isenabled()
                os.kill(os.getpid(), signal.SIGINT)
            except KeyboardInterrupt:
                os._exit(0 if worked else 1)
            finally:
                os._exit(2)
        codes.append(os.waitpid(child, 0)[1])

    kernel, done, codes = Kernel(shared, kept=False), threading.Event(), []
    threads_ = [
        begun(work) for work in (lambda: kernel(np.zeros(2, np.int64), parts=2), lambda: Kernel(small, kept=False)(np.zeros(1)), draw)
    ]
    with unbroken():
        for _ in range(6):
            forker = threading.Thread(target=fork)
            forker.start()
            forker.join()
    done.set()
    for thread in threads_:
        thread.join()
    assert codes == [0] * 6
