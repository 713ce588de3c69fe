"""Schemes on the device: whole steps beside numpy and beside programs line by line, bits, restarts, errors, and what is refused."""

import io
import logging
import os
import subprocess
import sys
from dataclasses import replace
from itertools import pairwise

import numpy as np
import openmm
import oracle
import pytest
from conftest import available
from devices import Device
from midpoint import step
from openmm import app, unit
from scenes import BOXES, EXTENDED, MASSES, PLAIN, D, beads, chains, fluid, same_bits, state_of

import openmm_dpd as dpd
from openmm_dpd.base.errors import ParameterError, PlanError, RunError
from openmm_dpd.model.schemes import SCHEMES, scheme_of
from openmm_dpd.plan import device as device_engine
from openmm_dpd.plan.forces import device_force as made
from openmm_dpd.plan.plan import make_plan
from openmm_dpd.simulation import device_check
from openmm_dpd.simulation.build import build_plan

OWN = "A/4 O/2 A/4 B/3 S/2 A/2 2B/3"
WORDS = [name for name, scheme in SCHEMES.items() if scheme.sweeps] + [OWN, "O B/2 A B/2"]
BOX = BOXES["ortho"]
CHARGES = {"charges": np.arange(60) % 2 * 2.0 - 1, "electrostatics": dpd.SlaterCharges(0.25, bjerrum_length=2.0)}


def made_on(scene, device, scheme="middle", lines=False, **choices) -> dpd.BuiltSystem:
    """Built for a device; ``lines``: by a program that goes line by line."""
    plan = make_plan(scene, **{"dt": 0.02, "scheme": scheme, "platform": device.platform, "seed": 5, "engine": "device"} | choices)
    if lines:
        plan = replace(plan, options=replace(plan.options, execution=replace(plan.execution, steps="program")))
    return build_plan(plan)


def run_on(scene, device, scheme="middle", **choices) -> app.Simulation:
    simulation = made_on(scene, device, scheme, **choices).simulation(properties=device.properties)
    assert simulation.integrator.device_group is not None
    return simulation


@pytest.fixture
def solved(monkeypatch):
    """Pair updates that are solved to rounding."""
    monkeypatch.setitem(made.device_force.__kwdefaults__, "tolerance", 1e-12)


# -- beside numpy, and beside each other ----------------------------------------------------------------------------------------------
@pytest.mark.parametrize("name", ["fluid", "chains", "immobile", "stiff"])
@pytest.mark.parametrize("scheme", WORDS)
def test_whole_steps_are_those_of_numpy(scheme, name, exact, solved):
    scene = {
        "fluid": lambda: fluid(PLAIN, BOX, n=50, spread=0),
        "chains": lambda: chains(BOX, n=60, k=20.0),
        "immobile": lambda: fluid(EXTENDED, BOXES["tilted"], n=50, spread=0, mobile=np.arange(50) > 7),
        "stiff": lambda: fluid({("*", "*"): D(A=25, gamma=120.0)}, BOX, n=50, spread=0),
    }[name]()
    simulation = run_on(scene, exact, scheme)
    bonds = openmm.Context(simulation.system, openmm.VerletIntegrator(0.02), openmm.Platform.getPlatformByName("Reference"))
    x, v = state_of(simulation.context)
    v = np.where(scene.immobile[:, None], scene.velocities, v)
    counter, plain = 0, oracle.conservative

    def with_bonds(x, *others):
        bonds.setPositions(x)
        state = bonds.getState(forces=True, groups=set(range(32)) - {31})
        return replace_forces(plain(x, *others), state.getForces(asNumpy=True)._value)

    for _ in range(3):
        try:
            oracle.conservative = with_bonds if name == "chains" else plain
            x, v, counter = step(scene, scheme_of(scheme).letters, x, v, 0.02, 1.0, 5, counter)
        finally:
            oracle.conservative = plain
        simulation.step(1)
        found_x, found_v = state_of(simulation.context)
        moving = ~scene.immobile
        np.testing.assert_allclose(found_x[moving], x[moving], rtol=0, atol=1e-8)
        np.testing.assert_allclose(found_v[moving], v[moving], rtol=0, atol=1e-7)
    assert simulation.context.getParameter("dpd_counter") == counter


def replace_forces(found, more):
    return found._replace(forces=found.forces + more)


def everything(**options) -> dpd.Scene:
    """Bonds, walls, body forces and several types."""
    rng = np.random.default_rng(4)
    x = rng.random((80, 3)) * [4.0, 4.0, 3.2] + [0, 0, 0.3]
    bonds = [dpd.HarmonicBonds([[2 * k, 2 * k + 1] for k in range(20)], k=30, r0=0.5)]
    x[1:40:2] = x[0:40:2] + 0.2
    return dpd.Scene(
        MASSES, rng.choice(["A", "B"], 80).tolist(), x, EXTENDED, kT=1.0, box=[4.0, 4.0, 4.0], bonds=bonds,
        bonded_factors=(0.0, 0.5, 1.0), velocities=rng.normal(size=(80, 3)), **options,
    )  # fmt: skip


