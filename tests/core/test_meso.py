"""eDPD, tDPD and mDPD in a running Context: steps on every platform against the oracle's integrators, sources, restart, files, energy."""

import io
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace

import numpy as np
import openmm
import oracle
import oracle_meso
import pytest
from cases import cases, every_pair, raises
from devices import DEVICES
from judged import any_seed
from kinds import HEAT, SPECIES
from scenes import BOXES, MASSES, fluid, place, state_of, step_all, stepped

import openmm_dpd as dpd
from openmm_dpd.base.errors import ParameterError, PlanError
from openmm_dpd.kernels.engine import PairEngine
from openmm_dpd.kernels.fields import FieldSpec, Sources
from openmm_dpd.simulation.fields import field_variables, raw_fields, read_fields, write_fields

DT, SEED, N = 0.01, 11, 90
CORNER = (-1.5, -2.0, -2.5)  # The lower corner of the box is not 0: places are meant in these coordinates.


def heat_scene(lammps=False, frozen=True, **options) -> dpd.Scene:
    rng = np.random.default_rng(4)
    sources = [
        dpd.Source(dpd.Block.centred((0.0, 0.0, -1.0), (2.0, 3.0, 2.0)), 0.7, corner=CORNER),
        dpd.Source(dpd.Sphere((1.0, 1.0, 0.0), 0.9), -0.4, beads=np.arange(N) % 2 == 0, corner=CORNER),
        dpd.Buoyancy((0.5, 0.0, -6.0), 0.9),
    ]
    internal = dpd.BeadTemperatures(rng.uniform(0.8, 1.2, N), rng.uniform(20, 60, N))
    mobile = np.arange(N) % 6 > 0 if frozen else None
    choices = {"sources": sources, "mobile": mobile, "compat": "lammps" if lammps else "consistent"}
    return fluid(HEAT, BOXES["ortho"], n=N, spread=0, internal=internal, **choices, **options)


def species_scene() -> dpd.Scene:
    rng = np.random.default_rng(4)
    sources = [
        dpd.Source(dpd.Block.centred((0.0, 0.0, -1.0), (2.0, 3.0, 2.0)), 0.7, species=3, corner=CORNER),
        dpd.Source(dpd.Sphere((1.0, 1.0, 0.0), 0.9), -0.4, corner=CORNER),
        dpd.Buoyancy((0.0, 2.0, -3.0), 0.7, species=2, beads=np.arange(N) % 3 > 0),
    ]
    internal = dpd.Concentrations(rng.uniform(0.0, 2.0, (N, 4)))
    return fluid(SPECIES, BOXES["ortho"], n=N, spread=0, internal=internal, sources=sources, mobile=np.arange(N) % 6 > 0, kT=1.3)


def density_scene(kernel="quadratic") -> dpd.Scene:
    table = {("*", "*"): dpd.MDPD(A=-40, B=25, gamma=4.5, cutoff=1.0, cutoff_B=0.75, kernel=kernel)}
    return fluid(table, BOXES["ortho"], n=200, spread=0)


def running(scene, device, **choices):
    built = dpd.build(scene, platform=device.platform, **{"seed": SEED, "dt": DT, "scheme": "mvv", **choices})
    simulation = built.simulation(properties=device.properties)
    simulation.built = built
    return simulation


class Rates:
    """Forces and rates at given positions, velocities and fields, from the kernel (which has tests of its own) and from sources done here."""

    def __init__(self, scene, built):
        spec = built.plan.spec  # the engine's own sources are replaced by an independent sum
        self.spec = replace(spec, fields=replace(spec.fields, sources=()))
        self.scene, self.engine, self.counter = scene, PairEngine(self.spec), -1
        self.mobile = self.spec.inv_mass > 0

    def __call__(self, x, v, values):
        self.counter += 1
        values = values.reshape(len(x), -1)
        self.engine.prepare(x, self.scene.box)
        force = self.engine.forces(7, v, self.scene.initial_kT, DT, SEED, self.counter, values)[1]
        rates = self.engine.rates.copy()
        folded = (x - CORNER) % np.diag(self.scene.box) + CORNER
        for source in self.scene.sources:
            if isinstance(source, dpd.Buoyancy):
                for i in range(len(x)):
                    if source.beads is None or source.beads[i]:
                        force[i] += (values[i, source.species] - source.reference) * source.force
                continue
            if isinstance(source.region, dpd.Block):
                inside = oracle_meso.in_cuboid(folded, (source.region.low + source.region.high) / 2, source.region.high - source.region.low)
            else:
                inside = oracle_meso.in_sphere(folded, source.region.centre, source.region.radius)
            inside = inside & (source.beads if source.beads is not None else True)
            rates[inside, source.species] += source.rate
        still = ~self.mobile
        force[still], rates[still] = 0.0, 0.0
        return force, rates


