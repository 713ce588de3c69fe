"""Schemes as words: what is read and what is refused, what a word says about itself, and where words replace names."""

import io
import json
import warnings
from fractions import Fraction
from pathlib import Path

import numpy as np
import openmm
import pytest
from cases import cases, put, raises
from devices import Device
from fluid_deck import ONE_TYPE
from scenes import beads, run_of, state_of, step_all, stepped

import openmm_dpd as dpd
from openmm_dpd.__main__ import main
from openmm_dpd.advice.recommend import advice, predicted_error
from openmm_dpd.lammps import RunOptions, export_lammps, run_deck
from openmm_dpd.measure.stress_parts import kinetic_deficit
from openmm_dpd.model.eos import ConstantHeatCapacity
from openmm_dpd.model.schemes import SCHEMES, Scheme, read_word, scheme_of, spelt
from openmm_dpd.plan.plan import make_plan

HALF = Fraction(1, 2)
NAMED = [scheme for scheme in SCHEMES.values() if scheme.letters]
BAOAB = "B/2 A/2 O A/2 B/2"
REFERENCE = Device("Reference")

DECK = ONE_TYPE + "timestep 0.01\nthermo 10\nrun 20\n"


@pytest.fixture
def deck(tmp_path: Path) -> Path:
    return put(tmp_path / "in.fluid", DECK)


def still(n: int = 81, **options) -> dpd.Scene:
    """The standard fluid with velocities, as dense as the table of steps has it."""
    v = np.random.default_rng(2).normal(size=(n, 3))
    return beads(n, velocities=v - v.mean(axis=0), **options)


# -- reading and spelling ------------------------------------------------------------------------------------------------------------
@cases(
    "text, letters",
    ("A B O", [("A", 1), ("B", 1), ("O", 1)]),
    ("B/2 A/2 O A/2 B/2", [("B", HALF), ("A", HALF), ("O", 1), ("A", HALF), ("B", HALF)]),
    ("3B/5 A 2B/5 S", [("B", Fraction(3, 5)), ("A", 1), ("B", Fraction(2, 5)), ("S", 1)]),
    ("1A/1 2B/2 O/2 S/2", [("A", 1), ("B", 1), ("O", HALF), ("S", HALF)]),
    ("  B\t A/2\n O A/2  ", [("B", 1), ("A", HALF), ("O", 1), ("A", HALF)]),
    ("118880B/1000000 A 881120B/1000000 O", [("B", Fraction(1486, 12500)), ("A", 1), ("B", Fraction(11014, 12500)), ("O", 1)]),
)
def test_words_are_read(text, letters):
    assert read_word(text) == tuple((name, Fraction(part)) for name, part in letters)
    assert scheme_of(text).letters == read_word(text)


@cases(
    "text, reason",
    ("B/2 A/2 X A/2 B/2", r"'X' is no part of a step .*A \(drift\), B \(kick\), O .*, S "),
    ("b/2 A O B/2", "'b/2' is no part|unknown scheme 'b/2"),
    ("B/2 a O B/2", "'a' is no part"),
    ("B A/2 o A/2", "'o' is no part"),
    ("B-A-O", "'B-A-O' is no part"),
    ("BAOAB", "'BAOAB' is no part"),
    ("B/2A/2 O A/2 B/2", "'B/2A/2' is no part"),
    ("-A 2A B O", "'-A' is no part"),
    ("0.5B A O B/2", "'0.5B' is no part"),
    ("B/2/2 A O", "'B/2/2' is no part"),
    ("B/ A O", "'B/' is no part"),
    ("A/0 B O", "'A/0' .* a number in it is 0"),
    ("A 0B B O", "'0B' .* a number in it is 0"),
    ("A B 0O/3 O", "'0O/3' .* a number in it is 0"),
    ("A/2 B O", "drifts A .* add up to 1/2 of a step, not to 1"),
    ("A A B O", "drifts A .* add up to 2 of"),
    ("A B/3 B/3 O", "kicks B .* add up to 2/3"),
    ("A B", "sweeps O and S .* add up to 0"),
    ("A B O S", "sweeps O and S .* add up to 2"),
    ("A B O/2 S/3", "sweeps O and S .* add up to 5/6"),
    ("B O", "drifts A .* add up to 0"),
    ("O", "drifts A"),
)
def test_words_are_refused_with_the_reason(text, reason):
    raises(dpd.ParameterError, reason, lambda: scheme_of(text))
    raises(dpd.ParameterError, reason, lambda: dpd.build(beads(), dt=0.02, scheme=text, platform="Reference"))


