"""Viscosities from made-up profiles and stress series with known answers, and the stress tensor of pairs."""

import numpy as np
import pytest
from cases import cases, raises, refused
from openmm import unit
from scenes import beads, chains, fluid, ready

import openmm_dpd as dpd
from openmm_dpd.analysis import VelocityProfile, couette_viscosity, green_kubo_viscosity, poiseuille_viscosity
from openmm_dpd.base.errors import ParameterError
from openmm_dpd.kernels.engine import CONSERVATIVE, DISSIPATIVE, RANDOM, STRESS, PairEngine
from openmm_dpd.measure import ProfileReporter, StressReporter


# -- the stress tensor ---------------------------------------------------------------------------------------------------------
@pytest.mark.parametrize("which", [CONSERVATIVE, DISSIPATIVE, RANDOM])
def test_stress_of_pairs(which):
    """Against r_ij F_ij of all pairs, one pair at a time; its trace is the virial, and forces and energy are those without it."""
    scene = fluid(n=40, table={("*", "*"): dpd.DPD(A=25, gamma=4.5, exponent=0.7)})
    engine = ready(PairEngine(dpd.make_plan(scene, dt=0.01, platform="CPU").spec), scene.positions, scene.box)
    plain = engine.forces(which, scene.velocities, 1.0, 0.01, 3, 5)
    forces = np.empty_like(scene.positions)
    with_stress = engine.sums(which | STRESS, scene.velocities, 1.0, 0.01, 3, 5, None, forces)
    assert np.array_equal(plain[1], forces) and plain[0] == with_stress.energy and plain[2] == with_stress.virial
    stress = with_stress.stress
    assert stress[:3].sum() == pytest.approx(plain[2], rel=1e-12)
    expected = np.zeros((3, 3))
    edges = np.diag(scene.box)
    types = scene.type_ids
    for i in range(40):
        for j in range(i + 1, 40):
            r = scene.positions[i] - scene.positions[j]
            r -= edges * np.rint(r / edges)
            distance = np.linalg.norm(r)
            if distance >= 1.0:
                continue
            if which == RANDOM:
                spec = engine.spec  # the force of one pair: that of the engine for these two beads alone, the others out of the way
                kept = np.where(np.isin(np.arange(40), [i, j]), types, -1).astype(np.int32)
                alone = ready(PairEngine(type(spec)(kept, spec.inv_mass, spec.terms)), scene.positions, scene.box)
                force = alone.forces(which, scene.velocities, 1.0, 0.01, 3, 5)[1][i]
            else:
                w, e = 1 - distance, r / distance
                force = 25 * w * e if which == CONSERVATIVE else -4.5 * w**1.4 * np.dot(e, scene.velocities[i] - scene.velocities[j]) * e
            expected += np.outer(r, force)
    np.testing.assert_allclose(stress, expected[[0, 1, 2, 0, 0, 1], [0, 1, 2, 1, 2, 2]], rtol=1e-9, atol=1e-9)


def test_reporter_adds_kinetic_and_bond_parts():
    """The trace is three times the conservative pressure times the volume that the Observer measures."""
    scene = chains(k=30.0, bonded_factors=(1.0, 1.0, 1.0), table={("*", "*"): dpd.DPD(A=25, gamma=4.5)})
    built = dpd.build(scene, dt=0.001, scheme="mvv", platform="Reference", seed=1)
    simulation = built.simulation()
    reporter = StressReporter(1, built)
    for _ in range(2):
        reporter.report(simulation, None)
    sample = dpd.Observer(built).sample(simulation.context)
    assert reporter.regular.shape == reporter.friction.shape == (2, 6)
    assert reporter.regular[0, :3].sum() == pytest.approx(3 * sample.pressure(full=False) * sample.volume, rel=1e-9)
    assert reporter.friction[0, :3].sum() == pytest.approx(sample.virial_dissipative, rel=1e-9)


def test_instantaneous_viscosity_is_the_stress_of_a_shear():
    """Of an affine shear, averaged over its six directions that are independent; by hand for one pair along the diagonal."""
    built = dpd.build(beads(2, positions=np.array([[1.0, 1, 1], [1.3, 1.3, 1.3]])), dt=0.01, platform="Reference", seed=1)
    reporter = StressReporter(1, built)
    reporter.report(built.simulation(), None)
    r = 0.3 * np.sqrt(3)
    assert reporter.instantaneous == pytest.approx(4.5 * (1 - r) ** 2 * r**2 / 15 / 27, rel=1e-9)


