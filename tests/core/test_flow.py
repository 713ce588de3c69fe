"""Driven and confined fluids: leaks, temperatures, slip at walls, momentum, restarts."""

import numpy as np
import openmm
import pytest
from cases import cases, raises
from judged import any_seed, judge
from openmm import unit
from scenes import beads

import openmm_dpd as dpd
from openmm_dpd.analysis import poiseuille_viscosity
from openmm_dpd.measure import ProfileReporter
from openmm_dpd.model.schemes import SCHEMES

LOW, HIGH, EDGES = 1.5, 4.5, np.array([3.0, 3.0, 6.0])


def channel(
    walls: str | None, *, frozen: bool = True, force: float = 0.0, dt: float = 0.02, scheme: str = "middle", seed: int = 1, A: float = 25.0
):
    """81 beads of fluid between z = 1.5 and 4.5, as dense as the frozen ones beyond."""
    rng = np.random.default_rng(seed)
    solid = 81 if frozen else 0
    x = rng.random((81 + solid, 3)) * [3, 3, 3] + [0, 0, LOW]
    x[81:, 2] += HIGH - LOW
    planes = [dpd.Wall("z", LOW, "above", walls), dpd.Wall("z", HIGH, "below", walls)] if walls else []
    types, forces = ["W"] * 81 + ["S"] * solid, [dpd.BodyForce((force, 0, 0), types="W")] if force else []
    settings = {"box": EDGES, "mobile": np.arange(81 + solid) < 81, "walls": planes, "body_forces": forces}
    scene = dpd.Scene({"W": 1.0, "S": 1.0}, types, x, {("*", "*"): dpd.DPD(A=A, gamma=4.5)}, 1.0, **settings)
    built = dpd.build(scene, dt=dt, scheme=scheme, seed=seed, platform="CPU")
    return built, built.simulation(properties={"Threads": "1"})


def beyond(simulation) -> int:
    z = simulation.context.getState(positions=True).getPositions(asNumpy=True).value_in_unit(unit.nanometer)[:81, 2] % EDGES[2]
    return int(np.sum((z < LOW) | (z > HIGH)))


@pytest.mark.parametrize("scheme", [name for name, scheme in SCHEMES.items() if not scheme.native])
@pytest.mark.parametrize("kind", ["specular", "bounce-back"])
def test_no_bead_passes_a_wall(scheme, kind):
    _, simulation = channel(kind, scheme=scheme)
    for _ in range(15):
        simulation.step(40)
        assert beyond(simulation) == 0


@any_seed(5)
@pytest.mark.parametrize("kind", ["specular", "bounce-back"])
def test_ideal_gas_between_walls_is_uniform_and_maxwellian(kind, seed):
    """At any step size.  Seen are a tenth more beads in a sixth of the channel, and 3 % of the temperature."""
    _, simulation = channel(kind, frozen=False, A=0.0, dt=0.1, seed=seed)
    simulation.step(100)
    z, v = [], []
    for _ in range(400):
        simulation.step(10)
        state = simulation.context.getState(positions=True, velocities=True)
        z.append(state.getPositions(asNumpy=True)._value[:, 2])
        v.append(state.getVelocities(asNumpy=True)._value)
    for layer in range(6):  # a bead leaves a sixth of the channel in about a unit of time, which is the time between samples
        judge((np.floor((np.array(z) - LOW) / (HIGH - LOW) * 6) == layer).mean(axis=1), 1 / 6, error=0.006)
    judge(np.mean(np.square(v), axis=(1, 2)), 1.0, error=0.01)


def flow(kind: str, steps: int, seed: int):
    """Parabola through a channel driven by f = 0.1, with frozen beads."""
    built, simulation = channel(kind, force=0.1, dt=0.03, seed=seed)
    simulation.step(1000)
    reporter = ProfileReporter(5, built, bins=24)
    simulation.reporters.append(reporter)
    simulation.step(steps)
    return poiseuille_viscosity(reporter.profile, 0.1, channel=(LOW, HIGH), skip=0.25)


@pytest.mark.slow
@any_seed(3)
def test_bounce_back_does_not_slip_and_specular_does(seed):
    stuck, slipping = flow("bounce-back", 12000, seed), flow("specular", 12000, seed)
    top = stuck.curvature * (HIGH - LOW) ** 2 / 8
    for slip, error in zip(stuck.slip, stuck.slip_error, strict=True):
        assert abs(slip) < 4 * error + 0.02 * top
        assert error < 0.1 * top
    # both walls together: one of them may hold the fluid fairly well by where its frozen beads happen to be
    assert sum(slipping.slip) > 4 * np.hypot(*slipping.slip_error)


def test_body_force_gives_momentum_and_reverse_flow_keeps_it():
    """Momentum changes by dt times the total force, step by step; in reverse flow this is f times the difference of the halves."""
    n = 81
    for pattern, axis in (("uniform", None), ("halves", "z")):
        force = dpd.BodyForce((0.5, 0, 0), pattern=pattern, axis=axis)
        scene = beads(n, body_forces=[force])
        simulation = dpd.build(scene, dt=0.02, seed=1, platform="CPU").simulation(properties={"Threads": "1"})
        expected = 0.0
        for _ in range(50):
            z = simulation.context.getState(positions=True).getPositions(asNumpy=True)._value[:, 2] % 3.0
            expected += 0.02 * 0.5 * (n if pattern == "uniform" else np.sum(z < 1.5) - np.sum(z >= 1.5))
            simulation.step(1)
        p = simulation.context.getState(velocities=True).getVelocities(asNumpy=True)._value.sum(axis=0)
        assert p == pytest.approx([expected, 0, 0], abs=2e-5)


