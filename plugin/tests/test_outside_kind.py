"""A kind of pair coefficients from outside the package: its friction is the device's, OpenMM compiles its repulsion; or it is refused."""

import numpy as np
import pytest
from toy_kind import Exponential, potential, scene, terms

import openmm_dpd as dpd
from openmm_dpd.base import serialized
from openmm_dpd.plan import kinds
from openmm_dpd.plan.kinds.dpd import on_device

CHOICES = {"dt": 0.01, "seed": 1}


@pytest.fixture
def register():
    """Registers the kind for the time of a test."""
    yield lambda **more: kinds.register(kinds.Kind(coefficient=Exponential, terms=terms, **more))
    kinds.KINDS.pop(Exponential, None)
    serialized._REGISTERED.discard(Exponential.__module__)


def friction(table) -> dict[str, np.ndarray]:
    return on_device(table.friction)


def reached(built: dpd.BuiltSystem, properties: dict | None = None) -> tuple[np.ndarray, np.ndarray]:
    """Positions and velocities after some steps."""
    simulation = built.simulation(properties=properties or {})
    simulation.step(5)
    state = simulation.context.getState(positions=True, velocities=True)
    return state.getPositions(asNumpy=True)._value, state.getVelocities(asNumpy=True)._value


def test_it_runs_as_on_the_host(register, usual):
    register(potential=potential, device=friction, device_repels=False)
    built = dpd.build(scene(), scheme="mvv", engine="device", platform=usual.platform, **CHOICES)
    assert (built.plan.execution.engine, built.plan.execution.conservative) == ("device", "openmm")
    assert "(the device leaves it to OpenMM)" in built.explain()
    found = reached(built, usual.properties)
    expected = reached(dpd.build(scene(), scheme="mvv", engine="host", platform="Reference", **CHOICES))
    for one, other in zip(found, expected, strict=True):
        np.testing.assert_allclose(one, other, rtol=0, atol=usual.choose(1e-10, 1e-4, 1e-4))


@pytest.mark.parametrize("scheme", ["middle", "bababo", "shardlow"])
def test_its_pair_updates_keep_the_momentum(scheme, register, usual):
    """And pass the check beside the host when the Context is made."""
    register(potential=potential, device=friction, device_repels=False)
    built = dpd.build(scene(), scheme=scheme, engine="device", platform=usual.platform, **CHOICES)
    simulation = built.simulation(properties=usual.properties)
    before = dpd.Observer(built).sample(simulation.context)
    simulation.step(50)
    after = dpd.Observer(built).sample(simulation.context)
    assert np.abs(after.momentum - before.momentum).max() < usual.choose(1e-9, 1e-3, 1e-3)
    assert 0.5 < after.kT < 2.0 and after.pair < 0.9 * before.pair


def test_what_the_device_lacks_is_refused(register, usual):
    device = {"engine": "device", "platform": usual.platform} | CHOICES
    register(potential=potential)
    with pytest.raises(dpd.PlanError, match="it has no Exponential"):
        dpd.build(scene(), **device)
    kinds.KINDS.pop(Exponential)
    register(potential=potential, device=friction, device_repels=False)
    with pytest.raises(dpd.PlanError, match="it leaves the conservative force of Exponential to OpenMM, and here that has to be"):
        dpd.build(scene(), conservative="kernel", **device)
