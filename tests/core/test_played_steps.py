"""Steps that are recorded and played again without Python, also with beads in another order: the same bits as step by step."""

from dataclasses import replace

import numpy as np
import openmm
import pytest
from cases import cases, each_with, raises
from kinds import KINDS, SEED, everything, made, running, same, schemes_of

import openmm_dpd as dpd
from openmm_dpd.base.names import IMPULSES
from openmm_dpd.kernels import charges, pairs, seats
from openmm_dpd.kernels.pairs import PairList
from openmm_dpd.kernels.steps import StepLoop
from openmm_dpd.runtime import threads as thread_count
from openmm_dpd.runtime.tape import Tape
from openmm_dpd.runtime.threads import set_threads

#: Kinds of which all but the first and the last step of a call are played.
PLAYED = {
    "dpd",
    "tilted",
    "two layers",
    "sigma",
    "friction alone",
    "no friction",
    "cold",
    "specular",
    "bounce-back",
    "mixed walls",
    "patterns",
    "ramp",
    "immobile",
    "bonded",
    "bonded, tilted",
    "moving walls",
    "energies",
    "tabulated energies",
    "energies between walls",
    "edpd",
    "tdpd",
    "mdpd",
    "mdpd lucy",
}
STEPS = 23


@pytest.fixture
def counted(monkeypatch):
    """How many steps were played so far."""
    real, found = Tape.play, [0]

    def play(*arguments):
        played = real(*arguments)
        found[0] += played[0]
        return played

    monkeypatch.setattr(Tape, "play", play)
    return found


@pytest.fixture
def together(monkeypatch, two_threads):
    """Two threads, and beads in the order of their cells, whatever the clock says about the cores."""
    monkeypatch.setattr(thread_count, "_WATCH", thread_count._Watch())
    monkeypatch.setattr(thread_count._Watch, "REST", -1.0)
    monkeypatch.setattr(seats, "LATEST", 7)


def run_of(built: dpd.BuiltSystem, *cuts: int) -> dict[str, np.ndarray]:
    """State after calls of so many steps."""
    simulation = running(built)
    for count in cuts:
        simulation.integrator.step(count)
    return everything(simulation.context, built)


def unplayed(monkeypatch, run):
    """What a run gives step by step."""
    with monkeypatch.context() as patch:
        patch.setattr(StepLoop, "_repeats", lambda *arguments: False)
        return run()


def step_by_step(monkeypatch, build, steps_of_it: int = STEPS) -> dict[str, np.ndarray]:
    return unplayed(monkeypatch, lambda: run_of(build(), steps_of_it))


def both_ways(monkeypatch, run, threads: int = 2) -> tuple:
    """What a run gives step by step on one thread, and played on so many."""
    set_threads(1)
    expected = unplayed(monkeypatch, run)
    set_threads(threads)
    return expected, run()


def in_turn(names: str, rows, schemes) -> pytest.MarkDecorator:
    """Each row with each scheme, on one thread and on two in turn: a row has both, and so has a scheme."""
    found = [(*row, scheme, 1 + (m + n) % 2) for m, row in enumerate(rows) for n, scheme in enumerate(schemes)]
    return pytest.mark.parametrize(f"{names}, scheme, threads", found)


def played_schemes_of(kind: str) -> list[str]:
    """Those that play differently: tests take two of them in turn."""
    return [scheme for scheme in ("mvv", "middle", "bababo") if scheme in schemes_of(kind)]


@cases("kind, scheme", *each_with(sorted(KINDS), played_schemes_of, 2))
def test_steps_are_played(kind, scheme, monkeypatch, counted):
    expected = step_by_step(monkeypatch, lambda: made(kind, scheme))
    assert counted == [0] and not same(run_of(made(kind, scheme), STEPS), expected)
    assert (counted[0] > 0) == (kind in PLAYED)
    assert not same(run_of(made(kind, scheme), 1, 4, STEPS - 5), expected)


