"""Energy-conserving DPD: force form and sweeps against the oracle, conservation, and the distribution the exact updates sample."""

from dataclasses import replace

import numpy as np
import oracle_energy as oracle
import pytest
from cases import cases, raises
from kinds import ENERGY
from reference_forces import COUNTER, DT, SEED, close, noise_matrices, prepared, same_terms
from scenes import BOX, BOXES, MASSES, chains, fluid, listed_pairs
from scipy import optimize, stats

import openmm_dpd as dpd
from openmm_dpd.kernels.energy_updates import any_conduction, any_motion
from openmm_dpd.kernels.engine import CONSERVATIVE, DISSIPATIVE, RANDOM
from openmm_dpd.kernels.eos import CONSTANT, log_ratio
from openmm_dpd.model.energy_dpd import EnergyDPD
from openmm_dpd.model.eos import ConstantHeatCapacity, TabulatedEOS
from openmm_dpd.model.internal import InternalEnergy
from openmm_dpd.plan.kinds.fields import eos_table
from openmm_dpd.runtime.decorators import compiled
from openmm_dpd.runtime.threads import set_threads

EOS = {"A": ConstantHeatCapacity(40.0), "B": ConstantHeatCapacity(70.0)}


def energy_fluid(box, *, make=fluid, eos=EOS, table=ENERGY, seed=5, **options) -> dpd.Scene:
    n = make(box=box).n_beads
    return make(table=table, box=box, internal=InternalEnergy(eos, np.random.default_rng(seed).uniform(0.7, 1.4, n)), **options)


def matrices(scene):
    names = scene.type_names
    entries = scene.tables[0].resolve(names)
    get = lambda key: np.array([[getattr(entries[(names[min(a, b)], names[max(a, b)])], key) for b in range(2)] for a in range(2)])  # noqa: E731
    return {key: get(key) for key in ("A", "sigma", "kappa", "cutoff")}


@BOX
def test_forces_and_heat_equal_the_oracle(box):
    scene = energy_fluid(box)
    engine, n = prepared(scene, "middle"), scene.n_beads
    u = scene.internal.energies(scene.type_ids, scene.type_names)
    theta = u.sum(axis=1) / np.array([EOS[t].capacity for t in scene.types])
    noise = dict(zip(("xi", "xi_q"), noise_matrices(n), strict=True))
    state = (scene.positions, scene.velocities, theta, scene.type_ids, scene.bead_masses)
    expected = oracle.dpde_rates(*state, **matrices(scene), box=box, k_B=1.0, dt=DT, **noise)
    parts = {}
    for which in (CONSERVATIVE, DISSIPATIVE, RANDOM):
        energy, force, virial = engine.forces(which, scene.velocities, 1.0, DT, SEED, COUNTER, u)
        parts[which] = (energy, force, virial, engine.rates.copy())
    same_terms([parts[which] for which in (CONSERVATIVE, DISSIPATIVE, RANDOM)], expected.terms)
    close(parts[DISSIPATIVE][3], np.column_stack([expected.cond_deterministic, expected.mech_deterministic]))
    close(parts[RANDOM][3], np.column_stack([expected.cond_random, expected.mech_random]))
    assert abs((parts[DISSIPATIVE][3] + parts[RANDOM][3])[:, 0].sum()) < 1e-12 * np.abs(parts[RANDOM][3]).sum()


@BOX
def test_frozen_sweep_equals_the_oracle(box):
    """What fix shardlow does, with the same noise in the same order of pairs."""
    scene = energy_fluid(box)
    engine = prepared(scene, "shardlow")
    u = scene.internal.energies(scene.type_ids, scene.type_names)
    theta = u.sum(axis=1) / np.array([EOS[t].capacity for t in scene.types])
    coefficients, (motion, heat) = matrices(scene), noise_matrices(scene.n_beads)
    coefficients.pop("A")
    expected = oracle.shardlow_energy_sweep(
        scene.positions, scene.velocities, u[:, 0], u[:, 1], theta, listed_pairs(engine, 0), scene.type_ids, scene.bead_masses, **coefficients,
        box=box, k_B=1.0, dt=DT, xi=motion, xi_q=heat,
    )  # fmt: skip
    change = engine.sweep(scene.velocities, 1.0, DT, SEED, COUNTER, u)
    close(scene.velocities + change, expected.v)
    close(u + engine.increments, np.column_stack([expected.u_cond, expected.u_mech]))


