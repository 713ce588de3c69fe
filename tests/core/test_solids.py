"""Walls of any shape: distances, bounces beside numpy, nothing behind them, momentum, restarts, threads, what is refused."""

import dataclasses
import io

import numpy as np
import openmm
import pytest
import scipy
from cases import cases
from oracle_walls import drifted, interpolated
from scenes import state_of

import openmm_dpd as dpd
from openmm_dpd.measure import SolidReporter, WallReporter
from openmm_dpd.plan.solids import solids_of, surface
from openmm_dpd.shapes import Ball, Complement, Cone, Cylinder, Difference, FormulaShape, GridShape, RoundedBox, SolidWall, Union

EDGES = np.array([5.0, 6.0, 5.5])
FLUID = {("*", "*"): dpd.DPD(A=25, gamma=4.5)}
PIPE = Complement(Cylinder((2.5, 3.0, 0.0), "z", 2.0))
SHAPES = {
    "pipe": PIPE,
    "ball": Ball((0.2, 5.9, 1.0), 1.3),
    "cone": Cone((2.0, 3.0, 2.0), (1.0, -0.5, 2.0), 3.0, 1.4, 0.3),
    "bar": Cylinder((2.0, 3.0, 2.0), (1.0, 1.0, 0.3), 0.7, 3.0),
    "block": RoundedBox((1.0, 1.0, 5.0), (2.0, 3.0, 1.5), 0.4),
    "slab": RoundedBox((1.0, 1.0, 0.0), (*EDGES[:2], 1.5)),
    "notched": Difference(RoundedBox((2.5, 3.0, 2.75), (3.0, 3.0, 3.0)), Ball((2.5, 3.0, 4.2), 1.3)),
    "both": Union([Ball((1.0, 1.0, 1.0), 0.9), Cylinder((3.5, 4.0, 0.0), "z", 0.8)]),
    "wavy": FormulaShape(f"abs(z - 2.75) - 1.2 - 0.4*sin(2*{np.pi}*x/5)*cos(2*{np.pi}*y/6)"),
}


def solids(*walls: SolidWall, cutoff: float = 1.0, inv_mass=None):
    return solids_of(walls, np.diag(EDGES), cutoff, np.ones(1) if inv_mass is None else inv_mass)


def fluid(around, n: int = 300, seed: int = 1, frozen: int = 0, **options) -> dpd.Scene:
    """Up to so many beads at random places outside the walls, and frozen ones inside."""
    rng = np.random.default_rng(seed)
    x = rng.random((40 * n, 3)) * EDGES * 3 - EDGES
    from_wall = solids(*around).distance(x).min(axis=0)
    x = np.concatenate([x[from_wall > 0.02][:n], x[from_wall < -0.02][:frozen]])
    options |= {"mobile": np.arange(len(x)) < len(x) - frozen} if frozen else {}
    given = {"masses": {"A": 1.0, "B": 2.5}, "types": (["A", "B"] * n)[: len(x)], "pairs": FLUID, "kT": 1.0, "box": EDGES}
    return dpd.Scene(**given | {"positions": x, "walls": around, "velocities": rng.normal(size=(len(x), 3))} | options)


TURNING = [
    SolidWall(PIPE, velocity=(0, 0, 0.3), centre=(2.5, 3.0, 0.0)),
    SolidWall(Cylinder((2.5, 3.0, 1.0), "z", 0.8, 2.5), spin=(0, 0, 2.0), centre=(2.5, 3.0, 0.0)),
]


# -- shapes ----------------------------------------------------------------------------------------------------------------------
@cases("name", "cone", "bar", "block", "both")
def test_distances_are_those_to_the_surface(name):
    """Beside many points of the surface, which are found as zeros along random lines; no distance changes faster than the place."""
    shape, rng = SHAPES[name], np.random.default_rng(3)
    ends = rng.random((2, 20000, 3)) * EDGES
    ends[1] = ends[0] + rng.normal(size=(20000, 3))
    levels = np.array([shape.distance(end, EDGES) for end in ends])
    assert np.all(np.abs(levels[1] - levels[0]) <= np.linalg.norm(ends[1] - ends[0], axis=1) + 1e-9)
    low, high = ends[:, np.sign(levels[0]) != np.sign(levels[1])]
    start = np.sign(shape.distance(low, EDGES))
    for _ in range(40):
        middle = 0.5 * (low + high)
        same = (np.sign(shape.distance(middle, EDGES)) == start)[:, None]
        low, high = np.where(same, middle, low), np.where(same, high, middle)
    tree = scipy.spatial.cKDTree(low % EDGES, boxsize=EDGES)
    x = ends[0, :500]
    assert np.abs(np.abs(shape.distance(x, EDGES)) - tree.query(x)[0]).max() < 0.25
    near = np.abs(shape.distance(x, EDGES)) < 0.2
    assert np.abs(np.abs(shape.distance(x[near], EDGES)) - tree.query(x[near])[0]).mean() < 0.04


