"""Rigid bodies: free rotation, sweeps and steps beside an oracle of projectors, conservation, restarts, measurements, and what is refused."""

from dataclasses import replace

import numpy as np
import openmm
import oracle
import pytest
from cases import cases, raises, refused
from openmm import app, unit
from oracle_bodies import Constrained
from scenes import noise_of, oracle_params, state_of

import openmm_dpd as dpd
from openmm_dpd.kernels.engine import PairEngine
from openmm_dpd.measure import Observer, StressReporter
from openmm_dpd.model.bodies import GivenBody
from openmm_dpd.model.schemes import scheme_of
from openmm_dpd.plan.plan import make_plan
from openmm_dpd.runtime.threads import set_threads

PAIRS = {
    ("C", "C"): dpd.DPD(A=20, gamma=9, exponent=0.7),
    ("C", "W"): dpd.DPD(A=31, gamma=3, cutoff=1.2),
    ("W", "W"): dpd.DPD(A=25, gamma=4.5),
}
EDGE, TOTAL = 3.0, 70
#: Beads of a lump, a rod, a plate that only turns, a pair of beads, and a lump that only moves along x.
ROD = np.outer(np.arange(4) - 1.5, [0.2, 0.3, 0.1])
BODIES = [
    (range(7), "xyz", True),
    (range(7, 11), "xyz", True),
    (range(11, 16), "", True),
    ((30, 41), "xyz", True),
    (range(50, 54), "x", False),
]


def scene(bodies=BODIES, *, seed=1, kT=1.2, inner=False, box=(EDGE,) * 3, **options) -> dpd.Scene:
    """Beads at random with bodies of unequal masses, strewn over many images of the box."""
    rng = np.random.default_rng(seed)
    x, mass = rng.random((TOTAL, 3)) * EDGE, rng.uniform(0.5, 20.0, TOTAL)
    for k, (beads, _, _) in enumerate(bodies):
        beads, places = list(beads), rng.normal(size=(len(list(beads)), 3)) * 0.4
        x[beads] = rng.random(3) * EDGE + rng.integers(-2, 3, 3) * EDGE + (ROD if k == 1 else places)
    inside = np.isin(np.arange(TOTAL), [bead for beads, _, _ in bodies for bead in beads])
    made = [dpd.Body(beads, moves, turns, inner) for beads, moves, turns in bodies]
    types = np.where(inside, "C", "W").tolist()
    mass[~inside] /= 5.0
    return dpd.Scene({"C": 1.0, "W": 1.0}, types, x, PAIRS, kT, box=box, bead_masses=mass, **{"bodies": made, **options})


def constrained(of: dpd.Scene) -> Constrained:
    return Constrained(of.bead_masses, [(body.beads, body.moves, body.turns) for body in of.bodies])


def order_of(engine: PairEngine, of: dpd.Scene) -> list[tuple[int, int]]:
    """Pairs in the order of a sweep: first those of free beads, then those with beads of bodies, column by column."""
    pairs, body = engine.lists[0], np.full(of.n_beads, -1)
    for number, its in enumerate(of.bodies):
        body[its.beads] = number
    i, j, *_ = pairs.listed()
    now = pairs.arrays
    rows = np.concatenate([np.arange(start, start + found) for start, found in zip(now.start.tolist(), now.found.tolist(), strict=False)])
    first = [(a, b) for a, b in zip(i.tolist(), j.tolist(), strict=True) if body[a] < 0 and body[b] < 0]
    second = zip(now.order[now.pi[rows]].tolist(), now.order[now.pj[rows]].tolist(), strict=True)
    second = [(a, b) for a, b in second if (body[a] >= 0 or body[b] >= 0) and body[a] != body[b]]
    assert len(first) > 50 and len(second) > 50
    return [(min(pair), max(pair)) for pair in first + second]


def swept(of: dpd.Scene, engine: PairEngine, x, v, dt, counter, shardlow=False) -> np.ndarray:
    """What the oracle makes of a sweep."""
    engine.prepare(x, of.box)
    params, types = oracle_params(of), of.type_ids
    noise = noise_of(of.n_beads, 21, counter, of.initial_kT, streams=1)

    def strength(i: int, j: int, r: float) -> float:
        a, b = types[i], types[j]
        return params.gamma[a, b] * (1 - r / params.cutoff[a, b]) ** (2 * params.s[a, b])

    return constrained(of).sweep(x, v, order_of(engine, of), strength, of.box, of.initial_kT, dt, lambda i, j: noise(i, j, 0), shardlow)