@pytest.mark.parametrize("kind", ["specular", "bounce-back"])
@pytest.mark.parametrize("scheme", WORDS)
def test_whole_steps_are_those_of_the_program(scheme, kind, exact, solved):
    """The same letters, by the plugin and by OpenMM's own kernels, with forces of others, walls and a ramp."""
    ramp = dpd.TemperatureRamp(1.0, 2.0, 0, 20)
    walls = [dpd.Wall("z", 0.2, "above", kind), dpd.Wall("z", 3.8, "below", kind)]
    options = {"walls": walls, "body_forces": [dpd.BodyForce((1.0, 0, 0))]}
    scene = everything(**options)
    scene = replace_kT(scene, ramp, options)
    pair = [run_on(scene, exact, scheme, lines=lines) for lines in (False, True)]
    before = state_of(pair[0].context)[0]
    for simulation in pair:
        simulation.step(15)
    (x, v), (lines_x, lines_v) = (state_of(simulation.context) for simulation in pair)
    assert np.abs(x - before).max() > 0.2
    np.testing.assert_allclose(x, lines_x, rtol=0, atol=1e-7)
    np.testing.assert_allclose(v, lines_v, rtol=0, atol=1e-6)


def replace_kT(scene, ramp, options):
    return dpd.Scene(
        MASSES, scene.types, scene.positions, EXTENDED, kT=ramp, box=scene.box, bonds=scene.bonds, bonded_factors=scene.bonded_factors,
        velocities=scene.velocities, **options,
    )  # fmt: skip


@pytest.mark.parametrize("lam", [0.5, 0.65])
@pytest.mark.parametrize("loop", ["walls", "plain", "chains"])
def test_modified_velocity_verlet_is_the_hosts(lam, loop, exact):
    """The same forces with the same noise: the same trajectory."""
    scene = chains(BOX, n=60, k=20.0) if loop == "chains" else everything() if loop == "walls" else fluid(PLAIN, BOX, n=60, spread=0)
    simulation = run_on(scene, exact, "mvv", lam=lam)
    host = dpd.build(scene, dt=0.02, scheme="mvv", lam=lam, platform=exact.platform, seed=5, engine="host", loop=False)
    host = host.simulation(properties=exact.properties)
    for _ in range(3):
        simulation.step(4)
        host.step(4)
        (x, v), (host_x, host_v) = (state_of(each.context) for each in (simulation, host))
        np.testing.assert_allclose(x, host_x, rtol=0, atol=1e-6)
        np.testing.assert_allclose(v, host_v, rtol=0, atol=1e-5)


@pytest.mark.parametrize("scheme", WORDS)
def test_beside_forces_of_others_whole_steps_are_the_hosts(scheme, exact, monkeypatch):
    """Bonds at every kick; sums over charges and forces of others once, at the ends of a step.  Friction is so little that the order of pairs
    makes no difference."""
    monkeypatch.setattr("openmm_dpd.plan.plan.few_charges", lambda *scene: False)
    scene = replace(chains(BOX, n=60, k=20.0, **CHARGES), pairs={("*", "*"): D(A=25, gamma=1e-12)})
    states = []
    for engine in ("device", "host"):
        choices = {"scheme": scheme, "platform": exact.platform, "seed": 5, "conservative": "kernel"}
        built = dpd.build(scene, dt=0.02, engine=engine, **choices)
        assert built.plan.execution.steps == {"device": "device", "host": "loop"}[engine]
        built.system.addForce(waves())
        simulation = built.simulation(properties=exact.properties)
        for n in (1, 13):
            simulation.step(n)
        states.append(state_of(simulation.context))
    (x, v), (host_x, host_v) = states
    np.testing.assert_allclose(x, host_x, rtol=0, atol=1e-6)
    np.testing.assert_allclose(v, host_v, rtol=0, atol=1e-5)


def waves() -> openmm.CustomExternalForce:
    """A potential of others for 60 beads."""
    force = openmm.CustomExternalForce("20*cos(3*x)")
    for bead in range(60):
        force.addParticle(bead, [])
    return force


def behind_our_back(context: openmm.Context, what: str) -> None:
    """Change the state of a Context by methods that the integrator does not hear of."""
    x = openmm.Context.getState(context, positions=True).getPositions(asNumpy=True)._value
    if what == "positions":
        openmm.Context.setPositions(context, x[::-1])
    elif what == "box":
        openmm.Context.setPeriodicBoxVectors(context, *(1.01 * np.asarray(BOX)).tolist())
    elif what == "minimiser":
        openmm.LocalEnergyMinimizer.minimize(context, 0.1, 10)
    elif what == "another moment":
        openmm.Context.loadCheckpoint(context, context.earlier)


