"""Runs: what the simulation is asked for, fixes, ramps, thermo output, dumps, and the example decks."""

import re
from pathlib import Path

import lammps_peer
import numpy as np
import pytest
from cases import cases, put, raises

from openmm_dpd.base.errors import DeckError, ParameterError
from openmm_dpd.lammps import RunRequest, read_deck
from openmm_dpd.lammps.language.arguments import INSTEAD
from openmm_dpd.lammps.run.deck import COMMANDS
from openmm_dpd.lammps.state.records import DeckSample
from openmm_dpd.lammps.values.resolver import Resolver
from openmm_dpd.lammps.values.words import WORDS
from openmm_dpd.model.temperature import TemperatureRamp

DECKS = Path(__file__).resolve().parents[2] / "examples" / "decks"

START = """units {units}
region b block 0 6 0 6 0 6 units box
create_box 2 b
create_atoms 1 random 30 1 b
create_atoms 2 random 20 2 b
mass 1 1.0
mass 2 2.0
pair_style dpd 1.0 1.0 77
pair_coeff * * 25 4.5
velocity all create 1.0 5
group one type 1
group two type 2
"""


def write(tmp_path, text: str, units: str = "lj") -> Path:
    return put(tmp_path / "in.deck", START.format(units=units) + text)


def sample_of(request: RunRequest, step: int | None = None, **values) -> DeckSample:
    scene = request.scene()
    kinetic = 0.5 * float(scene.bead_masses @ np.sum(scene.velocities**2, axis=1))
    defaults = {"pair_energy": 100.0, "bond_energy": 10.0, "virial": 300.0, "virial_full": 360.0, "force_norm": 7.0, "force_max": 2.0}
    defaults |= {"fields": {}, "virial_tensor": np.arange(6.0), "kinetic_tensor": np.ones(6)}
    return DeckSample(request.first_step if step is None else step, kinetic, **{**defaults, **values})


def requests_of(tmp_path, text: str, callback=None, **options) -> list[RunRequest]:
    found: list[RunRequest] = []

    def collect(request: RunRequest) -> None:
        found.append(request)
        if callback is not None:
            callback(request)

    read_deck(write(tmp_path, text), run_callback=collect, output=tmp_path, **options)
    return found


# -- runs --------------------------------------------------------------------------------------------------------------------
def test_several_runs(tmp_path):
    text = "fix 1 all nve\ntimestep 0.01\nthermo 50\nrun 100\nunfix 1\nfix 2 all mvv/dpd 0.65\ntimestep 0.02\nrun 300 upto\n"
    text += "reset_timestep 1000\nrun 0\nrun 70 start 0 stop 5000\n"
    first, second, third, fourth = requests_of(tmp_path, text)
    expected = [(0, 100, 100), (100, 200, 300), (1000, 0, 1000), (1000, 70, 1070)]
    assert [(r.first_step, r.steps, r.last_step) for r in (first, second, third, fourth)] == expected
    assert [r.dt for r in (first, second)] == [0.01, 0.02]
    assert [(r.scheme, r.lambda_) for r in (first, second)] == [("mvv", 0.5), ("mvv", 0.65)]
    assert (fourth.window.begin, fourth.window.end) == (0, 5000)
    assert [r.number for r in (first, second, third, fourth)] == [0, 1, 2, 3]
    assert first.seed == 77 and first.where.number == 16


def test_the_clock(tmp_path):
    """Time goes on when the time step changes; going back with reset_timestep sets it to 0 (as LAMMPS 22Jul2025 does)."""
    times = []

    def callback(request):
        steps = (request.first_step, request.last_step)
        times.append([request.thermo.values(sample_of(request, step), ("time",))["time"] for step in steps])

    text = "fix 1 all nve\ntimestep 0.01\nrun 100\ntimestep 0.02\nrun 100\nreset_timestep 0\nrun 10\nreset_timestep 100\nrun 10\n"
    text += "reset_timestep 50\nrun 10\nreset_timestep 70 time 3.0\nrun 10\n"
    requests_of(tmp_path, text, callback)
    np.testing.assert_allclose(times, [[0, 1], [1, 3], [0, 0.2], [2, 2.2], [0, 0.2], [3, 3.2]])


