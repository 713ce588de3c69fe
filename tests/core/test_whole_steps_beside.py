"""Whole steps beside everything else: forces, barostats and parameters of the user's, other Contexts, changes between steps, reporters."""

import io
import threading
from types import SimpleNamespace

import numpy as np
import openmm
import pytest
from cases import cases, each_with
from devices import Device
from judged import any_seed, bounded, judge
from kinds import SOLID, N, differences, everything, hand_over, made, plain_context, running, same, schemes_of
from openmm import app, unit
from scenes import BOXES, EXTENDED, beads, external_force, fluid, place, state_of, step_all, stepped

import openmm_dpd as dpd
from openmm_dpd.base.names import BODY_FORCE, COUNTER, KT, SEED
from openmm_dpd.simulation.fields import read_fields, write_fields
from openmm_dpd.units import BOLTZMANN

SCHEMES = ("mvv", "shardlow", "middle", "aboba", "bababo", "B/2 A/2 O A/2 B/2", "O/2 B/2 A B/2 O/2")
SCHEME = pytest.mark.parametrize("scheme", SCHEMES)
DT, FORCE = 0.01, 3.0


# -- forces of the user's --------------------------------------------------------------------------------------------------------------
def external(n: int) -> openmm.Force:
    return external_force(f"-{FORCE}*x", n)


def bonded(n: int) -> openmm.Force:
    """Pushes even beads along x by way of a bond to a place that is far away: as a centroid force with one group each."""
    force = openmm.CustomCompoundBondForce(1, f"-{FORCE}*x1")
    for bead in range(n):
        force.addBond([bead])
    return force


class Push:
    """A constant force along x."""

    def __init__(self, n: int):
        self.force = np.zeros((n, 3))
        self.force[:, 0] = FORCE

    def __call__(self, state):
        return 0.0 * unit.kilojoule_per_mole, self.force


def python(n: int) -> openmm.Force:
    return openmm.PythonForce(Push(n))


def collective(n: int) -> openmm.Force:
    force = openmm.CustomCVForce(f"-{FORCE}*s")
    force.addCollectiveVariable("s", external_force("x", n))
    return force


FORCES = {"external": external, "compound bond": bonded, "python": python, "collective variable": collective}


def context_of(built, compound: bool) -> openmm.Context:
    """A Context of the user's own making, with the integrator itself or within a compound one."""
    integrator = openmm.CompoundIntegrator() if compound else built.integrator
    if compound:
        integrator.addIntegrator(built.integrator)
    context = openmm.Context(built.system, integrator, openmm.Platform.getPlatformByName("CPU"), Device("CPU").properties)
    place(context, built.positions, built.velocities)
    return context


def run_with(made_force, group: int, how: str, scheme: str, steps: int, kind: str = "dpd", **choices):
    """Momentum that a run gains, and its Context; ``how`` says where the force comes in and who steps."""
    built = made(kind, scheme, "CPU", loop=how != "loop=False", **choices)
    force = made_force(N)
    force.setForceGroup(group)
    if how != "reinitialized":
        built.system.addForce(force)
    if how == "XML":
        context = plain_context(built, "CPU")
    elif how in ("compound", "bare"):
        context = context_of(built, compound=how == "compound")
    else:
        context = running(built, "CPU").context
    if how == "reinitialized":
        context.getIntegrator().step(7)
        built.system.addForce(force)
        context.reinitialize(preserveState=True)
    mass = built.plan.scene.bead_masses
    before = mass @ state_of(context)[1]
    context.getIntegrator().step(steps)
    return mass @ state_of(context)[1] - before, context, built


HOWS = ("loop", "bare", "XML", "loop=False", "compound", "reinitialized")


GROUPS = list(enumerate((0, 2, 12, 25)))
PLACES = [(name, group, SCHEMES[(2 * n + shift) % len(SCHEMES)]) for n, name in enumerate(FORCES) for shift, group in GROUPS]


