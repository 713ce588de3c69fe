"""Whole steps in the kernel's loop: the same as by programs, to rounding, and the same bits however a run is cut."""

import io
import itertools
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import openmm
import oracle
import pytest
from cases import each_with, every_pair
from devices import DEVICES
from judged import any_seed
from kinds import BESIDE, KINDS, NAMED, WORDS, N, differences, everything, made, plain_context, running, same, schemes_of
from scenes import BOXES, EXTENDED, beads, factor_of, fluid, listed_pairs, noise_of, oracle_params, place, run_of, state_of, stepped

import openmm_dpd as dpd
from openmm_dpd.base.names import BODY_FORCE, COUNTER
from openmm_dpd.kernels.engine import PairEngine
from openmm_dpd.model.schemes import read_word
from openmm_dpd.plan.plan import make_plan
from openmm_dpd.stats import block_average, ratio_average

PLATFORM = pytest.mark.parametrize("platform", ["Reference", "CPU"])
EVERY = [(kind, scheme) for kind in KINDS for scheme in schemes_of(kind)]
SOME = [  # Every kind with three schemes, and every scheme with many kinds.
    (kind, scheme)
    for number, kind in enumerate(KINDS)
    for scheme in {schemes_of(kind)[(4 * number + 3 * k) % len(schemes_of(kind))]: None for k in range(3)}
]
#: Every kind with four schemes.
MORE = each_with(KINDS, schemes_of, 4)
#: One scheme for each kind, another one for the next.
FEW = [(kind, schemes_of(kind)[(5 * number + 2) % len(schemes_of(kind))]) for number, kind in enumerate(KINDS)]


def test_the_kinds_are_looped():
    """Nothing of this file is about the general program alone."""
    for kind in KINDS:
        built = made(kind, "mvv")
        assert built.plan.execution.looped and built.integrator.whole is not None, kind
        assert made(kind, "mvv", loop=False).integrator.whole is None
    assert {scheme for _, scheme in SOME} == {scheme for _, scheme in FEW} == {*NAMED, *WORDS}


# -- beside programs -----------------------------------------------------------------------------------------------------------------
def too_far(found: dict, expected: dict, limit: float) -> dict[str, float]:
    """Deviations beyond a limit, in units of what is typical; of positions, how far beads go in 0.1 ps."""
    return {name: value for name, value in differences(found, expected, 0.1).items() if not value <= limit}


#: Sweeps that follow each other, and all kicks behind all drifts.
FOLLOWING = ("O/2 O/2 B/2 A B/2", "B/2 A/2 S/2 S/2 A/2 B/2", "A B O", "A O B", "O A B")


@pytest.mark.parametrize(("kind", "scheme"), [*MORE, *(("dpd", word) for word in FOLLOWING)])
def test_twenty_steps_are_those_of_the_program_from_xml(kind, scheme):
    """Every kind with four schemes, and every scheme with many kinds; lattice sums and formulas of the position kick beside the loop."""
    built = made(kind, scheme)
    context, simulation = plain_context(built), running(made(kind, scheme))
    before = everything(context, built)
    context.getIntegrator().step(20)
    simulation.integrator.step(20)
    expected = everything(context, built)
    assert not too_far(everything(simulation.context, built), expected, 1e-12)
    assert np.abs(expected["v"] - before["v"]).max() > 0.1  # a lot happened


def comparable(pairs):
    """Forces that stay OpenMM's act before and after a step of the loop, and in the middle of one of a program without it."""
    return [(kind, scheme) for kind, scheme in pairs if kind not in BESIDE or scheme in ("middle", WORDS[0])]


@pytest.mark.parametrize(("kind", "scheme"), comparable(SOME))
def test_twenty_steps_are_those_of_a_program_without_a_loop(kind, scheme):
    """... where OpenMM computes bonds, overlays and forces on single beads; in patterns it rounds positions that are folded."""
    first, second = (running(made(kind, scheme, loop=loop)) for loop in (False, True))
    for one in (first, second):
        one.integrator.step(20)
    expected = everything(first.context, first.built)
    assert not too_far(everything(second.context, second.built), expected, 1e-6 if kind == "patterns" else 1e-12)


