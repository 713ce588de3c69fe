"""A step that fails leaves nothing half done: everything is as at a whole step, and what follows is what would have been without it."""

from dataclasses import dataclass, field

import numpy as np
import openmm
import pytest
from cases import every_pair, raises
from devices import DEVICES, Device
from openmm import unit
from scenes import beads, fluid, state_of
from tired import Tired

import openmm_dpd as dpd
from openmm_dpd.model.eos import ConstantHeatCapacity
from openmm_dpd.simulation.fields import raw_fields

SCHEMES = ("mvv", "shardlow", "middle", "aboba", "bababo")
SCHEME = pytest.mark.parametrize("scheme", SCHEMES)
DT = 0.02


@dataclass
class Run:
    """A Simulation, and what is known of it after every whole step."""

    simulation: object
    spec: object = None
    known: dict[int, dict] = field(default_factory=dict)

    def now(self) -> dict:
        """Everything that a step changes."""
        context = self.simulation.context
        state = context.getState(positions=True, velocities=True)
        x, v = state_of(context)
        found = {"x": x, "v": v, "steps": state.getStepCount(), "counter": context.getParameter("dpd_counter")}
        found["time"] = state.getTime().value_in_unit(unit.picosecond)
        found["box"] = np.array(state.getPeriodicBoxVectors(asNumpy=True)._value)
        found["kT"] = context.getParameter("dpd_kT")
        if self.spec is not None and self.spec.fields is not None:
            found["fields"] = raw_fields(context, self.spec.fields)
        return found

    def record(self, n: int) -> None:
        """Step one by one and remember."""
        for _ in range(n):
            self.known[self.now()["steps"]] = self.now()
            self.simulation.step(1)
        self.known[self.now()["steps"]] = self.now()


def agrees(found: dict, expected: dict, limit: float) -> None:
    """Two states are the same, to ``limit``."""
    assert (found["steps"], found["counter"]) == (expected["steps"], expected["counter"])
    for name in expected:
        assert np.abs(np.asarray(found[name]) - expected[name]).max() <= limit, (name, found["steps"])


def scene_of(kind: str) -> dpd.Scene:
    rng = np.random.default_rng(2)
    if kind == "energies":
        internal = dpd.InternalEnergy(ConstantHeatCapacity(60.0), rng.uniform(0.8, 1.2, 90))
        return fluid({("*", "*"): dpd.EnergyDPD(A=25, sigma=3, kappa=2.0)}, n=90, spread=0, internal=internal)
    v = rng.normal(size=(81, 3))
    kT = dpd.TemperatureRamp(1.0, 2.0, 2, 30) if kind == "ramp" else 1.0
    return beads(kT=kT, velocities=v - v.mean(axis=0))


def run_of(kind: str, device: Device, scheme: str, conservative: str = "auto", dt: float = DT, change=lambda system: None) -> Run:
    built = dpd.build(scene_of(kind), dt=dt, scheme=scheme, conservative=conservative, platform=device.platform, seed=6)
    change(built.system)
    return Run(built.simulation(properties=device.properties), built.plan.spec)


def tired_run(kind, device, scheme, conservative="auto") -> tuple[Run, Tired]:
    tired = Tired()
    force = openmm.PythonForce(tired)  # in a group that no force of the package's has: none of their own calls reaches it
    force.setForceGroup(0)
    return run_of(kind, device, scheme, conservative, change=lambda system: system.addForce(force)), tired