@cases("name, group, scheme, how", *each_with(PLACES, lambda *_: HOWS, 3))
def test_a_force_of_the_users_acts_in_full(name, group, scheme, how):
    """N f t of momentum in 23 steps, for every force and place, each in three of the ways."""
    gained, _, _ = run_with(FORCES[name], group, how, scheme, 23)
    expected = np.array([N * FORCE * 23 * DT, 0, 0])
    assert np.abs(gained - expected).max() < 1e-4 * expected[0]


@SCHEME
@pytest.mark.parametrize("how", ["loop", "XML"])
def test_positions_follow_a_force_as_the_schemes_say(scheme, how):
    """The centre of mass moves as in a constant field, with velocities behind by the lag of the scheme."""
    _, context, built = run_with(external, 0, how, scheme, 0)
    mass = built.plan.scene.bead_masses
    x0, v0 = state_of(context)
    context.getIntegrator().step(30)
    x, _ = state_of(context)
    t, lag = 30 * DT, built.plan.options.scheme.lag
    moved = mass @ (x - x0)
    expected = (mass @ v0) * t + np.array([N * FORCE, 0, 0]) * (0.5 * t**2 + lag * DT * t)
    assert np.abs(moved - expected).max() < 1e-6


def ends_of(hows, scheme: str, steps: int, kind: str = "dpd", **choices) -> list[dict]:
    """Where a well leads that comes in in these ways."""
    return [everything(*run_with(_well, 3, how, scheme, steps, kind, **choices)[1:]) for how in hows]


@cases(
    "kind, scheme, every",
    *((kind, s, (1, 3)[(m + n) % 2]) for m, kind in enumerate(("dpd", "energies", "ramp", "edpd")) for n, s in enumerate(schemes_of(kind))),
)
def test_a_force_of_the_users_from_xml_kicks_as_in_the_loop(kind, scheme, every):
    """... before and after each step, or by impulses over three."""
    assert max(differences(*ends_of(("loop", "XML"), scheme, 20, kind, slow_every=every), 0.1).values()) < 1e-12


@pytest.mark.parametrize("scheme", ["middle", "B/2 A/2 O A/2 B/2", "mvv", "mvv-0.65"])
def test_where_kicks_stand_at_the_ends_a_force_of_the_users_is_one_of_the_scene(scheme):
    """These begin and end with kicks (or end before one), so that the loop is the program, to rounding."""
    ends = ends_of(("loop", "loop=False"), scheme, 5)
    assert max(differences(*ends, DT).values()) < 1e-7  # OpenMM's forces on CPU are single precision


def test_what_friction_saw_is_known_beside_a_force_of_the_users():
    """With forces that stay OpenMM's around the loop, a sample has the friction of the step, as with everything in the program."""
    samples = []
    for how in ("loop", "loop=False"):
        _, context, built = run_with(_well, 3, how, "mvv", 5)
        samples.append(dpd.Observer(built).sample(context))
    one, other = samples
    assert np.abs(one.forces - other.forces).max() < 1e-4  # half a kick by the well moves friction by 0.1
    assert one.virial_dissipative == pytest.approx(other.virial_dissipative, rel=1e-5)


def _well(n: int) -> openmm.Force:
    return external_force("4*(x-1.3)^2+y^2*z", n)


class Clock:
    """A force that depends on time, and remembers when it was asked."""

    def __init__(self):
        self.asked = []

    def __call__(self, state):
        time, step = state.getTime()._value, state.getStepCount()
        self.asked.append((step, time))
        force = np.zeros((N, 3))
        force[:, 0] = np.cos(20 * time)
        return 0.0 * unit.kilojoule_per_mole, force


