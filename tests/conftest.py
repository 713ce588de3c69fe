"""Fixtures of the whole suite: platforms, precisions and threads."""

import gc
import os
import signal
import sys
from collections.abc import Iterator
from pathlib import Path

# a shell that starts the tests in the background has them ignore Ctrl-C, which some are about
if signal.getsignal(signal.SIGINT) is signal.SIG_IGN:
    signal.signal(signal.SIGINT, signal.default_int_handler)

os.environ.setdefault("NUMBA_NUM_THREADS", "2")  # a second thread can be asked for on any machine; has to be set before numba is imported

if sys.dont_write_bytecode:  # without it each process that tests start would compile all of the package anew
    sys.dont_write_bytecode = False
    os.environ.pop("PYTHONDONTWRITEBYTECODE", None)

import numba
import pytest
from devices import DEVICES, MARKS, Device, available, further_cases, gpu
from undrawn import draw_nothing

from openmm_dpd.plan import device as device_engine
from openmm_dpd.runtime import threads
from openmm_dpd.runtime.threads import set_threads

#: Tests that continuous integration leaves to the night, with what it still runs of the same part.
NIGHT = {line.partition("  #")[0] for line in (Path(__file__).parent / "night.txt").read_text().splitlines() if "::" in line}

gc.disable()  # until all tests are collected


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Leave to the slow tests the further precisions of GPU platforms, and to the long ones all but the first and the last case of each."""
    for item in items:
        if item.nodeid.removeprefix("tests/") in NIGHT:
            item.add_marker("long")
        if (device := gpu(item)) is not None:
            for mark in MARKS.get(device.precision, ()):
                item.add_marker(mark)
    for item in further_cases(items):
        for mark in ("slow", "long"):
            item.add_marker(mark)


def pytest_collection_finish() -> None:
    """Thousands of tests stay: whoever looks for garbage need not look at them."""
    gc.freeze()
    gc.enable()


@pytest.fixture(params=DEVICES, ids=str)
def device(request) -> Device:
    """Every platform in every precision it has."""
    return available(request.param)


@pytest.fixture(params=[d for d in DEVICES if d.exact], ids=str)
def host(request) -> Device:
    """The platforms that hand positions and pair forces over in double precision, bit for bit."""
    return available(request.param)


@pytest.fixture(autouse=True)
def engine_of_the_host(monkeypatch) -> None:
    """engine="auto" is the host's on GPUs too: the plugin has tests of its own (plugin/tests/on_the_device.py asks for it here)."""
    monkeypatch.setattr(device_engine, "is_gpu", lambda platform: False)


@pytest.fixture(autouse=True)
def undrawn(monkeypatch) -> None:
    """To draw the pictures of a run takes six times as long as a short run.  Tests of pictures have a fixture of this name that does nothing."""
    draw_nothing(monkeypatch.setattr)


@pytest.fixture(autouse=True)
def unsynced(monkeypatch) -> None:
    """No test cuts the power: to wait for the disk takes as long as a short run of a deck."""
    monkeypatch.setattr(os, "fsync", os.fstat)  # which also wants an open file


@pytest.fixture(autouse=True)
def one_thread() -> Iterator[None]:
    """The kernel uses one thread unless a test asks for more, and then for few beads, too."""
    set_threads(1)
    least, threads.LEAST = threads.LEAST, 1
    yield
    threads.LEAST = least
    set_threads(None)


@pytest.fixture
def two_threads() -> None:
    """Skip where numba was limited to one thread before it was imported."""
    if numba.config.NUMBA_NUM_THREADS < 2:
        pytest.skip("NUMBA_NUM_THREADS is 1")