def fails_at_every_call(kind, device, scheme, conservative, calls, limit) -> None:
    """Interrupt a run at its k-th call in the third step and after it, for every k, and compare with the run that was never disturbed."""
    calm, _ = tired_run(kind, device, scheme, conservative)
    calm.record(8)
    failed = 0
    run, tired = tired_run(kind, device, scheme, conservative)
    start = run.simulation.context.getState(positions=True, velocities=True, parameters=True, integratorParameters=True)
    for k in (*calls, 10**6):  # the last one is never reached: an undisturbed run is repeated to ``limit``
        run.simulation.context.setState(start)
        run.simulation.step(2)
        tired.left = k
        try:
            run.simulation.step(4)
        except Exception as error:  # which class is OpenMM's affair
            assert "too tired" in str(error)
            failed += 1
        tired.left = 0  # some of these calls come in no step
        found = run.now()
        assert 2 <= found["steps"] <= 6
        assert run.simulation.currentStep == found["steps"]
        assert found["time"] == pytest.approx(found["steps"] * DT, abs=1e-12)
        agrees(found, calm.known[found["steps"]], limit)
        run.simulation.step(8 - found["steps"])
        agrees(run.now(), calm.known[8], limit)
    assert failed > 1


@every_pair(
    "host, scheme, conservative, kind",
    [device for device in DEVICES if device.exact],
    SCHEMES,
    ("openmm", "kernel"),
    ("plain", "ramp"),
    indirect=["host"],
)
def test_a_force_that_raises_leaves_a_whole_step(host, scheme, conservative, kind):
    """Wherever in a step the force of the user's is asked."""
    exact = host.platform == "Reference" or conservative == "kernel"
    fails_at_every_call(kind, host, scheme, conservative, range(1, 10), 1e-9 if exact else 1e-4)


@SCHEME
def test_energies_are_put_back_as_well(host, scheme):
    """Internal energies are per-DOF variables of the integrator."""
    fails_at_every_call("energies", host, scheme, "auto", range(1, 10), 1e-8 if host.platform == "Reference" else 1e-5)


@pytest.mark.slow
@pytest.mark.parametrize("scheme", ["mvv", "middle", "bababo"])
def test_on_every_device(device, scheme):
    """... in single precision as well."""
    fails_at_every_call("plain", device, scheme, "auto", (1, 2, 3, 4), device.choose(1e-4, 1e-3, 1e-3))


@SCHEME
def test_failures_in_the_middle_of_many_steps(host, scheme, tmp_path):
    """Simulation.step(25) goes in pieces, of which at most the one that failed is lost; what is saved afterwards is a state."""
    calm, _ = tired_run("plain", host, scheme, "kernel")
    calm.record(30)
    for k in (5, 14, 23):
        run, tired = tired_run("plain", host, scheme, "kernel")
        tired.left = k
        raises(Exception, "too tired", run.simulation.step, 25)
        found = run.now()
        agrees(found, calm.known[found["steps"]], 1e-9)
        run.simulation.step(30 - found["steps"])
        agrees(run.now(), calm.known[30], 1e-9)
    # every other step fails, once with the first call, once with the second
    run, tired = tired_run("plain", host, scheme, "kernel")
    for n in range(12):
        tired.left = 1 + n % 2
        try:
            run.simulation.step(1)
        except Exception as error:
            assert "too tired" in str(error)
        tired.left = 0
        found = run.now()
        agrees(found, calm.known[found["steps"]], 1e-9)
        run.simulation.step(n + 1 - found["steps"])
        agrees(run.now(), calm.known[n + 1], 1e-9)
    run, tired = tired_run("plain", host, scheme, "kernel")
    run.simulation.step(3)
    tired.left = 2
    raises(Exception, "too tired", lambda: run.simulation.step(5))
    run.simulation.saveState(str(tmp_path / "state.xml"))
    run.simulation.saveCheckpoint(str(tmp_path / "state.chk"))
    for load in ("loadState", "loadCheckpoint"):
        other, _ = tired_run("plain", host, scheme, "kernel")
        getattr(other.simulation, load)(str(tmp_path / ("state.xml" if load == "loadState" else "state.chk")))
        found = other.now()
        agrees(found, calm.known[found["steps"]], 1e-9)
        other.simulation.step(10 - found["steps"])
        agrees(other.now(), calm.known[10], 1e-9)


