"""Many-body DPD on the device: forces beside numpy and the host, whole steps beside programs and the host, bits, restarts, refusals."""

from dataclasses import replace

import numpy as np
import openmm
import oracle_density
import pytest
from conftest import available
from cuts import ends_of_all_ways
from devices import Device
from scenes import BOXES, chains, fluid, noise_of, same_bits, state_of
from test_pair_terms import COUNTER, DT, SEED, bound, close, context_of, found
from test_steps import made_on, run_on

import openmm_dpd as dpd
from openmm_dpd.base.names import PAIR_FORCE, Phase
from openmm_dpd.kernels.engines import engine_kind
from openmm_dpd.kernels.layer import CONSERVATIVE
from openmm_dpd.plan.forces import device_force as made

BOX = BOXES["ortho"]
PAIRS = (("A", "A"), ("A", "B"), ("B", "B"))
VALUES = {"A": (-40.0, -30.0, -35.0), "gamma": (4.5, 2.0, 9.0), "cutoff": (1.0, 1.2, 0.9)}
QUADRATIC = VALUES | {"B": (25.0,) * 3, "cutoff_B": (0.75,) * 3}
LUCY = VALUES | {"B": (25.0, 15.0, 20.0), "cutoff_B": (0.75, 0.8, 0.9), "cutoff_density": (0.75, 1.1, 0.6)}
KERNELS = {"quadratic": QUADRATIC, "lucy": LUCY}


def table_of(kernel: str) -> dict:
    """Coefficients of all pairs of two types; as much differs as may."""
    values = KERNELS[kernel]
    return {pair: dpd.MDPD(**{name: of[k] for name, of in values.items()}, kernel=kernel) for k, pair in enumerate(PAIRS)}


def matrix(kernel: str, name: str) -> np.ndarray:
    a, ab, b = KERNELS[kernel].get(name, KERNELS[kernel]["cutoff_B"])
    return np.array([[a, ab], [ab, b]])


def liquid(kernel: str, **options) -> dpd.Scene:
    return fluid(table_of(kernel), BOX, n=60, spread=0, **options)


@pytest.mark.parametrize("kernel", KERNELS)
def test_forces_are_the_oracles(kernel, device):
    scene = liquid(kernel)
    at = np.arange(60)
    at[[1, 3]] = 0, 2  # beads at one point count in densities
    scene = replace(scene, positions=scene.positions[at])
    context = context_of(scene, device)
    x, v = state_of(context)
    lucy = kernel == "lucy"
    weights = {"kernel": oracle_density.LUCY, "masses": scene.bead_masses} if lucy else {"kernel": oracle_density.WARREN}
    rho = oracle_density.local_density(x, scene.type_ids, matrix(kernel, "cutoff_density"), BOX, **weights)
    xi, draw = np.zeros((60, 60)), noise_of(60, SEED, COUNTER, 1.0)
    for i in range(60):
        for j in range(i):
            xi[i, j] = xi[j, i] = draw(j, i, 0)
    values = [matrix(kernel, name) for name in ("A", "B", "gamma", "cutoff", "cutoff_B")]
    expected, attraction = (oracle_density.mdpd_pair(x, v, of, scene.type_ids, *values, 1.0, BOX, DT, xi) for of in (rho, 0 * rho))
    energy, force = found(context, Phase.CONSERVE)
    close(force, expected.conservative, bound(device))
    wanted = expected.energy if lucy else attraction.energy + np.pi * 25.0 * 0.75**4 / 30 * np.sum(rho**2)
    assert energy == pytest.approx(wanted, abs=bound(device) * abs(attraction.energy))
    close(found(context, Phase.FORCE_KEPT)[1], expected.dissipative + expected.random, bound(device))


@pytest.mark.parametrize("name", ["chains", "tilted", "immobile", "NONE", "free"])
@pytest.mark.parametrize("kernel", KERNELS)
def test_forces_are_the_hosts(kernel, name):
    """With factors of bonded neighbours, which densities have too, immobile beads, types that do not interact, and without a box."""
    table = table_of(kernel) | ({("A", "B"): dpd.NONE} if name == "NONE" else {})
    scene = {
        "chains": lambda: replace(chains(BOX, n=60), pairs=table),
        "immobile": lambda: liquid(kernel, mobile=np.arange(60) > 7),
        "NONE": lambda: fluid(table, BOX, n=60, spread=0),
        "tilted": lambda: fluid(table, BOXES["tilted"], n=60),
        "free": lambda: fluid(table, None, n=60),
    }[name]()
    context = context_of(scene, available(Device("Reference")))
    x, v = state_of(context)
    engine = engine_kind("host").make(context.plan.spec)
    engine.prepare(x, scene.box)
    expected_energy, expected, _ = engine.forces(CONSERVATIVE, v, 1.0, DT, SEED, COUNTER)
    energy, force = found(context, Phase.CONSERVE)
    close(force, expected, 1e-9)
    assert energy == pytest.approx(expected_energy, abs=1e-9 * np.abs(expected).sum())
    assert np.abs(force.sum(axis=0)).max() < 1e-8 * np.abs(force).max()


