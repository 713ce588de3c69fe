"""Pair updates of heat and species on the device, from pair to pair in rounds: beside numpy, what is kept, bits, restarts, refusals."""

from dataclasses import replace

import numpy as np
import openmm
import oracle_meso as oracle
import pytest
from conftest import available
from cuts import ends_of_all_ways
from devices import Device
from kinds import TABULATED
from reference_forces import between, matrix
from scenes import beads, noise_of, same_bits, state_of
from test_fields import MIXED, POLYNOMIALS, SPECIES, WARM, N, carried, carrying, end_of, options_of, square
from test_steps import run_on

import openmm_dpd as dpd
from openmm_dpd.kernels import noise as hashed
from openmm_dpd.runtime import compiled

#: Nothing pushes: the first step begins with a sweep, and its velocities stay.
SWEPT = {"O": "O B/2 A B/2", "S": "S B/2 A B/2"}
DT, STEP_SEED = 0.02, 5


@compiled
def _hashes(key, stream, table, drawn):
    for i in range(len(table)):
        for j in range(i + 1, len(table)):
            pair = hashed.pair_key(key, i, j)
            table[i, j] = table[j, i] = hashed.mix(pair + np.uint64(1000) * stream) >> np.uint64(1)
            for k in range(len(drawn)):
                drawn[k, i, j] = drawn[k, j, i] = hashed.uniform(pair, k)


def state_of_bead(scene, bead: int) -> oracle.State:
    """Its equation of state in numpy."""
    eos = TABULATED[scene.types[bead]]
    if scene.immobile[bead]:
        return oracle.reservoir_state(scene.internal.thetas[bead])
    return oracle.curve_state(eos.energies, eos.thetas) if isinstance(eos, dpd.TabulatedEOS) else oracle.capacity_state(eos.capacity)


def three(scene):
    """A scene with three species at most."""
    if not isinstance(scene.internal, dpd.Concentrations):
        return scene
    table = {pair: replace(c, **{name: values[:3] for name, values in SPECIES.items()}) for pair, c in scene.tables[0].entries.items()}
    return replace(scene, pairs=table, internal=dpd.Concentrations(scene.internal.values[:, :3]))


def frictional(scene):
    """Without repulsion."""
    return replace(scene, pairs={pair: replace(c, A=0.0) for pair, c in scene.tables[0].entries.items()})


def swept(scene, letter: str) -> tuple[np.ndarray, np.ndarray]:
    """Velocities and what beads carry after a sweep by the oracle, in the order of hashes."""
    hashes, drawn = np.zeros((N, N), np.uint64), np.zeros((4, N, N))
    _hashes(hashed.noise_key(STEP_SEED, 1, 0, 1.0), np.uint64(0xD1342543DE82EF95), hashes, drawn)
    geometry, reach = between(scene), max(WARM["cutoff"] + WARM["cutoff_T"])
    pairs = [(i, j) for i in range(N) for j in range(i + 1, N) if geometry(i, j)[0] < reach]
    order = sorted(pairs, key=lambda pair: hashes[pair])
    draw = noise_of(N, STEP_SEED, 1, 1.0)
    numbers = np.array([[[draw(i, j, k) if i < j else 0.0 for j in range(N)] for i in range(N)] for k in range(4)])
    xi, flows = numbers[0] + numbers[0].T, numbers[1:] - np.swapaxes(numbers[1:], 1, 2)
    masses = np.where(scene.immobile, np.inf, scene.bead_masses)
    if isinstance(scene.internal, dpd.InternalEnergy):
        states = [state_of_bead(scene, bead) for bead in range(N)]
        energies = scene.internal.energies(scene.type_ids, scene.type_names).T
        values = [matrix(scene, name) for name in ("sigma", "kappa", "cutoff")]
        v, *energies = oracle.energy_sweep(
            scene.velocities, *energies, states, scene.type_ids, masses, *values, order, geometry, DT, xi, flows[0], *drawn[2:],
            shardlow=letter == "S",
        )  # fmt: skip
        return v, np.column_stack(energies)
    if isinstance(scene.internal, dpd.Concentrations):
        values = [square(MIXED[name]) for name in ("gamma", "exponent", "cutoff", "cutoff_c")]
        species = [values[:3] for values in SPECIES.values()]
        return oracle.tdpd_sweep(
            scene.velocities, scene.internal.values, scene.type_ids, masses, *values, *species, 1.0, order, geometry, DT, xi, flows,
            shardlow=letter == "S",
        )  # fmt: skip
    values = [square(WARM[name]) for name in ("gamma", "exponent", "cutoff", "kappa", "exponent_T", "cutoff_T")]
    v, temperature = oracle.edpd_sweep(
        scene.velocities, scene.internal.values(N)[:, 0], scene.internal.heat_capacities(N), scene.type_ids, masses, *values, order, geometry, DT,
        xi, flows[0], *drawn[2:], *map(square, POLYNOMIALS.values()), shardlow=letter == "S",
    )  # fmt: skip
    return v, temperature[:, None]