@pytest.mark.parametrize("lines", [False, True], ids=["watched", "XML"])
@pytest.mark.parametrize("what", ["positions", "box", "minimiser", "another moment", "nothing"])
def test_verlet_notices_what_has_changed(what, lines, usual):
    """The acceleration that is kept is not used at other positions, nor in another box; ``XML``: by OpenMM and the plugin alone."""
    if what == "minimiser" and usual.platform != "Reference":
        pytest.skip("OpenMM's minimiser crashes with PoCL, whatever it minimises")
    scene = fluid(PLAIN, BOX, n=60, spread=0)
    simulation, fresh = (run_on(scene, usual, "mvv") for _ in range(2))
    step = openmm.CustomIntegrator.step if lines else type(simulation.integrator).step
    context = simulation.context
    step(simulation.integrator, 5)
    context.earlier = openmm.Context.createCheckpoint(context)
    step(simulation.integrator, 4)
    behind_our_back(context, what)
    state = openmm.Context.getState(context, positions=True, velocities=True, parameters=True)
    for name in ("Positions", "Velocities", "PeriodicBoxVectors"):
        value = getattr(state, f"get{name}")()
        getattr(fresh.context, f"set{name}")(*(value if name == "PeriodicBoxVectors" else (value,)))
    fresh.context.setParameter("dpd_counter", state.getParameters()["dpd_counter"])
    step(simulation.integrator, 3)
    fresh.step(3)
    same = same_bits(state_of(context), state_of(fresh.context))
    assert same == (what != "nothing")


@pytest.mark.parametrize("what", ["positions", "box", "another moment", "nothing"])
def test_cells_that_the_last_step_has_filled_are_not_those_of_other_positions(what):
    """A step of `middle` leaves them to the next one."""
    scene, device, step = fluid(PLAIN, BOX, n=60, spread=0), available(Device("OpenCL", "mixed")), openmm.CustomIntegrator.step
    simulation, fresh = (run_on(scene, device, "middle") for _ in range(2))
    context = simulation.context
    step(simulation.integrator, 5)
    context.earlier = openmm.Context.createCheckpoint(context)
    step(simulation.integrator, 4)
    behind_our_back(context, what)
    openmm.Context.loadCheckpoint(fresh.context, openmm.Context.createCheckpoint(context))
    step(simulation.integrator, 3)
    step(fresh.integrator, 3)
    assert same_bits(state_of(context), state_of(fresh.context))


@pytest.mark.parametrize("scheme", ["shardlow", "bababo"])
def test_forces_of_others_may_change_between_calls(scheme, usual):
    """The acceleration at the end of a step serves the next one, unless it may not be right any more."""
    scene = fluid(PLAIN, BOX, n=60, spread=0)
    pair = []
    for strength in (0.0, 50.0):
        built = made_on(scene, usual, scheme)
        built.system.addForce(pulling(strength))
        pair.append(built.simulation(properties=usual.properties))
    changed, expected = pair
    changed.step(7)
    expected.context.setState(changed.context.getState(positions=True, velocities=True, parameters=True))
    force = changed.system.getForces()[-1]
    for k in range(60):
        force.setParticleParameters(k, k, [50.0])
    force.updateParametersInContext(changed.context)
    for simulation in pair:
        simulation.step(3)
    assert same_bits(*(state_of(simulation.context) for simulation in pair))


def pulling(strength: float) -> openmm.CustomExternalForce:
    """A constant force along x on 60 beads."""
    pull = openmm.CustomExternalForce("-k*x")
    pull.addPerParticleParameter("k")
    for bead in range(60):
        pull.addParticle(bead, [strength])
    return pull


@pytest.mark.parametrize("changed", [True, False])
@pytest.mark.parametrize("scheme", ["mvv", "shardlow", "middle", "bababo"])
def test_a_force_that_changed_acts_from_the_first_half_kick(scheme, changed, device):
    """... of the step after updateParametersInContext: all of its impulse is there, and none of that before."""
    scene, dt = fluid(PLAIN, BOX, n=60, spread=0), 0.02
    built, pull = made_on(scene, device, scheme, dt=dt), pulling(10.0)
    built.system.addForce(pull)
    simulation = built.simulation(properties=device.properties)
    simulation.step(7)
    if changed:
        for bead in range(60):
            pull.setParticleParameters(bead, bead, [50.0])
        pull.updateParametersInContext(simulation.context)
    mass = scene.bead_masses
    before = mass @ state_of(simulation.context)[1]
    simulation.step(3)
    found = mass @ state_of(simulation.context)[1] - before
    np.testing.assert_allclose(found, [60 * (50 if changed else 10) * 3 * dt, 0, 0], rtol=0, atol=device.choose(1e-8, 1e-3, 1e-3))


# -- bits -----------------------------------------------------------------------------------------------------------------------------
@pytest.mark.parametrize("scheme", ["middle", "bababo", "shardlow", "mvv", "mvv beside bonds", "bab3 beside bonds and charges"])
def test_two_runs_cut_runs_and_restarts_have_the_same_bits(scheme, device, tmp_path):
    scheme, _, beside = scheme.partition(" ")
    scene = chains(BOX, n=60, k=20.0, **(CHARGES if "charges" in beside else {})) if beside else beads(375, edge=5.0)
    whole, cut = run_on(scene, device, scheme), run_on(scene, device, scheme)
    whole.step(40)
    expected = state_of(whole.context)
    for n in (1, 12, 7):
        cut.step(n)
        cut.context.getState(energy=True, forces=True)
    cut.saveCheckpoint(str(tmp_path / "checkpoint"))
    cut.saveState(str(tmp_path / "state.xml"))
    cut.step(20)
    assert same_bits(state_of(cut.context), expected)
    for again, load in ((run_on(scene, device, scheme), "checkpoint"), (whole, "state")):
        if load == "checkpoint":
            again.loadCheckpoint(str(tmp_path / "checkpoint"))
        else:  # into a Context that is further on
            again.loadState(str(tmp_path / "state.xml"))
        again.step(20)
        assert same_bits(state_of(again.context), expected), load


