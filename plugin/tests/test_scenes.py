"""Several tables, no friction, walls that move or have a fluid behind them, shear, body forces alone: beside the host and numpy; bits; refusals."""

import io
from dataclasses import replace

import numpy as np
import openmm
import oracle
import pytest
from conftest import available
from cuts import ends_of_all_ways
from devices import Device
from judged import any_seed
from midpoint import impulses, noise_of_piece
from scenes import BOXES, EXTENDED, PLAIN, D, beads, chains, fluid, noise_of, oracle_params, same_bits, state_of
from test_fields import KINDS, carrying, end_of
from test_pair_terms import COUNTER, DT, SEED, bound, close, context_of, found
from test_rounds import three
from test_steps import OWN, made_on, pulling, run_on

import openmm_dpd as dpd
from openmm_dpd.analysis import couette_viscosity, shear_viscosity
from openmm_dpd.base.names import IMPULSES, Phase
from openmm_dpd.measure import Observer, ProfileReporter, StressReporter, WallReporter
from openmm_dpd.plan.forces.device_force import device_force
from openmm_dpd.simulation.device_check import differences

BOX = BOXES["ortho"]
WEAK = {("*", "*"): D(A=25, gamma=1e-12)}  # the order of pair updates makes no difference
ATTRACTION = {("*", "*"): dpd.MDPD(A=-30, B=25, gamma=3.0, cutoff_B=0.8)}
WORDS = ["middle", "shardlow", "bababo", OWN, "O B/2 A B/2"]
REFERENCE = Device("Reference")


def beside_the_host(scene, scheme: str, *, end=lambda each: state_of(each.context), steps=(1, 11), close=1e-7, **choices) -> tuple:
    """Simulations of device and host that end alike."""
    choices = {"dt": 0.01, "scheme": scheme, "seed": 5, "platform": "Reference"} | choices
    builts = [made_on(scene, available(REFERENCE), **choices), dpd.build(scene, engine="host", **choices)]
    pair = [built.simulation() for built in builts]
    for n in steps:
        for simulation in pair:
            simulation.step(n)
        for ours, theirs in zip(*map(end, pair), strict=True):
            np.testing.assert_allclose(ours, theirs, rtol=0, atol=close * max(1.0, np.abs(theirs).max()))
    return (*builts, *pair)


# -- several tables, and no friction ------------------------------------------------------------------------------------------------
def test_several_tables_are_those_of_numpy(device):
    scene = fluid([PLAIN, EXTENDED], BOX, n=60, spread=0)
    context = context_of(scene, device, tolerance=device.choose(1e-12, 1e-12 if device.precision == "double" else 1e-7, 1e-7))
    x, v = state_of(context)
    here = [(scene.type_ids, oracle_params(scene, layer), scene.box) for layer in (0, 1)]
    pushed = [oracle.conservative(x, *table, None) for table in here]
    energy, force = found(context, Phase.CONSERVE)
    close(force, pushed[0].forces + pushed[1].forces, bound(device))
    assert energy == pytest.approx(pushed[0].energy + pushed[1].energy, rel=bound(device))
    rest = sum(
        oracle.dissipative(x, v, *table, None).forces
        + oracle.random(x, *table, 1.0, DT, noise_of(60, SEED, COUNTER, 1.0, layer), None).forces
        for layer, table in enumerate(here)
    )
    close(found(context, Phase.FORCE_KEPT)[1], rest, bound(device))
    noises = (noise_of_piece(60, SEED, COUNTER, 1.0, 0, layer) for layer in (0, 1))
    close(found(context, Phase.SWEEP_SEEN + 1)[1], impulses(scene, x, v, DT, 1.0, *noises), bound(device))


@pytest.mark.parametrize("tables", [[PLAIN, EXTENDED], [PLAIN, ATTRACTION], [ATTRACTION, EXTENDED, PLAIN]], ids=["two", "many", "three"])
def test_steps_of_several_tables_are_the_hosts(tables):
    for scene in (fluid(tables, BOX, n=60, spread=0), replace(chains(BOXES["tilted"], n=60, k=20.0), pairs=tables)):
        beside_the_host(scene, "mvv", conservative="kernel")


