"""A state that one script wrote, loaded by another: whose temperature, seed, noise counter and step size hold.

The script's temperature, with a warning; the state's seed and counter, unless the script names a seed; the script's step size.
"""

import logging
import re

import numpy as np
import openmm
import pytest
from cases import cases, raises
from openmm import unit
from scenes import beads, same_bits, state_of, step_all, stepped

import openmm_dpd as dpd

SCHEMES = ("mvv", "shardlow", "middle", "aboba", "bababo")
SCHEME = pytest.mark.parametrize("scheme", SCHEMES)
WAYS = ("State", "Checkpoint")
HOW = pytest.mark.parametrize("how", WAYS)
PLATFORMS = ("Reference", "CPU")
_RUNS = [(PLATFORMS[(k + n) % 2], how, scheme) for k, scheme in enumerate(SCHEMES) for n, how in enumerate(WAYS)]
RUN = pytest.mark.parametrize("platform, how, scheme", _RUNS)  # every scheme, from both kinds of files, on both platforms by turns
REFUSED = (dpd.DPDError, openmm.OpenMMException)
DT, BEFORE, AFTER = 0.02, 7, 10


def script(platform, scheme, *, kT=1.0, dt=DT, **choices):
    """The Simulation that a script with these choices makes."""
    v = np.random.default_rng(2).normal(size=(81, 3))
    built = dpd.build(beads(kT=kT, velocities=v - v.mean(axis=0)), dt=dt, scheme=scheme, platform=platform, **choices)
    return built.simulation(properties={"Threads": "1"} if platform == "CPU" else {})


def hand_over(first, second, how, tmp_path, after=0):
    """Save the state of one Simulation after these steps and load it into another."""
    first.step(after)
    path = str(tmp_path / "saved")
    getattr(first, f"save{how}")(path)
    getattr(second, f"load{how}")(path)


def same(first, second) -> None:
    """Both are in the same state, to rounding in ten steps (an acceleration may be taken anew)."""
    for found, expected in zip(state_of(first.context), state_of(second.context), strict=True):
        assert np.abs(found - expected).max() < 1e-9


def parameter(simulation, name: str) -> float:
    return simulation.context.getParameter(name)


def warnings_of(caplog) -> list[str]:
    return [r.getMessage() for r in caplog.records if r.name.split(".")[0] == "openmm_dpd" and r.levelno >= logging.WARNING]


# -- temperature -----------------------------------------------------------------------------------------------------------------------
@RUN
def test_the_temperature_of_the_script_wins(platform, how, scheme, tmp_path, caplog):
    """Equilibrate hot, go on cold: as if the temperature had been set by hand, and said once."""
    caplog.set_level(logging.WARNING, "openmm_dpd")
    first, second = script(platform, scheme, seed=3), script(platform, scheme, kT=2.0)
    hand_over(first, second, how, tmp_path, after=BEFORE)
    dpd.set_kT(first.context, 2.0)
    for simulation in (first, second):
        simulation.step(AFTER)
        assert parameter(simulation, "dpd_kT") == 2.0
    same(first, second)
    said = warnings_of(caplog)
    assert len(said) == 1 and "\n" not in said[0], said
    assert "temperature" in said[0] or "kT" in said[0]


@RUN
@pytest.mark.parametrize("by", ["nothing", "set_temperature", "parameter", "setTemperature"])
def test_the_same_script_goes_on_without_a_word(platform, how, scheme, by, tmp_path, caplog):
    """The trajectory is that of the uninterrupted run, which stays as hot as it was, also where its temperature was changed."""
    caplog.set_level(logging.WARNING, "openmm_dpd")
    first, second = script(platform, scheme, seed=3), script(platform, scheme, seed=3)
    first.step(3)
    if by == "set_temperature":
        dpd.set_kT(first.context, 1.5)
    elif by == "parameter":
        first.context.setParameter("dpd_kT", 1.5)
    elif by == "setTemperature":
        first.integrator.setTemperature(1.5 / dpd.units.BOLTZMANN * unit.kelvin)
    first.step(BEFORE)
    kT = parameter(first, "dpd_kT")
    assert kT == (1.0 if by == "nothing" else pytest.approx(1.5, rel=1e-12))
    hand_over(first, second, how, tmp_path)
    for simulation in (first, second):
        simulation.step(AFTER)
        assert parameter(simulation, "dpd_kT") == kT
    same(first, second)
    assert not warnings_of(caplog)