def test_walls_and_body_forces_on_platforms(device):
    """A room across the boundary of the box, beads strewn over many boxes: none leaves it, and reverse flow pushes as it should."""
    edges, rng = np.array([4.0, 4.0, 6.0]), np.random.default_rng(2)
    x = rng.random((192, 3)) * [4, 4, 4] + [0, 0, 4] + rng.integers(-2, 3, (192, 3)) * edges
    walls, push = [dpd.Wall("z", 4.0, "above"), dpd.Wall("z", 2.0, "below")], dpd.BodyForce((0.1, 0, 0), pattern="halves", axis="y")
    scene = beads(192, positions=x, box=edges, walls=walls, body_forces=[push])
    built = dpd.build(scene, dt=0.02, seed=3, platform=device.platform)
    simulation = built.simulation(properties=device.properties)
    push = dpd.force_terms(built, properties=device.properties)["external"]
    assert np.allclose(push[:, 0], np.where(x[:, 1] % 4 < 2, 0.1, -0.1), atol=1e-6) and not push[:, 1:].any()
    for _ in range(5):
        simulation.step(20)
        z = (simulation.context.getState(positions=True).getPositions(asNumpy=True)._value[:, 2] - 3.0) % 6.0  # the room is 1 to 5
        slack = device.choose(1e-9, 1e-5, 1e-5)
        assert np.all((z > 1 - slack) & (z < 5 + slack))


@pytest.mark.parametrize("gamma", [0.0, 4.5])
def test_beads_on_which_only_body_forces_act(device, gamma):
    """Along such an axis a bead is accelerated evenly among any neighbours; the others feel it as before."""
    rng, taken = np.random.default_rng(7), np.ones((192, 3), bool)
    taken[:40, 2] = taken[30:50, 0] = False
    common = {"masses": {"W": 2.0}, "types": ["W"] * 192, "positions": rng.random((192, 3)) * 4, "box": [4.0] * 3}
    common |= {"pairs": {("W", "W"): dpd.DPD(A=25, gamma=gamma)}, "kT": 1.0 if gamma else 0.0}
    common |= {"velocities": rng.normal(size=(192, 3)), "body_forces": [dpd.BodyForce((0.5, 0, -3.0))]}
    scene = dpd.Scene(**common, interacting=taken)
    built = dpd.build(scene, dt=0.01, scheme="mvv", seed=3, platform=device.platform)
    simulation = built.simulation(properties=device.properties)
    simulation.step(20)
    state = simulation.context.getState(positions=True, velocities=True)
    v, slack = state.getVelocities(asNumpy=True)._value, device.choose(1e-12, 1e-5, 1e-5)
    expected = scene.velocities + 0.2 * np.array([0.25, 0, -1.5])
    assert np.allclose(v[~taken], expected[~taken], atol=slack)
    assert np.abs((v - expected)[taken]).min() > 1e-5
    # the first step of the others is the one that they take anyway
    free = dpd.build(dpd.Scene(**common), dt=0.01, scheme="mvv", seed=3, platform=device.platform)
    walled = dpd.build(scene, dt=0.01, scheme="mvv", seed=3, platform=device.platform)
    found = [each.simulation(properties=device.properties) for each in (walled, free)]
    forces = [dpd.Observer(each).sample(one.context).forces for each, one in zip((built, free), (simulation, found[1]), strict=True)]
    assert np.allclose(forces[0][~taken], np.broadcast_to([0.5, 0, -3.0], (192, 3))[~taken], atol=slack)
    for one in found:
        one.step(1)
    one, other = (each.context.getState(positions=True).getPositions(asNumpy=True)._value for each in found)
    assert np.allclose(one[taken], other[taken], atol=device.choose(1e-12, 1e-5, 1e-5))


_BOXES = [(np.diag([3.0, 3.0, 6.2]), True), (np.array([[3, 0, 0], [0, 3, 0], [0.5, 0, 6]]), True), (np.diag([3.1, 3.0, 6.0]), False)]
_PLANES = {"plain": {}, "moving": {"velocity": (1.0, 0, 0)}, "fluid behind": {"behind": "W", "density": 3.0}, "a program": {}}


@cases("planes, loop", {name: (planes, name != "a program") for name, planes in _PLANES.items()})
def test_a_box_that_was_set_by_hand_does_not_leave_walls_behind(planes, loop):
    """Beads were folded with the old edge, so that some of them were put back from inside, without a word."""
    walls = [dpd.Wall("z", place, side, "bounce-back", **planes) for place, side in ((LOW, "above"), (HIGH, "below"))]
    x = np.random.default_rng(1).random((81, 3)) * 3 + [0, 0, LOW]
    for box, refused in _BOXES:
        simulation = dpd.build(beads(81, box=EDGES, positions=x, walls=walls), dt=0.02, platform="Reference", loop=loop).simulation()
        simulation.step(1)
        simulation.context.setPeriodicBoxVectors(*box)
        if refused:
            raises(openmm.OpenMMException, "walls keep its edge along z, of 6 nm", simulation.step, 1)
        else:
            simulation.step(1)