def test_friction_of_several_tables_adds_up():
    """An exact update is divided by the friction of all tables together: two of them do what one of twice the friction does without noise."""
    ends = []
    for tables in ([{("W", "W"): D(gamma=100.0)}] * 2, [{("W", "W"): D(gamma=200.0)}]):
        simulation = run_on(
            beads(192, edge=4.0, table=tables, kT=0.0, velocities=np.ones((192, 3)) * np.arange(192)[:, None] % 7), available(REFERENCE)
        )
        simulation.step(3)
        ends.append(state_of(simulation.context))
    np.testing.assert_allclose(ends[0][1], ends[1][1], rtol=0, atol=1e-9)


@pytest.mark.parametrize("scheme", ["mvv", *WORDS])
def test_without_friction_steps_are_the_hosts(scheme):
    """Energies are kept as well, and beads of any speed are no error."""
    scene = replace(chains(BOX, n=60, k=20.0), pairs={("*", "*"): D(A=25)})
    _, _, simulation, host = beside_the_host(scene, scheme, conservative="kernel", loop=False)
    energies = [each.context.getState(energy=True) for each in (simulation, host)]
    assert energies[0].getPotentialEnergy()._value == pytest.approx(energies[1].getPotentialEnergy()._value, rel=1e-8)
    assert simulation.context.getParameter("dpd_counter") == 0
    many = replace(scene, bonds=(), pairs={("*", "*"): dpd.MDPD(A=-30, B=25, gamma=0, cutoff_B=0.8)})
    beside_the_host(many, scheme, conservative="kernel")
    simulation.context.setVelocities(np.full((60, 3), 300.0))
    simulation.step(10)
    assert np.isfinite(simulation.context.getState(energy=True).getPotentialEnergy()._value)


# -- walls ---------------------------------------------------------------------------------------------------------------------------
LOW, HIGH, EDGES = 0.7, 4.7, np.array([4.0, 4.0, 5.0])


def between_walls(kind: str, **more) -> dpd.Scene:
    """Beads of two masses strewn over boxes along x and y, some of them in pairs; "behind": their own friction is nearly 0, that of walls is not."""
    rng = np.random.default_rng(1)
    x = rng.random((96, 3)) * [4, 4, HIGH - LOW] + [0, 0, LOW] + EDGES * rng.integers(-1, 2, (96, 3))
    extra = {"behind": "W", "density": 3.0} if kind == "behind" else {}
    walls = [
        dpd.Wall("z", LOW, "above", velocity=(0.5, -0.2, 0.0), period=0.3, **extra),
        dpd.Wall("z", HIGH, "below", velocity=(-0.3, 0, 0)),
    ]
    if kind == "edges":
        x[:, 0], box = x[:, 0] % 4, EDGES + [1, 0, 0]
        walls += [dpd.Wall("x", 0.0, "above", "specular"), dpd.Wall("x", 4.0, "below", "specular")]
    else:
        box = EDGES
    table = WEAK | {("A", "W"): D(A=25, gamma=4.5), ("B", "W"): D(A=35, gamma=9, gamma_perp=2), ("W", "W"): D(A=25, gamma=4.5)}
    v = np.random.default_rng(2).normal(size=(96, 3))
    bonds = [dpd.HarmonicBonds(np.arange(20).reshape(-1, 2), k=20, r0=0.5)]
    own = {"masses": {"W": 1.0, "A": 1.0, "B": 2.0}, "types": ["A", "B"] * 48, "positions": x, "pairs": table, "kT": 1.0, "box": box}
    return dpd.Scene(**own | {"walls": walls, "velocities": v, "bonds": bonds} | more)


def with_impulses(simulation) -> tuple:
    state = simulation.context.getState(positions=True, velocities=True, parameters=True)
    known = state.getParameters()
    taken = np.array([known[name] if name in known else 0.0 for name in IMPULSES.values()])
    return state.getPositions(asNumpy=True)._value, state.getVelocities(asNumpy=True)._value, taken.reshape(3, 2, 3)


