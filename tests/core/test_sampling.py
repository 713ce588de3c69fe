"""OpenMM's own sampling with this package's thermostat: umbrellas, metadynamics, tempering, replica exchange, expanded ensembles."""

import functools
import itertools
import math
import random
import re
from pathlib import Path

import foreign_forces
import numpy as np
import openmm
import pytest
from cases import cases, raises
from judged import any_seed, with_seeds
from openmm import app, unit
from scenes import beads, place, state_of, step_all, stepped

import openmm_dpd as dpd
from openmm_dpd.stats import block_average
from openmm_dpd.units import BOLTZMANN

PAGE = Path(__file__).resolve().parents[2] / "docs" / "howto" / "sampling.md"
SCHEMES = ("mvv", "shardlow", "middle", "aboba", "bababo")
RUN = pytest.mark.parametrize("scheme, platform", [(scheme, ("Reference", "CPU")[k % 2]) for k, scheme in enumerate(SCHEMES)])
WAY = pytest.mark.parametrize("way", ["build", "add_thermostat"])
KELVIN = unit.kelvin
UNIT = 1.0 / BOLTZMANN  # kelvin of kT = 1 kJ/mol
FRICTION = {("W", "W"): dpd.DPD(gamma=4.5)}


def fluid(way="build", *, scheme="middle", platform="CPU", kT=1.0, n=81, edge=3.0, seed=4, dt=0.02, table=None) -> app.Simulation:
    """A fluid by either way; friction alone, unless there is a table (for build)."""
    v = np.random.default_rng(2).normal(size=(n, 3))
    v -= v.mean(axis=0)
    properties = {"Threads": "1"} if platform == "CPU" else {}
    x = np.random.default_rng(1).random((n, 3)) * edge
    if way == "build":
        scene = beads(n, edge=edge, positions=x, kT=kT, table=table or FRICTION, velocities=v)
        return dpd.build(scene, dt=dt, scheme=scheme, platform=platform, seed=seed).simulation(properties=properties)
    system, topology = openmm.System(), app.Topology()
    system.setDefaultPeriodicBoxVectors(*(openmm.Vec3(*row) for row in np.eye(3) * edge))
    chain = topology.addChain()
    force = openmm.CustomNonbondedForce("0")  # makes the System periodic
    force.setNonbondedMethod(openmm.CustomNonbondedForce.CutoffPeriodic)
    force.setCutoffDistance(1.0)
    for _ in range(n):
        system.addParticle(1.0)
        force.addParticle([])
        topology.addAtom("AR", app.Element.getBySymbol("Ar"), topology.addResidue("AR", chain))
    system.addForce(force)
    temperature = kT if isinstance(kT, dpd.TemperatureRamp) else kT * UNIT * KELVIN
    friction, choices = dpd.DPD(gamma=4.5, cutoff=1.0), {"scheme": scheme, "platform": platform, "seed": seed}
    integrator = dpd.add_thermostat(system, friction, temperature, dt, **choices).integrator
    simulation = app.Simulation(topology, system, integrator, openmm.Platform.getPlatformByName(platform), properties)
    place(simulation.context, x, v)
    return simulation


# -- who sets the temperature -----------------------------------------------------------------------------------------------------------
SET = {
    "global": lambda context, kT: context.getIntegrator().setGlobalVariableByName("temperature", kT / BOLTZMANN),
    "setTemperature": lambda context, kT: context.getIntegrator().setTemperature(kT / BOLTZMANN * KELVIN),
    "set_temperature": lambda context, kT: dpd.set_kT(context, kT),
    "parameter": lambda context, kT: context.setParameter("dpd_kT", kT),
}


def everyone_says(simulation, kT: float) -> None:
    """All four ways to ask give the same answer."""
    integrator = simulation.integrator
    assert simulation.context.getParameter("dpd_kT") == pytest.approx(kT, rel=1e-12)
    assert integrator.getTemperature().value_in_unit(KELVIN) == pytest.approx(kT / BOLTZMANN, rel=1e-12)
    assert integrator.getGlobalVariableByName("temperature") == pytest.approx(kT / BOLTZMANN, rel=1e-12)