@SCHEME
@HOW
def test_the_new_temperature_is_what_the_next_script_finds(how, scheme, tmp_path, caplog):
    """Three scripts: 1.0 wrote, 2.0 went on and wrote, 2.0 goes on once more, without a word."""
    first, second, third = script("Reference", scheme, seed=3), script("Reference", scheme, kT=2.0), script("Reference", scheme, kT=2.0)
    hand_over(first, second, how, tmp_path, after=BEFORE)
    second.step(3)
    caplog.clear()
    caplog.set_level(logging.WARNING, "openmm_dpd")
    hand_over(second, third, how, tmp_path)
    for simulation in (second, third):
        simulation.step(AFTER)
        assert parameter(simulation, "dpd_kT") == 2.0
    same(second, third)
    assert not warnings_of(caplog)


# -- seed and counter ------------------------------------------------------------------------------------------------------------------
@RUN
@pytest.mark.parametrize("kT", [1.0, 2.0])
def test_seed_and_counter_are_those_of_the_state(platform, how, scheme, kT, tmp_path):
    """The script names no seed; its temperature does not matter for that."""
    first, second = script(platform, scheme, seed=12345), script(platform, scheme, kT=kT)
    hand_over(first, second, how, tmp_path, after=BEFORE)
    second.step(AFTER)
    assert parameter(second, "dpd_seed") == 12345
    assert parameter(second, "dpd_counter") == parameter(first, "dpd_counter") + AFTER * parameter(first, "dpd_counter") / BEFORE


@RUN
@pytest.mark.parametrize("seed", [0, 1, 99])
def test_a_seed_that_the_script_names_holds(platform, how, scheme, seed, tmp_path):
    """A branch: as if the seed had been set by hand after loading; the counter goes on."""
    first, second = script(platform, scheme, seed=12345), script(platform, scheme, seed=seed)
    hand_over(first, second, how, tmp_path, after=BEFORE)
    first.context.setParameter("dpd_seed", seed)
    step_all(AFTER, first, second)
    assert parameter(second, "dpd_seed") == seed
    assert parameter(second, "dpd_counter") == parameter(first, "dpd_counter")
    same(first, second)


# -- step size and ramps ---------------------------------------------------------------------------------------------------------------
@RUN
def test_the_step_size_is_that_of_the_script(platform, how, scheme, tmp_path):
    """As if it had been set by hand."""
    first, second = script(platform, scheme, seed=3), script(platform, scheme, dt=0.01)
    first.step(BEFORE)
    time = first.context.getTime().value_in_unit(unit.picosecond)
    hand_over(first, second, how, tmp_path)
    first.integrator.setStepSize(0.01)
    step_all(AFTER, first, second)
    assert second.integrator.getStepSize().value_in_unit(unit.picosecond) == 0.01
    assert second.context.getTime().value_in_unit(unit.picosecond) == pytest.approx(time + AFTER * 0.01, abs=1e-12)
    same(first, second)


@RUN
def test_a_ramp_goes_on_where_it_was(platform, how, scheme, tmp_path, caplog):
    """Written in the middle of the ramp; nothing is said, and nothing refused."""
    caplog.set_level(logging.WARNING, "openmm_dpd")
    ramp = dpd.TemperatureRamp(kT_start=1.0, kT_end=2.0, first_step=4, last_step=20)
    first, second = script(platform, scheme, kT=ramp, seed=3), script(platform, scheme, kT=ramp, seed=3)
    hand_over(first, second, how, tmp_path, after=BEFORE)
    for n in (5, 20):
        step_all(n, first, second)
        assert parameter(second, "dpd_kT") == parameter(first, "dpd_kT")
    assert parameter(second, "dpd_kT") == 2.0
    same(first, second)
    assert not warnings_of(caplog)