def engine_of(of: dpd.Scene, scheme: str = "middle") -> PairEngine:
    return PairEngine(make_plan(of, dt=0.02, scheme=scheme, seed=21, platform="CPU").spec)


@cases("word", "B A/2 O A/2", "S B/2 A B/2", "O/2 B/3 3A/4 B/3 A/4 B/3 O/2")
def test_words_step_as_beads_do_whose_motion_is_projected(word):
    """1e-9 after three steps: what is left is the second order of the free rotation of the lumps in each drift."""
    of, dt = scene(), 0.002
    built = dpd.build(of, dt=dt, scheme=word, seed=21, platform="Reference")
    beads, engine, counter = constrained(of), engine_of(of, word), 0
    simulation = built.simulation()
    x, v = state_of(simulation.context)
    np.testing.assert_allclose(v, beads.projected(x, v), rtol=0, atol=1e-13)
    for _ in range(3):
        for letter, part in scheme_of(word).steps(True):
            time = float(part) * dt
            if letter == "A":
                x, v = beads.drift(x, v, time)
            elif letter == "B":
                engine.prepare(x, of.box)
                v = beads.projected(x, v + time * engine.forces(1, None, 0.0, 1.0, 0, 0)[1] / of.bead_masses[:, None])
            else:
                counter += 1
                v = swept(of, engine, x, v, time, counter, letter == "S")
    simulation.step(3)
    found = state_of(simulation.context)
    np.testing.assert_allclose(found[0], x, rtol=0, atol=2e-9)
    np.testing.assert_allclose(found[1], v, rtol=0, atol=2e-7)


def test_a_step_of_mvv_is_that_of_beads_whose_motion_is_projected():
    of, dt = scene(inner=True), 0.002
    simulation, beads = dpd.build(of, dt=dt, scheme="mvv", seed=21, platform="Reference").simulation(), constrained(of)
    engine, m = engine_of(of, "mvv"), of.bead_masses[:, None]
    x, v = state_of(simulation.context)
    force = _all_forces(engine, of, x, v, dt, 0)
    for counter in (1, 2, 3):
        x, half = beads.drift(x, beads.projected(x, v + 0.5 * dt * force / m), dt)
        force = _all_forces(engine, of, x, half, dt, counter)
        v = beads.projected(x, half + 0.5 * dt * force / m)
    simulation.step(3)
    found = state_of(simulation.context)
    np.testing.assert_allclose(found[0], x, rtol=0, atol=2e-9)
    np.testing.assert_allclose(found[1], v, rtol=0, atol=2e-7)


@cases("scheme", "middle", "mvv")
def test_given_masses_and_inertias_move_bodies_not_those_of_their_beads(scheme):
    """Beads of other masses in bodies that are given the mass, centre and tensor of inertia of the first ones: the same to rounding, with
    friction and noise, and of the pressure; cut in two it has the same bits."""
    of = scene(velocities=np.random.default_rng(6).normal(size=(TOTAL, 3)))
    start = state_of(dpd.build(of, dt=0.004, scheme=scheme, seed=21, platform="Reference").simulation().context)[1]
    given, masses = [], of.bead_masses.copy()
    for body in of.bodies:
        m, x = of.bead_masses[body.beads], of.positions[body.beads]
        centre, others = m @ x / m.sum(), np.random.default_rng(len(m)).permutation(m) * 1.7 + 0.3
        arms = np.sqrt(m)[:, None] * (x - centre)
        masses[body.beads] = others
        given.append(GivenBody(body.beads, body.moves, body.turns, False, m.sum(), centre, np.sum(arms**2) * np.eye(3) - arms.T @ arms))
    ends = []
    for bodies, mass, runs in ((of.bodies, of.bead_masses, (8,)), (given, masses, (8,)), (given, masses, (3, 5))):
        built = dpd.build(
            replace(of, velocities=start, bodies=bodies, bead_masses=mass), dt=0.004, scheme=scheme, seed=21, platform="Reference"
        )
        simulation = built.simulation()
        for steps in runs:
            simulation.step(steps)
        measured = Observer(built).sample(simulation.context)
        ends.append([*state_of(simulation.context), measured.pressure(), measured.potential, measured.kinetic])
    for found, expected in zip(ends[1][:4], ends[0][:4], strict=True):
        np.testing.assert_allclose(found, expected, rtol=1e-9, atol=1e-9)
    assert all(np.array_equal(*pair) for pair in zip(ends[1], ends[2], strict=True)) and ends[1][4] > 1.2 * ends[0][4]