def test_results_go_back_to_the_deck(tmp_path):
    def callback(request):
        scene = request.scene()
        v, sample = np.full_like(scene.velocities, 2.0), sample_of(request, request.last_step)
        request.finish(scene.positions + [7.0, -1.0, 0.0], v, sample=sample)

    text = 'fix 1 all nve\nrun 10\nvariable a equal pe+step\nvariable b equal vcm(all,x)\nprint "${a} ${b}"\nwrite_data out.*\nrun 5\n'
    said: list[str] = []
    requests = requests_of(tmp_path, text, callback, log=said.append)
    assert said == ["12.2 2"]  # 100 + 10 over 50 beads, plus the step; velocities are the new ones
    assert (tmp_path / "out.10").exists()
    assert requests[-1].state.step == 15


def test_images_count_how_often_a_bead_left_the_box(tmp_path):
    starts = []

    def callback(request):
        scene = request.scene()
        starts.append(request.state.box.unwrap(request.state.atoms.positions, request.state.atoms.images))
        request.finish(scene.positions + [7.0, -1.0, 13.0], scene.velocities)

    (first, second) = requests_of(tmp_path, "fix 1 all nve\nrun 10\nrun 10\n", callback)
    np.testing.assert_allclose(starts[1] - starts[0], np.tile([7.0, -1.0, 13.0], (50, 1)))
    assert np.all((second.scene().positions >= 0) & (second.scene().positions < 6))


def test_an_energy_of_a_run_that_is_over_is_not_current(tmp_path):
    text = 'fix 1 all nve\nrun 10\nreset_timestep 0\nprint "$(pe)"\n'

    def callback(request):
        request.finish(request.scene().positions, request.scene().velocities, sample=sample_of(request, request.last_step))

    raises(DeckError, r"in.deck:16: an energy, temperature or force is used before a run", lambda: requests_of(tmp_path, text, callback))


def test_overrides(tmp_path):
    (request,) = requests_of(tmp_path, "fix 1 all nve\nrun 10\n")
    other = request.override(steps=500, dt=0.03, scheme="middle")
    assert (other.steps, other.dt, other.scheme, other.last_step) == (500, 0.03, "middle", 500)
    assert other.thermo.due(500) and other.window.end == 500
    assert request.override().steps == 10


def test_stopping_before_the_first_run(tmp_path):
    state = read_deck(write(tmp_path, "fix 1 all nve\nrun 10\nnonsense\n"), stop_before_first_run=True)
    assert state.first_run.steps == 10 and state.first_run.scene().n_beads == 50
    state = read_deck(write(tmp_path, "fix 1 all nve\n"), stop_before_first_run=True)
    assert state.first_run.steps == 0


@cases(
    "error, seen, message",
    (ParameterError("something about the scene"), DeckError, r"in.deck:14: something about the scene"),
    (ValueError("a bug"), ValueError, "^a bug$"),
)
def test_errors_of_the_simulation_are_located_at_the_run_and_bugs_are_not(tmp_path, error, seen, message):
    def callback(request):
        raise error

    raises(seen, message, lambda: requests_of(tmp_path, "fix 1 all nve\nrun 10\n", callback))


def test_include_quit_and_notes(tmp_path):
    (tmp_path / "part").write_text("neighbor 0.3 bin\nneighbor 0.4 bin\nthermo ${every}\n")
    text = "include part\nfix 1 all nve\ncomm_modify vel yes\nrun 10\nquit\nnonsense\n"
    (request,) = requests_of(tmp_path, text, variables={"every": "5"})
    assert request.thermo.every == 5
    assert request.state.notes == ["neighbor has no effect here; keep it for LAMMPS", "comm_modify has no effect here; keep it for LAMMPS"]


def test_errors_in_and_of_included_files(tmp_path):
    files = {f"part{k}": f"thermo 5\ninclude part{k + 1}\n" for k in range(2000)} | {"three": "thermo 7\n"}
    for name, text in {**files, "odd": "thermo 5\nnonsense\n", "one": "thermo 5\ninclude two\n", "two": "include one\n"}.items():
        put(tmp_path / name, text)
    for name, message in (
        ("odd", r"odd:2: unknown or unsupported command 'nonsense'"),
        ("part0", "part99:2: include 'part100': include files are nested more than 100 deep"),
        ("one", r"two:1: include 'one': the file includes itself"),
    ):
        raises(DeckError, message, lambda name=name: requests_of(tmp_path, f"include {name}\n"))
    requests_of(tmp_path, "include three\ninclude three\nfix 1 all nve\nrun 1\n")  # the same file twice in a row is fine