# -- another scheme --------------------------------------------------------------------------------------------------------------------
@HOW
@pytest.mark.parametrize("written, loaded", [(a, b) for a in (*SCHEMES, "native") for b in SCHEMES if a != b])
def test_a_state_of_another_scheme_is_refused(how, written, loaded, tmp_path):
    """When it is loaded or at the first step, in words that say what is the matter."""
    platform = PLATFORMS[(how == "State") ^ (SCHEMES.index(loaded) % 2)]
    first, second = script(platform, written, seed=3), script(platform, loaded, seed=3)
    first.step(3)
    with pytest.raises(REFUSED) as caught:
        hand_over(first, second, how, tmp_path)
        second.step(1)
    text = str(caught.value)
    assert "scheme" in text and "\n" not in text.strip(), text


@HOW
def test_after_a_refusal_the_script_can_go_on(how, tmp_path):
    """A state of the right scheme is taken afterwards, and runs on as it would have."""
    wrong, right, second = (script("Reference", scheme, seed=3) for scheme in ("mvv", "middle", "middle"))
    step_all(BEFORE, wrong, right)
    with pytest.raises(REFUSED):
        hand_over(wrong, second, how, tmp_path)
        second.step(1)
    hand_over(right, second, how, tmp_path)
    step_all(AFTER, right, second)
    same(right, second)


# -- other variables ---------------------------------------------------------------------------------------------------------------------
RAMP = dpd.TemperatureRamp(2.0, 1.0, 0, 100)


@SCHEME
@pytest.mark.parametrize(("written", "loaded"), [("CPU", "Reference"), ("Reference", "CPU")])
def test_a_state_goes_from_one_platform_to_another(scheme, written, loaded, tmp_path):
    """Another program runs the scheme there, with other variables; positions, velocities and noise go on."""
    first, second = script(written, scheme, seed=3), script(loaded, scheme, seed=4)
    first.step(BEFORE)
    first.saveState(str(tmp_path / "saved"))
    second.loadState(str(tmp_path / "saved"))
    for found, expected in zip(state_of(second.context), state_of(first.context), strict=True):
        assert np.array_equal(found, expected)
    assert parameter(second, "dpd_counter") == BEFORE
    second.step(1)
    assert parameter(second, "dpd_counter") == BEFORE + 1


@SCHEME
@pytest.mark.parametrize(("written", "loaded"), [(RAMP, 1.0), (1.0, RAMP), (RAMP, dpd.TemperatureRamp(2.0, 1.5, 0, 100))])
def test_a_ramp_in_one_of_two_scripts(scheme, written, loaded, tmp_path, caplog):
    """XML has the names of variables: the script's temperature holds, said once.  A checkpoint without names is refused where they differ."""
    caplog.set_level(logging.WARNING, "openmm_dpd")
    first = stepped(script("CPU", scheme, kT=written, seed=3), BEFORE)
    first.saveState(str(tmp_path / "saved"))
    first.saveCheckpoint(str(tmp_path / "checkpoint"))
    second = script("CPU", scheme, kT=loaded, seed=3)
    second.loadState(str(tmp_path / "saved"))
    second.step(5)
    if isinstance(loaded, dpd.TemperatureRamp):
        done = 5 + (BEFORE if isinstance(written, dpd.TemperatureRamp) else 0)
        expected = 2.0 + (loaded.kT_end - 2.0) * done / 100
    else:
        expected = loaded
    assert parameter(second, "dpd_kT") == pytest.approx(expected, rel=1e-12)
    assert len(warnings_of(caplog)) == 1
    third = script("CPU", scheme, kT=loaded, seed=3)
    if isinstance(written, dpd.TemperatureRamp) and isinstance(loaded, dpd.TemperatureRamp):
        third.loadCheckpoint(str(tmp_path / "checkpoint"))
        third.step(5)
        assert parameter(third, "dpd_kT") == pytest.approx(expected, rel=1e-12)
    else:
        raises(dpd.PlanError, "checkpoint", lambda: third.loadCheckpoint(str(tmp_path / "checkpoint")))


