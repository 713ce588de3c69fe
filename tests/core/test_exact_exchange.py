"""Words with eDPD and tDPD: every platform, sources, walls, what is kept, and transport against analytic solutions at long steps."""

import sys
from dataclasses import replace
from itertools import permutations
from pathlib import Path

import numpy as np
import oracle
import pytest
from cases import every_pair, raises
from devices import CPU, DEVICES, REFERENCE
from judged import any_seed
from scenes import BOXES, fluid, state_of, step_all, stepped
from scipy.linalg import expm
from test_meso import CORNER, N, heat_scene, running, species_scene

import openmm_dpd as dpd
from openmm_dpd.kernels.engine import PairEngine
from openmm_dpd.simulation.fields import raw_fields, read_fields, write_fields

sys.path.append(str(Path(__file__).parents[2] / "docs" / "measure"))

import heat_steps

WORD = "B/2 A/2 O A/2 B/2"


def ends(simulation):
    return *state_of(simulation.context), raw_fields(simulation.context, simulation.built.plan.spec.fields)


@every_pair("device, make, scheme", DEVICES, (heat_scene, species_scene), ("middle", "bababo", "shardlow"), indirect=["device"])
def test_words_on_every_device(device, make, scheme):
    """Sources and beads that do not move included, against the Reference platform."""
    scene = make()
    x, v, values = ends(stepped(running(scene, REFERENCE, scheme=scheme), 6))
    got_x, got_v, got = ends(stepped(running(scene, device, scheme=scheme), 6))
    limit = device.choose(1e-11, 2e-5, 3e-3)
    mobile = ~scene.immobile
    assert np.abs(oracle.minimum_image(got_x - x, scene.box)).max() < limit
    assert np.abs(got_v - v)[mobile].max() < limit
    assert np.abs(got - values).max() < limit
    assert np.abs(values - read_start(make()))[mobile].max() > 0.02


def read_start(scene):
    return scene.internal.values(N) if isinstance(scene.internal, dpd.BeadTemperatures) else scene.internal.values


@pytest.mark.parametrize("loop", [True, False])
@pytest.mark.parametrize("scheme", ["middle", "O/4 B/2 A B/2 3O/4"])
def test_sources_give_what_they_should(scheme, loop):
    """Where all is heated, rate times time, to rounding, for parts of sweeps as well; beads that do not move keep their value."""
    everywhere = dpd.Source(dpd.Block((-50,) * 3, (50,) * 3), 0.7, corner=CORNER)
    scene = replace(heat_scene(), sources=[everywhere], internal=dpd.BeadTemperatures(1.0, 1e6))
    table = {("*", "*"): dpd.EDPD(A=25, gamma=0, kappa=0)}
    simulation = stepped(running(replace(scene, pairs=table), CPU, scheme=scheme, loop=loop), 9)
    temperature = read_fields(simulation.context, simulation.built.plan)["theta"]
    np.testing.assert_allclose(temperature[~scene.immobile], 1 + 0.7 * 9 * 0.01, rtol=1e-14)
    assert np.all(temperature[scene.immobile] == 1.0)


def test_a_sink_that_takes_what_is_not_there_stops_the_run():
    sink = dpd.Source(dpd.Block((-50,) * 3, (50,) * 3), -40.0, corner=CORNER)
    simulation = running(replace(heat_scene(frozen=False), sources=[sink]), CPU, scheme="middle")
    message = r"step \d: the temperature of bead \d+ is -\S+; it must be > 0 .*or a source take what is not there"
    raises(Exception, message, simulation.step, 10)