@pytest.mark.parametrize("kind, scheme", [("moving", "mvv"), ("edges", "mvv"), ("edges", "aboba"), *(("behind", word) for word in WORDS)])
def test_steps_between_walls_are_the_hosts(kind, scheme):
    """Positions, velocities and what walls have taken up; energies, too."""
    choices = {"dt": 0.01, "close": 1e-6, "end": with_impulses, "loop": True}
    for lam in (0.5, 0.65) if kind == "moving" else (0.5,):
        built, other, simulation, host = beside_the_host(between_walls(kind), scheme, lam=lam, steps=(1, 24, 5), **choices)
        taken = with_impulses(simulation)[2]
        assert np.abs(taken[2]).max() > 1 and (kind != "edges" or np.abs(taken[0]).max() > 1)
        samples = [Observer(each).sample(one.context) for each, one in ((built, simulation), (other, host))]
        assert samples[0].potential == pytest.approx(samples[1].potential, rel=1e-6)
    assert max(error for error, _ in differences(simulation.context, built.plan).values()) < 1e-3


@pytest.mark.parametrize("scheme, precision", [("middle", ""), ("mvv", ""), ("bababo", ""), ("bababo", "single")])
def test_walls_get_what_the_fluid_loses(scheme, precision):
    """Also beside a force of others."""
    usual = available(Device("OpenCL", precision) if precision else REFERENCE)
    scene = between_walls("moving" if scheme == "mvv" else "behind")
    built = made_on(scene, usual, scheme, dt=0.01)
    push = openmm.CustomExternalForce("-0.25*x")
    for bead in range(96):
        push.addParticle(bead)
    built.system.addForce(push)
    simulation = built.simulation(properties=usual.properties)
    before = scene.bead_masses @ with_impulses(simulation)[1]
    simulation.step(30)
    _, v, taken = with_impulses(simulation)
    assert np.abs(taken).max() > 10
    gained = scene.bead_masses @ v - before + taken.sum(axis=(0, 1))
    np.testing.assert_allclose(gained, [0.3 * 0.25 * 96, 0, 0], rtol=0, atol=usual.choose(1e-6, 2e-3, 2e-3))


def test_a_step_that_fails_leaves_the_walls_nothing():
    """What they had taken up in it and in those before is taken back with it."""
    scene, calls, pair = between_walls("moving"), [0], []

    def fails_once(state):
        calls[0] += 1
        if calls[0] == 20:
            raise ValueError("this once")
        return 0.0, np.zeros((96, 3))

    for force in (openmm.PythonForce(fails_once, {}), openmm.PythonForce(lambda state: (0.0, np.zeros((96, 3))), {})):
        built = made_on(scene, available(REFERENCE), "mvv", dt=0.01)
        built.system.addForce(force)
        pair.append(built.simulation())
    with pytest.raises(Exception, match="this once"):
        pair[0].step(30)
    pair[0].step(30 - pair[0].currentStep)
    pair[1].step(30)
    assert np.abs(with_impulses(pair[0])[2]).max() > 10
    for mine, expected in zip(*map(with_impulses, pair), strict=True):
        np.testing.assert_allclose(mine, expected, rtol=0, atol=1e-9)


# -- shear ---------------------------------------------------------------------------------------------------------------------------
SHEARS = {
    "constant": dpd.LeesEdwards(rate=-2.0),
    "ramp": dpd.LeesEdwards(rate=0.5, end_rate=3.0, ramp_time=0.1),
    "oscillating": dpd.LeesEdwards(amplitude=0.7, frequency=5.0),
}
TILTED = BOX + np.outer([0, 1, 0], [1.85, 0, 0])


def sheared(name: str, table=PLAIN, box=BOX, **options) -> dpd.Scene:
    """Beads strewn over many images of the box."""
    return fluid(table, box, n=60, shear=SHEARS[name], **options)


def with_box(simulation) -> tuple:
    state = simulation.context.getState(parameters=True)
    return *state_of(simulation.context), state.getPeriodicBoxVectors(asNumpy=True)._value, np.array(state.getParameters()["dpd_sheared"])