STILL, WARM = np.zeros((81, 3)), {("W", "W"): dpd.EDPD(A=18.75, gamma=4.5, kappa=1e-3)}


@cases(
    "scene, message",
    (beads(box=None), "no periodic box"),
    (beads(table={("W", "W"): dpd.DPD(A=25, gamma_perp=1)}), "asymmetric"),
    (beads(table=WARM, internal=dpd.BeadTemperatures(np.ones(81), 100.0), velocities=STILL), "energies, temperatures"),
)
def test_refused_scenes(scene, message):
    raises(dpd.ParameterError, message, StressReporter, 1, dpd.build(scene, dt=0.01, scheme="mvv", platform="Reference"))


# -- Green-Kubo ----------------------------------------------------------------------------------------------------------------
def correlated(n: int, tau: float, amplitude: float, seed: int) -> np.ndarray:
    """(n, 6) tensors whose five independent components are series with the correlation amplitude^2 exp(-t/tau)."""
    rng, keep = np.random.default_rng(seed), np.exp(-1 / tau)
    noise = rng.normal(size=(n, 5)) * amplitude * np.sqrt(1 - keep**2)
    series = np.empty((n, 5))
    series[0] = rng.normal(size=5) * amplitude
    for k in range(1, n):
        series[k] = keep * series[k - 1] + noise[k]
    a, b = series[:, 3], series[:, 4] / np.sqrt(3)
    return np.stack([a - b, -a - b, 2 * b, *series[:, :3].T], axis=1) + [7, 7, 7, 0, 0, 0]


def test_green_kubo_of_an_exponential():
    """Integral amplitude^2 tau/(V kT), here 4 * 20 * 0.01/(8 * 0.5) = 0.2, and what friction does at once; pressure does not matter."""
    stress = correlated(60000, 20.0, 2.0, 1)
    found = green_kubo_viscosity(stress, 0.01, volume=8.0, kT=0.5, t_max=1.5, instantaneous=0.05)
    assert found.error < 0.015
    assert found.viscosity == pytest.approx(0.25, abs=4 * found.error)
    assert found.integral[0] == 0.05 and found.integral[-1] == pytest.approx(found.viscosity)
    assert found.correlation[0] == pytest.approx(4 / 4, rel=0.1)
    kelvin = green_kubo_viscosity(stress, 0.01, volume=8.0, kT=0.5 / dpd.units.BOLTZMANN * unit.kelvin, t_max=1.5, instantaneous=0.05)
    assert kelvin.viscosity == pytest.approx(found.viscosity, rel=1e-14)
    automatic = green_kubo_viscosity(stress, 0.01, volume=8.0, kT=0.5)
    assert 0.3 < automatic.t_max < 3.0 and automatic.viscosity == pytest.approx(0.2, abs=4 * automatic.error)


def test_friction_enters_with_the_two_signs():
    """With D = c A the correlation is (1 - c)(1 + c) that of A; with a D that lags behind A, what comes later counts with +."""
    stress = correlated(60000, 20.0, 2.0, 2)
    whole = green_kubo_viscosity(stress, 0.01, volume=8.0, kT=0.5, t_max=1.0)
    part = green_kubo_viscosity(stress, 0.01, volume=8.0, kT=0.5, t_max=1.0, friction=0.5 * stress, instantaneous=0)
    assert part.viscosity == pytest.approx(0.75 * whole.viscosity, rel=1e-9)
    for lag, sign in ((30, 1), (-30, -1)):
        white = np.random.default_rng(3).normal(size=(40000, 6))
        friction = 0.3 * np.roll(white, lag, axis=0)
        found = green_kubo_viscosity(white, 0.01, volume=1.0, kT=1.0, t_max=0.5, friction=friction, instantaneous=0)
        # half the variance of the others is in the two components with xx, yy, zz
        assert found.correlation[30] == pytest.approx(0.3 * sign * 0.8, abs=4 / np.sqrt(5 * 40000))


