"""A piece of whole steps that is interrupted anywhere leaves whole steps, and the run goes on as if nothing had been."""

import os
import re
import signal
import threading
import time

import numpy as np
import openmm
import pytest
from cases import cases, each_with, every_pair, raises
from kinds import N, everything, made, running, same
from lines import Lines
from scenes import beads, external_force
from tired import Tired

import openmm_dpd as dpd
from openmm_dpd.base.names import PORTABLE
from openmm_dpd.kernels import motion
from openmm_dpd.kernels.engine import PairEngine

STEPS, BEFORE, AFTER = 3, 2, 4


def add_force(built) -> None:
    built.system.addForce(external_force("2*x^2", N))


ALONE = {  # Name -> kind, scheme, and what is added.  In the first ones nothing but the kernel acts, and nothing else hears of steps.
    "middle": ("dpd", "middle", None),
    "mvv": ("dpd", "mvv", None),
    "ramp": ("ramp", "mvv-0.65", None),
    "energies": ("energies", "bababo", None),
    "bonded": ("bonded", "B/2 A/2 O A/2 B/2", None),
}
BESIDE = {
    "force": ("dpd", "shardlow", add_force),
    "ramp and force": ("ramp", "middle", add_force),
    "charges": ("charged", "mvv", None),
    "barostat": ("dpd", "aboba", lambda built: dpd.add_barostat(built, 20.0, interval=50)),
}


def started(kind, scheme, add):
    built = made(kind, scheme)
    if add is not None:
        add(built)
    simulation = running(built)
    simulation.integrator.step(BEFORE)
    return simulation


def all_of(simulation) -> dict:
    """State, globals and per-DOF variables; what programs hand from one platform to another says nothing by itself."""
    integrator = simulation.integrator
    found = everything(simulation.context, simulation.built)
    for k in range(integrator.getNumGlobalVariables()):
        name = integrator.getGlobalVariableName(k)
        if name not in PORTABLE or name == "ahead":
            found[f"global {name}"] = np.asarray(integrator.getGlobalVariable(k))
    parameters = simulation.context.getParameters()
    found |= {name: np.asarray(parameters[name]) for name in parameters if name not in ("dpd_phase", "dpd_tau", "dpd_begun")}
    return found


def failing(monkeypatch, owner, name: str, at: int, error) -> list[int]:
    """Has a function fail when it is called for the at-th time; how many calls there are until then."""
    real, left = getattr(owner, name), [at]

    def call(*arguments, **named):
        left[0] -= 1
        if left[0] == 0:
            raise error
        return real(*arguments, **named)

    monkeypatch.setattr(owner, name, call)
    return left


def interrupted(case, lines) -> dict[int, list[str]]:
    """What is wrong after an interruption before some of the lines of a piece, which ``lines`` chooses from their functions' names."""
    calm = started(*case)
    calm.integrator.step(STEPS)  # kernels are looked for once
    calm = started(*case)
    before = all_of(calm)
    with Lines() as trace:
        calm.integrator.step(STEPS)
    after = all_of(calm)
    calm.integrator.step(AFTER)
    end = all_of(calm)
    wrong = {}
    chosen = lines(trace.functions)
    assert chosen
    for at in chosen:
        simulation = started(*case)
        with pytest.raises(KeyboardInterrupt), Lines(at, KeyboardInterrupt()):
            simulation.integrator.step(STEPS)
        found = all_of(simulation)
        differing = min(same(found, before), same(found, after), key=len)
        if not differing:
            simulation.integrator.step(BEFORE + STEPS + AFTER - simulation.currentStep)
            differing = [f"{name} at the end" for name in same(all_of(simulation), end)]
        if differing:
            wrong[at] = differing
    return wrong


def until_given_back(functions: list[str]) -> int:
    return functions.index("_give_back") if "_give_back" in functions else len(functions)


