"""Body forces and walls as data: what fits a scene, what is refused, which forces and programs they become."""

from dataclasses import replace

import numpy as np
import openmm
import pytest
from cases import raises, refused
from openmm import unit
from scenes import beads, fluid, stepped

import openmm_dpd as dpd
from openmm_dpd.base.names import BODY_FORCE, EXTERNAL_GROUP
from openmm_dpd.model.flow import gaps
from openmm_dpd.model.schemes import SCHEMES
from openmm_dpd.plan.execution import Execution
from openmm_dpd.plan.program_options import ProgramOptions
from openmm_dpd.simulation.programs import make_program, walls

OWN = [name for name, scheme in SCHEMES.items() if not scheme.native]
PLATFORM = pytest.mark.parametrize("platform", ["Reference", "CPU"])


def forces(scene: dpd.Scene, platform: str = "Reference", positions=None, **parameters):
    """(N, 3) forces on single beads, and their energy."""
    built = dpd.build(scene, dt=0.01, seed=1, platform=platform, loop=False)
    context = openmm.Context(built.system, openmm.VerletIntegrator(0.01), openmm.Platform.getPlatformByName(platform))
    context.setPositions(scene.positions if positions is None else positions)
    for name, value in parameters.items():
        context.setParameter(name, value)
    state = context.getState(forces=True, energy=True, groups={EXTERNAL_GROUP})
    return state.getForces(asNumpy=True)._value, state.getPotentialEnergy()._value


# -- body forces ---------------------------------------------------------------------------------------------------------------
@PLATFORM
def test_uniform_on_a_type_and_each_bead_its_own_with_a_scale(platform):
    scene = fluid(body_forces=[dpd.BodyForce((0.5, 0, -2), types="B")])
    f, energy = forces(scene, platform)
    assert np.allclose(f, np.outer(np.array(scene.types) == "B", [0.5, 0, -2]), atol=1e-12)
    assert abs(energy) < 1e-3  # no potential energy, though beads are strewn over many boxes
    own = np.random.default_rng(3).normal(size=(81, 3))
    scene = beads(body_forces=[dpd.BodyForce(own), dpd.BodyForce((1, 0, 0), beads=np.arange(81) < 5)])
    expected = own + np.outer(np.arange(81) < 5, [1, 0, 0])
    assert np.allclose(forces(scene, platform)[0], expected, atol=1e-6)
    assert np.allclose(forces(scene, platform, **{BODY_FORCE: 0.25})[0], 0.25 * expected, atol=1e-6)


@PLATFORM
@pytest.mark.parametrize("axis", ["x", "y", "z"])
@pytest.mark.parametrize("pattern", ["halves", "sine"])
def test_patterns_fold_positions_into_the_box(platform, axis, pattern):
    scene = fluid(body_forces=[dpd.BodyForce((0.1, 0.2, 0.3), pattern=pattern, axis=axis, origin=0.7)])
    k = "xyz".index(axis)
    part = np.mod((scene.positions[:, k] - 0.7) / scene.box[k, k], 1.0)
    sign = np.where(part < 0.5, 1, -1) if pattern == "halves" else np.sin(2 * np.pi * part)
    assert np.abs(scene.positions[:, k]).max() > 1.5 * scene.box[k, k]
    f, energy = forces(scene, platform)
    assert np.allclose(f, np.outer(sign, [0.1, 0.2, 0.3]), atol=2e-6)
    assert abs(energy) < 1e-3


def test_units_and_energy_without_a_box():
    force = dpd.BodyForce(np.array([0, 0, -9.81]) * 1e3 * unit.kilocalorie_per_mole / unit.angstrom)
    assert force.force[2] == pytest.approx(-9.81e3 * 41.84)
    scene = beads(box=None, body_forces=[dpd.BodyForce((0, 0, -2.0))])
    f, energy = forces(scene)
    assert energy == pytest.approx(2.0 * scene.positions[:, 2].sum(), rel=1e-9)


@PLATFORM
@pytest.mark.parametrize("box", ["ortho", "tilted"])
def test_formula_of_the_folded_position(platform, box):
    from scenes import BOXES

    corner = np.array([-1.0, 0.3, 0.2])
    scene = fluid(box=BOXES[box], body_forces=[dpd.PositionForce(("sin(x)", "0", "select(step(y-2.0), z^2, -x)"), corner=corner)])
    s = np.linalg.solve(BOXES[box].T, (scene.positions - corner).T).T
    x, y, z = ((s - np.floor(s)) @ BOXES[box] + corner).T
    sure = np.abs(y - 2.0) > 1e-5
    f, _ = forces(scene, platform)
    expected = np.stack([np.sin(x), 0 * x, np.where(y >= 2.0, z**2, -x)], axis=1)
    assert np.allclose(f[sure], expected[sure], atol=1e-4)


