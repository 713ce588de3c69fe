"""The reference suite: its files, its quantities against other ways to compute them, and what scores a word or the frames of another program."""

import json
from dataclasses import replace

import numpy as np
import pytest
from cases import cases

import openmm_dpd as dpd
from openmm_dpd.__main__ import main
from openmm_dpd.base.errors import ParameterError
from openmm_dpd.lammps import check_deck
from openmm_dpd.lammps.run.check import as_data
from openmm_dpd.score import BlockMeans, Judged, judge, load_suite, run_frames, run_word, score_word
from openmm_dpd.score.quantities import INTERVAL, QUANTITIES
from openmm_dpd.score.report import PEERS, gain
from openmm_dpd.score.scoring import climbed, forces, scenes_for, summed_up
from openmm_dpd.score.suite import FOLDER

SUITE = load_suite()


@pytest.fixture(autouse=True)
def undrawn():
    """Pictures are drawn."""


def test_the_file_is_as_its_schema_says():
    from jsonschema import Draft202012Validator

    data, schema = (json.loads((FOLDER / f"suite{end}.json").read_text(encoding="utf-8")) for end in ("", ".schema"))
    Draft202012Validator.check_schema(schema)
    Draft202012Validator(schema).validate(data)
    assert "CC-BY-4.0" in data["licence"] and "CC-BY-4.0" in (FOLDER / "LICENSE").read_text(encoding="utf-8")
    assert set(data["scenes"]) == {path.name.removeprefix("in.") for path in (FOLDER / "scenes").glob("in.*")} and len(data["scenes"]) == 12


def test_every_scene_is_a_deck_that_runs():
    for its in SUITE.values():
        assert as_data(check_deck(its.deck))["runs"]
        assert its.scene.n_beads > 800 and set(its.quantities) <= set(QUANTITIES)
        values = np.linalg.eigvalsh(its.covariance)
        assert np.all(values > -1e-9 * values.max()) and np.all(its.scale > 0)


def test_both_programs_agree_about_every_scene():
    """Deviations in standard errors of all quantities and scenes: none above 4, and their mean square as that of noise."""
    data = json.loads((FOLDER / "suite.json").read_text(encoding="utf-8"))
    z = [
        (its["openmm_dpd"][0] - its["LAMMPS"][0]) / np.hypot(its["openmm_dpd"][1], its["LAMMPS"][1])
        for entry in data["scenes"].values()
        for its in entry["quantities"].values()
    ]
    assert np.abs(z).max() < 4 and np.mean(np.square(z)) < 1 + 4 * (2 / len(z)) ** 0.5


@cases("word, count", ("mvv", 1), ("middle", 1), ("aboba", 1), ("bababo", 2), ("bab3", 3), ("B/2 A B/2 O", 1), ("A/2 B A/2 O", 1))
def test_force_evaluations_of_a_word(word, count):
    assert forces(word) == count


def dump(path, its, word, dt, time, columns=True):
    """Frames of a run here, as LAMMPS would write them: the box of a shear has moved on for the next step."""
    built = dpd.build(its.scene, dt=dt, scheme=word, platform="CPU", seed=1)
    simulation, every = built.simulation(properties={"Threads": "1"}), round(INTERVAL / dt)
    edges, rate = np.diag(its.scene.box).tolist(), its.scene.shear.rate if its.scene.shear else 0.0
    with path.open("w") as file:
        for k in range(round(time / INTERVAL) + 1):
            state = simulation.context.getState(positions=True, velocities=True)
            x, v = (np.array(values._value) for values in (state.getPositions(asNumpy=True), state.getVelocities(asNumpy=True)))
            fields = dpd.read_fields(simulation.context, built.plan)
            more = [np.ravel(fields["concentrations"])] if "concentrations" in fields and columns else []
            tilt = rate * (k * every + 1) * dt * edges[1]
            tilt -= edges[0] * np.rint(tilt / edges[0])
            rows = [[min(0.0, tilt), edges[0] + max(0.0, tilt), tilt], *([0.0, edge, 0.0] for edge in edges[1:])]
            ends = "\n".join(" ".join(f"{value:.15g}" for value in row[: 3 if rate else 2]) for row in rows)
            head = "id type x y z vx vy vz" + " c_species1" * len(more)
            file.write(
                f"ITEM: TIMESTEP\n{k * every}\nITEM: NUMBER OF ATOMS\n{len(x)}\nITEM: BOX BOUNDS{' xy xz yz' * bool(rate)} pp pp pp\n{ends}\nITEM: ATOMS {head}\n"
            )
            rows = np.column_stack([np.arange(1, len(x) + 1), its.scene.type_ids + 1, x, v, *more])
            np.savetxt(file, rows, fmt=["%d", "%d"] + ["%.12g"] * (rows.shape[1] - 2))
            simulation.step(every)