def test_a_deck_without_a_box_has_nothing_to_look_at(tmp_path):
    (tmp_path / "in.empty").write_text("units lj\n")
    raises(DeckError, "in.empty: the deck creates no simulation box", lambda: read_deck(tmp_path / "in.empty", stop_before_first_run=True))


def test_a_run_needs_a_pair_style_even_if_it_is_none(tmp_path):
    beads = START.format(units="lj").replace("pair_style dpd 1.0 1.0 77\npair_coeff * * 25 4.5\n", "{}") + "fix 1 all nve\nrun 1\n"
    path = put(tmp_path / "in.deck", beads.format(""))
    raises(DeckError, r"in.deck:12: run needs a preceding pair_style; .* 'pair_style none'", lambda: read_deck(path))
    assert read_deck(put(path, beads.format("pair_style none\n"))).runs == 1


def test_velocities_by_id_do_not_draw_for_every_number_up_to_a_huge_id(tmp_path):
    text = "two beads\n\n2 atoms\n1 atom types\n0 4 xlo xhi\n0 4 ylo yhi\n0 4 zlo zhi\n\n"
    (tmp_path / "data").write_text(text + "Masses\n\n1 1\n\nAtoms\n\n1 1 1 1 1\n2000000000 1 2 2 2\n")
    path = put(tmp_path / "in.sparse", "read_data data\nvelocity all create 1 5\n")
    with pytest.raises(DeckError, match="in.sparse:2: velocity create: 2 beads have ids up to 2000000000, .* use 'loop geom'"):
        read_deck(path, stop_before_first_run=True)
    assert read_deck(put(path, "read_data data\nvelocity all create 1 5 loop geom\n"), stop_before_first_run=True).atoms.velocities.any()


# -- ramps -------------------------------------------------------------------------------------------------------------------
def test_a_ramp_over_two_runs(tmp_path):
    text = "pair_style dpd/tstat 1.0 3.0 1.0 7\npair_coeff * * 4.5\nfix 1 all nve\nrun 100 start 0 stop 400\nrun 300 start 0 stop 400\n"
    text += "reset_timestep 0\nrun 50\nrun 0\n"
    text += "pair_style dpd/tstat 2.0 2.0 1.0 7\npair_coeff * * 4.5\nrun 10\n"
    found = []
    requests_of(tmp_path, text, lambda request: found.append(request.scene().kT))
    assert found == [TemperatureRamp(1, 3, 0, 400), TemperatureRamp(1, 3, -100, 300), TemperatureRamp(1, 3, 0, 50), 1.0, 2.0]


# -- fixes -------------------------------------------------------------------------------------------------------------------
def test_beads_in_no_fix_are_frozen_and_keep_their_velocity(tmp_path):
    (request,) = requests_of(tmp_path, "velocity two set 1 0 0 units box\nfix 1 one nve\nrun 10\n")
    scene = request.scene()
    assert scene.mobile.tolist() == [True] * 30 + [False] * 20
    assert np.array_equal(scene.velocities[30:], np.tile([1.0, 0, 0], (20, 1)))


FDT = "pair_style dpd/fdt 1.0 1.0 7\npair_coeff * * 25 3\n"


def test_two_fixes_on_disjoint_groups_then_shardlow_and_none(tmp_path):
    (request,) = requests_of(tmp_path, "fix 1 one nve\nfix 2 two mvv/dpd 0.5\nrun 10\n")
    assert request.scene().mobile is None and request.lambda_ == 0.5
    (request,) = requests_of(tmp_path, FDT + "fix s all shardlow\nfix n all nve\nrun 10\n")
    assert request.scheme == "shardlow"
    (request,) = requests_of(tmp_path, "run 10\n")
    assert not request.mobile.any() and "no fix moves any beads" in request.state.notes


FORMS = {"fix": "fix 1 all {} 1 2 3", "compute": "compute 1 all {} 1 2", "dump": "dump 1 all {} 10 f", "pair": "pair_style {} 1"}
FORMS |= {"fix gravity": "fix 1 all gravity 1 {} 1 2 3 4", "compute chunk/atom": "compute 1 all chunk/atom {}"}