def halves(**other):
    return dpd.BodyForce(**{"force": (1, 0, 0), "pattern": "halves", "axis": "z", **other})


TILTED = np.array([[3.0, 0, 0], [0, 3.0, 0], [0.4, 0, 3.0]])
BAD_FORCES = {
    "two components": (lambda: dpd.BodyForce((1, 2)), "three components"),
    "a length": (lambda: dpd.BodyForce(np.ones(3) * unit.nanometer), "no force"),
    "pattern": (lambda: halves(pattern="thirds"), "uniform, halves, sine"),
    "no axis": (lambda: halves(axis=None), "must be 'x', 'y' or 'z'"),
    "axis of uniform": (lambda: dpd.BodyForce((1, 0, 0), axis="z"), "pattern='halves'"),
    "type": (lambda: beads(body_forces=[dpd.BodyForce((1, 0, 0), types="X")]), "names the bead type 'X'"),
    "indices": (lambda: dpd.BodyForce((1, 0, 0), beads=[0, 1]), "one True or False per bead"),
    "mask": (lambda: beads(body_forces=[dpd.BodyForce((1, 0, 0), beads=[True])]), "one entry per bead, 81"),
    "vectors": (lambda: beads(body_forces=[dpd.BodyForce(np.ones((80, 3)))]), "80 vectors"),
    "no sequence": (lambda: beads(body_forces=dpd.BodyForce((1, 0, 0))), "must be a sequence of BodyForce or PositionForce"),
    "no box": (lambda: beads(box=None, body_forces=[halves()]), "needs a periodic box"),
    "tilted": (lambda: beads(box=TILTED, body_forces=[halves(axis="x")]), "the box is tilted"),
    "formula": (lambda: dpd.PositionForce(("vx", "0", "0")), "names 'vx'"),
    "call": (lambda: dpd.PositionForce(("system(x)", "0", "0")), "names 'system'"),
    "two formulas": (lambda: dpd.PositionForce(("x", "0")), "three formulas"),
    "types": (lambda: dpd.BodyForce((1, 0, 0), types=3), "name of a bead type or several, not 3"),
    "no formulas": (lambda: dpd.PositionForce(None), "three formulas"),
    "syntax": (lambda: dpd.PositionForce(("x+", "0", "0")), "the formula 'x.' of a position force cannot be read"),
    "half a number": (lambda: dpd.PositionForce(("1e", "0", "0")), "cannot be read"),
    "Python's power": (lambda: dpd.PositionForce(("x**2", "0", "0")), "cannot be read"),
    "arguments": (lambda: dpd.PositionForce(("max(x)", "0", "0")), "calls max with 1 arguments; it takes 2"),
    # OpenMM does not come back from this one
    "constant NaN": (lambda: dpd.PositionForce(("x*sqrt(-1)", "0", "0")), "without a finite value: sqrt.-1."),
    "not finite": (lambda: beads(body_forces=[dpd.PositionForce(("0", "log(x-100)", "0"))]), "gives nan for bead 0"),
    "definitions": (lambda: dpd.PositionForce(("x; x=1", "0", "0")), "one expression"),
}


test_refused_forces = refused(dpd.ParameterError, BAD_FORCES)


def test_explain():
    text = dpd.build(beads(body_forces=[halves()], walls=PAIR, positions=INSIDE), dt=0.01, platform="Reference").explain()
    assert "body force on single beads: (1, 0, 0) kJ/mol/nm, reversed in the upper half along z" in text
    assert "bounce-back walls: z from 0.5 nm to 2 nm" in text
    assert dpd.build(beads(box=TILTED, body_forces=[halves()]), dt=0.01, platform="Reference")


