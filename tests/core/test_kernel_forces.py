"""Force form of the kernel against the oracle: conservative, dissipative and random forces, energies, virials and Laplacians."""

import numpy as np
import oracle
import pytest
from scenes import BOX, BOXES, EXTENDED, PLAIN, TABLES, D, chains, factor_of, fluid, noise_of, oracle_params, ready

import openmm_dpd as dpd
from openmm_dpd.kernels.engine import CONSERVATIVE, DISSIPATIVE, RANDOM, PairEngine
from openmm_dpd.plan.plan import make_plan
from openmm_dpd.runtime.threads import set_threads

KT, DT, SEED, COUNTER = 1.3, 0.02, 21, 5


def prepared(scene) -> PairEngine:
    return ready(PairEngine(make_plan(scene, dt=DT, seed=SEED).spec), scene.positions, scene.box)


def close(got, expected, rtol=1e-12):
    """Equal to rtol of the largest component; beads far outside the box carry the rounding of their coordinates."""
    np.testing.assert_allclose(got, expected, rtol=0, atol=rtol * np.abs(expected).max())
    assert np.abs(expected).max() > 0.1


def compare(scene, layer=0):
    params, factor, engine = oracle_params(scene, layer), factor_of(scene), prepared(scene)
    x, v, types, box, n = scene.positions, scene.velocities, scene.type_ids, scene.box, scene.n_beads
    noise = noise_of(n, SEED, COUNTER, KT)
    conservative = oracle.conservative(x, types, params, box, factor)
    energy, force, virial = engine.forces(CONSERVATIVE, None, KT, DT, SEED, COUNTER)
    close(force, conservative.forces)
    assert energy == pytest.approx(conservative.energy, rel=1e-12)
    assert virial == pytest.approx(conservative.virial, rel=1e-12)
    drag = oracle.dissipative(x, v, types, params, box, factor)
    energy, force, virial = engine.forces(DISSIPATIVE, v, KT, DT, SEED, COUNTER)
    close(force, drag.forces)
    assert energy == 0.0
    assert virial == pytest.approx(drag.virial, rel=1e-11)
    random = oracle.random(x, types, params, box, KT, DT, noise, factor)
    energy, force, virial = engine.forces(RANDOM, None, KT, DT, SEED, COUNTER)
    close(force, random.forces)
    assert energy == 0.0
    assert virial == pytest.approx(random.virial, rel=1e-11)
    return conservative, drag, random


@BOX
@pytest.mark.parametrize("table", TABLES.values(), ids=TABLES.keys())
def test_forces_equal_the_oracle(box, table):
    scene = fluid(table, box, kT=KT)
    conservative, _, _ = compare(scene)
    assert prepared(scene).laplacian() == pytest.approx(conservative.laplacian, rel=1e-11)


@pytest.mark.parametrize("box", [BOXES["none"], BOXES["tilted"], BOXES["narrow"]], ids=["none", "tilted", "narrow"])
def test_factors_of_bonded_neighbours(box):
    """0 for 1-2, 0.5 for 1-3, 0.25 for 1-4 pairs: C and D times f, R times sqrt(f); a ring counts the shorter way."""
    scene = chains(box, kT=KT)
    scaled = compare(scene)
    plain = oracle.conservative(scene.positions, scene.type_ids, oracle_params(scene), box)
    assert np.abs(scaled[0].forces - plain.forces).max() > 1.0


@BOX
def test_parts_add_up_and_conserve_momentum_to_rounding(box):
    scene = fluid(EXTENDED, box, kT=KT)
    engine = prepared(scene)
    arguments = (scene.velocities, KT, DT, SEED, COUNTER)
    together = engine.forces(CONSERVATIVE | DISSIPATIVE | RANDOM, *arguments)
    parts = [engine.forces(which, *arguments) for which in (CONSERVATIVE, DISSIPATIVE, RANDOM)]
    for k in range(3):
        np.testing.assert_allclose(together[k], sum(part[k] for part in parts), rtol=1e-12, atol=1e-12)
    for _, force, _ in parts:
        assert np.abs(force.sum(axis=0)).max() < 1e-13 * np.abs(force).sum()


