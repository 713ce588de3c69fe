"""Internal energies on the device: pairs beside the host, what is kept, what is set, volume moves, temperatures, refusals."""

from dataclasses import replace

import numpy as np
import openmm
import pytest
from conftest import available
from devices import Device
from judged import any_seed, judge, ratios
from kinds import TABULATED
from scenes import BOXES, fluid, same_bits, state_of
from test_fields import N, carrying, end_of, options_of
from test_rounds import frictional
from test_steps import made_on, run_on

import openmm_dpd as dpd
from openmm_dpd.plan.kinds import KINDS
from openmm_dpd.simulation import barostat

EXACT = Device("Reference")
#: Energies around 0 and far from it, temperatures that hardly change and that jump.
STEEP = {
    "A": dpd.TabulatedEOS([0.5, 1.0, 1.001, 2.0], [-5.0, 0.0, 3.0, 4.0]),
    "B": dpd.TabulatedEOS([0.5, 0.9, 3.0], [1e4, 1e4 + 0.1, 1e4 + 50.0]),
}


def on_host(scene, scheme: str, **choices):
    return dpd.build(scene, scheme=scheme, platform="Reference", seed=5, engine="host", **{"dt": 0.01} | choices)


WORDS = ("middle", "bababo", "aboba")


@pytest.mark.parametrize(
    "scheme, eos", [*((scheme, TABULATED) for scheme in (*WORDS, "mvv", "shardlow")), *((scheme, STEEP) for scheme in WORDS)]
)
def test_pairs_alone_are_the_hosts(scheme, eos):
    """No order matters: all equations of state beside each other and beside reservoirs, with every test of a move."""
    rng = np.random.default_rng(4)
    sites = np.stack(np.meshgrid(np.arange(4), np.arange(4), np.arange(2), indexing="ij"), axis=-1).reshape(-1, 3)[: N // 2] * 3.0 + 1.5
    e = rng.normal(size=(N // 2, 3))
    e *= rng.uniform(0.2, 0.7, (N // 2, 1)) / np.linalg.norm(e, axis=1, keepdims=True)
    x = np.stack([sites, sites + e], axis=1).reshape(-1, 3)
    scene = carrying("energies", box=np.diag([12.0, 12.0, 6.5]), positions=x, mobile=rng.random(N) > 0.2)
    # long updates, which are often refused
    strong = {pair: replace(c, A=0.0, kappa=300 * c.kappa) for pair, c in scene.tables[0].entries.items()}
    scene = replace(scene, pairs=strong if eos is TABULATED else frictional(scene).tables[0], internal=replace(scene.internal, eos=eos))
    dt = 0.002 if scheme in ("mvv", "shardlow") else 0.02
    ours, host = run_on(scene, available(EXACT), scheme, dt=dt), on_host(scene, scheme, dt=dt).simulation()
    start = end_of(ours)
    for n in (1, 3, 6):
        for each in (ours, host):
            each.step(n)
        for mine, theirs in zip(end_of(ours), end_of(host), strict=True):
            np.testing.assert_allclose(mine, theirs, rtol=0, atol=1e-9 * np.abs(theirs).max())
    changed = np.abs(end_of(ours)[2] - start[2])[:, :2]
    assert changed[scene.immobile].max() == 0 and changed.max(axis=0).min() > 0.1


@pytest.mark.parametrize("scheme", ["middle", "bababo", "shardlow"])
def test_energy_and_momentum_are_kept_to_rounding(scheme, device):
    if device.precision in ("single", "double") or (device.precision and scheme != "middle"):
        pytest.skip("single precision is refused; compiled once, to save time")
    # OpenMM has inverse masses in single precision unless it is double
    scene = frictional(carrying("energies", masses={"A": 1.0, "B": 2.0}))
    built = made_on(scene, device, scheme, dt=0.01)
    simulation, sample, found = built.simulation(properties=device.properties), dpd.Observer(built).sample, []
    for n in (200, 0):
        now = sample(simulation.context)
        found.append((now.total, now.conductive, scene.bead_masses @ state_of(simulation.context)[1], end_of(simulation)[2]))
        simulation.step(n)
    (energy, conductive, momentum, u), (energy_now, conductive_now, momentum_now, u_now) = found
    assert energy_now == pytest.approx(energy, rel=1e-11) and conductive_now == pytest.approx(conductive, abs=1e-9)
    np.testing.assert_allclose(momentum_now, momentum, rtol=0, atol=1e-9)
    assert np.abs(u_now - u)[:, :2].max(axis=0).min() > 1.0


def test_what_is_set_acts_from_the_next_step_on():
    """As on the host: temperatures, and energies in which a program has kept what rounding lost."""
    scene = carrying("energies", **options_of("immobile"))
    ends = []
    for built in (made_on(scene, available(EXACT), "mvv", dt=0.005), on_host(scene, "mvv", dt=0.005)):
        simulation = built.simulation()
        simulation.step(3)
        dpd.write_fields(simulation.context, built.plan, theta=1.2)
        values = np.array(simulation.integrator.getPerDofVariableByName("field0")) + [0.0, 0.0, 0.5] * ~scene.immobile[:, None]
        simulation.integrator.setPerDofVariableByName("field0", values)
        assert dpd.read_fields(simulation.context, built.plan)["theta"][~scene.immobile].min() > 1.2
        simulation.step(2)
        ends.append((*state_of(simulation.context), *dpd.read_fields(simulation.context, built.plan).values()))
    for mine, theirs in zip(*ends, strict=True):
        np.testing.assert_allclose(mine, theirs, rtol=0, atol=1e-6 * np.abs(theirs).max())


def test_a_volume_move_pays_with_the_energies_that_the_device_has():
    scene = carrying("energies", n=120, box=BOXES["wide"])
    built = made_on(scene, available(EXACT), "middle", dt=0.01)
    simulation, sample, barostat, accepted = built.simulation(), dpd.Observer(built).sample, dpd.EnthalpyBarostat(built, 5.0), 0
    for _ in range(12):
        simulation.step(1)
        before = sample(simulation.context)
        accepted += barostat.move(simulation.context)
        after = sample(simulation.context)
        assert after.total + 5.0 * after.volume == pytest.approx(before.total + 5.0 * before.volume, rel=1e-9)
    assert accepted


@pytest.mark.parametrize("nothing", ["rejected moves", "parameters of others", "parameters that stay"])
def test_what_changes_nothing_has_mvv_keep_its_acceleration(nothing, monkeypatch):
    """With one that is computed anew, heat of friction and noise is that of velocities that this noise has changed: energy is lost."""
    monkeypatch.setattr(barostat, "_entropy_gain", lambda *_: -np.inf)
    ends = []
    for does in (False, True):
        built = made_on(carrying("energies", n=120, box=BOXES["wide"]), available(EXACT), "mvv", dt=0.002)
        beside = openmm.CustomExternalForce("0*own*x")
        beside.addGlobalParameter("own", 1.0)
        beside.addParticle(0)
        built.system.addForce(beside)
        simulation, moves = built.simulation(), dpd.EnthalpyBarostat(built, 5.0)
        for n in range(4):
            simulation.step(1)
            if does and nothing == "rejected moves":
                assert not moves.move(simulation.context)
            elif does:
                simulation.context.setParameter(*(("own", float(n)) if "others" in nothing else ("dpd_kT", 1.0)))
        ends.append((*state_of(simulation.context), *end_of(simulation)))
    assert same_bits(*ends)


@pytest.mark.parametrize("scheme, dt, kappa", [("shardlow", 1.0, 2e3), ("mvv", 0.02, 1e5)])
def test_energies_without_a_temperature_stop_a_run(scheme, dt, kappa):
    scene = replace(carrying("energies"), pairs={("*", "*"): dpd.EnergyDPD(kappa=kappa)})
    simulation = made_on(scene, available(EXACT), scheme, dt=dt).simulation()
    before = end_of(simulation)
    with pytest.raises(openmm.OpenMMException, match="the internal energy of bead [0-9]+ is outside its equation of state"):
        simulation.step(5)
        simulation.context.getState(energy=True)
    assert same_bits(end_of(simulation), before)


def test_what_it_has_not_is_refused(monkeypatch):
    scene = carrying("energies")
    with pytest.raises(Exception, match="need mixed or double precision"):
        run_on(scene, available(Device("OpenCL", "single")), "middle")
    monkeypatch.setitem(KINDS, dpd.EnergyDPD, replace(KINDS[dpd.EnergyDPD], device=None))
    with pytest.raises(dpd.PlanError, match="cannot run this scene on the platform Reference: it has no EnergyDPD"):
        made_on(scene, available(EXACT), "mvv")


@pytest.mark.slow
@pytest.mark.parametrize("scheme, dt", [("middle", 0.02), ("bababo", 0.03)])
@any_seed(3)
def test_temperatures_agree_and_those_of_beads_vary_as_they_should(scheme, dt, seed):
    """Kinetic, internal (harmonic means of both types) and configurational; u of a bead of heat capacity C has the weight u^C exp(-u/T): the mean of
    theta^2 over the square of its mean is 1 + 1/(C + 1), less a part 1/N of the last term.  Standard errors 0.7 %."""
    eos = {"A": dpd.ConstantHeatCapacity(6.0), "B": dpd.TabulatedEOS.from_functions(lambda theta: 3 * theta**2, (0.02, 12.0), points=60)}
    table, internal = {("*", "*"): dpd.EnergyDPD(A=25, sigma=3.0, kappa=8.0)}, dpd.InternalEnergy(eos, 1.5)
    scene = fluid(table, np.eye(3) * 4.0, n=192, spread=0, internal=internal)
    built = made_on(scene, available(EXACT), scheme, dt=dt, seed=seed)
    simulation, observer, rows = built.simulation(), dpd.Observer(built), []
    is_a = scene.type_ids == scene.type_names.index("A")
    simulation.step(1000)
    for _ in range(1200):
        simulation.step(8)
        theta, sample = dpd.read_fields(simulation.context, built.plan)["theta"], observer.sample(simulation.context)
        means = [1 / np.mean(1 / theta[members]) for members in (is_a, ~is_a)]
        rows.append((sample.kT, *means, np.mean(theta[is_a] ** 2), np.mean(theta[is_a]) ** 2, sample.gradient2, sample.laplacian))
    kinetic, of_a, of_b, square, mean, gradient2, laplacian = np.array(rows).T
    judge(ratios(kinetic, of_a), 1.0, error=0.01, beside=0.005)
    judge(ratios(of_b, of_a), 1.0, error=0.01, beside=0.002)
    judge(ratios(square, mean), 1 + 1 / 7, error=0.005, beside=0.003)
    judge(ratios(gradient2 / laplacian, of_a), 1.0, error=0.02, beside=0.02)