# -- walls ---------------------------------------------------------------------------------------------------------------------
PAIR = [dpd.Wall("z", 0.5, "above"), dpd.Wall("z", 2.0, "below")]
INSIDE = np.random.default_rng(1).random((81, 3)) * [3, 3, 1.5] + [0, 0, 0.5]
BAD_WALLS = {
    "axis": (lambda: dpd.Wall("w", 0, "above"), "must be 'x', 'y' or 'z'"),
    "side": (lambda: dpd.Wall("z", 0, "left"), "where the beads are"),
    "kind": (lambda: dpd.Wall("z", 0, "above", "sticky"), "specular, bounce-back"),
    "unit": (lambda: dpd.Wall("z", 1 * unit.picosecond, "above"), "no length"),
    "one": (lambda: beads(walls=PAIR[:1], positions=INSIDE), "back of the only wall"),
    "not a list": (lambda: beads(walls=PAIR[0], positions=INSIDE), "sequence of Wall"),
    "same side": (lambda: beads(walls=[*PAIR, PAIR[0]], positions=INSIDE), "on the same side"),
    "kinds": (lambda: beads(walls=[PAIR[0], dpd.Wall("z", 2, "below", "specular")], positions=INSIDE), "different kinds"),
    "no solid": (lambda: beads(walls=[dpd.Wall("z", 0, "above"), dpd.Wall("z", 3, "below")]), "no solid"),
    "beyond": (lambda: beads(walls=PAIR), "beyond a wall"),
    "crossed": (lambda: beads(box=None, walls=[dpd.Wall("z", 2, "above"), dpd.Wall("z", 1, "below")]), "not below the upper one"),
    "tilted": (lambda: beads(box=TILTED, walls=[dpd.Wall("x", 1, "above"), dpd.Wall("x", 2, "below")]), "tilted"),
}


test_refused_walls = refused(dpd.ParameterError, BAD_WALLS)


def test_native_scheme_has_no_walls():
    with pytest.raises(dpd.PlanError, match="cannot reflect beads"):
        dpd.build(beads(walls=PAIR, positions=INSIDE), dt=0.01, scheme="native", platform="Reference")


def test_solid_in_the_middle_of_the_box():
    """The room may reach across the boundary of the box."""
    (gap,) = gaps([dpd.Wall("y", 2.0, "above"), dpd.Wall("y", 1.0, "below")], np.diag([3.0, 3.0, 3.0])).values()
    assert (gap.low, gap.high) == (2.0, 4.0)
    assert gap.fold(np.array([0.5, -2.6, 2.5, 9.9])) == pytest.approx([3.5, 3.4, 2.5, 3.9])
    assert 4.0 < gap.fold(np.array([1.2]))[0] < 4.5 and 1.5 < gap.fold(np.array([1.8]))[0] < 2.0  # in the solid, on either side


def one_step(scheme: str, kind: str, platform: str, box, x, v, walls=None) -> tuple[np.ndarray, np.ndarray]:
    """Free flight of single beads for dt = 0.5 between z = 1 and z = 2."""
    walls = walls or [dpd.Wall("z", 1.0, "above", kind), dpd.Wall("z", 2.0, "below", kind)]
    table = {("A", "A"): dpd.DPD(A=0, gamma=1e-12, cutoff=1.0)}
    scene = dpd.Scene({"A": 1.0}, ["A"] * len(x), x, table, 0.0, box=box, velocities=v, walls=walls)
    simulation = stepped(dpd.build(scene, dt=0.5, scheme=scheme, seed=1, platform=platform).simulation(), 1)
    state = simulation.context.getState(positions=True, velocities=True)
    return state.getPositions(asNumpy=True)._value, state.getVelocities(asNumpy=True)._value


@PLATFORM
@pytest.mark.parametrize("scheme", OWN)
@pytest.mark.parametrize("box", [None, [6.0, 6.0, 4.0]])
@pytest.mark.parametrize("kind", ["specular", "bounce-back"])
def test_reflection_of_single_beads(platform, scheme, box, kind):
    """One bead hits the lower wall, one the upper, one neither; in a box they are some images away."""
    x = np.array([[0.5, 0.5, 1.2], [3.0, 0.5, 1.7], [0.5, 3.0, 1.5]])
    v = np.array([[0.3, -0.2, -1.0], [0.3, -0.2, 1.0], [0.3, -0.2, 0.1]])
    if box is not None:
        x = x + np.array([[6, 0, 4], [-6, 6, -8], [0, 0, 12]])
    new_x, new_v = one_step(scheme, kind, platform, box, x, v)
    turned = np.array([[1, 1, -1], [1, 1, -1], [1, 1, 1]]) if kind == "specular" else np.array([[-1] * 3, [-1] * 3, [1] * 3])
    np.testing.assert_allclose(new_v, v * turned, atol=1e-9)
    # 1.2 - 0.5 = 0.7 is put back to 1.3, 1.7 + 0.5 = 2.2 to 1.8
    np.testing.assert_allclose(new_x[:, 2] - x[:, 2], [0.1, 0.1, 0.05], atol=1e-9)
    if kind == "specular" or scheme in ("mvv", "shardlow"):  # the others turn in the middle of the step and come back
        np.testing.assert_allclose(new_x[:, :2] - x[:, :2], 0.5 * v[:, :2], atol=1e-9)


