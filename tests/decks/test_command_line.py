"""The command line: what it writes, what it overrides, and one clear line for each kind of bad input."""

import io
import json
import re
import signal
import subprocess
import sys
from pathlib import Path

import numpy as np
import openmm
import pytest
from cases import cases, put, raises
from fluid_deck import FLUID

import openmm_dpd as dpd
from openmm_dpd import __main__ as cli
from openmm_dpd.__main__ import main
from openmm_dpd.lammps import RunOptions, deck_forces, deck_scene, explain_deck, run_deck
from openmm_dpd.trajectory import load

DECKS = Path(__file__).parents[2] / "examples" / "decks"


@pytest.fixture
def deck(tmp_path: Path) -> Path:
    return put(tmp_path / "in.fluid", FLUID)


def test_run_writes_everything(deck, tmp_path, capsys):
    out, report_file = tmp_path / "out", tmp_path / "report.json"
    assert main(["run", str(deck), "--platform", "CPU", "--threads", "1", "--json", str(report_file), "--out", str(out)]) == 0
    report = json.loads(report_file.read_text())
    words = "natoms units scheme platform precision threads momentum runs steps dt seconds_per_step thermo"
    assert set(report) >= set(words.split())
    assert (report["natoms"], report["units"], report["scheme"], report["platform"], report["threads"]) == (192, "lj", "mvv", "CPU", 1)
    assert [run["steps"] for run in report["runs"]] == [50, 30]
    assert report["steps"] == 30 and report["dt"] == pytest.approx(0.01)
    assert report["momentum"] < 1e-9 * 192
    words = {"step", "temp", "press", "pe", "v_twice", "c_thermo_temp", "press_full", "ke", "etotal", "temp_conf"}
    assert set(report["thermo"]) == words
    for word in words:
        assert set(report["thermo"][word]) == {"mean", "sem", "first", "last"}
    assert report["thermo"]["v_twice"]["mean"] == pytest.approx(2 * report["thermo"]["temp"]["mean"])
    # the second run starts where the first one ends
    assert report["thermo"]["step"]["first"] == 50 and report["thermo"]["step"]["last"] == 80
    assert report["runs"][1]["thermo"]["pe"]["first"] == pytest.approx(report["runs"][0]["thermo"]["pe"]["last"], rel=1e-9)
    for name in ("trajectory.dcd", "topology.psf", "final_state.xml", "thermo.png", "beads.png"):
        assert (out / name).stat().st_size > 0
    printed = capsys.readouterr().out.splitlines()
    assert sum("Step" in line and "v_twice" in line for line in printed) == 2
    assert (out / "log.txt").read_text(encoding="utf-8").splitlines() == printed[:-1]  # everything is in the log as well, and what it took
    loop = r"Loop time of \S+ s for (\d+) steps of 192 beads \(run (\d)\): (\S+) steps/s, (\S+) bead-steps/s"
    speeds = [re.fullmatch(loop, line) for line in printed]
    assert [(found[2], found[1]) for found in speeds if found] == [("1", "50"), ("2", "30")]
    assert all(float(found[4]) == pytest.approx(192 * float(found[3]), rel=0.01) for found in speeds if found)
    temperature = report["thermo"]["temp"]
    assert "averages of run 2 over 4 rows, from step 50 on, with standard errors:" in printed
    (line,) = (line for line in printed if line.startswith("  temp "))
    assert line.split()[1] == f"{temperature['mean']:.8g}" and (temperature["sem"] is None) == ("+-" not in line)
    assert not (out / "checkpoint").exists()  # there is nothing to resume


@pytest.mark.parametrize(
    "line", ["delete_atoms random count 5 yes all NULL 8", "create_atoms 1 single 1 1 1", "replicate 2 1 1", "unfix move"]
)
def test_beads_may_change_after_the_last_run(tmp_path, line):
    deck = put(tmp_path / "in.fluid", FLUID.replace("run 50", "run 5").replace("run 30", "run 5") + f"\n{line}\nwrite_data end.data\n")
    assert main(["run", str(deck), "--out", str(tmp_path / "out"), "--quiet"]) == 0
    assert (tmp_path / "out" / "beads.png").stat().st_size > 0


