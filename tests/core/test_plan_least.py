"""The plan is the least the scene needs: nothing is built, declared or evaluated that nothing asks for."""

import io

import numpy as np
import openmm
import pytest
from openmm import unit
from scenes import BOXES, EXTENDED, PLAIN, D, beads, chains, fluid, stepped

import openmm_dpd as dpd
from openmm_dpd.base.names import PAIR_GROUP, PARAMETERS
from openmm_dpd.kernels import forces
from openmm_dpd.measure import StressReporter
from openmm_dpd.plan.plan import make_plan

SCHEMES = pytest.mark.parametrize("scheme", ["mvv", "shardlow", "middle", "aboba", "bababo"])
PLACEMENTS = pytest.mark.parametrize("conservative", ["kernel", "openmm"])
SOFT, FRICTION = {("W", "W"): D(A=25)}, {("W", "W"): D(gamma=4.5)}


def build(scene, **choices):
    return dpd.build(scene, **{"dt": 0.02, "platform": "Reference", "seed": 1, **choices})


def kinds(built) -> dict[str, openmm.Force]:
    return {type(force).__name__: force for force in built.system.getForces()}


def parameters_of(built) -> set[str]:
    return set(built.simulation().context.getParameters().keys())


@SCHEMES
def test_what_nothing_asks_for_is_not_there(scheme):
    """Without a thermostat: none of our parameters and variables.  Without a conservative force: no nonbonded force."""
    built = build(beads(table=SOFT), scheme=scheme)
    assert set(kinds(built)) == {"CustomNonbondedForce"}
    assert not parameters_of(built)
    assert built.integrator.getNumGlobalVariables() == 0
    assert "no pair kernel" in built.explain()
    built = build(beads(table=FRICTION), scheme=scheme)
    assert set(kinds(built)) == {"PythonForce"}
    assert built.plan.execution.conservative == "none"
    assert PAIR_GROUP not in _groups(build(beads(table=FRICTION), scheme=scheme, loop=False))


def _groups(built) -> set[int]:
    groups = built.integrator.getIntegrationForceGroups()
    return {g for g in range(32) if groups & (1 << g)} if isinstance(groups, int) else set(groups)


@SCHEMES
@PLACEMENTS
def test_one_force_for_each_thing(scheme, conservative):
    built = build(beads(), scheme=scheme, conservative=conservative)
    assert set(kinds(built)) == ({"PythonForce"} if conservative == "kernel" else {"PythonForce", "CustomNonbondedForce"})
    assert (PAIR_GROUP in _groups(built)) == (conservative == "kernel")
    assert parameters_of(built) == set(PARAMETERS)


def test_types_that_agree_have_constants_and_no_tables():
    """Only what differs between type pairs becomes a table."""
    force = kinds(build(beads(), conservative="openmm"))["CustomNonbondedForce"]
    assert force.getNumTabulatedFunctions() == 0
    assert force.getNumPerParticleParameters() == 0
    assert force.getNumGlobalParameters() == 0
    assert "type" not in force.getEnergyFunction()
    table = {("*", "*"): D(A=25, gamma=4.5)}
    force = kinds(build(fluid(table, np.diag([4.0] * 3), n=40), conservative="openmm"))["CustomNonbondedForce"]
    assert force.getNumTabulatedFunctions() == force.getNumPerParticleParameters() == 0
    force = kinds(build(fluid(PLAIN, np.diag([4.0] * 3), n=40), conservative="openmm"))["CustomNonbondedForce"]
    assert force.getNumTabulatedFunctions() == 1
    force = kinds(build(fluid(EXTENDED, np.diag([4.0] * 3), n=40), conservative="openmm"))["CustomNonbondedForce"]
    assert force.getNumTabulatedFunctions() == 2


@PLACEMENTS
def test_no_exclusions_and_no_bond_force_without_need(conservative):
    built = build(beads(), conservative=conservative)
    assert not any("Bond" in name for name in kinds(built))
    if conservative == "openmm":
        assert kinds(built)["CustomNonbondedForce"].getNumExclusions() == 0
    # bonded neighbours whose factors are all 1 need no exception either
    built = build(chains(bonded_factors=(1.0, 1.0, 1.0), k=10.0), conservative=conservative)
    assert "CustomCompoundBondForce" not in kinds(built)
    assert len(built.plan.exceptions) == 0 and len(built.plan.spec.exceptions[0]) == 0
    if conservative == "openmm":
        assert kinds(built)["CustomNonbondedForce"].getNumExclusions() == 0