@cases("kind, scheme", *each_with(sorted(PLAYED), played_schemes_of, 2))
def test_beads_in_another_order(kind, scheme, monkeypatch, counted, together):
    set_threads(1)
    expected = step_by_step(monkeypatch, lambda: made(kind, scheme))
    set_threads(2)
    assert not same(run_of(made(kind, scheme), 3, STEPS - 3), expected) and counted[0] > 0


@pytest.mark.parametrize("kind, threads", [("dpd", 1), ("immobile", 2), ("mixed walls", 1), ("moving walls", 2), ("tdpd", 2)])
def test_another_weight_of_the_prediction(kind, threads, monkeypatch, counted, together):
    def reached() -> dict[str, np.ndarray]:
        built = dpd.build(KINDS[kind](), dt=0.01, scheme="mvv", lam=0.65, seed=SEED, platform="CPU")
        return run_of(built, STEPS, 2, STEPS)

    assert not same(*both_ways(monkeypatch, reached, threads)) and counted[0] > 0


@in_turn("kind", [["edpd"], ["tdpd"], ["energies"], ["mdpd lucy"]], ["mvv", "middle", "O/2 B/2 A B/2 O/2", "B/2 O/2 B/2 A O/2"])
def test_fields(kind, scheme, threads, monkeypatch, counted, together):
    """On a ramp; forces of eDPD depend on temperatures, which sweeps change where positions stay."""
    scene = replace(KINDS[kind](), kT=dpd.TemperatureRamp(1.0, 1.5, 3, 60))

    def reached() -> dict[str, np.ndarray]:
        simulation = running(built := dpd.build(scene, dt=0.005, scheme=scheme, seed=SEED, platform="CPU"))
        for count in (STEPS, 1, 2 * STEPS):
            simulation.integrator.step(count)
            dpd.Observer(built).sample(simulation.context)
        return everything(simulation.context, built)

    assert not same(*both_ways(monkeypatch, reached, threads)) and counted[0] > 0


@pytest.mark.parametrize("scheme", ["mvv", "middle", "bababo"])
def test_charges(scheme, monkeypatch, counted, together):
    """Whose forces the kernel computes."""
    monkeypatch.setattr(charges, "FEW", 0)

    def reached() -> dict[str, np.ndarray]:
        return run_of(dpd.build(KINDS["charged"](), dt=0.01, scheme=scheme, seed=SEED, platform="CPU"), 3, STEPS - 3)

    set_threads(1)
    expected = unplayed(monkeypatch, reached)
    for threads in 1, 2:
        set_threads(threads)
        counted[0] = 0
        assert not same(reached(), expected) and counted[0] > 0


SHEARS = {
    "constant": dpd.LeesEdwards(rate=-1.5),
    "growing": dpd.LeesEdwards(rate=0.5, end_rate=3.0, ramp_time=0.3),
    "oscillating": dpd.LeesEdwards(amplitude=0.7, frequency=5.0),
}


SHEARED = [*(("polymers", shear) for shear in SHEARS), *((kind, "oscillating") for kind in ("bonded", "energies", "mdpd lucy"))]


@in_turn("kind, shear", SHEARED, ["mvv", "middle", "O/2 B/2 A/3 B/2 2A/3 O/2"])
def test_shear(kind, shear, scheme, threads, monkeypatch, counted, together):
    """Box and flow change in place, and are put back with the beads; overlays and segments have lists of their own."""
    scene = polymers() if kind == "polymers" else KINDS[kind]()
    scene = replace(scene, shear=SHEARS[shear], body_forces=())

    def reached() -> dict[str, np.ndarray]:
        return run_of(dpd.build(scene, dt=0.01, scheme=scheme, seed=SEED, platform="CPU"), 3, 2 * STEPS, STEPS)

    assert not same(*both_ways(monkeypatch, reached, threads)) and counted[0] > 0