@every_pair("device, make, lam", DEVICES, (heat_scene, species_scene), (0.5, 0.65), indirect=["device"])
def test_steps_on_every_device(device, make, lam):
    """Temperatures are predicted with lambda, concentrations take half steps; walls keep theirs; sources act where beads are."""
    scene = make()
    simulation = running(scene, device, lam=lam)
    rates = Rates(scene, simulation.built)
    mobile = rates.mobile
    x, v = scene.positions.copy(), np.where(mobile[:, None], scene.velocities, 0.0)
    values = rates.spec.fields.initial.copy()
    f, q = rates(x, v, values)
    steps = 6
    simulation.step(steps)
    for _ in range(steps):
        if make is heat_scene:
            x, v, values, f, q = oracle_meso.mvv_edpd_step(x, v, values, f, q, scene.bead_masses, np.ones((N, 1)), DT, lam, rates)
        else:
            x, v, values, f, q = oracle_meso.mvv_tdpd_step(x, v, values, f, q, scene.bead_masses, DT, lam, rates)
    got_x, got_v = state_of(simulation.context)
    limit = device.choose(1e-11, 2e-5, 3e-3)
    assert np.abs(oracle.minimum_image(got_x - x, scene.box)).max() < limit
    assert np.abs(got_v - v)[mobile].max() < limit
    got = raw_fields(simulation.context, rates.spec.fields)
    assert np.abs(got - values)[mobile].max() < limit
    np.testing.assert_allclose(got[~mobile], rates.spec.fields.initial[~mobile], rtol=1e-6)
    assert np.abs(values - rates.spec.fields.initial)[mobile].max() > 0.02


def test_sources_act_on_beads_that_crossed_the_box():
    """Beads flying through the box many times are heated where they are, counted from the box's own corner."""
    corner, edge, speed = np.array([-2.0, 1.0, 5.0]), 4.0, 10.0
    y = np.linspace(0, edge, 40, endpoint=False) + corner[1]
    x = np.column_stack([np.full(40, corner[0] + 1), y + 40 * edge, np.full(40, corner[2] + 1)])
    upper = dpd.Source(dpd.Block((-9, corner[1] + edge / 2, -9), (9, corner[1] + edge, 9)), 1.0, corner=corner)
    table = {("W", "W"): dpd.EDPD(A=0, gamma=0, kappa=0, cutoff=1.0)}
    scene = dpd.Scene(
        {"W": 1}, ["W"] * 40, x, table, 1.0, box=[edge] * 3, velocities=np.tile([0.0, speed, 0.0], (40, 1)),
        internal=dpd.BeadTemperatures(1.0, 1.0), sources=[upper],
    )  # fmt: skip
    simulation = running(scene, DEVICES[1], dt=0.001)
    simulation.step(4000)  # ten times through the box
    temperature = read_fields(simulation.context, simulation.built.plan)["theta"]
    np.testing.assert_allclose(temperature, 1.0 + 4.0 / 2, atol=0.02)  # half of the time in the source, to a step or two at its faces


def test_sources_in_a_tilted_box_act_within_its_faces():
    """As in LAMMPS, for beads in any image."""
    rng, box, corner = np.random.default_rng(2), BOXES["tilted"], np.array([-1.0, 0.5, 2.0])
    source, rates = dpd.Source(dpd.Block((1.0, -9, -9), (4.0, 9, 3.5)), 1.0, corner=corner), np.zeros((300, 1))
    inside = rng.random((300, 3)) @ box + corner
    source.add_to(rates, inside + rng.integers(-3, 4, (300, 3)) @ box, box)
    assert np.array_equal(rates[:, 0], source.region.contains(inside)) and 50 < rates.sum() < 250