@pytest.mark.parametrize("scheme", ["mvv", "aboba", WORDS[0]])
@pytest.mark.parametrize("kind", ["bonded", "patterns"])
def test_the_scale_of_body_forces(kind, scheme):
    """Set between steps: nothing, half, reversed."""
    general, looped = made(kind, scheme, loop=False), made(kind, scheme)
    first, second = running(general), running(looped)
    for scale in (0.0, 0.5, -1.0, -1.0, 1.0):
        for one in (first, second):
            one.context.setParameter(BODY_FORCE, scale)
            one.step(3)
        found = differences(everything(second.context, looped), everything(first.context, general), 0.01)
        assert max(found.values()) < (1e-6 if kind == "patterns" else 1e-10)


# -- beside the oracle ---------------------------------------------------------------------------------------------------------------
class Lettered:
    """A word carried out letter by letter with the oracle's forces and sweeps."""

    def __init__(self, scene, word: str, dt: float, seed: int):
        self.scene, self.letters, self.dt, self.seed, self.counter = scene, read_word(word), dt, seed, 0
        self.x, self.v = scene.positions.copy(), scene.velocities.copy()
        self.inv_mass, self.params, self.factor = 1 / scene.bead_masses, oracle_params(scene), factor_of(scene)
        self.engine = PairEngine(make_plan(scene, dt=dt, scheme=word, seed=seed).spec)

    def step(self) -> None:
        scene = self.scene
        for letter, part in self.letters:
            time = float(part) * self.dt
            if letter == "A":
                self.x = self.x + time * self.v
            elif letter == "B":
                force = oracle.conservative(self.x, scene.type_ids, self.params, scene.box, self.factor).forces
                self.v = self.v + time * self.inv_mass[:, None] * force
            else:
                self.counter += 1
                self.engine.prepare(self.x, scene.box)
                noise = noise_of(scene.n_beads, self.seed, self.counter, scene.initial_kT)
                update = oracle.shardlow_update if letter == "S" else oracle.ou_update
                common = (scene.type_ids, self.params, scene.box, scene.initial_kT, time, noise, update, self.factor)
                self.v = oracle.sweep(self.x, self.v, listed_pairs(self.engine), self.inv_mass, *common)


ODD = (*WORDS, "S/2 B/2 A B/2 S/2", "B/5 A O 4B/5", "A/3 B/2 A/3 O B/2 A/3", "B/2 A/4 O/2 A/2 O/2 A/4 B/2", "A B O", "O A B")


@every_pair("word, loop, platform", ODD, (True, False), ("Reference", "CPU"))
def test_words_step_as_their_letters_say(word, loop, platform):
    """1e-12 after one step, 1e-11 after ten."""
    scene = fluid(EXTENDED, BOXES["tilted"], n=50, density=1.0, kT=1.3, spread=0)
    built = dpd.build(scene, dt=0.03, scheme=word, platform=platform, conservative="kernel", seed=11, loop=loop)
    simulation, expected = running(built, platform), Lettered(scene, word, 0.03, 11)
    for steps, limit in ((1, 1e-12), (9, 1e-11)):
        simulation.step(steps)
        for _ in range(steps):
            expected.step()
        x, v = state_of(simulation.context)
        assert np.abs(x - expected.x).max() < limit and np.abs(v - expected.v).max() < limit
    assert simulation.context.getParameter(COUNTER) == expected.counter
    assert np.abs(expected.v - scene.velocities).max() > 0.5