@pytest.mark.parametrize("scheme, behind, threads", [("mvv", False, 1), ("middle", False, 2), ("middle", True, 1), ("bababo", True, 2)])
def test_driven_walls(behind, scheme, threads, monkeypatch, counted, together):
    """Impulses are part of the state; beads keep their seats, since sums of walls go through them in turn.  Walls that swing are left to
    Python."""
    pair, fluid = dpd.DPD(A=25, gamma=4.5), {"behind": "A", "density": 3.0} if behind else {}
    x = np.random.default_rng(1).random((300, 3)) * [5.0, 5.0, 4.0] + [0, 0, 0.7]

    def reached(**swinging) -> dict[str, np.ndarray]:
        planes = [
            dpd.Wall("z", *place, velocity=(speed, 0.3, 0), **fluid, **swinging)
            for place, speed in (((0.7, "above"), 1), ((4.7, "below"), -1))
        ]
        scene = dpd.Scene({"A": 1.0}, ["A"] * 300, x, {("A", "A"): pair}, kT=1.0, box=[5.0, 5.0, 6.0], walls=planes)
        simulation = running(built := dpd.build(scene, dt=0.02, scheme=scheme, seed=SEED, platform="CPU"))
        for count in (3, 2 * STEPS, STEPS):
            simulation.integrator.step(count)
        parameters = simulation.context.getParameters()
        impulses = np.array([parameters[name] for name in IMPULSES.values() if name in parameters])
        assert np.abs(impulses).max() > 1.0
        return everything(simulation.context, built) | {"impulses": impulses}

    assert not same(*both_ways(monkeypatch, reached, threads)) and counted[0] > 0
    counted[0] = 0
    reached(period=1.0)
    assert counted == [0]


@in_turn("kind", [["dpd"], ["tilted"], ["ramp"], ["bonded"], ["energies"], ["mdpd"], ["tdpd"]], ["mvv", "middle", "bab3"])
def test_steps_of_many_beads(kind, scheme, threads, monkeypatch, counted, together):
    """Whose pairs are listed where they are used; also where a measurement has had them stored, and where columns become full.  With one
    thread none of these is played: that would take more memory and no less time.  Pairs of densities are stored as ever, and those of
    energies where updates sweep over them."""
    if scheme not in schemes_of(kind):
        pytest.skip("this kind does not run with this scheme")
    monkeypatch.setattr(pairs, "MANY", 0)

    def measured() -> tuple:
        simulation, found = running(built := made(kind, scheme)), []
        for count in (4, STEPS):
            simulation.integrator.step(count)
            sample = dpd.Observer(built).sample(simulation.context)
            found.append((sample.pair, sample.virial_conservative, sample.virial_dissipative, sample.laplacian))
        return *found, everything(simulation.context, built)

    set_threads(1)
    *expected, state = unplayed(monkeypatch, measured)
    set_threads(threads)
    monkeypatch.setattr(PairList, "make_passing_room", _just_enough)
    *found, reached = measured()
    assert found == expected and not same(reached, state)
    assert (counted[0] > 0) == (threads == 2 or kind == "mdpd" or (kind, scheme) == ("energies", "middle"))


def _just_enough(self):
    self._passing = self._room(self.threads * int(self._stored.found.max()))


@in_turn("kind", [["dpd"], ["bonded"]], ["middle", "B A/2 S A/2", "B/2 O A B/2", "B/2 O/2 B/2 A O/2"])
def test_measured_between_calls(kind, scheme, threads, monkeypatch, counted, together):
    """So that the force is there when beads get seats, at another step size too, in words that sweep before beads drift too."""

    def measured() -> dict[str, np.ndarray]:
        simulation = running(built := made(kind, scheme))
        for dt in (0.01, 0.02):
            simulation.integrator.setStepSize(dt)
            for count in (STEPS, 2 * STEPS):
                simulation.integrator.step(count)
                dpd.Observer(built).sample(simulation.context)
        return everything(simulation.context, built)

    assert not same(*both_ways(monkeypatch, measured, threads)) and counted[0] > 0


def test_a_parameter_is_set_before_anything_else(together):
    """The factor of body forces, before beads were ever put in order."""
    found = []
    for threads in (1, 2):
        set_threads(threads)
        built = dpd.build(polymers(), dt=0.01, scheme="middle", seed=SEED, platform="CPU")
        simulation = built.simulation()
        simulation.context.setParameter("dpd_body_force", 2.0)
        simulation.step(20)
        found.append(everything(simulation.context, built))
    assert not same(*found)