@pytest.mark.parametrize("box", [None, "ortho", "tilted"])
def test_sources_in_one_pass_are_those_one_by_one(box):
    """To the last bit, with faces exactly at beads; beads that do not move get nothing in a sweep, and seats change nothing."""
    rng, box = np.random.default_rng(5), None if box is None else BOXES[box]
    x, immobile, some = rng.integers(-20, 20, (400, 3)) / 2.0, rng.random(400) < 0.2, rng.random(400) < 0.6
    sources = (
        dpd.Source(dpd.Block((1.0, -9, 0.5), (4.0, 9, 3.5)), 0.7, species=1, beads=some, corner=CORNER),
        dpd.Source(dpd.Block((-np.inf, 0, 0), (np.inf, 2, 9)), -0.3),
        dpd.Source(dpd.Sphere((1.0, 1.5, 0.5), 2.5), 1.1, species=1, corner=(0.5, 0, 0)),
    )
    found, expected, seats = (np.zeros((2, 400, 2)), np.zeros((2, 400, 2)), rng.permutation(400))
    its = Sources(FieldSpec("species", np.zeros((400, 2)), immobile, sources=sources))
    for source in sources:
        source.add_to(expected[0], x, box)
    expected[1] = np.where(immobile[:, None], 0.0, expected[0])
    its.seat(seats)
    for moving in (False, True):
        its.add_to(found[int(moving)], x[seats], box, moving)
    assert its.steady and np.array_equal(found, expected[:, seats]) and 20 < np.count_nonzero(expected[0]) < 700
    own = type("Own", (dpd.Source,), {})(sources[0].region, 1.0)  # which may have its own way to add
    for other in (dpd.Buoyancy((0, 0, 1), 1.0), own):
        assert not Sources(FieldSpec("species", np.zeros((400, 2)), immobile, sources=(*sources, other))).steady


@pytest.mark.parametrize("how", ["State", "Checkpoint"])
def test_states_of_beads_that_carry_something_else_are_refused(how):
    """Variables of heat and of species have the same names."""
    table = {("*", "*"): dpd.TDPD(A=1.0, gamma=4.5, kappa=(1.0,))}
    one = replace(species_scene(), internal=dpd.Concentrations(np.ones((N, 1))), sources=(), pairs=table)
    for scenes in ((heat_scene(), one), (one, heat_scene())):
        writer, reader = (running(scene, DEVICES[0]) for scene in scenes)
        file = io.StringIO() if how == "State" else io.BytesIO()
        getattr(writer, f"save{how}")(file)
        file.seek(0)
        raises(PlanError, "carry something else than those of this scene", getattr(reader, f"load{how}"), file)


def test_setting_values_acts_at_once():
    simulation = stepped(running(heat_scene(frozen=False), DEVICES[1]), 3)
    write_fields(simulation.context, simulation.built.plan, theta=1.0)
    assert np.all(read_fields(simulation.context, simulation.built.plan)["theta"] == 1.0)
    raises(ParameterError, "it must be > 0", lambda: write_fields(simulation.context, simulation.built.plan, theta=np.zeros(N)))
    species = running(species_scene(), DEVICES[1])
    raises(ParameterError, r"shape \(90, 4\)", lambda: write_fields(species.context, species.built.plan, concentrations=np.zeros(N)))
    write_fields(species.context, species.built.plan, concentrations=np.full((N, 4), 2.0))
    assert np.all(read_fields(species.context, species.built.plan)["concentrations"] == 2.0)


@pytest.mark.parametrize(("make", "name"), [(heat_scene, "theta"), (species_scene, "concentrations")])
@pytest.mark.parametrize("scheme", ["mvv", "middle"])
def test_fields_set_in_either_way(make, name, scheme):
    """By a per-DOF variable as by ``write_fields``: accelerations and rates of the old values are forgotten."""
    found = []
    for way in ("write_fields", "variables"):
        simulation = stepped(running(replace(make(), mobile=None), DEVICES[1], scheme=scheme), 3)
        values = 1.5 * read_fields(simulation.context, simulation.built.plan)[name]
        if way == "write_fields":
            write_fields(simulation.context, simulation.built.plan, **{name: values})
        else:
            for variable, block in field_variables(values.reshape(N, -1)).items():
                simulation.integrator.setPerDofVariableByName(variable, block)
        simulation.step(1)
        found.append((*state_of(simulation.context), read_fields(simulation.context, simulation.built.plan)[name]))
    assert all(np.array_equal(one, other) for one, other in zip(*found, strict=True))


