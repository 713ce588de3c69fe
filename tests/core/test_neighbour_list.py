"""In tilted boxes OpenMM's Reference platform misses pairs now and then; no force of ours does."""

import numpy as np
import openmm
import pytest
from openmm import unit

import openmm_dpd as dpd
from openmm_dpd.base.geometry import minimum_images
from openmm_dpd.plan.choices import may_miss_pairs
from openmm_dpd.plan.forces.expressions import PairExpression, nonbonded_force

BOX = np.array([[4.0, 0, 0], [1.8, 4.0, 0], [-0.6, 1.4, 4.0]])
SOFT = np.linspace(0.02, 1.8, 60)


def boxes(count: int):
    """Random boxes with cutoffs from a twelfth to a half of the smallest edge; every other one is tilted to the limit, or nearly so."""
    rng = np.random.default_rng(3)
    for k in range(count):
        edges = np.array([1.0, *rng.uniform(0.6, 1.6, 2)])
        tilts = rng.uniform(-1, 1, 3) if k % 2 else rng.choice([-1.0, 0.9, 0.0, 1.0], 3)
        bx, cx, cy = tilts * 0.5 * edges[[0, 0, 1]]
        box = np.array([[edges[0], 0, 0], [bx, edges[1], 0], [cx, cy, edges[2]]])
        yield box, rng.uniform(1 / 12, 0.5) * edges.min(), rng.random((200, 3)) @ box


def counted(box: np.ndarray, cutoff: float, x: np.ndarray, listed: bool) -> int:
    """Number of pairs that a CustomNonbondedForce meets on the Reference platform."""
    system = openmm.System()
    for _ in x:
        system.addParticle(1.0)
    system.setDefaultPeriodicBoxVectors(*box)
    system.addForce(nonbonded_force(PairExpression("one", "1", cutoff), np.zeros(len(x), int), [], True, listed=listed))
    context = openmm.Context(system, openmm.VerletIntegrator(0.001), openmm.Platform.getPlatformByName("Reference"))
    context.setPositions(x)
    return round(context.getState(energy=True).getPotentialEnergy().value_in_unit(unit.kilojoule_per_mole))


def test_lists_are_used_only_where_they_are_right():
    i, j = np.triu_indices(200, 1)
    lists, misses = 0, 0
    for box, cutoff, x in boxes(60):
        pairs = int(np.sum(np.linalg.norm(minimum_images(x[i] - x[j], box), axis=1) < cutoff))
        listed = not may_miss_pairs(box, cutoff)
        lists += listed
        misses += counted(box, cutoff, x, True) != pairs
        assert counted(box, cutoff, x, listed) == pairs
    assert lists > 15
    assert misses > 5, "OpenMM's list has become right: openmm_dpd/plan/choices.py can go"


def test_boxes_without_tilt_and_wide_ones_keep_their_list():
    assert not may_miss_pairs(None, 1.0)
    assert not may_miss_pairs(np.diag([2.0, 2.0, 2.0]), 1.0)
    assert not may_miss_pairs(BOX, 0.9)
    assert may_miss_pairs(BOX, 1.8)
    assert may_miss_pairs(np.array([[40.0, 0, 0], [20.0, 40.0, 0], [-20.0, 0, 40.0]]), 1.0)  # a shift of a whole box, b_x - c_x


def scene(pairs, seed: int = 7) -> dpd.Scene:
    x = np.random.default_rng(seed).random((60, 3)) @ BOX
    return dpd.Scene({"A": 1.0}, ["A"] * 60, x, pairs, 1.0, box=BOX, velocities=np.zeros((60, 3)))


TABLES = {
    "DPD": {("A", "A"): dpd.DPD(A=25, gamma=4.5, cutoff=1.8)},
    "DPD without friction": {("A", "A"): dpd.DPD(A=25, cutoff=1.8)},
    "tabulated": [{("A", "A"): dpd.DPD(gamma=4.5, cutoff=1.0)}, {("A", "A"): dpd.TabulatedPair(SOFT, 20 * (1 - SOFT / 1.8) ** 2)}],
}


@pytest.mark.parametrize("table", TABLES.values(), ids=TABLES)
@pytest.mark.parametrize("conservative", ["auto", "openmm"])
def test_forces_and_virials_on_reference_are_those_on_cpu(table, conservative):
    found = []
    for platform in ("Reference", "CPU"):
        built = dpd.build(scene(table), dt=0.01, platform=platform, conservative=conservative, seed=1)
        sample = dpd.Observer(built).sample(built.simulation().context)
        found.append((sample.potential, sample.virial_conservative, sample.forces))
    (energy, virial, forces), (energy_cpu, virial_cpu, forces_cpu) = found
    assert energy == pytest.approx(energy_cpu, rel=1e-6)
    assert virial == pytest.approx(virial_cpu, rel=1e-5)
    np.testing.assert_allclose(forces, forces_cpu, atol=1e-4)


def test_densities_are_left_to_the_kernel_and_the_plan_says_so():
    term = dpd.MDPD(A=-40, B=25, gamma=4.5, cutoff=1.8, cutoff_B=1.5)
    assert dpd.build(scene({("A", "A"): term}), dt=0.01, platform="Reference", seed=1).plan.execution.conservative == "kernel"
    with pytest.raises(dpd.PlanError, match="conservative='openmm' is not possible: .*tilted.*Reference platform.*CPU"):
        dpd.build(scene({("A", "A"): term}), dt=0.01, platform="Reference", conservative="openmm", seed=1)
    built = dpd.build(scene({("A", "A"): term}), dt=0.01, platform="CPU", conservative="openmm", seed=1)
    assert built.plan.execution.conservative == "openmm"
    choices = {"dt": 0.01, "platform": "Reference", "seed": 1}
    auto, openmm_force = (dpd.build(scene(TABLES["DPD"]), conservative=choice, **choices) for choice in ("auto", "openmm"))
    assert auto.plan.execution.conservative == "kernel"
    assert "over all pairs" in openmm_force.explain()
    assert "over all pairs" not in dpd.build(scene(TABLES["DPD"]), dt=0.01, platform="CPU", conservative="openmm", seed=1).explain()


@pytest.mark.parametrize(("platform", "groups"), [("Reference", 1), ("CPU", 0)])
def test_charges_do_without_a_list_too(platform, groups):
    x = np.random.default_rng(7).random((60, 3)) @ BOX
    options = {"charges": np.tile([1.0, -1.0], 30), "electrostatics": dpd.SlaterCharges(bjerrum_length=1.0, lamda=0.4, cutoff=1.5)}
    charged = dpd.Scene({"A": 1.0}, ["A"] * 60, x, {("A", "A"): dpd.DPD(A=25, gamma=4.5)}, 1.0, box=BOX, **options)
    built = dpd.build(charged, dt=0.01, platform=platform, seed=1, loop=False)
    forces = [force for force in built.system.getForces() if force.getName() == "smeared charges"]
    assert [force.getNumInteractionGroups() for force in forces] == [groups]