@WAY
@pytest.mark.parametrize("first, second", itertools.product(SET, SET))
def test_what_was_set_last_holds(way, first, second):
    """With steps between, also when a way is given the value that it was given before; and without, as samplers restore and set."""
    simulation = fluid(way, platform="Reference")
    context = simulation.context
    for setter, kT in ((first, 2.0), (second, 1.0), (first, 1.5), (second, 1.0), (first, 1.5), (first, 1.25), (second, 3.0)):
        SET[setter](context, kT)
        simulation.step(1)
        everyone_says(simulation, kT)
        simulation.step(2)
        everyone_says(simulation, kT)
    simulation = fluid(way, platform="Reference")
    for kT, last in ((2.0, 1.0), (1.5, 1.0), (1.0, 2.0)):
        SET[first](simulation.context, kT)
        SET[second](simulation.context, last)
        simulation.step(1)
        everyone_says(simulation, last)


@pytest.mark.parametrize("scheme, platform", [("mvv", "Reference"), ("middle", "CPU"), ("bababo", "CPU"), ("shardlow", "OpenCL")])
def test_beads_among_atoms_take_temperatures_as_well(scheme, platform):
    """With beads beside atoms; everything at 300 K at the start."""
    if foreign_forces.lacking(platform):
        pytest.skip(foreign_forces.lacking(platform))
    cell = foreign_forces.Cell("external", 0, scheme, platform, "auto", "mixed", "after", "own")
    case = foreign_forces.atoms()
    foreign_forces.among_beads(case, cell)
    simulation = stepped(case.simulation(platform, True), 1)
    everyone_says(simulation, 300 * BOLTZMANN)
    for way, kT in itertools.product(SET, (2.0, 3.0)):
        SET[way](simulation.context, kT)
        simulation.step(1)
        everyone_says(simulation, kT)


@RUN
@pytest.mark.parametrize("how", ["global", "setTemperature"])
def test_a_temperature_in_kelvin_is_the_same_run(scheme, platform, how):
    """Set in kelvin or as kT: the same trajectory."""
    table = {("W", "W"): dpd.DPD(A=25, gamma=4.5)}
    first, second = (fluid(scheme=scheme, platform=platform, table=table) for _ in range(2))
    step_all(2, first, second)
    SET[how](first.context, 2.0)
    first.step(1)
    kT = first.context.getParameter("dpd_kT")  # the noise depends on every bit of kT
    assert kT == pytest.approx(2.0, rel=1e-12)
    second.context.setParameter("dpd_kT", kT)
    second.step(1)
    step_all(5, first, second)
    for one, other in zip(state_of(first.context), state_of(second.context), strict=True):
        assert np.abs(one - other).max() < 1e-9


@WAY
@RUN
def test_a_kT_of_one_stays_one_to_the_last_bit(way, scheme, platform):
    """Not 0.9999999999999999 by way of kelvin."""
    kT = {"build": 1.0, "add_thermostat": UNIT * BOLTZMANN}[way]
    simulation = fluid(way, scheme=scheme, platform=platform)
    start = simulation.context.getParameter("dpd_kT")
    assert start == pytest.approx(kT, rel=1e-15) and (way != "build" or start == 1.0)
    simulation.step(3)
    assert simulation.context.getParameter("dpd_kT") == start
    simulation.integrator.setTemperature(simulation.integrator.getTemperature())
    simulation.step(3)
    assert simulation.context.getParameter("dpd_kT") == start
    simulation.integrator.setTemperature(2 * UNIT * KELVIN)
    simulation.step(1)
    dpd.set_kT(simulation.context, 1.0)
    simulation.step(3)
    assert simulation.context.getParameter("dpd_kT") == 1.0


