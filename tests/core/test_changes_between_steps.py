"""What a script may do between two steps: the run goes on as a fresh one would from the same positions, velocities and noise count."""

import io

import numpy as np
import openmm
import pytest
from cases import raises
from devices import CPU, DEVICES, REFERENCE
from openmm import app, unit
from scenes import BOXES, EXTENDED, SCHEME, SCHEMES, D, beads, fluid, place, run_of, same_bits, state_of, step_all, stepped

import openmm_dpd as dpd
from openmm_dpd.base.names import COUNTER, KT, PHASE, SEED, Phase

_KEPT = ("mvv", "mvv-0.65", "shardlow", "bababo")
HISTORY = pytest.mark.parametrize("choices", [SCHEMES[k] for k in _KEPT], ids=_KEPT)
DT = 0.03


def started(device, scene=None, dt=DT, steps=4, conservative="kernel", **choices):
    scene = scene or fluid(EXTENDED, BOXES["tilted"], n=70, seed=2, spread=0)
    return stepped(run_of(scene, device, dt=dt, conservative=conservative, **choices), steps)


def fresh_copy(simulation, device, scene=None, dt=DT, conservative="kernel", parameters=(COUNTER,), **choices):
    """A new run, built anew, that is given positions, velocities, box and noise count of another one."""
    copy = started(device, scene, dt=dt, steps=0, conservative=conservative, **choices)
    state = simulation.context.getState(positions=True, velocities=True)
    if simulation.system.usesPeriodicBoundaryConditions():
        copy.context.setPeriodicBoxVectors(*state.getPeriodicBoxVectors())
    place(copy.context, state.getPositions(), state.getVelocities())
    for name in parameters:
        copy.context.setParameter(name, simulation.context.getParameter(name))
    return copy


def same_from_here(first, second, steps=5, limit=0.0) -> None:
    before = state_of(first.context)
    step_all(steps, first, second)
    a, b = state_of(first.context), state_of(second.context)
    assert np.abs(a[1] - before[1]).max() > 0.05
    if limit:
        assert np.abs(a[1] - b[1]).max() < limit
    else:
        assert same_bits(a, b)
    assert first.context.getParameter(COUNTER) == second.context.getParameter(COUNTER)


# -- step size and temperature -----------------------------------------------------------------------------------------------------
@SCHEME
def test_another_step_size(host, choices):
    simulation = started(host, **choices)
    simulation.integrator.setStepSize(0.5 * DT)
    same_from_here(simulation, fresh_copy(simulation, host, dt=0.5 * DT, **choices))


@SCHEME
def test_another_temperature(host, choices):
    """Both with gamma fixed and with sigma fixed: the other follows."""
    table = {("A", "A"): D(A=25, gamma=4.5), ("A", "B"): D(A=25, sigma=3.0), ("B", "B"): D(A=25, sigma=2.0, gamma_perp=2.0)}

    def scene(kT):
        return fluid(table, BOXES["ortho"], n=60, seed=3, kT=kT)

    simulation = started(host, scene(1.0), **choices)
    dpd.set_kT(simulation.context, 2.5)
    same_from_here(simulation, fresh_copy(simulation, host, scene(2.5), **choices))
    simulation.context.setParameter(KT, 0.4)  # and by the name of the parameter, without the function
    same_from_here(simulation, fresh_copy(simulation, host, scene(0.4), **choices))


@SCHEME
def test_another_seed(choices):
    simulation = started(REFERENCE, **choices)
    simulation.context.setParameter(SEED, 77)
    same_from_here(simulation, fresh_copy(simulation, REFERENCE, seed=77, **choices))


def test_temperature_is_checked():
    simulation = started(REFERENCE)
    for wrong in (-1.0, float("nan")):
        raises(dpd.ParameterError, "kT|temperature", dpd.set_kT, simulation.context, wrong)
    dpd.set_kT(simulation.context, 300 * unit.kelvin)
    assert simulation.context.getParameter(KT) == pytest.approx(2.494, abs=1e-3)
    simulation.context.setParameter(KT, -1.0)
    raises(Exception, "dpd_kT must be >= 0", lambda: simulation.step(1))


# -- positions, box ------------------------------------------------------------------------------------------------------------------
@SCHEME
def test_other_positions(host, choices):
    simulation = started(host, **choices)
    x, _ = state_of(simulation.context)
    simulation.context.setPositions(x + np.random.default_rng(1).normal(size=x.shape) * 0.2)
    same_from_here(simulation, fresh_copy(simulation, host, **choices))


@HISTORY
def test_one_bead_moved_by_the_last_bit(choices):
    """The history is valid for exactly one set of positions."""
    simulation = started(REFERENCE, **choices)
    x, _ = state_of(simulation.context)
    x[17, 2] = np.nextafter(x[17, 2], 10)
    simulation.context.setPositions(x)
    counter = simulation.context.getParameter(COUNTER)
    same_from_here(simulation, fresh_copy(simulation, REFERENCE, **choices))
    drawn = simulation.context.getParameter(COUNTER) - counter
    assert drawn == 5  # an acceleration computed anew keeps the noise of the last half kick