@pytest.mark.parametrize("scheme", ["middle", "shardlow"])
@pytest.mark.parametrize("dt", [1e-4, 0.02, 3.0])
@BOX
def test_a_sweep_conserves_energy_and_momentum(box, dt, scheme):
    table = {key: EnergyDPD(A=c.A, sigma=c.sigma, kappa=0.1 * c.kappa, cutoff=c.cutoff) for key, c in ENERGY.items()}
    scene = energy_fluid(box, table=table)
    engine, v, mass = prepared(scene, scheme, dt), scene.velocities, scene.bead_masses
    u = scene.internal.energies(scene.type_ids, scene.type_names)
    change = engine.sweep(v, 1.0, dt, SEED, COUNTER, u)
    kinetic = [0.5 * mass @ np.sum(w**2, axis=1) for w in (v, v + change)]
    assert abs(kinetic[1] - kinetic[0] + engine.increments.sum()) < 1e-13 * (kinetic[0] + u.sum())
    assert abs(engine.increments[:, 0].sum()) < 1e-14 * u.sum()
    assert np.abs(mass @ change).max() < 1e-13 * mass @ np.abs(v).sum(axis=1)
    assert np.abs(engine.increments).max() > 1e-4 * dt


def test_small_steps_of_both_forms_agree():
    """A sweep over a time dt is dt times the rates to first order, noise included to order sqrt(dt)."""
    scene = energy_fluid(BOXES["ortho"])
    u, v, dt = scene.internal.energies(scene.type_ids, scene.type_names), scene.velocities, 1e-8
    engine = prepared(scene, "middle")
    force = engine.forces(DISSIPATIVE | RANDOM, v, 1.0, dt, SEED, COUNTER, u)[1]
    rates = engine.rates.copy()
    change = engine.sweep(v, 1.0, dt, SEED, COUNTER, u)
    np.testing.assert_allclose(change, dt * force / scene.bead_masses[:, None], atol=3e-3 * np.abs(change).max())
    np.testing.assert_allclose(engine.increments, dt * rates, atol=3e-3 * np.abs(engine.increments).max())


# -- what the exact update samples -----------------------------------------------------------------------------------------------------
COPIES = 20


