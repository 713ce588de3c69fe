"""Repulsion and friction that change in a Context: the run goes on as a new one from the same state would."""

import re
from dataclasses import replace

import numpy as np
import openmm
import pytest
from devices import REFERENCE
from scenes import BOXES, EXTENDED, MASSES, PLAIN, D, chains, fluid, same_bits, state_of
from test_steps import made_on, run_on

import openmm_dpd as dpd
from openmm_dpd.base.errors import PlanError
from openmm_dpd.base.names import BY_FORCES, PAIR_FORCE

BOX = BOXES["ortho"]
MANY = {("*", "*"): dpd.MDPD(A=-20.0, B=15.0, gamma=4.5, cutoff=1.0, cutoff_B=0.8)}


def other(table: dict) -> dict:
    """Coefficients of which each is another one, and none is 0 that was not."""
    factors = {"A": 0.7, "gamma": 2.0, "gamma_perp": 0.5, "B": 1.2}
    return {
        key: replace(pair, **{name: f * getattr(pair, name) for name, f in factors.items() if hasattr(pair, name)})
        for key, pair in table.items()
    }


@pytest.mark.parametrize("scheme, table", [("mvv", PLAIN), ("bababo", MANY), ("middle", EXTENDED)], ids=["mvv", "bababo", "middle"])
def test_a_changed_run_is_a_new_one_from_the_same_state(scheme, table, usual):
    before, after = (fluid(each, BOX, n=60, spread=0) for each in (table, other(table)))
    running, as_it_was = run_on(before, usual, scheme), run_on(before, usual, scheme)
    running.step(7)
    state = running.context.getState(positions=True, velocities=True, parameters=True)  # without the acceleration of the forces before
    built = made_on(after, usual, scheme)
    built.update_in_context(running.context)
    fresh = made_on(after, usual, scheme).simulation(properties=usual.properties)
    for simulation in (fresh, as_it_was):
        simulation.context.setState(state)
    ends = []
    for simulation in (running, fresh, as_it_was):
        energy = simulation.context.getState(energy=True).getPotentialEnergy()._value
        simulation.step(10)
        ends.append((np.array([energy]), *state_of(simulation.context)))
    assert same_bits(ends[0], ends[1])
    assert not same_bits(ends[0], ends[2])


@pytest.mark.parametrize("updated", [False, True])
def test_a_state_by_other_forces_begins_without_their_acceleration(updated, tmp_path):
    """Those of another scene, or of the same one before it was changed in the Context that wrote the state."""
    scenes = [fluid(each, BOX, n=60, spread=0) for each in (PLAIN, other(PLAIN))]
    written = run_on(scenes[updated], REFERENCE, "mvv")
    if updated:
        made_on(scenes[0], REFERENCE, "mvv").update_in_context(written.context)
    written.step(7)
    written.saveState(str(tmp_path / "state"))
    found, expected = (run_on(scenes[1], REFERENCE, "mvv") for _ in range(2))
    for simulation in (found, expected):
        simulation.loadState(str(tmp_path / "state"))
    expected.integrator.setGlobalVariableByName("valid_for", -1.0)
    found.step(1)
    expected.step(1)
    assert same_bits(state_of(found.context), state_of(expected.context))


def test_a_system_is_saved_with_what_it_has_now():
    running, built = run_on(fluid(PLAIN, BOX, n=60), REFERENCE), made_on(fluid(other(PLAIN), BOX, n=60), REFERENCE)
    built.update_in_context(running.context)
    found, expected = (pair_force(each) for each in (running.system, built.system))
    assert found == expected != pair_force(made_on(fluid(PLAIN, BOX, n=60), REFERENCE).system)


def pair_force(system: openmm.System) -> str:
    """Its XML, but for the number of the forces that a new Context begins with."""
    text = next(openmm.XmlSerializer.serialize(force) for force in system.getForces() if force.getName() == PAIR_FORCE)
    return re.sub(rf'default="[^"]*" name="{BY_FORCES}"', "", text)


REFUSED = {
    "cutoff": (fluid({("*", "*"): D(A=25, gamma=4.5, cutoff=1.1)}, BOX, n=60), "cutoff of a Context cannot change"),
    "exponent": (fluid({("*", "*"): D(A=25, gamma=4.5, exponent=0.5)}, BOX, n=60), "exponent of a Context cannot change"),
    "fixed sigma": (fluid({("*", "*"): D(A=25, sigma=3.0)}, BOX, n=60), "a fixed sigma"),
    "no friction": (fluid({("*", "*"): D(A=25, gamma=0.0)}, BOX, n=60), "letters of a Context cannot change"),
    "no repulsion": (fluid({("*", "*"): D(A=0, gamma=4.5)}, BOX, n=60), "repulsion where there was none"),
    "transverse": (fluid({("*", "*"): D(A=25, gamma=4.5, gamma_perp=1.0)}, BOX, n=60), "transverse friction"),
    "masses": (fluid({("*", "*"): D(A=25, gamma=4.5)}, BOX, n=60, masses=MASSES | {"B": 3.0}), "other masses"),
    "bonds": (chains(BOX, n=60, k=20.0), "has no such"),
}


@pytest.mark.parametrize("name", REFUSED)
def test_whatever_else_differs_is_refused_and_nothing_changes(name):
    plain = fluid({("*", "*"): D(A=25, gamma=4.5)}, BOX, n=60)
    refused, same = run_on(plain, REFERENCE), run_on(plain, REFERENCE)
    refused.step(3)
    scene, why = REFUSED[name]
    with pytest.raises(PlanError, match=why):
        made_on(scene, REFERENCE).update_in_context(refused.context)
    refused.step(3)
    same.step(6)
    assert same_bits(state_of(refused.context), state_of(same.context))


def test_a_force_of_the_context_that_is_missing_is_refused():
    bonded = run_on(chains(BOX, n=60, k=20.0), REFERENCE)
    with pytest.raises(PlanError, match="this build has no harmonic bonds"):
        made_on(fluid({("*", "*"): D(A=25, gamma=4.5)}, BOX, n=60), REFERENCE).update_in_context(bonded.context)


def test_the_hosts_kernel_says_what_to_do_instead():
    plain = fluid({("*", "*"): D(A=25, gamma=4.5)}, BOX, n=60)
    ours, theirs = (dpd.build(plain, dt=0.02, platform="Reference", engine="host") for _ in range(2))
    with pytest.raises(PlanError, match="load the state"):
        ours.update_in_context(theirs.simulation().context)