@pytest.mark.parametrize("scheme", ["middle", "mvv"])
def test_a_barostat_acts_and_bits_are_the_same(scheme, usual):
    scene = beads(375, edge=5.0)
    states = []
    # the lines of each degree of freedom draw numbers on Reference, from where barostats draw theirs, and the last step of a call has more
    odd = () if scheme == "mvv" and usual.platform == "Reference" else ((24, 36), (1, 6, 23, 30))
    for cuts in ((60,), (25, 35), *odd):
        built = made_on(scene, usual, scheme)
        built.system.addForce(
            openmm.MonteCarloBarostat(
                20 * unit.kilojoule_per_mole / unit.nanometer**3 / unit.AVOGADRO_CONSTANT_NA, 1 / 0.00831446261815324, 5
            )
        )
        simulation = built.simulation(properties=usual.properties)
        for n in cuts:
            simulation.step(n)
        states.append((*state_of(simulation.context), simulation.context.getState().getPeriodicBoxVectors(asNumpy=True)._value))
    assert all(same_bits(states[0], other) for other in states[1:])
    assert abs(states[0][2][0, 0] - 5.0) > 1e-3


@pytest.mark.parametrize("scheme", ["middle", "mvv"])
def test_restarts_behind_a_move_of_a_barostat_have_the_same_bits(scheme, tmp_path):
    """From checkpoints to the end; from States, which lack the numbers that barostats draw, to the next move.  Moves were accepted and refused."""
    device = available(Device("OpenCL", "single"))
    scene, edges = beads(375, edge=5.0), [5.0]

    def started():
        built = made_on(scene, device, scheme)
        dpd.add_barostat(built, 20.0, interval=5)
        return built.simulation(properties=device.properties)

    whole, found = started(), []
    for _ in range(6):
        whole.step(5)
        whole.saveCheckpoint(str(tmp_path / f"{len(found)}.chk"))
        whole.saveState(str(tmp_path / f"{len(found)}.xml"))
        found.append(state_of(whole.context))
        edges.append(whole.context.getState().getPeriodicBoxVectors()[0][0]._value)
    assert {a == b for a, b in pairwise(edges)} == {True, False}
    for at in range(5):
        ends = []
        for load in ("loadState", "loadCheckpoint"):
            again = started()
            getattr(again, load)(str(tmp_path / f"{at}.{'xml' if load == 'loadState' else 'chk'}"))
            again.step(4)
            ends.append(state_of(again.context))
        assert same_bits(*ends), at
        again.step(21 - 5 * at)
        assert same_bits(state_of(again.context), found[5]), at


def test_it_steps_without_this_package(exact, tmp_path):
    """From XML, by OpenMM and the plugin alone: the same bits."""
    scene = everything()
    built = made_on(scene, exact)
    files = {"system": built.system, "integrator": built.integrator}
    for name, thing in files.items():
        (tmp_path / f"{name}.xml").write_text(openmm.XmlSerializer.serialize(thing))
    simulation = built.simulation(properties=exact.properties)
    before = simulation.context.getState(positions=True, velocities=True, parameters=True)
    (tmp_path / "state.xml").write_text(openmm.XmlSerializer.serialize(before))
    script = f"""
import sys, openmm, openmm_dpd_device
read = lambda name: openmm.XmlSerializer.deserialize(open({str(tmp_path)!r} + "/" + name + ".xml").read())
integrator = read("integrator")
context = openmm.Context(read("system"), integrator, openmm.Platform.getPlatformByName({exact.platform!r}), {exact.properties!r})
context.setState(read("state"))
integrator.step(20)
assert "openmm_dpd" not in sys.modules
state = context.getState(positions=True, velocities=True)
open({str(tmp_path / "after.xml")!r}, "w").write(openmm.XmlSerializer.serialize(state))
"""
    subprocess.run([sys.executable, "-c", script], check=True, timeout=120)
    simulation.step(20)
    after = openmm.XmlSerializer.deserialize((tmp_path / "after.xml").read_text())
    x, v = state_of(simulation.context)
    np.testing.assert_array_equal(after.getPositions(asNumpy=True)._value, x)
    np.testing.assert_array_equal(after.getVelocities(asNumpy=True)._value, v)