@cases("text", "", "  ", None, 3, 0.5, b"A B O", ["A", "B", "O"], ("middle",), True, "verlet", "Middle ", "MVV", "leap frog")
def test_what_is_no_word_is_an_unknown_scheme(text):
    names = "mvv, shardlow, middle, basa, aboba, bababo, bababs, bab3, native"
    raises(dpd.ParameterError, f"unknown scheme .*{names}, or a word such as", scheme_of, text)
    raises(dpd.ParameterError, "unknown scheme", lambda: make_plan(beads(), dt=0.02, scheme=text))


@pytest.mark.parametrize("text", ["A B O", BAOAB, "3B/5 A 2B/5 S", "O/3 B A 2S/3", "A/4 S A/4 B A/2"])
def test_spelling_is_the_word(text):
    scheme = scheme_of(text)
    assert scheme.name == scheme.word == str(scheme) == " ".join(map(spelt, scheme.letters)) == text
    assert scheme_of(scheme.word) == scheme and scheme_of(scheme) is scheme
    assert not scheme.measured and scheme.sweeps and not scheme.predicts and not scheme.native and not scheme.constraints


def test_fractions_are_spelt_in_lowest_terms_and_two_sweeps_in_a_row_are_two():
    """Two sweeps over half a step are not one over the whole: each pair meets the changes of the others in between."""
    assert scheme_of("2B/4 3A/6 4O/4 2A/4 5B/10").name == BAOAB
    assert scheme_of("10B/30 A 20B/30 O").name == "B/3 A 2B/3 O"
    for text in ("O/2 O/2 A/2 B A/2", "A/2 B S/3 2S/3 A/2"):
        assert " ".join(map(spelt, scheme_of(text).steps())) == text


@pytest.mark.parametrize("scheme", NAMED, ids=str)
def test_the_word_of_a_named_scheme_is_that_scheme(scheme):
    assert scheme_of(scheme.word) is scheme_of(scheme.name) is scheme
    assert scheme_of(" ".join(f"{2 * part.numerator}{name}/{2 * part.denominator}" for name, part in scheme.letters)) is scheme
    assert make_plan(beads(), dt=0.02, scheme=scheme.word, seed=1).options.scheme is scheme
    ends = [state_of(stepped(run_of(still(), REFERENCE, dt=0.02, scheme=text), 3).context) for text in (scheme.name, scheme.word)]
    assert np.array_equal(ends[0][0], ends[1][0]) and np.array_equal(ends[0][1], ends[1][1])


# -- what a word says about itself ---------------------------------------------------------------------------------------------------
@cases(
    "text, lag",
    ("middle", 0.5),
    ("aboba", 0.0),
    ("bababo", 0.0),
    ("shardlow", 0.0),
    ("mvv", 0.0),
    ("native", 0.5),
    (BAOAB, 0.0),
    ("B A O", 0.5),
    ("A B O", -0.5),
    ("B/5 A 4B/5 O", -0.3),
    ("A/2 O/2 B O/2 A/2", 0.0),
    ("B/4 A/2 B/4 A/2 B/2 O", -0.125),
)
def test_lag_of_the_velocities(text, lag):
    """By how much of a kick velocities are behind."""
    assert scheme_of(text).lag == pytest.approx(lag, abs=1e-15)