@pytest.mark.parametrize("loop", [True, False])
def test_the_energy_of_a_state_is_that_of_its_temperatures(loop, tmp_path):
    """The repulsion of eDPD depends on them: after they are set, in a new Context that a state is loaded into, in another thread."""
    simulation = stepped(running(heat_scene(frozen=False), DEVICES[1], loop=loop), 3)

    def off(one) -> float:
        state = one.context.getState(energy=True, positions=True)
        engine = PairEngine(one.built.plan.spec)
        engine.prepare(state.getPositions(asNumpy=True)._value, BOXES["ortho"])
        expected = engine.forces(1, None, 0.0, 1.0, 0, 0, raw_fields(one.context, one.built.plan.spec.fields))[0]
        return abs(state.getPotentialEnergy()._value - expected)

    assert off(simulation) < 1e-9
    write_fields(simulation.context, simulation.built.plan, theta=2.0)
    assert off(simulation) < 1e-9
    simulation.saveState(str(tmp_path / "hot.xml"))
    other = running(heat_scene(frozen=False), DEVICES[1], loop=loop)
    other.loadState(str(tmp_path / "hot.xml"))
    with ThreadPoolExecutor(1) as threads:
        assert threads.submit(off, other).result() < 1e-9
    assert off(other) < 1e-9 and stepped(other, 1) and off(simulation) < 1e-9


@pytest.mark.parametrize(("make", "name"), [(heat_scene, "theta"), (species_scene, "concentrations")])
def test_walls_take_other_values_in_a_run(make, name):
    """... as if they had begun with them, also after a checkpoint, and not in another Context of the same System."""
    start, scene = make(), make()
    other = getattr(start.internal, "thetas" if name == "theta" else "values").copy()
    other[start.immobile] *= 3.0
    begun = running(replace(start, internal=replace(start.internal, **{"thetas" if name == "theta" else "values": other})), DEVICES[1])
    written = running(scene, DEVICES[1])
    program = openmm.Context(written.system, openmm.XmlSerializer.clone(written.integrator), openmm.Platform.getPlatformByName("CPU"))
    write_fields(written.context, written.built.plan, **{name: other})
    step_all(5, begun, written)
    state = written.context.createCheckpoint()
    written.step(3)
    written.context.loadCheckpoint(state)
    for simulation in (begun, written):
        simulation.step(6)
        assert np.array_equal(read_fields(simulation.context, simulation.built.plan)[name][start.immobile], other[start.immobile])
    ends = [(*state_of(s.context), raw_fields(s.context, s.built.plan.spec.fields)) for s in (begun, written)]
    for one, two in zip(*ends, strict=True):
        np.testing.assert_allclose(one, two, rtol=1e-10, atol=1e-10)  # values are shown by a scale that depends on those of the start
    untouched = stepped(running(make(), DEVICES[1]), 11)
    assert np.abs(raw_fields(untouched.context, scene_fields(untouched)) - ends[1][2])[~start.immobile].max() > 1e-3
    place(program, untouched.built.positions, untouched.built.velocities)
    program.getIntegrator().step(11)
    ends = [raw_fields(context, scene_fields(untouched)) for context in (program, untouched.context)]
    np.testing.assert_allclose(*ends, rtol=1e-12)  # a program and a loop agree to rounding


@pytest.mark.parametrize("way", ["XML", "CompoundIntegrator", "written back"])
def test_walls_with_other_values_refuse_programs_which_skip_them(way):
    """A program of OpenMM's knows the values of the start alone: it steps where these have been written back, and nowhere else."""
    written = running(heat_scene(), DEVICES[1])
    start = read_fields(written.context, written.built.plan)["theta"]
    write_fields(written.context, written.built.plan, theta=np.where(heat_scene().immobile, 3.0, start))
    if way == "written back":
        write_fields(written.context, written.built.plan, theta=start)
    state = written.context.getState(positions=True, velocities=True, parameters=True)
    integrator = openmm.XmlSerializer.clone(written.integrator)
    if way == "CompoundIntegrator":
        compound = openmm.CompoundIntegrator()
        compound.addIntegrator(integrator)
        integrator = compound
    context = openmm.Context(written.system, integrator, openmm.Platform.getPlatformByName("CPU"))
    context.setState(state)
    if way == "written back":
        integrator.step(1)
    else:
        with pytest.raises(openmm.OpenMMException, match="write_fields"):
            integrator.step(1)


def scene_fields(simulation):
    return simulation.built.plan.spec.fields


def test_walls_that_cannot_take_other_values_say_so():
    simulation = running(heat_scene(), DEVICES[1], loop=False)
    theta = read_fields(simulation.context, simulation.built.plan)["theta"]
    write_fields(simulation.context, simulation.built.plan, theta=theta)
    write_fields(simulation.context, simulation.built.plan, theta=1.5)
    assert np.array_equal(read_fields(simulation.context, simulation.built.plan)["theta"] == 1.5, np.arange(N) % 6 > 0)
    message = "bead 0 is immobile and keeps its value, since a program"
    raises(ParameterError, message, write_fields, simulation.context, simulation.built.plan, theta=theta + 1.0)