@pytest.mark.parametrize("precision, mvv, middle", [("single", 300, 780), ("mixed", 465, 930), ("double", 580, 1510)])
def test_arrays_are_those_that_a_scheme_needs(precision, mvv, middle, monkeypatch):
    """Bytes for each of many beads; OpenMM's own arrays are not among them."""
    monkeypatch.setattr(device_check, "MOST", 0)  # the comparison asks for more
    found = available(Device("OpenCL", precision))
    n = 81000
    x = (np.stack(np.meshgrid(*[np.arange(45)] * 3), -1).reshape(-1, 3)[:n] + 0.5) * (30 / 45) + 0.2 * np.random.default_rng(1).random(
        (n, 3)
    )
    for scheme, most in (("mvv", mvv), ("middle", middle)):
        simulation = run_on(beads(n, edge=30.0, positions=x), found, scheme)
        simulation.step(2)
        bytes_of_arrays = made.plugin().bytes_of_arrays
        assert 0.5 * most < bytes_of_arrays() / n <= most, bytes_of_arrays() / n


# -- threads that share beads, as on GPUs ---------------------------------------------------------------------------------------------
@pytest.mark.parametrize(
    "name, scheme",
    [(name, "middle") for name in ("two cells", "everything", "tilted", "bonds", "crowded", "no box")]
    + [(name, "mvv") for name in ("everything", "crowded", "no box")],
)
def test_threads_that_share_beads_change_no_bit(name, scheme, monkeypatch):
    """In mixed precision, where both find the same differences of positions; in a crowd each bead has more partners than are listed at a time."""
    scene = {
        "two cells": lambda: fluid(PLAIN, np.eye(3) * 3.5, n=200, spread=0),
        "everything": lambda: fluid(EXTENDED, BOX, n=200, spread=0, mobile=np.arange(200) > 7),
        "tilted": lambda: fluid(PLAIN, BOXES["tilted"], n=200),
        "bonds": lambda: chains(BOX, n=60, k=20.0),
        "crowded": lambda: beads(500, edge=3.3, table={("W", "W"): D(A=1, gamma=4.5)}),
        "no box": lambda: fluid(PLAIN, None, n=200),
    }[name]()
    found = available(Device("OpenCL", "mixed"))
    ends = []
    for lanes in ("1", "8"):
        monkeypatch.setenv("OPENMM_DPD_DEVICE_LANES", lanes)
        simulation = run_on(scene, found, scheme, dt=0.01)
        simulation.step(20)
        ends.append((*state_of(simulation.context), simulation.context.getState(energy=True).getPotentialEnergy()._value))
    assert same_bits(ends[1][:2], ends[0][:2])
    assert ends[1][2] == ends[0][2]


# -- errors ---------------------------------------------------------------------------------------------------------------------------
@pytest.mark.parametrize("scheme", ["middle", "mvv"])
def test_beads_that_run_away_are_an_error(scheme, usual):
    scene = fluid(PLAIN, BOX, n=60, spread=0)
    simulation = run_on(scene, usual, scheme)
    simulation.step(10)
    x, v = state_of(simulation.context)
    v[17] = 1e4
    simulation.context.setVelocities(v)
    with pytest.raises(openmm.OpenMMException, match="bead 17 has a velocity that is not finite, or crosses more than a cutoff"):
        simulation.step(10)
        simulation.context.getState(positions=True)
    assert same_bits(state_of(simulation.context), (x, v.astype(np.float32) if usual.precision == "single" else v))
    v[17] = 0.0
    simulation.context.setVelocities(v)
    simulation.step(10)
    assert np.isfinite(state_of(simulation.context)[0]).all()


@pytest.mark.parametrize("steps", [1, 2, 3])
def test_beads_that_ran_away_are_counted_once_afterwards(steps, usual):
    simulation = run_on(fluid(PLAIN, BOX, n=60, spread=0), usual, "mvv")
    x, v = state_of(simulation.context)
    energy = simulation.context.getState(energy=True).getPotentialEnergy()._value
    simulation.context.setVelocities(v + 1e4 * (np.arange(60) == 17)[:, None])
    with pytest.raises(openmm.OpenMMException, match="bead 17"):
        simulation.integrator.step(steps)
        simulation.context.getState(energy=True)
    simulation.context.setPositions(x)
    simulation.context.setVelocities(v)
    assert simulation.context.getState(energy=True).getPotentialEnergy()._value == pytest.approx(energy, rel=1e-6)


def test_a_run_that_is_not_a_number_is_an_error(usual):
    simulation = run_on(fluid(PLAIN, BOX, n=60, spread=0), usual)
    x, v = state_of(simulation.context)
    v[3, 1] = np.nan
    simulation.context.setVelocities(v)
    with pytest.raises(openmm.OpenMMException, match="not finite"):
        simulation.step(5)
        simulation.context.getState(energy=True)


@pytest.mark.parametrize("scheme", ["middle", "mvv"])
def test_room_grows_and_no_pair_is_dropped(scheme, usual):
    """Where cells or rows are too full the steps are done again: the bits are those of a Context that had the room."""
    scene = beads(648, edge=6.0)
    narrow, ample = (run_on(scene, usual, scheme, dt=0.002) for _ in range(2))
    narrow.step(5)
    x, v = state_of(narrow.context)
    for simulation in (narrow, ample):
        simulation.context.setPositions(1.0 + 0.2 * x)
        simulation.context.setVelocities(v)
        simulation.context.setParameter("dpd_counter", 5)
        simulation.step(12)
    assert same_bits(*(state_of(simulation.context) for simulation in (narrow, ample)))