def test_every_hint_is_said_to_those_who_need_it(tmp_path):
    """All commands that LAMMPS has are carried out, or have a hint in the place of the word that is most like theirs."""
    for name, hint in INSTEAD.items():
        kind, _, style = name.rpartition(" ")
        line = FORMS.get(kind, f"{kind} {{}}").format(style)
        raises(DeckError, re.escape(hint), lambda line=line: requests_of(tmp_path, f"{line}\n"))
    lammps_peer.need(("pair", "dpd"))
    with lammps_peer.instance() as lmp:
        assert set(lmp.available_styles("command")) <= set(COMMANDS) | set(INSTEAD)


@cases(
    "text, message",
    ("fix 1 all nve\n", "the deck has no run command"),
    ("fix 1 all nve\nfix 2 two nve\nrun 1\n", "in.deck:14: fix 2: bead 31 is moved by fix 1 already"),
    ("fix 1 one nve\nfix 2 two mvv/dpd 0.65\nrun 1\n", r"different lambda \(0.5, 0.65\)"),
    ("fix 1 all mvv/dpd 1.5\n", "lambda must be between 0 and 1, but is 1.5"),
    ("fix 1 all adopt 1\n", "in.deck:13: fix style 'adopt' is not supported; supported are nve, nve/sphere, mvv/dpd, mvv/edpd, "),
    (
        "fix 1 all temp/csvr 1 1 1 7\n",
        "fix style 'temp/csvr' is not supported: use fix nvt, fix langevin with fix nve, .* dpd/tstat",
    ),
    ("pair_coef 1 1 25 4.5\n", "unknown or unsupported command 'pair_coef'; did you mean pair_coeff?"),
    ("fix 1 all mvv/dpdd\n", "supported are nve, .*; did you mean mvv/dpd?"),
    ("compute v all presure thermo_temp\n", "; did you mean pressure?"),
    ("thermo_style custom step prss\n", "; did you mean press?"),
    ("print '$(sqr(2))'\n", "there is no function sqr; .*; did you mean sqrt?"),
    ("print '$(setp)'\n", "there is no thermo word 'setp'; .*; did you mean step?"),
    ("thermo_modify nrom yes\n", "thermo_modify has no option 'nrom' here; .*; did you mean norm?"),
    ("velocity all crate 1 2\n", "velocity style 'crate' is not supported; .*; did you mean create?"),
    ("velocity on set 1 1 1\n", "there is no group 'on'; .*; did you mean one?"),
    ("pair_style dpdd 1 1 1\n", "pair style 'dpdd' is not supported; .*; did you mean dpd?"),
    ("temper 100 100 1 1 2 3\n", "in.deck:13: temper: a deck simulates a single copy of its system"),
    ("pair_coeff 1 2 25 4.5 0\n", "in.deck:13: the cutoff must be > 0, but is 0; use 'pair_coeff i j none' for types that do not interact"),
    ("fix g all gravity 1 vector 0 0 0\n", "has no direction"),
    ("variable a atom x\nfix g all gravity v_a chute 1\n", "variable a is atom-style; expected an equal-style variable"),
    ("fix g all gravity 1 chute 1\nthermo_style custom f_g\n", "there is no fix 'g' with a value"),
    ("compute t all temp/profile 0 0 0 x 2\n", "one of its flags must be 1"),
    ("compute t all temp/profile 1 0 0 x 2 out bin\nthermo_style custom c_t[1]\n", r"has a table of values; use c_t\[row\]\[column\]"),
    ("compute_modify here extra/dof 1\n", "'here' is not the id of a compute of style temp"),
    ("fix a all ave/correlate 1 2 1 c_thermo_temp\n", "Nfreq must be a multiple of Nevery, at least Nrepeat"),
    ("fix a all ave/correlate 1 2 2 c_thermo_temp overwrite\n", "overwrite requires 'ave running'"),
    ("fix a all ave/correlate 1 2 2 c_thermo_temp type lower\n", "type lower has no pairs for a single value"),
    ("fix a all ave/correlate 1 2 2 c_thermo_temp\nthermo_style custom f_a[3][1]\n", "the fix has 2 rows and 3 columns"),
    ("set type 1 vx v_a\n", "there is no variable 'a'"),
    ("variable a atom id*100\nset type 1 type v_a\n", "atom type 100 is out of range: there are 2"),
    ("write_dump all custom a.txt id fx\n", "an energy, temperature or force is used before a run"),
    ("fix 1 most nve\n", "there is no group 'most'"),
    ("fix 1 all nve 5\n", "expected 'fix ID group nve', but found 1 argument"),
    ("fix 1 all nve\nfix 1 all mvv/dpd\n", "there already is a fix 1 of style nve"),
    ("unfix 1\n", "there is no fix '1'"),
    ("fix 1 all shardlow\nfix 2 all nve\nrun 1\n", "fix shardlow needs pair style dpd/fdt or dpd/fdt/energy; the deck has dpd"),
    (FDT + "fix 2 all nve\nfix 1 all shardlow\nrun 1\n", "in.deck:16: fix 1: fix shardlow must come before"),
    (FDT + "fix 1 all shardlow\nrun 1\n", "needs a fix nve after it"),
    (FDT + "fix 1 all shardlow\nfix 3 all shardlow\nfix 2 all nve\nrun 1\n", r"there already is a fix shardlow \(1\)"),
    (FDT + "fix 1 all shardlow\nfix 2 all mvv/dpd\nrun 1\n", "with fix shardlow, use fix nve"),
    (
        "pair_style hybrid/overlay dpd/fdt 1 1 7 dpd/tstat 1 1 1 7\npair_coeff * * dpd/fdt 25 3\npair_coeff * * dpd/tstat 4\n"
        "fix 1 all shardlow\nfix 2 all nve\nrun 1\n",
        "pair style dpd/tstat with fix shardlow is not supported",
    ),
    ("group two delete\nfix 1 all nve\ngroup one delete\nfix 2 one nve\n", "there is no group 'one'"),
    ("fix 1 one nve\ngroup one delete\n", "group one is used by fix 1"),
    ("run\n", "expected 'run N ...', but found 0 arguments"),
    ("run -5\n", "the number of steps must be at least 0"),
    ("run 1e3\n", "expected a whole number for the number of steps, not '1e3'"),
    ("run 10 every 0 NULL\n", "every must be at least 1"),
    ("reset_timestep 50\nrun 10 upto\n", "the present step, 50, is later"),
    ("run 10 start 5\n", "start 5 is after the first step of the run, 0"),
    ("run 10 stop 5\n", "stop 5 is before the last step of the run, 10"),
    ("timestep 0\n", "the time step must be > 0"),
    ("fire 1\n", "in.deck:13: unknown or unsupported command 'fire'$"),
    ("mass 1 nan\n", "the mass must be finite"),
    ("thermo_style custom step pyx\n", "thermo word 'pyx' is not supported; supported are step"),
    ("thermo_style custom v_x\n", "there is no variable 'x'"),
    ("variable x index 1\nthermo_style custom v_x\n", "variable x is index-style; only equal-style variables can be printed"),
    ("thermo_style custom c_x\n", "there is no compute 'x'; defined are thermo_temp"),
    ("thermo_style custom c_thermo_pe[1]\n", r"compute thermo_pe has a single value only; use c_thermo_pe"),
    ("variable a equal random(0,1,0.5)\nprint $a\n", "the seed of random must be a whole number of at least 1, not 0.5"),
    ("thermo_style custom f_1\n", "f_1: there is no fix '1' with a value; fix ave/time has values"),
    ("compute m all momentum\nthermo_style custom c_m\n", "compute m .style momentum. has no single value; use c_m.1."),
    ("compute x all dpd\n", "compute dpd needs atom_style dpd"),
    ("thermo_modify norm maybe\n", "expected yes or no for norm"),
    ("thermo_modify colour blue\n", "thermo_modify has no option 'colour'"),
    ("thermo_modify format float abc\n", "expected a format such as %12.6f, not 'abc'"),
    ("thermo_modify format float %.15X\n", "'%.15X' is not a format for float; expected one such as %12.6f"),
    ("thermo_modify format int %8.3f\n", "'%8.3f' is not a format for int; expected one such as %8d"),
    ("thermo_modify format line '%d %g'\n", "has 2 conversions for 6 columns"),
    ("thermo_modify format line 'step %d %g %g %g %g %g'\n", "must have one conversion in each word"),
    ("dump 1 all custom 10 d%.txt id\n", "one file per processor .%. is not supported"),
    ("thermo_modify temp x\n", "'x' is not the id of a compute of style temp"),
    ("dump 1 all custom 10 a id fast\n", "a column of dump custom must be one of"),
    ("dump 1 all custom 10 a id c_x\n", "c_x: there is no compute 'x'"),
    ("dump 1 all atom 0 a\n", "the interval of the dump must be at least 1"),
    ("undump 1\n", "there is no dump '1'"),
    ("variable a equal v_b\nvariable b equal v_a\nprint $a\n", "in.deck:14: variable b: variable a refers to itself: a -> b -> a"),
    ("variable a equal 1/0\nprint '${a}'\n", "in.deck:13: variable a: cannot evaluate the formula '1/0': division by zero"),
    ("print '$(temp)'\n", "in.deck:13: an energy, temperature or force is used before a run"),
    ("print ${b}\n", "in.deck:13: there is no variable 'b'"),
)
def test_errors(tmp_path, text, message):
    raises(DeckError, message, lambda: requests_of(tmp_path, text))


