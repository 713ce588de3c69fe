"""A restart continues the run: bit for bit where everything is double precision, across a fresh process."""

import subprocess
import sys
from pathlib import Path

import numpy as np
import openmm
import pytest
import restart_runs
from devices import DEVICES
from kinds import KINDS, differences, everything, made, plain_context, running, same
from restart_runs import AFTER, BEFORE, HOW
from scenes import EXTENDED, beads, fluid, place, run_of, same_bits, state_of, step_all, stepped

import openmm_dpd as dpd
from openmm_dpd.base.names import COUNTER


@pytest.fixture(scope="module", params=["Reference", "CPU"])
def continued(request, tmp_path_factory):
    """For each case: the uninterrupted run's last state, and the folder where a fresh process left the continued ones."""
    platform, folder = request.param, tmp_path_factory.mktemp("restart")
    results = {}
    for name, choices in restart_runs.cases(platform).items():
        simulation = stepped(restart_runs.simulation_of(platform, **choices), BEFORE)
        simulation.saveCheckpoint(str(folder / f"{name}.checkpoint"))
        simulation.saveState(str(folder / f"{name}.xml"))
        between = state_of(simulation.context)
        simulation.step(AFTER)
        results[name] = state_of(simulation.context)
        assert np.abs(results[name][0] - between[0]).max() > 0.1
    script = Path(restart_runs.__file__)
    done = subprocess.run([sys.executable, str(script), str(folder), platform], capture_output=True, text=True, cwd=folder)
    assert done.returncode == 0, done.stderr
    return platform, results, folder


@pytest.mark.parametrize(("continued", "how"), [("Reference", HOW[0]), ("CPU", HOW[1])], indirect=["continued"])
def test_restart_in_a_fresh_process_is_bit_exact(continued, how):
    _, results, folder = continued
    differing = []
    for name, expected in results.items():
        with np.load(folder / f"{name}.{how}.npz") as found:
            assert found["step"] == BEFORE + AFTER
            if not same_bits(expected, (found["x"], found["v"])):
                differing.append((name, float(np.abs(found["x"] - expected[0]).max())))
    assert not differing


SCHEMES = pytest.mark.parametrize("scheme", ["mvv", "shardlow", "middle", "aboba", "bababo"])


@SCHEMES
def test_restart_on_cpu_with_openmm_forces_agrees_to_float32(tmp_path, scheme):
    """The CPU platform's forces are single precision, from a list with history: 2e-5 in the velocities after 3 steps."""
    device = restart_runs.Device("CPU")

    def run():
        return run_of(fluid(EXTENDED, kT=1.0), device, dt=0.03, scheme=scheme, conservative="openmm", seed=5)

    first = stepped(run(), BEFORE)
    first.saveState(str(tmp_path / "state.xml"))
    second = run()
    second.loadState(str(tmp_path / "state.xml"))
    before = state_of(second.context)
    step_all(3, first, second)
    (x, v), (expected_x, expected_v) = state_of(second.context), state_of(first.context)
    assert np.abs(v - expected_v).max() < 2e-5 and np.abs(x - expected_x).max() < 2e-6
    assert np.abs(v - before[1]).max() > 0.1


@pytest.mark.parametrize("scheme", ["mvv", "shardlow"])
@pytest.mark.parametrize("device", [d for d in DEVICES if not d.exact], indirect=True, ids=str)
def test_restart_on_gpu_platforms(tmp_path, device, scheme):
    """Checkpoints and XML states also continue there, to the rounding of forces and states; these two schemes have a history."""

    def run():
        return run_of(fluid(EXTENDED, kT=1.0, n=60), device, dt=0.03, scheme=scheme, conservative="kernel", seed=5)

    first = stepped(run(), BEFORE)
    first.saveState(str(tmp_path / "state.xml"))
    first.saveCheckpoint(str(tmp_path / "checkpoint"))
    counter = first.context.getParameter(COUNTER)
    first.step(3)
    expected = state_of(first.context)
    for load in ("loadState", "loadCheckpoint"):
        second = run()
        getattr(second, load)(str(tmp_path / ("state.xml" if load == "loadState" else "checkpoint")))
        assert second.context.getParameter(COUNTER) == counter
        second.step(3)
        assert second.context.getParameter(COUNTER) == counter + 3  # one and the same noise: the history was not drawn anew
        assert np.abs(state_of(second.context)[1] - expected[1]).max() <= device.choose(0.0, 1e-6, 2e-4)