def polymers(beads: int = 600) -> dpd.Scene:
    """Chains of bonds, angles and dihedrals of two types, in a box with cells."""
    edge, rng = (beads / 3.0) ** (1 / 3), np.random.default_rng(3)
    x = np.cumsum(rng.normal(size=(beads // 10, 10, 3)) * 0.3, axis=1).reshape(-1, 3) + np.repeat(
        rng.random((beads // 10, 3)) * edge, 10, axis=0
    )
    index = np.arange(beads).reshape(-1, 10)
    bonds = np.stack([index[:, :-1].ravel(), index[:, 1:].ravel()], axis=1)
    angles = np.stack([index[:, k : k + 8].ravel() for k in range(3)], axis=1)
    dihedrals = np.stack([index[:, k : k + 7].ravel() for k in range(4)], axis=1)
    pairs = {("A", "A"): dpd.DPD(A=25, gamma=4.5), ("A", "B"): dpd.DPD(A=30, gamma=4.5, cutoff=1.1), ("B", "B"): dpd.DPD(A=25, gamma=9.0)}
    return dpd.Scene(
        {"A": 1.0, "B": 2.0}, list("AB") * (beads // 2), x, pairs, kT=1.0, box=[edge] * 3,
        bonds=[dpd.HarmonicBonds(bonds, 4.0, 0.3)], angles=[dpd.HarmonicAngles(angles, 2.0, 2.5)],
        dihedrals=[dpd.HarmonicDihedrals(dihedrals, 0.5, 1, 1)], bonded_factors=(0.0, 0.5, 1.0),
        body_forces=[dpd.BodyForce([0.1, 0.0, 0.0], types="B")], segments=dpd.SegmentalRepulsion(A=15, cutoff=0.6),
    )  # fmt: skip


@pytest.mark.parametrize("scheme", ["mvv", "bab3"])
@pytest.mark.parametrize("threads", [1, 2])
def test_chains(scheme, threads, monkeypatch, counted, together):
    """From a start far from equilibrium, in which lists get more room and beads are watched."""
    scene = polymers()
    set_threads(1)
    expected = step_by_step(monkeypatch, lambda: dpd.build(scene, dt=0.01, scheme=scheme, seed=SEED, platform="CPU"), 60)
    set_threads(threads)
    assert not same(run_of(dpd.build(scene, dt=0.01, scheme=scheme, seed=SEED, platform="CPU"), 20, 40), expected)
    assert 0 < counted[0] < 58


@in_turn("beads, cuts", [(600, [10] * 20), (601, [10] * 20), (602, [40, 360])], ["shardlow", "bab3"])
def test_lists_that_always_want_more_room(scheme, threads, beads, cuts, monkeypatch, counted, together):
    """Wherever a list gets more room, what was recorded with the arrays before is not played with them.  The last one does so after more
    steps in a row than a state is kept for."""

    def make_room(self):
        start = np.zeros_like(self._stored.start)
        start[1:] = np.cumsum(np.maximum(np.diff(self._stored.start), self._stored.found))
        pi, pj, geometry, factors = self._room(int(start[-1]))
        self._stored = self._stored._replace(start=start, pi=pi, pj=pj, geometry=geometry, factors=factors)

    monkeypatch.setattr(PairList, "_make_room", make_room)
    edge = (beads / 3.0) ** (1 / 3)
    x = np.random.default_rng(beads).random((beads, 3)) * edge
    scene = dpd.Scene({"W": 1.0}, ["W"] * beads, x, {("W", "W"): dpd.DPD(A=25, gamma=4.5)}, kT=1.0, box=[edge] * 3)
    set_threads(1)
    expected = step_by_step(monkeypatch, lambda: dpd.build(scene, dt=0.05, scheme=scheme, seed=SEED, platform="CPU"), sum(cuts))
    set_threads(threads)
    assert not same(run_of(dpd.build(scene, dt=0.05, scheme=scheme, seed=SEED, platform="CPU"), *cuts), expected)
    assert 0 < counted[0] < (150 if max(cuts) == 10 else 380)


@pytest.mark.parametrize("bead, scheme", [(55, "mvv"), (301, "middle")])
def test_a_bead_runs_away_from_its_seat(bead, scheme, monkeypatch, counted, together):
    """Half of the beads do not move, and one is pulled: it is found in the same step by its own number, whoever has that number's seat."""
    edge, types = 200.0 ** (1 / 3), np.where(np.arange(600) == bead, "B", "A").tolist()
    x = np.random.default_rng(2).random((600, 3)) * edge
    pulled = [dpd.BodyForce([60.0, 0.0, 0.0], types="B")]
    mobile, pair = np.arange(600) % 2 == 1, dpd.DPD(A=25, gamma=0.1)
    scene = dpd.Scene({"A": 1.0, "B": 1.0}, types, x, {("*", "*"): pair}, kT=1.0, box=[edge] * 3, mobile=mobile, body_forces=pulled)

    def failed() -> str:
        simulation = running(dpd.build(scene, dt=0.02, scheme=scheme, seed=SEED, platform="CPU"))
        simulation.integrator.step(5)  # beads get seats where they have been put into cells
        simulation.integrator.straight = 200
        with pytest.raises(openmm.OpenMMException) as error:
            simulation.integrator.step(200)
        return str(error.value)

    expected, found = both_ways(monkeypatch, failed)
    assert found == expected and f"bead {bead} moves" in expected and counted[0] > 0


@pytest.mark.parametrize("scheme", ["aboba", "B O A"])
def test_forces_at_old_positions_are_not_computed_again(scheme, monkeypatch, counted):
    """Where a step ends with a drift the force is that before it."""
    real, sums = StepLoop._sum, [0]

    def summed(*arguments):
        sums[0] += 1
        real(*arguments)

    monkeypatch.setattr(StepLoop, "_sum", summed)
    run_of(made("dpd", scheme), 5, 40)
    assert counted[0] > 20 and sums[0] == 45 - counted[0]


@pytest.mark.parametrize("scheme", ["mvv", "middle"])
def test_a_fast_bead_that_does_not_run_away(scheme, monkeypatch, counted):
    """One component of its velocity is beyond what a bead has in one of them that runs away, at least: steps with it are played as well."""
    edge = 200.0 ** (1 / 3)
    x, v = np.random.default_rng(2).random((600, 3)) * edge, np.zeros((600, 3))
    v[17, 1] = 35.0  # 0.7 cutoffs a step
    scene = dpd.Scene({"A": 1.0}, ["A"] * 600, x, {("A", "A"): dpd.DPD(A=5, gamma=0.1)}, kT=1.0, box=[edge] * 3, velocities=v)
    expected, found = both_ways(monkeypatch, lambda: run_of(dpd.build(scene, dt=0.02, scheme=scheme, seed=SEED, platform="CPU"), 30), 1)
    assert not same(found, expected) and counted[0] >= 20


def test_a_step_that_fails_is_python_s(monkeypatch, counted, together):
    """The state is that of the last call, and the message has the number of the bead."""
    for threads in (1, 2):
        built = made("dpd", "middle")
        set_threads(threads)
        simulation = running(built)
        simulation.integrator.step(5)
        before = everything(simulation.context, built)
        x = simulation.context.getState(positions=True).getPositions(asNumpy=True)._value.copy()
        velocities = simulation.context.getState(velocities=True).getVelocities(asNumpy=True)._value
        wrong = velocities.copy()
        wrong[17] = 1e6
        simulation.context.setVelocities(wrong)
        raises(openmm.OpenMMException, r"step 6: bead 17 moves", simulation.integrator.step, 20)
        simulation.context.setVelocities(velocities)
        assert np.array_equal(simulation.context.getState(positions=True).getPositions(asNumpy=True)._value, x)
        assert not same(everything(simulation.context, built), before)
