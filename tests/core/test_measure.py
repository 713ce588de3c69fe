"""Measured quantities against closed forms, finite differences and the oracle."""

import io

import numpy as np
import oracle
import pytest
from cases import cases, raises
from judged import any_seed, judge
from kinds import everything, made, running, same
from openmm import unit
from scenes import PLAIN, beads, chains, external_force

import openmm_dpd as dpd
from openmm_dpd.measure.stress_parts import bond_sums, stress_parts


def fluid(n: int = 120, edge: float = 3.4, **extra) -> dpd.Scene:
    rng = np.random.default_rng(5)
    pairs = {("A", "A"): dpd.DPD(A=25, gamma=4.5), ("B", "B"): dpd.DPD(A=18, gamma=3, gamma_perp=2)}
    pairs["A", "B"] = dpd.DPD(A=31, gamma=6, cutoff=1.3)
    types = ["A", "B", "B"] * (n // 3)
    settings = {"kT": 1.2, "box": [edge] * 3} | extra
    return dpd.Scene({"A": 1.0, "B": 2.5}, types, rng.random((n, 3)) * edge, pairs, velocities=rng.normal(size=(n, 3)), **settings)


def oracle_parameters() -> oracle.PairParams:
    A, gamma = np.array([[25, 31], [31, 18.0]]), np.array([[4.5, 6], [6, 3.0]])
    across = np.array([[0, 0], [0, 2.0]])
    return oracle.PairParams.build(2, A=A, gamma=gamma, gamma_perp=across, cutoff=np.array([[1, 1.3], [1.3, 1.0]]))


@pytest.mark.parametrize("conservative", ["kernel", "openmm"])
def test_sample_against_the_oracle(conservative):
    scene = fluid()
    # a scheme whose velocities are those of the positions, and count in pressures as they are
    built = dpd.build(scene, dt=0.01, scheme="bababo", platform="Reference", conservative=conservative, seed=3)
    sample = dpd.Observer(built).sample(built.simulation().context)
    mass, v = scene.bead_masses, scene.velocities
    expected = oracle.conservative(scene.positions, scene.type_ids, oracle_parameters(), scene.box)
    assert sample.potential == pytest.approx(expected[0], rel=1e-12)
    assert sample.virial_conservative == pytest.approx(expected[2], rel=1e-12)
    assert sample.laplacian == pytest.approx(expected[3], rel=1e-12)
    assert sample.gradient2 == pytest.approx(np.sum(expected[1] ** 2), rel=1e-12)
    drag = oracle.dissipative(scene.positions, v, scene.type_ids, oracle_parameters(), scene.box)
    assert sample.virial_dissipative == pytest.approx(drag[1], rel=1e-11)
    assert sample.virial_random == 0.0  # where pairs are swept, noise is no force
    kinetic = 0.5 * np.sum(mass[:, None] * v**2)
    assert sample.kinetic == pytest.approx(kinetic)
    assert sample.pressure() == pytest.approx((2 * kinetic + expected[2] + drag[1]) / (3 * 3.4**3), rel=1e-11)
    assert sample.kT == pytest.approx(2 * kinetic / (3 * 120 - 3))
    assert sample.pressure(full=False) == pytest.approx((2 * kinetic + expected[2]) / (3 * 3.4**3))
    np.testing.assert_allclose(sample.momentum, mass @ v)


def test_bond_sums_by_finite_differences():
    x = [[0.1, 0.2, 0.3], [0.9, 0.4, 0.1], [3.9, 0.3, 0.2], [2.0, 2.0, 2.0]]
    bonds = [dpd.HarmonicBonds(np.array([[0, 1], [0, 2]]), [10.0, 20.0], [0.5, 0.2])]
    scene = dpd.Scene({"A": 1.0}, ["A"] * 4, x, {("A", "A"): dpd.NONE}, kT=0, box=[4, 4, 4], bonds=bonds)
    plan = dpd.make_plan(scene, dt=0.01, platform="Reference")
    x, box, all_move = scene.positions, scene.box, np.ones(4, bool)
    energy, laplacian = bond_sums(plan, x, box, all_move)
    virial = sum(part(x, box)[:3].sum() for part in stress_parts(plan))
    h = 1e-4
    scaled = [bond_sums(plan, x * s, box * s, all_move)[0] for s in (1 + h, 1 - h)]
    assert virial == pytest.approx(-(scaled[0] - scaled[1]) / (2 * h), rel=1e-6)
    steps = h * np.eye(12).reshape(12, 4, 3)
    around = [bond_sums(plan, x + step, box, all_move)[0] for step in (*steps, *-steps)]
    assert laplacian == pytest.approx((sum(around) - 24 * energy) / h**2, rel=1e-5)


@pytest.mark.parametrize("coefficient", ["lennard_jones", "table"])
def test_virial_of_partners_by_finite_differences(coefficient):
    """A thermostat over another potential: -r dU/dr from the second force equals the derivative by a scaled box."""
    r = np.linspace(0.5, 1.5, 200)
    table = dpd.TabulatedPair(r, 3 * (1.5 - r) ** 3, forces=9 * (1.5 - r) ** 2)
    partner = table if coefficient == "table" else dpd.LennardJones(epsilon=0.7, sigma=0.5, cutoff=1.5, shift=True)
    grid = np.stack(np.meshgrid(*[np.arange(4.0)] * 3), -1).reshape(-1, 3) * 0.9 + 0.1 * np.random.default_rng(2).random((64, 3))

    def sample(scale: float) -> dpd.Sample:
        pairs = [dpd.PairTable({("A", "A"): partner}), dpd.PairTable({("A", "A"): dpd.DPD(gamma=2.0, cutoff=1.2)})]
        scene = dpd.Scene({"A": 1.0}, ["A"] * 64, grid * scale, pairs, kT=1.0, box=[3.6 * scale] * 3)
        built = dpd.build(scene, dt=0.005, platform="Reference", seed=1)
        return dpd.Observer(built).sample(built.simulation().context)

    h = 1e-5
    slope = -(sample(1 + h).potential - sample(1 - h).potential) / (2 * h)
    found = sample(1.0)
    assert found.virial_conservative == pytest.approx(slope, rel=1e-4)
    assert found.laplacian is None


def test_virial_forces_do_not_enter_anyones_energy():
    pairs = [dpd.PairTable({("A", "A"): dpd.LennardJones(1.0, 0.5, 1.2)}), dpd.PairTable({("A", "A"): dpd.DPD(gamma=2.0)})]
    scene = dpd.Scene({"A": 1.0}, ["A", "A"], [[0, 0, 0], [0.6, 0, 0]], pairs, kT=1.0, box=[3, 3, 3])
    built = dpd.build(scene, dt=0.005, platform="Reference", seed=1)
    simulation = built.simulation()
    s6 = (0.5 / 0.6) ** 6
    everything = simulation.context.getState(energy=True).getPotentialEnergy().value_in_unit(unit.kilojoule_per_mole)
    assert everything == pytest.approx(4 * (s6**2 - s6))
    dpd.Observer(built).sample(simulation.context)
    assert simulation.context.getState(energy=True).getPotentialEnergy().value_in_unit(unit.kilojoule_per_mole) == everything


def test_immobile_beads_are_left_out():
    mobile = np.ones(120, bool)
    mobile[:40] = False
    scene = fluid(mobile=mobile)
    built = dpd.build(scene, dt=0.01, platform="Reference", seed=3)
    sample = dpd.Observer(built).sample(built.simulation().context)
    mass, v = scene.bead_masses[mobile], scene.velocities[mobile]
    assert (sample.n_mobile, sample.dof) == (80, 240)  # frozen ones take up momentum
    assert sample.kinetic == pytest.approx(0.5 * np.sum(mass[:, None] * v**2))
    force = oracle.conservative(scene.positions, scene.type_ids, oracle_parameters(), scene.box)[1][mobile]
    assert sample.gradient2 == pytest.approx(np.sum(force**2), rel=1e-12)


@pytest.mark.parametrize("platform", ["Reference", "CPU"])
def test_body_forces_count_once_in_the_configurational_temperature(platform):
    """The identity of the forces within the fluid, in the field of all: sum over F (F - f).  They have no Laplacian."""
    fields = [dpd.BodyForce((3.0, -1.0, 2.0), types="A"), dpd.PositionForce(("0", "2*sin(x)", "0"))]
    still, driven = (fluid(body_forces=its) for its in ([], fields))
    found = []
    for scene in (still, driven):
        built = dpd.build(scene, dt=0.01, platform=platform, seed=3, scheme="middle")
        found.append(dpd.Observer(built).sample(built.simulation().context))
    inner, total = (sample.forces for sample in found)
    assert np.abs(total - inner).max() > 2
    assert found[1].gradient2 == pytest.approx(np.sum(total * inner), rel=1e-9)
    assert found[1].laplacian == pytest.approx(found[0].laplacian, rel=1e-12)


def test_reporter_writes_what_the_observer_measures():
    built = dpd.build(fluid(), dt=0.01, platform="Reference", seed=3)
    simulation, out = built.simulation(), io.StringIO()
    simulation.reporters.append(dpd.DPDReporter(out, 2, built, columns=("step", "kT", "temperature", "pressure", "pressure_bar")))
    simulation.step(4)
    header, *rows = out.getvalue().splitlines()
    assert header == "step,kT,temperature,pressure,pressure_bar"
    assert [row.split(",")[0] for row in rows] == ["2", "4"]
    step, kT, kelvin, pressure, bar = map(float, rows[-1].split(","))
    sample = dpd.Observer(built).sample(simulation.context)
    assert kT == pytest.approx(sample.kT, rel=1e-9) and pressure == pytest.approx(sample.pressure(), rel=1e-9)
    # the reduced units of the documentation: kT = 1 is 120.27 K, a pressure of 1 is 16.605 bar
    assert kelvin / kT == pytest.approx(120.27, abs=0.01) and bar / pressure == pytest.approx(16.605, abs=0.001)


def test_reporters_and_observers_refuse_what_is_not_theirs():
    built = dpd.build(fluid(), dt=0.01, platform="Reference", seed=3)
    raises(dpd.ParameterError, "unknown columns kt; they must be among step", dpd.DPDReporter, io.StringIO(), 2, built, columns=("kt",))
    raises(dpd.ParameterError, "interval.*at least 1, not 0", dpd.DPDReporter, io.StringIO(), 0, built)
    few, context = _few_beads("nothing"), built.simulation().context
    message = "the Context has 120 particles, but this Observer was made for a System of 8"
    raises(dpd.ParameterError, message, dpd.Observer(few).sample, context)


def test_the_set_temperature_of_openmms_integrator():
    """DPDIntegrator holds it itself, and it may be changed there."""
    scene = dpd.Scene({"A": 1.0}, ["A"] * 120, fluid().positions, {("A", "A"): dpd.DPD(A=25, gamma=4.5)}, kT=1.2, box=[3.4] * 3)
    built = dpd.build(scene, dt=0.01, scheme="native", platform="Reference", seed=3)
    simulation = built.simulation()
    assert dpd.Observer(built).sample(simulation.context).target_kT == pytest.approx(1.2)
    built.integrator.setTemperature(2.0 / dpd.units.BOLTZMANN)
    assert dpd.Observer(built).sample(simulation.context).target_kT == pytest.approx(2.0)


# -- forces of others ----------------------------------------------------------------------------------------------------------------
@pytest.mark.parametrize("conservative", ["openmm", "kernel"])
@pytest.mark.parametrize("scheme", ["mvv", "middle", "native"])
def test_forces_that_somebody_adds_are_told_apart(scheme, conservative, tmp_path, caplog):
    """They count in the potential energy, and in no other sum over forces of the scene; what is not known with them is said."""
    if (scheme, conservative) == ("native", "kernel"):
        pytest.skip("native has no kernel")
    n, edge = 81, 3.0
    scene = beads(n, seed=3, edge=edge, bonds=[dpd.HarmonicBonds([[0, 1], [2, 3]], k=5.0, r0=0.5)])
    x = scene.positions
    plain, pulled = (dpd.build(scene, dt=0.01, scheme=scheme, platform="Reference", conservative=conservative, seed=1) for _ in range(2))
    pulled.system.addForce(external_force("-3*x+7*y", 10))
    one, other = (dpd.Observer(built).sample(built.simulation().context) for built in (plain, pulled))
    energy = float(np.sum(-3 * x[:10, 0] + 7 * x[:10, 1]))
    assert other.other == pytest.approx(energy, rel=1e-12) and one.other == 0.0
    assert other.potential == pytest.approx(one.potential + energy, rel=1e-12)
    assert (other.pair, other.bond) == (pytest.approx(one.pair, rel=1e-12), one.bond)
    assert other.virial_conservative == pytest.approx(one.virial_conservative, rel=1e-12)
    assert one.kT_conf is not None and other.kT_conf is None
    terms, with_pull = dpd.force_terms(plain), dpd.force_terms(pulled)
    expected = np.zeros((n, 3))
    expected[:10, :2] = [3.0, -7.0]
    np.testing.assert_allclose(with_pull.pop("other"), expected, atol=1e-12)
    for name in terms:
        np.testing.assert_allclose(with_pull[name], terms[name], atol=1e-12)
    caplog.clear()  # what was compiled for the first time was announced
    dpd.DPDReporter(str(tmp_path / "plain.csv"), 10, plain)
    assert not caplog.records
    dpd.DPDReporter(str(tmp_path / "pulled.csv"), 10, pulled)
    assert [("kT_conf" in r.getMessage(), "CustomExternalForce" in r.getMessage()) for r in caplog.records] == [(True, True), (False, True)]


def _few_beads(tied: str, seed: int = 3) -> dpd.BuiltSystem:
    n = 8
    x = np.array([(i, j, k) for i in (0.3, 1.3) for j in (0.3, 1.3) for k in (0.3, 1.3)]) + 0.3
    more: dict = {
        "frozen": {"mobile": np.arange(n) > 0},
        "specular": {"walls": [dpd.Wall("z", 0.05, "above", "specular"), dpd.Wall("z", 1.95, "below", "specular")]},
        "bounce-back": {"walls": [dpd.Wall("z", 0.05, "above"), dpd.Wall("z", 1.95, "below")]},
        "place": {"body_forces": [dpd.PositionForce(("3*sin(3.14159265358979*x)", "0", "0"))]},
        "constant": {"body_forces": [dpd.BodyForce((0.0, 0.0, 0.0))]},
    }.get(tied, {})
    scene = dpd.Scene({"W": 1.0}, ["W"] * n, x, {("W", "W"): dpd.DPD(A=25, gamma=20)}, kT=1.0, box=[2] * 3, **more)
    built = dpd.build(scene, dt=0.02, seed=seed, platform="Reference")
    if tied == "theirs":
        built.system.addForce(external_force("5*periodicdistance(x, y, z, 1, 1, 1)^2", n))
    return built


@cases("tied, dof", ("nothing", 21), ("constant", 21), ("frozen", 21), ("specular", 22), ("bounce-back", 24), ("place", 22), ("theirs", 24))
def test_degrees_of_freedom_know_what_takes_up_momentum(tied, dof):
    """One less for each component of the momentum that is conserved; a frozen bead has none, and no other is taken off then."""
    built = _few_beads(tied)
    assert dpd.Observer(built).sample(built.simulation().context).dof == dof


@pytest.mark.slow
@any_seed(1)
@pytest.mark.parametrize("tied", ["nothing", *(pytest.param(tied, marks=pytest.mark.long) for tied in ("frozen", "specular")), "theirs"])
def test_temperatures_of_few_beads(tied, seed):
    """With the right number of degrees of freedom the mean kinetic temperature is the one set; three are 0.125 of it."""
    built = _few_beads(tied, seed)
    simulation = built.simulation()
    dof, kinetic = dpd.Observer(built).sample(simulation.context).dof, []
    built.integrator.step(200)
    for _ in range(3000):
        built.integrator.step(10)
        kinetic.append(simulation.context.getState(energy=True).getKineticEnergy()._value)
    judge(2 * np.array(kinetic) / dof, 1.0, error=0.028)


def test_bonds_fit_into_the_box():
    x = [[0.5, 0.5, 0.5], [1.0, 0.5, 0.5], [1.5, 0.5, 0.5]]
    bonds = dpd.HarmonicBonds([[0, 1], [1, 2]], k=[10.0, 10.0], r0=[0.5, 2.1])
    pairs = {("W", "W"): dpd.DPD(A=25, gamma=4.5)}
    long = "beads 1 and 2 .counted from 0. has the rest length 2.1 nm, over half the box, whose width is 4 nm"
    raises(dpd.ParameterError, long, lambda: dpd.Scene({"W": 1.0}, ["W"] * 3, x, pairs, kT=1.0, box=[4, 5, 5], bonds=[bonds]))
    dpd.Scene({"W": 1.0}, ["W"] * 3, x, pairs, kT=1.0, bonds=[bonds])


@cases(
    "kind, scheme",
    *(("dpd", scheme) for scheme in ("mvv", "middle", "bababo")),
    *(("mdpd", "mvv"), ("energies", "mvv"), ("edpd", "mvv-0.65"), ("tdpd", "mvv"), ("sigma", "aboba"), ("patterns", "mvv")),
    *(("bonded", "middle"), ("bonded", "mvv"), ("ramp", "mvv"), ("charged", "mvv")),
)
def test_samples_share_the_engine_of_the_run(kind, scheme):
    """A run that is measured in every step keeps its bits; its samples are those of a run that goes step by step, with an engine apart."""
    measured, alone, stepwise = (running(made(kind, scheme, loop=loop)) for loop in (True, True, False))
    observers = [(dpd.Observer(simulation.built), simulation) for simulation in (measured, stepwise)]
    names = ("potential", "virial_conservative", "virial_dissipative", "virial_random", "gradient2", "force_max", "kinetic_pressure")
    for _ in range(3):
        for simulation in (measured, alone, stepwise):
            simulation.step(1)
        found, expected = (observer.sample(simulation.context) for observer, simulation in observers)
        size = max(1.0, abs(expected.virial_conservative))
        for name in names:
            assert getattr(found, name) == pytest.approx(getattr(expected, name), rel=1e-9, abs=1e-9 * size), name
        assert found.laplacian == (None if expected.laplacian is None else pytest.approx(expected.laplacian, rel=1e-9))
    assert not same(everything(measured.context, measured.built), everything(alone.context, alone.built))


@cases("options", {}, {"bonded_factors": (0.5, 0.3, 0.7)}, {"mobile": np.arange(100) % 9 > 0})
def test_samples_have_the_same_bits_where_a_run_was_cut(options):
    """Conservative forces come with the last step where somebody measures, and alone after a restart."""
    built = [dpd.build(chains(table=PLAIN, k=20.0, **options), dt=0.01, scheme="mvv", platform="CPU", seed=1) for _ in range(2)]
    (first, one), (second, other) = ((b.simulation().context, dpd.Observer(b)) for b in built)
    built[0].integrator.step(3)
    one.sample(first)
    built[0].integrator.step(2), built[1].integrator.step(5)
    found, expected = one.sample(first), other.sample(second)
    assert one._sampler.present._last_step.held is not None and other._sampler.present._last_step.held is None
    for name in ("potential", "virial_conservative", "gradient2", "laplacian", "virial_dissipative"):
        assert getattr(found, name) == getattr(expected, name), name