def moments(scheme: Scheme) -> Fraction:
    """In a constant field x(1) = v(0) + (1/2 + lag) f: each kick acts during the drifts after it."""
    parts = [(name, part) for name, part in scheme.steps(thermostat=False)]
    acts = sum(part * sum(p for name, p in parts[n:] if name == "A") for n, (letter, part) in enumerate(parts) if letter == "B")
    return acts - HALF


UNEVEN = ("A/3 B/2 A/3 O B/2 A/3", "A/4 S A/4 B A/2", "A/3 B 2A/3 O", "3A/4 B O A/4", "B/4 A/4 B/2 3A/4 B/4 O")


@cases("text", *(scheme.name for scheme in NAMED), BAOAB, "A B O", "B/5 A 4B/5 O", *UNEVEN)
def test_lag_is_that_of_a_constant_field(text):
    """With v + lag f dt/m for v the positions are x + v dt + f dt^2/2m."""
    assert scheme_of(text).lag == pytest.approx(float(moments(scheme_of(text))), abs=1e-15)


def stationary(scheme: Scheme, omega_dt: float, friction: float) -> np.ndarray:
    """Covariances of x and of v at whole steps, for a harmonic oscillator with omega = kT = m = 1 whose sweeps are exact."""
    step, noise = np.eye(2), np.zeros((2, 2))
    for name, part in scheme.motion:
        h = float(part) * omega_dt
        keep = np.exp(-friction * h)
        letter = {"A": [[1, h], [0, 1]], "B": [[1, 0], [-h, 1]]}.get(name, [[1, 0], [0, keep]])
        step, noise = np.array(letter) @ step, np.array(letter) @ noise @ np.array(letter).T
        if name in "OS":
            noise[1, 1] += 1 - keep**2
    return np.linalg.solve(np.eye(4) - np.kron(step, step), noise.ravel()).reshape(2, 2)


SYMMETRIC = {"middle": 0.25, "native": 0.25, BAOAB: 0.25, "aboba": -0.25, "bababo": 0.0, "shardlow": 0.0, "O/2 B/2 A B/2 O/2": 0.0}
OTHERS = {"B A O": 0.0, "A B O": 0.0, "A/2 O B A/2": -0.25, "A/3 B O 2A/3": -2 / 9, "O/4 B A/2 3O/4 A/2": 0.1875}


@pytest.mark.parametrize(
    ("text", "deficit", "friction"),
    [(text, c, friction) for text, c in SYMMETRIC.items() for friction in (1e-3, 30.0)] + [(text, c, 1e-4) for text, c in OTHERS.items()],
)
def test_the_kinetic_part_of_a_harmonic_bond_is_right(text, deficit, friction):
    """m <v v> + c dt^2 <F F>/m is kT to fourth order in the step, where velocities at full steps are off by c (omega dt)^2.

    At any friction if what is left and right of the sweep mirror each other, else at weak friction.
    """
    scheme = scheme_of(text)
    assert kinetic_deficit(scheme) == pytest.approx(deficit, abs=1e-15)
    errors = []
    for omega_dt in (0.2, 0.1):
        covariance = stationary(scheme, omega_dt, friction)
        on_step = np.array([-scheme.lag * omega_dt, 1.0])
        errors.append(on_step @ covariance @ on_step + kinetic_deficit(scheme) * omega_dt**2 * covariance[0, 0] - 1.0)
    assert abs(errors[0]) < 2e-4 and abs(errors[1]) < 2e-4 / 15, errors


@cases(
    "text, left",
    ("middle", "B A"),
    ("shardlow", "B/2 A B/2"),
    ("aboba", "A/2 B A/2"),
    ("bababo", "B/5 A/2 3B/5 A/2 B/5"),
    ("mvv", "B/2 A B/2"),
    (BAOAB, "B/2 A B/2"),
    ("B/2 O/2 B/2 A/2 S/2 A/2", "B A"),
)
def test_without_friction_sweeps_are_dropped(text, left):
    """... and what follows each other is one."""
    assert " ".join(map(spelt, scheme_of(text).steps(thermostat=False))) == left