@pytest.mark.slow
def test_frames_of_a_run_say_what_the_run_says(tmp_path):
    """Of velocity Verlet, whose velocities do not lag: the same quantities from a dump as from the Context."""
    its, dt = SUITE["species"], INTERVAL / 16
    dump(tmp_path / "frames", its, "mvv", dt, 24.0)
    found, expected = run_frames(its, tmp_path / "frames", dt, discard=4.0), run_word(its, "mvv", dt, time=20.0, discard=3.75)
    assert not expected.reason
    np.testing.assert_allclose(found.mean[:2], expected.mean[:2], rtol=0.02)
    its = replace(its, reference=expected.mean, covariance=np.zeros_like(its.covariance))
    assert judge(its, dt, found).joint(0.01) < 0.05


def test_the_box_of_a_shear_is_that_of_the_forces(tmp_path):
    """That of the frame, one step ahead, would make the stress 2 % and the configurational temperature 3 % larger here."""
    its, dt = SUITE["shear"], INTERVAL / 16
    dump(tmp_path / "frames", its, "mvv", dt, 20.0)
    found, expected = run_frames(its, tmp_path / "frames", dt, discard=INTERVAL), run_word(its, "mvv", dt, time=20.0, discard=0.0)
    np.testing.assert_allclose(found.mean, expected.mean, rtol=1e-5)


def test_frames_that_lack_something_are_refused(tmp_path):
    its = SUITE["species"]
    dump(tmp_path / "frames", its, "mvv", INTERVAL / 16, 1.0, columns=False)
    with pytest.raises(ParameterError, match="do.* not have the beads' own .*concentrations"):
        run_frames(its, tmp_path / "frames", INTERVAL / 16)
    its = SUITE["standard"]
    dump(tmp_path / "frames", its, "mvv", INTERVAL / 16, 1.0)
    with pytest.raises(ParameterError, match="needs 80 frames or more after 20 units"):
        run_frames(its, tmp_path / "frames", INTERVAL / 16)


def judged_by(power, bound=0.08):
    """Runs whose only error grows with a power of the step, and reaches 1 % at a step."""
    return lambda dt: Judged(dt, np.array([0.01 * (dt / bound) ** power]), np.array([1e-9]), 1.0 / dt)


@cases("first", 0.02, 0.07, 0.5)
def test_the_longest_step_is_found_from_either_side(first):
    its = replace(SUITE["standard"], quantities=("T_kin",))
    score = summed_up(its, climbed(first, judged_by(2.0), 0.01), 0.01)
    assert score.limit == pytest.approx(0.08, rel=1e-6) and score.limited_by == "T_kin"
    assert score.seconds == pytest.approx(1 / 0.08)


def test_noise_and_breakdowns():
    its = SUITE["standard"]
    assert Judged(0.1, np.array([0.015]), np.array([0.01]), 1.0).joint(0.01) == pytest.approx(0.005)
    assert Judged(0.1, np.array([0.025]), np.array([0.01]), 1.0).joint(0.01) == pytest.approx(0.025)
    stopped = judge(its, 0.1, BlockMeans(np.full((1, 7), np.inf), reason="too long"))
    good = Judged(0.08, np.zeros(7), np.full(7, 1e-3), 1.0)
    score = summed_up(its, [good, stopped], 0.01)
    assert (score.limit, score.limited_by) == (0.08, "too long")
    assert json.loads(json.dumps(score.as_data()))["runs"][1] == {"dt": 0.1, "failed": "too long"}