@pytest.mark.parametrize("name, scheme, lam", [(n, "mvv", lam) for n in SHEARS for lam in (0.5, 0.65)] + [("ramp", w, 0.5) for w in WORDS])
def test_steps_of_a_shear_are_the_hosts(name, scheme, lam):
    scene = sheared(name, EXTENDED if scheme == "mvv" else WEAK, TILTED if name == "constant" else BOX)
    choices = {"lam": lam, "steps": (3, 17), "end": with_box, "close": 1e-6}
    built, other, simulation, host = beside_the_host(scene, scheme, **choices)
    samples = [Observer(each).sample(one.context) for each, one in ((built, simulation), (other, host))]
    assert samples[0].kT == pytest.approx(samples[1].kT, rel=1e-5)
    if scheme == "mvv":  # friction at the velocities that the last step has predicted
        assert samples[0].virial_dissipative == pytest.approx(samples[1].virial_dissipative, rel=1e-5)
    assert abs(with_box(simulation)[2][1, 0] - scene.box[1, 0]) > 0.2


@pytest.mark.parametrize("kind", ["chains", *KINDS])
def test_steps_of_other_kinds_in_a_shear_are_the_hosts(kind):
    given = {"shear": SHEARS["ramp"]}
    scene = replace(chains(BOX, n=60, k=20.0), pairs=PLAIN, **given) if kind == "chains" else carrying(kind, **given)
    close = {} if kind == "chains" else {"end": end_of}
    beside_the_host(scene, "mvv", dt=0.005, close=1e-6, **close)


@pytest.mark.parametrize("scheme", ["middle", "mvv"])
@pytest.mark.parametrize("kind", ["pairs", "heat", "species"])
def test_a_slab_that_meets_no_image_knows_nothing_of_a_shear(kind, scheme, monkeypatch):
    """Friction and heat depend on the velocities themselves, with the flow in them: all is as without a shear."""
    monkeypatch.setitem(device_force.__kwdefaults__, "tolerance", 1e-12)
    ends = []
    for given in ({}, {"shear": dpd.LeesEdwards(rate=1.5)}):
        scene = fluid(EXTENDED, BOX, n=60, **given) if kind == "pairs" else three(carrying(kind, **given))
        x = np.random.default_rng(1).random((len(scene.types), 3)) * [3.7, 2.0, 4.1] + [0, 1.4, 0]
        simulation = run_on(replace(scene, positions=x), available(REFERENCE), scheme, dt=0.005)
        simulation.step(10)
        ends.append(state_of(simulation.context) if kind == "pairs" else end_of(simulation))
    for mine, theirs in zip(*ends, strict=True):
        np.testing.assert_allclose(mine, theirs, rtol=0, atol=1e-9)


@pytest.mark.parametrize("kind", ["pairs", "heat", "species"])
def test_where_beads_are_put_among_their_images_changes_nothing_but_rounding(kind):
    """Pair updates, of heat and species too, of beads that are moved to other images, with the velocities that these have."""
    given = {"shear": dpd.LeesEdwards(rate=1.5)}
    scene = fluid(EXTENDED, BOX, n=60, **given) if kind == "pairs" else three(carrying(kind, **given))
    one, other = (run_on(scene, available(REFERENCE), dt=0.005) for _ in range(2))
    for simulation in (one, other):
        simulation.step(20)
    x, v, box, _ = with_box(other)
    turns = np.random.default_rng(4).integers(-3, 4, x.shape) * [1, 100, 1]  # where beads that follow the flow are fast
    other.context.setPositions(x + turns @ box)
    other.context.setVelocities(v + 1.5 * box[1, 1] * turns[:, 1:2] * [1, 0, 0])
    for simulation in (one, other):
        simulation.step(20)
    ends = []
    for simulation, moved in ((one, 0 * turns), (other, turns)):
        x, v, *fields = state_of(simulation.context) if kind == "pairs" else end_of(simulation)
        ends.append((x[:, 1] - box[1, 1] * moved[:, 1], v - 1.5 * x[:, 1:2] * [1, 0, 0], *fields))
    for mine, theirs in zip(*ends, strict=True):
        np.testing.assert_allclose(mine, theirs, rtol=0, atol=1e-9 * max(1.0, np.abs(mine).max()))
    assert np.abs(box[1, 0]) > 0.1