def heat_error(compat: str, dt: float, seed: int) -> float:
    """Change of K + sum C T over a time of 2, by friction, noise and conduction alone (A = 0)."""
    rng = np.random.default_rng(4)
    table = {("*", "*"): dpd.EDPD(A=0.0, gamma=4.5, kappa=1e-3, cutoff=1.0)}
    internal = dpd.BeadTemperatures(1.5, rng.uniform(20, 60, 200))
    simulation = running(fluid(table, BOXES["ortho"], n=200, internal=internal, compat=compat), DEVICES[1], dt=dt, seed=seed)
    observer = dpd.Observer(simulation.built)
    start = observer.sample(simulation.context).total
    simulation.step(round(2 / dt))
    end = observer.sample(simulation.context)
    assert end.kT > 1.05  # 200 beads of kT = 1 have warmed up
    return end.total - start


@any_seed(1)
def test_consistent_heat_conserves_energy_and_lammps_heat_does_not(seed):
    """K rises by 150, from the beads (six runs: but for 25(3) and 4(2) at the two steps), or in LAMMPS's form from nowhere."""
    coarse, fine = (np.mean([heat_error("consistent", dt, seed + k) for k in range(6)]) for dt in (0.008, 0.001))
    assert abs(fine) < 12 and fine < 0.6 * coarse
    assert heat_error("lammps", 0.001, seed) > 50


@pytest.mark.parametrize("make", [heat_scene, species_scene, density_scene])
def test_files_beside_the_trajectory(make, tmp_path):
    simulation = running(make(), DEVICES[1])
    simulation.reporters.append(dpd.FieldReporter(tmp_path / "fields.npz", 2, simulation.built))
    simulation.step(6)
    fields = dpd.load_fields(tmp_path / "fields.npz")
    np.testing.assert_array_equal(fields["step"], [2, 4, 6])
    np.testing.assert_allclose(fields["time"], [0.02, 0.04, 0.06])
    now = read_fields(simulation.context, simulation.built.plan)
    for name, values in now.items():
        np.testing.assert_array_equal(fields[name][-1], values)
    assert len(now) == 1


def test_local_density_is_a_measured_quantity(device):
    simulation = stepped(running(density_scene(), device, scheme="middle"), 3)
    density = read_fields(simulation.context, simulation.built.plan)["density"]
    x, _ = state_of(simulation.context)
    r = np.linalg.norm(oracle.minimum_image(x[:, None] - x[None], BOXES["ortho"]), axis=2) + 9 * np.eye(len(x))
    expected = np.sum(np.where(r < 0.75, 15 / (2 * np.pi * 0.75**3) * (1 - r / 0.75) ** 2, 0), axis=1)
    np.testing.assert_allclose(density, expected, rtol=1e-10)


@every_pair("device, kernel, scheme", DEVICES, ("quadratic", "lucy"), ("mvv", "shardlow", "middle", "aboba", "bababo"), indirect=["device"])
def test_many_body_scenes_on_every_device(device, kernel, scheme):
    """One step of every scheme on every platform, against Reference."""
    results = [state_of(stepped(running(density_scene(kernel), where, scheme=scheme), 3).context) for where in (DEVICES[0], device)]
    limit = device.choose(1e-4, 1e-4, 3e-3)  # the CPU platform's own forces are single precision
    assert np.abs(oracle.minimum_image(results[0][0] - results[1][0], BOXES["ortho"])).max() < limit
    assert np.abs(results[0][1] - results[1][1]).max() < 10 * limit


# -- errors --------------------------------------------------------------------------------------------------------------------------------
def test_schemes_and_places_that_do_not_fit():
    with pytest.raises(PlanError, match="compat='lammps' has no pair updates: .* only scheme='mvv' runs it, not 'middle'"):
        dpd.build(heat_scene(lammps=True), dt=DT, scheme="middle", platform="CPU")
    for make, why in ((heat_scene, "depends on the temperatures"), (species_scene, "it knows isothermal DPD only, not TDPD")):
        raises(PlanError, why, lambda make=make: dpd.build(replace(make(), sources=()), dt=DT, scheme="native", platform="CPU"))
    raises(PlanError, "depends on the temperatures", dpd.build, heat_scene(), dt=DT, scheme="mvv", conservative="openmm", platform="CPU")
    raises(PlanError, "derives from no potential", lambda: dpd.build(density_scene("lucy"), dt=DT, conservative="openmm", platform="CPU"))
    raises(PlanError, "it knows isothermal DPD only, not MDPD", lambda: dpd.build(density_scene(), dt=DT, scheme="native", platform="CPU"))