@WAY
def test_setting_is_refused_with_a_ramp(way):
    """The ramp would overwrite it."""
    simulation = fluid(way, kT=dpd.TemperatureRamp(1.0, 2.0, 0, 100), platform="Reference")
    for _ in range(2):
        raises(dpd.ParameterError, "ramp|Ramp", simulation.integrator.setTemperature, 200 * KELVIN)
        simulation.step(1)
    assert simulation.context.getParameter("dpd_kT") == pytest.approx(1.02, abs=0.011)


@pytest.mark.parametrize("value", [-1.0, float("nan"), float("inf"), "warm", 3 * unit.nanometer])
def test_senseless_temperatures_are_refused(value):
    """What was set before holds."""
    simulation = fluid(platform="Reference")
    raises((dpd.DPDError, openmm.OpenMMException, TypeError), ".", simulation.integrator.setTemperature, value)
    simulation.step(1)
    assert simulation.context.getParameter("dpd_kT") == 1.0


# -- noise ---------------------------------------------------------------------------------------------------------------------------
@WAY
def test_the_seed_of_the_integrator_is_that_of_the_noise(way):
    """Whichever seed a state has that is loaded, from the next step on; 0 draws one, as in OpenMM."""

    def after(*seeds):
        simulation = fluid(way, platform="Reference", seed=4)
        state = simulation.context.getState(positions=True, velocities=True, parameters=True, integratorParameters=True)
        for seed in seeds:
            simulation.integrator.setRandomNumberSeed(seed)
        simulation.context.setState(state)
        simulation.step(2)
        return simulation.context.getParameter("dpd_seed"), simulation.context.getState(velocities=True).getVelocities(asNumpy=True)._value

    (own, plain), (one, first), (again, repeated), (other, second) = after(), after(7), after(9, 7), after(8)
    assert (own, one, again, other) == (4, 7, 7, 8)
    assert np.array_equal(first, repeated)
    assert not np.array_equal(first, second) and not np.array_equal(first, plain)
    assert after(0)[0] not in (0, 4) and after(0)[0] != after(0)[0]


def kick(way, scheme, platform, kT, seed=4, counter=0) -> np.ndarray:
    """What one step of friction and noise does to beads at rest."""
    simulation = fluid(way, scheme=scheme, platform=platform, seed=seed)
    simulation.context.setVelocities(np.zeros((81, 3)))
    simulation.context.setParameter("dpd_kT", kT)
    simulation.context.setParameter("dpd_counter", counter)
    simulation.step(1)
    return state_of(simulation.context)[1].ravel()


@WAY
@RUN
def test_noise_is_a_function_of_seed_counter_and_temperature(way, scheme, platform):
    """Alike in all: the same; unlike in one of them: no likeness beyond that of two random vectors."""
    one = kick(way, scheme, platform, 1.0)
    assert np.abs(one).max() > 0.01
    assert np.array_equal(one, kick(way, scheme, platform, 1.0))
    others = {"kT": kick(way, scheme, platform, 2.0), "slightly": kick(way, scheme, platform, 1.0 + 1e-12)}
    others |= {"seed": kick(way, scheme, platform, 1.0, seed=5), "counter": kick(way, scheme, platform, 1.0, counter=7)}
    limit = 4 / math.sqrt(len(one) - 3)  # momentum is zero in each direction
    found = {name: float(np.corrcoef(one, other)[0, 1]) for name, other in others.items()}
    assert all(abs(value) < limit for value in found.values()), found


def replicas(states, simulation, steps, iterations) -> app.ReplicaExchangeSampler:
    random.seed(3)
    sampler = app.ReplicaExchangeSampler(states, simulation, steps)
    sampler.simulate(iterations)
    return sampler


def velocities(sampler) -> list[np.ndarray]:
    return [state.getVelocities(asNumpy=True)._value.ravel() for state in sampler.replicaConformation]