@pytest.mark.parametrize("steps", [1, 2, 3])
@pytest.mark.parametrize("scheme", ["basa", "shardlow"])
def test_where_rows_alone_are_too_full_no_bead_is_counted_twice(scheme, steps, usual):
    lattice = np.stack(np.meshgrid(*[np.arange(4) * 1.5 + 0.7] * 3), -1).reshape(-1, 3)
    corners = np.stack(np.meshgrid(*[[-1, 1]] * 3), -1).reshape(-1, 3)
    crowded = np.concatenate([2.4 + 0.12 * corners, 2.4 + 0.21 * corners, lattice[16:]])  # in eight cells
    narrow, ample = (run_on(beads(64, edge=6.0, positions=x), usual, scheme, dt=0.002) for x in (lattice, crowded))
    narrow.step(5)
    v = state_of(narrow.context)[1]
    for simulation in (narrow, ample):
        simulation.context.setPositions(crowded)
        simulation.context.setVelocities(v)
        simulation.context.setParameter("dpd_counter", 5)
        simulation.step(steps)
    assert same_bits(*(state_of(simulation.context) for simulation in (narrow, ample)))


def test_a_nearly_empty_box_takes_little_memory(usual):
    before = made.plugin().bytes_of_arrays()
    simulation = run_on(beads(500, edge=100.0), usual)
    simulation.step(2)
    assert made.plugin().bytes_of_arrays() - before < 1e8


def test_energies_of_a_device_with_an_odd_number_of_blocks():
    """OpenMM's buffer of energies is no multiple of a block of ours there."""
    found = available(Device("OpenCL", "mixed"))
    script = f"""
import sys
sys.path[:0] = {sys.path!r}
from test_steps import Device, beads, device_check, run_on
device_check.MOST = 0
print(run_on(beads(3000, edge=10.0), Device("OpenCL", "mixed"), "mvv").context.getState(energy=True).getPotentialEnergy()._value)
"""
    environment = os.environ | {"POCL_MAX_PTHREAD_COUNT": "1", "OPENMM_DPD_DEVICE_LANES": "8"}
    run = subprocess.run([sys.executable, "-c", script], env=environment, capture_output=True, text=True)
    assert run.returncode == 0, run.stderr
    expected = run_on(beads(3000, edge=10.0), found, "mvv").context.getState(energy=True).getPotentialEnergy()._value
    assert float(run.stdout.split()[-1]) == pytest.approx(expected, rel=1e-6)


@pytest.mark.parametrize("crowd", range(4, 26))
def test_cells_of_any_number_of_beads(crowd):
    """Forces, noise and pair updates are the host's, however full the fullest cell is: a Simulation that is made is compared."""
    found = available(Device("Reference"))
    x = np.stack(np.meshgrid(*[np.arange(5) * 1.2 + 0.1] * 3), -1).reshape(-1, 3)[:100]
    x[:crowd] = 2.5 + 0.4 * np.random.default_rng(1).random((crowd, 3))
    run_on(beads(100, edge=6.0, positions=x), found)


def test_without_the_guards_a_step_with_too_little_room_is_an_error(usual):
    scene = beads(648, edge=6.0)
    built = made_on(scene, usual, dt=0.002)
    integrator = openmm.XmlSerializer.clone(built.integrator)
    context = openmm.Context(built.system, integrator, openmm.Platform.getPlatformByName(usual.platform), usual.properties)
    context.setPositions(scene.positions)
    integrator.step(5)
    x, _ = state_of(context)
    context.setPositions(1.0 + 0.2 * x)
    integrator.step(2)
    with pytest.raises(openmm.OpenMMException, match="beads have come closer together than there was room for on the device"):
        context.getState(energy=True)


@pytest.mark.parametrize(
    "broken, wrong",
    [("A", "the conservative force by 0.0009.*, its energy by 0.001"), ("gamma", "friction and noise by 0.01, the pair update by 0.0")],
)
def test_a_broken_kernel_is_refused(broken, wrong, usual, monkeypatch):
    """One whose repulsion is wrong by a part in a thousand, or whose friction by one in fifty."""
    scene = fluid(PLAIN, BOX, n=60, spread=0)
    real = made.device_force

    def changed(spec, *arguments, **more):
        (table,) = spec.terms
        by = {"A": 1.001, "gamma": 1.02}[broken]
        return real(replace(spec, terms=(replace(table, **{broken: by * getattr(table, broken)}),)), *arguments, **more)

    monkeypatch.setattr("openmm_dpd.simulation.scene_system.device_force", changed)
    with pytest.raises(RunError, match=f"the device computes something else than the host .* {wrong}.*engine='host'"):
        run_on(scene, usual)


@pytest.mark.parametrize("dt", [0.5, 2.0])
def test_a_long_step_of_a_right_device_is_not_refused(dt, usual):
    """Errors of velocities within the tolerance are larger forces there."""
    run_on(fluid({("*", "*"): D(gamma=4.5)}, np.eye(3) * 3.0, n=81, spread=0), usual, dt=dt)