@PLATFORM
def test_mixed_kinds(platform):
    """Specular along x, bounce-back along z: a corner turns everything once."""
    walls = [dpd.Wall("x", 1.0, "above", "specular"), dpd.Wall("z", 1.0, "above", "bounce-back")]
    x = np.array([[1.1, 0.0, 5.0], [5.0, 3.0, 1.1], [1.1, 6.0, 1.1]])
    v = np.array([[-1.0, 0.3, -0.1], [-1.0, 0.3, -1.0], [-1.0, 0.3, -1.0]])
    _, new = one_step("mvv", "", platform, None, x, v, walls)
    np.testing.assert_allclose(new, v * [[-1, 1, 1], [-1, -1, -1], [-1, -1, -1]], atol=1e-9)


@pytest.mark.parametrize("kind", ["specular", "bounce-back", "mixed"])
@pytest.mark.parametrize("scheme", OWN)
@pytest.mark.parametrize("thermostat", [True, False])
def test_programs_with_walls(scheme, kind, thermostat):
    """They pass the checks; only bounce-back needs a vector function; the velocities are shown by trial drifts only."""
    choices = {"walls": kind, "thermostat": thermostat, "execution": Execution(conservative="kernel")}
    options = ProgramOptions(scheme=SCHEMES[scheme], dt=0.02, kT=1.0, seed=1, **choices)
    text = make_program(options).describe()
    assert ("dot(" in text) == (kind != "specular")
    assert text.count("reflect at the walls") == sum(letter == "A" for letter, _ in SCHEMES[scheme].steps(thermostat))
    assert not any(phase in text for phase in ("FORCE_SEEN", "SWEEP_SEEN"))
    plain = make_program(replace(options, walls=""))
    assert not set(plain.per_dof) & set(walls.variables({}, "", 1)) and walls.PUT_BACK not in plain.per_dof


def test_predicted_velocities_turn_too():
    text = make_program(ProgramOptions(SCHEMES["mvv"], 0.02, kT=1.0, seed=1, execution=Execution(), lam=0.65, walls="specular")).describe()
    assert "vp <- vp*(1-2*" in text


# -- beads on which only body forces act -----------------------------------------------------------------------------------------
def alone(**changes) -> dpd.Scene:
    return beads(**{"interacting": np.arange(243).reshape(81, 3) > 5, "body_forces": [dpd.BodyForce((1, 0, 0))]} | changes)


def test_all_forces_on_all_beads_is_the_default():
    assert beads(interacting=np.ones((81, 3), bool)).interacting is None


@pytest.mark.parametrize("value", [np.ones(81, bool), np.ones((80, 3), bool), np.ones((81, 3))])
def test_interacting_is_one_truth_value_for_each_component(value):
    raises(dpd.ParameterError, "bools of shape .81, 3.", lambda: beads(interacting=value))


@pytest.mark.parametrize("scheme", ["middle", "shardlow", "native"])
def test_pair_updates_cannot_leave_out_components(scheme):
    raises(dpd.PlanError, "only scheme='mvv'", lambda: dpd.build(alone(), dt=0.01, scheme=scheme, platform="Reference"))


def test_terms_and_words_of_such_beads():
    built = dpd.build(alone(), dt=0.01, scheme="mvv", platform="Reference", seed=1)
    assert "beads on which only body forces act, along x/y/z: 2/2/2" in built.explain()
    assert "one by one, by the program (on some beads only body forces act)" in built.explain()
    terms = dpd.force_terms(built)
    assert np.allclose(sum(terms.values())[:2], [[1, 0, 0]] * 2) and np.abs(terms["conservative"][2:]).max() > 1
    raises(dpd.PlanError, "a barostat needs a scene where all forces act", lambda: dpd.add_barostat(built, 1.0))