def _all_forces(engine: PairEngine, of: dpd.Scene, x, v, dt: float, counter: int) -> np.ndarray:
    engine.prepare(x, of.box)
    return engine.forces(7, v, of.initial_kT, dt, 21, counter)[1]


def test_a_sweep_conserves_momentum_and_angular_momentum():
    of = scene(BODIES[:2] + BODIES[3:4], box=None)
    x, engine = of.positions, engine_of(of)
    engine.prepare(x, None)
    v = constrained(of).projected(x, np.random.default_rng(2).normal(size=x.shape))
    change = of.bead_masses[:, None] * engine.sweep(v, 1.2, 0.5, 21, 1)
    for total in (change.sum(axis=0), np.cross(x, change).sum(axis=0)):
        assert np.abs(total).max() < 1e-12 * np.abs(np.cross(x, change)).sum()
    assert np.abs(change).max() > 0.1


def rotor(places, mass, spin, steps: int, dt: float) -> tuple[np.ndarray, np.ndarray, dpd.Scene]:
    """Positions and velocities of a free body after some steps."""
    n = len(places)
    x = np.concatenate([np.asarray(places, float), [[50.0, 0, 0], [50.5, 0, 0]]])
    v = np.zeros_like(x)
    m = np.append(np.asarray(mass, float), [1.0, 1.0])
    v[:n] = np.cross(spin, x[:n] - m[:n] @ x[:n] / m[:n].sum())
    options = {"bead_masses": m, "velocities": v, "bodies": [dpd.Body(range(n))]}
    of = dpd.Scene({"C": 1.0}, ["C"] * (n + 2), x, {("C", "C"): dpd.DPD(A=1, gamma=1, cutoff=20)}, 0.0, **options)
    simulation = dpd.build(of, dt=dt, scheme="B A O", seed=1, platform="Reference").simulation()
    simulation.step(steps)
    return *(each[:n] for each in state_of(simulation.context)), of


SPHERE = np.array([[1, 0, 0], [-1, 0, 0], [0, 1, 0], [0, -1, 0], [0, 0, 1], [0, 0, -1]], float) * 0.7


@cases(
    "places, mass",
    {
        "sphere": (SPHERE, [1.0] * 6),
        "rod": (ROD, [1.0, 2.0, 3.0, 1.0]),
        "two beads": (ROD[:2], [1.0, 5.0]),
        "disc": (SPHERE[:4], [2.0] * 4),
        "top": (np.concatenate([SPHERE[:4], [[0, 0, 2.0]]]), [1.0] * 4 + [7.0]),
    },
)
def test_spheres_rods_and_tops_turn_exactly(places, mass):
    """At a step in which they turn by more than a radian."""
    turn = np.linalg.qr(np.random.default_rng(3).normal(size=(3, 3)))[0]
    places = places @ turn
    spin = np.array([1.1, -0.7, 2.0])
    x, v, of = rotor(places, mass, spin, 4, 0.6)
    beads = constrained(of)
    start = beads.projected(of.positions, of.velocities)
    expected_x, expected_v = beads.drift(of.positions, start, 2.4)
    np.testing.assert_allclose(x, expected_x[: len(x)], rtol=0, atol=1e-10)
    np.testing.assert_allclose(v, expected_v[: len(x)], rtol=0, atol=1e-10)


def test_any_body_turns_to_second_order_with_its_momentum_and_a_bounded_energy():
    places, mass, spin = np.random.default_rng(4).normal(size=(6, 3)) * [0.3, 0.8, 1.5], [1, 30, 2, 1000, 1, 1], np.array([1.1, -0.7, 2.0])
    errors = []
    for steps in (40, 80):
        x, v, of = rotor(places, mass, spin, steps, 4.0 / steps)
        m = of.bead_masses[:6, None]
        expected = constrained(of).drift(of.positions, of.velocities, 4.0)[0][:6]
        errors.append(np.abs(x - expected).max())
        before, after = (np.cross(p, m * u).sum(axis=0) for p, u in ((of.positions[:6], of.velocities[:6]), (x, v)))
        np.testing.assert_allclose(after, before, rtol=0, atol=1e-12 * np.linalg.norm(before))
    assert errors[0] < 0.1 and errors[0] / errors[1] == pytest.approx(4.0, rel=0.1)
    x, v, of = rotor(places, mass, spin, 3000, 0.05)
    kinetic = [np.sum(of.bead_masses[:6, None] * u**2) for u in (of.velocities[:6], v)]
    assert kinetic[1] == pytest.approx(kinetic[0], rel=0.02)


