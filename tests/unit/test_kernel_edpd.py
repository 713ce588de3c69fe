"""eDPD: forces and heat against the oracle, ranges, factors, walls, noise and errors."""

import numpy as np
import oracle_meso as oracle
import pytest
from kernel_answers import COUNTER, DT, PARTS, SEED, close, noise_matrices, prepared, same_terms, scaled_by
from marks import BOX
from raising import raises
from scenes import BOXES, MASSES, chains, fluid, noise_of

import openmm_dpd as dpd
from openmm_dpd.kernels.edpd import clamped
from openmm_dpd.kernels.engine import CONSERVATIVE, DISSIPATIVE, RANDOM
from openmm_dpd.model.edpd import EDPD
from openmm_dpd.model.internal import BeadTemperatures

COMPAT = pytest.mark.parametrize("compat", ["consistent", "lammps"])
_POLYNOMIALS = {"exponent_polynomial": (0.5, -0.3, 0.8, 0.2), "kappa_polynomial": (0.5, -0.3, 0.2, 0.1)}
_WIDE = {"cutoff": 1.2, "cutoff_T": 0.8, "exponent": 0.41, "exponent_T": 1.0, "exponent_polynomial": (-3.0, 0, 0, 0)}
#: Conduction reaches further than the forces, less far, and as far; the exponent of AB falls to its smallest value where it is warm.
TABLE = {
    ("A", "A"): EDPD(A=25, gamma=4.5, kappa=0.7, cutoff=1.0, cutoff_T=1.2, **_POLYNOMIALS),
    ("A", "B"): EDPD(A=31, gamma=2, kappa=0.2, **_WIDE),
    ("B", "B"): EDPD(A=18, gamma=9, kappa=1.3, cutoff=0.9, exponent=1.2, exponent_T=3.0, kappa_polynomial=(-0.2, 0.4, 0, 0.3)),
}


def warm_fluid(box=BOXES["ortho"], *, make=fluid, table=TABLE, seed=5, **options) -> dpd.Scene:
    """Temperatures from 0.6 to 1.8 and heat capacities from 2 to 5."""
    rng, n = np.random.default_rng(seed), make(box=box).n_beads
    return make(table=table, box=box, internal=BeadTemperatures(rng.uniform(0.6, 1.8, n), rng.uniform(2.0, 5.0, n)), **options)


def evaluate(scene, which, v=None, counter=COUNTER, engine=None):
    """Energy, forces, virial and heat (N,) into each bead."""
    engine = engine or prepared(scene)
    temperature = scene.internal.values(scene.n_beads)
    energy, force, virial = engine.forces(which, scene.velocities if v is None else v, 1.0, DT, SEED, counter, temperature)
    return energy, force, virial, engine.rates[:, 0] * scene.internal.heat_capacities(scene.n_beads)


def oracle_rates(scene, compat="consistent", masses=None) -> oracle.EdpdRates:
    names, n = scene.type_names, scene.n_beads
    entries = scene.tables[0].resolve(names)
    term = lambda a, b: entries[(names[min(a, b)], names[max(a, b)])]  # noqa: E731
    get = lambda key: np.array([[getattr(term(a, b), key) for b in range(len(names))] for a in range(len(names))])  # noqa: E731
    motion, heat = noise_matrices(n, SEED, COUNTER)
    return oracle.edpd_pair(
        scene.positions, scene.velocities, scene.internal.values(n)[:, 0], scene.internal.heat_capacities(n), scene.type_ids,
        scene.bead_masses if masses is None else masses, get("A"), get("gamma"), get("exponent"), get("cutoff"), get("kappa"),
        get("exponent_T"), get("cutoff_T"), scene.box, DT, xi=motion, xi_T=None if compat == "lammps" else heat,
        power_coeffs=get("exponent_polynomial"), kappa_coeffs=get("kappa_polynomial"), compat=compat,
    )  # fmt: skip


def pair_of_beads(f=1.0, distance=0.5, compat="consistent", **changes) -> dpd.Scene:
    """Two bonded beads of unequal mass, temperature and capacity; ``f`` is their factor."""
    values = {"A": 25, "gamma": 4.5, "kappa": 0.7, "exponent": 1.4} | changes
    x, v = np.array([[0.0, 0, 0], [0.6 * distance, 0, -0.8 * distance]]), np.array([[0.3, 1.0, -0.2], [-0.5, 0.4, 0.9]])
    bonds = [dpd.HarmonicBonds(np.array([[0, 1]]), 0.0, 0.5)]
    internal = BeadTemperatures(np.array([0.8, 1.7]), np.array([2.0, 5.0]))
    options = {"velocities": v, "internal": internal, "bonds": bonds, "bonded_factors": (f, 1, 1), "compat": compat}
    return dpd.Scene(MASSES, ["A", "B"], x, {("*", "*"): EDPD(**values)}, 1.0, **options)