def test_large_scenes_are_not_compared(exact, monkeypatch, caplog):
    monkeypatch.setattr(device_check, "MOST", 50)
    monkeypatch.setattr(device_check, "differences", None)
    with caplog.at_level(logging.INFO, "openmm_dpd"):
        run_on(fluid(PLAIN, BOX, n=60, spread=0), exact)
    assert "more than 50 beads: the device is not compared with the host" in caplog.text


@pytest.mark.parametrize("scheme", ["middle", "mvv", "bababo"])
@pytest.mark.parametrize("table", [PLAIN, EXTENDED, {("*", "*"): D(gamma=3)}], ids=["plain", "ext", "tstat"])
def test_the_device_computes_what_the_host_does(table, scheme, usual):
    simulation = run_on(fluid(table, BOX, n=60, spread=0), usual, scheme)
    found = device_check.differences(simulation.context, simulation._plan)
    assert found and all(error <= most for error, most in found.values())
    assert all(error <= usual.choose(1e-8, 1e-5, 2e-5) for what, (error, _) in found.items() if what != "the pair update")


# -- which engine, and what is refused ------------------------------------------------------------------------------------------------
@pytest.fixture
def gpu(monkeypatch) -> Device:
    """The OpenCL platform here, taken for a GPU."""
    found = available(Device("OpenCL", "single"))
    monkeypatch.setattr(device_engine, "is_gpu", lambda platform: platform == "OpenCL")
    return found


def test_auto_takes_the_device_on_a_gpu(gpu):
    scene = fluid(PLAIN, BOX, n=60, spread=0)
    built = dpd.build(scene, dt=0.01, platform="OpenCL", seed=1)
    text = built.explain()
    assert "engine of the pair kernel: device (the platform is a GPU)" in text
    assert "friction and noise: OpenMM's device, by the plugin openmm-dpd-device\n" in text
    assert "steps: whole ones on the device; charges and forces of others kick before and after each" in text
    assert "engine of the pair kernel: host (it runs everything)" in dpd.build(scene, dt=0.01, platform="CPU").explain()
    many = fluid({("*", "*"): dpd.MDPD(A=-40, B=25, gamma=4.5)}, BOX, n=60, spread=0)
    assert "engine of the pair kernel: device (the platform is a GPU)" in dpd.build(many, dt=0.01, platform="OpenCL").explain()
    table, internal = {("*", "*"): dpd.EnergyDPD(A=25, sigma=3)}, dpd.InternalEnergy(dpd.ConstantHeatCapacity(60), 1.0)
    heat = dpd.build(fluid(table, BOX, n=60, spread=0, internal=internal), dt=0.01, platform="OpenCL").explain()
    assert "engine of the pair kernel: device (the platform is a GPU)" in heat


def test_without_the_plugin_all_is_as_before(gpu, monkeypatch):
    scene = fluid(PLAIN, BOX, n=60, spread=0)
    monkeypatch.setattr(made, "plugin", lambda: "the package openmm-dpd-device is not installed")
    built = dpd.build(scene, dt=0.01, platform="OpenCL", seed=1)
    assert "engine of the pair kernel: host (not the device: the package openmm-dpd-device is not installed)" in built.explain()
    with pytest.raises(
        PlanError, match="'device' cannot run this scene on the platform CPU: the package openmm-dpd-device is not installed"
    ):
        dpd.build(scene, dt=0.01, platform="CPU", engine="device")


@pytest.mark.parametrize(
    "scene, scheme, reason",
    [
        (lambda: fluid(PLAIN, BOX, n=40), "native", "OpenMM's own integrator steps"),
        (
            lambda: fluid({("*", "*"): D()}, BOX, n=40),
            "middle",
            "there is no friction and no noise, and no force that OpenMM does not compute",
        ),
        (
            lambda: beads(
                40,
                positions=1 + np.random.default_rng(1).random((40, 3)),
                edge=5.0,
                walls=[dpd.SolidWall(dpd.shapes.Ball((4.0, 4.0, 4.0), 0.5))],
            ),
            "middle",
            "it has no walls that have a shape",
        ),
    ],
)
def test_what_it_cannot_is_refused_by_name(scene, scheme, reason, exact):
    with pytest.raises(PlanError, match=f"the engine 'device' cannot run this scene on the platform {exact.platform}: {reason}"):
        made_on(scene(), exact, scheme)


def test_several_many_body_tables_are_refused(exact):
    scene = fluid([{("*", "*"): dpd.MDPD(A=-30, B=25, gamma=3)}] * 2, BOX, n=40)
    with pytest.raises(PlanError, match="it has several tables of isothermal terms alone, many-body terms in one of them"):
        made_on(scene, exact)


def test_an_engine_that_there_is_not(exact):
    with pytest.raises(ParameterError, match="engine must be 'auto' or one of 'host', 'device', not 'gpu'"):
        made_on(fluid(n=40), exact, engine="gpu")