def test_version(capsys):
    raises(SystemExit, "0", main, ["--version"])
    assert capsys.readouterr().out == f"openmm-dpd {dpd.__version__}, OpenMM {openmm.__version__}\n"


def test_recommend_speaks_in_the_units_of_the_deck(tmp_path, capsys):
    deck = put(tmp_path / "in.fluid", FLUID)
    assert main(["recommend", str(deck), "--error", "0.02"]) == 0
    lines = capsys.readouterr().out.splitlines()
    best = dpd.recommend(deck_scene(deck), 0.02)
    assert lines[0] == f"for temperatures within 2 % (95 of 100 times): {best.scheme} at dt = {best.dt:.2g}"
    assert len(lines) == 1 + len(best.choices) + len(best.notes) + 1
    assert lines[-1].startswith("the deck's own: mvv at dt = 0.01: ")
    assert main(["recommend", str(deck), "--scheme", "middle", "--dt", "0.03"]) == 0
    assert "middle at dt = 0.03:" in capsys.readouterr().out


@pytest.mark.parametrize("form", ["dcd", "xtc"])
def test_frames_at_chosen_steps(deck, tmp_path, form):
    """Multiples of --every, each once, although the second run begins where the first one ends."""
    words = ["run", str(deck), "--platform", "CPU", "--threads", "1", "--out", str(tmp_path), "--format", form, "--every", "25", "--quiet"]
    dump = "dump d all custom 25 dump.d xu yu zu\ndump_modify d format float %.9g\nrun 50"
    deck.write_text(FLUID.replace("run 50", dump), encoding="utf-8")
    assert main(words) == 0
    frames = load(tmp_path / f"trajectory.{form}", tmp_path / "topology.psf")
    dumped = (tmp_path / "dump.d").read_text(encoding="utf-8").split("ITEM: TIMESTEP\n")[1:]
    assert [int(frame.split()[0]) for frame in dumped] == [0, 25, 50, 75]
    expected = np.array([np.loadtxt(frame.splitlines()[8:]) for frame in dumped])
    np.testing.assert_allclose(frames.xyz, expected, atol=6e-4 if form == "xtc" else 1e-6)
    assert np.abs(expected[1:] - expected[:-1]).max() > 0.1
    np.testing.assert_allclose(frames.unitcell_lengths, 4.0, atol=1e-6)
    if form == "xtc":
        np.testing.assert_allclose(frames.time, [0.0, 0.25, 0.5, 0.75], atol=1e-6)


@cases(
    "words, message",
    (["--steps", "-4"], "--steps must be at least 0, but is -4"),
    (["--checkpoint", "0"], "--checkpoint must be at least 1, but is 0"),
    (["--every", "0"], "--every must be at least 1, but is 0"),
    (["--dt", "nan"], "--dt must be > 0, but is nan"),
    (["--restart", "nowhere"], "--restart: there is no checkpoint in nowhere; give the --out folder of the interrupted run"),
)
def test_wrong_options_are_named(deck, capsys, words, message):
    assert main(["run", str(deck), "--out", str(deck.parent / "out"), *words]) == 1
    assert capsys.readouterr().err == f"openmm-dpd: error: {message}\n"


def test_trajectory_opens_in_mdtraj_with_the_right_masses(deck, tmp_path):
    from openmm_dpd.trajectory import bead_masses

    run_deck(deck, RunOptions(platform="CPU", threads=1), out=tmp_path)
    trajectory = load(tmp_path / "trajectory.dcd", tmp_path / "topology.psf")
    assert trajectory.n_atoms == 192
    np.testing.assert_allclose(bead_masses(trajectory.topology), [1.0] * 100 + [2.0] * 92)
    np.testing.assert_allclose(trajectory.unitcell_lengths[0], 4.0, rtol=1e-6)