BAD_SERIES = {
    "shape": (lambda: green_kubo_viscosity(np.zeros((500, 5)), 0.1, volume=1, kT=1), "xx, yy, zz"),
    "missing": (lambda: green_kubo_viscosity(np.zeros((500, 6))), "needs dt, volume and kT"),
    "short": (lambda: green_kubo_viscosity(np.zeros((50, 6)), 0.1, volume=1, kT=1), "in 10 blocks"),
    "t_max": (lambda: green_kubo_viscosity(np.zeros((500, 6)), 0.1, volume=1, kT=1, t_max=10.0), "length of a block, 5 ps"),
    "friction": (lambda: known(friction=np.zeros((400, 6)), instantaneous=1.0), "the same number of rows"),
    "no step": (lambda: known(dt=0.0), "dt must be > 0"),
    "no volume": (lambda: known(volume=-1.0), "volume must be > 0"),
    "no temperature": (lambda: known(kT=0.0), "kT must be > 0"),
    "no blocks": (lambda: known(blocks=0), "in 0 blocks"),
    "blocks": (lambda: known(blocks=10.0), "must be a whole number"),
    "half of friction": (lambda: known(friction=np.zeros((500, 6))), "needs its instantaneous viscosity"),
    "instantaneous": (lambda: known(instantaneous=np.nan), "must be a number >= 0, not nan"),
    "channel": (lambda: poiseuille_viscosity(profile(np.sin), 0.1, channel=5.0), "channel must be two lengths"),
    "origin": (lambda: poiseuille_viscosity(profile(np.sin), 0.1, origin=[1.0, 2.0]), "origin must be a single number"),
    "skip": (lambda: couette_viscosity(profile(np.sin), np.zeros(400), channel=(0, 10), skip=-1), "skip must be >= 0"),
}


def known(**values):
    return green_kubo_viscosity(np.zeros((500, 6)), **{"dt": 0.1, "volume": 1, "kT": 1} | values)


test_refused_series = refused(dpd.ParameterError, BAD_SERIES)


# -- Poiseuille ----------------------------------------------------------------------------------------------------------------
def profile(function, bins: int = 20, length: float = 10.0, noise: float = 0.02, n: int = 400, seed: int = 1) -> VelocityProfile:
    """Slabs that average a function exactly, with noise."""
    width = length / bins
    edges = np.arange(bins + 1) * width
    mean = function(edges[:-1, None] + (np.arange(1000) + 0.5) * width / 1000).mean(axis=1)
    rows = mean + noise * np.random.default_rng(seed).normal(size=(n, bins))
    centres = edges[:-1] + width / 2
    errors = np.full(bins, noise / n**0.5), np.full(bins, 3.0)
    return VelocityProfile(centres, width, rows.mean(axis=0), *errors, np.ones(bins), rows, length)


def test_reverse_poiseuille_fit():
    """eta = 0.85, f = 0.05, rho = 3, and a drift of the whole box."""

    def v(z):
        return np.where(z < 5, 1, -1) * 3 * 0.05 / (2 * 0.85) * (z % 5) * (5 - z % 5) + 0.1

    found = poiseuille_viscosity(profile(v), 0.05)
    assert found.error < 0.005 and found.viscosity == pytest.approx(0.85, abs=4 * found.error)
    exact = poiseuille_viscosity(profile(v, noise=1e-9), 0.05)
    assert exact.viscosity == pytest.approx(0.85, rel=1e-6) and exact.slip is None
    shifted = poiseuille_viscosity(profile(lambda z: v((z - 2.5) % 10), noise=1e-9), 0.05, origin=2.5)
    assert shifted.viscosity == pytest.approx(0.85, rel=1e-6)


def test_couette_fit():
    """A line through a channel from 1.5 to 8.5 with a slip of 0.1 at the lower end, slabs near the ends off; errors of rate and stress."""

    def v(z):
        return np.where((z > 2) & (z < 8), 0.2 * (z - 1.5) - 0.9, 5.0)

    stress = 0.17 + 0.03 * np.random.default_rng(2).normal(size=400)
    found = couette_viscosity(profile(v), stress, channel=(1.5, 8.5), skip=0.5)
    assert found.rate == pytest.approx(0.2, abs=4 * found.rate_error) and 0 < found.rate_error < 0.001
    assert found.stress_error == pytest.approx(0.0015, rel=0.2) and found.converged
    assert found.viscosity == pytest.approx(0.85, abs=4 * found.error)
    assert found.error / found.viscosity == pytest.approx(np.hypot(found.stress_error / 0.17, found.rate_error / 0.2), rel=0.05)
    assert found.ends == pytest.approx((-0.9, 0.5), abs=0.005)
    raises(ParameterError, "slabs are too few", couette_viscosity, profile(v), stress, channel=(1.5, 8.5), skip=3.2)
    raises(ParameterError, "not sheared", couette_viscosity, profile(np.zeros_like, noise=0.0), stress, channel=(1.5, 8.5))


