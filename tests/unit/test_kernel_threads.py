"""Threads: what waits how, and when one of them does the work alone."""

import os
import time

import pytest

from openmm_dpd.kernels import threads


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

    def parallel():
        clocks["passed"] += passed
        clocks["spent"] += spent
        return "parallel"

    return threads.dispatch(lambda: "serial", parallel)


def test_threads_with_a_core_each_go_on(watch):
    assert [called(watch, 0.004, 0.0075) for _ in range(20)] == ["parallel"] * 20


def test_threads_that_share_a_core_leave_the_work_to_one_for_a_while(watch):
    judged = int(threads._Watch.SPAN / 0.004) + 1
    assert [called(watch, 0.004, 0.004) for _ in range(judged + 2)] == ["parallel"] * judged + ["serial"] * 2
    watch["passed"] += threads._Watch.REST - 0.01
    assert called(watch, 0.004, 0.004) == "serial"
    watch["passed"] += 0.02
    assert [called(watch, 0.004, 0.004) for _ in range(judged + 1)] == ["parallel"] * judged + ["serial"]


def test_time_of_the_compiler_does_not_count(watch):
    assert [called(watch, 5.0, 5.0) for _ in range(5)] == ["parallel"] * 5


def test_waiting_threads_spin_for_a_short_time():
    """Importing the package chooses, unless the user has: spinning on, they take ten times as long on a busy machine."""
    assert os.environ["OMP_WAIT_POLICY"] and os.environ["GOMP_SPINCOUNT"]