@cases("scheme", "middle", "mvv", "shardlow", "O/2 B/2 A B/2 O/2")
def test_the_same_bits_however_a_run_is_cut_and_shared(scheme, tmp_path):
    """In pieces, by checkpoints and XML into new Contexts, at a temperature that was changed; on two threads."""

    def run(*pieces: int, threads: int = 1) -> tuple[np.ndarray, ...]:
        set_threads(threads)
        try:
            simulation = made()
            for k, steps in enumerate(pieces):
                if k == 1:
                    simulation.saveCheckpoint(str(tmp_path / "c"))
                    simulation = made()
                    simulation.loadCheckpoint(str(tmp_path / "c"))
                elif k == 2:
                    simulation.saveState(str(tmp_path / "x"))
                    simulation = made()
                    simulation.loadState(str(tmp_path / "x"))
                simulation.step(steps)
            return state_of(simulation.context)
        finally:
            set_threads(1)

    def made() -> app.Simulation:
        return dpd.build(scene(), dt=0.01, scheme=scheme, seed=21, platform="CPU").simulation()

    whole = run(40)
    for other in (run(7, 12, 1, 20), run(40, threads=2)):
        np.testing.assert_array_equal(whole[0], other[0])
        np.testing.assert_array_equal(whole[1], other[1])


def test_temperature_and_pressure_are_those_of_bodies():
    of = scene()
    built = dpd.build(of, dt=0.01, scheme="shardlow", seed=21, platform="CPU")
    simulation = built.simulation()
    x, v = state_of(simulation.context)
    sample = Observer(built).sample(simulation.context)
    free = 3 * (TOTAL - 22) + 6 + 5 + 3 + 5 + 1
    assert sample.dof == free - 0  # the plate takes up momentum along all axes
    assert sample.kT == pytest.approx(1.2 * (free - 3) / free)
    # the pressure from the work of a change of the volume, in which bodies move as wholes
    energies = []
    for factor in (1 - 1e-6, 1 + 1e-6):
        moved = x.copy()
        centres = {k: of.bead_masses[b.beads] @ x[b.beads] / of.bead_masses[b.beads].sum() for k, b in enumerate(of.bodies)}
        inside = np.concatenate([body.beads for body in of.bodies])
        outside = np.setdiff1d(np.arange(TOTAL), inside)
        moved[outside] *= factor
        for k, body in enumerate(of.bodies):
            moved[body.beads] += (factor - 1) * centres[k]
        params = oracle_params(of)
        counted = lambda i, j: 0.0 if any({i, j} <= set(b.beads.tolist()) for b in of.bodies) else 1.0  # noqa: E731
        energies.append(oracle.conservative(moved, of.type_ids, params, np.full(3, EDGE * factor), counted).energy)
    virial = -(energies[1] - energies[0]) / 2e-6
    speeds = [of.bead_masses[b.beads] @ v[b.beads] / of.bead_masses[b.beads].sum() for b in of.bodies]
    kinetic = np.sum(of.bead_masses[outside, None] * v[outside] ** 2)
    kinetic += sum(of.bead_masses[b.beads].sum() * u @ u for b, u in zip(of.bodies, speeds, strict=True))
    assert sample.pressure(full=False) == pytest.approx((kinetic + virial) / (3 * EDGE**3), rel=1e-5)
    raises(dpd.ParameterError, "keep bodies rigid", StressReporter, 10, built)


