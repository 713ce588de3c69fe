"""Right at any distance from the origin, beside foreign checkpoints and ramps, in crowds, and without races."""

import os
import re
import shutil
import subprocess
import sys
from dataclasses import replace

import numpy as np
import openmm
import pytest
from conftest import available
from devices import Device
from scenes import BOXES, PLAIN, D, beads, chains, fluid, same_bits, state_of
from test_steps import run_on

import openmm_dpd as dpd

BOX = np.eye(3) * 5.0
USUAL = Device("OpenCL", "mixed")  # what everybody gets


def test_beads_on_a_lattice_are_compared_with_the_host():
    """Forces add up to nothing but rounding, in another order there."""
    x = np.stack(np.meshgrid(*[np.arange(6) + 0.25] * 3), axis=-1).reshape(-1, 3) * 0.7
    scene = beads(216, edge=4.2, positions=x)
    run_on(scene, available(Device("Reference")))
    run_on(scene, available(USUAL))


def put_away(simulation, step: int, shift) -> None:
    """Move all beads, and count steps from this one on."""
    simulation.context.setStepCount(step)
    simulation.context.setPositions(simulation.context.getState(positions=True).getPositions(asNumpy=True)._value + shift)


@pytest.mark.parametrize("boxes, scheme", [(200_000, "middle"), (-2_000_000, "mvv")])
def test_beads_far_from_the_origin_move_as_those_in_the_box(boxes, scheme):
    """1e6 and 1e7 cutoffs away, in the precision that everybody gets; digits of the positions that are set are all that is lost."""
    available(USUAL)
    scene, ends = beads(375, edge=5.0), []
    for away in (0, boxes):
        shift = 5.0 * away * np.array([1, 0, -1])
        built = dpd.build(scene, dt=0.02, scheme=scheme, platform="OpenCL", seed=5, engine="device")
        assert "positions and velocities: mixed precision" in built.explain()
        simulation = built.simulation()
        put_away(simulation, 0, shift)
        simulation.step(4)
        x, v = state_of(simulation.context)
        energy = simulation.context.getState(energy=True).getPotentialEnergy()._value
        ends.append((x - shift, v, energy, dpd.Observer(built).sample(simulation.context).pressure()))
    for near, far, most in zip(*ends, (1e-7, 1e-5, 1e-3, 1e-3), strict=True):
        np.testing.assert_allclose(far, near, rtol=0, atol=most)


@pytest.mark.parametrize("precision, scheme", [("mixed", "mvv"), ("single", "bababo")])
def test_what_is_far_goes_back_by_whole_molecules_and_no_bit_depends_on_calls(precision, scheme, tmp_path):
    """Every thousandth step, at which States and the acceleration that is kept go on as before."""
    found = available(Device("OpenCL", precision))
    scene, shift = chains(BOX, n=60, k=20.0), np.array([5.0 * 2**13, 0, -5.0 * 2**13])
    whole, cut, again = (run_on(scene, found, scheme) for _ in range(3))
    for each in (whole, cut):
        put_away(each, 995, shift)
    whole.step(5)
    before = state_of(whole.context)[0]
    assert precision == "mixed" or np.all(before[:, 0] % 2.0**-9 == 0)
    whole.step(1)
    after, v = state_of(whole.context)
    np.testing.assert_allclose(after, before + 0.02 * v, rtol=0, atol=0.02)
    assert np.any(after[:, 0] % 2.0**-9 != 0)  # the digits of numbers near the origin
    whole.step(6)
    cut.step(5)
    cut.saveCheckpoint(str(tmp_path / "checkpoint"))
    cut.context.getState(energy=True, forces=True)
    cut.step(2)
    cut.step(5)
    again.loadCheckpoint(str(tmp_path / "checkpoint"))
    again.step(7)
    assert same_bits(state_of(whole.context), state_of(cut.context))
    assert same_bits(state_of(whole.context), state_of(again.context))
    bonds = np.diff(state_of(whole.context)[0][scene.bond_pairs], axis=1)
    assert np.linalg.norm(bonds, axis=-1).max() < 3