# -- thermo output -----------------------------------------------------------------------------------------------------------
def values_of(tmp_path, text: str, **sample) -> dict[str, float]:
    found: dict[str, float] = {}
    requests_of(tmp_path, text, lambda request: found.update(request.thermo.values(sample_of(request, **sample))))
    return found


def test_normalisation(tmp_path):
    text = "fix 1 all nve\nvariable p equal pe/count(all)\nthermo_style custom pe ke etotal temp v_p c_thermo_pe\n{}run 1\n"
    normed, total = (values_of(tmp_path, text.format(extra)) for extra in ("", "thermo_modify norm no\n"))
    assert normed["pe"] == pytest.approx(110 / 50) and total["pe"] == 110
    assert normed["v_p"] == pytest.approx(110 / 50 / 50)  # LAMMPS normalises words in formulas as well
    assert normed["c_thermo_pe"] == pytest.approx(110 / 50)
    assert normed["temp"] == total["temp"] == pytest.approx(1.0)
    assert normed["ke"] == pytest.approx(1.5 * 49 / 50) and total["ke"] == pytest.approx(1.5 * 49)


def test_every_word_has_a_value_and_pressures_theirs(tmp_path):
    found = values_of(tmp_path, f"fix 1 all nve\nthermo_style custom {' '.join(WORDS)}\nrun 1\n", kT_conf=1.25)
    assert set(found) == set(WORDS) and all(np.isfinite(list(found.values())))
    expected = {"press": (147 + 300) / 648, "press_full": (147 + 360) / 648, "temp_conf": 1.25}
    assert {name: found[name] for name in expected} == pytest.approx(expected)