def test_overrides_apply_to_every_run(deck):
    report = run_deck(deck, RunOptions(platform="Reference", scheme="middle", dt=0.02, steps=4, threads=1))
    assert report["scheme"] == "middle"
    assert [(run["steps"], run["dt"]) for run in report["runs"]] == [(4, pytest.approx(0.02))] * 2


def test_discard_leaves_out_the_beginning(deck):
    all_rows = run_deck(deck, RunOptions(platform="Reference", threads=1, discard=0))["runs"][0]["thermo"]["step"]
    late = run_deck(deck, RunOptions(platform="Reference", threads=1, discard=30))["runs"][0]["thermo"]["step"]
    assert all_rows["mean"] == 25 and late["mean"] == 40 and late["first"] == 0


def test_seeds_and_runs_draw_different_noise(deck):
    def last(seed: int) -> float:
        return run_deck(deck, RunOptions(platform="Reference", threads=1, seed=seed, steps=5))["thermo"]["pe"]["last"]

    assert last(1) == last(1)
    assert last(1) != last(2)


@pytest.mark.parametrize("scheme", ["mvv", "middle"])
def test_forces_add_up_and_do_not_depend_on_the_scheme(deck, tmp_path, scheme):
    target = tmp_path / "forces.json"
    assert main(["forces", str(deck), "--platform", "Reference", "--json", str(target)]) == 0
    terms = {name: np.array(force) for name, force in json.loads(target.read_text())["terms"].items()}
    assert set(terms) == {"conservative", "dissipative", "random"}
    again = deck_forces(deck, RunOptions(platform="Reference", scheme=scheme))
    for name, force in terms.items():
        assert force.shape == (192, 3)
        np.testing.assert_allclose(force.sum(axis=0), 0, atol=1e-10)
        np.testing.assert_allclose(force, again[name], rtol=1e-12, atol=1e-12)


def test_explain_shows_plan_program_and_notes(deck):
    text = explain_deck(deck, RunOptions(platform="CPU"))
    for part in ("192 beads of 2 type(s)", "scheme: mvv", "program mvv", "comm_modify has no effect here; keep it"):
        assert part in text


@cases("units, T, spacing, said", ("real", 1, 6, True), ("metal", 300, 0.5, True), ("real", 300, 6, False), ("lj", 1, 0.5, False))
def test_reduced_numbers_in_other_units_are_noted(deck, units, T, spacing, said):
    """Too cold, or too dense for beads as large as atoms."""
    box = f"lattice sc {spacing if units != 'lj' else spacing**-3}\nregion b block 0 9 0 9 0 9\ncreate_box 1 b\ncreate_atoms 1 box\n"
    deck.write_text(f"units {units}\n{box}mass 1 9\npair_style dpd {T} {2 * spacing} 7\npair_coeff 1 1 1 1\nfix 1 all nve\nrun 1\n")
    noted = "in.fluid:7: the temperature is below 10 K, or there is more than one bead per cubic Angstrom, as in reduced units (units lj)"
    assert (noted in explain_deck(deck)) == said


@cases(
    "edit, message",
    (("pair_coeff 1 2 30.0 4.5\n", ""), "in.fluid:11: no pair coefficients for type pair 1 2"),
    (("1 2 30.0 4.5", "1 2 30.0 -4.5"), "in.fluid:13: pair style dpd, types 1 2: gamma must be >= 0, but is -4.5"),
    (("2 2 25.0 4.5", "2 2 25.0 4.5 2.5"), "in.fluid:14: the cutoff 2.5 of types 2 2 exceeds half the box"),
    (("timestep", "tempstep"), "in.fluid:17: unknown or unsupported command 'tempstep'"),
    (("run 50\nrun 30\n", ""), "in.fluid: the deck has no run command"),
    (("fix move all nve", "fix move all adapt 1"), "in.fluid:16:"),
    (
        ("pair_style dpd 1.0 1.0 34387\npair_coeff 1 1 25.0 4.5\npair_coeff 1 2 30.0 4.5\npair_coeff 2 2 25.0 4.5\n", ""),
        "needs a preceding pair_style",
    ),
    (("2*temp", "c_none[1]"), "variable twice: there is no compute 'none'"),
    (("2*temp", "1e308*10"), "in.fluid:21: thermo output v_twice is inf at step 0"),
    (("timestep", "dump d all custom 10 ../in.fluid/d id\ntimestep"), "in.fluid:17: the file '../in.fluid/d' would lie outside the"),
    (("timestep", "print hello file a/../../b\ntimestep"), "in.fluid:17: the file 'a/../../b' would lie outside the"),
    (("timestep", "fix a all ave/time 1 1 1 c_thermo_temp file ../b\ntimestep"), "in.fluid:17: the file '../b' would lie outside the"),
    (("25.0 4.5\npair_coeff 1 2", "nan 4.5\npair_coeff 1 2"), "in.fluid:12:"),
)
def test_one_clear_line_for_bad_input(deck, capsys, edit, message):
    text = FLUID.replace(*edit)
    assert text != FLUID
    deck.write_text(text)
    assert main(["run", str(deck), "--platform", "Reference", "--quiet", "--out", str(deck.parent / "out")]) == 1
    error = capsys.readouterr().err
    assert message in error
    assert error.count("\n") == 1