@HISTORY
@pytest.mark.parametrize("device", [d for d in DEVICES if not d.exact and d.precision != "double"], indirect=True, ids=str)
def test_other_positions_on_gpu_platforms(device, choices):
    simulation = started(device, **choices)
    x, _ = state_of(simulation.context)
    simulation.context.setPositions(x + np.random.default_rng(1).normal(size=x.shape) * 0.2)
    same_from_here(simulation, fresh_copy(simulation, device, **choices), steps=3, limit=device.choose(0, 1e-6, 1e-3))


@SCHEME
def test_positions_that_are_set_to_what_they_were_change_nothing(choices):
    first, second = started(REFERENCE, **choices), started(REFERENCE, **choices)
    x, v = state_of(second.context)
    place(second.context, x, v)
    same_from_here(first, second)


@SCHEME
def test_parameters_of_forces_of_others_do_not_undo_a_step(choices):
    """An acceleration that is kept has no part of a force that kicks apart; a new one would cost energy where beads have it."""
    ends = []
    for sets in (False, True):
        scene = fluid(EXTENDED, BOXES["tilted"], n=70, seed=2, spread=0)
        built = dpd.build(scene, dt=DT, platform="Reference", seed=1, **choices)
        beside = openmm.CustomExternalForce("0*own*x")
        beside.addGlobalParameter("own", 0.0)
        beside.addParticle(0)
        built.system.addForce(beside)
        simulation = built.simulation()
        for n in range(4):
            simulation.step(1)
            simulation.context.setParameter("own", float(n * sets))
        ends.append(state_of(simulation.context))
    assert same_bits(*ends)


@SCHEME
def test_another_box(host, choices):
    """The box alone changes, the positions stay: other images are neighbours now."""
    simulation = started(host, **choices)
    simulation.context.setPeriodicBoxVectors(*(BOXES["tilted"] * 1.07))
    same_from_here(simulation, fresh_copy(simulation, host, **choices))


@SCHEME
@pytest.mark.parametrize("conservative", ["kernel", "openmm"])
def test_minimizing(choices, conservative):
    simulation = started(REFERENCE, conservative=conservative, **choices)

    def energy():
        return simulation.context.getState(energy=True).getPotentialEnergy()

    before = energy()
    simulation.minimizeEnergy(maxIterations=20)
    assert energy() < 0.8 * before
    same_from_here(simulation, fresh_copy(simulation, REFERENCE, conservative=conservative, **choices))


# -- barostats -------------------------------------------------------------------------------------------------------------------------
@pytest.mark.parametrize("conservative", ["kernel", "openmm"])
@SCHEME
def test_barostat_moves(choices, conservative):
    """A move is tried at each step; accepted or refused, noise is drawn once per step."""
    built = dpd.build(beads(150, edge=4.0, seed=4), dt=0.02, platform="Reference", conservative=conservative, seed=8, **choices)
    pressure = 20.0 / unit.nanometer**3 * unit.kilojoule_per_mole / unit.AVOGADRO_CONSTANT_NA
    built.system.addForce(openmm.MonteCarloBarostat(pressure, 120.27 * unit.kelvin, 1))
    simulation = built.simulation()
    context, volumes, drawn = simulation.context, [], []
    for _ in range(60):
        simulation.step(1)
        volumes.append(context.getState().getPeriodicBoxVolume().value_in_unit(unit.nanometer**3))
        drawn.append(context.getParameter(COUNTER))
    assert 5 < (np.diff([4.0**3, *volumes]) != 0).sum() < 58
    assert np.array_equal(drawn, np.arange(1, 61))


@pytest.mark.parametrize(("scheme", "device"), [("middle", REFERENCE), ("middle", CPU), ("native", REFERENCE)], ids=str)
def test_a_seeded_run_with_a_barostat_repeats(scheme, device):
    """The moves are those of the plan's seed, 0 too, which for OpenMM would be any.

    Where sums are not the same bit for bit (GPU platforms, OpenMM's own integrator on CPU) a move may be accepted in one run alone.
    """

    def volume(seed: int) -> float:
        built = dpd.build(beads(150, edge=4.0, seed=4), dt=0.02, scheme=scheme, platform=device.platform, seed=seed)
        dpd.add_barostat(built, 20.0, interval=1)
        return stepped(built.simulation(properties=device.properties), 15).context.getState().getPeriodicBoxVolume()._value

    first, second, other = volume(0), volume(0), volume(5)
    assert first == second
    assert abs(other / first - 1) > 1e-3