def test_what_was_not_measured_is_an_error(tmp_path):
    with pytest.raises(DeckError, match="thermo output fmax: the simulation did not measure force max"):
        values_of(tmp_path, "fix 1 all nve\nthermo_style custom fmax\nrun 1\n", force_max=None)


def test_a_temperature_on_a_group(tmp_path):
    text = "velocity two scale 3.0\ncompute t two temp\nfix 1 all nve\nthermo_style custom temp ke press c_t c_thermo_temp\n"
    text += "thermo_modify temp t\nrun 1\n"
    seen = {}

    def callback(request):
        seen.update(request.thermo.values(sample_of(request, velocities=request.scene().velocities)))

    requests_of(tmp_path, text, callback)
    kinetic = 0.5 * 57 * 3.0
    assert seen["temp"] == pytest.approx(3.0) == seen["c_t"] == seen["c_thermo_temp"]
    assert seen["ke"] == pytest.approx(kinetic / 50)
    assert seen["press"] == pytest.approx((2 * kinetic + 300) / 648)


def test_compute_dpd_counts_the_internal_energies_of_an_isothermal_run(tmp_path):
    text = "set group all dpd/theta 300\nset atom 1 dpd/theta 100\ncompute u all dpd\nfix 1 all nve\n"
    text += "thermo_style custom c_u[1] c_u[4] c_u[5]\nrun 1\n"
    path = write(tmp_path, text, "metal\natom_style dpd")
    found: dict[str, float] = {}
    read_deck(path, run_callback=lambda request: found.update(request.thermo.values(sample_of(request))))
    assert found == pytest.approx({"c_u[1]": 0, "c_u[4]": 50 / (49 / 300 + 1 / 100), "c_u[5]": 50})