@cases(
    "command, option, target",
    ("run", "--json", "folder"),
    ("run", "--json", "file/x.json"),
    ("run", "--json", "/proc/x.json"),
    ("run", "--out", "file"),
    ("run", "--out", "file/x"),
    ("forces", "--json", "folder"),
    ("forces", "--json", "file/x.json"),
)
def test_places_that_cannot_be_written_are_found_before_anything_is_computed(deck, capsys, monkeypatch, command, option, target):
    monkeypatch.chdir(deck.parent)
    Path("folder").mkdir()
    Path("file").write_text("")
    monkeypatch.setattr("openmm_dpd.lammps.run.main.open_deck", lambda *_, **__: pytest.fail("the deck was read"))
    assert main([command, str(deck), option, target, *(["--quiet"] if command == "run" else [])]) == 1
    error = capsys.readouterr().err
    assert error.startswith(f"openmm-dpd: error: {option}: ") and error.count("\n") == 1


def test_absolute_names_are_taken_as_they_are_and_this_is_said(deck, tmp_path, capsys):
    elsewhere = tmp_path / "elsewhere"
    lines = f"dump d all atom 10 {elsewhere}/d.*\nprint hello file {elsewhere}/hello\nprint hello file inside/hello\n"
    deck.write_text(FLUID.replace("run 50\nrun 30", lines + "run 10"))
    out = tmp_path / "out"
    assert main(["run", str(deck), "--platform", "Reference", "--out", str(out)]) == 0
    assert {path.name for path in elsewhere.iterdir()} == {"d.0", "d.10", "hello"}
    assert (out / "inside" / "hello").read_text() == "hello\n"
    said = [line for line in capsys.readouterr().out.splitlines() if line.startswith("note: /")]
    where = f"is an absolute path: the file is not written to the output folder {out}"
    assert said == [f"note: {elsewhere}/{name} {where}" for name in ("d.*", "hello")]


def test_discard_holds_for_each_run_that_is_as_long(deck):
    """The first run has 50 steps, the second one 30 and the last one none: of these nothing is left out."""
    deck.write_text(deck.read_text(encoding="utf-8") + "run 0\n", encoding="utf-8")
    runs = run_deck(deck, RunOptions(platform="Reference", threads=1, discard=31))["runs"]
    assert [run["averages_from"] for run in runs] == [40, 50, 80]


def test_ctrl_c_inside_a_force_callback_is_no_error(deck, capsys, monkeypatch):
    """OpenMM turns the KeyboardInterrupt of a callback into an exception of its own, without a text."""

    def interrupted(*_):
        try:
            signal.raise_signal(signal.SIGINT)
        except KeyboardInterrupt:
            raise dpd.RunError("the run stopped: <NULL>") from None

    before = signal.getsignal(signal.SIGINT)
    monkeypatch.setattr(cli, "_run", interrupted)
    assert main(["run", str(deck)]) == 130
    assert capsys.readouterr().err == "openmm-dpd: interrupted by SIGINT\n"
    assert signal.getsignal(signal.SIGINT) is before