@pytest.mark.parametrize("scheme", ["mvv", "bababo"])
def test_a_plain_integrator_keeps_no_acceleration_of_other_positions(scheme):
    """A checkpoint of another run at the same step is loaded: the next step is that of a new Context with this state."""
    usual, contexts = available(USUAL), []
    for seed in (1, 2, 3):
        simulation = run_on(beads(375, edge=5.0, seed=seed), usual, scheme)
        integrator = openmm.XmlSerializer.clone(simulation.integrator)
        context = openmm.Context(simulation.system, integrator, openmm.Platform.getPlatformByName(usual.platform), usual.properties)
        context.setPositions(simulation.context.getState(positions=True).getPositions())
        contexts.append(context)
    other, into, fresh = contexts
    for context in (other, into):
        context.getIntegrator().step(5)
    for context in (into, fresh):
        context.loadCheckpoint(other.createCheckpoint())
        context.getIntegrator().step(1)
    assert same_bits(state_of(into), state_of(fresh))


@pytest.mark.parametrize("what", ["ramp", "velocities", "kT", "positions"])
def test_a_new_acceleration_of_verlet_is_the_hosts(what):
    """It has the noise and the thermal energy of the last half kick."""
    exact = available(Device("Reference"))
    scene = fluid(PLAIN, BOXES["ortho"], n=60, spread=0)
    scene = replace(scene, kT=dpd.TemperatureRamp(1.0, 20.0, 0, 20)) if what in ("ramp", "positions") else scene
    simulation = run_on(scene, exact, "mvv")
    host = dpd.build(scene, dt=0.02, scheme="mvv", platform=exact.platform, seed=5, engine="host", loop=False)
    pair = [simulation, host.simulation(properties=exact.properties)]
    for k in range(3):
        for each in pair:
            each.step(3)
        x, v = state_of(pair[1].context)
        for each in pair:
            if what == "velocities":
                each.context.setVelocities(v[::-1])
            if what == "kT":
                each.context.setParameter("dpd_kT", 2.0 + k)
            if what == "positions":  # nobody but the plugin notices
                openmm.Context.setPositions(each.context, x[::-1])
        for each in pair:
            each.step(1)
    (x, v), (host_x, host_v) = (state_of(each.context) for each in pair)
    np.testing.assert_allclose(x, host_x, rtol=0, atol=1e-6)
    np.testing.assert_allclose(v, host_v, rtol=0, atol=1e-5)


def test_more_partners_than_a_bound_can_count_are_an_error():
    x = 1.5 + 0.02 * np.random.default_rng(1).random((1100, 3))
    with pytest.raises(openmm.OpenMMException, match="more than some thousand others within its cutoff"):
        run_on(beads(1100, edge=3.0, positions=x, table={("W", "W"): D(gamma=1e-3)}), available(Device("Reference")))


def test_no_races_and_no_access_out_of_bounds():
    """In Oclgrind, which simulates an OpenCL device, but for reads that only save atomic maxima."""
    simulator = shutil.which("oclgrind")
    if simulator is None:
        pytest.skip("there is no oclgrind here: apt-get install oclgrind")
    script = f"""
import sys
sys.path[:0] = {sys.path!r}
from test_steps import BOX, EXTENDED, Device, device_check, fluid, run_on
device_check.MOST = 0
for scheme in ("mvv", "middle"):
    simulation = run_on(fluid(EXTENDED, BOX, n=40, spread=0), Device("OpenCL", "single"), scheme)
    simulation.step(2)
    print(simulation.context.getState(energy=True).getPotentialEnergy()._value)
"""
    environment = os.environ | {"OPENMM_DPD_DEVICE_LANES": "8"}
    command = [simulator, "--data-races", "--max-errors", "100000", sys.executable, "-c", script]
    run = subprocess.run(command, env=environment, capture_output=True, text=True, timeout=120)
    text = run.stdout + run.stderr
    assert run.returncode == 0 and "Invalid" not in text and "divergence" not in text, text
    lines = set(re.findall(r"At line \d+ \(column \d+\) of .*:\n\s*(.*)", text))
    assert all("flags[M" in line or "flags[BOUND]" in line for line in lines), lines