@pytest.mark.parametrize("scheme", ["middle", WORD])
def test_temperatures_that_are_set_push_at_once(scheme):
    """Also where the last kick of a step and the first of the next are at the same positions."""
    written = stepped(running(heat_scene(frozen=False), CPU, scheme=scheme), 3)
    x, v = state_of(written.context)
    write_fields(written.context, written.built.plan, theta=3.0)
    hot = dpd.BeadTemperatures(3.0, heat_scene().internal.capacities)
    begun = running(replace(heat_scene(frozen=False), positions=x, velocities=v, internal=hot), CPU, scheme=scheme)
    begun.context.setParameter("dpd_counter", 3.0)
    step_all(2, written, begun)
    for one, two in zip(ends(written), ends(begun), strict=True):
        np.testing.assert_allclose(one, two, rtol=1e-12, atol=1e-12)


@pytest.mark.parametrize("dt", [0.04, 0.4])
def test_each_step_keeps_energy_and_species(dt):
    """To 1e-12 of the whole, without a repulsion that depends on temperatures; no temperature or concentration becomes negative."""
    n, rng = 200, np.random.default_rng(4)
    table = {("*", "*"): dpd.EDPD(A=0.0, gamma=4.5, kappa=0.2, cutoff=1.0)}
    internal = dpd.BeadTemperatures(rng.uniform(0.2, 3.0, n), rng.uniform(2, 6, n))
    heated = running(fluid(table, BOXES["ortho"], n=n, internal=internal), CPU, scheme="middle", dt=dt)
    observer, totals = dpd.Observer(heated.built), []
    table = {("*", "*"): dpd.TDPD(A=0.0, gamma=4.5, kappa=3.0, epsilon=1.0)}
    c = np.where(np.arange(n) % 3 == 0, 1.0, 0.0)
    species = running(fluid(table, BOXES["ortho"], n=n, internal=dpd.Concentrations(c)), CPU, scheme="middle", dt=dt)
    for _ in range(10):
        totals.append(observer.sample(heated.context).total)
        found = read_fields(species.context, species.built.plan)["concentrations"]
        assert read_fields(heated.context, heated.built.plan)["theta"].min() > 0 <= found.min()
        assert abs(found.sum() - c.sum()) < 1e-12 * c.sum()
        heated.step(1)
        species.step(1)
    assert np.ptp(totals) < 1e-12 * totals[0] and observer.sample(heated.context).kT > 1.2
    assert 0.01 < found.std() < 0.9 * c.std()


@pytest.mark.parametrize("what", ["species", "heat", "energies"])
def test_fast_exchange_goes_as_far_as_it_should(what):
    """Where no bead moves, a sweep with kappa dt of 1 to 5 and a bead's sum of it up to 9 takes as much of a sine away as all exchange at once,
    the exponential of the matrix of rates: on average to 0.3 %, at 5 to 1.2 %, and of these few beads to 1, 5 and 2 % (the worst of eight
    such scenes: 0.4, 4.0 and 0.9 %).  What pairs alone would exchange one after another is up to a half less."""
    capacity = 1e12  # no noise
    for kind, rate, off in ((heat_steps.STANDARD, 1.0, 0.01), (heat_steps.STANDARD, 5.0, 0.05), (heat_steps.WIDE, 1.5, 0.02)):
        scene, dt = heat_steps.fluid(what, kind, 1e3 * rate, 3, capacity), 1e-3  # so short that it does not matter how fast beads are
        built = dpd.build(scene, dt=0.01, scheme="middle", platform="Reference", seed=3)
        simulation = built.simulation()
        simulation.step(40)
        x = simulation.context.getState(positions=True).getPositions(asNumpy=True)._value
        d = x[:, None] - x[None]
        r = np.linalg.norm(d - scene.box.diagonal() * np.round(d / scene.box.diagonal()), axis=2)
        rates = rate * np.maximum(1.0 - r / kind[2], 0.0) ** 2
        np.fill_diagonal(rates, 0.0)
        wave = np.sin(2 * np.pi * x[:, 0] / scene.box[0, 0])
        right = wave @ (wave - expm(rates - np.diag(rates.sum(axis=1))) @ wave)
        engine, small = PairEngine(built.plan.spec), 0.05
        engine.prepare(x, scene.box)
        values = {"species": 1.0 + small * wave, "heat": 1.0 + small * wave, "energies": capacity * (1.0 + small * wave)}[what]
        raw = np.column_stack([np.zeros(len(x)), values]) if what == "energies" else values[:, None]
        engine.sweep(np.zeros_like(x), 1.0, dt, 1, 1, raw)
        flows = engine.increments[:, 0] / (capacity if what == "energies" else 1.0)
        lost = -wave @ flows / small
        assert lost == pytest.approx(right, rel=off), (kind, rate)


