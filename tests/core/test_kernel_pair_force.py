"""The callable between OpenMM and the kernel, without OpenMM: displacements, fingerprints, pickling, phases."""

import pickle
from types import SimpleNamespace

import numpy as np
import pytest
from openmm import unit
from scenes import BOXES, EXTENDED, fluid

from openmm_dpd import RunError
from openmm_dpd.base.names import COUNTER, DT, KT, PHASE, SEED, TAU, Phase
from openmm_dpd.kernels import motion
from openmm_dpd.kernels.engine import CONSERVATIVE, DISSIPATIVE, RANDOM, PairEngine
from openmm_dpd.plan.forces.pair_force import PairForceFunction
from openmm_dpd.plan.forces.thread_state import fingerprint, only_folded
from openmm_dpd.plan.plan import make_plan

SCENE = fluid(EXTENDED, BOXES["tilted"], n=60)
SPEC = make_plan(SCENE, dt=0.02, seed=1).spec
PARAMETERS = {PHASE: 0.0, TAU: 1 / 64, DT: 0.02, KT: 1.3, COUNTER: 4.0, SEED: 9.0}


def state(x, phase, box=SCENE.box, **parameters):
    """What OpenMM hands to a PythonForce."""
    values = {**PARAMETERS, PHASE: float(phase), **parameters}
    return SimpleNamespace(
        getParameters=lambda: values,
        getStepCount=lambda: 0,
        _getNumParticles=lambda: len(x),
        _getVectorAsNumpy=lambda kind, out: np.copyto(out, x),
        getPeriodicBoxVectors=lambda asNumpy: box * unit.nanometer,
    )


@pytest.mark.parametrize("name", ["ortho", "tilted", "tilted_narrow"])
def test_beads_that_were_folded_back_are_where_they_were(name):
    """A GPU platform moves beads by whole boxes between two steps; any other change of a position is one."""
    rng, box = np.random.default_rng(1), BOXES[name]
    before = rng.random((200, 3)) @ box
    after = before + rng.integers(-2, 3, (200, 3)) @ box
    assert only_folded(after, before, box) and only_folded(after.astype(np.float32).astype(float), before, box)
    after[7, 1] += 0.001
    assert not only_folded(after, before, box)
    assert not only_folded(before, before, box)  # nothing was


def test_velocities_are_not_folded_into_the_box():
    """A bead that crosses several boxes within the drift is shown as fast as it is."""
    x = SCENE.positions
    v = np.random.default_rng(3).normal(size=x.shape) * 20 * SCENE.box[0, 0]
    seen = np.empty_like(v)
    motion.seen_velocities(x + 0.5 * v, x, 0.5, seen)
    np.testing.assert_allclose(seen, v, rtol=0, atol=1e-12)


def test_fingerprint_depends_on_every_bit():
    x, parameters = np.random.default_rng(2).random((50, 3)), np.array([1.0, 0.02, 7.0])
    found = {fingerprint(x, parameters)}
    for k in range(x.size):
        y = x.copy()
        y.flat[k] = np.nextafter(y.flat[k], 2)
        found.add(fingerprint(y, parameters))
    for k in range(3):
        changed = parameters.copy()
        changed[k] = np.nextafter(changed[k], 99)
        found.add(fingerprint(x, changed))
    found |= {fingerprint(x[::-1].copy(), parameters), fingerprint(x[:-1].copy(), parameters)}
    assert len(found) == 1 + x.size + 3 + 2
    assert all(0 <= value < 1e-250 for value in found)  # nobody may take it for an energy, and it must not vanish either
    assert fingerprint(x.copy(), parameters.copy()) == fingerprint(x, parameters)


def test_phases():
    """Every phase against the engine, with a velocity shown by a drift."""
    function, engine = PairForceFunction(SPEC, True, True), PairEngine(SPEC)
    x, v = SCENE.positions, SCENE.velocities
    seen = x + PARAMETERS[TAU] * v
    common = (PARAMETERS[KT], PARAMETERS[DT], 9, 4)

    def at(positions):
        engine.prepare(positions, SCENE.box)
        return engine

    energy, force = function(state(x, Phase.CONSERVE))
    expected = at(x).forces(CONSERVATIVE, None, *common)
    assert energy == expected[0] and np.array_equal(force, expected[1])
    assert function(state(x, Phase.IDLE))[0] == expected[0]
    for phase, result in {
        Phase.FORCE_SEEN: lambda: at(seen).forces(CONSERVATIVE | DISSIPATIVE | RANDOM, v, *common)[1],
        Phase.FORCE_KEPT: lambda: at(x).forces(DISSIPATIVE | RANDOM, v, *common)[1],
        Phase.SWEEP_SEEN: lambda: at(seen).sweep(v, *common) * SCENE.bead_masses[:, None] / PARAMETERS[DT],
        Phase.SWEEP_KEPT: lambda: at(x).sweep(v, *common) * SCENE.bead_masses[:, None] / PARAMETERS[DT],
    }.items():
        energy, force = function(state(seen, phase))
        assert energy == 0.0
        np.testing.assert_allclose(force, result(), rtol=0, atol=1e-9)


def test_what_is_asked_outside_of_a_step_sees_the_conservative_force_alone_and_disturbs_nothing():
    function, engine = PairForceFunction(SPEC, True, True), PairEngine(SPEC)
    later = SCENE.positions - 0.01 * SCENE.velocities
    function(state(SCENE.positions, Phase.CONSERVE))
    assert np.array_equal(function(state(later, Phase.IDLE))[1], function(state(later, Phase.CONSERVE))[1])
    engine.prepare(later, SCENE.box)
    assert np.array_equal(function(state(later, Phase.IDLE))[1], engine.forces(CONSERVATIVE, None, 0.0, 1.0, 0, 0)[1])
    energy, force = PairForceFunction(SPEC, False, True)(state(SCENE.positions, Phase.IDLE))
    assert energy == 0.0 and not force.any()
    with pytest.raises(RunError, match="before any positions were stored"):
        PairForceFunction(SPEC, False, True)(state(SCENE.positions, Phase.FORCE_SEEN))


def test_pickled_copies_do_the_same():
    function = PairForceFunction(SPEC, True, True)
    function(state(SCENE.positions, Phase.CONSERVE))  # what it keeps is not part of it
    copy = pickle.loads(pickle.dumps(function))
    assert len(pickle.dumps(function)) == len(pickle.dumps(copy)) < 8000
    for phase in (Phase.FINGERPRINT, Phase.CONSERVE, Phase.FORCE_KEPT):
        first, second = (f(state(SCENE.positions, phase)) for f in (function, copy))
        assert first[0] == second[0] and np.array_equal(first[1], second[1])