def random_words(count: int, seed: int) -> list[str]:
    """Words of two to four drifts, one to four kicks and one to three sweeps, in any order (no two sweeps beside each other)."""
    rng, found = np.random.default_rng(seed), []
    while len(found) < count:
        tokens = [
            name
            for letter, most in (("A", 4), ("B", 4), ("O", 3))
            for name in (lambda n, letter=letter: [(f"{letter}/{n}" if n > 1 else letter)] * n)(int(rng.integers(1, most + 1)))
        ]
        tokens = [tokens[k].replace("O", "OS"[int(rng.integers(2))]) for k in rng.permutation(len(tokens))]
        if not any(a[0] in "OS" and b[0] in "OS" for a, b in itertools.pairwise(tokens)):
            found.append(" ".join(tokens))
    return found


def agrees_with_letters(word: str, *ways: tuple[bool, str]) -> None:
    """Three steps of the loop (True) or the program (False), with the conservative force in the kernel or OpenMM's."""
    scene = fluid(EXTENDED, BOXES["ortho"], n=40, kT=1.3, spread=0)
    expected = Lettered(scene, word, 0.02, 11)
    for _ in range(3):
        expected.step()
    for loop, conservative in ways:
        built = dpd.build(scene, dt=0.02, scheme=word, platform="Reference", conservative=conservative, seed=11, loop=loop)
        x, v = state_of(stepped(running(built), 3).context)
        assert np.abs(x - expected.x).max() < 1e-11 and np.abs(v - expected.v).max() < 1e-11, (loop, conservative)


LOOP, PROGRAMS = (True, "kernel"), ((False, "kernel"), (False, "openmm"))


#: A drift between two sweeps.
BETWEEN = ("O/2 A/2 O/2 B A/2", "S/2 A/2 O/2 A/2 B", "B O/2 A/2 O/2 A/2", "B/2 O/2 B/2 A/2 O/2 A/2")


@pytest.mark.parametrize("word", [*random_words(12, 1), *BETWEEN])
def test_any_word(word):
    """By the loop and by the program that is written for it."""
    agrees_with_letters(word, LOOP, *PROGRAMS)


@pytest.mark.parametrize("kind", [kind for kind in KINDS if kind not in BESIDE])
def test_any_word_of_any_kind(kind):
    """The program does what the loop does, which the oracles hold; most words where beads have fields, which programs show to the pair force."""
    has_fields = KINDS[kind]().internal is not None
    for word in random_words(6 if has_fields else 2, list(KINDS).index(kind)):
        ends = []
        for loop in (True, False):
            simulation = stepped(running(made(kind, word, loop=loop)), 4)
            ends.append(everything(simulation.context, simulation.built))
        assert not too_far(*ends, 1e-6 if kind == "patterns" else 1e-11), word


@pytest.mark.parametrize("device", [d for d in DEVICES if d.precision in ("", "single")], ids=str, indirect=True)
@pytest.mark.parametrize("kind", ["dpd", "energies", "edpd", "tdpd"])
def test_beads_that_never_meet_move_by_v_t(kind, device):
    """In the loop and in the program, whatever the word."""
    x = 2.6 * np.stack(np.meshgrid(*[np.arange(4)] * 3), axis=-1).reshape(-1, 3)[:N]
    scene = replace(KINDS[kind](), positions=x, box=10.4 * np.eye(3))
    v = np.where(scene.mobile[:, None], scene.velocities, 0.0) if scene.mobile is not None else scene.velocities
    words, ways = (random_words(2, 3), (True, False)) if device.exact else ((), (False,))
    for word, loop in itertools.product([*words, "B/2 O/2 A O/2 B/2"], ways):
        moved = state_of(stepped(run_of(scene, device, dt=0.01, scheme=word, loop=loop), 20).context)[0] - x
        np.testing.assert_allclose(moved, 0.2 * v, atol=device.choose(1e-12, 1e-6, 1e-5), err_msg=f"{word} {loop}")


@pytest.mark.slow
@pytest.mark.long
@pytest.mark.parametrize("word", random_words(300, 2))
def test_very_many_words(word):
    agrees_with_letters(word, LOOP, *PROGRAMS)


