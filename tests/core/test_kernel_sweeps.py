"""Sweep form of the kernel against the oracle, handed the same noise and the same order of pairs."""

import numpy as np
import oracle
import pytest
from scenes import BOX, BOXES, EXTENDED, TABLES, D, beads, chains, factor_of, fluid, listed_pairs, noise_of, oracle_params, ready

import openmm_dpd as dpd
from openmm_dpd.kernels.engine import PairEngine
from openmm_dpd.kernels.layer import EXACT, SHARDLOW
from openmm_dpd.plan.plan import make_plan
from openmm_dpd.runtime.threads import set_threads

UPDATE = pytest.mark.parametrize("scheme", ["middle", "shardlow"])
KT, SEED, COUNTER = 1.3, 21, 5


def prepared(scene, scheme) -> PairEngine:
    return ready(PairEngine(make_plan(scene, dt=0.1, seed=SEED, scheme=scheme).spec), scene.positions, scene.box)


def expected_of(scene, scheme, engine, dt, kT=KT, inv_mass=None, v=None, counter=COUNTER):
    v = scene.velocities if v is None else v
    inv_mass = 1 / scene.bead_masses if inv_mass is None else inv_mass
    update = {"middle": oracle.ou_update, "shardlow": oracle.shardlow_update}[scheme]
    for layer in range(len(scene.tables)):
        noise = noise_of(scene.n_beads, SEED, counter, kT, layer) if kT else None
        order = listed_pairs(engine, layer)
        common = (inv_mass, scene.type_ids, oracle_params(scene, layer), scene.box, kT, dt, noise, update, factor_of(scene))
        v = oracle.sweep(scene.positions, v, order, *common)
    return v


def check(scene, scheme, dt, kT=KT):
    engine = prepared(scene, scheme)
    change = engine.sweep(scene.velocities, kT, dt, SEED, COUNTER)
    expected = expected_of(scene, scheme, engine, dt, kT)
    np.testing.assert_allclose(scene.velocities + change, expected, rtol=0, atol=1e-12 * (1 + np.abs(expected).max()))
    assert np.abs(change).max() > 0.01
    assert np.abs(scene.bead_masses @ change).max() < 1e-13 * np.sum(scene.bead_masses[:, None] * np.abs(scene.velocities))


@UPDATE
@BOX
def test_sweep_equals_the_oracle(box, scheme):
    check(fluid(EXTENDED, box, kT=KT), scheme, 0.05)


@UPDATE
@pytest.mark.parametrize("table", TABLES.values(), ids=TABLES.keys())
@pytest.mark.parametrize("dt", [1e-4, 0.05, 10.0])
def test_tables_and_step_sizes(table, scheme, dt):
    """A step so long that the pair forgets its velocity is as legal as a short one."""
    scene = fluid(table, BOXES["ortho"], kT=KT)
    engine = prepared(scene, scheme)
    change = engine.sweep(scene.velocities, KT, dt, SEED, COUNTER)
    expected = expected_of(scene, scheme, engine, dt)
    np.testing.assert_allclose(scene.velocities + change, expected, rtol=0, atol=1e-11 * np.abs(expected).max())


@UPDATE
def test_friction_without_noise_factors_and_overlaid_tables_that_are_swept_one_after_the_other(scheme):
    check(fluid(EXTENDED, BOXES["tilted"], kT=0.0), scheme, 0.05, kT=0.0)
    check(chains(BOXES["ortho"], kT=KT), scheme, 0.05)
    first = fluid(EXTENDED, kT=KT)
    tables = [dpd.PairTable(EXTENDED), dpd.PairTable({("*", "*"): D(gamma=3.0, gamma_perp=1.0, cutoff=0.8)})]
    scene = dpd.Scene(first.masses, first.types, first.positions, tables, KT, box=first.box, velocities=first.velocities)
    check(scene, scheme, 0.05)


@UPDATE
def test_immobile_beads_keep_their_velocity_and_drag_the_others(scheme):
    base = fluid(EXTENDED, BOXES["ortho"], kT=KT)
    mobile = np.arange(base.n_beads) % 5 > 0
    scene = dpd.Scene(base.masses, base.types, base.positions, EXTENDED, KT, box=base.box, velocities=base.velocities, mobile=mobile)
    engine = prepared(scene, scheme)
    seen = np.where(mobile[:, None], base.velocities, 0.0)  # OpenMM shows beads of mass 0 at rest
    change = engine.sweep(seen, KT, 0.05, SEED, COUNTER)
    assert not change[~mobile].any()
    inv_mass = np.where(mobile, 1 / base.bead_masses, 0.0)
    expected = expected_of(scene, scheme, engine, 0.05, inv_mass=inv_mass)
    np.testing.assert_allclose((base.velocities + change)[mobile], expected[mobile], rtol=0, atol=1e-12)
    at_rest = expected_of(scene, scheme, engine, 0.05, inv_mass=inv_mass, v=seen)
    assert np.abs((expected - at_rest)[mobile]).max() > 1e-3  # the walls' motion is seen