def test_what_a_shear_cannot_have_is_refused():
    exact, scene = available(REFERENCE), sheared("constant")
    made = [made_on(scene, exact) for _ in range(2)]
    force = openmm.CustomExternalForce("-0.1*z")
    force.addParticle(0)
    made[0].system.addForce(force)
    with pytest.raises(dpd.PlanError, match="sliding images"):
        made[0].simulation().step(1)
    simulation = made[1].simulation()
    simulation.step(3)
    simulation.context.setPeriodicBoxVectors(*TILTED)
    with pytest.raises(openmm.OpenMMException, match="tilted by 1.85 and not by the -0.588.* of the shear"):
        simulation.step(1)
    single = Device("OpenCL", "single")
    with pytest.raises(dpd.ParameterError, match="a shear needs mixed precision"):
        run_on(scene, available(single))
    with pytest.raises(dpd.ParameterError, match="double precision beside Forces of OpenMM"):
        run_on(replace(chains(BOX, n=60, k=20.0), pairs=PLAIN, shear=SHEARS["ramp"]), available(Device("OpenCL", "mixed")))
    tables = [PLAIN, {("*", "*"): dpd.LennardJones(epsilon=0.1, sigma=0.3, cutoff=1.0)}]
    for given, choices in ((replace(scene, pairs=tables), {}), (scene, {"conservative": "openmm"})):
        with pytest.raises(dpd.PlanError, match="forces of OpenMM's own with a cutoff would put them back"):
            made_on(given, exact, **choices)


@pytest.mark.parametrize(
    "scene",
    [lambda: between_walls("behind", pairs={("*", "*"): D(A=25, gamma=4.5)}), lambda: sheared("ramp", EXTENDED)],
    ids=["walls", "shear"],
)
def test_forces_are_the_hosts(scene, device):
    if device.precision == "single" and scene().shear is not None:
        pytest.skip("refused")
    simulation = run_on(scene(), device, dt=0.01)
    simulation.step(5)
    off = {what: error for what, (error, _) in differences(simulation.context, simulation._plan).items()}
    assert off.pop("the pair update") < 5e-3 and max(off.values()) < bound(device) and len(off) == 3


@pytest.mark.parametrize("kind", ["behind", "sheared"])
def test_states_go_to_the_host_and_back(kind):
    scene, end = (sheared("constant"), with_box) if kind == "sheared" else (between_walls("behind"), with_impulses)
    ours, host = (dpd.build(scene, dt=0.01, platform="Reference", seed=5, engine=engine).simulation() for engine in ("device", "host"))
    for one, other in ((ours, host), (host, ours)):
        one.step(7)
        state = io.StringIO()
        one.saveState(state)
        other.loadState(io.StringIO(state.getvalue()))
        assert same_bits(end(one), end(other))
        other.step(1)


# -- body forces alone ---------------------------------------------------------------------------------------------------------------
@pytest.mark.parametrize("lam", [0.5, 0.65])
@pytest.mark.parametrize("friction", [True, False])
def test_where_only_body_forces_act_steps_are_the_hosts(friction, lam):
    scene = replace(chains(BOX, n=60, k=20.0), pairs=PLAIN if friction else {("*", "*"): D(A=25)})
    free = np.random.default_rng(3).random((60, 3)) > 0.3
    scene = replace(scene, interacting=free, body_forces=[dpd.BodyForce((1.0, -2.0, 0.5))])
    _, _, simulation, _ = beside_the_host(scene, "mvv", lam=lam if friction else 0.5, conservative="kernel", close=1e-6)
    gained = state_of(simulation.context)[1] - scene.velocities
    expected = 0.12 * np.array([1.0, -2.0, 0.5]) / scene.bead_masses[:, None]
    np.testing.assert_allclose(gained[~free], expected[~free], rtol=0, atol=1e-9)
    replaced = replace(scene, kT=dpd.TemperatureRamp(1.0, 2.0, 0, 20)) if friction else scene
    beside_the_host(replaced, "mvv", conservative="kernel", close=1e-6)


def test_where_only_body_forces_act_those_of_others_may_change():
    scene = replace(fluid(PLAIN, BOX, n=60, spread=0), interacting=np.random.default_rng(3).random((60, 3)) > 0.3)
    built, pull = (
        made_on(replace(scene, body_forces=[dpd.BodyForce((1.0, -2.0, 0.5))]), available(REFERENCE), "mvv", dt=0.01),
        pulling(10.0),
    )
    built.system.addForce(pull)
    simulation = built.simulation()
    for strength in (50.0, -20.0):
        simulation.step(5)
        for bead in range(60):
            pull.setParticleParameters(bead, bead, [strength])
        pull.updateParametersInContext(simulation.context)
    simulation.step(5)
    expected = scene.velocities + 0.15 * np.array([1.0, -2.0, 0.5]) / scene.bead_masses[:, None]
    np.testing.assert_allclose(state_of(simulation.context)[1][~scene.interacting], expected[~scene.interacting], rtol=0, atol=1e-9)


