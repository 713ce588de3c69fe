"""Kernels without physics: called, shared, recorded and played; and what the rest of the package knows of the runtime."""

import ast
from collections.abc import Iterator
from types import SimpleNamespace
from typing import NamedTuple

import numpy as np
import pytest
from import_graph import GRAPH, NODES, TREES

from openmm_dpd import runtime
from openmm_dpd.runtime import Kernel, Tape, inlined, meet, threads
from openmm_dpd.runtime.native import KernelCall


# -- the face of the room --------------------------------------------------------------------------------------------------------
def test_few_names_are_used_from_outside():
    face = {name for name, value in vars(runtime).items() if not name.startswith("_") and type(value) is not type(runtime)}
    outside = [module for module in TREES if not f"{module}.".startswith("openmm_dpd.runtime.")]
    assert not [module for module in outside for name in GRAPH[module] if name.startswith("openmm_dpd.runtime.")]
    nodes = [node for module in outside for node in NODES[module] if isinstance(node, ast.ImportFrom)]
    used = {alias.name for node in nodes if (node.module or "").rpartition(".")[2] == "runtime" for alias in node.names}
    assert used == face and len(face) <= 15


# -- calls -----------------------------------------------------------------------------------------------------------------------
def test_arguments_are_read_as_they_are_written():
    """Arrays of all kinds, numbers, and tuples in tuples."""

    class Record(NamedTuple):
        whole: int
        key: np.uint64
        inner: np.ndarray

    def told(out, record, real, yes, strided, plain, readonly, empty, more, part, parts, team):
        out[0], out[1], out[2], out[3] = record.whole, record.inner[1, 2], real, 1.0 if yes else 0.0
        out[4], out[5], out[6], out[7] = strided[2, 1], plain[3], readonly[1], len(empty)
        out[8], out[9] = more[1][0], np.float64(record.key >> np.uint64(60))
        return 0

    grid, readonly = np.arange(48.0).reshape(6, 8), np.arange(3, dtype=np.uint32)
    readonly.flags.writeable = False
    record = Record(-3, np.uint64(15) << np.uint64(60), np.arange(6.0).reshape(2, 3))
    kernel, out = Kernel(told, kept=False), np.zeros(10)
    arguments = (out, record, 2.5, True, grid[::2, ::4], np.arange(5), readonly, np.zeros(0), (1, (8,)))
    for _ in range(2):
        assert kernel(*arguments) == 0
        assert out.tolist() == [-3, 5, 2.5, 1, grid[4, 4], 3, 1, 0, 8, 15]
    assert kernel.versions == 1
    kernel(*arguments[:4], grid, *arguments[5:])  # contiguous now
    assert kernel.versions == 2 and out[4] == grid[2, 1]
    for whole in (4, 5, 5):  # from a memory, which has the last record
        assert kernel(out, record._replace(whole=whole), *arguments[2:], memory={Record: None}) == 0 and out[0] == whole
    assert kernel.versions == 3


# -- steps -----------------------------------------------------------------------------------------------------------------------
class Push(NamedTuple):
    word: np.uint64  #: Another one in each step
    table: np.ndarray  #: (1,)
    level: float


def _neighbours(x, before, push, part, parts, team):
    """Each number of a ring goes to the mean of its neighbours, and a bit further."""
    begin, end = len(x) * part // parts, len(x) * (part + 1) // parts
    for i in range(begin, end):
        before[i] = x[i]
    meet(team, parts)
    for i in range(begin, end):
        kick = np.float64((push.word + np.uint64(i)) % np.uint64(1000)) * 0.001
        x[i] = push.table[0] * (before[i - 1] + before[(i + 1) % len(x)]) + push.level * kick
    return 0


def _total(x, most, sums, part, parts, team):
    """The sum, in one order for any number of threads; 1 if it is too much."""
    meet(team, parts)
    if part == 0:
        sums[0] = 0.0
        for i in range(len(x)):
            sums[0] += x[i]
    meet(team, parts)
    return 1 if sums[0] > most else 0


@inlined
def _word(numbers, counted, level):
    return (numbers[1] + counted * np.uint64(0x9E3779B97F4A7C15)) ^ (level >> np.uint64(numbers[0]))