# -- measurements, temperatures, files --------------------------------------------------------------------------------------------------
@pytest.mark.parametrize("scheme", ["middle", "mvv"])
def test_samples_are_the_hosts(scheme, device):
    """From one State per report; the same numbers within the precision."""
    scene = everything()
    simulation = run_on(scene, device, scheme)
    built = made_on(scene, device, scheme)
    host = dpd.build(scene, dt=0.02, scheme=scheme, platform="Reference", seed=5, engine="host", loop=False)
    there = host.simulation()
    simulation.step(5)
    state = simulation.context.getState(positions=True, velocities=True)
    there.context.setPositions(state.getPositions())
    there.context.setVelocities(state.getVelocities())
    there.context.setParameter("dpd_counter", simulation.context.getParameter("dpd_counter"))
    found, expected = dpd.Observer(built).sample(simulation.context), dpd.Observer(host).sample(there.context)
    close = device.choose(1e-9, 1e-6, 3e-5)
    for name in ("kinetic", "pair", "virial_conservative", "kT"):
        assert getattr(found, name) == pytest.approx(getattr(expected, name), rel=close), name
    if scheme == "middle":  # the other one's has friction at a velocity that only its own last step knows
        np.testing.assert_allclose(found.forces, expected.forces, rtol=0, atol=close * np.abs(expected.forces).max())


def test_temperature_and_step_size_may_be_set(exact):
    simulation = run_on(beads(375, edge=5.0), exact)
    simulation.step(3)
    simulation.integrator.setTemperature(2 / 0.00831446261815324)
    simulation.integrator.setStepSize(0.01)
    simulation.step(3)
    assert simulation.context.getParameter("dpd_kT") == pytest.approx(2.0)
    assert simulation.context.getParameter("dpd_dt") == 0.01
    for _ in range(40):
        simulation.step(10)
    _, v = state_of(simulation.context)
    assert 1.6 < np.sum(v**2) / (3 * len(v) - 3) < 2.4


def test_a_system_is_plain_xml(exact):
    built = made_on(everything(), exact)
    text = openmm.XmlSerializer.serialize(built.system)
    assert "PythonForce" not in text
    again = dpd.load_xml(io.StringIO(text))
    assert openmm.XmlSerializer.serialize(again) == text


def test_forces_added_later_act(exact):
    scene = fluid(PLAIN, BOX, n=60, spread=0)
    built = made_on(scene, exact)
    pull = openmm.CustomExternalForce("-50*x")
    for k in range(60):
        pull.addParticle(k, [])
    built.system.addForce(pull)
    simulation = built.simulation(properties=exact.properties)
    _, before = state_of(simulation.context)
    simulation.step(10)
    _, v = state_of(simulation.context)
    mass = scene.bead_masses[:, None]
    # 60 beads, 50 kJ/mol/nm for 0.2 ps
    np.testing.assert_allclose((mass * (v - before)).sum(axis=0), [600.0, 0, 0], atol=1e-4)


# -- Systems made elsewhere -------------------------------------------------------------------------------------------------------------
def argon(constrained: bool) -> tuple[openmm.System, np.ndarray]:
    """A Lennard-Jones fluid of 108 pairs, with constraints or without."""
    system = openmm.System()
    system.setDefaultPeriodicBoxVectors([2.4, 0, 0], [0, 2.4, 0], [0, 0, 2.4])
    force = openmm.NonbondedForce()
    force.setNonbondedMethod(force.CutoffPeriodic)
    force.setCutoffDistance(0.9)
    grid = np.stack(np.meshgrid(*[np.arange(6) * 0.4 + 0.05] * 3), -1).reshape(-1, 3)
    for _ in range(216):
        system.addParticle(39.9)
        force.addParticle(0.0, 0.3, 0.9)
    for k in range(0, 216, 2):
        force.addException(k, k + 1, 0, 0.3, 0)
        if constrained:
            system.addConstraint(k, k + 1, 0.4)
    system.addForce(force)
    return system, grid


@pytest.mark.parametrize("constrained", [False, True], ids=["free", "constrained"])
def test_a_thermostat_for_a_system_made_elsewhere(constrained, usual):
    system, x = argon(constrained)
    topology = app.Topology()
    chain = topology.addChain()
    for _ in range(216):
        topology.addAtom("AR", app.Element.getBySymbol("Ar"), topology.addResidue("AR", chain))
    choices = {"platform": usual.platform, "seed": 3, "topology": topology, "positions": x, "engine": "device"}
    built = dpd.add_thermostat(system, D(gamma=400, cutoff=0.6), 120, 0.004, **choices)
    assert built.plan.execution.steps == ("program" if constrained else "device")
    assert ("whole ones on the device; all forces of the System kick at every B" in built.explain()) != constrained
    simulation = built.simulation(properties=usual.properties)
    simulation.step(400)
    samples = []
    for _ in range(40):
        simulation.step(10)
        samples.append(2 * simulation.context.getState(energy=True).getKineticEnergy()._value)
    _, v = state_of(simulation.context)
    assert np.abs(v.sum(axis=0)).max() < usual.choose(1e-10, 1e-2, 1e-2)
    freedom = 3 * 216 - 3 - (108 if constrained else 0)
    assert np.mean(samples) / freedom / 0.00831446261815324 == pytest.approx(120, rel=0.05)
    if constrained:
        found, _ = state_of(simulation.context)
        apart = found[1::2] - found[::2]
        np.testing.assert_allclose(np.linalg.norm(apart - 2.4 * np.round(apart / 2.4), axis=1), 0.4, rtol=1e-4)