def test_overlaid_tables_add_up_and_draw_noise_of_their_own():
    first, second = EXTENDED, {("*", "*"): D(gamma=3.0, gamma_perp=1.0, cutoff=0.8)}
    both = fluid(first, kT=KT)
    tables, v = [dpd.PairTable(first), dpd.PairTable(second)], both.velocities
    both = dpd.Scene(both.masses, both.types, both.positions, tables, KT, box=both.box, velocities=v)
    force = prepared(both).forces(RANDOM, None, KT, DT, SEED, COUNTER)[1]
    x, types, box, n = both.positions, both.type_ids, both.box, both.n_beads
    expected = sum(oracle.random(x, types, oracle_params(both, k), box, KT, DT, noise_of(n, SEED, COUNTER, KT, k)).forces for k in (0, 1))
    close(force, expected)
    drag = sum(oracle.dissipative(x, both.velocities, types, oracle_params(both, k), box).forces for k in (0, 1))
    close(prepared(both).forces(DISSIPATIVE, both.velocities, KT, DT, SEED, COUNTER)[1], drag)


def test_noise_of_two_runs_with_consecutive_seeds_has_nothing_in_common():
    """Not even between the first table of one and the second of the other: no number of seed 5 is drawn with seed 6."""
    table = {("W", "W"): D(gamma=4.5)}
    x = np.array([[0.0, 0.0, 0.0], [0.5, 0.0, 0.0]])
    scene = dpd.Scene({"W": 1.0}, ["W"] * 2, x, [dpd.PairTable(table), dpd.PairTable(table)], 1.0)
    single = dpd.Scene({"W": 1.0}, ["W"] * 2, x, table, 1.0)
    drawn = set()
    for seed in range(20):
        for counter in range(5):
            one = prepared(single).forces(RANDOM, None, 1.0, 1.0, seed, counter)[1][0, 0]
            other = prepared(scene).forces(RANDOM, None, 1.0, 1.0, seed, counter)[1][0, 0] - one
            drawn |= {round(one, 9), round(other, 9)}
    assert len(drawn) == 20 * 5 * 2


def test_sigma_fixed_and_gamma_fixed():
    """Sigma alone: gamma follows as sigma^2/(2 kT), and falls as kT rises; gamma alone: sigma follows."""
    x, v = np.array([[0.0, 0.0, 0.0], [0.25, 0.0, 0.0]]), np.array([[1.0, 0.0, 0.0], [0.0, 0.0, 0.0]])

    def forces(coefficient, kT):
        engine = prepared(dpd.Scene({"W": 1.0}, ["W"] * 2, x, {("W", "W"): coefficient}, 1.0))
        return [engine.forces(which, v, kT, DT, SEED, COUNTER)[1][0, 0] for which in (DISSIPATIVE, RANDOM)]

    by_gamma, by_sigma = D(gamma=4.5), D(sigma=3.0)
    np.testing.assert_allclose(forces(by_gamma, 1.0), forces(by_sigma, 1.0), rtol=1e-14)
    drag, noise = forces(by_sigma, 1.0)
    cold, hot = (noise_of(2, SEED, COUNTER, kT)(0, 1, 0) for kT in (1.0, 4.0))  # another temperature draws other numbers
    assert cold != hot
    np.testing.assert_allclose(forces(by_sigma, 4.0), [drag / 4, noise * hot / cold], rtol=1e-14)
    np.testing.assert_allclose(forces(by_gamma, 4.0), [drag, 2 * noise * hot / cold], rtol=1e-14)
    assert drag == pytest.approx(-4.5 * 0.75**2)
    assert noise == pytest.approx(-3.0 * 0.75 / np.sqrt(DT) * cold)  # e points from bead 1 to bead 0, along -x