@pytest.mark.parametrize("conservative", ["kernel", "openmm"])
@pytest.mark.parametrize("text", [BAOAB, "O/2 B/2 A B/2 O/2", "A/2 S/2 B S/2 A/2"])
def test_a_frictionless_word_steps_as_its_kicks_and_drifts(text, conservative):
    """The same trajectory as by the named scheme that has the same ones, and no noise is drawn."""
    same = "aboba" if text.startswith("A") else "mvv"
    scene = still(table={("W", "W"): dpd.DPD(A=25)})
    runs = [run_of(scene, REFERENCE, dt=0.02, scheme=name, conservative=conservative) for name in (text, same)]
    for simulation in runs:
        simulation.step(20)
    (x, v), (other_x, other_v) = (state_of(simulation.context) for simulation in runs)
    assert np.abs(x - other_x).max() < 1e-12 and np.abs(v - other_v).max() < 1e-11
    if conservative == "kernel":
        assert runs[0].context.getParameter("dpd_counter") == 0


# -- where words are taken -----------------------------------------------------------------------------------------------------------
def _constrained(word: str):
    """Atoms, two of them at a fixed distance, under pairwise friction."""
    system = openmm.System()
    for _ in range(4):
        system.addParticle(39.9)
    system.addConstraint(0, 1, 0.3)
    return dpd.add_thermostat(system, dpd.DPD(gamma=5, cutoff=0.6), 300, 0.002, scheme=word, platform="Reference").integrator


def test_constraints_and_other_parameters_that_do_not_go_with_words():
    for text in (BAOAB, "A/2 B/2 S B/2 A/2", "A B O"):
        raises(dpd.PlanError, "constrain.*middle", _constrained, text)
    made = _constrained("B A/2 O A/2")
    assert any(made.getComputationStep(k)[0] == made.ConstrainPositions for k in range(made.getNumComputations()))
    raises((dpd.ParameterError, dpd.PlanError), "lam", lambda: dpd.build(beads(), dt=0.02, scheme=BAOAB, lam=0.65, platform="Reference"))
    scene = beads(table={("W", "W"): dpd.EDPD(A=25, gamma=4.5, kappa=1e-3)}, internal=dpd.BeadTemperatures(1.0, 30.0), compat="lammps")
    reason = "keeps the energy of a pair, which LAMMPS's heat does not; only scheme='mvv'.*B/2 A/2 O A/2 B/2"
    raises(dpd.PlanError, reason, dpd.build, scene, dt=0.02, scheme=BAOAB, platform="Reference")
    built = dpd.build(beads(), dt=0.02, scheme=BAOAB, platform="Reference", seed=1)
    assert BAOAB in dpd.explain_plan(built.plan) and BAOAB in repr(built.plan) and BAOAB in built.explain()


DENSE = beads(375, edge=5.0)


def test_advice_about_words():
    """About a word of a name what is known of the name; nothing is known of others."""
    for scheme in NAMED:
        assert predicted_error(DENSE, scheme.word, 0.04) == predicted_error(DENSE, scheme.name, 0.04) is not None
        assert "at dt = 0.04 ps" in advice(DENSE, scheme.word, 0.04)
    assert predicted_error(DENSE, BAOAB, 0.04) is None
    assert "nothing was measured" in advice(DENSE, BAOAB, 0.04) and BAOAB in advice(DENSE, BAOAB, 0.04)
    for ask in (predicted_error, advice):
        raises(dpd.ParameterError, "unknown scheme", ask, DENSE, "baoab", 0.04)


# -- decks ---------------------------------------------------------------------------------------------------------------------------
def test_the_command_line_takes_a_word(deck, tmp_path, capsys):
    report = tmp_path / "report.json"
    words = ["--scheme", "2B/4 A/2 O A/2 B/2", "--platform", "CPU", "--threads", "1", "--quiet"]
    assert main(["run", str(deck), *words, "--json", str(report), "--out", str(tmp_path / "out")]) == 0
    found = json.loads(report.read_text())
    assert scheme_of(found["scheme"]).name == BAOAB
    assert found["momentum"] is not None
    capsys.readouterr()
    assert main(["explain", str(deck), "--scheme", BAOAB, "--platform", "CPU"]) == 0
    text = capsys.readouterr().out
    assert BAOAB in text and "nothing was measured" in text