@pytest.mark.parametrize("letter", SWEPT)
@pytest.mark.parametrize("name", ["plain", "immobile"])
@pytest.mark.parametrize("kind", ["heat", "species", "energies"])
def test_a_sweep_is_the_oracles(kind, name, letter, device):
    if device.precision == "single":
        pytest.skip("single precision is refused")
    if device.precision and (name, letter if device.precision == "double" else "O") != ("plain", "O"):
        pytest.skip("compiled once, to save time")
    scene = frictional(three(carrying(kind, **({} if name == "plain" else options_of(name)), spread=0)))
    simulation = run_on(scene, device, SWEPT[letter], dt=DT)
    v, values = swept(scene, letter)
    simulation.step(1)
    mixed = 1e-6 if kind == "energies" else 1e-5
    moving, bound = ~scene.immobile, device.choose(1e-9, {"mixed": mixed}.get(device.precision, 1e-9), 1e-5)
    found = carried(simulation)[:, : values.shape[1]]
    np.testing.assert_allclose(state_of(simulation.context)[1][moving], v[moving], rtol=0, atol=bound * np.abs(v).max())
    np.testing.assert_allclose(found, values, rtol=0, atol=bound * np.abs(values).max())
    assert np.abs(found - carried(run_on(scene, device, SWEPT[letter], dt=DT))[:, : values.shape[1]]).max() > 1e-3


@pytest.mark.parametrize("kind", ["heat", "species", "energies"])
@pytest.mark.parametrize("scheme", ["middle", "bababo", "aboba", "shardlow", "O A/2 B A/2", "A/2 B O A/2", "B/2 A B/2 O"])
def test_words_with_next_to_no_updates_are_the_hosts(scheme, kind):
    """Sources change temperatures, and forces follow these at every kick."""
    scene = three(carrying(kind, **options_of("sources")))
    names = {"sigma": 1e-6} if kind == "energies" else {"gamma": 1e-12}
    names |= {"kappa": (0.0,) * 3 if kind == "species" else 0.0}
    names |= {"epsilon": (0.0,) * 3} if kind == "species" else {}
    scene = replace(scene, pairs={pair: replace(c, **names) for pair, c in scene.tables[0].entries.items()})
    ours = run_on(scene, available(Device("Reference")), scheme, dt=0.01)
    host = dpd.build(scene, dt=0.01, scheme=scheme, platform="Reference", seed=STEP_SEED, engine="host").simulation()
    for n in (1, 4, 7):
        for each in (ours, host):
            each.step(n)
            each.context.getState(energy=True)
        for mine, theirs in zip((*state_of(ours.context), carried(ours)), (*state_of(host.context), carried(host)), strict=True):
            np.testing.assert_allclose(mine, theirs, rtol=0, atol=1e-6 * np.abs(theirs).max())