def test_where_only_body_forces_act_calls_of_step_change_nothing_beside_others():
    """An acceleration that is kept gets what the others' forces have changed by, not friction of other velocities."""
    scene, ends = replace(fluid(PLAIN, BOX, n=60, spread=0), interacting=np.random.default_rng(3).random((60, 3)) > 0.3), []
    for calls in (1, 6):
        built = made_on(replace(scene, body_forces=[dpd.BodyForce((1.0, -2.0, 0.5))]), available(REFERENCE), "mvv", dt=0.01)
        built.system.addForce(pulling(50.0))
        simulation = built.simulation()
        for _ in range(calls):
            simulation.step(12 // calls)
        ends.append(state_of(simulation.context))
    np.testing.assert_allclose(ends[0], ends[1], rtol=0, atol=1e-9)


@pytest.mark.parametrize("kT", [1.0, dpd.TemperatureRamp(1.0, 2.0, 0, 20)], ids=["constant", "ramp"])
@pytest.mark.parametrize("restarts", [False, True])
def test_the_noise_of_a_new_step_size_is_the_hosts(kT, restarts):
    """The acceleration that the last step has kept is that of another step size, also where a State has it."""
    *_, simulation, host = beside_the_host(fluid(PLAIN, BOX, n=60, kT=kT), "mvv", steps=(5,), close=1e-6)
    for each in (simulation, host):
        if restarts:
            state = io.StringIO()
            each.saveState(state)
            each.loadState(io.StringIO(state.getvalue()))
        each.integrator.setStepSize(0.006)
        each.step(5)
    for ours, theirs in zip(state_of(simulation.context), state_of(host.context), strict=True):
        np.testing.assert_allclose(ours, theirs, rtol=0, atol=1e-6)


# -- bits, and XML -------------------------------------------------------------------------------------------------------------------
def pulled_alone() -> dpd.Scene:
    """Chains on which only body forces act along some axes."""
    scene = replace(chains(BOX, n=60, k=20.0), pairs=PLAIN, interacting=np.random.default_rng(3).random((60, 3)) > 0.3)
    return replace(scene, body_forces=[dpd.BodyForce((1.0, -2.0, 0.5))])


@pytest.mark.parametrize(
    "scene, scheme, end",
    [
        (lambda: between_walls("behind"), "middle", with_impulses),
        (lambda: sheared("oscillating"), "middle", with_box),
        (pulled_alone, "mvv", lambda each: state_of(each.context)),
        pytest.param(lambda: between_walls("moving"), "mvv", with_impulses, marks=pytest.mark.slow),
        pytest.param(lambda: sheared("oscillating"), "mvv", with_box, marks=pytest.mark.slow),
    ],
    ids=["walls", "shear", "body forces", "swinging walls", "shear mvv"],
)
def test_cuts_restarts_shared_beads_and_plain_integrators_change_no_bit(scene, scheme, end, tmp_path, monkeypatch):
    """Plain ones are read from XML, and OpenMM and the plugin step them."""
    device = available(Device("OpenCL", "mixed"))
    ends = ends_of_all_ways(lambda: run_on(scene(), device, scheme, dt=0.01), end, tmp_path)
    monkeypatch.setenv("OPENMM_DPD_DEVICE_LANES", "8")
    shared = run_on(scene(), device, scheme, dt=0.01)
    built = made_on(scene(), device, scheme, dt=0.01)
    system, integrator = map(openmm.XmlSerializer.clone, (built.system, built.integrator))
    context = openmm.Context(system, integrator, openmm.Platform.getPlatformByName("OpenCL"), device.properties)
    context.setPositions(built.positions)
    context.setVelocities(built.velocities)
    for stepping in (shared, integrator):
        stepping.step(20)
    ends.append(end(shared))
    shared.context = context
    assert all(same_bits(ends[0], other) for other in (*ends[1:], end(shared)))


@pytest.mark.parametrize(
    "scene, name, message",
    [
        (lambda: between_walls("behind"), "wallMotion", "motion of walls needs 24 numbers"),
        (lambda: between_walls("behind"), "behind", "what is behind walls needs two tables"),
        (lambda: sheared("ramp"), "shear", "a shear needs six numbers"),
        (lambda: fluid(PLAIN, BOX, n=60, interacting=np.random.default_rng(3).random((60, 3)) > 0.3), "alone", "of every particle"),
    ],
)
def test_it_goes_through_xml_and_wrong_xml_is_refused(scene, name, message):
    built = made_on(scene(), available(REFERENCE), "mvv" if name == "alone" else "middle")
    text = openmm.XmlSerializer.serialize(built.system)
    assert 'version="4"' in text and openmm.XmlSerializer.serialize(openmm.XmlSerializer.deserialize(text)) == text
    with pytest.raises(openmm.OpenMMException, match=message):
        openmm.XmlSerializer.deserialize(text.replace(f' {name}="', f' {name}="1 ', 1))


# -- averages ------------------------------------------------------------------------------------------------------------------------
@pytest.mark.slow
@pytest.mark.statistical
@any_seed(1)
def test_a_flow_between_walls(seed):
    """Shear rate, viscosity, temperature and density are those of the standard fluid up to the walls, as the host's: 2 to 4 % and four errors."""
    gap, edge, n = 6.0, 4.0, 288
    sides = ((0, "above", -0.6), (gap, "below", 0.6))
    walls = [dpd.Wall("z", z, side, velocity=(u, 0, 0), behind="W", density=3.0) for z, side, u in sides]
    x = np.random.default_rng(seed).random((n, 3)) * [edge, edge, gap]
    scene = dpd.Scene({"W": 1.0}, ["W"] * n, x, {("W", "W"): D(A=25, gamma=4.5)}, 1.0, box=[edge, edge, gap + 1], walls=walls)
    built = made_on(scene, available(REFERENCE), dt=0.03, seed=seed)
    simulation = built.simulation()
    simulation.step(1000)
    profile, forces = ProfileReporter(5, built, bins=35), WallReporter(500, built)
    simulation.reporters += [profile, forces]
    simulation.step(15000)
    found, fit = profile.profile, couette_viscosity(profile.profile, forces.shear(), channel=(0, gap), skip=1.5)
    assert abs(fit.rate / 0.2 - 1) < 0.02 + 4 * fit.rate_error / 0.2
    assert abs(fit.viscosity / 0.85 - 1) < 0.04 + 4 * fit.error / 0.85
    layers = [0, 1, 28, 29]
    assert np.all(np.abs(found.kT[layers] / found.kT[8:22].mean() - 1) < 0.01 + 0.02)
    assert np.all(np.abs(found.density[[2, 3, 26, 27]] / found.density[8:22].mean() - 1) < 0.03 + 0.02)
    assert forces.pressure.mean() == pytest.approx(23.64, rel=0.015)


@pytest.mark.slow
@pytest.mark.statistical
@any_seed(1)
def test_viscosity_in_a_shear(seed):
    """... of the standard fluid at a rate of 0.6, a linear profile and the heat of the work, as the host's (test_shear.py)."""
    scene = beads(375, edge=5.0, shear=dpd.LeesEdwards(rate=0.6))
    built = made_on(scene, available(REFERENCE), dt=0.04, seed=seed)
    simulation = built.simulation()
    simulation.step(500)
    stress, profile = StressReporter(2, built), ProfileReporter(5, built, axis="y", component="x", bins=8)
    simulation.reporters += [stress, profile]
    simulation.step(3750)
    viscosity, flow = shear_viscosity(stress), profile.profile
    assert viscosity.viscosity == pytest.approx(0.83, abs=4 * viscosity.error + 0.02 * 0.83) and viscosity.error < 0.035
    assert np.abs(flow.velocity - 0.6 * flow.centres).max() < 5 * flow.error.max() + 0.01
    assert np.mean(flow.kT) == pytest.approx(1.03, abs=0.015)
    assert np.abs(Observer(built).sample(simulation.context).momentum).max() < 1e-6
