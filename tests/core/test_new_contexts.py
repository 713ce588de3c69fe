"""One integrator in a Context that is made anew, in copies, and in the hands of somebody who interrupts it."""

import copy
import signal
import threading
import weakref

import numpy as np
import openmm
import pytest
from cases import raises
from openmm import app, unit
from scenes import beads, external_force, place, state_of, stepped

import openmm_dpd as dpd
from openmm_dpd.units import BOLTZMANN

SCHEMES = ("mvv", "shardlow", "middle", "aboba", "bababo")
SCHEME = pytest.mark.parametrize("scheme", SCHEMES)


def built(scheme="middle", kT=1.0, seed=3, **choices) -> dpd.BuiltSystem:
    v = np.random.default_rng(2).normal(size=(81, 3))
    return dpd.build(beads(kT=kT, velocities=v - v.mean(axis=0)), dt=0.02, scheme=scheme, platform="CPU", seed=seed, **choices)


def anew(context: openmm.Context, x=None, v=None) -> None:
    """Reinitialize without the state, and put positions and velocities back."""
    here = state_of(context)
    context.reinitialize()
    place(context, here[0] if x is None else x, here[1] if v is None else v)


@SCHEME
@pytest.mark.parametrize("conservative", ["kernel", "openmm"])
@pytest.mark.parametrize("asked", [False, True])
def test_no_acceleration_is_taken_over(scheme, conservative, asked):
    """A step of a Context that was made anew is that of a new one, also with a force of the user's in it."""
    ends = []
    for before in (0, 7):
        made = built(scheme, conservative=conservative)
        simulation = made.simulation(properties={"Threads": "1"})
        x, v = state_of(simulation.context)
        simulation.step(before)
        if asked:
            made.integrator.getTemperature()
        made.system.addForce(external_force("-30*x", 81))
        anew(simulation.context, x, v)
        simulation.step(1)
        ends.append(state_of(simulation.context))
    for first, second in zip(*ends, strict=True):
        np.testing.assert_allclose(first, second, atol=1e-12 if conservative == "kernel" else 1e-5)


@pytest.mark.parametrize("seed", [None, 3])
def test_noise_is_new_unless_a_seed_was_given(seed):
    simulation = built(seed=seed).simulation()
    x, v = state_of(simulation.context)
    ends, seeds = [], []
    for _ in range(3):
        anew(simulation.context, x, v)
        simulation.step(1)
        ends.append(state_of(simulation.context)[1])
        seeds.append(simulation.context.getParameter("dpd_seed"))
    assert len(set(seeds)) == (1 if seed is not None else 3)
    assert np.array_equal(ends[0], ends[1]) == (seed is not None)


class OwnContext(openmm.Context):
    """Somebody's own."""


def test_an_integrator_knows_its_context_while_there_is_one():
    """From before the first step, with what other Python threads are just building left alone; and it keeps none alive."""
    made, errors, done = built("mvv", loop=False), [], threading.Event()

    def build_tuples():
        while not done.is_set() and not errors:
            try:
                tuple(k for k in range(3000))
            except SystemError as error:
                errors.append(error)

    thread = threading.Thread(target=build_tuples)
    thread.start()
    for kind in (openmm.Context, OwnContext) * 6:
        integrator = copy.copy(made.integrator)
        context = kind(made.system, integrator, openmm.Platform.getPlatformByName("Reference"))
        assert integrator.context() is context and isinstance(context, kind) and copy.copy(integrator).context() is None
        place(context, made.positions, made.velocities)
        integrator.step(1)
        context = weakref.ref(context)
        assert context() is None and integrator.context() is None
    done.set()
    thread.join()
    assert not errors
    context = openmm.Context(made.system, made.integrator, openmm.Platform.getPlatformByName("Reference"))
    made.integrator.setIntegrationForceGroups(set(range(32)) - {5})
    raises(dpd.PlanError, "after the Context was made", made.integrator.step, 1)


@SCHEME
def test_a_temperature_stays_with_its_integrator(scheme):
    """As with OpenMM's: in a Context made anew and in a copy of the integrator."""
    made = built(scheme)
    simulation = made.simulation()
    simulation.integrator.setTemperature(240)
    simulation.step(3)
    anew(simulation.context)
    simulation.step(2)
    assert simulation.context.getParameter("dpd_kT") == pytest.approx(240 * BOLTZMANN, rel=1e-14)
    for make in (copy.copy, copy.deepcopy, openmm.XmlSerializer.clone):
        other = make(simulation.integrator)
        context = openmm.Context(made.system, other, openmm.Platform.getPlatformByName("Reference"))
        context.setPositions(made.positions)
        other.step(1)
        if make is not openmm.XmlSerializer.clone:  # a plain CustomIntegrator takes the System's
            assert context.getParameter("dpd_kT") == pytest.approx(240 * BOLTZMANN, rel=1e-14)