def test_inside_is_where_it_should_be():
    x = np.random.default_rng(1).random((5000, 3)) * EDGES
    d = x - [2.0, 3.0, 2.0]
    axis = np.array([1.0, -0.5, 2.0]) / np.sqrt(5.25)
    along = d @ axis
    across = np.linalg.norm(d - along[:, None] * axis, axis=1)
    cone = (np.abs(along) < 1.5) & (across < 1.4 - 1.1 * (along + 1.5) / 3)
    notch = (np.abs(x - [2.5, 3.0, 2.75]).max(axis=1) < 1.5) & (np.linalg.norm(x - [2.5, 3.0, 4.2], axis=1) > 1.3)
    pipe = np.hypot(x[:, 0] - 2.5, x[:, 1] - 3.0) > 2.0
    for name, inside in {"cone": cone, "notched": notch, "pipe": pipe}.items():
        assert np.array_equal(SHAPES[name].distance(x, EDGES) < 0, inside)
        values = SHAPES[name].distance(x, EDGES)
        assert np.array_equal(Complement(SHAPES[name]).distance(x, EDGES), -values)
    grid = np.stack(np.meshgrid(*[np.arange(n) / n * e for n, e in zip((50, 60, 55), EDGES, strict=True)], indexing="ij"), axis=-1)
    read = GridShape(SHAPES["ball"].distance(grid.reshape(-1, 3), EDGES).reshape(50, 60, 55))
    assert np.abs(read.distance(x, EDGES) - SHAPES["ball"].distance(x, EDGES)).max() < 0.05


# -- drifts ----------------------------------------------------------------------------------------------------------------------
def moving(name: str) -> list[SolidWall]:
    return TURNING if name == "turning" else [SolidWall(SHAPES[name], centre=(1.0, 2.0, 3.0))]


@cases("name", "turning", "notched", "wavy")
def test_drifts_beside_numpy(name):
    """Beads near walls, fast and slow, over several boxes; stretches are shorter in numpy, so that a corner may be cut by one and not by
    the other."""
    rng, n = np.random.default_rng(5), 40
    walls = moving(name)
    made = solids(*walls, cutoff=3.0, inv_mass=rng.choice([0.0, 0.5, 2.0], n, p=[0.1, 0.5, 0.4]))
    x = rng.random((60 * n, 3)) * EDGES * 3 - EDGES
    near = made.distance(x).min(axis=0)
    x = x[(near > 0) & (near < 0.4)][:n]
    v = rng.normal(size=(n, 3)) * rng.choice([1.0, 8.0], n)[:, None]
    assert np.allclose(made.distance(x), np.transpose([interpolated(made.distances, EDGES, p) for p in x]), atol=1e-9)
    new, turned, taken = x.copy(), v.copy(), np.zeros(made.shape)
    made.drift(new, turned, 0.15, taken)
    assert made.distance(new[made.inv_mass > 0]).min() > 0
    off, expected = 0, np.zeros(made.shape)
    for i in np.flatnonzero(made.inv_mass):
        its = drifted(made.distances, EDGES, made.motion, x[i], v[i], 1 / made.inv_mass[i], 0.15, 0.05)
        off += not (np.allclose(new[i], its[0], atol=1e-7) and np.allclose(turned[i], its[1], atol=1e-7))
        expected += its[2]
    still = made.inv_mass == 0
    assert off <= 1 and np.array_equal(new[still], x[still]) and np.array_equal(turned[still], v[still])
    if not off:
        assert np.allclose(taken, expected, rtol=0, atol=1e-5)
    assert np.count_nonzero(turned != v) > 10