def test_factors_of_zero_and_walls_at_rest_need_nothing_of_their_own():
    built = build(chains(bonded_factors=(0.0, 1.0, 1.0), k=10.0), conservative="openmm")
    assert "CustomCompoundBondForce" not in kinds(built)
    assert kinds(built)["CustomNonbondedForce"].getNumExclusions() == len(built.plan.scene.bond_pairs)
    assert make_plan(beads(), dt=0.02, seed=1).spec.wall_velocity is None
    assert make_plan(beads(mobile=np.arange(81) > 9, velocities=np.zeros((81, 3))), dt=0.02, seed=1).spec.wall_velocity is None
    assert make_plan(beads(mobile=np.arange(81) > 9, velocities=np.ones((81, 3))), dt=0.02, seed=1).spec.wall_velocity is not None


@SCHEMES
def test_no_ramp_no_ramp_variable(scheme):
    for kT, expected in ((1.0, False), (dpd.TemperatureRamp(1, 2, 0, 10), True)):
        integrator = build(beads(kT=kT), scheme=scheme).integrator
        names = {integrator.getGlobalVariableName(k) for k in range(integrator.getNumGlobalVariables())}
        assert ("ramp_step" in names) == expected


def test_no_transverse_work_without_transverse_friction():
    """The coefficient the compiled loops test is exactly 0, and explain says so; with transverse friction it says that."""
    plain, extended = (build(fluid(table, BOXES["ortho"], n=40)) for table in (PLAIN, EXTENDED))
    column = [built.plan.spec.terms[0].coefficients(1.0)[:, [forces.GAMMA_PERP, forces.SIGMA_PERP]] for built in (plain, extended)]
    assert not column[0].any() and column[1].any()
    assert "transverse" not in plain.explain() and "transverse" in extended.explain()


def test_only_the_forces_of_the_scene_have_parameters_of_types():
    """One table, one layer: no more layers than tables with DPD terms; thermostat-only layers hold no conservative term."""
    friction = dpd.PairTable({("*", "*"): D(gamma=4.5)})
    lennard_jones = dpd.PairTable({("*", "*"): dpd.LennardJones(1.0, 0.5, 1.2)})
    scene = dpd.Scene({"W": 1.0}, ["W"] * 20, np.random.default_rng(1).random((20, 3)) * 4, [lennard_jones, friction], 1.0, box=[4.0] * 3)
    built = build(scene, loop=False)
    assert len(built.plan.layers) == len(built.plan.overlays) == 1
    assert built.plan.execution.conservative == "none"
    assert sorted(type(f).__name__ for f in built.system.getForces()) == ["CustomNonbondedForce", "PythonForce"]
    context = built.simulation().context
    everything, integrated = (context.getState(energy=True, **kw).getPotentialEnergy() for kw in ({}, {"groups": _groups(built)}))
    assert everything == integrated


def test_auto_takes_the_kernel_where_everything_is_double_precision_and_native_no_python_force():
    for platform, expected in (("CPU", "kernel"), ("Reference", "kernel"), ("OpenCL", "openmm"), ("CUDA", "openmm")):
        assert make_plan(beads(), dt=0.02, platform=platform, seed=1).execution.conservative == expected
    assert make_plan(beads(table=SOFT), dt=0.02, platform="CPU", seed=1).execution.conservative == "openmm"
    assert make_plan(beads(), dt=0.02, platform="CPU", scheme="native", seed=1).execution.conservative == "openmm"
    built = build(beads(), scheme="native")
    # the bond force is empty: it holds the box, and what states say of the scheme
    assert set(kinds(built)) == {"CustomNonbondedForce", "CustomBondForce"}
    assert isinstance(built.integrator, openmm.DPDIntegrator)
    assert built.program is None and "DPDIntegrator" in built.explain()


@pytest.mark.parametrize("platform", ["Reference", "CPU"])
def test_native_friction_acts_across_the_faces_of_a_box(platform):
    """Without repulsion no force makes the System periodic, and OpenMM's integrator would leave out the pair."""
    coefficient = {("W", "W"): dpd.DPD(A=0, gamma=20)}
    x, v = np.array([[0.1, 2, 2], [3.9, 2, 2]]), np.array([[0.1, 0, 0], [-0.1, 0, 0]])
    scene = dpd.Scene({"W": 1}, ["W"] * 2, x, coefficient, kT=0, box=[4, 4, 4], velocities=v)
    simulation = stepped(build(scene, scheme="native", platform=platform).simulation(), 10)
    # gamma w^2 (1/m + 1/m) = 25 per ps at the distance 0.2
    after = simulation.context.getState(velocities=True).getVelocities(asNumpy=True)._value
    assert 0 < after[0, 0] < 0.1 * np.exp(-25 * 0.2 * 0.5) and after[0, 0] == pytest.approx(-after[1, 0])