def test_a_step_that_is_too_long_never_passes_without_a_word(deck, tmp_path, capsys, caplog):
    """Far too long: an error.  Too long: a warning and an entry for each run.  A flow has no one temperature to compare with."""
    target = tmp_path / "report.json"
    once = FLUID.replace("run 50\nrun 30", "run 800")  # so long that the rows of its end do not look like a quench
    arguments = ["run", str(deck), "--platform", "CPU", "--threads", "1", "--json", str(target), "--out", str(tmp_path / "out"), "--quiet"]

    def found(text: str, timestep: str) -> list[str | None]:
        deck.write_text(text.replace("timestep 0.01", f"timestep {timestep}"))
        assert main(arguments) == 0
        return [run["temperature_warning"] for run in json.loads(target.read_text())["runs"]]

    for timestep in ("0.5", "2.0"):
        deck.write_text(once.replace("timestep 0.01", f"timestep {timestep}"))
        assert main(arguments) == 1
        assert "in.fluid:21: the run stopped" in capsys.readouterr().err
    (text,) = found(once, "0.1")
    assert text.startswith("the kinetic temperature of the last 41 rows is ") and "above the set 1;" in text
    assert [record.getMessage() for record in caplog.records if record.name == "openmm_dpd"] == [f"{deck}:21: {text}"]
    assert found(FLUID.replace("run 50", "run 300"), "0.02") == [None, None]  # relaxed by then
    assert found(once.replace("all nve\n", "all nve\nfix push all addforce 2.0 0 0\n"), "0.02") == [None]
    assert capsys.readouterr().err == ""


@pytest.mark.parametrize("terminal", [False, True])
def test_a_progress_bar_needs_a_terminal(deck, tmp_path, monkeypatch, capsys, terminal):
    """In a batch job standard error is a file, and a bar would be one line of many kilobytes in it."""
    errors = io.StringIO()
    errors.isatty = lambda: terminal
    monkeypatch.setattr(sys, "stderr", errors)
    assert main(["run", str(deck), "--platform", "Reference", "--steps", "2", "--out", str(tmp_path / "out")]) == 0
    assert bool(errors.getvalue()) == terminal
    assert "files are in" in capsys.readouterr().out


def test_impossible_scheme_names_the_reason(deck, capsys):
    deck.write_text(FLUID.replace("pair_style dpd 1.0 1.0", "pair_style dpd/ext 1.0 1.0").replace(" 4.5\n", " 4.5 2.0 1.0 1.0\n"))
    assert main(["run", str(deck), "--platform", "Reference", "--scheme", "native", "--quiet"]) == 1
    assert "DPDIntegrator cannot run this scene: for types (1, 1) there is transverse friction" in capsys.readouterr().err


def test_native_scheme_runs_a_deck(deck):
    report = run_deck(deck, RunOptions(platform="CPU", scheme="native", steps=20, threads=1))
    assert report["scheme"] == "native" and np.isfinite(report["thermo"]["temp"]["mean"])
    # the native integrator has no noise of ours to report: its pressure is the conservative one
    assert report["thermo"]["press"]["mean"] != report["thermo"]["press_full"]["mean"]


def test_configurational_temperature_is_null_with_a_reason(tmp_path):
    report = run_deck(DECKS / "in.dpd_tstat", RunOptions(platform="CPU", steps=2, threads=1), out=tmp_path)
    assert report["thermo"]["temp_conf"] is None
    assert "Laplacian" in report["temp_conf_reason"]