@pytest.mark.parametrize("device", [d for d in DEVICES if d.precision == "single"], indirect=True, ids=str)
def test_warm_beads_go_on_with_the_temperatures_that_were_saved(tmp_path, device):
    """The host steps them in double precision, of which a Context in single precision keeps a part."""
    built = [made("edpd", "mvv", device.platform, engine="host") for _ in range(2)]
    first, second = (one.simulation(properties=device.properties) for one in built)
    first.step(5)
    first.saveState(str(tmp_path / "state.xml"))
    second.loadState(str(tmp_path / "state.xml"))
    step_all(3, first, second)
    assert not same(everything(second.context, built[1]), everything(first.context, built[0]))


def test_going_back_to_a_state_repeats_the_run(tmp_path):
    """An XML state loaded into the simulation that ran ahead gives what the first pass gave, noise included."""
    simulation = stepped(run_of(beads(), restart_runs.Device("Reference"), dt=0.04, scheme="mvv", conservative="kernel"), 5)
    simulation.saveState(str(tmp_path / "state.xml"))
    simulation.step(5)
    expected = state_of(simulation.context)
    simulation.step(9)
    simulation.loadState(str(tmp_path / "state.xml"))
    simulation.step(5)
    assert same_bits(expected, state_of(simulation.context))


@pytest.mark.parametrize("kind", KINDS)
def test_every_kind_of_scene_goes_on(kind, tmp_path):
    """From a checkpoint and an XML state bit for bit; with System and integrator from XML to rounding."""
    built = [made(kind, "shardlow") for _ in range(4)]
    first = stepped(running(built[0]), 7)
    for how in ("Checkpoint", "State"):
        getattr(first, f"save{how}")(str(tmp_path / how))
    first.step(6)
    expected = everything(first.context, built[0])
    for how, one in zip(("Checkpoint", "State"), built[1:], strict=False):
        second = running(one)
        getattr(second, f"load{how}")(str(tmp_path / how))
        second.step(6)
        assert not same(everything(second.context, one), expected), how
    copy = plain_context(built[3])
    copy.getIntegrator().step(13)
    found = differences(everything(copy, built[3]), expected, 0.01)
    assert max(found.values()) < 1e-9, found


@SCHEMES
@pytest.mark.parametrize("conservative", ["kernel", "openmm"])
def test_system_and_integrator_survive_serialization(scheme, conservative):
    """XmlSerializer and back: the same trajectory of a scene that has everything, bit for bit where the first one is no loop."""
    built_run = restart_runs.simulation_of("Reference", "fluid", scheme=scheme, conservative=conservative)
    system, integrator = built_run.system, built_run.integrator
    copies = [openmm.XmlSerializer.deserialize(openmm.XmlSerializer.serialize(thing)) for thing in (system, integrator)]
    assert copies[1].getIntegrationForceGroups() == integrator.getIntegrationForceGroups()
    assert copies[0].usesPeriodicBoundaryConditions() == system.usesPeriodicBoundaryConditions()
    context = openmm.Context(*copies, openmm.Platform.getPlatformByName("Reference"))
    x, v = state_of(built_run.context)
    place(context, x, v)
    built_run.step(8)
    copies[1].step(8)
    (x, v), (expected_x, expected_v) = state_of(context), state_of(built_run.context)
    limit = 0.0 if built_run.integrator.whole is None else 1e-12
    assert np.abs(x - expected_x).max() <= limit and np.abs(v - expected_v).max() <= limit


def test_a_system_in_xml_stays_small():
    """The pair force carries numbers per bead, nothing per pair: below 200 bytes of XML per bead."""
    built = dpd.build(beads(3000, edge=10.0), dt=0.04, platform="Reference", conservative="kernel", seed=1)
    force = next(f for f in built.system.getForces() if isinstance(f, openmm.PythonForce))
    assert len(openmm.XmlSerializer.serialize(force)) < 200 * 3000