def test_native_has_the_friction_of_lammps():
    """Gamma in Da/ps becomes a rate: gamma (1/m_i + 1/m_j)/2 for w^2 twice over; and the temperature is kT over the gas constant."""
    table = {("A", "A"): D(A=25, gamma=4.5), ("A", "B"): D(A=25, gamma=3.0, cutoff=1.2), ("B", "B"): D(A=25, gamma=9.0)}

    def bare(value):
        return value.value_in_unit_system(unit.md_unit_system) if unit.is_quantity(value) else value

    integrator = build(fluid(table, np.diag([4.0] * 3), n=40, kT=1.5), scheme="native").integrator
    rates = {}
    for k in range(integrator.getNumTypePairs()):
        a, b, rate, cutoff = integrator.getTypePairParameters(k)
        rates[a, b] = bare(rate), bare(cutoff)
    assert rates == {(0, 0): (4.5, 1.0), (0, 1): (pytest.approx(3.0 * (1 + 1 / 2.7) / 2), 1.2), (1, 1): (pytest.approx(9.0 / 2.7), 1.0)}
    kT = bare(integrator.getTemperature()) * unit.MOLAR_GAS_CONSTANT_R.value_in_unit(unit.kilojoule_per_mole / unit.kelvin)
    assert kT == pytest.approx(1.5)


@pytest.fixture
def counts(monkeypatch):
    """How often the kernel lists pairs, and adds forces or sweeps, in steps that Python does: played ones repeat what these call."""
    from openmm_dpd.kernels.engine import PairEngine
    from openmm_dpd.kernels.pairs import PairList
    from openmm_dpd.kernels.steps import StepLoop

    monkeypatch.setattr(StepLoop, "_repeats", lambda *arguments: False)
    counts = {"lists": 0, "forces": 0, "sweeps": 0}

    def counted(owner, name, key):
        original = getattr(owner, name)

        def call(self, *arguments, **options):
            counts[key] += 1
            return original(self, *arguments, **options)

        monkeypatch.setattr(owner, name, call)

    counted(PairList, "build", "lists")
    counted(PairEngine, "sums", "forces")
    counted(PairEngine, "swept", "sweeps")
    return counts


@SCHEMES
@PLACEMENTS
def test_evaluations_per_step(scheme, conservative, counts):
    """Counted on a running scene."""
    simulation = stepped(build(beads(), scheme=scheme, conservative=conservative).simulation(), 3)
    counts.update(dict.fromkeys(counts, 0))
    simulation.step(10)
    kernel = conservative == "kernel"
    once, twice = (10, 10 if kernel else 0, 10), (20 if kernel else 10, 10 if kernel else 0, 10)
    fifths = (20 if kernel else 10, 20 if kernel else 0, 10)
    expected = {"mvv": (10, 10, 0), "shardlow": once, "middle": twice, "aboba": once, "bababo": fifths}[scheme]
    assert tuple(counts.values()) == expected


def test_explain_says_what_will_be_built():
    scene = chains(mobile=np.arange(100) % 9 > 0, kT=dpd.TemperatureRamp(1, 2, 0, 50))
    text = build(scene, scheme="mvv", lam=0.65, conservative="kernel").explain()
    for word in ("100 beads of 2 type(s)", "A (mass 1)", "B (mass 2.7)", "lambda = 0.65", "dt = 0.02", "kT from 1 to 2", "between steps 0 and 50",
                 "A - B: DPD(A = 31", "gamma_perp = 3", "pair kernel", "transverse", "37 harmonic bonds", "12 beads do not move", "program mvv"):  # fmt: skip
        assert word in text, word


def test_a_table_whose_pairs_are_all_overwritten_is_none():
    """Later entries overwrite earlier ones, here all of them."""
    empty = {("A", "A"): dpd.DPD(A=25, gamma=4.5), ("*", "*"): dpd.NONE}
    gone = {("A", "A"): dpd.LennardJones(1.0, 0.3, 0.9), ("*", "*"): dpd.NONE}
    scene = dpd.Scene({"A": 1.0}, ["A"] * 30, np.random.default_rng(1).random((30, 3)) * 3, [empty, gone], kT=1.0, box=[3.0] * 3)
    plan = dpd.make_plan(scene, dt=0.01, platform="CPU", seed=1)
    assert plan.layers == plan.overlays == () and plan.execution.conservative == "none"
    dpd.build(scene, dt=0.01, platform="CPU", seed=1).simulation().step(2)


@pytest.mark.parametrize(
    ("scheme", "reporter", "more"),
    [("mvv", dpd.DPDReporter, 0), ("middle", dpd.DPDReporter, 1), ("mvv", StressReporter, 0), ("middle", StressReporter, 0)],
)
def test_evaluations_per_sample(scheme, reporter, more, counts):
    """A sample takes the list of the run and leaves what it computes; friction as a force in words adds to it, nothing else does."""
    built = build(beads(), scheme=scheme)
    simulation = stepped(built.simulation(), 3)
    counts.update(dict.fromkeys(counts, 0))
    simulation.step(10)
    before = dict(counts)
    simulation.reporters.append(reporter(io.StringIO(), 1, built) if reporter is dpd.DPDReporter else reporter(1, built))
    simulation.step(3)
    counts.update(dict.fromkeys(counts, 0))
    simulation.step(10)
    assert counts == before | {"forces": before["forces"] + 10 * more}