# -- bits ----------------------------------------------------------------------------------------------------------------------------
def ways_of_a_run(kind: str, scheme: str, platform: str):
    """Name and end of 25 steps, cut in every way."""

    def fresh():
        return running(made(kind, scheme, platform), platform)

    whole = fresh()
    whole.integrator.step(25)
    yield "whole", everything(whole.context, whole.built)
    parts = fresh()
    parts.integrator.step(12)
    middle = parts.context.getState(positions=True, velocities=True, parameters=True, integratorParameters=True)
    state, checkpoint = io.StringIO(), io.BytesIO()
    parts.saveState(state)
    parts.saveCheckpoint(checkpoint)
    parts.integrator.step(13)
    yield "12 + 13", everything(parts.context, parts.built)
    singles = fresh()
    for _ in range(25):
        singles.integrator.step(1)
    yield "singles", everything(singles.context, singles.built)
    for file, load in ((state, "loadState"), (checkpoint, "loadCheckpoint")):
        file.seek(0)
        loaded = stepped(fresh(), 3)
        getattr(loaded, load)(file)
        loaded.step(13)
        yield load, everything(loaded.context, loaded.built)
    loaded = fresh()
    loaded.context.setState(middle)
    loaded.integrator.step(13)
    yield "setState", everything(loaded.context, loaded.built)


def same_bits_in_every_way(kind: str, scheme: str, platform: str) -> None:
    ways = ways_of_a_run(kind, scheme, platform)
    _, expected = next(ways)
    wrong = {name: found for name, end in ways if (found := same(end, expected))}
    assert not wrong, wrong


@pytest.mark.parametrize("how", ["XML", "compound"])
def test_a_ramp_heats_without_the_subclass(how):
    """From 1 to 4 within 40 steps and as many to settle: beads with friction alone follow at once."""
    v = np.random.default_rng(2).normal(size=(375, 3))
    options = {"table": {("W", "W"): dpd.DPD(gamma=20)}, "velocities": v - v.mean(axis=0)}
    scene = beads(375, edge=5.0, kT=dpd.TemperatureRamp(1.0, 4.0, 0, 40), **options)
    built = dpd.build(scene, dt=0.05, scheme="middle", platform="CPU", seed=1)
    if how == "XML":
        context = plain_context(built, "CPU")
    else:
        compound = openmm.CompoundIntegrator()
        compound.addIntegrator(built.integrator)
        context = openmm.Context(built.system, compound, openmm.Platform.getPlatformByName("CPU"), {"Threads": "1"})
        place(context, built.positions, built.velocities)
    context.getIntegrator().step(80)
    assert context.getParameter("dpd_kT") == 4.0
    assert np.mean(state_of(context)[1] ** 2) == pytest.approx(4.0, rel=0.2)


@pytest.mark.parametrize(("number", "case"), list(enumerate(FEW)), ids=[f"{kind}-{scheme}" for kind, scheme in FEW])
def test_a_run_is_the_same_however_it_is_cut(number, case):
    same_bits_in_every_way(*case, ("CPU", "Reference")[number % 2])


@pytest.mark.slow
@pytest.mark.long
@PLATFORM
@pytest.mark.parametrize(("kind", "scheme"), EVERY)
def test_every_run_is_the_same_however_it_is_cut(kind, scheme, platform):
    same_bits_in_every_way(kind, scheme, platform)


@pytest.mark.parametrize(("kind", "scheme"), FEW)
def test_threads_do_not_change_a_bit(two_threads, kind, scheme):
    ends = []
    for threads in (1, 2):
        dpd.set_threads(threads)
        simulation = running(made(kind, scheme, "CPU"), "CPU")
        simulation.integrator.step(15)
        ends.append(everything(simulation.context, simulation.built))
    assert not same(*ends)