@pytest.mark.parametrize("scheme", ["mvv", "bababo", "shardlow"])
@pytest.mark.parametrize("kernel", KERNELS)
def test_steps_are_the_hosts_or_the_programs(kernel, scheme, monkeypatch):
    """``mvv`` has the trajectory of the host, a word that of its letters line by line."""
    monkeypatch.setitem(made.device_force.__kwdefaults__, "tolerance", 1e-12)
    exact, scene = available(Device("Reference")), liquid(kernel)
    simulation = run_on(scene, exact, scheme, dt=0.01)
    other = made_on(scene, exact, scheme, lines=scheme != "mvv", dt=0.01, **({"engine": "host", "loop": False} if scheme == "mvv" else {}))
    other = other.simulation()
    for each in (simulation, other):
        each.step(12)
    (x, v), (other_x, other_v) = (state_of(each.context) for each in (simulation, other))
    np.testing.assert_allclose(x, other_x, rtol=0, atol=1e-7)
    np.testing.assert_allclose(v, other_v, rtol=0, atol=1e-6)


@pytest.mark.parametrize("precision, scheme, kernel", [("single", "middle", "quadratic"), ("mixed", "mvv", "lucy")])
def test_restarts_cuts_and_shared_beads_have_the_same_bits(precision, scheme, kernel, tmp_path, monkeypatch):
    scene, found = liquid(kernel), available(Device("OpenCL", precision))
    ends = ends_of_all_ways(lambda: run_on(scene, found, scheme, dt=0.01), lambda each: state_of(each.context), tmp_path)
    if precision == "mixed":
        monkeypatch.setenv("OPENMM_DPD_DEVICE_LANES", "8")
        shared = run_on(scene, found, scheme, dt=0.01)
        shared.step(20)
        ends.append(state_of(shared.context))
    assert all(same_bits(ends[0], end) for end in ends[1:])


def test_a_barostat_acts_and_bits_are_the_same():
    scene, found, ends = liquid("quadratic"), available(Device("Reference")), []
    for cuts in ((40,), (15, 25)):
        built = made_on(scene, found, "bababo", dt=0.01)
        dpd.add_barostat(built, 5.0, interval=5)
        simulation = built.simulation()
        for n in cuts:
            simulation.step(n)
        ends.append((*state_of(simulation.context), simulation.context.getState().getPeriodicBoxVectors(asNumpy=True)._value))
    assert same_bits(*ends) and ends[0][2][0, 0] != BOX[0, 0]


def test_it_is_explained_goes_through_xml_and_no_older_plugin_reads_it():
    scene, exact = liquid("lucy"), available(Device("Reference"))
    built = made_on(scene, exact)
    assert "engine of the pair kernel: device (as asked for)" in built.explain()
    (force,) = (force for force in built.system.getForces() if force.getName() == PAIR_FORCE)
    text = openmm.XmlSerializer.serialize(force)
    assert 'version="2"' in text
    assert openmm.XmlSerializer.serialize(openmm.XmlSerializer.deserialize(text)) == text
    for old, new, message in (
        ('densityWeights="', 'densityWeights="1 ', "weight of every particle"),
        (' cutoffB="', ' cutoffB="0.5 ', "a table of many-body terms"),
        ('version="2"', 'version="5"', "version"),
    ):
        assert text.count(old) == 1
        with pytest.raises(openmm.OpenMMException, match=message):
            openmm.XmlSerializer.deserialize(text.replace(old, new))


def test_what_minimises_and_measures_them_is_the_host():
    """From States: the same numbers as on the host."""
    scene, exact = liquid("quadratic"), available(Device("Reference"))
    built, host = made_on(scene, exact), dpd.build(scene, dt=0.02, platform="Reference", seed=5, engine="host")
    pair = [built.simulation(), host.simulation()]
    pair[0].minimizeEnergy(maxIterations=5)
    pair[1].context.setPositions(pair[0].context.getState(positions=True).getPositions())
    samples = [dpd.Observer(each).sample(simulation.context) for each, simulation in zip((built, host), pair, strict=True)]
    assert samples[0].potential == pytest.approx(samples[1].potential, rel=1e-9)
    assert samples[0].pressure() == pytest.approx(samples[1].pressure(), rel=1e-9)
    np.testing.assert_allclose(samples[0].forces, samples[1].forces, rtol=0, atol=1e-8 * np.abs(samples[1].forces).max())