def test_rows_are_due_first_last_and_at_multiples(tmp_path):
    (_, request) = requests_of(tmp_path, "fix 1 all nve\nthermo 50\nrun 30\nrun 100\n")
    assert [step for step in range(30, 131) if request.thermo.due(step)] == [30, 50, 100, 130]
    step, seen = 30, []
    while step < 130:
        step = request.thermo.next_due(step)
        seen.append(step)
    assert seen == [50, 100, 130]
    (request,) = requests_of(tmp_path, "fix 1 all nve\nrun 100\n")
    assert request.thermo.next_due(0) == 100


# -- dumps -------------------------------------------------------------------------------------------------------------------
def dump_run(request: RunRequest) -> None:
    """Move all beads by 0.1 along x each step."""
    scene = request.scene()
    for step in range(request.first_step, request.last_step + 1):
        x = scene.positions + [0.1 * (step - request.first_step), 0, 0]
        for dump in request.dumps:
            if dump.due(step):
                sample = DeckSample(step, positions=x, velocities=scene.velocities, forces=np.full_like(x, 3.0))
                dump.write(Resolver(request.state, sample, request.window))
    request.finish(x, scene.velocities)


def frames(path: Path) -> list[tuple[int, list[list[str]]]]:
    blocks = path.read_text().split("ITEM: TIMESTEP\n")[1:]
    return [
        (int(block.split("\n", 1)[0]), [line.split() for line in block.splitlines() if line[0].isdigit() or line[0] == "-"][5:])
        for block in blocks
    ]


def test_text_dumps(tmp_path):
    text = "fix 1 all nve\ndump 1 two custom 20 some.dump id type x xu ix vx fz\ndump 2 all atom 50 atom.*.dump\n"
    text += "dump_modify 1 first yes format xu %.3f\nrun 50\nundump 2\nrun 50\n"
    (request, _) = requests_of(tmp_path, text, dump_run)
    found = frames(tmp_path / "some.dump")
    assert [step for step, _ in found] == [0, 20, 40, 60, 80, 100]
    assert all(len(rows) == 20 for _, rows in found)
    first = np.array(found[0][1], dtype=float)
    last = np.array(found[-1][1], dtype=float)
    assert first[:, 0].tolist() == list(range(31, 51)) and set(first[:, 1]) == {2.0}
    np.testing.assert_allclose(last[:, 3] - first[:, 3], 10.0, atol=2e-3)
    np.testing.assert_allclose(last[:, 3], last[:, 2] + 6 * last[:, 4], atol=2e-3)
    assert set(last[:, 6]) == {3.0}
    assert sorted(path.name for path in tmp_path.glob("atom.*")) == ["atom.0.dump", "atom.50.dump"]


def test_dcd_dumps_go_on_over_runs(tmp_path):
    from mdtraj.formats import DCDTrajectoryFile

    requests = requests_of(tmp_path, "fix 1 all nve\ndump 1 two dcd 20 some.dcd\nrun 50\nrun 50\n", dump_run)
    with DCDTrajectoryFile(str(tmp_path / "some.dcd")) as file:
        positions, lengths, angles = file.read()
    assert positions.shape == (6, 20, 3)
    np.testing.assert_allclose(lengths, 6)
    np.testing.assert_allclose(angles, 90)
    scene = requests[0].state
    assert np.all((positions >= 0) & (positions <= 6)) and scene.dumps["1"].last_step == 100


def test_forces_must_be_handed_over(tmp_path):
    (request,) = requests_of(tmp_path, "fix 1 all nve\ndump 1 all custom 10 a fx\nrun 1\n")
    (dump,) = request.dumps
    scene = request.scene()
    with pytest.raises(ParameterError, match="did not measure forces"):
        dump.write(Resolver(request.state, DeckSample(0, positions=scene.positions, velocities=scene.velocities), request.window))
    dump.close()


# -- the example decks -------------------------------------------------------------------------------------------------------
@pytest.mark.parametrize("path", sorted(DECKS.glob("in.*")), ids=lambda path: path.name)
def test_example_decks(tmp_path, path):
    """Each parses to valid scenes, run by run, and its thermo words have values."""
    rows = []

    def callback(request: RunRequest) -> None:
        scene = request.scene()
        assert scene.n_beads == len(request.state.atoms) and np.all(np.isfinite(scene.positions))
        sample = sample_of(request, positions=scene.positions, velocities=scene.velocities)
        rows.append(request.thermo.row(request.thermo.values(sample), sample))

    state = read_deck(path, run_callback=callback, output=tmp_path)
    assert len(rows) == state.runs >= 1