def test_positions_that_are_set_are_those_of_whole_bodies_and_the_minimiser_keeps_them(unsynced):
    of = scene()
    built = dpd.build(of, dt=0.01, seed=21, platform="CPU")
    simulation = built.simulation()
    simulation.minimizeEnergy(maxIterations=5)
    x, _ = state_of(simulation.context)
    np.testing.assert_array_equal(x[of.bodies[0].beads], of.positions[of.bodies[0].beads])
    assert np.abs(x - of.positions).max() > 0.01
    moved = x + 0.3
    simulation.context.setPositions(moved)
    simulation.context.setVelocitiesToTemperature(300)
    simulation.step(3)
    wrong = moved.copy()
    wrong[8] += 0.1
    simulation.context.setPositions(wrong)
    with pytest.raises(openmm.OpenMMException, match="body 1 is not rigid: bead"):
        simulation.step(1)


def test_barostats_move_bodies_as_wholes():
    of = scene()
    built = dpd.build(of, dt=0.01, seed=21, platform="CPU")
    dpd.add_barostat(built, 20.0, interval=2)
    simulation = built.simulation()
    simulation.step(60)
    box = simulation.context.getState().getPeriodicBoxVectors(asNumpy=True).value_in_unit(unit.nanometer)
    assert abs(box[0, 0] - EDGE) > 1e-4
    x, _ = state_of(simulation.context)
    beads = of.bodies[0].beads
    np.testing.assert_allclose(
        np.linalg.norm(x[beads] - x[beads[0]], axis=1), np.linalg.norm(of.positions[beads] - of.positions[beads[0]], axis=1)
    )


def test_a_body_does_not_meet_its_own_image():
    """In a box that is not twice as wide as the body, at any rotation."""
    x = np.random.default_rng(8).normal(size=(9, 3)) * 0.9
    options = {"box": [2.5] * 3, "bodies": [dpd.Body(range(9))], "velocities": np.cross([30.0, 10.0, -20.0], x)}
    built = dpd.build(dpd.Scene({"C": 1.0}, ["C"] * 9, x, {("C", "C"): PAIRS["C", "C"]}, 1.0, **options), dt=0.001, seed=1, platform="CPU")
    simulation, observer = built.simulation(), Observer(built)
    start = state_of(simulation.context)[1]
    for _ in range(5):
        simulation.step(9)
        assert observer.sample(simulation.context).potential == 0.0
    assert np.abs(start).max() > 10.0 and np.abs(state_of(simulation.context)[1]).max() > 10.0


def free(**changes) -> dpd.Scene:
    return replace(scene(), **changes)


test_what_is_refused = refused(
    dpd.DPDError,
    (lambda: dpd.Body([1]), "at least two beads"),
    (lambda: dpd.Body([1, 1]), "different ones"),
    (lambda: dpd.Body([1, 2], "up"), "axes such as"),
    (lambda: free(bodies=[dpd.Body([1, 2]), dpd.Body([2, 3])]), "bead 2 is in two bodies"),
    (lambda: free(bodies=[dpd.Body([1, 500])]), "has bead 500"),
    (lambda: free(bodies=[dpd.Body([1, 2])], mobile=np.arange(TOTAL) != 2), "bead 2 of body 0 is immobile"),
    (lambda: free(bodies=[dpd.Body([0, 1])], positions=np.ones((TOTAL, 3))), "at one place"),
    (lambda: free(shear=dpd.LeesEdwards(rate=0.1)), "shear does not move bodies"),
    (lambda: free(walls=[dpd.Wall("z", -100.0, "above")], box=None), "one by one"),
    (lambda: dpd.build(scene(), dt=0.01, loop=False), "whole steps in double precision: switched off"),
    (lambda: dpd.build(scene(), dt=0.01, scheme="mvv", lam=0.6), "lam must be 0.5"),
    (lambda: dpd.build(scene(), dt=0.01, conservative="openmm"), "rigid bodies need whole steps"),
    (lambda: dpd.build(free(pairs={("*", "*"): dpd.DPD(A=1, gamma=1, gamma_perp=1)}), dt=0.01), "gamma_perp"),
    (lambda: dpd.build(free(pairs={("*", "*"): dpd.MDPD(A=-1, B=2, gamma=1, cutoff_B=0.7)}), dt=0.01), "not of"),
)


def test_openmm_by_itself_does_not_carry_out_their_programs():
    built = dpd.build(scene(), dt=0.01, seed=21, platform="Reference")
    simulation = built.simulation()
    with pytest.raises(openmm.OpenMMException, match="rigid bodies are in the pair kernel's whole steps alone"):
        openmm.CustomIntegrator.step(simulation.integrator, 1)