# -- the oracle ---------------------------------------------------------------------------------------------------------------------------
@COMPAT
@BOX
def test_forces_and_heat_equal_the_oracle(box, compat):
    scene = warm_fluid(box, compat=compat)
    expected = oracle_rates(scene, compat)
    engine, terms = prepared(scene), expected.terms
    got = {which: evaluate(scene, which, engine=engine) for which in PARTS}
    same_terms([got[which] for which in PARTS], terms)
    assert not got[CONSERVATIVE][3].any()
    close(got[DISSIPATIVE][3], expected.q_conductive + expected.q_viscous_deterministic)
    close(got[RANDOM][3], expected.q_random + expected.q_viscous_random)
    _, force, _, heat = evaluate(scene, sum(PARTS), engine=engine)  # all at once
    close(force, terms.forces)
    close(heat, expected.q)


@COMPAT
def test_heat_and_forces_have_ranges_of_their_own(compat):
    """Heat range shorter and longer than the forces', in a fluid of one type; the list reaches as far as the longer."""
    for ranges in ({"cutoff": 1.2, "cutoff_T": 0.7}, {"cutoff": 0.7, "cutoff_T": 1.2}):
        scene = warm_fluid(table={("*", "*"): EDPD(A=25, gamma=4.5, kappa=0.7, **ranges)}, compat=compat)
        expected = oracle_rates(scene, compat)
        close(evaluate(scene, sum(PARTS))[1], expected.terms.forces)
        close(evaluate(scene, sum(PARTS))[3], expected.q)
    # two beads between the ranges
    short, long = (pair_of_beads(compat=compat, **ranges) for ranges in ({"cutoff_T": 0.4}, {"cutoff": 0.4, "cutoff_T": 1.0}))
    _, force, _, heat = evaluate(short, sum(PARTS))
    assert np.abs(force).max() > 1 and heat[0] == heat[1] and (heat[0] == 0) == (compat == "lammps")
    energy, force, virial, heat = evaluate(long, sum(PARTS))
    assert energy == virial == 0 and not force.any() and heat[0] == -heat[1] and (heat[0] == 0) == (compat == "lammps")


def test_conduction_loses_no_heat_and_viscous_heat_is_the_work_of_the_forces():
    """At rest in space the noise only conducts; in motion it heats by what its forces take.  Factors of neighbours included."""
    scene = warm_fluid(make=chains)
    at_rest, moving = (evaluate(scene, RANDOM, v=v) for v in (0 * scene.velocities, scene.velocities))
    assert abs(at_rest[3].sum()) < 1e-12 * np.abs(at_rest[3]).sum()
    assert np.abs(at_rest[3]).max() > 0.1
    assert moving[3].sum() == pytest.approx(-np.sum(scene.velocities * moving[1]), rel=1e-10)
    # deterministic: what friction takes, less what the kicks give on average, which does not depend on the velocities
    at_rest, moving = (evaluate(scene, DISSIPATIVE, v=v) for v in (0 * scene.velocities, scene.velocities))
    assert moving[3].sum() - at_rest[3].sum() == pytest.approx(-np.sum(scene.velocities * moving[1]), rel=1e-10)
    assert at_rest[3].sum() < -1.0
    for part in PARTS:
        force = evaluate(scene, part)[1]
        assert np.abs(force.sum(axis=0)).max() < 1e-12 * np.abs(force).sum()


@pytest.mark.parametrize("f", [0.25, 0.81])
def test_factors(f):
    """Repulsion and friction have f, noise its square root, viscous heat what its forces have, and conduction none."""
    plain, scaled = pair_of_beads(), pair_of_beads(f)
    for which, factor in ((CONSERVATIVE, f), (DISSIPATIVE, f), (RANDOM, np.sqrt(f))):
        one, other = evaluate(plain, which), evaluate(scaled, which)
        scaled_by(factor, one, other)
        assert other[3].sum() == pytest.approx(factor * one[3].sum(), rel=1e-12)
        assert np.diff(other[3]) == pytest.approx(np.diff(one[3]), rel=1e-12)


@COMPAT
def test_walls_have_infinite_mass(compat):
    mobile = np.arange(warm_fluid().n_beads) % 3 > 0
    scene = warm_fluid(compat=compat, mobile=mobile)
    expected = oracle_rates(scene, compat, masses=np.where(mobile, scene.bead_masses, np.inf))
    close(evaluate(scene, DISSIPATIVE)[3], expected.q_conductive + expected.q_viscous_deterministic)


# -- noise --------------------------------------------------------------------------------------------------------------------------------
def many_pairs(compat="consistent", n=5000) -> dpd.Scene:
    """Isolated pairs of beads 0.45 apart, all at T = 1.2 with capacities 2 and 3: every pair is one sample."""
    corner = 4.0 * np.array(list(np.ndindex(25, 20, 10)))
    x = np.concatenate([corner, corner + [0.27, 0.0, 0.36]])
    internal = BeadTemperatures(1.2, np.repeat([2.0, 3.0], n))
    table = {("*", "*"): EDPD(A=0, gamma=4.5, kappa=0.7, exponent=1.4, exponent_T=2.0, cutoff_T=0.9)}
    options = {"internal": internal, "velocities": np.zeros((2 * n, 3)), "compat": compat}
    return dpd.Scene(MASSES, ["A"] * n + ["B"] * n, x, table, 1.2, box=[100.0, 80.0, 40.0], **options)