def test_no_noise_at_zero_temperature():
    scene = fluid(EXTENDED, kT=0.0)
    assert not prepared(scene).forces(RANDOM, None, 0.0, DT, SEED, COUNTER)[1].any()
    drag = prepared(scene).forces(DISSIPATIVE, scene.velocities, 0.0, DT, SEED, COUNTER)[1]
    close(drag, oracle.dissipative(scene.positions, scene.velocities, scene.type_ids, oracle_params(scene), scene.box).forces)


def test_drag_sees_moving_walls_and_noise_acts_on_them():
    scene = fluid(EXTENDED, seed=4)
    mobile = np.arange(scene.n_beads) % 4 > 0
    wall = dpd.Scene(scene.masses, scene.types, scene.positions, EXTENDED, KT, box=scene.box, velocities=scene.velocities, mobile=mobile)
    seen_by_openmm = np.where(mobile[:, None], scene.velocities, 0.0)
    force = prepared(wall).forces(DISSIPATIVE, seen_by_openmm, KT, DT, SEED, COUNTER)[1]
    close(force, oracle.dissipative(scene.positions, scene.velocities, scene.type_ids, oracle_params(scene), scene.box).forces)


def test_laplacian_counts_mobile_beads_only():
    scene = fluid(PLAIN, BOXES["ortho"], n=60, seed=1)
    mobile = np.arange(scene.n_beads) % 4 > 0
    frozen = dpd.Scene(scene.masses, scene.types, scene.positions, PLAIN, KT, box=scene.box, mobile=mobile)
    engine, x, h = prepared(frozen), scene.positions, 1e-4

    def energy(bead, axis, shift):
        moved = x.copy()
        moved[bead, axis] += shift
        engine.prepare(moved, scene.box)
        return engine.forces(CONSERVATIVE, None, 0.0, DT, 0, 0)[0]

    expected = 0.0
    centre = energy(0, 0, 0.0)
    # the second derivative jumps where a pair enters the cutoff: leave beads with a pair that close to it out
    found = oracle.pair_list(x, scene.type_ids, oracle_params(scene), scene.box)
    rough = {int(b) for i, j, r in zip(found.i, found.j, found.r, strict=True) if abs(r - 1) < 3 * h for b in (i, j)}
    assert not rough, "choose another seed"
    for bead in np.flatnonzero(mobile):
        expected += sum(energy(bead, axis, h) + energy(bead, axis, -h) - 2 * centre for axis in range(3)) / h**2
    engine.prepare(x, scene.box)
    assert engine.laplacian() == pytest.approx(expected, rel=1e-5)


@pytest.mark.parametrize("which", [CONSERVATIVE, DISSIPATIVE, RANDOM])
def test_evaluating_again_gives_the_same_bits(which, two_threads):
    """The noise is a pure function: again, for other threads, in another engine, after other positions and another temperature."""
    scene = fluid(EXTENDED, BOXES["wide"], kT=KT)
    arguments = (which, scene.velocities, KT, DT, SEED, COUNTER)
    first, results = prepared(scene), []
    results.append(first.forces(*arguments)[1])
    results.append(first.forces(*arguments)[1])
    first.forces(which, -scene.velocities, 2 * KT, DT, SEED, COUNTER + 1)
    first.prepare(scene.positions[::-1].copy(), scene.box)
    first.prepare(scene.positions, scene.box)
    results.append(first.forces(*arguments)[1])
    set_threads(2)
    results.append(prepared(scene).forces(*arguments)[1])
    assert all(np.array_equal(results[0], other) for other in results[1:])


def test_noise_does_not_depend_on_the_order_of_the_pairs():
    """Translating all beads sorts them anew; a pair's number belongs to its beads, and stays."""
    scene = fluid(EXTENDED, BOXES["ortho"], kT=KT)
    force = prepared(scene).forces(RANDOM, None, KT, DT, SEED, COUNTER)[1]
    engine = prepared(scene)
    before = list(engine.lists[0].order)
    engine.prepare(scene.positions + [1.1, -2.3, 0.7], scene.box)
    assert list(engine.lists[0].order) != before
    close(engine.forces(RANDOM, None, KT, DT, SEED, COUNTER)[1], force, 1e-11)