@pytest.mark.parametrize(("word", "reason"), [("A B", "add up to 0"), ("baoab", "unknown scheme"), ("", "unknown scheme")])
def test_the_command_line_refuses_what_is_no_step(deck, tmp_path, capsys, word, reason):
    run = ["run", str(deck), "--quiet", "--out", str(tmp_path / "out")]
    for command in (run, ["explain", str(deck)], ["export", str(deck), str(tmp_path / "to")]):
        assert main([*command, "--scheme", word]) == 1
        error = capsys.readouterr().err
        assert reason in error and error.count("\n") == 1


def test_a_deck_runs_as_the_scene_does(deck, tmp_path):
    """A deck's run with a word is that of its name."""
    options = [RunOptions(scheme=text, platform="CPU", threads=1) for text in ("middle", "B A/2 O A/2")]
    runs = [run_deck(deck, one, out=tmp_path / one.scheme[0])["runs"] for one in options]
    assert runs[0][0]["thermo"]["temp"]["last"] > 0
    assert [run["thermo"] for run in runs[0]] == [run["thermo"] for run in runs[1]]


def exported(folder, scheme: str) -> tuple[str, ...]:
    """What an export says that LAMMPS will do differently."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        return export_lammps(DENSE, folder, "fluid", dt=0.02, steps=10, scheme=scheme).differences


@cases("text", BAOAB, "A/2 B/2 O B/2 A/2", "A/2 B/2 S B/2 A/2", "S/2 B/2 A B/2 S/2")
def test_export_notes_that_lammps_has_no_such_scheme(text, tmp_path):
    assert exported(tmp_path / "shardlow", "S B/2 A B/2") == ()
    notes = " ".join(exported(tmp_path, text))
    assert "LAMMPS has no scheme" in notes and scheme_of(text).name in notes


def saved(scheme: str, how: str) -> tuple:
    simulation = stepped(run_of(still(), REFERENCE, dt=0.02, scheme=scheme), 2)
    file = io.StringIO() if how == "State" else io.BytesIO()
    getattr(simulation, f"save{how}")(file)
    file.seek(0)
    return simulation, file


@pytest.mark.parametrize("how", ["State", "Checkpoint"])
def test_states_of_other_words_are_refused(how):
    """... and go from a name to its word."""
    for writer, reader in ((BAOAB, "middle"), ("middle", BAOAB), (BAOAB, "B/2 A/2 S A/2 B/2"), ("O/2 B A O/2", "O/3 B A 2O/3")):
        _, file = saved(writer, how)
        other = run_of(still(), REFERENCE, dt=0.02, scheme=reader)
        raises(dpd.PlanError, "written by another scheme|with other variables", getattr(other, f"load{how}"), file)
    simulation, file = saved("middle", how)
    other = run_of(still(), REFERENCE, dt=0.02, scheme="B A/2 O A/2")
    getattr(other, f"load{how}")(file)
    step_all(3, simulation, other)
    assert np.array_equal(state_of(simulation.context)[1], state_of(other.context)[1])


def test_a_word_conserves_energy_in_its_sweeps():
    """Internal energies: what a sweep takes from the motion the beads get; kicks and drifts conserve as velocity Verlet does."""
    internal = dpd.InternalEnergy(ConstantHeatCapacity(60.0), 1.0)
    scene = still(table={("W", "W"): dpd.EnergyDPD(A=25, sigma=3, kappa=1.0)}, internal=internal)
    built = dpd.build(scene, dt=0.005, scheme="O/2 B/2 A B/2 O/2", platform="Reference", seed=1)
    simulation, observer = built.simulation(), dpd.Observer(built)
    before = observer.sample(simulation.context).total
    simulation.step(100)
    assert observer.sample(simulation.context).total == pytest.approx(before, abs=2e-3 * 81)