@any_seed(1)
@WAY
def test_equal_replicas_with_seeds_of_their_own_part(way, seed):
    """One start, one temperature, two seeds."""
    one, two = velocities(replicas([{"temperature": UNIT * KELVIN, "dpd_seed": seed + k} for k in (0, 1)], fluid(way), 100, 2))
    assert abs(np.corrcoef(one, two)[0, 1]) < 4 / math.sqrt(len(one) - 3)


@WAY
def test_equal_replicas_without_seeds_of_their_own_do_not_part(way):
    """docs/howto/sampling.md says why states need a seed."""
    one, two = velocities(replicas([{"temperature": UNIT * KELVIN} for _ in range(2)], fluid(way), 50, 2))
    assert np.abs(one - two).max() < 1e-9


@any_seed(4)
@WAY
def test_replicas_at_different_temperatures_part(way, seed):
    """... although they start alike and share seed and counter."""
    states = [{"temperature": factor * UNIT * KELVIN} for factor in (1.0, 1.02)]
    one, two = velocities(replicas(states, fluid(way, seed=seed), 100, 2))
    assert abs(np.corrcoef(one, two)[0, 1]) < 4 / math.sqrt(len(one) - 3)


# -- temperatures of states ------------------------------------------------------------------------------------------------------------
def kinetic(v: np.ndarray) -> float:
    """kT of particles of mass 1 without total momentum."""
    return float(np.sum(v**2) / (3 * (len(v) - 1)))


def holds(samples: list[float], kT: float) -> None:
    """The mean is the temperature asked for, within 1 % and four standard errors; and the errors are small."""
    average = block_average(samples)
    assert average.sem is not None and average.sem < 0.015 * kT
    assert abs(average.mean - kT) < 0.01 * kT + 4 * average.sem, (average, kT)


def watched_replicas(states, simulation, length: int, count: int) -> tuple[list[list[float]], list[list[int]]]:
    """Kinetic temperatures in each state, and the states of the replicas, both after each exchange."""
    found, order = [[] for _ in states], []

    def watch(sampler):
        order.append(list(sampler.replicaStateIndex))
        for replica, state in enumerate(order[-1]):
            found[state].append(kinetic(sampler.replicaConformation[replica].getVelocities(asNumpy=True)._value))

    sampler = app.ReplicaExchangeSampler(states, simulation, length)
    sampler.reporters.append(watch)
    sampler.simulate(count)
    return found, order


@pytest.mark.slow
@any_seed(4)
@cases(
    "method, way, keys",
    ("SimulatedTempering", "build", "temperature"),
    ("SimulatedTempering", "add_thermostat", "temperature"),
    ("ExpandedEnsembleSampler", "build", "with dpd_kT"),
    ("ExpandedEnsembleSampler", "add_thermostat", "temperature"),
    ("ReplicaExchangeSampler", "build", "with dpd_seed"),
    ("ReplicaExchangeSampler", "add_thermostat", "temperature"),
)
def test_states_have_their_temperatures(method, way, keys, seed):
    """Particles with friction alone have no energy to be compared: all changes are accepted, however far apart the temperatures are."""
    factors, length = (1.0, 1.5, 2.0), 40
    states = [{"temperature": factor * UNIT * KELVIN} for factor in factors]
    for k, (state, factor) in enumerate(zip(states, factors, strict=True)):
        state.update({"with dpd_seed": {"dpd_seed": seed + 6 + k}, "with dpd_kT": {"dpd_kT": factor}}.get(keys, {}))
    simulation = fluid(way, n=162, edge=3.8, dt=0.05, seed=seed)
    found: list[list[float]] = [[] for _ in factors]
    random.seed(seed + 1)
    if method == "ReplicaExchangeSampler":
        found, _ = watched_replicas(states, simulation, length, 60)
    else:
        if method == "SimulatedTempering":
            choices = {"weights": [0.0] * 3, "tempChangeInterval": length, "reportFile": None}
            sampler = app.SimulatedTempering(simulation, [s["temperature"] for s in states], **choices)
        else:
            sampler = app.ExpandedEnsembleSampler(states, simulation, length, weights=[0.0] * 3)
        for _ in range(180):
            index = sampler.currentTemperature if method == "SimulatedTempering" else sampler.currentStateIndex
            simulation.step(length - 1)
            found[index].append(kinetic(state_of(simulation.context)[1]))
            simulation.step(1)
    for samples, factor in zip(found, factors, strict=True):
        assert len(samples) > 30
        holds(samples, factor)