def cluster(eos, n=6, kappa=0.5, theta=1.0, copies=COPIES, **options):
    """Beads of two masses, all within reach of each other and at rest in space: only the sweep acts.  Far apart there are as many again, and again."""
    x = np.random.default_rng(3).uniform(0, 0.5, (n, 3)) + 10.0 * np.arange(copies)[:, None, None] * [1, 0, 0]
    table = {("*", "*"): EnergyDPD(sigma=2.0, kappa=kappa, cutoff=1.5)}
    beads = {"internal": InternalEnergy(eos, theta), "velocities": np.zeros((n * copies, 3))}
    return dpd.Scene(MASSES, ["A", "B"] * (n // 2 * copies), x.reshape(-1, 3), table, 1.0, **beads, **options)


def sampled(scene, scheme, dt, sweeps, thin):
    """Energy of bead 0 and kinetic energy after every ``thin`` sweeps, one cluster after the other; the energy of a cluster."""
    engine = prepared(scene, scheme, dt)
    u, v = scene.internal.energies(scene.type_ids, scene.type_names), scene.velocities.copy()
    rows, sums = [], np.arange(0, len(u), len(u) // COPIES)
    kinetic = lambda: np.add.reduceat(0.5 * scene.bead_masses * np.sum(v**2, axis=1), sums)  # noqa: E731
    for k in range(20 * thin + sweeps // COPIES):
        v += engine.sweep(v, 1.0, dt, SEED, k, u)
        u = u + engine.increments
        if k % thin == 0 and k > 20 * thin:
            rows.append((u[sums].sum(axis=1), kinetic()))
    energy = np.add.reduceat(u.sum(axis=1), sums) + kinetic()
    assert energy == pytest.approx(energy[0], rel=1e-10) or scene.mobile is not None
    return np.array(rows).transpose(1, 2, 0).reshape(2, -1), energy[0]


@pytest.mark.parametrize("dt", [0.1, 5.0])
@pytest.mark.parametrize("capacity", [2.0, 6.0, 60.0])
def test_exact_sweep_samples_the_microcanonical_distribution(capacity, dt):
    """u of a bead and K follow beta distributions: weight u^C for each bead, and 3N - 6 velocities (total and angular momentum stay 0).

    Kolmogorov-Smirnov test of 1,000 nearly independent samples (u forgets itself in 40 sweeps since the conductivity grows with the
    capacity); fails at about 4 sigma (p < 6e-5).
    """
    n = 6
    (u, kinetic), energy = sampled(cluster(ConstantHeatCapacity(capacity), kappa=capacity / 4), "middle", dt, 4000 * 10, 10)
    assert energy == pytest.approx(n * capacity, rel=1e-11)
    motion = (3 * n - 6) / 2
    expected = {"u": stats.beta(capacity + 1, (n - 1) * (capacity + 1) + motion), "K": stats.beta(motion, n * (capacity + 1))}
    for name, values in (("u", u), ("K", kinetic)):
        # every 4th row: neighbouring rows still remember each other a little
        p = stats.kstest(values[::4] / energy, expected[name].cdf).pvalue
        assert p > 6e-5, (name, p)


def test_the_distribution_test_can_fail():
    """It distinguishes the weight u^C from u^(C-1)."""
    (u, _), energy = sampled(cluster(ConstantHeatCapacity(2.0)), "middle", 1.0, 40_000, 10)
    assert stats.kstest(u[::4] / energy, stats.beta(2, 10 + 6).cdf).pvalue < 1e-8


def test_exact_sweep_with_a_table():
    """Any equation of state: u = theta^2 (S = 2 sqrt(u)) for one type, constant capacity for the other, against a direct integral."""
    low, high = 0.05, 8.0
    eos = {"A": TabulatedEOS.from_functions(lambda theta: 3 * theta**2, (low, high)), "B": ConstantHeatCapacity(4.0)}
    n = 4
    (u, _), energy = sampled(cluster(eos, n), "middle", 1.0, 60_000, 10)
    # marginal of bead 0: exp(S(u)) times the number of states of the rest, which is a convolution on a grid
    grid = np.linspace(0, energy, 4001)[1:]
    table = np.where(grid >= 3 * low**2, np.exp(2 * np.sqrt(3 * np.maximum(grid, 0))), 0.0)
    constant, motion = grid**4.0, grid ** ((3 * n - 6) / 2 - 1)
    rest = motion
    for weight in (table, constant, constant):
        rest = np.convolve(rest, weight)[: len(grid)]
        rest = rest / rest.max()
    density = table[:-4] * rest[::-1][4:]  # grid points are cells: the total of four cells lies two cells below the sum of their upper ends
    cdf = np.cumsum(density) / density.sum()
    p = stats.kstest(u[::4], lambda value: np.interp(value, grid[:-4], cdf)).pvalue
    assert p > 6e-5, p


def _update(ev, im, ui, uj, strength, dt, xi, drawn, states, curves):
    return any_motion(ev, im, ui, uj, strength, dt, xi, drawn, states, curves)


@pytest.mark.parametrize("capacities, numbers", [((40.0, 15.0), (CONSTANT, CONSTANT)), ((0.0, 4.0), (0, CONSTANT)), ((0.0, 0.0), (0, 0))])
def test_the_temperature_of_an_exact_update_is_that_of_its_reverse(capacities, numbers):
    """It depends on the conserved energy of the pair alone, or there is no detailed balance: from two updates of one state with known noise."""
    tabulated = TabulatedEOS.from_functions(lambda theta: 3 * theta**2, (0.05, 8.0))
    table = eos_table([tabulated], np.zeros(1, int), np.zeros(1, bool), np.ones(1))
    im, strength, dt = 1.5, 3.0, 0.4

    def temperature(ev, ui, uj):
        still, moved = move(ev, ui, uj, 0.0)[0], move(ev, ui, uj, 1.0)[0]
        lost = 1.0 - still / ev
        return (moved - still) ** 2 / (lost * (2.0 - lost) * im)

    update, states, curves = compiled(_update, kept=False), (*capacities, *numbers), (table.start, table.nodes, table.pieces)
    move = lambda ev, ui, uj, xi: update(ev, im, ui, uj, strength, dt, xi, 0.0, states, curves)  # noqa: E731
    for ev, ui, uj in ((1.3, 30.0, 12.0), (-2.5, 8.0, 20.0)):
        new, gain = move(ev, ui, uj, -0.7)
        assert gain != 0.0
        assert temperature(new, ui + gain, uj + gain) == pytest.approx(temperature(ev, ui, uj), rel=1e-9)


@compiled
def _heat(ui, uj, exchange, xi, drawn, states, curves):
    return any_conduction(ui, uj, exchange, xi, drawn, states, curves)


@pytest.mark.parametrize("capacities, numbers", [((40.0, 15.0), (CONSTANT, CONSTANT)), ((0.0, 15.0), (0, CONSTANT)), ((0.0, 0.0), (0, 0))])
def test_heat_goes_on_to_others(capacities, numbers):
    """A sweep takes away as much of a difference, and adds as much noise, as the formulas of :mod:`openmm_dpd.kernels.exchange` say, with
    b = -S'' at equal temperatures: S' = C/u, or (3/u)^(1/2) for u = 3 theta^2."""
    tabulated = TabulatedEOS.from_functions(lambda theta: 3 * theta**2, (0.05, 8.0))
    table = eos_table([tabulated], np.zeros(1, int), np.zeros(1, bool), np.ones(1))
    slopes = [lambda u, c=c, k=k: c / u if k == CONSTANT else (3 / u) ** 0.5 for c, k in zip(capacities, numbers, strict=True)]
    bends = [lambda u, c=c, k=k: c / u**2 if k == CONSTANT else (0.75 / u**3) ** 0.5 for c, k in zip(capacities, numbers, strict=True)]
    total, excess = 60.0, 2.5
    share = optimize.brentq(lambda u: slopes[0](u) - slopes[1](total - u), 1.0, total - 1.0, xtol=1e-13)
    bi, bj = bends[0](share), bends[1](total - share)
    e, moving = 0.8 / (bi + bj), 0.3
    wi, wj, y, s = 3.0 * e, 4.0 * e, 0.8, moving / slopes[0](share)
    others = (bi**2 * (wi - e) + bj**2 * (wj - e)) / (bi + bj)
    every = y + others
    lost = y * (1 - y / every * (1 - (1 - np.exp(-every)) / every / (1 + s * others)))
    width = np.sqrt(lost * (2 - lost) / (bi + bj))
    for xi, change in ((0.0, -lost * excess), (-0.7, -lost * excess - 0.7 * width), (total / width, 0.0), (-total / width, 0.0)):
        # nothing, if one bead had to give more than it has
        found = _heat(share + excess, total - share - excess, (e, wi, wj, moving), xi, 0.0, (*capacities, *numbers), table.curves)
        assert found == pytest.approx(change, rel=1e-3 if 0 in numbers else 1e-12)


def test_threads_give_the_same_bits():
    scene = energy_fluid(BOXES["wide"])
    u = scene.internal.energies(scene.type_ids, scene.type_names)
    results = []
    for threads in (1, 2):
        set_threads(threads)
        engine = prepared(scene, "middle")
        force = engine.forces(7, scene.velocities, 1.0, DT, SEED, COUNTER, u)[1]
        rates = engine.rates.copy()
        results.append((force, rates, engine.sweep(scene.velocities, 1.0, DT, SEED, COUNTER, u), engine.increments.copy()))
    for one, two in zip(*results, strict=True):
        np.testing.assert_array_equal(one, two)


def test_factors_act_on_forces_and_their_heat():
    """f on A, f on sigma^2 (so that friction and noise stay in balance), nothing on conduction; energy stays conserved."""
    scene = energy_fluid(BOXES["ortho"], make=chains)
    engine, v, mass = prepared(scene, "middle"), scene.velocities, scene.bead_masses
    u = scene.internal.energies(scene.type_ids, scene.type_names)
    change = engine.sweep(v, 1.0, DT, SEED, COUNTER, u)
    kinetic = [0.5 * mass @ np.sum(w**2, axis=1) for w in (v, v + change)]
    assert abs(kinetic[1] - kinetic[0] + engine.increments.sum()) < 1e-13 * (kinetic[0] + u.sum())


# -- walls and errors ---------------------------------------------------------------------------------------------------------------------
def test_a_wall_is_a_reservoir():
    """Beads in contact with immobile ones of theta = 2 get that temperature: u of a bead follows the gamma distribution of theta = 2."""
    mobile = np.arange(6 * COPIES) % 6 < 1
    scene = cluster(ConstantHeatCapacity(6.0), theta=np.where(mobile, 1.0, 2.0), mobile=mobile)
    (u, kinetic), _ = sampled(scene, "middle", 0.5, 60_000, 10)
    assert stats.kstest(u[::4], stats.gamma(7.0, scale=2.0).cdf).pvalue > 6e-5
    assert stats.kstest(kinetic[::4], stats.gamma(1.5, scale=2.0).cdf).pvalue > 6e-5


def test_energy_out_of_range_names_the_bead():
    """Euler conduction overshoots at large steps; the run stops there."""
    table = {("*", "*"): EnergyDPD(sigma=2.0, kappa=500.0, cutoff=1.5)}
    scene = replace(cluster(ConstantHeatCapacity(2.0), copies=1), pairs=table)
    engine = prepared(scene, "shardlow", 5.0)
    u = scene.internal.energies(scene.type_ids, scene.type_names)
    message = r"internal energy -\S+ kJ/mol of bead \d after the sweep is outside"
    raises(dpd.RunError, message, engine.sweep, scene.velocities, 1.0, 5.0, SEED, COUNTER, u)


@cases(
    "change, message",
    ({"internal": None}, "need internal=InternalEnergy"),
    ({"internal": InternalEnergy(EOS, 0.0)}, "bead 0 is 0; it must be > 0"),
    ({"internal": InternalEnergy({"A": EOS["A"]}, 1.0)}, "no equation of state for bead type B"),
    ({"internal": InternalEnergy(TabulatedEOS([1, 2], [1, 2]), 3.0)}, "3 of bead 0 is outside its equation of state"),
)
def test_bad_internal_energies(change, message):
    raises(dpd.ParameterError, message, lambda: fluid(table=ENERGY, box=BOXES["ortho"], **change))


@compiled
def _logarithm(ratio):
    return log_ratio(ratio, 1.0)


def test_logarithms_of_ratios():
    """Near 1 by the series alone, and far from it by roots."""
    for logarithm in (*np.linspace(-0.3, 0.3, 60), *np.linspace(-60.0, 60.0, 60)):
        ratio = np.exp(logarithm)
        assert _logarithm(ratio) == pytest.approx(np.log(ratio), rel=1e-14)


def test_bad_equations_of_state():
    raises(dpd.ParameterError, "must be a single number > 0", lambda: ConstantHeatCapacity(0.0))
    with pytest.raises(dpd.ParameterError, match=r"energies .* must increase; entry 3 \(1.5\) is not above entry 2 \(2\)"):
        TabulatedEOS([1, 2, 3], [1, 2, 1.5])
    raises(dpd.ParameterError, "does not invert energy", lambda: TabulatedEOS.from_functions(lambda theta: theta, (1, 2), lambda u: 2 * u))