@pytest.mark.slow
@pytest.mark.parametrize("scheme", ["mvv", "middle", WORDS[1]])
def test_threads_do_not_change_a_bit_of_many_terms(two_threads, scheme):
    """So many that all of them are shared between the threads."""
    rng, n = np.random.default_rng(3), 9000
    x = rng.random((n, 3)) * 14.0
    x[1::2] = x[::2] + 0.5 * (rng.random((n // 2, 3)) - 0.5)
    bonds = [dpd.HarmonicBonds(np.arange(n).reshape(-1, 2), 30.0, 0.4)]
    v = rng.normal(size=(n, 3))
    rows = {"bonds": bonds, "body_forces": [dpd.BodyForce((0.1, 0, 0))], "velocities": v}
    scene = dpd.Scene({"W": 1.0}, ["W"] * n, x, {("W", "W"): dpd.DPD(A=25, gamma=4.5)}, 1.0, box=[14.0] * 3, **rows)
    ends = []
    for threads in (1, 2):
        dpd.set_threads(threads)
        ends.append(state_of(stepped(running(dpd.build(scene, dt=0.01, scheme=scheme, platform="CPU", seed=2), "CPU"), 12).context))
    assert np.array_equal(ends[0][0], ends[1][0]) and np.array_equal(ends[0][1], ends[1][1])


@pytest.mark.parametrize("scheme", ["middle", "mvv", WORDS[0]])
def test_a_thousand_steps_of_time(scheme):
    """Added up step by step, as OpenMM does it."""
    ends = []
    for cut in (1000, 1):
        simulation = running(made("friction alone", scheme, "CPU"), "CPU")
        for _ in range(1000 // cut):
            simulation.step(cut)
        assert simulation.currentStep == 1000
        ends.append(everything(simulation.context, simulation.built))
    assert not same(*ends)
    time = 0.0
    for _ in range(1000):
        time += 0.01
    assert ends[0]["time"] == time


# -- averages ------------------------------------------------------------------------------------------------------------------------
@pytest.fixture
def orders(monkeypatch):
    """benchmarks/orders.py, which steps words on the kernel by itself."""
    monkeypatch.syspath_prepend(str(Path(__file__).resolve().parents[2] / "benchmarks"))
    import orders

    yield orders
    for name in [name for name in sys.modules if name == "orders" or name.startswith("atlas_parts")]:
        del sys.modules[name]


@pytest.mark.slow
@any_seed(5)
def test_averages_of_a_word_are_those_of_an_independent_stepping(orders, seed):
    """Kinetic and configurational temperature, and energy, at dt = 0.05."""
    word, dt, n = "B/2 A/2 O A/2 B/2", 0.05, 1500
    job = {"method": "x", "gamma": 4.5, "beads": n, "dt": dt, "time": 300.0}
    orders.ORDERS["x"] = orders.Order(word)
    expected = orders.work(job)
    dpd.set_threads(1)
    edge = (n / 3.0) ** (1 / 3)
    x = np.random.default_rng(2).random((n, 3)) * edge
    scene = dpd.Scene({"W": 1.0}, ["W"] * n, x, {("W", "W"): dpd.DPD(A=25, gamma=4.5)}, kT=1.0, box=[edge] * 3)
    start = stepped(dpd.build(scene, dt=0.02, scheme="aboba", platform="CPU", seed=4).simulation(properties={"Threads": "1"}), 600)
    built = dpd.build(scene, dt=dt, scheme=word, platform="CPU", seed=seed)
    simulation, observer, rows = built.simulation(properties={"Threads": "1"}), dpd.Observer(built), []
    simulation.context.setPositions(state_of(start.context)[0])
    simulation.step(200)
    for _ in range(1500):
        simulation.step(4)
        sample = observer.sample(simulation.context)
        v = state_of(simulation.context)[1]
        rows.append((sample.potential / n, sample.gradient2, sample.laplacian, np.sum(v**2) / (3 * n - 3)))
    energy, above, below, kinetic = np.array(rows).T
    found = {"T_kin": block_average(kinetic), "T_conf": ratio_average(above, below), "U": block_average(energy)}
    for name, average in found.items():
        mean, sem = expected[name]
        assert abs(average.mean - mean) < 4 * np.hypot(average.sem, sem), (name, average, mean, sem)
        assert np.hypot(average.sem, sem) < 0.005 * mean