def drawn_noise(scene, calls=20):
    """Force along the axis and heat of the first bead of each pair, (calls, n)."""
    n, engine = scene.n_beads // 2, prepared(scene)
    results = [evaluate(scene, RANDOM, counter=k, engine=engine) for k in range(calls)]
    axis = np.array([-0.6, 0.0, -0.8])
    return np.array([force[:n] @ axis for _, force, _, _ in results]), np.array([heat[:n] for *_, heat in results])


def test_noise_has_the_right_variance_and_heat_is_independent_of_motion():
    """100,000 samples: standard errors sqrt(2/n) of a variance, 1/sqrt(n) of a mean over its sigma and of a correlation; 4 of them fail."""
    force, heat = drawn_noise(many_pairs())
    n = force.size
    w, w_T, strength = 1 - 0.45, 1 - 0.45 / 0.9, 2 * 3 * 0.7 * 1.2**2
    for values, variance in ((force, 2 * 4.5 * 1.2 * w**1.4 / DT), (heat, 2 * strength * w_T**2 / DT)):
        assert abs(values.var() / variance - 1) < 4 * np.sqrt(2 / n)
        assert abs(values.mean()) < 4 * np.sqrt(variance / n)
    for first, second in ((force, heat), (heat[1:], heat[:-1]), (force[1:], heat[:-1]), (heat[:, 1:], heat[:, :-1])):
        assert abs(np.corrcoef(first.ravel(), second.ravel())[0, 1]) < 4 / np.sqrt(first.size)
    assert abs(np.corrcoef(force.ravel() ** 2, heat.ravel() ** 2)[0, 1]) < 4 / np.sqrt(n)  # no hidden dependence of the amplitudes either


def test_lammps_uses_the_noise_of_the_motion_for_the_heat():
    force, heat = drawn_noise(many_pairs("lammps"), calls=2)
    assert np.corrcoef(force.ravel(), heat.ravel())[0, 1] == pytest.approx(1.0, abs=1e-12)
    assert heat.var() == pytest.approx(drawn_noise(many_pairs(), calls=2)[1].var(), rel=4 * np.sqrt(4 / heat.size))


@pytest.mark.parametrize(("stream", "counter"), [(1, 3855336), (0, 5166690)])
def test_noise_of_the_heat_is_cut_at_five(stream, counter):
    """At these counts of the noise the number of the pair is beyond 5: it happens once in 1.7 million draws."""
    xi = noise_of(2, SEED, counter, 1.0)(0, 1, stream)
    assert abs(xi) > 5.05
    scene = pair_of_beads(compat="lammps" if stream == 0 else "consistent")
    _, force, _, heat = evaluate(scene, RANDOM, v=np.zeros((2, 3)), counter=counter)
    close(heat, np.sqrt(2 * 2 * 5 * 0.7 * 1.25**2 / DT) * 0.5 * np.sign(xi) * 5 * np.array([1, -1]))
    if stream == 0:
        theta = 2 / (1 / 0.8 + 1 / 1.7)
        assert np.linalg.norm(force[0]) == pytest.approx(np.sqrt(2 * 4.5 * theta * 0.5**1.4 / DT) * abs(xi), rel=1e-12)


def test_clamped():
    assert [clamped(value) for value in (-7.0, -5.0, 0.3, 5.0, 9.0)] == [-5.0, -5.0, 0.3, 5.0, 5.0]


# -- errors -------------------------------------------------------------------------------------------------------------------------------
@pytest.mark.parametrize("value", [0.0, -0.4, np.nan])
def test_a_temperature_must_stay_positive(value):
    scene = warm_fluid()
    temperature = scene.internal.values(scene.n_beads)
    temperature[[17, 30]] = value
    with pytest.raises(dpd.RunError, match=rf"temperature of bead 17 is {value:g}; it must be > 0"):
        prepared(scene).forces(sum(PARTS), scene.velocities, 1.0, DT, SEED, COUNTER, temperature)


def test_a_negative_conduction_coefficient_names_the_temperature():
    """At T_m = 1.25 it is 0.7 (1 - 8/4) = -0.7; without conduction nothing is wrong."""
    scene = pair_of_beads(kappa_polynomial=(-8.0, 0, 0, 0))
    evaluate(scene, CONSERVATIVE)
    for which in (DISSIPATIVE, RANDOM):
        raises(dpd.RunError, r"conduction coefficient is -0.7 at the temperature 1.25 of beads (0 and 1|1 and 0)", evaluate, scene, which)
    evaluate(pair_of_beads(kappa=0.0, kappa_polynomial=(-8.0, 0, 0, 0)), DISSIPATIVE)


def test_there_is_no_sweep_and_no_laplacian():
    scene = pair_of_beads()
    engine = prepared(scene)
    assert np.isnan(engine.laplacian())
    raises(dpd.RunError, "only the scheme mvv", lambda: engine.sweep(scene.velocities, 1.0, DT, SEED, COUNTER, scene.internal.values(2)))