def test_configurational_temperature_of_beads_out_of_reach_is_null_with_a_reason(deck, tmp_path):
    single = FLUID.replace("create_atoms 1 random 100 4243 box\ncreate_atoms 2 random 92 4244 box", "create_atoms 1 single 1 1 1 units box")
    single = single.replace("velocity all create 1.0 87287\n", "")
    deck.write_text(single)
    target = tmp_path / "single.json"
    assert main(["run", str(deck), "--platform", "Reference", "--quiet", "--json", str(target), "--out", str(tmp_path)]) == 0
    report = json.loads(target.read_text(), parse_constant=lambda word: pytest.fail(f"{word} is no JSON"))
    assert report["thermo"]["temp_conf"] is None and "Laplacian is 0" in report["temp_conf_reason"]

    # two beads that come into reach of each other: a row without a value is null, the others count
    second = "single 1 1 1 units box\ncreate_atoms 1 single 2.5 1 1 units box\nset atom 2 vx -5.0"
    deck.write_text(single.replace("single 1 1 1 units box", second))
    conf = run_deck(deck, RunOptions(platform="Reference", threads=1))["runs"][0]["thermo"]["temp_conf"]
    assert conf["first"] is None and np.isfinite(conf["mean"])


@pytest.mark.parametrize("deck_name", sorted(path.name for path in DECKS.glob("in.*") if path.name not in ("in.edpd", "in.tdpd")))
def test_every_example_deck_runs(deck_name, tmp_path):
    """Those with 16,000 beads are run by tests/decks/test_energy_decks.py."""
    report = run_deck(DECKS / deck_name, RunOptions(platform="CPU", steps=4, threads=1), out=tmp_path)
    assert all(np.isfinite(run["thermo"]["temp"]["last"]) for run in report["runs"])


@cases(
    "words, message",
    ("recommend DECK --error 3", "--error must be a fraction of the temperature from 0.0001 to 0.1"),
    ("recommend DECK --scheme fast", "--scheme: unknown scheme 'fast'"),
    ("explain DECK --dt -1", "--dt must be > 0"),
    ("explain DECK --seed 2147483648", "--seed must be less than 2^31"),
    ("run DECK --platform Abacus --out OUT", "--platform: there is no platform 'Abacus' here"),
    ("run DECK --threads 0 --out OUT", "--threads must be at least 1"),
    ("export DECK OUT --dt -1", "--dt must be > 0"),
    ("export DECK OUT --every -1", "--every must be at least 1"),
    ("export DECK OUT --seed -1", "--seed must be"),
)
def test_errors_name_options_as_they_are_written(deck, tmp_path, capsys, words, message):
    places = {"DECK": str(deck), "OUT": str(tmp_path / "out")}
    assert main([places.get(word, word) for word in words.split()]) == 1
    assert capsys.readouterr().err.startswith(f"openmm-dpd: error: {message}")


AFTER_WARM = """
import numpy as np, openmm_dpd as dpd
from openmm_dpd.runtime.numba_private import compiling
heard = []
x = np.random.default_rng(1).random((375, 3)) * 5
charges = np.where(np.arange(375) < 8, 1.0 - 2.0 * (np.arange(375) % 2), 0.0)
clouds = dpd.SlaterCharges(lamda=0.5, bjerrum_length=1.0, cutoff=2.0)
dpd.set_threads(1)
with compiling(lambda: heard.append(1)):
    stiff = {"bonds": [dpd.FENEBonds([[0, 1]], 1.0, 5.0)]}
    for scheme, more in (("bababo", {}), ("mvv", stiff), ("middle", {"charges": charges, "electrostatics": clouds})):
        scene = dpd.Scene({"W": 1.0}, ["W"] * 375, x, {("W", "W"): dpd.DPD(A=25, gamma=4.5)}, kT=1.0, box=[5, 5, 5], **more)
        built = dpd.build(scene, dt=0.01, scheme=scheme, platform="CPU", seed=1)
        simulation = built.simulation()
        simulation.step(12)
        dpd.Observer(built).sample(simulation.context)
print(len(heard))
"""


def test_after_warm_nothing_is_left_to_compile(capsys):
    """Another process, and scenes that ``warm`` does not have: a listener hears of every compilation."""
    assert main(["warm", "--threads", "1"]) == 0
    lines = capsys.readouterr().out.splitlines()
    assert "eDPD" in lines and "kernels are in" in lines[-1]
    done = subprocess.run([sys.executable, "-c", AFTER_WARM], capture_output=True, text=True, check=True)
    assert done.stdout.split()[-1] == "0", done.stderr