@pytest.mark.slow
@any_seed(4)
@pytest.mark.parametrize("scheme", ["middle", "bababo"])
def test_replicas_of_a_dpd_fluid_have_their_temperatures(scheme, seed):
    """With repulsion, and temperatures near enough for exchanges; energies of neighbours differ as their heat capacity says."""
    factors = (1.0, 1.05, 1.1)
    states = [{"temperature": factor * UNIT * KELVIN} for factor in factors]
    simulation = stepped(fluid(scheme=scheme, n=192, edge=4.0, dt=0.04, table={("W", "W"): dpd.DPD(A=25, gamma=4.5)}, seed=seed), 300)
    random.seed(seed + 1)
    found, order = watched_replicas(states, simulation, 25, 200)
    assert sum(one != other for one, other in itertools.pairwise([[0, 1, 2], *order])) > 20
    for samples, factor in zip(found, factors, strict=True):
        holds(samples[10:], factor)


# -- free energies -----------------------------------------------------------------------------------------------------------------------
def ghosts(pairs: int, soft: int, edge: float) -> dpd.Scene:
    """Pairs of beads with friction only, one apart, among soft ones."""
    rng = np.random.default_rng(1)
    first, step = rng.random((pairs, 3)) * edge, rng.normal(size=(pairs, 3))
    second = first + step / np.linalg.norm(step, axis=1)[:, None]
    x = np.concatenate([np.stack([first, second], axis=1).reshape(-1, 3), rng.random((soft, 3)) * edge])
    table = {("W", "W"): dpd.DPD(A=25, gamma=4.5), ("G", "*"): dpd.DPD(gamma=4.5)}
    return dpd.Scene({"W": 1.0, "G": 1.0}, ["G"] * (2 * pairs) + ["W"] * soft, x, table, kT=1.0, box=[edge] * 3)


def umbrella(pairs: int, stiffness: float, centre: float, kind: str) -> openmm.Force:
    """A harmonic bias on the distance of each pair."""
    force = openmm.CustomBondForce(f"0.5*{stiffness}*(r-{centre})^2")
    for k in range(pairs):
        force.addBond(2 * k, 2 * k + 1, [])
    force.setUsesPeriodicBoundaryConditions(True)
    if kind == "bond":
        return force
    whole = openmm.CustomCVForce("u")
    whole.addCollectiveVariable("u", force)
    return whole