@pytest.mark.parametrize(("kappa", "scheme", "fast"), [(1.0, "middle", False), (100.0, "middle", True), (100.0, "mvv", False)])
def test_others_count_where_exchange_is_fast(kappa, scheme, fast):
    """Slow: three beads end as pair updates alone, one after the other in some order, leave them."""
    x, c, dt = np.array([[0.5, 0.5, 0.5], [1.0, 0.5, 0.5], [0.8, 0.9, 0.5]]), np.array([1.0, 2.0, 4.0]), 0.2
    table = {("W", "W"): dpd.TDPD(A=0.0, gamma=0.0, kappa=(kappa,))}
    scene = dpd.Scene({"W": 1.0}, ["W"] * 3, x, table, kT=1.0, box=[4.0] * 3, internal=dpd.Concentrations(c[:, None]))
    engine = PairEngine(dpd.build(scene, dt=dt, scheme=scheme, platform="Reference", seed=1).plan.spec)
    assert engine.layers[0].pairs.spread == fast
    if scheme == "mvv":
        return
    engine.prepare(x, scene.box)
    engine.sweep(np.zeros_like(x), 1.0, dt, 1, 1, c[:, None])
    ends = []
    for order in permutations(((0, 1), (0, 2), (1, 2))):
        now = c.copy()
        for i, j in order:
            flow = 0.5 * (now[j] - now[i]) * -np.expm1(-2 * kappa * (1.0 - np.linalg.norm(x[i] - x[j])) ** 2 * dt)
            now += np.where(np.arange(3) == i, flow, 0.0) - np.where(np.arange(3) == j, flow, 0.0)
        ends.append(np.abs(now - c - engine.increments[:, 0]).max())
    assert (min(ends) < 1e-12) != fast


# -- transport ---------------------------------------------------------------------------------------------------------------------------
@pytest.mark.slow
@pytest.mark.parametrize("scheme", ["middle", "aboba", "bababo"])
@pytest.mark.parametrize("what", ["heat", "species"])
@any_seed(1)
def test_a_sine_decays_as_it_should(what, scheme, seed):
    """At a step of 0.04; mvv needs 0.01 for this, and breaks down at 0.04.  Standard error of two runs with heat: 0.4 %; of one with species:
    0.2 % (docs/howto/heat_species.md)."""
    found = [heat_steps.run(what, scheme, 0.04, seed + 10 * k)["rate"] for k in range(2 if what == "heat" else 1)]
    assert abs(np.mean(found)) < 0.02


@pytest.mark.slow
@any_seed(1)
def test_motion_and_beads_have_one_temperature(seed):
    """Within 0.5 % at a step of 0.04, with a standard error of 0.1 %."""
    built = dpd.build(heat_steps.scene("heat", seed), dt=0.04, scheme="middle", seed=seed)
    simulation, observer, ratios = built.simulation(), dpd.Observer(built), []
    simulation.step(100)
    for _ in range(400):
        simulation.step(4)
        sample = observer.sample(simulation.context)
        ratios.append(sample.kT / sample.theta)
    assert abs(np.mean(ratios) - 1) < 0.005