def test_a_gas_stays_uniform():
    """Between a ball and a box: shells keep their part of the beads within four standard errors, and no speed changes."""
    rng, n = np.random.default_rng(2), 20000
    made = solids(SolidWall(Ball((2.5, 3.0, 2.7), 1.5)), cutoff=2.0, inv_mass=np.ones(n))
    x = rng.random((2 * n, 3)) * EDGES
    x = x[made.distance(x)[0] > 0][:n]
    v = rng.normal(size=(n, 3))
    speeds, before, start = np.sum(v**2, axis=1), np.histogram(made.distance(x)[0], 12)[0], made.distance(x)[0]
    for _ in range(40):
        made.drift(x, v, 0.2, np.zeros(made.shape))
    assert np.allclose(np.sum(v**2, axis=1), speeds)
    after = np.histogram(made.distance(x)[0], 12, range=(start.min(), start.max()))[0]
    assert np.all(np.abs(after - before) < 4 * np.sqrt(after + before) + 1)
    for k in range(3):
        near = made.distance(x)[0] < 0.3
        assert abs(np.mean(v[near, k] ** 2) - 1) < 5 * np.sqrt(2 / near.sum())


# -- whole steps -----------------------------------------------------------------------------------------------------------------
def run(scene, scheme: str = "middle", dt: float = 0.02, platform: str = "CPU", seed: int = 3, **options):
    built = dpd.build(scene, dt=dt, scheme=scheme, seed=seed, platform=platform, **options)
    return built, built.simulation()


def bits(simulation) -> tuple:
    state = simulation.context.getState(positions=True, velocities=True, parameters=True)
    parameters = {name: value for name, value in state.getParameters().items() if "solid" in name or "counter" in name}
    return state.getPositions(asNumpy=True)._value.tobytes(), state.getVelocities(asNumpy=True)._value.tobytes(), parameters


@cases("scheme", "middle", "mvv", "B/2 A/2 S A/2 B/2")
def test_walls_get_what_the_fluid_loses(scheme):
    scene = fluid(TURNING)
    built, simulation = run(scene, scheme)
    reporter = SolidReporter(20, built)
    simulation.reporters.append(reporter)
    momentum, loose = [], scene.bead_masses[:, None]
    for _ in range(3):
        simulation.step(20)
        state = simulation.context.getState(positions=True, velocities=True)
        momentum.append(np.sum(loose * state.getVelocities(asNumpy=True)._value, axis=0))
    assert built.plan.driven.distance(state.getPositions(asNumpy=True)._value).min() > 0
    impulses = 0.4 * reporter.forces.sum(axis=1)
    assert impulses.shape == (2, 3) and np.abs(impulses).min() > 1e-3
    assert np.allclose(np.diff(momentum, axis=0), -impulses, rtol=0, atol=1e-10)
    assert reporter.torques.shape == (2, 2, 3) and np.isclose(reporter.times[1] - reporter.times[0], 0.4)
    assert reporter.torques[:, 1, 2].mean() < 0  # the fluid brakes the cylinder that turns


@cases("scheme", "middle", pytest.param("mvv", marks=pytest.mark.slow))
def test_restarts_and_numbers_of_threads_give_the_same_bits(scheme, many=500):
    scene = fluid(TURNING, many, frozen=60)
    _, simulation = run(scene, scheme)
    simulation.step(10)
    kept, xml = io.BytesIO(simulation.context.createCheckpoint()), None
    xml = simulation.context.getState(positions=True, velocities=True, parameters=True, integratorParameters=True)
    simulation.step(15)
    wanted = bits(simulation)
    simulation.context.loadCheckpoint(kept.getvalue())
    simulation.step(7)
    simulation.step(8)
    assert bits(simulation) == wanted
    other = run(scene, scheme)[1]
    other.context.setState(openmm.XmlSerializer.deserialize(openmm.XmlSerializer.serialize(xml)))
    other.context.setTime(xml.getTime())
    other.step(15)
    assert bits(other)[:2] == wanted[:2]
    before = dpd.get_threads()
    try:
        for threads in (1, 2):
            dpd.set_threads(threads)
            again = run(scene, scheme)[1]
            again.step(25)
            assert bits(again) == wanted
    finally:
        dpd.set_threads(before)