def test_minimizing_and_energies_after_a_failure(host):
    """Nothing of the failed step is left in the pair force: energy and forces are those of the positions."""
    run, tired = tired_run("plain", host, "middle", "kernel")
    run.simulation.step(2)
    tired.left = 2
    raises(Exception, "too tired", lambda: run.simulation.step(5))
    x, v = state_of(run.simulation.context)
    fresh, _ = tired_run("plain", host, "middle", "kernel")
    fresh.simulation.context.setPositions(x)
    energies, forces = [], []
    for one in (run, fresh):
        state = one.simulation.context.getState(energy=True, forces=True)
        energies.append(state.getPotentialEnergy()._value)
        forces.append(state.getForces(asNumpy=True)._value)
    assert energies[0] == pytest.approx(energies[1], rel=1e-12)
    assert np.abs(forces[0] - forces[1]).max() < 1e-9


# -- runs that fly apart -----------------------------------------------------------------------------------------------------------------
def violent(scheme: str, platform: str, dt: float, kind: str) -> Run:
    """Beads that repel each other so strongly that the step below throws them out."""
    v = np.random.default_rng(2).normal(size=(81, 3))
    v -= v.mean(axis=0)
    if kind == "energies":
        internal = dpd.InternalEnergy(ConstantHeatCapacity(60.0), 1.0)
        scene = beads(table={("W", "W"): dpd.EnergyDPD(A=25e5, sigma=3, kappa=1.0)}, velocities=v, internal=internal)
    else:
        scene = beads(table={("W", "W"): dpd.DPD(A=25e5, gamma=4.5)}, velocities=v)
    built = dpd.build(scene, dt=dt, scheme=scheme, conservative="kernel", platform=platform, seed=6)
    return Run(built.simulation(properties=Device(platform).properties), built.plan.spec)


@SCHEME
@pytest.mark.parametrize("platform", ["Reference", "CPU"])
@pytest.mark.parametrize("kind", ["plain", "energies"])
def test_a_run_that_flies_apart_can_be_taken_up_with_a_shorter_step(platform, scheme, kind):
    """Some short steps, a step far too long, short ones again: the failed ones leave no trace."""
    short, long = 1e-6, 0.05
    calm, run = violent(scheme, platform, short, kind), violent(scheme, platform, short, kind)
    calm.record(8)
    run.simulation.step(3)
    run.simulation.integrator.setStepSize(long)
    with pytest.raises((dpd.DPDError, openmm.OpenMMException)) as caught:
        run.simulation.step(10)
    found = run.now()
    if found["steps"] == 3:
        agrees(found, calm.known[3], 1e-12)
        with pytest.raises((dpd.DPDError, openmm.OpenMMException)) as again:
            run.simulation.step(10)
        assert str(again.value) == str(caught.value)
        run.simulation.integrator.setStepSize(short)
        run.simulation.step(5)
        agrees(run.now(), calm.known[8], 1e-9)
        return
    n = found["steps"] - 3  # a whole step of the long ones was done: the same as without what failed
    calm = violent(scheme, platform, short, kind)
    calm.simulation.step(3)
    calm.simulation.integrator.setStepSize(long)
    calm.simulation.step(n)
    agrees(found, calm.now(), 1e-6 * np.abs(found["v"]).max())
    assert np.isfinite(found["x"]).all() and np.isfinite(found["v"]).all()


def test_the_recording_sees_a_half_done_step(host):
    """The comparison of this file can fail: a drift by half a step, another counter, and another time are all seen."""
    run = run_of("plain", host, "middle", "kernel")
    run.record(2)
    last = run.known[2]
    for name, change in (("x", 0.5 * DT * last["v"]), ("counter", 1.0), ("time", DT), ("steps", 1)):
        raises(AssertionError, ".", agrees, {**last, name: last[name] + change}, last, 1e-4)