def test_channel_fit():
    """Curvature, and both slips, of a channel from 1.5 to 8.5 with 0.2 at one end and 0.1 at the other."""

    def v(z):
        s = z - 1.5
        return 3 * 0.05 / (2 * 0.85) * s * (7 - s) + 0.2 - 0.1 * s / 7

    found = poiseuille_viscosity(profile(v, noise=1e-9), 0.05, channel=(1.5, 8.5), skip=0.5)
    assert found.viscosity == pytest.approx(0.85, rel=1e-6)
    assert found.slip == pytest.approx((0.2, 0.1), abs=1e-6)
    assert np.isnan(found.fitted[[0, 1, 2, 3]]).all() and np.isfinite(found.fitted[4:16]).all()


@cases(
    "make, message",
    (lambda p: poiseuille_viscosity(p, 0), "other than 0"),
    (lambda p: poiseuille_viscosity(p, -0.05), "does not flow along"),
    (lambda p: poiseuille_viscosity(p, 0.05, channel=(4, 5)), "slabs are too few"),
)
def test_refused_profiles(make, message):
    raises(dpd.ParameterError, message, lambda: make(profile(lambda z: np.where(z < 5, 1, -1) * (z % 5) * (5 - z % 5))))


def test_samples_of_a_stress_know_their_steps():
    """Another step size after the last sample changes nothing; samples with two of them, or with a gap, have no time between them."""
    built = dpd.build(beads(81), dt=0.02, scheme="middle", platform="CPU", seed=1)
    simulation, reporter = built.simulation(), StressReporter(2, built)
    raises(ParameterError, "the 0 samples", lambda: reporter.time_step)
    simulation.reporters.append(reporter)
    simulation.step(8)
    simulation.integrator.setStepSize(0.005)
    assert reporter.time_step == pytest.approx(0.04) and reporter.kT == 1.0
    simulation.step(2)
    raises(ParameterError, "5 samples were taken with 2 step sizes from 0.005 to 0.02 ps", green_kubo_viscosity, reporter)
    other = StressReporter(2, built)
    for _ in range(2):
        simulation.reporters[:] = [other]
        simulation.step(4)
        simulation.reporters.clear()
        simulation.step(6)
    raises(ParameterError, "are not evenly spaced, every 0.01 ps", lambda: other.time_step)
    dpd.set_kT(simulation.context, 1.5)
    simulation.reporters[:] = [other]
    simulation.step(2)
    raises(ParameterError, "2 thermal energies from 1 to 1.5 kJ/mol", lambda: other.kT)


def test_a_profile_in_a_box_that_changes():
    """Slabs are parts of the present box."""
    rng = np.random.default_rng(1)
    scene = beads(300, positions=rng.random((300, 3)) * 5, box=[5.0] * 3)
    built = dpd.build(scene, dt=0.02, scheme="middle", platform="Reference", seed=1)
    simulation, reporter = built.simulation(), ProfileReporter(1, built, bins=4)
    edges = [5.0, 4.0]
    for edge in edges:
        simulation.context.setPeriodicBoxVectors(*np.diag([edge] * 3))
        simulation.context.setPositions(rng.random((300, 3)) * edge)
        reporter.report(simulation, None)
    found = reporter.profile
    assert found.length == 4.5 and found.width == 4.5 / 4
    assert found.density.mean() == pytest.approx(np.mean([300 / edge**3 for edge in edges]))


def test_profile_reporter_counts_and_averages():
    """Beads in known slabs with known velocities, some of them outside the box; frozen ones do not count, and what swings is no heat."""
    x = np.array([[0, 0, 0.2], [1.5, 0, 3.3], [0, 1.5, -2.9], [1.5, 1.5, 2.6], [2.9, 2.9, 1.2]])
    v = np.array([[1.0, 0, 0], [3, 0, 0], [2, 0, 0], [0.5, 0, 0], [9, 9, 9]])
    scene = beads(5, positions=x, velocities=v, mobile=np.arange(5) < 4, table={("W", "W"): dpd.DPD(gamma=4.5)})
    built = dpd.build(scene, dt=0.01, scheme="mvv", platform="Reference", seed=1)
    reporter = ProfileReporter(1, built, bins=6)
    raises(dpd.ParameterError, "no sample", lambda: reporter.profile)  # noqa: B018
    simulation = built.simulation()
    for k in range(6):
        simulation.context.setVelocities(v + [0, np.cos(k), 0])
        reporter.report(simulation, None)
    found = reporter.profile
    assert found.velocity[[0, 5]] == pytest.approx([2.0, 0.5]) and np.isnan(found.velocity[[1, 2, 3, 4]]).all()
    assert found.density[0] == pytest.approx(3 / 4.5) and found.kT[0] == pytest.approx(2 / 6)
    assert found.rows.shape == (6, 6) and found.length == 3.0