@cases("scheme", "middle", "mvv", "O/2 B/2 A B/2 O/2")
def test_frozen_beads_go_with_walls_that_move(scheme):
    """Exactly, in one run or in several, and only those in a wall; friction sees their velocities of now."""
    scene = fluid(TURNING, 100, frozen=40)
    still, u = ~scene.mobile, TURNING[1].spin[2]
    scene = dataclasses.replace(scene, positions=np.where(np.arange(140)[:, None] == 139, [2.5, 4.2, 3.0], scene.positions))
    built, simulation = run(scene, scheme)
    for steps in (1, 2, 47):
        simulation.step(steps)
    state = simulation.context.getState(positions=True, velocities=True)
    x, v = state.getPositions(asNumpy=True)._value, state.getVelocities(asNumpy=True)._value
    start, wall = scene.positions, built.plan.driven.distance(scene.positions).argmin(axis=0)
    arm = start - TURNING[1].centre
    arm -= EDGES * np.rint(arm / EDGES)
    wanted = start + np.where(
        (wall == 1)[:, None], arm @ scipy.spatial.transform.Rotation.from_rotvec([0, 0, u]).as_matrix().T - arm, [0, 0, 0.3]
    )
    assert set(wall[still]) == {0, 1}
    assert np.allclose(x[still][:-1], wanted[still][:-1], rtol=0, atol=1e-12) and np.array_equal(x[139], start[139])
    speeds = np.array([built.plan.driven.velocity(wall[k], x[k : k + 1])[0] for k in np.flatnonzero(still)[:-1]])
    assert np.array_equal(v[still][:-1], speeds) and not np.array_equal(speeds, built.plan.driven.velocity(1, start[still][:-1]))
    assert f"which {np.count_nonzero(wall[still][:-1] == 1)} immobile beads go along with" in built.explain()
    engine = built.plan.new_engine()
    engine.prepare(x, np.diag(EDGES))
    assert np.array_equal(engine.seen(v)[still][:-1], speeds)


def test_platforms_agree_and_other_forces_act():
    """Positions after twenty steps on both platforms, beside a force that somebody else adds; a field in the pipe drives a flow."""
    scene = fluid([SolidWall(PIPE)], body_forces=[dpd.BodyForce((0, 0, 0.5))])
    found = []
    for platform in ("CPU", "Reference"):
        built, simulation = run(scene, platform=platform)
        push = openmm.CustomExternalForce("-0.25*x")
        for k in range(scene.n_beads):
            push.addParticle(k, [])
        built.system.addForce(push)
        simulation.context.reinitialize(preserveState=True)
        simulation.step(20)
        found.append(state_of(simulation.context))
    assert np.allclose(found[0][0], found[1][0], atol=1e-4)


def shaken(seed: int) -> Union | Difference | Complement:
    """A shape at random."""
    rng = np.random.default_rng(seed)
    makers = [
        lambda: Ball(rng.random(3) * EDGES, rng.uniform(0.5, 1.6)),
        lambda: Cylinder(rng.random(3) * EDGES, rng.normal(size=3), rng.uniform(0.4, 1.0), rng.uniform(0.5, 2.5)),
        lambda: Cone(rng.random(3) * EDGES, rng.normal(size=3), rng.uniform(0.5, 2.5), rng.uniform(0.5, 1.2), rng.uniform(0, 0.6)),
        lambda: RoundedBox(rng.random(3) * EDGES, rng.uniform(0.8, 3.0, 3), 0.2),
    ]
    one, other, third = (makers[rng.integers(4)]() for _ in range(3))
    return (Union([one, other, third]), Difference(Union([one, other]), third), Complement(Union([one, other, third])))[seed % 3]