@pytest.mark.slow
@any_seed(9)
@pytest.mark.parametrize(
    "way, scheme, kind, group",
    [("build", "middle", "bond", 0), ("build", "aboba", "cv", 30), ("build", "bababo", "bond", 7), ("add_thermostat", "middle", "cv", 31)],
)
def test_umbrellas_give_back_the_free_energy(way, scheme, kind, group, seed):
    """Reweighted distances of free pairs: -2 kT ln r, within 0.1 kT and not worse than four standard errors over the pairs."""
    pairs, stiffness, centre, dt = 100, 10.0, 1.0, 0.03
    force = umbrella(pairs, stiffness, centre, kind)
    force.setForceGroup(group)
    scene = ghosts(pairs, 175, 5.0)
    if way == "build":
        built = dpd.build(scene, dt=dt, scheme=scheme, platform="CPU", seed=seed)
        built.system.addForce(force)
        cpu = openmm.Platform.getPlatformByName("CPU")
        simulation = app.Simulation(built.topology, built.system, built.integrator, cpu, {"Threads": "1"})
    else:
        plain = dpd.build(ghosts(pairs, 175, 5.0), dt=dt, platform="CPU", conservative="openmm", seed=9)
        system = openmm.System()
        system.setDefaultPeriodicBoxVectors(*plain.system.getDefaultPeriodicBoxVectors())
        for _ in range(scene.n_beads):
            system.addParticle(1.0)
        system.addForce(force)
        friction, choices = dpd.DPD(gamma=4.5, cutoff=1.0), {"scheme": scheme, "platform": "CPU", "seed": seed}
        integrator = dpd.add_thermostat(system, friction, UNIT * KELVIN, dt, **choices).integrator
        simulation = app.Simulation(plain.topology, system, integrator, openmm.Platform.getPlatformByName("CPU"), {"Threads": "1"})
    simulation.context.setPositions(scene.positions)
    simulation.context.setVelocitiesToTemperature(UNIT * KELVIN, 3)
    simulation.step(200)
    distances = []
    for _ in range(600):
        simulation.step(10)
        x = state_of(simulation.context)[0]
        distances.append(np.linalg.norm(x[1 : 2 * pairs : 2] - x[0 : 2 * pairs : 2], axis=1))
    r = np.array(distances)
    edges = np.arange(0.6, 1.45, 0.2)
    weight = np.exp(0.5 * stiffness * (r - centre) ** 2)
    mass = np.array([np.where((r > a) & (r < b), weight, 0).mean(axis=0) for a, b in itertools.pairwise(edges)])  # of every bin and pair
    mean, sem = mass.mean(axis=1), mass.std(axis=1, ddof=1) / math.sqrt(pairs)
    free = -np.log(mean) + np.log(np.diff(edges**3))
    error = sem / mean
    off = free[1:] - free[0]
    error = np.hypot(error[1:], error[0])
    assert error.max() < 0.06, "too short"
    assert np.abs(off).max() < 0.1 and np.all(np.abs(off) < 4 * error), (off, error)


# -- the page ----------------------------------------------------------------------------------------------------------------------------
@pytest.fixture(scope="module")
def page(tmp_path_factory):
    """Names that the scripts of docs/howto/sampling.md leave behind, by what is added to their seeds."""
    blocks = re.findall(r"^```python\n(.*?)^```$", PAGE.read_text(encoding="utf-8"), flags=re.MULTILINE | re.DOTALL)

    @functools.cache
    def names_of(more: int) -> dict:
        names: dict = {"__name__": "page"}
        with pytest.MonkeyPatch.context() as patch:
            patch.chdir(tmp_path_factory.mktemp("page"))
            for block in blocks:
                exec(compile(with_seeds(block, more), str(PAGE), "exec"), names)
        return names

    return names_of


#: Standard errors of the numbers of the page, as six runs of each script with other seeds scatter.
UMBRELLA_ERROR, METADYNAMICS_ERROR = 0.02, 0.21


@pytest.mark.slow
@any_seed(0)
def test_what_the_page_says(page, seed):
    """Free energies beside volumes of two shells and -2 kT ln r, temperatures of tempering and exchange; seeds of their own part twins."""
    assert page(seed)["exact"] == pytest.approx(-math.log((1.4**3 - 1.2**3) / (0.8**3 - 0.6**3)))
    assert abs(page(seed)["difference"] - page(seed)["exact"]) < 4 * UMBRELLA_ERROR
    assert page(seed)["exact_rise"] == pytest.approx(-2 * math.log(1.3 / 0.7))
    assert abs(page(seed)["rise"] - page(seed)["exact_rise"]) < 4 * METADYNAMICS_ERROR
    for factor, samples in zip((1.0, 1.05), page(seed)["kinetic"].values(), strict=True):
        holds(samples, factor)
    for factor, samples in zip((1.0, 1.05, 1.1), page(seed)["reached"].values(), strict=True):
        holds(samples, factor)
    assert abs(page(seed)["likeness"]) < 4 / math.sqrt(3 * 192 - 3)