def test_a_state_with_what_this_scene_lacks_says_how_it_is_loaded(tmp_path):
    x = np.random.default_rng(1).random((24, 3)) * 2.5
    given = {"masses": {"W": 1.0}, "types": ["W"] * 24, "positions": x, "kT": 1.0, "box": [2.5] * 3}
    kinds = {
        "plain": (dpd.DPD(A=25, gamma=4.5), None),
        "species": (dpd.TDPD(A=25, gamma=4.5, kappa=[1.0]), dpd.Concentrations(np.ones((24, 1)))),
    }
    plain, species = (
        dpd.build(dpd.Scene(**given, pairs={("W", "W"): pair}, internal=internal), dt=0.02, platform="Reference", seed=1).simulation()
        for pair, internal in kinds.values()
    )
    state = species.context.getState(positions=True, velocities=True, parameters=True)
    raises(
        dpd.PlanError,
        "dpd_(written|by_fields) .*what beads carry; here none do: use simulation.loadState",
        plain.context.setState,
        state,
    )
    species.saveState(str(tmp_path / "saved"))
    plain.loadState(str(tmp_path / "saved"))
    assert np.array_equal(state_of(plain.context)[0], state_of(species.context)[0])
    energies = dpd.build(
        dpd.Scene(
            **given,
            pairs={("W", "W"): dpd.EnergyDPD(A=25, sigma=3, kappa=1)},
            internal=dpd.InternalEnergy(dpd.ConstantHeatCapacity(50.0), 1.0),
        ),
        dt=0.02,
        platform="Reference",
        seed=1,
    ).simulation()
    energies.saveState(str(tmp_path / "energies"))
    raises(dpd.PlanError, "has the parameter dpd_volume_.* of another kind of scene", plain.loadState, str(tmp_path / "energies"))


# -- other forces ------------------------------------------------------------------------------------------------------------------------
_OTHER = {"repulsion": {"table": {("W", "W"): dpd.DPD(A=60, gamma=4.5)}}, "friction": {"table": {("W", "W"): dpd.DPD(A=25, gamma=40.5)}}}
_OTHER |= {"masses": {"bead_masses": np.linspace(1, 3, 81)}, "bonds": {"bonds": [dpd.HarmonicBonds([(0, 1), (3, 7)], 50.0, 0.5)]}}


@HOW
@cases("given", _OTHER)
@cases("choices", {"mvv": {"scheme": "mvv"}, "a program": {"scheme": "mvv", "loop": False}, "a word": {"scheme": "bababo", "loop": False}})
def test_an_acceleration_by_other_forces_is_not_taken_over(how, given, choices, tmp_path):
    """The first half kick was by the forces of the script that wrote the state.  Valid for nothing, it is computed anew."""
    written = stepped(dpd.build(beads(), dt=DT, platform="Reference", seed=3, **choices).simulation(), BEFORE)
    found, expected = (dpd.build(beads(**given), dt=DT, platform="Reference", seed=3, **choices).simulation() for _ in range(2))
    for simulation in (found, expected):
        hand_over(written, simulation, how, tmp_path)
    expected.integrator.setGlobalVariableByName("valid_for", -1.0)
    step_all(1, found, expected)
    assert same_bits(state_of(found.context), state_of(expected.context))


def test_a_state_that_does_not_say_by_which_forces_goes_on_exactly(tmp_path):
    """An earlier version wrote it."""
    first, second = (dpd.build(beads(), dt=DT, scheme="mvv", platform="Reference", seed=3).simulation() for _ in range(2))
    path = tmp_path / "saved"
    stepped(first, BEFORE).saveState(str(path))
    text, there = re.subn(r'dpd_by_forces="[^"]*"', "", path.read_text())
    assert there == 1
    path.write_text(text)
    second.loadState(str(path))
    step_all(AFTER, first, second)
    assert same_bits(state_of(first.context), state_of(second.context))