def pass_none(seeds, steps: int, n: int) -> None:
    for seed in seeds:
        rng = np.random.default_rng(seed)
        dt = (0.02, 0.05, 0.1, 0.2)[seed % 4]
        scene = fluid([SolidWall(shaken(seed))], n, seed, pairs={("*", "*"): dpd.DPD(A=float(rng.choice([0.0, 5.0])), gamma=20)})
        built, simulation = run(scene, ("middle", "aboba", "bababo")[seed % 3] if dt < 0.2 else "middle", dt, seed=seed)
        at = np.sign(built.plan.driven.distance(scene.positions))
        for _ in range(5):
            simulation.step(steps // 5)
            x = simulation.context.getState(positions=True).getPositions(asNumpy=True)._value
            assert np.array_equal(np.sign(built.plan.driven.distance(x)), at), (seed, dt)


def test_no_bead_passes():
    pass_none((1, 3), 30, 200)


@pytest.mark.slow
def test_no_bead_passes_in_many_steps():
    """Half a million bead-steps; docs/measure/solid_walls.py does ten million."""
    pass_none(range(4, 12), 125, 500)


def test_planes_beside_a_shape_reflect_where_they_are():
    """Ideal beads in the next image, towards both planes and the ball: after a step they are where a bounce at the time of the crossing takes
    them, in the frame of planes that move; the planes' impulses are what the beads lose."""
    low, high, speeds = 1.0, 4.5, {"above": (0.5, -1.0, 0.0), "below": (0.0, 0.25, 0.0)}
    planes = [dpd.Wall("z", z, side, velocity=speeds[side]) for z, side in ((low, "above"), (high, "below"))]
    walls = [planes[0], SolidWall(Ball((2.5, 3.0, 2.75), 1.0)), planes[1]]
    rng, n = np.random.default_rng(4), 40
    x, v = rng.random((n, 3)) * [0.8, 6.0, 0.0], rng.normal(size=(n, 3))
    side = np.arange(n) % 2
    x[:, 2] = np.where(side, high - 0.01, low + 0.01) + EDGES[2]
    v[:, 2] = np.where(side, 1, -1) * (1.0 + np.abs(v[:, 2]))
    x[0], v[0] = [2.5, 3.0, 1.72], [0.0, 0.0, 1.0]
    given = {"types": ["A"] * n, "masses": {"A": 2.0}, "positions": x, "velocities": v, "kT": 0.0}
    scene = dpd.Scene(**given, pairs={("A", "A"): dpd.DPD(A=1e-12, gamma=0)}, box=EDGES, walls=walls)
    built, simulation = run(scene, "mvv", dt=0.1)
    assert "plane across z at 1 nm on a grid" in built.explain() and "velocity (0.5, -1, 0)" in built.explain()
    simulation.step(1)
    state = simulation.context.getState(positions=True, velocities=True)
    there, turned = state.getPositions(asNumpy=True)._value, state.getVelocities(asNumpy=True)._value
    u = np.where(side[:, None], speeds["below"], speeds["above"])
    u[0] = 0.0
    time = np.where(side, high + EDGES[2] - x[:, 2], low + EDGES[2] - x[:, 2]) / v[:, 2]
    time[0] = 0.03
    after = 2 * u - v
    np.testing.assert_allclose(turned, after, atol=1e-6)
    np.testing.assert_allclose(there, x + time[:, None] * v + (0.1 - time)[:, None] * after, atol=1e-5)
    pushes = np.array([[simulation.context.getParameter(f"dpd_solid_{k}_force_{a}") for a in "xyz"] for k in range(3)])
    parts = [2.0 * np.sum((v - after)[its], axis=0) for its in (side == 0, slice(0, 1), side == 1)]
    np.testing.assert_allclose(pushes, [parts[0] - parts[1], *parts[1:]], atol=1e-5)


# -- what is refused -------------------------------------------------------------------------------------------------------------
def refused(message: str, walls=(TURNING[0],), build=None, **options) -> None:
    with pytest.raises(dpd.DPDError, match=message):
        n = 20
        given = {"masses": {"A": 1.0}, "types": ["A"] * n, "pairs": FLUID, "kT": 1.0, "box": EDGES, "walls": walls}
        x = np.random.default_rng(1).random((n, 3)) + [2.0, 2.5, 2.0]
        dpd.build(dpd.Scene(**given | {"positions": x} | options), **{"dt": 0.02, "platform": "CPU"} | (build or {}))


def test_what_cannot_be_is_refused():
    wall = SolidWall(PIPE)
    refused("bead 0 starts in a wall, 0.24 nm deep .20 such", positions=np.random.default_rng(1).random((20, 3)) * 0.1 + [0.4, 2.0, 0])
    pair = [wall, dpd.Wall("z", 0.0, "above"), dpd.Wall("z", 5.0, "below")]
    refused("only wall there", pair[:2])
    refused("the plane across z at 5 nm is specular", [*(dataclasses.replace(each, kind="specular") for each in pair[1:]), wall][::-1])
    refused("plane across z at 0 nm oscillates", [wall, dataclasses.replace(pair[1], velocity=(1, 0, 0), period=3.0), pair[2]])
    refused("plane across z at 5 nm has a fluid behind it", [*pair[:2], dataclasses.replace(pair[2], behind="A", density=3.0)])
    refused("plane across z at 0 nm has no periodic box", pair, box=None)
    refused("plane across z at 0 nm, has no surface in the box: all of it is fluid", [*pair[:2], dpd.Wall("z", 5.42, "below")])
    refused("sequence of Wall", SolidWall(PIPE))
    refused("periodic box that is not tilted", box=None)
    refused("periodic box that is not tilted", box=np.diag(EDGES) + [[0, 0, 0], [1, 0, 0], [0, 0, 0]])
    refused("all of it is solid", [SolidWall(FormulaShape("-1 - z"))])
    refused("all of it is fluid", [SolidWall(Complement(FormulaShape("-1 - z")))])
    refused("cut by the faces of the box across z", [SolidWall(FormulaShape("z - 1"))])
    refused("longer along x", [SolidWall(Ball((1, 1, 1), 2.6))])
    refused("would not stay where it is", [SolidWall(PIPE, velocity=(0.1, 0, 0))])
    refused("would not stay where it is", [SolidWall(PIPE, spin=(0, 0, 1.0), centre=(2.3, 3.0, 0))])
    refused("more than 8", [wall] * 9)
    far = {"positions": np.random.default_rng(1).random((20, 3)) * 0.1 + [0.1, 0.1, 0.0], "mobile": [False] * 20}
    refused("bead 0 would turn with its wall, 0,", [SolidWall(PIPE, spin=(0, 0, 1.0), centre=(2.5, 3.0, 0))], **far)
    refused("lam must be 0.5", build={"scheme": "mvv", "lam": 0.65})
    refused("whole steps", build={"loop": False})
    refused("walls", build={"scheme": "native"})
    refused("walls stand still", shear=dpd.LeesEdwards(rate=0.1))
    refused("not possible in this scene: walls", bodies=[dpd.Body([0, 1, 2])])
    refused("no finite value", [SolidWall(FormulaShape("z - 1/(x - 2.5)"))])
    for make in (
        lambda: SolidWall("pipe"),
        lambda: SolidWall(PIPE, velocity=(1, 2)),
        lambda: Ball((0, 0, 0), -1),
        lambda: Cylinder((0, 0, 0), "w", 1),
        lambda: Cylinder((0, 0, 0), (1, 1, 0), 1),
        lambda: Cone((0, 0, 0), "x", 0, 1),
        lambda: RoundedBox((0, 0, 0), (1, 1, 1), 0.6),
        lambda: FormulaShape("z - w"),
        lambda: GridShape(np.zeros((3, 3))),
        lambda: Union([]),
        lambda: Complement(Union([PIPE, 1])),
        lambda: Difference(PIPE, 3),
    ):
        with pytest.raises(dpd.ParameterError):
            make()


def test_barostats_planes_and_places_in_a_wall_are_refused():
    scene = fluid([SolidWall(PIPE)])
    built, simulation = run(scene)
    with pytest.raises(dpd.DPDError, match="have a shape"):
        dpd.add_barostat(built, 1.0)
    with pytest.raises(dpd.ParameterError, match="no two walls"):
        WallReporter(10, built)
    with pytest.raises(dpd.ParameterError, match="SolidWall"):
        SolidReporter(10, dpd.build(fluid([SolidWall(PIPE)], walls=()), dt=0.02, platform="CPU"))
    assert "complement of Cylinder on a grid of 50 x 60 x 55, off by up to 0.000" in built.explain()
    simulation.step(3)
    x = scene.positions.copy()
    x[7] = [0.1, 0.1, 0.1]
    simulation.context.setPositions(x)
    with pytest.raises(openmm.OpenMMException, match="step 4: bead 7 is in a wall"):
        simulation.step(2)
    simulation.context.setPeriodicBoxVectors(*np.diag(EDGES + 0.1))
    with pytest.raises(openmm.OpenMMException, match="walls keep its edge along x"):
        simulation.step(2)


def test_surface_lies_on_the_surface():
    made = solids(SolidWall(SHAPES["ball"]))
    points, _ = surface(made, 0)
    assert np.abs(SHAPES["ball"].distance(points, EDGES)).max() < 0.002 and len(points) > 1000