def clocked(scheme: str, how: str, cut: int = 25):
    built, clock = made("dpd", scheme, "CPU", loop=how != "loop=False"), Clock()
    built.system.addForce(openmm.PythonForce(clock))
    context = context_of(built, compound=True) if how == "compound" else running(built, "CPU").context
    for _ in range(25 // cut):
        context.getIntegrator().step(cut)
    return built, clock, context


@SCHEME
def test_a_force_of_the_users_sees_the_right_time(scheme):
    """Each step's end, and its time as OpenMM adds it up; the same bits in singles."""
    built, clock, context = clocked(scheme, "loop")
    times = np.concatenate([[0.0], np.cumsum(np.full(25, DT))])
    assert {step for step, _ in clock.asked} >= set(range(25))
    assert all(time == times[step] for step, time in clock.asked)
    assert context.getStepCount() == 25 and context.getTime()._value == times[25]
    _, _, other = clocked(scheme, "loop", 1)
    assert not same(everything(context, built), everything(other, built))
    momentum = (built.plan.scene.bead_masses @ (state_of(context)[1] - built.velocities._value))[0]
    lag = built.plan.options.scheme.lag
    impulse = N * DT * (np.cos(20 * times[:25]).sum() * (0.5 + lag) + np.cos(20 * times[1:]).sum() * (0.5 - lag))
    assert momentum == pytest.approx(impulse, abs=1e-9)


LATE = "the second kick of the program comes before OpenMM sets the clock forward"
EARLY_KICK = pytest.mark.xfail(strict=True, raises=AssertionError, reason=LATE)


@pytest.mark.parametrize("scheme", [pytest.param(s, marks=() if s == "middle" else EARLY_KICK) for s in SCHEMES])
def test_a_force_of_the_users_sees_the_right_time_without_the_subclass(scheme):
    ends = [everything(context, built) for built, _, context in (clocked(scheme, how) for how in ("loop", "compound"))]
    assert max(differences(*ends, 0.1).values()) < 1e-12


@pytest.mark.parametrize("scheme", ["middle", "aboba", "mvv"])
def test_a_force_that_depends_on_the_thermal_energy_of_a_ramp(scheme):
    ends = []
    for cut in (15, 1):
        built = made("ramp", scheme, "CPU")
        force = external_force("-dpd_kT*x", N)
        force.addGlobalParameter(KT, 1.0)
        built.system.addForce(force)
        simulation = running(built, "CPU")
        for _ in range(15 // cut):
            simulation.integrator.step(cut)
        ends.append(everything(simulation.context, built))
    assert not same(*ends)


# -- changes between steps ---------------------------------------------------------------------------------------------------------------
def anew(simulation, kind: str, scheme: str, **choices):
    """A fresh run with the state of another one, but no history."""
    built = made(kind, scheme, "CPU", dt=simulation.integrator.getStepSize()._value, **choices)
    other = running(built, "CPU")
    state = simulation.context.getState(positions=True, velocities=True, parameters=True)
    place(other.context, state.getPositions(), state.getVelocities())
    other.context.setPeriodicBoxVectors(*state.getPeriodicBoxVectors())
    other.context.setStepCount(state.getStepCount())
    other.context.setTime(state.getTime())
    for name in {COUNTER, SEED, KT, BODY_FORCE} & set(state.getParameters()):
        other.context.setParameter(name, state.getParameters()[name])
    if "ramp_step" in other.integrator.variables():
        other.integrator.setGlobalVariableByName("ramp_step", simulation.integrator.getGlobalVariableByName("ramp_step"))
    if built.plan.spec.fields is not None:
        for k in range(built.plan.spec.fields.n_blocks):
            values = np.array(simulation.integrator.getPerDofVariableByName(f"field{k}"))
            other.integrator.setPerDofVariableByName(f"field{k}", values)
    return other


def started(kind: str, scheme: str, steps: int = 5, **choices):
    return stepped(running(made(kind, scheme, "CPU", **choices), "CPU"), steps)


def move(simulation):
    x, _ = state_of(simulation.context)
    simulation.context.setPositions(x + np.random.default_rng(1).normal(size=x.shape) * 0.05)


def set_box(simulation):
    x, _ = state_of(simulation.context)
    simulation.context.setPeriodicBoxVectors(*simulation.built.plan.scene.box * 1.03)
    simulation.context.setPositions(x * 1.03)


def look_after(change):
    """A reporter asks for forces after a change."""
    return lambda simulation: (change(simulation), simulation.context.getState(energy=True, forces=True))


def turn_one(simulation):
    """The last bit of one velocity."""
    _, v = state_of(simulation.context)
    v[17, 1] = np.nextafter(v[17, 1], 9.0)
    simulation.context.setVelocities(v)


def fill(simulation):
    per_bead = np.random.default_rng(3).uniform(0.8, 1.2, N)
    write_fields(simulation.context, simulation.built.plan, theta=per_bead)


def fill_by_hand(simulation):
    block = np.array(simulation.integrator.getPerDofVariableByName("field0"))
    simulation.integrator.setPerDofVariableByName("field0", block * np.where(SOLID, 1.05, 1.0)[:, None])


def parameter(name: str, value: float):
    return lambda simulation: simulation.context.setParameter(name, value)


CHANGES = {  # Name -> what is done, and with which kinds.
    "positions": (move, ("dpd", "specular", "ramp")),
    "positions, looked at": (look_after(move), ("dpd", "mdpd")),
    "box": (set_box, ("dpd", "tilted")),
    "box, looked at": (look_after(set_box), ("dpd",)),
    "velocities": (
        lambda run: run.context.setVelocities(np.random.default_rng(8).normal(size=(N, 3))),
        ("dpd", "energies", "ramp"),
    ),
    "one bit of a velocity": (turn_one, ("dpd", "tdpd")),
    "velocities of a temperature": (lambda run: run.context.setVelocitiesToTemperature(99.0, 3), ("dpd", "moving walls", "edpd")),
    "temperature": (lambda run: run.integrator.setTemperature(1.7 / BOLTZMANN), ("dpd", "sigma")),
    "temperature by its variable": (lambda run: run.integrator.setGlobalVariableByName("temperature", 1.7 / BOLTZMANN), ("dpd",)),
    "kT": (parameter(KT, 1.7), ("dpd", "immobile")),
    "seed": (parameter(SEED, 77), ("dpd", "energies")),
    "noise counter": (parameter(COUNTER, 1000), ("dpd", "edpd")),
    "body forces": (parameter(BODY_FORCE, -0.5), ("patterns",)),
    "step size": (lambda run: run.integrator.setStepSize(0.5 * DT), ("dpd", "tdpd")),
    "fields": (fill, ("energies",)),
    "fields by their variable": (fill_by_hand, ("energies", "edpd", "tdpd")),
}


#: Every kind with two schemes.
OTHERS = [(name, kind) for name, (_, kinds) in CHANGES.items() for kind in kinds[1:]]
CHANGED = each_with([(name, kinds[0]) for name, (_, kinds) in CHANGES.items()], lambda *_: SCHEMES, 2)
CHANGED += each_with(OTHERS, lambda *_: SCHEMES, 2)


@pytest.mark.parametrize("name, kind, scheme", CHANGED)
def test_after_a_change_the_run_is_as_a_fresh_one(scheme, name, kind):
    """Bit for bit, in the loop, in the program and in one that nobody watches; so is one with another history that loads the state."""
    ends, change = [], CHANGES[name][0]
    for loop in (True, False):
        simulation, other = (started(kind, scheme, steps, loop=loop) for steps in (5, 3))
        change(simulation)
        runs = [simulation, anew(simulation, kind, scheme, loop=loop), other]
        other.integrator.setStepSize(simulation.integrator.getStepSize())
        hand_over(simulation, other)
        if not loop and not name.startswith("temperature"):
            context = plain_context(made(kind, scheme, "CPU", loop=False), "CPU")
            integrator = context.getIntegrator()
            plain = SimpleNamespace(context=context, integrator=integrator, built=simulation.built, step=integrator.step)
            change(stepped(plain, 5))
            runs.append(plain)
        step_all(4, *runs)
        found = [everything(one.context, one.built) for one in runs]
        differ = [set(same(found[0], one)) - ({"time"} if name == "step size" else set()) for one in found]  # of which the loop alone knows
        assert not any(differ), (loop, differ)
        ends.append(found[0])
    limit = 1e-6 if kind == "patterns" else 1e-10
    assert not {
        what: value for what, value in differences(*ends, DT).items() if not value < limit and (what, name) != ("time", "step size")
    }


@pytest.mark.parametrize("scheme", SCHEMES)
def test_after_minimising(scheme):
    simulation = started("bonded", scheme)
    simulation.minimizeEnergy(maxIterations=10)
    x, _ = state_of(simulation.context)
    simulation.context.setPositions(x)
    # a general program of bonds has forces of OpenMM's that round: another loop is the fresh one
    other = running(made("bonded", scheme, "CPU"), "CPU")
    other.context.setParameter(COUNTER, simulation.context.getParameter(COUNTER))
    place(other.context, x, state_of(simulation.context)[1])
    step_all(3, simulation, other)
    assert np.abs(state_of(simulation.context)[1] - state_of(other.context)[1]).max() < 1e-10


@pytest.mark.parametrize("loop", [True, False])
def test_a_step_without_the_subclass_after_a_look(loop):
    """A System and an integrator from XML do the same."""
    ends = []
    for look in (True, False):
        context = plain_context(made("dpd", "shardlow", "CPU", loop=loop), "CPU")
        context.getIntegrator().step(3)
        x, _ = state_of(context)
        context.setPositions(x + 0.05 * np.sin(np.arange(3 * N)).reshape(-1, 3))
        if look:
            context.getState(energy=True)
        context.getIntegrator().step(1)
        ends.append(state_of(context)[1])
    assert np.abs(ends[0] - ends[1]).max() < 1e-10


@pytest.mark.parametrize("scheme", SCHEMES)
@pytest.mark.parametrize("preserve", [True, False])
@pytest.mark.parametrize("kind", ["dpd", "energies", "ramp"])
def test_after_reinitializing(kind, scheme, preserve):
    runs = [started(kind, scheme, loop=loop) for loop in (True, False)]
    for simulation in runs:
        x, v = state_of(simulation.context)
        simulation.context.reinitialize(preserveState=preserve)
        if not preserve:
            place(simulation.context, x, v)
        simulation.step(4)
    found = differences(*(everything(one.context, one.built) for one in runs), DT)
    assert max(found.values()) < 1e-10, found


def test_energies_that_another_way_of_stepping_left():
    """A state goes from a loop to the program and back."""
    looped, plain = (started("energies", "bababo", loop=loop) for loop in (True, False))
    hand_over(looped, plain)
    plain.step(20)
    hand_over(plain, looped)
    step_all(1, looped, plain)
    first, second = (read_fields(one.context, one.built.plan)["theta"] for one in (looped, plain))
    assert np.abs(first - second).max() < 1e-9


# -- several Contexts --------------------------------------------------------------------------------------------------------------------
@pytest.mark.parametrize("scheme", SCHEMES)
@pytest.mark.parametrize("kind", ["dpd", "energies"])
def test_two_contexts_of_one_system_interleaved(kind, scheme):
    """Each goes its own way, as if it were alone."""
    ends = []
    for order in ((0, 1, 0, 1, 1, 0), (0, 0, 0), (1, 1, 1)):
        contexts = _two(made(kind, scheme, "CPU"), scheme, kind)
        for k in order:
            contexts[k].getIntegrator().step(4)
        ends.append([state_of(context) for context in contexts])
    for k in (0, 1):
        np.testing.assert_array_equal(ends[0][k], ends[k + 1][k])


def _two(built, scheme, kind):
    """Two Contexts of one System with integrators of their own, from different positions."""
    contexts = []
    for k in (0, 1):
        integrator = built.integrator if k == 0 else openmm.XmlSerializer.clone(built.integrator)
        context = openmm.Context(built.system, integrator, openmm.Platform.getPlatformByName("CPU"), Device("CPU").properties)
        place(context, built.positions._value + 0.02 * k * np.cos(np.arange(3 * N)).reshape(-1, 3), built.velocities)
        contexts.append(context)
    return contexts


@pytest.mark.parametrize("scheme", SCHEMES)
def test_two_contexts_that_are_looked_at(scheme):
    """Energies are asked for between the steps of the other."""
    ends = []
    for look in (True, False):
        contexts = _two(made("dpd", scheme, "CPU"), scheme, "dpd")
        for _ in range(3):
            for context in contexts:
                if look:
                    context.getState(energy=True)
                context.getIntegrator().step(2)
        ends.append([state_of(context) for context in contexts])
    np.testing.assert_array_equal(*ends)


@pytest.mark.parametrize("scheme", ["middle", "mvv", "bababo"])
def test_two_contexts_of_one_system_in_two_threads(scheme):
    ends = []
    for threads in (True, False):
        contexts = _two(made("bonded", scheme, "CPU"), scheme, "bonded")
        jobs = [threading.Thread(target=context.getIntegrator().step, args=(30,)) for context in contexts]
        for job in jobs:
            job.start() if threads else job.run()
        for job in jobs if threads else ():
            job.join()
        ends.append([state_of(context) for context in contexts])
    np.testing.assert_array_equal(*ends)


def test_a_context_that_changes_threads():
    """Begun in one thread, continued in another, and back."""
    ends = []
    for threads in (True, False):
        simulation = started("energies", "mvv", 3)
        job = threading.Thread(target=simulation.step, args=(5,))
        if threads:
            job.start()
            job.join()
        else:
            simulation.step(5)
        simulation.step(4)
        ends.append(everything(simulation.context, simulation.built))
    assert not same(*ends)


# -- reporters ---------------------------------------------------------------------------------------------------------------------------
@cases("kind, scheme", ("charged", "middle"), *each_with(("dpd", "energies", "ramp"), lambda _: SCHEMES, 4))
def test_reporters_do_not_change_a_run(kind, scheme, tmp_path):
    """Every step, every ten, every seven and never."""
    ends, times = [], []
    for every in (1, 10, 7, 0):
        simulation, lines = running(made(kind, scheme, "CPU"), "CPU"), io.StringIO()
        if every:
            simulation.reporters.append(app.StateDataReporter(lines, every, step=True, time=True, potentialEnergy=True, kineticEnergy=True))
            simulation.reporters.append(app.CheckpointReporter(str(tmp_path / "check"), every))
        simulation.step(23)
        assert simulation.currentStep == 23
        ends.append(everything(simulation.context, simulation.built))
        times.append([line.split(",")[0] for line in lines.getvalue().splitlines()[1:]])
    assert all(not same(end, ends[-1]) for end in ends)
    assert times[:3] == [[str(k) for k in range(1, 24)], ["10", "20"], ["7", "14", "21"]]


def test_energies_at_every_step_are_those_of_the_positions():
    simulation, lines = running(made("bonded", "bababo", "CPU"), "CPU"), io.StringIO()
    simulation.reporters.append(app.StateDataReporter(lines, 1, potentialEnergy=True))
    found = []
    for _ in range(5):
        simulation.step(1)
        other = running(made("bonded", "bababo", "CPU"), "CPU")
        other.context.setPositions(state_of(simulation.context)[0])
        found.append(other.context.getState(energy=True).getPotentialEnergy()._value)
    assert [float(line) for line in lines.getvalue().splitlines()[1:]] == pytest.approx(found, rel=1e-12)


# -- barostats ---------------------------------------------------------------------------------------------------------------------------
def pressed(scheme: str, frequency: int, *, loop: bool = True, scene=None, dt: float = 0.02, seed: int = 8, pressure: float = 20.0):
    scene = scene or beads(150, edge=4.0, seed=4)
    built = dpd.build(scene, dt=dt, platform="CPU", conservative="kernel", seed=seed, scheme=scheme, loop=loop)
    dpd.add_barostat(built, pressure, interval=frequency)
    simulation = built.simulation(properties=Device("CPU").properties)
    simulation.built = built
    return simulation


@cases("scheme, frequency", *each_with(SCHEMES, lambda _: (7, 1, 25), 1))
def test_barostats_try_as_often_as_they_should(scheme, frequency):
    """The volume can change in steps k frequency alone, and the noise is drawn once (twice) per step."""
    simulation, volumes = pressed(scheme, frequency), []
    for _ in range(150):
        simulation.step(1)
        volumes.append(simulation.context.getState().getPeriodicBoxVolume()._value)
    changed = np.flatnonzero(np.diff([64.0, *volumes])) + 1
    assert len(changed) > 1
    assert np.all(changed % frequency == 0)
    sweeps = 2 if scheme.startswith("O/2") else 1
    assert simulation.context.getParameter(COUNTER) == 150 * sweeps
    assert simulation.context.getStepCount() == 150 and simulation.context.getTime()._value == pytest.approx(3.0)


@SCHEME
def test_barostats_in_pieces_try_as_often(scheme):
    """... in steps of any number at once."""
    simulation, found = pressed(scheme, 7), []
    for n in (5, 12, 7, 1, 25, 3, 17):
        simulation.integrator.step(n)
        found.append(simulation.context.getStepCount())
    assert found == [5, 17, 24, 25, 50, 53, 70]
    assert simulation.context.getTime()._value == pytest.approx(1.4, rel=1e-12)


@SCHEME
def test_bits_beside_a_barostat_do_not_depend_on_where_calls_end(scheme):
    """A move acts behind its own step, wherever a call began."""
    found = []
    for cuts in ((56,), (21, 35), (24, 32), (1, 12, 3, 40)):
        simulation = pressed(scheme, 7)
        for n in cuts:
            simulation.step(n)
        state = simulation.context.getState(positions=True, velocities=True)
        found.append([*state_of(simulation.context), state.getPeriodicBoxVectors(asNumpy=True)._value])
    assert found[0][2][0, 0] != 4.0
    for other in found[1:]:
        for one, same_one in zip(found[0], other, strict=True):
            np.testing.assert_array_equal(one, same_one)


@pytest.mark.parametrize("scheme", SCHEMES[::2])
def test_after_an_accepted_volume_move_the_run_is_as_a_fresh_one(scheme):
    """Positions and box have changed: the next step begins with the force there."""
    simulation = pressed(scheme, 3)
    accepted = 0
    for _ in range(20):
        before = simulation.context.getState().getPeriodicBoxVolume()._value
        simulation.step(3)
        if simulation.context.getState().getPeriodicBoxVolume()._value == before:
            continue
        accepted += 1
        other = pressed(scheme, 1000)
        state = simulation.context.getState(positions=True, velocities=True)
        other.context.setPeriodicBoxVectors(*state.getPeriodicBoxVectors())
        place(other.context, state.getPositions(), state.getVelocities())
        other.context.setParameter(COUNTER, simulation.context.getParameter(COUNTER))
        other.step(1)
        simulation.step(1)
        assert np.abs(state_of(other.context)[1] - state_of(simulation.context)[1]).max() < 1e-9
        simulation.step(2)
    assert accepted > 2


@SCHEME
def test_volume_moves_in_a_run_from_xml(scheme):
    """A program that is given every volume move of a loop: OpenMM's random numbers depend on how many lines a program has."""
    simulation, other = pressed(scheme, 2), pressed(scheme, 1000)
    context, volumes = plain_context(other.built, "CPU"), [64.0]
    for _ in range(20):
        for one in (simulation.integrator, context.getIntegrator()):
            one.step(1)
        state = simulation.context.getState(positions=True)
        volumes.append(state.getPeriodicBoxVolume()._value)
        if volumes[-1] != volumes[-2]:
            context.setPeriodicBoxVectors(*state.getPeriodicBoxVectors())
            context.setPositions(state.getPositions())
    assert len(set(volumes)) > 3
    (x, v), (expected_x, expected_v) = state_of(context), state_of(simulation.context)
    assert np.abs(x - expected_x).max() < 1e-12 and np.abs(v - expected_v).max() < 1e-12


@pytest.mark.parametrize("scheme", ["middle", "aboba", "mvv"])
def test_molecules_move_as_wholes(scheme):
    """A volume move shifts the centres of chains and leaves the distances within them."""
    moved = 0
    built = made("bonded", scheme, "CPU")
    dpd.add_barostat(built, 5.0, interval=1)
    simulation = running(built, "CPU")
    context, chain = simulation.context, np.arange(48).reshape(12, 4)
    assert sorted(map(len, [sorted(molecule) for molecule in context.getMolecules()])) == [1] * 12 + [4] * 12
    barostat = next(force for force in built.system.getForces() if isinstance(force, openmm.MonteCarloBarostat))
    assert barostat.getFrequency() == 1
    for _ in range(40):
        before = context.getState(positions=True)
        x = state_of(context)[0]
        volume = before.getPeriodicBoxVolume()._value
        # as the loop lets barostats hear of a step that is done
        openmm.CustomIntegrator.setGlobalVariableByName(simulation.integrator, "ahead", 1.0)
        openmm.CustomIntegrator.step(simulation.integrator, 1)
        openmm.CustomIntegrator.setGlobalVariableByName(simulation.integrator, "ahead", 0.0)
        after = state_of(context)[0]
        if context.getState().getPeriodicBoxVolume()._value == volume:
            assert np.array_equal(x, after)
            continue
        moved += 1
        steps = np.diff(x[chain], axis=1), np.diff(after[chain], axis=1)
        assert np.abs(steps[1] - steps[0]).max() < 1e-9
        assert np.abs(after - x).max() > 1e-6
    assert moved > 2


@pytest.mark.parametrize("barostat", ["anisotropic", "flexible", "membrane"])
def test_other_barostats_hear_of_steps(barostat):
    bar = 20.0 * 16.6054
    kelvin = 1 / BOLTZMANN
    made_barostat = {
        "anisotropic": lambda: openmm.MonteCarloAnisotropicBarostat(openmm.Vec3(bar, bar, bar), kelvin, True, True, True, 4),
        "flexible": lambda: openmm.MonteCarloFlexibleBarostat(bar, kelvin, 4),
        "membrane": lambda: openmm.MonteCarloMembraneBarostat(bar, 0.0, kelvin, 0, 0, 4),
    }[barostat]()
    built = dpd.build(beads(150, edge=4.0, seed=4), dt=0.02, platform="CPU", conservative="kernel", seed=8)
    built.system.addForce(made_barostat)
    simulation = stepped(built.simulation(properties=Device("CPU").properties), 100)
    assert simulation.context.getState().getPeriodicBoxVolume()._value != 64.0
    assert simulation.currentStep == 100


@pytest.mark.slow
@pytest.mark.parametrize(
    ("scheme", "frequency"),
    [("middle", 25), ("mvv", 7)]
    + [pytest.param(*case, marks=pytest.mark.long) for case in (("middle", 1), ("aboba", 7), ("shardlow", 1), ("B/2 A/2 O A/2 B/2", 7))],
)
@any_seed(3)
def test_averages_at_constant_pressure(scheme, frequency, seed):
    """Volume and kinetic temperature of the loop and of the program agree within errors."""
    found = []
    for loop in (True, False):
        simulation = pressed(scheme, frequency, loop=loop, scene=beads(375, edge=5.0, seed=4), dt=0.03, pressure=23.0, seed=seed)
        simulation.step(1000)
        rows = []
        for _ in range(600):
            simulation.step(20)
            state = simulation.context.getState(velocities=True)
            rows.append((state.getPeriodicBoxVolume()._value, np.sum(state.getVelocities(asNumpy=True)._value ** 2) / (3 * 374)))
        found.append([bounded(column) for column in np.array(rows).T])
    for (mean, sem, bound), (other, its_sem, its_bound) in zip(*found, strict=True):
        assert abs(mean - other) < np.hypot(bound, its_bound)
        assert np.hypot(sem, its_sem) < 0.01 * other


@pytest.mark.slow
@any_seed(4)
@pytest.mark.parametrize("scheme", ["mvv", "middle", "B/2 A/2 O A/2 B/2"])
def test_a_long_run_of_loops_keeps_its_temperature(scheme, seed):
    """... with a force of the user's beside it, which must not heat."""
    scene = fluid(EXTENDED, BOXES["wide"], n=500, spread=0)
    built = dpd.build(scene, dt=0.02, scheme=scheme, platform="CPU", seed=seed)
    built.system.addForce(external_force("8*sin(x)^2", 500))
    simulation = stepped(built.simulation(properties=Device("CPU").properties), 1000)
    mass, kinetic = scene.bead_masses[:, None], []
    for _ in range(500):
        simulation.step(10)
        kinetic.append(np.sum(mass * state_of(simulation.context)[1] ** 2) / 1500)
    judge(kinetic, 1.0, error=0.01, beside=0.01)