class Ring:
    """Steps of a ring of numbers."""

    kernels = Kernel(_neighbours, kept=False), Kernel(_total, kept=False)

    def __init__(self, parts: int, most: float):
        self.x, self.before, self.sums = np.arange(1000.0) % 7, np.zeros(1000), np.zeros(1)
        self.parts, self.most, self.counter = parts, most, 0

    def step(self, level: float = 1.5) -> int:
        self.counter += 1
        word = _word.py_func(np.array([3, 77], np.uint64), np.uint64(self.counter), np.float64(level).view(np.uint64))
        Tape.tell("word", word, self.counter, level, 3, 77)
        neighbours, total = self.kernels
        neighbours(self.x, self.before, Push(word, self.table(level), level), parts=self.parts)
        return total(self.x, self.most, self.sums, parts=self.parts)

    @staticmethod
    def table(level: float) -> np.ndarray:
        return np.array([0.5 - 0.01 * level])

    def recorded(self) -> Tape:
        tape = Tape(_word)
        with tape.recording():
            self.step()
        assert tape.smooth and [call.layout.name for call in tape.calls] == ["_neighbours", "_total"]
        tape.finish(self.counter - 1, 1, [self.x], self.at_levels)
        assert tape.begins_with(self.x) and not tape.begins_with(self.x.copy())
        return tape

    def at_levels(self, number: int, levels: np.ndarray) -> dict[str, np.ndarray] | None:
        assert number == 3
        return None if levels.max() > 100.0 else {"table": np.array([self.table(level) for level in levels]), "level": levels}


@pytest.fixture(params=[1, 2, 3])
def rings(request, monkeypatch, two_threads) -> Iterator:
    """Makes a ring whose steps Python does, and one for a number of threads, whatever the clock says about the cores."""
    monkeypatch.setattr(threads, "_WATCH", threads._Watch())
    monkeypatch.setattr(threads._Watch, "REST", -1.0)
    with np.errstate(over="ignore"):
        yield lambda most=np.inf: (Ring(1, most), Ring(request.param, most))


def played(tape: Tape, counter: int, steps: int, levels: np.ndarray | None = None) -> tuple[int, int | None]:
    """As :meth:`Tape.play`, which stops early where threads lack cores."""
    done, again = 0, None
    while done < steps and again is None:
        now, again = tape.play(counter + done, steps - done, None if levels is None else levels[done:])
        done += now
    return done, again


def test_played_steps_are_those_of_python(rings):
    """On a ramp too, where the table and the level are other ones in each step; and where nobody can say, none is played."""
    expected, ring = rings()
    levels = 1.5 + 0.25 * np.arange(40)
    for level in [1.5] * 60 + levels.tolist():
        assert expected.step(level) == 0
    ring.step()
    tape = ring.recorded()
    assert tape.threads == ring.parts and played(tape, 2, 58) == (58, None)
    assert tape.play(60, 40, 101.0 + levels) == (0, None)
    assert played(tape, 60, 40, levels) == (40, None)
    assert np.array_equal(ring.x, expected.x) and ring.sums == expected.sums


def test_some_steps_of_another_tape_note_what_they_find(rings):
    """Every fifth step, from the fourth one on; a step that does not go on is played again, and its notes are those of the last time."""
    expected, ring = rings(18000.0)
    plain = ring.recorded()
    seldom = Tape(_word)
    with seldom.recording():
        ring.step()
        Tape.note(ring.sums)
    seldom.finish(ring.counter - 1, 1, [ring.x], ring.at_levels)
    found = []
    while expected.step() == 0:
        found.append(expected.sums[0])
    done, notes = 2, []
    while True:
        room, until = [np.zeros((40, 1))], -(done - 5) % 5
        now, again = plain.play(done, 200, None, (seldom, until, 5, room))
        notes += room[0][: len(range(until, now, 5)), 0].tolist()
        done += now
        if again is not None:
            break
    # a step that fails takes up to 16 before it back
    assert len(notes) > 3 and notes == found[5:done:5]


def test_a_step_with_something_to_say_is_left_to_python(rings):
    """The state is that some steps before it, which are played again."""
    expected, ring = rings(18000.0)
    count = next(k for k in range(200) if expected.step())
    assert 20 < count < 180
    other = Ring(1, 18000.0)
    tape = ring.recorded()
    done, again = played(tape, 1, 200)
    assert again < 16 and 1 + done + again == count
    for _ in range(1 + done):
        other.step()
    assert np.array_equal(ring.x, other.x)
    assert played(tape, 1 + done, again) == (again, None)
    ring.counter = count
    with (again := Tape(_word)).recording():
        assert ring.step() == 1 and not again.smooth
    assert np.array_equal(ring.x, expected.x)


def test_shared_by_as_many_as_have_room():
    """Kernels that were recorded with more threads are played with fewer: each has room for its own."""
    tape, layout = Tape(_word), SimpleNamespace(address=0, places={})
    tape.calls = [KernelCall(layout, b"12345678", parts, ()) for parts in (1, 4, 3, 4)]  # type: ignore[arg-type]
    tape.finish(0, 0, [], lambda *arguments: None)
    assert tape.threads == 3