def test_every_scene_has_a_scheme_to_compare_others_with():
    """Where velocity Verlet has no step within 1 %, it is LAMMPS's other scheme; one that scores as it does is as fast."""
    its = SUITE["conducting"]
    assert not its.scores["mvv"]["limit"] and all(any(its.scores.get(word, {}).get("limit") for word in PEERS) for its in SUITE.values())
    dt = its.scores["shardlow"]["limit"]
    good = Judged(dt, np.zeros(9), np.full(9, 1e-3), run_word(its, "shardlow", dt, time=20.0, discard=2.0).seconds)
    assert 0.5 < gain(summed_up(its, [good], 0.01)) < 2.0


def test_a_step_that_is_too_long_breaks_down():
    found = run_word(SUITE["stiff"], "mvv", 0.2, time=20.0)
    assert found.reason and np.isinf(found.mean).all()


@cases(
    "arguments, message",
    (["nothing"], "'nothing'"),
    (["middle", "--scenes", "lake"], "no scene 'lake' in the suite; its scenes are standard,"),
    (["middle", "--error", "0"], "error must be between 0 and 1"),
    (["middle", "--time", "5"], "samples is too short: 16 are needed after 6 units of time"),
    (["frames", "--dt", "0.01"], "scenes must be the one that the frames are of: standard,"),
)
def test_wrong_arguments_are_named(arguments, message, capsys):
    assert main(["score", *arguments]) == 1
    assert message in capsys.readouterr().err


def test_scenes_that_a_scheme_cannot_run_are_known():
    assert scenes_for(SUITE, "bababo") == list(SUITE)
    assert not {"slab", "conducting", "heat", "species"} & set(scenes_for(SUITE, "native"))


@pytest.mark.slow
def test_a_score_on_the_command_line(tmp_path, capsys):
    files = [tmp_path / "score.json", tmp_path / "score.png"]
    arguments = [
        "score",
        "B A/2 O A/2",
        "--scenes",
        "standard",
        "--time",
        "12",
        "--error",
        "0.05",
        "--json",
        str(files[0]),
        "--picture",
        str(files[1]),
    ]
    assert main(arguments) == 0
    out = capsys.readouterr().out
    assert "standard" in out and "times as fast as mvv" in out
    found = json.loads(files[0].read_text())["standard"]
    assert 0.03 < found["limit"] < 0.2 and files[1].stat().st_size > 10_000
    assert set(found["runs"][0]["errors"]) == set(SUITE["standard"].quantities)


@pytest.mark.slow
@pytest.mark.statistical
@pytest.mark.parametrize("part", [0, pytest.param(1, marks=pytest.mark.long), pytest.param(2, marks=pytest.mark.long)])
def test_short_steps_reproduce_the_reference(part):
    """Every third scene with a word and a seed that the reference does not know.  With errors from eight blocks, z^2 is 1.4 on average and has a
    variance of 8; diffusion is left out, since blocks of so short a run are correlated by its lag."""
    z = []
    for its in list(SUITE.values())[part::3]:
        run = judge(its, its.step, run_word(its, "bab3", its.step, time=60.0, seed=5))
        assert not run.reason
        # steps are short, but not 0
        z += [e / np.hypot(s, 0.001) for q, e, s in zip(its.quantities, run.errors, run.sems, strict=True) if not q.startswith("D")]
    assert np.mean(np.square(z)) < 1.4 + 4 * (8 / len(z)) ** 0.5, np.round(z, 1)


@pytest.mark.slow
def test_a_small_score_orders_the_schemes():
    """In the standard fluid ``bababo`` takes steps at least 1.4 times as long as ``middle``, which is within 1 % for longer than velocity
    Verlet: by factors of about 2.5 and 2 in longer runs."""
    mvv, middle, bababo = (score_word(word, ["standard"], time=60.0)[0].limit for word in ("mvv", "middle", "bababo"))
    assert middle > mvv and bababo > 1.4 * middle