@pytest.mark.parametrize("scheme", ["middle", "shardlow"])
def test_energy_momentum_and_species_are_kept_to_rounding(scheme, device):
    if device.precision == "single" or (device.precision == "mixed" and scheme != "middle"):
        pytest.skip("single precision is refused; compiled once, to save time")
    # masses and capacities are in single precision unless it is double
    scene = frictional(carrying("heat", masses={"A": 1.0, "B": 2.0}))
    mass, capacities = scene.bead_masses[:, None], scene.internal.capacities.astype(np.float32 if device.precision else float)
    scene = replace(scene, internal=replace(scene.internal, capacities=capacities))
    simulation, energies, momenta = run_on(scene, device, scheme, dt=0.05), [], []
    for n in (200, 0):
        v = state_of(simulation.context)[1]
        energies.append(0.5 * np.sum(mass * v**2) + capacities @ carried(simulation)[:, 0])
        momenta.append((mass * v).sum(axis=0))
        simulation.step(n)
    assert energies[1] == pytest.approx(energies[0], rel=1e-11)
    np.testing.assert_allclose(momenta[1], momenta[0], rtol=0, atol=1e-9)
    assert carried(simulation)[:, 0].min() > 0
    scene = three(carrying("species"))
    simulation = run_on(scene, device, scheme, dt=0.02)
    simulation.step(100)
    after = carried(simulation)[:, :3]
    assert after.min() >= 0 and np.abs(after - scene.internal.values).max() > 0.1
    np.testing.assert_allclose(after.sum(axis=0), scene.internal.values.sum(axis=0), rtol=1e-11)


def test_the_order_of_pairs_knows_nothing_of_their_noise(exact):
    """Updates that are exact one by one leave the distribution as it is in any order, but not in one by the noise."""
    rng, n = np.random.default_rng(6), 1000
    table, internal = {("W", "W"): dpd.EDPD(A=0.0, gamma=4.5, kappa=0.01)}, dpd.BeadTemperatures(1.0, 1e4)
    scene = beads(n, edge=(n / 3) ** (1 / 3), table=table, internal=internal, velocities=rng.normal(size=(n, 3)))
    simulation, found = run_on(scene, exact, "middle", dt=0.1), []
    for _ in range(20):
        simulation.step(3)
        found.append(np.mean(state_of(simulation.context)[1] ** 2))
    assert np.mean(found) == pytest.approx(1.0, abs=0.025)


@pytest.mark.parametrize(
    "kind, shares", [("heat", False), ("species", True), ("energies", False), pytest.param("energies", True, marks=pytest.mark.slow)]
)
def test_restarts_cuts_and_shared_beads_have_the_same_bits(kind, shares, tmp_path, monkeypatch):
    scene, device, scheme = three(carrying(kind, **options_of("sources"))), available(Device("OpenCL", "mixed")), "bababo"
    ends = ends_of_all_ways(lambda: run_on(scene, device, scheme, dt=0.01), end_of, tmp_path)
    if shares:
        monkeypatch.setenv("OPENMM_DPD_DEVICE_LANES", "8")
        shared = run_on(scene, device, scheme, dt=0.01)
        shared.step(20)
        ends.append(end_of(shared))
    assert all(same_bits(ends[0], end) for end in ends[1:])


def test_more_rounds_than_expected_are_made_in_another_try():
    """All beads in one spot: every pair of a bead waits for all others."""
    scene = frictional(three(carrying("species")))
    rng = np.random.default_rng(2)
    simulation = run_on(scene, available(Device("Reference")), "middle", dt=0.01)
    simulation.step(1)
    simulation.context.setPositions(2.0 + 0.3 * rng.random((N, 3)))
    simulation.step(1)
    np.testing.assert_allclose(carried(simulation)[:, :3].sum(axis=0), scene.internal.values.sum(axis=0), rtol=1e-11)


def test_what_it_has_not_is_refused():
    exact, heat = available(Device("Reference")), carrying("heat")
    with pytest.raises(Exception, match="need mixed or double precision"):
        run_on(heat, available(Device("OpenCL", "single")), "middle")
    context = run_on(heat, exact, "middle").context
    context.setParameter("dpd_phase", 101)
    with pytest.raises(openmm.OpenMMException, match="those of whole steps alone"):
        context.getState(forces=True)