# -- looking on, and starting over -------------------------------------------------------------------------------------------------------
@SCHEME
@pytest.mark.parametrize("conservative", ["kernel", "openmm"])
def test_reporters_do_not_disturb(choices, conservative, tmp_path):
    """Energies, forces, states and samples asked for after every step leave the trajectory as it is; the energies are those of the positions."""
    scene = fluid(EXTENDED, BOXES["ortho"], n=60, seed=2)
    alone = started(REFERENCE, scene, steps=9, conservative=conservative, **choices)
    built = dpd.build(scene, dt=DT, platform="Reference", conservative=conservative, seed=11, **choices)
    watched = built.simulation()
    lines = io.StringIO()
    words = "step time potentialEnergy kineticEnergy totalEnergy temperature volume density speed"
    watched.reporters.append(app.StateDataReporter(lines, 1, **dict.fromkeys(words.split(), True)))
    watched.reporters.append(app.DCDReporter(str(tmp_path / "run.dcd"), 1))
    watched.reporters.append(app.CheckpointReporter(str(tmp_path / "run.chk"), 2))
    observer = dpd.Observer(built)
    for _ in range(9):
        watched.step(1)
        sample = observer.sample(watched.context)
        energy = watched.context.getState(energy=True).getPotentialEnergy().value_in_unit(unit.kilojoule_per_mole)
        assert energy == pytest.approx(sample.potential, rel=1e-12)
        assert watched.context.getParameter(PHASE) == Phase.IDLE
    assert same_bits(state_of(alone.context), state_of(watched.context))
    rows = [line.split(",") for line in lines.getvalue().splitlines()[1:]]
    assert len(rows) == 9 and float(rows[-1][2]) == pytest.approx(energy, rel=1e-12)


@SCHEME
def test_two_runs_after_resetting_the_step_count_draw_different_noise(choices):
    """Reset_timestep: same positions and velocities, step and time back to 0, other noise; with the noise count put back as well, the same."""
    simulation = started(REFERENCE, fluid(EXTENDED, BOXES["ortho"], n=60, seed=2), steps=0, **choices)
    start = state_of(simulation.context)
    ends = []
    for _ in range(3):
        place(simulation.context, start[0], start[1])
        simulation.context.setStepCount(0)
        simulation.context.setTime(0)
        simulation.step(5)
        assert simulation.context.getStepCount() == 5
        ends.append(state_of(simulation.context))
    for first, second in ((0, 1), (1, 2), (0, 2)):
        assert np.abs(ends[first][1] - ends[second][1]).max() > 0.1
    simulation.context.setParameter(COUNTER, 0)
    simulation.context.setPositions(start[0] + 1e-9)  # so that mvv does not go on from the history of the last run
    simulation.context.setVelocities(start[1])
    simulation.step(5)
    np.testing.assert_allclose(state_of(simulation.context)[1], ends[0][1], atol=1e-5)


@pytest.mark.parametrize("count", [2**24, 2**52])
def test_the_noise_count_may_be_large(device, count):
    """It is a whole number in a double on every platform; beyond 2^24 single precision would not count on."""
    simulation = run_of(beads(table={("W", "W"): D(gamma=4.5)}), device, dt=0.04, scheme="middle")
    simulation.context.setParameter(COUNTER, float(count))
    before = state_of(simulation.context)[1]
    changes = []
    for k in range(3):
        simulation.step(1)
        after = state_of(simulation.context)[1]
        changes.append(after - before)
        before = after
        assert simulation.context.getParameter(COUNTER) == count + k + 1
    for first, second in ((0, 1), (1, 2)):
        assert abs(np.corrcoef(changes[first].ravel(), changes[second].ravel())[0, 1]) < 0.4


@pytest.mark.parametrize("loop", [True, False])
@pytest.mark.parametrize(("name", "value"), [(COUNTER, -5.0), (COUNTER, np.inf), (SEED, np.nan), (SEED, 1.5)])
def test_a_key_of_the_noise_that_is_none(name, value, loop):
    """One that is set to no whole number stops the run, however many steps follow."""
    for steps in (1, 20):
        simulation = run_of(beads(), REFERENCE, dt=0.02, scheme="middle", loop=loop)
        simulation.step(2)
        simulation.context.setParameter(name, value)
        raises(openmm.OpenMMException, f"the context parameter {name} must be a whole number >= 0", simulation.step, steps)


@pytest.mark.parametrize(
    ("device", "conservative"),
    [(d, c) for d in DEVICES for c in ("kernel", "openmm") if c == "openmm" or d.precision == "single"],
    indirect=["device"],
    ids=str,
)
def test_noise_is_drawn_once_per_step_on_every_platform(device, conservative):
    """GPU platforms sort beads anew and wrap them into the box now and then; no bead moved, and mvv must not kick with two different noises.

    Where it does, in one of 40 steps, the fluid is 1.3 % cold.
    """
    simulation = stepped(run_of(beads(150, edge=3.7), device, dt=0.04, scheme="mvv", conservative=conservative), 120)
    assert 120 <= simulation.context.getParameter(COUNTER) <= 121


@SCHEME
def test_reinitializing_the_context_keeps_the_run_going(choices):
    first, second = started(REFERENCE, **choices), started(REFERENCE, **choices)
    second.context.reinitialize(preserveState=True)
    same_from_here(first, second)