def steady_profile(diffusion: float, wide=6.0, slices=10, fine=120) -> np.ndarray:
    """Means over slices of what satisfies rho kappa int w^2 (T(x') - T(x)) d^3r + D T'' = 0 between walls of 1.02 and 0.98 that beads do not
    enter: a straight line but for a jump at the walls, since heat jumps between beads."""
    h, reach = wide / fine, heat_steps.CUTOFF
    beyond = int(np.ceil(reach / h))
    apart = h * np.abs(np.subtract.outer(np.arange(fine), np.arange(-beyond, fine + beyond)))
    # 2 pi int (1 - r/rc)^2 r dr from the distance along x to rc
    primitive = lambda r: r**2 / 2 - 2 * r**3 / (3 * reach) + r**4 / (4 * reach**2)  # noqa: E731
    near = np.minimum(apart, reach)
    kernel = heat_steps.DENSITY * heat_steps.RATE * 2 * np.pi * (primitive(reach) - primitive(near)) * h
    inner = slice(beyond, beyond + fine)
    matrix = kernel[:, inner] - np.diag(kernel.sum(axis=1))
    for i in range(fine):
        for j in (i - 1, i + 1):
            if 0 <= j < fine:
                matrix[i, j] += diffusion / h**2
                matrix[i, i] -= diffusion / h**2
    given = 1.02 * kernel[:, :beyond].sum(axis=1) + 0.98 * kernel[:, beyond + fine :].sum(axis=1)
    return np.linalg.solve(matrix, -given).reshape(slices, -1).mean(axis=1)


@pytest.mark.slow
@pytest.mark.parametrize("scheme", ["middle", "bababo"])
@pytest.mark.parametrize("what", ["heat", "species"])
def test_profile_between_two_walls(what, scheme):
    """Beads that do not move, of 1.02 and 0.98, on both sides of 6 nm of fluid, at a step of 0.04: slices are within 2 % of the difference
    of the walls of the continuum limit.  (With a larger difference the warm side expands.)"""
    edges = np.array([9.2, 5.0, 5.0])
    n = round(heat_steps.DENSITY * np.prod(edges))
    x = np.random.default_rng(1).random((n, 3)) * edges
    still = (x[:, 0] < 1.6) | (x[:, 0] > 7.6)
    start = np.where(x[:, 0] < 1.6, 1.02, np.where(still, 0.98, 1.0))
    scene = heat_steps.scene(what, 1)
    (term,) = scene.tables[0].entries.values()
    pairs = {("W", "W"): replace(term, kappa=heat_steps.RATE / 1e6)} if what == "heat" else scene.pairs
    internal = dpd.BeadTemperatures(start, 1e6) if what == "heat" else dpd.Concentrations(start)
    walls = [dpd.Wall("x", 1.6, "above", "bounce-back"), dpd.Wall("x", 7.6, "below", "bounce-back")]
    of_beads = {"types": ["W"] * n, "positions": x, "velocities": None, "bead_masses": None, "mobile": ~still, "internal": internal}
    built = dpd.build(replace(scene, box=edges, walls=walls, pairs=pairs, **of_beads), dt=0.04, scheme=scheme, seed=1)
    simulation = built.simulation()
    simulation.step(600)
    begun = state_of(simulation.context)[0]
    sums, counts = np.zeros(10), np.zeros(10)
    for _ in range(200):
        simulation.step(2)
        at, values = state_of(simulation.context)[0], raw_fields(simulation.context, built.plan.spec.fields)[~still, 0]
        place = ((at[~still, 0] - 1.6) / 0.6).astype(int).clip(0, 9)
        sums += np.bincount(place, values, 10)
        counts += np.bincount(place, minlength=10)
    diffusion = np.mean((at - begun)[~still, 1:] ** 2) / (2 * 400 * 0.04)
    print(what, scheme, diffusion, np.round((sums / counts - steady_profile(diffusion)) / 0.04, 4))
    assert np.abs(sums / counts - steady_profile(diffusion)).max() < 0.02 * 0.04
