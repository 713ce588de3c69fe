"""Lists and scratch of the engine after an error before any of its lines: the next forces are those of a new engine, bit for bit."""

import os
from contextlib import nullcontext
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from kinds import KINDS, SEED
from lines import PACKAGE, Lines

import openmm_dpd as dpd
from openmm_dpd.kernels import pairs
from openmm_dpd.kernels.engine import CONSERVATIVE, DISSIPATIVE, RANDOM, PairEngine
from openmm_dpd.runtime import threads as thread_count
from openmm_dpd.runtime.threads import set_threads

KERNELS = f"{Path(PACKAGE) / 'kernels'}{os.sep}"

ROOM = {"build", "grid", "_resize", "bin", "list", "_make_room", "scratch"}

#: Kind of scene, what the positions are multiplied with for the forces that are interrupted, how many threads there are, how the names of
#: the files begin in whose lines that happens, and what is called there.
CASES = {
    "the box grows": ("dpd", 1.4, 1, "", ROOM),
    "the box becomes small": ("tilted", 0.8, 1, "", ROOM),
    "no box": ("no box", 1.3, 1, "", ROOM),
    "columns become full": ("no box", 0.35, 1, "", ROOM),
    "many-body": ("mdpd lucy", 1.4, 1, "", ROOM | {"_sorted_densities"}),
    "internal energies": ("energies", 1.4, 1, "", ROOM),
    "threads": ("dpd", 1.4, 2, "", ROOM),
    "many beads": ("dpd", 1.4, 1, "", ROOM - {"list", "_make_room"} | {"passing"}),
    "many beads without a box": ("no box", 0.35, 1, "", ROOM - {"list", "_make_room"} | {"passing", "make_passing_room"}),
    "segments": ("bonded", 1.25, 1, "segments", {"add_to", "_set_reach"}),
    "charges": ("charged", 1.25, 1, "charges", {"_prepare", "_space_for"}),
}


def forces_at(engine: PairEngine, place: tuple, scene: dpd.Scene) -> list[np.ndarray]:
    """Everything that an engine computes at positions in a box."""
    x, box = place
    engine.prepare(x, box)
    fields = None if engine.spec.fields is None else engine.spec.fields.initial
    conditions = (1.0, 0.01, 1, 2, fields)
    found = [*engine.forces(CONSERVATIVE | DISSIPATIVE | RANDOM, scene.velocities, *conditions), engine.rates.copy()]
    if engine.spec.sweeps:
        found += [engine.swept(scene.velocities, *conditions), engine.increments.copy()]
    return [np.array(values) for values in found]


@pytest.fixture
def threads(request, monkeypatch):
    """So many threads, regardless of what the clock says about the cores: which lines are run, and how many, has to be the same each time.

    The lock goes: a tracer can raise where a with statement ends, before it lets go of the lock; signals and failed calls cannot.
    """
    monkeypatch.setattr(thread_count, "_PARALLEL_LOCK", nullcontext())
    monkeypatch.setattr(thread_count._WATCH, "until", 0.0)
    monkeypatch.setattr(thread_count._WATCH, "call", lambda threads, function: function(threads))
    set_threads(request.param)
    yield request.param
    set_threads(1)


@pytest.mark.parametrize(("kind", "scale", "threads", "files", "called"), CASES.values(), ids=CASES, indirect=["threads"])
def test_an_error_before_any_line(kind, scale, threads, files, called, monkeypatch):
    """Where the list gets other cells or more room, too: the next forces there, and back at the first place."""
    if "passing" in called:
        monkeypatch.setattr(pairs, "MANY", 0)
    scene = KINDS[kind]()
    built = dpd.build(scene, dt=0.01, scheme="middle", platform="CPU", conservative="kernel", seed=SEED)
    spec = built.integrator.whole.function.spec
    places = [(scene.positions * s, None if scene.box is None else np.array(scene.box) * s) for s in (1.0, scale)]
    expected = [forces_at(PairEngine(spec), place, scene) for place in places]
    calm = PairEngine(spec)
    forces_at(calm, places[0], scene)
    with Lines(files=KERNELS + files) as trace:
        forces_at(calm, places[1], scene)
    assert called <= set(trace.functions)
    wrong = []
    # two threads that share a core wait for each other: some lines only, there; every other one elsewhere, others for each kind
    for at in trace.places[len(kind) % 2 :: 2 if threads == 1 else 12]:
        engine = PairEngine(spec)
        forces_at(engine, places[0], scene)
        with pytest.raises(MemoryError), Lines(at, MemoryError(), KERNELS + files):
            forces_at(engine, places[1], scene)
        for which in (1, 0):
            if not all(map(np.array_equal, forces_at(engine, places[which], scene), expected[which])):
                wrong.append((at, trace.functions[at - 1], which))
    assert not wrong


def test_an_error_before_any_line_of_changing_seats():
    """The next change is that of a new engine, and what the scene has given stays as it was."""
    scene = KINDS["two layers"]()
    spec = dpd.build(scene, dt=0.01, scheme="middle", platform="CPU", conservative="kernel", seed=SEED).plan.spec
    spec = replace(spec, inv_mass=np.linspace(0.5, 1.0, len(spec.types)))
    names = np.random.default_rng(4).permutation(len(spec.types)).astype(np.uint32)
    places = np.argsort(names).astype(np.uint32)
    kept = spec.types.copy(), spec.inv_mass.copy()

    def seated(at: int | None) -> list[np.ndarray]:
        engine = PairEngine(spec)
        if at is not None:
            with pytest.raises(MemoryError), Lines(at, MemoryError(), f"{KERNELS}pairs"):
                engine.seat(names, places)
        with Lines(files=f"{KERNELS}pairs") as trace:
            engine.seat(names, places)
        lines.append(len(trace.functions))
        engine.prepare(np.ascontiguousarray(scene.positions[names]), np.array(scene.box))
        lists = engine.lists
        return [
            array for pairs in lists for array in (pairs.order, pairs.arrays.seats, pairs.arrays.inv_mass, pairs.arrays.types, pairs.beads)
        ]

    lines: list[int] = []
    expected = seated(None)
    for at in range(1, lines[0] + 1):
        assert all(map(np.array_equal, seated(at), expected)), at
    assert np.array_equal(spec.types, kept[0]) and np.array_equal(spec.inv_mass, kept[1])