def test_a_temperature_from_before_the_context_is_the_earlier_one():
    for later in ("set_temperature", "parameter"):
        made = built()
        made.integrator.setTemperature(240)
        simulation = made.simulation()
        if later == "parameter":
            simulation.context.setParameter("dpd_kT", 3.0)
        else:
            dpd.set_kT(simulation.context, 3.0)
        simulation.step(2)
        assert simulation.context.getParameter("dpd_kT") == 3.0
        assert made.integrator.getTemperature().value_in_unit(unit.kelvin) == pytest.approx(3 / BOLTZMANN)


@SCHEME
@pytest.mark.parametrize("how", ["State", "Checkpoint"])
def test_what_is_set_after_loading_another_scripts_state_holds(how, scheme, tmp_path):
    first, second = built(scheme, kT=1.0).simulation(), built(scheme, kT=2.0, seed=5).simulation()
    first.step(3)
    getattr(first, f"save{how}")(str(tmp_path / "saved"))
    getattr(second, f"load{how}")(str(tmp_path / "saved"))
    assert second.integrator.getTemperature().value_in_unit(unit.kelvin) == pytest.approx(2 / BOLTZMANN)
    dpd.set_kT(second.context, 3.0)
    second.context.setParameter("dpd_seed", 777)
    second.step(2)
    assert (second.context.getParameter("dpd_kT"), second.context.getParameter("dpd_seed")) == (3.0, 777)


def test_in_a_compound_integrator_the_temperature_is_heard():
    made = built()
    compound = openmm.CompoundIntegrator()
    compound.addIntegrator(made.integrator)
    simulation = app.Simulation(made.topology, made.system, compound, openmm.Platform.getPlatformByName("CPU"))
    simulation.context.setPositions(made.positions)
    for kelvin in (240, 240, 180):
        made.integrator.setTemperature(kelvin)
        simulation.step(1)
        assert simulation.context.getParameter("dpd_kT") == pytest.approx(kelvin * BOLTZMANN)
        dpd.set_kT(simulation.context, 1.5)
        simulation.step(1)
        assert simulation.context.getParameter("dpd_kT") == 1.5


@pytest.mark.skipif(threading.current_thread() is not threading.main_thread(), reason="signals go to the main thread")
def test_ctrl_c_is_a_keyboard_interrupt(monkeypatch):
    """Also where it comes inside a force, and the step is taken back."""
    from openmm_dpd.kernels import engine

    simulation = stepped(built("middle").simulation(), 10)
    before, sweep = state_of(simulation.context), engine.PairEngine.swept

    def interrupted(*arguments, **named):
        signal.raise_signal(signal.SIGINT)
        return sweep(*arguments, **named)

    monkeypatch.setattr(engine.PairEngine, "swept", interrupted)
    with pytest.raises(KeyboardInterrupt):
        simulation.step(5)
    assert simulation.currentStep == 10
    for found, expected in zip(state_of(simulation.context), before, strict=True):
        assert np.array_equal(found, expected)


def test_parameters_that_are_variables_of_the_integrator():
    for name, reason in (("dt", "step size"), ("temperature", "called temperature")):
        made = built()
        force = openmm.CustomExternalForce(f"{name}*x")
        force.addGlobalParameter(name, 1.0)
        force.addParticle(0)
        made.system.addForce(force)
        with pytest.raises(dpd.PlanError, match=reason):
            made.simulation().step(1)


def test_an_infinite_temperature_is_an_error():
    simulation = built().simulation()
    simulation.context.setParameter("dpd_kT", np.inf)
    raises(openmm.OpenMMException, "must be >= 0 and finite", simulation.step, 1)


def test_a_topology_is_made_for_those_who_ask():
    """Once: built system and Simulation have the same one; nothing else needs it."""
    made = dpd.build(beads(), dt=0.02, platform="Reference")
    simulation = made.simulation()
    simulation.step(1)
    assert all(callable(vars(each)["topology"]) for each in (made, simulation))
    assert simulation.topology is made.topology and simulation.topology.getNumAtoms() == 81
    simulation.topology = other = app.Topology()
    assert simulation.topology is other is not made.topology