@pytest.mark.parametrize("name", [name for name in (*ALONE, *BESIDE) if name != "charges"])
def test_an_interruption_at_some_lines(name):
    """Before the results go back to OpenMM; with forces or barostats, which have a way back, at any line."""
    case = (ALONE | BESIDE)[name]

    def lines(functions):
        last = until_given_back(functions) if name in ALONE else len(functions)
        return list(range(1, last, last // 8))

    assert not interrupted(case, lines)


@pytest.mark.slow
@pytest.mark.long
@pytest.mark.parametrize("name", [*ALONE, *BESIDE])
def test_an_interruption_at_any_line(name):
    case = (ALONE | BESIDE)[name]
    assert not interrupted(case, lambda functions: list(range(1, 1 + (until_given_back(functions) if name in ALONE else len(functions)))))


@pytest.mark.parametrize("name", ALONE)
def test_an_interruption_while_the_results_go_back(name):
    assert not interrupted(ALONE[name], lambda functions: list(range(until_given_back(functions) + 1, len(functions) + 1, 5)))


# -- errors of what a step calls -------------------------------------------------------------------------------------------------------
CALLS = [
    (PairEngine, "place"), (PairEngine, "keep"), (PairEngine, "sums"), (PairEngine, "swept"),
    (motion, "move"), (motion, "accelerate"),
]  # fmt: skip

#: What a scheme does not call.
UNUSED = {("swept", "mvv"), ("keep", "middle"), *(("accelerate", case) for case in ("middle", "energies", "force"))}
ERRORS = [dpd.RunError("too tired"), KeyboardInterrupt(), MemoryError("too tired")]


@every_pair("case, call, error", ("middle", "mvv", "energies", "force"), CALLS, ERRORS)
def test_calls_that_fail(case, call, error, monkeypatch):
    """At the first, third, ... call of ten steps: nothing has happened, the step is named, and the run goes on as if it had not been."""
    (owner, name), chosen = call, (ALONE | BESIDE)[case]
    calm = started(*chosen)
    expected = all_of(calm)
    calm.integrator.step(12)
    end = all_of(calm)
    real, tried = getattr(owner, name), 0
    for at in (1, 3, 8, 13, 18):
        simulation, left = started(*chosen), failing(monkeypatch, owner, name, at, error)
        try:
            simulation.integrator.step(10)
        except (openmm.OpenMMException, KeyboardInterrupt, MemoryError) as found:
            tried += 1
            assert not same(all_of(simulation), expected)
            if isinstance(error, dpd.RunError):
                assert isinstance(found, openmm.OpenMMException) and re.match(r"step \d+: too tired", str(found)), found
                step = int(str(found).split(":")[0].split()[1])
                assert BEFORE < step <= BEFORE + 10
                if (name, case) == ("swept", "middle"):
                    assert step == BEFORE + at  # one in each step
            else:
                assert isinstance(found, type(error))
            left[0] = 0
            simulation.integrator.step(12)
            assert not same(all_of(simulation), end)
        monkeypatch.setattr(owner, name, real)
    assert bool(tried) != ((name, case) in UNUSED)


CONTEXT_CALLS = ["setPositions", "setVelocities", "setParameter", "setStepCount", "setTime", "getState"]


@cases("name, case", *each_with(CONTEXT_CALLS, lambda _: ("middle", "mvv", "energies", "ramp", "force", "ramp and force"), 4))
def test_calls_of_openmm_that_fail(case, name, monkeypatch):
    """The first three calls of each kind in a piece, out of memory: nothing has happened, or all of the piece."""
    chosen = (ALONE | BESIDE)[case]
    calm = started(*chosen)
    before = all_of(calm)
    calm.integrator.step(5)
    after = all_of(calm)
    kind = type(calm.context)  # one of the package's own, whose calls do not go through the class of OpenMM
    real, wrong, tried = getattr(kind, name), [], 0
    for at in (1, 2, 3):
        simulation, left = started(*chosen), failing(monkeypatch, kind, name, at, MemoryError())
        try:
            simulation.integrator.step(5)
        except MemoryError:
            tried += 1
        monkeypatch.setattr(kind, name, real)
        if left[0] <= 0:
            found = all_of(simulation)
            wrong += min(same(found, before), same(found, after), key=len)
    assert tried
    assert not wrong


@cases("kind, scheme", *each_with(("dpd", "energies", "bonded", "ramp"), lambda _: ("middle", "mvv", "bababo", "O/2 B/2 A B/2 O/2"), 2))
def test_a_force_of_the_users_that_raises(kind, scheme):
    """At any of its evaluations in ten steps."""

    def tired_run():
        built, tired = made(kind, scheme, "CPU"), Tired(0.1)
        built.system.addForce(openmm.PythonForce(tired))
        simulation = running(built, "CPU")
        simulation.integrator.step(BEFORE)
        return simulation, tired

    calm, _ = tired_run()
    expected = all_of(calm)
    calm.integrator.step(14)
    end, failed = all_of(calm), 0
    for k in range(1, 12):
        simulation, tired = tired_run()
        tired.left = k
        try:
            simulation.integrator.step(10)
        except openmm.OpenMMException as error:
            assert "too tired to go on" in str(error)
            failed += 1
            assert not same(all_of(simulation), expected)
        tired.left = 0
        simulation.integrator.step(BEFORE + 14 - simulation.currentStep)
        assert not same(all_of(simulation), end)
    assert failed >= 10


# -- runs that break -------------------------------------------------------------------------------------------------------------------
def torn(speed: float):
    """Two beads that fly apart on a weak FENE bond, among others: it breaks in step 7 at speed 1."""
    n, dt = 40, 0.02
    x = np.random.default_rng(2).random((n, 3)) * 4.0
    x[0], x[1] = [1.0, 1.0, 1.0], [1.75, 1.0, 1.0]
    v = np.zeros((n, 3))
    v[0, 0], v[1, 0] = -speed, speed
    table = {("W", "W"): dpd.DPD(A=25, gamma=4.5), ("F", "*"): dpd.DPD(gamma=1e-6)}
    bonds = [dpd.FENEBonds(np.array([[0, 1]]), 1e-9, 1.01)]
    types = ["F", "F"] + ["W"] * (n - 2)
    return dpd.Scene({"W": 1.0, "F": 1.0}, types, x, table, 0.0, box=[4.0] * 3, velocities=v, bonds=bonds), dt


@pytest.mark.parametrize("scheme", ["middle", "aboba", "mvv", "shardlow", "bababo", "B/2 A/2 O A/2 B/2"])
def test_a_bond_that_breaks(scheme):
    """The bond is too long in the seventh of ten steps: no step is left, six can be done, and the step is named."""
    scene, dt = torn(1.0)
    simulation = running(dpd.build(scene, dt=dt, scheme=scheme, platform="CPU", seed=3), "CPU")
    before = all_of(simulation)
    with pytest.raises(openmm.OpenMMException, match=r"FENE.*0 and 1|bond.*0.*1") as found:
        simulation.integrator.step(10)
    step = int(re.match(r"step (\d+): ", str(found.value))[1])
    assert step in (7, 8)  # by the kicks between the drifts
    assert not same(all_of(simulation), before)
    simulation.integrator.step(step - 1)
    assert simulation.currentStep == step - 1
    with pytest.raises(openmm.OpenMMException) as again:
        simulation.integrator.step(1)
    assert str(again.value) == str(found.value)
    assert simulation.currentStep == step - 1


@pytest.mark.parametrize("scheme", ["middle", "aboba", "mvv", "shardlow", "bababo", "B/2 A/2 O A/2 B/2"])
@pytest.mark.parametrize("kind", ["plain", "beside a force"])
def test_a_start_that_runs_away(scheme, kind):
    """The message names the step and the bead, and positions are those of the last piece."""
    v = np.random.default_rng(2).normal(size=(81, 3))
    scene = beads(table={("W", "W"): dpd.DPD(A=25e5, gamma=4.5)}, velocities=v - v.mean(axis=0))
    built = dpd.build(scene, dt=1e-6, scheme=scheme, platform="CPU", seed=6)
    if kind != "plain":
        built.system.addForce(external_force("x^2", 81))
    simulation = running(built, "CPU")
    simulation.integrator.step(23)
    before = all_of(simulation)
    simulation.integrator.setStepSize(0.05)
    raises(openmm.OpenMMException, r"step 2[45]: bead \d+ moves .* step size is too large", simulation.integrator.step, 10)
    assert not same(all_of(simulation), before)


# -- Ctrl-C ----------------------------------------------------------------------------------------------------------------------------
@pytest.fixture
def ctrl_c():
    """Has a SIGINT come after some seconds, in any line."""
    if threading.current_thread() is not threading.main_thread() or not hasattr(signal, "setitimer"):
        pytest.skip("signals go to the main thread, and Windows has no such timer")
    before = signal.signal(signal.SIGALRM, lambda *_: signal.raise_signal(signal.SIGINT))
    yield lambda seconds: signal.setitimer(signal.ITIMER_REAL, seconds)
    signal.setitimer(signal.ITIMER_REAL, 0)
    signal.signal(signal.SIGALRM, before)
    assert signal.getsignal(signal.SIGINT) is signal.default_int_handler


@pytest.mark.parametrize(("platform", "loop"), [("CPU", True), ("Reference", False)])
def test_ctrl_c_at_any_moment(platform, loop, ctrl_c):
    """It is always a KeyboardInterrupt at a whole step, and the run goes on as if it had not been, to rounding where OpenMM sorts beads."""
    if platform not in [openmm.Platform.getPlatform(k).getName() for k in range(openmm.Platform.getNumPlatforms())]:
        pytest.skip("this platform is not here")

    def simulation():
        return running(made("dpd", "middle", platform, loop=loop), platform)

    broken, calm, rng = simulation(), simulation(), np.random.default_rng(4)
    for step in (broken.step, broken.integrator.step):
        for seconds in rng.uniform(1e-4, 5e-3 if loop else 2e-2, 10 if platform == "OpenCL" else 30):
            with pytest.raises(KeyboardInterrupt):
                ctrl_c(seconds)  # which may come before the first step
                step(100_000)
        assert broken.context.getTime()._value == pytest.approx(0.01 * broken.currentStep, rel=1e-9)
        broken.step(3)
        calm.step(broken.currentStep - calm.currentStep)
        found, expected = all_of(broken), all_of(calm)
        if platform == "OpenCL":
            assert np.abs(found["x"] - expected["x"]).max() < 1e-3
        else:
            assert not same(found, expected)


@pytest.mark.parametrize("conservative", ["kernel", "openmm"])
def test_ctrl_c_while_minimising(conservative, ctrl_c):
    """Where the kernel computes the forces, and where OpenMM does."""
    simulation = running(made("dpd", "middle", "CPU", conservative=conservative), "CPU")
    x = simulation.built.positions
    for seconds in np.random.default_rng(4).uniform(1e-4, 5e-3, 10):
        simulation.context.setPositions(x)
        with pytest.raises(KeyboardInterrupt):
            ctrl_c(seconds)
            for _ in range(1000):
                simulation.minimizeEnergy(1e-12)


def test_a_second_ctrl_c_acts_at_once(ctrl_c, monkeypatch):
    """In the middle of a step too, which is taken back."""
    simulation = started(*ALONE["middle"])
    before, left = all_of(simulation), []

    def asked_twice(*_):
        signal.raise_signal(signal.SIGINT)
        left.append("noted")
        signal.raise_signal(signal.SIGINT)
        left.append("too late")

    monkeypatch.setattr(PairEngine, "swept", asked_twice)
    with pytest.raises(KeyboardInterrupt):
        simulation.step(10)
    assert left == ["noted"]
    assert not same(all_of(simulation), before)


def test_handlers_of_others_and_other_threads_are_left_alone(ctrl_c):
    simulation, seen = started(*ALONE["middle"]), []

    def handler(number, frame):
        seen.append(number)

    signal.signal(signal.SIGINT, handler)
    try:
        ctrl_c(0.001)
        simulation.step(1000)
        assert signal.getsignal(signal.SIGINT) is handler
    finally:
        signal.signal(signal.SIGINT, signal.default_int_handler)
    assert seen == [signal.SIGINT]
    thread = threading.Thread(target=simulation.step, args=(1000,))
    thread.start()
    with pytest.raises(KeyboardInterrupt):
        signal.raise_signal(signal.SIGINT)
    thread.join()
    assert simulation.currentStep == BEFORE + 2000


@pytest.mark.skipif(threading.current_thread() is not threading.main_thread(), reason="signals go to the main thread")
@pytest.mark.parametrize("case", ["middle", "mvv", "energies", "force"])
def test_ctrl_c_in_a_long_run(case):
    """It acts at once, and what is left is a whole step."""
    chosen = (ALONE | BESIDE)[case]
    simulation = started(*chosen)
    sent = []

    def interrupt():
        time.sleep(0.3)
        sent.append(time.monotonic())
        os.kill(os.getpid(), signal.SIGINT)

    thread = threading.Thread(target=interrupt)
    thread.start()
    with pytest.raises(KeyboardInterrupt):
        simulation.integrator.step(100000)
    late = time.monotonic() - sent[0]
    thread.join()
    assert late < 2.0
    found = all_of(simulation)
    assert 2 < found["steps"] < 100000
    assert found["time"] == pytest.approx(0.01 * found["steps"], rel=1e-9)
    calm = started(*chosen)
    calm.integrator.step(int(found["steps"]) - BEFORE)
    assert not same(found, all_of(calm))


def test_steps_that_are_none():
    """No steps, and numbers that are none."""
    simulation = started(*ALONE["middle"])
    before = all_of(simulation)
    simulation.integrator.step(0)
    for wrong in (2.5, "3", None):
        with pytest.raises(TypeError):
            simulation.integrator.step(wrong)
    assert not same(all_of(simulation), before)