@UPDATE
def test_the_input_is_left_alone_and_again_gives_the_same_bits(scheme, two_threads):
    scene = fluid(EXTENDED, BOXES["wide"], kT=KT)
    engine, v = prepared(scene, scheme), scene.velocities.copy()
    results = [engine.sweep(v, KT, 0.05, SEED, COUNTER)]
    engine.sweep(2 * v, KT, 0.05, SEED, COUNTER + 1)
    results.append(engine.sweep(v, KT, 0.05, SEED, COUNTER))
    set_threads(2)
    results.append(prepared(scene, scheme).sweep(v, KT, 0.05, SEED, COUNTER))
    assert np.array_equal(v, scene.velocities)
    assert all(np.array_equal(results[0], other) for other in results[1:])


def test_the_update_may_be_chosen_for_each_call():
    scene = fluid(EXTENDED, kT=KT)
    middle, shardlow = prepared(scene, "middle"), prepared(scene, "shardlow")
    arguments = (scene.velocities, KT, 0.05, SEED, COUNTER)
    assert np.array_equal(middle.swept(*arguments, update=SHARDLOW), shardlow.swept(*arguments))
    assert np.array_equal(shardlow.swept(*arguments, update=EXACT), middle.swept(*arguments))
    assert not np.array_equal(middle.swept(*arguments), shardlow.swept(*arguments))


@UPDATE
@pytest.mark.parametrize("dt", [1e-4, 0.05, 0.2, 1.0, 7.0, 40.0])
def test_beads_that_are_all_alike(scheme, dt):
    """One type, one mass, exponent 1: the loops for that case, from weak damping to x = 900, where they leave it to the others."""
    scene = beads(300, edge=4.5, table={("W", "W"): D(gamma=11.0)}, kT=KT, velocities=np.random.default_rng(2).normal(size=(300, 3)))
    check(scene, scheme, dt)


def pairs_apart(count, distance, rng) -> tuple[np.ndarray, np.ndarray]:
    """Places of isolated pairs of beads, the first ones of all before the second ones, and their directions."""
    places = np.stack(np.meshgrid(*[np.arange(16) * 4.0] * 3), axis=-1).reshape(-1, 3)[:count]
    e = rng.normal(size=(count, 3))
    e /= np.linalg.norm(e, axis=1)[:, None]
    return np.concatenate([places, places + distance * e]), e


@UPDATE
@pytest.mark.parametrize("dt", [0.02, 0.5])
def test_maxwell_distribution_is_left_unchanged(scheme, dt):
    """4,000 isolated pairs of masses 1 and 2.7, from the exact distribution, 12 sweeps: covariances stay within 4 standard errors.

    Radial and transverse parts of the relative velocity apart, in units of kT (1/m_i + 1/m_j): errors sqrt(2/M) = 2.2 % and 1.6 %.
    """
    pairs, rng = 4000, np.random.default_rng(5)
    x, e = pairs_apart(pairs, 0.3, rng)
    masses = {"A": 1.0, "B": 2.7}
    table = {("*", "*"): D(gamma=40.5, gamma_perp=3.0, exponent_perp=0.5, cutoff=1.0)}
    v = rng.normal(size=(2 * pairs, 3)) * np.sqrt(KT / np.repeat([1.0, 2.7], pairs))[:, None]
    engine = prepared(dpd.Scene(masses, ["A"] * pairs + ["B"] * pairs, x, table, KT, velocities=v), scheme)
    start, radial, transverse = v.copy(), [], []
    for counter in range(12):
        v = v + engine.sweep(v, KT, dt, SEED, counter)
        u = v[pairs:] - v[:pairs]
        along = np.einsum("pk,pk->p", u, e)
        radial.append(np.mean(along**2))
        transverse.append(np.mean(np.sum(u**2, axis=1) - along**2) / 2)
    scale = KT * (1 + 1 / 2.7)
    for values, error in ((radial, np.sqrt(2 / pairs)), (transverse, np.sqrt(1 / pairs))):
        assert abs(np.mean(values[6:]) / scale - 1) < 4 * error
        assert abs(values[-1] / scale - 1) < 4 * error
    assert np.abs((v[:pairs] + 2.7 * v[pairs:]) - (start[:pairs] + 2.7 * start[pairs:])).max() < 1e-12


@UPDATE
def test_pairs_that_start_cold_warm_up_to_the_temperature(scheme):
    """From rest: 1 - <q^2> of the equilibrium after one sweep, radial and transverse, within 4 standard errors."""
    pairs, rng, dt = 4000, np.random.default_rng(6), 0.05
    x, e = pairs_apart(pairs, 0.4, rng)
    gamma, gamma_perp, mass = 9.0, 4.0, 2.0
    table = {("W", "W"): D(gamma=gamma, gamma_perp=gamma_perp, cutoff=1.0)}
    scene = dpd.Scene({"W": mass}, ["W"] * 2 * pairs, x, table, KT, velocities=np.zeros((2 * pairs, 3)))
    v = prepared(scene, scheme).sweep(scene.velocities, KT, dt, SEED, 0)
    u = v[:pairs] - v[pairs:]
    along = np.einsum("pk,pk->p", u, e)
    for g, measured, count in ((gamma, np.mean(along**2), pairs), (gamma_perp, np.mean(np.sum(u**2, axis=1) - along**2) / 2, 2 * pairs)):
        rate = g * 0.6**2 * (2 / mass) * dt
        q = np.exp(-rate) if scheme == "middle" else (1 - rate / 2) / (1 + rate / 2)
        assert abs(measured / (KT * (2 / mass) * (1 - q * q)) - 1) < 4 * np.sqrt(2 / count)