@cases(
    "change, message",
    ({"internal": dpd.BeadTemperatures(0.0, 1.0)}, "temperature of bead 0 is 0; it must be > 0"),
    ({"internal": dpd.BeadTemperatures(1.0, -1.0)}, "heat capacity of bead 0 is -1; it must be > 0"),
    ({"internal": dpd.Concentrations(np.ones(N))}, "need internal=BeadTemperatures"),
    ({"sources": [dpd.Source(dpd.Sphere((50, 0, 0), 1.0), 1.0)]}, "lies outside the box"),
    ({"sources": [dpd.Source(dpd.Sphere((1, 0, 0), 1.0), 1.0, species=1)]}, "names species 1, but there are 1"),
    ({"sources": [dpd.Buoyancy((0, 0, 1), 1.0, species=1)]}, "a buoyancy names species 1, but there are 1"),
    ({"sources": [dpd.Buoyancy((0, 0, 1), 1.0, beads=np.ones(3))]}, "one entry per bead, 90"),
    ({"sources": ["up"]}, "Source and Buoyancy, not 'up'"),
    ({"compat": "LAMMPS"}, "compat must be"),
)
def test_bad_input(change, message):
    good = {"internal": dpd.BeadTemperatures(1.0, 1.0)}
    raises(ParameterError, message, lambda: fluid(HEAT, BOXES["ortho"], n=N, **{**good, **change}))


def test_buoyancy_is_momentum_and_runs_the_same_however_it_is_run(tmp_path):
    """Momentum changes by dt times the sum of the forces; OpenMM's own steps and a restart from XML do the same; LAMMPS has none."""
    for number in ((0, -6.0), 0.9), (-6.0, 0.9), (None, 0.9), ((np.nan, 0, 1), 0.9), ((0, 0, 1), np.inf):
        raises(ParameterError, "of a buoyancy", dpd.Buoyancy, *number)
    lift = dpd.Buoyancy((0.0, 1.5, -3.0), 0.7, species=2)
    still = replace(species_scene(), sources=[lift], mobile=None)
    one, device = running(still, DEVICES[1], scheme="bababo"), DEVICES[1]
    assert still.kept_momenta == 1
    expected = (still.velocities * still.bead_masses[:, None]).sum(axis=0)
    for _ in range(5):
        c = read_fields(one.context, one.built.plan)["concentrations"]
        expected = expected + 0.5 * DT * np.sum(c[:, 2] - 0.7) * lift.force
        one.step(1)
        expected = expected + 0.5 * DT * np.sum(read_fields(one.context, one.built.plan)["concentrations"][:, 2] - 0.7) * lift.force
    x, v = state_of(one.context)
    np.testing.assert_allclose((v * still.bead_masses[:, None]).sum(axis=0), expected, atol=1e-9)
    for choices in ({"loop": False}, {"scheme": "bababo"}):
        other = running(still, device, **{"scheme": "bababo", **choices})
        other.step(3)
        other.saveState(str(tmp_path / "state.xml"))
        again = running(still, device, **{"scheme": "bababo", **choices})
        again.loadState(str(tmp_path / "state.xml"))
        again.step(2)
        np.testing.assert_allclose(state_of(again.context)[1], v, atol=1e-9)
        again.step(1)
        openmm.LocalEnergyMinimizer.minimize(again.context, 1.0, 2)  # asks for forces without a look before
    from openmm_dpd.lammps import export_lammps

    raises(ParameterError, "a buoyancy follows", export_lammps, still, tmp_path, "deck", dt=DT)


def test_species_must_match():
    two, four = dpd.Concentrations(np.ones((N, 2))), dpd.Concentrations(np.ones((N, 4)))
    message = r"\('A', 'A'\): coefficients of 4 species, but the beads have 2"
    raises(ParameterError, message, fluid, SPECIES, BOXES["ortho"], n=N, internal=two)
    raises(ParameterError, "cannot be combined", fluid, [SPECIES, HEAT], BOXES["ortho"], n=N, internal=four, masses=MASSES)
